//! Seams, the arcs between regions. Both sides have to divide them at the same corners, whatever charts each side has.

use std::collections::BTreeMap;

use lodpack_stage::arcs::{SeamCorner, SeamStart, Seams};

use super::boundary::RegionBoundary;
use super::matching::{EdgeId, Matching, firsts};
use super::sketch::{BoundarySketch, LoopSketch};

/// The most edges in an arc of a seam: with this many, every vertex can be a sample.
const MAX_EDGES: usize = 4096;
/// The fewest half-arcs in a loop, if it has as many edges.
const LEAST_SIDES: usize = 3;

/// Finds the corners of all seams and numbers them. `boundaries` are the matched ones, after components were reversed.
pub fn find_seams(boundaries: &[&RegionBoundary], matching: &Matching, sketches: &[BoundarySketch]) -> Vec<Seams> {
    let mut tracer = Tracer::new(boundaries, matching, sketches);
    tracer.mark_closed();
    tracer.mark_poor_loops(sketches);
    tracer.trace()
}

struct Tracer<'a> {
    boundaries: &'a [&'a RegionBoundary],
    matching: &'a Matching,
    /// Index of each region's first edge among all.
    first: Vec<usize>,
    /// The edge before each edge.
    previous: Vec<Vec<u32>>,
    /// Union-find over the first vertices of all edges.
    parent: Vec<usize>,
    /// For each root of the union-find whether its vertex is a corner.
    is_corner: Vec<bool>,
}

