//! One input file: its bytes, and the errors and notes that name it.

use std::cell::Cell;
use std::fs::{File, Metadata};
use std::io;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use memmap2::{Mmap, UncheckedAdvice};

use super::error::{ImportError, Location, Parsed};
use lodpack_runtime::progress::Progress;

/// The bytes of a file, memory-mapped.
pub(super) struct FileBytes {
    path: PathBuf,
    map: Mmap,
    /// Pages before this offset have been dropped.
    dropped: Cell<usize>,
}

/// How far a parser reads before the pages behind it are dropped.
pub(super) const DROP_BYTES: usize = 16 << 20;

impl FileBytes {
    /// Maps a regular, non-empty file.
    pub(super) fn open(path: &Path) -> Parsed<Self> {
        let io = |source| ImportError::Io { path: path.to_owned(), source };
        let metadata = std::fs::metadata(path).map_err(io)?;
        if let Some(kind) = kind_of_no_file(&metadata) {
            return Err(ImportError::NotAFile { path: path.to_owned(), kind }.into());
        }
        if metadata.len() == 0 {
            return Err(ImportError::Empty { path: path.to_owned() }.into());
        }
        let file = File::open(path).map_err(io)?;
        // SAFETY: the map is read-only and private to this value, and handed out only as a shared slice that lives no
        // longer than the map. Another program may still change the file while it is read. Each value is checked after
        // it is loaded, so changed bytes give a wrong mesh or an error; a shortened file ends the process by SIGBUS,
        // which `import_meshes` documents.
        #[expect(unsafe_code, reason = "mapping a file is unsafe because other programs may change it meanwhile")]
        let map = unsafe { Mmap::map(&file) }.map_err(io)?;
        Ok(Self { path: path.to_owned(), map, dropped: Cell::new(0) })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Drops all pages. Pages that are read again come back from the file.
    #[cold]
    pub(super) fn drop_pages(&self) {
        self.dropped.set(0);
        self.drop_before(self.map.len());
        self.dropped.set(0);
    }

    #[cold]
    fn drop_before(&self, offset: usize) {
        let dropped = self.dropped.replace(offset);
        if let Some(length) = offset.checked_sub(dropped) {
            // SAFETY: the map of the file is read-only and shared, so dropped pages come back from the file when they
            // are read again, and nothing has ever been written through it. A failure only leaves the pages where they
            // are.
            #[expect(
                unsafe_code,
                reason = "dropping pages of a map would lose changes made through it; there are none"
            )]
            let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, dropped, length) };
        }
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map
    }
}

/// What a path leads to that is no regular file. It is asked before a file is opened, because opening a pipe could
/// block forever.
fn kind_of_no_file(metadata: &Metadata) -> Option<&'static str> {
    match metadata {
        of if of.is_file() => None,
        of if of.is_dir() => Some("a directory"),
        _ => Some("a device or pipe"),
    }
}

/// Bytes of a regular file that an input names; it is asked before the file is opened.
///
/// # Errors
/// If there is no such file, or it is a directory, a device or a pipe.
pub fn size_of_file(path: &Path) -> io::Result<u64> {
    let metadata = std::fs::metadata(path)?;
    match kind_of_no_file(&metadata) {
        Some(kind) => Err(io::Error::other(format!("it is {kind}, not a file"))),
        None => Ok(metadata.len()),
    }
}

/// A file that is being parsed.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    /// The name for messages.
    pub(super) path: &'a Path,
    /// The whole content.
    pub(super) bytes: &'a [u8],
    /// The file to which the bytes belong, if they are not in memory.
    file: Option<&'a FileBytes>,
    progress: &'a dyn Progress,
}

impl<'a> Source<'a> {
    /// A source whose bytes are in memory.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], progress: &'a dyn Progress) -> Self {
        Self { path, bytes, file: None, progress }
    }

    /// A source over a mapped file.
    pub(super) fn of_file(path: &'a Path, file: &'a FileBytes, progress: &'a dyn Progress) -> Self {
        Self { path, bytes: file, file: Some(file), progress }
    }

    /// The same file as if it ended at an offset.
    pub(super) fn until(&self, end: usize) -> Self {
        Self { bytes: &self.bytes[..end], ..*self }
    }

    /// Declares everything before an offset as done, so it need not stay in memory. Reading it again is allowed.
    #[inline]
    pub(super) fn passed(&self, offset: usize) {
        if let Some(file) = self.file
            && offset.wrapping_sub(file.dropped.get()) >= DROP_BYTES
        {
            file.drop_before(offset);
        }
    }

    /// Declares everything read so far as done, so it need not stay in memory. Reading it again is allowed.
    pub(super) fn drop_pages(&self) {
        if let Some(file) = self.file {
            file.drop_pages();
        }
    }

    /// Tells the user something that is not an error, together with the file's name.
    pub(super) fn note(&self, message: &str) {
        self.progress.note(&format!("{}: {message}", self.path.display()));
    }

    /// Notes how many items were left out, if any.
    pub(super) fn note_skipped(&self, count: u64, what: &str) {
        if count > 0 {
            self.note(&format!("{count} {what}"));
        }
    }

    /// The line, counted from 1, that contains the byte at `offset`. It counts from the start of the file, so only
    /// messages use it.
    pub(super) fn line(&self, offset: usize) -> Location {
        let before = &self.bytes[..offset.min(self.bytes.len())];
        let end = if self.bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        Location::Line(1 + before.iter().filter(|&&b| b == end).count() as u64)
    }

    #[cold]
    pub(super) fn syntax(&self, location: Location, problem: impl Into<String>) -> Box<ImportError> {
        ImportError::Syntax { path: self.path.to_owned(), location, problem: problem.into() }.into()
    }

    #[cold]
    pub(super) fn truncated(&self, location: Location, missing: impl Into<String>) -> Box<ImportError> {
        ImportError::Truncated { path: self.path.to_owned(), location, missing: missing.into() }.into()
    }

    #[cold]
    pub(super) fn coordinate(&self, location: Location, vertex: u64, position: glam::DVec3) -> Box<ImportError> {
        let value = position.to_array().into_iter().find(|c| !c.is_finite()).unwrap_or(f64::NAN);
        ImportError::Coordinate { path: self.path.to_owned(), location, vertex, value }.into()
    }

    #[cold]
    pub(super) fn unsupported(&self, feature: impl Into<String>, remedy: &'static str) -> Box<ImportError> {
        ImportError::Unsupported { path: self.path.to_owned(), feature: feature.into(), remedy }.into()
    }

    #[cold]
    pub(super) fn wrong_magic(&self, rule: &str) -> Box<ImportError> {
        let problem = format!("{rule}, but this one starts with {}; rename or convert it", self.start_of_file());
        self.syntax(Location::Byte(0), problem)
    }

    /// The first bytes, quoted and escaped.
    pub(super) fn start_of_file(&self) -> String {
        format!("\"{}\"", self.bytes[..self.bytes.len().min(16)].escape_ascii())
    }

    /// Notes a text file whose last line has no end: if the file was cut short, a number may have lost digits
    /// unnoticed.
    pub(super) fn note_missing_line_end(&self) {
        if !matches!(self.bytes.last(), Some(b'\n' | b'\r')) {
            self.note("the last line has no line end; if the file was cut short, its last face may be wrong");
        }
    }
}
