/* Objects of files: objects FILE... Finds every node by name and id and below its parent, hides and shows objects alone, and picks. Ends with 1 where
 * an answer contradicts another one. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lodpack.h"

#define CHECK(what) \
    do { \
        if (!(what)) { \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #what, lodpack_last_error()); \
            exit(1); \
        } \
    } while (0)
#define OK(call) CHECK((call) == LODPACK_STATUS_OK)

/* Triangles of what a filter shows. */
static uint64_t triangles(lodpack_file *file, const lodpack_object_filter *filter) {
    lodpack_query query = lodpack_query_default();
    lodpack_cut *cut;
    lodpack_mesh *mesh;
    uint64_t count;
    query.objects = filter;
    OK(lodpack_select(file, &query, &cut));
    OK(lodpack_decode(file, cut, &mesh));
    count = lodpack_triangle_count(mesh);
    lodpack_free_mesh(mesh);
    lodpack_free_cut(cut);
    return count;
}

/* Triangles of a stream, once everything is there. */
static uint64_t streamed(lodpack_file *file, const lodpack_object_filter *filter) {
    lodpack_stream_options options = lodpack_stream_options_default();
    lodpack_query query = lodpack_query_default();
    lodpack_stream *stream;
    lodpack_frame frame;
    options.waits = 1;
    query.objects = filter;
    OK(lodpack_open_stream(file, &options, &stream));
    do {
        OK(lodpack_draw_frame(stream, &query, &frame));
    } while (!frame.is_complete);
    lodpack_close_stream(stream);
    return frame.triangle_count;
}

static int has(const uint32_t *numbers, size_t count, uint32_t wanted) {
    size_t k;
    for (k = 0; k < count && numbers[k] != wanted; k++) {
    }
    return k < count;
}

int main(int argc, char **argv) {
    int at;
    unsigned long checked = 0, picked = 0;
    for (at = 1; at < argc; at++) {
        lodpack_file *file;
        lodpack_object_filter *hidden, *only;
        uint32_t objects, nodes, number, first[2] = {0, 1};
        uint64_t all;
        size_t count, top_count = 0;
        OK(lodpack_open(argv[at], &file));
        OK(lodpack_object_count(file, &objects, &nodes));
        if (nodes == 0) {
            CHECK(lodpack_hide_objects(file, first, 1, &hidden) == LODPACK_STATUS_ARGUMENT && !hidden);
            lodpack_close(file);
            continue;
        }
        uint32_t *found = malloc(nodes * sizeof *found);
        CHECK(found != NULL);
        for (number = 0; number < nodes; number++) {
            lodpack_object *object;
            OK(lodpack_open_object(file, number, &object));
            const char *name = lodpack_object_name(object), *id = lodpack_object_id(object);
            uint32_t parent = lodpack_object_parent(object);
            if (name) {
                OK(lodpack_find_objects(file, name, found, nodes, &count));
                CHECK(count <= nodes && has(found, count, number));
                /* A smaller capacity is no error. */
                OK(lodpack_find_objects(file, name, found, 0, &count));
                CHECK(count >= 1);
            }
            if (id && !name) {
                OK(lodpack_find_objects(file, id, found, nodes, &count));
                CHECK(count >= 1);
            }
            OK(lodpack_object_children(file, parent, found, nodes, &count));
            CHECK(has(found, count, number));
            top_count += parent == UINT32_MAX;
            lodpack_free_object(object);
            checked++;
        }
        OK(lodpack_object_children(file, UINT32_MAX, found, nodes, &count));
        CHECK(count == top_count);
        all = triangles(file, NULL);
        for (number = 0; number < nodes; number += 1 + nodes / 40) {
            double low[3], high[3], origin[3], direction[3];
            int32_t is_there, k;
            lodpack_pick pick;
            OK(lodpack_hide_objects(file, &number, 1, &hidden));
            OK(lodpack_show_only(file, &number, 1, &only));
            uint64_t rest = triangles(file, hidden), own = triangles(file, only);
            CHECK(rest + own == all && own > 0);
            CHECK(streamed(file, hidden) == rest && streamed(file, only) == own);
            OK(lodpack_object_bounds(file, &number, 1, low, high, &is_there));
            CHECK(is_there);
            for (k = 0; k < 3; k++) {
                CHECK(low[k] <= high[k]);
                origin[k] = high[k] + 1000;
                direction[k] = (low[k] + high[k]) / 2 - origin[k];
            }
            OK(lodpack_pick_surface(file, origin, direction, only, &pick));
            if (pick.is_hit) {
                picked++;
                CHECK(pick.object < objects && pick.distance > 0);
                for (k = 0; k < 3; k++) {
                    CHECK(pick.point[k] >= low[k] - 1e-6 && pick.point[k] <= high[k] + 1e-6);
                }
                lodpack_pick other;
                OK(lodpack_pick_surface(file, origin, direction, hidden, &other));
                CHECK(!other.is_hit || other.object != pick.object);
            }
            lodpack_free_filter(hidden);
            lodpack_free_filter(only);
        }
        OK(lodpack_show_only(file, NULL, 0, &only));
        CHECK(triangles(file, only) == 0);
        lodpack_free_filter(only);
        CHECK(lodpack_hide_objects(file, &nodes, 1, &hidden) == LODPACK_STATUS_QUERY && !hidden);
        CHECK(lodpack_open_object(NULL, 0, (lodpack_object **)&hidden) == LODPACK_STATUS_ARGUMENT);
        CHECK(lodpack_object_name(NULL) == NULL && lodpack_object_parent(NULL) == UINT32_MAX);
        free(found);
        lodpack_close(file);
    }
    printf("%lu nodes, %lu picks, all as expected\n", checked, picked);
    return 0;
}
