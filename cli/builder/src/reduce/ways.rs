//! A whole surface with a stated number of triangles, whatever its topology is.
//!
//! Edge collapse keeps the topology, and is nearest to the surface until it needs some sixty triangles a handle and a
//! dozen a part. It is tried in several ways, which renew their planes more or less often, and again with more weight
//! where the result is farthest off. Where fewer than three times as many are asked for, closed surfaces are also
//! [resampled](lodpack_stage::resample) on cells so large that few handles are left, and [vertices are
//! clustered](lodpack_stage::cluster_vertices), which suits scenes of many parts. Vertices are also clustered where
//! nothing else reaches the number. The vertices of the nearest results are [moved nearer](super::moved_nearer), too.
//! Of the results that reach it, the one with the least mean squared distance is taken, unless its largest distance is
//! much more than another's. The error is certified against the surface that came in, both ways.

use std::collections::BTreeSet;
use std::iter;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::collapsed::{STOPS, collapsed_in_areas};
use super::far_weights::FarWeights;
use super::manifold::open_edges;
use super::moved_nearer::{Whole, moved_nearer, take_back};
use super::other_topology::{CROWDED, capped, clustered, needed, resampled};
use super::spread_points::for_each_point;
use super::surface::CoarseSurface;
use lodpack_mesh::{Mesh, NONE};
use lodpack_runtime::trace;
use lodpack_stage::areas::Areas;
use lodpack_stage::certify::{CertifyOptions, Hint, TriangleBvh, two_sided};
use lodpack_stage::chart::ChartMesh;

/// Of the candidates whose bound is at most this many times the least one, the one with the least mean is taken.
const FARTHER: f64 = 1.2;
/// Ways to collapse edges, as [`SimplifyOptions::stops`](lodpack_stage::simplify::SimplifyOptions): all are tried,
/// since which is nearest differs from surface to surface.
pub(crate) const ALL_STOPS: [&[f64]; 3] = [&[], &STOPS, &[4.0, 2.0, 1.4]];
/// Input triangles that are collapsed again, in all ways together, with more weight where the surface was farthest off;
/// the same where there is something of that size already; what measuring a surface costs beside its triangles; and the
/// most rounds of each way.
const COLLAPSED_AGAIN: usize = 900_000;
const COLLAPSED_QUICKLY: usize = 30_000;
const MEASURING: usize = 8000;
const MOST_ROUNDS: usize = 16;
/// The most rounds in which vertices of a surface that was moved nearer are taken back where it is farther off than
/// before.
const TAKEN_BACK: usize = 2;
/// Points at which the candidates are compared, of each surface.
const COMPARED_POINTS: usize = 4000;

/// What became of the topology of a reduced surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Topology {
    /// It is that of the surface.
    Kept,
    /// The solid was resampled: handles and cavities are closed, thin parts gone.
    Resampled,
    /// Vertices were clustered: parts have merged or are gone.
    Clustered,
}

/// A surface with at most `triangles` triangles, after `mended` has made of it what is needed; none if even clustering
/// cannot make one.
pub(crate) fn reduce(
    surface: &CoarseSurface,
    ways: Ways<'_>,
    triangles: usize,
    mended: impl Fn(Mesh) -> Option<Mesh> + Sync,
) -> Option<(CoarseSurface, Topology)> {
    let nearest = reductions(surface, ways, triangles, mended).into_iter().next();
    nearest.map(|reduced| (reduced.surface, reduced.topology))
}

/// What a surface has become.
pub(crate) struct Reduced {
    pub surface: CoarseSurface,
    pub topology: Topology,
    /// The area of each triangle; empty if that is not known.
    pub areas: Vec<u32>,
}

/// The ways in which a surface is reduced.
#[derive(Clone, Copy)]
pub(crate) enum Ways<'a> {
    /// All that bring it near, also again with more weight where it is farthest off.
    Nearest,
    /// Edge collapse in one way alone, and again only as often as it takes next to no time: for a surface that has
    /// something as small already.
    Quick,
    /// A few, for the caller to choose from. If areas are given, lines between them stay, too, in as many ways more.
    Each(Option<Areas<'a>>),
}

