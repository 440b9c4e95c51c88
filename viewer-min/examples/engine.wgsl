@group(0) @binding(0) var<uniform> camera: mat4x4f;
struct Pixel { @builtin(position) place: vec4f, @location(0) normal: vec3f }
@vertex fn vertex(@location(0) position: vec3f, @location(1) octahedron: vec2f) -> Pixel {
    let z = 1.0 - abs(octahedron.x) - abs(octahedron.y);
    let folded = (1.0 - abs(octahedron.yx)) * select(vec2f(-1.0), vec2f(1.0), octahedron >= vec2f(0.0));
    return Pixel(vec4f(position, 1.0) * camera, normalize(vec3f(select(octahedron, folded, z < 0.0), z)));
}
@fragment fn fragment(pixel: Pixel) -> @location(0) vec4f {
    let light = 0.35 + 0.65 * abs(dot(normalize(pixel.normal), normalize(vec3f(0.4, 0.8, 0.45))));
    return vec4f(vec3f(0.86, 0.82, 0.75) * light, 1.0);
}
