//! From a cut-out chart to a root's blocks: simplify, code, certify; again where a bound is above the tolerance.

use super::borders::{ARC_TANGENT_SHIFT, Borders, CutChart, Raise};
use super::{Effort, Surface};
use crate::certify::{self, CertifyOptions, exceeding, two_sided};
use crate::chart::NEVER;
use crate::progress::Progress;
use crate::simplify::{LevelPatch, SimplifiedChart, SimplifyOptions, simplify_chart};
use crate::summary::{Fallbacks, StageTime, thread_cpu_time};
use glam::DVec3;
use lodpack::{
    ArcRecord, BlockRecord, Filling, LatticePoint, LevelInfo, Model, Patch, PatchTarget, RootRecord, Slide, SourceInfo,
    SymbolBuffer, encode_patch,
};
use rayon::prelude::*;
use std::sync::Mutex;
use std::time::Duration;

/// How often a chart is simplified again before its finest level is the input itself.
const MAX_TRIES: u32 = 4;
/// What a vertex's quadric is multiplied by where the bound was above the tolerance.
const IMPORTANCE_STEP: f32 = 16.0;
/// A finer block that lowers the error by less than this factor is left out.
const WORTHWHILE: f64 = 0.8;

/// Processor time by stage, summed over charts.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    cut: Duration,
    simplify: Duration,
    encode: Duration,
    certify: Duration,
}

/// A root's record, or what the chart needs from its arcs before it can have one.
enum Outcome {
    Done(Box<RootRecord>),
    Wishes(Vec<Raise>),
}

/// Builds every root. Charts that need more of their arcs are done again together with their neighbours, until none does.
pub(super) fn build_roots(
    surface: &Surface,
    effort: Effort,
    borders: &mut Borders,
    fallbacks: &mut Fallbacks,
    progress: &dyn Progress,
) -> lodpack::Result<(Vec<RootRecord>, Vec<StageTime>)> {
    let chart_count = surface.atlas.charts.len();
    let totals = Mutex::new(Times::default());
    let mut roots: Vec<Option<RootRecord>> = vec![None; chart_count];
    let mut states: Vec<Retry> = vec![Retry::default(); chart_count];
    let mut pending: Vec<u32> = (0..chart_count as u32).collect();
    while !pending.is_empty() {
        let outcomes: Vec<(Outcome, Retry)> = pending
            .par_iter()
            .map(|&chart| {
                let retry = states[chart as usize].clone();
                let mut work = ChartWork { surface, borders, effort, chart, times: Times::default(), retry };
                let outcome = work.run();
                if let Ok(mut totals) = totals.lock() {
                    totals.add(&work.times);
                }
                progress.advance(1);
                (outcome, work.retry)
            })
            .collect();
        let mut wishes = vec![];
        for (&chart, (outcome, retry)) in pending.iter().zip(outcomes) {
            states[chart as usize] = retry;
            match outcome {
                Outcome::Done(record) => roots[chart as usize] = Some(*record),
                Outcome::Wishes(list) => wishes.extend(list),
            }
        }
        let (added, again) = borders.raise(surface, wishes)?;
        fallbacks.raised_samples += added;
        pending = again;
    }
    let times = totals.into_inner().unwrap_or_default();
    fallbacks.retried_charts = states.iter().filter(|state| state.tries > 1).count() as u64;
    fallbacks.unsimplified_charts = states.iter().filter(|state| state.tries > MAX_TRIES).count() as u64;
    Ok((roots.into_iter().flatten().collect(), times.stages()))
}

impl Times {
    fn add(&mut self, other: &Self) {
        self.cut += other.cut;
        self.simplify += other.simplify;
        self.encode += other.encode;
        self.certify += other.certify;
    }

    fn stages(&self) -> Vec<StageTime> {
        [("cut", self.cut), ("simplify", self.simplify), ("encode", self.encode), ("certify", self.certify)]
            .map(|(stage, cpu)| StageTime { stage, wall_seconds: 0.0, cpu_seconds: cpu.as_secs_f64() })
            .to_vec()
    }
}

