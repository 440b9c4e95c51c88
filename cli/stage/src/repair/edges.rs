//! Pairs the half-edges at each edge.

use glam::DVec3;
use rayon::prelude::*;

use lodpack_mesh::{NONE, next_half_edge, previous_half_edge};
use lodpack_runtime::trace;

/// At an edge with more triangles than this, only the first ones are paired: trying all pairs takes quadratic time.
pub const MAX_MATCHED: usize = 32;

/// Buckets that a task sorts.
const BUCKETS: usize = 1 << 13;

/// Half-edges, paired across their edges.
pub struct Pairing {
    /// For each half-edge the one on the other side; [`NONE`] where the surface ends. Both may run in the same
    /// direction until [`super::winding`] has made them consistent.
    pub opposite: Vec<u32>,
    /// Whether the half-edges of some pair run in the same direction.
    pub(super) has_inconsistent_pair: bool,
    /// Triangles with the same three vertices as an earlier one, ascending. If there are any, the pairs are not valid.
    pub duplicates: Vec<u32>,
    pub(super) nonmanifold_edge_count: u64,
    /// All half-edges at edges of more than two triangles; later also those of other edges that are cut.
    pub(super) cut: Vec<u32>,
}

/// Pairs the half-edges of triangles that repeat no vertex.
pub fn pair_edges(triangles: &[[u32; 3]], positions: &[DVec3]) -> Pairing {
    let mut pairing = Pairing {
        opposite: vec![NONE; 3 * triangles.len()],
        has_inconsistent_pair: false,
        duplicates: Vec::new(),
        nonmanifold_edge_count: 0,
        cut: Vec::new(),
    };
    let (mut sorted, ends) = half_edges_by_edge(triangles, positions.len());
    sort_buckets(&mut sorted, &ends);
    let mut run: Vec<u32> = Vec::new();
    let mut start = 0;
    for end in ends {
        let bucket = &sorted[start as usize..end as usize];
        start = end;
        for same_edge in bucket.chunk_by(|a, b| a >> 32 == b >> 32) {
            match *same_edge {
                [_] => {}
                [g, h] => {
                    let (g, h) = (g as u32, h as u32);
                    if apex(triangles, g) == apex(triangles, h) {
                        pairing.duplicates.push(h / 3);
                    }
                    pairing.join(triangles, g, h);
                }
                _ => {
                    run.clear();
                    run.extend(same_edge.iter().map(|&entry| entry as u32));
                    pairing.cut.extend_from_slice(&run);
                    pairing.nonmanifold_edge_count += 1;
                    list_duplicates(triangles, &run, &mut pairing.duplicates);
                    match_best_pairs(triangles, positions, &run, &mut pairing);
                }
            }
        }
    }
    pairing.duplicates.sort_unstable();
    pairing.duplicates.dedup();
    pairing
}

impl Pairing {
    fn join(&mut self, triangles: &[[u32; 3]], g: u32, h: u32) {
        self.opposite[g as usize] = h;
        self.opposite[h as usize] = g;
        self.has_inconsistent_pair |= origin(triangles, g) == origin(triangles, h);
    }

    /// Opens the surface at a half-edge, on both sides.
    pub(super) fn separate(&mut self, half_edge: u32) {
        let other = std::mem::replace(&mut self.opposite[half_edge as usize], NONE);
        if other != NONE {
            self.opposite[other as usize] = NONE;
            self.cut.extend([half_edge, other]);
        }
    }
}

/// The vertex at which a half-edge starts.
#[inline]
pub(super) fn origin(triangles: &[[u32; 3]], half_edge: u32) -> u32 {
    triangles[half_edge as usize / 3][half_edge as usize % 3]
}

/// The vertex opposite a half-edge in its triangle.
#[inline]
fn apex(triangles: &[[u32; 3]], half_edge: u32) -> u32 {
    origin(triangles, previous_half_edge(half_edge))
}

