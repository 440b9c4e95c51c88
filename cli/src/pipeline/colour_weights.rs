//! Another collapse of a cut, with more weight where the last one shows wrong colours.
//!
//! Nearly all that a reduced cut shows wrongly is in few places: a thousandth of the points have half of it. There two parts of the surface lie
//! close together, or a corner is gone, and the closest point belongs to what looks otherwise. A few triangles more in these places cost the others next
//! to nothing.

use std::collections::BTreeSet;

use glam::DVec3;
use lodpack::Lattice;

use super::coarse::{CoarseSurface, collapsed_in_areas};
use super::far_weights::raise;
use super::finish::{Finished, local_surface};
use super::reduce::{ALL_STOPS, Reduced, Topology, areas_of_chart, differing_stops};
use super::shown_colours::Difference;
use crate::mesh::Mesh;
use crate::stage::areas::{Areas, Jumps};
use crate::stage::certify::{CertifyOptions, Hint, TriangleBvh, two_sided};
use crate::stage::chart::ChartMesh;

/// How often a cut is collapsed again at most,
const MOST_ROUNDS: usize = 12;
/// and how often in a row if it does not become better.
const PATIENCE: usize = 4;
/// The share of the squared difference of colours that the worst points have together.
const WORST: f64 = 0.3;
/// Factor on the quadrics of vertices around these, with every round.
const STEP: f32 = 30.0;

/// A cut that is collapsed again and again.
pub(super) struct Recollapse<'a> {
    surface: CoarseSurface,
    chart: ChartMesh,
    of_chart: TriangleBvh,
    /// The areas of the chart's triangles, if colours jump between some.
    areas: Option<(Vec<u32>, &'a Jumps)>,
    triangles: usize,
    lattice: &'a Lattice,
}

impl<'a> Recollapse<'a> {
    /// Of a cut as [`finished_ways`](super::finish::finished_ways) takes it. None if it is no manifold.
    pub fn new(
        positions: &[[f64; 3]],
        triangles: &[[u32; 3]],
        error: f64,
        areas: Option<Areas<'a>>,
        lattice: &'a Lattice,
        most_triangles: usize,
    ) -> Option<Self> {
        let surface = local_surface(positions, triangles, error, lattice);
        let mut chart = surface.chart()?;
        chart.free_border();
        let whole = Mesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
        Some(Self {
            areas: areas.map(|areas| (areas_of_chart(&whole, areas, &chart), areas.jumps)),
            of_chart: TriangleBvh::new(&chart.positions, &chart.triangles),
            triangles: most_triangles,
            surface,
            chart,
            lattice,
        })
    }

    /// A reduced cut, or a better one that is made in the same way with other weights. `difference` says how far off colours are, and `value` how bad that is.
    pub fn better(
        &self,
        first: Finished,
        difference: impl Fn(&Finished) -> Option<Difference>,
        value: impl Fn(&Difference, &Finished) -> f64,
    ) -> Finished {
        let has_lines = !first.areas.is_empty();
        let mut weights = vec![1.0; self.chart.positions.len()];
        let all_stops = differing_stops(&ALL_STOPS, self.chart.triangles.len(), self.triangles);
        let is_first = |way: Finished| way.positions == first.positions && way.triangles == first.triangles;
        let is_way = |stops: &Vec<f64>| self.collapsed(stops, has_lines, &weights).is_some_and(is_first);
        let Some(stops) = all_stops.into_iter().find(is_way) else { return first };
        let Some(mut last) = difference(&first) else { return first };
        let (mut least, mut best, mut failed) = (value(&last, &first), first, 0);
        for _ in 0..MOST_ROUNDS {
            self.raise(&mut weights, &last.worst(WORST));
            let Some(way) = self.collapsed(&stops, has_lines, &weights) else { break };
            let Some(of_way) = difference(&way) else { break };
            let now = value(&of_way, &way);
            last = of_way;
            if now < least {
                (least, best, failed) = (now, way, 0);
            } else {
                failed += 1;
            }
            if failed == PATIENCE {
                break;
            }
        }
        best
    }

