//! Index pages: what a file says about a tile and those up to three depths below it (SPEC.md, "Section HEIGHT_INDEX").

use super::{
    grid::{CELLS, Grid, Lines, TileId},
    surface::{Base, Surface},
};
use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::{unzigzag, zigzag},
    },
    error::{Error, Result},
    format::{
        error_code::ErrorCode,
        sections::{Extent, Part},
    },
    lattice::Lattice,
    limits::{Limits, within},
};

/// Depths of tiles in a page.
pub(super) const PAGE_DEPTHS: u32 = 4;
/// A tile has at most this many resolutions.
pub const MAX_RESOLUTIONS: usize = 8;
/// A tile has at most this many triangles.
const MAX_TRIANGLES: u64 = 8192;

/// One way to draw a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Resolution {
    /// The tolerance of the restricted triangulation, in units of space.
    pub tolerance: f64,
    /// A bound of the distance to what the heights were made from, whatever is drawn beside it; units of space.
    pub error: f64,
    /// Triangles, without those that neighbours with more samples add.
    pub triangle_count: u32,
}

/// The largest number that a file can store as a tolerance and that is at most `tolerance`; for all tolerances of
/// resolutions.
///
/// # Errors
/// [`Error::Model`] if it is negative, not finite, or too large.
pub fn storable_tolerance(tolerance: f64) -> Result<f64> {
    crate::format::error_code::storable_error(tolerance, &Lattice::default())
}

/// What a file says about a tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileRecord {
    /// The tile.
    pub id: TileId,
    /// Which of its quarters are tiles of the file: bit k for [`TileId::children`]`[k]`. If none are, all heights below
    /// are as predicted; if some are, the others draw nothing.
    pub children: u8,
    /// Whether only some of its cells are drawn.
    pub is_partial: bool,
    /// The lowest of its samples, in steps.
    pub lowest: i32,
    /// The highest of its samples, in steps.
    pub highest: i32,
    /// From coarse to fine, 1 to [`MAX_RESOLUTIONS`]. Errors do not grow.
    pub resolutions: Vec<Resolution>,
    /// Bytes of its block.
    pub block_bytes: u64,
    /// CRC-32 of its block.
    pub checksum: u32,
    /// Everything below is level and follows from it (SPEC.md 22.3): the file has none of its quarters, and they are
    /// drawn all the same.
    pub is_level: bool,
}

impl TileRecord {
    /// Its quarters that can be drawn.
    pub fn child_tiles(&self) -> impl Iterator<Item = TileId> + use<> {
        let children = self.children;
        (0..4).zip(self.id.children()).filter(move |(k, _)| (children >> k) & 1 != 0).map(|(_, child)| child)
    }

    /// The error of its finest resolution.
    pub fn finest_error(&self) -> f64 {
        self.resolutions.last().map_or(0.0, |finest| finest.error)
    }
}

/// The most level tiles that are divided and whose quarters follow from them: these take no bytes, so the size of a
/// file does not bound their number.
pub const MOST_LEVEL: u64 = 1 << 16;

/// What a tile below a level one has of its parent's error beyond the least one: a quarter, as globes bend, and what
/// rounding may add.
const OF_LEVEL: f64 = 0.2578125;
/// Positions on an ellipsoid are rounded a few times, each by an ulp of its axis at most.
const ROUNDING_OF_AXIS: f64 = 1.0 / (1u64 << 48) as f64;

/// What follows below level tiles of an ellipsoid: everything there has the height of the tile, so its error is that of
/// the ellipsoid's curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelErrors {
    /// In units of space.
    least: f64,
    /// The greatest depth of the grid.
    depth: u32,
}

impl LevelErrors {
    /// None on a plane, where level tiles have no error at any depth. `sample_error` is in units of heights.
    pub fn new(grid: &Grid, surface: &Surface, sample_error: f64) -> Option<Self> {
        let Base::Ellipsoid { axis, .. } = surface.base else { return None };
        let least = sample_error * surface.height_scale + axis * ROUNDING_OF_AXIS;
        Some(Self { least, depth: grid.depth() })
    }

