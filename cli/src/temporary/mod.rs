//! Temporary files: what a build keeps on disk because it does not fit in memory.
//!
//! All are in one directory, which goes with the value that stands for it. They hold arrays of little-endian
//! [`Record`]s. Nothing in them outlives the process, so there are no versions and no checks.

mod lookup;
mod records;

pub use lookup::Lookup;
pub use records::{Record, RecordReader, RecordWriter};

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A temporary file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error(
    "the temporary file {} cannot be {action}; give its disk more space or name a directory elsewhere with --temp",
    path.display()
)]
pub struct TemporaryError {
    /// The file or directory.
    pub path: PathBuf,
    /// "made", "written" or "read".
    pub action: &'static str,
    /// What the system said.
    pub source: std::io::Error,
}

/// A directory for temporary files, removed with all that is in it when the last copy of this value is dropped.
#[derive(Clone, Debug)]
pub struct TemporaryDirectory(Arc<Directory>);

#[derive(Debug)]
struct Directory {
    path: PathBuf,
    bytes: AtomicU64,
    most_bytes: AtomicU64,
}

impl TemporaryDirectory {
    /// Makes a new directory within `parent`.
    ///
    /// # Errors
    /// Where that is not possible.
    pub fn create(parent: &Path) -> Result<Self, TemporaryError> {
        let mut number = 0;
        loop {
            let path = parent.join(format!("lodpack-{}-{number}.tmp", std::process::id()));
            match fs::create_dir(&path) {
                Ok(()) => {
                    let (bytes, most_bytes) = (AtomicU64::new(0), AtomicU64::new(0));
                    return Ok(Self(Arc::new(Directory { path, bytes, most_bytes })));
                }
                // Another build of this process, or one that was killed.
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
                Err(source) => return Err(TemporaryError { path, action: "made", source }),
            }
        }
    }

    /// Where a file of the directory is.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path.join(name)
    }

    /// Removes a file that is not needed any more; one that is not there is none of anybody's concern.
    pub fn remove(&self, path: &Path) {
        if let Ok(metadata) = fs::metadata(path)
            && fs::remove_file(path).is_ok()
        {
            self.0.bytes.fetch_sub(metadata.len(), Ordering::Relaxed);
        }
    }

    /// The most bytes that all files together had at a time.
    pub fn most_bytes(&self) -> u64 {
        self.0.most_bytes.load(Ordering::Relaxed)
    }

    fn count(&self, bytes: u64) {
        let now = self.0.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.0.most_bytes.fetch_max(now, Ordering::Relaxed);
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        // Nothing more can be done about a failure here; the name says that it is no product.
        let _ = fs::remove_dir_all(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn records_come_back_and_go_with_the_directory() {
        let parent = tempfile::tempdir().unwrap();
        let directory = TemporaryDirectory::create(parent.path()).unwrap();
        let points: Vec<DVec3> = (0..100_000).map(|i| DVec3::new(f64::from(i), -0.0, 1.0 / f64::from(i))).collect();
        let mut writer = RecordWriter::create(&directory, "points").unwrap();
        writer.push_all(&points).unwrap();
        let path = writer.finish().unwrap();
        let read = RecordReader::<DVec3>::open(&path).unwrap().read_all().unwrap();
        assert!(
            read.iter().zip(&points).all(|(a, b)| a.to_array().map(f64::to_bits) == b.to_array().map(f64::to_bits))
        );
        assert_eq!((read.len(), directory.most_bytes()), (points.len(), 2_400_000));

        let lookup = Lookup::open(&path).unwrap();
        assert!((0..100_000).rev().step_by(7).all(|i| lookup.position(i).x == f64::from(i)));
        assert_eq!(lookup.count(), 100_000);
        // More is added behind what is there, and counts.
        let mut writer = RecordWriter::append(&directory, "points").unwrap();
        writer.push_all(&points[..1]).unwrap();
        writer.finish().unwrap();
        assert_eq!(RecordReader::<DVec3>::open(&path).unwrap().read_all().unwrap().len(), 100_001);
        directory.remove(&path);
        directory.remove(&path);
        drop((lookup, directory));
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
    }

    #[test]
    fn errors_name_the_file() {
        let parent = tempfile::tempdir().unwrap();
        let error = TemporaryDirectory::create(&parent.path().join("nowhere")).unwrap_err();
        assert!(error.to_string().contains("nowhere"), "{error}");
        assert!(RecordReader::<u32>::open(&parent.path().join("nothing")).is_err());
    }
}
