//! The samples of a tile as symbols (SPEC.md, "Blocks of heights").
//!
//! A tile below another one has every second of its samples in common with a quarter of that, and codes the others; one
//! at depth 0 begins with its corners. Each *refinement* halves the distance of samples: it predicts them from all that
//! is known around, and codes what they are off.
//!
//! - [`contexts`]: the statistics of symbols,
//! - [`stencil`]: interpolation between uneven lines,
//! - [`refine`]: one refinement,
//! - `even`: the same for encoders, for whole rows of tiles with even lines,
//! - [`cells`]: which cells are drawn.

mod cells;
pub(crate) mod contexts;
mod even;
mod refine;
mod stencil;
#[cfg(test)]
mod tests;

use self::{
    cells::Cells,
    contexts::{BEYOND, CELL, CORNER, escape},
    refine::{Coded, Coder, Samples, refine},
};
use super::{
    drawn::TileValues,
    grid::{CELLS, Grid, Lines, SIDE, TileId},
};
use crate::{
    codec::entropy::{Decoder, SymbolBuffer, SymbolSource, Tables, context::Context, unzigzag, zigzag},
    error::{Error, Result, Violation},
};

/// All cells are drawn.
const ALL: Cells = [u64::MAX; CELLS];

impl TileValues {
    /// The cells that are drawn; none if all are.
    pub(super) fn drawn_cells(&self) -> Option<&[u64; CELLS]> {
        self.cells.as_deref().filter(|&cells| *cells != ALL)
    }
}

/// What is known of a tile before its block.
struct Start {
    /// Every second sample in both directions. At depth 0 nothing is known.
    samples: Box<Samples>,
    /// The cells that can be drawn.
    can_be: Cells,
}

impl Start {
    fn new(grid: &Grid, id: TileId, parent: Option<&TileValues>) -> Self {
        let mut this = Self { samples: Box::new([0; SIDE * SIDE]), can_be: ALL };
        let (Some(parent), Some(parent_id)) = (parent, id.parent()) else { return this };
        const HALF: usize = CELLS / 2;
        let (left, top) = (id.quarter() % 2 * HALF, id.quarter() / 2 * HALF);
        let mut known = [[0; HALF + 1]; HALF + 1];
        for (row, known) in known.iter_mut().enumerate() {
            known.copy_from_slice(&parent.steps[(top + row) * SIDE + left..][..HALF + 1]);
        }
        if let Some(cells) = parent.drawn_cells() {
            this.can_be = cells::quarter_of(cells, id.quarter());
            let corners = cells::corners(cells, &grid.lines(parent_id));
            cells::fill(&mut known, |column, row| corners[(top + row) * SIDE + left + column]);
        }
        for (row, known) in known.iter().enumerate() {
            for (column, &value) in known.iter().enumerate() {
                this.samples[2 * row * SIDE + 2 * column] = value;
            }
        }
        this
    }

    /// The tile whose residuals are all 0.
    fn predicted(self, lines: &Lines, is_root: bool) -> Result<TileValues> {
        let cells = (self.can_be != ALL).then(|| Box::new(self.can_be));
        self.code(lines, is_root, cells, &mut Predicted)
    }

    /// Finds the samples of the tile.
    fn code(
        mut self,
        lines: &Lines,
        is_root: bool,
        cells: Option<Box<Cells>>,
        coder: &mut impl Coder,
    ) -> Result<TileValues> {
        let corners = cells.as_deref().map(|cells| cells::corners(cells, lines));
        let coded = corners.as_deref();
        let mut stride = 1;
        if is_root {
            code_corners(&mut self.samples, coded, coder)?;
            stride = CELLS / 2;
        }
        while stride > 0 {
            refine(&mut self.samples, lines, stride, coded, coder)?;
            stride /= 2;
        }
        Ok(TileValues { steps: self.samples, cells })
    }
}

/// The corners of a tile at depth 0, each from the one before it.
fn code_corners(samples: &mut Samples, coded: Coded<'_>, coder: &mut impl Coder) -> Result<(), Violation> {
    let mut before = 0;
    for at in [0, CELLS, CELLS * SIDE, CELLS * SIDE + CELLS] {
        if coded.is_none_or(|coded| coded[at]) {
            before = coder.corner(at, before)?;
        }
        samples[at] = before;
    }
    Ok(())
}

/// Appends the symbols of a tile. Every second of its samples is one of `parent`'s; a tile at depth 0 has no parent.
/// Samples that no drawn cell touches do not count, neither here nor in the parent.
///
/// # Errors
/// [`Error::Model`] if the tile contradicts its parent, or is not in the grid.
pub fn tile_symbols(
    grid: &Grid,
    id: TileId,
    parent: Option<&TileValues>,
    tile: &TileValues,
    out: &mut SymbolBuffer,
) -> Result<()> {
    if !grid.has(id) || parent.is_some() != (id.depth > 0) {
        let what = "is not in the grid, or has a parent at depth 0, or none below it";
        return Err(Error::model(format!("tile {} {what}", id.name())));
    }
    let lines = grid.lines(id);
    if let Some(parent) = parent
        && [parent, tile].iter().all(|tile| tile.drawn_cells().is_none())
        && lines.distances().is_some_and(|distances| distances.into_iter().all(u64::is_power_of_two))
        && contains_quarter(parent, id, tile)
        && even::put(&tile.steps, out)
    {
        return Ok(());
    }
    uneven_symbols(id, (&lines, Start::new(grid, id, parent)), tile, out)
}