    fn collapsed(&self, stops: &[f64], has_lines: bool, weights: &[f32]) -> Option<Finished> {
        let areas = self.areas.as_ref().filter(|_| has_lines);
        let areas = areas.and_then(|(of_triangles, jumps)| Areas::of(of_triangles, Some(jumps)));
        let (mesh, areas) = collapsed_in_areas(&self.chart, areas, self.triangles, stops, Some(weights))?;
        let Mesh { positions, triangles } = mesh;
        if triangles.is_empty() || triangles.len() > self.triangles {
            return None;
        }
        let drawn = TriangleBvh::new(&positions, &triangles);
        let error = self.surface.error_at(two_sided(&self.of_chart, &drawn, &CertifyOptions::default()).upper);
        let surface = CoarseSurface { positions, triangles, error };
        Some(Finished::new(Reduced { surface, topology: Topology::Kept, areas }, self.lattice))
    }

    /// Raises the weights around points, which are world coordinates.
    fn raise(&self, weights: &mut [f32], points: &[DVec3]) {
        let (origin, mut hint) = (DVec3::from_array(self.lattice.origin), Hint::default());
        let mut corners = |point: &DVec3| {
            let closest = self.of_chart.closest(point - origin, &mut hint);
            self.chart.triangles[closest.triangle as usize]
        };
        let vertices: BTreeSet<u32> = points.iter().flat_map(&mut corners).collect();
        raise(weights, &vertices, STEP);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of hills, as many along both sides.
    fn hills(lattice: &Lattice) -> Mesh {
        let side = 33;
        let hill = |x: u32, y: u32| (f64::from(x) * 0.8).sin() * (f64::from(y) * 0.8).sin();
        let on_lattice = |p: [f64; 3]| DVec3::from(lattice.world(lattice.units(p).map(|x| x.round() as i64)));
        let point = |v: u32| on_lattice([f64::from(v % side), f64::from(v / side), hill(v % side, v / side)]);
        let cells = (0..side * (side - 1)).filter(|v| v % side + 1 < side);
        let triangles = cells.flat_map(|v| [[v, v + 1, v + side], [v + 1, v + side + 1, v + side]]).collect();
        Mesh { positions: (0..side * side).map(point).collect(), triangles }
    }

    #[test]
    fn where_colours_are_wrong_there_are_more_triangles_afterwards() {
        let lattice = Lattice { origin: [100.0, 0.0, 0.0], step_log2: -10 };
        let Mesh { positions, triangles } = hills(&lattice);
        let positions: Vec<[f64; 3]> = positions.iter().map(|point| point.to_array()).collect();
        let recollapse = Recollapse::new(&positions, &triangles, 0.0, None, &lattice, 300).expect("a manifold");
        let uniform = vec![1.0; positions.len()];
        let stops = differing_stops(&ALL_STOPS, triangles.len(), 300);
        let first = recollapse.collapsed(&stops[0], false, &uniform).expect("possible");
        let place = DVec3::new(8.0, 8.0, 0.5);
        let around = |way: &Finished| {
            let is_near = |point: &&[f64; 3]| DVec3::from(**point).distance(place) < 5.0;
            way.positions.iter().filter(is_near).count()
        };
        let off = |way: &Finished| 1000.0 - around(way) as f64;
        let difference = |way: &Finished| Some(Difference::of(vec![(place, off(way)), (DVec3::splat(20.0), 1.0)]));
        let better = recollapse.better(first.clone(), difference, |difference, _| difference.mean());
        assert!(around(&better) > around(&first), "{} and {}", around(&better), around(&first));
        assert!(better.triangles.len() <= 300);
        // What was made otherwise stays.
        let mut other = first;
        other.triangles.pop();
        assert_eq!(recollapse.better(other.clone(), difference, |difference, _| difference.mean()), other);
    }
}
