//! Edge-connected components of equal label, by union-find: within blocks of triangles in parallel, then across the
//! edges between blocks.

use lodpack_mesh::union_find::unite;
use lodpack_mesh::{Adjacency, NONE};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// Triangles per task. The number is fixed so that nothing depends on the number of threads.
const BLOCK: usize = 1 << 18;

/// Numbers the edge-connected components of equal label by their smallest triangle. Returns the component of each
/// triangle, and the number of components.
pub(super) fn connected_components(adjacency: &Adjacency, labels: &[u32]) -> (Vec<u32>, u32) {
    let mut parent = vec![0u32; labels.len()];
    let of_all = trace::even("blocks");
    let links: Vec<Vec<(u32, u32)>> = parent
        .par_chunks_mut(BLOCK)
        .enumerate()
        .map(|(block, parent)| {
            let first = (block * BLOCK) as u32;
            let mut links = Vec::new();
            for i in 0..parent.len() {
                parent[i] = i as u32;
                let t = first + i as u32;
                for &opposite in &adjacency.opposite[3 * t as usize..3 * t as usize + 3] {
                    let u = opposite / 3;
                    if opposite == NONE || u >= t || labels[u as usize] != labels[t as usize] {
                        continue;
                    }
                    if u >= first {
                        unite(parent, i as u32, u - first);
                    } else {
                        links.push((t, u));
                    }
                }
            }
            for p in parent {
                *p += first;
            }
            links
        })
        .collect();
    drop(of_all);
    for &(t, u) in links.iter().flatten() {
        unite(&mut parent, t, u);
    }
    // A root is the smallest triangle of its component, and every parent is smaller than its child, so one ascending
    // pass resolves all.
    let mut count = 0;
    for t in 0..parent.len() {
        let p = parent[t] as usize;
        parent[t] = if p == t {
            count += 1;
            count - 1
        } else {
            parent[p]
        };
    }
    (parent, count)
}
