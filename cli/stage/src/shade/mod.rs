//! What colour and which values a point of the input's surface has.
//!
//! The base colour is that of glTF 2.0 (section 3.9.2): factor times texture times vertex colour, in linear light.
//! Textures are filtered over pyramids of averages (Williams 1983, "Pyramidal parametrics"), with alike blur in both
//! directions. All results are the same on every machine and any number of threads.

mod cache;
mod decode;
mod jumps;
mod level;
mod maps;
mod meaning;
mod texels;
mod texture;

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::areas::ColourAreas;
use crate::bake::{Points, growth_over};
use cache::TextureCache;
use lodpack_mesh::appearance::{AlphaMode, Appearance, Material, TextureUse, images_on};
use lodpack_mesh::attributes::RegionAttributes;
use lodpack_runtime::storage::WorkError;
use meaning::Meaning;
use texture::Texture;

/// Texels for each sample where a triangle looks alike everywhere, in each direction.
const EVEN: f32 = 0.25;
/// At most this many texels of an image look alike.
const ALIKE: f64 = 0.5;

/// Evaluates the surface of an input. Threads share it, and the images that it has decoded.
pub struct Shader<'a> {
    appearance: &'a Appearance,
    textures: TextureCache<'a>,
}

impl<'a> Shader<'a> {
    /// `folder` is the work directory of a job, where it keeps images. At most about `memory` bytes of decoded images
    /// are kept, but always the ones that are in use; those of more than half of it are in files in `scratch`. `note`
    /// is told of images that cannot be decoded; their materials keep the factor alone.
    pub fn new(
        appearance: &'a Appearance,
        folder: Option<&'a Path>,
        scratch: &Path,
        memory: u64,
        note: &'a (dyn Fn(&str) + Sync),
    ) -> Self {
        Self { appearance, textures: TextureCache::new(&appearance.images, folder, scratch, memory, note) }
    }

    /// Whether what it has shown so far is what there is.
    ///
    /// # Errors
    /// If a file for texels cannot be made, written or read. Then surfaces have been shown without their textures.
    pub fn check(&self) -> Result<(), WorkError> {
        self.textures.failure().map_or(Ok(()), Err)
    }

    /// Evaluates the triangles of a region. Each thread has its own.
    pub fn painter<'s>(&'s self, region: &'s RegionAttributes) -> Painter<'s> {
        Painter {
            appearance: self.appearance,
            textures: &self.textures,
            region,
            areas: None,
            latest: Default::default(),
        }
    }
}

/// Evaluates the triangles of a region.
pub struct Painter<'s> {
    appearance: &'s Appearance,
    textures: &'s TextureCache<'s>,
    region: &'s RegionAttributes,
    /// Its areas, once they are known.
    areas: Option<&'s ColourAreas>,
    /// The textures that were used last, by their use, with their keys.
    latest: [Option<(usize, Option<Arc<Texture>>)>; Use::COUNT],
}

impl Drop for Painter<'_> {
    /// The next part of a surface shows another part of images that are in files.
    fn drop(&mut self) {
        self.latest
            .iter()
            .flatten()
            .filter_map(|(_, texture)| texture.as_ref())
            .for_each(|texture| texture.drop_pages());
    }
}

impl<'s> Painter<'s> {
    /// One that knows the areas of the region.
    pub fn with_areas(mut self, areas: Option<&'s ColourAreas>) -> Self {
        self.areas = areas;
        self
    }

