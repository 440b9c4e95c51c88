//! Decides when blocks get texels: a group right after its members, so that few texels wait, however large a region is.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use lodpack::write::{BlockRecord, RootRecord, texel_size};
use rayon::prelude::*;

use super::ChartedMesh;
use super::drawn::{DrawnBlocks, DrawnPatch};
use super::region_progress::RegionProgress;
use super::shared_arcs::SharedArcs;
use super::texels::{DENSITY, InputSource, TrianglesAround, storage};
use lodpack_mesh::NONE;
use lodpack_mesh::appearance::{Appearance, ScalarRange};
use lodpack_mesh::attributes::RegionAttributes;
use lodpack_runtime::machine::{return_large_blocks, thread_cpu_time};
use lodpack_runtime::storage::memory::{Pool, texel_memory};
use lodpack_runtime::trace;
use lodpack_stage::areas::{Areas, Jumps};
use lodpack_stage::bake::{
    Baked, BakedPatch, Baker, Coarse, Located, MAX_EXPONENT, MAX_TEXELS, Storage, Surfels, area_of_texel, baking_bytes,
    exponent_of,
};
use lodpack_stage::shade::Shader;

/// Texels of a map for each that the surface covers, about: pieces do not fill their image.
const SPREAD: f64 = 1.5;
/// How much finer texels of the finest block are where colours jump and triangles have few texels, as a power of the
/// root of two. What is blurred over a texel beside each line costs more there than twice as many texels, which lines
/// cut up or leave alike.
const FINER_WITH_JUMPS: u32 = 1;
/// Texels of the input for each of its triangles that are few in this sense.
const FEW_TEXELS: f64 = 100.0;

/// A region whose blocks get texels.
pub(super) struct PaintedRegion<'a> {
    pub charted: &'a ChartedMesh<'a>,
    pub arcs: &'a SharedArcs,
    pub attributes: &'a RegionAttributes,
    pub appearance: &'a Appearance,
    /// How many texels the finest blocks have for each of the input.
    pub texel_share: f64,
    pub studio: &'a Studio<'a>,
}

/// What all regions are painted with.
pub(crate) struct Studio<'a> {
    pub shader: Shader<'a>,
    /// Memory for the maps that are baked at a time.
    baking: Pool,
    /// How many bytes each thread may keep between maps.
    kept: u64,
}

impl<'a> Studio<'a> {
    /// With a share of the memory of a build; otherwise as [`Shader::new`].
    pub fn new(
        appearance: &'a Appearance,
        folder: Option<&'a Path>,
        scratch: &Path,
        memory: u64,
        note: &'a (dyn Fn(&str) + Sync),
    ) -> Self {
        if !appearance.is_empty() {
            return_large_blocks();
        }
        let [images, maps] = texel_memory(memory);
        Self {
            shader: Shader::new(appearance, folder, scratch, images, note),
            baking: Pool::new(maps),
            kept: maps / rayon::current_num_threads() as u64,
        }
    }
}

/// The streams of each block of a record; empty where it has none.
type Streams = Vec<Vec<Vec<u8>>>;

/// All records of a region on their way to texels.
struct Painting<'a> {
    region: &'a PaintedRegion<'a>,
    progress: &'a RegionProgress<'a>,
    records: &'a [RootRecord],
    drawn: &'a [DrawnBlocks],
    /// The members of each record, ascending.
    members: Vec<Vec<u32>>,
    around: TrianglesAround,
    storage: &'a Storage,
    /// Memory with which no thread bakes now.
    bakers: Mutex<Vec<Baker<'a>>>,
    streams: Vec<Mutex<Streams>>,
    nanoseconds: AtomicU64,
    /// Charts that have fewer texels than the input's images.
    coarser: AtomicU64,
}

