//! The tree of tiles of an open file: which there are, and where their blocks are.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{
    file::Heights,
    grid::TileId,
    index::HeightsIndex,
    page::{Entry, Found, Page},
};
use crate::{
    error::{Error, Result},
    format::sections::Part,
    source::{ReadAt, read_ranges},
};

/// No answer depends on what another thread did while it panicked: maps only grow by whole entries.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Index pages that have been read.
#[derive(Debug, Default)]
pub(super) struct KnownPages {
    pages: HashMap<TileId, Arc<Page>>,
    bytes: u64,
}

impl KnownPages {
    /// Keeps a page. Returns the bytes of all pages.
    pub fn add(&mut self, WantedPage { top, part, .. }: &WantedPage, page: Page) -> u64 {
        if self.pages.insert(*top, Arc::new(page)).is_none() {
            self.bytes += part.length;
        }
        self.bytes
    }

    /// Tiles of all pages.
    pub fn tile_count(&self) -> u64 {
        self.pages.values().map(|page| page.tile_count() as u64).sum()
    }
}

/// A page that is to be read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WantedPage {
    pub top: TileId,
    pub part: Part,
    /// The error of the tile above it.
    pub coarser: f64,
}

/// What a file knows of a tile.
#[derive(Clone, Debug)]
pub(crate) enum Place {
    /// It has this tile.
    Here(Entry),
    /// Its heights follow from those of an ancestor.
    Implied,
    /// Nothing is drawn there.
    Nothing,
}

impl HeightsIndex {
    /// Where a tile is, or the page that has to be read to know.
    pub(crate) fn find(&self, id: TileId) -> Result<Place, WantedPage> {
        if !self.grid().has(id) {
            return Ok(Place::Nothing);
        }
        let mut top = id.ancestor(0);
        let mut on_the_way = None;
        loop {
            let Some(page) = self.known_page(top) else { return on_the_way.map_or(Ok(Place::Nothing), Err) };
            match page.find(id) {
                Some(Found::Here(entry)) => return Ok(Place::Here(entry.clone())),
                Some(Found::Level(entry)) => return Ok(Place::Here(entry)),
                Some(Found::Missing(above)) if above.record.children == 0 => return Ok(Place::Implied),
                Some(Found::Below { top: below, part, coarser }) => {
                    on_the_way = Some(WantedPage { top: below, part, coarser });
                    top = below;
                }
                _ => return Ok(Place::Nothing),
            }
        }
    }

    /// The page on the way to a tile that is not known yet, if there is one.
    pub(super) fn missing_page(&self, id: TileId) -> Option<WantedPage> {
        self.find(id).err()
    }

    /// The page whose top is a tile, if it has been read.
    pub(crate) fn known_page(&self, top: TileId) -> Option<Arc<Page>> {
        lock(&self.known).pages.get(&top).cloned()
    }
}

impl<S: ReadAt> Heights<S> {
    /// Where a tile is. Reads the pages on the way to it.
    pub(super) fn place(&self, id: TileId) -> Result<Place> {
        loop {
            match self.index().find(id) {
                Ok(place) => return Ok(place),
                Err(page) => self.load_pages(&[page])?,
            }
        }
    }

    /// Reads all pages on the way to tiles, four depths at once.
    pub(super) fn load_pages_of(&self, ids: &[TileId]) -> Result<()> {
        loop {
            let mut wanted: Vec<WantedPage> = ids.iter().filter_map(|&id| self.index().missing_page(id)).collect();
            if wanted.is_empty() {
                return Ok(());
            }
            wanted.sort_unstable_by_key(|page| page.top);
            wanted.dedup_by_key(|page| page.top);
            self.load_pages(&wanted)?;
        }
    }

    /// Reads pages, as far as they are not there yet, with few requests.
    fn load_pages(&self, wanted: &[WantedPage]) -> Result<()> {
        let mut fetched = crate::source::Fetched::default();
        match self.index().take_pages(wanted, &fetched) {
            Err(Error::Missing { ranges }) => {
                read_ranges(self.source(), &ranges)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
                self.index().take_pages(wanted, &fetched)
            }
            answer => answer,
        }
    }
}
