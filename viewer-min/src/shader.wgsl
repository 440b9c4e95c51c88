// Both ways of drawing. Stitched: the CPU makes vertices and index lists. Pulled: the vertex shader reads block data as
// it is, and looks up the samples that a finer neighbour has on the shared arc.
//
// A position is a pair of floats, so its difference to the camera is exact to 48 bits. It depends only on the world
// position, so two roots draw the points that they share at the same position, bit for bit.
//
// Roots with an image have entries of their own, `..._textured`: each vertex also gets its place in the image.

struct Globals {
    // The camera's axes, then its position as pairs.
    right: vec4f, up: vec4f, forward: vec4f,
    camera_high: vec4f, camera_low: vec4f,
    // Clip units per tangent in x and y, near plane, pixels per tangent.
    projection: vec4f,
    // Tolerance in pixels; number of levels; greatest depth in the tree.
    scale: vec4f,
    // Meaning of colours (0 shading, 1 nodes, 2 levels, 3 errors, 4 depths); 1 for wireframe; 1 for borders.
    mode: vec4f,
    // What texels are (1 colours, 2 numbers for the ramp, 3 classes, 4 normals); 1 for no light; smallest and largest number of the ramp.
    channel: vec4f,
}
// The mean is a texel in four bytes, all 0 if there is none.
struct Root { id: u32, level: u32, error: f32, depth: u32, mean: u32 }
// For each coordinate of a place what a point is multiplied with, and what is added; smallest and largest place.
struct Piece { u: vec4f, v: vec4f, range: vec4f }
// Points are taken from the origin, which is a pair; its last number has the bits of the number of inner triangles. The fourth one has, of a tile of
// heights, the texels of its colours for each of its normals, along each direction; else 0.
struct Pieces { origin_high: vec4f, origin_low: vec4f, items: array<Piece> }

@group(0) @binding(0) var<uniform> globals: Globals;
@group(0) @binding(1) var<storage, read> roots: array<Root>;
// Block data: six floats per vertex and its normal, three indices per triangle, twelve numbers per border triangle; and the
// neighbours' samples.
@group(1) @binding(0) var<storage, read> points: array<u32>;
@group(1) @binding(1) var<storage, read> triangles: array<u32>;
@group(1) @binding(2) var<storage, read> border: array<u32>;
@group(1) @binding(3) var<storage, read> snap: array<u32>;

// A root's image, and the piece of each triangle: inner ones, then those at the border.
@group(2) @binding(0) var<storage, read> pieces: Pieces;
@group(2) @binding(1) var texels: texture_2d<f32>;
@group(2) @binding(2) var linear_sampler: sampler;
@group(2) @binding(3) var<storage, read> labels: array<u32>;
// Normals, with 1 in the fourth component; 0 where there are none.
@group(2) @binding(4) var normals: texture_2d<f32>;

struct Vertex {
    @invariant @builtin(position) clip: vec4f,
    @location(0) view: vec3f,
    // Barycentric coordinates, for lines.
    @location(1) corner: vec3f,
    @location(2) @interpolate(flat) slot: u32,
    // Bit k: the edge from corner k to the next lies on an arc.
    @location(3) @interpolate(flat) borders: u32,
    // Along the camera's axes; without length where there is none.
    @location(4) normal: vec3f,
}

struct TexturedVertex {
    @invariant @builtin(position) clip: vec4f,
    @location(0) view: vec3f,
    @location(1) corner: vec3f,
    @location(2) @interpolate(flat) slot: u32,
    @location(3) @interpolate(flat) borders: u32,
    // In texels of the image. A place is linear in the point, so it may be interpolated.
    @location(4) place: vec2f,
    @location(5) @interpolate(flat) piece: u32,
    @location(6) normal: vec3f,
}

// A corner of a triangle: its position as a pair, and its normal as a place in the unfolded octahedron.
struct Point { high: vec3f, low: vec3f, folded: u32, corner: vec3f, borders: u32 }

// The normal as the camera sees it; without length if there is none.
fn unfolded(folded: u32) -> vec3f {
    if (folded == 0x80008000u) { return vec3f(0.0); }
    let place = unpack2x16snorm(folded);
    var n = vec3f(place, 1.0 - abs(place.x) - abs(place.y));
    if (n.z < 0.0) { n = vec3f((1.0 - abs(place.yx)) * select(vec2f(-1.0), vec2f(1.0), place >= vec2f(0.0)), n.z); }
    n = normalize(n);
    return vec3f(dot(globals.right.xyz, n), dot(globals.up.xyz, n), dot(globals.forward.xyz, n));
}