impl PaintedRegion<'_> {
    /// Gives the blocks of all records texels; the first records are those of charts, in order. `drawn` is what their
    /// blocks decode to. Returns the processor time that it takes, and how many charts have fewer texels than the
    /// input's images, because a map holds no more.
    pub fn paint(
        &self,
        records: &mut [RootRecord],
        drawn: &[DrawnBlocks],
        colour_step: u8,
        progress: &RegionProgress<'_>,
    ) -> (Duration, u64) {
        let start = thread_cpu_time();
        let around = TrianglesAround::new(&self.charted.mesh.triangles, self.charted.mesh.positions.len());
        let mut members: Vec<Vec<u32>> = vec![vec![]; records.len()];
        let mut tops = vec![];
        for (number, record) in (0..).zip(records.iter()) {
            // Groups follow their members.
            match record.parent.filter(|&parent| parent > number) {
                Some(parent) => members[parent as usize].push(number),
                None => tops.push(number),
            }
        }
        let storage = storage(self.appearance, colour_step);
        let painting = Painting {
            region: self,
            progress,
            drawn,
            members,
            around,
            storage: &storage,
            bakers: Mutex::default(),
            streams: records.iter().map(|_| Mutex::default()).collect(),
            records,
            nanoseconds: AtomicU64::default(),
            coarser: AtomicU64::default(),
        };
        let prepared = thread_cpu_time() - start;
        let of_all = trace::parallel("trees");
        tops.par_iter().for_each(|&top| drop(painting.paint(top)));
        drop(of_all);
        let Painting { streams, nanoseconds, coarser, .. } = painting;
        for (record, streams) in records.iter_mut().zip(streams) {
            let streams = streams.into_inner().unwrap_or_default();
            for (block, streams) in record.blocks.iter_mut().zip(streams) {
                if let Some(block) = block {
                    block.texels = streams;
                }
            }
        }
        (prepared + Duration::from_nanos(nanoseconds.into_inner()), coarser.into_inner())
    }

    /// What these triangles of the region show, of which the first ones are those of a chart.
    pub fn input(&self, own: Vec<u32>) -> InputSource<'_> {
        let PaintedRegion { charted, attributes, appearance, studio, .. } = *self;
        InputSource {
            positions: &charted.mesh.positions,
            all: &charted.mesh.triangles,
            own_count: own.len(),
            own,
            scale: charted.scale,
            appearance,
            is_label: appearance.scalars.iter().map(ScalarRange::is_label).collect(),
            painter: studio.shader.painter(attributes).with_areas(charted.areas),
            areas: charted.areas.map_or(&[], |areas| &areas.of_triangles),
            larger: vec![],
            growths: vec![],
            along_boundary: HashSet::new(),
        }
    }

    /// The triangles of a chart, and those that touch it: where images are read beside a patch, they show what lies
    /// there.
    fn triangles(&self, chart: u32, around: &TrianglesAround) -> Vec<u32> {
        let ChartedMesh { atlas, labels, .. } = *self.charted;
        let this = &atlas.charts[chart as usize];
        let arcs = this.loops.iter().flatten().map(|half_arc| &atlas.arcs[half_arc.arc as usize]);
        let mut beside: Vec<u32> = arcs
            .filter(|arc| arc.charts.iter().any(|&other| other != NONE && other != chart))
            .flat_map(|arc| arc.path.iter())
            .flat_map(|&vertex| around.of(vertex))
            .copied()
            .filter(|&triangle| labels[triangle as usize] != chart)
            .collect();
        beside.sort_unstable();
        beside.dedup();
        [this.triangles.as_slice(), &beside].concat()
    }
}

impl<'a> Painting<'a> {
    /// Gives a record texels, after all that lies below it.
    fn paint(&self, number: u32) -> Painted {
        let _pass = trace::pass("paint");
        let of_all = trace::parallel("below");
        let below: Vec<Painted> = self.members[number as usize].par_iter().map(|&member| self.paint(member)).collect();
        drop(of_all);
        let start = thread_cpu_time();
        let is_chart = (number as usize) < self.region.charted.atlas.charts.len();
        let (painted, streams) = if is_chart { self.paint_chart(number) } else { self.paint_group(number, &below) };
        drop(below);
        if is_chart {
            self.progress.painted();
        }
        let taken = thread_cpu_time() - start;
        self.nanoseconds.fetch_add(taken.as_nanos() as u64, Ordering::Relaxed);
        if let Ok(mut own) = self.streams[number as usize].lock() {
            *own = streams;
        }
        painted
    }

    fn paint_chart(&self, chart: u32) -> (Painted, Streams) {
        let PaintedRegion { charted, arcs, appearance, texel_share, studio, .. } = *self.region;
        let scale = charted.scale;
        let mut source = InputSource {
            own_count: charted.atlas.charts[chart as usize].triangles.len(),
            along_boundary: arcs.along_boundary(charted, chart),
            ..self.region.input(self.region.triangles(chart, &self.around))
        };
        let mut painted = Painted::default();
        let mut streams = self.streams_of(chart);
        let Some([density, area]) = source.density() else { return (painted, streams) };
        let density = density * texel_share.sqrt();
        let is_coarse = area * density * density <= FEW_TEXELS * source.own.len() as f64;
        let finer = if is_coarse && charted.jumps_inside(chart) { FINER_WITH_JUMPS } else { 0 };
        let across = density * DENSITY * texel_size(finer);
        let texels = (area * across * across * SPREAD).min(MAX_TEXELS as f64);
        let _held = studio.baking.hold(baking_bytes(texels as u64, self.storage));
        let mut baker = self.baker();
        let mut source = Located::new(source);
        let finest = exponent_of(1.0 / (across * scale.step()));
        // Of the texels of the block before.
        let mut before = finest;
        let (usual, is_sharp) = (finest + finer, !appearance.images.is_empty());
        for (level, block, drawn) in self.blocks(chart) {
            let patch = drawn.baked(block.error / scale.step(), charted.jumps());
            // The finest block is drawn at all finer levels, too.
            let (exponent, baked) = if painted.surfels.is_empty() {
                let baked = baker.bake(&BakedPatch { finer, is_sharp, ..patch }, &mut source, finest);
                let is_full = baked.as_ref().is_some_and(|baked| baked.is_full);
                self.coarser.fetch_add(u64::from(is_full), Ordering::Relaxed);
                (usual, baked)
            } else {
                let exponent = coarser(usual, usize::from(scale.finest()) - level);
                let fewer = area_of_texel(exponent - before.min(exponent));
                let coarse = Coarse { exponent, texels: painted.surfels.usual_count() / fewer };
                let finer = std::iter::once(&painted.surfels);
                before = exponent;
                (exponent, baker.bake_coarser(&patch, finer, Some(&mut source), coarse))
            };
            painted.take(&mut streams[level], baked, exponent, level);
        }
        self.keep(baker);
        (painted, streams)
    }

