//! The content of a file of heights for a loader: blocks of tiles, each of which is decoded from its parent.

use std::{
    collections::BTreeMap,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use crate::{
    codec::bytes::has_checksum,
    error::{Error, Result},
    heights::{Covering, HeightsIndex, ImageId, Place, ReadyTile, TileId, TileRecord, WantedPage},
    source::{Fetched, requests::plan},
    stream::{job::Content, queue::ByteSpan},
};

/// Bytes of a file of heights that are read together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum HeightsPage {
    /// The block of a tile.
    Block(TileId),
    /// A scale of a tile of the image over the heights.
    Image(ImageId, u8),
}

/// A file of heights, as far as its index is known.
#[derive(Debug)]
pub(crate) struct HeightsContent {
    index: Arc<HeightsIndex>,
    /// The most texels of the image over the heights for each sample of a tile.
    most_texels: u32,
    /// What was read of directories of images, until they are all there that a tile waits for.
    directories: Mutex<Fetched>,
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
    /// `most_texels` are those of the image over the heights for each sample of a tile, along each direction.
    pub fn new(index: Arc<HeightsIndex>, most_texels: u32) -> Self {
        Self { index, most_texels, directories: Mutex::default(), pages: Mutex::default() }
    }

    /// The streams of the image over a tile, with the ranges where they are.
    fn image_streams(&self, tile: &TileRecord) -> Result<Vec<(ImageId, u8, Range<u64>)>> {
        let Some(covering) = Covering::of(&self.index, tile, self.most_texels) else { return Ok(vec![]) };
        let mut directories = self.directories();
        let streams = self.index.drape_streams(covering.window(), &directories);
        if !matches!(streams, Err(Error::Missing { .. })) {
            // The index keeps what they say; what is not sound is read again when it is asked for again.
            *directories = Fetched::default();
        }
        streams
    }

    fn directories(&self) -> MutexGuard<'_, Fetched> {
        self.directories.lock().unwrap_or_else(PoisonError::into_inner)
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
    type Page = HeightsPage;
    type Unit = TileId;
    type Data = ReadyTile;

    fn pages(&self, unit: TileId) -> Result<Vec<HeightsPage>> {
        let Place::Here(entry) = self.place(unit)? else { return Ok(Vec::new()) };
        let block = self.index.block_range(&entry)?.map(|_| HeightsPage::Block(unit));
        let images = self.image_streams(&entry.record)?.into_iter();
        Ok(block.into_iter().chain(images.map(|(id, scale, _)| HeightsPage::Image(id, scale))).collect())
    }

    fn supply(&self, offset: u64, bytes: Vec<u8>) {
        let range = offset..offset.saturating_add(bytes.len() as u64);
        let mut fetched = Fetched::default();
        if self.index.drape().is_some() {
            // Units that wait for directories of images ask for them at once.
            self.directories().insert(offset, bytes.clone());
        }
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

    fn span(&self, page: HeightsPage) -> ByteSpan {
        let range = match page {
            HeightsPage::Block(tile) => match self.index.find(tile) {
                Ok(Place::Here(entry)) => self.index.block_range(&entry).ok().flatten(),
                _ => None,
            },
            HeightsPage::Image(id, scale) => self.index.drape_stream(id, scale).map(|(range, _)| range),
        };
        range.map_or(ByteSpan::default(), |range| ByteSpan { offset: range.start, length: range.end - range.start })
    }

    fn is_sound(&self, page: HeightsPage, bytes: &[u8]) -> bool {
        match page {
            HeightsPage::Block(tile) => {
                matches!(self.index.find(tile), Ok(Place::Here(entry)) if has_checksum(bytes, entry.record.checksum))
            }
            HeightsPage::Image(id, scale) => {
                self.index.drape_stream(id, scale).is_some_and(|(_, checksum)| has_checksum(bytes, checksum))
            }
        }
    }

    fn is_pinned(&self, unit: TileId) -> bool {
        unit.depth == 0
    }

    fn base(&self, unit: TileId) -> Option<TileId> {
        unit.parent()
    }

    fn decode(&self, unit: TileId, pages: &[(HeightsPage, Arc<[u8]>)], base: Option<&ReadyTile>) -> Result<ReadyTile> {
        let place = self.place(unit)?;
        let nothing = || Error::format("a tile is not there").at(|| format!("tile {}", unit.name()));
        let Place::Here(entry) = &place else { return Err(nothing()) };
        let block = pages.iter().find(|(page, _)| matches!(page, HeightsPage::Block(_)));
        let block = block.map_or(&[][..], |(_, bytes)| bytes);
        let values = self.index.decode(unit, &place, base.map(|base| &base.values), block)?.ok_or_else(nothing)?;
        let mut ready = ReadyTile::new(&self.index, unit, values, &entry.record.resolutions);
        let Some(covering) = Covering::of(&self.index, &entry.record, self.most_texels) else { return Ok(ready) };
        let mut fetched = Fetched::default();
        for (id, scale, range) in self.image_streams(&entry.record)? {
            let bytes = pages.iter().find(|(page, _)| *page == HeightsPage::Image(id, scale));
            if let Some((_, bytes)) = bytes {
                fetched.insert(range.start, bytes.to_vec());
            }
        }
        let image = self.index.drape_image(covering.window(), &fetched)?;
        ready.colours = Some(covering.colours(&self.index, &ready.values, &image));
        Ok(ready)
    }

    fn byte_count(&self, data: &ReadyTile) -> u64 {
        data.byte_count()
    }

    fn page_name(&self, page: HeightsPage) -> String {
        match page {
            HeightsPage::Block(tile) => format!("block of tile {}", tile.name()),
            HeightsPage::Image(id, _) => format!("image {}", id.name()),
        }
    }

    fn unit_name(&self, unit: TileId) -> String {
        format!("tile {}", unit.name())
    }
}
