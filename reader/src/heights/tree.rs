//! The tree of tiles of an open file: which there are, and where their blocks are.

use std::{collections::HashMap, ops::Range, sync::Arc};

use super::{
    file::{Heights, lock},
    grid::TileId,
    page::{Entry, Found, Page},
};
use crate::{
    codec::bytes::has_checksum,
    error::{Error, Result},
    format::sections::Part,
    source::ReadAt,
};

/// Index pages that have been read.
#[derive(Debug, Default)]
pub(super) struct KnownPages {
    pages: HashMap<TileId, Arc<Page>>,
    bytes: u64,
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
    Implied,
    /// Nothing is drawn there.
    Nothing,
}

impl<S: ReadAt> Heights<S> {
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
                Some(Found::Missing(above)) if above.record.children == 0 => return Ok(Place::Implied),
                Some(Found::Below { top: below, part, coarser }) => {
                    self.load_pages(&[WantedPage { top: below, part, coarser }])?;
                    top = below;
                }
                _ => return Ok(Place::Nothing),
            }
        }
    }

    /// The page on the way to a tile that is not known yet, if there is one.
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

    /// Reads all pages on the way to tiles, four depths at once.
    pub(super) fn load_pages_of(&self, ids: &[TileId]) -> Result<()> {
        loop {
            let mut wanted: Vec<WantedPage> = ids.iter().filter_map(|&id| self.missing_page(id)).collect();
            if wanted.is_empty() {
                return Ok(());
            }
            wanted.sort_unstable_by_key(|page| page.top);
            wanted.dedup_by_key(|page| page.top);
            self.load_pages(&wanted)?;
        }
    }

    /// The page whose top is a tile, if it has been read.
    pub(super) fn known_page(&self, top: TileId) -> Option<Arc<Page>> {
        lock(&self.known).pages.get(&top).cloned()
    }

    /// Reads pages, as far as they are not there yet, with few requests.
    pub(super) fn load_pages(&self, wanted: &[WantedPage]) -> Result<()> {
        let location = |page: &WantedPage| format!("index page of tile {}", page.top.name());
        let wanted: Vec<&WantedPage> = wanted.iter().filter(|page| self.known_page(page.top).is_none()).collect();
        let range = |page: &&WantedPage| {
            let range = self.range(&self.index, page.part.offset, page.part.length);
            range.map_err(|error| error.at(|| location(page)))
        };
        let ranges: Vec<Range<u64>> = wanted.iter().map(range).collect::<Result<_>>()?;
        let fetched = self.fetch(&ranges)?;
        for (page, range) in wanted.into_iter().zip(ranges) {
            let parse = || {
                let bytes = self.get(&fetched, range)?;
                if !has_checksum(bytes, page.part.checksum) {
                    return Err(Error::format("the checksum does not match"));
                }
                Page::parse(bytes, (page.top, page.coarser), &self.info.grid, &self.limits)
            };
            let parsed = parse().map_err(|error| error.at(|| location(page)))?;
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
}
