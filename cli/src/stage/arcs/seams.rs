//! What charts of one region have to respect so that they fit those of others.

use serde::{Deserialize, Serialize};

/// The seams of a region: the parts of its mesh's boundary that are arcs shared with other regions. Empty where the mesh is
/// all there is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seams {
    /// Mesh vertices that are corners of seams, ascending.
    pub corners: Vec<SeamCorner>,
    /// Half-edges that lie on seams, ascending.
    pub half_edges: Vec<u32>,
    /// Where each seam begins, ascending.
    pub starts: Vec<SeamStart>,
}

/// A corner of seams for a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SeamCorner {
    /// The mesh's vertex.
    pub vertex: u32,
    /// Number among all corners of seams.
    pub number: u32,
    /// Whether no region with a smaller number has it.
    pub is_first: bool,
}

/// Where a seam begins for a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SeamStart {
    /// First half-edge in the direction of the region's boundary.
    pub half_edge: u32,
    /// Number among all seams.
    pub seam: u32,
    /// Whether the boundary runs from the seam's end to its start; for the region with the larger number it does.
    pub reversed: bool,
}

impl Seams {
    /// Whether a half-edge of the boundary lies on a seam.
    pub fn contains(&self, half_edge: u32) -> bool {
        self.half_edges.binary_search(&half_edge).is_ok()
    }

    /// The seam that begins with a half-edge of the boundary.
    pub fn starting(&self, half_edge: u32) -> Option<SeamStart> {
        let found = self.starts.binary_search_by_key(&half_edge, |start| start.half_edge).ok()?;
        Some(self.starts[found])
    }

    /// The corner of seams that a vertex is.
    pub fn corner(&self, vertex: u32) -> Option<SeamCorner> {
        let found = self.corners.binary_search_by_key(&vertex, |corner| corner.vertex).ok()?;
        Some(self.corners[found])
    }
}
