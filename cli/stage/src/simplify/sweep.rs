//! The first collapses: sweeps over all edges take what costs next to nothing, without a queue.
//!
//! Nine of ten vertices of a scan go, and most of them for an error far below the threshold. Which of these goes first
//! hardly matters; that they go evenly does, and a queue, which takes the cheapest wherever it is, does not see to
//! that. So a sweep takes edges in the order of their numbers, and none beside a vertex that it has merged already: it
//! thins the surface by up to a half everywhere.

use super::collapse::{Candidate, Collapser, STRICT};
use super::early::Merge;

impl Collapser<'_> {
    /// Sweeps over all edges inside several times, collapses those whose mean squared distance is at most the
    /// threshold, and returns what it did. Where nothing may be off, or only a number of triangles ends a level,
    /// nothing is cheap.
    pub fn sweep(&mut self, sweeps: u32, threshold: f64) -> Vec<Merge> {
        let mut merges = vec![];
        if threshold <= 0.0 || threshold == f64::INFINITY {
            return merges;
        }
        let mut merged_by = vec![0; self.positions.len()];
        for sweep in 1..=sweeps {
            let before = self.mesh.triangle_count();
            for edge in 0..self.mesh.edge_count() as u32 {
                let Some(h) = self.mesh.half_edge(edge) else { continue };
                let ends = [self.mesh.origin(h), self.mesh.target(h)];
                if ends.iter().any(|&v| merged_by[v as usize] == sweep || self.mesh.is_border(v)) {
                    continue;
                }
                let Candidate { half_edge, removed, kept, target, mean, .. } = self.to_minimum(h, ends[0], ends[1]);
                if mean <= threshold
                    && self.mesh.triangle_count() > self.min_triangles
                    && self.merge(half_edge, [removed, kept], target, Some(STRICT))
                {
                    merged_by[kept as usize] = sweep;
                    merges.push(Merge { half_edge, removed, target });
                }
            }
            if self.took_few(before) {
                break;
            }
        }
        merges
    }
}
