/* Writes what a file shows at an error as OBJ to stdout, a mesh with the ground that it stands on: extract FILE_OR_ADDRESS TOLERANCE [NAME]
 * With the name or id of an object it writes everything but that one.
 *
 *     cargo build --release -p lodpack-c
 *     cc -I reader/c/include reader/c/examples/extract.c -L target/release -llodpack_c -Wl,-rpath,target/release -o extract
 */
#include <stdio.h>
#include <stdlib.h>

#include "lodpack.h"

static void check(lodpack_status status) {
    if (status != LODPACK_STATUS_OK) {
        fprintf(stderr, "error: %s\n", lodpack_last_error());
        exit(2);
    }
}

/* Writes the mesh of a cut, moved by a matrix if there is one. Vertices are counted from those that are written already; returns the new count. */
static size_t write_cut(const lodpack_file *file, const lodpack_cut *cut, const lodpack_ground_frame *frame, size_t written) {
    lodpack_cut_info info;
    check(lodpack_get_cut_info(cut, &info));
    lodpack_mesh *mesh;
    check(lodpack_decode(file, cut, &mesh));
    size_t vertices = lodpack_vertex_count(mesh), triangles = lodpack_triangle_count(mesh);
    /* C++ wants the casts. */
    double *positions = (double *)malloc((vertices + 1) * 3 * sizeof *positions);
    uint32_t *indices = (uint32_t *)malloc((triangles + 1) * 3 * sizeof *indices);
    if (!positions || !indices) {
        fprintf(stderr, "error: out of memory\n");
        exit(2);
    }
    check(lodpack_copy_positions(mesh, positions, vertices, 0));
    check(lodpack_copy_triangles(mesh, indices, triangles));

    printf("# %lu triangles, at most %g off the input\n", (unsigned long)triangles, info.error * (frame ? frame->scale : 1));
    for (size_t i = 0; i < vertices; i++) {
        const double *p = positions + 3 * i;
        double moved[3] = {p[0], p[1], p[2]};
        for (int k = 0; frame && k < 3; k++) {
            const double *row = frame->mesh_from_ground[k];
            moved[k] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
        }
        printf("v %.17g %.17g %.17g\n", moved[0], moved[1], moved[2]);
    }
    for (size_t i = 0; i < triangles; i++) {
        size_t first = written + 1;
        const uint32_t *corners = indices + 3 * i;
        printf("f %lu %lu %lu\n", (unsigned long)(first + corners[0]), (unsigned long)(first + corners[1]), (unsigned long)(first + corners[2]));
    }
    free(positions);
    free(indices);
    lodpack_free_mesh(mesh);
    return written + vertices;
}

static size_t write_heights(const lodpack_file *file, double tolerance, const lodpack_ground_frame *frame, size_t written) {
    lodpack_heights_query query = lodpack_heights_query_default();
    query.tolerance = frame ? tolerance / frame->scale : tolerance;
    lodpack_cut *cut;
    check(lodpack_select_heights(file, &query, &cut));
    written = write_cut(file, cut, frame, written);
    lodpack_free_cut(cut);
    return written;
}

int main(int argc, char **argv) {
    if (argc != 3 && argc != 4) {
        fprintf(stderr, "usage: extract FILE_OR_ADDRESS TOLERANCE [NAME]\n");
        return 2;
    }
    double tolerance = atof(argv[2]);
    lodpack_file *file;
    check(lodpack_open(argv[1], &file));
    lodpack_info info;
    check(lodpack_get_info(file, &info));
    if (info.kind == LODPACK_KIND_HEIGHTS) {
        write_heights(file, tolerance, NULL, 0);
        lodpack_close(file);
        return 0;
    }

    lodpack_query query = lodpack_query_default();
    query.tolerance = tolerance;
    lodpack_object_filter *hidden = NULL;
    if (argc == 4) {
        uint32_t numbers[64];
        size_t count;
        check(lodpack_find_objects(file, argv[3], numbers, 64, &count));
        check(lodpack_hide_objects(file, numbers, count < 64 ? count : 64, &hidden));
        query.objects = hidden;
    }
    lodpack_cut *cut;
    check(lodpack_select(file, &query, &cut));
    size_t written = write_cut(file, cut, NULL, 0);
    lodpack_free_cut(cut);
    lodpack_free_filter(hidden);

    lodpack_file *ground;
    lodpack_ground_frame frame;
    check(lodpack_open_ground(file, &ground, &frame));
    if (ground) {
        write_heights(ground, tolerance, &frame, written);
        lodpack_close(ground);
    }
    lodpack_close(file);
    return 0;
}
