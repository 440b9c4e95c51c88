//! Where the samples of a grid are in its tiles (SPEC.md, "Grid of heights").
//!
//! The tiles of each depth divide the *index space*, whose sides are powers of two times the roots. At the greatest
//! depth, an index coordinate is the number of a line of samples, and all levels are nested. Where the index space has
//! more cells than the grid, all coordinates beyond belong to the last line: cells there are *empty*, and have no
//! width.

use super::page::PAGE_DEPTHS;
use crate::error::{Error, Result};

/// Cells along a side of a tile.
pub const CELLS: usize = 64;
/// Samples along a side of a tile.
pub const SIDE: usize = CELLS + 1;
/// A grid has at most this many cells along a side.
pub const MAX_CELLS: u64 = 1 << 30;
/// At most this many tiles lie at depth 0, in a row or in a column.
const MAX_ROOTS: u64 = 2;

/// A tile: its depth, and its place among the tiles of this depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TileId {
    /// 0 at the roots.
    pub depth: u32,
    /// From the west.
    pub column: u64,
    /// From the north.
    pub row: u64,
}

/// The lower 32 bits of a number, with a zero above each.
fn spread(number: u64) -> u64 {
    [
        (16, 0xffff_0000_ffff_u64),
        (8, 0x00ff_00ff_00ff_00ff),
        (4, 0x0f0f_0f0f_0f0f_0f0f),
        (2, 0x3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555),
    ]
    .into_iter()
    .fold(number & 0xffff_ffff, |bits, (shift, mask)| (bits | bits << shift) & mask)
}

impl TileId {
    /// The tile that this one is a quarter of.
    pub fn parent(self) -> Option<Self> {
        let depth = self.depth.checked_sub(1)?;
        Some(Self { depth, column: self.column >> 1, row: self.row >> 1 })
    }

    /// Its quarters: north-west, north-east, south-west, south-east.
    pub fn children(self) -> [Self; 4] {
        let (depth, column, row) = (self.depth + 1, 2 * self.column, 2 * self.row);
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| Self { depth, column: column + x, row: row + y })
    }

    /// A key by which tiles of a grid come in the order of the file: by index pages, coarse to fine, and along a Z in
    /// each depth.
    pub fn order(self, grid: &Grid) -> impl Ord + Copy + use<> {
        let root = self.ancestor(0);
        let along_z = |id: Self| spread(id.column) | spread(id.row) << 1;
        let top = self.ancestor(self.depth - self.depth % PAGE_DEPTHS);
        // Above all steps between quarters, the number of the root decides.
        let within = |id: Self| along_z(id) & ((1 << (2 * id.depth)) - 1);
        (top.depth, root.row * grid.roots()[0] + root.column, within(top), self.depth, within(self))
    }

    /// A key by which a tile comes before those that it covers, and these before all others. `depth` is the greatest
    /// one of the grid.
    pub(crate) fn along_z(self, depth: u32) -> impl Ord + Copy + use<> {
        let up = depth.saturating_sub(self.depth);
        (spread(self.column << up) | spread(self.row << up) << 1, self.depth)
    }

    /// Its depth, column and row, for messages.
    pub(crate) fn name(self) -> String {
        format!("{}/{}/{}", self.depth, self.column, self.row)
    }

    /// Which quarter of its parent it is: 0 to 3.
    pub fn quarter(self) -> usize {
        (self.column & 1 | (self.row & 1) << 1) as usize
    }

    /// The tile that covers this one at a depth that is not greater.
    pub fn ancestor(self, depth: u32) -> Self {
        let up = self.depth.saturating_sub(depth);
        Self { depth: self.depth - up, column: self.column >> up, row: self.row >> up }
    }
}

/// The columns and rows on which the samples of a tile lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lines {
    /// Of each index column, ascending, not strictly.
    pub columns: [u64; SIDE],
    /// Of each index row.
    pub rows: [u64; SIDE],
}

