//! The numbers of texels: in memory, or in a file without a name where an image is too large for what there is of it.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use memmap2::{Mmap, UncheckedAdvice};

use lodpack_runtime::storage::WorkError;

/// What messages call a file of texels, because it has no name.
const NAME: &str = "(texels of an image)";

/// Where texels are kept.
#[derive(Debug)]
pub(super) struct Place {
    /// The folder of files.
    folder: PathBuf,
    /// The most bytes of a level of an image in memory.
    most: u64,
    /// Held while a large image is decoded as a whole: one at a time.
    alone: Mutex<()>,
}

impl Place {
    /// Up to the given number of bytes in memory, the rest in a folder.
    pub fn new(folder: &Path, most: u64) -> Self {
        Self { folder: folder.to_owned(), most, alone: Mutex::default() }
    }

    /// Waits until nobody else decodes a large image as a whole.
    pub fn alone(&self) -> MutexGuard<'_, ()> {
        self.alone.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether that many bytes are in a file.
    pub fn is_file(&self, bytes: u64) -> bool {
        bytes > self.most
    }

    /// Keeps what a function hands on, piece after piece, given the bytes of all.
    ///
    /// # Errors
    /// If a file cannot be made, written or read.
    pub fn keep<E: From<WorkError>>(
        &self,
        bytes: u64,
        fill: impl FnOnce(&mut dyn FnMut(&[u8])) -> Result<(), E>,
    ) -> Result<Bytes, E> {
        if !self.is_file(bytes) {
            let mut kept = Vec::with_capacity(bytes as usize);
            fill(&mut |piece| kept.extend_from_slice(piece))?;
            return Ok(Bytes::Memory(kept));
        }
        let failed = |action: &'static str| move |error| WorkError::new(&self.folder.join(NAME), action, error);
        let file = tempfile::tempfile_in(&self.folder).map_err(failed("made"))?;
        let mut file = BufWriter::with_capacity(1 << 20, file);
        let mut written = Ok(());
        fill(&mut |piece| {
            if written.is_ok() {
                written = file.write_all(piece);
            }
        })?;
        written.map_err(failed("written"))?;
        let file = file.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed("written"))?;
        Ok(Bytes::map(&file).map_err(failed("read"))?)
    }

    /// Keeps what is in memory already.
    ///
    /// # Errors
    /// As [`Place::keep`].
    pub fn move_here(&self, bytes: Vec<u8>) -> Result<Bytes, WorkError> {
        match self.is_file(bytes.len() as u64) {
            true => self.keep(bytes.len() as u64, |push| {
                push(&bytes);
                Ok(())
            }),
            false => Ok(Bytes::Memory(bytes)),
        }
    }
}

/// Numbers of texels.
pub(super) enum Bytes {
    Memory(Vec<u8>),
    File(Mmap),
}

impl Bytes {
    fn map(file: &File) -> io::Result<Self> {
        // SAFETY: the file has no name, so nobody else can change it, and this process writes to it no more.
        #[expect(unsafe_code, reason = "mapping a file is unsafe because other programs may change it meanwhile")]
        unsafe { Mmap::map(file) }.map(Self::File)
    }

    /// How many are in memory.
    pub fn in_memory(&self) -> u64 {
        match self {
            Self::Memory(bytes) => bytes.len() as u64,
            Self::File(_) => 0,
        }
    }

    /// Drops the pages of a file. Those that are read again come back.
    pub fn drop_pages(&self) {
        if let Self::File(map) = self {
            // SAFETY: the map of the file is read-only and shared, so dropped pages come back from the file when they
            // are read again, and nothing has ever been written through it. A failure only leaves the pages where they
            // are.
            #[expect(
                unsafe_code,
                reason = "dropping pages of a map would lose changes made through it; there are none"
            )]
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
        }
    }
}

impl Deref for Bytes {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        match self {
            Self::Memory(bytes) => bytes,
            Self::File(map) => map,
        }
    }
}
