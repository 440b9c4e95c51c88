//! The half-edges along which labels cut the surface, and their order around each chart.

use lodpack_mesh::{Adjacency, NONE, next_half_edge};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// All half-edges whose other side has a different label, or no triangle.
pub struct CutEdges {
    /// Ascending.
    pub half_edges: Vec<u32>,
    /// For each cut half-edge the index (into `half_edges`) of the next one around the same chart, in the winding of
    /// its triangles.
    pub next: Vec<u32>,
}

impl CutEdges {
    /// Finds the half-edges along which the labels of triangles differ, or the mesh ends.
    pub fn new(adjacency: &Adjacency, labels: &[u32]) -> Self {
        let _all = trace::even("cut edges");
        let half_edges: Vec<u32> =
            (0..adjacency.opposite.len() as u32).into_par_iter().filter(|&h| is_cut(adjacency, labels, h)).collect();
        let next = half_edges
            .par_iter()
            .map(|&h| {
                // Rotate inside the chart around the vertex that `h` runs to.
                let mut following = next_half_edge(h);
                while !is_cut(adjacency, labels, following) {
                    following = next_half_edge(adjacency.opposite[following as usize]);
                }
                index_of(&half_edges, following)
            })
            .collect();
        Self { half_edges, next }
    }

    /// Index of a cut half-edge in `half_edges`.
    pub fn index_of(&self, half_edge: u32) -> u32 {
        index_of(&self.half_edges, half_edge)
    }

    /// Visits the cycles of `next` as lists of indices. Each loop starts at its smallest index, and loops come in the
    /// order of those.
    pub fn for_each_loop(&self, mut visit: impl FnMut(&[u32])) {
        let mut seen = vec![false; self.next.len()];
        let mut around = Vec::new();
        for start in 0..self.next.len() as u32 {
            around.clear();
            let mut i = start;
            while !seen[i as usize] {
                seen[i as usize] = true;
                around.push(i);
                i = self.next[i as usize];
            }
            if !around.is_empty() {
                visit(&around);
            }
        }
    }
}

fn index_of(half_edges: &[u32], half_edge: u32) -> u32 {
    half_edges.partition_point(|&h| h < half_edge) as u32
}

/// Whether the other side of a half-edge has a different label, or no triangle.
pub(super) fn is_cut(adjacency: &Adjacency, labels: &[u32], half_edge: u32) -> bool {
    let opposite = adjacency.opposite[half_edge as usize];
    opposite == NONE || labels[opposite as usize / 3] != labels[half_edge as usize / 3]
}
