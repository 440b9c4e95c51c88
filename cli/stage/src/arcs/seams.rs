//! Seams: the borders between regions, which the charts on either side must share.

use serde::{Deserialize, Serialize};

/// The seams of one region: the parts of its mesh boundary that are arcs shared with other regions. Empty if one region
/// holds the whole input.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seams {
    /// Mesh vertices that are corners of seams, ascending.
    pub corners: Vec<SeamCorner>,
    /// Half-edges that lie on seams, ascending.
    pub half_edges: Vec<u32>,
    /// Where each seam begins, ascending.
    pub starts: Vec<SeamStart>,
}

/// A corner at which seams meet, as one region sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SeamCorner {
    /// Vertex of the region's mesh.
    pub vertex: u32,
    /// Number among the corners of all seams.
    pub number: u32,
    /// True if no region with a smaller number has this corner.
    pub is_first: bool,
}

/// Where a seam begins, as one region sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SeamStart {
    /// The seam's first half-edge in the direction of the region's boundary.
    pub half_edge: u32,
    /// Number among all seams.
    pub seam: u32,
    /// True if the boundary runs from the seam's end to its start, as it does in the region with the larger number.
    pub reversed: bool,
}

impl Seams {
    /// Whether a boundary half-edge lies on a seam.
    pub fn contains(&self, half_edge: u32) -> bool {
        self.half_edges.binary_search(&half_edge).is_ok()
    }

    /// The seam that begins with a boundary half-edge, if any.
    pub fn starting(&self, half_edge: u32) -> Option<SeamStart> {
        let found = self.starts.binary_search_by_key(&half_edge, |start| start.half_edge).ok()?;
        Some(self.starts[found])
    }

    /// The corner of seams at a vertex, if any.
    pub fn corner(&self, vertex: u32) -> Option<SeamCorner> {
        let found = self.corners.binary_search_by_key(&vertex, |corner| corner.vertex).ok()?;
        Some(self.corners[found])
    }
}