    /// Whether everything below a tile is level, and follows from it: the file has no quarters of it.
    pub fn follow_from(&self, record: &TileRecord) -> bool {
        let is_level = record.children == 0 && record.lowest == record.highest && !record.is_partial;
        is_level && record.id.depth < self.depth
    }

    /// The error of what has all samples.
    pub fn least(&self) -> f64 {
        self.least
    }

    /// The error of a tile at a depth, whose parent has the error `above`.
    pub fn below(&self, above: f64, depth: u32) -> f64 {
        let share = if depth < self.depth { OF_LEVEL } else { 0.0 };
        above.min(self.least + (above - self.least) * share)
    }

    /// What the error of a tile needs so that one below it, at a depth, has an error of at least `below`.
    pub fn above(&self, below: f64, depth: u32) -> f64 {
        /// It is rounded a few times.
        const ROUNDED_UP: f64 = 1.0 + 1e-9;
        match depth < self.depth {
            true => self.least + (below - self.least).max(0.0) / OF_LEVEL * ROUNDED_UP,
            false => self.least,
        }
    }
}

/// What the record before says.
#[derive(Debug, Default)]
struct Before {
    tolerances: [u16; MAX_RESOLUTIONS],
    lowest: i32,
}

/// A page that is being written: records and what follows from them.
#[derive(Debug, Default)]
pub(super) struct PageDraft {
    pub records: Vec<u8>,
    before: Before,
    /// Bytes of its blocks in PAGES.
    pub block_bytes: u64,
    /// Pages below it.
    pub child_count: usize,
}

impl PageDraft {
    /// Appends a record.
    ///
    /// # Errors
    /// [`Error::Model`] if it breaks a rule.
    pub fn push(&mut self, record: &TileRecord) -> Result<()> {
        let wrong = |what: &str| Error::model(format!("tile {} {what}", record.id.name()));
        let count = record.resolutions.len();
        if count == 0 || count > MAX_RESOLUTIONS {
            return Err(wrong("does not have 1 to 8 resolutions"));
        }
        if record.children > 15 || record.lowest > record.highest {
            return Err(wrong("has more than four children, or its lowest sample above its highest"));
        }
        self.records.push(record.children | u8::from(record.is_partial) << 4 | (count as u8 - 1) << 5);
        Part { offset: 0, length: record.block_bytes, checksum: record.checksum }.write(&mut self.records);
        put_varint(&mut self.records, zigzag(i64::from(record.lowest) - i64::from(self.before.lowest)));
        put_varint(&mut self.records, record.highest.abs_diff(record.lowest).into());
        self.before.lowest = record.lowest;
        let lattice = Lattice::default();
        let mut finer = None;
        for (resolution, before) in record.resolutions.iter().zip(&mut self.before.tolerances) {
            let tolerance = ErrorCode::at_least(resolution.tolerance, &lattice)?;
            let error = ErrorCode::at_least(resolution.error, &lattice)?;
            if tolerance.bound(&lattice) != resolution.tolerance {
                return Err(wrong("has a tolerance that cannot be stored; see storable_tolerance"));
            }
            if finer.is_some_and(|coarser| error > coarser) || u64::from(resolution.triangle_count) > MAX_TRIANGLES {
                return Err(wrong("has errors that grow, or more than 8,192 triangles"));
            }
            finer = Some(error);
            put_varint(&mut self.records, zigzag(i64::from(tolerance.0) - i64::from(*before)));
            put_varint(&mut self.records, zigzag(i64::from(error.0) - i64::from(tolerance.0)));
            put_varint(&mut self.records, resolution.triangle_count.into());
            *before = tolerance.0;
        }
        Ok(())
    }

