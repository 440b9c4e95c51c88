//! Arrays of records in files.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::{WorkDirectory, WorkError};

/// Bytes that are read or written at once.
const CHUNK_BYTES: usize = 1 << 20;

/// A value that takes a fixed number of bytes, little-endian.
pub trait Record: Copy {
    /// The number of bytes.
    const BYTES: usize;

    /// Appends the value's bytes.
    fn put(&self, bytes: &mut Vec<u8>);

    /// The value of [`Self::BYTES`] bytes.
    fn get(bytes: &[u8]) -> Self;
}

impl Record for u32 {
    const BYTES: usize = 4;

    fn put(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }

    fn get(bytes: &[u8]) -> Self {
        bytes.first_chunk().copied().map_or(0, Self::from_le_bytes)
    }
}

impl Record for [u32; 3] {
    const BYTES: usize = 12;

    fn put(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|number| number.put(bytes));
    }

    fn get(bytes: &[u8]) -> Self {
        [0, 4, 8].map(|at| u32::get(&bytes[at..]))
    }
}

impl Record for u16 {
    const BYTES: usize = 2;

    fn put(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }

    fn get(bytes: &[u8]) -> Self {
        bytes.first_chunk().copied().map_or(0, Self::from_le_bytes)
    }
}

impl Record for f32 {
    const BYTES: usize = 4;

    fn put(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }

    fn get(bytes: &[u8]) -> Self {
        bytes.first_chunk().copied().map_or(0.0, Self::from_le_bytes)
    }
}

impl Record for DVec3 {
    const BYTES: usize = 24;

    fn put(&self, bytes: &mut Vec<u8>) {
        self.to_array().iter().for_each(|coordinate| bytes.extend(coordinate.to_le_bytes()));
    }

    fn get(bytes: &[u8]) -> Self {
        [0, 8, 16].map(|at| bytes[at..].first_chunk().copied().map_or(0.0, f64::from_le_bytes)).into()
    }
}

/// Writes records to a temporary file.
#[derive(Debug)]
pub struct RecordWriter<R> {
    directory: WorkDirectory,
    path: PathBuf,
    file: File,
    pending: Vec<u8>,
    records: PhantomData<R>,
}

impl<R: Record> RecordWriter<R> {
    /// Begins a file, and replaces one of that name.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(directory: &WorkDirectory, name: &str) -> Result<Self, WorkError> {
        directory.remove(&directory.path(name));
        Self::append(directory, name)
    }

    /// Continues at the end of a file, or begins one.
    ///
    /// # Errors
    /// If the file cannot be opened or made.
    pub fn append(directory: &WorkDirectory, name: &str) -> Result<Self, WorkError> {
        let path = directory.path(name);
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(|source| WorkError::new(&path, "made", source))?;
        Ok(Self { directory: directory.clone(), path, file, pending: vec![], records: PhantomData })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends records.
    ///
    /// # Errors
    /// If the disk is full or fails.
    pub fn push_all(&mut self, records: &[R]) -> Result<(), WorkError> {
        for chunk in records.chunks(CHUNK_BYTES / R::BYTES) {
            chunk.iter().for_each(|record| record.put(&mut self.pending));
            if self.pending.len() >= CHUNK_BYTES {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Ends the file and returns its path.
    ///
    /// # Errors
    /// As [`Self::push_all`].
    pub fn finish(mut self) -> Result<PathBuf, WorkError> {
        self.flush()?;
        Ok(self.path)
    }

    /// Hands everything pushed so far to the system.
    ///
    /// # Errors
    /// As [`Self::push_all`].
    pub fn flush(&mut self) -> Result<(), WorkError> {
        let written = self.file.write_all(&self.pending);
        written.map_err(|source| WorkError::new(&self.path, "written", source))?;
        self.directory.count(self.pending.len() as u64);
        self.pending.clear();
        Ok(())
    }
}

/// Reads records of a temporary file.
#[derive(Debug)]
pub struct RecordReader<R> {
    path: PathBuf,
    file: File,
    /// The number of records.
    pub count: u64,
    records: PhantomData<R>,
}

impl<R: Record> RecordReader<R> {
    /// Opens a file.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, WorkError> {
        let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        let (bytes, file) = opened.map_err(|source| WorkError::new(path, "read", source))?;
        Ok(Self { path: path.to_owned(), file, count: bytes / R::BYTES as u64, records: PhantomData })
    }

    /// Visits all records in order.
    ///
    /// # Errors
    /// If the disk fails.
    pub fn for_each(self, visit: impl FnMut(R)) -> Result<(), WorkError> {
        let all = 0..self.count;
        self.for_each_of(all, visit)
    }

    /// Visits a range of records in order.
    ///
    /// # Errors
    /// If there are not that many, or the disk fails.
    pub fn for_each_of(mut self, range: Range<u64>, mut visit: impl FnMut(R)) -> Result<(), WorkError> {
        let bytes = range.start * R::BYTES as u64;
        let sought = self.file.seek(SeekFrom::Start(bytes));
        sought.map_err(|source| WorkError::new(&self.path, "read", source))?;
        let mut buffer = vec![0; CHUNK_BYTES / R::BYTES * R::BYTES];
        let mut left = range.end.saturating_sub(range.start) * R::BYTES as u64;
        while left > 0 {
            let size = left.min(buffer.len() as u64) as usize;
            let chunk = &mut buffer[..size];
            let read = self.file.read_exact(chunk);
            read.map_err(|source| WorkError::new(&self.path, "read", source))?;
            chunk.chunks_exact(R::BYTES).for_each(|bytes| visit(R::get(bytes)));
            left -= size as u64;
        }
        Ok(())
    }

    /// All records.
    ///
    /// # Errors
    /// As [`Self::for_each`].
    pub fn read_all(self) -> Result<Vec<R>, WorkError> {
        let mut records = Vec::with_capacity(self.count as usize);
        self.for_each(|record| records.push(record))?;
        Ok(records)
    }
}
