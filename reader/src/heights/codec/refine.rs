//! One refinement of a tile: from the samples at even multiples of a stride to those at all (SPEC.md, "Predicted heights").
//!
//! First come the *centres* of four known samples, then the *edges*, which lie between two known samples and two centres. Lines that lie on
//! others take no part: their samples are copies.

use super::{
    contexts::{CENTRE, EDGE, class},
    stencil::{Stencil, WEIGHT_BITS},
};
use crate::{
    codec::entropy::context::Context,
    error::Violation,
    heights::grid::{CELLS, Lines, SIDE},
};

/// Samples of a tile, row by row.
pub(super) type Samples = [i32; SIDE * SIDE];
/// Which samples are coded; none if all are.
pub(super) type Coded<'a> = Option<&'a [bool; SIDE * SIDE]>;

/// Who knows samples: an encoder all of them, a decoder those that it gets.
pub(super) trait Coder {
    /// The value of the sample `at` in the corner of a tile, from that of the corner before it.
    fn corner(&mut self, at: usize, before: i32) -> Result<i32, Violation>;

    /// The value of the sample `at`, from its prediction.
    fn sample(&mut self, at: usize, first: Context, class: u16, prediction: i64) -> Result<i32, Violation>;
}

/// What a residual is where there is none.
const NONE: i64 = -1;

/// The lines of one axis, at a stride.
struct Axis {
    /// Index coordinates whose samples are known already: of those on one line the first.
    known: Vec<usize>,
    /// Those between them, without those on a known line.
    new: Vec<usize>,
    /// Whether an index coordinate is in `new`.
    is_new: [bool; SIDE],
    /// For those in `new`: from known lines.
    from_known: [Stencil; SIDE],
    /// For known ones that have new ones on both sides: from those.
    from_new: [Option<Stencil>; SIDE],
    /// The one in `known` or `new` on the same line.
    same: [usize; SIDE],
}

impl Axis {
    fn new(lines: &[u64; SIDE], stride: usize) -> Self {
        let (mut known, mut new) = (Vec::with_capacity(SIDE), Vec::with_capacity(SIDE));
        let mut is_new = [false; SIDE];
        let mut same = std::array::from_fn(|k| k);
        for at in (0..SIDE).step_by(2 * stride) {
            match known.last() {
                Some(&last) if lines[last] == lines[at] => same[at] = last,
                _ => known.push(at),
            }
        }
        let around = |at: usize| {
            let far = 3 * stride;
            let before = at.checked_sub(far);
            let after = Some(at + far).filter(|&after| after <= CELLS);
            [Some(at - stride), Some(at + stride), before, after].into_iter().flatten()
        };
        let mut from_known = [Stencil::default(); SIDE];
        for at in (stride..CELLS).step_by(2 * stride) {
            if lines[at] == lines[at - stride] {
                same[at] = same[at - stride];
            } else if lines[at] == lines[at + stride] {
                same[at] = at + stride;
            } else {
                is_new[at] = true;
                new.push(at);
                from_known[at] = Stencil::new(lines, at, around(at));
            }
        }
        let mut from_new = [None; SIDE];
        for &at in known.iter().filter(|&&at| at > 0 && at < CELLS) {
            if is_new[at - stride] && is_new[at + stride] {
                from_new[at] = Some(Stencil::new(lines, at, around(at).filter(|&at| is_new[at])));
            }
        }
        Self { known, new, is_new, from_known, from_new, same }
    }
}

/// Finds the samples at odd multiples of the stride. Those that are not coded become what is predicted.
///
/// # Errors
/// What the coder says.
pub(super) fn refine(
    samples: &mut Samples,
    lines: &Lines,
    stride: usize,
    coded: Coded<'_>,
    coder: &mut impl Coder,
) -> Result<(), Violation> {
    let axes = [Axis::new(&lines.columns, stride), Axis::new(&lines.rows, stride)];
    let mut refinement = Refinement { samples, axes, stride, coded, sizes: Box::new([NONE; SIDE * SIDE]), coder };
    refinement.centres()?;
    refinement.edges()?;
    refinement.copies();
    Ok(())
}

struct Refinement<'a, C> {
    samples: &'a mut Samples,
    axes: [Axis; 2],
    stride: usize,
    coded: Coded<'a>,
    /// The sizes of residuals so far.
    sizes: Box<[i64; SIDE * SIDE]>,
    coder: &'a mut C,
}

fn rounded(value: i64, bits: u32) -> i64 {
    (value + (1 << (bits - 1))) >> bits
}

/// 12 times the mean of those sizes that there are, and whether there are any.
#[inline]
fn mean(sizes: [i64; 4]) -> Option<i64> {
    let sum: i64 = sizes.iter().map(|&size| size.max(0)).sum();
    let count: usize = sizes.iter().map(|&size| usize::from(size >= 0)).sum();
    (count > 0).then(|| sum * [0, 12, 6, 4, 3][count])
}

