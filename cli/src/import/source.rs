//! One input file: its bytes, and errors and notes that name it.

use std::fs::File;
use std::ops::Deref;
use std::path::Path;

use memmap2::Mmap;

use super::error::{ImportError, Parsed, Place};
use crate::progress::Progress;

/// The bytes of a file, memory-mapped.
pub(super) struct FileBytes(Mmap);

impl FileBytes {
    /// Maps a regular, non-empty file.
    pub(super) fn open(path: &Path) -> Parsed<Self> {
        let io = |source| ImportError::Io { path: path.to_owned(), source };
        // Asked before opening: opening a pipe could wait for ever.
        let metadata = std::fs::metadata(path).map_err(io)?;
        if !metadata.is_file() {
            let kind = if metadata.is_dir() { "a directory" } else { "a device or pipe" };
            return Err(ImportError::NotAFile { path: path.to_owned(), kind }.into());
        }
        if metadata.len() == 0 {
            return Err(ImportError::Empty { path: path.to_owned() }.into());
        }
        let file = File::open(path).map_err(io)?;
        // SAFETY: the map is read-only and private to this value, and handed out only as a shared slice that lives no
        // longer than the map. What remains is that another program changes the file while it is read: each value is
        // checked after it is loaded, so changed bytes give a wrong mesh or an error; a shortened file ends the process
        // by SIGBUS, which `import_meshes` documents.
        #[expect(unsafe_code, reason = "mapping a file is unsafe because other programs may change it meanwhile")]
        let map = unsafe { Mmap::map(&file) }.map_err(io)?;
        Ok(Self(map))
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

/// A file that is being parsed.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    /// The name, for messages.
    pub(super) path: &'a Path,
    /// The whole content.
    pub(super) bytes: &'a [u8],
    progress: &'a dyn Progress,
}

impl<'a> Source<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], progress: &'a dyn Progress) -> Self {
        Self { path, bytes, progress }
    }

    /// Tells the user something that is not an error, with the file's name.
    pub(super) fn note(&self, message: &str) {
        self.progress.note(&format!("{}: {message}", self.path.display()));
    }

    /// Notes how many items were left out, if any.
    pub(super) fn note_skipped(&self, count: u64, what: &str) {
        if count > 0 {
            self.note(&format!("{count} {what}"));
        }
    }

    /// The line, counted from 1, that holds the byte at `offset`. Counts from the start of the file: only for messages.
    pub(super) fn line(&self, offset: usize) -> Place {
        let before = &self.bytes[..offset.min(self.bytes.len())];
        let end = if self.bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        Place::Line(1 + before.iter().filter(|&&b| b == end).count() as u64)
    }

    #[cold]
    pub(super) fn syntax(&self, place: Place, problem: impl Into<String>) -> Box<ImportError> {
        ImportError::Syntax { path: self.path.to_owned(), place, problem: problem.into() }.into()
    }

    #[cold]
    pub(super) fn truncated(&self, place: Place, missing: impl Into<String>) -> Box<ImportError> {
        ImportError::Truncated { path: self.path.to_owned(), place, missing: missing.into() }.into()
    }

    #[cold]
    pub(super) fn coordinate(&self, place: Place, vertex: u64, position: glam::DVec3) -> Box<ImportError> {
        let value = position.to_array().into_iter().find(|c| !c.is_finite()).unwrap_or(f64::NAN);
        ImportError::Coordinate { path: self.path.to_owned(), place, vertex, value }.into()
    }

    #[cold]
    pub(super) fn unsupported(&self, feature: impl Into<String>, remedy: &'static str) -> Box<ImportError> {
        ImportError::Unsupported { path: self.path.to_owned(), feature: feature.into(), remedy }.into()
    }

    #[cold]
    pub(super) fn wrong_magic(&self, rule: &str) -> Box<ImportError> {
        let problem = format!("{rule}, but this one starts with {}; rename or convert it", self.start_of_file());
        self.syntax(Place::Byte(0), problem)
    }

    /// The first bytes, quoted and escaped.
    pub(super) fn start_of_file(&self) -> String {
        format!("\"{}\"", self.bytes[..self.bytes.len().min(16)].escape_ascii())
    }

    /// Notes a text file whose last line has no end: if it was cut short there, a number may have lost digits unseen.
    pub(super) fn note_missing_line_end(&self) {
        if !matches!(self.bytes.last(), Some(b'\n' | b'\r')) {
            self.note("the last line has no line end; if the file was cut short, its last face may be wrong");
        }
    }
}