    /// The page, with the pages below it.
    pub fn finish(&self, first_block: u64, first_page: u64, pages: &[Part]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(16 + self.records.len() + 6 * pages.len());
        bytes.extend(first_block.to_le_bytes());
        bytes.extend(first_page.to_le_bytes());
        bytes.extend(&self.records);
        pages.iter().for_each(|page| page.write(&mut bytes));
        bytes
    }
}

/// A tile of a page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    pub record: TileRecord,
    /// Where its block lies in PAGES, or among the blocks of the roots.
    pub block: Extent,
    /// The number of its first child: in the page, or among the pages below.
    first_child: usize,
}

/// A page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    entries: Vec<Entry>,
    /// Below its deepest tiles.
    pages: Vec<Part>,
    grid: Grid,
    /// On a globe.
    level: Option<LevelErrors>,
}

/// Where a tile of a page's tree is.
#[derive(Clone, Debug)]
pub(crate) enum Found<'a> {
    /// In the page.
    Here(&'a Entry),
    /// It follows from a level tile of the page: see [`Page::below_level`].
    Level(Entry),
    /// In another page.
    Below {
        /// The tile of the page.
        top: TileId,
        part: Part,
        /// The error of the tile above it.
        coarser: f64,
    },
    /// The file has no such tile. Its nearest ancestor that is there.
    Missing(&'a Entry),
}

impl Page {
    /// Reads the page of a tile, whose parent has an error of `coarser`.
    pub fn parse(
        bytes: &[u8],
        (top, coarser): (TileId, f64),
        (grid, level): (&Grid, Option<LevelErrors>),
        limits: &Limits,
    ) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let (mut next_block, mut next_page) = (cursor.u64()?, cursor.u64()?);
        let mut this = Self { entries: Vec::new(), pages: Vec::new(), grid: grid.clone(), level };
        let mut before = Before::default();
        // Every tile takes at least six bytes, so their number is bounded by the page's length as well as by its
        // depths.
        let mut depth = vec![(top, coarser)];
        let mut page_count = 0;
        while depth.first().is_some_and(|(id, _)| id.depth < top.depth + PAGE_DEPTHS) {
            let mut below = Vec::new();
            let first_below = this.entries.len() + depth.len();
            let is_last = depth.first().is_some_and(|(id, _)| id.depth + 1 == top.depth + PAGE_DEPTHS);
            for &(id, coarser) in &depth {
                let mut record = parse_record(&mut cursor, id, coarser, grid, &mut before)?;
                // Blocks of the roots lie in HEIGHTS.
                let offset = if id.depth == 0 { 0 } else { next_block };
                within(limits.part_bytes, record.block_bytes, "size of a block of heights")?;
                let end = offset.checked_add(record.block_bytes);
                let end = end.ok_or_else(|| Error::format("a block ends beyond 2^64"))?;
                if id.depth > 0 {
                    next_block = end;
                }
                let first_child = if is_last { page_count } else { first_below + below.len() };
                page_count += if is_last { record.children.count_ones() as usize } else { 0 };
                let error = record.finest_error();
                below.extend(record.child_tiles().map(|child| (child, error)));
                let block = Extent { offset, length: record.block_bytes };
                if level.is_some_and(|level| level.follow_from(&record)) {
                    (record.is_level, record.children) = (true, quarters(grid, id));
                }
                this.entries.push(Entry { record, block, first_child });
            }
            depth = below;
        }
        for _ in depth {
            let page = Part::parse(&mut cursor, &mut next_page, limits)?;
            if page.length == 0 {
                return Err(Error::format("an index page has no bytes"));
            }
            this.pages.push(page);
        }
        cursor.finish()?;
        Ok(this)
    }

    /// A tile below a level one: all its cells are drawn, and its error follows.
    fn below_level(&self, above: &Entry, id: TileId) -> Entry {
        let own = above.record.finest_error();
        let error = self.level.map_or(own, |level| {
            (above.record.id.depth + 1..=id.depth).fold(own, |error, depth| level.below(error, depth))
        });
        let triangle_count = face_count(&self.grid, id);
        let record = TileRecord {
            id,
            children: quarters(&self.grid, id),
            resolutions: vec![Resolution { tolerance: 0.0, error, triangle_count }],
            block_bytes: 0,
            checksum: 0,
            is_level: id.depth < self.grid.depth(),
            ..above.record
        };
        Entry { record, block: Extent::default(), first_child: 0 }
    }

    /// The tile of the page.
    pub fn top(&self) -> Option<&Entry> {
        self.entries.first()
    }

    /// How many tiles it has.
    pub fn tile_count(&self) -> usize {
        self.entries.len()
    }

    /// Hands out the tiles of the page that have none below them in it.
    pub fn for_each_deepest(&self, mut with: impl FnMut(&TileRecord)) {
        let top = self.top().map_or(0, |entry| entry.record.id.depth);
        let is_deepest =
            |record: &TileRecord| record.is_level || record.children == 0 || record.id.depth + 1 == top + PAGE_DEPTHS;
        self.entries.iter().map(|entry| &entry.record).filter(|record| is_deepest(record)).for_each(&mut with);
    }

    /// Looks for a tile that lies in the page's tile.
    pub fn find(&self, id: TileId) -> Option<Found<'_>> {
        let mut at = self.entries.first()?;
        let top = at.record.id;
        if id.depth < top.depth || id.ancestor(top.depth) != top {
            return None;
        }
        while at.record.id.depth < id.depth {
            let child = id.ancestor(at.record.id.depth + 1);
            let bit = 1 << child.quarter();
            if at.record.is_level {
                return Some(if self.grid.has(id) {
                    Found::Level(self.below_level(at, id))
                } else {
                    Found::Missing(at)
                });
            }
            if at.record.children & bit == 0 {
                return Some(Found::Missing(at));
            }
            let number = at.first_child + (at.record.children & (bit - 1)).count_ones() as usize;
            if child.depth == top.depth + PAGE_DEPTHS {
                let coarser = at.record.finest_error();
                return self.pages.get(number).map(|&part| Found::Below { top: child, part, coarser });
            }
            at = self.entries.get(number)?;
        }
        Some(Found::Here(at))
    }
}

