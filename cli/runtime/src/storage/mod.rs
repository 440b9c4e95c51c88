//! Work directories: what a build keeps on disk because it does not fit in memory, or because other processes continue
//! from it.
//!
//! There are two kinds of files. Arrays of little-endian [`Record`]s grow while an input is read; they count only once
//! another file says that they are complete. A [`SealedWriter`] makes a file that exists completely or not at all,
//! names the job that it belongs to, and is checked when it is read: a build can be resumed from such files.

mod free;
mod lock;
mod lookup;
pub mod memory;
mod records;
mod sealed;

pub use free::{default_memory, free_bytes};
pub use lock::Lock;
pub use lookup::Lookup;
pub use lookup::Windows;
pub use records::{Record, RecordReader, RecordWriter};
pub use sealed::DAMAGED;
pub use sealed::{JobId, SealedReader, SealedWriter};

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A file of a work directory is unusable.
#[derive(Debug, thiserror::Error)]
#[error("{} cannot be {action}", path.display())]
pub struct WorkError {
    /// The file or directory.
    pub path: PathBuf,
    /// "made", "written", "locked" or "read".
    pub action: &'static str,
    /// The reason that the system gave.
    pub source: io::Error,
}

impl WorkError {
    /// What to do about it, and whether using another directory would help as well. None if the system's message is
    /// enough.
    pub fn advice(&self) -> Option<(&'static str, bool)> {
        match (self.action, self.source.kind()) {
            ("read", io::ErrorKind::PermissionDenied) => Some(("check its permissions", false)),
            ("read", _) => None,
            ("locked", io::ErrorKind::WouldBlock) => Some(("wait until it has ended, or stop it", false)),
            (_, io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge) => {
                Some(("give its disk more space", true))
            }
            (_, io::ErrorKind::ReadOnlyFilesystem | io::ErrorKind::PermissionDenied) => {
                Some(("check the permissions of its directory", true))
            }
            _ => None,
        }
    }

    /// The error of an action on a file, in the words of the system.
    pub fn new(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self { path: path.to_owned(), action, source }
    }

    /// A file does not hold what it should.
    pub fn damaged(path: &Path, what: &str) -> Self {
        Self::new(path, "read", io::Error::new(io::ErrorKind::InvalidData, what.to_owned()))
    }
}

/// A directory for one build, held by one process at a time. When the last clone of this value is dropped, the
/// directory is removed with everything in it, unless it is to be kept.
#[derive(Clone, Debug)]
pub struct WorkDirectory(Arc<Directory>);

#[derive(Debug)]
struct Directory {
    path: PathBuf,
    kept: AtomicBool,
    bytes: AtomicU64,
    most_bytes: AtomicU64,
    _lock: Option<Lock>,
}

/// The file that the process at work holds a lock on.
const LOCK_NAME: &str = "lock";
/// The file that says what a job is.
pub const MANIFEST_NAME: &str = "job.json";
/// The file that says that a job's regions are there.
pub const PLAN_NAME: &str = "plan";
/// The file that says that a job's input is divided.
pub const DIVIDED_NAME: &str = "divided";
/// Files that vouch for others go first: what a kill then leaves of the directory is begun anew.
const FIRST_REMOVED: [&str; 3] = [MANIFEST_NAME, PLAN_NAME, DIVIDED_NAME];
/// The folder of the tasks of a job's stages.
pub const STAGES_NAME: &str = "stages";
/// The other names in a job's directory, by whoever writes them: the parts' folder, scripts, a ground, a grid, and
/// what is read of inputs.
const OTHERS: [&str; 9] =
    ["parts", "slurm", "ground.lodpack", "samples", "pairs", "vertices", "triangles", "vertex-values", "corner-values"];
/// How the names of files begin of which there are several: of regions and of what is built of them, of images, and of
/// the texts that tasks have read.
const NUMBERED: [&str; 4] = ["region-", "part-", "image-", "text-"];

