//! Seams: the arcs between regions. Both sides have to end them at the same corners, whatever their charts are.

use std::collections::BTreeMap;

use crate::stage::arcs::{SeamCorner, SeamStart, Seams};

use super::border::Border;
use super::matching::{EdgeId, Matching};
use super::sketch::{BorderSketch, LoopSketch};

/// Edges of a seam after which it gets a corner, so that every vertex can be a sample.
const MAX_EDGES: usize = 4096;
/// Half-arcs that a loop has at least, where it has as many edges.
const LEAST_SIDES: usize = 3;

/// Finds the corners of all seams and numbers these. `borders` are those that were matched, after turning.
pub fn find_seams(borders: &[&Border], matching: &Matching, sketches: &[BorderSketch]) -> Vec<Seams> {
    let mut tracer = Tracer::new(borders, matching, sketches);
    tracer.mark_closed();
    tracer.mark_poor_loops(sketches);
    tracer.trace()
}

struct Tracer<'a> {
    borders: &'a [&'a Border],
    matching: &'a Matching,
    /// Index of each region's first edge among all.
    first: Vec<usize>,
    /// The edge before each edge.
    previous: Vec<Vec<u32>>,
    /// Union-find over the first vertices of all edges.
    parent: Vec<usize>,
    /// For each root whether it is a corner.
    is_corner: Vec<bool>,
}

impl<'a> Tracer<'a> {
    fn new(borders: &'a [&'a Border], matching: &'a Matching, sketches: &[BorderSketch]) -> Self {
        let mut total = 0;
        let mut first = vec![];
        for border in borders {
            first.push(total);
            total += border.edges.len();
        }
        let previous = borders
            .iter()
            .map(|border| {
                let mut previous = vec![0; border.edges.len()];
                border.edges.iter().zip(0..).for_each(|(edge, index)| previous[edge.next as usize] = index);
                previous
            })
            .collect();
        let mut tracer =
            Self { borders, matching, first, previous, parent: (0..total).collect(), is_corner: vec![false; total] };
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
        let counts: Vec<u32> = self.borders.iter().map(|border| border.edges.len() as u32).collect();
        (0..).zip(counts).flat_map(|(region, count)| (0..count).map(move |index| (region, index)))
    }

    fn partner(&self, (region, index): EdgeId) -> Option<EdgeId> {
        self.matching.partners[region as usize][index as usize]
    }

    fn next(&self, (region, index): EdgeId) -> EdgeId {
        (region, self.borders[region as usize].edges[index as usize].next)
    }

    fn previous(&self, (region, index): EdgeId) -> EdgeId {
        (region, self.previous[region as usize][index as usize])
    }

    fn place(&self, (region, index): EdgeId) -> usize {
        self.first[region as usize] + index as usize
    }

    fn find(&self, mut place: usize) -> usize {
        while self.parent[place] != place {
            place = self.parent[place];
        }
        place
    }

    fn unite(&mut self, a: EdgeId, b: EdgeId) {
        let (a, b) = (self.find(self.place(a)), self.find(self.place(b)));
        let (low, high) = (a.min(b), a.max(b));
        self.parent[high] = low;
    }

    /// Makes the first vertex of an edge a corner, on all sides.
    fn mark(&mut self, id: EdgeId) {
        let root = self.find(self.place(id));
        self.is_corner[root] = true;
    }

    fn is_corner(&self, id: EdgeId) -> bool {
        self.is_corner[self.find(self.place(id))]
    }

    /// Whether an edge at the first vertex of this edge is on a seam.
    fn is_on_seam(&self, id: EdgeId) -> bool {
        self.partner(id).is_some() || self.partner(self.previous(id)).is_some()
    }

    /// Whether no seam can go on through the first vertex of an edge.
    fn breaks(&self, id: EdgeId) -> bool {
        match (self.partner(self.previous(id)), self.partner(id)) {
            (None, None) => false,
            (Some(before), Some(after)) => before.0 != after.0 || self.next(after) != before,
            _ => true,
        }
    }

    /// An edge of the region with the smaller number stands for the seam.
    fn leads(&self, id: EdgeId) -> bool {
        self.partner(id).is_some_and(|partner| id.0 < partner.0)
    }

    /// Seams that run round get three corners, or one more where they end at the corner that they begin with.
    fn mark_closed(&mut self) {
        let mut seen = vec![false; self.parent.len()];
        for from_corner in [true, false] {
            for start in self.edge_ids() {
                if seen[self.place(start)] || !self.leads(start) || from_corner && !self.is_corner(start) {
                    continue;
                }
                let mut chain = vec![];
                let mut id = start;
                while !seen[self.place(id)] {
                    seen[self.place(id)] = true;
                    chain.push(id);
                    id = self.next(id);
                    if self.is_corner(id) {
                        break;
                    }
                }
                if !from_corner {
                    let pieces = LEAST_SIDES.min(chain.len());
                    (0..pieces).for_each(|piece| self.mark(chain[piece * chain.len() / pieces]));
                }
                let [begin, end] = [start, id].map(|id| self.find(self.place(id)));
                if from_corner && begin == end {
                    self.mark(chain[chain.len() / 2]);
                }
                let long = chain.len() / MAX_EDGES;
                (1..=long).for_each(|piece| self.mark(chain[piece * chain.len() / (long + 1)]));
            }
        }
    }

    /// Loops that would have too few sides get corners on their seams, if they cannot be divided elsewhere.
    fn mark_poor_loops(&mut self, sketches: &[BorderSketch]) {
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

    /// Vertices between two edges of the loop on the border that is no seam.
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

    /// The middle of the longest run of seam edges between corners.
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
        let mut seams = vec![Seams::default(); self.borders.len()];
        // With the first region that has it.
        let mut corner_numbers: BTreeMap<usize, (u32, u32)> = BTreeMap::new();
        for id in self.edge_ids().filter(|&id| self.is_on_seam(id)) {
            let edge = &self.borders[id.0 as usize].edges[id.1 as usize];
            if self.partner(id).is_some() {
                seams[id.0 as usize].half_edges.push(edge.half_edge);
            }
            let root = self.find(self.place(id));
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
                let half_edge = self.borders[id.0 as usize].edges[id.1 as usize].half_edge;
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
