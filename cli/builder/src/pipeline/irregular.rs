//! An irregular filling: simplify, code, certify; then again where the bound is above the tolerance.

use super::Scale;
use super::chart_work::{ALMOST, ChartWork, CodedLevel, Outcome, border_loops};
use super::divided::{behind_flat_ears, border_vertices, divide};
use super::fill::{ChartFilling, FillingRow};
use super::shared_arcs::{CutChart, SampleWish};
use glam::DVec3;
use lodpack::{
    LatticePoint,
    decode::Patch,
    index::Filling,
    write::{PatchTarget, Slide, SymbolBuffer, encode_refined_patch},
};
use lodpack_mesh::NONE;
use lodpack_mesh::exact::power_of_two;
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::areas::{Areas, Jumps};
use lodpack_stage::certify::{self, Comparison};
use lodpack_stage::chart::NEVER;
use lodpack_stage::simplify::{Early, LevelPatch, SimplifiedChart, SimplifyOptions, simplify_again};
use std::borrow::Cow;
use std::collections::HashMap;

/// How often a chart is simplified again before its finest level is the input itself.
pub(super) const MAX_FAILURES: u32 = 8;
/// Factor on a vertex's quadric where the bound was above the tolerance: five times as near there. After two failures
/// hardly anything is collapsed there any more.
const IMPORTANCE_STEP: f32 = 32.0;
/// The number of failures that are answered locally, where the bound was exceeded.
const LOCAL_FAILURES: u32 = 6;
/// The number of these that are answered by weights at the triangles in question alone. Only then their neighbourhood,
/// or the step along the surface, is taken to be the cause.
const NEAREST_FAILURES: u32 = 3;
/// Factor on the finest threshold with every failure after those.
const FINER: f64 = 0.4;

/// In a mesh of at most this many triangles, a chart that is off by more than this share of the tolerance is made
/// again, with more weight where it is off by more than that. That is a tenth of the charts, so that large meshes would
/// take a tenth longer; in small ones a largest distance in one place shows.
const SMALL: usize = 250_000;
const NEAR: f64 = 0.9;
const FAR: f64 = 0.75;
/// The factor by which its triangles may grow then.
const HARDLY_MORE: f64 = 1.02;

/// How often the tangential step is halved where colours jump.
const LINE_REFINEMENT: u32 = 3;

/// The filling's row in the table.
pub(super) const ROW: FillingRow =
    FillingRow { filling: Filling::Irregular, steps: |_, level| level.quantisation, challenge: None };

/// An irregular filling of a chart.
#[derive(Debug, Default)]
pub(super) struct IrregularFilling {
    /// Weight per chart vertex for the simplifier, as the attempts above the tolerance have raised it; empty while all
    /// are 1.
    importance: Vec<f32>,
}

impl ChartFilling for IrregularFilling {
    fn filling(&self) -> Filling {
        Filling::Irregular
    }

    fn fill(
        &mut self,
        work: &mut ChartWork,
        cut: &CutChart,
        original: &certify::Surface,
        failures: &mut u32,
    ) -> Outcome {
        work.fill_irregularly(cut, original, failures, &mut self.importance)
    }
}

/// A chart simplified and coded, coarsest level first, and how far its finest level is off.
struct Attempt {
    coded: Vec<Option<CodedLevel>>,
    compared: Comparison,
    error: f64,
}

impl Attempt {
    /// Whether it is nearer than another, with hardly more triangles.
    fn is_better_than(&self, other: &Self) -> bool {
        let triangles = |attempt: &Self| {
            let finest = attempt.coded.last().and_then(Option::as_ref);
            finest.map_or(0.0, |finest| finest.patch.triangles.len() as f64)
        };
        self.error < other.error && triangles(self) <= HARDLY_MORE * triangles(other)
    }
}

