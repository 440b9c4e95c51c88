//! Which boundary edges of different regions are the same edge, and which components have to be reversed so that
//! windings agree.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::boundary::{BoundaryEdge, PositionKey, RegionBoundary};
use lodpack_stage::repair::{MAX_MATCHED, RepairReport, best_pairs};

/// A boundary edge: its region, and its index in the region's boundary.
pub type EdgeId = (u32, u32);

/// The result of matching the boundaries of all regions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Matching {
    /// For each region and edge the edge on the other side; none where the surface ends.
    pub partners: Vec<Vec<Option<EdgeId>>>,
    /// For each region and connected component whether its winding has to be reversed.
    pub reversed: Vec<Vec<bool>>,
    /// Edges left open because no winding is consistent across them.
    pub unorientable_edges: u64,
    /// Edges at which more than two boundary edges meet.
    pub nonmanifold_edges: u64,
    /// Connected components of the whole surface.
    pub components: u64,
}

/// Joins boundary edges of different regions that have the same two ends and are of one object. Where there are more
/// than two, pairs of opposite direction come first, and among these the flattest, as in repair.
pub fn match_boundaries(boundaries: &[&RegionBoundary]) -> Matching {
    let mut entries: Vec<(([PositionKey; 2], u32), EdgeId)> = vec![];
    for (region, boundary) in (0..).zip(boundaries) {
        entries.extend((0..).zip(&boundary.edges).map(|(index, edge)| ((edge.key(), edge.object), (region, index))));
    }
    entries.par_sort_unstable();
    let mut matching = Matching {
        partners: boundaries.iter().map(|boundary| vec![None; boundary.edges.len()]).collect(),
        ..Matching::default()
    };
    let mut pairs: Vec<[EdgeId; 2]> = vec![];
    for run in entries.chunk_by(|a, b| a.0 == b.0) {
        let region = run[0].1.0;
        if run.iter().all(|(_, (other, _))| *other == region) {
            // Nothing is joined. The edge counts where a triangle of another region could lie at it.
            let can_touch = |(other, boundary): (u32, &&RegionBoundary)| {
                other != region && boundary.can_touch(edge_of(boundaries, run[0].1))
            };
            let counts = run.len() > 2 && (0..).zip(boundaries).any(can_touch);
            matching.nonmanifold_edges += u64::from(counts);
            continue;
        }
        // Nearly all edges: one triangle on each side.
        if let [(_, a), (_, b)] = run {
            pairs.push([*a, *b]);
            continue;
        }
        matching.nonmanifold_edges += u64::from(run.len() > 2);
        let run: Vec<EdgeId> = run.iter().map(|entry| entry.1).take(MAX_MATCHED).collect();
        let fit = |i: usize, j: usize| {
            let (a, b) = (edge_of(boundaries, run[i]), edge_of(boundaries, run[j]));
            (run[i].0 != run[j].0).then(|| (is_opposite(a, b), a.normal.dot(b.normal)))
        };
        pairs.extend(best_pairs(run.len(), fit).into_iter().map(|pair| pair.map(|index| run[index])));
    }
    matching.orient(boundaries, pairs);
    matching
}

fn edge_of<'a>(boundaries: &[&'a RegionBoundary], (region, index): EdgeId) -> &'a BoundaryEdge {
    &boundaries[region as usize].edges[index as usize]
}

/// For each region, how many of something the regions before it have together.
pub(super) fn firsts(boundaries: &[&RegionBoundary], count: impl Fn(&RegionBoundary) -> usize) -> Vec<usize> {
    let mut next = 0;
    let first = |&boundary: &&RegionBoundary| {
        next += count(boundary);
        next - count(boundary)
    };
    boundaries.iter().map(first).collect()
}

fn is_opposite(a: &BoundaryEdge, b: &BoundaryEdge) -> bool {
    a.positions[0] == b.positions[1]
}

