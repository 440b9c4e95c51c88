//! The ground of a job's mesh. It is a file of heights, which the process that plans makes, and which lies in the job's
//! directory until the merge puts it under the mesh. Parts know nothing of it.

use std::fs::{self, File};
use std::io::{self, Seek};
use std::path::{Path, PathBuf};

use super::file_name::job_of;
use super::{JobError, Manifest};
use lodpack_runtime::storage::WorkError;

/// The ground's name in a job's directory.
pub const GROUND_NAME: &str = "ground.lodpack";

/// Puts a file of heights into the directory of a job whose mesh stands on it.
///
/// # Errors
/// If the directory cannot be written.
pub fn keep_ground(job: &Path, mut ground: &File) -> Result<(), JobError> {
    let path = job.join(GROUND_NAME);
    let temporary = job.join(format!("{GROUND_NAME}.{}.tmp", std::process::id()));
    let mut write = || {
        ground.rewind()?;
        let mut file = File::create(&temporary)?;
        io::copy(&mut ground, &mut file)?;
        file.sync_all()?;
        fs::rename(&temporary, &path)
    };
    write().map_err(|source| {
        let _ = fs::remove_file(&temporary);
        WorkError::new(&path, "written", source).into()
    })
}

/// The ground in the job that parts belong to: the directory of a job, or what lies in one. None without a job, or
/// where it has no ground.
///
/// # Errors
/// If the job's manifest cannot be read, or names a ground that is not there.
pub fn kept_ground(parts: &[PathBuf]) -> Result<Option<PathBuf>, JobError> {
    let folder_of = |part: &PathBuf| if part.is_dir() { Some(part.clone()) } else { part.parent().map(Path::to_owned) };
    let Some(job) = parts.iter().filter_map(folder_of).find_map(|folder| job_of(&folder)) else { return Ok(None) };
    if Manifest::read(&job)?.ground.is_empty() {
        return Ok(None);
    }
    let path = job.join(GROUND_NAME);
    match path.is_file() {
        true => Ok(Some(path)),
        // The process that planned has ended before it wrote it.
        false => {
            let what = "the ground of the job's mesh is not there; run the same `lodpack plan` again with --resume";
            Err(WorkError::damaged(&path, what).into())
        }
    }
}
