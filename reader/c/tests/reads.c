/* Reads files in every way that lodpack.h offers: reads sound FILE... | reads invalid FILE... | reads hostile FILE...
 *
 * Of a sound file, every answer has to hold what it promises; of an invalid one, lodpack_verify() has to fail at the latest, with a message, and
 * nothing may do worse. A hostile one may be either. Prints what is not so, and how many files of how many could be opened and drawn; ends with 1 if
 * anything is not so. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lodpack.h"

typedef enum { SOUND, INVALID, HOSTILE } nature;

static int failures = 0;
static const char *current = "";
static int opened = 0, drawn = 0;

#define EXPECT(condition)                                                                                     \
    do {                                                                                                      \
        if (!(condition)) {                                                                                   \
            failures++;                                                                                       \
            fprintf(stderr, "%s: line %d: %s (%s)\n", current, __LINE__, #condition, lodpack_last_error());    \
        }                                                                                                     \
    } while (0)

typedef struct {
    unsigned char *bytes;
    size_t length;
    int reads;
    int fails;
} memory;

static memory load(const char *path) {
    memory found = {NULL, 0, 0, 0};
    FILE *stream = fopen(path, "rb");
    if (!stream) {
        return found;
    }
    fseek(stream, 0, SEEK_END);
    found.length = (size_t)ftell(stream);
    rewind(stream);
    found.bytes = malloc(found.length + 1);
    found.length = fread(found.bytes, 1, found.length, stream);
    fclose(stream);
    return found;
}

static int read_memory(void *context, uint64_t offset, uint8_t *buffer, size_t length) {
    memory *from = context;
    from->reads++;
    if (from->fails || offset + length > from->length) {
        return 1;
    }
    memcpy(buffer, from->bytes + offset, length);
    return 0;
}

/* What a call about a file in memory may answer that does not succeed: never that the source fails, or that lodpack has a defect. */
static int is_refusal(lodpack_status status) {
    return status == LODPACK_STATUS_FORMAT || status == LODPACK_STATUS_UNSUPPORTED || status == LODPACK_STATUS_LIMIT ||
           status == LODPACK_STATUS_QUERY;
}