impl Matching {
    /// How many vertices of regions the whole surface does not have, because joined edges share their ends. It has to
    /// be called before components are reversed.
    pub fn doubled_vertices(&self, boundaries: &[&RegionBoundary]) -> u64 {
        // Every boundary vertex is the first vertex of exactly one edge, which stands for it.
        let first_edge = firsts(boundaries, |boundary| boundary.edges.len());
        let start = |(region, index): EdgeId| first_edge[region as usize] + index as usize;
        let end = |id: EdgeId| start((id.0, edge_of(boundaries, id).next));
        let mut vertices = Orientations::new(boundaries.iter().map(|boundary| boundary.edges.len()).sum());
        let mut doubled = 0;
        for (region, partners) in (0..).zip(&self.partners) {
            for (a, b) in (0..).zip(partners).filter_map(|(index, &partner)| Some(((region, index), partner?))) {
                let [start_b, end_b] = match is_opposite(edge_of(boundaries, a), edge_of(boundaries, b)) {
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

    /// Corrects the reports of single regions, for which seams were boundaries of the surface.
    pub fn report(&self, repairs: &mut RepairReport) {
        let joined = self.partners.iter().flatten().flatten().count() as u64;
        repairs.boundary_edges -= joined;
        repairs.components = self.components;
        repairs.unorientable_edges_cut += self.unorientable_edges;
        repairs.nonmanifold_edges_cut += self.nonmanifold_edges;
    }

    /// Joins pairs of edges and decides which components to reverse. The winding with more area wins; a pair that
    /// contradicts earlier ones stays open.
    fn orient(&mut self, boundaries: &[&RegionBoundary], mut pairs: Vec<[EdgeId; 2]>) {
        pairs.sort_unstable();
        let first_component = firsts(boundaries, |boundary| boundary.component_areas.len());
        let areas: Vec<f64> = boundaries.iter().flat_map(|boundary| boundary.component_areas.iter().copied()).collect();
        let component = |id: EdgeId| first_component[id.0 as usize] + edge_of(boundaries, id).component as usize;
        let mut components = Orientations::new(areas.len());
        for [a, b] in pairs {
            let differ = !is_opposite(edge_of(boundaries, a), edge_of(boundaries, b));
            if components.join(component(a), component(b), differ) {
                self.partners[a.0 as usize][a.1 as usize] = Some(b);
                self.partners[b.0 as usize][b.1 as usize] = Some(a);
            } else {
                self.unorientable_edges += 1;
            }
        }
        // For each set of joined components the area of either winding.
        self.components = (0..areas.len()).filter(|&member| components.parent[member] == member).count() as u64;
        let mut sides = vec![[0.0; 2]; areas.len()];
        let found: Vec<(usize, bool)> = (0..areas.len()).map(|member| components.find(member)).collect();
        for (&(root, turned), area) in found.iter().zip(&areas) {
            sides[root][usize::from(turned)] += area;
        }
        let reversed: Vec<bool> =
            found.iter().map(|&(root, turned)| turned != (sides[root][1] > sides[root][0])).collect();
        let count = |region: usize| boundaries[region].component_areas.len();
        self.reversed = (0..boundaries.len())
            .map(|region| reversed[first_component[region]..first_component[region] + count(region)].to_vec())
            .collect();
    }
}

/// Union-find whose members each have the winding of their root or the opposite one.
struct Orientations {
    parent: Vec<usize>,
    reversed: Vec<bool>,
}

impl Orientations {
    fn new(count: usize) -> Self {
        Self { parent: (0..count).collect(), reversed: vec![false; count] }
    }

    fn find(&self, mut member: usize) -> (usize, bool) {
        let mut turned = false;
        while self.parent[member] != member {
            turned ^= self.reversed[member];
            member = self.parent[member];
        }
        (member, turned)
    }

    /// Joins two members whose windings have to differ, or not; returns whether earlier ones allow that.
    fn join(&mut self, a: usize, b: usize, differ: bool) -> bool {
        let ((root_a, turned_a), (root_b, turned_b)) = (self.find(a), self.find(b));
        // Shortens the path of the next search.
        for (member, root, turned) in [(a, root_a, turned_a), (b, root_b, turned_b)] {
            if member != root {
                (self.parent[member], self.reversed[member]) = (root, turned);
            }
        }
        let wanted = turned_a ^ turned_b ^ differ;
        if root_a == root_b {
            return !wanted;
        }
        let (low, high) = (root_a.min(root_b), root_a.max(root_b));
        (self.parent[high], self.reversed[high]) = (low, wanted);
        true
    }
}
