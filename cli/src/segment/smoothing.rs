//! Shorter, smoother borders: threshold dynamics (Merriman, Bence, Osher 1992) in a band along them, then greedy flips.
//!
//! Each triangle of the band holds shares of up to three labels. Shares diffuse over edges, less over creases, and every
//! triangle then takes its largest share: borders move by their curvature and come to rest on creases.

use super::SegmentOptions;
use super::geometry::{Frame, bend, creaseness};
use crate::mesh::{Adjacency, Mesh, NONE};
use glam::DVec3;
use rayon::prelude::*;

/// Triangles that the band reaches from a border to either side; borders cannot move farther.
const BAND_DEPTH: usize = 6;
/// Diffusion steps a round: the fewer, the more a border sticks to the triangles it runs along.
const DIFFUSION_STEPS: usize = 8;
/// Passes of greedy flips at the end.
const FLIP_PASSES: usize = 3;

/// Shortens the borders between labels where that is possible within a few triangles.
pub(super) fn smooth_borders(
    mesh: &Mesh,
    adjacency: &Adjacency,
    frame: &Frame,
    options: &SegmentOptions,
    labels: &mut [u32],
) {
    let band = Band::new(mesh, adjacency, frame, options.crease_weight, labels);
    let mut shares: Vec<Shares> = Vec::new();
    let mut next = Vec::new();
    for _ in 0..options.smoothing_rounds {
        shares.clear();
        shares.par_extend(band.triangles.par_iter().map(|&t| Shares::whole(labels[t as usize])));
        next.clone_from(&shares);
        for _ in 0..DIFFUSION_STEPS {
            next.par_iter_mut().enumerate().for_each(|(i, next)| *next = band.diffuse(i, &shares));
            std::mem::swap(&mut shares, &mut next);
        }
        for (&t, share) in band.triangles.iter().zip(&shares) {
            labels[t as usize] = share.label[0];
        }
    }
    band.flip(labels);
}

/// Shares of labels that a triangle holds, largest first, together 1; unused places have share 0.
#[derive(Clone, Copy, PartialEq)]
struct Shares {
    label: [u32; 3],
    share: [f32; 3],
}

impl Shares {
    fn whole(label: u32) -> Self {
        Self { label: [label, NONE, NONE], share: [1.0, 0.0, 0.0] }
    }

    fn is_whole(&self) -> bool {
        self.share[0] == 1.0
    }
}

/// The triangles near borders.
struct Band {
    triangles: Vec<u32>,
    edges: Vec<[BandEdge; 3]>,
}

#[derive(Clone, Copy)]
struct BandEdge {
    /// Place in the band, or [`NONE`].
    to: u32,
    /// Triangle outside the band, or [`NONE`] inside the band and on the mesh boundary. Its label never changes.
    outside: u32,
    label_outside: u32,
    /// How well shares pass.
    conductance: f32,
    /// What a border along this edge costs: its length, less on creases.
    border_cost: f32,
}

