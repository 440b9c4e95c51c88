//! An open file of heights.

use std::{
    collections::HashMap,
    ops::Range,
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::{
    drawn::{DrawnTile, TileValues},
    grid::{Grid, TileId},
    page::TileRecord,
    section::{HeightsInfo, HeightsSection},
    surface::Surface,
    tiles::KeptTiles,
    tree::{KnownPages, Place, WantedPage},
};
use crate::{
    codec::entropy::Tables,
    error::{Error, Result},
    file::read_ranges,
    format::{
        header::{Section, kind},
        placement::Placement,
        records::SourceInfo,
        sections::{Part, parse_source},
    },
    index::Opener,
    limits::Limits,
    source::{Fetched, ReadAt, requests::plan},
};

/// The size of the first read: it covers a first picture.
const FIRST_READ_BYTES: usize = 16 << 10;
/// An open file of heights, and a source from which it reads what an answer needs. It keeps index pages, and the tiles used last.
#[derive(Debug)]
pub struct Heights<S> {
    source: S,
    pub(super) limits: Limits,
    pub(super) info: HeightsInfo,
    source_info: Option<SourceInfo>,
    placement: Option<Placement>,
    pub(super) tables: Tables,
    pub(super) index: Section,
    pub(super) pages: Section,
    /// The tiles at depth 0 that the file has.
    roots: Vec<TileId>,
    /// Their blocks.
    pub(super) root_blocks: HashMap<TileId, Vec<u8>>,
    pub(super) known: Mutex<KnownPages>,
    pub(super) tiles: Mutex<KeptTiles>,
    head: Fetched,
}

/// No answer depends on what another thread did while it panicked: maps only grow by whole entries.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<S: ReadAt> Heights<S> {
    /// Opens a file: one request of 16 KiB for most.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] if it is damaged or not whole, [`Error::Unsupported`] if it needs a newer reader, [`Error::Limit`];
    /// [`Error::Query`] if it holds a mesh.
    pub fn open(source: S, limits: Limits) -> Result<Self> {
        let io = |source| Error::Io { offset: 0, length: FIRST_READ_BYTES as u64, source };
        let (bytes, size) = source.read_start(FIRST_READ_BYTES).map_err(io)?;
        let mut head = Fetched::default();
        head.insert(0, bytes.clone());
        let mut opener = Opener::new(limits);
        opener.start(bytes, size);
        let header = opener.header()?;
        if header.section(kind::HEIGHTS).is_none() {
            return Err(Error::Query {
                what: "this file holds a mesh, not a grid of heights; open it with lodpack::File".into(),
            });
        }
        let index = *header.required_section(kind::HEIGHT_INDEX)?;
        let pages = *header.required_section(kind::PAGES)?;
        let end = || "end of the file".to_string();
        match pages.offset.checked_add(pages.length) {
            Some(end) if end == size => {}
            Some(last) if last < size => return Err(Error::format("there are bytes after the last section").at(end)),
            _ => return Err(Error::format("the file is truncated").at(end)),
        }
        let sections = [kind::SOURCE, kind::PLACEMENT, kind::TABLES, kind::HEIGHTS];
        while let Err(error) = opener.need(sections.into_iter().filter_map(|kind| header.section(kind))) {
            let Error::Missing { ranges } = error else { return Err(error) };
            read_ranges(&source, &ranges)?.into_iter().for_each(|(at, bytes)| opener.insert(at, bytes));
        }
        let tables = opener.parse(&header, kind::TABLES, Tables::parse)?;
        let section = opener.parse(&header, kind::HEIGHTS, |bytes| HeightsSection::parse(bytes, &limits))?;
        let source_info = header.section(kind::SOURCE).map(|_| opener.parse(&header, kind::SOURCE, parse_source));
        let placement =
            header.section(kind::PLACEMENT).map(|_| opener.parse(&header, kind::PLACEMENT, Placement::parse));
        let mut this = Self {
            source,
            limits,
            info: section.info,
            source_info: source_info.transpose()?,
            placement: placement.transpose()?,
            tables,
            index,
            pages,
            roots: Vec::new(),
            root_blocks: HashMap::new(),
            known: Mutex::default(),
            tiles: Mutex::default(),
            head,
        };
        this.find_roots(&section.pages, section.blocks)?;
        Ok(this)
    }

    /// Reads the first pages, and hands out the blocks of their tiles.
    fn find_roots(&mut self, pages: &[Part], blocks: Vec<u8>) -> Result<()> {
        let roots: Vec<(TileId, Part)> = self.info.grid.root_tiles().zip(pages.iter().copied()).collect();
        let roots = roots.into_iter().filter(|(_, part)| part.length > 0);
        let wanted: Vec<WantedPage> =
            roots.map(|(top, part)| WantedPage { top, part, coarser: f64::INFINITY }).collect();
        self.load_pages(&wanted)?;
        let mut rest = blocks.as_slice();
        let wrong = || {
            Error::format("the blocks of the first tiles do not have their lengths")
                .at(|| "section heights".to_string())
        };
        for WantedPage { top, .. } in wanted {
            let Some(page) = self.known_page(top) else { continue };
            let length = page.top().map_or(0, |entry| entry.record.block_bytes);
            let (block, others) =
                usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length)).ok_or_else(wrong)?;
            self.root_blocks.insert(top, block.to_vec());
            self.roots.push(top);
            rest = others;
        }
        if rest.is_empty() { Ok(()) } else { Err(wrong()) }
    }

    /// The source that the file is read from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// What the file says about all of it.
    pub fn info(&self) -> &HeightsInfo {
        &self.info
    }

    /// The samples.
    pub fn grid(&self) -> &Grid {
        &self.info.grid
    }

    /// Where they are.
    pub fn surface(&self) -> &Surface {
        &self.info.surface
    }

    /// What the file was made from, if it says so.
    pub fn source_info(&self) -> Option<&SourceInfo> {
        self.source_info.as_ref()
    }

    /// Where the heights are in the world, if the file says so.
    pub fn placement(&self) -> Option<&Placement> {
        self.placement.as_ref()
    }

    /// The tiles at depth 0. One that draws nothing is not there.
    pub fn roots(&self) -> &[TileId] {
        &self.roots
    }

    /// What the file says about a tile; none if it does not have it.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn record(&self, id: TileId) -> Result<Option<TileRecord>> {
        match self.place(id)? {
            Place::Here(entry) => Ok(Some(entry.record)),
            _ => Ok(None),
        }
    }

    /// A tile laid out in space. `coarsest` is the largest tolerance that it will be drawn at.
    pub fn draw(&self, id: TileId, tile: &TileValues, coarsest: f64) -> DrawnTile {
        DrawnTile::new(&self.info.grid, &self.info.surface, [self.info.zero, self.info.step], (id, tile), coarsest)
    }

    /// Where the pages of the index begin.
    #[cfg(test)]
    pub(crate) fn index_offset(&self) -> u64 {
        self.index.offset
    }

    /// A part of a section as a range of the file.
    pub(super) fn range(&self, section: &Section, offset: u64, length: u64) -> Result<Range<u64>> {
        if offset.checked_add(length).is_none_or(|end| end > section.length) {
            return Err(Error::format("a part is not within its section"));
        }
        Ok(section.offset + offset..section.offset + offset + length)
    }

    /// Reads ranges, as far as they did not come with opening.
    pub(super) fn fetch(&self, ranges: &[Range<u64>]) -> Result<Fetched> {
        let mut fetched = Fetched::default();
        let new = plan(ranges.iter().filter(|&range| self.head.get(range.clone()).is_none()).cloned());
        read_ranges(&self.source, &new)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
        Ok(fetched)
    }

    /// Bytes of a range that was fetched.
    pub(super) fn get<'a>(&'a self, fetched: &'a Fetched, range: Range<u64>) -> Result<&'a [u8]> {
        let found = self.head.get(range.clone()).or_else(|| fetched.get(range));
        found.ok_or_else(|| Error::format("the file is truncated"))
    }
}
