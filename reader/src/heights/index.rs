//! What is known of an open file of heights without reading: the whole, and the index pages that have been read.

use std::{collections::HashMap, ops::Range, sync::Mutex};

use super::{
    bounds::tile_box,
    codec::{decode_tile, implied_tile},
    drape::{Drape, DrapeImage, DrapeWindow, HEAD_BYTES, ImageId, OpenDrape},
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
/// The head of the image over the heights, and its first directories.
const FIRST_DRAPE_BYTES: u64 = 4 << 10;

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
    drape: Option<OpenDrape>,
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
    pub(crate) head: Fetched,
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
        let drape = header.section(kind::DRAPE).copied();
        needed
            .and_then(|()| head_of(opener, drape).map(drop))
            .map_err(|error| with_first_pages(error, opener, &index, drape))?;
        let tables = opener.parse(&header, kind::TABLES, Tables::parse)?;
        let limits = *opener.limits();
        let section = opener.parse(&header, kind::HEIGHTS, |bytes| HeightsSection::parse(bytes, &limits))?;
        let source_info = header.section(kind::SOURCE).map(|_| opener.parse(&header, kind::SOURCE, parse_source));
        let placement =
            header.section(kind::PLACEMENT).map(|_| opener.parse(&header, kind::PLACEMENT, Placement::parse));
        let ramp = header.section(kind::RAMP).map(|_| opener.parse(&header, kind::RAMP, Ramp::parse));
        let location = || "section drape".to_string();
        let drape =
            drape.zip(head_of(opener, drape)?).map(|(section, bytes)| OpenDrape::parse(bytes, section, &limits));
        let mut this = Self {
            limits,
            info: section.info,
            source_info: source_info.transpose()?,
            placement: placement.transpose()?,
            ramp: ramp.transpose()?,
            drape: drape.transpose().map_err(|error| error.at(location))?,
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

    /// The image over it, if the file has one.
    pub fn drape(&self) -> Option<&Drape> {
        self.drape.as_ref().map(OpenDrape::drape)
    }

    /// Bytes of the file that the image takes; 0 if there is none.
    pub fn drape_bytes(&self) -> u64 {
        self.drape.as_ref().map_or(0, OpenDrape::bytes)
    }

    /// The texels of a window of the image over it, from bytes that were fetched or came with opening. What it reads of
    /// the index of images stays, and so do decoded images, up to 64 MB.
    ///
    /// # Errors
    /// [`Error::Missing`] until everything needed has been read; [`Error::Query`] if there is no image, or the window
    /// has more texels than [`Limits::texel_count`]; [`Error::Format`], [`Error::Limit`].
    pub fn drape_image(&self, window: &DrapeWindow, fetched: &Fetched) -> Result<DrapeImage> {
        let no_image = || Error::Query { what: "the file has no image over its heights".into() };
        match self.open_drape().ok_or_else(no_image)?.image(window, [&self.head, fetched]) {
            Err(Error::Missing { ranges }) => Err(Error::Missing { ranges: plan(ranges) }),
            image => image,
        }
    }

    /// The streams that a window of the image takes, and where they are, from directories that were fetched or are
    /// known.
    pub(crate) fn drape_streams(
        &self,
        window: &DrapeWindow,
        fetched: &Fetched,
    ) -> Result<Vec<(ImageId, u8, Range<u64>)>> {
        let Some(drape) = &self.drape else { return Ok(vec![]) };
        match drape.streams(window, [&self.head, fetched]) {
            Err(Error::Missing { ranges }) => Err(Error::Missing { ranges: plan(ranges) }),
            streams => streams,
        }
    }

    /// Where a stream is, and its checksum, if its directory is known.
    pub(crate) fn drape_stream(&self, id: ImageId, scale: u8) -> Option<(Range<u64>, u32)> {
        self.drape.as_ref()?.stream(id, scale)
    }

    /// Where the section of the image is.
    #[cfg(test)]
    pub(crate) fn drape_range(&self) -> Option<Range<u64>> {
        self.drape.as_ref().map(OpenDrape::section_range)
    }

    pub(crate) fn open_drape(&self) -> Option<&OpenDrape> {
        self.drape.as_ref()
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

/// The head of the image over the heights, if there is one.
fn head_of(opener: &Opener, drape: Option<Section>) -> Result<Option<&[u8]>> {
    let Some(Section { offset, length, .. }) = drape else { return Ok(None) };
    if length < HEAD_BYTES as u64 {
        return Err(Error::format("the section ends within its head").at(|| "section drape".to_string()));
    }
    let range = offset..offset.saturating_add(HEAD_BYTES as u64);
    let missing = || Error::Missing { ranges: vec![opener.fetched().rest_of(range.clone())] };
    opener.fetched().get(range.clone()).ok_or_else(missing).map(Some)
}

/// Asks for the first index pages, too, if anything is missing: they are needed next. Likewise for the beginning of the
/// image over the heights.
fn with_first_pages(error: Error, opener: &Opener, index: &Section, drape: Option<Section>) -> Error {
    let Error::Missing { mut ranges } = error else { return error };
    if let Some(Section { offset, length, .. }) = drape {
        let end = offset.saturating_add(length.min(FIRST_DRAPE_BYTES)).min(opener.size());
        ranges.push(opener.fetched().rest_of(offset.min(end)..end));
    }
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
