//! Shortens and smooths borders: threshold dynamics (Merriman, Bence and Osher, 1992) in a band along them, then greedy
//! flips.
//!
//! Each triangle of the band holds shares of up to three labels. Shares diffuse across edges, less so across creases,
//! and then every triangle takes its largest share. So borders move by their curvature and come to rest on creases.

use super::SegmentOptions;
use super::geometry::{Facet, Normaliser, bend, creaseness};
use glam::DVec3;
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// How many triangles the band reaches from a border to either side. Borders cannot move farther.
const BAND_DEPTH: usize = 6;
/// Diffusion steps per round. With fewer, a border sticks more to the triangles along which it runs.
const DIFFUSION_STEPS: usize = 8;
/// Passes of greedy flips at the end.
const FLIP_PASSES: usize = 3;

/// Shortens the borders between labels where moving them by a few triangles can.
pub(super) fn smooth_borders(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    options: &SegmentOptions,
    labels: &mut [u32],
) {
    let band = Band::new(mesh, adjacency, normaliser, options.crease_weight, labels);
    let mut shares: Vec<Shares> = Vec::new();
    let mut next = Vec::new();
    for _ in 0..options.smoothing_rounds {
        shares.clear();
        shares.par_extend(band.triangles.par_iter().map(|&t| Shares::whole(labels[t as usize])));
        next.clone_from(&shares);
        let of_all = trace::even("diffusion");
        for _ in 0..DIFFUSION_STEPS {
            next[..band.links.len()]
                .par_iter_mut()
                .zip(&band.links)
                .enumerate()
                .with_min_len(1 << 12)
                .for_each(|(i, (next, links))| *next = links.diffuse(i, &shares));
            std::mem::swap(&mut shares, &mut next);
        }
        drop(of_all);
        for (&t, share) in band.triangles[..band.links.len()].iter().zip(&shares) {
            labels[t as usize] = share.label[0];
        }
    }
    band.flip(labels);
}

/// The shares of labels that a triangle holds, the largest first; they add up to 1, and unused entries have share 0.
#[derive(Clone, Copy, PartialEq)]
struct Shares {
    label: [u32; 3],
    share: [f32; 3],
}

impl Shares {
    fn whole(label: u32) -> Self {
        Self { label: [label, NONE, NONE], share: [1.0, 0.0, 0.0] }
    }
}

/// How a triangle of the band is connected with its neighbours.
#[derive(Clone, Copy)]
struct Links {
    /// Indices into the band; its own index on the mesh boundary.
    to: [u32; 3],
    /// How well shares pass; 0 on the mesh boundary.
    conductance: [f32; 3],
    /// The cost of a border along this edge: its length, less on creases.
    border_cost: [f32; 3],
}

/// The triangles near borders.
struct Band {
    /// Those with links, ascending, then the ring around them, whose labels never change.
    triangles: Vec<u32>,
    links: Vec<Links>,
}

impl Band {
    fn new(mesh: &Mesh, adjacency: &Adjacency, normaliser: &Normaliser, crease_weight: f64, labels: &[u32]) -> Self {
        let across = |t: u32| adjacency.opposite[3 * t as usize..3 * t as usize + 3].iter().copied();
        let mut triangles: Vec<u32> = (0..labels.len() as u32)
            .into_par_iter()
            .filter(|&t| across(t).any(|h| h != NONE && labels[h as usize / 3] != labels[t as usize]))
            .collect();
        let mut slot = vec![NONE; labels.len()];
        for &t in &triangles {
            slot[t as usize] = 0;
        }
        let mut linked = 0;
        for _ in 0..BAND_DEPTH {
            let ring = linked;
            linked = triangles.len();
            for i in ring..linked {
                for h in across(triangles[i]) {
                    if h != NONE && slot[h as usize / 3] == NONE {
                        slot[h as usize / 3] = 0;
                        triangles.push(h / 3);
                    }
                }
            }
        }
        // In mesh order, neighbours lie close to each other in memory.
        let outside = triangles.split_off(linked);
        for &t in &outside {
            slot[t as usize] = NONE;
        }
        triangles.clear();
        triangles.par_extend((0..labels.len() as u32).into_par_iter().filter(|&t| slot[t as usize] == 0));
        triangles.extend(outside);
        for (i, &t) in triangles.iter().enumerate() {
            slot[t as usize] = i as u32;
        }
        let _all = trace::even("links");
        let facets: Vec<Facet> = triangles.par_iter().map(|&t| normaliser.facet(mesh, t)).collect();
        // Each triangle's area vector plus those of its neighbours.
        let around: Vec<DVec3> = (0..linked)
            .into_par_iter()
            .map(|i| {
                let neighbours = across(triangles[i]).filter(|&h| h != NONE).map(|h| slot[h as usize / 3]);
                neighbours.fold(facets[i].area_vector, |sum, j| sum + facets[j as usize].area_vector)
            })
            .collect();
        let links = (0..linked)
            .into_par_iter()
            .map(|i| {
                let mut links = Links { to: [i as u32; 3], conductance: [0.0; 3], border_cost: [0.0; 3] };
                for k in 0..3 {
                    let h = 3 * triangles[i] + k as u32;
                    let opposite = adjacency.opposite[h as usize];
                    if opposite == NONE {
                        continue;
                    }
                    let j = slot[opposite as usize / 3] as usize;
                    // The normals on both sides without the triangle across the edge: true creases stay, and noise
                    // averages out.
                    let crease = if j < linked {
                        creaseness(bend(around[i] - facets[j].area_vector, around[j] - facets[i].area_vector))
                    } else {
                        0.0
                    };
                    let discount = 1.0 / (1.0 + crease_weight * crease);
                    let length = normaliser.edge_length(mesh, h);
                    let distance = facets[i].centroid.distance(facets[j].centroid);
                    // In a mesh of equilateral triangles, edges are 1.73 times as long as the way across them.
                    let ratio = if distance > 0.0 { length / (1.73 * distance) } else { 1.0 };
                    links.to[k] = j as u32;
                    links.conductance[k] = (ratio.clamp(0.3, 3.0) * discount) as f32;
                    links.border_cost[k] = (length * discount) as f32;
                }
                links
            })
            .collect();
        Self { triangles, links }
    }