impl Band {
    fn new(mesh: &Mesh, adjacency: &Adjacency, frame: &Frame, crease_weight: f64, labels: &[u32]) -> Self {
        let across = |t: u32| adjacency.opposite[3 * t as usize..3 * t as usize + 3].iter().copied();
        let mut triangles: Vec<u32> = (0..labels.len() as u32)
            .into_par_iter()
            .filter(|&t| across(t).any(|h| h != NONE && labels[h as usize / 3] != labels[t as usize]))
            .collect();
        let mut slot = vec![NONE; labels.len()];
        for &t in &triangles {
            slot[t as usize] = 0;
        }
        let mut ring = 0;
        for _ in 1..BAND_DEPTH {
            let ring_end = triangles.len();
            for i in ring..ring_end {
                for h in across(triangles[i]) {
                    if h != NONE && slot[h as usize / 3] == NONE {
                        slot[h as usize / 3] = 0;
                        triangles.push(h / 3);
                    }
                }
            }
            ring = ring_end;
        }
        // In mesh order neighbours lie close to each other in memory.
        triangles.par_sort_unstable();
        for (i, &t) in triangles.iter().enumerate() {
            slot[t as usize] = i as u32;
        }
        let facets: Vec<_> = triangles.par_iter().map(|&t| frame.facet(mesh, t)).collect();
        let edges = (0..triangles.len())
            .into_par_iter()
            .map(|i| {
                [0, 1, 2].map(|k| {
                    let h = 3 * triangles[i] + k;
                    let opposite = adjacency.opposite[h as usize];
                    let mut edge =
                        BandEdge { to: NONE, outside: NONE, label_outside: NONE, conductance: 0.0, border_cost: 0.0 };
                    if opposite == NONE {
                        return edge;
                    }
                    edge.to = slot[opposite as usize / 3];
                    if edge.to == NONE {
                        edge.outside = opposite / 3;
                        edge.label_outside = labels[opposite as usize / 3];
                        edge.conductance = 1.0;
                        edge.border_cost = frame.edge_length(mesh, h) as f32;
                        return edge;
                    }
                    // The normals of both sides without what lies across the edge: true creases stay, noise averages out.
                    let side = |i: u32, skip: u32| -> DVec3 {
                        let own = &facets[i as usize];
                        across(triangles[i as usize])
                            .filter(|&h| h != NONE && h / 3 != triangles[skip as usize])
                            .map(|h| slot[h as usize / 3])
                            .filter(|&j| j != NONE)
                            .fold(own.area_vector, |sum, j| sum + facets[j as usize].area_vector)
                    };
                    let crease = creaseness(bend(side(i as u32, edge.to), side(edge.to, i as u32)));
                    let discount = 1.0 / (1.0 + crease_weight * crease);
                    let length = frame.edge_length(mesh, h);
                    let distance = facets[i].centroid.distance(facets[edge.to as usize].centroid);
                    let ratio = if distance > 0.0 { length / (1.75 * distance) } else { 1.0 };
                    edge.conductance = (ratio.clamp(0.3, 3.0) * discount) as f32;
                    edge.border_cost = (length * discount) as f32;
                    edge
                })
            })
            .collect();
        Self { triangles, edges }
    }

    /// One step: the mean of a triangle's own shares and its neighbours', weighted with the conductances.
    fn diffuse(&self, i: usize, shares: &[Shares]) -> Shares {
        let own = &shares[i];
        let of = |edge: &BandEdge| {
            if edge.to == NONE { Shares::whole(edge.label_outside) } else { shares[edge.to as usize] }
        };
        if own.is_whole() && self.edges[i].iter().all(|edge| edge.conductance == 0.0 || of(edge) == *own) {
            return *own;
        }
        let mut sums = [(NONE, 0f32); 12];
        let mut count = 0;
        let mut add = |from: &Shares, weight: f32| {
            for (&label, &share) in from.label.iter().zip(&from.share) {
                if share == 0.0 {
                    break;
                }
                let place = sums[..count].iter().position(|sum| sum.0 == label).unwrap_or(count);
                count = count.max(place + 1);
                sums[place].0 = label;
                sums[place].1 += weight * share;
            }
        };
        add(own, 1.0);
        for edge in self.edges[i].iter().filter(|edge| edge.conductance > 0.0) {
            add(&of(edge), edge.conductance);
        }
        let sums = &mut sums[..count];
        sums.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let total: f32 = sums.iter().take(3).map(|sum| sum.1).sum();
        let mut result = Shares { label: [NONE; 3], share: [0.0; 3] };
        for (k, sum) in sums.iter().take(3).enumerate() {
            result.label[k] = sum.0;
            result.share[k] = sum.1 / total;
        }
        result
    }

    /// Gives single triangles to a neighbour where that makes the border cheaper: takes off the teeth of a zigzag.
    fn flip(&self, labels: &mut [u32]) {
        for _ in 0..FLIP_PASSES {
            let mut flips = 0;
            for (i, &t) in self.triangles.iter().enumerate() {
                let own = labels[t as usize];
                let sides = self.edges[i].map(|edge| {
                    let label = if edge.to != NONE {
                        labels[self.triangles[edge.to as usize] as usize]
                    } else if edge.outside != NONE {
                        edge.label_outside
                    } else {
                        NONE
                    };
                    (label, edge.border_cost)
                });
                if sides.iter().all(|&(label, _)| label == own || label == NONE) {
                    continue;
                }
                let cost_with =
                    |label: u32| -> f32 { sides.iter().filter(|side| side.0 == label).map(|side| side.1).sum() };
                let mut best = (own, cost_with(own));
                for &(label, _) in sides.iter().filter(|side| side.0 != NONE) {
                    if cost_with(label) > best.1 * 1.0001 {
                        best = (label, cost_with(label));
                    }
                }
                if best.0 != own {
                    labels[t as usize] = best.0;
                    flips += 1;
                }
            }
            if flips == 0 {
                break;
            }
        }
    }
}
