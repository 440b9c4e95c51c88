//! Where products and the state of builds go, and what to do about state that an earlier build left.

use crate::messages;
use crate::output::{check_folder, shell};
use anyhow::{Context, Result, anyhow, bail};
use lodpack_cli::import::ImportError;
use lodpack_cli::job::{BuildError, FILE_EXTENSION, beside};
use lodpack_cli::storage::{WorkError, is_of_job};
use std::fs;
use std::path::{Path, PathBuf};

/// The path of a product that was not named: beside the first input that was typed, with its name; beside the first
/// file of a pattern.
pub fn beside_first(typed: &[PathBuf], files: &[PathBuf], extension: &str) -> Result<PathBuf> {
    let inputs = if typed.first().is_some_and(|first| first.exists()) { typed } else { files };
    let Some(first) = inputs.first() else { bail!("name at least one input") };
    // A problem of the input must not be reported as one of the output.
    if let Err(source) = fs::metadata(first) {
        return Err(ImportError::Io { path: first.clone(), source }.into());
    }
    if extension == FILE_EXTENSION && first.extension().is_some_and(|found| found == extension) {
        bail!("{}: a file is not built onto itself; name the new one with -o", first.display());
    }
    let product = beside(first, extension);
    if inputs.len() > 1 {
        let (count, name) = (inputs.len(), product.display());
        messages::tell(
            "note",
            &format!("the {count} inputs become one model, {name}, named after the first; -o names it otherwise"),
        );
    }
    Ok(product)
}

/// Refuses a name of another kind of file for a product.
pub fn check_extension(output: &Path) -> Result<()> {
    let extension = output.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    let Some(extension) = extension.filter(|found| MESHES.contains(&found.as_str())) else { return Ok(()) };
    let as_file = output.with_extension(FILE_EXTENSION);
    bail!(
        "{}: this command writes .{FILE_EXTENSION} files; write {} first, and `lodpack extract {} -o {}` makes {} of it",
        output.display(),
        as_file.display(),
        shell(&as_file),
        shell(output),
        extension.to_ascii_uppercase()
    )
}

/// The extensions of meshes that `lodpack extract` writes.
const MESHES: [&str; 4] = ["glb", "obj", "ply", "stl"];

/// Where a build keeps its state if memory does not suffice: always the same path, so that it can be resumed.
pub fn work_directory(output: &Path, temp: Option<&Path>) -> PathBuf {
    let folder = temp.map_or_else(|| folder_beside(output), Path::to_owned);
    let is_device = is_device(output);
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    match is_device {
        true => folder.join(format!("{name}.{}.building", std::process::id())),
        false => folder.join(format!("{name}.building")),
    }
}

/// Decides what becomes of an earlier build's state: it is resumed, removed by --force, or the build is refused.
pub fn begin_in(work: &Path, resume: bool, force: bool) -> Result<()> {
    if !work.exists() || resume {
        return Ok(());
    }
    if force {
        return remove_job(work);
    }
    bail!(
        "an earlier build of this file was stopped, and its state is in {}; continue it with --resume, or discard it with --force",
        work.display()
    )
}

/// Checks that a job can be planned in a directory: it must not exist, be empty, or hold a plan to resume or remove.
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
            bail!("{} is not a job's directory: it holds {}; name another one with -o", job.display(), other.display())
        }
        None if fs::read_dir(job).is_ok_and(|mut entries| entries.next().is_none()) || resume => Ok(()),
        None if force => remove_job(job),
        None => bail!("{} holds a job; continue it with --resume, or plan it anew with --force", job.display()),
    }
}

/// Removes a job's directory, unless it holds other files or a process is working in it.
pub fn remove_job(directory: &Path) -> Result<()> {
    let cannot_remove = || format!("cannot remove {}", directory.display());
    for entry in fs::read_dir(directory).with_context(cannot_remove)? {
        let name = entry.with_context(cannot_remove)?.file_name();
        if !name.to_str().is_some_and(is_of_job) {
            bail!(
                "{} is not removed: it holds {}, which is not a job's file; move that away, or name another directory",
                directory.display(),
                name.display()
            );
        }
    }
    // Opening fails while a process works there; dropping what it returns removes the directory.
    lodpack_cli::storage::WorkDirectory::open(directory)?.keep(false);
    Ok(())
}

/// The folder for files that are needed while an output is written: its own, or the system's if the output is a device.
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

/// Adds the output's name to an error of writing it, and advice that depends on the command: `elsewhere` is the option
/// that names another directory.
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
        Some(advice) => anyhow!("{}; {advice}", messages::with_reasons(&error)),
        None => error,
    }
}

/// [`naming`] for a build with its state in `work`: says how to continue if there is state to continue from.
pub fn with_advice(error: BuildError, output: &Path, work: &Path) -> anyhow::Error {
    let can_go_on = error.can_be_resumed() && work.exists();
    let error = naming(error, output, Some("--temp"));
    match can_go_on {
        true => error
            .context("the build stopped, and what it has done is kept; run the same command with --resume to continue"),
        false => error,
    }
}
