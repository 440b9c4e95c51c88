//! Texels of a region: each block gets images of what the input shows where the block lies, groups included.

use std::time::Duration;

use glam::DVec3;
use lodpack::index::{ChannelInfo, ChannelKind};
use lodpack::write::RootRecord;
use rayon::prelude::*;

use super::chart_work::DrawnBlocks;
use super::{ChartedMesh, Scale};
use crate::machine::thread_cpu_time;
use crate::mesh::NONE;
use crate::mesh::appearance::{Appearance, COLOUR, ScalarRange};
use crate::mesh::attributes::RegionAttributes;
use crate::stage::bake::{BakedPatch, Source, Storage, bake};
use crate::stage::shade::{Painter, Shader};

/// Bytes of decoded images that are kept.
pub(crate) const TEXTURE_MEMORY: u64 = 256 << 20;
/// Numbers of a scalar channel.
const SCALAR_STEPS: f64 = 65535.0;
/// How much larger than wanted texels may be, because their size is a power of the root of two.
const LARGER: f64 = 1.1;
/// The largest exponent of a texel's size.
pub(super) const MAX_EXPONENT: u32 = 127;

/// The channels of a file whose input looks like this.
pub(super) fn channels(appearance: &Appearance) -> Vec<ChannelInfo> {
    let colour = appearance.has_colour.then(|| ChannelInfo {
        name: COLOUR.into(),
        kind: ChannelKind::Colour,
        components: colour_components(appearance),
        low: 0.0,
        step: 1.0,
        bound: 0.0,
    });
    let scalar = |range: &ScalarRange| {
        let [low, step] = numbers(range);
        let (kind, bound) = (ChannelKind::Scalar, step * 0.5);
        ChannelInfo { name: range.name.clone(), kind, components: 1, low, step, bound }
    };
    colour.into_iter().chain(appearance.scalars.iter().map(scalar)).collect()
}

fn colour_components(appearance: &Appearance) -> u8 {
    if appearance.has_alpha { 4 } else { 3 }
}

/// The value of number 0 of a scalar, and the step between numbers: 1 for whole values, if so many numbers are enough.
fn numbers(range: &ScalarRange) -> [f64; 2] {
    let [low, high] = [range.low, range.high].map(f64::from);
    // No value at all.
    if !(low <= high) {
        return [0.0, 1.0];
    }
    let step = (high - low) / SCALAR_STEPS;
    [low, if step == 0.0 || (range.is_whole && step <= 1.0) { 1.0 } else { step }]
}

/// How the channels of a file are stored.
pub(super) fn storage(appearance: &Appearance, colour_step: u8) -> Storage {
    Storage {
        colour_components: appearance.has_colour.then(|| colour_components(appearance)),
        colour_step,
        scalars: appearance.scalars.iter().map(numbers).collect(),
    }
}

/// The largest exponent of texels that are hardly larger than this, in lattice units.
pub(super) fn exponent_of(size: f64) -> u32 {
    let of = |exponent: u32| lodpack::write::texel_size(exponent);
    (1..=MAX_EXPONENT).take_while(|&exponent| of(exponent) <= size * LARGER).last().unwrap_or(0)
}

/// A region whose blocks get texels.
pub(super) struct PaintedRegion<'a> {
    pub charted: &'a ChartedMesh<'a>,
    pub attributes: &'a RegionAttributes,
    pub appearance: &'a Appearance,
    pub shader: &'a Shader<'a>,
}

