//! Encoding tiles with even lines (encoder only): most of them. What [`super::refine`] does sample by sample is done
//! for whole rows.
//!
//! An encoder knows all samples, so nothing waits for a residual. Interpolation between even lines has weights of
//! sixteenths, and small heights need no more than 32 bits; so everything up to the classes of residuals runs in lanes,
//! over four planes: the known samples, the centres, and the edges between known ones above each other and beside each
//! other.

use super::{
    contexts::{BEYOND, CENTRE, EDGE, escape},
    refine::Samples,
};
use crate::{
    codec::entropy::{SymbolBuffer, context::Context},
    heights::grid::{CELLS, SIDE},
};

/// New lines, between known ones.
const NEW: usize = CELLS / 2;
/// Known lines.
const KNOWN: usize = NEW + 1;
/// Sums of products of weights and heights fit in 32 bits if heights are at most so large.
const LARGEST: u32 = 1 << 19;

/// Rows of a plane.
type Plane<const COLUMNS: usize, const ROWS: usize> = [[i32; COLUMNS]; ROWS];

/// Sixteen times the values between those of a line, and so of rows between rows: the cubic polynomial through the four
/// nearest, or at both ends the quadratic one through the three nearest.
fn between<const N: usize, const M: usize>(line: &[i32; N]) -> [i32; M] {
    let mut all = [0; M];
    all[0] = 6 * line[0] + 12 * line[1] - 2 * line[2];
    all[M - 1] = 12 * line[N - 2] + 6 * line[N - 1] - 2 * line[N - 3];
    for (value, near) in all[1..M - 1].iter_mut().zip(line.windows(4)) {
        *value = 9 * (near[1] + near[2]) - (near[0] + near[3]);
    }
    all
}

fn between_rows<const N: usize, const M: usize, const COLUMNS: usize>(rows: &Plane<COLUMNS, N>) -> Plane<COLUMNS, M> {
    let mut all = [[0; COLUMNS]; M];
    for column in 0..COLUMNS {
        all[0][column] = 6 * rows[0][column] + 12 * rows[1][column] - 2 * rows[2][column];
        all[M - 1][column] = 12 * rows[N - 2][column] + 6 * rows[N - 1][column] - 2 * rows[N - 3][column];
    }
    for (all, near) in all[1..M - 1].iter_mut().zip(rows.windows(4)) {
        for (column, value) in all.iter_mut().enumerate() {
            *value = 9 * (near[1][column] + near[2][column]) - (near[0][column] + near[3][column]);
        }
    }
    all
}

/// Class of a measure below 2^24: the exponent and the first bit behind it are half octaves.
#[inline(always)]
fn class(measure: i32) -> i32 {
    let half_octaves = ((measure as f32).to_bits() >> 22).cast_signed() - 2 * 127;
    half_octaves.max(measure.min(1)).min(31)
}

/// Residuals of a row, and what is known of each beside the sizes of others.
#[derive(Clone, Copy)]
struct Row<const COLUMNS: usize> {
    /// Zigzag mapped.
    residuals: [i32; COLUMNS],
    sizes: [i32; COLUMNS],
    /// Of a centre six times its bend and three times its range, of an edge 24 times the difference and three times the
    /// slopes.
    activity: [i32; COLUMNS],
}

impl<const COLUMNS: usize> Row<COLUMNS> {
    const NONE: Self = Self { residuals: [0; COLUMNS], sizes: [0; COLUMNS], activity: [0; COLUMNS] };

    #[inline(always)]
    fn set(&mut self, column: usize, sample: i32, prediction: i32, activity: i32) {
        let residual = sample - prediction;
        self.sizes[column] = residual.abs();
        self.residuals[column] = (residual << 1) ^ (residual >> 31);
        self.activity[column] = activity;
    }

    /// Appends the residuals, in classes of these measures.
    fn put(&self, first: Context, measures: &[i32; COLUMNS], out: &mut SymbolBuffer) {
        let classes = measures.map(class);
        for (&residual, &class) in self.residuals.iter().zip(&classes) {
            let (context, residual) = (first + class as Context, residual.cast_unsigned().into());
            let escape = escape(class as u16);
            match residual < escape {
                true => out.put(context, residual),
                false => {
                    out.put(context, escape);
                    out.put(BEYOND, residual - escape);
                }
            }
        }
    }
}

