//! What every filling decodes to: the triangles of one root at one level.

pub(crate) use crate::lattice::LatticePoint;

/// The triangles of one root at one level of detail.
///
/// Vertices 0..border_count are the border samples, loop after loop in the order of the root's loops, each loop in the
/// winding of the triangles; the interior vertices follow.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Patch {
    /// How many vertices lie on the root's loops.
    pub border_count: u32,
    /// Positions of the interior vertices.
    pub interior: Vec<LatticePoint>,
    /// Vertex indices, below `border_count + interior.len()`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
