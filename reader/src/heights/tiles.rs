//! The samples of an open file: tiles one by one, and windows of the grid.

use std::{collections::HashMap, ops::Range, sync::Arc};

use super::{
    codec::known_samples,
    drawn::TileValues,
    file::Heights,
    grid::{CELLS, SIDE, TileId},
    tree::{Place, lock},
};
use crate::{
    error::{Error, Result},
    source::{Fetched, ReadAt},
};

/// Tiles that are kept decoded: about 4 MB.
const KEPT_TILES: usize = 256;
/// Tiles whose blocks are read at once.
const TILES_AT_ONCE: usize = 1024;

/// Decoded tiles, those used last.
#[derive(Debug, Default)]
pub(super) struct KeptTiles {
    tiles: HashMap<TileId, (u64, Arc<TileValues>)>,
    uses: u64,
}

impl KeptTiles {
    fn get(&mut self, id: TileId) -> Option<Arc<TileValues>> {
        self.uses += 1;
        let (used, tile) = self.tiles.get_mut(&id)?;
        *used = self.uses;
        Some(Arc::clone(tile))
    }

    fn keep(&mut self, id: TileId, tile: &Arc<TileValues>) {
        self.uses += 1;
        self.tiles.insert(id, (self.uses, Arc::clone(tile)));
        if self.tiles.len() > KEPT_TILES {
            // Half of the tiles have not been used for longer than the others.
            let mut uses: Vec<u64> = self.tiles.values().map(|&(used, _)| used).collect();
            let middle = uses.len() / 2;
            let limit = *uses.select_nth_unstable(middle).1;
            self.tiles.retain(|_, (used, _)| *used >= limit);
        }
    }
}

