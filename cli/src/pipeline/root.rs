//! From cut-out charts to roots: what both fillings share, and the loop that settles borders between neighbours.

use super::borders::{Borders, CutChart, Raise};
use super::choose::choose_fillings;
use super::grid::GridFilling;
use super::{Effort, Fillings, Scale, Surface};
use crate::pipeline::summary::{Fallbacks, StageTime, thread_cpu_time};
use crate::progress::Progress;
use crate::stage::certify::{self, BorderPairing, CertifyOptions, PairedVertex, exceeding, two_sided_along};
use glam::DVec3;
use lodpack::{BlockRecord, Filling, LatticePoint, Patch, RootRecord, SymbolBuffer};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::Duration;

/// How often a chart is simplified again before its finest level is the input itself.
pub(super) const MAX_FAILURES: u32 = 8;
/// A finer irregular block that lowers the error by less than this factor is left out.
const WORTHWHILE: f64 = 0.8;
/// Points of a chart at which its root mean square error is estimated.
const RMS_POINTS: usize = 1000;

/// Processor time by stage, summed over charts.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Times {
    pub arcs: Duration,
    pub cut: Duration,
    pub embed: Duration,
    pub sample: Duration,
    pub simplify: Duration,
    pub encode: Duration,
    pub certify: Duration,
}

impl Times {
    pub fn add(&mut self, other: &Self) {
        self.arcs += other.arcs;
        self.cut += other.cut;
        self.embed += other.embed;
        self.sample += other.sample;
        self.simplify += other.simplify;
        self.encode += other.encode;
        self.certify += other.certify;
    }

    /// The same by name.
    pub fn stages(&self) -> Vec<StageTime> {
        [
            ("arcs", self.arcs),
            ("cut", self.cut),
            ("embed", self.embed),
            ("sample", self.sample),
            ("simplify", self.simplify),
            ("encode", self.encode),
            ("certify", self.certify),
        ]
        .map(|(stage, cpu)| StageTime { stage, wall_seconds: 0.0, cpu_seconds: cpu.as_secs_f64() })
        .to_vec()
    }
}

/// A root and what is known about it beside its record.
#[derive(Clone, Debug)]
pub(super) struct Root {
    pub record: RootRecord,
    /// Interior vertices of all blocks.
    pub vertices: u64,
    /// Root mean square distance of a thousand vertices of the input from the finest level, input units.
    pub rms: f64,
}

/// What became of a try.
pub(super) enum Outcome {
    Done(Box<Root>),
    /// The chart needs these of its arcs first.
    Wishes(Vec<Raise>),
    /// No grid of this chart meets the tolerance.
    Unfit,
}

/// How a chart is to be filled.
#[derive(Clone, Debug, Default)]
pub(super) enum Choice {
    #[default]
    Irregular,
    Grid(Box<GridFilling>),
}

/// A chart on its way to a root.
#[derive(Clone, Debug, Default)]
pub(super) struct ChartState {
    pub choice: Choice,
    /// Tries that were above the tolerance.
    pub failures: u32,
    /// Weight per chart vertex for the simplifier; empty while all are 1.
    pub importance: Vec<f32>,
    pub root: Option<Root>,
}

/// What is done with a chart whose grid does not meet the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unfit {
    /// It is left without a root.
    Drop,
    /// It gets an irregular filling.
    FillIrregularly,
}

/// Builds roots, chart by chart side by side.
pub(super) struct RootBuilder<'a> {
    pub surface: &'a Surface<'a>,
    pub progress: &'a dyn Progress,
    pub times: Mutex<Times>,
}

