//! The mesh from which a file was built, as PLY: positions and faces only.

use std::{io::BufReader, path::Path};

use anyhow::{Context, Result, bail};
use lodpack::Mesh;
use ply_rs_bw::{
    parser::Parser,
    ply::{Property, PropertyAccess, PropertyAccessResult},
};

/// A vertex or a face.
struct Element {
    position: [f64; 3],
    corners: Vec<u32>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self { position: [f64::NAN; 3], corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
            let single = || value.to_f32_lossy().map_or(f64::NAN, f64::from);
            self.position[axis] = if let Property::Double(value) = value { value } else { single() };
        } else if name.starts_with("vertex_ind") {
            let Some(corners) = value.to_u32_list() else { return PropertyAccessResult::UnsupportedType };
            self.corners = corners;
        }
        PropertyAccessResult::Set
    }
}

/// Reads a PLY file.
pub fn read_mesh(path: &Path) -> Result<Mesh> {
    let read = || Parser::<Element>::new().read_ply(&mut BufReader::new(std::fs::File::open(path)?));
    let mut payload = read().with_context(|| format!("{} cannot be read as PLY", path.display()))?.payload;
    let mut elements = |name: &str| payload.swap_remove(name).unwrap_or_default();
    let positions: Vec<[f64; 3]> = elements("vertex").iter().map(|vertex| vertex.position).collect();
    let fan = |face: Element| (2..face.corners.len()).map(move |k| [0, k - 1, k].map(|corner| face.corners[corner]));
    let triangles: Vec<[u32; 3]> = elements("face").into_iter().flat_map(fan).collect();
    if triangles.iter().flatten().any(|&vertex| vertex as usize >= positions.len()) {
        bail!("{}: a face has a vertex that does not exist", path.display());
    }
    Ok(Mesh { positions, triangles, ..Mesh::default() })
}
