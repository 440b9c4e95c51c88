//! One refinement of a tile: from the samples at even multiples of a stride to those at all (SPEC.md, "Predicted
//! heights").
//!
//! First come the *centres* of four known samples, then the *edges*, which lie between two known samples and two
//! centres. Lines that lie on the one before them take no part: their samples are copies.

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

/// The size of a residual where there is none.
const NONE: i32 = -1;
/// Sizes lie in an array with two unused ones on all sides, so that no neighbour has to be looked for.
const PADDED: usize = SIDE + 4;

/// The lines of one axis, at a stride.
struct Axis {
    /// Index coordinates below this one lie on lines of their own; it and all above it lie on the last line.
    last: usize,
    /// For new coordinates: from known lines.
    from_known: [Stencil; SIDE],
    /// For known coordinates that have new ones on both sides: from those.
    from_new: [Option<Stencil>; SIDE],
}

impl Axis {
    fn new(lines: &[u64; SIDE], stride: usize) -> Self {
        let last = lines.partition_point(|&line| line < lines[CELLS]);
        let mut this = Self { last, from_known: [Stencil::default(); SIDE], from_new: [None; SIDE] };
        let stencil = |at: usize, end: usize| {
            let far = [at.checked_sub(3 * stride), Some(at + 3 * stride).filter(|&far| far < end)];
            Stencil::new(lines, at, [at - stride, at + stride], far.into_iter().flatten())
        };
        for at in this.new_lines(stride) {
            this.from_known[at] = stencil(at, SIDE);
        }
        for at in this.known_lines(stride).filter(|&at| at > 0 && at + stride < last) {
            this.from_new[at] = Some(stencil(at, last));
        }
        this
    }

    /// Coordinates between known ones, on lines of their own.
    fn new_lines(&self, stride: usize) -> impl Iterator<Item = usize> + use<> {
        (stride..self.last).step_by(2 * stride)
    }

    /// Coordinates whose samples are known: of those on the last line the first.
    fn known_lines(&self, stride: usize) -> impl Iterator<Item = usize> + use<> {
        (0..self.last + 2 * stride).step_by(2 * stride)
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
    let sizes = &mut [NONE; PADDED * PADDED];
    let mut refinement = Refinement { samples, axes: &axes, stride, coded, sizes, coder };
    refinement.centres()?;
    for row in (0..SIDE).step_by(stride) {
        match (row / stride).is_multiple_of(2) {
            false if row < axes[1].last => refinement.edges_of_new_row(row)?,
            true if row < axes[1].last + 2 * stride => refinement.edges_of_known_row(row)?,
            _ => {}
        }
    }
    refinement.copies();
    Ok(())
}

struct Refinement<'a, C> {
    samples: &'a mut Samples,
    axes: &'a [Axis; 2],
    stride: usize,
    coded: Coded<'a>,
    /// The sizes of residuals so far, by multiples of the stride.
    sizes: &'a mut [i32; PADDED * PADDED],
    coder: &'a mut C,
}

/// 12 by the number of sizes; the index is 0 less those that are missing, modulo 4.
const SHARES: [i64; 4] = [3, 12, 6, 4];

fn rounded(value: i64, bits: u32) -> i64 {
    (value + (1 << (bits - 1))) >> bits
}

/// 12 times the mean of those sizes that there are, and whether there are any.
#[inline(always)]
fn mean(sizes: [i32; 4]) -> Option<i64> {
    let [a, b, c, d] = sizes;
    let sum = i64::from(a.max(0)) + i64::from(b.max(0)) + i64::from(c.max(0)) + i64::from(d.max(0));
    // The sign of a size that is none counts it.
    let none = (a >> 31) + (b >> 31) + (c >> 31) + (d >> 31);
    (none > -4).then(|| sum * SHARES[(none & 3) as usize])
}