/* Decodes a cut and looks at what comes out. */
static void look_at(const lodpack_file *file, const lodpack_query *query, int is_sound) {
    lodpack_cut *cut;
    lodpack_mesh *mesh;
    lodpack_cut_info info;
    lodpack_status status = lodpack_select(file, query, &cut);
    EXPECT((status == LODPACK_STATUS_OK) == (cut != NULL));
    if (status != LODPACK_STATUS_OK) {
        EXPECT(is_sound ? status == LODPACK_STATUS_QUERY : is_refusal(status));
        EXPECT(lodpack_last_error()[0] != 0);
        return;
    }
    EXPECT(lodpack_get_cut_info(cut, &info) == LODPACK_STATUS_OK);
    status = lodpack_decode(file, cut, &mesh);
    lodpack_free_cut(cut);
    if (status != LODPACK_STATUS_OK) {
        EXPECT(!is_sound && mesh == NULL && is_refusal(status));
        return;
    }
    drawn++;
    size_t vertices = lodpack_vertex_count(mesh), triangles = lodpack_triangle_count(mesh);
    EXPECT(triangles == info.triangle_count);
    EXPECT(info.error <= info.error_everywhere);
    /* Exactly as much memory as is asked for, so that valgrind sees a byte too many. */
    double *positions = malloc(vertices * 3 * sizeof(double) + (vertices == 0));
    uint32_t *indices = malloc(triangles * 3 * sizeof(uint32_t) + (triangles == 0));
    struct {
        float position[3];
        float colour;
    } *interleaved = malloc(vertices * sizeof *interleaved + (vertices == 0));
    for (size_t i = 0; i < vertices; i++) {
        interleaved[i].colour = 0.5f;
    }
    EXPECT(lodpack_copy_positions(mesh, positions, vertices, 0) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_triangles(mesh, indices, triangles) == LODPACK_STATUS_OK);
    const double *origin = vertices ? positions : NULL;
    EXPECT(lodpack_copy_positions_float(mesh, origin, interleaved->position, vertices, sizeof *interleaved) == LODPACK_STATUS_OK);
    for (size_t i = 0; i < vertices; i++) {
        EXPECT(interleaved[i].colour == 0.5f);
        for (int axis = 0; axis < 3; axis++) {
            EXPECT(interleaved[i].position[axis] == (float)(positions[3 * i + axis] - positions[axis]));
        }
    }
    for (size_t i = 0; i < 3 * triangles; i++) {
        EXPECT(indices[i] < vertices);
    }
    if (vertices) {
        EXPECT(lodpack_copy_positions(mesh, positions, vertices - 1, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_copy_positions(mesh, positions, vertices, 23) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_copy_positions(mesh, NULL, vertices, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(strstr(lodpack_last_error(), "null") != NULL);
    }
    free(positions);
    free(indices);
    free(interleaved);
    lodpack_free_mesh(mesh);
}

static void ask_everything(const lodpack_file *file, int is_sound) {
    lodpack_info info;
    lodpack_level level;
    lodpack_mesh *overview;
    EXPECT(lodpack_get_info(file, &info) == LODPACK_STATUS_OK);
    for (uint32_t number = 0; number < info.level_count; number++) {
        EXPECT(lodpack_get_level(file, number, &level) == LODPACK_STATUS_OK);
    }
    EXPECT(lodpack_get_level(file, info.level_count, &level) == LODPACK_STATUS_ARGUMENT);
    lodpack_status status = lodpack_decode_overview(file, &overview);
    EXPECT(status == LODPACK_STATUS_OK || (!is_sound && is_refusal(status)));
    EXPECT(overview == NULL || lodpack_triangle_count(overview) == info.overview_triangle_count);
    lodpack_free_mesh(overview);

    lodpack_query query = lodpack_query_default();
    look_at(file, &query, is_sound);
    query.tolerance = INFINITY;
    look_at(file, &query, is_sound);
    query.tolerance = NAN;
    lodpack_cut *cut;
    EXPECT(lodpack_select(file, &query, &cut) == LODPACK_STATUS_QUERY || !is_sound);
    lodpack_free_cut(cut);

    query = lodpack_query_default();
    for (int axis = 0; axis < 3; axis++) {
        query.box_high[axis] = (info.bounds_low[axis] + info.bounds_high[axis]) / 2;
    }
    look_at(file, &query, is_sound);
    query.outside = LODPACK_OUTSIDE_COARSEST;
    look_at(file, &query, is_sound);
    query.outside = 7;
    EXPECT(lodpack_select(file, &query, &cut) == LODPACK_STATUS_ARGUMENT);
    query = lodpack_query_default();
    query.box_low[1] = NAN;
    EXPECT(lodpack_select(file, &query, &cut) == LODPACK_STATUS_QUERY || !is_sound);

    query = lodpack_query_default();
    query.max_triangles = 40;
    look_at(file, &query, is_sound);
    query.max_bytes = 0;
    look_at(file, &query, is_sound);
    lodpack_view view = lodpack_view_default();
    view.position[2] = info.bounds_high[2] + 1;
    query = lodpack_query_default();
    query.view = &view;
    look_at(file, &query, is_sound);
    view.width = 0;
    EXPECT(lodpack_select(file, &query, &cut) == LODPACK_STATUS_QUERY || !is_sound);
}

static void ask_null(void) {
    lodpack_file *file;
    lodpack_cut *cut;
    lodpack_mesh *mesh;
    lodpack_info info;
    lodpack_query query = lodpack_query_default();
    EXPECT(lodpack_open(NULL, &file) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_open("nowhere.lodpack", NULL) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_open("nowhere.lodpack", &file) == LODPACK_STATUS_SOURCE && file == NULL);
    EXPECT(lodpack_open("\xff\xfe", &file) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_open("http://127.0.0.1:9/nowhere.lodpack", &file) == LODPACK_STATUS_SOURCE);
    EXPECT(lodpack_open_memory(NULL, 0, &file) == LODPACK_STATUS_FORMAT);
    EXPECT(lodpack_open_memory(NULL, 5, &file) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_open_memory((const uint8_t *)"", SIZE_MAX, &file) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_open_source(NULL, &file) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_get_info(NULL, &info) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_select(NULL, &query, &cut) == LODPACK_STATUS_ARGUMENT && cut == NULL);
    EXPECT(lodpack_decode(NULL, NULL, &mesh) == LODPACK_STATUS_ARGUMENT && mesh == NULL);
    EXPECT(lodpack_copy_triangles(NULL, NULL, 0) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_vertex_count(NULL) == 0 && lodpack_triangle_count(NULL) == 0);
    EXPECT(strlen(lodpack_version()) >= 5);
    lodpack_close(NULL);
    lodpack_free_cut(NULL);
    lodpack_free_mesh(NULL);
}

static void read_file(const char *path, nature kind) {
    int is_sound = kind == SOUND;
    current = path;
    memory content = load(path);
    EXPECT(content.bytes != NULL);
    lodpack_source source = {&content, read_memory, content.length};
    lodpack_file *files[3];
    lodpack_status statuses[3];
    statuses[0] = lodpack_open(path, &files[0]);
    statuses[1] = lodpack_open_memory(content.bytes, content.length, &files[1]);
    statuses[2] = lodpack_open_source(&source, &files[2]);
    EXPECT(content.reads > 0);
    EXPECT(statuses[0] == statuses[1] && statuses[1] == statuses[2]);
    for (int i = 0; i < 3; i++) {
        EXPECT((statuses[i] == LODPACK_STATUS_OK) == (files[i] != NULL));
        EXPECT(statuses[i] == LODPACK_STATUS_OK || (!is_sound && is_refusal(statuses[i])));
        if (!files[i]) {
            continue;
        }
        opened += i == 0;
        ask_everything(files[i], is_sound);
        lodpack_status verified = lodpack_verify(files[i]);
        EXPECT(verified == LODPACK_STATUS_OK || is_refusal(verified));
        EXPECT(kind == HOSTILE || (verified == LODPACK_STATUS_OK) == is_sound);
        EXPECT(kind != INVALID || strstr(lodpack_last_error(), "damaged") || strstr(lodpack_last_error(), "newer"));
        lodpack_close(files[i]);
    }
    /* A file that ends early is refused, wherever it ends. */
    for (size_t length = 0; is_sound && length < content.length; length += 1 + content.length / 50) {
        if (lodpack_open_memory(content.bytes, length, &files[0]) == LODPACK_STATUS_OK) {
            EXPECT(lodpack_verify(files[0]) == LODPACK_STATUS_FORMAT);
            lodpack_close(files[0]);
        }
    }
    /* A source that fails is no damaged file. */
    content.fails = 1;
    EXPECT(lodpack_open_source(&source, &files[0]) == LODPACK_STATUS_SOURCE);
    free(content.bytes);
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "usage: reads sound|invalid|hostile FILE...\n");
        return 2;
    }
    nature kind = !strcmp(argv[1], "sound") ? SOUND : !strcmp(argv[1], "invalid") ? INVALID : HOSTILE;
    ask_null();
    for (int i = 2; i < argc; i++) {
        read_file(argv[i], kind);
    }
    printf("%d files, %s; %d opened, %d meshes\n", argc - 2, failures ? "some not as expected" : "all as expected", opened, drawn);
    return failures != 0;
}
