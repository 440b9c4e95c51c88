//! Brightness and differences of colour, which blocks are transformed and quantised as.

use super::transform::MOST;
#[cfg(feature = "write")]
use super::{
    image::Image,
    transform::{AREA, SIDE},
};
use crate::error::{Error, Result};

/// Whether a component is one of the two differences.
pub(super) fn is_difference(component: usize, components: usize) -> bool {
    components >= 3 && (component == 1 || component == 2)
}

/// The step of a component: the eye and the mean error care less for differences.
pub(super) fn step_of(component: usize, components: usize, step: u8) -> i32 {
    let step = i32::from(step);
    if is_difference(component, components) { (step * 3 + 1) / 2 } else { step }
}

pub(super) fn too_large() -> Error {
    Error::format("a coefficient of an image is too large")
}

pub(super) fn scaled(level: i32, step: i32) -> Result<i32> {
    level.checked_mul(step).filter(|c| c.abs() <= MOST).ok_or_else(too_large)
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

/// How many steps a coefficient has, rounded; at most a limit. Compilers turn this into vectors, as conversions that
/// saturate are not.
#[cfg(feature = "write")]
#[inline(always)]
pub(super) fn level_size(coefficient: f32, inverse: f32, limit: f32) -> f32 {
    let size = (coefficient * inverse).abs() + ROUNDING;
    let size = if size < limit { size } else { limit };
    let rounded = size + WHOLE - WHOLE;
    rounded - if rounded > size { 1.0 } else { 0.0 }
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
