//! What quantisation costs an image, and whether a finer step is worth its bytes.

use super::colours::{ROUNDING, WHOLE, step_of, store};
use super::transform::{AREA, MOST, SIDE, inverse};

/// What an image loses. An even block is off by the same everywhere: its mean may lie anywhere between two steps. Where most of an image is even, a
/// slightly finer step may show it much better.
#[derive(Default)]
pub(super) struct Errors {
    /// The means of all blocks, as coefficients, and whether they have nothing else.
    pub constants: Vec<([f32; 4], bool)>,
    /// The sum of squares of what all other coefficients are off by.
    pub others: f32,
}

/// What a bit is worth, in squares of a step: between a step and half of it lies a bit for each coefficient, whose square error is a twelfth of the
/// square of the step, or a quarter of that.
const WORTH: f32 = 0.15;

impl Errors {
    /// A finer step than that with which an image has so many bytes, if most of what it loses is in its means, and the bytes are worth it.
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