    /// Gives single triangles to a neighbour where that makes the border cheaper, which removes the teeth of a zigzag.
    fn flip(&self, labels: &mut [u32]) {
        for _ in 0..FLIP_PASSES {
            let mut flips = 0;
            for (&t, links) in self.triangles.iter().zip(&self.links) {
                let own = labels[t as usize];
                let sides = links.to.map(|to| labels[self.triangles[to as usize] as usize]);
                if sides == [own; 3] {
                    continue;
                }
                let kept = |label: u32| -> f32 {
                    let costs = sides.iter().zip(links.border_cost).filter(|side| *side.0 == label);
                    costs.map(|side| side.1).sum()
                };
                let mut best = (own, kept(own));
                for &label in &sides {
                    if kept(label) > best.1 * 1.0001 {
                        best = (label, kept(label));
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

impl Links {
    /// One step of diffusion: the mean of the shares of triangle `i` and those of its neighbours, weighted by
    /// conductance.
    fn diffuse(&self, i: usize, shares: &[Shares]) -> Shares {
        let own = &shares[i];
        let others = self.to.map(|to| &shares[to as usize]);
        if own.share[0] == 1.0 && others.iter().all(|other| *other == own) {
            return *own;
        }
        // Nearly always there are only two labels, and then one sum is enough.
        let a = own.label[0];
        let mut b = own.label[1];
        let mut two_only = own.share[2] == 0.0;
        let mut total = 1.0;
        let mut of_a = own.share[0];
        for (other, conductance) in others.into_iter().zip(self.conductance) {
            for k in 0..2 {
                let label = other.label[k];
                if label == a {
                    of_a += conductance * other.share[k];
                } else if label != NONE {
                    b = if b == NONE { label } else { b };
                    two_only &= b == label;
                }
            }
            two_only &= other.share[2] == 0.0;
            total += conductance;
        }
        if !two_only {
            return self.diffuse_many(own, others);
        }
        let share = (of_a / total).min(1.0);
        // Ties go to the smaller label.
        if share > 0.5 || (share == 0.5 && a < b) {
            Shares { label: [a, b, NONE], share: [share, 1.0 - share, 0.0] }
        } else {
            Shares { label: [b, a, NONE], share: [1.0 - share, share, 0.0] }
        }
    }

    /// [`Self::diffuse`] for any number of labels; keeps the three largest shares.
    fn diffuse_many(&self, own: &Shares, others: [&Shares; 3]) -> Shares {
        let mut sums = [(NONE, 0f32); 12];
        let mut count = 0;
        let mut add = |from: &Shares, weight: f32| {
            for (&label, &share) in from.label.iter().zip(&from.share) {
                if share == 0.0 {
                    continue;
                }
                let found = sums[..count].iter().position(|sum| sum.0 == label).unwrap_or(count);
                count = count.max(found + 1);
                sums[found].0 = label;
                sums[found].1 += weight * share;
            }
        };
        add(own, 1.0);
        for (other, conductance) in others.into_iter().zip(self.conductance) {
            add(other, conductance);
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
}
