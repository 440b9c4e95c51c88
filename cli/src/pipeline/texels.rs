//! Texels of a region: each block gets images of what the input shows where the block lies, groups included.

use std::collections::BTreeSet;
use std::time::Duration;

use glam::DVec3;
use lodpack::index::{ChannelInfo, ChannelKind};
use lodpack::write::{BlockRecord, RootRecord};
use rayon::prelude::*;

use super::chart_work::{DrawnBlocks, DrawnPatch};
use super::{ChartedMesh, Scale};
use crate::machine::thread_cpu_time;
use crate::mesh::NONE;
use crate::mesh::appearance::{
    Appearance, COLOUR, DRAWING, EMISSIVE, METALLIC, MaterialMaps, NORMAL, OCCLUSION, ROUGHNESS, ScalarRange,
};
use crate::mesh::attributes::RegionAttributes;
use crate::stage::areas::{Areas, Jumps};
use crate::stage::bake::{Baked, BakedPatch, Source, Storage, Stored, Surfels, bake, bake_coarser};
use crate::stage::shade::{Painter, Shader};

/// Bytes of decoded images that are kept.
pub(crate) const TEXTURE_MEMORY: u64 = 256 << 20;
/// Steps between the least and the largest value of a scalar that is not whole: 12 bits, of which neighbours predict most.
const SCALAR_STEPS: f64 = 4095.0;
/// Texels for each texel or vertex of the input, along each direction. Texels lie askew to those of the input: with as many, a bunny with a photograph
/// had 36 dB at any quality.
const DENSITY: f64 = 1.4;
/// How much larger than wanted texels may be, because their size is a power of the root of two.
const LARGER: f64 = 1.1;
/// The largest exponent of a texel's size.
pub(super) const MAX_EXPONENT: u32 = 127;

/// The channels of a file whose input looks like this.
pub(super) fn channels(appearance: &Appearance) -> Vec<ChannelInfo> {
    let of = |name: &str, kind: ChannelKind, components: u8, low: f64, step: f64, bound: f64| ChannelInfo {
        name: name.into(),
        kind,
        components,
        low,
        step,
        bound,
    };
    let maps = &appearance.maps;
    let factor = |name: &str| of(name, ChannelKind::Factor, 1, 0.0, 1.0 / 255.0, 0.0);
    let colour = |name: &str, components: u8| of(name, ChannelKind::Colour, components, 0.0, 1.0, 0.0);
    let of_materials = [
        (appearance.has_colour, colour(COLOUR, colour_components(appearance))),
        (maps.normal, of(NORMAL, ChannelKind::Normal, 2, -128.0 / 127.0, 1.0 / 127.0, 0.0)),
        (maps.emissive, colour(EMISSIVE, 3)),
        (maps.occlusion, factor(OCCLUSION)),
        (maps.metallic, factor(METALLIC)),
        (maps.roughness, factor(ROUGHNESS)),
        (appearance.has_drawings, of(DRAWING, ChannelKind::Drawing, 1, 0.0, 1.0, 0.0)),
    ];
    let mut all: Vec<ChannelInfo> =
        of_materials.into_iter().filter(|(is_there, _)| *is_there).map(|(_, channel)| channel).collect();
    for range in &appearance.scalars {
        let [low, step] = numbers(range);
        // A number per vertex may have the name of what materials have.
        let is_taken = all.iter().any(|channel| channel.name == range.name);
        let name = if is_taken { format!("{} of vertices", range.name) } else { range.name.clone() };
        let (kind, bound) =
            if range.is_label() { (ChannelKind::Label, 0.0) } else { (ChannelKind::Scalar, step * 0.5) };
        all.push(of(&name, kind, 1, low, step, bound));
    }
    all
}

fn colour_components(appearance: &Appearance) -> u8 {
    if appearance.has_alpha { 4 } else { 3 }
}

/// The value of number 0 of a scalar, and the step between numbers: 1 for whole values, if so many numbers are enough.
fn numbers(range: &ScalarRange) -> [f64; 2] {
    let [low, high] = [range.low, range.high].map(f64::from);
    // No value at all.
    if low > high {
        return [0.0, 1.0];
    }
    let is_exact = range.is_whole && high - low <= f64::from(u16::MAX);
    let step = (high - low) / SCALAR_STEPS;
    [low, if step == 0.0 || is_exact { 1.0 } else { step }]
}

