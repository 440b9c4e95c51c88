//! What texels show: the channels of a file, how they are stored, and the surface of the input.

use std::collections::{BTreeSet, HashSet};

use glam::DVec3;
use lodpack::LatticePoint;
use lodpack::index::{ChannelInfo, ChannelKind};

use super::Scale;
use super::density::{Density, asked_by_images};
use super::sharp::Sharpness;
use lodpack_mesh::NONE;
use lodpack_mesh::appearance::{
    Appearance, COLOUR, DRAWING, EMISSIVE, METALLIC, MaterialMaps, NORMAL, OCCLUSION, ROUGHNESS, ScalarRange,
};
use lodpack_stage::bake::{Points, Source, Storage, Stored, area_of_texel};
use lodpack_stage::shade::Painter;

/// Steps between the least and the largest value of a scalar that is not whole: 12 bits, of which neighbours predict
/// most.
const SCALAR_STEPS: f64 = 4095.0;
/// A share of a step that is too small to matter.
const NEGLIGIBLE: f64 = 0.01;
/// Texels for each texel or vertex of the input, along each direction. Texels lie askew to those of the input: with as
/// many, a bunny with a photograph had 36 dB at any quality.
pub(super) const DENSITY: f64 = 1.4;
/// How much finer texels are where images are even but for a few sharp edges, which each texel that lies across blurs.
const FINER_IF_SHARP: f64 = 2.0;
/// A mesh of at most this many triangles is small.
const SMALL: usize = 1000;
/// Charts of a small mesh that do not look alike everywhere have this many texels.
const SMALL_TEXELS: f64 = 4096.0;
/// Or they have at most this many times as many along each direction: these take next to no bytes, and what few texels
/// blur is all that there is.
const SMALL_FINER: f64 = 16.0;

/// Whether texels of a kind are bytes, of which something may be lost.
fn is_of_bytes(kind: ChannelKind) -> bool {
    matches!(kind, ChannelKind::Colour | ChannelKind::Normal | ChannelKind::Factor)
}

/// The channels of a file whose input looks like this, and of whose colours nothing is lost if they are exact.
pub(super) fn channels(appearance: &Appearance, is_exact: bool) -> Vec<ChannelInfo> {
    let of = |name: &str, kind: ChannelKind, components: u8, low: f64, step: f64, bound: f64| ChannelInfo {
        name: name.into(),
        kind,
        is_exact: is_exact && is_of_bytes(kind),
        is_scaled: !is_exact && is_of_bytes(kind),
        components,
        low,
        step,
        bound,
    };
    let maps = &appearance.maps;
    // All that exact ones are off by is rounding. Of normals that holds for those alone that are on the near side of a
    // piece.
    let rounding = if is_exact { 0.5 } else { 0.0 };
    let factor = |name: &str| of(name, ChannelKind::Factor, 1, 0.0, 1.0 / 255.0, rounding / 255.0);
    let colour = |name: &str, components: u8| of(name, ChannelKind::Colour, components, 0.0, 1.0, rounding);
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
            if range.is_label() { (ChannelKind::Label, 0.0) } else { (ChannelKind::Scalar, bound(range, step)) };
        all.push(of(&name, kind, 1, low, step, bound));
    }
    all
}

/// How far what is stored for a value may be from it.
fn bound(range: &ScalarRange, step: f64) -> f64 {
    let (of_steps, rounding) = (step * 0.5, range.rounding());
    // Usually numbers are much closer to one another than steps are.
    if rounding > NEGLIGIBLE * of_steps { of_steps + rounding } else { of_steps }
}

fn colour_components(appearance: &Appearance) -> u8 {
    if appearance.has_alpha { 4 } else { 3 }
}

/// The value of number 0 of a scalar, and the step between numbers: 1 for whole values, if there are enough numbers.
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

/// The triangles around each vertex.
pub(super) struct TrianglesAround {
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl TrianglesAround {
    pub fn new(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
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

    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.triangles[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }
}

/// Triangles of the input.
pub(super) struct InputSource<'a> {
    pub positions: &'a [DVec3],
    /// All triangles of the region.
    pub all: &'a [[u32; 3]],
    /// Those that are shown.
    pub own: Vec<u32>,
    pub scale: &'a Scale,
    pub appearance: &'a Appearance,
    /// Of each scalar whether it is one of labels.
    pub is_label: Vec<bool>,
    pub painter: Painter<'a>,
    /// The area of each triangle of the region; empty if colours jump nowhere.
    pub areas: &'a [u32],
    /// How many of the triangles that are shown are the chart's own.
    pub own_count: usize,
    /// How much larger the texels of each of those should be than the smallest; empty if all are alike.
    pub larger: Vec<u8>,
    /// How fast texels of images grow over each, per size of such texels; empty if there are about as many in all
    /// directions.
    pub growths: Vec<Option<[DVec3; 2]>>,
    /// Points from which the chart's border runs on along the boundary of the mesh.
    pub along_boundary: HashSet<LatticePoint>,
}

impl InputSource<'_> {
    fn points(&self, triangle: usize) -> [DVec3; 3] {
        self.all[self.own[triangle] as usize].map(|vertex| self.scale.local(self.positions[vertex as usize]))
    }

