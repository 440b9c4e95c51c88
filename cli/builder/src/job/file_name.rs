//! Names for files and jobs that were given none: they are named after their input, and lie beside it.

use std::fs;
use std::path::{Path, PathBuf};

use super::{JobError, MANIFEST_NAME, Manifest};

/// How lodpack files are named.
pub const FILE_EXTENSION: &str = "lodpack";
/// How the directories of jobs are named, where `lodpack plan` chooses the name.
pub const JOB_EXTENSION: &str = "job";

/// The path beside an input that has its name and another extension: `mesh.obj` gives `mesh.lodpack`, and the directory
/// `atlas/` gives `atlas.lodpack`.
pub fn beside(input: &Path, extension: &str) -> PathBuf {
    let input = named(input);
    match input.is_dir() {
        true => {
            let mut name = input.file_name().unwrap_or_default().to_owned();
            name.push(".");
            name.push(extension);
            input.with_file_name(name)
        }
        false => input.with_extension(extension),
    }
}

/// The name of the file that a job is merged to: that of a job called `NAME.job`, else that of its first input.
pub(super) fn product_name(job: &Path, inputs: &[PathBuf]) -> PathBuf {
    let job = named(job);
    let is_named = job.extension().is_some_and(|extension| extension == JOB_EXTENSION);
    let path = match inputs.first() {
        Some(input) if !is_named => beside(input, FILE_EXTENSION),
        _ => job.with_extension(FILE_EXTENSION),
    };
    path.file_name().map(PathBuf::from).unwrap_or_default()
}

/// The file that parts are merged to where no name is given: beside their job, with the name that was planned. A
/// directory of parts that is in no job gives the file its own name. None for parts that are named one by one and are
/// in no job.
///
/// # Errors
/// If the job's manifest cannot be read.
pub fn merged_file(parts: &[PathBuf]) -> Result<Option<PathBuf>, JobError> {
    let folder_of = |part: &PathBuf| if part.is_dir() { Some(named(part)) } else { part.parent().map(named) };
    let mut folders = parts.iter().map(folder_of);
    let Some(Some(folder)) = folders.next() else { return Ok(None) };
    if folders.any(|other| other.as_ref() != Some(&folder)) {
        return Ok(None);
    }
    let Some(job) = job_of(&folder) else {
        return Ok(parts[0].is_dir().then(|| beside(&folder, FILE_EXTENSION)));
    };
    let manifest = Manifest::read(&job)?;
    if manifest.parts.is_empty() && manifest.stages.is_none() {
        return Err(JobError::NotPlanned { path: job });
    }
    // Only ever a name: the manifest does not say where files are written.
    Ok(manifest.output.file_name().map(|name| named(&job).with_file_name(name)))
}

/// The job that a directory is of: itself, or the one that it lies in.
pub(super) fn job_of(folder: &Path) -> Option<PathBuf> {
    let above = folder.parent().map(|above| if above.as_os_str().is_empty() { Path::new(".") } else { above });
    let jobs = [Some(folder), above].into_iter().flatten();
    jobs.map(Path::to_owned).find(|folder| folder.join(MANIFEST_NAME).exists())
}

/// A path that ends in a name, where there is one: `.`, `..` and nothing at all do not.
fn named(path: &Path) -> PathBuf {
    let here = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    match here.file_name() {
        // Without what may follow the name, as a slash.
        Some(_) => here.components().collect(),
        None => fs::canonicalize(here).unwrap_or_else(|_| here.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_directories_give_their_name() {
        let dir = tempfile::tempdir().unwrap();
        let atlas = dir.path().join("atlas.v2");
        fs::create_dir(&atlas).unwrap();
        assert_eq!(beside(&atlas.join(""), FILE_EXTENSION), dir.path().join("atlas.v2.lodpack"));
        assert_eq!(beside(&atlas.join("."), FILE_EXTENSION), dir.path().join("atlas.v2.lodpack"));
        for (input, file) in [("mesh.obj", "mesh.lodpack"), ("a/scan.v2.ply", "a/scan.v2.lodpack"), ("x", "x.lodpack")]
        {
            assert_eq!(beside(Path::new(input), FILE_EXTENSION), Path::new(file));
        }
        let here = std::env::current_dir().unwrap();
        assert_eq!(
            beside(Path::new("."), "job").file_name(),
            Some(format!("{}.job", here.file_name().unwrap().display()).as_ref())
        );
    }

    #[test]
    fn a_job_is_merged_to_its_own_name_or_its_inputs() {
        let name = |job: &str| product_name(Path::new(job), &["tiles/a.ply".into(), "b.ply".into()]);
        assert_eq!(name("land.job/"), Path::new("land.lodpack"));
        assert_eq!(name("x/job"), Path::new("a.lodpack"));
        assert_eq!(name("job.d"), Path::new("a.lodpack"));
    }
}