/// Sorts all half-edges by the smaller end of their edge, by counting. The upper half of an entry holds the larger end,
/// the lower half the half-edge. Returns the entries, and for each smaller end where its bucket ends.
fn half_edges_by_edge(triangles: &[[u32; 3]], vertex_count: usize) -> (Vec<u64>, Vec<u32>) {
    let mut slot = vec![0u32; vertex_count + 1];
    for &[a, b, c] in triangles {
        slot[a.min(b) as usize + 1] += 1;
        slot[b.min(c) as usize + 1] += 1;
        slot[c.min(a) as usize + 1] += 1;
    }
    for v in 0..vertex_count {
        slot[v + 1] += slot[v];
    }
    let mut sorted = vec![0u64; 3 * triangles.len()];
    for (t, &[a, b, c]) in triangles.iter().enumerate() {
        for (k, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
            let next = &mut slot[from.min(to) as usize];
            sorted[*next as usize] = u64::from(from.max(to)) << 32 | (3 * t + k) as u64;
            *next += 1;
        }
    }
    // Filling has moved each start to the end of its bucket.
    slot.truncate(vertex_count);
    (sorted, slot)
}

/// Sorts each bucket by the other end of the edge, then by half-edge.
fn sort_buckets(sorted: &mut [u64], ends: &[u32]) {
    let _all = trace::even("buckets");
    let (mut rest, mut start) = (sorted, 0);
    let mut blocks = vec![];
    for ends in ends.chunks(BUCKETS) {
        let end = ends[ends.len() - 1];
        let (block, behind) = std::mem::take(&mut rest).split_at_mut((end - start) as usize);
        blocks.push((block, ends, start));
        (rest, start) = (behind, end);
    }
    blocks.into_par_iter().for_each(|(mut block, ends, mut start)| {
        for &end in ends {
            let (bucket, behind) = block.split_at_mut((end - start) as usize);
            bucket.sort_unstable();
            (block, start) = (behind, end);
        }
    });
}

fn list_duplicates(triangles: &[[u32; 3]], run: &[u32], duplicates: &mut Vec<u32>) {
    let mut by_apex: Vec<(u32, u32)> = run.iter().map(|&h| (apex(triangles, h), h / 3)).collect();
    by_apex.sort_unstable();
    duplicates.extend(by_apex.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1));
}

/// Pairs the half-edges of one edge greedily: consistently wound pairs before others, then the flattest continuation,
/// then the earliest. So two solids that touch along an edge stay closed, and of a fin on a smooth surface the fin is
/// cut off.
fn match_best_pairs(triangles: &[[u32; 3]], positions: &[DVec3], run: &[u32], pairing: &mut Pairing) {
    let run = &run[..run.len().min(MAX_MATCHED)];
    let normals: Vec<DVec3> = run
        .iter()
        .map(|&h| {
            let [a, b, c] =
                [h, next_half_edge(h), previous_half_edge(h)].map(|h| positions[origin(triangles, h) as usize]);
            (b - a).cross(c - a).normalize_or_zero()
        })
        .collect();
    let fit = |i: usize, j: usize| {
        let consistent = origin(triangles, run[i]) != origin(triangles, run[j]);
        Some((consistent, normals[i].dot(normals[j])))
    };
    for [i, j] in best_pairs(run.len(), fit) {
        pairing.join(triangles, run[i], run[j]);
    }
}

/// Which triangles at one edge to pair, each at most once: consistently wound pairs before others, then the flattest
/// continuation, then the earliest. `fit` says whether two triangles are wound consistently, and the cosine between
/// their normals; it returns nothing for two that cannot be paired.
pub fn best_pairs(count: usize, fit: impl Fn(usize, usize) -> Option<(bool, f64)>) -> Vec<[usize; 2]> {
    let mut candidates: Vec<(bool, f64, usize, usize)> = Vec::new();
    for i in 0..count {
        for j in i + 1..count {
            if let Some((consistent, cosine)) = fit(i, j) {
                candidates.push((consistent, if consistent { cosine } else { -cosine }, i, j));
            }
        }
    }
    candidates.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
    let mut taken = vec![false; count];
    let mut pairs = Vec::new();
    for (_, _, i, j) in candidates {
        if !taken[i] && !taken[j] {
            (taken[i], taken[j]) = (true, true);
            pairs.push([i, j]);
        }
    }
    pairs
}
