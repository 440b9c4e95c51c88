/* The table of queries that every language answers alike: queries TABLE VECTORS. reader/src/tests/queries.rs says what its lines mean. Prints each
 * line whose answer is another one; ends with 1 if there is any. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lodpack.h"

static const char *const KINDS[] = {"ok", "source", "format", "unsupported", "query", "limit", "argument", "internal"};
static const char *const MEANINGS[] = {"unknown", "colour", "scalar", "normal", "label", "factor", "drawing"};
static const char *const LIMITERS[] = {"tolerance", "finest", "triangles", "nodes", "bytes"};

/* FNV-1a of 64 bits. */
static uint64_t hashed(uint64_t hash, const void *bytes, size_t length) {
    const unsigned char *at = bytes;
    while (length--) {
        hash = (hash ^ *at++) * UINT64_C(0x100000001b3);
    }
    return hash;
}

static lodpack_file *opened(const char *vectors, const char *name) {
    char path[1024];
    lodpack_file *file = NULL;
    snprintf(path, sizeof path, "%s/%s.lodpack", vectors, name);
    if (lodpack_open(path, &file) != LODPACK_STATUS_OK) {
        fprintf(stderr, "%s\n", lodpack_last_error());
        exit(2);
    }
    return file;
}

/* Answers a question, which is cut into words, and compares with what is expected. */
static int is_expected(const char *vectors, char *asked, char *expected) {
    char answer[256], carried[64] = "";
    const char *channel = NULL;
    lodpack_query query = lodpack_query_default();
    lodpack_heights_query of_heights = lodpack_heights_query_default();
    lodpack_file *file = opened(vectors, strtok(asked, " ")), *drawer = NULL;
    lodpack_info info;
    lodpack_cut *cut = NULL;
    lodpack_mesh *mesh = NULL;
    lodpack_cut_info about;
    lodpack_status status;
    char *word;
    while ((word = strtok(NULL, " "))) {
        char *value = strchr(word, '=');
        value = value ? value + 1 : word;
        if (!strncmp(word, "tolerance=", 10)) {
            query.tolerance = of_heights.tolerance = strtod(value, NULL);
        } else if (!strncmp(word, "triangles=", 10)) {
            query.max_triangles = of_heights.max_triangles = strtoull(value, NULL, 10);
        } else if (!strncmp(word, "nodes=", 6)) {
            query.max_nodes = strtoull(value, NULL, 10);
        } else if (!strncmp(word, "bytes=", 6)) {
            query.max_bytes = strtoull(value, NULL, 10);
        } else if (!strncmp(word, "box=", 4)) {
            int k;
            for (k = 0; k < 6; k++) {
                double *corner = k < 3 ? query.box_low : query.box_high;
                corner[k % 3] = strtod(value, &value);
                if (k % 3 < 2) {
                    (k < 3 ? of_heights.low : of_heights.high)[k % 3] = corner[k % 3];
                }
                value++;
            }
        } else if (!strcmp(word, "context")) {
            query.outside = LODPACK_OUTSIDE_COARSEST;
        } else if (!strncmp(word, "channel=", 8)) {
            channel = value;
        } else if (!strncmp(word, "drawn-by=", 9)) {
            drawer = opened(vectors, value);
        }
    }
    lodpack_get_info(file, &info);
    status = info.kind == LODPACK_KIND_HEIGHTS ? lodpack_select_heights(file, &of_heights, &cut)
                                               : lodpack_select(file, &query, &cut);
    if (status == LODPACK_STATUS_OK && channel) {
        lodpack_channel of;
        uint32_t number = 0;
        /* C asks by number. */
        while (number < info.channel_count && (lodpack_get_channel(file, number, &of), strcmp(of.name, channel))) {
            number++;
        }
        status = number < info.channel_count ? lodpack_decode_channels(file, cut, &number, 1, &mesh) : LODPACK_STATUS_QUERY;
        if (status == LODPACK_STATUS_OK) {
            snprintf(carried, sizeof carried, "%s:%s", of.name, MEANINGS[of.meaning]);
        }
    } else if (status == LODPACK_STATUS_OK) {
        status = lodpack_decode(drawer ? drawer : file, cut, &mesh);
    }
    snprintf(answer, sizeof answer, "%s", KINDS[status]);
    if (status == LODPACK_STATUS_OK) {
        size_t vertices = lodpack_vertex_count(mesh), triangles = lodpack_triangle_count(mesh);
        double *positions = malloc(vertices * 24 + 1), error = 0, everywhere = 0;
        uint32_t *corners = malloc(triangles * 12 + 1);
        uint64_t hash = UINT64_C(0xcbf29ce484222325);
        unsigned long of[3] = {0, 0, 0};
        char limiter[16] = "", hex[20] = "", of_channel[64] = "";
        lodpack_get_cut_info(cut, &about);
        lodpack_copy_positions(mesh, positions, vertices, 0);
        lodpack_copy_triangles(mesh, corners, triangles);
        hash = hashed(hashed(hash, positions, vertices * 24), corners, triangles * 12);
        snprintf(answer, sizeof answer, "%" PRIu64 " %lu %lu %.17g %.17g %s %016" PRIx64, about.node_count,
                 (unsigned long)triangles, (unsigned long)vertices, about.error, about.error_everywhere,
                 LIMITERS[about.limited_by], hash);
        /* Numbers are compared as numbers: they may be written in other ways. */
        if (sscanf(expected, "%lu %lu %lu %lf %lf %15s %19s %63s", &of[0], &of[1], &of[2], &error, &everywhere, limiter, hex,
                   of_channel) >= 7 &&
            of[0] == about.node_count && of[1] == triangles && of[2] == vertices && error == about.error &&
            everywhere == about.error_everywhere && !strcmp(limiter, LIMITERS[about.limited_by]) &&
            strtoull(hex, NULL, 16) == hash && !strcmp(of_channel, carried)) {
            snprintf(answer, sizeof answer, "%s", expected);
        }
        free(positions);
        free(corners);
    }
    lodpack_free_mesh(mesh);
    lodpack_free_cut(cut);
    lodpack_close(drawer);
    lodpack_close(file);
    if (strcmp(answer, expected)) {
        fprintf(stderr, "expected %s, and the answer is %s\n", expected, answer);
        return 0;
    }
    return 1;
}

int main(int count, char **arguments) {
    FILE *table = count == 3 ? fopen(arguments[1], "r") : NULL;
    char line[512], asked[512];
    int answered = 0, wrong = 0;
    while (table && fgets(line, sizeof line, table)) {
        char *expected = strstr(line, " = ");
        if (!expected) {
            continue;
        }
        line[strcspn(line, "\n")] = 0;
        *expected = 0;
        strcpy(asked, line);
        if (!is_expected(arguments[2], line, expected + 3)) {
            fprintf(stderr, "  asked: %s\n", asked);
            wrong++;
        }
        answered++;
    }
    printf("%d queries, %d answered otherwise\n", answered, wrong);
    return answered < 40 || wrong;
}
