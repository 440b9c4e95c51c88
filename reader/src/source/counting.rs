//! Sources that record the requests they get.

use std::{
    io,
    ops::Range,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{ReadAt, Request};

/// Counts requests and bytes.
#[derive(Debug, Default)]
pub struct Counting<T> {
    source: T,
    reads: AtomicU64,
    bytes: AtomicU64,
}

impl<T> Counting<T> {
    /// Counts from zero.
    pub fn new(source: T) -> Self {
        Self { source, reads: AtomicU64::new(0), bytes: AtomicU64::new(0) }
    }

    /// The number of requests so far.
    pub fn read_count(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// The number of bytes read so far.
    pub fn byte_count(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    fn count(&self, length: usize) {
        self.reads.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(length as u64, Ordering::Relaxed);
    }
}

impl<T: ReadAt> ReadAt for Counting<T> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.count(buf.len());
        self.source.read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        self.source.size()
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let answer = self.source.read_start(length)?;
        self.count(answer.0.len());
        Ok(answer)
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        requests.iter().for_each(|request| self.count(request.buf.len()));
        self.source.read_ranges(requests)
    }
}

/// Writes down every request. It never forgets, so it is for tests and measurements.
#[derive(Debug, Default)]
pub struct Recording<T> {
    source: T,
    requests: Mutex<Vec<Range<u64>>>,
}

impl<T> Recording<T> {
    /// Begins with an empty list.
    pub fn new(source: T) -> Self {
        Self { source, requests: Mutex::new(Vec::new()) }
    }

    /// The requests since the last call, in their order.
    pub fn take(&self) -> Vec<Range<u64>> {
        std::mem::take(&mut *self.requests.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn note(&self, offset: u64, length: usize) {
        let range = offset..offset.saturating_add(length as u64);
        self.requests.lock().unwrap_or_else(PoisonError::into_inner).push(range);
    }
}

impl<T: ReadAt> ReadAt for Recording<T> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.note(offset, buf.len());
        self.source.read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        self.source.size()
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let answer = self.source.read_start(length)?;
        self.note(0, answer.0.len());
        Ok(answer)
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        requests.iter().for_each(|request| self.note(request.offset, request.buf.len()));
        self.source.read_ranges(requests)
    }
}
