//! Where builds keep their state, and what becomes of it.

use crate::output::check_folder;
use crate::talk;
use anyhow::{Context, Result, anyhow, bail};
use lodpack_cli::job::{BuildError, MANIFEST_NAME, PARTS_NAME, SLURM_NAME};
use lodpack_cli::storage::WorkError;
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

/// Sees to it that there is room for a job: nothing of that name, an empty directory, or what an earlier plan has left.
pub fn begin_job(job: &Path, resume: bool, force: bool) -> Result<()> {
    if job.exists() && !job.is_dir() {
        bail!("{} is a file; name a directory", job.display());
    }
    if !job.exists() {
        return check_folder(job);
    }
    let mut entries = fs::read_dir(job).with_context(|| format!("cannot read {}", job.display()))?.flatten();
    let other = entries.find(|entry| !entry.file_name().to_str().is_some_and(is_of_job));
    match other {
        Some(other) => {
            let other = other.file_name();
            bail!("{} is no job's directory: it holds {}; name another one with -o", job.display(), other.display())
        }
        None if fs::read_dir(job).is_ok_and(|mut entries| entries.next().is_none()) || resume => Ok(()),
        None if force => remove_job(job),
        None => bail!("{} holds a job; go on with --resume, or begin again with --force", job.display()),
    }
}

/// Whether a file may be one of a job's.
fn is_of_job(name: &str) -> bool {
    ["lock", "plan", "divided", "vertices", "triangles", PARTS_NAME, SLURM_NAME, MANIFEST_NAME].contains(&name)
        || ["region-", "part-", MANIFEST_NAME].iter().any(|prefix| name.starts_with(prefix))
        || name.ends_with(".tmp")
}

/// Removes a directory, if it is one of ours and nobody is at work in it.
pub fn remove_job(directory: &Path) -> Result<()> {
    let cannot_remove = || format!("cannot remove {}", directory.display());
    for entry in fs::read_dir(directory).with_context(cannot_remove)? {
        let name = entry.with_context(cannot_remove)?.file_name();
        if !name.to_str().is_some_and(is_of_job) {
            bail!(
                "{} is not removed: it holds {}, which is none of a job's files",
                directory.display(),
                name.display()
            );
        }
    }
    // Refused where a process is at work; removed with the lock's value.
    lodpack_cli::storage::WorkDirectory::open(directory)?.keep(false);
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

/// Names the file where that is what could not be written, and says what to do where that depends on the command: `elsewhere` is
/// the option that names another directory for what could not be.
pub fn naming(error: BuildError, output: &Path, elsewhere: Option<&str>) -> anyhow::Error {
    let advice = error.work().and_then(WorkError::advice).map(|(advice, has_choice)| match elsewhere {
        Some(option) if has_choice => format!("{advice}, or name a directory elsewhere with {option}"),
        _ => advice.to_owned(),
    });
    let error = match error.into_output_error() {
        Ok(source) => anyhow::Error::new(source).context(format!("cannot write {}", output.display())),
        Err(other) => other.into(),
    };
    match advice {
        Some(advice) => anyhow!("{}; {advice}", talk::told(&error)),
        None => error,
    }
}

/// As [`naming`], for a build that works in `work`; says how to go on where there is something to go on with.
pub fn with_advice(error: BuildError, output: &Path, work: &Path) -> anyhow::Error {
    let can_go_on = error.can_be_resumed() && work.exists();
    let error = naming(error, output, Some("--temp"));
    match can_go_on {
        true => {
            error.context("the build stopped; what it has done is kept: run the same command with --resume to go on")
        }
        false => error,
    }
}
