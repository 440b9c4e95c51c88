//! What is seen of an image beside the pieces of its map: borders alone.
//!
//! Texels beside a piece show nothing but a share of its border, where another image begins, and a step of colour between both is seen as a line.
//! So the levels of their blocks are not those nearest to each coefficient: of all that are about as near, they are those that show borders
//! best, whatever becomes of texels that nobody sees.

use std::sync::OnceLock;

use super::transform::{AREA, SIDE, forward};

/// What the square of an error counts at a point of a border, beside that of a texel.
const OF_POINTS: f32 = 4.0;
/// And at a texel beside a piece: finer borders may reach beyond those that are known.
const BESIDE: f32 = 0.1;
/// What a level costs that is farther from zero by one, in squares of a step: as much as levels are rounded towards zero for.
const OF_LEVEL: f32 = 0.2;
/// The most levels that change in a block.
const MOST_CHANGES: usize = 16;

/// A point between four texels.
#[derive(Clone, Copy, Debug)]
pub struct SeenPoint {
    /// Column and row of the first of them; the others are beside it and below.
    pub texel: [u32; 2],
    /// How far it is from the first one to those beside and below.
    pub share: [f32; 2],
}

/// What is seen of an image.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    /// Of each texel whether its own value is.
    is_covered: &'a [bool],
    /// Points of borders by block, ascending.
    points: Vec<(u32, PartOfPoint)>,
}

/// The share that a block's texels have of a point. Those of other blocks see to their own.
#[derive(Clone, Copy, Debug)]
struct PartOfPoint {
    /// Within the block; those without a share come last, and have the first one's number.
    texels: [u8; 4],
    shares: [f32; 4],
}

impl<'a> Seen<'a> {
    /// Texels whose own values are seen, and points of borders of an image of so many columns and rows.
    pub fn new(is_covered: &'a [bool], size: [u32; 2], points: impl IntoIterator<Item = SeenPoint>) -> Self {
        let side = SIDE as u32;
        let columns = size[0].div_ceil(side);
        let mut parts: Vec<(u32, PartOfPoint)> = vec![];
        for SeenPoint { texel, share: [right, down] } in points {
            let first = parts.len();
            for (dx, dy, share) in [
                (0, 0, (1.0 - right) * (1.0 - down)),
                (1, 0, right * (1.0 - down)),
                (0, 1, (1.0 - right) * down),
                (1, 1, right * down),
            ] {
                let [x, y] = [texel[0] + dx, texel[1] + dy];
                if share <= 0.0 || x >= size[0] || y >= size[1] {
                    continue;
                }
                let (block, at) = (y / side * columns + x / side, (y % side * side + x % side) as u8);
                match parts[first..].iter_mut().find(|(other, _)| *other == block) {
                    Some((_, part)) => {
                        let next = part.shares.iter().position(|&share| share == 0.0).unwrap_or(3);
                        (part.texels[next], part.shares[next]) = (at, share);
                    }
                    None => parts.push((block, PartOfPoint { texels: [at; 4], shares: [share, 0.0, 0.0, 0.0] })),
                }
            }
        }
        // A stable sort: points of a block stay in their order.
        parts.sort_by_key(|(block, _)| *block);
        Self { is_covered, points: parts }
    }

    /// What is seen of a block, of which the first texel is given; none if no border crosses it. Blocks are asked for in ascending order, and
    /// `next` is where the points of this one begin.
    pub(super) fn block(
        &self,
        block: u32,
        [left, top]: [usize; 2],
        size: [u32; 2],
        next: &mut usize,
    ) -> Option<SeenBlock<'_>> {
        let first = *next;
        let count = self.points[first..].iter().take_while(|(other, _)| *other == block).count();
        *next += count;
        if count == 0 {
            return None;
        }
        let [width, height] = size.map(|length| length as usize);
        let mut weights = [BESIDE; AREA];
        for y in top..(top + SIDE).min(height) {
            let row = left..(left + SIDE).min(width);
            let weights = &mut weights[(y - top) * SIDE..];
            for (weight, &is_covered) in weights.iter_mut().zip(&self.is_covered[y * width..][row]) {
                *weight = if is_covered { 1.0 } else { BESIDE };
            }
        }
        Some(SeenBlock::new(weights, &self.points[first..first + count]))
    }
}

/// What is seen of a block: a square form of the errors of its texels.
pub(super) struct SeenBlock<'a> {
    weights: [f32; AREA],
    points: &'a [(u32, PartOfPoint)],
    /// By how much the square of an error of each coefficient counts in texels.
    of_texels: [f32; AREA],
    /// And with points; not a number until somebody asks, since few do.
    curvature: [f32; AREA],
}

impl<'a> SeenBlock<'a> {
    fn new(weights: [f32; AREA], points: &'a [(u32, PartOfPoint)]) -> Self {
        let of_texels = |basis: &[f32; AREA]| basis.iter().zip(&weights).map(|(b, weight)| weight * b * b).sum();
        Self { weights, points, of_texels: bases().each_ref().map(of_texels), curvature: [f32::NAN; AREA] }
    }

    fn curvature(&mut self, at: usize) -> f32 {
        let known = &mut self.curvature[at];
        if known.is_nan() {
            let basis = &bases()[at];
            let of_points: f32 = self.points.iter().map(|(_, part)| part.of(basis)).map(|sum| sum * sum).sum();
            *known = self.of_texels[at] + OF_POINTS * of_points;
        }
        *known
    }

