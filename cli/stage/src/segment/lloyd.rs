//! Lloyd rounds on the graph of microcharts: grow charts from seeds, move each seed to the middle of its chart, repeat.
//!
//! Distances count triangles rather than lengths, so that charts get about equally many. A chart that is still too
//! large grows more slowly in the next round. A microchart whose normal differs from the chart's mean normal counts as
//! farther away.

use super::SegmentOptions;
use super::microcharts::{MicrochartGraph, Microcharts};
use glam::DVec3;
use lodpack_mesh::NONE;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The result of the rounds.
pub(super) struct Partition {
    /// Chart of each microchart.
    pub label: Vec<u32>,
    /// Seed microchart of each chart.
    pub seeds: Vec<u32>,
}

/// The state of a chart for the next round.
#[derive(Clone, Copy)]
struct Site {
    /// Mean normal, or zero.
    normal: DVec3,
    /// 1 if there is a mean normal, else 0.
    known: f64,
    /// All distances within the chart are multiplied by this.
    slowness: f64,
}

/// Assigns the microcharts to charts. `component` is the connected component of each triangle, `component_sizes` the
/// number of triangles of each component.
pub(super) fn partition(
    microcharts: &Microcharts,
    graph: &MicrochartGraph,
    component: &[u32],
    component_sizes: &[u32],
    target: u32,
    options: &SegmentOptions,
) -> Partition {
    let normals: Vec<DVec3> = microcharts.all.iter().map(|c| c.area_vector.normalize_or_zero()).collect();
    let (mut label, chart_count) = first_charts(microcharts, graph, component, component_sizes, target);
    let mut sites = vec![Site { normal: DVec3::ZERO, known: 0.0, slowness: 1.0 }; chart_count];
    let mut seeds = middles(microcharts, &label, chart_count);
    for round in 0..=options.lloyd_rounds {
        grow(graph, &normals, &seeds, &sites, options.flatness_weight, &mut label);
        if round < options.lloyd_rounds {
            update_sites(microcharts, &label, target, &mut sites);
            seeds = middles(microcharts, &label, chart_count);
        }
    }
    Partition { label, seeds }
}

/// Charts to start from: breadth-first floods of somewhat less than a chart's size. Each component keeps its largest
/// floods, as many as it should have charts; the microcharts of the others stay [`NONE`].
fn first_charts(
    microcharts: &Microcharts,
    graph: &MicrochartGraph,
    component: &[u32],
    component_sizes: &[u32],
    target: u32,
) -> (Vec<u32>, usize) {
    let microchart_count = microcharts.all.len();
    let mut label = vec![NONE; microchart_count];
    // Component, size (to sort descending) and number of each flood.
    let mut floods: Vec<(u32, Reverse<u32>, u32)> = Vec::new();
    let mut queue = Vec::new();
    for seed in 0..microchart_count as u32 {
        if label[seed as usize] != NONE {
            continue;
        }
        let component = component[microcharts.all[seed as usize].first as usize];
        let size = component_sizes[component as usize];
        let capacity = (f64::from(size) / f64::from(charts_of(size, target)) * 0.7) as u32;
        let flood = floods.len() as u32;
        queue.clear();
        queue.push(seed);
        label[seed as usize] = flood;
        let mut filled = microcharts.all[seed as usize].count;
        let mut head = 0;
        while head < queue.len() && filled < capacity {
            for &(c, _) in graph.neighbours(queue[head]) {
                if label[c as usize] == NONE && filled < capacity {
                    label[c as usize] = flood;
                    filled += microcharts.all[c as usize].count;
                    queue.push(c);
                }
            }
            head += 1;
        }
        floods.push((component, Reverse(filled), flood));
    }
    floods.sort_unstable();
    let mut number = vec![NONE; floods.len()];
    let mut chart_count = 0;
    for same_component in floods.chunk_by(|a, b| a.0 == b.0) {
        let wanted = charts_of(component_sizes[same_component[0].0 as usize], target) as usize;
        for &(_, _, flood) in same_component.iter().take(wanted) {
            number[flood as usize] = chart_count;
            chart_count += 1;
        }
    }
    for label in &mut label {
        *label = number[*label as usize];
    }
    (label, chart_count as usize)
}