    /// Gives the blocks of a group texels, from those of its members.
    fn paint_group(&self, group: u32, members: &[Painted]) -> (Painted, Streams) {
        const NO_SOURCE: Option<&mut Located<InputSource<'_>>> = None;
        let PaintedRegion { charted, studio, .. } = *self.region;
        let (scale, jumps) = (charted.scale, charted.jumps());
        let mut painted = Painted::default();
        let mut streams = self.streams_of(group);
        let known = || members.iter().filter(|member| !member.surfels.is_empty());
        // The finest of them decides.
        let finest = known().map(|member| (member.exponent, member.level)).min();
        let Some((base, at)) = finest else { return (painted, streams) };
        let texels: usize = known().map(|member| member.surfels.count()).sum();
        // Texels are twice as large at the next level.
        let _held = studio.baking.hold(baking_bytes((texels as f64 * SPREAD) as u64 / 4, self.storage));
        let mut baker = self.baker();
        for (level, block, drawn) in self.blocks(group) {
            let patch = drawn.baked(block.error / scale.step(), jumps);
            let exponent = coarser(base, at.saturating_sub(level));
            let baked = if painted.surfels.is_empty() {
                let coarse = Coarse { exponent, texels: known().map(|member| member.texels_at(level)).sum() };
                baker.bake_coarser(&patch, known().map(|member| &member.surfels), NO_SOURCE, coarse)
            } else {
                let coarse = Coarse { exponent, texels: painted.texels_at(level) };
                baker.bake_coarser(&patch, std::iter::once(&painted.surfels), NO_SOURCE, coarse)
            };
            painted.take(&mut streams[level], baked, exponent, level);
        }
        self.keep(baker);
        (painted, streams)
    }

    /// A baker with which no thread bakes.
    fn baker(&self) -> Baker<'a> {
        let idle = self.bakers.lock().ok().and_then(|mut bakers| bakers.pop());
        idle.unwrap_or_else(|| Baker::new(self.storage))
    }

    /// Keeps it for the next map, unless it holds too much memory.
    fn keep(&self, baker: Baker<'a>) {
        if let (true, Ok(mut bakers)) = (baker.bytes() <= self.region.studio.kept, self.bakers.lock()) {
            bakers.push(baker);
        }
    }

    fn streams_of(&self, record: u32) -> Streams {
        vec![vec![]; self.records[record as usize].blocks.len()]
    }

    /// The blocks of a record and what they decode to, the finest one first.
    fn blocks(&self, record: u32) -> impl Iterator<Item = (usize, &BlockRecord, &DrawnPatch)> {
        let blocks = self.records[record as usize].blocks.iter().zip(&self.drawn[record as usize]);
        let of_level = |(level, (block, drawn)): (usize, _)| {
            let (block, drawn): (&Option<BlockRecord>, &Option<DrawnPatch>) = (block, drawn);
            Some((level, block.as_ref()?, drawn.as_ref()?))
        };
        blocks.enumerate().rev().filter_map(of_level)
    }
}

impl DrawnPatch {
    /// As what gets images.
    pub fn baked<'a>(&'a self, reach: f64, jumps: Option<&'a Jumps>) -> BakedPatch<'a> {
        let areas = Areas::of(&self.areas, jumps);
        BakedPatch { positions: &self.positions, triangles: &self.triangles, reach, areas, finer: 0, is_sharp: false }
    }
}

/// The texels of a record's coarsest block, from which those of the group above are made.
#[derive(Default)]
struct Painted {
    surfels: Surfels,
    /// The size of its texels, and its level.
    exponent: u32,
    level: usize,
}

impl Painted {
    /// The number of texels that stand for its own at a coarser level.
    fn texels_at(&self, level: usize) -> f64 {
        self.surfels.usual_count() / area_of_texel(2 * self.level.saturating_sub(level) as u32)
    }

    /// Gives a block its texels.
    fn take(&mut self, streams: &mut Vec<Vec<u8>>, baked: Option<Baked>, exponent: u32, level: usize) {
        if let Some(baked) = baked {
            *streams = baked.streams;
            *self = Self { surfels: baked.surfels, exponent, level };
        }
    }
}

/// Exponents of texels that are `levels` levels coarser: twice as large with each.
fn coarser(exponent: u32, levels: usize) -> u32 {
    (exponent + 2 * levels as u32).min(MAX_EXPONENT)
}
