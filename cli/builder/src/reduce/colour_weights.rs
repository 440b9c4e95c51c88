//! Another collapse of a cut, with more weight where the last one shows wrong colours.
//!
//! Nearly all that a reduced cut shows wrongly is in few places: a thousandth of the points have half of it. There two
//! parts of the surface lie close together, or a corner is gone, and the closest point belongs to what looks otherwise.
//! A few triangles more in these places cost the others next to nothing.

use std::collections::BTreeSet;

use glam::DVec3;
use lodpack::Lattice;
use rayon::prelude::*;

use super::cells::{Sampled, Seen};
use super::collapsed::collapsed_in_areas;
use super::far_weights::raise;
use super::finish::{Finished, local_surface};
use super::moved_nearer::{Whole, moved_nearer};
use super::moved_singly::{moved_again, moved_singly};
use super::surface::CoarseSurface;
use super::ways::{ALL_STOPS, Reduced, Topology, areas_of_chart, differing_stops};
use lodpack_mesh::Mesh;
use lodpack_stage::areas::{Areas, Jumps};
use lodpack_stage::certify::{CertifyOptions, Hint, TriangleBvh, two_sided};
use lodpack_stage::chart::ChartMesh;

/// The number of cuts that are collapsed again, those that show most first.
const WAYS: usize = 3;
/// A cut that is this many times as bad as the best is not collapsed again.
const WORSE: f64 = 1.4;
/// The most rounds of it.
const MOST_ROUNDS: usize = 12;
/// The most rounds in a row in which no cut becomes better.
const PATIENCE: usize = 4;
/// The share of the squared difference of colours that the worst points have together.
const WORST: f64 = 0.3;
/// Factors on the quadrics of vertices around these. Each round goes on with the best result.
const STEPS: [f32; 2] = [30.0, 5.0];
/// The best of all is collapsed again beside these in each round, with this factor around points that have one of these
/// shares of the squared difference, another one each time that it has not become better.
const STEP_AT_TOP: f32 = 5.0;
const SHARES_AT_TOP: [f64; 4] = [0.15, 0.08, 0.04, 0.5];
/// The number of the best of all that are moved nearer, which takes as long as to collapse and to compare them.
const MOVED: usize = 4;
/// Of a cut with more triangles one way is collapsed again, with one factor, and nothing is moved nearer, which takes
/// long.
const LARGE: usize = 20_000;
/// Vertices of a cut that has at most this many triangles are moved one at a time at last. With more, little is gained
/// for the time that it takes.
const FEW: usize = 200;
/// With at most this many, those of more than the best cut are, and at last those of the best one [again](moved_again).
/// With more, that gains nothing.
const VERY_FEW: usize = 100;
/// The number of these cuts.
const MOVED_SINGLY: usize = 2;

/// A reduced cut, what colours are seen on it, and how bad that is.
pub(super) struct Compared {
    pub way: Finished,
    pub seen: Seen,
    pub value: f64,
}

/// What another round goes on with.
#[derive(Clone)]
struct Last {
    made: Made,
    seen: Seen,
    value: f64,
}

impl Last {
    fn new(made: Made, compared: &Compared) -> Self {
        Self { made, seen: compared.seen.clone(), value: compared.value }
    }
}

/// A cut that is collapsed again and again.
pub(super) struct Recollapse<'a> {
    surface: CoarseSurface,
    chart: ChartMesh,
    /// The triangles of the chart.
    whole: Mesh,
    of_chart: TriangleBvh,
    /// The areas of the chart's triangles, if colours jump between some.
    areas: Option<(Vec<u32>, &'a Jumps)>,
    triangles: usize,
    lattice: &'a Lattice,
}

/// How a reduced cut is made.
#[derive(Clone)]
struct Made {
    /// As [`SimplifyOptions::stops`](lodpack_stage::simplify::SimplifyOptions::stops).
    stops: Vec<f64>,
    has_lines: bool,
    /// Of each vertex of the chart.
    weights: Vec<f32>,
}