impl Lines {
    /// Whether the samples are all of a square of the grid.
    pub fn are_whole(&self) -> bool {
        let is_whole = |lines: &[u64; SIDE]| lines[CELLS] - lines[0] == CELLS as u64;
        is_whole(&self.columns) && is_whole(&self.rows) && self.is_finest()
    }

    /// From each column to the next, and from each row to the next, if all columns are equally far apart, and all rows.
    pub fn distances(&self) -> Option<[u64; 2]> {
        let of = |lines: &[u64; SIDE]| {
            let distance = lines[1] - lines[0];
            (distance > 0 && lines.windows(2).all(|pair| pair[1] - pair[0] == distance)).then_some(distance)
        };
        Some([of(&self.columns)?, of(&self.rows)?])
    }

    /// Whether no sample lies between the lines of the tile.
    pub fn is_finest(&self) -> bool {
        [&self.columns, &self.rows].iter().all(|lines| lines.windows(2).all(|pair| pair[1] - pair[0] <= 1))
    }
}

/// A regular grid of samples, divided into tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Grid {
    cells: [u64; 2],
    wraps: bool,
    poles: [bool; 2],
    roots: [u64; 2],
    depth: u32,
}

impl Grid {
    /// A grid, given its columns and rows of cells. It `wraps` if the last column of cells ends at the first column of
    /// samples; its first and its last row of samples may be one point each, a pole.
    ///
    /// # Errors
    /// [`Error::Format`] if there are no cells, or more than 2^30 along a side.
    pub fn new(cells: [u64; 2], wraps: bool, poles: [bool; 2]) -> Result<Self> {
        if cells.iter().any(|&count| count == 0 || count > MAX_CELLS) {
            return Err(Error::format("a grid of heights does not have 1 to 2^30 cells along each side"));
        }
        let of_depth = |depth: u32| cells.map(|count| count.div_ceil((CELLS as u64) << depth));
        let depth = (0..).find(|&depth| of_depth(depth).iter().product::<u64>() <= MAX_ROOTS).unwrap_or(0);
        Ok(Self { cells, wraps, poles, roots: of_depth(depth), depth })
    }

    /// Columns and rows of cells.
    pub fn cells(&self) -> [u64; 2] {
        self.cells
    }

    /// Columns and rows of samples. The last column of a grid that wraps is its first one, and not counted.
    pub fn samples(&self) -> [u64; 2] {
        [self.cells[0] + u64::from(!self.wraps), self.cells[1] + 1]
    }

    /// Whether the last column of cells ends at the first column of samples.
    pub fn wraps(&self) -> bool {
        self.wraps
    }

    /// Whether the first and the last row of samples are one point.
    pub fn poles(&self) -> [bool; 2] {
        self.poles
    }

    /// The triangles of `columns` by `rows` cells, between a first and a last row of samples: two in each cell, but one
    /// at a pole.
    pub fn face_count(&self, [columns, rows]: [u64; 2], [first, last]: [u64; 2]) -> u64 {
        let [is_first, is_last] = self.poles;
        let poles = u64::from(is_first && first == 0) + u64::from(is_last && last == self.cells()[1]);
        columns * (2 * rows - poles)
    }

    /// Columns and rows of tiles at depth 0.
    pub fn roots(&self) -> [u64; 2] {
        self.roots
    }

    /// The greatest depth.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// How many lines of the grid lie between the samples of a tile, and one: a power of two.
    pub fn distance(&self, id: TileId) -> u64 {
        1 << self.depth.saturating_sub(id.depth)
    }

    /// The tiles at depth 0, from the west or from the north.
    pub fn root_tiles(&self) -> impl Iterator<Item = TileId> + use<> {
        let [columns, rows] = self.roots;
        (0..rows).flat_map(move |row| (0..columns).map(move |column| TileId { depth: 0, column, row }))
    }

