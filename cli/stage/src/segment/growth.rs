//! From microcharts to triangles. The borders between charts made of microcharts are ragged, so the microcharts along
//! them are given up and their triangles are grown again from both sides. Steps across creases cost much, so the fronts
//! meet there.

use super::SegmentOptions;
use super::geometry::{Facet, Normaliser, bend_between, creaseness, relative_distance};
use super::lloyd::Partition;
use super::microcharts::{MicrochartGraph, Microcharts};
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// The range of costs in one bucket of the queue; a step costs about 1.
const BUCKET_WIDTH: f32 = 0.35;
/// Buckets in the ring: more than the most expensive step spans.
const BUCKETS: usize = 1024;

/// Gives the triangles of all microcharts the label `first_label` + their chart in `partition`. Other triangles keep
/// their label.
#[expect(clippy::too_many_arguments, reason = "one caller, which passes everything that the earlier steps found")]
pub(super) fn grow_labels(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    microcharts: &Microcharts,
    graph: &MicrochartGraph,
    partition: &Partition,
    first_label: u32,
    options: &SegmentOptions,
    labels: &mut [u32],
) {
    let mut certain: Vec<bool> = (0..microcharts.all.len() as u32)
        .into_par_iter()
        .map(|c| {
            let label = partition.label[c as usize];
            graph.neighbours(c).iter().all(|&(n, _)| partition.label[n as usize] == label)
        })
        .collect();
    for &seed in &partition.seeds {
        certain[seed as usize] = true;
    }
    labels.par_iter_mut().zip(&microcharts.of_triangle).for_each(|(label, &c)| {
        if c != NONE {
            *label = if certain[c as usize] { first_label + partition.label[c as usize] } else { NONE };
        }
    });
    let open: Vec<u32> = (0..labels.len() as u32).into_par_iter().filter(|&t| labels[t as usize] == NONE).collect();
    if open.is_empty() {
        return;
    }
    let mut slot = vec![NONE; labels.len()];
    for (i, &t) in open.iter().enumerate() {
        slot[t as usize] = i as u32;
    }
    let of_all = trace::even("facets");
    let facets: Vec<Facet> = open.par_iter().map(|&t| normaliser.facet(mesh, t)).collect();
    let steps: Vec<[Step; 3]> = (0..open.len())
        .into_par_iter()
        .map(|i| {
            [0, 1, 2].map(|k| {
                let opposite = adjacency.opposite[3 * open[i] as usize + k];
                if opposite == NONE {
                    return Step { to: NONE, cost: 0.0 };
                }
                let to = slot[opposite as usize / 3];
                let other = if to == NONE { normaliser.facet(mesh, opposite / 3) } else { facets[to as usize] };
                Step { to, cost: step_cost(&facets[i], &other, options.crease_weight) }
            })
        })
        .collect();
    drop(of_all);

    let mut front = Front::new(open.len());
    for (i, steps) in steps.iter().enumerate() {
        for k in 0..3 {
            let opposite = adjacency.opposite[3 * open[i] as usize + k];
            if opposite != NONE && steps[k].to == NONE {
                front.offer(i as u32, steps[k].cost, labels[opposite as usize / 3]);
            }
        }
    }
    front.advance(&steps);
    for (&t, label) in open.iter().zip(front.label) {
        labels[t as usize] = label;
    }
}

/// A step from an open triangle across one of its edges.
#[derive(Clone, Copy)]
struct Step {
    /// The open triangle across the edge, or [`NONE`].
    to: u32,
    cost: f32,
}

fn step_cost(a: &Facet, b: &Facet, crease_weight: f64) -> f32 {
    let distance = relative_distance(a.centroid.distance(b.centroid), a.size, b.size);
    (distance * (1.0 + crease_weight * creaseness(bend_between(a, b)))).min(100.0) as f32
}

/// Multi-source shortest paths, with a ring of buckets instead of a heap. A triangle may be reached again at a lower
/// cost.
struct Front {
    cost: Vec<f32>,
    label: Vec<u32>,
    buckets: Vec<Vec<(u32, f32)>>,
    current: usize,
    waiting: usize,
}

impl Front {
    fn new(count: usize) -> Self {
        Self {
            cost: vec![f32::INFINITY; count],
            label: vec![NONE; count],
            buckets: vec![Vec::new(); BUCKETS],
            current: 0,
            waiting: 0,
        }
    }

    fn offer(&mut self, i: u32, cost: f32, label: u32) {
        if cost < self.cost[i as usize] {
            self.cost[i as usize] = cost;
            self.label[i as usize] = label;
            let bucket = ((cost / BUCKET_WIDTH) as usize).clamp(self.current, self.current + BUCKETS - 1);
            self.buckets[bucket % BUCKETS].push((i, cost));
            self.waiting += 1;
        }
    }

    fn advance(&mut self, steps: &[[Step; 3]]) {
        while self.waiting > 0 {
            while let Some((i, cost)) = self.buckets[self.current % BUCKETS].pop() {
                self.waiting -= 1;
                if cost > self.cost[i as usize] {
                    continue;
                }
                let label = self.label[i as usize];
                for step in steps[i as usize].iter().filter(|step| step.to != NONE) {
                    self.offer(step.to, cost + step.cost, label);
                }
            }
            self.current += 1;
        }
    }
}
