//! The vertices and triangles of an input by their numbers, wherever they are.

use std::ops::Range;
use std::path::PathBuf;

use glam::DVec3;

use lodpack_import::{ImportError, RangedMesh, TRIANGLES_NAME, VERTICES_NAME};
use lodpack_runtime::storage::{Lookup, RecordReader, WorkDirectory, WorkError};

/// An input whose vertices and triangles can be looked up.
#[derive(Debug)]
pub enum NumberedMesh {
    /// In temporary files.
    Files {
        /// The positions.
        vertices: Lookup,
        /// Their file.
        vertex_file: PathBuf,
        /// The file of triangles.
        triangle_file: PathBuf,
        /// The number of triangles.
        triangle_count: u64,
    },
    /// In the input files themselves.
    Ranged(RangedMesh),
}

impl NumberedMesh {
    /// The files that an import has left in a directory. Positions are removed once all regions are repaired.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn in_directory(directory: &WorkDirectory, triangle_count: u64) -> Result<Self, WorkError> {
        let vertex_file = directory.path(VERTICES_NAME);
        let vertices = if vertex_file.exists() { Lookup::open(&vertex_file)? } else { Lookup::empty() };
        Ok(Self::Files { vertices, vertex_file, triangle_file: directory.path(TRIANGLES_NAME), triangle_count })
    }

    /// The number of vertices.
    pub fn vertex_count(&self) -> u64 {
        match self {
            Self::Files { vertices, .. } => vertices.count(),
            Self::Ranged(mesh) => mesh.vertex_count(),
        }
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> u64 {
        match self {
            Self::Files { triangle_count, .. } => *triangle_count,
            Self::Ranged(mesh) => mesh.triangle_count(),
        }
    }

    /// The position of a vertex.
    ///
    /// # Panics
    /// Where temporary files have no such vertex.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        match self {
            Self::Files { vertices, .. } => vertices.position(vertex),
            Self::Ranged(mesh) => mesh.position(vertex),
        }
    }

    /// All positions.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn all_positions(&self) -> Result<Vec<DVec3>, WorkError> {
        match self {
            Self::Files { vertex_file, .. } => RecordReader::open(vertex_file)?.read_all(),
            Self::Ranged(mesh) => Ok((0..mesh.vertex_count() as u32).map(|vertex| mesh.position(vertex)).collect()),
        }
    }

    /// Visits a range of triangles, each by the numbers of its vertices.
    ///
    /// # Errors
    /// If the input is damaged, or a file cannot be read.
    pub fn for_each_triangle(&self, range: Range<u64>, mut visit: impl FnMut([u32; 3])) -> Result<(), ImportError> {
        match self {
            Self::Files { triangle_file, vertices, .. } => {
                let (count, mut is_sound) = (vertices.count(), true);
                RecordReader::<[u32; 3]>::open(triangle_file)?.for_each_of(range, |triangle| {
                    match triangle.iter().all(|&vertex| u64::from(vertex) < count) {
                        true => visit(triangle),
                        false => is_sound = false,
                    }
                })?;
                match is_sound {
                    true => Ok(()),
                    false => Err(WorkError::damaged(triangle_file, lodpack_runtime::storage::DAMAGED).into()),
                }
            }
            Self::Ranged(mesh) => mesh.for_each_triangle(range, visit),
        }
    }
}
