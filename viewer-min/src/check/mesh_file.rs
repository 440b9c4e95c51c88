//! The mesh that a file was made from, PLY or OBJ: positions and faces alone.

use std::{io::BufReader, path::Path};

use anyhow::{Context, Result, bail};
use ply_rs_bw::{
    parser::Parser,
    ply::{Property, PropertyAccess, PropertyAccessResult},
};

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
    let read = match () {
        () if is("ply") => read_ply,
        () if is("obj") => read_obj,
        () => bail!("{}: only PLY and OBJ are compared with", path.display()),
    };
    let mesh = read(path).with_context(|| path.display().to_string())?;
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

fn read_ply(path: &Path) -> Result<InputMesh> {
    let mut payload = Parser::<Element>::new().read_ply(&mut BufReader::new(std::fs::File::open(path)?))?.payload;
    let mut elements = |name: &str| payload.swap_remove(name).unwrap_or_default();
    let positions = elements("vertex").iter().map(|vertex| vertex.position).collect();
    let fan = |face: Element| (2..face.corners.len()).map(move |k| [0, k - 1, k].map(|corner| face.corners[corner]));
    Ok(InputMesh { positions, triangles: elements("face").into_iter().flat_map(fan).collect() })
}