/// The number of charts that a component of this many triangles should have.
fn charts_of(size: u32, target: u32) -> u32 {
    (size.saturating_add(target / 2) / target).max(2)
}

/// For each chart the microchart nearest to the chart's centroid. Microcharts are weighted by their number of
/// triangles.
fn middles(microcharts: &Microcharts, label: &[u32], chart_count: usize) -> Vec<u32> {
    let mut centroid = vec![(DVec3::ZERO, 0.0); chart_count];
    for (microchart, &l) in microcharts.all.iter().zip(label) {
        if l != NONE {
            let weight = f64::from(microchart.count);
            centroid[l as usize].0 += microchart.centroid * weight;
            centroid[l as usize].1 += weight;
        }
    }
    let mut best = vec![(f64::INFINITY, NONE); chart_count];
    for (c, (microchart, &l)) in microcharts.all.iter().zip(label).enumerate() {
        if l != NONE {
            let (sum, weight) = centroid[l as usize];
            let distance = microchart.centroid.distance_squared(sum / weight);
            if distance < best[l as usize].0 || best[l as usize].1 == NONE {
                best[l as usize] = (distance, c as u32);
            }
        }
    }
    best.into_iter().map(|(_, c)| c).collect()
}

fn update_sites(microcharts: &Microcharts, label: &[u32], target: u32, sites: &mut [Site]) {
    let mut size = vec![0u32; sites.len()];
    for site in sites.iter_mut() {
        site.normal = DVec3::ZERO;
    }
    for (microchart, &l) in microcharts.all.iter().zip(label) {
        if l != NONE {
            sites[l as usize].normal += microchart.area_vector;
            size[l as usize] += microchart.count;
        }
    }
    for (site, size) in sites.iter_mut().zip(size) {
        site.normal = site.normal.normalize_or_zero();
        site.known = if site.normal == DVec3::ZERO { 0.0 } else { 1.0 };
        // A chart twice too large should have distances longer by the square root of two. Half of that step each round
        // converges.
        let step = (f64::from(size) / f64::from(target)).sqrt().sqrt();
        site.slowness = (site.slowness * step).clamp(0.5, 2.0);
    }
}

/// Dijkstra's algorithm from all seeds at once. Every chart is connected, because a microchart takes the label of its
/// predecessor.
fn grow(
    graph: &MicrochartGraph,
    normals: &[DVec3],
    seeds: &[u32],
    sites: &[Site],
    flatness_weight: f64,
    label: &mut [u32],
) {
    label.fill(NONE);
    let mut cost = vec![f32::INFINITY; label.len()];
    // The bits of non-negative floats sort like the floats. Ties go to the smaller microchart.
    let mut heap: BinaryHeap<Reverse<(u32, u32)>> = BinaryHeap::new();
    for (l, &seed) in seeds.iter().enumerate() {
        cost[seed as usize] = 0.0;
        label[seed as usize] = l as u32;
        heap.push(Reverse((0, seed)));
    }
    while let Some(Reverse((bits, c))) = heap.pop() {
        let reached = f32::from_bits(bits);
        if reached > cost[c as usize] {
            continue;
        }
        let l = label[c as usize];
        let site = sites[l as usize];
        for &(next, distance) in graph.neighbours(c) {
            if cost[next as usize] <= reached {
                continue;
            }
            // 1 - cos; normals have length 1, or 0 where unknown.
            let tilt = site.known - normals[next as usize].dot(site.normal);
            let factor = site.slowness * (1.0 + flatness_weight * tilt.max(0.0));
            let next_cost = reached + distance * factor as f32;
            if next_cost < cost[next as usize] {
                cost[next as usize] = next_cost;
                label[next as usize] = l;
                heap.push(Reverse((next_cost.to_bits(), next)));
            }
        }
    }
}
