//! Locks: which process is at work in a directory or on a part.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

use super::WorkError;

/// A file that this process has locked. The system releases the lock when the process ends in any way: nothing has to
/// be cleaned up after a kill, and no clock decides whether the process is still alive.
#[derive(Debug)]
pub struct Lock(#[expect(dead_code, reason = "the lock lasts as long as the file is open")] File);

impl Lock {
    /// Locks a file, makes it if it is not there, and writes this process's name into it.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] if another process holds the lock.
    pub fn try_take(path: &Path) -> Result<Self, WorkError> {
        let open = File::options().create(true).truncate(false).write(true).open(path);
        let mut file = open.map_err(|source| WorkError::new(path, "made", source))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(busy(path)),
            Err(TryLockError::Error(source)) => return Err(WorkError::new(path, "locked", source)),
        }
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let holder = match host.trim() {
            "" => format!("process {}", std::process::id()),
            host => format!("process {} on {host}", std::process::id()),
        };
        // The name only informs people, so a failure to write it is ignored.
        let _ = file.set_len(0).and_then(|()| file.write_all(holder.as_bytes()));
        Ok(Self(file))
    }

    /// Takes a shared lock on an existing file, beside other processes that only read. None if the file system has no
    /// locks for it, as on read-only disks.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] if another process holds the lock for itself.
    pub fn try_share(path: &Path) -> Result<Option<Self>, WorkError> {
        let Ok(file) = File::open(path) else { return Ok(None) };
        match file.try_lock_shared() {
            Ok(()) => Ok(Some(Self(file))),
            Err(TryLockError::WouldBlock) => Err(busy(path)),
            Err(TryLockError::Error(_)) => Ok(None),
        }
    }

    /// The process that holds the lock of a file, if one does.
    pub fn holder(path: &Path) -> Option<String> {
        let file = File::options().read(true).write(true).open(path).ok()?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => Some(std::fs::read_to_string(path).unwrap_or_default()),
            _ => None,
        }
    }
}

fn busy(path: &Path) -> WorkError {
    let holder = std::fs::read_to_string(path).unwrap_or_default();
    let what = format!("{} is at work", if holder.is_empty() { "another process" } else { &holder });
    WorkError::new(path, "locked", io::Error::new(io::ErrorKind::WouldBlock, what))
}