impl ChartWork<'_> {
    /// See [`IrregularFilling::fill`].
    fn fill_irregularly(
        &mut self,
        cut: &CutChart,
        original: &certify::Surface,
        failures: &mut u32,
        importance: &mut Vec<f32>,
    ) -> Outcome {
        let finest = self.charted.scale.finest();
        let limit = self.charted.scale.error_limit;
        let mut early = None;
        loop {
            let keep_all = *failures >= MAX_FAILURES;
            // One attempt takes the whole border as samples. Beyond that, wishes have proved vain.
            if *failures == MAX_FAILURES {
                let wishes = self.all_border_vertices(cut);
                if !wishes.is_empty() {
                    return Outcome::Wishes(wishes);
                }
            }
            let mut attempt = match self.attempt(cut, original, importance, *failures, &mut early) {
                Ok(attempt) => attempt,
                Err(wishes) => return Outcome::Wishes(wishes),
            };
            if attempt.error <= limit || keep_all {
                // Several parts are bounded no closer than that.
                if !keep_all && attempt.compared.part_count() == 1 && self.is_worth_another(attempt.error) {
                    let far = self.exceeding(&mut attempt.compared, FAR);
                    let mut importance = importance.clone();
                    raise(&mut importance, &with_rings(&cut.mesh.triangles, far, 1), cut.original.len());
                    let again = self.attempt(cut, original, &importance, *failures, &mut early);
                    attempt = again.ok().filter(|again| again.is_better_than(&attempt)).unwrap_or(attempt);
                }
                let Attempt { coded, compared, error } = attempt;
                let rms = self.rms(cut, &compared);
                return Outcome::Done(Box::new(self.root(cut, original, Filling::Irregular, coded, [error, rms])));
            }
            *failures += 1;
            let triangles = self.exceeding(&mut attempt.compared, ALMOST);
            // Triangles may be too far off because of their neighbourhood, so every later failure takes in one more
            // ring.
            let rings = 1 + failures.saturating_sub(NEAREST_FAILURES);
            let beyond = with_rings(&cut.mesh.triangles, triangles, rings as usize);
            raise(importance, &beyond, cut.original.len());
            let wishes = self.wishes(cut, beyond.into_iter().map(|v| (v, finest)));
            // Importance helps the interior; only more samples help a border that is too coarse.
            if *failures >= 2 && !wishes.is_empty() {
                return Outcome::Wishes(wishes);
            }
        }
    }

    /// Whether a chart that is so far off, within the tolerance, is to be nearer.
    fn is_worth_another(&self, error: f64) -> bool {
        self.charted.mesh.triangles.len() <= SMALL && error > NEAR * self.charted.scale.error_limit
    }

    /// Simplifies, codes and measures the chart; what it wishes if it cannot.
    fn attempt(
        &mut self,
        cut: &CutChart,
        original: &certify::Surface,
        importance: &[f32],
        failures: u32,
        early: &mut Option<Early>,
    ) -> Result<Attempt, Vec<SampleWish>> {
        let mut simplified = self.simplify(cut, importance, failures, early);
        if !simplified.stuck.is_empty() {
            let wishes = self.wishes(cut, simplified.stuck.iter().map(|s| (s.vertex, s.level)));
            if !wishes.is_empty() {
                return Err(wishes);
            }
            // The stuck vertices lie on seams, whose samples are fixed.
            simplified.cap_missing(&cut.mesh, usize::from(self.charted.coarsest));
        }
        if !self.divided.is_empty() {
            self.divide(cut, &mut simplified);
        }
        let coded: Vec<Option<CodedLevel>> = (0..)
            .zip(&simplified.levels)
            .map(|(level, patch)| patch.as_ref().map(|patch| self.encode(cut, patch, level, failures)))
            .collect();
        // The finest level first: it decides whether the chart needs another attempt.
        let Some(Some(finest_level)) = coded.last() else { unreachable!("a missing level has been capped") };
        let mut compared = self.compared(original, cut, self.charted.scale.finest(), finest_level);
        let error = self.certify_within(&mut compared);
        Ok(Attempt { coded, compared, error })
    }

    /// `early` serves all attempts that differ in weights alone.
    fn simplify(
        &mut self,
        cut: &CutChart,
        importance: &[f32],
        failures: u32,
        early: &mut Option<Early>,
    ) -> SimplifiedChart {
        let start = thread_cpu_time();
        let mut thresholds: Vec<f64> = self.charted.scale.levels.iter().map(|level| level.threshold).collect();
        if let Some(finest) = thresholds.last_mut() {
            // First only local weights, then a finer threshold for the whole chart, then the chart as it is.
            *finest *= match failures {
                0..LOCAL_FAILURES => 1.0,
                LOCAL_FAILURES..MAX_FAILURES => (LOCAL_FAILURES..=failures).map(|_| FINER).product(),
                MAX_FAILURES.. => 0.0,
            };
        }
        let importance = Some(importance).filter(|weights| !weights.is_empty());
        let coarsest = usize::from(self.charted.coarsest);
        let of_triangles = self.charted.areas_of(self.chart);
        let areas = Areas::of(&of_triangles, self.charted.jumps());
        let options = SimplifyOptions {
            thresholds: &thresholds,
            coarsest,
            importance,
            min_triangles: 0,
            areas,
            ..SimplifyOptions::default()
        };
        let simplified = simplify_again(&cut.mesh, &options, (failures < LOCAL_FAILURES).then_some(early));
        self.times.simplify += thread_cpu_time() - start;
        simplified
    }

    /// Divides the edges of `divided` in the patches of all levels.
    fn divide(&self, cut: &CutChart, simplified: &mut SimplifiedChart) {
        for (level, patch) in (0..).zip(&mut simplified.levels) {
            let Some(patch) = patch else { continue };
            let vertices = border_vertices(self.charted, cut, level);
            // A border may touch a vertex twice.
            let places = |vertex: u32| (0..).zip(&vertices).filter(move |&(_, &v)| v == vertex).map(|(place, _)| place);
            let edges =
                self.divided.iter().flat_map(|&[a, b]| places(a).flat_map(move |a| places(b).map(move |b| [a, b])));
            let border: Vec<DVec3> = patch.border.iter().map(|&v| cut.mesh.positions[v as usize]).collect();
            divide(patch, &border, &edges.collect::<Vec<_>>());
        }
    }

    fn encode(&mut self, cut: &CutChart, level_patch: &LevelPatch, level: u8, failures: u32) -> CodedLevel {
        let start = thread_cpu_time();
        // Where the bound is exceeded again and again, the tangential step may be the cause.
        let is_finest = level == self.charted.scale.finest();
        let refinement = if is_finest { failures.saturating_sub(NEAREST_FAILURES) } else { 0 };
        let refinement = refinement.max(refinement_of_lines(level_patch, self.charted.jumps()));
        let coded = code(self.charted.scale, level, &border_loops(cut, level), level_patch, refinement);
        let Coded { patch, symbols, areas, was } = match coded {
            Ok(coded) => coded,
            // Simplification keeps patches manifold with the given border, and `Scale` keeps them within the lattice.
            Err(error) => unreachable!("a simplified patch is codable: {error}"),
        };
        self.times.encode += thread_cpu_time() - start;
        CodedLevel { areas, was, ..self.coded_level(cut, level, patch, symbols) }
    }

    fn all_border_vertices(&self, cut: &CutChart) -> Vec<SampleWish> {
        let finest = self.charted.scale.finest();
        let vertices = cut.mesh.loops.iter().flatten().filter(|b| b.level == NEVER).map(|b| (b.vertex, finest));
        self.wishes(cut, vertices)
    }
}

