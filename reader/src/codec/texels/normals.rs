//! Normals: directions relative to the axis of the piece in which a texel lies, by Lambert's equal-area projection of a
//! hemisphere.
//!
//! Near the axis a step is .6 degrees, everywhere less than one. Nothing folds, so filtering and transforming do no
//! harm.

use super::{
    image::{Image, check},
    map::{Map, Piece},
    scaled::SCALES,
};
#[cfg(feature = "write")]
use crate::codec::vector::dot;
use crate::error::Result;

/// The byte of a vanishing component, and what the bytes of 1 and -1 are away from it.
const MIDDLE: f64 = 128.0;
const REACH: f64 = 127.0;

/// The texels of a piece's rectangle: left, top, right and bottom, of which the last two are outside.
fn rectangle(piece: &Piece) -> [usize; 4] {
    let [low, high] = piece.range();
    [low[0] as usize, low[1] as usize, high[0] as usize + 1, high[1] as usize + 1]
}

impl Image<u8> {
    /// Decodes normals. Each texel has three components: a direction of length 1 is 128 + 127 times its coordinates.
    /// Texels beside all pieces are 0.
    ///
    /// # Errors
    /// If the bytes break a rule of the format.
    pub fn decode_normals(bytes: &[u8], map: &Map) -> Result<Self> {
        Self::decode_colours(bytes, map.size, 2)?.directions(map)
    }

    /// As [`Image::decode_normals`], from the first strings of an image in scales ([`Image::decode_scaled`]); `map` is
    /// that of the image in full.
    ///
    /// # Errors
    /// If the strings break a rule of the format.
    pub fn decode_scaled_normals<S: AsRef<[u8]>>(strings: &[S], map: &Map) -> Result<Self> {
        let image = Self::decode_scaled(strings, map.size, 2)?;
        match SCALES.saturating_sub(strings.len()) as u8 {
            0 => image.directions(map),
            halvings => image.directions(&map.halved(halvings)),
        }
    }

    /// As [`Image::decode_normals`], of an exact channel.
    ///
    /// # Errors
    /// If the bytes break a rule of the format.
    pub fn decode_exact_normals(bytes: &[u8], map: &Map) -> Result<Self> {
        Self::decode_exact(bytes, map.size, 2)?.directions(map)
    }

    /// The directions that two bytes of each texel stand for.
    fn directions(self, map: &Map) -> Result<Self> {
        let projected = self;
        check(map.size, 3)?;
        let width = map.size[0] as usize;
        let mut data = vec![0; projected.data.len() / 2 * 3];
        for piece in &map.pieces {
            let frame = piece.frame();
            let [left, top, right, bottom] = rectangle(piece);
            for y in top..bottom {
                let row = y * width + left..y * width + right;
                let projected = projected.data[2 * row.start..2 * row.end].chunks_exact(2);
                for (texel, from) in data[3 * row.start..3 * row.end].chunks_exact_mut(3).zip(projected) {
                    texel.copy_from_slice(&direction([from[0], from[1]], &frame));
                }
            }
        }
        Ok(Self { size: map.size, components: 3, data })
    }
}

/// The bytes of the direction that two bytes stand for.
fn direction(bytes: [u8; 2], [u, v, axis]: &[[f64; 3]; 3]) -> [u8; 3] {
    let [x, y] = bytes.map(|byte| (f64::from(byte) - MIDDLE) / REACH);
    let square = x * x + y * y;
    // Beyond the edge of the hemisphere lies its edge.
    let (x, y, square) = if square > 1.0 { (x / square.sqrt(), y / square.sqrt(), 1.0) } else { (x, y, square) };
    let (length, height) = ((2.0 - square).sqrt(), 1.0 - square);
    let along = |k: usize| u[k] * (x * length) + v[k] * (y * length) + axis[k] * height;
    // The conversion rounds down.
    [0, 1, 2].map(|k| (along(k) * REACH + MIDDLE + 0.5) as u8)
}

/// Codes directions of any length, one for each texel of a map, with a step of quantisation. Texels that are not used
/// may have any value afterwards.
#[cfg(feature = "write")]
pub fn encode_normals(map: &Map, directions: &[[f32; 3]], is_used: &[bool], step: u8) -> super::ImageStreams {
    super::encode_image(&projected_image(map, directions), is_used, step)
}