impl PaintedRegion<'_> {
    /// Gives the blocks of all records texels; the first records are those of charts, in order. `drawn` is what their blocks decode to.
    /// Returns the processor time that it takes.
    pub fn paint(&self, records: &mut [RootRecord], drawn: &[DrawnBlocks], colour_step: u8) -> Duration {
        let charts = self.charted.atlas.charts.len();
        // Groups follow their members.
        let mut below: Vec<Vec<u32>> =
            (0..records.len()).map(|record| vec![record as u32; usize::from(record < charts)]).collect();
        for record in 0..records.len() {
            if let Some(parent) = records[record].parent {
                let members = below[record].clone();
                below[parent as usize].extend(members);
            }
        }
        let start = thread_cpu_time();
        let around = TrianglesAround::new(&self.charted.mesh.triangles, self.charted.mesh.positions.len());
        let alone = thread_cpu_time() - start;
        let storage = storage(self.appearance, colour_step);
        let times = records.par_iter_mut().zip(drawn).zip(&below).map(|((record, drawn), charts)| {
            let start = thread_cpu_time();
            self.paint_record(record, drawn, charts, &around, &storage);
            thread_cpu_time() - start
        });
        alone + times.sum::<Duration>()
    }

    fn paint_record(
        &self,
        record: &mut RootRecord,
        drawn: &DrawnBlocks,
        charts: &[u32],
        around: &TrianglesAround,
        storage: &Storage,
    ) {
        let scale = self.charted.scale;
        let triangles = self.triangles(charts, around);
        let mut source = InputSource {
            positions: &self.charted.mesh.positions,
            all: &self.charted.mesh.triangles,
            own: triangles,
            scale,
            appearance: self.appearance,
            painter: self.shader.painter(self.attributes),
        };
        let Some(density) = source.density() else { return };
        let exponent = exponent_of(1.0 / (density * scale.step()));
        let is_leaf = charts.len() == 1;
        let finest_block = record.blocks.iter().rposition(Option::is_some);
        for (level, (block, drawn)) in record.blocks.iter_mut().zip(drawn).enumerate() {
            let (Some(block), Some(drawn)) = (block, drawn) else { continue };
            // The finest block of a leaf is drawn at all finer levels, too.
            let is_finest = is_leaf && finest_block == Some(level);
            let steps = if is_finest { 0 } else { usize::from(scale.finest()) - level };
            let reach = block.error / scale.step();
            let patch = BakedPatch { positions: &drawn.positions, triangles: &drawn.triangles, reach };
            let exponent = (exponent + 2 * steps as u32).min(MAX_EXPONENT);
            block.texels = bake(&patch, &mut source, exponent, storage).map_or(vec![], |baked| baked.streams);
        }
    }

    /// The triangles of some charts, and those that touch them: where images are read beside a patch, they show what lies there.
    fn triangles(&self, charts: &[u32], around: &TrianglesAround) -> Vec<u32> {
        let ChartedMesh { atlas, labels, .. } = *self.charted;
        let mut is_own = vec![false; atlas.charts.len()];
        charts.iter().for_each(|&chart| is_own[chart as usize] = true);
        let mut triangles: Vec<u32> =
            charts.iter().flat_map(|&chart| atlas.charts[chart as usize].triangles.iter().copied()).collect();
        let half_arcs = charts.iter().flat_map(|&chart| atlas.charts[chart as usize].loops.iter().flatten());
        let outer = half_arcs
            .map(|half_arc| &atlas.arcs[half_arc.arc as usize])
            .filter(|arc| arc.charts.iter().any(|&chart| chart != NONE && !is_own[chart as usize]));
        let mut beside: Vec<u32> = outer
            .flat_map(|arc| arc.path.iter())
            .flat_map(|&vertex| around.of(vertex))
            .copied()
            .filter(|&triangle| !is_own[labels[triangle as usize] as usize])
            .collect();
        beside.sort_unstable();
        beside.dedup();
        triangles.extend(beside);
        triangles
    }
}

/// The triangles around each vertex.
struct TrianglesAround {
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl TrianglesAround {
    fn new(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        let mut starts = vec![0; vertex_count + 1];
        triangles.iter().flatten().for_each(|&vertex| starts[vertex as usize + 1] += 1);
        for vertex in 0..vertex_count {
            starts[vertex + 1] += starts[vertex];
        }
        let (mut next, mut around) = (starts.clone(), vec![0; 3 * triangles.len()]);
        for (triangle, corners) in (0..).zip(triangles) {
            for &corner in corners {
                around[next[corner as usize] as usize] = triangle;
                next[corner as usize] += 1;
            }
        }
        Self { starts, triangles: around }
    }

    fn of(&self, vertex: u32) -> &[u32] {
        &self.triangles[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }
}

/// Triangles of the input.
struct InputSource<'a> {
    positions: &'a [DVec3],
    /// All triangles of the region.
    all: &'a [[u32; 3]],
    /// Those that are shown.
    own: Vec<u32>,
    scale: &'a Scale,
    appearance: &'a Appearance,
    painter: Painter<'a>,
}

impl InputSource<'_> {
    fn points(&self, triangle: usize) -> [DVec3; 3] {
        self.all[self.own[triangle] as usize].map(|vertex| self.scale.local(self.positions[vertex as usize]))
    }

    /// Texels per unit of length that show everything. None where there is no area.
    fn density(&mut self) -> Option<f64> {
        let (mut sum, mut areas) = (0.0, 0.0);
        for triangle in 0..self.own.len() {
            let points = self.points(triangle);
            let area = (points[1] - points[0]).cross(points[2] - points[0]).length();
            let face = self.painter.face(self.own[triangle] as usize, points);
            let density = if self.appearance.has_colour { face.colour_density() } else { face.scalar_density() };
            sum += area * f64::from(density);
            areas += area;
        }
        let density = sum / areas;
        (density > 0.0 && density.is_finite()).then_some(density)
    }
}

impl Source for InputSource<'_> {
    fn triangle_count(&self) -> usize {
        self.own.len()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let inverse = 1.0 / self.scale.step();
        self.points(triangle).map(|point| point * inverse)
    }

    fn shade(&mut self, triangle: usize, weights: &[[f32; 3]], footprint: f32, values: &mut Vec<f32>) {
        let face = self.painter.face(self.own[triangle] as usize, self.points(triangle));
        let footprint = footprint * self.scale.step() as f32;
        for &weights in weights {
            if self.appearance.has_colour {
                values.extend(face.base_colour(weights, footprint));
            }
            values.extend((0..self.appearance.scalars.len()).map(|scalar| face.scalar(scalar, weights)));
        }
    }
}