/// As [`reduce`], made in several ways, the one that is taken first.
pub(crate) fn reductions(
    surface: &CoarseSurface,
    ways: Ways<'_>,
    triangles: usize,
    mended: impl Fn(Mesh) -> Option<Mesh> + Sync,
) -> Vec<Reduced> {
    let whole = Mesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
    let is_small = |mesh: &Mesh| mesh.triangles.len() <= triangles;
    let as_it_is = is_small(&whole).then(|| whole.clone()).and_then(&mended);
    if let Some(Mesh { positions, triangles }) = as_it_is.filter(is_small) {
        let surface = CoarseSurface { positions, triangles, error: surface.error };
        return vec![Reduced { surface, topology: Topology::Kept, areas: vec![] }];
    }
    let bvh = TriangleBvh::new(&whole.positions, &whole.triangles);
    let reducing = Reducing { whole: Whole { mesh: &whole, bvh: &bvh }, triangles, mended: &mended };
    let is_quick = matches!(ways, Ways::Quick);
    let mut chart = surface.chart();
    let closed = match &chart {
        _ if is_quick => None,
        Some(chart) => (triangles < CROWDED * needed(chart)).then(|| capped(chart)),
        // What touches itself bounds a solid nevertheless.
        None => open_edges(&whole.triangles).is_empty().then(|| whole.clone()),
    };
    chart.iter_mut().for_each(ChartMesh::free_border);
    let is_crowded = closed.is_some();
    // Candidates do not depend on each other, and their order is that in which they are listed here.
    let resampled = || -> Vec<Measured> {
        let meshes = closed.iter().flat_map(|closed| resampled(closed, triangles));
        meshes.filter_map(|mesh| reducing.mended(Candidate::of(mesh, Topology::Resampled))).collect()
    };
    let collapsed = || chart.as_ref().map_or(vec![], |chart| reducing.collapsed(chart, ways));
    let clustered = || -> Vec<Measured> {
        let meshes = clustered(&whole, triangles, &mended).into_iter();
        meshes.map(|mesh| reducing.measured(Candidate::of(mesh, Topology::Clustered))).collect()
    };
    let of_all = trace::parallel("ways");
    let when_crowded = || if is_crowded { passed("cluster", clustered) } else { vec![] };
    let ((mut measured, of_collapse), of_clusters) =
        rayon::join(|| rayon::join(|| passed("resample", resampled), || passed("collapse", collapsed)), when_crowded);
    drop(of_all);
    measured.extend(of_collapse.into_iter().chain(of_clusters));
    if !is_crowded && measured.is_empty() && !is_quick {
        measured = clustered();
    }
    if !matches!(ways, Ways::Each(_)) {
        let nearer = reducing.moved_nearer(&measured);
        measured.extend(nearer);
    }
    measured.retain(|m| m.bound.is_finite());
    let least = measured.iter().map(|m| m.bound).fold(f64::INFINITY, f64::min);
    let is_far = |m: &Measured| m.bound > FARTHER * least;
    measured.sort_by(|a, b| is_far(a).cmp(&is_far(b)).then(a.mean.total_cmp(&b.mean)));
    let reduced = |Measured { candidate, bound, .. }| {
        let Candidate { mesh: Mesh { positions, triangles }, topology, mut areas } = candidate;
        if areas.len() != triangles.len() {
            // The mesh has been mended.
            areas.clear();
        }
        Reduced { surface: CoarseSurface { positions, triangles, error: surface.error_at(bound) }, topology, areas }
    };
    measured.into_iter().map(reduced).collect()
}

/// A pass of the trace.
fn passed<T>(name: &'static str, work: impl FnOnce() -> T) -> T {
    let _pass = trace::pass(name);
    work()
}

/// What makes candidates for one surface.
struct Reducing<'a> {
    whole: Whole<'a>,
    triangles: usize,
    mended: &'a (dyn Fn(Mesh) -> Option<Mesh> + Sync),
}

