//! What a region's charts do at its boundary, which is all that seams have to know of them.

use serde::{Deserialize, Serialize};

use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_stage::arcs::cut_edges::CutEdges;

use super::boundary::RegionBoundary;

/// A loop of a chart, as far as seams depend on it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoopSketch {
    /// Boundary edges on the loop, in its order. After each, the loop goes on with the next one or leaves the boundary.
    pub edges: Vec<u32>,
    /// For each of `edges` whether the loop leaves the boundary after it.
    pub leaves: Vec<bool>,
    /// Corners between edges that are not on the boundary.
    pub inner_corners: u32,
    /// Other vertices between such edges, at which arcs could be divided.
    pub inner_vertices: u32,
}

/// A region's charts at its boundary.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoundarySketch {
    /// For each boundary edge whether its first vertex is a corner because of the region's own charts.
    pub corners: Vec<bool>,
    /// All loops with boundary edges.
    pub loops: Vec<LoopSketch>,
}

impl BoundarySketch {
    /// Follows the loops of a region's charts. `labels` are the charts of its triangles.
    pub fn new(mesh: &Mesh, adjacency: &Adjacency, boundary: &RegionBoundary, labels: &[u32]) -> Self {
        let cut = CutEdges::new(adjacency, labels);
        let origin = |h: u32| mesh.triangles[h as usize / 3][h as usize % 3];
        let mut cut_half_edges = vec![0u8; mesh.positions.len()];
        for &h in &cut.half_edges {
            let count = &mut cut_half_edges[origin(h) as usize];
            *count = count.saturating_add(1);
        }
        // An inner edge has a half-edge that leaves each end, a boundary edge has only one.
        let on_boundary = |h: u32| adjacency.opposite[h as usize] == NONE;
        let is_natural = |v: u32, with_boundary: bool| cut_half_edges[v as usize] != if with_boundary { 1 } else { 2 };
        let corners = boundary.edges.iter().map(|edge| is_natural(edge.vertices[0], true)).collect();

        let mut by_half_edge: Vec<(u32, u32)> =
            boundary.edges.iter().zip(0..).map(|(edge, index)| (edge.half_edge, index)).collect();
        by_half_edge.sort_unstable();
        let index_of =
            |h: u32| by_half_edge.binary_search_by_key(&h, |entry| entry.0).ok().map(|at| by_half_edge[at].1);
        let mut loops = vec![];
        cut.for_each_loop(|places| {
            let half_edges = || places.iter().map(|&place| cut.half_edges[place as usize]);
            if !half_edges().any(on_boundary) {
                return;
            }
            let mut sketch = LoopSketch::default();
            for (h, following) in half_edges().zip(half_edges().cycle().skip(1)) {
                match index_of(h) {
                    Some(index) => {
                        sketch.edges.push(index);
                        sketch.leaves.push(!on_boundary(following));
                    }
                    None if on_boundary(following) => {}
                    None if is_natural(origin(following), false) => sketch.inner_corners += 1,
                    None => sketch.inner_vertices += 1,
                }
            }
            loops.push(sketch);
        });
        Self { corners, loops }
    }
}
