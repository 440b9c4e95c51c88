//! Cuts charts: opens rings, that is, charts with two long borders, and halves charts that are too large.

use super::dual_graph::DualGraph;
use super::geometry::Normaliser;
use super::{compact_labels, label_sizes, triangles_by_label};
use crate::arcs::cut_edges::CutEdges;
use lodpack_mesh::{Adjacency, Mesh};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// A loop shorter than this share of the chart's longest is a small hole, which stays.
const LONG_LOOP: f64 = 1.0 / 6.0;

/// Splits charts whose second longest border loop is longer than a sixth of the longest into strips from loop to loop,
/// unless that would leave slivers (under an eighth of `target`, or nowhere eight triangles wide). Labels must be
/// `0..n`, each connected.
pub(super) fn open_rings(mesh: &Mesh, adjacency: &Adjacency, normaliser: &Normaliser, target: u32, labels: &mut [u32]) {
    let count = labels.par_iter().max().map_or(0, |&l| l + 1);
    let mut longest = vec![[0.0f64; 2]; count as usize];
    let cut = CutEdges::new(adjacency, labels);
    cut.for_each_loop(|around| {
        let of_chart = &mut longest[labels[cut.half_edges[around[0] as usize] as usize / 3] as usize];
        let length = around.iter().map(|&i| normaliser.edge_length(mesh, cut.half_edges[i as usize])).sum();
        if length > of_chart[0] {
            *of_chart = [length, of_chart[0]];
        } else if length > of_chart[1] {
            of_chart[1] = length;
        }
    });
    let rings: Vec<u32> = (0..count).filter(|&l| longest[l as usize][1] > LONG_LOOP * longest[l as usize][0]).collect();
    split_charts(labels, count, &rings, |triangles| {
        let graph = DualGraph::new(adjacency, triangles);
        let loops = graph.loops(mesh, normaliser);
        let halves = match &loops[..] {
            [first, second, ..] if second.length > LONG_LOOP * first.length => graph.halve_ring(first, second),
            _ => None,
        };
        match halves {
            Some(halves) if halves.iter().all(|half| half.len() * 8 >= target as usize) => Ok(halves),
            _ => Err(graph.triangles),
        }
    });
}

/// Halves charts of more than twice `target` triangles until none is left. Labels must be `0..n`, each connected.
pub(super) fn halve_large(adjacency: &Adjacency, target: u32, labels: &mut [u32]) {
    let count = labels.par_iter().max().map_or(0, |&l| l + 1);
    let sizes = label_sizes(labels, count);
    let limit = 2 * target as usize;
    let large: Vec<u32> = (0..count).filter(|&l| sizes[l as usize] as usize > limit).collect();
    split_charts(labels, count, &large, |triangles| {
        if triangles.len() <= limit {
            return Err(triangles);
        }
        Ok(DualGraph::new(adjacency, triangles).halve())
    });
}

/// Halves charts of triangles that weigh more than `most` together, until none is left but single triangles. Labels
/// must be `0..n`, each connected; they are renumbered by their smallest triangle.
pub fn halve_heavy(adjacency: &Adjacency, weights: &[f64], most: f64, labels: &mut [u32]) {
    let count = labels.par_iter().max().map_or(0, |&l| l + 1);
    let mut sums = vec![0.0; count as usize];
    labels.iter().zip(weights).for_each(|(&label, weight)| sums[label as usize] += weight);
    let heavy: Vec<u32> = (0..count).filter(|&label| sums[label as usize] > most).collect();
    split_charts(labels, count, &heavy, |triangles| {
        let weight: f64 = triangles.iter().map(|&triangle| weights[triangle as usize]).sum();
        if triangles.len() < 2 || weight <= most {
            return Err(triangles);
        }
        Ok(DualGraph::new(adjacency, triangles).halve())
    });
    compact_labels(labels);
}

/// Splits each of `charts` as long as `halve` finds a way, all charts in parallel. The first fragment keeps the label;
/// the others get new labels from `count` on, in order.
fn split_charts(
    labels: &mut [u32],
    count: u32,
    charts: &[u32],
    halve: impl Fn(Vec<u32>) -> Result<[Vec<u32>; 2], Vec<u32>> + Sync,
) {
    if charts.is_empty() {
        return;
    }
    let (start, list) = triangles_by_label(labels, count);
    let of_all = trace::parallel("charts");
    let fragments: Vec<Vec<Vec<u32>>> = charts
        .par_iter()
        .map(|&l| {
            let _pass = trace::pass("split");
            let mut open = vec![list[start[l as usize] as usize..start[l as usize + 1] as usize].to_vec()];
            let mut done = Vec::new();
            while let Some(triangles) = open.pop() {
                match halve(triangles) {
                    Ok(halves) => open.extend(halves),
                    Err(triangles) => done.push(triangles),
                }
            }
            done
        })
        .collect();
    drop(of_all);
    for (label, fragment) in (count..).zip(fragments.iter().flat_map(|of_chart| &of_chart[1..])) {
        for &t in fragment {
            labels[t as usize] = label;
        }
    }
}