impl<S: ReadAt> Heights<S> {
    /// The samples of a tile, also of one that follows from what is above it; none where nothing is drawn.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn tile(&self, id: TileId) -> Result<Option<Arc<TileValues>>> {
        let mut found = None;
        self.for_each_tile(&[id], |_, tile| {
            found = Some(Arc::clone(tile));
            Ok(())
        })?;
        Ok(found)
    }

    /// The heights of samples, row by row; NaN where no drawn cell touches the sample. Columns of a grid that wraps may
    /// go on beyond the last one, up to once around.
    ///
    /// # Errors
    /// [`Error::Query`] if the window is not in the grid; [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn window(&self, columns: Range<u64>, rows: Range<u64>) -> Result<Vec<f64>> {
        let grid = self.grid();
        let [column_count, row_count] = grid.samples();
        let width = columns.end.saturating_sub(columns.start);
        let ends =
            if grid.wraps() { column_count.saturating_add(columns.start.min(column_count - 1)) } else { column_count };
        let is_within = columns.start < column_count && columns.end <= ends && rows.end <= row_count;
        let count = usize::try_from(width.saturating_mul(rows.end.saturating_sub(rows.start)));
        let (true, Ok(count)) = (is_within && width <= column_count && rows.start <= rows.end, count) else {
            let what = format!(
                "columns {columns:?} and rows {rows:?} are not within a grid of {column_count} x {row_count} samples"
            );
            return Err(Error::Query { what });
        };
        let mut heights = Vec::new();
        let no_room =
            |_| Error::Query { what: format!("{count} heights do not fit in memory; ask for a smaller window") };
        heights.try_reserve_exact(count).map_err(no_room)?;
        heights.resize(count, f64::NAN);
        // Around a globe, a window goes on from the beginning; and the first column is also the last one of the tiles
        // in the east.
        let first = columns.start..columns.end.min(column_count);
        let second = 0..columns.end.saturating_sub(column_count);
        let mut pieces = vec![(first, 0), (second, column_count as i64)];
        if grid.wraps() {
            let has_first = pieces.iter().filter(|(piece, _)| piece.start == 0 && piece.end > 0);
            let last = has_first.map(|(_, shift)| (column_count..column_count + 1, shift - column_count as i64));
            pieces.extend(last.collect::<Vec<_>>());
        }
        for (piece, shift) in pieces {
            self.for_each_sample([piece, rows.clone()], |column, row, steps| {
                let (column, row) = (column.wrapping_add_signed(shift) - columns.start, row - rows.start);
                heights[(row * width + column) as usize] = self.info().height(steps);
            })?;
        }
        Ok(heights)
    }

    /// Hands out the drawn samples of a piece of the grid, some of them more than once.
    fn for_each_sample(&self, [columns, rows]: [Range<u64>; 2], mut with: impl FnMut(u64, u64, i32)) -> Result<()> {
        let grid = self.grid();
        if columns.is_empty() || rows.is_empty() {
            return Ok(());
        }
        let touches = |id: TileId| {
            let is_within = |axis: usize, tile: u64, range: &Range<u64>| {
                let end = |k: u64| grid.line(axis, id.depth, (tile + k) * CELLS as u64);
                end(0) < range.end && end(1) >= range.start
            };
            grid.has(id) && is_within(0, id.column, &columns) && is_within(1, id.row, &rows)
        };
        // Tiles of a depth are taken in bunches, so that a window of any size needs little memory beside its heights.
        let mut waiting: Vec<TileId> = self.roots().to_vec();
        let mut finest = Vec::new();
        while !waiting.is_empty() {
            while let Some(id) = waiting.pop_if(|_| finest.len() < TILES_AT_ONCE) {
                match id.depth < grid.depth() {
                    _ if !touches(id) => {}
                    true => waiting.extend(id.children()),
                    false => finest.push(id),
                }
            }
            self.for_each_tile(&finest, |id, tile| {
                let lines = grid.lines(id);
                let known = known_samples(tile, &lines);
                let inside = |lines: &[u64; SIDE], range: &Range<u64>| {
                    lines.partition_point(|&line| line < range.start)..lines.partition_point(|&line| line < range.end)
                };
                for row in inside(&lines.rows, &rows) {
                    for column in inside(&lines.columns, &columns) {
                        let at = row * SIDE + column;
                        if known.as_ref().is_none_or(|known| known[at]) {
                            with(lines.columns[column], lines.rows[row], tile.steps[at]);
                        }
                    }
                }
                Ok(())
            })?;
            finest.clear();
        }
        Ok(())
    }

    /// Hands out the samples of tiles, along a Z; a tile that draws nothing is left out. Tiles above them are decoded
    /// once.
    pub(crate) fn for_each_tile(
        &self,
        ids: &[TileId],
        mut with: impl FnMut(TileId, &Arc<TileValues>) -> Result<()>,
    ) -> Result<()> {
        let mut ids = ids.to_vec();
        ids.sort_unstable_by_key(|id| id.along_z(self.grid().depth()));
        for ids in ids.chunks(TILES_AT_ONCE) {
            self.load_pages_of(ids)?;
            let mut places = HashMap::new();
            let mut ranges = Vec::new();
            for id in ids.iter().flat_map(|id| (0..=id.depth).map(|depth| id.ancestor(depth))) {
                if places.contains_key(&id) {
                    continue;
                }
                let (place, kept) = (self.place(id)?, lock(&self.tiles).get(id));
                if let Place::Here(entry) = &place
                    && kept.is_none()
                {
                    ranges.extend(self.index().block_range(entry)?);
                }
                places.insert(id, (place, kept));
            }
            let fetched = self.fetch(&ranges)?;
            let mut path: Vec<(TileId, Arc<TileValues>)> = Vec::new();
            for &id in ids {
                while path.last().is_some_and(|(above, _)| id.depth < above.depth || id.ancestor(above.depth) != *above)
                {
                    path.pop();
                }
                for depth in path.len() as u32..=id.depth {
                    let id = id.ancestor(depth);
                    let Some((place, kept)) = places.get(&id) else { break };
                    let parent = path.last().map(|(_, tile)| tile.as_ref());
                    let tile = match kept {
                        Some(tile) => Some(Arc::clone(tile)),
                        None => self.decode(id, place, parent, &fetched)?,
                    };
                    let Some(tile) = tile else { break };
                    path.push((id, tile));
                }
                if let Some((found, tile)) = path.last().filter(|(found, _)| *found == id) {
                    with(*found, tile)?;
                }
            }
        }
        Ok(())
    }

    /// A tile from its parent, which is then kept.
    fn decode(
        &self,
        id: TileId,
        place: &Place,
        parent: Option<&TileValues>,
        fetched: &Fetched,
    ) -> Result<Option<Arc<TileValues>>> {
        let range = match place {
            Place::Here(entry) => self.index().block_range(entry)?,
            _ => None,
        };
        let block = range.map_or(Ok(&[][..]), |range| self.get(fetched, range));
        let block = block.map_err(|error| error.at(|| format!("block of tile {}", id.name())))?;
        let Some(tile) = self.index().decode(id, place, parent, block)? else { return Ok(None) };
        let tile = Arc::new(tile);
        lock(&self.tiles).keep(id, &tile);
        Ok(Some(tile))
    }
}
