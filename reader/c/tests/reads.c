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
static int opened = 0, drawn = 0, channels = 0, lossless = 0, frames = 0, grounds = 0;

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

/* Memory for exactly so many bytes, so that valgrind sees a byte too many. */
static void *room(size_t bytes) { return malloc(bytes + (bytes == 0)); }

/* What the surface carries at vertices. */
static void look_at_vertices(const lodpack_mesh *mesh, uint32_t channel, const lodpack_channel *about) {
    size_t vertices = lodpack_vertex_count(mesh);
    uint8_t *colours = room(4 * vertices);
    double *values = room(vertices * about->component_count * sizeof(double));
    EXPECT(lodpack_copy_colours(mesh, channel, colours, vertices, 0) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_values(mesh, channel, values, vertices, 0) == LODPACK_STATUS_OK);
    for (size_t i = 0; i < vertices; i++) {
        double first = values[i * about->component_count];
        EXPECT(isnan(first) || about->meaning == LODPACK_MEANING_NORMAL || first >= about->low);
        if (about->meaning == LODPACK_MEANING_COLOUR && !isnan(first)) {
            EXPECT(fabs((first - about->low) / about->step - colours[4 * i]) <= 1);
        }
    }
    if (vertices) {
        EXPECT(lodpack_copy_colours(mesh, channel, colours, vertices - 1, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_copy_values(mesh, channel, values, vertices, 7) == LODPACK_STATUS_ARGUMENT);
    }
    EXPECT(lodpack_copy_colours(mesh, 64, colours, vertices, 0) == LODPACK_STATUS_ARGUMENT);
    if (about->meaning == LODPACK_MEANING_NORMAL) {
        float *normals = room(vertices * 3 * sizeof(float));
        EXPECT(lodpack_copy_normals(mesh, normals, vertices, 0) == LODPACK_STATUS_OK);
        for (size_t i = 0; i < vertices; i++) {
            float *n = normals + 3 * i, length = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
            EXPECT(length == 0 || fabs(length - 1) < 1e-4);
        }
        free(normals);
    }
    free(colours);
    free(values);
}

/* Pages of a channel, and where vertices lie in them. */
static void look_at_pages(const lodpack_mesh *mesh, uint32_t channel, const lodpack_channel *about) {
    size_t vertices = lodpack_vertex_count(mesh), last = 0;
    float *places = room(vertices * 2 * sizeof(float));
    EXPECT(lodpack_copy_places(mesh, places, vertices, 0) == LODPACK_STATUS_OK);
    for (size_t i = 0; i < 2 * vertices; i++) {
        EXPECT(places[i] >= 0 && places[i] <= 1);
    }
    free(places);
    lodpack_page page;
    for (size_t number = 0; number < lodpack_page_count(mesh); number++) {
        EXPECT(lodpack_get_page(mesh, number, &page) == LODPACK_STATUS_OK);
        EXPECT(page.first_triangle == last && page.width > 0 && page.height > 0);
        last += page.triangle_count;
        size_t texels = (size_t)page.width * page.height, bytes = texels * about->component_count * about->number_bytes;
        uint8_t *colours = room(4 * texels), *numbers = room(bytes);
        EXPECT(lodpack_copy_page_colours(mesh, channel, number, colours, texels) == LODPACK_STATUS_OK);
        EXPECT(lodpack_copy_page_numbers(mesh, channel, number, numbers, bytes) == LODPACK_STATUS_OK);
        EXPECT(about->meaning != LODPACK_MEANING_COLOUR || (colours[0] == numbers[0] && colours[1] == numbers[1]));
        EXPECT(lodpack_copy_page_colours(mesh, channel, number, colours, texels - 1) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_copy_page_numbers(mesh, channel, number, numbers, bytes - 1) == LODPACK_STATUS_ARGUMENT);
        free(colours);
        free(numbers);
    }
    EXPECT(last <= lodpack_triangle_count(mesh));
    EXPECT(lodpack_get_page(mesh, lodpack_page_count(mesh), &page) == LODPACK_STATUS_ARGUMENT);
}

/* Decodes everything with all channels. */
static void look_at_channels(const lodpack_file *file, uint32_t count, int is_sound) {
    lodpack_query query = lodpack_query_default();
    lodpack_cut *cut;
    lodpack_mesh *mesh, *bare, *pages;
    uint32_t numbers[64];
    for (uint32_t number = 0; number < count && number < 64; number++) {
        numbers[number] = number;
    }
    uint32_t missing = count;
    if (lodpack_select(file, &query, &cut) != LODPACK_STATUS_OK) {
        EXPECT(!is_sound);
        return;
    }
    EXPECT(lodpack_decode_channels(file, cut, &missing, 1, &mesh) == LODPACK_STATUS_ARGUMENT && mesh == NULL);
    EXPECT(lodpack_decode_channels(file, cut, NULL, 1, &mesh) == LODPACK_STATUS_ARGUMENT && mesh == NULL);
    lodpack_status status = lodpack_decode_channels(file, cut, numbers, count, &mesh);
    /* The texels of the format's vectors are bytes made up: a mesh is sound where they are not. */
    EXPECT(status == LODPACK_STATUS_OK || (mesh == NULL && is_refusal(status)));
    if (status == LODPACK_STATUS_OK && lodpack_decode(file, cut, &bare) == LODPACK_STATUS_OK) {
        EXPECT(lodpack_vertex_count(mesh) == lodpack_vertex_count(bare));
        EXPECT(lodpack_copy_colours(bare, 0, NULL, 0, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_page_count(mesh) == 0 && lodpack_copy_places(mesh, NULL, 0, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(lodpack_make_pages(bare, 256, &pages) == LODPACK_STATUS_ARGUMENT && pages == NULL);
        EXPECT(lodpack_make_pages(mesh, 256, &pages) == LODPACK_STATUS_OK);
        lodpack_free_mesh(bare);
        EXPECT(lodpack_triangle_count(pages) == lodpack_triangle_count(mesh));
        EXPECT(lodpack_vertex_count(pages) >= lodpack_vertex_count(mesh) || !is_sound);
        for (uint32_t number = 0; number < count; number++) {
            lodpack_channel about;
            EXPECT(lodpack_get_channel(file, number, &about) == LODPACK_STATUS_OK);
            EXPECT(about.name && about.name[0] && about.component_count >= 1 && about.component_count <= 4);
            look_at_vertices(mesh, number, &about);
            look_at_vertices(pages, number, &about);
            look_at_pages(pages, number, &about);
            EXPECT(about.is_lossless == 0 || (about.is_lossless == 1 && about.number_bytes == 1));
            channels++;
            lossless += about.is_lossless;
        }
        /* Pages stay when what they were made from is freed. */
        lodpack_free_mesh(mesh);
        mesh = pages;
        EXPECT(lodpack_copy_triangles(mesh, NULL, 0) == (lodpack_triangle_count(mesh) ? LODPACK_STATUS_ARGUMENT : LODPACK_STATUS_OK));
    }
    lodpack_free_mesh(mesh);
    lodpack_free_cut(cut);
}

/* The mesh of a cut of heights. */
static void look_at_heights(const lodpack_file *file, const lodpack_heights_query *query, int has_colours, int is_sound) {
    lodpack_cut *cut;
    lodpack_mesh *mesh;
    lodpack_cut_info info;
    lodpack_status status = lodpack_select_heights(file, query, &cut);
    EXPECT((status == LODPACK_STATUS_OK) == (cut != NULL));
    if (status != LODPACK_STATUS_OK) {
        EXPECT(is_sound ? status == LODPACK_STATUS_QUERY : is_refusal(status));
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
    double *positions = room(vertices * 3 * sizeof(double)), *heights = room(vertices * sizeof(double));
    float *normals = room(vertices * 3 * sizeof(float));
    uint32_t *indices = room(triangles * 3 * sizeof(uint32_t));
    uint8_t *colours = room(vertices * 4);
    EXPECT(lodpack_copy_positions(mesh, positions, vertices, 0) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_triangles(mesh, indices, triangles) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_normals(mesh, normals, vertices, 0) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_values(mesh, 0, heights, vertices, 0) == LODPACK_STATUS_OK);
    EXPECT(lodpack_copy_values(mesh, 1, heights, vertices, 0) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_copy_colours(mesh, 0, colours, vertices, 0) == (has_colours ? LODPACK_STATUS_OK : LODPACK_STATUS_ARGUMENT));
    for (size_t i = 0; i < vertices; i++) {
        float *n = normals + 3 * i, length = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        EXPECT(fabs(length - 1) < 1e-3);
        EXPECT(!has_colours || colours[4 * i + 3] == 255);
        EXPECT(isfinite(heights[i]));
    }
    for (size_t i = 0; i < 3 * triangles; i++) {
        EXPECT(indices[i] < vertices);
    }
    free(positions);
    free(heights);
    free(normals);
    free(indices);
    free(colours);
    lodpack_free_mesh(mesh);
}

static void ask_heights(const lodpack_file *file, int is_sound) {
    lodpack_heights_info info;
    EXPECT(lodpack_get_heights_info(file, &info) == LODPACK_STATUS_OK);
    EXPECT(info.column_count > 0 && info.row_count > 0 && info.spacing[0] > 0 && info.spacing[1] < 0 && info.crs);
    lodpack_heights_query query = lodpack_heights_query_default();
    query.max_triangles = 20000;
    look_at_heights(file, &query, info.has_colours, is_sound);
    query.tolerance = INFINITY;
    look_at_heights(file, &query, info.has_colours, is_sound);
    for (int axis = 0; axis < 2; axis++) {
        double ends[2] = {info.first[axis], info.first[axis] + info.spacing[axis] * (axis ? info.row_count : info.column_count) / 2.0};
        query.low[axis] = fmin(ends[0], ends[1]);
        query.high[axis] = fmax(ends[0], ends[1]);
    }
    look_at_heights(file, &query, info.has_colours, is_sound);
    lodpack_cut *cut;
    lodpack_query other = lodpack_query_default();
    EXPECT(lodpack_select(file, &other, &cut) == LODPACK_STATUS_ARGUMENT && strstr(lodpack_last_error(), "holds heights"));
    query.low[0] = NAN;
    EXPECT(lodpack_select_heights(file, &query, &cut) == LODPACK_STATUS_QUERY || !is_sound);

    uint64_t columns = info.column_count < 5 ? info.column_count : 5, rows = info.row_count < 3 ? info.row_count : 3;
    double *heights = room(columns * rows * sizeof(double));
    lodpack_status status = lodpack_read_heights(file, info.column_count - columns, columns, 0, rows, heights, columns * rows);
    EXPECT(status == LODPACK_STATUS_OK || (!is_sound && is_refusal(status)));
    for (uint64_t i = 0; status == LODPACK_STATUS_OK && i < columns * rows; i++) {
        double steps = heights[i] / info.step;
        EXPECT(isnan(steps) || isfinite(steps));
    }
    EXPECT(lodpack_read_heights(file, 0, columns, 0, rows, heights, columns * rows - 1) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_read_heights(file, 0, UINT64_MAX, 0, 3, heights, columns * rows) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_read_heights(file, 0, 1, info.row_count, 1, heights, 1) == LODPACK_STATUS_QUERY);
    free(heights);
}

/* Draws as little that is new in a frame as there can be, until all of it is drawn, and then nothing more. */
static void pace(const lodpack_file *file) {
    lodpack_stream_options options = lodpack_stream_options_default();
    EXPECT(options.upload_bytes == UINT64_MAX);
    options.upload_bytes = 0;
    options.thread_count = 2;
    lodpack_stream *stream;
    EXPECT(lodpack_open_stream(file, &options, &stream) == LODPACK_STATUS_OK);
    lodpack_query query = lodpack_query_default();
    lodpack_frame frame = {0};
    for (int number = 0; number < 100000 && !frame.is_complete; number++) {
        EXPECT(lodpack_draw_frame(stream, &query, &frame) == LODPACK_STATUS_OK);
        EXPECT(lodpack_settle(stream) == LODPACK_STATUS_OK);
    }
    EXPECT(frame.is_complete);
    EXPECT(lodpack_draw_frame(stream, &query, &frame) == LODPACK_STATUS_OK);
    EXPECT(frame.is_complete && frame.upload_count == 0 && frame.drop_count == 0);
    lodpack_close_stream(stream);
}

/* Two streams keep one budget of triangles in every frame, one near and one far. */
static void share(const lodpack_file *file, const lodpack_info *info) {
    lodpack_stream_options options = lodpack_stream_options_default();
    options.waits = 1;
    lodpack_stream *streams[2];
    lodpack_view view = lodpack_view_default();
    lodpack_query query = lodpack_query_default();
    query.view = &view;
    for (int axis = 0; axis < 3; axis++) {
        view.position[axis] = (info->bounds_low[axis] + info->bounds_high[axis]) / 2;
    }
    double size = info->bounds_high[0] - info->bounds_low[0];
    view.near_plane = fmax(size / 1e6, 1e-12);
    lodpack_frame frames[2];
    uint64_t shares[2], least = 0, most = 0;
    double tolerance;
    for (int k = 0; k < 2; k++) {
        EXPECT(lodpack_open_stream(file, &options, &streams[k]) == LODPACK_STATUS_OK);
        view.position[2] = info->bounds_high[2] + size * (k ? 8 : .5);
        for (view.pixel_tolerance = 1e9; view.pixel_tolerance > 0; view.pixel_tolerance = view.pixel_tolerance > 1 ? 1e-9 : 0) {
            EXPECT(lodpack_draw_frame(streams[k], &query, &frames[k]) == LODPACK_STATUS_OK);
            EXPECT(frames[k].limited_by != LODPACK_LIMITER_TRIANGLES);
            *(view.pixel_tolerance > 1 ? &least : &most) += frames[k].wanted_triangle_count;
        }
    }
    lodpack_budget *budget;
    EXPECT(lodpack_open_budget(&budget) == LODPACK_STATUS_OK);
    uint64_t whole = least * 2 + (most - least) / 4;
    for (int number = 0; number < 30; number++) {
        EXPECT(lodpack_share_budget(budget, whole, .001, &tolerance, shares, 2) == LODPACK_STATUS_OK);
        EXPECT(shares[0] + shares[1] == whole && tolerance >= .001);
        for (int k = 0; k < 2; k++) {
            view.position[2] = info->bounds_high[2] + size * (k ? 8 : .5);
            view.pixel_tolerance = tolerance;
            query.max_triangles = shares[k];
            EXPECT(lodpack_draw_frame(streams[k], &query, &frames[k]) == LODPACK_STATUS_OK);
        }
        /* A share may be smaller than the coarsest cut. */
        EXPECT(frames[0].wanted_triangle_count + frames[1].wanted_triangle_count <= whole + least);
        EXPECT(lodpack_record_frames(budget, frames, 2) == LODPACK_STATUS_OK);
    }
    EXPECT(frames[0].wanted_triangle_count + frames[1].wanted_triangle_count <= whole);
    EXPECT(frames[0].wanted_triangle_count >= frames[1].wanted_triangle_count);
    EXPECT(lodpack_share_budget(NULL, 1, 1, &tolerance, shares, 2) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_share_budget(budget, 1, 1, &tolerance, NULL, 2) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_record_frames(budget, NULL, 2) == LODPACK_STATUS_ARGUMENT);
    lodpack_close_budget(budget);
    lodpack_close_budget(NULL);
    lodpack_close_stream(streams[0]);
    lodpack_close_stream(streams[1]);
}

/* Flies past a file, and counts the roots that a viewer would have. */
static void fly(const lodpack_file *file, const lodpack_info *info, int is_sound) {
    uint32_t channel = 0;
    lodpack_stream_options options = lodpack_stream_options_default();
    options.waits = 1;
    options.thread_count = 2;
    options.channels = &channel;
    options.channel_count = info->kind == LODPACK_KIND_MESH && info->channel_count > 0;
    lodpack_stream *stream;
    lodpack_stream_options idle = options;
    idle.thread_count = 0;
    EXPECT(lodpack_open_stream(file, &idle, &stream) == LODPACK_STATUS_ARGUMENT && stream == NULL);
    EXPECT(strstr(lodpack_last_error(), "thread_count"));
    lodpack_status status = lodpack_open_stream(file, &options, &stream);
    EXPECT((status == LODPACK_STATUS_OK) == (stream != NULL));
    if (status != LODPACK_STATUS_OK) {
        EXPECT(!is_sound && is_refusal(status));
        return;
    }
    lodpack_channel about;
    EXPECT(options.channel_count == 0 || lodpack_get_channel(file, 0, &about) == LODPACK_STATUS_OK);
    lodpack_view view = lodpack_view_default();
    lodpack_query query = lodpack_query_default();
    query.view = &view;
    double size = 0;
    for (int axis = 0; axis < 3; axis++) {
        view.position[axis] = (info->bounds_low[axis] + info->bounds_high[axis]) / 2;
        size = fmax(size, info->bounds_high[axis] - info->bounds_low[axis]);
    }
    view.near_plane = fmax(size / 1e6, 1e-12);
    uint64_t held = 0, triangles = 0;
    for (int number = 0; number < 6; number++) {
        view.position[2] = info->bounds_high[2] + size * (number < 4 ? 4.0 / (1 << number) : 4);
        lodpack_frame frame;
        status = lodpack_draw_frame(stream, &query, &frame);
        EXPECT(status == LODPACK_STATUS_OK || (!is_sound && is_refusal(status)));
        if (status != LODPACK_STATUS_OK) {
            break;
        }
        frames++;
        held += frame.upload_count;
        for (size_t i = 0; i < frame.upload_count; i++) {
            lodpack_upload upload;
            lodpack_mesh *mesh;
            EXPECT(lodpack_get_upload(stream, i, &upload, &mesh) == LODPACK_STATUS_OK);
            triangles += lodpack_triangle_count(mesh);
            if (lodpack_page_count(mesh)) {
                EXPECT(options.channel_count == 1);
                look_at_pages(mesh, 0, &about);
            }
            if (info->kind == LODPACK_KIND_HEIGHTS) {
                float *normals = room(lodpack_vertex_count(mesh) * 12);
                EXPECT(lodpack_copy_normals(mesh, normals, lodpack_vertex_count(mesh), 0) == LODPACK_STATUS_OK);
                free(normals);
            }
            lodpack_free_mesh(mesh);
        }
        lodpack_mesh *none;
        lodpack_upload upload;
        EXPECT(lodpack_get_upload(stream, frame.upload_count, &upload, &none) == LODPACK_STATUS_ARGUMENT && none == NULL);
        for (size_t i = 0; i < frame.drop_count; i++) {
            uint32_t root;
            EXPECT(lodpack_get_drop(stream, i, &root) == LODPACK_STATUS_OK);
        }
        /* What waits is complete, and everything of the first picture is new. */
        EXPECT(!is_sound || frame.is_complete);
        EXPECT(number > 0 || held == frame.root_count || frame.shows != LODPACK_SHOWN_PICTURE);
        EXPECT(number > 0 || triangles == frame.triangle_count || frame.shows != LODPACK_SHOWN_PICTURE);
    }
    EXPECT(lodpack_settle(stream) == LODPACK_STATUS_OK);
    EXPECT(lodpack_retry(stream) == LODPACK_STATUS_OK);
    const char *problem = lodpack_next_problem(stream);
    EXPECT(!is_sound || problem == NULL || strstr(problem, "texels"));
    EXPECT(problem == NULL || strlen(problem) > 0);
    lodpack_close_stream(stream);
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
        /* What no memory has room for is refused before anything is written. */
        size_t strides[3] = {SIZE_MAX, SIZE_MAX / 2, SIZE_MAX / vertices + 1};
        for (int i = 0; i < 3; i++) {
            EXPECT(vertices < 4 || lodpack_copy_positions(mesh, positions, vertices, strides[i]) == LODPACK_STATUS_ARGUMENT);
            EXPECT(vertices < 4 || strstr(lodpack_last_error(), "larger than any memory"));
        }
        EXPECT(lodpack_copy_positions(mesh, NULL, vertices, 0) == LODPACK_STATUS_ARGUMENT);
        EXPECT(strstr(lodpack_last_error(), "null") != NULL);
    }
    free(positions);
    free(indices);
    free(interleaved);
    lodpack_free_mesh(mesh);
}

static double along(const double row[4], const double p[3]) { return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]; }

/* The heights that a mesh stands on, which are a file like any other. */
static void ask_ground(const lodpack_file *file, const lodpack_info *info, int is_sound) {
    lodpack_file *ground;
    lodpack_ground_frame frame;
    lodpack_status status = lodpack_open_ground(file, &ground, &frame);
    EXPECT(status == LODPACK_STATUS_OK || (!is_sound && is_refusal(status) && ground == NULL));
    EXPECT(status != LODPACK_STATUS_OK || (ground != NULL) == (info->ground_bytes > 0));
    if (!ground) {
        return;
    }
    grounds++;
    lodpack_info below;
    EXPECT(lodpack_get_info(ground, &below) == LODPACK_STATUS_OK && below.kind == LODPACK_KIND_HEIGHTS);
    ask_heights(ground, is_sound);
    lodpack_status verified = lodpack_verify(ground);
    EXPECT(verified == LODPACK_STATUS_OK || (!is_sound && is_refusal(verified)));
    /* There and back again; lengths grow by the scale. */
    double low[3], high[3], back[3], own = 0, seen = 0;
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = along(frame.mesh_from_ground[axis], below.bounds_low);
        high[axis] = along(frame.mesh_from_ground[axis], below.bounds_high);
        own += (below.bounds_high[axis] - below.bounds_low[axis]) * (below.bounds_high[axis] - below.bounds_low[axis]);
        seen += (high[axis] - low[axis]) * (high[axis] - low[axis]);
    }
    for (int axis = 0; axis < 3; axis++) {
        back[axis] = along(frame.ground_from_mesh[axis], low);
        EXPECT(fabs(back[axis] - below.bounds_low[axis]) <= 1e-9 * (1 + fabs(back[axis])) || !is_sound);
    }
    EXPECT(fabs(sqrt(seen) - frame.scale * sqrt(own)) <= 1e-9 * (1 + sqrt(seen)) || !is_sound);
    lodpack_view view = lodpack_view_default(), from;
    EXPECT(lodpack_view_of_ground(&frame, &view, &from) == LODPACK_STATUS_OK);
    EXPECT(fabs(from.near_plane * frame.scale - view.near_plane) < 1e-12 && from.width == view.width);
    EXPECT(lodpack_view_of_ground(NULL, &view, &from) == LODPACK_STATUS_ARGUMENT);
    fly(ground, &below, is_sound);
    lodpack_close(ground);
}

static void ask_everything(const lodpack_file *file, int is_sound) {
    lodpack_info info;
    lodpack_level level;
    lodpack_mesh *overview;
    lodpack_heights_info heights;
    EXPECT(lodpack_get_info(file, &info) == LODPACK_STATUS_OK);
    lodpack_channel about;
    EXPECT(lodpack_get_channel(file, info.channel_count, &about) == LODPACK_STATUS_ARGUMENT);
    ask_ground(file, &info, is_sound);
    if (info.kind == LODPACK_KIND_HEIGHTS) {
        ask_heights(file, is_sound);
        return;
    }
    EXPECT(lodpack_get_heights_info(file, &heights) == LODPACK_STATUS_ARGUMENT);
    if (info.channel_count) {
        look_at_channels(file, info.channel_count, is_sound);
    }
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
    lodpack_stream *stream;
    lodpack_frame frame;
    EXPECT(lodpack_open_stream(NULL, NULL, &stream) == LODPACK_STATUS_ARGUMENT && stream == NULL);
    EXPECT(lodpack_draw_frame(NULL, &query, &frame) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_next_problem(NULL) == NULL && lodpack_page_count(NULL) == 0);
    EXPECT(lodpack_read_heights(NULL, 0, 1, 0, 1, NULL, 1) == LODPACK_STATUS_ARGUMENT);
    EXPECT(lodpack_copy_normals(NULL, NULL, 0, 0) == LODPACK_STATUS_ARGUMENT);
    lodpack_ground_frame ground;
    EXPECT(lodpack_open_ground(NULL, &file, &ground) == LODPACK_STATUS_ARGUMENT && file == NULL);
    lodpack_close_stream(NULL);
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
        lodpack_info info;
        if (i == 1 && lodpack_get_info(files[i], &info) == LODPACK_STATUS_OK) {
            fly(files[i], &info, is_sound);
            if (is_sound && info.kind == LODPACK_KIND_MESH) {
                pace(files[i]);
            }
            if (is_sound) {
                share(files[i], &info);
            }
        }
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
    printf("%d files, %s; %d opened, %d meshes, %d channels, %d lossless, %d frames, %d grounds\n", argc - 2,
           failures ? "some not as expected" : "all as expected", opened, drawn, channels, lossless, frames, grounds);
    return failures != 0;
}