impl<'a> Tracer<'a> {
    fn new(boundaries: &'a [&'a RegionBoundary], matching: &'a Matching, sketches: &[BoundarySketch]) -> Self {
        let first = firsts(boundaries, |boundary| boundary.edges.len());
        let total = boundaries.iter().map(|boundary| boundary.edges.len()).sum();
        let previous = boundaries.iter().map(|boundary| boundary.previous()).collect();
        let (parent, is_corner) = ((0..total).collect(), vec![false; total]);
        let mut tracer = Self { boundaries, matching, first, previous, parent, is_corner };
        for id in tracer.edge_ids() {
            if let Some(partner) = tracer.partner(id) {
                tracer.unite(id, tracer.next(partner));
                tracer.unite(tracer.next(id), partner);
            }
        }
        for id in tracer.edge_ids() {
            let natural = sketches[id.0 as usize].corners[id.1 as usize];
            if tracer.breaks(id) || natural && tracer.is_on_seam(id) {
                tracer.mark(id);
            }
        }
        tracer
    }

    fn edge_ids(&self) -> impl Iterator<Item = EdgeId> + use<> {
        let counts: Vec<u32> = self.boundaries.iter().map(|boundary| boundary.edges.len() as u32).collect();
        (0..).zip(counts).flat_map(|(region, count)| (0..count).map(move |index| (region, index)))
    }

    fn partner(&self, (region, index): EdgeId) -> Option<EdgeId> {
        self.matching.partners[region as usize][index as usize]
    }

    fn next(&self, (region, index): EdgeId) -> EdgeId {
        (region, self.boundaries[region as usize].edges[index as usize].next)
    }

    fn previous(&self, (region, index): EdgeId) -> EdgeId {
        (region, self.previous[region as usize][index as usize])
    }

    /// The index of an edge among those of all regions.
    fn index(&self, (region, index): EdgeId) -> usize {
        self.first[region as usize] + index as usize
    }

    fn find(&self, mut vertex: usize) -> usize {
        while self.parent[vertex] != vertex {
            vertex = self.parent[vertex];
        }
        vertex
    }

    fn unite(&mut self, a: EdgeId, b: EdgeId) {
        let (a, b) = (self.find(self.index(a)), self.find(self.index(b)));
        let (low, high) = (a.min(b), a.max(b));
        self.parent[high] = low;
    }

    /// Makes the first vertex of an edge a corner, on all sides.
    fn mark(&mut self, id: EdgeId) {
        let root = self.find(self.index(id));
        self.is_corner[root] = true;
    }

    fn is_corner(&self, id: EdgeId) -> bool {
        self.is_corner[self.find(self.index(id))]
    }

    /// Whether a boundary edge at the first vertex of this edge is on a seam.
    fn is_on_seam(&self, id: EdgeId) -> bool {
        self.partner(id).is_some() || self.partner(self.previous(id)).is_some()
    }

    /// Whether seams have to end at the first vertex of an edge.
    fn breaks(&self, id: EdgeId) -> bool {
        match (self.partner(self.previous(id)), self.partner(id)) {
            (None, None) => false,
            (Some(before), Some(after)) => before.0 != after.0 || self.next(after) != before,
            _ => true,
        }
    }

    /// Whether the edge stands for a seam: that of the region with the smaller number does.
    fn leads(&self, id: EdgeId) -> bool {
        self.partner(id).is_some_and(|partner| id.0 < partner.0)
    }

    /// Closed seams without a corner get three; those that end at the corner where they begin get one more; long ones
    /// get as many as they need.
    fn mark_closed(&mut self) {
        let mut seen = vec![false; self.parent.len()];
        for from_corner in [true, false] {
            for start in self.edge_ids() {
                if seen[self.index(start)] || !self.leads(start) || from_corner && !self.is_corner(start) {
                    continue;
                }
                let mut chain = vec![];
                let mut id = start;
                while !seen[self.index(id)] {
                    seen[self.index(id)] = true;
                    chain.push(id);
                    id = self.next(id);
                    if self.is_corner(id) {
                        break;
                    }
                }
                if !from_corner {
                    let count = LEAST_SIDES.min(chain.len());
                    (0..count).for_each(|corner| self.mark(chain[corner * chain.len() / count]));
                }
                let [begin, end] = [start, id].map(|id| self.find(self.index(id)));
                if from_corner && begin == end {
                    self.mark(chain[chain.len() / 2]);
                }
                let long = chain.len() / MAX_EDGES;
                (1..=long).for_each(|corner| self.mark(chain[corner * chain.len() / (long + 1)]));
            }
        }
    }

    /// Loops with too few sides get corners on their seams where they cannot be divided elsewhere.
    fn mark_poor_loops(&mut self, sketches: &[BoundarySketch]) {
        for (region, sketch) in (0..).zip(sketches) {
            for sketch in &sketch.loops {
                let free = sketch.inner_vertices as usize + self.open_vertices(region, sketch);
                while self.side_count(region, sketch) + free < LEAST_SIDES {
                    let Some(id) = self.middle_of_longest_run(region, sketch) else { break };
                    self.mark(id);
                }
            }
        }
    }

    /// Vertices between two boundary edges of the loop that are not on a seam.
    fn open_vertices(&self, region: u32, sketch: &LoopSketch) -> usize {
        let inside = |&index: &u32| {
            let id = (region, index);
            let follows = sketch.edges.contains(&self.previous(id).1);
            follows && !self.is_on_seam(id)
        };
        if sketch.edges.len() <= 2 * LEAST_SIDES { sketch.edges.iter().filter(|i| inside(i)).count() } else { 0 }
    }

    fn side_count(&self, region: u32, sketch: &LoopSketch) -> usize {
        let starts = sketch.edges.iter().filter(|&&index| self.is_corner((region, index))).count();
        starts + sketch.leaves.iter().filter(|&&leaves| leaves).count() + sketch.inner_corners as usize
    }

    /// The middle edge of the longest run of seam edges between corners.
    fn middle_of_longest_run(&self, region: u32, sketch: &LoopSketch) -> Option<EdgeId> {
        let mut best: Option<(usize, u32)> = None;
        let mut run: Vec<u32> = vec![];
        let mut end_run = |run: &mut Vec<u32>| {
            if run.len() > 1 && best.is_none_or(|(length, _)| run.len() > length) {
                best = Some((run.len(), run[run.len() / 2]));
            }
            run.clear();
        };
        for (&index, &leaves) in sketch.edges.iter().zip(&sketch.leaves) {
            let id = (region, index);
            if self.is_corner(id) || self.partner(id).is_none() {
                end_run(&mut run);
            }
            if self.partner(id).is_some() {
                run.push(index);
            }
            if leaves {
                end_run(&mut run);
            }
        }
        end_run(&mut run);
        best.map(|(_, index)| (region, index))
    }

    fn trace(&self) -> Vec<Seams> {
        let mut seams = vec![Seams::default(); self.boundaries.len()];
        // The number of each corner, and the first region that has it.
        let mut corner_numbers: BTreeMap<usize, (u32, u32)> = BTreeMap::new();
        for id in self.edge_ids().filter(|&id| self.is_on_seam(id)) {
            let edge = &self.boundaries[id.0 as usize].edges[id.1 as usize];
            if self.partner(id).is_some() {
                seams[id.0 as usize].half_edges.push(edge.half_edge);
            }
            let root = self.find(self.index(id));
            if self.is_corner[root] {
                let next = corner_numbers.len() as u32;
                let (number, first) = *corner_numbers.entry(root).or_insert((next, id.0));
                let corner = SeamCorner { vertex: edge.vertices[0], number, is_first: first == id.0 };
                seams[id.0 as usize].corners.push(corner);
            }
        }
        let starts = self.edge_ids().filter(|&id| self.leads(id) && self.is_corner(id));
        for (seam, start) in (0..).zip(starts) {
            let mut last = start;
            while !self.is_corner(self.next(last)) {
                last = self.next(last);
            }
            let other = self.partner(last).unwrap_or(last);
            for (id, reversed) in [(start, false), (other, true)] {
                let half_edge = self.boundaries[id.0 as usize].edges[id.1 as usize].half_edge;
                seams[id.0 as usize].starts.push(SeamStart { half_edge, seam, reversed });
            }
        }
        for region in &mut seams {
            region.corners.sort_unstable();
            region.half_edges.sort_unstable();
            region.starts.sort_unstable();
        }
        seams
    }
}