impl<C: Coder> Refinement<'_, C> {
    #[inline(always)]
    fn at(&self, column: usize, row: usize) -> i64 {
        i64::from(self.samples[row * SIDE + column])
    }

    /// Where the size of a residual lies.
    #[inline(always)]
    fn place(&self, column: usize, row: usize) -> usize {
        let shift = self.stride.trailing_zeros();
        ((row >> shift) + 2) * PADDED + (column >> shift) + 2
    }

    /// A value times 4096, from those in a row.
    #[inline(always)]
    fn along_row(&self, stencil: &Stencil, row: usize) -> i64 {
        stencil.apply(|column| self.at(column, row))
    }

    /// A value times 4096, from those in a column.
    #[inline(always)]
    fn along_column(&self, stencil: &Stencil, column: usize) -> i64 {
        stencil.apply(|row| self.at(column, row))
    }

    #[inline(always)]
    fn sample(
        &mut self,
        [column, row]: [usize; 2],
        place: usize,
        first: Context,
        measure: i64,
        prediction: i64,
    ) -> Result<(), Violation> {
        let at = row * SIDE + column;
        let value = if self.coded.is_none_or(|coded| coded[at]) {
            let value = self.coder.sample(at, first, class(measure as u64), prediction)?;
            // Larger sizes belong to the last class anyway.
            self.sizes[place] = (i64::from(value) - prediction).unsigned_abs().min(i32::MAX as u64) as i32;
            value
        } else {
            prediction.clamp(i32::MIN.into(), i32::MAX.into()) as i32
        };
        self.samples[at] = value;
        Ok(())
    }

    fn centres(&mut self) -> Result<(), Violation> {
        let ([across, down], stride) = (self.axes, self.stride);
        // Columns first: their values count for up to four centres.
        let mut in_row = [0; SIDE];
        for row in down.new_lines(stride) {
            for column in across.known_lines(stride) {
                in_row[column] = self.along_column(&down.from_known[row], column);
            }
            let (north, south) = (row - stride, row + stride);
            for column in across.new_lines(stride) {
                let (west, east) = (column - stride, column + stride);
                let sum = across.from_known[column].apply(|column| in_row[column]);
                let prediction = rounded(sum, 2 * WEIGHT_BITS);
                let [a, b, c, d] =
                    [self.at(west, north), self.at(east, north), self.at(west, south), self.at(east, south)];
                let bend = (a + d - b - c).abs() + (4 * prediction - (a + b + c + d)).abs();
                let range = a.max(b).max(c.max(d)) - a.min(b).min(c.min(d));
                let place = self.place(column, row);
                let above = place - 2 * PADDED;
                let sizes = [place - 2, above - 2, above, above + 2].map(|place| self.sizes[place]);
                let mean = mean(sizes).unwrap_or(2 * bend);
                let measure = (16 * mean + 6 * bend + 3 * range) / 12;
                self.sample([column, row], place, CENTRE, measure, prediction)?;
            }
        }
        Ok(())
    }

    /// Samples between a known one in the north and one in the south, and perhaps between two centres.
    fn edges_of_new_row(&mut self, row: usize) -> Result<(), Violation> {
        let ([across, down], stride) = (self.axes, self.stride);
        for column in across.known_lines(stride) {
            let along = self.along_column(&down.from_known[row], column);
            let slope = (self.at(column, row - stride) - self.at(column, row + stride)).abs();
            let other = across.from_new[column].as_ref().map(|stencil| {
                let slope = (self.at(column - stride, row) - self.at(column + stride, row)).abs();
                (self.along_row(stencil, row), slope)
            });
            let place = self.place(column, row);
            self.edge([column, row], place, [place - 1, place + 1], (along, slope), other)?;
        }
        Ok(())
    }

    /// Samples between a known one in the west and one in the east, and perhaps between two centres.
    fn edges_of_known_row(&mut self, row: usize) -> Result<(), Violation> {
        let ([across, down], stride) = (self.axes, self.stride);
        for column in across.new_lines(stride) {
            let along = self.along_row(&across.from_known[column], row);
            let slope = (self.at(column - stride, row) - self.at(column + stride, row)).abs();
            let other = down.from_new[row].as_ref().map(|stencil| {
                let slope = (self.at(column, row - stride) - self.at(column, row + stride)).abs();
                (self.along_column(stencil, column), slope)
            });
            let place = self.place(column, row);
            self.edge([column, row], place, [place - PADDED, place + PADDED], (along, slope), other)?;
        }
        Ok(())
    }

    /// An edge, from what lies along it and what lies across: values times 4096, and slopes. `centres` are the places
    /// across.
    #[inline(always)]
    fn edge(
        &mut self,
        at: [usize; 2],
        place: usize,
        centres: [usize; 2],
        (along, slope): (i64, i64),
        other: Option<(i64, i64)>,
    ) -> Result<(), Violation> {
        let [one, two] = centres;
        let sizes = [one, two, place - PADDED - 1, place - PADDED + 1].map(|place| self.sizes[place]);
        let mean = mean(sizes);
        let (prediction, difference, slopes) = match other {
            Some((other, other_slope)) => {
                let difference = (along - other).abs() >> (WEIGHT_BITS - 2);
                (rounded(along + other, WEIGHT_BITS + 1), Some(difference), slope + other_slope)
            }
            None => (rounded(along, WEIGHT_BITS), None, 2 * slope),
        };
        // What is missing counts as much as what there is.
        let difference = difference.or(mean.map(|mean| mean / 3)).unwrap_or(0);
        let mean = mean.unwrap_or(3 * difference);
        let measure = (24 * difference + 16 * mean + 3 * slopes) / 24;
        self.sample(at, place, EDGE, measure, prediction)
    }

    /// Samples on the last column and the last row.
    fn copies(&mut self) {
        let step = self.stride;
        // Of those on the last line, one at an even multiple is known.
        let [known_column, known_row] =
            [0, 1].map(|axis: usize| self.axes[axis].last.next_multiple_of(2 * step).min(CELLS));
        for row in (0..known_row + 1).step_by(step) {
            let known = self.samples[row * SIDE + known_column];
            for column in (self.axes[0].last.next_multiple_of(step)..SIDE).step_by(step) {
                self.samples[row * SIDE + column] = known;
            }
        }
        for row in (self.axes[1].last.next_multiple_of(step)..SIDE).step_by(step) {
            if row != known_row {
                self.samples.copy_within(known_row * SIDE..known_row * SIDE + SIDE, row * SIDE);
            }
        }
    }
}