/// Whether a job's directory may hold a file or folder of this name. Whatever a job writes has to be known here: a
/// directory with anything else is nobody's to resume or to remove.
pub fn is_of_job(name: &str) -> bool {
    [LOCK_NAME, MANIFEST_NAME, PLAN_NAME, DIVIDED_NAME, STAGES_NAME].contains(&name)
        || OTHERS.contains(&name)
        || NUMBERED.iter().any(|begin| name.starts_with(begin))
        || name.ends_with(".tmp")
}

impl WorkDirectory {
    /// Makes a new directory, or takes an empty one. Anything else of that name is refused and left alone.
    ///
    /// # Errors
    /// If the directory cannot be made or locked.
    pub fn create(path: &Path) -> Result<Self, WorkError> {
        let is_empty = fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
        if !is_empty {
            fs::create_dir(path).map_err(|source| WorkError::new(path, "made", source))?;
        }
        Self::hold(path, false)
    }

    /// Opens a directory that an earlier process has left, and keeps it.
    ///
    /// # Errors
    /// If it cannot be locked: [`io::ErrorKind::WouldBlock`] if another process is at work in it.
    pub fn open(path: &Path) -> Result<Self, WorkError> {
        let directory = Self::hold(path, true)?;
        remove_left(path);
        Ok(directory)
    }

    /// Opens a directory that an earlier process has left, only to read it, as other processes may at the same time.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] if another process is changing it.
    pub fn visit(path: &Path) -> Result<Self, WorkError> {
        Ok(Self::with(path, true, Lock::try_share(&path.join(LOCK_NAME))?))
    }

    fn hold(path: &Path, kept: bool) -> Result<Self, WorkError> {
        Ok(Self::with(path, kept, Some(Lock::try_take(&path.join(LOCK_NAME))?)))
    }

    fn with(path: &Path, kept: bool, lock: Option<Lock>) -> Self {
        let (bytes, most_bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        Self(Arc::new(Directory { path: path.to_owned(), kept: AtomicBool::new(kept), bytes, most_bytes, _lock: lock }))
    }

    /// The directory itself.
    pub fn folder(&self) -> &Path {
        &self.0.path
    }

    /// Sets whether the directory stays when the build ends.
    pub fn keep(&self, kept: bool) {
        self.0.kept.store(kept, Ordering::Relaxed);
    }

    /// The path of a file in the directory, whose name [`is_of_job`] knows.
    pub fn path(&self, name: &str) -> PathBuf {
        debug_assert!(is_of_job(name), "is_of_job does not know {name}");
        self.0.path.join(name)
    }

    /// Removes a file that is no longer needed, if it exists.
    pub fn remove(&self, path: &Path) {
        if let Ok(metadata) = fs::metadata(path)
            && fs::remove_file(path).is_ok()
        {
            // Files of an earlier process were not counted.
            let less = |bytes: u64| Some(bytes.saturating_sub(metadata.len()));
            let _ = self.0.bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
        }
    }

    /// The most bytes that all files of this process took at a time.
    pub fn most_bytes(&self) -> u64 {
        self.0.most_bytes.load(Ordering::Relaxed)
    }

    /// Counts bytes that were written.
    pub fn count(&self, bytes: u64) {
        let now = self.0.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.0.most_bytes.fetch_max(now, Ordering::Relaxed);
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        if !*self.kept.get_mut() {
            // A failure is ignored: nothing more can be done here, and the directory's name says that it is temporary.
            for name in FIRST_REMOVED {
                let _ = fs::remove_file(self.path.join(name));
            }
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

/// Removes what killed processes have left: unfinished files, and all numbered files and stages where there is no
/// manifest. Such a directory was being removed, so what one of its files says of another need no longer be true.
fn remove_left(folder: &Path) {
    let has_manifest = folder.join(MANIFEST_NAME).exists();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        if name.ends_with(".tmp") || !has_manifest && NUMBERED.iter().any(|begin| name.starts_with(begin)) {
            let _ = fs::remove_file(entry.path());
        }
        if !has_manifest && name == STAGES_NAME {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(test)]
mod tests;