/// Whether every second sample of a tile is one of its parent's.
fn contains_quarter(parent: &TileValues, id: TileId, tile: &TileValues) -> bool {
    const HALF: usize = CELLS / 2;
    let (left, top) = (id.quarter() % 2 * HALF, id.quarter() / 2 * HALF);
    (0..=HALF).all(|row| {
        let (of_parent, own) =
            (&parent.steps[(top + row) * SIDE + left..][..=HALF], &tile.steps[2 * row * SIDE..][..SIDE]);
        of_parent.iter().zip(own.iter().step_by(2)).fold(true, |same, (a, b)| same & (a == b))
    })
}

/// Appends the symbols of any tile, of which something is known.
fn uneven_symbols(
    id: TileId,
    (lines, start): (&Lines, Start),
    tile: &TileValues,
    out: &mut SymbolBuffer,
) -> Result<()> {
    let wrong = |what: &str| Error::model(format!("tile {} {what}", id.name()));
    let cells = tile.drawn_cells();
    let is_within = |(cells, can_be): (&u64, &u64)| cells & !can_be == 0;
    if !cells.unwrap_or(&ALL).iter().zip(&start.can_be).all(is_within) {
        return Err(wrong("draws a cell that its parent does not draw"));
    }
    if let Some(cells) = cells {
        cells::put(cells, &start.can_be, out);
    }
    let mut coder = Encoder { steps: &tile.steps, symbols: out };
    let coded = start.code(lines, id.depth == 0, cells.map(|&cells| Box::new(cells)), &mut coder)?;
    let corners = cells.map(|cells| cells::corners(cells, lines));
    let is_coded = |at: usize| corners.as_ref().is_none_or(|corners| corners[at]);
    match (0..SIDE * SIDE).all(|at| coded.steps[at] == tile.steps[at] || !is_coded(at)) {
        true => Ok(()),
        false => Err(wrong("has other samples than its parent, or two heights in one place")),
    }
}

/// Decodes the block of a tile. A block without bytes has no residual but 0, and draws all cells that can be drawn.
///
/// # Errors
/// [`Error::Format`].
pub(super) fn decode_tile(
    grid: &Grid,
    id: TileId,
    parent: Option<&TileValues>,
    is_partial: bool,
    (tables, block): (&Tables, &[u8]),
) -> Result<TileValues> {
    let start = Start::new(grid, id, parent);
    let (lines, is_root) = (grid.lines(id), id.depth == 0);
    if block.is_empty() {
        if is_partial != (start.can_be != ALL) {
            return Err(Error::format("a tile without a block does not draw what its parent does"));
        }
        return start.predicted(&lines, is_root);
    }
    let mut symbols = Decoder::new(tables, block)?;
    let cells = match is_partial {
        true => Some(Box::new(cells::get(&start.can_be, &mut symbols)?)),
        false if start.can_be != ALL => {
            return Err(Error::format("a tile draws cells that its parent does not draw"));
        }
        false => None,
    };
    let tile = start.code(&lines, is_root, cells, &mut symbols)?;
    symbols.finish()?;
    Ok(tile)
}

/// Which samples of a tile are known; none if all are.
pub(crate) fn known_samples(tile: &TileValues, lines: &Lines) -> Option<Box<[bool; SIDE * SIDE]>> {
    tile.drawn_cells().map(|cells| cells::corners(cells, lines))
}

/// A tile that a file does not have, because all residuals from `parent` on are 0.
pub(super) fn implied_tile(grid: &Grid, id: TileId, parent: &TileValues) -> Result<TileValues> {
    Start::new(grid, id, Some(parent)).predicted(&grid.lines(id), false)
}

/// Whether symbols say no more than a block without bytes.
pub(super) fn is_implied(symbols: &SymbolBuffer) -> bool {
    symbols.iter().all(|(context, value)| value == u64::from(context >= CELL))
}

struct Encoder<'a> {
    steps: &'a Samples,
    symbols: &'a mut SymbolBuffer,
}

impl Coder for Encoder<'_> {
    fn corner(&mut self, at: usize, before: i32) -> Result<i32, Violation> {
        self.symbols.put_signed(CORNER, i64::from(self.steps[at]) - i64::from(before));
        Ok(self.steps[at])
    }

    #[inline]
    fn sample(&mut self, at: usize, first: Context, class: u16, prediction: i64) -> Result<i32, Violation> {
        let residual = zigzag(i64::from(self.steps[at]) - prediction);
        let escape = escape(class);
        self.symbols.put(first + class, residual.min(escape));
        if residual >= escape {
            self.symbols.put(BEYOND, residual - escape);
        }
        Ok(self.steps[at])
    }
}

fn height(value: Option<i64>) -> Result<i32, Violation> {
    value.and_then(|value| value.try_into().ok()).ok_or(Violation(&"a height exceeds 32 bits"))
}

impl Coder for Decoder<'_> {
    fn corner(&mut self, _: usize, before: i32) -> Result<i32, Violation> {
        height(self.get_signed(CORNER)?.checked_add(before.into()))
    }

    #[inline]
    fn sample(&mut self, _: usize, first: Context, class: u16, prediction: i64) -> Result<i32, Violation> {
        let mut residual = self.get(first + class)?;
        if residual >= escape(class) {
            residual = residual.saturating_add(self.get(BEYOND)?);
        }
        height(prediction.checked_add(unzigzag(residual)))
    }
}

/// Residuals that are all 0.
struct Predicted;

impl Coder for Predicted {
    fn corner(&mut self, _: usize, before: i32) -> Result<i32, Violation> {
        Ok(before)
    }

    fn sample(&mut self, _: usize, _: Context, _: u16, prediction: i64) -> Result<i32, Violation> {
        height(Some(prediction))
    }
}