/// How often the tangential step of a patch is halved because colours jump at lines in it: steps along the surface move
/// these across, and nothing slides back.
pub(super) fn refinement_of_lines(level_patch: &LevelPatch, jumps: Option<&Jumps>) -> u32 {
    let has_lines = Areas::of(&level_patch.areas, jumps).is_some_and(|areas| areas.have_jumps());
    if has_lines { LINE_REFINEMENT } else { 0 }
}

/// A simplified patch as it is coded.
pub(super) struct Coded {
    pub patch: Patch,
    pub symbols: SymbolBuffer,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
    /// The chart-local vertex that each vertex was; empty if unknown.
    pub was: Vec<u32>,
}

/// Codes a simplified patch with the border `loops`, and with a finer tangential step the more often it is to be
/// halved.
pub(super) fn code(
    scale: &Scale,
    level: u8,
    loops: &[Vec<LatticePoint>],
    level_patch: &LevelPatch,
    refinement: u32,
) -> Result<Coded, lodpack::write::EncodeError> {
    let step = scale.step();
    let border: Vec<DVec3> = loops.iter().flatten().map(|&point| scale.local_from_lattice(point)).collect();
    let flat = behind_flat_ears(level_patch, &border);
    let mut level_patch = Cow::Borrowed(level_patch);
    if !flat.is_empty() {
        divide(level_patch.to_mut(), &border, &flat);
    }
    let level_patch = &*level_patch;
    let interior: Vec<[f64; 3]> = level_patch.interior.iter().map(|&p| (p / step).to_array()).collect();
    let target = PatchTarget { loops, interior: &interior, triangles: &level_patch.triangles };
    let quantisation = scale.levels[usize::from(level)].quantisation;
    let refinement = refinement.min(u32::from(quantisation.tangent_shift)) as u8;
    let shift = i32::from(quantisation.normal_shift) + i32::from(quantisation.tangent_shift - refinement);
    let slide = QuadricSlide { patch: level_patch, step, bound: power_of_two(shift) };
    let mut symbols = SymbolBuffer::default();
    let (patch, order) = encode_refined_patch(&target, quantisation, refinement, &slide, &mut symbols)?;
    let areas = areas_in_order(level_patch, &patch, &order);
    let of_inside = order.iter().filter_map(|&inside| level_patch.interior_was.get(inside as usize));
    let is_known = level_patch.interior_was.len() == level_patch.interior.len();
    let was = if is_known { level_patch.border.iter().chain(of_inside).copied().collect() } else { vec![] };
    Ok(Coded { patch, symbols, areas, was })
}

