//! Charts and the arcs between them (DESIGN: "arcs carry the seams, roots fill them").
//!
//! Stub: the types are the contract between `segment`, `sample`, `simplify` and `pack`.

use crate::mesh::{Adjacency, Mesh};

/// A chain of mesh edges between two corners that separates two charts, or a chart from nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// Corner ids (indices into [`Atlas::corners`]) of both ends; equal only never: loops get extra corners.
    pub ends: [u32; 2],
    /// Mesh vertices along the arc, both ends included, at least two.
    pub path: Vec<u32>,
    /// The chart left of the path (the path runs along that chart's own winding) and the one right of it;
    /// the second is [`crate::mesh::NONE`] on the mesh boundary.
    pub charts: [u32; 2],
}

/// An arc as one chart sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HalfArc {
    /// Index into [`Atlas::arcs`].
    pub arc: u32,
    /// True when the chart's winding runs from the arc's second end to its first.
    pub reversed: bool,
}

/// A piece of the surface: triangles and the loops of half-arcs around it, each in the winding of its triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Mesh triangles, ascending.
    pub triangles: Vec<u32>,
    /// Boundary loops, each of at least three half-arcs; none for a closed component. The longest loop first.
    pub loops: Vec<Vec<HalfArc>>,
}

/// All charts, who borders whom, and where.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// Mesh vertex of each corner.
    pub corners: Vec<u32>,
    /// All arcs.
    pub arcs: Vec<Arc>,
    /// All charts.
    pub charts: Vec<Chart>,
}

/// Traces the arcs and loops between triangles of different `labels` (one chart id a triangle, all of `0..chart_count` used).
pub fn trace_arcs(_mesh: &Mesh, _adjacency: &Adjacency, _labels: &[u32]) -> Atlas {
    Atlas::default()
}
