//! Traces corners, arcs and loops from one label per triangle.

use super::bends::{bends, farthest};
use super::cut_edges::CutEdges;
use super::halving::intervals_too_deep;
use super::{Arc, Atlas, Chart, HalfArc, Seams};
use glam::DVec3;
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};
use rayon::prelude::*;

/// The fewest half-arcs of a loop that has as many edges.
const LEAST_SIDES: usize = 3;

/// Traces the arcs and loops between triangles of different `labels`: one chart id per triangle, all of
/// `0..chart_count` in use.
///
/// The mesh must be as repair leaves it: at most two triangles at an edge, one fan at a vertex. The surface is cut
/// where labels differ and at the mesh boundary. Corners are
/// - the vertices at which the number of cut edges is not two, and the corners of seams;
/// - extra corners on arcs that would end where they begin and on loops of fewer than three half-arcs, at equal parts
///   of the length, counted from the smallest vertex where the loop has no corner;
/// - for [`trace_arcs_to_bends`], the bends of the boundary;
/// - extra corners on arcs whose edges differ so much in length that halving would not reach every vertex.
///
/// Seams stay as they are. Every id depends on the input alone.
pub fn trace_arcs(mesh: &Mesh, adjacency: &Adjacency, labels: &[u32], seams: &Seams) -> Atlas {
    trace_arcs_to_bends(mesh, adjacency, labels, seams, f64::INFINITY)
}

/// As [`trace_arcs`], with further corners on the boundary of the mesh: where it would otherwise leave its chords by
/// more than `straight`, a length.
pub fn trace_arcs_to_bends(mesh: &Mesh, adjacency: &Adjacency, labels: &[u32], seams: &Seams, straight: f64) -> Atlas {
    let cut = CutEdges::new(adjacency, labels);
    let tracer = Tracer { mesh, adjacency, labels, seams, cut: &cut };
    let is_corner = tracer.natural_corners();
    let mut chains = tracer.chains(&is_corner);
    if straight < f64::INFINITY {
        chains = chains.into_iter().flat_map(|chain| tracer.split_at_bends(chain, &is_corner, straight)).collect();
    }
    let arc_counts = tracer.arc_counts(&chains);
    let chains = tracer.split(chains, &arc_counts);
    let chains = tracer.split_deep(chains);
    tracer.atlas(&chains)
}

/// An arc in the making: indices into [`CutEdges::half_edges`], in the winding of the chart with the smaller label.
type Chain = Vec<u32>;

struct Tracer<'a> {
    mesh: &'a Mesh,
    adjacency: &'a Adjacency,
    labels: &'a [u32],
    seams: &'a Seams,
    cut: &'a CutEdges,
}

