//! Positions and other numbers by their place in a file.

use std::cell::{Cell, RefCell};
use std::fs::File;
use std::path::Path;

use glam::DVec3;
use memmap2::{Mmap, UncheckedAdvice};

use super::{Record, WorkError};

/// Bytes that become resident with each page that is touched, because the system maps its surroundings too (Linux:
/// fault-around).
const WINDOW_BYTES: usize = 1 << 16;
/// The most windows that may be resident: 32 MiB. Dropped pages come back from the system's cache.
const MAX_RESIDENT_WINDOWS: usize = 512;

/// Which parts of a memory-mapped file were touched since its pages were last dropped, so that the file's share of the
/// process's memory is bounded, whatever is looked up.
#[derive(Debug, Default)]
pub struct Windows {
    touched: RefCell<Vec<bool>>,
    count: Cell<usize>,
}

impl Windows {
    /// None of a file of `bytes` bytes.
    pub fn new(bytes: usize) -> Self {
        Self { touched: RefCell::new(vec![false; bytes / WINDOW_BYTES + 1]), count: Cell::new(0) }
    }

    /// Notes that a place within the file is read, and calls `drop_pages` first where that would be too much.
    #[inline]
    pub fn touch(&self, at: usize, drop_pages: impl FnOnce()) {
        let (mut touched, window) = (self.touched.borrow_mut(), at / WINDOW_BYTES);
        if !touched[window] {
            if self.count.get() == MAX_RESIDENT_WINDOWS {
                drop_pages();
                touched.fill(false);
                self.count.set(0);
            }
            touched[window] = true;
            self.count.set(self.count.get() + 1);
        }
    }
}

/// A memory-mapped file of positions, or of other numbers.
#[derive(Debug)]
pub struct Lookup {
    map: Option<Mmap>,
    windows: Windows,
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
        let windows = Windows::new(map.as_ref().map_or(0, |map| map.len()));
        Ok(Self { map, windows })
    }

    /// No positions.
    pub fn empty() -> Self {
        Self { map: None, windows: Windows::default() }
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
        self.windows.touch(at, || self.drop_pages());
        DVec3::get(&bytes[at..at + DVec3::BYTES])
    }

    /// Copies 32-bit numbers from a file of such numbers, beginning with a place.
    ///
    /// # Panics
    /// Where there are not that many.
    #[inline]
    pub fn floats(&self, place: u64, values: &mut [f32]) {
        let bytes: &[u8] = self.map.as_deref().unwrap_or_default();
        let at = place as usize * f32::BYTES;
        self.windows.touch(at, || self.drop_pages());
        let from = &bytes[at..at + values.len() * f32::BYTES];
        values.iter_mut().zip(from.chunks_exact(f32::BYTES)).for_each(|(value, bytes)| *value = f32::get(bytes));
    }

    /// Reads a list of 32-bit numbers that stands behind its length in a file of such numbers. None where the file does
    /// not have it.
    pub fn list(&self, place: u64, values: &mut Vec<u32>) -> Option<()> {
        let bytes: &[u8] = self.map.as_deref().unwrap_or_default();
        let at = usize::try_from(place).ok()?.checked_mul(u32::BYTES)?;
        let (length, rest) = bytes.get(at..)?.split_at_checked(u32::BYTES)?;
        self.windows.touch(at, || self.drop_pages());
        let list = rest.get(..(u32::get(length) as usize).checked_mul(u32::BYTES)?)?;
        values.clear();
        values.extend(list.chunks_exact(u32::BYTES).map(u32::get));
        Some(())
    }

    /// The number of 32-bit numbers.
    pub fn float_count(&self) -> u64 {
        self.map.as_ref().map_or(0, |map| (map.len() / f32::BYTES) as u64)
    }

    /// Drops all pages. Those that are read again come back from the file.
    pub fn drop_pages(&self) {
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
