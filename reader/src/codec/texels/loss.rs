//! What quantisation costs an image, and whether a finer step is worth its bytes.

use super::{
    image::Image,
    planes::{ROUNDING, WHOLE, planes, step_of, store},
    transform::{AREA, MOST, SIDE, forward, inverse},
};

/// One of this many blocks is looked at, row after row.
const LOOKED_AT: usize = 13;

/// What quantisation with a step loses of an image in three components: the mean of squares of what a component is off
/// by, in squares of the step. Estimated from some of its blocks; 0 without any.
pub fn lost_squares(image: &Image<u8>, is_used: &[bool], step: u8) -> f32 {
    let [columns, rows] = image.size.map(|length| (length as usize).div_ceil(SIDE));
    let components = usize::from(image.components);
    let mut errors = Errors::default();
    for number in (0..columns * rows).step_by(LOOKED_AT) {
        let first = [number % columns * SIDE, number / columns * SIDE];
        let Some(planes) = planes(image, is_used, first) else { continue };
        let mut constants = [0.0; 4];
        for (component, plane) in planes.iter().enumerate().take(components) {
            let coefficients = forward(plane);
            constants[component] = coefficients[0];
            let inverse = 1.0 / step_of(component, components, step) as f32;
            errors.others += weight_of(component, components) * others_off(&coefficients, inverse);
        }
        errors.constants.push((constants, false));
    }
    let all = errors.others + errors.of_constants(step, components);
    let values = (errors.constants.len().max(1) * AREA * components.min(3)) as f32;
    all / (values * f32::from(step) * f32::from(step))
}

/// What an image loses. An even block is off by the same everywhere: its mean may lie anywhere between two steps. Where
/// most of an image is even, a slightly finer step may show it much better.
#[derive(Default)]
pub(super) struct Errors {
    /// The means of all blocks, as coefficients, and whether they have nothing else.
    pub constants: Vec<([f32; 4], bool)>,
    /// The sum of squares of what all other coefficients are off by.
    pub others: f32,
}

/// What a bit is worth, in squares of a step: between a step and half of it lies a bit for each coefficient, whose
/// square error is a twelfth of the square of the step, or a quarter of that.
const WORTH: f32 = 0.15;

impl Errors {
    /// A finer step than that with which an image has `bytes` bytes, if most of what it loses is in its means, and the
    /// bytes are worth it.
    pub fn better_step(&self, step: u8, components: usize, bytes: usize) -> Option<u8> {
        if self.of_constants(step, components) <= self.others {
            return None;
        }
        let bits = WORTH * f32::from(step) * f32::from(step) * 8.0 * bytes as f32;
        let cost = |finer: u8| self.of_constants(finer, components) + bits * f32::from(step) / f32::from(finer);
        let costs = (step.div_ceil(2)..=step).rev().map(|finer| (cost(finer), finer));
        costs.min_by(|(one, _), (other, _)| one.total_cmp(other)).map(|(_, finer)| finer).filter(|&finer| finer < step)
    }

    /// The sum of squares of what the means are off by.
    fn of_constants(&self, step: u8, components: usize) -> f32 {
        let steps: [f32; 4] = std::array::from_fn(|component| step_of(component, components, step) as f32);
        let of_block = |(block, is_even): &([f32; 4], bool)| {
            let quantised: [f32; 4] = std::array::from_fn(|k| (block[k] / steps[k]).round() * steps[k]);
            if *is_even && components == 3 {
                // As it is decoded, in whole numbers.
                let wanted = colour_of(block.map(|constant| constant / SIDE as f32));
                let mut shown = [0; 3];
                store(&mut shown, |plane| {
                    let mut coefficients = [0; AREA];
                    coefficients[0] = (quantised[plane] as i32).clamp(-MOST, MOST);
                    inverse(&coefficients)[0]
                });
                let off = |k: usize| wanted[k] - f32::from(shown[k]);
                AREA as f32 * (0..3).map(|k| off(k) * off(k)).sum::<f32>()
            } else {
                let off = |k: usize| block[k] - quantised[k];
                (0..components).map(|k| weight_of(k, components) * off(k) * off(k)).sum()
            }
        };
        self.constants.iter().map(of_block).sum()
    }
}

/// The colour of a brightness and two differences.
fn colour_of([brightness, blueness, redness, _]: [f32; 4]) -> [f32; 3] {
    let green = brightness + 128.0 - (88.0 * blueness + 183.0 * redness) / 256.0;
    [brightness + 128.0 + redness * (359.0 / 256.0), green, brightness + 128.0 + blueness * (454.0 / 256.0)]
}

/// By what the square of an error of a component counts in those of all components of a colour.
pub(super) fn weight_of(component: usize, components: usize) -> f32 {
    match (component, components >= 3) {
        (0, true) => 3.0,
        (1, true) => 3.26,
        (2, true) => 2.48,
        _ => 1.0,
    }
}

/// The sum of squares of what all coefficients but the first are off by.
pub(super) fn others_off(coefficients: &[f32; AREA], inverse: f32) -> f32 {
    let step = 1.0 / inverse;
    let mut sums = [0.0; SIDE];
    for row in coefficients.as_chunks::<SIDE>().0 {
        for (sum, c) in sums.iter_mut().zip(row) {
            let size = c.abs();
            let rounded = size * inverse + ROUNDING - 0.5 + WHOLE - WHOLE;
            let off = size - step * rounded;
            *sum += off * off;
        }
    }
    let first = coefficients[0].abs();
    let off = first - step * (first * inverse + ROUNDING - 0.5 + WHOLE - WHOLE);
    sums.iter().sum::<f32>() - off * off
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey noise of at most so much.
    fn noise(size: [u32; 2], most: u32) -> Image<u8> {
        let mut number = 1_u32;
        let mut next = || {
            number = number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (128 + (number >> 8) % (2 * most + 1)).saturating_sub(most) as u8
        };
        let data = (0..size[0] * size[1]).flat_map(|_| [next(); 3]).collect();
        Image { size, components: 3, data }
    }

    #[test]
    fn a_twelfth_is_lost_of_what_is_larger_than_the_step_and_all_of_what_is_smaller() {
        let size = [256, 200];
        let all = vec![true; 256 * 200];
        let lost = lost_squares(&noise(size, 100), &all, 9);
        assert!((0.08..0.1).contains(&lost), "{lost}");
        // Numbers from -2 to 2 have a mean square of 2.
        let lost = lost_squares(&noise(size, 2), &all, 40) * 1600.0;
        assert!((1.8..2.2).contains(&lost), "{lost}");
    }

    #[test]
    fn what_is_even_or_not_used_loses_nothing() {
        let grey = Image::filled([64, 64], &[128; 3]);
        assert_eq!(lost_squares(&grey, &[true; 4096], 9), 0.0);
        assert_eq!(lost_squares(&noise([64, 64], 50), &[false; 4096], 9), 0.0);
    }
}