/// How the channels of a file are stored.
pub(super) fn storage(appearance: &Appearance, step: u8) -> Storage {
    let maps = &appearance.maps;
    let factor = Stored::Factor { step };
    let of_materials = [
        (appearance.has_colour, Stored::Colour { components: colour_components(appearance), step }),
        (maps.normal, Stored::Normal { step }),
        (maps.emissive, Stored::Colour { components: 3, step }),
        (maps.occlusion, factor),
        (maps.metallic, factor),
        (maps.roughness, factor),
        (appearance.has_drawings, Stored::Label { low: 0.0 }),
    ];
    let scalars = appearance.scalars.iter().map(|range| {
        let [low, step] = numbers(range);
        if range.is_label() { Stored::Label { low } } else { Stored::Scalar { low, step } }
    });
    let of_materials = of_materials.into_iter().filter(|(is_there, _)| *is_there).map(|(_, stored)| stored);
    Storage::new(of_materials.chain(scalars).collect())
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
        let start = thread_cpu_time();
        let around = TrianglesAround::new(&self.charted.mesh.triangles, self.charted.mesh.positions.len());
        let mut time = thread_cpu_time() - start;
        let storage = storage(self.appearance, colour_step);
        let (leaves, groups) = records.split_at_mut(charts.min(records.len()));
        let painted: Vec<(Painted, Duration)> = leaves
            .par_iter_mut()
            .zip(drawn)
            .enumerate()
            .map(|(chart, (record, drawn))| {
                let start = thread_cpu_time();
                let painted = self.paint_leaf(record, drawn, chart as u32, &around, &storage);
                (painted, thread_cpu_time() - start)
            })
            .collect();
        let mut of_members: Vec<Vec<Painted>> = (0..groups.len()).map(|_| vec![]).collect();
        let give = |of_members: &mut [Vec<Painted>], parent: Option<u32>, painted: Painted| {
            if let Some(parent) = parent.and_then(|parent| of_members.get_mut((parent as usize).wrapping_sub(charts))) {
                parent.push(painted);
            }
        };
        for (record, (painted, taken)) in leaves.iter().zip(painted) {
            time += taken;
            give(&mut of_members, record.parent, painted);
        }
        // Groups follow their members, and those of a height are side by side.
        let mut first = 0;
        while first < groups.len() {
            let is_within =
                |number: &usize| groups[*number].parent.is_none_or(|parent| parent as usize >= charts + *number);
            let ready = |end: usize| {
                let below = |number: usize| {
                    groups[first..end].iter().any(|record| record.parent == Some((charts + number) as u32))
                };
                is_within(&end) && !below(end)
            };
            let end = (first + 1..groups.len()).find(|&end| !ready(end)).unwrap_or(groups.len());
            let some = groups[first..end].par_iter_mut().zip(&drawn[charts + first..]).zip(&of_members[first..]);
            let painted: Vec<(Painted, Duration)> = some
                .map(|((record, drawn), members)| {
                    let start = thread_cpu_time();
                    let painted = paint_group(record, drawn, members, self.charted, &storage);
                    (painted, thread_cpu_time() - start)
                })
                .collect();
            for (number, (painted, taken)) in (first..).zip(painted) {
                time += taken;
                of_members[number] = vec![];
                give(&mut of_members, groups[number].parent, painted);
            }
            first = end;
        }
        time
    }

    fn paint_leaf(
        &self,
        record: &mut RootRecord,
        drawn: &DrawnBlocks,
        chart: u32,
        around: &TrianglesAround,
        storage: &Storage,
    ) -> Painted {
        let scale = self.charted.scale;
        let mut source = InputSource {
            positions: &self.charted.mesh.positions,
            all: &self.charted.mesh.triangles,
            own: self.triangles(chart, around),
            scale,
            appearance: self.appearance,
            is_label: self.appearance.scalars.iter().map(ScalarRange::is_label).collect(),
            painter: self.shader.painter(self.attributes),
            areas: self.charted.areas.map_or(&[], |areas| &areas.of_triangles),
            own_count: self.charted.atlas.charts[chart as usize].triangles.len(),
        };
        let Some(density) = source.density() else { return Painted::default() };
        let exponent = exponent_of(1.0 / (density * DENSITY * scale.step()));
        let mut painted = Painted::default();
        for (level, (block, drawn)) in record.blocks.iter_mut().zip(drawn).enumerate().rev() {
            let (Some(block), Some(drawn)) = (block, drawn) else { continue };
            let reach = block.error / scale.step();
            let patch = drawn.baked(reach, self.charted.jumps());
            // The finest block is drawn at all finer levels, too.
            let (exponent, baked) = if painted.surfels.is_empty() {
                (exponent, bake(&patch, &mut source, exponent, storage))
            } else {
                let exponent = coarser(exponent, usize::from(scale.finest()) - level);
                (exponent, bake_coarser(&patch, painted.surfels.iter(), exponent, storage))
            };
            painted.take(block, baked, exponent, level);
        }
        painted
    }

    /// The triangles of a chart, and those that touch it: where images are read beside a patch, they show what lies there.
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

/// The texels of a record's coarsest block, from which those of the group above are made.
#[derive(Default)]
pub(super) struct Painted {
    surfels: Vec<Surfels>,
    /// The size of its texels, and its level.
    exponent: u32,
    level: usize,
}