    /// Texels per unit of length that show everything, in the mean, and the area. None where there is no area.
    pub fn density(&mut self) -> Option<[f64; 2]> {
        let has_others = self.appearance.has_colour || self.appearance.has_materials();
        let has_images = has_others && !self.appearance.images.is_empty();
        let (mut densities, mut sums, mut sharpness) = (vec![], [0.0; 3], Sharpness::default());
        let mut is_even = true;
        for triangle in 0..self.own.len() {
            let points = self.points(triangle);
            let area = 0.5 * (points[1] - points[0]).cross(points[2] - points[0]).length();
            let face = self.painter.face(self.own[triangle] as usize, points);
            let mean = f64::from(if has_others { face.image_density() } else { face.scalar_density() });
            let least = f64::from(face.least_density());
            sums = [sums[0] + mean * area, sums[1] + least * area, sums[2] + area];
            is_even &= face.is_even();
            if has_images {
                sharpness.look(&face, points, mean);
                densities.push(Density { mean, most: f64::from(face.most_density()), area });
            }
        }
        let [sum, least, area] = sums;
        let mut mean = sum.max(least) / area;
        if !(mean > 0.0 && mean.is_finite()) {
            return None;
        }
        if has_images {
            let triangles: Vec<[u32; 3]> = self.own.iter().map(|&triangle| self.all[triangle as usize]).collect();
            let asked = asked_by_images(&triangles, &densities);
            self.larger = asked.larger;
            if let Some(stretched) = asked.stretched {
                mean = mean.max(stretched);
                self.growths = self.growths_per_size(&densities, mean);
            }
        }
        if !is_even && self.all.len() <= SMALL {
            mean *= (SMALL_TEXELS / (area * mean * mean)).sqrt().clamp(1.0, SMALL_FINER);
        }
        Some([if sharpness.is_sharp() { FINER_IF_SHARP * mean } else { mean }, area])
    }

    /// How fast texels grow, relative to the size of each triangle's texels, whose mean is `mean`.
    fn growths_per_size(&mut self, densities: &[Density], mean: f64) -> Vec<Option<[DVec3; 2]>> {
        let fewer: Vec<f64> = (0..self.own.len()).map(|triangle| area_of_texel(self.larger(triangle).into())).collect();
        let area: f64 = densities.iter().map(|density| density.area).sum();
        let texels: f64 = densities.iter().zip(&fewer).map(|(density, fewer)| density.area / fewer).sum();
        let finest = mean * (area / texels).sqrt();
        let per_size = |(triangle, fewer): (usize, f64)| {
            let face = self.painter.face(self.own[triangle] as usize, self.points(triangle));
            face.texel_growth().map(|growth| growth.map(|growth| growth * (fewer.sqrt() / finest)))
        };
        fewer.into_iter().enumerate().map(per_size).collect()
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

    fn has_sizes(&self) -> bool {
        !self.larger.is_empty()
    }

    fn larger(&self, triangle: usize) -> u8 {
        self.larger.get(triangle).copied().unwrap_or(0)
    }

    fn has_long(&self) -> bool {
        !self.growths.is_empty()
    }

    fn growth(&self, triangle: usize) -> Option<[DVec3; 2]> {
        *self.growths.get(triangle)?
    }

    fn ends_along(&self, start: LatticePoint) -> bool {
        self.along_boundary.contains(&start)
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let inverse = 1.0 / self.scale.step();
        self.points(triangle).map(|point| point * inverse)
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        let face = self.painter.face(self.own[triangle] as usize, self.points(triangle));
        let footprint = footprint * self.scale.step() as f32;
        let maps = self.appearance.maps;
        let is_colour_all = !self.appearance.has_materials() && self.appearance.scalars.is_empty();
        if self.appearance.has_colour && is_colour_all {
            return face.base_colours(points, footprint, self.appearance.has_alpha, values);
        }
        let components = usize::from(colour_components(self.appearance));
        for weights in points.iter().flat_map(|points| points.weights()) {
            if self.appearance.has_colour {
                values.extend_from_slice(&face.base_colour(weights, footprint)[..components]);
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
