/* Writes what a file shows at an error as OBJ to stdout: extract FILE_OR_ADDRESS TOLERANCE
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

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: extract FILE_OR_ADDRESS TOLERANCE\n");
        return 2;
    }
    lodpack_file *file;
    check(lodpack_open(argv[1], &file));

    lodpack_query query = lodpack_query_default();
    query.tolerance = atof(argv[2]);
    lodpack_cut *cut;
    check(lodpack_select(file, &query, &cut));
    lodpack_cut_info info;
    check(lodpack_get_cut_info(cut, &info));

    lodpack_mesh *mesh;
    check(lodpack_decode(file, cut, &mesh));
    size_t vertices = lodpack_vertex_count(mesh), triangles = lodpack_triangle_count(mesh);
    double(*positions)[3] = malloc((vertices + 1) * sizeof *positions);
    uint32_t(*indices)[3] = malloc((triangles + 1) * sizeof *indices);
    if (!positions || !indices) {
        fprintf(stderr, "error: out of memory\n");
        return 2;
    }
    check(lodpack_copy_positions(mesh, positions[0], vertices, 0));
    check(lodpack_copy_triangles(mesh, indices[0], triangles));

    printf("# %lu triangles, at most %g off the input\n", (unsigned long)triangles, info.error);
    for (size_t i = 0; i < vertices; i++) {
        printf("v %.17g %.17g %.17g\n", positions[i][0], positions[i][1], positions[i][2]);
    }
    for (size_t i = 0; i < triangles; i++) {
        printf("f %u %u %u\n", indices[i][0] + 1, indices[i][1] + 1, indices[i][2] + 1);
    }
    free(positions);
    free(indices);
    lodpack_free_mesh(mesh);
    lodpack_free_cut(cut);
    lodpack_close(file);
    return 0;
}