impl<C: Coder> Refinement<'_, C> {
    #[inline]
    fn at(&self, column: usize, row: usize) -> i64 {
        i64::from(self.samples[row * SIDE + column])
    }

    #[inline]
    fn size(&self, column: usize, row: usize) -> i64 {
        self.sizes[row * SIDE + column]
    }

    #[inline]
    fn sample(
        &mut self,
        [column, row]: [usize; 2],
        first: Context,
        measure: i64,
        prediction: i64,
    ) -> Result<(), Violation> {
        let at = row * SIDE + column;
        let value = if self.coded.is_none_or(|coded| coded[at]) {
            let value = self.coder.sample(at, first, class(measure as u64), prediction)?;
            self.sizes[at] = (i64::from(value) - prediction).abs();
            value
        } else {
            prediction.clamp(i32::MIN.into(), i32::MAX.into()) as i32
        };
        self.samples[at] = value;
        Ok(())
    }

    fn centres(&mut self) -> Result<(), Violation> {
        let stride = self.stride;
        for row_number in 0..self.axes[1].new.len() {
            let row = self.axes[1].new[row_number];
            let down = self.axes[1].from_known[row];
            let (north, south) = (row - stride, row + stride);
            for column_number in 0..self.axes[0].new.len() {
                let column = self.axes[0].new[column_number];
                let (west, east) = (column - stride, column + stride);
                let along = self.axes[0].from_known[column];
                let sum = down.apply(|row| along.apply(|column| self.at(column, row)));
                let prediction = rounded(sum, 2 * WEIGHT_BITS);
                let corners = [self.at(west, north), self.at(east, north), self.at(west, south), self.at(east, south)];
                let [a, b, c, d] = corners;
                let bend = (a + d - b - c).abs() + (4 * prediction - (a + b + c + d)).abs();
                let range = a.max(b).max(c).max(d) - a.min(b).min(c).min(d);
                let before = |numbers: &[usize], number: usize| number.checked_sub(1).map(|number| numbers[number]);
                let up = before(&self.axes[1].new, row_number);
                let left = before(&self.axes[0].new, column_number);
                let right = self.axes[0].new.get(column_number + 1).copied();
                let size = |column: Option<usize>, row: Option<usize>| match (column, row) {
                    (Some(column), Some(row)) => self.size(column, row),
                    _ => NONE,
                };
                let sizes = [size(left, Some(row)), size(left, up), size(Some(column), up), size(right, up)];
                let mean = mean(sizes).unwrap_or(2 * bend);
                let measure = (16 * mean + 6 * bend + 3 * range) / 12;
                self.sample([column, row], CENTRE, measure, prediction)?;
            }
        }
        Ok(())
    }

    fn edges(&mut self) -> Result<(), Violation> {
        for row in (0..SIDE).step_by(self.stride) {
            if self.axes[1].is_new[row] {
                for number in 0..self.axes[0].known.len() {
                    self.edge([self.axes[0].known[number], row], 1)?;
                }
            } else if self.axes[1].same[row] == row {
                for number in 0..self.axes[0].new.len() {
                    self.edge([self.axes[0].new[number], row], 0)?;
                }
            }
        }
        Ok(())
    }

    /// A sample between two known ones along `axis`, and perhaps between two centres across it.
    #[inline]
    fn edge(&mut self, place: [usize; 2], axis: usize) -> Result<(), Violation> {
        let [column, row] = place;
        let stride = self.stride;
        let moved = |axis: usize, to: usize| if axis == 0 { [to, row] } else { [column, to] };
        let value = |axis: usize, to: usize| {
            let [column, row] = moved(axis, to);
            self.at(column, row)
        };
        let size = |axis: usize, to: usize| {
            let [column, row] = moved(axis, to);
            self.size(column, row)
        };
        let slope = |axis: usize| (value(axis, place[axis] - stride) - value(axis, place[axis] + stride)).abs();
        let across = 1 - axis;
        let along = self.axes[axis].from_known[place[axis]].apply(|to| value(axis, to));
        let other = self.axes[across].from_new[place[across]].map(|stencil| stencil.apply(|to| value(across, to)));

        let west = column.checked_sub(stride);
        let east = Some(column + stride).filter(|&east| east <= CELLS);
        let north = row.checked_sub(stride);
        let diagonal = |column: Option<usize>| match (column, north) {
            (Some(column), Some(north)) => self.size(column, north),
            _ => NONE,
        };
        let centres = match place[across] {
            0 => [NONE, size(across, stride)],
            CELLS => [size(across, CELLS - stride), NONE],
            at => [size(across, at - stride), size(across, at + stride)],
        };
        let mean = mean([centres[0], centres[1], diagonal(west), diagonal(east)]);
        let (prediction, difference, slopes) = match other {
            Some(other) => {
                let difference = (along - other).abs() >> (WEIGHT_BITS - 2);
                (rounded(along + other, WEIGHT_BITS + 1), Some(difference), slope(axis) + slope(across))
            }
            None => (rounded(along, WEIGHT_BITS), None, 2 * slope(axis)),
        };
        // What is missing counts as much as what there is.
        let difference = difference.or(mean.map(|mean| mean / 3)).unwrap_or(0);
        let mean = mean.unwrap_or(3 * difference);
        let measure = (24 * difference + 16 * mean + 3 * slopes) / 24;
        self.sample(place, EDGE, measure, prediction)
    }

    /// Samples on lines of others.
    fn copies(&mut self) {
        let step = self.stride;
        let [columns, rows] = [&self.axes[0].same, &self.axes[1].same];
        if [columns, rows].iter().all(|same| (0..SIDE).step_by(step).all(|at| same[at] == at)) {
            return;
        }
        for row in (0..SIDE).step_by(step).filter(|&row| rows[row] == row) {
            for column in (0..SIDE).step_by(step) {
                self.samples[row * SIDE + column] = self.samples[row * SIDE + columns[column]];
            }
        }
        for row in (0..SIDE).step_by(step).filter(|&row| rows[row] != row) {
            self.samples.copy_within(rows[row] * SIDE..rows[row] * SIDE + SIDE, row * SIDE);
        }
    }
}
