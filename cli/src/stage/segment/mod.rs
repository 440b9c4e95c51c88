//! Segment: cuts the surface into charts of about equal triangle count with short, smooth borders.
//!
//! microcharts of some 64 triangles are grouped by Lloyd rounds on their graph (a normal-aware variant of the
//! geodesic centroidal partition that the seeds use), the borders between the groups are found again triangle by triangle,
//! charts that are rings with two long borders are cut open, and threshold dynamics (Merriman, Bence, Osher 1992: diffuse the
//! labels, keep the strongest) shortens the borders and lets them snap to creases.
//!
//! Charts need not be disks: small holes and scan-noise handles stay inside, the irregular filling takes any topology.
//! Everything is measured relative to the size of the mesh and of its triangles, so units do not matter.

mod components;
mod dual_graph;
mod geometry;
mod growth;
mod lloyd;
mod merge;
mod microcharts;
mod smoothing;
mod split;

use crate::mesh::{Adjacency, Mesh};
use geometry::Normaliser;
use rayon::prelude::*;

/// How [`segment_charts`] cuts.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentOptions {
    /// Triangles a chart should have. Charts end up between a third and twice of it, except that a connected component
    /// of at most one and a half times of it stays whole. At least 64. Default 8192: small enough to adapt well,
    /// large enough that borders (a third of the bytes at 8k) do not dominate.
    pub target_triangles: u32,
    /// How much cheaper a border is along a crease of 60 degrees or more than on smooth ground, as a factor minus one.
    /// 0 ignores creases. Default 8.
    pub crease_weight: f64,
    /// How much farther a place counts from a chart whose mean normal is perpendicular to its own, as a factor minus one.
    /// 0 ignores normals. Default 1.
    pub flatness_weight: f64,
    /// Lloyd rounds on the graph of microcharts. Default 8: more changes sizes and shapes by under two per cent.
    pub lloyd_rounds: u32,
    /// Rounds of border smoothing; 0 leaves borders as the growth found them. Default 2:
    /// the first does nine tenths of the work, a third changes lengths by under half a per cent.
    pub smoothing_rounds: u32,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { target_triangles: 8192, crease_weight: 8.0, flatness_weight: 1.0, lloyd_rounds: 8, smoothing_rounds: 2 }
    }
}

/// Labels each triangle with its chart: `0..n`, all used, numbered by their smallest triangle; every chart is connected over edges.
///
/// The result depends on the mesh and the options alone, not on the number of threads.
pub fn segment_charts(mesh: &Mesh, adjacency: &Adjacency, options: &SegmentOptions) -> Vec<u32> {
    let target = options.target_triangles.max(64);
    let one = vec![0; mesh.triangles.len()];
    let (mut labels, component_count) = components::connected_components(adjacency, &one);
    drop(one);
    let sizes = label_sizes(&labels, component_count);
    let whole = |size: u32| u64::from(size) * 2 <= u64::from(target) * 3;
    if sizes.iter().all(|&size| whole(size)) {
        return labels;
    }
    let normaliser = Normaliser::new(mesh);
    // The components that must be cut; whole ones keep their label, which lies below `component_count`.
    let microcharts =
        microcharts::build_microcharts(mesh, adjacency, &normaliser, |t| !whole(sizes[labels[t as usize] as usize]));
    let graph = microcharts::build_graph(adjacency, &microcharts, options);
    let partition = lloyd::partition(&microcharts, &graph, &labels, &sizes, target, options);
    growth::grow_labels(
        mesh,
        adjacency,
        &normaliser,
        &microcharts,
        &graph,
        &partition,
        component_count,
        options,
        &mut labels,
    );
    drop((microcharts, graph));

    regularize(mesh, adjacency, &normaliser, target, &mut labels);
    split::open_rings(mesh, adjacency, &normaliser, target, &mut labels);
    if options.smoothing_rounds > 0 {
        smoothing::smooth_borders(mesh, adjacency, &normaliser, options, &mut labels);
        regularize(mesh, adjacency, &normaliser, target, &mut labels);
    }
    labels
}

/// Makes every label connected, gives charts that are too small to a neighbour and halves those that are too large.
fn regularize(mesh: &Mesh, adjacency: &Adjacency, normaliser: &Normaliser, target: u32, labels: &mut Vec<u32>) {
    let (connected, count) = components::connected_components(adjacency, labels);
    *labels = connected;
    merge::merge_small(mesh, adjacency, normaliser, target, count, labels);
    split::halve_large(adjacency, target, labels);
}

/// Triangles a label.
fn label_sizes(labels: &[u32], count: u32) -> Vec<u32> {
    let mut sizes = vec![0; count as usize];
    for &label in labels {
        sizes[label as usize] += 1;
    }
    sizes
}

/// Renumbers labels by their smallest triangle; returns their count.
fn compact_labels(labels: &mut [u32]) -> u32 {
    const UNSEEN: u32 = u32::MAX;
    let largest = labels.par_iter().copied().max().unwrap_or(0);
    let mut number = vec![UNSEEN; largest as usize + 1];
    let mut count = 0;
    for label in labels {
        let number = &mut number[*label as usize];
        if *number == UNSEEN {
            *number = count;
            count += 1;
        }
        *label = *number;
    }
    count
}

/// Triangles of each label, ascending: `list[start[l]..start[l + 1]]`.
fn triangles_by_label(labels: &[u32], count: u32) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; count as usize + 1];
    for &label in labels {
        start[label as usize + 1] += 1;
    }
    for l in 0..count as usize {
        start[l + 1] += start[l];
    }
    let mut slot = start.clone();
    let mut list = vec![0u32; labels.len()];
    for (t, &label) in labels.iter().enumerate() {
        let s = &mut slot[label as usize];
        list[*s as usize] = t as u32;
        *s += 1;
    }
    (start, list)
}

#[cfg(test)]
mod tests;