impl RootBuilder<'_> {
    /// Builds the roots of `pending` charts. Charts that need more of their arcs are done again together with their
    /// neighbours, as far as these are among `charts`, until none does. Returns how many arc samples were added.
    pub fn build(
        &self,
        borders: &mut Borders,
        charts: &mut BTreeMap<u32, ChartState>,
        mut pending: Vec<u32>,
        unfit: Unfit,
    ) -> lodpack::Result<u64> {
        let mut added_in_all = 0;
        while !pending.is_empty() {
            let started: Vec<(u32, ChartState)> = pending
                .iter()
                .filter_map(|&chart| charts.get_mut(&chart).map(|state| (chart, std::mem::take(state))))
                .collect();
            let tried: Vec<(u32, ChartState, Outcome)> = started
                .into_par_iter()
                .map(|(chart, mut state)| {
                    let outcome = self.work(borders, chart, |work| work.run(&mut state));
                    (chart, state, outcome)
                })
                .collect();
            let (mut wishes, mut wishing, mut again) = (vec![], vec![], vec![]);
            for (chart, mut state, outcome) in tried {
                match outcome {
                    Outcome::Done(root) => state.root = Some(*root),
                    Outcome::Wishes(list) => {
                        wishes.extend(list);
                        wishing.push(chart);
                    }
                    Outcome::Unfit => {
                        state = ChartState::default();
                        if unfit == Unfit::FillIrregularly {
                            again.push(chart);
                        }
                    }
                }
                charts.insert(chart, state);
            }
            let (added, touched) = borders.raise(self.surface, wishes)?;
            added_in_all += added;
            again.extend(touched.into_iter().filter(|chart| {
                charts
                    .get(chart)
                    .is_some_and(|state| unfit == Unfit::FillIrregularly || matches!(state.choice, Choice::Grid(_)))
            }));
            again.sort_unstable();
            again.dedup();
            // A chart whose wishes could not be fulfilled goes on without, and gives up after a few tries more.
            for chart in wishing {
                if let (Err(_), Some(state)) = (again.binary_search(&chart), charts.get_mut(&chart)) {
                    state.failures += 1;
                    if state.failures > MAX_FAILURES + 3 {
                        let what =
                            format!("the border of chart {chart} cannot be thinned out; this is a defect of lodpack");
                        return Err(lodpack::Error::Model { what });
                    }
                    again.push(chart);
                }
            }
            again.sort_unstable();
            pending = again;
        }
        Ok(added_in_all)
    }

    /// Does something with a chart and adds up the time that it takes.
    pub fn work<T>(&self, borders: &Borders, chart: u32, task: impl FnOnce(&mut ChartWork) -> T) -> T {
        let mut work = ChartWork { surface: self.surface, borders, chart, times: Times::default() };
        let result = task(&mut work);
        if let Ok(mut times) = self.times.lock() {
            times.add(&work.times);
        }
        self.progress.advance(1);
        result
    }

    /// Processor time by stage.
    pub fn times(&self) -> Times {
        self.times.lock().map(|times| *times).unwrap_or_default()
    }
}

/// Builds every root; besides, the number of their vertices and the time by stage.
pub(super) fn build_roots(
    surface: &Surface,
    options: (Fillings, Effort),
    borders: &mut Borders,
    fallbacks: &mut Fallbacks,
    progress: &dyn Progress,
) -> lodpack::Result<(Vec<RootRecord>, u64, Times)> {
    let chart_count = surface.atlas.charts.len() as u32;
    let builder = RootBuilder { surface, progress, times: Mutex::default() };
    let mut charts = (0..chart_count).map(|chart| (chart, ChartState::default())).collect();
    let pending = (0..chart_count).collect();
    fallbacks.raised_samples += builder.build(borders, &mut charts, pending, Unfit::FillIrregularly)?;
    choose_fillings(&builder, options, borders, &mut charts, fallbacks)?;
    count_failures(&charts, fallbacks);
    let vertices = charts.values().filter_map(|state| state.root.as_ref()).map(|root| root.vertices).sum();
    Ok((charts.into_values().filter_map(|state| Some(state.root?.record)).collect(), vertices, builder.times()))
}

/// Counts what went another way.
fn count_failures(charts: &BTreeMap<u32, ChartState>, fallbacks: &mut Fallbacks) {
    let irregular = || charts.values().filter(|state| matches!(state.choice, Choice::Irregular));
    fallbacks.retried_charts = irregular().filter(|state| state.failures > 0).count() as u64;
    fallbacks.unsimplified_charts = irregular().filter(|state| state.failures >= MAX_FAILURES).count() as u64;
}

/// Everything about one chart while its root is made.
pub(super) struct ChartWork<'a> {
    pub surface: &'a Surface<'a>,
    pub borders: &'a Borders,
    pub chart: u32,
    pub times: Times,
}

/// One level of a filling, coded.
pub(super) struct CodedLevel {
    pub patch: Patch,
    /// The patch's vertices as they decode, relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    pub symbols: SymbolBuffer,
}

impl CodedLevel {
    pub fn surface(&self) -> certify::TriangleBvh {
        certify::TriangleBvh::new(&self.positions, &self.patch.triangles)
    }
}

