//! A tile whose samples fit in memory together, with all tiles below it.

use lodpack::heights::{CELLS, Resolution, SIDE, TileEncoder, TileId, TileValues};
use lodpack::write::SymbolBuffer;
use serde::{Deserialize, Serialize};

use super::HeightsError;
use super::facets::Judge;
use super::mask::{Drawn as DrawnCells, Mask};
use super::samples::{Samples, Window};
use super::tile::{Setting, Tile, distance_of_quarters, range_of, symbols_of, values_of};

/// The error of a level tile may grow by this factor so that its quarters follow from it.
const GROWN: f64 = 1.1;

/// The tile above another one.
#[derive(Clone, Copy)]
pub struct Parent<'a> {
    pub values: &'a TileValues,
    /// How far the samples of its quarters are from it.
    pub off: f64,
}

/// A tile as it is stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Finished {
    pub id: TileId,
    /// Bits of the quarters that are stored.
    pub children: u8,
    /// The lowest and the highest step of it and of everything below.
    pub range: [i32; 2],
    /// Fine to coarse.
    pub resolutions: Vec<Resolution>,
    pub block: Vec<u8>,
    pub is_partial: bool,
}

/// What a tile says to the one above it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Below {
    pub id: TileId,
    /// Whether its samples and their straight connections say everything about the samples below.
    pub is_settled: bool,
    /// Whether it can be foretold from the tile above.
    pub is_silent: bool,
    /// Its finest error.
    pub least: f64,
    pub range: [i32; 2],
    /// Of a level tile on a globe: the error that it needs so that all tiles below follow from it.
    pub level: Option<f64>,
}

impl Below {
    /// Joins what the quarters of a tile say: whether they can be left out, and the finest error and the range of all.
    pub fn of_quarters(quarters: &[Self], off: Option<f64>, is_full: bool) -> (bool, bool, f64, Option<[i32; 2]>) {
        let is_settled = is_full
            && match off {
                None => true,
                Some(off) => off <= 0.0 && quarters.iter().all(|quarter| quarter.is_settled),
            };
        let are_silent = is_settled && quarters.iter().all(|quarter| quarter.is_silent);
        let least = quarters.iter().fold(0.0, |least: f64, quarter| least.max(quarter.least));
        let ranges = quarters.iter().map(|quarter| quarter.range);
        (is_settled, are_silent, least, ranges.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]))
    }
}

/// A tile with its samples, and those of everything below it.
pub struct Unit<'a> {
    setting: &'a Setting<'a>,
    root: TileId,
    pub window: Window,
    /// Drawn cells by depth, from the root's on; empty if all are.
    masks: Vec<Mask>,
}

impl<'a> Unit<'a> {
    /// Reads the samples.
    pub fn read(setting: &'a Setting<'a>, samples: &Samples, root: TileId) -> Result<Self, HeightsError> {
        let lines = setting.grid.lines(root);
        let ends = |lines: &[u64; SIDE]| [lines[0], lines[SIDE - 1]];
        let (columns, rows) = (ends(&lines.columns), ends(&lines.rows));
        let window = samples.window(columns, rows)?;
        let mut masks = vec![];
        if window.has_voids() {
            let depth = setting.grid.depth();
            let side = CELLS << (depth - root.depth);
            let of = |axis: usize, tile: u64, k: usize| setting.grid.line(axis, depth, tile * side as u64 + k as u64);
            // An empty cell is drawn where the next one is.
            // A thin grid leaves most of the unit empty. Cells are joined by two at each depth.
            let used = |[first, last]: [u64; 2]| ((last - first) as usize).next_multiple_of(side / CELLS).min(side);
            let column: Vec<u64> = (0..used(columns)).map(|k| of(0, root.column, k).min(columns[1] - 1)).collect();
            let row: Vec<u64> = (0..used(rows)).map(|k| of(1, root.row, k).min(rows[1] - 1)).collect();
            let mut mask = Mask::new([column.len(), row.len()], |a, b| window.is_drawn(column[a], row[b]));
            for _ in root.depth..depth {
                let above = mask.halved();
                masks.push(std::mem::replace(&mut mask, above));
            }
            masks.push(mask);
            masks.reverse();
        }
        Ok(Self { setting, root, window, masks })
    }

    /// The drawn cells of the root; none if all are.
    pub fn root_mask(&self) -> Option<&Mask> {
        self.masks.first()
    }

    /// The first cell of a tile in the mask of its depth.
    fn first_cell(&self, id: TileId) -> [usize; 2] {
        let down = id.depth - self.root.depth;
        let of = |tile: u64, root: u64| (tile - (root << down)) as usize * CELLS;
        [of(id.column, self.root.column), of(id.row, self.root.row)]
    }

    /// The samples of a tile; none if it has no drawn cell, or does not exist.
    pub fn values(&self, id: TileId) -> Option<TileValues> {
        if !self.setting.grid.has(id) {
            return None;
        }
        let cells = match self.masks.get((id.depth - self.root.depth) as usize) {
            None => None,
            Some(mask) => match mask.tile(self.first_cell(id)) {
                DrawnCells::None => return None,
                DrawnCells::Some(bits) => Some(bits),
                DrawnCells::All => None,
            },
        };
        Some(values_of(&self.window, &self.setting.grid.lines(id), cells))
    }

