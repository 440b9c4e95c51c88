//! Segment: cuts the surface into charts of about equally many triangles, with short, smooth borders.
//!
//! The algorithm is a Lloyd-style chartification (Sander et al., "Multi-Chart Geometry Images", 2003) that runs on a
//! coarser graph:
//!
//! 1. Lloyd rounds assign microcharts of about 64 triangles to charts, aware of normals.
//! 2. The borders between charts are found again triangle by triangle.
//! 3. Rings, that is, charts with two long borders, are cut open.
//! 4. Threshold dynamics (Merriman, Bence and Osher, 1992: diffuse the labels, keep the strongest) shortens the borders
//!    and lets them snap to creases.
//!
//! Later stages may assume that labels are `0..n`, all used, numbered by their smallest triangle, and that every chart
//! is connected over edges. Charts need not be disks: small holes and handles from scan noise stay inside, because the
//! irregular filling takes any topology. All measures are relative to the size of the mesh and of its triangles, so
//! units do not matter.
//!
//! Where the input is cut into charts already, [`keep_charts`] takes these instead, and cuts what is too large for one.

mod components;
mod dual_graph;
mod geometry;
mod growth;
mod kept;
mod lloyd;
mod merge;
mod microcharts;
mod smoothing;
mod split;

pub use kept::keep_charts;
pub use split::halve_heavy;

use geometry::Normaliser;
use lodpack_mesh::{Adjacency, Mesh};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// Options of [`segment_charts`].
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentOptions {
    /// Triangles that a chart should have, at least 64. Charts end up with a third to twice of that; a connected
    /// component of at most one and a half times of it stays whole. Default 8192: small enough to adapt well, large
    /// enough that borders (a third of the bytes at this size) do not dominate.
    pub target_triangles: u32,
    /// How much cheaper a border is along a crease of 60 degrees or more than on smooth ground, as a factor minus one.
    /// 0 ignores creases. Default 8.
    pub crease_weight: f64,
    /// How much farther a microchart counts from a chart whose mean normal is perpendicular to its own, as a factor
    /// minus one. 0 ignores normals. Default 1.
    pub flatness_weight: f64,
    /// Lloyd rounds on the graph of microcharts. Default 8: more rounds change sizes and shapes by less than two per
    /// cent.
    pub lloyd_rounds: u32,
    /// Rounds of border smoothing; 0 leaves borders as growth left them. Default 2: the first round does nine tenths of
    /// the work, and a third would change lengths by less than half a per cent.
    pub smoothing_rounds: u32,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { target_triangles: 8192, crease_weight: 8.0, flatness_weight: 1.0, lloyd_rounds: 8, smoothing_rounds: 2 }
    }
}

/// Labels each triangle with its chart: `0..n`, all used, numbered by their smallest triangle. Every chart is connected
/// over edges.
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
    let step = trace::step("microcharts");
    let normaliser = Normaliser::new(mesh);
    // Only the components that must be cut. Whole ones keep their label, which is below `component_count`.
    let microcharts =
        microcharts::build_microcharts(mesh, adjacency, &normaliser, |t| !whole(sizes[labels[t as usize] as usize]));
    drop(step);
    let step = trace::step("graph");
    let graph = microcharts::build_graph(adjacency, &microcharts, options);
    drop(step);
    let step = trace::step("lloyd");
    let partition = lloyd::partition(&microcharts, &graph, &labels, &sizes, target, options);
    drop(step);
    let step = trace::step("growth");
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
    drop((microcharts, graph, step));

    regularize(mesh, adjacency, &normaliser, target, &mut labels);
    let step = trace::step("rings");
    split::open_rings(mesh, adjacency, &normaliser, target, &mut labels);
    drop(step);
    if options.smoothing_rounds > 0 {
        let step = trace::step("smoothing");
        smoothing::smooth_borders(mesh, adjacency, &normaliser, options, &mut labels);
        drop(step);
        regularize(mesh, adjacency, &normaliser, target, &mut labels);
    }
    labels
}

/// Makes every label connected, merges charts that are too small into a neighbour, and halves those that are too large.
fn regularize(mesh: &Mesh, adjacency: &Adjacency, normaliser: &Normaliser, target: u32, labels: &mut Vec<u32>) {
    let _step = trace::step("regularize");
    let (connected, count) = components::connected_components(adjacency, labels);
    *labels = connected;
    merge::merge_small(mesh, adjacency, normaliser, target, count, labels);
    split::halve_large(adjacency, target, labels);
}

/// Number of triangles of each label.
fn label_sizes(labels: &[u32], count: u32) -> Vec<u32> {
    let mut sizes = vec![0; count as usize];
    for &label in labels {
        sizes[label as usize] += 1;
    }
    sizes
}

/// Renumbers labels by their smallest triangle and returns their number.
pub(super) fn compact_labels(labels: &mut [u32]) -> u32 {
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

/// The triangles of each label, ascending: `list[start[l]..start[l + 1]]`.
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
