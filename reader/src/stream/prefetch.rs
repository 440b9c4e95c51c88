//! Keeps track of what was prefetched and what of it was used (Correa 2004, section 4.5, limits the bytes of each
//! frame).

use super::job::Content;
use crate::sorted::{SortedMap, SortedSet};

/// Frames without prefetching, or without decoding prefetched pages, after the cache evicted some that no frame had
/// used.
const PAUSE: u64 = 30;

#[derive(Clone, Copy, Debug)]
struct Page {
    bytes: u64,
    /// Whether a unit was decoded from it that no frame had demanded.
    is_decoded: bool,
}

/// Prefetched pages, and units decoded from pages, that no frame has demanded yet.
#[derive(Debug)]
pub(crate) struct Prefetch<P, U> {
    frame: u64,
    /// Bytes that may still be prefetched in this frame.
    pub left: u64,
    reading_paused_until: u64,
    decoding_paused_until: u64,
    pages: SortedMap<P, Page>,
    units: SortedSet<U>,
}

impl<P: Copy + Ord, U: Copy + Ord> Prefetch<P, U> {
    pub fn new() -> Self {
        Self {
            frame: 0,
            left: 0,
            reading_paused_until: 0,
            decoding_paused_until: 0,
            pages: SortedMap::new(),
            units: SortedSet::new(),
        }
    }

    pub fn begin_frame(&mut self, frame: u64, bytes: u64) {
        self.frame = frame;
        self.left = bytes;
    }

    pub fn is_reading_paused(&self) -> bool {
        self.frame < self.reading_paused_until
    }

    pub fn is_decoding_paused(&self) -> bool {
        self.frame < self.decoding_paused_until
    }

    pub fn add_page(&mut self, page: P, bytes: u64) {
        self.pages.insert(page, Page { bytes, is_decoded: false });
    }

    /// Forgets a page that had to be read on demand after all.
    pub fn forget_page(&mut self, page: P) {
        self.pages.remove(&page);
    }

    /// Adds a decoded unit that no frame has demanded.
    pub fn add_unit<'p>(&mut self, unit: U, pages: impl IntoIterator<Item = &'p P>)
    where
        P: 'p,
    {
        self.units.insert(unit);
        for page in pages {
            if let Some(page) = self.pages.get_mut(page) {
                page.is_decoded = true;
            }
        }
    }

    /// Notes that a frame demands a page. Returns how many prefetched bytes this has used.
    pub fn use_page(&mut self, page: P) -> u64 {
        self.pages.remove(&page).map_or(0, |page| page.bytes)
    }

    /// As [`Prefetch::use_page`], for the pages of a decoded unit.
    pub fn use_unit(&mut self, unit: U, content: &impl Content<Page = P, Unit = U>) -> u64 {
        if !self.units.remove(&unit) {
            return 0;
        }
        let pages = content.pages(unit).unwrap_or_default();
        pages.into_iter().map(|page| self.use_page(page)).sum()
    }

    /// Notes that a page was evicted. If it has been decoded, it may still be used.
    pub fn page_evicted(&mut self, page: P) {
        if self.pages.get(&page).is_some_and(|page| !page.is_decoded) {
            self.pages.remove(&page);
            self.reading_paused_until = self.frame + PAUSE;
        }
    }

    /// Notes that a decoded unit was evicted.
    pub fn unit_evicted(&mut self, unit: U) {
        if self.units.remove(&unit) {
            self.decoding_paused_until = self.frame + PAUSE;
        }
    }
}
