//! Which boundary edges of regions are one edge of the surface, and which pieces of regions have to turn over for that.

use super::border::{Border, BorderEdge};
use crate::stage::repair::{MAX_MATCHED, RepairReport, best_pairs};

/// A boundary edge of some region: the region, and the index in its border.
pub type EdgeId = (u32, u32);

/// The result of laying all borders side by side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Matching {
    /// For each region and edge the edge on the other side; none where the surface ends.
    pub partners: Vec<Vec<Option<EdgeId>>>,
    /// For each region and connected piece whether its winding is to be reversed.
    pub reversed: Vec<Vec<bool>>,
    /// Edges left open because no winding is consistent across them.
    pub unorientable_edges: u64,
    /// Edges that more than two regions have.
    pub nonmanifold_edges: u64,
    /// Pieces of the whole surface that no edge connects.
    pub components: u64,
}

/// Joins the boundary edges of different regions that have the same two ends. Where more than two have, pairs of opposite
/// direction go first, and of these the flattest, as in repair.
pub fn match_borders(borders: &[&Border]) -> Matching {
    let mut entries = vec![];
    for (region, border) in (0..).zip(borders) {
        for (index, edge) in (0..).zip(&border.edges) {
            let mut others = (0u32..).zip(borders).filter(|&(other, _)| other != region);
            if others.any(|(_, other)| other.can_touch(edge)) {
                entries.push((edge.key(), (region, index)));
            }
        }
    }
    entries.sort_unstable();
    let mut matching = Matching {
        partners: borders.iter().map(|border| vec![None; border.edges.len()]).collect(),
        ..Matching::default()
    };
    let mut pairs: Vec<[EdgeId; 2]> = vec![];
    for run in entries.chunk_by(|a, b| a.0 == b.0) {
        matching.nonmanifold_edges += u64::from(run.len() > 2);
        let run: Vec<EdgeId> = run.iter().map(|entry| entry.1).take(MAX_MATCHED).collect();
        let fit = |i: usize, j: usize| {
            let (a, b) = (edge_of(borders, run[i]), edge_of(borders, run[j]));
            (run[i].0 != run[j].0).then(|| (is_opposite(a, b), a.normal.dot(b.normal)))
        };
        pairs.extend(best_pairs(run.len(), fit).into_iter().map(|pair| pair.map(|place| run[place])));
    }
    matching.turn(borders, pairs);
    matching
}

fn edge_of<'a>(borders: &[&'a Border], (region, index): EdgeId) -> &'a BorderEdge {
    &borders[region as usize].edges[index as usize]
}

/// The number of each region's first thing, where those of all are counted one after the other.
fn firsts(borders: &[&Border], count: impl Fn(&Border) -> usize) -> Vec<usize> {
    let mut next = 0;
    let first = |&border: &&Border| {
        next += count(border);
        next - count(border)
    };
    borders.iter().map(first).collect()
}

fn is_opposite(a: &BorderEdge, b: &BorderEdge) -> bool {
    a.positions[0] == b.positions[1]
}

impl Matching {
    /// How many vertices of regions are no vertices of the whole surface, because another one is the same: where edges are joined,
    /// so are their ends. Asked before anything is turned over.
    pub fn doubled_vertices(&self, borders: &[&Border]) -> u64 {
        // Every boundary vertex is the first vertex of exactly one edge, which stands for it.
        let first_edge = firsts(borders, |border| border.edges.len());
        let start = |(region, index): EdgeId| first_edge[region as usize] + index as usize;
        let end = |id: EdgeId| start((id.0, edge_of(borders, id).next));
        let mut vertices = Orientations::new(borders.iter().map(|border| border.edges.len()).sum());
        let mut doubled = 0;
        for (region, partners) in (0..).zip(&self.partners) {
            for (a, b) in (0..).zip(partners).filter_map(|(index, &partner)| Some(((region, index), partner?))) {
                let [start_b, end_b] = match is_opposite(edge_of(borders, a), edge_of(borders, b)) {
                    true => [end(b), start(b)],
                    false => [start(b), end(b)],
                };
                for (one, other) in [(start(a), start_b), (end(a), end_b)] {
                    doubled += u64::from(vertices.find(one).0 != vertices.find(other).0);
                    vertices.join(one, other, false);
                }
            }
        }
        doubled
    }