/// What a chart remembers from tries that were not good enough.
#[derive(Clone, Debug, Default)]
struct Retry {
    tries: u32,
    /// Weight per chart vertex; empty while all are 1.
    importance: Vec<f32>,
}

/// Everything about one chart while its root is made.
struct ChartWork<'a> {
    surface: &'a Surface<'a>,
    borders: &'a Borders,
    effort: Effort,
    chart: u32,
    times: Times,
    retry: Retry,
}

/// One level of an irregular filling, coded.
struct CodedLevel {
    patch: Patch,
    positions: Vec<DVec3>,
    symbols: SymbolBuffer,
}

impl ChartWork<'_> {
    fn run(&mut self) -> Outcome {
        let start = thread_cpu_time();
        let cut = self.borders.cut(self.surface, self.chart);
        self.times.cut += thread_cpu_time() - start;

        let start = thread_cpu_time();
        let original = certify::Surface::new(&cut.original, &cut.mesh.triangles);
        self.times.certify += thread_cpu_time() - start;

        let finest = self.surface.scale.finest();
        let tolerance = self.surface.scale.tolerance;
        loop {
            self.retry.tries += 1;
            let keep_all = self.retry.tries > MAX_TRIES;
            if keep_all {
                let wishes = self.all_border_vertices(&cut);
                if !wishes.is_empty() {
                    return Outcome::Wishes(wishes);
                }
            }
            let simplified = self.simplify(&cut, keep_all);
            if !simplified.stuck.is_empty() {
                return Outcome::Wishes(self.wishes(&cut, simplified.stuck.iter().map(|s| (s.vertex, s.level))));
            }
            let coded: Vec<CodedLevel> = simplified
                .levels
                .iter()
                .flatten()
                .enumerate()
                .map(|(level, patch)| self.encode(&cut, patch, level as u8))
                .collect();

            // The finest level first: it decides whether the chart has to be done again.
            let start = thread_cpu_time();
            let finest_level = &coded[usize::from(finest)];
            let finest_surface = certify::Surface::new(&finest_level.positions, &finest_level.patch.triangles);
            let options = self.certify_options(0.0);
            let bound = two_sided(&original, &finest_surface, &options);
            if bound.upper > tolerance && !keep_all {
                let beyond = self.mark_exceeding(&cut, &original, finest_level, &finest_surface);
                self.times.certify += thread_cpu_time() - start;
                let wishes = self.wishes(&cut, beyond.into_iter().map(|v| (v, finest)));
                // Interior trouble is cured by importance; a border that lies too coarsely only by more samples.
                if self.retry.tries >= 2 && !wishes.is_empty() {
                    return Outcome::Wishes(wishes);
                }
                continue;
            }
            self.times.certify += thread_cpu_time() - start;
            return Outcome::Done(Box::new(self.record(&cut, &original, coded, bound.upper)));
        }
    }

    fn simplify(&mut self, cut: &CutChart, keep_all: bool) -> SimplifiedChart {
        let start = thread_cpu_time();
        let mut thresholds: Vec<f64> = self.surface.scale.levels.iter().map(|level| level.threshold).collect();
        if keep_all && let Some(finest) = thresholds.last_mut() {
            *finest = 0.0;
        }
        let importance = Some(self.retry.importance.as_slice()).filter(|weights| !weights.is_empty());
        let options = SimplifyOptions { thresholds: &thresholds, importance, min_triangles: 0 };
        let simplified = simplify_chart(&cut.mesh, &options);
        self.times.simplify += thread_cpu_time() - start;
        simplified
    }

    fn encode(&mut self, cut: &CutChart, level_patch: &LevelPatch, level: u8) -> CodedLevel {
        let start = thread_cpu_time();
        let step = self.surface.scale.step();
        let loops = border_loops(cut, level);
        let interior: Vec<[f64; 3]> = level_patch.interior.iter().map(|&p| (p / step).to_array()).collect();
        let target = PatchTarget { loops: &loops, interior: &interior, triangles: &level_patch.triangles };
        let quantisation = self.surface.scale.levels[usize::from(level)].quantisation;
        let shift = i32::from(quantisation.normal_shift) + i32::from(quantisation.tangent_shift);
        let slide = QuadricSlide { patch: level_patch, step, bound: 2f64.powi(shift) };
        let mut symbols = SymbolBuffer::default();
        let coded = encode_patch(&target, quantisation, &slide, &mut symbols);
        let patch = match coded {
            Ok((patch, _)) => patch,
            // Simplification keeps patches manifold with the given border, and Scale keeps them on the lattice.
            Err(error) => unreachable!("a simplified patch is codable: {error}"),
        };
        let points = loops.iter().flatten().chain(&patch.interior);
        let positions = points.map(|&p| self.surface.scale.local_from_lattice(p)).collect();
        self.times.encode += thread_cpu_time() - start;
        CodedLevel { patch, positions, symbols }
    }

    fn certify_options(&self, lower: f64) -> CertifyOptions {
        CertifyOptions { lower, floor: self.surface.scale.step() * 0.05, ..CertifyOptions::default() }
    }

    /// Raises the importance of the vertices around what is too far off; returns those of them on the border.
    fn mark_exceeding(
        &mut self,
        cut: &CutChart,
        original: &certify::Surface,
        coded: &CodedLevel,
        drawn: &certify::Surface,
    ) -> Vec<u32> {
        let tolerance = self.surface.scale.tolerance;
        let mut marked: Vec<u32> = exceeding(original, drawn, tolerance, u64::MAX)
            .into_iter()
            .flat_map(|t| cut.mesh.triangles[t as usize])
            .collect();
        // What the drawn side shows too far off is cured where the input is nearest.
        let mut hint = certify::Hint::default();
        for t in exceeding(drawn, original, tolerance, u64::MAX) {
            let corners = coded.patch.triangles[t as usize].map(|v| coded.positions[v as usize]);
            for p in corners.into_iter().chain([(corners[0] + corners[1] + corners[2]) / 3.0]) {
                let nearest = original.closest(p, &mut hint);
                marked.extend(cut.mesh.triangles[nearest.triangle as usize]);
            }
        }
        marked.sort_unstable();
        marked.dedup();
        self.retry.importance.resize(cut.original.len(), 1.0);
        for &v in &marked {
            self.retry.importance[v as usize] *= IMPORTANCE_STEP;
        }
        marked
    }

    /// Turns chart vertices into wishes for those of them that lie on the border.
    fn wishes(&self, cut: &CutChart, vertices: impl Iterator<Item = (u32, u8)>) -> Vec<Raise> {
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
                if has > level {
                    wishes.push(Raise { arc, path_index, level });
                }
            }
        }
        wishes
    }

    fn all_border_vertices(&self, cut: &CutChart) -> Vec<Raise> {
        let finest = self.surface.scale.finest();
        let vertices = cut.mesh.loops.iter().flatten().filter(|b| b.level == NEVER).map(|b| (b.vertex, finest));
        self.wishes(cut, vertices)
    }

    /// Certifies the coarser levels and keeps the blocks that are worth their bytes.
    fn record(
        &mut self,
        cut: &CutChart,
        original: &certify::Surface,
        coded: Vec<CodedLevel>,
        finest_error: f64,
    ) -> RootRecord {
        let start = thread_cpu_time();
        let deviations = self.borders.deviations(self.surface, self.chart);
        let finest = coded.len() - 1;
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &p in cut.original.iter().chain(coded.iter().flat_map(|level| &level.positions)) {
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        let mut blocks: Vec<Option<BlockRecord>> = Vec::with_capacity(coded.len());
        let mut best = f64::INFINITY;
        for (level, coded_level) in coded.into_iter().enumerate() {
            let error = if level == finest {
                finest_error
            } else {
                let drawn = certify::Surface::new(&coded_level.positions, &coded_level.patch.triangles);
                two_sided(original, &drawn, &self.certify_options(0.0)).upper
            };
            let needed = level == finest && best > self.surface.scale.tolerance;
            if level > 0 && !needed && error > best * WORTHWHILE {
                blocks.push(None);
                continue;
            }
            best = error;
            blocks.push(Some(BlockRecord {
                error,
                border_deviation: deviations[level],
                triangle_count: coded_level.patch.triangles.len() as u32,
                symbols: coded_level.symbols,
            }));
        }
        self.times.certify += thread_cpu_time() - start;
        let origin = DVec3::from_array(self.surface.scale.lattice.origin);
        let loops = self.surface.atlas.charts[self.chart as usize].loops.iter();
        RootRecord {
            filling: Filling::Irregular,
            loops: loops
                .map(|l| l.iter().map(|h| lodpack::HalfArc { arc: h.arc, reversed: h.reversed }).collect())
                .collect(),
            bounds: bounds.map(|p| (p + origin).to_array()),
            blocks,
        }
    }
}

