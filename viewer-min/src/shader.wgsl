// Both ways of drawing. Stitched: the CPU makes vertices and index lists. Pulled: the vertex shader reads block data as
// it is, and looks up the samples that a finer neighbour has on the shared arc.
//
// A position is a pair of floats, so its difference to the camera is exact to 48 bits. It depends only on the world
// position, so two roots draw the points that they share at the same position, bit for bit.

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
}
struct Root { id: u32, level: u32, error: f32, depth: u32 }

@group(0) @binding(0) var<uniform> globals: Globals;
@group(0) @binding(1) var<storage, read> roots: array<Root>;
// Block data: six floats per vertex, three indices per triangle, twelve numbers per border triangle; and the
// neighbours' samples.
@group(1) @binding(0) var<storage, read> points: array<f32>;
@group(1) @binding(1) var<storage, read> triangles: array<u32>;
@group(1) @binding(2) var<storage, read> border: array<u32>;
@group(1) @binding(3) var<storage, read> snap: array<u32>;

struct Vertex {
    @invariant @builtin(position) clip: vec4f,
    @location(0) view: vec3f,
    // Barycentric coordinates, for lines.
    @location(1) corner: vec3f,
    @location(2) @interpolate(flat) slot: u32,
    // Bit k: the edge from corner k to the next lies on an arc.
    @location(3) @interpolate(flat) borders: u32,
}

fn project(high: vec3f, low: vec3f, corner: vec3f, slot: u32, borders: u32) -> Vertex {
    let offset = (high - globals.camera_high.xyz) + (low - globals.camera_low.xyz);
    let view = vec3f(dot(globals.right.xyz, offset), dot(globals.up.xyz, offset), dot(globals.forward.xyz, offset));
    let clip = vec4f(view.x * globals.projection.x, view.y * globals.projection.y, globals.projection.z, view.z);
    return Vertex(clip, view, corner, slot, borders);
}

@vertex
fn stitched(@location(0) high: vec3f, @location(1) low: vec3f, @builtin(instance_index) slot: u32) -> Vertex {
    return project(high, low, vec3f(1.0), slot, 0u);
}

fn unit(k: u32) -> vec3f {
    return vec3f(f32(k == 0u), f32(k == 1u), f32(k == 2u));
}

fn place_point(point: u32, corner: u32, slot: u32, borders: u32) -> Vertex {
    let at = 6u * point;
    return project(vec3f(points[at], points[at + 1u], points[at + 2u]),
        vec3f(points[at + 3u], points[at + 4u], points[at + 5u]), unit(corner), slot, borders);
}

@vertex
fn pulled(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> Vertex {
    return place_point(triangles[vertex], vertex % 3u, slot, 0u);
}

// The first sample of a chain, from index `begin` on, whose place is at least `place`.
fn first_at_least(begin: u32, count: u32, place: u32) -> u32 {
    var low = 0u;
    var high = count;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (snap[begin + 7u * middle] < place) { low = middle + 1u; } else { high = middle; }
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
    return Extra(begin + 7u * low, high - low);
}

// A vertex of the fan: a point of the block, or the words of a sample.
struct Pick { point: u32, sample: u32 }

// Item `i` of the chain: `from`, samples, `to`.
fn chain(i: u32, from_point: u32, extra: Extra, to_point: u32) -> Pick {
    if (i == 0u) { return Pick(from_point, 0u); }
    if (i > extra.count) { return Pick(to_point, 0u); }
    return Pick(0u, extra.start + 7u * (i - 1u));
}

// Border snapping. Stitching turns a border triangle into a fan. Each border triangle gets as many triangles as the largest
// fan of this root has at present: its own fan fills the first ones, and the others degenerate to points.
@vertex
fn pulled_border(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> Vertex {
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
        return place_point(border[record + select(0u, corner, number == 0u)], corner, slot, borders);
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
    if (pick.sample == 0u) { return place_point(pick.point, corner, slot, borders); }
    let at = pick.sample + 1u;
    let high = vec3f(bitcast<f32>(snap[at]), bitcast<f32>(snap[at + 1u]), bitcast<f32>(snap[at + 2u]));
    let low = vec3f(bitcast<f32>(snap[at + 3u]), bitcast<f32>(snap[at + 4u]), bitcast<f32>(snap[at + 5u]));
    return project(high, low, unit(corner), slot, borders);
}

fn hue(h: f32) -> vec3f {
    return clamp(abs(fract(vec3f(h) + vec3f(1.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, vec3f(0.0), vec3f(1.0));
}

struct Pixel {
    @location(0) colour: vec4f,
    // The root's number plus one, and the bits of the depth along the camera's axis.
    @location(1) where_from: vec2u,
}

@fragment
fn shade(vertex: Vertex, @builtin(front_facing) is_front: bool) -> Pixel {
    let root = roots[vertex.slot];
    let along_x = dpdx(vertex.view);
    let along_y = dpdy(vertex.view);
    var normal = cross(along_x, along_y);
    // Rounding may leave a sliver without a normal; light it from the front.
    let is_lost = dot(normal, normal) <= 1e-12 * dot(along_x, along_x) * dot(along_y, along_y);
    normal = normalize(select(normal, -vertex.view, is_lost));
    if (dot(normal, vertex.view) > 0.0) { normal = -normal; }
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
