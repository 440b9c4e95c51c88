//! The mesh that a file was made from: binary or ASCII PLY, and OBJ; positions and faces alone.

use std::{io::BufRead, path::Path};

use anyhow::{Context, Result, bail};

/// Triangles in double precision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InputMesh {
    /// World positions.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices; all exist.
    pub triangles: Vec<[u32; 3]>,
}

/// Reads a mesh by its ending.
///
/// # Errors
/// Where it cannot be read.
pub fn read_mesh(path: &Path) -> Result<InputMesh> {
    let is = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let mesh = if is("ply") {
        read_ply(&std::fs::read(path).with_context(|| path.display().to_string())?)
    } else if is("obj") {
        read_obj(path)
    } else {
        bail!("{}: only PLY and OBJ are compared with", path.display());
    };
    let mesh = mesh.with_context(|| path.display().to_string())?;
    let count = mesh.positions.len() as u32;
    if mesh.triangles.iter().flatten().any(|&vertex| vertex >= count) {
        bail!("{}: a face has a vertex that does not exist", path.display());
    }
    Ok(mesh)
}

fn read_obj(path: &Path) -> Result<InputMesh> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(path, &options)?;
    let mut mesh = InputMesh::default();
    for model in models {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(model.mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        mesh.triangles.extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|i| i + first)));
    }
    Ok(mesh)
}

/// A property: its type and name; for a list the type of its count too.
struct Property {
    count: Option<String>,
    kind: String,
    name: String,
}

/// Numbers one after the other, in any of the three encodings.
enum Numbers<'b> {
    Ascii(std::str::SplitAsciiWhitespace<'b>),
    Binary { bytes: &'b [u8], big_endian: bool },
}

impl Numbers<'_> {
    fn next(&mut self, kind: &str) -> Result<f64> {
        const ENDS: &str = "the file ends too early";
        match self {
            Self::Ascii(words) => Ok(words.next().context(ENDS)?.parse()?),
            Self::Binary { bytes, big_endian } => {
                let size = match kind {
                    "char" | "uchar" | "int8" | "uint8" => 1,
                    "short" | "ushort" | "int16" | "uint16" => 2,
                    "int" | "uint" | "int32" | "uint32" | "float" | "float32" => 4,
                    "double" | "float64" => 8,
                    _ => bail!("unknown type {kind}"),
                };
                let (number, rest) = bytes.split_at_checked(size).context(ENDS)?;
                *bytes = rest;
                let mut raw = [0; 8];
                for (k, byte) in number.iter().enumerate() {
                    raw[if *big_endian { size - 1 - k } else { k }] = *byte;
                }
                let word = u64::from_le_bytes(raw);
                Ok(match kind {
                    "char" | "int8" => f64::from(word as i8),
                    "short" | "int16" => f64::from(word as i16),
                    "int" | "int32" => f64::from(word as i32),
                    "float" | "float32" => f64::from(f32::from_bits(word as u32)),
                    "double" | "float64" => f64::from_bits(word),
                    _ => word as f64,
                })
            }
        }
    }
}

fn read_ply(bytes: &[u8]) -> Result<InputMesh> {
    let mut reader = bytes;
    let (mut elements, mut format): (Vec<(String, usize, Vec<Property>)>, _) = (Vec::new(), String::new());
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line).context("the header is no text")? == 0 {
            bail!("the header does not end");
        }
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let last = elements.last_mut();
        match (words.as_slice(), last) {
            (["end_header"], _) => break,
            (["format", name, ..], _) => format = (*name).to_string(),
            (["element", name, count], _) => elements.push(((*name).to_string(), count.parse()?, Vec::new())),
            (["property", "list", count, kind, name], Some((_, _, properties))) => properties.push(Property {
                count: Some((*count).to_string()),
                kind: (*kind).to_string(),
                name: (*name).to_string(),
            }),
            (["property", kind, name], Some((_, _, properties))) => {
                properties.push(Property { count: None, kind: (*kind).to_string(), name: (*name).to_string() });
            }
            _ => (),
        }
    }
    let mut numbers = match format.as_str() {
        "ascii" => Numbers::Ascii(std::str::from_utf8(reader).context("the body is no text")?.split_ascii_whitespace()),
        "binary_little_endian" => Numbers::Binary { bytes: reader, big_endian: false },
        "binary_big_endian" => Numbers::Binary { bytes: reader, big_endian: true },
        other => bail!("unknown format {other}"),
    };
    let mut mesh = InputMesh::default();
    for (element, count, properties) in &elements {
        for _ in 0..*count {
            let mut position = [f64::NAN; 3];
            for property in properties {
                let Some(count) = &property.count else {
                    let value = numbers.next(&property.kind)?;
                    if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == property.name) {
                        position[axis] = value;
                    }
                    continue;
                };
                let length = numbers.next(count)? as usize;
                let mut corners = Vec::new();
                for _ in 0..length {
                    corners.push(numbers.next(&property.kind)? as u32);
                }
                if element == "face" && property.name.starts_with("vertex_ind") {
                    mesh.triangles.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
                }
            }
            if element == "vertex" {
                mesh.positions.push(position);
            }
        }
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ascii_and_binary_say_the_same() {
        let head = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            )
        };
        let ascii = head("ascii") + "0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n4 0 1 2 3\n";
        let mut binary = head("binary_big_endian").into_bytes();
        for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]] {
            binary.extend((x as f32).to_be_bytes());
            binary.extend(f64::to_be_bytes(y));
            binary.extend((z as f32).to_be_bytes());
        }
        binary.push(4);
        (0..4_i32).for_each(|k| binary.extend(k.to_be_bytes()));
        let mesh = read_ply(ascii.as_bytes()).unwrap();
        assert_eq!(mesh, read_ply(&binary).unwrap());
        assert_eq!((mesh.positions[3], &mesh.triangles[..]), ([0.0, 1.0, 0.5], &[[0, 1, 2], [0, 2, 3]][..]));
        assert!(read_ply(&binary[..binary.len() - 1]).is_err() && read_ply(b"ply\n").is_err());
    }
}
