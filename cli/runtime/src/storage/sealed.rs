//! Files that exist completely or not at all.
//!
//! A file holds: a magic number, the version of all such files, its kind, the job's number; then values (length, then
//! the value as `postcard` writes it), bytes (length, then these) and arrays of [`Record`]s (length in bytes, then the
//! records); then the XXH3 hash of everything before. It is written under a temporary name and renamed when it is
//! complete.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::{Record, WorkDirectory, WorkError};

const MAGIC: [u8; 8] = *b"\x8fLODWRK\n";
/// Increases when the content of any kind of file changes: with each further filling, since parts hold the steps of all
/// of them, with what pieces, regions and tasks hold, and with what plans say.
const VERSION: u32 = 41;
/// The message for files that cannot be what was written.
pub const DAMAGED: &str = "it is damaged or truncated";
const HASH_BYTES: u64 = 8;
const BUFFER_BYTES: usize = 1 << 20;

/// The number of a job: a hash of its inputs and options. Files of one job are of no use to another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct JobId(pub u128);

impl std::fmt::Display for JobId {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

/// Writes a sealed file. If it is dropped unfinished, it leaves no file.
pub struct SealedWriter {
    path: PathBuf,
    temporary: PathBuf,
    out: Option<BufWriter<File>>,
    hash: Xxh3,
    bytes: u64,
    count_in: Option<WorkDirectory>,
}

impl SealedWriter {
    /// Begins a file of a kind, which [`SealedReader::open`] has to ask for. The caller holds a lock, so that no one
    /// else writes the same file meanwhile.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(path: &Path, kind: [u8; 4], job: JobId) -> Result<Self, WorkError> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".tmp");
        let temporary = path.with_file_name(name);
        let file = File::create(&temporary).map_err(|source| WorkError::new(&temporary, "made", source))?;
        let mut writer = Self {
            path: path.to_owned(),
            temporary,
            out: Some(BufWriter::with_capacity(BUFFER_BYTES, file)),
            hash: Xxh3::new(),
            bytes: 0,
            count_in: None,
        };
        writer.write(&MAGIC)?;
        writer.write(&VERSION.to_le_bytes())?;
        writer.write(&kind)?;
        writer.write(&job.0.to_le_bytes())?;
        Ok(writer)
    }

    /// As [`Self::create`], in a work directory, which counts its bytes.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn within(directory: &WorkDirectory, name: &str, kind: [u8; 4], job: JobId) -> Result<Self, WorkError> {
        let mut writer = Self::create(&directory.path(name), kind, job)?;
        writer.count_in = Some(directory.clone());
        Ok(writer)
    }

    /// Appends a value.
    ///
    /// # Errors
    /// If the disk is full or fails.
    pub fn put<T: Serialize>(&mut self, value: &T) -> Result<(), WorkError> {
        let bytes = postcard::to_stdvec(value).map_err(|error| WorkError::damaged(&self.path, &error.to_string()))?;
        self.write(&(bytes.len() as u64).to_le_bytes())?;
        self.write(&bytes)
    }

    /// Appends an array.
    ///
    /// # Errors
    /// As [`Self::put`].
    pub fn put_records<R: Record>(&mut self, records: &[R]) -> Result<(), WorkError> {
        self.write(&(records.len() as u64 * R::BYTES as u64).to_le_bytes())?;
        let mut bytes = Vec::with_capacity(BUFFER_BYTES.min(records.len() * R::BYTES));
        for chunk in records.chunks(BUFFER_BYTES / R::BYTES) {
            bytes.clear();
            chunk.iter().for_each(|record| record.put(&mut bytes));
            self.write(&bytes)?;
        }
        Ok(())
    }

    /// Appends bytes, before them their number.
    ///
    /// # Errors
    /// As [`Self::put`].
    pub fn put_bytes(&mut self, bytes: &[u8]) -> Result<(), WorkError> {
        self.write(&(bytes.len() as u64).to_le_bytes())?;
        bytes.chunks(BUFFER_BYTES).try_for_each(|bytes| self.write(bytes))
    }

    /// Renames the file to its own name, with `sync` only after it has reached the disk. Returns its size.
    ///
    /// # Errors
    /// As [`Self::put`].
    pub fn finish(mut self, sync: bool) -> Result<u64, WorkError> {
        let hash = self.hash.digest();
        self.write(&hash.to_le_bytes())?;
        if let Some(out) = self.out.take() {
            let finished = out.into_inner().map_err(io::IntoInnerError::into_error).and_then(|file| {
                if sync {
                    file.sync_all()?;
                }
                fs::rename(&self.temporary, &self.path)
            });
            if let Err(source) = finished {
                let _ = fs::remove_file(&self.temporary);
                return Err(WorkError::new(&self.path, "written", source));
            }
        }
        if let Some(directory) = &self.count_in {
            directory.count(self.bytes);
        }
        Ok(self.bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), WorkError> {
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        let out = self.out.as_mut().map_or(Ok(()), |out| out.write_all(bytes));
        out.map_err(|source| WorkError::new(&self.path, "written", source))
    }
}

