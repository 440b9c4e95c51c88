//! What is known of an open file of heights without reading: the whole, and the index pages that have been read.

use std::{collections::HashMap, ops::Range, sync::Mutex};

use super::{
    bounds::tile_box,
    codec::{decode_tile, implied_tile},
    drawn::{DrawnTile, TileValues},
    grid::{Grid, TileId},
    page::{Entry, LevelErrors, Page, TileRecord},
    ramp::Ramp,
    section::{HeightsInfo, HeightsSection},
    surface::{Base, Surface},
    tree::{KnownPages, Place, WantedPage, lock},
};
use crate::{
    codec::{bytes::has_checksum, entropy::Tables},
    error::{Error, Result},
    format::{
        header::{FileId, Section, kind},
        placement::Placement,
        records::SourceInfo,
        sections::{Part, parse_source},
    },
    index::Opener,
    limits::Limits,
    source::{Fetched, requests::plan},
};

/// The first two index pages take no more than this many bytes, or nearly: each has 85 tiles, of about 45 bytes.
const FIRST_PAGES_BYTES: u64 = 8 << 10;

/// The index of a file of heights: it reads nothing itself, and says what is missing. Sessions and programs that read
/// elsewhere use it;
/// [`super::Heights`] combines it with a source.
#[derive(Debug)]
pub struct HeightsIndex {
    pub(super) limits: Limits,
    info: HeightsInfo,
    source_info: Option<SourceInfo>,
    placement: Option<Placement>,
    ramp: Option<Ramp>,
    id: FileId,
    version: (u16, u16),
    tables: Tables,
    pub(super) index: Section,
    pages: Section,
    /// The tiles at depth 0 that the file has.
    roots: Vec<TileId>,
    /// Their blocks.
    root_blocks: HashMap<TileId, Vec<u8>>,
    pub(super) known: Mutex<KnownPages>,
    /// What came with opening.
    pub(super) head: Fetched,
}

impl HeightsIndex {
    /// Whether the file that is being opened holds heights, from its header.
    ///
    /// # Errors
    /// As [`Opener::finish`].
    pub fn is_in(opener: &Opener) -> Result<bool> {
        Ok(opener.header()?.section(kind::HEIGHTS).is_some())
    }

    /// The index of the file that is being opened, or [`Error::Missing`] with the ranges to read first.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Format`] if the file is damaged or not whole, [`Error::Unsupported`] if it needs a
    /// newer reader,
    /// [`Error::Limit`]; [`Error::Query`] if it holds a mesh.
    pub fn new(opener: &Opener) -> Result<Self> {
        let header = opener.header()?;
        if header.section(kind::HEIGHTS).is_none() {
            let what = "this file holds a mesh, not a grid of heights; open it with lodpack::File";
            return Err(Error::Query { what: what.into() });
        }
        let index = *header.required_section(kind::HEIGHT_INDEX)?;
        let pages = *header.required_section(kind::PAGES)?;
        let end = || "end of the file".to_string();
        match pages.offset.checked_add(pages.length) {
            Some(end) if end == opener.size() => {}
            Some(last) if last < opener.size() => {
                return Err(Error::format("there are bytes after the last section").at(end));
            }
            _ => return Err(Error::format("the file is truncated").at(end)),
        }
        let sections = [kind::SOURCE, kind::PLACEMENT, kind::TABLES, kind::HEIGHTS, kind::RAMP];
        let needed = opener.need(sections.into_iter().filter_map(|kind| header.section(kind)));
        needed.map_err(|error| with_first_pages(error, opener, &index))?;
        let tables = opener.parse(&header, kind::TABLES, Tables::parse)?;
        let limits = *opener.limits();
        let section = opener.parse(&header, kind::HEIGHTS, |bytes| HeightsSection::parse(bytes, &limits))?;
        let source_info = header.section(kind::SOURCE).map(|_| opener.parse(&header, kind::SOURCE, parse_source));
        let placement =
            header.section(kind::PLACEMENT).map(|_| opener.parse(&header, kind::PLACEMENT, Placement::parse));
        let ramp = header.section(kind::RAMP).map(|_| opener.parse(&header, kind::RAMP, Ramp::parse));
        let mut this = Self {
            limits,
            info: section.info,
            source_info: source_info.transpose()?,
            placement: placement.transpose()?,
            ramp: ramp.transpose()?,
            id: header.id,
            version: header.version,
            tables,
            index,
            pages,
            roots: Vec::new(),
            root_blocks: HashMap::new(),
            known: Mutex::default(),
            head: opener.fetched().clone(),
        };
        match this.find_roots(&section.pages, section.blocks) {
            Err(Error::Missing { ranges }) => Err(Error::Missing {
                ranges: ranges.into_iter().map(|range| opener.fetched().rest_of(range)).collect(),
            }),
            found => found.map(|()| this),
        }
    }

