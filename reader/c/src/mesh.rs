//! Decoding, and copies into the caller's memory.
#![expect(unsafe_code, reason = "the names are C's")]

use crate::{
    file::File,
    pointer::{borrow, copy_rows, give, release, write},
    query::Cut,
    status::{Failure, Status, guard},
};

/// The triangles of a cut.
pub struct Mesh(lodpack::Mesh);

/// Reads, decodes and joins the triangles of a cut of this file. The mesh is watertight where the whole surface is.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_decode(file: *const File, cut: *const Cut, mesh: *mut *mut Mesh) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let File { file, name } = borrow(file, "file")?;
        let Cut(cut) = borrow(cut, "cut")?;
        give(mesh, Mesh(file.extract(cut).map_err(|error| Failure::from(error).of(name))?))
    })
}

/// Decodes the overview: one small mesh of everything, which came with opening. Without an overview the mesh is a null pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_decode_overview(file: *const File, mesh: *mut *mut Mesh) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let File { file, name } = borrow(file, "file")?;
        match file.overview().map_err(|error| Failure::from(error).of(name))? {
            Some(overview) => give(mesh, Mesh(overview.mesh(&file.lattice()))),
            None => Ok(()),
        }
    })
}

/// Number of vertices; 0 for a null pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_vertex_count(mesh: *const Mesh) -> usize {
    borrow(mesh, "mesh").map_or(0, |mesh| mesh.0.positions.len())
}

/// Number of triangles; 0 for a null pointer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_triangle_count(mesh: *const Mesh) -> usize {
    borrow(mesh, "mesh").map_or(0, |mesh| mesh.0.triangles.len())
}

/// Copies the vertices' positions to `positions`, which has room for `capacity` vertices, `stride_bytes` from one to the next (0 for no
/// gaps; what lies between stays as it is).
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_positions(
    mesh: *const Mesh,
    positions: *mut f64,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| copy_rows(borrow(mesh, "mesh")?.0.positions.iter().copied(), positions, capacity, stride_bytes))
}

/// As lodpack_copy_positions(), in single precision relative to `origin`: three coordinates near the mesh, such as the middle of its
/// file's bounds, without which coordinates far from zero lose digits. A null pointer is the origin of coordinates.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_positions_float(
    mesh: *const Mesh,
    origin: *const f64,
    positions: *mut f32,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| {
        let mesh = &borrow(mesh, "mesh")?.0;
        let origin = if origin.is_null() { [0.0; 3] } else { *borrow(origin.cast::<[f64; 3]>(), "origin")? };
        let near = mesh.positions.iter().map(|point| [0, 1, 2].map(|axis| (point[axis] - origin[axis]) as f32));
        copy_rows(near, positions, capacity, stride_bytes)
    })
}

/// Copies three vertex numbers for each triangle to `indices`, which has room for `capacity` triangles: counter-clockwise seen from
/// outside.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_triangles(mesh: *const Mesh, indices: *mut u32, capacity: usize) -> Status {
    guard(|| copy_rows(borrow(mesh, "mesh")?.0.triangles.iter().copied(), indices, capacity, 0))
}

/// Frees a mesh.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_free_mesh(mesh: *mut Mesh) {
    release(mesh);
}