    /// How much more is lost for each coefficient that grows, if texels are off by so much; half of it.
    fn slope(&self, errors: &[f32; AREA]) -> [f32; AREA] {
        let mut weighted: [f32; AREA] = std::array::from_fn(|at| self.weights[at] * errors[at]);
        for (_, part) in self.points {
            let sum = OF_POINTS * part.of(errors);
            for (&texel, share) in part.texels.iter().zip(part.shares) {
                weighted[usize::from(texel)] += share * sum;
            }
        }
        forward(&weighted)
    }

    /// Multiples of a step that show a block best, of those near its coefficients, in the order of [`forward`]. `levels` are those nearest to them.
    pub fn improve(&mut self, coefficients: &[f32; AREA], step: f32, levels: &mut [f32; AREA]) {
        let mut errors = [0.0; AREA];
        for ((basis, level), coefficient) in bases().iter().zip(levels.iter()).zip(coefficients) {
            let off = level * step - coefficient;
            (0..AREA).for_each(|at| errors[at] += off * basis[at]);
        }
        for _ in 0..MOST_CHANGES {
            let slope = self.slope(&errors);
            let mut best = (0, 0.0, 0.0);
            for at in 0..AREA {
                let sign = if slope[at] > 0.0 { -1.0 } else { 1.0 };
                let farther = (levels[at] + sign).abs() - levels[at].abs();
                // The mean costs as much wherever it lies.
                let of_level = if at == 0 { 0.0 } else { OF_LEVEL * farther };
                let gain = |curvature: f32| 2.0 * step * slope[at].abs() - step * step * (curvature + of_level);
                // Points only make it less.
                if gain(self.of_texels[at]) > best.1 {
                    let gain = gain(self.curvature(at));
                    best = if gain > best.1 { (at, gain, sign) } else { best };
                }
            }
            let (at, gain, sign) = best;
            if gain <= 0.01 * step * step {
                break;
            }
            levels[at] += sign;
            let basis = &bases()[at];
            (0..AREA).for_each(|k| errors[k] += sign * step * basis[k]);
        }
    }
}

impl PartOfPoint {
    /// What it shows of values of a block.
    #[inline]
    fn of(&self, values: &[f32; AREA]) -> f32 {
        let part = |k: usize| self.shares[k] * values[usize::from(self.texels[k])];
        part(0) + part(1) + part(2) + part(3)
    }
}

/// The values of a block for each coefficient, in the order of [`forward`].
fn bases() -> &'static [[f32; AREA]; AREA] {
    static BASES: OnceLock<[[f32; AREA]; AREA]> = OnceLock::new();
    BASES.get_or_init(|| {
        let mut bases = [[0.0; AREA]; AREA];
        for texel in 0..AREA {
            let mut values = [0.0; AREA];
            values[texel] = 1.0;
            let of_texel = forward(&values);
            (0..AREA).for_each(|at| bases[at][texel] = of_texel[at]);
        }
        bases
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Image, encode_image, encode_seen_image};
    use super::*;

    #[test]
    fn borders_are_shown_better_where_texels_beside_them_are_free() {
        let size = [64, 64];
        let value = |x: u32, y: u32| ((x * x * 7 + y * 13 + x * y * 5) % 97) as u8 * 2;
        let data = (0..64 * 64).flat_map(|at| [value(at % 64, at / 64), 90, 200]).collect();
        let image = Image { size, components: 3, data };
        // A piece ends between the columns 20 and 21; beside it one column is used.
        let covered: Vec<bool> = (0..64 * 64).map(|at| at % 64 <= 20).collect();
        let used: Vec<bool> = (0..64 * 64).map(|at| at % 64 <= 21).collect();
        let points: Vec<SeenPoint> =
            (0..126).map(|k| SeenPoint { texel: [20, k / 2], share: [0.5, 0.25 + 0.5 * (k % 2) as f32] }).collect();
        let border = |image: &Image<u8>, y: u32| {
            let texel = |x: u32, y: u32| f64::from(image.texel(x, y)[0]);
            0.25 * (texel(20, y) + texel(21, y) + texel(20, y + 1) + texel(21, y + 1))
        };
        let error = |bytes: &[u8]| {
            let back = Image::decode_colours(bytes, size, 3).unwrap();
            let squares: f64 = (0..63).map(|y| (border(&back, y) - border(&image, y)).powi(2)).sum();
            (squares / 63.0).sqrt()
        };
        let step = 20;
        let before = encode_image(&image, &used, step);
        let after = encode_seen_image(&image, &used, &Seen::new(&covered, size, points), step);
        assert!(error(&after) < 0.6 * error(&before), "{} {}", error(&after), error(&before));
        assert!(after.len() < before.len() + before.len() / 10, "{} {}", after.len(), before.len());
    }

    #[test]
    fn points_between_blocks_belong_to_each_for_its_texels() {
        let covered = vec![true; 256];
        let point = SeenPoint { texel: [7, 7], share: [0.25, 0.5] };
        let seen = Seen::new(&covered, [16, 16], [point]);
        let shares: Vec<(u32, u8, f32)> =
            seen.points.iter().map(|(block, part)| (*block, part.texels[0], part.shares[0])).collect();
        assert_eq!(shares, [(0, 63, 0.375), (1, 56, 0.125), (2, 7, 0.375), (3, 0, 0.125)]);
        // Nothing is beyond the last texel.
        let last = SeenPoint { texel: [15, 15], share: [0.5, 0.5] };
        assert_eq!(Seen::new(&covered, [16, 16], [last]).points.len(), 1);
    }
}