/// The areas of a patch's triangles, which are those of a simplified patch in another order. `order` are the interior
/// vertices of that.
fn areas_in_order(level_patch: &LevelPatch, patch: &Patch, order: &[u32]) -> Vec<u32> {
    if level_patch.areas.is_empty() {
        return vec![];
    }
    let from_smallest = |corners: [u32; 3]| {
        let [a, b, c] = corners;
        let least = a.min(b).min(c);
        if least == a {
            corners
        } else if least == b {
            [b, c, a]
        } else {
            [c, a, b]
        }
    };
    let known: HashMap<[u32; 3], u32> = level_patch
        .triangles
        .iter()
        .map(|&corners| from_smallest(corners))
        .zip(level_patch.areas.iter().copied())
        .collect();
    let border = level_patch.border.len() as u32;
    let before = |v: u32| v.checked_sub(border).map_or(v, |inside| border + order[inside as usize]);
    let area = |corners: &[u32; 3]| known.get(&from_smallest(corners.map(before))).copied().unwrap_or(NONE);
    patch.triangles.iter().map(area).collect()
}

/// Raises the weights of some of `count` vertices.
fn raise(importance: &mut Vec<f32>, vertices: &[u32], count: usize) {
    importance.resize(count, 1.0);
    vertices.iter().for_each(|&v| importance[v as usize] *= IMPORTANCE_STEP);
}

/// The vertices of some triangles of a mesh and of the rings of triangles around them, ascending.
pub(super) fn with_rings(mesh: &[[u32; 3]], mut triangles: Vec<u32>, rings: usize) -> Vec<u32> {
    let mut vertices = vec![];
    for _ in 0..rings {
        vertices = vertices_of(mesh, &triangles);
        triangles = triangles_around(mesh, &vertices);
    }
    vertices
}

/// The vertices of some triangles, ascending.
fn vertices_of(mesh: &[[u32; 3]], triangles: &[u32]) -> Vec<u32> {
    let mut vertices: Vec<u32> = triangles.iter().flat_map(|&t| mesh[t as usize]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The triangles with at least one of some ascending vertices, ascending.
fn triangles_around(mesh: &[[u32; 3]], vertices: &[u32]) -> Vec<u32> {
    let touches = |t: &[u32; 3]| t.iter().any(|v| vertices.binary_search(v).is_ok());
    (0..).zip(mesh).filter(|(_, t)| touches(t)).map(|(index, _)| index).collect()
}

/// Slides vertices to the minimum of their quadrics.
pub(super) struct QuadricSlide<'a> {
    pub patch: &'a LevelPatch,
    /// Lattice step.
    pub step: f64,
    /// How far a vertex may slide from its projection, in lattice steps: one tangential step.
    pub bound: f64,
}

impl Slide for QuadricSlide<'_> {
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64 {
        // Quadrics are functions of the offset from the wanted position. Along directions in which the quadric is
        // nearly flat the minimum may be far away; a share of the plain squared distance prevents that, and so does the
        // bound. Sliding only has to make up for the tangential step.
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
