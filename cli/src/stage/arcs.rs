//! Charts and the arcs between them (DESIGN: "arcs carry the seams, roots fill them").
//!
//! The types are the contract between `segment`, `sample`, `simplify` and `pack`: [`trace_arcs`] makes an [`Atlas`] from labels,
//! [`cut_chart`] cuts one chart out of the mesh.

mod cut_chart;
pub(crate) mod cut_edges;
mod seams;
mod trace;

pub use cut_chart::{LocalChart, LoopVertex, cut_chart};
pub use seams::{SeamCorner, SeamStart, Seams};
pub use trace::trace_arcs;

/// A chain of mesh edges between two corners that separates two charts, or a chart from nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// Corner ids (indices into [`Atlas::corners`]) of both ends; equal only never: loops get extra corners.
    pub ends: [u32; 2],
    /// Mesh vertices along the arc, both ends included, at least two.
    pub path: Vec<u32>,
    /// The chart left of the path (the path runs along that chart's own winding) and the one right of it;
    /// the second is [`crate::mesh::NONE`] on the mesh boundary, one of them on a seam.
    pub charts: [u32; 2],
    /// Number of the seam between regions that the arc is.
    pub seam: Option<u32>,
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

impl Arc {
    /// Mesh edges along the arc, at least one.
    pub fn edge_count(&self) -> usize {
        self.path.len() - 1
    }

    fn reverse(&mut self) {
        self.ends.reverse();
        self.path.reverse();
        self.charts.reverse();
    }
}

impl HalfArc {
    /// The chart on the other side, [`crate::mesh::NONE`] on the mesh boundary.
    pub fn neighbour(self, atlas: &Atlas) -> u32 {
        atlas.arcs[self.arc as usize].charts[usize::from(!self.reversed)]
    }

    /// Corner ids (indices into [`Atlas::corners`]) from and to which the half-arc runs.
    pub fn ends(self, atlas: &Atlas) -> [u32; 2] {
        let [a, b] = atlas.arcs[self.arc as usize].ends;
        if self.reversed { [b, a] } else { [a, b] }
    }

    /// Places in the arc's path in the order of the half-arc, both ends included.
    pub fn path_indices(self, atlas: &Atlas) -> impl Iterator<Item = u32> + use<> {
        let last = atlas.arcs[self.arc as usize].edge_count() as u32;
        (0..=last).map(move |i| if self.reversed { last - i } else { i })
    }
}

#[cfg(test)]
pub(crate) mod tests;