impl Drop for SealedWriter {
    fn drop(&mut self) {
        if self.out.is_some() {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Reads a sealed file in the order in which it was written. What was read is to be trusted only after
/// [`Self::finish`].
pub struct SealedReader {
    path: PathBuf,
    file: File,
    hash: Xxh3,
    left: u64,
    /// The job that the file belongs to.
    pub job: JobId,
}

impl SealedReader {
    /// Opens a file of a kind.
    ///
    /// # Errors
    /// If the file cannot be read, or is of another kind or version.
    pub fn open(path: &Path, kind: [u8; 4]) -> Result<Self, WorkError> {
        let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        let (bytes, file) = opened.map_err(|source| WorkError::new(path, "read", source))?;
        let left = bytes.saturating_sub(HASH_BYTES);
        let mut reader = Self { path: path.to_owned(), file, hash: Xxh3::new(), left, job: JobId::default() };
        if reader.array()? != MAGIC {
            return Err(reader.damaged("it is not a file of a build"));
        }
        let version = u32::from_le_bytes(reader.array()?);
        if version != VERSION {
            return Err(reader.damaged(&format!(
                "another version of lodpack wrote it (its work files have version {version}, this program's have {VERSION})"
            )));
        }
        if reader.array()? != kind {
            return Err(reader.damaged("it is another kind of file of a build"));
        }
        reader.job = JobId(u128::from_le_bytes(reader.array()?));
        Ok(reader)
    }

    /// Opens a file of a kind that has to belong to a job.
    ///
    /// # Errors
    /// As [`Self::open`], and where the file belongs to another job.
    pub fn open_of_job(path: &Path, kind: [u8; 4], job: JobId) -> Result<Self, WorkError> {
        let reader = Self::open(path, kind)?;
        if reader.job == job { Ok(reader) } else { Err(reader.damaged("it belongs to another job")) }
    }

    /// The next value.
    ///
    /// # Errors
    /// If the file ends, or the next value is of another type.
    pub fn get<T: DeserializeOwned>(&mut self) -> Result<T, WorkError> {
        let length = self.length()?;
        let bytes = self.bytes(length)?;
        match postcard::take_from_bytes(&bytes) {
            Ok((value, [])) => Ok(value),
            _ => Err(self.damaged(DAMAGED)),
        }
    }

    /// Skips the next value. [`Self::finish`] can no longer check the file after that.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn skip(&mut self) -> Result<(), WorkError> {
        let length = self.length()?;
        self.left -= length;
        self.file.seek_relative(length as i64).map_err(|source| WorkError::new(&self.path, "read", source))
    }

    /// The next array.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn get_records<R: Record>(&mut self) -> Result<Vec<R>, WorkError> {
        let mut left = self.length()?;
        if !left.is_multiple_of(R::BYTES as u64) {
            return Err(self.damaged(DAMAGED));
        }
        let mut records = Vec::with_capacity((left / R::BYTES as u64) as usize);
        while left > 0 {
            let size = left.min((BUFFER_BYTES / R::BYTES * R::BYTES) as u64);
            let bytes = self.bytes(size)?;
            records.extend(bytes.chunks_exact(R::BYTES).map(R::get));
            left -= size;
        }
        Ok(records)
    }

    /// The next bytes.
    ///
    /// # Errors
    /// If the file ends.
    pub fn get_bytes(&mut self) -> Result<Vec<u8>, WorkError> {
        let length = self.length()?;
        self.bytes(length)
    }

    /// Whether everything was read that is to be read before [`Self::finish`].
    pub fn is_at_end(&self) -> bool {
        self.left == 0
    }

    /// Reads the rest and checks the hash of everything.
    ///
    /// # Errors
    /// If any bit differs from what was written.
    pub fn finish(mut self) -> Result<(), WorkError> {
        while self.left > 0 {
            self.bytes(self.left.min(BUFFER_BYTES as u64))?;
        }
        let mut stored = [0; HASH_BYTES as usize];
        self.file.read_exact(&mut stored).map_err(|_| self.damaged(DAMAGED))?;
        if stored == self.hash.digest().to_le_bytes() { Ok(()) } else { Err(self.damaged(DAMAGED)) }
    }

    /// A length, checked against the rest of the file.
    fn length(&mut self) -> Result<u64, WorkError> {
        let length = u64::from_le_bytes(self.array()?);
        if length > self.left { Err(self.damaged(DAMAGED)) } else { Ok(length) }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], WorkError> {
        let bytes = self.bytes(N as u64)?;
        bytes.first_chunk().copied().ok_or_else(|| self.damaged(DAMAGED))
    }

    fn bytes(&mut self, count: u64) -> Result<Vec<u8>, WorkError> {
        if count > self.left {
            return Err(self.damaged(DAMAGED));
        }
        let mut bytes = vec![0; count as usize];
        self.file.read_exact(&mut bytes).map_err(|source| WorkError::new(&self.path, "read", source))?;
        self.hash.update(&bytes);
        self.left -= count;
        Ok(bytes)
    }

    fn damaged(&self, what: &str) -> WorkError {
        WorkError::damaged(&self.path, what)
    }
}