/// The quarters of a tile that are in a grid, as bits.
fn quarters(grid: &Grid, id: TileId) -> u8 {
    id.children().into_iter().enumerate().fold(0, |bits, (k, quarter)| bits | u8::from(grid.has(quarter)) << k)
}

/// The triangles of a tile with all its samples, in cells with width and height.
fn face_count(grid: &Grid, id: TileId) -> u32 {
    let Lines { columns, rows } = grid.lines(id);
    let count = |lines: &[u64]| lines.windows(2).filter(|pair| pair[0] < pair[1]).count() as u64;
    grid.face_count([count(&columns), count(&rows)], [rows[0], rows[CELLS]]) as u32
}

fn parse_record(
    cursor: &mut Cursor<'_>,
    id: TileId,
    coarser: f64,
    grid: &Grid,
    before: &mut Before,
) -> Result<TileRecord> {
    let flags = cursor.u8()?;
    let (children, is_partial, count) = (flags & 15, flags & 16 != 0, usize::from(flags >> 5) + 1);
    let block_bytes = cursor.varint()?;
    let checksum = if block_bytes > 0 { cursor.u32()? } else { 0 };
    let steps = |value: Option<i64>| value.and_then(|value| i32::try_from(value).ok());
    let lowest = steps(unzigzag(cursor.varint()?).checked_add(before.lowest.into()));
    let highest = steps(i64::try_from(cursor.varint()?).ok().and_then(|size| size.checked_add(lowest?.into())));
    let (Some(lowest), Some(highest)) = (lowest, highest) else {
        return Err(Error::format("a height exceeds 32 bits"));
    };
    before.lowest = lowest;
    let lattice = Lattice::default();
    let mut resolutions = Vec::with_capacity(count);
    let mut coarser = coarser;
    for before in &mut before.tolerances[..count] {
        let code = |value: u64, base: u16| {
            let code = unzigzag(value).checked_add(base.into()).and_then(|code| u16::try_from(code).ok());
            code.ok_or_else(|| Error::format("an error code exceeds 16 bits"))
        };
        *before = code(cursor.varint()?, *before)?;
        let error = ErrorCode(code(cursor.varint()?, *before)?).bound(&lattice);
        let triangle_count = cursor.varint_up_to(MAX_TRIANGLES, "a tile has more than 8,192 triangles")? as u32;
        if error > coarser {
            return Err(Error::format("the error of a tile grows with finer resolutions"));
        }
        coarser = error;
        resolutions.push(Resolution { tolerance: ErrorCode(*before).bound(&lattice), error, triangle_count });
    }
    let record =
        TileRecord { id, children, is_partial, lowest, highest, resolutions, block_bytes, checksum, is_level: false };
    if record.child_tiles().any(|child| !grid.has(child)) {
        return Err(Error::format("a tile has a child that is not in the grid"));
    }
    Ok(record)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOP: TileId = TileId { depth: 0, column: 0, row: 0 };

    fn record(id: TileId, children: u8, error: f64) -> TileRecord {
        let resolutions = vec![Resolution { tolerance: 0.5, error, triangle_count: 7 }];
        let (lowest, highest) = (-5 - id.column as i32, 9);
        TileRecord {
            id,
            children,
            is_partial: false,
            lowest,
            highest,
            resolutions,
            block_bytes: 3,
            checksum: 4,
            is_level: false,
        }
    }

    fn page(records: &[TileRecord]) -> Vec<u8> {
        let mut draft = PageDraft::default();
        records.iter().for_each(|record| draft.push(record).unwrap());
        draft.finish(10, 0, &[])
    }

    fn parse(bytes: &[u8]) -> Result<Page> {
        let grid = Grid::new([300, 300], false, [false; 2]).unwrap();
        Page::parse(bytes, (TOP, 100.0), (&grid, None), &Limits::default())
    }

    /// Why a page is refused.
    fn fault(bytes: &[u8]) -> String {
        parse(bytes).unwrap_err().to_string()
    }

    #[test]
    fn records_come_back() {
        let [child, _, _, other] = TOP.children();
        let records = [record(TOP, 9, 4.0), record(child, 0, 2.0), record(other, 0, 4.0)];
        let parsed = parse(&page(&records)).unwrap();
        assert_eq!(parsed.top().unwrap().record, records[0]);
        for (record, offset) in records.iter().zip([0, 10, 13]) {
            let Some(Found::Here(entry)) = parsed.find(record.id) else { panic!("{record:?}") };
            assert_eq!((&entry.record, entry.block), (record, Extent { offset, length: 3 }));
        }
        let below = other.children()[1];
        assert!(matches!(parsed.find(below), Some(Found::Missing(entry)) if entry.record.id == other));
        assert!(parsed.find(TileId { column: 1, ..TOP }).is_none());
    }

    #[test]
    fn level_tiles_on_a_globe_have_quarters_that_follow_from_them() {
        let grid = Grid::new([300, 150], true, [true; 2]).unwrap();
        let level = TileRecord { lowest: 3, highest: 3, ..record(TOP, 0, 16.0) };
        let bytes = page(&[level]);
        let parse = |level| Page::parse(&bytes, (TOP, 100.0), (&grid, level), &Limits::default()).unwrap();
        assert!(matches!(parse(None).find(TOP.children()[0]), Some(Found::Missing(_))));
        let level = LevelErrors { least: 1.0, depth: grid.depth() };
        let parsed = parse(Some(level));
        let top = parsed.top().unwrap();
        assert!(top.record.is_level);
        let at = |id: TileId| match parsed.find(id) {
            Some(Found::Level(entry)) => entry.record,
            found => panic!("{found:?}"),
        };
        let (quarter, least) = (TileId { depth: 1, column: 1, row: 0 }, TileId { depth: 2, column: 1, row: 0 });
        let error = 1.0 + (top.record.finest_error() - 1.0) * OF_LEVEL;
        assert!((at(quarter).finest_error() - error).abs() < 1e-12 && at(quarter).is_level);
        // It has all samples.
        assert_eq!((at(least).finest_error(), at(least).is_level), (1.0, false));
        assert_eq!((at(least).lowest, at(least).highest, at(least).children), (3, 3, 0));
        assert_eq!(at(least).resolutions[0].triangle_count, 64 * (2 * 64 - 1));
        assert!(level.below(level.above(7.0, 1), 1) >= 7.0 && level.below(0.5, 1) == 0.5);
        assert_eq!(parsed.top().unwrap().record.child_tiles().count(), 4);
        assert!(parsed.find(TileId { depth: 9, ..least }).is_some_and(|found| matches!(found, Found::Missing(_))));
    }

    #[test]
    fn pages_that_break_a_rule_are_refused() {
        let [child, ..] = TOP.children();
        let good = page(&[record(TOP, 1, 4.0), record(child, 0, 4.0)]);
        assert!(parse(&good).is_ok());
        assert!((0..good.len()).all(|end| parse(&good[..end]).is_err()));
        assert!(fault(&[&good[..], &[0]].concat()).contains("left over"));
        let grows = page(&[record(TOP, 1, 4.0), record(child, 0, 5.0)]);
        assert!(fault(&grows).contains("the error of a tile grows"));
        assert!(fault(&page(&[record(TOP, 0, 101.0)])).contains("the error of a tile grows"));
        let small = Grid::new([64, 64], false, [false; 2]).unwrap();
        let outside = Page::parse(&page(&[record(TOP, 2, 4.0)]), (TOP, 100.0), (&small, None), &Limits::default());
        assert!(outside.unwrap_err().to_string().contains("a child that is not in the grid"));
        let high = TileRecord { highest: i32::MAX, lowest: i32::MIN, ..record(TOP, 0, 4.0) };
        assert!(parse(&page(std::slice::from_ref(&high))).is_ok());
        let mut higher = page(&[high]);
        // The lowest height is one higher, and the difference of the highest as large as before.
        let at = 16 + 1 + 1 + 4;
        higher[at] -= 2;
        assert!(fault(&higher).contains("exceeds 32 bits"));
        let small = Limits { part_bytes: 2, ..Limits::default() };
        let grid = Grid::new([300, 300], false, [false; 2]).unwrap();
        assert!(matches!(Page::parse(&good, (TOP, 100.0), (&grid, None), &small), Err(Error::Limit { .. })));
    }

    #[test]
    fn drafts_refuse_what_a_page_cannot_say() {
        let mut draft = PageDraft::default();
        let good = record(TOP, 0, 4.0);
        let with = |resolutions: Vec<Resolution>| TileRecord { resolutions, ..good.clone() };
        let resolution = good.resolutions[0];
        for bad in [
            with(vec![]),
            with(vec![resolution; 9]),
            with(vec![Resolution { tolerance: 1.0 / 3.0, ..resolution }]),
            with(vec![Resolution { triangle_count: 8193, ..resolution }]),
            with(vec![resolution, Resolution { error: 5.0, ..resolution }]),
            TileRecord { children: 16, ..good.clone() },
            TileRecord { lowest: 10, ..good.clone() },
        ] {
            assert!(matches!(draft.push(&bad), Err(Error::Model { .. })), "{bad:?}");
        }
        draft.push(&good).unwrap();
    }
}