impl Painted {
    /// Gives a block its texels.
    fn take(&mut self, block: &mut BlockRecord, baked: Option<Baked>, exponent: u32, level: usize) {
        if let Some(Baked { streams, surfels }) = baked {
            block.texels = streams;
            *self = Self { surfels, exponent, level };
        }
    }
}

/// Exponents of texels that are so many levels coarser: twice as large with each.
pub(super) fn coarser(exponent: u32, levels: usize) -> u32 {
    (exponent + 2 * levels as u32).min(MAX_EXPONENT)
}

/// Gives the blocks of a group texels, from those of its members.
fn paint_group(
    record: &mut RootRecord,
    drawn: &DrawnBlocks,
    members: &[Painted],
    charted: &ChartedMesh,
    storage: &Storage,
) -> Painted {
    let (scale, jumps) = (charted.scale, charted.jumps());
    let mut painted = Painted::default();
    let known = || members.iter().filter(|member| !member.surfels.is_empty());
    // The finest of them decides.
    let Some((base, at)) = known().map(|member| (member.exponent, member.level)).min() else { return painted };
    let all: Vec<&Surfels> = known().flat_map(|member| &member.surfels).collect();
    for (level, (block, drawn)) in record.blocks.iter_mut().zip(drawn).enumerate().rev() {
        let (Some(block), Some(drawn)) = (block, drawn) else { continue };
        let reach = block.error / scale.step();
        let patch = drawn.baked(reach, jumps);
        let exponent = coarser(base, at.saturating_sub(level));
        let baked = if painted.surfels.is_empty() {
            bake_coarser(&patch, all.iter().copied(), exponent, storage)
        } else {
            bake_coarser(&patch, painted.surfels.iter(), exponent, storage)
        };
        painted.take(block, baked, exponent, level);
    }
    painted
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
    /// Of each scalar whether it is one of labels.
    is_label: Vec<bool>,
    painter: Painter<'a>,
    /// The area of each triangle of the region; empty if colours jump nowhere.
    areas: &'a [u32],
    /// How many of the triangles that are shown are the chart's own.
    own_count: usize,
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
            let has_others = self.appearance.has_colour || self.appearance.has_materials();
            let density = if has_others { face.material_density() } else { face.scalar_density() };
            sum += area * f64::from(density);
            areas += area;
        }
        let density = sum / areas;
        (density > 0.0 && density.is_finite()).then_some(density)
    }
}

impl DrawnPatch {
    /// As what gets images.
    fn baked<'a>(&'a self, reach: f64, jumps: Option<&'a Jumps>) -> BakedPatch<'a> {
        let areas = Areas::of(&self.areas, jumps);
        BakedPatch { positions: &self.positions, triangles: &self.triangles, reach, areas }
    }
}

impl Source for InputSource<'_> {
    fn triangle_count(&self) -> usize {
        self.own.len()
    }

    fn area(&self, triangle: usize) -> u32 {
        self.areas.get(self.own[triangle] as usize).copied().unwrap_or(NONE)
    }

    fn areas_beyond(&self) -> Vec<u32> {
        let (own, beside) = self.own.split_at(self.own_count);
        let of = |triangles: &[u32]| -> BTreeSet<u32> {
            triangles.iter().filter_map(|&t| self.areas.get(t as usize)).copied().collect()
        };
        let (own, beside) = (of(own), of(beside));
        beside.difference(&own).copied().collect()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let inverse = 1.0 / self.scale.step();
        self.points(triangle).map(|point| point * inverse)
    }

    fn shade(&mut self, triangle: usize, weights: &[[f32; 3]], footprint: f32, values: &mut Vec<f32>) {
        let face = self.painter.face(self.own[triangle] as usize, self.points(triangle));
        let footprint = footprint * self.scale.step() as f32;
        let maps = self.appearance.maps;
        let is_colour_all = !self.appearance.has_materials() && self.appearance.scalars.is_empty();
        if self.appearance.has_colour && is_colour_all {
            return face.base_colours(weights, footprint, values);
        }
        for &weights in weights {
            if self.appearance.has_colour {
                values.extend(face.base_colour(weights, footprint));
            }
            if maps != MaterialMaps::default() {
                // In the order of the channels.
                let [metallic, roughness] = face.metallic_roughness(weights, footprint);
                values.extend(maps.normal.then(|| face.normal(weights, footprint)).into_iter().flatten());
                values.extend(maps.emissive.then(|| face.emissive(weights, footprint)).into_iter().flatten());
                values.extend(maps.occlusion.then(|| face.occlusion(weights, footprint)));
                values.extend(maps.metallic.then_some(metallic));
                values.extend(maps.roughness.then_some(roughness));
            }
            values.extend(self.appearance.has_drawings.then(|| f32::from(face.drawing())));
            values.extend((0..).zip(&self.is_label).map(|(number, &is_label)| {
                if is_label { face.label(number, weights) } else { face.scalar(number, weights) }
            }));
        }
    }
}