/// Lattice positions of the border samples of a level, loop after loop.
fn border_loops(cut: &CutChart, level: u8) -> Vec<Vec<LatticePoint>> {
    let loops = cut.mesh.loops.iter().zip(&cut.lattice);
    loops
        .map(|(border, points)| {
            border.iter().zip(points).filter(|(b, _)| b.level <= level).filter_map(|(_, p)| *p).collect()
        })
        .collect()
}

/// Slides vertices to the minimum of their quadrics.
struct QuadricSlide<'a> {
    patch: &'a LevelPatch,
    /// Lattice step.
    step: f64,
    /// How far a vertex may slide from its plain projection, in lattice steps: one tangential step.
    bound: f64,
}

impl Slide for QuadricSlide<'_> {
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64 {
        // Quadrics are functions of the offset from the wanted position. A share of the plain distance keeps directions
        // along which the quadric is nearly flat from running away, and so does the bound: the tangential step is all that
        // sliding has to make up for.
        const PLAIN_SHARE: f64 = 0.05;
        let quadric = &self.patch.interior_quadrics[vertex as usize];
        let wanted = self.patch.interior[vertex as usize];
        let (direction, start) = (DVec3::from_array(normal), DVec3::from_array(point) * self.step - wanted);
        let plain = -start.dot(direction) / self.step;
        let along = |x: DVec3| quadric.half_gradient(x) - quadric.half_gradient(DVec3::ZERO);
        let trace = DVec3::AXES.map(|axis| along(axis).dot(axis)).iter().sum::<f64>();
        let share = PLAIN_SHARE * trace;
        let slope = (quadric.half_gradient(start) + start * share).dot(direction);
        let offset = -slope / (along(direction).dot(direction) + share) / self.step;
        if offset.is_finite() { offset.clamp(plain - self.bound, plain + self.bound) } else { plain }
    }
}

