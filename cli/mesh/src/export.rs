//! Writes triangle meshes: PLY, OBJ, STL and GLB.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use serde_json::json;

use super::smooth::{COMPUTED, Fans};
use super::upright::Upright;

/// The formats that [`write_mesh`] can write, by file name extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary little-endian PLY with double coordinates.
    Ply,
    /// Wavefront OBJ: text with full precision.
    Obj,
    /// Binary STL: single precision, relative to the given origin.
    Stl,
    /// Binary glTF 2.0. Coordinates are relative to a node translation, so that models far from the origin keep their
    /// detail.
    Glb,
}

impl MeshFormat {
    /// The format for a path's extension.
    pub fn from_path(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "obj" => Some(Self::Obj),
            "stl" => Some(Self::Stl),
            "glb" => Some(Self::Glb),
            _ => None,
        }
    }
}

/// How far a format moves a vertex, at most: STL and GLB round to single precision. Infinite if a coordinate is
/// beyond their range.
pub fn rounding(format: MeshFormat, positions: &[[f64; 3]]) -> f64 {
    let origin = match format {
        MeshFormat::Ply | MeshFormat::Obj => return 0.0,
        MeshFormat::Stl => [0.0; 3],
        MeshFormat::Glb => glb_origin(positions),
    };
    rounding_around(origin, positions)
}

/// How far single precision moves a vertex, at most, where coordinates are relative to an origin.
pub(super) fn rounding_around(origin: [f64; 3], positions: &[[f64; 3]]) -> f64 {
    let moved = |p: &[f64; 3]| {
        let off = |k: usize| f64::from((p[k] - origin[k]) as f32) - (p[k] - origin[k]);
        (0..3).map(off).map(|off| off * off).sum::<f64>().sqrt()
    };
    positions.iter().map(moved).fold(0.0, f64::max)
}

/// Writes a mesh in the given format.
///
/// # Errors
///
/// Any error of the writer; [`io::ErrorKind::InvalidInput`] if the format cannot hold that many vertices or such
/// coordinates.
pub fn write_mesh(
    out: impl Write,
    format: MeshFormat,
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
) -> io::Result<()> {
    write_mesh_with_normals(out, format, (positions, triangles), None, Upright::default())
}

/// Writes a mesh, and its normals where the format has room for them. In PLY each vertex must have one; GLB has a
/// vertex for each fan.
///
/// # Errors
/// As [`write_mesh`].
pub fn write_mesh_with_normals(
    out: impl Write,
    format: MeshFormat,
    (positions, triangles): (&[[f64; 3]], &[[u32; 3]]),
    fans: Option<&Fans>,
    upright: Upright,
) -> io::Result<()> {
    if rounding(format, positions) == f64::INFINITY {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "coordinates are beyond the single precision of this format; write PLY or OBJ instead",
        ));
    }
    let mut out = BufWriter::with_capacity(1 << 20, out);
    match format {
        MeshFormat::Ply => {
            let columns = fans.map_or(vec![], |fans| normal_columns(&fans.normals));
            write_ply::<0>(&mut out, positions, triangles, &[], &columns)
        }
        MeshFormat::Obj => write_obj(&mut out, positions, triangles, fans),
        MeshFormat::Stl => write_stl(&mut out, positions, triangles),
        MeshFormat::Glb => write_glb(&mut out, positions, triangles, fans, upright),
    }?;
    out.flush()
}

/// A number of every vertex, as PLY has it.
pub(super) struct Column {
    /// Its name.
    pub name: String,
    /// `float` or `int`.
    pub kind: &'static str,
    /// Little-endian bytes.
    pub values: Vec<[u8; 4]>,
}

/// The normals of vertices, as PLY has them.
pub(super) fn normal_columns(normals: &[[f32; 3]]) -> Vec<Column> {
    let column = |(axis, name): (usize, &str)| Column {
        name: name.into(),
        kind: "float",
        values: normals.iter().map(|normal| normal[axis].to_le_bytes()).collect(),
    };
    ["nx", "ny", "nz"].into_iter().enumerate().map(column).collect()
}

/// Writes binary PLY. Vertices have as many components of colour as there are in `colours`: one entry each, or none at
/// all; and an entry of each column.
pub(super) fn write_ply<const N: usize>(
    out: &mut impl Write,
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    colours: &[[u8; N]],
    columns: &[Column],
) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n",
        positions.len(),
    )?;
    for component in &["red", "green", "blue", "alpha"][..N] {
        writeln!(out, "property uchar {component}")?;
    }
    for Column { name, kind, .. } in columns {
        writeln!(out, "property {kind} {name}")?;
    }
    write!(out, "element face {}\nproperty list uchar uint vertex_indices\nend_header\n", triangles.len())?;
    for (vertex, position) in positions.iter().enumerate() {
        for x in position {
            out.write_all(&x.to_le_bytes())?;
        }
        out.write_all(colours.get(vertex).map_or(&[], |colour| colour.as_slice()))?;
        for column in columns {
            out.write_all(&column.values.get(vertex).copied().unwrap_or_default())?;
        }
    }
    for triangle in triangles {
        out.write_all(&[3])?;
        for vertex in triangle {
            out.write_all(&vertex.to_le_bytes())?;
        }
    }
    Ok(())
}