    /// The quarters of a tile, unless it has all samples itself.
    fn quarters(&self, id: TileId) -> Vec<(TileId, TileValues)> {
        if self.setting.grid.lines(id).is_finest() {
            return vec![];
        }
        id.children().into_iter().filter_map(|quarter| Some((quarter, self.values(quarter)?))).collect()
    }

    /// The symbols of a tile and of those below. For `thinned` depths only one quarter of each tile is taken.
    pub fn symbols(
        &self,
        (id, thinned): (TileId, u32),
        above: Option<&TileValues>,
        values: &TileValues,
        out: &mut Vec<SymbolBuffer>,
    ) -> Result<(), HeightsError> {
        out.push(symbols_of(self.setting.grid, id, above, values)?);
        let mut quarters = self.quarters(id);
        if thinned > 0 && !quarters.is_empty() {
            let number = (id.column ^ id.row) as usize % quarters.len();
            quarters = vec![quarters.swap_remove(number)];
        }
        let thinned = thinned.saturating_sub(1);
        quarters.iter().try_for_each(|(quarter, below)| self.symbols((*quarter, thinned), Some(values), below, out))
    }

    /// Finishes a tile and all below.
    pub fn finish(
        &self,
        encoder: &TileEncoder,
        judge: &Judge<'_>,
        id: TileId,
        above: Option<Parent<'_>>,
        values: TileValues,
    ) -> Result<(Below, Vec<Finished>), HeightsError> {
        let quarters = self.quarters(id);
        let off = (!quarters.is_empty()).then(|| {
            distance_of_quarters(self.setting, id, &values, quarters.iter().map(|(id, values)| (*id, values)))
        });
        let (mut below, mut all) = (vec![], vec![]);
        for (quarter, of_quarter) in quarters {
            let parent = Parent { values: &values, off: off.map_or(0.0, |off| off.most) };
            let (said, finished) = self.finish(encoder, judge, quarter, Some(parent), of_quarter)?;
            below.push(said);
            all.extend(finished);
        }
        let mut tile = Tile::new(self.setting, (id, Some(judge)), values, off, above.map(|above| above.off))?;
        if let Some(mask) = self.masks.get((id.depth - self.root.depth) as usize) {
            let [x, y] = self.first_cell(id);
            tile.note_partly(self.setting, |column, row| mask.is_whole([x + column, y + row]));
        }
        let least = below.iter().fold(0.0, |least: f64, quarter| least.max(quarter.least));
        tile.judge(judge, least - self.setting.added());
        let off = off.map(|off| off.most);
        let (said, finished) = finish_tile(self.setting, encoder, &tile, off, above.map(|above| above.values), &below)?;
        if finished.children == 0 {
            all.clear();
        }
        all.push(finished);
        Ok((said, all))
    }
}

/// Finishes a tile whose distances are known. It leaves its quarters out where they say nothing.
pub fn finish_tile(
    setting: &Setting<'_>,
    encoder: &TileEncoder,
    tile: &Tile,
    off: Option<f64>,
    above: Option<&TileValues>,
    below: &[Below],
) -> Result<(Below, Finished), HeightsError> {
    let is_full = tile.values.cells.is_none();
    let (is_settled, are_silent, least, ranges) = Below::of_quarters(below, off, is_full);
    let mut resolutions = tile.resolutions(setting, least);
    let [low, high] = range_of(&tile.values);
    let range = ranges.map_or([low, high], |[a, b]| [a.min(low), b.max(high)]);
    let block = encoder.encode(&symbols_of(setting.grid, tile.id, above, &tile.values)?)?;
    let level = if is_full && range[0] == range[1] { level_error(setting, &resolutions, below) } else { None };
    if let Some(needed) = level {
        resolutions.iter_mut().for_each(|resolution| resolution.error = resolution.error.max(needed));
    }
    let children = match are_silent || level.is_some() {
        true => 0,
        false => below.iter().fold(0, |bits, quarter| bits | 1 << quarter.id.quarter()),
    };
    let is_silent = block.is_empty() && children == 0 && is_full;
    let least = resolutions.first().map_or(least, |finest| finest.error);
    let said = Below { id: tile.id, is_settled, is_silent, least, range, level };
    let finished = Finished { id: tile.id, children, range, resolutions, block, is_partial: !is_full };
    Ok((said, finished))
}

/// The error that a level tile needs so that all tiles below follow from it; none if that is too much, or one of them
/// says something.
fn level_error(setting: &Setting<'_>, resolutions: &[Resolution], below: &[Below]) -> Option<f64> {
    let levels = setting.level?;
    // What follows is drawn with all samples.
    let own = resolutions.first().filter(|finest| finest.tolerance == 0.0)?.error;
    let needed = below.iter().try_fold(own, |most, quarter| {
        let error = quarter.level.filter(|_| quarter.is_silent)?;
        Some(most.max(levels.above(error, quarter.id.depth)))
    })?;
    (needed - levels.least() <= GROWN * (own - levels.least())).then_some(needed)
}