fn project(point: Point, slot: u32) -> Vertex {
    let offset = (point.high - globals.camera_high.xyz) + (point.low - globals.camera_low.xyz);
    let view = vec3f(dot(globals.right.xyz, offset), dot(globals.up.xyz, offset), dot(globals.forward.xyz, offset));
    let clip = vec4f(view.x * globals.projection.x, view.y * globals.projection.y, globals.projection.z, view.z);
    return Vertex(clip, view, point.corner, slot, point.borders, unfolded(point.folded));
}

fn project_textured(point: Point, slot: u32, number: u32) -> TexturedVertex {
    let vertex = project(point, slot);
    let offset = (point.high - pieces.origin_high.xyz) + (point.low - pieces.origin_low.xyz);
    let piece = pieces.items[number];
    let place = vec2f(dot(offset, piece.u.xyz) + piece.u.w, dot(offset, piece.v.xyz) + piece.v.w);
    return TexturedVertex(vertex.clip, vertex.view, vertex.corner, slot, vertex.borders, place, number, vertex.normal);
}

@vertex
fn stitched(
    @location(0) high: vec3f, @location(1) low: vec3f, @location(3) folded: u32, @builtin(instance_index) slot: u32,
) -> Vertex {
    return project(Point(high, low, folded, vec3f(1.0), 0u), slot);
}

@vertex
fn stitched_textured(
    @location(0) high: vec3f, @location(1) low: vec3f, @location(2) piece: u32, @location(3) folded: u32,
    @builtin(instance_index) slot: u32,
) -> TexturedVertex {
    return project_textured(Point(high, low, folded, vec3f(1.0), 0u), slot, piece);
}

// A tile of heights: its images have a texel a sample, or several, and each vertex its place among these texels.
@vertex
fn stitched_tile(
    @location(0) high: vec3f, @location(1) low: vec3f, @location(2) place: vec2f, @builtin(instance_index) slot: u32,
) -> TexturedVertex {
    let vertex = project(Point(high, low, 0x80008000u, vec3f(1.0), 0u), slot);
    return TexturedVertex(vertex.clip, vertex.view, vertex.corner, slot, vertex.borders, place + 0.5, 0u, vertex.normal);
}

fn unit(k: u32) -> vec3f {
    return vec3f(f32(k == 0u), f32(k == 1u), f32(k == 2u));
}

fn point_of(point: u32, corner: u32, borders: u32) -> Point {
    let at = 7u * point;
    let high = vec3f(bitcast<f32>(points[at]), bitcast<f32>(points[at + 1u]), bitcast<f32>(points[at + 2u]));
    let low = vec3f(bitcast<f32>(points[at + 3u]), bitcast<f32>(points[at + 4u]), bitcast<f32>(points[at + 5u]));
    return Point(high, low, points[at + 6u], unit(corner), borders);
}

