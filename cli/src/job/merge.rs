//! Merging parts.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::file_name::job_of;
use super::part::{PART_EXTENSION, PartReader};
use super::planned::PARTS_NAME;
use super::{JobError, Manifest};
use crate::pipeline::summary::{BuildSummary, Stopwatch, shell};
use crate::pipeline::{BuildError, Plan, Products, RegionFacts, Times, join};
use crate::progress::Progress;
use crate::storage::{JobId, WorkError};
use lodpack::{Piece, PieceIndex};

/// The parts of one job, complete and undamaged.
pub struct Parts {
    plan: Plan,
    /// By number.
    files: Vec<PathBuf>,
    /// Inputs that have changed since the job was planned, where they can be seen.
    pub changed_inputs: Vec<PathBuf>,
}

/// What the parts have to belong to.
struct Expected {
    job: JobId,
    parts: u32,
}

impl Parts {
    /// Finds and checks parts: those in a directory (of a job, or any), or files by name.
    ///
    /// # Errors
    /// [`JobError::Parts`] names every part that is missing, damaged or of another job, and what is to be done.
    pub fn check(paths: &[PathBuf], progress: &dyn Progress) -> Result<Self, JobError> {
        let mut files = vec![];
        let mut job = None;
        for path in paths {
            if path.is_dir() {
                let here = job_of(path);
                let folder = if here.as_ref() == Some(path) { path.join(PARTS_NAME) } else { path.clone() };
                job = here.or(job);
                files.extend(parts_in(&folder)?);
            } else {
                files.push(path.clone());
            }
        }
        let manifest = job.as_deref().map(Manifest::read).transpose()?;
        let expected = manifest.as_ref().filter(|manifest| !manifest.parts.is_empty());
        let expected = expected.map(|m| Expected { job: m.id(), parts: m.parts.len() as u32 });
        if files.is_empty() && expected.is_none() {
            return Err(JobError::NoParts { path: paths.first().cloned().unwrap_or_default() });
        }
        let changed = manifest.iter().flat_map(|manifest| manifest.changed_inputs());
        let changed_inputs = changed.map(Path::to_owned).collect();
        let (plan, files) = checked(files, expected, job.as_deref(), progress)?;
        Ok(Self { plan, files, changed_inputs })
    }
}

fn parts_in(folder: &Path) -> Result<Vec<PathBuf>, JobError> {
    let unreadable = |source| WorkError::new(folder, "read", source);
    let mut files = vec![];
    if folder.exists() {
        for entry in fs::read_dir(folder).map_err(unreadable)? {
            files.push(entry.map_err(unreadable)?.path());
        }
    }
    files.retain(|path| path.extension().is_some_and(|extension| extension == PART_EXTENSION));
    files.sort();
    Ok(files)
}

/// All parts by number, and their plan.
fn checked(
    files: Vec<PathBuf>,
    mut expected: Option<Expected>,
    job: Option<&Path>,
    progress: &dyn Progress,
) -> Result<(Plan, Vec<PathBuf>), JobError> {
    let repair = |part: u32| {
        let job = job.map_or("JOB".into(), shell);
        format!("`lodpack build --job {job} --part {part}` makes it")
    };
    let mut plan: Option<Plan> = None;
    let mut found: BTreeMap<u32, PathBuf> = BTreeMap::new();
    // Parts that are there but of no use are not missing as well.
    let (mut problems, mut broken) = (vec![], BTreeSet::new());
    progress.begin("check", files.len() as u64);
    for path in files {
        progress.advance(1);
        let named = path.display();
        // Nothing that a damaged file says of itself counts, but for its name.
        let read = PartReader::open(&path).and_then(|part| {
            let (head, id) = (part.head.clone(), part.job);
            part.finish().map(|()| (head, id))
        });
        let problem = match read {
            Err(error) => format!("{named}: {}; {}", error.source, again(&path, &repair)),
            Ok((head, id)) => {
                let Expected { job, parts } = *expected.get_or_insert(Expected { job: id, parts: head.parts });
                let number = head.part;
                if id != job {
                    format!("{named} belongs to another job ({id} instead of {job}); take it away")
                } else if head.parts != parts {
                    let count = head.parts;
                    let again = again(&path, &repair);
                    format!("{named} is part {number} of {count} of the same job, but there are to be {parts}; {again}")
                } else if plan.get_or_insert_with(|| head.plan.clone()) != &head.plan {
                    format!("{named} was built after another plan; {}", repair(number))
                } else if let Some(other) = found.get(&number).filter(|other| !same(other, &path)) {
                    format!("{named} and {} are both part {number}, and differ; take one away", other.display())
                } else {
                    found.entry(number).or_insert(path);
                    continue;
                }
            }
        };
        broken.extend(number_of(&path));
        problems.push(problem);
    }
    let parts = expected.map_or(0, |expected| expected.parts);
    let missing = (0..parts).filter(|part| !found.contains_key(part) && !broken.contains(part));
    problems.extend(missing.map(|part| format!("part {part} is missing; {}", repair(part))));
    match plan {
        Some(plan) if problems.is_empty() && found.len() == parts as usize => Ok((plan, found.into_values().collect())),
        _ => Err(JobError::Parts { parts, problems }),
    }
}

