//! What is seen of an image beside the pieces of its map: borders alone.
//!
//! Texels beside a piece show nothing but a share of its border, where another image begins, and a step of colour
//! between both is seen as a line. So the levels of their blocks are not those nearest to each coefficient: of all that
//! are about as near, they are those that show borders best, whatever becomes of texels that nobody sees.

use super::form::Form;
use super::transform::{AREA, COSINES_OF, SIDE, forward};

/// What the square of an error counts at a point of a border, beside that of a texel.
const OF_POINTS: f32 = 4.0;
/// And at a texel beside a piece: finer borders may reach beyond those that are known.
const BESIDE: f32 = 0.1;
/// What a level costs that is farther from zero by one, in squares of a step: as much as levels are rounded towards
/// zero for.
const OF_LEVEL: f32 = 0.2;
/// The most levels that change in a block.
const MOST_CHANGES: usize = 16;
/// The least that a change gains, in squares of a step.
const LEAST_GAIN: f32 = 0.01;

/// A point between four texels.
#[derive(Clone, Copy, Debug, Default)]
pub struct SeenPoint {
    /// Column and row of the first of them; the others are beside it and below.
    pub texel: [u32; 2],
    /// How far it is from the first one to those beside and below.
    pub share: [f32; 2],
}

impl SeenPoint {
    /// The blocks of an image that have a share of it: one, or two side by side, and those below.
    fn blocks(&self, size: [u32; 2]) -> impl Iterator<Item = usize> {
        let side = SIDE as u32;
        let columns = size[0].div_ceil(side);
        let [x, y] = [0, 1].map(|axis| {
            let is_between = self.share[axis] > 0.0 && self.texel[axis] + 1 < size[axis];
            self.texel[axis] / side..(self.texel[axis] + u32::from(is_between)) / side + 1
        });
        y.flat_map(move |y| x.clone().map(move |x| (y * columns + x) as usize))
    }
}

/// What is seen of an image.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    /// Of each texel whether its own value is.
    is_covered: &'a [bool],
    size: [u32; 2],
    /// Points of borders by block.
    points: Vec<SeenPoint>,
    /// Where those of each block end.
    ends: Vec<u32>,
}

impl<'a> Seen<'a> {
    /// Texels whose own values are seen, and points of borders of an image, given its columns and rows.
    pub fn new(is_covered: &'a [bool], size: [u32; 2], points: impl IntoIterator<Item = SeenPoint>) -> Self {
        let all: Vec<SeenPoint> = points.into_iter().collect();
        let blocks = size.map(|length| (length as usize).div_ceil(SIDE));
        let mut ends = vec![0_u32; blocks[0] * blocks[1] + 1];
        for point in &all {
            point.blocks(size).for_each(|block| ends[block + 1] += 1);
        }
        (1..ends.len()).for_each(|block| ends[block] += ends[block - 1]);
        let mut points = vec![SeenPoint::default(); ends.last().map_or(0, |&end| end as usize)];
        for point in &all {
            for block in point.blocks(size) {
                points[ends[block] as usize] = *point;
                ends[block] += 1;
            }
        }
        Self { is_covered, size, points, ends }
    }

    /// Points in which a block has a share.
    fn of_block(&self, block: usize) -> &[SeenPoint] {
        let first = block.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.points[first as usize..self.ends[block] as usize]
    }

    /// What is seen of a block, of which the number and first texel are given; none if no border crosses it.
    pub(super) fn block(&self, block: usize, [left, top]: [usize; 2]) -> Option<SeenBlock> {
        let points = self.of_block(block);
        if points.is_empty() {
            return None;
        }
        let [width, height] = self.size.map(|length| length as usize);
        let mut weights = [BESIDE; AREA];
        for y in top..(top + SIDE).min(height) {
            let row = left..(left + SIDE).min(width);
            let weights = &mut weights[(y - top) * SIDE..];
            for (weight, &is_covered) in weights.iter_mut().zip(&self.is_covered[y * width..][row]) {
                *weight = if is_covered { 1.0 } else { BESIDE };
            }
        }
        let mut form = Form::new(&weights);
        for SeenPoint { texel, share } in points {
            form.add([texel[0] as usize + 1 - left, texel[1] as usize + 1 - top], *share, OF_POINTS);
        }
        Some(SeenBlock::new(form))
    }
}

/// What is seen of a block: a square form of the errors of its texels.
pub(super) struct SeenBlock {
    form: Form,
    /// By how much the square of an error of each coefficient counts.
    curvature: [f32; AREA],
    /// Of coefficients that have changed how much the slopes of all grow.
    columns: Vec<(usize, [f32; AREA])>,
}