@vertex
fn pulled(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> Vertex {
    return project(point_of(triangles[vertex], vertex % 3u, 0u), slot);
}

@vertex
fn pulled_textured(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> TexturedVertex {
    return project_textured(point_of(triangles[vertex], vertex % 3u, 0u), slot, labels[vertex / 3u]);
}

// The first sample of a chain, from index `begin` on, whose place is at least `place`.
fn first_at_least(begin: u32, count: u32, place: u32) -> u32 {
    var low = 0u;
    var high = count;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (snap[begin + 8u * middle] < place) { low = middle + 1u; } else { high = middle; }
    }
    return low;
}

// The samples that a border edge gets: the index of the first one's words, and their number. Corners that only finer roots have count
// as samples. A chain is the border from one corner of the root to the next; places along it grow in the direction of the loop.
struct Extra { start: u32, count: u32 }

fn extra_of(record: u32, edge: u32) -> Extra {
    let chain = border[record + 3u + 3u * edge];
    if (chain == 0xffffffffu) { return Extra(0u, 0u); }
    let begin = snap[1u + 2u * chain];
    let all = snap[2u + 2u * chain];
    let low = first_at_least(begin, all, border[record + 4u + 3u * edge] + 1u);
    let high = first_at_least(begin, all, border[record + 5u + 3u * edge]);
    if (high <= low) { return Extra(0u, 0u); }
    return Extra(begin + 8u * low, high - low);
}

// A vertex of the fan: a point of the block, or the words of a sample.
struct Pick { point: u32, sample: u32 }

// Item `i` of the chain: `from`, samples, `to`.
fn chain(i: u32, from_point: u32, extra: Extra, to_point: u32) -> Pick {
    if (i == 0u) { return Pick(from_point, 0u); }
    if (i > extra.count) { return Pick(to_point, 0u); }
    return Pick(0u, extra.start + 8u * (i - 1u));
}

// Border snapping. Stitching turns a border triangle into a fan. Each border triangle gets as many triangles as the largest
// fan of this root has at present: its own fan fills the first ones, and the others degenerate to points.
fn border_point(vertex: u32) -> Point {
    let most_triangles = snap[0];
    let corner = vertex % 3u;
    let number = (vertex / 3u) % most_triangles;
    let record = 12u * (vertex / (3u * most_triangles));
    var extra = array<Extra, 3>(extra_of(record, 0u), extra_of(record, 1u), extra_of(record, 2u));
    var on_border = array<u32, 3>(
        u32(border[record + 3u] != 0xffffffffu), u32(border[record + 6u] != 0xffffffffu),
        u32(border[record + 9u] != 0xffffffffu));
    var base = 0u;
    if (extra[0].count == 0u) { base = 1u; if (extra[1].count == 0u) { base = 2u; } }
    let on_base = extra[base];
    if (on_base.count == 0u) {
        // No neighbour is finer.
        let borders = on_border[0] | on_border[1] << 1u | on_border[2] << 2u;
        return point_of(border[record + select(0u, corner, number == 0u)], corner, borders);
    }
    let after = (base + 1u) % 3u;
    let before = (base + 2u) % 3u;
    let from_point = border[record + base];
    let to_point = border[record + after];
    let apex = border[record + before];
    let first_fan = extra[before].count + 1u;
    let middle_fan = on_base.count - 1u;
    let all = first_fan + middle_fan + extra[after].count + 1u;
    var pick = Pick(apex, 0u);
    var borders = 0u;
    if (number < first_fan) {
        if (corner == 0u) { pick = chain(1u, from_point, on_base, to_point); }
        else { pick = chain(number + corner - 1u, apex, extra[before], from_point); }
        borders = on_border[before] << 1u | u32(number + 1u == first_fan) << 2u;
    } else if (number < first_fan + middle_fan) {
        if (corner > 0u) { pick = chain(number - first_fan + corner, from_point, on_base, to_point); }
        borders = 2u;
    } else if (number < all) {
        let i = number - first_fan - middle_fan;
        if (corner == 0u) { pick = chain(on_base.count, from_point, on_base, to_point); }
        else { pick = chain(i + corner - 1u, to_point, extra[after], apex); }
        borders = on_border[after] << 1u | u32(i == 0u);
    }
    if (pick.sample == 0u) { return point_of(pick.point, corner, borders); }
    let at = pick.sample + 1u;
    let high = vec3f(bitcast<f32>(snap[at]), bitcast<f32>(snap[at + 1u]), bitcast<f32>(snap[at + 2u]));
    let low = vec3f(bitcast<f32>(snap[at + 3u]), bitcast<f32>(snap[at + 4u]), bitcast<f32>(snap[at + 5u]));
    return Point(high, low, snap[at + 6u], unit(corner), borders);
}

@vertex
fn pulled_border(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> Vertex {
    return project(border_point(vertex), slot);
}

@vertex
fn pulled_border_textured(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> TexturedVertex {
    let label = bitcast<u32>(pieces.origin_low.w) + vertex / (3u * snap[0]);
    return project_textured(border_point(vertex), slot, labels[label]);
}

fn hue(h: f32) -> vec3f {
    return clamp(abs(fract(vec3f(h) + vec3f(1.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, vec3f(0.0), vec3f(1.0));
}

struct Pixel {
    @location(0) colour: vec4f,
    // The root's number plus one, and the bits of the depth along the camera's axis.
    @location(1) where_from: vec2u,
}

// Between what screens show (sRGB) and linear light.
fn linear_of(shown: vec3f) -> vec3f {
    return select(pow((shown + 0.055) / 1.055, vec3f(2.4)), shown / 12.92, shown <= vec3f(0.04045));
}

fn shown_of(light: vec3f) -> vec3f {
    let high = 1.055 * pow(max(light, vec3f(0.0)), vec3f(1.0 / 2.4)) - 0.055;
    return clamp(select(high, 12.92 * light, light <= vec3f(0.0031308)), vec3f(0.0), vec3f(1.0));
}

// Colours of growing brightness, which stay apart for those who do not see all colours: viridis.
fn ramp(t: f32) -> vec3f {
    var stops = array<vec3f, 5>(
        vec3f(68.0, 1.0, 84.0), vec3f(59.0, 82.0, 139.0), vec3f(33.0, 145.0, 140.0), vec3f(94.0, 201.0, 98.0),
        vec3f(253.0, 231.0, 37.0));
    let x = clamp(t, 0.0, 1.0) * 4.0;
    let k = min(u32(x), 3u);
    return mix(stops[k], stops[k + 1u], x - f32(k)) / 255.0;
}

// The linear colour of a texel, which is linear light or a number in two bytes.
fn colour_of(texel: vec4f) -> vec3f {
    if (globals.channel.x == 2.0) {
        let number = texel.x * 65280.0 + texel.y * 255.0;
        return linear_of(ramp((number - globals.channel.z) / max(globals.channel.w - globals.channel.z, 1e-6)));
    }
    return texel.rgb;
}

// The mean of an image over the pixel: of one place where texels are larger than pixels, of up to 16 where they are smaller. No place is beyond the
// piece, so no other piece's texels are read.
fn mean_at(image: texture_2d<f32>, place: vec2f, along_x: vec2f, along_y: vec2f, range: vec4f) -> vec4f {
    let size = vec2f(textureDimensions(image));
    let count = clamp(ceil(max(length(along_x), length(along_y))), 1.0, 4.0);
    var sum = vec4f(0.0);
    for (var y = 0.5; y < count; y += 1.0) {
        for (var x = 0.5; x < count; x += 1.0) {
            let at = place + along_x * (x / count - 0.5) + along_y * (y / count - 0.5);
            sum += textureSampleLevel(image, linear_sampler, clamp(at, range.xy, range.zw) / size, 0.0);
        }
    }
    return sum / (count * count);
}

@fragment
fn shade(vertex: Vertex, @builtin(front_facing) is_front: bool) -> Pixel {
    let mean = unpack4x8unorm(roots[vertex.slot].mean);
    let is_number = globals.channel.x == 2.0;
    let colour = colour_of(vec4f(select(linear_of(mean.rgb), mean.rgb, is_number), 1.0));
    return finished(vertex, is_front, vec4f(colour, mean.a), vec3f(0.0), globals.channel.y == 1.0);
}

@fragment
fn shade_textured(vertex: TexturedVertex, @builtin(front_facing) is_front: bool) -> Pixel {
    let along_x = dpdx(vertex.place);
    let along_y = dpdy(vertex.place);
    let range = pieces.items[vertex.piece].range;
    let nearest = textureLoad(texels, vec2u(clamp(vertex.place, range.xy, range.zw)), 0);
    var texel = nearest;
    if (globals.channel.x != 3.0) { texel = mean_at(texels, vertex.place, along_x, along_y, range); }
    var normal = vec3f(0.0);
    let per_normal = max(pieces.origin_high.w, 1.0);
    if (pieces.origin_high.w > 0.0 || all(textureDimensions(normals) == textureDimensions(texels))) {
        let place = (vertex.place - 0.5) / per_normal + 0.5;
        let of_normals = (range - 0.5) / per_normal + 0.5;
        let direction = mean_at(normals, place, along_x / per_normal, along_y / per_normal, of_normals);
        let n = (direction.xyz * 255.0 - 128.0) * direction.w;
        normal = vec3f(dot(globals.right.xyz, n), dot(globals.up.xyz, n), dot(globals.forward.xyz, n));
    }
    let plain = Vertex(vertex.clip, vertex.view, vertex.corner, vertex.slot, vertex.borders, vertex.normal);
    // The lowest bits of a texel's coverage say how it is meant: they are not interpolated.
    var bits = 3u;
    if (globals.channel.x == 1.0) { bits = u32(nearest.a * 255.0 + 0.5); }
    let is_unlit = globals.channel.y == 1.0 || (bits & 2u) == 0u;
    let pixel = finished(plain, is_front, vec4f(colour_of(texel), 1.0), normal, is_unlit);
    // What stops a share of the light is there in this share of the pixels: in none with the least coverage, 4, and in all with the most, 252.
    let least = select(f32(bits & 3u) + 4.5 + 247.0 * scattered(vertex.clip.xy), 127.5, (bits & 1u) != 0u);
    if (globals.channel.x == 1.0 && globals.mode.x == 0.0 && texel.a * 255.0 < least) { discard; }
    return pixel;
}

// A number from 0 to 1 for a pixel, so that those of neighbours are spread evenly (Jimenez 2014, "Next generation post processing in Call of
// Duty: Advanced Warfare", interleaved gradient noise).
fn scattered(pixel: vec2f) -> f32 {
    return fract(52.9829189 * fract(dot(floor(pixel), vec2f(0.06711056, 0.00583715))));
}

// A pixel of a surface of this linear colour, or of none if it has no opacity; and with this normal, or that of its vertices if it has no length, or that of
// its triangle if they have none.
fn finished(vertex: Vertex, faces_here: bool, channel: vec4f, stored: vec3f, is_unlit: bool) -> Pixel {
    let root = roots[vertex.slot];
    let along_x = dpdx(vertex.view);
    let along_y = dpdy(vertex.view);
    var normal = cross(along_x, along_y);
    // Rounding may leave a sliver without a normal; light it from the front.
    let is_lost = dot(normal, normal) <= 1e-12 * dot(along_x, along_x) * dot(along_y, along_y);
    normal = normalize(select(normal, -vertex.view, is_lost));
    if (dot(normal, vertex.view) > 0.0) { normal = -normal; }
    var is_front = faces_here;
    if (dot(stored, stored) > 0.0) {
        normal = normalize(select(-stored, stored, is_front));
    } else if (dot(vertex.normal, vertex.normal) > 0.0) {
        // A sliver that is folded over is seen from behind, but looks this way with all around it.
        is_front = is_front || dot(vertex.normal, vertex.view) < 0.0;
        normal = normalize(select(-vertex.normal, vertex.normal, is_front));
    }
    // A key light over the left shoulder, a weak one from the right, and the sky.
    let key = max(dot(normal, normalize(vec3f(-0.45, 0.6, -0.66))), 0.0);
    let fill = max(dot(normal, normalize(vec3f(0.8, 0.0, -0.6))), 0.0);
    let light = 0.16 + 0.92 * key + 0.18 * fill + 0.08 * normal.y;
    var base = select(vec3f(0.75, 0.32, 0.26), vec3f(0.86, 0.83, 0.78), is_front);
    if (globals.mode.x == 1.0) {
        base = mix(vec3f(1.0), hue(fract(f32(root.id % 4096u) * 0.618034)), 0.42);
    } else if (globals.mode.x == 2.0) {
        base = mix(vec3f(1.0), hue(0.7 - 0.7 * f32(root.level) / max(globals.scale.y - 1.0, 1.0)), 0.5);
    } else if (globals.mode.x == 3.0) {
        // Green: far below the tolerance; yellow: at it; red: twice the tolerance.
        let pixels = root.error * globals.projection.w / vertex.view.z;
        base = mix(vec3f(1.0), hue(clamp(0.333 - 0.167 * pixels / globals.scale.x, 0.0, 0.333)), 0.6);
    } else if (globals.mode.x == 4.0) {
        base = mix(vec3f(1.0), hue(0.7 - 0.7 * f32(root.depth) / max(globals.scale.z, 1.0)), 0.5);
    }
    var colour = sqrt(clamp(base * base * light, vec3f(0.0), vec3f(1.0)));
    let is_clay = globals.channel.x == 4.0 && globals.channel.y == 0.0;
    if (channel.a > 0.0 && globals.mode.x == 0.0 && !is_clay) {
        colour = shown_of(channel.rgb * select(light, 1.0, is_unlit));
    }
    let width = fwidth(vertex.corner);
    let line = vec3f(1.0) - smoothstep(vec3f(0.2) * width, vec3f(1.2) * width, vertex.corner);
    if (globals.mode.y == 1.0) {
        colour = mix(colour, vec3f(0.05, 0.1, 0.2), 0.55 * max(line.x, max(line.y, line.z)));
    }
    if (globals.mode.z == 1.0) {
        // The edge from corner k to the next is where the coordinate of the third corner is zero.
        let is_border = vec3f(f32((vertex.borders >> 1u) & 1u), f32((vertex.borders >> 2u) & 1u), f32(vertex.borders & 1u));
        let line = (vec3f(1.0) - smoothstep(vec3f(0.8) * width, vec3f(2.0) * width, vertex.corner)) * is_border;
        colour = mix(colour, vec3f(0.85, 0.1, 0.45), max(line.x, max(line.y, line.z)));
    }
    return Pixel(vec4f(colour, 1.0), vec2u(root.id + 1u, bitcast<u32>(vertex.view.z)));
}
