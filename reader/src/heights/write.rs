//! Writing a file of heights (feature `write`): tables from some tiles, blocks of all of them, then their records in
//! the order of the file.

use std::{
    collections::VecDeque,
    io::{self, Read, Seek, Write},
};

use super::{
    codec::{contexts::anything, is_implied},
    drape::DrapeWriter,
    grid::TileId,
    page::{PAGE_DEPTHS, PageDraft, TileRecord},
    ramp::Ramp,
    section::{HeightsInfo, HeightsSection},
};
use crate::{
    codec::entropy::{Codes, SymbolBuffer, Tables, Tally, context, encode},
    error::{Error, Result},
    format::{
        header::{Header, Section, VERSION_WITH_DRAPE, VERSION_WITH_HEIGHTS, kind},
        placement::Placement,
        records::SourceInfo,
        sections::{Part, write_source},
    },
    lattice::Lattice,
    write::WriteReport,
};

/// Encodes the blocks of a file's tiles. Threads can share it.
#[derive(Debug)]
pub struct TileEncoder {
    tables: Tables,
    codes: Codes,
}

impl TileEncoder {
    /// An encoder for tiles that are like `some`. If these are not all tiles (`is_all`), its tables have codes for what
    /// does not occur in them, which costs a hundredth of a bit a sample.
    pub fn new<'a>(some: impl IntoIterator<Item = &'a SymbolBuffer>, is_all: bool) -> Self {
        let mut tally = Tally::of(some.into_iter().map(SymbolBuffer::iter));
        // A table with a single token would code it in no bytes, and these mean a tile that is as predicted.
        let two = (0..context::COUNT as u16).filter(|&context| tally.has(context));
        let two: SymbolBuffer = two.flat_map(|context| [(context, 0), (context, 1)]).collect();
        tally.add(&Tally::of([two.iter()]));
        if !is_all {
            tally.add(&Tally::of([anything().iter()]));
        }
        let tables = Tables::of(&tally);
        Self { codes: tables.codes(), tables }
    }

    /// Its tables, for other processes that write tiles of the same file.
    pub fn tables(&self) -> Vec<u8> {
        self.tables.write()
    }

    /// The encoder with these tables.
    ///
    /// # Errors
    /// [`Error::Format`] if they are no tables.
    pub fn of_tables(bytes: &[u8]) -> Result<Self> {
        let tables = Tables::parse(bytes)?;
        Ok(Self { codes: tables.codes(), tables })
    }

    /// The block of a tile, from its symbols. It has no bytes if the tile is as predicted.
    ///
    /// # Errors
    /// [`Error::Model`] if a symbol has no code, because the tables were made of all tiles, and this is none of them.
    pub fn encode(&self, symbols: &SymbolBuffer) -> Result<Vec<u8>> {
        if is_implied(symbols) {
            return Ok(Vec::new());
        }
        encode(&self.codes, [symbols.iter()])
    }
}

/// A file of heights that takes the records of its tiles.
#[derive(Debug)]
pub struct HeightsWriter {
    info: HeightsInfo,
    /// What the heights were made from.
    pub source: SourceInfo,
    /// Where they are in the world.
    pub placement: Option<Placement>,
    /// The colours to draw it with.
    pub ramp: Option<Ramp>,
    pages: Vec<PageDraft>,
    /// Tiles of the page that come next, with the errors of their parents.
    next: VecDeque<(TileId, f64)>,
    /// The tiles of the pages after it.
    next_pages: VecDeque<(TileId, f64)>,
    root_blocks: Vec<u8>,
    block_bytes: u64,
}

impl HeightsWriter {
    /// A file without tiles yet.
    ///
    /// # Errors
    /// [`Error::Model`] if a file cannot say this.
    pub fn new(info: HeightsInfo) -> Result<Self> {
        if let Some(fault) = info.fault() {
            return Err(Error::model(fault));
        }
        Ok(Self {
            next_pages: info.grid.root_tiles().map(|root| (root, f64::INFINITY)).collect(),
            info,
            source: SourceInfo::default(),
            placement: None,
            ramp: None,
            pages: Vec::new(),
            next: VecDeque::new(),
            root_blocks: Vec::new(),
            block_bytes: 0,
        })
    }

    /// The tile whose record comes next; none if there is no further one. A tile at depth 0 may be left out: see
    /// [`Self::skip`].
    pub fn expected(&self) -> Option<TileId> {
        self.next.front().or(self.next_pages.front()).map(|&(id, _)| id)
    }

