//! The content of a file of heights for a loader: blocks of tiles, each of which is decoded from its parent.

use std::{
    collections::BTreeMap,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use crate::{
    codec::bytes::has_checksum,
    error::{Error, Result},
    heights::{HeightsIndex, Place, ReadyTile, TileId, WantedPage},
    source::{Fetched, requests::plan},
    stream::{job::Content, queue::ByteSpan},
};

/// A file of heights, as far as its index is known.
#[derive(Debug)]
pub(crate) struct HeightsContent {
    index: Arc<HeightsIndex>,
    /// Index pages that are waited for.
    pages: Mutex<WaitingPages>,
}

#[derive(Debug, Default)]
struct WaitingPages {
    /// By where they begin.
    wanted: BTreeMap<u64, (WantedPage, Range<u64>)>,
    /// What is read at once.
    joined: Vec<Range<u64>>,
    /// Why a page cannot be used, by its tile.
    failed: BTreeMap<TileId, String>,
}

impl HeightsContent {
    pub fn new(index: Arc<HeightsIndex>) -> Self {
        Self { index, pages: Mutex::default() }
    }

    pub fn index(&self) -> &Arc<HeightsIndex> {
        &self.index
    }

    fn pages(&self) -> MutexGuard<'_, WaitingPages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says which index pages a frame lacks, so that those near each other are read at once.
    pub fn want_pages(&self, pages: &[WantedPage]) {
        let mut waiting = self.pages();
        let mut new = Vec::new();
        for page in pages {
            let Ok(range) = self.index.page_range(page) else { continue };
            if !waiting.joined.iter().any(|joined| joined.start <= range.start && range.end <= joined.end) {
                new.push(range.clone());
            }
            waiting.wanted.insert(range.start, (*page, range));
        }
        waiting.joined.extend(plan(new));
    }

    /// Forgets which pages were not sound.
    pub fn retry(&self) {
        self.pages().failed.clear();
    }

    /// Where a tile is.
    fn place(&self, id: TileId) -> Result<Place> {
        let page = match self.index.find(id) {
            Ok(place) => return Ok(place),
            Err(page) => page,
        };
        let range = self.index.page_range(&page)?;
        let mut waiting = self.pages();
        if let Some(what) = waiting.failed.get(&page.top) {
            return Err(Error::Query { what: what.clone() });
        }
        waiting.wanted.insert(range.start, (page, range.clone()));
        let joined = waiting.joined.iter().find(|joined| joined.start <= range.start && range.end <= joined.end);
        Err(Error::Missing { ranges: vec![joined.cloned().unwrap_or(range)] })
    }
}

impl Content for HeightsContent {
    type Page = TileId;
    type Unit = TileId;
    type Data = ReadyTile;

    fn pages(&self, unit: TileId) -> Result<Vec<TileId>> {
        match self.place(unit)? {
            Place::Here(entry) => Ok(self.index.block_range(&entry)?.map(|_| unit).into_iter().collect()),
            _ => Ok(Vec::new()),
        }
    }

    fn supply(&self, offset: u64, bytes: Vec<u8>) {
        let range = offset..offset.saturating_add(bytes.len() as u64);
        let mut fetched = Fetched::default();
        fetched.insert(offset, bytes);
        let mut waiting = self.pages();
        waiting.joined.retain(|joined| joined.start < range.start || joined.end > range.end);
        let pages: Vec<(WantedPage, Range<u64>)> =
            waiting.wanted.range(range.clone()).map(|(_, page)| page.clone()).collect();
        for (page, place) in pages.into_iter().filter(|(_, place)| place.end <= range.end) {
            waiting.wanted.remove(&place.start);
            if let Err(error) = self.index.take_pages(&[page], &fetched) {
                waiting.failed.insert(page.top, error.to_string());
            }
        }
    }

    fn span(&self, page: TileId) -> ByteSpan {
        let range = match self.index.find(page) {
            Ok(Place::Here(entry)) => self.index.block_range(&entry).ok().flatten(),
            _ => None,
        };
        range.map_or(ByteSpan::default(), |range| ByteSpan { offset: range.start, length: range.end - range.start })
    }

    fn is_sound(&self, page: TileId, bytes: &[u8]) -> bool {
        matches!(self.index.find(page), Ok(Place::Here(entry)) if has_checksum(bytes, entry.record.checksum))
    }

    fn is_pinned(&self, unit: TileId) -> bool {
        unit.depth == 0
    }

    fn base(&self, unit: TileId) -> Option<TileId> {
        unit.parent()
    }

    fn decode(&self, unit: TileId, pages: &[(TileId, Arc<[u8]>)], base: Option<&ReadyTile>) -> Result<ReadyTile> {
        let place = self.place(unit)?;
        let nothing = || Error::format("a tile is not there").at(|| format!("tile {}", unit.name()));
        let Place::Here(entry) = &place else { return Err(nothing()) };
        let block = pages.first().map_or(&[][..], |(_, bytes)| bytes);
        let values = self.index.decode(unit, &place, base.map(|base| &base.values), block)?.ok_or_else(nothing)?;
        Ok(ReadyTile::new(&self.index, unit, values, &entry.record.resolutions))
    }

    fn byte_count(&self, data: &ReadyTile) -> u64 {
        data.byte_count()
    }

    fn page_name(&self, page: TileId) -> String {
        format!("block of tile {}", page.name())
    }

    fn unit_name(&self, unit: TileId) -> String {
        format!("tile {}", unit.name())
    }
}
