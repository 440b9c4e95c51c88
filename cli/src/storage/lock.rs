//! Who is at work.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

use super::WorkError;

/// A file that this process has locked. The system lets go of it when the process ends, in whatever way: nothing has to be
/// cleaned up after one that was killed, and no clock decides whether it is still alive.
#[derive(Debug)]
pub struct Lock(#[expect(dead_code, reason = "it is locked as long as it is open")] File);

impl Lock {
    /// Locks a file, which is made if it is not there, and writes into it who did.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] where another process has it.
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
        // What it says is for people; a full disk is found by those who have more to write.
        let _ = file.set_len(0).and_then(|()| file.write_all(holder.as_bytes()));
        Ok(Self(file))
    }

    /// Locks a file that is there together with others that only read what it stands for; none where it cannot be locked at
    /// all, as on read-only disks.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] where another process has it for itself.
    pub fn try_share(path: &Path) -> Result<Option<Self>, WorkError> {
        let Ok(file) = File::open(path) else { return Ok(None) };
        match file.try_lock_shared() {
            Ok(()) => Ok(Some(Self(file))),
            Err(TryLockError::WouldBlock) => Err(busy(path)),
            Err(TryLockError::Error(_)) => Ok(None),
        }
    }

    /// Whether some process has the lock of a file, and who.
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