    /// Takes the first pages, and hands out the blocks of their tiles.
    fn find_roots(&mut self, pages: &[Part], blocks: Vec<u8>) -> Result<()> {
        let roots: Vec<(TileId, Part)> = self.info.grid.root_tiles().zip(pages.iter().copied()).collect();
        let roots = roots.into_iter().filter(|(_, part)| part.length > 0);
        let wanted: Vec<WantedPage> =
            roots.map(|(top, part)| WantedPage { top, part, coarser: f64::INFINITY }).collect();
        self.take_pages(&wanted, &Fetched::default())?;
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

    /// What the file says about all of it.
    pub fn info(&self) -> &HeightsInfo {
        &self.info
    }

    /// What tells this file from others.
    pub fn id(&self) -> FileId {
        self.id
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

    /// The colours to draw it with, if the file has some.
    pub fn ramp(&self) -> Option<&Ramp> {
        self.ramp.as_ref()
    }

    /// Major and minor version of the format.
    pub fn version(&self) -> (u16, u16) {
        self.version
    }

    /// The tiles at depth 0. One that draws nothing is not there.
    pub fn roots(&self) -> &[TileId] {
        &self.roots
    }

    /// A box around everything, in space; none if there is nothing. It is the closer the more of the index is known.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        if let (Base::Ellipsoid { axis, eccentricity }, true, [true, true]) =
            (self.surface().base, self.grid().wraps(), self.grid().poles())
        {
            let record = |&root: &TileId| Some(self.known_page(root)?.top()?.record.clone());
            let height = |record: TileRecord| {
                self.info.height(record.highest) * self.surface().height_scale + 2.0 * record.finest_error()
            };
            let highest = self.roots.iter().filter_map(record).map(height).fold(0.0, f64::max);
            let high = [axis, axis, axis * (1.0 - eccentricity).sqrt()].map(|half| half + highest);
            return (!self.roots.is_empty()).then_some([high.map(|x| -x), high]);
        }
        let mut bounds: Option<[[f64; 3]; 2]> = None;
        for &root in &self.roots {
            self.known_page(root)?.for_each_deepest(|record| {
                let [low, high] = tile_box(self, record).bounds();
                let [least, most] = bounds.unwrap_or([low, high]);
                bounds = Some([[0, 1, 2].map(|k| least[k].min(low[k])), [0, 1, 2].map(|k| most[k].max(high[k]))]);
            });
        }
        bounds
    }

    /// How many tiles are in the index pages that have been read.
    pub fn known_tile_count(&self) -> u64 {
        lock(&self.known).tile_count()
    }

    /// A tile laid out in space. `coarsest` is the largest tolerance that it will be drawn at.
    pub fn draw(&self, id: TileId, tile: &TileValues, coarsest: f64) -> DrawnTile {
        DrawnTile::new(&self.info.grid, &self.info.surface, [self.info.zero, self.info.step], (id, tile), coarsest)
    }

    /// A part of the index as a range of the file.
    pub(crate) fn page_range(&self, page: &WantedPage) -> Result<Range<u64>> {
        let range = range_in(&self.index, page.part.offset, page.part.length);
        range.map_err(|error| error.at(|| format!("index page of tile {}", page.top.name())))
    }

    /// Takes pages from what was fetched, or came with opening. [`Error::Missing`] if some are in neither; the others
    /// are then kept.
    pub(crate) fn take_pages(&self, wanted: &[WantedPage], fetched: &Fetched) -> Result<()> {
        let mut missing = Vec::new();
        for page in wanted.iter().filter(|page| self.known_page(page.top).is_none()) {
            let range = self.page_range(page)?;
            match self.head.get(range.clone()).or_else(|| fetched.get(range.clone())) {
                Some(bytes) => self.take_page(page, bytes)?,
                None => missing.push(range),
            }
        }
        if missing.is_empty() { Ok(()) } else { Err(Error::Missing { ranges: plan(missing) }) }
    }

    fn take_page(&self, page: &WantedPage, bytes: &[u8]) -> Result<()> {
        let parse = || {
            if !has_checksum(bytes, page.part.checksum) {
                return Err(Error::format("the checksum does not match"));
            }
            let HeightsInfo { grid, surface, sample_error, .. } = &self.info;
            let level = LevelErrors::new(grid, surface, *sample_error);
            Page::parse(bytes, (page.top, page.coarser), (grid, level), &self.limits)
        };
        let parsed = parse().map_err(|error| error.at(|| format!("index page of tile {}", page.top.name())))?;
        // Otherwise a small file could have as many tiles as its grid has room for.
        match lock(&self.known).add(page, parsed) <= self.index.length {
            true => Ok(()),
            false => Err(Error::format("index pages overlap").at(|| "section height index".to_string())),
        }
    }

    /// Where a block is in the file; none if it came with opening, or has no bytes.
    pub(crate) fn block_range(&self, entry: &Entry) -> Result<Option<Range<u64>>> {
        if entry.record.id.depth == 0 || entry.block.length == 0 {
            return Ok(None);
        }
        let range = range_in(&self.pages, entry.block.offset, entry.block.length);
        range.map(Some).map_err(|error| error.at(|| format!("block of tile {}", entry.record.id.name())))
    }

    /// A tile from its parent and its block, which is empty where [`HeightsIndex::block_range`] returns none. None
    /// where nothing is drawn.
    pub(crate) fn decode(
        &self,
        id: TileId,
        place: &Place,
        parent: Option<&TileValues>,
        block: &[u8],
    ) -> Result<Option<TileValues>> {
        let tile = match (place, parent) {
            (Place::Implied, Some(parent)) => implied_tile(&self.info.grid, id, parent),
            (Place::Here(entry), _) => self.decode_block(entry, parent, block),
            (Place::Nothing, _) | (Place::Implied, None) => return Ok(None),
        };
        tile.map(Some).map_err(|error| error.at(|| format!("block of tile {}", id.name())))
    }

    fn decode_block(&self, entry: &Entry, parent: Option<&TileValues>, block: &[u8]) -> Result<TileValues> {
        let id = entry.record.id;
        let block = self.root_blocks.get(&id).map_or(block, Vec::as_slice);
        if !block.is_empty() && !has_checksum(block, entry.record.checksum) {
            return Err(Error::format("the checksum does not match"));
        }
        decode_tile(&self.info.grid, id, parent, entry.record.is_partial, (&self.tables, block))
    }
}

/// Asks for the first index pages, too, if anything is missing: they are needed next.
fn with_first_pages(error: Error, opener: &Opener, index: &Section) -> Error {
    let Error::Missing { mut ranges } = error else { return error };
    let end = index.offset.saturating_add(index.length.min(FIRST_PAGES_BYTES)).min(opener.size());
    ranges.push(opener.fetched().rest_of(index.offset.min(end)..end));
    Error::Missing { ranges: plan(ranges) }
}

/// A part of a section as a range of the file.
fn range_in(section: &Section, offset: u64, length: u64) -> Result<Range<u64>> {
    if offset.checked_add(length).is_none_or(|end| end > section.length) {
        return Err(Error::format("a part is not within its section"));
    }
    Ok(section.offset + offset..section.offset + offset + length)
}