impl ChartWork<'_> {
    fn run(&mut self, state: &mut ChartState) -> Outcome {
        let cut = self.cut();
        let start = thread_cpu_time();
        let original = certify::TriangleBvh::new(&cut.original, &cut.mesh.triangles);
        self.times.certify += thread_cpu_time() - start;
        let ChartState { choice, failures, importance, .. } = state;
        match choice {
            Choice::Irregular => self.fill_irregularly(&cut, &original, failures, importance),
            Choice::Grid(filling) => self.fill_with_grid(&cut, &original, failures, filling),
        }
    }

    /// Cuts the chart out.
    pub fn cut(&mut self) -> CutChart {
        let start = thread_cpu_time();
        let cut = self.borders.cut(self.surface, self.chart);
        self.times.cut += thread_cpu_time() - start;
        cut
    }

    /// What is drawn at a level, with the border's decoded positions.
    pub fn coded_level(&self, cut: &CutChart, level: u8, patch: Patch, symbols: SymbolBuffer) -> CodedLevel {
        let loops = border_loops(cut, level);
        let points = loops.iter().flatten().chain(&patch.interior);
        let positions = points.map(|&p| self.surface.scale.local_from_lattice(p)).collect();
        CodedLevel { patch, positions, symbols }
    }

    /// The certified error of what is drawn.
    pub fn certify(
        &mut self,
        original: &certify::TriangleBvh,
        drawn: &certify::TriangleBvh,
        seam: &BorderPairing,
    ) -> f64 {
        let start = thread_cpu_time();
        let options = CertifyOptions {
            relative_gap: self.surface.certify_gap,
            floor: self.surface.scale.step() * 0.05,
            ..CertifyOptions::default()
        };
        let bound = two_sided_along(original, drawn, seam, &options).upper;
        self.times.certify += thread_cpu_time() - start;
        bound
    }

    /// The certified error of what is drawn, as tight as it takes to prove that what is stored of it is within the tolerance if
    /// it is.
    pub fn certify_within(
        &mut self,
        original: &certify::TriangleBvh,
        drawn: &certify::TriangleBvh,
        seam: &BorderPairing,
    ) -> f64 {
        let mut error = self.certify(original, drawn, seam);
        let start = thread_cpu_time();
        let Scale { tolerance, error_limit, .. } = *self.surface.scale;
        // What is stored is rounded up: of the little that lies between, most can be proven to be less.
        for (target, most) in [(tolerance, tolerance * (1.0 + self.surface.certify_gap)), (error_limit, tolerance)] {
            if error > target && error <= most {
                let options = CertifyOptions { target: Some(target), relative_gap: 0.002, ..CertifyOptions::default() };
                error = error.min(two_sided_along(original, drawn, seam, &options).upper);
            }
        }
        self.times.certify += thread_cpu_time() - start;
        error
    }

    /// The chart's triangles around what is too far off, ascending.
    pub fn exceeding(
        &mut self,
        cut: &CutChart,
        original: &certify::TriangleBvh,
        coded: &CodedLevel,
        drawn: &certify::TriangleBvh,
    ) -> Vec<u32> {
        let start = thread_cpu_time();
        // A little below the tolerance, so that what is found is never empty.
        let tolerance = self.surface.scale.tolerance * 0.9;
        let mut found = exceeding(original, drawn, tolerance, u64::MAX);
        // What the drawn side shows too far off is cured where the input is nearest.
        let mut hint = certify::Hint::default();
        for t in exceeding(drawn, original, tolerance, u64::MAX) {
            let corners = coded.patch.triangles[t as usize].map(|v| coded.positions[v as usize]);
            for p in corners.into_iter().chain([(corners[0] + corners[1] + corners[2]) / 3.0]) {
                found.push(original.closest(p, &mut hint).triangle);
            }
        }
        found.sort_unstable();
        found.dedup();
        found.retain(|&t| (t as usize) < cut.mesh.triangles.len());
        self.times.certify += thread_cpu_time() - start;
        found
    }

    /// Turns chart vertices into wishes for those of them that lie on the border; seams stay as they are.
    pub fn wishes(&self, cut: &CutChart, vertices: impl Iterator<Item = (u32, u8)>) -> Vec<Raise> {
        let mut by_vertex: Vec<(u32, (u32, u32), u8)> = cut
            .mesh
            .loops
            .iter()
            .zip(&cut.origin)
            .flat_map(|(border, origin)| border.iter().zip(origin).map(|(b, &o)| (b.vertex, o, b.level)))
            .collect();
        by_vertex.sort_unstable();
        let mut wishes = vec![];
        for (vertex, level) in vertices {
            let begin = by_vertex.partition_point(|entry| entry.0 < vertex);
            for &(_, (arc, path_index), has) in by_vertex[begin..].iter().take_while(|entry| entry.0 == vertex) {
                if has > level && self.surface.atlas.arcs[arc as usize].seam.is_none() {
                    wishes.push(Raise { arc, path_index, level });
                }
            }
        }
        wishes
    }

    /// Certifies the coarser levels and keeps the blocks that are worth their bytes. The finest level is there; in a grid,
    /// whose levels build on each other, all that are there are kept.
    pub fn root(
        &mut self,
        cut: &CutChart,
        original: &certify::TriangleBvh,
        filling: Filling,
        coded: Vec<Option<CodedLevel>>,
        finest: (&certify::TriangleBvh, f64),
    ) -> Root {
        let (finest_surface, finest_error) = finest;
        let rms = self.rms(cut, finest_surface);
        let deviations = self.borders.deviations(self.surface, self.chart);
        let last = coded.iter().rposition(Option::is_some).unwrap_or(0);
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &p in cut.original.iter().chain(coded.iter().flatten().flat_map(|level| &level.positions)) {
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        let mut blocks: Vec<Option<BlockRecord>> = Vec::with_capacity(coded.len());
        let (mut best, mut vertices, mut coarser) = (f64::INFINITY, 0, 0);
        // What a file stores of a block that is drawn where the level is missing: a neighbour may be finer.
        let mut best_stored = f64::INFINITY;
        for (level, coded_level) in coded.into_iter().enumerate() {
            let Some(coded_level) = coded_level else {
                blocks.push(None);
                continue;
            };
            let error = if level == last {
                finest_error
            } else {
                self.certify(original, &coded_level.surface(), &seam(cut, level as u8))
            };
            let needed = filling == Filling::Grid || level == last && best_stored > self.surface.scale.tolerance;
            if level > 0 && !needed && error > best * WORTHWHILE {
                blocks.push(None);
                continue;
            }
            best = error;
            best_stored =
                lodpack::stored_error(error, deviations[level], &self.surface.scale.lattice).unwrap_or(f64::INFINITY);
            let interior = coded_level.patch.interior.len() as u64;
            vertices += interior - coarser;
            coarser = if filling == Filling::Grid { interior } else { 0 };
            blocks.push(Some(BlockRecord {
                error,
                border_deviation: deviations[level],
                triangle_count: coded_level.patch.triangles.len() as u32,
                symbols: coded_level.symbols,
            }));
        }
        // A grid's vertices serve all levels, so that a coarser one may happen to be closer. Its bound is made the larger one:
        // refinement never raises an error then.
        let mut finer: f64 = 0.0;
        for block in blocks.iter_mut().rev().flatten() {
            finer = finer.max(block.error);
            block.error = finer;
        }
        let origin = DVec3::from_array(self.surface.scale.lattice.origin);
        let loops = self.surface.atlas.charts[self.chart as usize].loops.iter();
        let record = RootRecord {
            filling,
            loops: loops
                .map(|l| l.iter().map(|h| lodpack::HalfArc { arc: h.arc, reversed: h.reversed }).collect())
                .collect(),
            bounds: bounds.map(|p| (p + origin).to_array()),
            blocks,
        };
        Root { record, vertices, rms }
    }

    /// Root mean square distance of evenly chosen vertices of the input.
    fn rms(&mut self, cut: &CutChart, drawn: &certify::TriangleBvh) -> f64 {
        let start = thread_cpu_time();
        let stride = cut.original.len().div_ceil(RMS_POINTS).max(1);
        let mut hint = certify::Hint::default();
        let squares: Vec<f64> =
            cut.original.iter().step_by(stride).map(|&p| drawn.closest(p, &mut hint).distance.powi(2)).collect();
        self.times.certify += thread_cpu_time() - start;
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// Which border vertices of a chart are drawn at a level, as which of the drawn vertices.
pub(super) fn seam(cut: &CutChart, level: u8) -> BorderPairing {
    let mut drawn = 0..;
    let mut partner = |is_drawn: bool| if is_drawn { drawn.next() } else { None };
    let loops = cut.mesh.loops.iter().zip(&cut.lattice);
    loops
        .map(|(border, points)| {
            let vertices = border.iter().zip(points);
            vertices
                .map(|(b, p)| PairedVertex { fine: b.vertex, coarse: partner(b.level <= level && p.is_some()) })
                .collect()
        })
        .collect()
}

/// Lattice positions of the border samples of a level, loop after loop.
pub(super) fn border_loops(cut: &CutChart, level: u8) -> Vec<Vec<LatticePoint>> {
    let loops = cut.mesh.loops.iter().zip(&cut.lattice);
    loops
        .map(|(border, points)| {
            border.iter().zip(points).filter(|(b, _)| b.level <= level).filter_map(|(_, p)| *p).collect()
        })
        .collect()
}
