//! Writes meshes of heights with what their vertices look like: GLB with normals and colours, PLY with colours.

use std::io::{self, BufWriter, Write};

use serde_json::json;

use super::export::{MeshFormat, normal_columns, write_mesh_with_normals, write_ply};
use super::smooth::Fans;
use super::srgb::linear_from_srgb;
use super::textured::Binary;
use super::upright::Upright;

/// What vertices look like.
#[derive(Clone, Debug, Default)]
pub struct Shading {
    /// Of length 1, one a vertex.
    pub normals: Vec<[f32; 3]>,
    /// Red, green and blue as screens show them (sRGB), one a vertex, if the file has a ramp.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Whether PLY and OBJ get the normals, too. GLB always has them.
    pub has_normals_everywhere: bool,
}

/// Red, green, blue and opacity in linear light as glTF has them, in 65,535ths.
pub fn linear(colour: [u8; 3]) -> [u16; 4] {
    let [red, green, blue] = colour.map(|x| (linear_from_srgb(f32::from(x) / 255.0) * 65535.0).round() as u16);
    [red, green, blue, u16::MAX]
}

/// Writes a mesh, with as much of its shading as the format has room for.
///
/// # Errors
/// As [`write_mesh_with_normals`].
pub fn write_shaded_mesh(
    out: impl Write,
    format: MeshFormat,
    (positions, triangles): (&[[f64; 3]], &[[u32; 3]]),
    shading: &Shading,
    upright: Upright,
) -> io::Result<()> {
    match (format, &shading.colours) {
        (MeshFormat::Glb, _) => write_glb(out, (positions, triangles), shading, upright),
        (MeshFormat::Ply, Some(colours)) => {
            let mut out = BufWriter::with_capacity(1 << 20, out);
            let columns = if shading.has_normals_everywhere { normal_columns(&shading.normals) } else { vec![] };
            write_ply(&mut out, positions, triangles, colours, &columns)?;
            out.flush()
        }
        _ => {
            let fans = || Fans { normals: shading.normals.clone(), triangles: triangles.to_vec(), vertices: vec![] };
            write_mesh_with_normals(
                out,
                format,
                (positions, triangles),
                shading.has_normals_everywhere.then(fans).as_ref(),
                upright,
            )
        }
    }
}

fn write_glb(
    out: impl Write,
    (positions, triangles): (&[[f64; 3]], &[[u32; 3]]),
    shading: &Shading,
    upright: Upright,
) -> io::Result<()> {
    const VERTICES: Option<u32> = Some(34962);
    let centre = super::export::glb_origin(positions);
    let local = |p: &[f64; 3]| [0, 1, 2].map(|k| (p[k] - centre[k]) as f32);
    let [low, high] = if positions.is_empty() { [[0.0; 3]; 2] } else { super::export::bounds(positions) };
    let (mut binary, count) = (Binary::default(), positions.len());
    let places = binary.add(positions.iter().flat_map(local).flat_map(f32::to_le_bytes), VERTICES);
    let normals = binary.add(shading.normals.iter().flatten().copied().flat_map(f32::to_le_bytes), VERTICES);
    let mut accessors = vec![
        json!({"bufferView": places, "componentType": 5126, "count": count, "type": "VEC3", "min": local(&low), "max": local(&high)}),
        json!({"bufferView": normals, "componentType": 5126, "count": count, "type": "VEC3"}),
    ];
    let mut attributes = json!({"POSITION": 0, "NORMAL": 1});
    if let Some(colours) = &shading.colours {
        let words = colours.iter().flat_map(|&colour| linear(colour));
        let view = binary.add(words.flat_map(u16::to_le_bytes), VERTICES);
        attributes["COLOR_0"] = accessors.len().into();
        accessors.push(
            json!({"bufferView": view, "componentType": 5123, "normalized": true, "count": count, "type": "VEC4"}),
        );
    }
    let indices = binary.add(triangles.iter().flatten().flat_map(|vertex| vertex.to_le_bytes()), Some(34963));
    accessors
        .push(json!({"bufferView": indices, "componentType": 5125, "count": 3 * triangles.len(), "type": "SCALAR"}));
    let document = json!({
        "asset": {"version": "2.0", "generator": "lodpack"},
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [upright.node(0, centre)],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": accessors.len() - 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "buffers": [{"byteLength": binary.bytes.len()}],
        "bufferViews": binary.views,
        "accessors": accessors,
    });
    super::export::write_glb_chunks(out, &document, &binary.bytes)
}