    /// Corrects what the repair of single regions took for the surface's end.
    pub fn report(&self, repairs: &mut RepairReport) {
        let joined = self.partners.iter().flatten().flatten().count() as u64;
        repairs.boundary_edges -= joined;
        repairs.components = self.components;
        repairs.unorientable_edges_cut += self.unorientable_edges;
        repairs.nonmanifold_edges_cut += self.nonmanifold_edges;
    }

    /// Finds which pieces to reverse; pairs that contradict earlier ones stay open. The winding with more area wins.
    fn turn(&mut self, borders: &[&Border], mut pairs: Vec<[EdgeId; 2]>) {
        pairs.sort_unstable();
        let first_piece = firsts(borders, |border| border.component_areas.len());
        let areas: Vec<f64> = borders.iter().flat_map(|border| border.component_areas.iter().copied()).collect();
        let piece = |id: EdgeId| first_piece[id.0 as usize] + edge_of(borders, id).component as usize;
        let mut pieces = Orientations::new(areas.len());
        for [a, b] in pairs {
            let differ = !is_opposite(edge_of(borders, a), edge_of(borders, b));
            if pieces.join(piece(a), piece(b), differ) {
                self.partners[a.0 as usize][a.1 as usize] = Some(b);
                self.partners[b.0 as usize][b.1 as usize] = Some(a);
            } else {
                self.unorientable_edges += 1;
            }
        }
        // Area by winding for each set of pieces.
        self.components = (0..areas.len()).filter(|&piece| pieces.parent[piece] == piece).count() as u64;
        let mut sides = vec![[0.0; 2]; areas.len()];
        let found: Vec<(usize, bool)> = (0..areas.len()).map(|piece| pieces.find(piece)).collect();
        for (&(root, turned), area) in found.iter().zip(&areas) {
            sides[root][usize::from(turned)] += area;
        }
        let reversed: Vec<bool> =
            found.iter().map(|&(root, turned)| turned != (sides[root][1] > sides[root][0])).collect();
        let count = |region: usize| borders[region].component_areas.len();
        self.reversed = (0..borders.len())
            .map(|region| reversed[first_piece[region]..first_piece[region] + count(region)].to_vec())
            .collect();
    }
}

/// Union-find whose members are turned over, or not, against their root.
struct Orientations {
    parent: Vec<usize>,
    turned: Vec<bool>,
}

impl Orientations {
    fn new(count: usize) -> Self {
        Self { parent: (0..count).collect(), turned: vec![false; count] }
    }

    fn find(&self, mut piece: usize) -> (usize, bool) {
        let mut turned = false;
        while self.parent[piece] != piece {
            turned ^= self.turned[piece];
            piece = self.parent[piece];
        }
        (piece, turned)
    }

    /// Whether the two can be turned so.
    fn join(&mut self, a: usize, b: usize, differ: bool) -> bool {
        let ((root_a, turned_a), (root_b, turned_b)) = (self.find(a), self.find(b));
        // Short ways for the next search.
        for (piece, root, turned) in [(a, root_a, turned_a), (b, root_b, turned_b)] {
            if piece != root {
                (self.parent[piece], self.turned[piece]) = (root, turned);
            }
        }
        let wanted = turned_a ^ turned_b ^ differ;
        if root_a == root_b {
            return !wanted;
        }
        let (low, high) = (root_a.min(root_b), root_a.max(root_b));
        (self.parent[high], self.turned[high]) = (low, wanted);
        true
    }
}
