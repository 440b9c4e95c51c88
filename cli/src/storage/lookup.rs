//! Positions and other numbers by their place in a file.

use std::cell::{Cell, RefCell};
use std::fs::File;
use std::path::Path;

use glam::DVec3;
use memmap2::{Mmap, UncheckedAdvice};

use super::{Record, WorkError};

/// Bytes that become resident with each page that is touched, because the system maps its surroundings too (Linux: fault-around).
const WINDOW_BYTES: usize = 1 << 16;
/// The most windows that may be resident: 32 MiB. Dropped pages come back from the system's cache.
const MAX_RESIDENT_WINDOWS: usize = 512;

/// A memory-mapped file of positions, or of other numbers. Its share of the process's memory is bounded, whatever is looked up.
#[derive(Debug)]
pub struct Lookup {
    map: Option<Mmap>,
    /// The windows that were touched since pages were last dropped.
    touched: RefCell<Vec<bool>>,
    touched_count: Cell<usize>,
}

impl Lookup {
    /// Maps a file that is complete, or only grows.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, WorkError> {
        let mapped = File::open(path).and_then(|file| {
            if file.metadata()?.len() == 0 {
                return Ok(None);
            }
            // SAFETY: the file lies in a directory that this process has made for itself under a name of its own, and
            // is only ever added to or removed as a whole while the map lives, neither of which changes mapped bytes.
            #[expect(unsafe_code, reason = "mapping a file is unsafe because other programs may change it meanwhile")]
            unsafe { Mmap::map(&file) }.map(Some)
        });
        let map = mapped.map_err(|source| WorkError::new(path, "read", source))?;
        let windows = map.as_ref().map_or(0, |map| map.len() / WINDOW_BYTES + 1);
        Ok(Self { map, touched: RefCell::new(vec![false; windows]), touched_count: Cell::new(0) })
    }

    /// No positions.
    pub fn empty() -> Self {
        Self { map: None, touched: RefCell::default(), touched_count: Cell::new(0) }
    }

    /// The number of positions.
    pub fn count(&self) -> u64 {
        self.map.as_ref().map_or(0, |map| (map.len() / DVec3::BYTES) as u64)
    }

    /// The position of a number.
    ///
    /// # Panics
    /// Where there is no such position.
    #[inline]
    pub fn position(&self, number: u32) -> DVec3 {
        let bytes: &[u8] = self.map.as_deref().unwrap_or_default();
        let at = number as usize * DVec3::BYTES;
        self.touch(at / WINDOW_BYTES);
        DVec3::get(&bytes[at..at + DVec3::BYTES])
    }

    /// Copies 32-bit numbers from a file of such numbers, beginning with a place.
    ///
    /// # Panics
    /// Where there are not so many.
    #[inline]
    pub fn floats(&self, place: u64, values: &mut [f32]) {
        let bytes: &[u8] = self.map.as_deref().unwrap_or_default();
        let at = place as usize * f32::BYTES;
        self.touch(at / WINDOW_BYTES);
        let from = &bytes[at..at + values.len() * f32::BYTES];
        values.iter_mut().zip(from.chunks_exact(f32::BYTES)).for_each(|(value, bytes)| *value = f32::get(bytes));
    }

    /// The number of 32-bit numbers.
    pub fn float_count(&self) -> u64 {
        self.map.as_ref().map_or(0, |map| (map.len() / f32::BYTES) as u64)
    }

    #[inline]
    fn touch(&self, window: usize) {
        let mut touched = self.touched.borrow_mut();
        if !touched[window] {
            if self.touched_count.get() == MAX_RESIDENT_WINDOWS {
                self.drop_pages();
                touched.fill(false);
                self.touched_count.set(0);
            }
            touched[window] = true;
            self.touched_count.set(self.touched_count.get() + 1);
        }
    }

    fn drop_pages(&self) {
        if let Some(map) = &self.map {
            // SAFETY: the map is a read-only, shared one of a file, so dropped pages come back from the file with the
            // same bytes; nothing has ever been written through it. A failure only leaves the pages where they are.
            #[expect(
                unsafe_code,
                reason = "dropping pages of a map would lose changes made through it; there are none"
            )]
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
        }
    }
}
