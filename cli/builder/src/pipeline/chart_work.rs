//! One chart on its way to a root: what all fillings share.

use super::divided::{self, Edge, border_vertices};
use super::drawn::{DrawnBlocks, DrawnPatch};
use super::groups::top::{Few, reduce_top};
use super::overview::OVERVIEW_TRIANGLES;
use super::owners::ChartObjects;
use super::shared_arcs::{CutChart, SampleWish, SharedArcs};
use super::summary::Times;
use super::{ChartedMesh, Scale};
use crate::reduce::CoarseSurface;
use glam::DVec3;
use lodpack::{
    LatticePoint,
    decode::Patch,
    index::Filling,
    write::{BlockRecord, RootRecord, SymbolBuffer},
};
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::certify::{BorderPairing, CertifyOptions, Comparison, PairedVertex, Surface};

/// Share by which a certified error may exceed the true one.
const CERTIFY_GAP: f64 = 0.05;
/// A finer irregular block is left out unless its error is below this multiple of the coarser one's.
const WORTHWHILE: f64 = 0.8;
/// Distances below this share of the tolerance need not be resolved in charts of several parts.
const FLOOR_OF_PARTS: f64 = 0.75;
/// Share by which the errors of two levels differ at least, and the same of a lattice step. A file rounds them up by
/// less than half of it.
const APART: f64 = 1.0 / 128.0;
/// Where a chart is above the tolerance, what exceeds this share of it is too far off: there is always something, then.
pub(super) const ALMOST: f64 = 0.9;
/// Points of a chart at which its root mean square error is estimated.
const RMS_POINTS: usize = 500;

/// A root, and what is known of it beside its record.
#[derive(Clone, Debug)]
pub(super) struct Root {
    pub record: RootRecord,
    /// The patch of its coarsest level, from which groups are made.
    pub coarsest: Patch,
    /// What is drawn at each level, if it is to have texels.
    pub drawn: DrawnBlocks,
    /// Interior vertices of all blocks.
    pub vertices: u64,
    /// Root mean square distance of some hundreds of input vertices from the finest level, in input units.
    pub rms: f64,
    /// The edges inside its finest patch between vertices of its border.
    pub chords: Vec<Edge>,
}

/// The outcome of one attempt to fill a chart.
pub(super) enum Outcome {
    Done(Box<Root>),
    /// The chart first needs these samples on its arcs.
    Wishes(Vec<SampleWish>),
    /// The filling cannot meet the tolerance on this chart.
    Unfit,
}

/// One chart while its root is made, and the time that this takes.
pub(super) struct ChartWork<'a> {
    pub charted: &'a ChartedMesh<'a>,
    pub arcs: &'a SharedArcs,
    pub chart: u32,
    /// Edges that get a vertex in their middle.
    pub divided: Vec<Edge>,
    pub times: Times,
}

/// One level of a filling, coded.
#[derive(Clone)]
pub(super) struct CodedLevel {
    pub patch: Patch,
    /// The patch's vertices as they decode, relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    /// The chart-local vertex that each of these was, or [`NONE`](lodpack_mesh::NONE); empty if unknown.
    pub was: Vec<u32>,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
    pub symbols: SymbolBuffer,
}

impl CodedLevel {
    pub fn surface(&self) -> Surface<'_> {
        Surface::new(&self.positions, &self.patch.triangles)
    }
}

