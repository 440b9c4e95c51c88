//! Baking: gives a patch an image of what the input shows where the patch lies.
//!
//! The patch is divided into pieces that can be projected (`pieces`), the pieces are packed into one image ([`lodpack::write::encode_map`]),
//! and the input's triangles are projected along the same axes (`gather`). So neither side needs texture coordinates, and seams of the
//! input's textures are not seen by the result. The texels of coarser patches are means of those of finer ones as they were before they
//! were quantised ([`Surfels`]): each point of the input is looked at once, and nothing is lost twice.

mod gather;
mod pieces;
mod raster;

use glam::DVec3;
use lodpack::{
    LatticePoint,
    decode::texels::{Image, Map},
    write::{encode_image, encode_map, encode_values},
};

use crate::mesh::srgb::srgb_byte;
pub use gather::Surfels;
use gather::{gather, gather_surfels, surfels};
use pieces::{Pieces, divide};
use raster::Drawn;

/// The most texels of a patch.
pub const MAX_TEXELS: u64 = 1 << 24;
/// How often a patch is divided further because pieces overlap themselves.
const MAX_ROUNDS: usize = 3;

/// A patch whose image is wanted.
#[derive(Clone, Copy, Debug)]
pub struct BakedPatch<'a> {
    /// Its vertices as they decode.
    pub positions: &'a [LatticePoint],
    /// Its triangles.
    pub triangles: &'a [[u32; 3]],
    /// How far it may be from the input, lattice units.
    pub reach: f64,
}

/// The surface that images show.
pub trait Source {
    /// The number of its triangles.
    fn triangle_count(&self) -> usize;

    /// The corners of a triangle, lattice units.
    fn corners(&self, triangle: usize) -> [DVec3; 3];

    /// Appends the values at points of a triangle, which are given by the weights of its corners: of each point all of [`ValueKinds`].
    /// They are means over `footprint` lattice units.
    fn shade(&mut self, triangle: usize, weights: &[[f32; 3]], footprint: f32, values: &mut Vec<f32>);
}

/// What a point of a surface carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ValueKinds {
    /// Whether the first four values are a colour in linear light, with straight opacity.
    pub has_colour: bool,
    /// How many scalars follow, NaN where there is none.
    pub scalars: usize,
}

impl ValueKinds {
    /// Values of a point.
    pub fn count(self) -> usize {
        4 * usize::from(self.has_colour) + self.scalars
    }
}

/// What a block stores of its images.
#[derive(Clone, Debug, Default)]
pub struct Baked {
    /// The map, then the image of each channel.
    pub streams: Vec<Vec<u8>>,
    /// Its texels as points, before they were quantised: for the images of coarser patches.
    pub surfels: Vec<Surfels>,
}

/// How values are stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Storage {
    /// Components of the colour, if there is one: 3, or 4 with opacity.
    pub colour_components: Option<u8>,
    /// The step of quantisation of colours, of 255.
    pub colour_step: u8,
    /// For each scalar the value of number 0, and the step between numbers.
    pub scalars: Vec<[f64; 2]>,
}

impl Storage {
    fn kinds(&self) -> ValueKinds {
        ValueKinds { has_colour: self.colour_components.is_some(), scalars: self.scalars.len() }
    }
}

/// The images of a patch, with texels of 2^(exponent / 2) lattice units. None if nothing can be projected.
pub fn bake(patch: &BakedPatch<'_>, source: &mut impl Source, exponent: u32, storage: &Storage) -> Option<Baked> {
    let (map, bytes, drawn) = mapped(patch, exponent)?;
    let values = gather(patch, &map, &drawn, source, storage.kinds());
    Some(baked(patch, &map, bytes, &drawn, &values, storage))
}

/// As [`bake`], from the texels of finer patches.
pub fn bake_coarser(patch: &BakedPatch<'_>, finer: &[Surfels], exponent: u32, storage: &Storage) -> Option<Baked> {
    let (map, bytes, drawn) = mapped(patch, exponent)?;
    let values = gather_surfels(patch, &map, &drawn, finer, storage.kinds());
    Some(baked(patch, &map, bytes, &drawn, &values, storage))
}

fn baked(patch: &BakedPatch<'_>, map: &Map, bytes: Vec<u8>, drawn: &Drawn, values: &[f32], storage: &Storage) -> Baked {
    let kinds = storage.kinds();
    let mut streams = vec![bytes];
    if let Some(components) = storage.colour_components {
        let colours = values.chunks_exact(kinds.count()).map(|texel| [texel[0], texel[1], texel[2], texel[3]]);
        let image = encoded(colours, map.size, components);
        streams.push(encode_image(&image, &drawn.is_used, storage.colour_step));
    }
    let first = 4 * usize::from(kinds.has_colour);
    for (number, &[low, step]) in storage.scalars.iter().enumerate() {
        let numbers = values.chunks_exact(kinds.count()).map(|texel| number_of(texel[first + number], low, step));
        let image = Image { size: map.size, components: 1, data: numbers.collect() };
        streams.push(encode_values(&image, &drawn.is_used));
    }
    Baked { streams, surfels: surfels(patch, map, drawn, values, kinds) }
}

/// The number that stands for a value; 0 for none.
fn number_of(value: f32, low: f64, step: f64) -> u16 {
    // The conversion saturates, and NaN becomes 0.
    ((f64::from(value) - low) / step + 0.5) as u16
}

/// Finds a map whose pieces do not overlap themselves by much.
fn mapped(patch: &BakedPatch<'_>, mut exponent: u32) -> Option<(Map, Vec<u8>, Drawn)> {
    let BakedPatch { positions, triangles, .. } = *patch;
    let mut pieces = divide(positions, triangles);
    for round in 0.. {
        let Pieces { shapes, labels } = &pieces;
        let Ok((map, bytes)) = encode_map(positions, triangles, exponent, shapes, labels, MAX_TEXELS) else {
            // Fewer texels, until they fit.
            exponent += 1;
            if exponent > 127 {
                return None;
            }
            continue;
        };
        let drawn = Drawn::new(positions, triangles, &map);
        if round < MAX_ROUNDS && !drawn.hidden.is_empty() {
            pieces.separate(&drawn.hidden, positions, triangles);
            continue;
        }
        return Some((map, bytes, drawn));
    }
    None
}

/// Colours as they are stored, from linear light.
fn encoded(texels: impl Iterator<Item = [f32; 4]>, size: [u32; 2], components: u8) -> Image<u8> {
    let opaque = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let mut data = Vec::with_capacity(size[0] as usize * size[1] as usize * usize::from(components));
    for [red, green, blue, opacity] in texels {
        let colour = [srgb_byte(red), srgb_byte(green), srgb_byte(blue), opaque(opacity)];
        data.extend(&colour[..usize::from(components)]);
    }
    Image { size, components, data }
}

#[cfg(test)]
mod tests;