impl Reducing<'_> {
    /// Mends and measures a candidate, if it is small enough then.
    fn mended(&self, candidate: Candidate) -> Option<Measured> {
        let mesh = (self.mended)(candidate.mesh)?;
        let fits = mesh.triangles.len() <= self.triangles && !mesh.triangles.is_empty();
        fits.then(|| self.measured(Candidate { mesh, ..candidate }))
    }

    fn measured(&self, candidate: Candidate) -> Measured {
        let Mesh { positions, triangles } = &candidate.mesh;
        let drawn = TriangleBvh::new(positions, triangles);
        let bound = two_sided(self.whole.bvh, &drawn, &CertifyOptions::default()).upper;
        let mean = one_way(self.whole.mesh, &drawn) + one_way(&candidate.mesh, self.whole.bvh);
        Measured { candidate, bound, mean }
    }

    /// What edge collapse makes of the surface: way after way, and in each the first before those made again.
    fn collapsed(&self, chart: &ChartMesh, ways: Ways<'_>) -> Vec<Measured> {
        let (areas, again) = match ways {
            Ways::Nearest => (None, COLLAPSED_AGAIN),
            Ways::Quick => (None, COLLAPSED_QUICKLY),
            Ways::Each(areas) => (areas, 0),
        };
        let of_chart = areas.map(|areas| areas_of_chart(self.whole.mesh, areas, chart));
        let areas = areas.and_then(|areas| Areas::of(of_chart.as_deref()?, Some(areas.jumps)));
        let tried = if matches!(ways, Ways::Quick) { &ALL_STOPS[1..2] } else { &ALL_STOPS };
        let all_stops = differing_stops(tried, chart.triangles.len(), self.triangles);
        let a_round = MEASURING + chart.triangles.len();
        let rounds = |ways: usize| (again / (ways * a_round)).min(MOST_ROUNDS);
        let kept = iter::once(None).chain(areas.map(Some));
        let all: Vec<Way> = kept.flat_map(|areas| all_stops.iter().map(move |stops| Way { stops, areas })).collect();
        let weights = FarWeights::new(chart);
        let of_all = trace::parallel("collapses");
        let in_way = |&way: &Way<'_>| -> Vec<Measured> {
            let _pass = trace::pass("collapse");
            let Some(first) = self.collapsed_in(chart, way, None) else { return vec![] };
            let again = self.collapsed_again(weights.clone(), way, &first, rounds(all_stops.len()));
            iter::once(first).chain(again).collect()
        };
        let of_ways: Vec<Vec<Measured>> = all.par_iter().map(in_way).collect();
        drop(of_all);
        let firsts = all.iter().zip(&of_ways).filter_map(|(way, measured)| Some((*way, measured.first()?)));
        let nearest = firsts.reduce(|best, next| if next.1.bound < best.1.bound { next } else { best });
        // A large surface is made again in one way alone.
        let last = match nearest {
            Some((way, first)) if rounds(all_stops.len()) == 0 => self.collapsed_again(weights, way, first, rounds(1)),
            _ => vec![],
        };
        of_ways.into_iter().flatten().chain(last).collect()
    }

    /// What edge collapse makes of the surface in one way.
    fn collapsed_in(&self, chart: &ChartMesh, way: Way<'_>, importance: Option<&[f32]>) -> Option<Measured> {
        let (mesh, areas) = collapsed_in_areas(chart, way.areas, self.triangles, way.stops, importance)?;
        self.mended(Candidate { mesh, topology: Topology::Kept, areas })
    }

    /// The nearest surfaces again, by what they may be chosen for, with vertices that are moved nearer.
    fn moved_nearer(&self, measured: &[Measured]) -> Vec<Measured> {
        let nearest = |of: fn(&Measured) -> f64| {
            (0..measured.len()).min_by(|&a, &b| of(&measured[a]).total_cmp(&of(&measured[b])))
        };
        let chosen =
            [|m: &Measured| m.bound, |m: &Measured| m.mean, |m: &Measured| m.mean * m.bound * m.bound].map(nearest);
        let chosen: Vec<usize> = chosen.into_iter().flatten().collect::<BTreeSet<usize>>().into_iter().collect();
        let _all = trace::parallel("nearer");
        let nearer = |&number: &usize| {
            let _pass = trace::pass("move");
            let Measured { candidate: Candidate { mesh: before, topology, areas }, bound, .. } = &measured[number];
            let (mut mesh, mut made) = (moved_nearer(before, self.whole), vec![]);
            for _ in 0..=TAKEN_BACK {
                let next = Candidate { mesh: mesh.clone(), topology: *topology, areas: areas.clone() };
                made.extend(self.mended(next));
                let is_near = made.last().is_some_and(|last: &Measured| last.bound <= *bound);
                if is_near || !take_back(&mut mesh, before, self.whole, *bound) {
                    break;
                }
            }
            made
        };
        let made: Vec<Vec<Measured>> = chosen.par_iter().map(nearer).collect();
        made.into_iter().flatten().collect()
    }

    /// Repeats the first one of a way `rounds` times, with ever more weight where the last one was farthest off.
    fn collapsed_again(
        &self,
        mut weights: FarWeights<'_>,
        way: Way<'_>,
        first: &Measured,
        rounds: usize,
    ) -> Vec<Measured> {
        let mut made = vec![];
        for _ in 0..rounds {
            let Measured { candidate, bound, .. } = made.last().unwrap_or(first);
            if !weights.raise(&candidate.mesh, *bound) {
                break;
            }
            let Some(next) = self.collapsed_in(weights.chart(), way, weights.of_vertices()) else { break };
            made.push(next);
        }
        made
    }
}