    /// A triangle of the region, with the positions of its corners.
    pub fn face(&mut self, triangle: usize, corners: [DVec3; 3]) -> Face<'s> {
        let Appearance { layout, materials, .. } = self.appearance;
        let material = materials.get(usize::from(self.region.material(triangle)));
        let records = self.region.records_of(triangle, layout.stride);
        let [a, b, c] = corners;
        let area = (b - a).cross(c - a).length() / 2.0;
        let maps = &self.appearance.maps;
        let mut textures: [Option<TexturedFace>; Use::COUNT] = Default::default();
        if let Some(material) = material {
            let is_opaque = material.alpha == AlphaMode::Opaque;
            let has_own_alpha = !is_opaque && material.opacity_texture.is_none();
            let colours = if has_own_alpha { Meaning::Transparent } else { Meaning::Opaque };
            let uses = [
                (Use::Base, self.appearance.has_colour, material.base_texture.as_ref(), colours),
                (
                    Use::Opacity,
                    self.appearance.has_colour && !is_opaque,
                    material.opacity_texture.as_ref(),
                    Meaning::Opacity,
                ),
                (Use::Normal, maps.normal, material.normal_texture.as_ref().map(|(of, _)| of), Meaning::Shares),
                (Use::Emissive, maps.emissive, material.emissive_texture.as_ref(), Meaning::Opaque),
                (
                    Use::Occlusion,
                    maps.occlusion,
                    material.occlusion_texture.as_ref().map(|(of, _)| of),
                    Meaning::Shares,
                ),
                (
                    Use::MetallicRoughness,
                    maps.metallic || maps.roughness,
                    material.metallic_roughness_texture.as_ref(),
                    Meaning::Shares,
                ),
                (Use::Metallic, maps.metallic, material.metallic_texture.as_ref(), Meaning::Shares),
                (Use::Roughness, maps.roughness, material.roughness_texture.as_ref(), Meaning::Shares),
            ];
            for (which, is_wanted, texture, meaning) in uses {
                if let Some(texture) = texture.filter(|_| is_wanted) {
                    textures[which as usize] = self.textured(which, texture, meaning, records, area);
                }
            }
        }
        let hides = textures[Use::Base as usize].is_some() && material.is_some_and(|m| m.hides_vertex_colour);
        let colour = layout.colour.filter(|_| !hides);
        // About one texel per vertex: a vertex has two triangles.
        let vertex_density = if area > 0.0 { (1.0 / (2.0 * area).sqrt()) as f32 } else { 0.0 };
        let is_part = colour.is_some() && self.areas.is_some_and(|areas| areas.are_part(triangle));
        Face { appearance: self.appearance, material, corners, records, textures, colour, is_part, vertex_density }
    }

    fn textured(
        &mut self,
        which: Use,
        texture_use: &TextureUse,
        meaning: Meaning,
        records: [&[f32]; 3],
        area: f64,
    ) -> Option<TexturedFace> {
        let uv = texture_use.corners(&self.appearance.layout, records)?;
        let texture = self.texture(which, meaning.key(texture_use.image))?;
        let [width, height] = texture.size().map(f64::from);
        let texels = images_on(uv) * width * height;
        let density = if area > 0.0 { (texels / area).sqrt() as f32 } else { 0.0 };
        Some(TexturedFace { texture, uv, wrap: texture_use.wrap, density })
    }

    fn texture(&mut self, which: Use, key: usize) -> Option<Arc<Texture>> {
        let latest = &mut self.latest[which as usize];
        match latest {
            Some((known, texture)) if *known == key => texture.clone(),
            _ => {
                let texture = self.textures.get(key);
                *latest = Some((key, texture.clone()));
                texture
            }
        }
    }
}

/// What a material uses a texture for.
#[derive(Clone, Copy, Debug)]
enum Use {
    Base,
    Opacity,
    Normal,
    Emissive,
    Occlusion,
    MetallicRoughness,
    Metallic,
    Roughness,
}

impl Use {
    const COUNT: usize = 8;
}

/// A triangle whose points can be evaluated. Points are given by three weights of the corners whose sum is 1.
pub struct Face<'s> {
    appearance: &'s Appearance,
    material: Option<&'s Material>,
    corners: [DVec3; 3],
    records: [&'s [f32]; 3],
    /// By their use.
    textures: [Option<TexturedFace>; Use::COUNT],
    /// Place of the colour in records.
    colour: Option<usize>,
    /// Whether it belongs to an area of which all vertices have one colour.
    is_part: bool,
    vertex_density: f32,
}

struct TexturedFace {
    texture: Arc<Texture>,
    uv: [[f64; 2]; 3],
    wrap: [lodpack_mesh::appearance::Wrap; 2],
    /// Texels per unit of length.
    density: f32,
}

impl TexturedFace {
    fn sample(&self, weights: [f32; 3], footprint: f32) -> [f32; 4] {
        self.with(&self.filter(footprint), weights)
    }

    /// Whether a triangle lies between so few texels that it looks alike everywhere, as those of which each has its
    /// place in a palette.
    fn is_even(&self) -> bool {
        let size = self.texture.size().map(f64::from);
        let span = |k: usize| {
            let places = self.uv.map(|uv| uv[k] * size[k]);
            places.into_iter().fold(f64::MIN, f64::max) - places.into_iter().fold(f64::MAX, f64::min)
        };
        (0..2).all(|k| span(k) <= ALIKE)
    }

    /// How fast places in the image grow over the triangle, in texels per unit of length. None if it has no area.
    fn growth(&self, corners: [DVec3; 3]) -> Option<[DVec3; 2]> {
        let size = self.texture.size().map(f64::from);
        growth_over(corners, self.uv.map(|uv| [uv[0] * size[0], uv[1] * size[1]]))
    }

