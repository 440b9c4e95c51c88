//! An open file of heights.

use std::{
    collections::HashMap,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{
    codec::{decode_tile, implied_tile},
    drawn::{DrawnTile, TileValues},
    grid::{Grid, TileId},
    page::{Entry, Found, MOST_PART_BYTES, Page, TileRecord},
    section::{HeightsInfo, HeightsSection},
    surface::Surface,
};
use crate::{
    codec::{bytes::has_checksum, entropy::Tables},
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
/// Tiles that are kept decoded: about 4 MB.
const KEPT_TILES: usize = 256;
/// Tiles whose blocks are read at once.
const TILES_AT_ONCE: usize = 1024;

/// An open file of heights, and a source from which it reads what an answer needs. It keeps index pages, and the tiles used last.
#[derive(Debug)]
pub struct Heights<S> {
    source: S,
    limits: Limits,
    info: HeightsInfo,
    source_info: Option<SourceInfo>,
    placement: Option<Placement>,
    tables: Tables,
    index: Section,
    pages: Section,
    /// The tiles at depth 0 that the file has.
    roots: Vec<TileId>,
    /// Their blocks.
    root_blocks: HashMap<TileId, Vec<u8>>,
    known: Mutex<KnownPages>,
    tiles: Mutex<KeptTiles>,
    head: Fetched,
}

#[derive(Debug, Default)]
struct KnownPages {
    pages: HashMap<TileId, Arc<Page>>,
    bytes: u64,
}

#[derive(Debug, Default)]
struct KeptTiles {
    tiles: HashMap<TileId, (u64, Arc<TileValues>)>,
    uses: u64,
}

/// A page that is to be read.
#[derive(Clone, Copy, Debug)]
pub(super) struct WantedPage {
    pub top: TileId,
    pub part: Part,
    /// The error of the tile above it.
    pub coarser: f64,
}

/// What a file knows of a tile.
#[derive(Clone, Debug)]
pub(super) enum Place {
    /// It has this tile.
    Here(Entry),
    /// Its heights follow from those of an ancestor.
    Implied(TileId),
    /// Nothing is drawn there.
    Nothing,
}

/// No answer depends on what another thread did while it panicked: maps only grow by whole entries.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
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
            return Err(Error::Query { what: "this file holds a mesh, not a grid of heights; open it with lodpack::File".into() });
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
        let wanted: Vec<WantedPage> = roots.map(|(top, part)| WantedPage { top, part, coarser: f64::INFINITY }).collect();
        self.load_pages(&wanted)?;
        let mut rest = blocks.as_slice();
        let wrong = || Error::format("the blocks of the first tiles do not have their lengths").at(|| "section heights".to_string());
        for WantedPage { top, .. } in wanted {
            let Some(page) = self.known_page(top) else { continue };
            let length = page.top().map_or(0, |entry| entry.record.block_bytes);
            let (block, others) = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length)).ok_or_else(wrong)?;
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

    /// A tile laid out in space.
    pub fn draw(&self, id: TileId, tile: &TileValues) -> DrawnTile {
        DrawnTile::new(&self.info.grid, &self.info.surface, [self.info.zero, self.info.step], id, tile)
    }

    /// Where a tile is. Reads the pages on the way to it.
    pub(super) fn place(&self, id: TileId) -> Result<Place> {
        if !self.info.grid.has(id) {
            return Ok(Place::Nothing);
        }
        let mut top = id.ancestor(0);
        loop {
            let Some(page) = self.known_page(top) else { return Ok(Place::Nothing) };
            match page.find(id) {
                Some(Found::Here(entry)) => return Ok(Place::Here(entry.clone())),
                Some(Found::Missing(above)) if above.record.children == 0 => {
                    return Ok(Place::Implied(above.record.id));
                }
                Some(Found::Below { top: below, part, coarser }) => {
                    self.load_pages(&[WantedPage { top: below, part, coarser }])?;
                    top = below;
                }
                _ => return Ok(Place::Nothing),
            }
        }
    }

    /// The page between a tile and the tile below it, if it is not known yet.
    pub(super) fn missing_page(&self, id: TileId) -> Option<WantedPage> {
        let mut top = id.ancestor(0);
        loop {
            match self.known_page(top)?.find(id) {
                Some(Found::Below { top: below, part, coarser }) if self.known_page(below).is_none() => {
                    return Some(WantedPage { top: below, part, coarser });
                }
                Some(Found::Below { top: below, .. }) => top = below,
                _ => return None,
            }
        }
    }

    fn known_page(&self, top: TileId) -> Option<Arc<Page>> {
        lock(&self.known).pages.get(&top).cloned()
    }

    /// Reads pages, as far as they are not there yet, with few requests.
    pub(super) fn load_pages(&self, wanted: &[WantedPage]) -> Result<()> {
        let wanted: Vec<&WantedPage> = wanted.iter().filter(|page| self.known_page(page.top).is_none()).collect();
        let range = |page: &WantedPage| self.range(&self.index, page.part.offset, page.part.length);
        let ranges: Vec<Range<u64>> = wanted
            .iter()
            .map(|page| range(page).map_err(|error| error.at(|| format!("index page of tile {}", page.top.name()))))
            .collect::<Result<_>>()?;
        let fetched = self.fetch(&ranges)?;
        for (page, range) in wanted.into_iter().zip(ranges) {
            let parse = || {
                let bytes = self.get(&fetched, range)?;
                if !has_checksum(bytes, page.part.checksum) {
                    return Err(Error::format("the checksum does not match"));
                }
                Page::parse(bytes, (page.top, page.coarser), &self.info.grid)
            };
            let parsed = parse().map_err(|error| error.at(|| format!("index page of tile {}", page.top.name())))?;
            let mut known = lock(&self.known);
            if known.pages.insert(page.top, Arc::new(parsed)).is_none() {
                known.bytes += page.part.length;
            }
            // Otherwise a small file could have as many tiles as its grid has room for.
            if known.bytes > self.index.length {
                return Err(Error::format("index pages overlap").at(|| "section height index".to_string()));
            }
        }
        Ok(())
    }

    /// A part of a section as a range of the file.
    fn range(&self, section: &Section, offset: u64, length: u64) -> Result<Range<u64>> {
        if offset.checked_add(length).is_none_or(|end| end > section.length) || length > MOST_PART_BYTES {
            return Err(Error::format("a part is not within its section, or has more than 65,536 bytes"));
        }
        Ok(section.offset + offset..section.offset + offset + length)
    }

    /// Reads ranges, as far as they did not come with opening.
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Fetched> {
        let mut fetched = Fetched::default();
        let new = plan(ranges.iter().filter(|&range| self.head.get(range.clone()).is_none()).cloned());
        read_ranges(&self.source, &new)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
        Ok(fetched)
    }

    fn get<'a>(&'a self, fetched: &'a Fetched, range: Range<u64>) -> Result<&'a [u8]> {
        let found = self.head.get(range.clone()).or_else(|| fetched.get(range));
        found.ok_or_else(|| Error::format("the file is truncated"))
    }

    /// Hands out the samples of tiles, in an order of its own; a tile that draws nothing is left out. Tiles above them are decoded once.
    pub(super) fn for_each_tile(
        &self,
        ids: &[TileId],
        mut with: impl FnMut(TileId, &Arc<TileValues>) -> Result<()>,
    ) -> Result<()> {
        let mut ids = ids.to_vec();
        ids.sort_unstable_by_key(|id| id.along_z(self.info.grid.depth()));
        for ids in ids.chunks(TILES_AT_ONCE) {
            let mut entries = HashMap::new();
            let mut ranges = Vec::new();
            let wanted: Vec<WantedPage> = self.pages_of(ids)?;
            debug_assert!(wanted.is_empty());
            for id in ids {
                let places = (0..=id.depth).map(|depth| id.ancestor(depth));
                for id in places {
                    if entries.contains_key(&id) {
                        continue;
                    }
                    let place = self.place(id)?;
                    if let Place::Here(entry) = &place {
                        let is_kept = id.depth == 0 || lock(&self.tiles).tiles.contains_key(&id);
                        if !is_kept && entry.block.length > 0 {
                            ranges.push(self.block_range(entry)?);
                        }
                    }
                    entries.insert(id, place);
                }
            }
            let fetched = self.fetch(&ranges)?;
            let mut path: Vec<(TileId, Arc<TileValues>)> = Vec::new();
            for &id in ids {
                while path.last().is_some_and(|(above, _)| id.depth < above.depth || id.ancestor(above.depth) != *above) {
                    path.pop();
                }
                for depth in path.len() as u32..=id.depth {
                    let id = id.ancestor(depth);
                    let Some(place) = entries.get(&id) else { break };
                    let parent = path.last().map(|(_, tile)| tile.as_ref());
                    match self.decode(id, place, parent, &fetched)? {
                        Some(tile) => path.push((id, tile)),
                        None => break,
                    }
                }
                if let Some((found, tile)) = path.last() && *found == id {
                    with(id, tile)?;
                }
            }
        }
        Ok(())
    }

    /// Reads all pages on the way to tiles, depth by depth.
    fn pages_of(&self, ids: &[TileId]) -> Result<Vec<WantedPage>> {
        loop {
            let mut wanted: Vec<WantedPage> = ids.iter().filter_map(|&id| self.missing_page(id)).collect();
            wanted.sort_unstable_by_key(|page| page.part.offset);
            wanted.dedup_by_key(|page| page.top);
            if wanted.is_empty() {
                return Ok(wanted);
            }
            self.load_pages(&wanted)?;
        }
    }

    fn block_range(&self, entry: &Entry) -> Result<Range<u64>> {
        let range = self.range(&self.pages, entry.block.offset, entry.block.length);
        range.map_err(|error| error.at(|| format!("block of tile {}", entry.record.id.name())))
    }

    /// A tile from its parent.
    fn decode(
        &self,
        id: TileId,
        place: &Place,
        parent: Option<&TileValues>,
        fetched: &Fetched,
    ) -> Result<Option<Arc<TileValues>>> {
        if let Some(tile) = lock(&self.tiles).get(id) {
            return Ok(Some(tile));
        }
        let location = || format!("block of tile {}", id.name());
        let tile = match (place, parent) {
            (Place::Nothing, _) => return Ok(None),
            (Place::Implied(_), Some(parent)) => implied_tile(&self.info.grid, id, parent),
            (Place::Implied(_), None) => return Ok(None),
            (Place::Here(entry), _) => (|| {
                let block = match self.root_blocks.get(&id) {
                    Some(block) => block,
                    None if entry.block.length == 0 => &[][..],
                    None => self.get(fetched, self.block_range(entry)?)?,
                };
                if !block.is_empty() && !has_checksum(block, entry.record.checksum) {
                    return Err(Error::format("the checksum does not match"));
                }
                decode_tile(&self.info.grid, id, parent, entry.record.is_partial, (&self.tables, block))
            })(),
        };
        let tile = Arc::new(tile.map_err(|error| error.at(location))?);
        lock(&self.tiles).keep(id, &tile);
        Ok(Some(tile))
    }
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