/// The model that the format layer writes.
pub(super) fn assemble(surface: &Surface, borders: Borders, roots: Vec<RootRecord>) -> Model {
    let scale = surface.scale;
    let arcs = surface.atlas.arcs.iter().zip(borders.samples);
    Model {
        lattice: scale.lattice,
        arc_tangent_shift: ARC_TANGENT_SHIFT,
        grid_quantisation: scale.levels[usize::from(scale.finest())].quantisation,
        levels: scale
            .levels
            .iter()
            .map(|level| LevelInfo { tolerance: level.tolerance, quantisation: level.quantisation })
            .collect(),
        source: SourceInfo {
            triangle_count: surface.mesh.triangles.len() as u64,
            vertex_count: surface.mesh.positions.len() as u64,
            mean_edge_length: scale.mean_edge_length,
            area: (0..surface.mesh.triangles.len() as u32)
                .map(|t| {
                    let [a, b, c] = surface.mesh.corners(t);
                    (b - a).cross(c - a).length() * 0.5
                })
                .sum(),
            generator: concat!("lodpack ", env!("CARGO_PKG_VERSION")).into(),
        },
        corners: borders.corners,
        arcs: arcs.map(|(arc, samples)| ArcRecord { ends: arc.ends, samples }).collect(),
        roots,
    }
}