    /// Texels per unit of length, in the direction in which there are most.
    fn most_along(&self, corners: [DVec3; 3]) -> f32 {
        let Some([u, v]) = self.growth(corners) else { return self.density };
        // The greater root of what the squares of lengths grow by.
        let half = 0.5 * (u.length_squared() + v.length_squared());
        let square = half + (half * half - u.cross(v).length_squared()).max(0.0).sqrt();
        if square.is_finite() { square.sqrt() as f32 } else { self.density }
    }

    fn filter(&self, footprint: f32) -> texture::Filter<'_> {
        self.texture.filter(footprint * self.density)
    }

    #[inline]
    fn with(&self, filter: &texture::Filter<'_>, weights: [f32; 3]) -> [f32; 4] {
        let [a, b, c] = weights.map(f64::from);
        let at = |axis: usize| self.uv[0][axis] * a + self.uv[1][axis] * b + self.uv[2][axis] * c;
        filter.sample([at(0), at(1)], self.wrap)
    }
}

impl Face<'_> {
    /// Red, green, blue and straight alpha in linear light, averaged over about a `footprint`, which is a length in
    /// units of the positions.
    pub fn base_colour(&self, weights: [f32; 3], footprint: f32) -> [f32; 4] {
        let texture = self.textures[Use::Base as usize].as_ref().map(|face| (face, face.filter(footprint)));
        self.base_colour_with(texture.as_ref(), self.opacity(weights, footprint), weights)
    }

    /// Appends the base colours of several points, as [`Face::base_colour`] has them, with or without alpha.
    pub fn base_colours(&self, points: &[Points], footprint: f32, has_alpha: bool, values: &mut Vec<f32>) {
        let texture = self.textures[Use::Base as usize].as_ref().map(|face| (face, face.filter(footprint)));
        if let (Some((face, filter)), None, false) = (&texture, self.colour, has_alpha) {
            return self.textured_colours(face, filter, points, values);
        }
        let components = if has_alpha { 4 } else { 3 };
        for weights in points.iter().flat_map(|points| points.weights()) {
            let colour = self.base_colour_with(texture.as_ref(), self.opacity(weights, footprint), weights);
            values.extend_from_slice(&colour[..components]);
        }
    }

    /// Those of a texture, in rows, times the factor.
    fn textured_colours(
        &self,
        face: &TexturedFace,
        filter: &texture::Filter<'_>,
        points: &[Points],
        values: &mut Vec<f32>,
    ) {
        let count: usize = points.iter().map(|points| points.count as usize).sum();
        let first = values.len();
        values.resize(first + 3 * count, 0.0);
        let colours = values[first..].as_chunks_mut::<3>().0;
        let mut rest = &mut *colours;
        for points in points {
            let (row, others) = rest.split_at_mut(points.count as usize);
            let along =
                |weights: [f64; 3]| [0, 1].map(|axis| (0..3).map(|k| face.uv[k][axis] * weights[k]).sum::<f64>());
            filter.sample_row(along(points.first), along(points.growth), face.wrap, row);
            rest = others;
        }
        let [red, green, blue, _] = self.material.map_or([1.0; 4], |material| material.base_colour);
        if [red, green, blue] != [1.0; 3] {
            colours.iter_mut().for_each(|colour| *colour = [colour[0] * red, colour[1] * green, colour[2] * blue]);
        }
    }

    /// What an image of opacity alone says.
    #[inline]
    fn opacity(&self, weights: [f32; 3], footprint: f32) -> f32 {
        let texture = self.textures[Use::Opacity as usize].as_ref();
        texture.map_or(1.0, |face| face.texture.opacity(face.sample(weights, footprint)))
    }

    #[inline]
    fn base_colour_with(
        &self,
        texture: Option<&(&TexturedFace, texture::Filter<'_>)>,
        opacity: f32,
        weights: [f32; 3],
    ) -> [f32; 4] {
        let mut colour = self.material.map_or([1.0; 4], |material| material.base_colour);
        colour[3] *= opacity;
        let mut multiply = |factor: [f32; 4]| (0..4).for_each(|i| colour[i] *= factor[i]);
        if let Some(place) = self.colour {
            multiply(self.interpolated_colour(place, weights));
        }
        if let Some((face, filter)) = texture {
            multiply(face.with(filter, weights));
        }
        match self.material.map(|material| material.alpha) {
            Some(AlphaMode::Opaque) => colour[3] = 1.0,
            // Where it is kept how the surface is drawn, alpha is compared when it is drawn: so outlines are as smooth
            // as the input's.
            Some(AlphaMode::Mask(least)) if !self.appearance.has_drawings => {
                colour[3] = if colour[3] >= least { 1.0 } else { 0.0 }
            }
            _ => {}
        }
        colour
    }

    /// The number of how it is drawn.
    pub fn drawing(&self) -> u16 {
        self.material.map_or(0, |material| material.drawing().number())
    }

    /// The value of a scalar, counted as in [`Appearance::scalars`]. NaN where no corner has one.
    pub fn scalar(&self, which: usize, weights: [f32; 3]) -> f32 {
        let layout = &self.appearance.layout;
        let name = self.appearance.scalars.get(which).map_or("", |range| range.name.as_str());
        let place = layout.scalars.iter().find(|(known, _)| known == name).map_or(usize::MAX, |(_, place)| *place);
        let (mut sum, mut weight) = (0.0, 0.0);
        for (record, share) in self.records.iter().zip(weights) {
            if let Some(value) = record.get(place).filter(|value| value.is_finite()) {
                (sum, weight) = (sum + share * value, weight + share);
            }
        }
        if weight > 0.0 { sum / weight } else { f32::NAN }
    }

    /// The label of the nearest corner, counted as scalars are. NaN if it has none.
    pub fn label(&self, which: usize, weights: [f32; 3]) -> f32 {
        let [a, b, c] = weights;
        let nearest = if a >= b && a >= c {
            0
        } else if b >= c {
            1
        } else {
            2
        };
        let mut alone = [0.0; 3];
        alone[nearest] = 1.0;
        self.scalar(which, alone)
    }

    /// Samples per unit of length that the channels of the input have here, but for scalars: texels of its textures, or
    /// about one for each vertex; 0 where it has none of them.
    pub fn material_density(&self) -> f32 {
        // What the factors of a material say takes texels, too, and so does the one place in an image that a triangle
        // shows.
        let has_factors = self.appearance.has_colour || self.appearance.has_materials();
        let is_even = has_factors && self.are_textures_even();
        let has_vertices = self.colour.is_some() || self.appearance.maps.normal || is_even;
        let of_vertices = if has_vertices { self.vertex_density } else { 0.0 };
        of_vertices.max(self.texture_density())
    }

    /// As many as images of it need: fewer where all of the triangle looks alike, since no piece of an image reaches
    /// beyond what jumps.
    pub fn image_density(&self) -> f32 {
        (if self.is_even() { EVEN * self.material_density() } else { self.material_density() })
            .max(self.texture_density())
    }

    /// Whether its colour is the same everywhere.
    pub fn has_one_colour(&self) -> bool {
        let are_alike = |place: usize| {
            let [one, two, three] = self.records.map(|record| colour_at(record, place).map(f32::to_bits));
            one == two && two == three
        };
        self.colour.is_none_or(are_alike) && self.are_textures_even()
    }

    /// Whether it looks alike everywhere.
    pub fn is_even(&self) -> bool {
        let has_colours = self.colour.is_some() && !self.is_part;
        let has_values = has_colours || self.appearance.maps.normal || !self.appearance.scalars.is_empty();
        !has_values && self.are_textures_even()
    }

    /// As many as there are at least in the mean of all triangles: along a ramp, where these have no area in the image,
    /// those of vertices at most.
    pub fn least_density(&self) -> f32 {
        let of_texture = |face: &TexturedFace| face.most_along(self.corners).min(self.vertex_density);
        self.textures.iter().flatten().map(of_texture).fold(0.0, f32::max)
    }

    /// How fast the places in its image grow, in texels per unit of length; in that with most texels.
    pub fn texel_growth(&self) -> Option<[DVec3; 2]> {
        let most = self.textures.iter().flatten().max_by(|one, other| one.density.total_cmp(&other.density));
        most.filter(|face| !face.is_even())?.growth(self.corners)
    }

    /// Texels of its textures.
    fn texture_density(&self) -> f32 {
        self.textures.iter().flatten().map(|face| face.density).fold(0.0, f32::max)
    }

    fn are_textures_even(&self) -> bool {
        self.textures.iter().flatten().all(TexturedFace::is_even)
    }

    /// As [`Face::image_density`], along the direction in which there are most of them.
    pub fn most_density(&self) -> f32 {
        let along = |face: &TexturedFace| face.most_along(self.corners);
        self.textures.iter().flatten().map(along).fold(self.image_density(), f32::max)
    }

    /// Samples per unit of length that scalars of the input have here: about one for each vertex.
    pub fn scalar_density(&self) -> f32 {
        self.vertex_density
    }

    #[inline]
    fn interpolated_colour(&self, place: usize, weights: [f32; 3]) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for (record, weight) in self.records.iter().zip(weights) {
            let colour = colour_at(record, place);
            (0..4).for_each(|k| sum[k] += weight * colour[k]);
        }
        sum
    }
}

/// The colour of a record. A vertex without one is white.
#[inline]
fn colour_at(record: &[f32], place: usize) -> &[f32; 4] {
    record.get(place..).and_then(|rest| rest.first_chunk()).unwrap_or(&[1.0; 4])
}

#[cfg(test)]
mod tests;
