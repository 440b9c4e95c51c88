//! Decoding, and copies into the caller's memory.
#![expect(unsafe_code, reason = "the names are C's")]

use std::sync::Arc;

use lodpack::{Opened, heights::HeightsMesh};

use crate::{
    channels::Textured,
    file::File,
    pages::Paged,
    pointer::{borrow, copy_rows, give, release, slice, write},
    query::Cut,
    status::{Failure, Status, guard},
};

/// Triangles: of a cut, of the overview, of a root in a frame.
pub enum Mesh {
    Bare(lodpack::Mesh),
    Heights(Lit),
    Textured(Arc<Textured>),
    Paged(Box<Paged>),
}

/// Triangles of heights.
pub struct Lit {
    pub positions: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// For each vertex, of length 1.
    pub normals: Vec<[f32; 3]>,
    /// For each vertex. Those of frames have none.
    pub heights: Vec<f64>,
    /// For each vertex, if the file has an image over the heights or a ramp.
    pub colours: Option<Vec<[u8; 3]>>,
}

impl Lit {
    fn new(mesh: HeightsMesh, colours: Option<Vec<[u8; 3]>>) -> Self {
        let HeightsMesh { positions, triangles, normals, heights, .. } = mesh;
        let normals = normals.into_iter().map(|normal| normal.map(|x| f32::from(x) / 32767.0)).collect();
        Self { positions, triangles, normals, heights, colours }
    }

    /// Heights have one channel.
    pub fn of_channel(&self, channel: u32) -> Result<&Self, Failure> {
        let missing = || Failure::argument(format!("there is no channel {channel}: heights have channel 0 alone"));
        (channel == 0).then_some(self).ok_or_else(missing)
    }
}

impl Mesh {
    pub fn positions(&self) -> &[[f64; 3]] {
        match self {
            Self::Bare(mesh) => &mesh.positions,
            Self::Heights(lit) => &lit.positions,
            Self::Textured(textured) => &textured.mesh.mesh.positions,
            Self::Paged(paged) => &paged.positions,
        }
    }

    pub fn triangles(&self) -> &[[u32; 3]] {
        match self {
            Self::Bare(mesh) => &mesh.triangles,
            Self::Heights(lit) => &lit.triangles,
            Self::Textured(textured) => &textured.mesh.mesh.triangles,
            Self::Paged(paged) => &paged.triangles,
        }
    }

    /// What it was decoded with.
    pub fn textured(&self) -> Result<&Textured, Failure> {
        match self {
            Self::Textured(textured) => Ok(textured),
            Self::Paged(paged) => paged.textured().ok_or_else(|| {
                Failure::argument("roots of frames have values in pages alone: see lodpack_copy_page_colours()".into())
            }),
            _ => Err(Failure::argument("the mesh has no channels: decode it with lodpack_decode_channels()".into())),
        }
    }

    /// Of a mesh in pages, for each vertex the one that it is in the mesh without.
    pub fn source_vertices(&self) -> Option<impl ExactSizeIterator<Item = usize> + '_> {
        match self {
            Self::Paged(paged) => Some(paged.sources.iter().map(|&vertex| vertex as usize)),
            _ => None,
        }
    }
}

/// Reads, decodes and joins the triangles of a cut of this file, or of one of the same bytes. The mesh is watertight
/// where the whole surface is. Of heights it has normals and colours, too.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_decode(file: *const File, cut: *const Cut, mesh: *mut *mut Mesh) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let file = borrow(file, "file")?;
        match (borrow(cut, "cut")?, file.opened()) {
            (Cut::Mesh(cut), Opened::Mesh(opened)) => {
                give(mesh, Mesh::Bare(opened.extract(cut).map_err(|error| file.blame(error))?))
            }
            (Cut::Heights(cut), Opened::Heights(heights)) => {
                let found = heights.mesh(cut).map_err(|error| file.blame(error))?;
                let colours = heights.colours(cut, &found).map_err(|error| file.blame(error))?;
                give(mesh, Mesh::Heights(Lit::new(found, colours)))
            }
            _ => Err(Failure::other_cut().of(file.name())),
        }
    })
}