impl ChartWork<'_> {
    /// Cuts the chart out of the mesh.
    pub fn cut(&mut self) -> CutChart {
        let start = thread_cpu_time();
        let cut = self.arcs.cut(self.charted, self.chart);
        self.times.cut += thread_cpu_time() - start;
        cut
    }

    /// The patch of a level with its border, at the positions that a reader will decode.
    pub fn coded_level(&self, cut: &CutChart, level: u8, patch: Patch, symbols: SymbolBuffer) -> CodedLevel {
        let loops = border_loops(cut, level);
        let points = loops.iter().flatten().chain(&patch.interior);
        let positions = points.map(|&p| self.charted.scale.local_from_lattice(p)).collect();
        CodedLevel { patch, positions, was: vec![], areas: vec![], symbols }
    }

    /// The input's chart beside a decoded level.
    pub fn compared(&mut self, original: &Surface, cut: &CutChart, level: u8, coded: &CodedLevel) -> Comparison {
        let start = thread_cpu_time();
        let compared = Comparison::new(original, &coded.surface(), &seam(cut, level), coded.was.clone());
        self.times.certify += thread_cpu_time() - start;
        compared
    }

    /// Bounds the distance between the input's chart and the decoded patch, both ways.
    pub fn certify(&mut self, compared: &mut Comparison) -> f64 {
        let start = thread_cpu_time();
        let Scale { error_limit, .. } = *self.charted.scale;
        // One of many parts is nearly as far off as it may be.
        let is_in_parts = compared.part_count() > 1;
        let floor = if is_in_parts { error_limit * FLOOR_OF_PARTS } else { self.charted.scale.step() * 0.05 };
        let options = CertifyOptions { relative_gap: CERTIFY_GAP, floor, ..CertifyOptions::default() };
        let bound = compared.two_sided(&options).upper;
        self.times.certify += thread_cpu_time() - start;
        bound
    }

    /// As [`Self::certify`], tightened as far as needed to prove, where it is true, that the stored error is within the
    /// tolerance.
    pub fn certify_within(&mut self, compared: &mut Comparison) -> f64 {
        let mut error = self.certify(compared);
        let start = thread_cpu_time();
        let Scale { tolerance, error_limit, .. } = *self.charted.scale;
        // The file rounds errors up. Most bounds between `error_limit` and the tolerance can be proven to be below it.
        for (target, most) in [(tolerance, tolerance * (1.0 + CERTIFY_GAP)), (error_limit, tolerance)] {
            if error > target && error <= most {
                let options = CertifyOptions { target: Some(target), relative_gap: 0.002, ..CertifyOptions::default() };
                error = error.min(compared.two_sided(&options).upper);
            }
        }
        self.times.certify += thread_cpu_time() - start;
        error
    }

    /// The chart's triangles where the patch is farther from them, or they from the patch, than the given number of
    /// tolerances, ascending.
    pub fn exceeding(&mut self, compared: &mut Comparison, tolerances: f64) -> Vec<u32> {
        let start = thread_cpu_time();
        let found = compared.exceeding(self.charted.scale.tolerance * tolerances, u64::MAX);
        self.times.certify += thread_cpu_time() - start;
        found
    }

    /// Wishes for those of some vertices that lie on the border. Nothing is wished of seams, whose samples are fixed.
    pub fn wishes(&self, cut: &CutChart, vertices: impl Iterator<Item = (u32, u8)>) -> Vec<SampleWish> {
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
                if has > level && self.charted.atlas.arcs[arc as usize].seam.is_none() {
                    wishes.push(SampleWish { arc, path_index, level });
                }
            }
        }
        wishes
    }

    /// Certifies the coarser levels and keeps the blocks that are worth their bytes. The finest level's certified error
    /// and root mean square distance are known. A nested filling keeps all its levels, because each builds on the
    /// coarser ones.
    pub fn root(
        &mut self,
        cut: &CutChart,
        original: &Surface,
        filling: Filling,
        coded: Vec<Option<CodedLevel>>,
        [finest_error, rms]: [f64; 2],
    ) -> Root {
        let deviations = self.arcs.deviations(self.charted, self.chart);
        let last = coded.iter().rposition(Option::is_some).unwrap_or(0);
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &p in cut.original.iter().chain(coded.iter().flatten().flat_map(|level| &level.positions)) {
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        // All of a file, if it has to have a top of few triangles.
        let is_top = self.charted.coarsest == 0
            && self.charted.atlas.charts.len() == 1
            && cut.mesh.loops.is_empty()
            && !filling.is_nested();
        let crowded = coded.last().and_then(Option::as_ref).filter(|_| is_top);
        let crowded = crowded.filter(|finest| finest.patch.triangles.len() > OVERVIEW_TRIANGLES).cloned();
        let objects = ChartObjects::of(self.charted, self.chart, cut, original);
        let mut blocks: Vec<Option<BlockRecord>> = Vec::with_capacity(coded.len());
        let mut drawn: DrawnBlocks = if self.charted.has_channels { vec![None; coded.len()] } else { vec![] };
        let (mut best, mut vertices, mut coarser) = (f64::INFINITY, 0, 0);
        // The stored error of a block includes what finer neighbours move at its border while finer levels are missing.
        let mut best_stored = f64::INFINITY;
        let (mut coarsest, mut finest) = (Patch::default(), (0, Patch::default()));
        for (level, coded_level) in coded.into_iter().enumerate() {
            let Some(coded_level) = coded_level else {
                blocks.push(None);
                continue;
            };
            let error = if level == last {
                finest_error
            } else {
                let mut compared = self.compared(original, cut, level as u8, &coded_level);
                self.certify(&mut compared)
            };
            // A flat patch may be as near as it has to be at a coarse level, but lines end at samples of the finest
            // one.
            let has_lines = level == last
                && self.charted.jumps_inside(self.chart)
                && blocks.iter().flatten().last().is_some_and(|coarser: &BlockRecord| {
                    (coarser.triangle_count as usize) < coded_level.patch.triangles.len()
                });
            let needed =
                filling.is_nested() || has_lines || level == last && best_stored > self.charted.scale.tolerance;
            if best.is_finite() && !needed && error > best * WORTHWHILE {
                blocks.push(None);
                continue;
            }
            if best.is_infinite() && self.charted.coarsest > 0 {
                coarsest = coded_level.patch.clone();
            }
            let owners = objects.as_ref().map_or(vec![], |objects| {
                let CodedLevel { patch, positions, was, .. } = &coded_level;
                objects.owners(level as u8, &patch.triangles, positions, was)
            });
            if let Some(drawn) = drawn.get_mut(level) {
                let Patch { interior, triangles, .. } = &coded_level.patch;
                let border = border_loops(cut, level as u8);
                let positions = border.into_iter().flatten().chain(interior.iter().copied()).collect();
                *drawn = Some(DrawnPatch { positions, triangles: triangles.clone(), areas: coded_level.areas });
            }
            best = error;
            best_stored = lodpack::write::stored_error(error, deviations[level], &self.charted.scale.lattice)
                .unwrap_or(f64::INFINITY);
            let interior = coded_level.patch.interior.len() as u64;
            vertices += interior - coarser;
            coarser = if filling.is_nested() { interior } else { 0 };
            blocks.push(Some(BlockRecord {
                error,
                border_deviation: deviations[level],
                triangle_count: coded_level.patch.triangles.len() as u32,
                symbols: coded_level.symbols,
                texels: vec![],
                owners,
            }));
            finest = (level as u8, coded_level.patch);
        }
        let chords = divided::chords(&finest.1, &border_vertices(self.charted, cut, finest.0));
        if let Some(CodedLevel { patch, positions, .. }) = crowded {
            let whole = CoarseSurface { positions, triangles: patch.triangles, error: finest_error };
            let few = if self.charted.jumps_inside(self.chart) { Few::Lines } else { Few::Surface };
            let before = objects.is_some().then(|| (blocks.clone(), drawn.clone(), bounds));
            let reduced =
                reduce_top(&whole, &mut blocks[..last], self.charted.scale, few, &mut drawn, &mut bounds, false);
            if let (Some(objects), Some((level, surface))) = (&objects, &reduced.replaced) {
                let owners = objects.owners_of(&surface.positions, &surface.triangles);
                match (owners, before, &mut blocks[usize::from(*level)]) {
                    (Some(owners), _, Some(block)) => block.owners = owners,
                    // Objects must not grow together.
                    (_, Some(before), _) => (blocks, drawn, bounds) = before,
                    _ => {}
                }
            }
        }
        raise_coarser(&mut blocks, None, self.charted.scale.step());
        let origin = DVec3::from_array(self.charted.scale.lattice.origin);
        let record = RootRecord {
            filling,
            parent: None,
            loops: record_loops(&self.charted.atlas.charts[self.chart as usize].loops),
            bounds: bounds.map(|p| (p + origin).to_array()),
            blocks,
        };
        Root { record, coarsest, drawn, vertices, rms, chords }
    }

    /// Root mean square distance of evenly chosen input vertices from the patch.
    pub fn rms(&mut self, cut: &CutChart, compared: &Comparison) -> f64 {
        let start = thread_cpu_time();
        let squares = compared.squares(cut.original.len().div_ceil(RMS_POINTS).max(1));
        self.times.certify += thread_cpu_time() - start;
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// Gives coarser blocks larger bounds than finer ones, the finest a larger one than that of what lies `below`: then
/// refinement always lowers the error. A coarser level may happen to be closer than a finer one, above all where the
/// vertices of a nested filling serve all levels.
pub(super) fn raise_coarser(blocks: &mut [Option<BlockRecord>], below: Option<f64>, step: f64) {
    let mut finer = below;
    for block in blocks.iter_mut().rev().flatten() {
        let least = finer.map_or(0.0, |finer| finer * (1.0 + APART) + step * APART);
        block.error = block.error.max(least);
        finer = Some(block.error);
    }
}

/// Loops as records have them.
pub(super) fn record_loops(loops: &[Vec<HalfArc>]) -> Vec<Vec<lodpack::index::HalfArc>> {
    let half_arc = |&HalfArc { arc, reversed }: &HalfArc| lodpack::index::HalfArc { arc, reversed };
    loops.iter().map(|half_arcs| half_arcs.iter().map(half_arc).collect()).collect()
}

/// The border vertices of a chart, and which of them are drawn at a level as which vertex of the patch.
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
