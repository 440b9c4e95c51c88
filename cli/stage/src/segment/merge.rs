//! Merges charts that are too small into a neighbour: the one with the longest shared border, unless that would close a
//! ring.

use super::compact_labels;
use super::geometry::Normaliser;
use crate::arcs::cut_edges::CutEdges;
use lodpack_mesh::union_find::find;
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The border that two charts share.
#[derive(Clone, Copy)]
struct SharedBorder {
    /// The other chart, as numbered before any merging; [`NONE`] on the mesh boundary.
    other: u32,
    length: f64,
    /// Number of separate stretches of border. Two disks that share exactly one make a disk; 0 stands for a whole loop.
    /// After merging, an upper bound.
    runs: u32,
}

/// Merges every chart of fewer than a third of `target` triangles into a neighbour, if it has one. Labels must be
/// `0..count`, each connected; they are renumbered by their smallest triangle.
pub(super) fn merge_small(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    target: u32,
    count: u32,
    labels: &mut [u32],
) {
    let mut size = super::label_sizes(labels, count);
    let is_small = |size: u32| u64::from(size) * 3 < u64::from(target);
    if !size.iter().any(|&size| is_small(size)) {
        compact_labels(labels);
        return;
    }
    let mut borders = shared_borders(mesh, adjacency, normaliser, count, labels);
    let mut merged_into: Vec<u32> = (0..count).collect();
    let mut small: BinaryHeap<Reverse<(u32, u32)>> =
        (0..count).filter(|&l| is_small(size[l as usize])).map(|l| Reverse((size[l as usize], l))).collect();
    while let Some(Reverse((old_size, chart))) = small.pop() {
        if merged_into[chart as usize] != chart || size[chart as usize] != old_size {
            continue;
        }
        let own = combine(&borders[chart as usize], chart, &mut merged_into);
        let score = |border: &SharedBorder| {
            let union = u64::from(old_size) + u64::from(size[border.other as usize]);
            // A union that is too large is halved again later, which costs a new border.
            let fits = if union > 2 * u64::from(target) { 0.25 } else { 1.0 };
            // Scraps go where they cost least, but a chart of some size should not close a ring.
            let disk = if border.runs == 1 || u64::from(old_size) * 8 < u64::from(target) { 1.0 } else { 0.25 };
            border.length * fits * disk
        };
        let best = own
            .iter()
            .filter(|border| border.other != NONE)
            .max_by(|a, b| score(a).total_cmp(&score(b)).then(b.other.cmp(&a.other)));
        let Some(other) = best.map(|border| border.other) else { continue };
        merged_into[chart as usize] = other;
        size[other as usize] += old_size;
        borders[chart as usize] = Vec::new();
        borders[other as usize].extend(own);
        if is_small(size[other as usize]) {
            small.push(Reverse((size[other as usize], other)));
        }
    }
    for l in 0..count {
        merged_into[l as usize] = find(&mut merged_into, l);
    }
    labels.par_iter_mut().for_each(|label| *label = merged_into[*label as usize]);
    compact_labels(labels);
}

/// Adds up the borders with what is the same neighbour by now, and drops those that have become inner edges.
fn combine(borders: &[SharedBorder], chart: u32, merged_into: &mut [u32]) -> Vec<SharedBorder> {
    let mut current: Vec<SharedBorder> = borders
        .iter()
        .map(|border| SharedBorder {
            other: if border.other == NONE { NONE } else { find(merged_into, border.other) },
            ..*border
        })
        .filter(|border| border.other != chart)
        .collect();
    // A stable sort, so that lengths are always added in the same order.
    current.sort_by_key(|border| border.other);
    current
        .chunk_by(|a, b| a.other == b.other)
        .map(|same| SharedBorder {
            other: same[0].other,
            length: same.iter().map(|border| border.length).sum(),
            runs: same.iter().map(|border| border.runs).sum(),
        })
        .collect()
}

/// The shared borders of each chart.
fn shared_borders(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    count: u32,
    labels: &[u32],
) -> Vec<Vec<SharedBorder>> {
    let cut = CutEdges::new(adjacency, labels);
    let own = |h: u32| labels[h as usize / 3];
    let other = |h: u32| match adjacency.opposite[h as usize] {
        NONE => NONE,
        opposite => labels[opposite as usize / 3],
    };
    let of_all = trace::even("borders");
    let mut cut_edges: Vec<(u32, u32, u32, f64, bool)> = (0..cut.half_edges.len() as u32)
        .into_par_iter()
        .map(|i| {
            let h = cut.half_edges[i as usize];
            let following = cut.half_edges[cut.next[i as usize] as usize];
            // Runs are counted where they end; as many begin.
            (own(h), other(h), i, normaliser.edge_length(mesh, h), other(following) != other(h))
        })
        .collect();
    cut_edges.par_sort_unstable_by_key(|&(own, other, i, ..)| (own, other, i));
    drop(of_all);
    let mut borders = vec![Vec::new(); count as usize];
    for same in cut_edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        borders[same[0].0 as usize].push(SharedBorder {
            other: same[0].1,
            length: same.iter().map(|edge| edge.3).sum(),
            runs: same.iter().filter(|edge| edge.4).count() as u32,
        });
    }
    borders
}