/// The samples of a tile by their places.
struct Planes {
    known: Plane<KNOWN, KNOWN>,
    centres: Plane<NEW, NEW>,
    /// Between known ones above each other.
    upright: Plane<KNOWN, NEW>,
    /// Between known ones beside each other.
    level: Plane<NEW, KNOWN>,
}

impl Planes {
    fn new(steps: &Samples) -> Self {
        let mut this = Self {
            known: [[0; KNOWN]; KNOWN],
            centres: [[0; NEW]; NEW],
            upright: [[0; KNOWN]; NEW],
            level: [[0; NEW]; KNOWN],
        };
        let (rows, _) = steps.as_chunks::<SIDE>();
        let split = |row: &[i32; SIDE], even: &mut [i32; KNOWN], odd: &mut [i32; NEW]| {
            let (pairs, last) = row.as_chunks::<2>();
            for ((even, odd), &[a, b]) in even.iter_mut().zip(odd).zip(pairs) {
                (*even, *odd) = (a, b);
            }
            even[NEW] = last[0];
        };
        for (number, row) in rows.iter().enumerate() {
            let half = number / 2;
            match number % 2 {
                0 => split(row, &mut this.known[half], &mut this.level[half]),
                _ => split(row, &mut this.upright[half], &mut this.centres[half]),
            }
        }
        this
    }
}

/// Appends the symbols of a tile below another one that draws all cells, as [`super::refine::refine`] finds them. Its
/// lines are even. Returns whether it could: heights must not be large.
pub(super) fn put(steps: &Samples, out: &mut SymbolBuffer) -> bool {
    if steps.iter().fold(0, |all, step| all | step.unsigned_abs()) > LARGEST {
        return false;
    }
    let planes = &Planes::new(steps);
    out.reserve(SIDE * SIDE);
    let upright_between: Plane<KNOWN, NEW> = between_rows(&planes.known);
    let mut centres = [Row::<NEW>::NONE; NEW];
    for number in 0..NEW {
        centres[number] = centre_row(planes, number, &between(&upright_between[number]));
        let above = number.checked_sub(1);
        put_centres(&centres[number], above.map(|above| &centres[above].sizes), out);
    }
    let across: Plane<NEW, { NEW - 1 }> = between_rows(&planes.centres);
    let mut above: Option<[i32; KNOWN]> = None;
    for number in 0..KNOWN {
        // Centres to the north and to the south.
        let beside = [number.checked_sub(1), Some(number).filter(|&number| number < NEW)];
        let crossed = number.checked_sub(1).and_then(|at| across.get(at));
        let level = level_row(planes, number, crossed);
        put_level(&level, beside.map(|at| at.map(|at| &centres[at].sizes)), above.as_ref(), out);
        if number < NEW {
            let upright = upright_row(planes, number, &upright_between[number]);
            put_upright(&upright, &centres[number].sizes, &level.sizes, out);
            above = Some(upright.sizes);
        }
    }
    true
}

fn centre_row(planes: &Planes, number: usize, between: &[i32; NEW]) -> Row<NEW> {
    let mut row = Row::NONE;
    let (north, south, own) = (&planes.known[number], &planes.known[number + 1], &planes.centres[number]);
    for k in 0..NEW {
        let prediction = (between[k] + 128) >> 8;
        let [a, b, c, d] = [north[k], north[k + 1], south[k], south[k + 1]];
        let bend = (a + d - b - c).abs() + (4 * prediction - (a + b + c + d)).abs();
        let range = a.max(b).max(c.max(d)) - a.min(b).min(c.min(d));
        row.set(k, own[k], prediction, 6 * bend + 3 * range);
        if number == 0 && k == 0 {
            // Nothing else is known of the first one.
            row.activity[0] += 16 * 2 * bend;
        }
    }
    row
}

fn put_centres(row: &Row<NEW>, above: Option<&[i32; NEW]>, out: &mut SymbolBuffer) {
    let sizes = &row.sizes;
    let mut means = [0; NEW];
    match above {
        None => (1..NEW).for_each(|k| means[k] = 12 * sizes[k - 1]),
        Some(above) => {
            means[0] = 6 * (above[0] + above[1]);
            for k in 1..NEW - 1 {
                means[k] = 3 * (sizes[k - 1] + above[k - 1] + above[k] + above[k + 1]);
            }
            means[NEW - 1] = 4 * (sizes[NEW - 2] + above[NEW - 2] + above[NEW - 1]);
        }
    }
    let mut measures = [0; NEW];
    for k in 0..NEW {
        measures[k] = (16 * means[k] + row.activity[k]).cast_unsigned().div_euclid(12).cast_signed();
    }
    row.put(CENTRE, &measures, out);
}