/// How to make a file again whose name is all that is known of it.
fn again(path: &Path, repair: &impl Fn(u32) -> String) -> String {
    number_of(path).map_or("take it away".into(), repair)
}

/// The number of a part by its name.
fn number_of(path: &Path) -> Option<u32> {
    let stem = path.file_stem()?.to_str()?;
    stem.rsplit(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

/// Whether two files hold the same.
fn same(a: &Path, b: &Path) -> bool {
    let read = |path| fs::read(path).ok();
    fs::metadata(a).ok().map(|m| m.len()) == fs::metadata(b).ok().map(|m| m.len()) && read(a) == read(b)
}

/// Joins parts to a file. Of what lies in files a few regions are in memory at a time; symbols and pages wait in files in the
/// directory `scratch`.
///
/// # Errors
/// Where a file cannot be read any more, or regions do not fit together.
pub fn merge(
    parts: &Parts,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    let files = PartProducts { paths: parts.files.clone() };
    join(&parts.plan, &files, scratch, out, progress, Stopwatch::default(), Times::default())
}

/// The products of regions in parts.
pub(super) struct PartProducts {
    /// By number.
    pub paths: Vec<PathBuf>,
}

impl Products for PartProducts {
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, RegionFacts>, Cow<'_, PieceIndex>), BuildError>> {
        let heads = self.paths.iter().flat_map(|path| Regions::new(path, PartReader::head, false));
        heads.map(|head| head.map(|(facts, index)| (Cow::Owned(facts), Cow::Owned(index))))
    }

    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, BuildError>> {
        self.paths
            .iter()
            .flat_map(|path| Regions::new(path, PartReader::piece, true))
            .map(|piece| piece.map(Cow::Owned))
    }
}

/// What there is of each region of a part.
struct Regions<F> {
    part: Option<PartReader>,
    failure: Option<WorkError>,
    left: u32,
    read: F,
    /// Whether `read` reads all there is, so that the hash can be checked.
    is_checked: bool,
}

impl<F> Regions<F> {
    fn new(path: &Path, read: F, is_checked: bool) -> Self {
        match PartReader::open(path) {
            Ok(part) => {
                Self { left: part.head.regions.len() as u32, part: Some(part), failure: None, read, is_checked }
            }
            Err(error) => Self { left: 0, part: None, failure: Some(error), read, is_checked },
        }
    }
}

impl<T, F: Fn(&mut PartReader) -> Result<T, WorkError>> Iterator for Regions<F> {
    type Item = Result<T, BuildError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.left > 0 {
            self.left -= 1;
            return Some((self.read)(self.part.as_mut()?).map_err(BuildError::from));
        }
        // The hash is behind the last region.
        let part = self.part.take().filter(|_| self.is_checked);
        let failure = self.failure.take().or_else(|| part.and_then(|part| part.finish().err()));
        failure.map(|error| Err(error.into()))
    }
}