impl SeenBlock {
    fn new(form: Form) -> Self {
        let curvature = form.curvature();
        Self { form, curvature, columns: vec![] }
    }

    /// How much the slope of each coefficient grows if one does.
    fn column(&mut self, at: usize) -> &[f32; AREA] {
        let known = self.columns.iter().position(|(other, _)| *other == at);
        let number = known.unwrap_or_else(|| {
            let (across, down) = (&COSINES_OF[at / SIDE], &COSINES_OF[at % SIDE]);
            let mut basis = [0.0; AREA];
            for (row, down) in basis.as_chunks_mut::<SIDE>().0.iter_mut().zip(down) {
                *row = across.map(|across| down * across);
            }
            self.columns.push((at, forward(&self.form.times(&basis))));
            self.columns.len() - 1
        });
        &self.columns[number].1
    }

    /// Multiples of a step that show values best, of those near their coefficients. `levels` are those nearest to them,
    /// in the order of [`forward`].
    pub fn improve(&mut self, values: &[f32; AREA], step: f32, levels: &mut [f32; AREA]) {
        let inverse = 1.0 / step;
        let mut errors = values.map(|value| value * -inverse);
        add_shown(levels, &mut errors);
        // How much more is lost for each coefficient that grows; half of it.
        let mut slope = forward(&self.form.times(&errors));
        for _ in 0..MOST_CHANGES {
            let gains: [f32; AREA] = std::array::from_fn(|at| {
                let of_level = if levels[at] * slope[at] > 0.0 { OF_LEVEL } else { -OF_LEVEL };
                // The mean costs as much wherever it lies.
                2.0 * slope[at].abs() - self.curvature[at] + if at == 0 { 0.0 } else { of_level }
            });
            let best = gains.as_chunks::<SIDE>().0.iter().fold([LEAST_GAIN; SIDE], |best, row| {
                std::array::from_fn(|k| if row[k] > best[k] { row[k] } else { best[k] })
            });
            let best = best.iter().fold(LEAST_GAIN, |best, &gain| if gain > best { gain } else { best });
            let Some(at) = (0..AREA).find(|&at| gains[at] == best && best > LEAST_GAIN) else { break };
            let sign = if slope[at] > 0.0 { -1.0 } else { 1.0 };
            levels[at] += sign;
            let column = self.column(at);
            (0..AREA).for_each(|k| slope[k] += sign * column[k]);
        }
    }
}

/// Adds what levels show.
fn add_shown(levels: &[f32; AREA], values: &mut [f32; AREA]) {
    for (levels, across) in levels.as_chunks::<SIDE>().0.iter().zip(&COSINES_OF) {
        if *levels == [0.0; SIDE] {
            continue;
        }
        let mut of_rows = [0.0; SIDE];
        for (&level, down) in levels.iter().zip(&COSINES_OF).filter(|(level, _)| **level != 0.0) {
            (0..SIDE).for_each(|y| of_rows[y] += level * down[y]);
        }
        for (row, of_row) in values.as_chunks_mut::<SIDE>().0.iter_mut().zip(of_rows) {
            (0..SIDE).for_each(|x| row[x] += of_row * across[x]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Image, ImageStreams, encode_image, encode_seen_image};
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
        let error = |streams: &ImageStreams| {
            let back = Image::decode_scaled(streams, size, 3).unwrap();
            let squares: f64 = (0..63).map(|y| (border(&back, y) - border(&image, y)).powi(2)).sum();
            (squares / 63.0).sqrt()
        };
        let step = 20;
        let before = encode_image(&image, &used, step);
        let after = encode_seen_image(&image, &used, &Seen::new(&covered, size, points), step);
        assert!(error(&after) < 0.6 * error(&before), "{} {}", error(&after), error(&before));
        let [before, after] = [before, after].map(|streams| streams.concat().len());
        assert!(after < before + before / 10, "{after} {before}");
    }

    #[test]
    fn points_between_blocks_belong_to_each_for_its_texels() {
        let covered = vec![true; 256];
        let point = SeenPoint { texel: [7, 7], share: [0.25, 0.5] };
        let seen = Seen::new(&covered, [16, 16], [point]);
        assert_eq!(std::array::from_fn(|block| seen.of_block(block).len()), [1; 4]);
        // Nothing is beyond the last texel.
        let last = SeenPoint { texel: [15, 15], share: [0.5, 0.5] };
        let seen = Seen::new(&covered, [16, 16], [last]);
        assert_eq!(std::array::from_fn(|block| seen.of_block(block).len()), [0, 0, 0, 1]);
    }
}
