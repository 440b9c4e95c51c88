//! Which index cells are drawn, at one depth: a cell is drawn where any of its four quarters is.

use lodpack::heights::CELLS;

/// Some samples of the cell are there.
const SOME: u8 = 1;
/// All of them are.
const ALL: u8 = 2;

/// Index cells of a rectangle. Beyond it, every cell is like the last one of its row or column.
#[derive(Clone, Debug)]
pub struct Mask {
    width: usize,
    cells: Vec<u8>,
}

/// Bits of the drawn cells of a tile.
pub enum Drawn {
    None,
    Some(Box<[u64; CELLS]>),
    All,
}

impl Mask {
    /// A mask of cells of the finest depth: `is_there(column, row)`.
    pub fn new([width, height]: [usize; 2], is_there: impl Fn(usize, usize) -> bool) -> Self {
        let cell = |at: usize| if is_there(at % width, at / width) { SOME | ALL } else { 0 };
        Self { width, cells: (0..width * height).map(cell).collect() }
    }

    /// A mask in which no cell is drawn yet.
    pub fn empty([width, height]: [usize; 2]) -> Self {
        Self { width, cells: vec![0; width * height] }
    }

    /// Puts the first tile of another mask into this one, with its first cell there.
    pub fn put(&mut self, [column, row]: [usize; 2], other: &Self) {
        for from in 0..CELLS {
            let at = (row + from) * self.width + column;
            for (k, cell) in self.cells[at..at + CELLS].iter_mut().enumerate() {
                *cell = other.cell(k, from);
            }
        }
    }

    fn cell(&self, column: usize, row: usize) -> u8 {
        let height = self.cells.len() / self.width;
        self.cells[row.min(height - 1) * self.width + column.min(self.width - 1)]
    }

    /// The mask of the depth above.
    pub fn halved(&self) -> Self {
        let width = self.width / 2;
        let height = self.cells.len() / self.width / 2;
        let cell = |at: usize| {
            let (column, row) = (2 * (at % width), 2 * (at / width));
            let at = row * self.width + column;
            let quarters = [at, at + 1, at + self.width, at + self.width + 1].map(|at| self.cells[at]);
            let some = quarters.iter().fold(0, |all, quarter| all | quarter & SOME);
            some | quarters.iter().fold(ALL, |all, quarter| all & quarter)
        };
        Self { width, cells: (0..width * height).map(cell).collect() }
    }

    /// The drawn cells of a tile, which begins at a cell.
    pub fn tile(&self, [column, row]: [usize; 2]) -> Drawn {
        let mut bits = Box::new([0; CELLS]);
        for (line, bits) in bits.iter_mut().enumerate() {
            for k in 0..CELLS {
                *bits |= u64::from(self.cell(column + k, row + line) & SOME) << k;
            }
        }
        match (bits.iter().all(|&row| row == 0), bits.iter().all(|&row| row == u64::MAX)) {
            (true, _) => Drawn::None,
            (_, true) => Drawn::All,
            _ => Drawn::Some(bits),
        }
    }

    /// Bits of the cells of a tile, which begins at a cell, that have all samples.
    pub fn whole(&self, [column, row]: [usize; 2]) -> Vec<u64> {
        let bits =
            |line: usize| (0..CELLS).fold(0, |bits, k| bits | u64::from(self.is_whole([column + k, row + line])) << k);
        (0..CELLS).map(bits).collect()
    }

    /// Whether all samples of a cell are there.
    pub fn is_whole(&self, [column, row]: [usize; 2]) -> bool {
        self.cell(column, row) & ALL != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_drawn_where_a_quarter_is_and_whole_where_all_are() {
        let fine = Mask::new([128, 128], |column, row| column < 3 && row < 2 || column >= 64);
        let coarse = fine.halved();
        assert!(coarse.is_whole([0, 0]) && !coarse.is_whole([1, 0]) && coarse.is_whole([40, 9]));
        let Drawn::Some(bits) = coarse.tile([0, 0]) else { panic!("some cells are drawn") };
        assert_eq!(bits[0], 0b11 | u64::MAX << 32);
        assert_eq!(bits[1], u64::MAX << 32);
        assert!(matches!(fine.tile([64, 0]), Drawn::All) && matches!(fine.tile([0, 64]), Drawn::None));
    }
}