/// An edge from what lies along it and across it, sixteen times each.
#[inline(always)]
fn edge(along: i32, across: i32) -> (i32, i32) {
    ((along + across + 16) >> 5, 24 * ((along - across).abs() >> 2))
}

/// An edge of which nothing is known across: its prediction, and what its slope counts.
#[inline(always)]
fn end(along: i32, slope: i32) -> (i32, i32) {
    ((along + 8) >> 4, 6 * slope)
}

/// What the sizes around an edge count without anything across: they stand for the difference, too.
#[inline(always)]
fn alone(mean: i32) -> i32 {
    16 * mean + 24 * (mean.cast_unsigned() / 3).cast_signed()
}

fn level_row(planes: &Planes, number: usize, across: Option<&[i32; NEW]>) -> Row<NEW> {
    let (known, own) = (&planes.known[number], &planes.level[number]);
    let along: [i32; NEW] = between(known);
    let mut row = Row::NONE;
    match across {
        None => {
            for k in 0..NEW {
                let (prediction, activity) = end(along[k], (known[k] - known[k + 1]).abs());
                row.set(k, own[k], prediction, activity);
            }
        }
        Some(across) => {
            let (north, south) = (&planes.centres[number - 1], &planes.centres[number]);
            for k in 0..NEW {
                let slopes = (known[k] - known[k + 1]).abs() + (north[k] - south[k]).abs();
                let (prediction, difference) = edge(along[k], across[k]);
                row.set(k, own[k], prediction, difference + 3 * slopes);
            }
        }
    }
    row
}

fn put_level(row: &Row<NEW>, centres: [Option<&[i32; NEW]>; 2], above: Option<&[i32; KNOWN]>, out: &mut SymbolBuffer) {
    let mut sums = [0; NEW];
    for k in 0..NEW {
        sums[k] = match (centres, above) {
            ([Some(north), Some(south)], Some(above)) => 16 * 3 * (north[k] + south[k] + above[k] + above[k + 1]),
            ([Some(north), None], Some(above)) => alone(4 * (north[k] + above[k] + above[k + 1])),
            ([_, south], _) => alone(12 * south.map_or(0, |south| south[k])),
        };
    }
    put_edges(row, &sums, out);
}

fn upright_row(planes: &Planes, number: usize, along: &[i32; KNOWN]) -> Row<KNOWN> {
    let (north, south, own) = (&planes.known[number], &planes.known[number + 1], &planes.upright[number]);
    let centres = &planes.centres[number];
    let across: [i32; NEW - 1] = between(centres);
    let mut row = Row::NONE;
    for k in 1..NEW {
        let slopes = (north[k] - south[k]).abs() + (centres[k - 1] - centres[k]).abs();
        let (prediction, difference) = edge(along[k], across[k - 1]);
        row.set(k, own[k], prediction, difference + 3 * slopes);
    }
    for k in [0, NEW] {
        let (prediction, activity) = end(along[k], (north[k] - south[k]).abs());
        row.set(k, own[k], prediction, activity);
    }
    row
}

fn put_upright(row: &Row<KNOWN>, centres: &[i32; NEW], above: &[i32; NEW], out: &mut SymbolBuffer) {
    let mut sums = [0; KNOWN];
    for k in 1..NEW {
        sums[k] = 16 * 3 * (centres[k - 1] + centres[k] + above[k - 1] + above[k]);
    }
    sums[0] = alone(6 * (centres[0] + above[0]));
    sums[NEW] = alone(6 * (centres[NEW - 1] + above[NEW - 1]));
    put_edges(row, &sums, out);
}

fn put_edges<const COLUMNS: usize>(row: &Row<COLUMNS>, sums: &[i32; COLUMNS], out: &mut SymbolBuffer) {
    let mut measures = [0; COLUMNS];
    for k in 0..COLUMNS {
        measures[k] = ((sums[k] + row.activity[k]).cast_unsigned() / 24).cast_signed();
    }
    row.put(EDGE, &measures, out);
}
