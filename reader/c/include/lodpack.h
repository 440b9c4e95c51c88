/* Reads .lodpack files: any part of a huge triangle mesh or terrain, at any certified error.
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
 * What the surface carries besides positions is asked for when a cut is decoded: lodpack_decode_channels(). A file of heights has queries of its own:
 * lodpack_select_heights(); so has the ground that a mesh may stand on, which lodpack_open_ground() opens. A program that draws for a moving camera opens a
 * stream and asks for a frame at a time: lodpack_open_stream(). What the input named is found with lodpack_find_objects(), picked with
 * lodpack_pick_surface(), and hidden with a filter in a query: lodpack_hide_objects().
 *
 * Every function that can fail returns a status, and lodpack_last_error() says what went wrong, where, and what to do. No function
 * panics, unwinds or exits. Where a status is not LODPACK_STATUS_OK, what a function should have written is a null pointer or unchanged.
 *
 * Pointers to handles may be null: functions then return LODPACK_STATUS_ARGUMENT, and those that free do nothing. All other pointers
 * have to be valid as C understands it. A file, cut or mesh may be used from several threads at once, and freed once, when no
 * thread uses it any more; a stream is for one thread at a time. A cut, a mesh and a stream stay valid when their file is closed.
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

// What a file holds.
typedef enum {
  // A mesh.
  LODPACK_KIND_MESH = 0,
  // A grid of heights: terrain.
  LODPACK_KIND_HEIGHTS = 1,
} lodpack_kind;

// What the values of a channel mean.
typedef enum {
  // This version of lodpack does not know.
  LODPACK_MEANING_UNKNOWN = 0,
  // Colours as screens show them (sRGB): three components, or four with opacity.
  LODPACK_MEANING_COLOUR = 1,
  // Measured numbers.
  LODPACK_MEANING_SCALAR = 2,
  // Directions of length 1.
  LODPACK_MEANING_NORMAL = 3,
  // Numbers of classes, between which nothing lies.
  LODPACK_MEANING_LABEL = 4,
  // Numbers from 0 to 1, such as the roughness of a material.
  LODPACK_MEANING_FACTOR = 5,
  // How the surface is drawn: double-sided, unlit and alpha modes, as bits (SPEC.md, 21.6).
  LODPACK_MEANING_DRAWING = 6,
} lodpack_meaning;

// What heights stand on.
typedef enum {
  // A plane: coordinates are x and y, and z is up.
  LODPACK_GROUND_PLANE = 0,
  // A sphere around the origin: coordinates are degrees of longitude and latitude.
  LODPACK_GROUND_SPHERE = 1,
  // An ellipsoid of revolution around the origin, in the same coordinates.
  LODPACK_GROUND_ELLIPSOID = 2,
} lodpack_ground;

// What a frame draws.
typedef enum {
  // Nothing is there yet.
  LODPACK_SHOWN_NOTHING = 0,
  // The overview (lodpack_decode_overview()), until the coarsest level is there.
  LODPACK_SHOWN_OVERVIEW = 1,
  // All roots that were uploaded and not dropped.
  LODPACK_SHOWN_PICTURE = 2,
} lodpack_shown;

// What several streams share: a mesh, the ground that it stands on, and other files in the same picture.
typedef struct lodpack_budget lodpack_budget;

// A level for each root that is drawn; of heights a resolution for each tile.
typedef struct lodpack_cut lodpack_cut;

// An open file of either kind.
typedef struct lodpack_file lodpack_file;

// Triangles: of a cut, of the overview, of a root in a frame.
typedef struct lodpack_mesh lodpack_mesh;

// What the input named: an object, or an assembly of others.
typedef struct lodpack_object lodpack_object;

// What is drawn of the objects of a file. A query holds one: see lodpack_hide_objects() and lodpack_show_only().
typedef struct lodpack_object_filter lodpack_object_filter;

// Frames of a moving camera, and threads that load for them.
typedef struct lodpack_stream lodpack_stream;

// What the surface carries besides positions. A value is `low + number * step` of a stored number.
typedef struct {
  // In UTF-8; valid until the file is closed.
  const char *name;
  // A lodpack_meaning.
  int32_t meaning;
  // Numbers of a value, 1 to 4.
  uint32_t component_count;
  // Bytes of each of these numbers in pages: 1 (uint8_t), or 2 (uint16_t).
  uint32_t number_bytes;
  // The value that the number 0 stands for.
  double low;
  // What a number adds for each 1.
  double step;
  // Stated bound on the error of a value; 0 where none is stated.
  double bound;
  // 1 if colours, normals or factors are stored without loss; 0 if not, and for other meanings.
  int32_t is_lossless;
} lodpack_channel;

// A file that the caller reads, such as one in an archive of assets.
typedef struct {
  // What `read` is called with. It has to stay valid until the file is closed.
  void *context;
  // Fills `buffer` with `length` bytes from `offset` on, and returns 0, or anything else if it cannot. It is called
  // in the threads that call functions with the file, so by several at once if these do; it must not unwind.
  int (*read)(void *context, uint64_t offset, uint8_t *buffer, size_t length);
  // Number of bytes of the file.
  uint64_t size;
} lodpack_source;

// What is known about a file as soon as it is open. Lengths are in the units of the file's coordinates.
typedef struct {
  // A lodpack_kind: what the file holds.
  int32_t kind;
  // Version of the format.
  uint32_t format_major;
  // A newer minor version adds what a reader may skip.
  uint32_t format_minor;
  // Number of levels; 0 is the coarsest. Heights have none.
  uint32_t level_count;
  // Number of roots; 0 for an empty file, whose bounds are all zero, and for heights.
  uint32_t root_count;
  // Number of channels: what the surface carries besides positions.
  uint32_t channel_count;
  // Smallest coordinates.
  double bounds_low[3];
  // Largest coordinates.
  double bounds_high[3];
  // Coordinates are multiples of it, from the file's origin on; 0 for heights.
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
  // Bytes of the heights that the mesh stands on (lodpack_open_ground()); 0 without any.
  uint64_t ground_bytes;
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

// Where a ground is in the space of its mesh.
typedef struct {
  // Rows of the matrix that takes positions of the ground to the space of the mesh. The fourth column is what is
  // added.
  double mesh_from_ground[3][4];
  // The way back.
  double ground_from_mesh[3][4];
  // Units of the mesh in a unit of the ground. Errors of the ground grow by it; its tolerances are those of the mesh
  // divided by it.
  double scale;
} lodpack_ground_frame;

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

// What is known about a file of heights as soon as it is open.
typedef struct {
  // A lodpack_ground.
  int32_t ground;
  // Whether the last column is followed by the first one, around a globe.
  int32_t wraps;
  // Whether its meshes have colours: those of a ramp, or of an image over the heights.
  int32_t has_colours;
  // The tolerance of a query is met by tiles of at most this many depths.
  uint32_t depth_count;
  // Columns of samples.
  uint64_t column_count;
  // Rows of samples.
  uint64_t row_count;
  // Coordinates of the first column and the first row, which is the northernmost.
  double first[2];
  // What each column and each row adds to them. Rows go to the south, so theirs is negative.
  double spacing[2];
  // Stored heights are multiples of it, but for a constant.
  double step;
  // No stored height is further from the sample that it was made from.
  double sample_error;
  // Units of positions in a unit of heights.
  double height_scale;
  // Metres in a unit of heights; 0 if nobody has said.
  double unit;
  // The coordinate reference system, as "EPSG:" and a number or as WKT; empty if there is none. Valid until the file
  // is closed.
  const char *crs;
} lodpack_heights_info;

// What to draw of heights, and how finely. lodpack_heights_query_default() fills all of it.
typedef struct {
  // The error to reach, in units of positions. By default 0: as fine as possible.
  double tolerance;
  // The least coordinates: x and y, or degrees of longitude and latitude; by default minus infinity. Tiles that meet
  // the box are drawn whole.
  double low[2];
  // The greatest coordinates; by default infinity. On a globe the least longitude may be larger: then the box
  // crosses the end of the grid.
  double high[2];
  // The most triangles, without those that close the lines between tiles; by default UINT64_MAX.
  uint64_t max_triangles;
} lodpack_heights_query;

// What a ray meets first.
typedef struct {
  // Where.
  double point[3];
  // How far that is from where the ray begins.
  double distance;
  // Bound of the distance between the surface that was met and the input.
  double error;
  // The root that was met, at its finest level.
  uint32_t root;
  // Its object; UINT32_MAX in a file without objects.
  uint32_t object;
  // Whether anything was met: if not, nothing else here means anything.
  int32_t is_hit;
} lodpack_pick;

// A page: an image over a part of a mesh's triangles.
typedef struct {
  // Texels in a row.
  uint32_t width;
  // Rows, the first one at the top.
  uint32_t height;
  // The number of the first triangle that lies in it; the others follow.
  size_t first_triangle;
  // How many these are.
  size_t triangle_count;
} lodpack_page;

// What to draw, and how finely. lodpack_query_default() fills all of it.
typedef struct {
  // The error to reach, in units of the file's coordinates. By default 0: as fine as possible. With a view its own
  // tolerance counts.
  double tolerance;
  // The box's smallest coordinates; by default minus infinity.
  double box_low[3];
  // The box's largest coordinates; by default infinity. Every root whose box touches this one is drawn whole.
  double box_high[3];
  // A camera, or null: by default everything is in sight.
  const lodpack_view *view;
  // The most triangles; by default UINT64_MAX. The cut is one that the file holds: a mixture of levels, often well
  // below.
  uint64_t max_triangles;
  // The most nodes (roots at a level each); by default UINT64_MAX.
  uint64_t max_nodes;
  // The most bytes of pages to read; by default UINT64_MAX.
  uint64_t max_bytes;
  // A lodpack_outside; by default LODPACK_OUTSIDE_DROP.
  int32_t outside;
  // Which objects are drawn: a filter of lodpack_hide_objects() or lodpack_show_only(), or null, by default, for
  // all. Budgets then count whole roots.
  const lodpack_object_filter *objects;
} lodpack_query;

// What is known of a cut before anything is decoded.
typedef struct {
  // Bound of the two-sided distance to the input, of what is inside the box and the view.
  double error;
  // The same of everything that is drawn.
  double error_everywhere;
  // The largest error in the view, pixels; 0 without a view.
  double pixel_error;
  // Exact number of triangles of the mesh; of heights without those that close the lines between tiles.
  uint64_t triangle_count;
  // Number of nodes: roots at a level each; of heights tiles.
  uint64_t node_count;
  // A lodpack_limiter: why it is not finer.
  int32_t limited_by;
} lodpack_cut_info;

// What is new in a frame.
typedef struct {
  // A lodpack_shown: what to draw.
  int32_t shows;
  // Whether everything is drawn as wanted.
  int32_t is_complete;
  // Roots to upload, instead of what they had: see lodpack_get_upload().
  size_t upload_count;
  // Roots to draw no longer: see lodpack_get_drop().
  size_t drop_count;
  // Roots that are drawn coarser than wanted, since they are not there yet.
  uint64_t late_root_count;
  // Roots to draw.
  uint64_t root_count;
  // Their triangles.
  uint64_t triangle_count;
  // Bytes read since the last frame.
  uint64_t byte_count;
  // Triangles that it would have if everything were there.
  uint64_t wanted_triangle_count;
  // A lodpack_limiter: why that is not finer.
  int32_t limited_by;
} lodpack_frame;

// How a stream behaves. lodpack_stream_options_default() fills all of it.
typedef struct {
  // Most bytes of the file that are kept in memory.
  uint64_t page_cache_bytes;
  // Most bytes of decoded triangles.
  uint64_t mesh_cache_bytes;
  // Most bytes of decoded images. They are drawn smaller where they would not fit.
  uint64_t texel_cache_bytes;
  // About how many texels images have along each side of a pixel, as near as halving allows; above 0. 1 by default.
  double texels_per_pixel;
  // Most bytes of triangles that are new in a frame; what does not fit waits, and what was drawn stays. One root or
  // group always goes, and so does what nothing was drawn in place of. UINT64_MAX, the default, for no bound. Those
  // of heights have none.
  uint64_t upload_bytes;
  // Threads that read and decode; at least 1, and 256 where it is more.
  uint32_t thread_count;
  // Whether frames wait until everything that they want is there. By default they do not: what is missing is drawn
  // coarser.
  int32_t waits;
  // The channels to show, by number; by default none. All roots of heights have their normals and colours anyway.
  const uint32_t *channels;
  // How many these are.
  size_t channel_count;
} lodpack_stream_options;

// A root to upload.
typedef struct {
  // Its number. What had this number before is drawn no longer.
  uint32_t root;
  // The level at which it is drawn.
  uint32_t level;
  // Bound of the two-sided distance between it and the input.
  double error;
} lodpack_upload;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Writes what the file says about a channel. Reads nothing. A file of heights has one: its heights.
lodpack_status lodpack_get_channel(const lodpack_file *file, uint32_t number, lodpack_channel *channel);

// Copies the colour of each vertex to `rgba`, which has room for `capacity` vertices, `stride_bytes` from one to the
// next (0 for no gaps): red, green, blue and opacity as screens show them (sRGB). White where nothing is known.
// `channel` counts those that the mesh was decoded with. Measured numbers get colours of a ramp from dark blue to
// yellow, classes one each. Of heights channel 0 has the colours of the file's ramp.
lodpack_status lodpack_copy_colours(const lodpack_mesh *mesh, uint32_t channel, uint8_t *rgba, size_t capacity, size_t stride_bytes);

// Copies the values of each vertex to `values`, `component_count` of the channel each: numbers in units of the
// channel. NaN where nothing is known. `channel` counts those that the mesh was decoded with. Of heights channel 0 has
// the heights.
lodpack_status lodpack_copy_values(const lodpack_mesh *mesh, uint32_t channel, double *values, size_t capacity, size_t stride_bytes);

// Copies the normal of each vertex to `normals`: of heights, or of a mesh that was decoded with a channel of normals.
// Length 1, or 0 where nothing is known.
lodpack_status lodpack_copy_normals(const lodpack_mesh *mesh, float *normals, size_t capacity, size_t stride_bytes);

// Opens a file of either kind: a path, or an address that begins with http:// or https://, in UTF-8. Reads 8 kB of a
// small file. Web servers have to support range requests.
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

// Opens the ground that a mesh stands on as a file of heights, and writes where it is. Writes a null pointer and no
// frame if there is none. Reads 16 kB. The ground is closed like any file, and stays open when the file of the mesh is
// closed.
lodpack_status lodpack_open_ground(const lodpack_file *file, lodpack_file **ground, lodpack_ground_frame *frame);

// The camera that shows the ground in the same pixels as a camera shows the mesh, and with the same depths. A stream
// of the ground is drawn with it.
lodpack_status lodpack_view_of_ground(const lodpack_ground_frame *frame, const lodpack_view *view, lodpack_view *seen);

// Writes what a file of heights says of itself. Reads nothing.
lodpack_status lodpack_get_heights_info(const lodpack_file *file, lodpack_heights_info *info);

// A query for everything at the finest resolution.
lodpack_heights_query lodpack_heights_query_default(void);

// Finds the coarsest tiles within the tolerance, or the finest ones that keep the budget. lodpack_decode() makes their
// mesh, without cracks.
lodpack_status lodpack_select_heights(const lodpack_file *file, const lodpack_heights_query *query, lodpack_cut **cut);

// Reads a window of samples to `heights`, which has room for `capacity` numbers: `row_count` rows of `column_count`,
// from the north; NaN where there are none. Around a globe a window may go on beyond the last column.
lodpack_status lodpack_read_heights(const lodpack_file *file,
                                    uint64_t first_column,
                                    uint64_t column_count,
                                    uint64_t first_row,
                                    uint64_t row_count,
                                    double *heights,
                                    size_t capacity);

// Reads, decodes and joins the triangles of a cut of this file, or of one of the same bytes. The mesh is watertight
// where the whole surface is. Of heights it has normals and colours, too.
lodpack_status lodpack_decode(const lodpack_file *file, const lodpack_cut *cut, lodpack_mesh **mesh);

// As lodpack_decode(), with the images of `channel_count` channels, by number. lodpack_copy_colours() and
// lodpack_copy_values() then tell what the surface carries at vertices, and lodpack_make_pages() makes textures of it.
// The bytes of other channels are not read.
lodpack_status lodpack_decode_channels(const lodpack_file *file,
                                       const lodpack_cut *cut,
                                       const uint32_t *channels,
                                       size_t channel_count,
                                       lodpack_mesh **mesh);

// Decodes the overview: one small mesh of everything, which came with opening. Without an overview the mesh is a null
// pointer.
lodpack_status lodpack_decode_overview(const lodpack_file *file, lodpack_mesh **mesh);

// Number of vertices; 0 for a null pointer.
size_t lodpack_vertex_count(const lodpack_mesh *mesh);

// Number of triangles; 0 for a null pointer.
size_t lodpack_triangle_count(const lodpack_mesh *mesh);

// Copies the vertices' positions to `positions`, which has room for `capacity` vertices, `stride_bytes` from one to
// the next (0 for no gaps; what lies between stays as it is).
lodpack_status lodpack_copy_positions(const lodpack_mesh *mesh, double *positions, size_t capacity, size_t stride_bytes);

// As lodpack_copy_positions(), in single precision relative to `origin`: three coordinates near the mesh, such as the
// middle of its file's bounds, without which coordinates far from zero lose digits. A null pointer is the origin of
// coordinates.
lodpack_status lodpack_copy_positions_float(const lodpack_mesh *mesh,
                                            const double *origin,
                                            float *positions,
                                            size_t capacity,
                                            size_t stride_bytes);

// Copies three vertex numbers for each triangle to `indices`, which has room for `capacity` triangles:
// counter-clockwise seen from outside.
lodpack_status lodpack_copy_triangles(const lodpack_mesh *mesh, uint32_t *indices, size_t capacity);

// Frees a mesh.
void lodpack_free_mesh(lodpack_mesh *mesh);

// The number of objects, which have the numbers from 0, and that of objects and assemblies, which follow: both 0 in a
// file without objects.
lodpack_status lodpack_object_count(const lodpack_file *file, uint32_t *object_count, uint32_t *node_count);

// Reads name, id and parent of an object or assembly.
lodpack_status lodpack_open_object(const lodpack_file *file, uint32_t number, lodpack_object **object);

// The name of an object in UTF-8, for as long as it is open; null if it has none.
const char *lodpack_object_name(const lodpack_object *object);

// What other programs know an object by, in UTF-8, for as long as it is open; null if it has no id.
const char *lodpack_object_id(const lodpack_object *object);

// What an object is a part of; UINT32_MAX if it is a part of nothing.
uint32_t lodpack_object_parent(const lodpack_object *object);

// Closes an object; null is nothing.
void lodpack_free_object(lodpack_object *object);

// The numbers of all objects and assemblies of a name or, if there is none, of an id, ascending: `capacity` of them at
// most. `count` says how many there are.
lodpack_status lodpack_find_objects(const lodpack_file *file, const char *name_or_id, uint32_t *numbers, size_t capacity, size_t *count);

// The numbers of what an object or assembly consists of, ascending, or with UINT32_MAX of all that is a part of
// nothing: `capacity` of them at most. `count` says how many there are.
lodpack_status lodpack_object_children(const lodpack_file *file, uint32_t parent, uint32_t *numbers, size_t capacity, size_t *count);

// A box around some objects and assemblies with everything below them. `is_there` says whether there is anything of
// them; if not, the box stays as it was.
lodpack_status lodpack_object_bounds(const lodpack_file *file,
                                     const uint32_t *numbers,
                                     size_t count,
                                     double *low,
                                     double *high,
                                     int32_t *is_there);

// A filter that draws everything but some objects and assemblies with everything below them. It is found once; queries
// that hold it read no more of the objects.
lodpack_status lodpack_hide_objects(const lodpack_file *file, const uint32_t *numbers, size_t count, lodpack_object_filter **filter);

// A filter that draws nothing but some objects and assemblies with everything below them.
lodpack_status lodpack_show_only(const lodpack_file *file, const uint32_t *numbers, size_t count, lodpack_object_filter **filter);

// Frees a filter; null is nothing. Cuts and streams that were asked for with it keep what they need.
void lodpack_free_filter(lodpack_object_filter *filter);

// What a ray meets first of the finest surface, from either side. `origin` and `direction` have three numbers; a
// filter lets it pass what it hides, and may be null.
lodpack_status lodpack_pick_surface(const lodpack_file *file,
                                    const double *origin,
                                    const double *direction,
                                    const lodpack_object_filter *filter,
                                    lodpack_pick *pick);

// Makes another mesh, whose vertices have a place in a page of images each: those on borders between images are there
// several times. Pages have at most `most_texels` texels along each side (such as 4096), unless one image is larger.
// All channels share these places.
lodpack_status lodpack_make_pages(const lodpack_mesh *mesh, uint32_t most_texels, lodpack_mesh **pages);

// Number of pages; 0 for a mesh without.
size_t lodpack_page_count(const lodpack_mesh *mesh);

// Writes how large a page is, and which triangles lie in it. Triangles after those of the last page have no texels.
lodpack_status lodpack_get_page(const lodpack_mesh *mesh, size_t number, lodpack_page *page);

// Copies the place of each vertex in its page to `places`, which has room for `capacity` vertices, `stride_bytes` from
// one to the next (0 for no gaps): texture coordinates from 0 to 1, where the first row of texels is at 0.
lodpack_status lodpack_copy_places(const lodpack_mesh *mesh, float *places, size_t capacity, size_t stride_bytes);

// Copies a page of a channel to `rgba`, which has room for `capacity` texels of four bytes: row by row from the top,
// in the colours of lodpack_copy_colours(). `channel` counts those that the mesh was decoded with.
lodpack_status lodpack_copy_page_colours(const lodpack_mesh *mesh, uint32_t channel, size_t number, uint8_t *rgba, size_t capacity);

// Copies a page of a channel to `numbers`, which has room for `capacity_bytes`: row by row from the top,
// `component_count` numbers a texel, of `number_bytes` each (see lodpack_channel). `channel` counts those that the
// mesh was decoded with. 0 where nothing is known.
lodpack_status lodpack_copy_page_numbers(const lodpack_mesh *mesh, uint32_t channel, size_t number, void *numbers, size_t capacity_bytes);

// A view from the origin along the negative z axis: 60 degrees, 1920 x 1080, one pixel.
lodpack_view lodpack_view_default(void);

// A query for everything at the finest level.
lodpack_query lodpack_query_default(void);

// Finds the coarsest cut within the tolerance that keeps every budget. Reads the index where the query needs it, and
// no surface. A box beside the surface gives an empty cut.
lodpack_status lodpack_select(const lodpack_file *file, const lodpack_query *query, lodpack_cut **cut);

// Writes what is known of a cut.
lodpack_status lodpack_get_cut_info(const lodpack_cut *cut, lodpack_cut_info *info);

// Frees a cut.
void lodpack_free_cut(lodpack_cut *cut);

// Makes a budget that streams share from frame to frame.
lodpack_status lodpack_open_budget(lodpack_budget **budget);

// Writes what each of `count` streams may take in the next frame, for `max_triangles` of all of them together and the
// tolerance that is worth having, in pixels: a tolerance for the views of all of them, and a number for the
// `max_triangles` of each one's query. Together these numbers are the budget, in every frame; which one gets how much
// follows from what was recorded, so that all have about the same error after a few frames.
lodpack_status lodpack_share_budget(lodpack_budget *budget,
                                    uint64_t max_triangles,
                                    double pixel_tolerance,
                                    double *shared_tolerance,
                                    uint64_t *shares,
                                    size_t count);

// Records the frames of all streams, in the order of the shares.
lodpack_status lodpack_record_frames(lodpack_budget *budget, const lodpack_frame *frames, size_t count);

// Ends a budget.
void lodpack_close_budget(lodpack_budget *budget);

// What went wrong in this thread's last call that returned a status: a text that is valid until the thread's next such
// call, and empty if nothing went wrong.
const char *lodpack_last_error(void);

// The version of this library, such as "0.1.0".
const char *lodpack_version(void);

// Options that suit most programs: 64 MiB of the file, 256 MiB of triangles and of images, four threads.
lodpack_stream_options lodpack_stream_options_default(void);

// Starts threads that load a file of either kind for a moving camera; null `options` are the default ones. A stream
// may be used by one thread at a time. Its file may be closed before it, but what the file is read from has to stay
// until both are.
lodpack_status lodpack_open_stream(const lodpack_file *file, const lodpack_stream_options *options, lodpack_stream **stream);

// Draws a frame: what a query wants, as far as it is loaded, without cracks. It does not wait, unless the stream was
// opened so. Call it again for the next picture, also where the camera stands still, until the frame is complete. The
// query needs a view, or a tolerance.
lodpack_status lodpack_draw_frame(lodpack_stream *stream, const lodpack_query *query, lodpack_frame *frame);

// Writes which root of the last frame to upload, and its mesh, which the caller frees. Where the stream shows channels
// and the root's images are there, the mesh has one page with all of them, else none. Of heights it has normals, and
// colours if there is a ramp.
lodpack_status lodpack_get_upload(const lodpack_stream *stream, size_t number, lodpack_upload *upload, lodpack_mesh **mesh);

// Writes the number of a root of the last frame that is drawn no longer.
lodpack_status lodpack_get_drop(const lodpack_stream *stream, size_t number, uint32_t *root);

// Waits until everything that the last frame wanted is loaded, or given up. The next frame draws it.
lodpack_status lodpack_settle(const lodpack_stream *stream);

// The next thing that a stream could not load and draws coarser: a text that is valid until the next call with the
// stream, or null.
const char *lodpack_next_problem(lodpack_stream *stream);

// Has later frames try again what could not be loaded.
lodpack_status lodpack_retry(lodpack_stream *stream);

// Ends the threads of a stream.
void lodpack_close_stream(lodpack_stream *stream);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LODPACK_H */
