//! Where builds keep their state, and what becomes of it.

use anyhow::{Context, Result, bail};
use lodpack_cli::build::BuildError;
use lodpack_cli::job::{MANIFEST_NAME, PARTS_NAME, SLURM_NAME};
use std::fs;
use std::path::{Path, PathBuf};

/// Where a build of a file works if memory does not do: always the same place, so that it can be gone on with.
pub fn work_directory(output: &Path, temp: Option<&Path>) -> PathBuf {
    let folder = temp.map_or_else(|| folder_beside(output), Path::to_owned);
    let is_device = is_device(output);
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    match is_device {
        true => folder.join(format!("{name}.{}.building", std::process::id())),
        false => folder.join(format!("{name}.building")),
    }
}

/// Sees to it that what is left of an earlier build is neither lost nor in the way.
pub fn begin_in(work: &Path, resume: bool, force: bool) -> Result<()> {
    if !work.exists() || resume {
        return Ok(());
    }
    if force {
        return remove_job(work);
    }
    bail!(
        "a build of this file has begun before and is not finished: its state is in {}; go on with --resume, or begin again with \
         --force",
        work.display()
    )
}

/// Removes a directory, if it is one of ours and nobody is at work in it.
pub fn remove_job(directory: &Path) -> Result<()> {
    let is_ours = |name: &str| {
        ["lock", "plan", "divided", "vertices", "triangles", PARTS_NAME, SLURM_NAME, MANIFEST_NAME].contains(&name)
            || ["region-", "part-", MANIFEST_NAME].iter().any(|prefix| name.starts_with(prefix))
            || name.ends_with(".tmp")
    };
    let cannot_remove = || format!("cannot remove {}", directory.display());
    for entry in fs::read_dir(directory).with_context(cannot_remove)? {
        let name = entry.with_context(cannot_remove)?.file_name();
        if !name.to_str().is_some_and(is_ours) {
            bail!(
                "{} is not removed: it holds {}, which is none of a job's files",
                directory.display(),
                name.display()
            );
        }
    }
    // Refused where a process is at work; removed with the lock's value.
    lodpack_cli::work::WorkDirectory::open(directory)?.keep(false);
    Ok(())
}

/// Where files go that are needed while an output is written: beside it. What is written to a device has no place for others.
pub fn folder_beside(output: &Path) -> PathBuf {
    match output.parent() {
        _ if is_device(output) => std::env::temp_dir(),
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

fn is_device(output: &Path) -> bool {
    output.exists() && !output.is_file()
}

/// Names the file where that is what could not be written.
pub fn naming(error: BuildError, output: &Path) -> anyhow::Error {
    match error {
        BuildError::Write(lodpack::Error::Write { source }) => {
            anyhow::Error::new(source).context(format!("cannot write {}", output.display()))
        }
        other => other.into(),
    }
}

/// Says how to go on where there is something to go on with.
pub fn with_advice(error: anyhow::Error, work: &Path) -> anyhow::Error {
    match work.exists() {
        true => {
            error.context("the build stopped; what it has done is kept: run the same command with --resume to go on")
        }
        false => error,
    }
}
