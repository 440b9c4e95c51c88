/* Reads .lodpack files: any part of a huge triangle mesh, at any certified error.
 *
 * A file is opened, a query selects a cut of it, the cut is decoded to a mesh, and the mesh is copied to where the caller wants it:
 *
 *     lodpack_file *file; lodpack_cut *cut; lodpack_mesh *mesh;
 *     if (lodpack_open("scan.lodpack", &file)) { puts(lodpack_last_error()); return 1; }
 *     lodpack_query query = lodpack_query_default();
 *     query.tolerance = 0.002;
 *     lodpack_select(file, &query, &cut);
 *     lodpack_decode(file, cut, &mesh);
 *
 * Every function that can fail returns a status, and lodpack_last_error() says what went wrong, where, and what to do. No function
 * panics, unwinds or exits. Where a status is not LODPACK_STATUS_OK, what a function should have written is a null pointer or unchanged.
 *
 * Pointers to handles may be null: functions then return LODPACK_STATUS_ARGUMENT, and those that free do nothing. All other pointers
 * have to be valid as C understands it. A file, cut or mesh may be used from several threads at once, and freed once, when no
 * thread uses it any more. A cut and a mesh stay valid when their file is closed.
 *
 * The sources in src make this header: LODPACK_WRITE_HEADER=1 cargo test -p lodpack-c */

#ifndef LODPACK_H
#define LODPACK_H

#include <stddef.h>
#include <stdint.h>

// Who has to act to make a call succeed.
typedef enum {
  // All went well.
  LODPACK_STATUS_OK = 0,
  // The bytes could not be read: a disk, a server, a network or the caller's own function failed.
  LODPACK_STATUS_SOURCE = 1,
  // The file is damaged, or not a lodpack file.
  LODPACK_STATUS_FORMAT = 2,
  // The file is sound but needs a newer lodpack.
  LODPACK_STATUS_UNSUPPORTED = 3,
  // The query asks for something impossible.
  LODPACK_STATUS_QUERY = 4,
  // The file asks for more than lodpack allows files from untrusted places.
  LODPACK_STATUS_LIMIT = 5,
  // An argument cannot be meant: a null pointer, too little room.
  LODPACK_STATUS_ARGUMENT = 6,
  // lodpack has a defect. The handles of the call should only be freed.
  LODPACK_STATUS_INTERNAL = 7,
} lodpack_status;

// What becomes of what is outside the box and the view.
typedef enum {
  // It is not drawn.
  LODPACK_OUTSIDE_DROP = 0,
  // It is drawn at its coarsest, without a crack in between.
  LODPACK_OUTSIDE_COARSEST = 1,
} lodpack_outside;

// Why a cut is not finer.
typedef enum {
  // It is as fine as was asked for.
  LODPACK_LIMITER_TOLERANCE = 0,
  // The file has nothing finer.
  LODPACK_LIMITER_FINEST = 1,
  // The budget of triangles.
  LODPACK_LIMITER_TRIANGLES = 2,
  // The budget of nodes.
  LODPACK_LIMITER_NODES = 3,
  // The budget of bytes.
  LODPACK_LIMITER_BYTES = 4,
} lodpack_limiter;

// A level for each root that is drawn.
typedef struct lodpack_cut lodpack_cut;

// An open file.
typedef struct lodpack_file lodpack_file;

// The triangles of a cut.
typedef struct lodpack_mesh lodpack_mesh;

// A file that the caller reads, such as one in an archive of assets.
typedef struct {
  // What `read` is called with. It has to stay valid until the file is closed.
  void *context;
  // Fills `buffer` with `length` bytes from `offset` on, and returns 0, or anything else if it cannot. It is called in the threads that
  // call functions with the file, so by several at once if these do; it must not unwind.
  int (*read)(void *context, uint64_t offset, uint8_t *buffer, size_t length);
  // Number of bytes of the file.
  uint64_t size;
} lodpack_source;

// What is known about a file as soon as it is open. Lengths are in the units of the file's coordinates.
typedef struct {
  // Version of the format.
  uint32_t format_major;
  // A newer minor version adds what a reader may skip.
  uint32_t format_minor;
  // Number of levels; 0 is the coarsest.
  uint32_t level_count;
  // Number of roots; 0 for an empty file, whose bounds are all zero.
  uint32_t root_count;
  // Smallest coordinates.
  double bounds_low[3];
  // Largest coordinates.
  double bounds_high[3];
  // Coordinates are multiples of it, from the file's origin on.
  double lattice_step;
  // Mean edge length of the input; 0 if the file does not say.
  double mean_edge_length;
  // Triangles of the input after repair; 0 if the file does not say.
  uint64_t source_triangle_count;
  // Vertices of the input after repair; 0 if the file does not say.
  uint64_t source_vertex_count;
  // Triangles of the overview; 0 if there is none.
  uint64_t overview_triangle_count;
  // Bound of the overview's two-sided distance to the input.
  double overview_error;
} lodpack_info;

// What a file says about one level.
typedef struct {
  // Bound of the two-sided distance to the input with everything drawn at this level.
  double error;
  // The error that the level was built for.
  double tolerance;
  // Triangles with everything drawn at this level.
  uint64_t triangle_count;
  // Bytes that this level adds to the coarser ones.
  uint64_t page_bytes;
} lodpack_level;