/// The stops that differ for a surface of some triangles.
pub(crate) fn differing_stops(tried: &[&[f64]], of: usize, triangles: usize) -> Vec<Vec<f64>> {
    let ratio = of as f64 / triangles.max(1) as f64;
    let mut all: Vec<Vec<f64>> = vec![];
    for stops in tried {
        let stops: Vec<f64> = stops.iter().copied().filter(|&times| times < ratio).collect();
        if !all.contains(&stops) {
            all.push(stops);
        }
    }
    all
}

/// The areas of a chart's triangles, which are those of the surface that it was made from, but for a few that were
/// divided.
pub(crate) fn areas_of_chart(whole: &Mesh, areas: Areas<'_>, chart: &ChartMesh) -> Vec<u32> {
    if chart.triangles == whole.triangles {
        return areas.of_triangles.to_vec();
    }
    let bvh = TriangleBvh::new(&whole.positions, &whole.triangles);
    let mut hint = Hint::default();
    let middle = |corners: &[u32; 3]| corners.iter().map(|&v| chart.positions[v as usize]).sum::<DVec3>() / 3.0;
    let mut of = |corners| areas.of_triangles.get(bvh.closest(middle(corners), &mut hint).triangle as usize).copied();
    chart.triangles.iter().map(|corners| of(corners).unwrap_or(NONE)).collect()
}

/// A way to collapse edges.
#[derive(Clone, Copy)]
struct Way<'a> {
    /// As [`SimplifyOptions::stops`](lodpack_stage::simplify::SimplifyOptions::stops).
    stops: &'a [f64],
    /// Areas between which lines stay.
    areas: Option<Areas<'a>>,
}

/// What the surface may become.
struct Candidate {
    mesh: Mesh,
    topology: Topology,
    /// The area of each triangle before the mesh was mended; empty if that is not known.
    areas: Vec<u32>,
}

impl Candidate {
    fn of(mesh: Mesh, topology: Topology) -> Self {
        Self { mesh, topology, areas: vec![] }
    }
}

/// A candidate beside the surface that came in.
struct Measured {
    candidate: Candidate,
    /// Bound of the two-sided distance.
    bound: f64,
    /// Mean squared distances of both ways, added.
    mean: f64,
}

/// Mean squared distance of the points of a mesh from a surface, at points spread by area.
fn one_way(from: &Mesh, to: &TriangleBvh) -> f64 {
    let (mut sum, mut count, mut hint) = (0.0, 0_u32, Hint::default());
    for_each_point(&from.doubled_areas(), COMPARED_POINTS, |triangle, [_, u, v]| {
        let [a, b, c] = from.corners(triangle as u32);
        let distance = to.closest(a + (b - a) * u + (c - a) * v, &mut hint).distance;
        sum += distance * distance;
        count += 1;
    });
    sum / f64::from(count.max(1))
}
