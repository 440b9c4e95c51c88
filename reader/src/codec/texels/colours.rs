//! Colours: blocks of 8 x 8 texels, transformed and quantised.

use super::binary::{BitDecoder, Chance, NumberChances};
#[cfg(feature = "write")]
use super::{
    binary::BitEncoder,
    loss::{Errors, others_off, weight_of},
    seen::Seen,
    transform::forward,
};
use super::{
    image::Image,
    transform::{AREA, MOST, ORDER, SIDE, inverse},
};
use crate::error::{Error, Result};

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

/// Whether a component is one of the two differences.
fn is_difference(component: usize, components: usize) -> bool {
    components >= 3 && (component == 1 || component == 2)
}

/// The step of a component: the eye and the mean error care less for differences.
pub(super) fn step_of(component: usize, components: usize, step: u8) -> i32 {
    let step = i32::from(step);
    if is_difference(component, components) { (step * 3 + 1) / 2 } else { step }
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

fn too_large() -> Error {
    Error::format("a coefficient of an image is too large")
}

fn scaled(level: i32, step: i32) -> Result<i32> {
    level.checked_mul(step).filter(|c| c.abs() <= MOST).ok_or_else(too_large)
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

/// Turns brightness and differences into a colour.
pub(super) fn store(texel: &mut [u8], plane: impl Fn(usize) -> i32) {
    let clamped = |value: i32| value.clamp(0, 255) as u8;
    if let [red, green, blue, rest @ ..] = texel {
        let [brightness, blueness, redness] = [plane(0) + 128, plane(1), plane(2)];
        *red = clamped(brightness + ((359 * redness + 128) >> 8));
        *green = clamped(brightness - ((88 * blueness + 183 * redness + 128) >> 8));
        *blue = clamped(brightness + ((454 * blueness + 128) >> 8));
        rest.iter_mut().for_each(|opacity| *opacity = clamped(plane(3) + 128));
    } else {
        texel.iter_mut().enumerate().for_each(|(component, value)| *value = clamped(plane(component) + 128));
    }
}

/// Share of a step that is added before a coefficient is rounded down: below one half, because zeros cost least.
#[cfg(feature = "write")]
pub(super) const ROUNDING: f32 = 0.4;

/// Numbers of single precision have no fraction from here to twice as much.
#[cfg(feature = "write")]
pub(super) const WHOLE: f32 = (1 << 23) as f32;

/// Where a coefficient stands among those that [`forward`] returns.
#[cfg(feature = "write")]
const fn transposed(at: u8) -> usize {
    at as usize % SIDE * SIDE + at as usize / SIDE
}

/// The place of each of them in the order.
#[cfg(feature = "write")]
static PLACE_OF: [u8; AREA] = {
    let (mut places, mut place) = ([0; AREA], 0);
    while place < AREA {
        places[transposed(ORDER[place])] = place as u8;
        place += 1;
    }
    places
};

/// Colours with a step of quantisation, or with a finer one where that is worth its bytes; and which one it is.
#[cfg(feature = "write")]
pub(super) fn encode(image: &Image<u8>, is_used: &[bool], seen: Option<&Seen<'_>>, step: u8) -> (u8, Vec<u8>) {
    let mut errors = Errors::default();
    let bytes = encode_with(image, is_used, seen, step, &mut errors);
    match errors.better_step(step, usize::from(image.components), bytes.len()) {
        Some(better) => (better, encode_with(image, is_used, seen, better, &mut Errors::default())),
        None => (step, bytes),
    }
}

#[cfg(feature = "write")]
fn encode_with(image: &Image<u8>, is_used: &[bool], seen: Option<&Seen<'_>>, step: u8, errors: &mut Errors) -> Vec<u8> {
    let count = usize::from(image.components);
    let mut bits = BitEncoder::new();
    let (mut chances, mut blocks) = (Box::<Chances>::default(), Blocks::new(image.size));
    for block_row in 0..blocks.rows {
        for column in 0..blocks.columns {
            let first = [column * SIDE, block_row * SIDE];
            let (left, above) = blocks.neighbours(column);
            let known = usize::from(left.is_coded) + usize::from(above.is_coded);
            let planes = planes(image, is_used, first);
            bits.bit(&mut chances.skip[known], planes.is_none());
            let Some(planes) = planes else {
                blocks.set(column, Known::default());
                continue;
            };
            let mut seen = seen.and_then(|seen| seen.block(block_row * blocks.columns + column, first));
            let mut this = Known { is_coded: true, ..Known::default() };
            let mut constants = [0.0; 4];
            for (component, plane) in planes.iter().enumerate().take(count) {
                let of_plane = &mut chances.planes[usize::from(is_difference(component, count))];
                let class = activity(left, above, component);
                let (mut coefficients, step) = (forward(plane), step_of(component, count, step) as f32);
                let inverse = 1.0 / step;
                constants[component] = coefficients[0];
                errors.others += weight_of(component, count) * others_off(&coefficients, inverse);
                let limit = MOST as f32 * inverse;
                if let Some(seen) = &mut seen {
                    let mut levels = coefficients.map(|c| level_size(c, inverse, limit).copysign(c));
                    levels[0] = (coefficients[0] * inverse).round();
                    seen.improve(plane, step, &mut levels);
                    coefficients = levels.map(|level| level * step);
                }
                let constant = (coefficients[0] * inverse).round().clamp(-limit, limit) as i32;
                bits.signed(&mut of_plane.constant[class], constant - expected(left, above, component));
                this.constant[component] = constant;
                this.count[component] = encode_others(&mut bits, of_plane, class, &coefficients, inverse);
            }
            errors.constants.push((constants, this.count == [0; 4]));
            blocks.set(column, this);
        }
    }
    bits.finish()
}

/// How many steps a coefficient has, rounded; at most a limit. Compilers turn this into vectors, as conversions that
/// saturate are not.
#[cfg(feature = "write")]
#[inline(always)]
fn level_size(coefficient: f32, inverse: f32, limit: f32) -> f32 {
    let size = (coefficient * inverse).abs() + ROUNDING;
    let size = if size < limit { size } else { limit };
    let rounded = size + WHOLE - WHOLE;
    rounded - if rounded > size { 1.0 } else { 0.0 }
}

/// Codes all coefficients but the first. Levels are multiples of the step, with `inverse`.
#[cfg(feature = "write")]
fn encode_others(
    bits: &mut BitEncoder,
    chances: &mut PlaneChances,
    class: usize,
    coefficients: &[f32; AREA],
    inverse: f32,
) -> u8 {
    let limit = MOST as f32 * inverse;
    let sizes = coefficients.map(|c| ((level_size(c, inverse, limit) + WHOLE).to_bits() & 0x1fff) as u16);
    // Places where something is, a bit each: most rows of a block have nothing.
    let mut rest = 0_u64;
    for (row, sizes) in sizes.as_chunks::<SIDE>().0.iter().enumerate() {
        if *sizes != [0; SIDE] {
            for (column, &size) in sizes.iter().enumerate() {
                rest |= u64::from(size != 0) << PLACE_OF[row * SIDE + column];
            }
        }
    }
    rest &= !1;
    let count = rest.count_ones();
    let (mut place, mut before) = (1, 0);
    let BitEncoder { interval, bytes } = bits;
    let mut own = *interval;
    while rest != 0 {
        own.bit(bytes, &mut chances.more[class][place.min(15)], true);
        let next = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        while place < next {
            let [band, within] = class_of(place);
            own.bit(bytes, &mut chances.significant[band][within][before], false);
            (place, before) = (place + 1, 0);
        }
        let [band, within] = class_of(place);
        // At the last place there is nothing to say.
        if place < AREA - 1 {
            own.bit(bytes, &mut chances.significant[band][within][before], true);
        }
        let at = transposed(ORDER[place]);
        let size = u32::from(sizes[at]);
        own.number(bytes, &mut chances.magnitude[band][before], size - 1);
        own.even(bytes, coefficients[at] < 0.0);
        (place, before) = (place + 1, 1 + usize::from(size > 1));
    }
    if place < AREA {
        own.bit(bytes, &mut chances.more[class][place.min(15)], false);
    }
    *interval = own;
    count as u8
}

/// Brightness and differences of a block, about zero. Texels that are not used get values that cost little; none if no
/// texel is used.
#[cfg(feature = "write")]
pub(super) fn planes(image: &Image<u8>, is_used: &[bool], [left, top]: [usize; 2]) -> Option<[[f32; AREA]; 4]> {
    let [width, height] = image.size.map(|length| length as usize);
    let count = usize::from(image.components);
    let mut planes = [[0.0; AREA]; 4];
    let mut used = 0_u64;
    let columns = SIDE.min(width - left);
    for y in 0..SIDE.min(height - top) {
        let first = (top + y) * width + left;
        for (x, &is_used) in is_used[first..first + columns].iter().enumerate() {
            used |= u64::from(is_used) << (y * SIDE + x);
        }
        let texels = &image.data[first * count..(first + columns) * count];
        let value = |byte: u8| f32::from(byte) - 128.0;
        let places = y * SIDE..;
        match count {
            3 => places.zip(texels.as_chunks().0).for_each(|(at, &[red, green, blue])| {
                [planes[0][at], planes[1][at], planes[2][at]] = [value(red), value(green), value(blue)];
            }),
            _ => places.zip(texels.chunks_exact(count)).for_each(|(at, texel)| {
                planes.iter_mut().zip(texel).for_each(|(plane, &byte)| plane[at] = value(byte));
            }),
        }
    }
    if used == 0 {
        return None;
    }
    if let ([red, green, blue, _], true) = (&mut planes, count >= 3) {
        for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
            let brightness = 0.299 * *red + 0.587 * *green + 0.114 * *blue;
            let differences = [(*blue - brightness) * (256.0 / 454.0), (*red - brightness) * (256.0 / 359.0)];
            [*red, *green, *blue] = [brightness, differences[0], differences[1]];
        }
    }
    fill(&mut planes[..count], used);
    Some(planes)
}

/// Gives values that are not known those of their neighbours, ring by ring, smoothed towards the mean of all. Each bit
/// of `known` is a value.
#[cfg(feature = "write")]
fn fill(planes: &mut [[f32; AREA]], mut known: u64) {
    const LEFT: u64 = 0x0101_0101_0101_0101;
    while known != u64::MAX {
        let [left, right] = [known << 1 & !LEFT, known >> 1 & !(LEFT << (SIDE - 1))];
        let ring = (left | right | known << SIDE | known >> SIDE) & !known;
        let mut rest = ring;
        while rest != 0 {
            let at = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (x, y) = (at % SIDE, at / SIDE);
            let sides = [
                (x > 0, at.wrapping_sub(1)),
                (x + 1 < SIDE, at + 1),
                (y > 0, at.wrapping_sub(SIDE)),
                (y + 1 < SIDE, at + SIDE),
            ];
            for plane in &mut *planes {
                let (mut sum, mut count) = (0.0, 0.0);
                for (_, side) in sides.iter().filter(|&&(is_inside, side)| is_inside && known >> side & 1 == 1) {
                    (sum, count) = (sum + plane[*side], count + 1.0);
                }
                plane[at] = sum / count;
            }
        }
        known |= ring;
    }
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::super::encode_image;
    use super::*;

    /// A picture with edges and gradients.
    fn picture(size: [u32; 2], components: u8) -> Image<u8> {
        let mut image = Image { size, components, data: vec![] };
        for y in 0..size[1] {
            for x in 0..size[0] {
                let inside = (x / 13 + y / 9) % 3 == 0;
                let texel = [x * 2 + y, y * 3, if inside { 200 } else { 30 + x % 7 }, 255 - x / 2];
                image.data.extend(texel[..usize::from(components)].iter().map(|&value| value.min(255) as u8));
            }
        }
        image
    }

    fn error(a: &Image<u8>, b: &Image<u8>, is_used: &[bool]) -> f64 {
        let count = usize::from(a.components);
        let pairs = a.data.chunks(count).zip(b.data.chunks(count)).zip(is_used).filter(|&(_, &used)| used);
        let squares: Vec<f64> = pairs
            .flat_map(|((a, b), _)| a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)))
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    #[test]
    fn images_come_back_within_their_step() {
        for size in [[1, 1], [7, 3], [8, 8], [64, 50], [100, 9], [3, 200]] {
            for components in 1..=4 {
                let image = picture(size, components);
                let used = vec![true; image.data.len() / usize::from(components)];
                for step in [1, 6, 20, 255] {
                    let bytes = encode_image(&image, &used, step);
                    let back = Image::decode_colours(&bytes, size, components).unwrap();
                    assert_eq!((back.size, back.components, back.data.len()), (size, components, image.data.len()));
                    let error = error(&image, &back, &used);
                    assert!(error <= 1.0 + 0.6 * f64::from(step), "{size:?} {components} {step}: {error}");
                }
            }
        }
    }

    #[test]
    fn an_even_image_has_a_step_that_shows_it() {
        // Nearly one colour, of which the usual step would show another blue.
        let mut image = Image::filled([256, 256], &[26, 26, 28]);
        (0..60).for_each(|k| image.data[k * 37] = 27);
        let used = vec![true; 256 * 256];
        for step in [9, 12, 15] {
            let bytes = encode_image(&image, &used, step);
            assert!((step.div_ceil(2)..=step).contains(&bytes[0]), "{}", bytes[0]);
            let back = Image::decode_colours(&bytes, image.size, 3).unwrap();
            let error = error(&image, &back, &used);
            assert!(error < 1.0, "{step} {}: {error}", bytes[0]);
        }
        // One that is not even keeps its step.
        let image = picture([256, 256], 3);
        assert_eq!(encode_image(&image, &used, 9)[0], 9);
    }

    #[test]
    fn what_is_not_used_costs_little() {
        let image = picture([128, 128], 3);
        let all = vec![true; 128 * 128];
        let half: Vec<bool> = (0..128 * 128).map(|k| k % 128 < 64).collect();
        let [all, half] = [all, half].map(|used| encode_image(&image, &used, 8).len());
        assert!((half as f64) < 0.56 * all as f64, "{half} {all}");
        let none = vec![false; 128 * 128];
        assert_eq!(encode_image(&image, &none, 8).len(), 4);
    }

    #[test]
    fn damaged_images_are_refused_or_decoded_but_never_panic() {
        let image = picture([60, 40], 4);
        let bytes = encode_image(&image, &[true; 2400], 10);
        for at in 0..bytes.len() {
            for flip in [1, 0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                let _ = Image::decode_colours(&damaged, [60, 40], 4);
            }
            let _ = Image::decode_colours(&bytes[..at], [60, 40], 4);
        }
        assert!(Image::decode_colours(&[1], [u32::MAX, u32::MAX], 4).is_err());
        assert!(Image::decode_colours(&[], [4, 4], 3).is_err());
    }
}