/// As lodpack_decode(), with the images of `channel_count` channels, by number. lodpack_copy_colours() and
/// lodpack_copy_values() then tell what the surface carries at vertices, and lodpack_make_pages() makes textures of it.
/// The bytes of other channels are not read.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_decode_channels(
    file: *const File,
    cut: *const Cut,
    channels: *const u32,
    channel_count: usize,
    mesh: *mut *mut Mesh,
) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let file = borrow(file, "file")?;
        let mesh_file = file.mesh()?;
        let (mut numbers, mut infos) = (vec![], vec![]);
        for &channel in slice(channels, channel_count, "channels")? {
            let info = mesh_file.channels().get(channel as usize);
            let missing = || format!("there is no channel {channel}; the file has {}", mesh_file.channels().len());
            infos.push(info.ok_or_else(|| Failure::argument(missing()))?.clone());
            numbers.push(channel as u8);
        }
        let Cut::Mesh(cut) = borrow(cut, "cut")? else {
            return Err(Failure::other_cut().of(file.name()));
        };
        let found = mesh_file.extract_textured(cut, &numbers).map_err(|error| file.blame(error))?;
        give(mesh, Mesh::Textured(Arc::new(Textured { mesh: found, channels: infos })))
    })
}

/// Decodes the overview: one small mesh of everything, which came with opening. Without an overview the mesh is a null
/// pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_decode_overview(file: *const File, mesh: *mut *mut Mesh) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let file = borrow(file, "file")?;
        match file.mesh()?.overview().map_err(|error| file.blame(error))? {
            Some(overview) => give(mesh, Mesh::Bare(overview.mesh(&file.mesh()?.lattice()))),
            None => Ok(()),
        }
    })
}

/// Number of vertices; 0 for a null pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_vertex_count(mesh: *const Mesh) -> usize {
    borrow(mesh, "mesh").map_or(0, |mesh| mesh.positions().len())
}

/// Number of triangles; 0 for a null pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_triangle_count(mesh: *const Mesh) -> usize {
    borrow(mesh, "mesh").map_or(0, |mesh| mesh.triangles().len())
}

/// Copies the vertices' positions to `positions`, which has room for `capacity` vertices, `stride_bytes` from one to
/// the next (0 for no gaps; what lies between stays as it is).
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_positions(
    mesh: *const Mesh,
    positions: *mut f64,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| copy_rows(borrow(mesh, "mesh")?.positions().iter().copied(), positions, capacity, stride_bytes))
}

/// As lodpack_copy_positions(), in single precision relative to `origin`: three coordinates near the mesh, such as the
/// middle of its file's bounds, without which coordinates far from zero lose digits. A null pointer is the origin of
/// coordinates.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_positions_float(
    mesh: *const Mesh,
    origin: *const f64,
    positions: *mut f32,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| {
        let mesh = borrow(mesh, "mesh")?;
        let origin = if origin.is_null() { [0.0; 3] } else { *borrow(origin.cast::<[f64; 3]>(), "origin")? };
        let near = mesh.positions().iter().map(|point| [0, 1, 2].map(|axis| (point[axis] - origin[axis]) as f32));
        copy_rows(near, positions, capacity, stride_bytes)
    })
}

/// Copies three vertex numbers for each triangle to `indices`, which has room for `capacity` triangles:
/// counter-clockwise seen from outside.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_triangles(mesh: *const Mesh, indices: *mut u32, capacity: usize) -> Status {
    guard(|| copy_rows(borrow(mesh, "mesh")?.triangles().iter().copied(), indices, capacity, 0))
}

/// Frees a mesh.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_free_mesh(mesh: *mut Mesh) {
    release(mesh);
}