    /// The finest error of the parent of the tile whose record comes next; infinity at depth 0. None of its errors may
    /// be larger.
    pub fn error_above(&self) -> f64 {
        self.next.front().or(self.next_pages.front()).map_or(f64::INFINITY, |&(_, error)| error)
    }

    /// Leaves out a tile at depth 0, which draws nothing.
    ///
    /// # Errors
    /// [`Error::Model`] if another one is expected.
    pub fn skip(&mut self, id: TileId) -> Result<()> {
        if self.expected() != Some(id) || id.depth > 0 {
            return Err(Error::model(format!("tile {} cannot be left out here", id.name())));
        }
        self.next_pages.pop_front();
        self.pages.push(PageDraft::default());
        Ok(())
    }

    /// Takes the record of the next tile, in the order of [`TileId::order`], and its block if it lies at depth 0.
    ///
    /// # Errors
    /// [`Error::Model`] if another tile is expected, or the record breaks a rule.
    pub fn add(&mut self, record: &TileRecord, root_block: Option<&[u8]>) -> Result<()> {
        let id = record.id;
        let wrong = |what: &str| Error::model(format!("tile {} {what}", id.name()));
        if self.expected() != Some(id) {
            return Err(wrong("does not come in the order of the file, or its parent does not have it"));
        }
        if record.child_tiles().any(|child| !self.info.grid.has(child)) {
            return Err(wrong("has a child that is not in the grid"));
        }
        let is_root = id.depth == 0;
        let is_root_block = |block: &[u8]| is_root && block.len() as u64 == record.block_bytes;
        if root_block.is_some_and(|block| !is_root_block(block)) || (is_root && root_block.is_none()) {
            return Err(wrong("comes with a block that is not its own, or without the block of a root"));
        }
        if let Some(block) = root_block {
            self.root_blocks.extend(block);
        }
        let coarser = match self.next.pop_front() {
            Some((_, coarser)) => coarser,
            None => {
                self.pages.push(PageDraft::default());
                self.next_pages.pop_front().map_or(f64::INFINITY, |(_, coarser)| coarser)
            }
        };
        if record.resolutions.first().is_some_and(|first| first.error > coarser) {
            return Err(wrong("has a larger error than its parent"));
        }
        let Some(page) = self.pages.last_mut() else { return Err(wrong("has no page")) };
        page.push(record)?;
        if !is_root {
            page.block_bytes += record.block_bytes;
            self.block_bytes += record.block_bytes;
        }
        let below = record.child_tiles().map(|child| (child, record.finest_error()));
        if (id.depth + 1).is_multiple_of(PAGE_DEPTHS) {
            page.child_count += record.children.count_ones() as usize;
            self.next_pages.extend(below);
        } else {
            self.next.extend(below);
        }
        Ok(())
    }

    /// Writes the file. `blocks` has the blocks of all tiles but those at depth 0, in the order of their records.
    ///
    /// # Errors
    /// [`Error::Model`] if a tile is missing, [`Error::Write`].
    pub fn finish(self, encoder: &TileEncoder, blocks: &mut impl Read, out: &mut impl Write) -> Result<WriteReport> {
        self.finish_draped(encoder, blocks, None::<DrapeWriter<io::Cursor<Vec<u8>>>>, out)
    }