/// As [`encode_normals`], for an exact channel: nothing is lost but what two bytes cannot say.
#[cfg(feature = "write")]
pub fn encode_exact_normals(map: &Map, directions: &[[f32; 3]], is_used: &[bool]) -> Vec<u8> {
    super::encode_exact_image(&projected_image(map, directions), is_used)
}

/// The two bytes of each texel's direction.
#[cfg(feature = "write")]
fn projected_image(map: &Map, directions: &[[f32; 3]]) -> Image<u8> {
    let mut image = Image::filled(map.size, &[MIDDLE as u8; 2]);
    let width = map.size[0] as usize;
    for piece in &map.pieces {
        let frame = piece.frame();
        let [left, top, right, bottom] = rectangle(piece);
        for y in top..bottom {
            for texel in y * width + left..y * width + right {
                let bytes = projected(directions[texel].map(f64::from), &frame);
                image.data[2 * texel..][..2].copy_from_slice(&bytes);
            }
        }
    }
    image
}

/// The two bytes of a direction; those of the axis if it has no length.
#[cfg(feature = "write")]
fn projected(direction: [f64; 3], [u, v, axis]: &[[f64; 3]; 3]) -> [u8; 2] {
    let length = dot(direction, direction).sqrt();
    if length <= 0.0 || !length.is_finite() {
        return [MIDDLE as u8; 2];
    }
    let [x, y, height] = [u, v, axis].map(|&of| dot(direction, of) / length);
    let factor = if height > 0.0 { 1.0 / (1.0 + height).sqrt() } else { 1.0 / (x * x + y * y).sqrt().max(1e-30) };
    [x, y].map(|x| (MIDDLE + REACH * (x * factor).clamp(-1.0, 1.0)).round() as u8)
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;
    use crate::codec::texels::{PieceShape, encode_map};

    #[test]
    fn directions_of_a_hemisphere_come_back_within_a_degree_and_others_at_its_edge() {
        let positions = [[0, 0, 0], [4000, 0, -3000], [0, 4000, 0]];
        let shapes = [PieceShape { axis: [3, 0, 4], ..PieceShape::default() }];
        let (map, _) = encode_map(&positions, &[[0, 1, 2]], 12, &shapes, &[0], 1 << 20).unwrap();
        let count = (map.size[0] * map.size[1]) as usize;
        let axis = [0.6, 0.0, 0.8];
        let direction = |texel: usize| {
            let (up, turn) = (1.0 - 2.0 * (texel as f32 + 0.5) / count as f32, texel as f32 * 2.4);
            let across = (1.0 - up * up).sqrt();
            [across * turn.cos(), across * turn.sin(), up].map(|x| 7.0 * x)
        };
        let directions: Vec<[f32; 3]> = (0..count).map(direction).collect();
        // With the smallest step. Neighbours have nothing in common here.
        let streams = encode_normals(&map, &directions, &vec![true; count], 1);
        let image = Image::decode_scaled_normals(&streams, &map).unwrap();
        for (wanted, texel) in directions.iter().zip(image.data.chunks_exact(3)) {
            let found = [0, 1, 2].map(|k| (f64::from(texel[k]) - 128.0) / 127.0);
            let wanted = wanted.map(|x| f64::from(x) / 7.0);
            let cosine = dot(found, wanted) / dot(found, found).sqrt();
            let height = dot(wanted, axis);
            let expected = if height > 0.0 { 1.0 } else { (1.0 - height * height).sqrt() };
            assert!((cosine - expected).abs() < 0.03 && (height < 0.0 || cosine > 0.9994), "{wanted:?} {found:?}");
        }
    }

    #[test]
    fn no_bytes_make_a_direction_that_is_too_long() {
        let frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for bytes in (0..=255).flat_map(|x| (0..=255).map(move |y| [x, y])) {
            let found = direction(bytes, &frame).map(|byte| f64::from(byte) - 128.0);
            let length = dot(found, found).sqrt();
            assert!((length - 127.0).abs() < 1.0, "{bytes:?} {length}");
        }
    }
}
