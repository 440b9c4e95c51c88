//! How large regions are, so that lengths can be derived from all of them.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::mesh::Mesh;

/// Size of the repaired input, as sums over its regions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extent {
    /// Smallest and largest coordinates.
    pub bounds: [DVec3; 2],
    /// Triangles.
    pub triangles: u64,
    /// Vertices; those of seams count in each region.
    pub vertices: u64,
    /// Sum over the sides of all triangles.
    pub edge_lengths: f64,
    /// Area.
    pub area: f64,
}

impl Extent {
    /// The size of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let area = |t: u32| {
            let [a, b, c] = mesh.corners(t);
            (b - a).cross(c - a).length() * 0.5
        };
        Self {
            bounds: mesh.bounds(),
            triangles: mesh.triangles.len() as u64,
            vertices: mesh.positions.len() as u64,
            edge_lengths: mesh.edge_lengths(),
            area: (0..mesh.triangles.len() as u32).map(area).sum(),
        }
    }

    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        let ([low, high], [other_low, other_high]) = (self.bounds, other.bounds);
        Self {
            bounds: [low.min(other_low), high.max(other_high)],
            triangles: self.triangles + other.triangles,
            vertices: self.vertices + other.vertices,
            edge_lengths: self.edge_lengths + other.edge_lengths,
            area: self.area + other.area,
        }
    }

    /// Mean length of the triangles' edges, each side of each triangle counted once.
    pub fn mean_edge_length(&self) -> f64 {
        self.edge_lengths / (3 * self.triangles).max(1) as f64
    }
}