fn write_obj(
    out: &mut impl Write,
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    fans: Option<&Fans>,
) -> io::Result<()> {
    for [x, y, z] in positions {
        writeln!(out, "v {x} {y} {z}")?;
    }
    for [x, y, z] in fans.into_iter().flat_map(|fans| &fans.normals) {
        writeln!(out, "vn {x} {y} {z}")?;
    }
    let mut normals = fans.into_iter().flat_map(|fans| &fans.triangles);
    for t in triangles {
        let [a, b, c] = t.map(|v| u64::from(v) + 1);
        match normals.next().map(|of_corners| of_corners.map(|n| u64::from(n) + 1)) {
            Some([n, m, o]) => writeln!(out, "f {a}//{n} {b}//{m} {c}//{o}")?,
            None => writeln!(out, "f {a} {b} {c}")?,
        }
    }
    Ok(())
}

fn write_stl(out: &mut impl Write, positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> io::Result<()> {
    let mut header = [0u8; 80];
    header[..7].copy_from_slice(b"lodpack");
    out.write_all(&header)?;
    let count = u32::try_from(triangles.len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "STL holds at most 2^32 - 1 triangles"))?;
    out.write_all(&count.to_le_bytes())?;
    for t in triangles {
        // A zero normal asks readers to derive it from the winding.
        out.write_all(&[0; 12])?;
        for &v in t {
            for c in positions[v as usize] {
                out.write_all(&(c as f32).to_le_bytes())?;
            }
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}

pub(super) fn bounds(positions: &[[f64; 3]]) -> [[f64; 3]; 2] {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in positions {
        for k in 0..3 {
            bounds[0][k] = bounds[0][k].min(p[k]);
            bounds[1][k] = bounds[1][k].max(p[k]);
        }
    }
    bounds
}

/// The origin to which a GLB's coordinates are relative.
pub(super) fn glb_origin(positions: &[[f64; 3]]) -> [f64; 3] {
    let [low, high] = bounds(positions);
    [0, 1, 2].map(|k| if positions.is_empty() { 0.0 } else { 0.5 * (low[k] + high[k]) })
}

/// Writes a GLB from its two chunks.
pub(super) fn write_glb_chunks(out: impl Write, json: &serde_json::Value, binary: &[u8]) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 20, out);
    write_glb_header(&mut out, json, binary.len())?;
    out.write_all(binary)?;
    out.flush()
}

/// Writes everything before the bytes of the binary chunk, whose number is a multiple of four.
fn write_glb_header(out: &mut impl Write, json: &serde_json::Value, binary_bytes: usize) -> io::Result<()> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + binary_bytes;
    let length = |n: usize| {
        u32::try_from(n)
            .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "GLB holds at most 4 GiB; write PLY instead"))
    };
    for word in [0x4654_6C67, 2, length(total)?, length(json.len())?, 0x4E4F_534A] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&json)?;
    for word in [length(binary_bytes)?, 0x004E_4942] {
        out.write_all(&word.to_le_bytes())?;
    }
    Ok(())
}

fn write_glb(
    out: &mut impl Write,
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    fans: Option<&Fans>,
    upright: Upright,
) -> io::Result<()> {
    let (bounds, centre) = (bounds(positions), glb_origin(positions));
    let local = |p: [f64; 3]| [0, 1, 2].map(|k| (p[k] - centre[k]) as f32);
    let count = fans.map_or(positions.len(), |fans| fans.vertices.len());
    let (vertex_bytes, index_bytes) = (count * 12, triangles.len() * 12);
    let (low, high) = match positions.is_empty() {
        true => ([0.0; 3], [0.0; 3]),
        false => (local(bounds[0]), local(bounds[1])),
    };
    let mut attributes = json!({"POSITION": 0});
    let mut views = vec![
        json!({"buffer": 0, "byteOffset": 0, "byteLength": vertex_bytes, "target": 34962}),
        json!({"buffer": 0, "byteOffset": vertex_bytes, "byteLength": index_bytes, "target": 34963}),
    ];
    let mut accessors = vec![
        json!({"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": low, "max": high}),
        json!({"bufferView": 1, "componentType": 5125, "count": triangles.len() * 3, "type": "SCALAR"}),
    ];
    let mut byte_count = vertex_bytes + index_bytes;
    if fans.is_some() {
        attributes["NORMAL"] = 2.into();
        views.push(json!({"buffer": 0, "byteOffset": byte_count, "byteLength": vertex_bytes, "target": 34962}));
        accessors
            .push(json!({"bufferView": 2, "componentType": 5126, "count": count, "type": "VEC3", "name": COMPUTED}));
        byte_count += vertex_bytes;
    }
    let json = json!({
        "asset": {"version": "2.0", "generator": "lodpack"},
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [upright.node(0, centre)],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 1, "material": 0}]}],
        "materials": [super::material::plain()],
        "buffers": [{"byteLength": byte_count}],
        "bufferViews": views,
        "accessors": accessors,
    });
    write_glb_header(out, &json, byte_count)?;
    let mut write = |p: [f32; 3]| p.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()));
    match fans {
        Some(fans) => fans.vertices.iter().try_for_each(|&v| write(local(positions[v as usize])))?,
        None => positions.iter().try_for_each(|&p| write(local(p)))?,
    }
    for v in fans.map_or(triangles, |fans| &fans.triangles).iter().flatten() {
        out.write_all(&v.to_le_bytes())?;
    }
    fans.into_iter().flat_map(|fans| &fans.normals).flatten().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