    /// The line of samples of an index coordinate of some depth, along axis 0 (columns) or 1 (rows).
    pub fn line(&self, axis: usize, depth: u32, index: u64) -> u64 {
        // Below 2^34 times 2^24, at most.
        self.cells[axis].min(index << (self.depth - depth.min(self.depth)))
    }

    /// The first and the last column of a tile, and its first and last row.
    pub fn ends(&self, id: TileId) -> [[f64; 2]; 2] {
        [(0, id.column), (1, id.row)].map(|(axis, tile)| {
            [0, 1].map(|k| self.line(axis, id.depth, tile.saturating_add(k).saturating_mul(CELLS as u64)) as f64)
        })
    }

    /// The lines of a tile's samples.
    pub fn lines(&self, id: TileId) -> Lines {
        let of =
            |axis: usize, tile: u64| std::array::from_fn(|k| self.line(axis, id.depth, tile * CELLS as u64 + k as u64));
        Lines { columns: of(0, id.column), rows: of(1, id.row) }
    }

    /// Whether there is such a tile: within the grid, and neither its columns nor its rows are empty.
    pub fn has(&self, id: TileId) -> bool {
        let is_there = |axis: usize, tile: u64| {
            let count = self.roots[axis].checked_shl(id.depth).unwrap_or(0);
            let from = tile.saturating_mul(CELLS as u64);
            tile < count && self.line(axis, id.depth, from) < self.line(axis, id.depth, from + CELLS as u64)
        };
        id.depth <= self.depth && is_there(0, id.column) && is_there(1, id.row)
    }

    /// One name for each point of the surface: the last column of a grid that wraps is its first one, and a pole is one
    /// point.
    pub fn vertex(&self, column: u64, row: u64) -> [u64; 2] {
        let is_pole = row == 0 && self.poles[0] || row == self.cells[1] && self.poles[1];
        let is_first = is_pole || self.wraps && column == self.cells[0];
        [if is_first { 0 } else { column }, row]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_of_all_depths_are_nested_and_cover_every_sample() {
        for cells in [[1, 1], [64, 64], [65, 3], [100, 1000], [43_200, 21_600], [1_000_000, 2], [4096, 4096]] {
            let grid = Grid::new(cells, false, [false; 2]).unwrap();
            assert!(grid.roots().iter().product::<u64>() <= 2);
            for axis in 0..2 {
                let count = grid.roots()[axis] * CELLS as u64;
                assert_eq!(grid.line(axis, 0, count), cells[axis]);
                for depth in 0..grid.depth() {
                    for index in (0..=count << depth).step_by(7) {
                        assert_eq!(grid.line(axis, depth, index), grid.line(axis, depth + 1, 2 * index));
                    }
                }
                let finest = (0..=count << grid.depth()).map(|index| grid.line(axis, grid.depth(), index));
                let steps = finest.collect::<Vec<_>>();
                assert!(steps.windows(2).all(|pair| pair[1] - pair[0] <= 1));
            }
        }
    }

    #[test]
    fn quarters_know_their_parents() {
        let tile = TileId { depth: 3, column: 5, row: 2 };
        for (k, child) in tile.children().into_iter().enumerate() {
            assert_eq!((child.parent(), child.quarter(), child.ancestor(3)), (Some(tile), k, tile));
        }
    }

    #[test]
    fn grids_without_cells_are_refused() {
        assert!(Grid::new([0, 4], false, [false; 2]).is_err());
        assert!(Grid::new([4, MAX_CELLS + 1], false, [false; 2]).is_err());
    }

    #[test]
    fn tiles_without_width_are_none() {
        let grid = Grid::new([1000, 2], false, [false; 2]).unwrap();
        let deepest = |row| TileId { depth: grid.depth(), column: 0, row };
        let count = (0..grid.roots()[1] << grid.depth()).filter(|&row| grid.has(deepest(row))).count();
        assert_eq!(count, 1);
        assert!(!grid.has(TileId { depth: grid.depth() + 1, column: 0, row: 0 }));
    }
}