// A camera. What it does not show is outside.
typedef struct {
  // Where it stands.
  double position[3];
  // Where it looks: a direction of any length but zero.
  double forward[3];
  // What is up in the picture; it need not be perpendicular to `forward`.
  double up[3];
  // Full angle between the picture's upper and lower border, radians.
  double vertical_fov;
  // Depth of the near plane, above zero.
  double near_plane;
  // The error to reach in the picture, pixels.
  double pixel_tolerance;
  // Width of the picture in pixels.
  uint32_t width;
  // Height of the picture in pixels.
  uint32_t height;
} lodpack_view;

// What to draw, and how finely. lodpack_query_default() fills all of it.
typedef struct {
  // The error to reach, in units of the file's coordinates. By default 0: as fine as possible. With a view its own tolerance counts.
  double tolerance;
  // The box's smallest coordinates; by default minus infinity.
  double box_low[3];
  // The box's largest coordinates; by default infinity. Every root whose box touches this one is drawn whole.
  double box_high[3];
  // A camera, or null: by default everything is in sight.
  const lodpack_view *view;
  // The most triangles; by default UINT64_MAX. The cut is one that the file holds: a mixture of levels, often well below.
  uint64_t max_triangles;
  // The most nodes (roots at a level each); by default UINT64_MAX.
  uint64_t max_nodes;
  // The most bytes of pages to read; by default UINT64_MAX.
  uint64_t max_bytes;
  // A lodpack_outside; by default LODPACK_OUTSIDE_DROP.
  int32_t outside;
} lodpack_query;

// What is known of a cut before anything is decoded.
typedef struct {
  // Bound of the two-sided distance to the input, of what is inside the box and the view.
  double error;
  // The same of everything that is drawn.
  double error_everywhere;
  // The largest error in the view, pixels; 0 without a view.
  double pixel_error;
  // Exact number of triangles of the mesh.
  uint64_t triangle_count;
  // Number of nodes: roots at a level each.
  uint64_t node_count;
  // A lodpack_limiter: why it is not finer.
  int32_t limited_by;
} lodpack_cut_info;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Opens a file: a path, or an address that begins with http:// or https://, in UTF-8. Reads 8 kB of a small file. Web servers have to
// support range requests.
lodpack_status lodpack_open(const char *path, lodpack_file **file);

// Opens a file in memory. The bytes are copied.
lodpack_status lodpack_open_memory(const uint8_t *data, size_t length, lodpack_file **file);

// Opens a file that the caller reads. The structure itself is copied.
lodpack_status lodpack_open_source(const lodpack_source *source, lodpack_file **file);

// Closes a file.
void lodpack_close(lodpack_file *file);

// Writes what the file says of itself. Reads nothing.
lodpack_status lodpack_get_info(const lodpack_file *file, lodpack_info *info);

// Writes what the file says about a level. Reads nothing.
lodpack_status lodpack_get_level(const lodpack_file *file, uint32_t number, lodpack_level *level);

// Reads the complete file, and checks every checksum and every rule of the format.
lodpack_status lodpack_verify(const lodpack_file *file);

// Reads, decodes and joins the triangles of a cut of this file. The mesh is watertight where the whole surface is.
lodpack_status lodpack_decode(const lodpack_file *file, const lodpack_cut *cut, lodpack_mesh **mesh);

// Decodes the overview: one small mesh of everything, which came with opening. Without an overview the mesh is a null pointer.
lodpack_status lodpack_decode_overview(const lodpack_file *file, lodpack_mesh **mesh);

// Number of vertices; 0 for a null pointer.
size_t lodpack_vertex_count(const lodpack_mesh *mesh);

// Number of triangles; 0 for a null pointer.
size_t lodpack_triangle_count(const lodpack_mesh *mesh);

// Copies the vertices' positions to `positions`, which has room for `capacity` vertices, `stride_bytes` from one to the next (0 for no
// gaps; what lies between stays as it is).
lodpack_status lodpack_copy_positions(const lodpack_mesh *mesh, double *positions, size_t capacity, size_t stride_bytes);

// As lodpack_copy_positions(), in single precision relative to `origin`: three coordinates near the mesh, such as the middle of its
// file's bounds, without which coordinates far from zero lose digits. A null pointer is the origin of coordinates.
lodpack_status lodpack_copy_positions_float(const lodpack_mesh *mesh,
                                            const double *origin,
                                            float *positions,
                                            size_t capacity,
                                            size_t stride_bytes);

// Copies three vertex numbers for each triangle to `indices`, which has room for `capacity` triangles: counter-clockwise seen from
// outside.
lodpack_status lodpack_copy_triangles(const lodpack_mesh *mesh, uint32_t *indices, size_t capacity);

// Frees a mesh.
void lodpack_free_mesh(lodpack_mesh *mesh);

// A view from the origin along the negative z axis: 60 degrees, 1920 x 1080, one pixel.
lodpack_view lodpack_view_default(void);

// A query for everything at the finest level.
lodpack_query lodpack_query_default(void);

// Finds the coarsest cut within the tolerance that keeps every budget. Reads the index where the query needs it, and no surface. A box
// beside the surface gives an empty cut.
lodpack_status lodpack_select(const lodpack_file *file, const lodpack_query *query, lodpack_cut **cut);

// Writes what is known of a cut.
lodpack_status lodpack_get_cut_info(const lodpack_cut *cut, lodpack_cut_info *info);

// Frees a cut.
void lodpack_free_cut(lodpack_cut *cut);

// What went wrong in this thread's last call that returned a status: a text that is valid until the thread's next such call, and empty
// if nothing went wrong.
const char *lodpack_last_error(void);

// The version of this library, such as "0.1.0".
const char *lodpack_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LODPACK_H */
