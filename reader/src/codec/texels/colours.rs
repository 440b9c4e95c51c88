//! Colours of one scale, as files before version 4.4 have them: blocks of 8 x 8 texels, transformed and quantised.
//! They are read, and not written any more.

use super::binary::{BitDecoder, Chance, NumberChances};
use super::{
    image::Image,
    planes::{is_difference, scaled, step_of, store, too_large},
    transform::{AREA, ORDER, SIDE, inverse},
};
use crate::error::Result;

/// Blocks between checks that the bytes have not ended.
const CHECKED: usize = 64;

/// What is coded alike: brightness and opacity, or the two differences of colour.
#[derive(Default)]
struct PlaneChances {
    /// By activity of the neighbours.
    constant: [NumberChances; 4],
    /// Whether another coefficient follows, by activity and place.
    more: [[Chance; 16]; 4],
    /// Whether a coefficient is not zero, by place and what the one before is.
    significant: [[[Chance; 3]; 16]; 4],
    magnitude: [[NumberChances; 3]; 4],
}

/// What neighbours of a block must know of it.
#[derive(Clone, Copy, Default)]
struct Known {
    is_coded: bool,
    /// Quantised mean and number of other coefficients, by plane.
    constant: [i32; 4],
    count: [u8; 4],
}

#[derive(Default)]
struct Chances {
    skip: [Chance; 3],
    planes: [PlaneChances; 2],
}

/// Four classes of how many coefficients the blocks to the left and above have.
fn activity(left: Known, above: Known, component: usize) -> usize {
    match u32::from(left.count[component]) + u32::from(above.count[component]) {
        0 => 0,
        1..=4 => 1,
        5..=14 => 2,
        _ => 3,
    }
}

/// Of each place its class, of four by frequency, and its number within the class.
static PLACES: [[u8; 2]; AREA] = {
    let (mut places, mut place) = ([[0; 2]; AREA], 0);
    while place < AREA {
        let [band, within] = match place {
            0..=2 => [0, place],
            3..=9 => [1, place - 3],
            10..=27 => [2, if place < 25 { place - 10 } else { 15 }],
            _ => [3, (place - 28) / 3],
        };
        places[place] = [band as u8, within as u8];
        place += 1;
    }
    places
};

/// The class of a place, and its number within the class.
#[inline]
fn class_of(place: usize) -> [usize; 2] {
    PLACES[place].map(usize::from)
}

/// The mean that is expected of a block.
fn expected(left: Known, above: Known, component: usize) -> i32 {
    match (left.is_coded, above.is_coded) {
        (true, true) => (left.constant[component] + above.constant[component]) >> 1,
        (true, false) => left.constant[component],
        (false, true) => above.constant[component],
        (false, false) => 0,
    }
}

/// The blocks of an image, row after row, with what is known of those before.
struct Blocks {
    columns: usize,
    rows: usize,
    above: Vec<Known>,
    left: Known,
}

impl Blocks {
    fn new(size: [u32; 2]) -> Self {
        let [columns, rows] = size.map(|length| (length as usize).div_ceil(SIDE));
        Self { columns, rows, above: vec![Known::default(); columns], left: Known::default() }
    }

    fn neighbours(&mut self, column: usize) -> (Known, Known) {
        if column == 0 {
            self.left = Known::default();
        }
        (self.left, self.above[column])
    }

    fn set(&mut self, column: usize, known: Known) {
        (self.left, self.above[column]) = (known, known);
    }
}