    /// As [`Self::finish`], with an image over the heights.
    ///
    /// # Errors
    /// As [`Self::finish`], and [`Error::Model`] if images are missing.
    pub fn finish_draped<S: Read + Write + Seek>(
        self,
        encoder: &TileEncoder,
        blocks: &mut impl Read,
        drape: Option<DrapeWriter<S>>,
        out: &mut impl Write,
    ) -> Result<WriteReport> {
        if let Some(id) = self.expected() {
            return Err(Error::model(format!("tile {} is missing", id.name())));
        }
        let (pages, root_count) = (self.write_pages(), self.info.grid.root_tiles().count());
        let root_pages = pages.iter().take(root_count).scan(0, |offset, page| {
            *offset += page.len() as u64;
            Some(part_of(page, *offset - page.len() as u64))
        });
        let heights = HeightsSection { pages: root_pages.collect(), info: self.info, blocks: self.root_blocks }.write();
        let mut sections = vec![("tables", kind::TABLES, encoder.tables.write()), ("heights", kind::HEIGHTS, heights)];
        sections.extend(self.ramp.as_ref().map(|ramp| ("ramp", kind::RAMP, ramp.write())));
        if let Some(placement) = &self.placement {
            sections.insert(0, ("placement", kind::PLACEMENT, placement.write()?));
        }
        if self.source != SourceInfo::default() {
            sections.insert(0, ("source", kind::SOURCE, write_source(&self.source)));
        }
        let index_bytes = pages.iter().map(|page| page.len() as u64).sum();
        let drape = drape.map(DrapeWriter::finish).transpose()?;
        let version = if drape.is_some() { VERSION_WITH_DRAPE } else { VERSION_WITH_HEIGHTS };
        let mut in_parts = vec![("height index", kind::HEIGHT_INDEX, index_bytes)];
        in_parts.extend(drape.as_ref().map(|(length, _)| ("drape", kind::DRAPE, *length)));
        in_parts.push(("pages", kind::PAGES, self.block_bytes));
        let checked = sections.iter().map(|&(_, kind, ref bytes)| Section {
            kind,
            required: matches!(kind, kind::TABLES | kind::HEIGHTS),
            checksum: Some(crc32fast::hash(bytes)),
            offset: 0,
            length: bytes.len() as u64,
        });
        let by_parts = in_parts.iter().map(|&(_, kind, length)| Section {
            kind,
            required: kind != kind::DRAPE,
            checksum: None,
            offset: 0,
            length,
        });
        let directory = checked.chain(by_parts).collect();
        let header = Header::new(version, Lattice::default(), directory).write();
        let write = |source| Error::Write { source };
        out.write_all(&header).map_err(write)?;
        for bytes in sections.iter().map(|(.., bytes)| bytes).chain(&pages) {
            out.write_all(bytes).map_err(write)?;
        }
        if let Some((_, write_drape)) = drape {
            write_drape(out).map_err(write)?;
        }
        let copied = io::copy(&mut blocks.take(self.block_bytes), out).map_err(write)?;
        if copied != self.block_bytes {
            return Err(write(io::Error::new(io::ErrorKind::UnexpectedEof, "blocks are missing")));
        }
        let names = sections.iter().map(|(name, _, bytes)| (*name, bytes.len() as u64));
        let names = [("header", header.len() as u64)].into_iter().chain(names);
        let sections: Vec<_> = names.chain(in_parts.iter().map(|&(name, _, length)| (name, length))).collect();
        Ok(WriteReport { total_bytes: sections.iter().map(|section| section.1).sum(), sections, ..Default::default() })
    }

    /// All pages. Each says how long those below it are, so they are made from the last one on.
    fn write_pages(&self) -> Vec<Vec<u8>> {
        let count = self.pages.len();
        // Where the pages below each page begin: they follow those below the page before.
        let mut first_child = Vec::with_capacity(count + 1);
        let mut next_child = self.info.grid.root_tiles().count();
        for page in &self.pages {
            first_child.push(next_child);
            next_child += page.child_count;
        }
        let below = |number: usize| first_child[number]..first_child[number] + self.pages[number].child_count;
        // Lengths first, since offsets are parts of what checksums cover.
        let mut lengths = vec![0_u64; count];
        for number in (0..count).rev().filter(|&number| !self.pages[number].records.is_empty()) {
            let parts: Vec<Part> =
                below(number).map(|child| Part { length: lengths[child], ..Part::default() }).collect();
            lengths[number] = self.pages[number].finish(0, 0, &parts).len() as u64;
        }
        let sums = |lengths: &mut dyn Iterator<Item = u64>| -> Vec<u64> {
            let mut sum = 0;
            let mut sums = vec![0];
            sums.extend(lengths.map(|length| {
                sum += length;
                sum
            }));
            sums
        };
        let offsets = sums(&mut lengths.iter().copied());
        let block_offsets = sums(&mut self.pages.iter().map(|page| page.block_bytes));
        let mut bytes = vec![Vec::new(); count];
        let mut parts = vec![Part::default(); count];
        for number in (0..count).rev().filter(|&number| !self.pages[number].records.is_empty()) {
            let below = below(number);
            let page = &self.pages[number];
            let first_page = if below.is_empty() { 0 } else { offsets[below.start] };
            let first_block = if page.block_bytes == 0 { 0 } else { block_offsets[number] };
            bytes[number] = page.finish(first_block, first_page, &parts[below]);
            parts[number] = part_of(&bytes[number], offsets[number]);
        }
        bytes
    }
}

fn part_of(bytes: &[u8], offset: u64) -> Part {
    Part { offset, length: bytes.len() as u64, checksum: crc32fast::hash(bytes) }
}
