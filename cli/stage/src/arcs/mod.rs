//! Charts and the arcs between them: arcs carry the borders, roots fill what lies between (format-spec/SPEC.md 1.4).
//!
//! [`trace_arcs`] makes an [`Atlas`] from one label per triangle; [`cut_chart`] cuts one chart out of the mesh. Later
//! stages may assume that every cut edge lies on exactly one arc; that no arc ends where it begins; that every loop has
//! at least three half-arcs where it has as many edges; that halving reaches every vertex of an arc that is not a seam;
//! and that all ids depend on the input alone.

mod bends;
mod cut_chart;
pub mod cut_edges;
pub(crate) mod halving;
mod seams;
mod trace;

pub use bends::closest_on_segment;
pub use cut_chart::{LocalChart, LoopVertex, cut_chart};
pub use halving::ARC_UNITS;
pub use seams::{SeamCorner, SeamStart, Seams};
pub use trace::{trace_arcs, trace_arcs_to_bends};

/// A chain of mesh edges between two corners. It separates two charts, or a chart from the outside of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// Corner ids (indices into [`Atlas::corners`]) of both ends. They differ, because loops get extra corners.
    pub ends: [u32; 2],
    /// Mesh vertices along the arc, both ends included: at least two.
    pub path: Vec<u32>,
    /// The chart left of the path, along whose winding the path runs, and the chart right of it. The second is
    /// [`lodpack_mesh::NONE`] on the mesh boundary; on a seam one of the two is.
    pub charts: [u32; 2],
    /// Number of the seam between two regions, if the arc is one.
    pub seam: Option<u32>,
}

/// An arc as one of its charts sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HalfArc {
    /// Index into [`Atlas::arcs`].
    pub arc: u32,
    /// True if the chart's winding runs from the arc's second end to its first.
    pub reversed: bool,
}

/// A connected set of triangles, with the loops of half-arcs around it in the winding of its triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Mesh triangles, ascending.
    pub triangles: Vec<u32>,
    /// Border loops, the longest first, each of at least three half-arcs. A closed component has none.
    pub loops: Vec<Vec<HalfArc>>,
}

/// All charts, and the arcs and corners at which they meet.
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
    /// The chart on the other side; [`lodpack_mesh::NONE`] on the mesh boundary.
    pub fn neighbour(self, atlas: &Atlas) -> u32 {
        atlas.arcs[self.arc as usize].charts[usize::from(!self.reversed)]
    }

    /// Corner ids (indices into [`Atlas::corners`]): where the half-arc starts and where it ends.
    pub fn ends(self, atlas: &Atlas) -> [u32; 2] {
        let [a, b] = atlas.arcs[self.arc as usize].ends;
        if self.reversed { [b, a] } else { [a, b] }
    }

    /// Indices into the arc's path in the order of the half-arc, both ends included.
    pub fn path_indices(self, atlas: &Atlas) -> impl Iterator<Item = u32> + use<> {
        let last = atlas.arcs[self.arc as usize].edge_count() as u32;
        (0..=last).map(move |i| if self.reversed { last - i } else { i })
    }
}

#[cfg(test)]
pub(crate) mod tests;