pub(super) fn decode(bytes: &[u8], size: [u32; 2], components: u8, step: u8) -> Result<Image<u8>> {
    let count = usize::from(components);
    let mut bits = BitDecoder::new(bytes);
    let (mut chances, mut blocks) = (Box::<Chances>::default(), Blocks::new(size));
    // Rows of blocks are allocated as they come, so that a short string cannot take much memory.
    let row_length = size[0] as usize * count;
    let mut data = Vec::new();
    for block_row in 0..blocks.rows {
        let rows = SIDE.min(size[1] as usize - block_row * SIDE);
        let first = data.len();
        data.resize(first + rows * row_length, 0);
        for column in 0..blocks.columns {
            if column % CHECKED == 0 {
                bits.check()?;
            }
            let (left, above) = blocks.neighbours(column);
            let known = usize::from(left.is_coded) + usize::from(above.is_coded);
            if bits.bit(&mut chances.skip[known]) {
                blocks.set(column, Known::default());
                continue;
            }
            let mut planes = [[0; AREA]; 4];
            let mut this = Known { is_coded: true, ..Known::default() };
            for (component, plane) in planes.iter_mut().enumerate().take(count) {
                let of_plane = &mut chances.planes[usize::from(is_difference(component, count))];
                let class = activity(left, above, component);
                let step = step_of(component, count, step);
                let delta = bits.signed(&mut of_plane.constant[class])?;
                let constant = delta.checked_add(expected(left, above, component)).ok_or_else(too_large)?;
                let mut coefficients = [0; AREA];
                coefficients[0] = scaled(constant, step)?;
                this.constant[component] = constant;
                this.count[component] = decode_others(&mut bits, of_plane, class, step, &mut coefficients)?;
                *plane = inverse(&coefficients);
            }
            blocks.set(column, this);
            let columns = SIDE.min(size[0] as usize - column * SIDE);
            for y in 0..rows {
                let start = first + y * row_length + column * SIDE * count;
                let texels = data[start..start + columns * count].chunks_exact_mut(count);
                for (x, texel) in texels.enumerate() {
                    store(texel, |component| planes[component][y * SIDE + x]);
                }
            }
        }
    }
    bits.finish()?;
    Ok(Image { size, components, data })
}

/// Decodes all coefficients but the first; returns how many are not zero.
fn decode_others(
    bits: &mut BitDecoder<'_>,
    chances: &mut PlaneChances,
    class: usize,
    step: i32,
    coefficients: &mut [i32; AREA],
) -> Result<u8> {
    let (mut place, mut before, mut count) = (1, 0, 0);
    while place < AREA && bits.bit(&mut chances.more[class][place.min(15)]) {
        while place < AREA - 1 {
            let [band, within] = class_of(place);
            if bits.bit(&mut chances.significant[band][within][before]) {
                break;
            }
            (place, before) = (place + 1, 0);
        }
        let size = bits.number(&mut chances.magnitude[class_of(place)[0]][before])?;
        let size = size.checked_add(1).and_then(|size| i32::try_from(size).ok()).ok_or_else(too_large)?;
        let value = scaled(size, step)?;
        coefficients[usize::from(ORDER[place])] = if bits.raw(1) == 1 { -value } else { value };
        (place, before, count) = (place + 1, 1 + usize::from(size > 1), count + 1);
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 x 12 texels of a picture with an edge, of which the last columns are not used, by the encoder of version 4.1.
    const BYTES: [u8; 87] = [
        12, 127, 255, 246, 195, 125, 127, 255, 254, 22, 143, 255, 139, 0, 34, 255, 180, 114, 16, 216, 64, 32, 71, 225,
        252, 30, 213, 24, 69, 42, 103, 199, 194, 81, 54, 162, 89, 219, 36, 253, 5, 20, 255, 174, 15, 245, 7, 222, 189,
        74, 80, 237, 109, 125, 170, 210, 143, 36, 84, 182, 70, 26, 142, 166, 4, 140, 198, 217, 19, 175, 70, 156, 246,
        24, 83, 222, 166, 255, 43, 169, 93, 70, 170, 54, 238, 170, 22,
    ];

    #[test]
    fn images_of_earlier_versions_are_read_as_before() {
        let image = Image::decode_colours(&BYTES, [20, 12], 3).unwrap();
        assert_eq!(image.data[..12], [2, 2, 198, 3, 1, 198, 5, 1, 199, 7, 1, 199]);
        let sum: u32 = (0..).zip(&image.data).map(|(at, &byte)| (at % 251 + 1) * u32::from(byte)).sum();
        assert_eq!(sum, 3_844_924);
    }

    #[test]
    fn damaged_images_are_refused_or_decoded_but_never_panic() {
        for at in 0..BYTES.len() {
            for flip in [1, 0x80, 0xff] {
                let mut damaged = BYTES;
                damaged[at] ^= flip;
                let _ = Image::decode_colours(&damaged, [20, 12], 3);
            }
            let _ = Image::decode_colours(&BYTES[..at], [20, 12], 3);
        }
        assert!(Image::decode_colours(&[1], [u32::MAX, u32::MAX], 4).is_err());
        assert!(Image::decode_colours(&[], [4, 4], 3).is_err());
    }
}
