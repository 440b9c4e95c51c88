//! Which cells of a tile are drawn, and which samples that makes known (SPEC.md, "Drawn cells").

use super::contexts::CELL;
use crate::{
    codec::entropy::{SymbolBuffer, SymbolSource, context::Context},
    error::Violation,
    heights::grid::{CELLS, Lines, SIDE},
};

/// Bits of cells, row by row, the westernmost one the lowest.
pub(super) type Cells = [u64; CELLS];

/// The cells of a quarter of a tile that are drawn, as cells of half the size: what a child can draw.
pub(super) fn quarter_of(cells: &Cells, quarter: usize) -> Cells {
    let (column, row) = (quarter % 2 * CELLS / 2, quarter / 2 * CELLS / 2);
    std::array::from_fn(|k| {
        let half = (cells[row + k / 2] >> column) & u64::from(u32::MAX);
        let spread = (0..CELLS / 2).fold(0, |sum, bit| sum | ((half >> bit) & 1) << (2 * bit));
        spread | spread << 1
    })
}

/// The context of a cell, from those before it.
fn context(cells: &Cells, column: usize, row: usize) -> Context {
    let above = row.checked_sub(1).map_or(0, |row| cells[row]);
    let bit = |bits: u64, column: usize| ((bits >> column) & 1) as Context;
    let west = |bits: u64| column.checked_sub(1).map_or(0, |column| bit(bits, column));
    let east = if column + 1 < CELLS { bit(above, column + 1) } else { 0 };
    CELL + (west(cells[row]) | west(above) << 1 | bit(above, column) << 2 | east << 3)
}

/// Visits all cells that can be drawn, in order. `of` says whether one is, from its context.
fn visit(
    can_be: &Cells,
    mut of: impl FnMut(usize, usize, Context) -> Result<bool, Violation>,
) -> Result<Cells, Violation> {
    let mut cells = [0; CELLS];
    for row in 0..CELLS {
        for column in (0..CELLS).filter(|&column| (can_be[row] >> column) & 1 != 0) {
            let is_drawn = of(column, row, context(&cells, column, row))?;
            cells[row] |= u64::from(is_drawn) << column;
        }
    }
    Ok(cells)
}

/// Appends which of the cells that can be drawn are.
pub(super) fn put(cells: &Cells, can_be: &Cells, symbols: &mut SymbolBuffer) {
    let _ = visit(can_be, |column, row, context| {
        let is_drawn = (cells[row] >> column) & 1;
        symbols.put(context, is_drawn);
        Ok(is_drawn != 0)
    });
}

/// Reads what [`put`] wrote.
pub(super) fn get(can_be: &Cells, symbols: &mut impl SymbolSource) -> Result<Cells, Violation> {
    visit(can_be, |_, _, context| match symbols.get(context)? {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(Violation(&"a cell is neither drawn nor not")),
    })
}

/// The samples that are corners of drawn cells, or lie on the same column and row as one.
pub(super) fn corners(cells: &Cells, lines: &Lines) -> Box<[bool; SIDE * SIDE]> {
    let mut is_corner = Box::new([false; SIDE * SIDE]);
    // Bit k is the sample at column k; the last column has a bit of its own.
    let row_corners = |row: usize| {
        let above = row.checked_sub(1).map_or(0, |row| cells[row]);
        let cells = above | cells.get(row).copied().unwrap_or(0);
        u128::from(cells) | u128::from(cells) << 1
    };
    let mut rows: [u128; SIDE] = std::array::from_fn(row_corners);
    for run in lines.rows.chunk_by(|a, b| a == b).scan(0, |start, run| {
        *start += run.len();
        Some(*start - run.len()..*start)
    }) {
        let all = rows[run.clone()].iter().fold(0, |all, bits| all | bits);
        rows[run].fill(all);
    }
    let mut first = 0;
    for run in lines.columns.chunk_by(|a, b| a == b) {
        let mask = ((1 << run.len()) - 1) << first;
        first += run.len();
        if run.len() > 1 {
            rows.iter_mut().filter(|bits| **bits & mask != 0).for_each(|bits| *bits |= mask);
        }
    }
    for (row, bits) in rows.iter().enumerate() {
        for column in 0..SIDE {
            is_corner[row * SIDE + column] = (bits >> column) & 1 != 0;
        }
    }
    is_corner
}

/// Gives each sample of a quarter's 33 x 33 that is not known the value of a known one: in its row of the nearest to
/// the west, or else of the first to the east; a row without any is like the one above, or else like the first that has
/// some.
pub(super) fn fill(samples: &mut [[i32; CELLS / 2 + 1]; CELLS / 2 + 1], is_known: impl Fn(usize, usize) -> bool) {
    let mut first_row = None;
    for row in 0..samples.len() {
        let first = (0..samples.len()).find(|&column| is_known(column, row));
        match (first, first_row) {
            (Some(first), _) => {
                let mut last = samples[row][first];
                for column in 0..samples.len() {
                    if is_known(column, row) {
                        last = samples[row][column];
                    }
                    samples[row][column] = last;
                }
                first_row = first_row.or(Some(row));
            }
            (None, Some(_)) => samples[row] = samples[row - 1],
            (None, None) => {}
        }
    }
    let like = first_row.map_or([0; CELLS / 2 + 1], |row| samples[row]);
    samples[..first_row.unwrap_or(CELLS / 2 + 1)].fill(like);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_are_spread_and_corners_include_those_on_the_same_lines() {
        let mut cells = [0; CELLS];
        cells[40] = 1 << 35;
        let quarter = quarter_of(&cells, 3);
        assert_eq!((quarter[15], quarter[16], quarter[17], quarter[18]), (0, 3 << 6, 3 << 6, 0));
        assert_eq!([0, 1, 2].map(|k| quarter_of(&cells, k)), [[0; CELLS]; 3]);

        let mut columns: [u64; SIDE] = std::array::from_fn(|k| k as u64);
        columns[34] = 35;
        columns[37] = 36;
        let rows = std::array::from_fn(|k| k as u64);
        let corners = corners(&cells, &Lines { columns, rows });
        let found: Vec<[usize; 2]> = (0..SIDE * SIDE).filter(|&k| corners[k]).map(|k| [k % SIDE, k / SIDE]).collect();
        assert_eq!(found, [40, 41].map(|row| [34, 35, 36, 37].map(|column| [column, row])).concat());
    }

    #[test]
    fn unknown_samples_take_the_nearest_ones() {
        let mut samples = [[0; 33]; 33];
        (samples[2][5], samples[2][20], samples[9][0]) = (7, 8, 9);
        fill(&mut samples, |column, row| [[5, 2], [20, 2], [0, 9]].contains(&[column, row]));
        assert_eq!([samples[0][0], samples[2][19], samples[8][20], samples[9][32], samples[32][0]], [7, 7, 8, 9, 9]);
        fill(&mut samples, |_, _| false);
        assert_eq!(samples, [[0; 33]; 33]);
    }
}
