//! The ground that a mesh stands on: what it is read from, and where it is in the space of the mesh.

use crate::{array::Array, source::Source};
use lodpack::{
    File, GroundFrame, ReadAt,
    source::{Counting, Request},
};
use pyo3::{pyclass, pymethods};
use std::{io, sync::Arc};

/// A ground is read through the open file of its mesh, whose counters count that, too.
pub struct OfFile(pub Arc<File<Counting<Source>>>);

impl ReadAt for OfFile {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.0.source().read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        self.0.source().size()
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        self.0.source().read_ranges(requests)
    }
}

/// Takes coordinates of a ground to those of its mesh.
#[pyclass(frozen, name = "GroundFrame", module = "lodpack._lodpack")]
pub struct NativeFrame(pub GroundFrame);

#[pymethods]
impl NativeFrame {
    /// Units of the mesh in a unit of the ground.
    #[getter]
    fn scale(&self) -> f64 {
        self.0.scale()
    }

    /// The matrix that does so, of four rows and columns.
    fn transform(&self) -> Array {
        let [x, y, z] = self.0.surface_from_ground();
        Array::shaped([x, y, z, [0.0, 0.0, 0.0, 1.0]].concat(), &[4, 4])
    }

    /// The box of a map below a box in the space of the mesh, which may be endless.
    fn map_box(&self, bbox: [[f64; 3]; 2]) -> [[f64; 2]; 2] {
        self.0.bounds_of_ground(bbox).map(|[x, y, _]| [x, y])
    }
}