impl Made {
    /// Whether another cut is made in the same way, but for weights.
    fn is_way(&self, other: &Self) -> bool {
        self.stops == other.stops && self.has_lines == other.has_lines
    }
}

/// Whether vertices of a cut are moved [again](moved_again).
pub(super) fn has_very_few(way: &Finished) -> bool {
    way.triangles.len() <= VERY_FEW
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
        let areas = areas.map(|areas| (areas_of_chart(&whole, areas, &chart), areas.jumps));
        let whole = Mesh { positions: chart.positions.clone(), triangles: chart.triangles.clone() };
        Some(Self {
            of_chart: TriangleBvh::new(&whole.positions, &whole.triangles),
            triangles: most_triangles,
            areas,
            whole,
            surface,
            chart,
            lattice,
        })
    }

    /// The best of some reduced cuts, which come with the best first, of those that are made in the same ways with
    /// other weights, and of the best of these moved nearer: again with the best first. `compare` says what colours are
    /// seen on a cut.
    pub fn best(&self, firsts: Vec<Compared>, compare: &(impl Fn(Finished) -> Compared + Sync)) -> Vec<Compared> {
        let (ways, steps) = if self.is_large() { (1, &STEPS[..1]) } else { (WAYS, &STEPS[..]) };
        let most = firsts.first().map_or(0.0, |first| WORSE * first.value);
        let mut last: Vec<Last> = vec![];
        for first in firsts.iter().take(ways).take_while(|first| first.value <= most) {
            last.extend(self.made_by(&first.way).map(|made| Last::new(made, first)));
        }
        let mut best = firsts;
        best.truncate(MOVED);
        let mut top = last.first().filter(|_| !self.is_large()).cloned();
        let (mut failed, mut failed_at_top) = (0, 0);
        for _ in 0..MOST_ROUNDS {
            let mut tried: Vec<(&Last, f32, f64)> =
                last.iter().flat_map(|last| steps.iter().map(move |&step| (last, step, WORST))).collect();
            let of_last = tried.len();
            let share = SHARES_AT_TOP[failed_at_top % SHARES_AT_TOP.len()];
            tried.extend(top.iter().map(|top| (top, STEP_AT_TOP, share)));
            let again = |&(last, step, share): &(&Last, f32, f64)| self.again(last, step, share, compare);
            let made: Vec<Option<(Last, Compared)>> = tried.par_iter().map(again).collect();
            let mut all: Vec<(Last, Compared, bool)> = vec![];
            for (number, made) in made.into_iter().enumerate() {
                all.extend(made.map(|(made, compared)| (made, compared, number < of_last)));
            }
            all.sort_by(|(_, one, _), (_, other, _)| one.value.total_cmp(&other.value));
            let least = best.first().map_or(f64::INFINITY, |best| best.value);
            let has_gained = all.first().is_some_and(|(_, first, _)| first.value < least);
            failed = if has_gained { 0 } else { failed + 1 };
            if let Some((made, ..)) =
                all.first().filter(|(made, ..)| top.as_ref().is_some_and(|top| made.value < top.value))
            {
                (top, failed_at_top) = (Some(made.clone()), 0);
            } else {
                failed_at_top += 1;
            }
            // Each way goes on with its best.
            last.clear();
            for (made, compared, is_of_last) in all {
                if is_of_last && last.iter().all(|other| !other.made.is_way(&made.made)) {
                    last.push(made);
                }
                best.push(compared);
            }
            best.sort_by(|one, other| one.value.total_cmp(&other.value));
            best.dedup_by(|one, other| one.way == other.way);
            best.truncate(MOVED);
            if failed == PATIENCE || last.is_empty() {
                break;
            }
        }
        let mut moved: Vec<Compared> = best.into_par_iter().map(|one| self.or_nearer(one, compare)).collect();
        moved.sort_by(|one, other| one.value.total_cmp(&other.value));
        moved
    }

    /// A cut made in the same way, with more weight around the points that have a share of all squares.
    fn again(
        &self,
        last: &Last,
        step: f32,
        share: f64,
        compare: &impl Fn(Finished) -> Compared,
    ) -> Option<(Last, Compared)> {
        let mut made = last.made.clone();
        self.raise(&mut made.weights, &last.seen.worst(share), step);
        let (mesh, areas) = self.collapsed(&made)?;
        let compared = compare(self.finished(mesh, areas));
        Some((Last::new(made, &compared), compared))
    }

    /// How a cut was made, if edge collapse makes it with the same weight everywhere.
    fn made_by(&self, way: &Finished) -> Option<Made> {
        let all_stops = differing_stops(&ALL_STOPS, self.chart.triangles.len(), self.triangles);
        let weights = vec![1.0; self.chart.positions.len()];
        let made = |stops| Made { stops, has_lines: !way.areas.is_empty(), weights: weights.clone() };
        let is_way = |made: &Made| {
            let Some((mesh, areas)) = self.collapsed(made) else { return false };
            let Finished { positions, triangles, .. } = self.finished(mesh, areas);
            positions == way.positions && triangles == way.triangles
        };
        all_stops.into_iter().map(made).find(is_way)
    }

    fn collapsed(&self, Made { stops, has_lines, weights }: &Made) -> Option<(Mesh, Vec<u32>)> {
        let areas = self.areas.as_ref().filter(|_| *has_lines);
        let areas = areas.and_then(|(of_triangles, jumps)| Areas::of(of_triangles, Some(jumps)));
        let collapsed = collapsed_in_areas(&self.chart, areas, self.triangles, stops, Some(weights))?;
        Some(collapsed).filter(|(mesh, _)| !mesh.triangles.is_empty() && mesh.triangles.len() <= self.triangles)
    }

    /// A cut, or the same moved nearer if that is better.
    fn or_nearer(&self, first: Compared, compare: &impl Fn(Finished) -> Compared) -> Compared {
        if self.is_large() {
            return first;
        }
        let moved = moved_nearer(&self.local(&first.way), Whole { mesh: &self.whole, bvh: &self.of_chart });
        self.or_moved(first, moved, compare)
    }

    /// The best of some cuts that come with the best first, and if that one has few triangles, of the first of them
    /// with their vertices
    /// [moved one at a time](moved_singly).
    pub fn best_singly(
        &self,
        all: Vec<Compared>,
        sampled: &Sampled,
        compare: &impl Fn(Finished) -> Compared,
    ) -> Option<Compared> {
        let first = &all.first()?.way;
        if first.triangles.len() > FEW {
            return all.into_iter().next();
        }
        let tries = if has_very_few(first) { MOVED_SINGLY } else { 1 };
        let moved = |first: Compared| match moved_singly(sampled, &self.local(&first.way)) {
            Some(moved) => self.or_moved(first, moved, compare),
            None => first,
        };
        all.into_iter().take(tries).map(moved).min_by(|one, other| one.value.total_cmp(&other.value))
    }

    /// A cut, or if that is better by a finer surface, the same moved [again](moved_again).
    pub fn or_again(&self, first: Compared, finer: &Sampled, compare: &impl Fn(Finished) -> Compared) -> Compared {
        let Some((moved, parts_of)) = moved_again(finer, &self.local(&first.way), self.triangles) else { return first };
        let areas = parts_of.iter().filter_map(|&t| first.way.areas.get(t as usize).copied()).collect();
        self.or_better(first, moved, areas, compare)
    }

    /// A cut, or the same with its vertices where they are in a mesh, if that is better.
    fn or_moved(&self, first: Compared, moved: Mesh, compare: &impl Fn(Finished) -> Compared) -> Compared {
        let areas = first.way.areas.clone();
        self.or_better(first, moved, areas, compare)
    }

    /// A cut, or a mesh that was made of it, if that is better.
    fn or_better(
        &self,
        first: Compared,
        mesh: Mesh,
        areas: Vec<u32>,
        compare: &impl Fn(Finished) -> Compared,
    ) -> Compared {
        let other = compare(Finished { topology: first.way.topology, ..self.finished(mesh, areas) });
        if other.value < first.value { other } else { first }
    }

    fn is_large(&self) -> bool {
        self.chart.triangles.len() > LARGE
    }

    fn finished(&self, Mesh { positions, triangles }: Mesh, areas: Vec<u32>) -> Finished {
        let drawn = TriangleBvh::new(&positions, &triangles);
        let error = self.surface.error_at(two_sided(&self.of_chart, &drawn, &CertifyOptions::default()).upper);
        let surface = CoarseSurface { positions, triangles, error };
        Finished::new(Reduced { surface, topology: Topology::Kept, areas }, self.lattice)
    }

    /// A cut relative to the lattice's origin.
    fn local(&self, way: &Finished) -> Mesh {
        let origin = DVec3::from_array(self.lattice.origin);
        let positions = way.positions.iter().map(|&p| DVec3::from_array(p) - origin).collect();
        Mesh { positions, triangles: way.triangles.clone() }
    }

    /// Raises the weights around points, which are relative to the lattice's origin.
    fn raise(&self, weights: &mut [f32], points: &[DVec3], step: f32) {
        let mut hint = Hint::default();
        let mut corners = |point: &DVec3| {
            let closest = self.of_chart.closest(*point, &mut hint);
            self.chart.triangles[closest.triangle as usize]
        };
        let vertices: BTreeSet<u32> = points.iter().flat_map(&mut corners).collect();
        raise(weights, &vertices, step);
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
        let stops = differing_stops(&ALL_STOPS, triangles.len(), 300);
        let made = Made { stops: stops[0].clone(), has_lines: false, weights: vec![1.0; positions.len()] };
        let (mesh, areas) = recollapse.collapsed(&made).expect("possible");
        let first = recollapse.finished(mesh, areas);
        let place = DVec3::new(8.0, 8.0, 0.5);
        let around = |way: &Finished| {
            let is_near = |point: &&[f64; 3]| DVec3::from(**point).distance(place) < 5.0;
            way.positions.iter().filter(is_near).count()
        };
        let worst = place - DVec3::from(lattice.origin);
        let compare = |way: Finished| {
            let value = 1000.0 - around(&way) as f64;
            Compared { seen: Seen { sum: value, area: 1.0, far: vec![(worst, value)], ..Seen::default() }, value, way }
        };
        let best = recollapse.best(vec![compare(first.clone())], &compare).swap_remove(0).way;
        assert!(around(&best) > around(&first), "{} and {}", around(&best), around(&first));
        assert!(best.triangles.len() <= 300);
        // What was made otherwise is moved at most.
        let mut other = first;
        other.triangles.pop();
        assert!(recollapse.made_by(&other).is_none());
        let best = recollapse.best(vec![compare(other.clone())], &compare).swap_remove(0).way;
        assert_eq!(best.triangles, other.triangles);
        assert!(recollapse.best(vec![], &compare).is_empty());
    }

    #[test]
    fn cuts_are_moved_nearer_if_that_is_better() {
        let lattice = Lattice { origin: [100.0, 0.0, 0.0], step_log2: -10 };
        let Mesh { positions, triangles } = hills(&lattice);
        let positions: Vec<[f64; 3]> = positions.iter().map(|point| point.to_array()).collect();
        let recollapse = Recollapse::new(&positions, &triangles, 0.5, None, &lattice, 200).expect("a manifold");
        let made = Made { stops: vec![], has_lines: false, weights: vec![1.0; positions.len()] };
        let (mesh, areas) = recollapse.collapsed(&made).expect("possible");
        let first = recollapse.finished(mesh, areas);
        for sign in [1.0, -1.0] {
            let height = |way: &Finished| way.positions.iter().map(|p| p[2].abs()).sum::<f64>();
            let compare = |way: Finished| Compared { seen: Seen::default(), value: sign * height(&way), way };
            let chosen = recollapse.or_nearer(compare(first.clone()), &compare).way;
            assert!(sign * height(&chosen) <= sign * height(&first));
            assert!(chosen.error > 0.5 && chosen.triangles == first.triangles);
        }
    }
}
