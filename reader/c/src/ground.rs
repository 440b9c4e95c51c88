//! The ground that a mesh stands on: heights in the same file, and where they are in the space of the mesh.
#![expect(unsafe_code, reason = "the names are C's")]

use std::sync::Arc;

use lodpack::{Ground, Opened, source::Within};

use crate::{
    file::{AnySource, File},
    pointer::{borrow, give, write},
    query::View,
    status::{Status, guard},
};

/// Where a ground is in the space of its mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GroundFrame {
    /// Rows of the matrix that takes positions of the ground to the space of the mesh. The fourth column is what is
    /// added.
    pub mesh_from_ground: [[f64; 4]; 3],
    /// The way back.
    pub ground_from_mesh: [[f64; 4]; 3],
    /// Units of the mesh in a unit of the ground. Errors of the ground grow by it; its tolerances are those of the mesh
    /// divided by it.
    pub scale: f64,
}

/// Opens the ground that a mesh stands on as a file of heights, and writes where it is. Writes a null pointer and no
/// frame if there is none. Reads 16 kB. The ground is closed like any file, and stays open when the file of the mesh is
/// closed.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_ground(file: *const File, ground: *mut *mut File, frame: *mut GroundFrame) -> Status {
    guard(|| {
        write(ground, std::ptr::null_mut(), "ground")?;
        let file = borrow(file, "file")?;
        let Opened::Mesh(mesh) = file.opened() else { return Ok(()) };
        let Some(range) = mesh.index().ground_range() else { return Ok(()) };
        let source: AnySource = Arc::new(Within::new(Arc::clone(mesh.source()), range));
        let found = Ground::within(mesh.index(), source).map_err(|error| file.blame(error))?;
        let placed = GroundFrame {
            mesh_from_ground: found.frame.surface_from_ground(),
            ground_from_mesh: found.frame.ground_from_surface(),
            scale: found.frame.scale(),
        };
        write(frame, placed, "frame")?;
        give(ground, File::new(Opened::Heights(found.heights), format!("the ground of {}", file.name())))
    })
}

/// The camera that shows the ground in the same pixels as a camera shows the mesh, and with the same depths. A stream
/// of the ground is drawn with it.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_view_of_ground(frame: *const GroundFrame, view: *const View, seen: *mut View) -> Status {
    guard(|| {
        let &GroundFrame { ground_from_mesh: rows, scale, .. } = borrow(frame, "frame")?;
        let &view = borrow(view, "view")?;
        let turned = |[x, y, z]: [f64; 3], w: f64| rows.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3] * w);
        // Directions may have any length but zero, and are scaled with the rest.
        let value = View {
            position: turned(view.position, 1.0),
            forward: turned(view.forward, 0.0),
            up: turned(view.up, 0.0),
            near_plane: view.near_plane / scale,
            ..view
        };
        write(seen, value, "seen")
    })
}