impl Tracer<'_> {
    fn half_edge(&self, at: u32) -> u32 {
        self.cut.half_edges[at as usize]
    }

    fn label(&self, half_edge: u32) -> u32 {
        self.labels[half_edge as usize / 3]
    }

    /// The vertex at which a half-edge starts.
    fn origin(&self, half_edge: u32) -> u32 {
        self.mesh.triangles[half_edge as usize / 3][half_edge as usize % 3]
    }

    fn target(&self, half_edge: u32) -> u32 {
        self.origin(next_half_edge(half_edge))
    }

    /// Whether arcs run along this half-edge rather than along its opposite.
    fn leads(&self, half_edge: u32) -> bool {
        let opposite = self.adjacency.opposite[half_edge as usize];
        opposite == NONE || self.label(half_edge) < self.label(opposite)
    }

    fn length(&self, at: u32) -> f64 {
        let h = self.half_edge(at);
        let [a, b] = [self.origin(h), self.target(h)].map(|v| self.mesh.positions[v as usize]);
        a.distance(b)
    }

    /// Marks the vertices whose number of cut edges is neither 0 nor 2, and the corners of seams.
    fn natural_corners(&self) -> Vec<bool> {
        let mut cut_edge_count = vec![0u8; self.mesh.positions.len()];
        for &h in self.cut.half_edges.iter().filter(|&&h| self.leads(h)) {
            for v in [self.origin(h), self.target(h)] {
                let count = &mut cut_edge_count[v as usize];
                *count = count.saturating_add(1);
            }
        }
        let mut is_corner: Vec<bool> = cut_edge_count.into_iter().map(|count| count != 0 && count != 2).collect();
        self.seams.corners.iter().for_each(|corner| is_corner[corner.vertex as usize] = true);
        is_corner
    }

    /// Chains from corner to corner, then the closed chains without a corner, each from its smallest vertex.
    fn chains(&self, is_corner: &[bool]) -> Vec<Chain> {
        let mut seen = vec![false; self.cut.half_edges.len()];
        let mut chains = Vec::new();
        for from_corner in [true, false] {
            for start in 0..self.cut.half_edges.len() as u32 {
                let h = self.half_edge(start);
                if seen[start as usize] || !self.leads(h) || (from_corner && !is_corner[self.origin(h) as usize]) {
                    continue;
                }
                let mut chain = Vec::new();
                let mut at = start;
                while !seen[at as usize] {
                    seen[at as usize] = true;
                    chain.push(at);
                    if is_corner[self.target(self.half_edge(at)) as usize] {
                        break;
                    }
                    at = self.cut.next[at as usize];
                }
                if !from_corner {
                    let smallest = (0..chain.len()).min_by_key(|&i| self.origin(self.half_edge(chain[i])));
                    chain.rotate_left(smallest.unwrap_or(0));
                }
                chains.push(chain);
            }
        }
        chains
    }

    fn is_seam(&self, chain: &[u32]) -> bool {
        self.seams.contains(self.half_edge(chain[0]))
    }

    /// Splits a chain of the boundary where it bends. Between two corners of seams something unknown may lie beyond it.
    fn split_at_bends(&self, mut chain: Chain, is_corner: &[bool], straight: f64) -> Vec<Chain> {
        let first = self.half_edge(chain[0]);
        let ends = [self.origin(first), self.target(self.half_edge(chain[chain.len() - 1]))];
        let is_boundary = self.adjacency.opposite[first as usize] == NONE;
        if !is_boundary || self.is_seam(&chain) || ends.iter().all(|&v| self.seams.corner(v).is_some()) {
            return vec![chain];
        }
        let path = |chain: &[u32]| -> Vec<DVec3> {
            let vertices = chain.iter().map(|&at| self.origin(self.half_edge(at)));
            let end = self.target(self.half_edge(chain[chain.len() - 1]));
            vertices.chain([end]).map(|v| self.mesh.positions[v as usize]).collect()
        };
        let mut points = path(&chain);
        let mut cuts = vec![];
        if ends[0] == ends[1] {
            let Some(mut middle) = farthest(&points, straight) else { return vec![chain] };
            if !is_corner[ends[0] as usize] {
                // The farthest point is a corner wherever the chain begins.
                chain.rotate_left(middle);
                points = path(&chain);
                middle = farthest(&points, straight).unwrap_or(middle);
            }
            cuts.extend(bends(&points[..=middle], straight));
            cuts.push(middle);
            cuts.extend(bends(&points[middle..], straight).into_iter().map(|bend| middle + bend));
        } else {
            cuts = bends(&points, straight);
        }
        let mut chains = vec![];
        for cut in cuts.into_iter().rev() {
            chains.push(chain.split_off(cut));
        }
        chains.push(chain);
        chains.reverse();
        chains
    }

    /// Whether a chain ends where it begins. Two vertices of one region may be the same corner once all regions are
    /// together.
    fn is_closed(&self, chain: &[u32]) -> bool {
        let [from, to] = [self.origin(self.half_edge(chain[0])), self.target(self.half_edge(chain[chain.len() - 1]))];
        let shared = |v: u32| self.seams.corner(v).map(|corner| corner.number);
        from == to || shared(from).is_some() && shared(from) == shared(to)
    }

    /// The number of arcs into which each chain must be split: none may be closed, and a loop needs three half-arcs.
    fn arc_counts(&self, chains: &[Chain]) -> Vec<usize> {
        let mut arc_counts: Vec<usize> =
            chains.iter().map(|c| if self.is_closed(c) && !self.is_seam(c) { c.len().min(2) } else { 1 }).collect();
        let (loops, _) = self.loops(chains);
        let length = |chain: usize| -> f64 { chains[chain].iter().map(|&at| self.length(at)).sum() };
        for sides in loops.iter().filter(|sides| sides.len() < LEAST_SIDES) {
            while sides.iter().map(|side| arc_counts[side.arc as usize]).sum::<usize>() < LEAST_SIDES {
                // Take the chain with the longest arcs, if it has enough edges for one more.
                let longest = sides
                    .iter()
                    .map(|side| side.arc as usize)
                    .filter(|&c| arc_counts[c] < chains[c].len() && !self.is_seam(&chains[c]))
                    .map(|c| (length(c) / arc_counts[c] as f64, c))
                    .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
                let Some((_, chain)) = longest else { break };
                arc_counts[chain] += 1;
            }
        }
        arc_counts
    }

    /// Splits chains into arcs of about equal length, each of at least one edge.
    fn split(&self, chains: Vec<Chain>, arc_counts: &[usize]) -> Vec<Chain> {
        let mut result = Vec::with_capacity(chains.len());
        for (chain, &count) in chains.into_iter().zip(arc_counts) {
            if count == 1 {
                result.push(chain);
                continue;
            }
            let mut along = 0.0;
            // Length from the start to the end of each edge.
            let reached: Vec<f64> = chain
                .iter()
                .map(|&at| {
                    along += self.length(at);
                    along
                })
                .collect();
            let mut begin = 0;
            for arc in 1..count {
                let wanted = along * arc as f64 / count as f64;
                let (first, last) = (begin + 1, chain.len() - (count - arc));
                let nearest = (first..=last).min_by(|&i, &j| {
                    let off = |i: usize| (reached[i - 1] - wanted).abs();
                    off(i).total_cmp(&off(j)).then(i.cmp(&j))
                });
                let end = nearest.unwrap_or(first);
                result.push(chain[begin..end].to_vec());
                begin = end;
            }
            result.push(chain[begin..].to_vec());
        }
        result
    }

    /// Splits chains until halving reaches all of their vertices. Seams stay: another region relies on their
    /// parameters.
    fn split_deep(&self, chains: Vec<Chain>) -> Vec<Chain> {
        let mut result = Vec::with_capacity(chains.len());
        let mut pending: Vec<Chain> = chains.into_iter().rev().collect();
        while let Some(mut chain) = pending.pop() {
            let cuts = if chain.len() < 2 || self.is_seam(&chain) {
                vec![]
            } else {
                let origins = chain.iter().map(|&at| self.origin(self.half_edge(at)));
                let path = origins.chain([self.target(self.half_edge(chain[chain.len() - 1]))]);
                intervals_too_deep(&path.map(|v| self.mesh.positions[v as usize]).collect::<Vec<_>>())
            };
            if cuts.is_empty() {
                result.push(chain);
                continue;
            }
            // Push the last arc first, so that the first is looked at next.
            for cut in cuts.into_iter().rev() {
                pending.push(chain.split_off(cut));
            }
            pending.push(chain);
        }
        result
    }

    /// The half-arcs of each loop, and the chart of each loop. A loop starts with its smallest chain, and loops come in
    /// that order.
    fn loops(&self, chains: &[Chain]) -> (Vec<Vec<HalfArc>>, Vec<u32>) {
        let opposite_index = |at: u32| match self.adjacency.opposite[self.half_edge(at) as usize] {
            NONE => None,
            opposite => Some(self.cut.index_of(opposite)),
        };
        // For each cut half-edge at which a half-arc starts: that half-arc, and the cut half-edge at which it ends.
        let mut starting = vec![None; self.cut.half_edges.len()];
        for (arc, chain) in chains.iter().enumerate() {
            let (first, last) = (chain[0], chain[chain.len() - 1]);
            starting[first as usize] = Some((HalfArc { arc: arc as u32, reversed: false }, last));
            if let (Some(first), Some(last)) = (opposite_index(last), opposite_index(first)) {
                starting[first as usize] = Some((HalfArc { arc: arc as u32, reversed: true }, last));
            }
        }
        let mut loops = Vec::new();
        let mut charts = Vec::new();
        for chain in chains {
            let starts = [Some(chain[0]), opposite_index(chain[chain.len() - 1])];
            for start in starts.into_iter().flatten() {
                let mut sides = Vec::new();
                let mut at = start;
                while let Some((half_arc, last)) = starting[at as usize].take() {
                    sides.push(half_arc);
                    at = self.cut.next[last as usize];
                }
                if !sides.is_empty() {
                    charts.push(self.label(self.half_edge(start)));
                    loops.push(sides);
                }
            }
        }
        (loops, charts)
    }

    fn atlas(&self, chains: &[Chain]) -> Atlas {
        let ends = |chain: &Chain| {
            [self.origin(self.half_edge(chain[0])), self.target(self.half_edge(chain[chain.len() - 1]))]
        };
        let mut corners: Vec<u32> = chains.iter().flat_map(ends).collect();
        corners.par_sort_unstable();
        corners.dedup();
        let corner_of = |v: u32| corners.partition_point(|&c| c < v) as u32;
        let arcs: Vec<Arc> = chains
            .par_iter()
            .map(|chain| {
                let first = self.half_edge(chain[0]);
                let opposite = self.adjacency.opposite[first as usize];
                let mut path: Vec<u32> = chain.iter().map(|&at| self.origin(self.half_edge(at))).collect();
                let ends = ends(chain);
                path.push(ends[1]);
                let seam = self.seams.starting(first);
                let mut arc = Arc {
                    ends: ends.map(corner_of),
                    path,
                    charts: [self.label(first), if opposite == NONE { NONE } else { self.label(opposite) }],
                    seam: seam.map(|start| start.seam),
                };
                if seam.is_some_and(|start| start.reversed) {
                    arc.reverse();
                }
                arc
            })
            .collect();

        let mut charts = charts_of_labels(self.labels);
        let arc_lengths: Vec<f64> =
            chains.par_iter().map(|chain| chain.iter().map(|&at| self.length(at)).sum()).collect();
        let (loops, chart_of_loop) = self.loops(chains);
        for (mut sides, chart) in loops.into_iter().zip(chart_of_loop) {
            // Of a seam's half-arcs, the only one in this region may run against it.
            sides.iter_mut().for_each(|side| side.reversed ^= arcs[side.arc as usize].charts[0] == NONE);
            charts[chart as usize].loops.push(sides);
        }
        charts.par_iter_mut().for_each(|chart| {
            let length = |sides: &Vec<HalfArc>| -> f64 { sides.iter().map(|s| arc_lengths[s.arc as usize]).sum() };
            // The sort is stable: loops of equal length keep the order of their smallest arcs.
            chart.loops.sort_by_cached_key(|sides| std::cmp::Reverse(length(sides).to_bits()));
        });
        Atlas { corners, arcs, charts }
    }
}

/// One chart per label with its triangles; loops are still missing.
fn charts_of_labels(labels: &[u32]) -> Vec<Chart> {
    let mut sizes = Vec::new();
    for &label in labels {
        if label as usize >= sizes.len() {
            sizes.resize(label as usize + 1, 0);
        }
        sizes[label as usize] += 1;
    }
    let mut charts: Vec<Chart> =
        sizes.iter().map(|&size| Chart { triangles: Vec::with_capacity(size), loops: Vec::new() }).collect();
    for (t, &label) in labels.iter().enumerate() {
        charts[label as usize].triangles.push(t as u32);
    }
    charts
}
