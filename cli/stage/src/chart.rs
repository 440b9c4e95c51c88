//! One chart as a mesh of its own, with its border as the arcs describe it. Embed, sample and simplify all work on it.

use glam::DVec3;

/// The level of a border vertex that is a sample of its arc at no level.
pub const NEVER: u8 = u8::MAX;

/// The level of a border vertex that no neighbour needs: simplification keeps or removes it, whichever costs less.
pub const FREE: u8 = NEVER - 1;

/// A border vertex of a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BorderVertex {
    /// Chart-local vertex.
    pub vertex: u32,
    /// Index of the half-arc in its loop.
    pub side: u32,
    /// Position along that side in the direction of the loop: 0 at the side's first corner, always below 1. For a
    /// sample it is exactly a dyadic fraction k / 2^j; between samples it grows strictly.
    pub param: f64,
    /// The coarsest level at which this vertex is a sample of its arc (0 for corners), or [`NEVER`], or [`FREE`]. A
    /// vertex of level m belongs to the border at every level l >= m. Samples are nested dyadically: if k / 2^j (k odd)
    /// has level m, then the ends of its interval, (k - 1) / 2^j and (k + 1) / 2^j, have levels <= m.
    pub level: u8,
}

/// A chart cut out of the mesh. Where the chart touches a mesh vertex in two separate fans, that vertex becomes two
/// local ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartMesh {
    /// Vertex positions, in input units relative to a file-wide origin.
    pub positions: Vec<DVec3>,
    /// Chart-local vertex indices, counter-clockwise seen from outside. The triangles are manifold and wound
    /// consistently.
    pub triangles: Vec<[u32; 3]>,
    /// Border loops in the winding of the triangles, each starting at a corner; empty for a closed chart. Any topology
    /// is possible (holes, handles); a disk has exactly one loop and Euler characteristic 1.
    pub loops: Vec<Vec<BorderVertex>>,
}

impl ChartMesh {
    /// Lets go of the border, where nobody needs it.
    pub fn free_border(&mut self) {
        self.loops.iter_mut().flatten().for_each(|border| border.level = FREE);
    }
}
