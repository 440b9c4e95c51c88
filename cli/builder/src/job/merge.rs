//! Merging parts into one file.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::encoded::BuiltJob;
use super::file_name::job_of;
use super::heights::HeightsPart;
use super::part::{PART_EXTENSION, PartHead, PartReader};
use super::plan::read_plan;
use super::planned::{PARTS_NAME, chain};
use super::{BuildError, JobError, Manifest};
use crate::pipeline::summary::{BuildSummary, Stopwatch, Times};
use crate::pipeline::{PipelineError, Plan, ProductStats, Products, join};
use crate::region::RegionError;
use lodpack::write::{Piece, PieceIndex};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::{JobId, WorkError};
use lodpack_runtime::text::shell;

/// The parts of one job, complete and undamaged.
pub struct Parts {
    /// None for a file of heights.
    plan: Option<Plan>,
    /// By number.
    pub(super) files: Vec<PathBuf>,
    /// The job, where all its clusters are encoded. Then nothing but that is read.
    encoded: Option<(PathBuf, Manifest)>,
    /// Inputs that have changed since the job was planned, as far as they can be seen from here.
    pub changed_inputs: Vec<PathBuf>,
}

/// What a part's file says.
pub(super) struct FoundPart<P> {
    pub job: JobId,
    pub part: u32,
    pub parts: u32,
    /// How many regions it has.
    pub regions: u32,
    /// How many there are in all, as far as this part knows.
    pub all_regions: Option<u32>,
    /// What all parts have in common.
    pub plan: P,
}

/// The job that all parts have to belong to, and how many it has.
#[derive(Clone, Copy)]
struct Expected {
    job: JobId,
    parts: u32,
}

impl Parts {
    /// Finds and checks parts: those in directories (a job's, or any other), and single files.
    ///
    /// # Errors
    /// [`JobError::Parts`] names every part that is missing, damaged or of another job, and says what to do.
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
        if let ([path], Some(job), Some(manifest)) = (paths, &job, &manifest)
            && path == job
            && let Some(stages) = manifest.stages
            && (BuiltJob { folder: job, manifest, stages }).is_encoded()
        {
            let changed_inputs = manifest.changed_inputs(job).into_iter().map(Path::to_owned).collect();
            let (plan, _) = read_plan(job, manifest.id())?;
            let encoded = Some((job.clone(), manifest.clone()));
            return Ok(Self { plan: Some(plan), files, encoded, changed_inputs });
        }
        let expected = manifest.as_ref().filter(|manifest| !manifest.parts.is_empty());
        let expected = expected.map(|m| Expected { job: m.part_id(), parts: m.parts.len() as u32 });
        if files.is_empty() && expected.is_none() {
            return Err(JobError::NoParts { path: paths.first().cloned().unwrap_or_default() });
        }
        let changed = manifest.iter().zip(&job).flat_map(|(manifest, job)| manifest.changed_inputs(job));
        let changed_inputs = changed.map(Path::to_owned).collect();
        let is_heights = match &manifest {
            Some(manifest) => manifest.heights,
            None => files.first().is_some_and(|file| HeightsPart::is_one(file)),
        };
        let of = (job.as_deref(), manifest.as_ref());
        let (plan, files) = match is_heights {
            true => (None, checked(files, expected, of, progress, HeightsPart::check)?.1),
            false => {
                let (mut plan, files) = checked(files, expected, of, progress, PartReader::check)?;
                for file in &files {
                    let PartHead { regions, nodes, .. } = PartReader::open(file)?.head;
                    if regions.contains(&0) {
                        plan.nodes = nodes;
                        break;
                    }
                }
                (Some(plan), files)
            }
        };
        Ok(Self { plan, files, encoded: None, changed_inputs })
    }

    /// Whether they make a file of heights, which [`super::merge_heights`] joins.
    pub fn are_heights(&self) -> bool {
        self.plan.is_none()
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

/// Checks all parts; returns those that have regions, and any others that are there, by number, and their plan.
fn checked<P: PartialEq>(
    files: Vec<PathBuf>,
    mut expected: Option<Expected>,
    (job, manifest): (Option<&Path>, Option<&Manifest>),
    progress: &dyn Progress,
    check: impl Fn(&Path) -> Result<FoundPart<P>, WorkError>,
) -> Result<(P, Vec<PathBuf>), JobError> {
    let repair = |part: u32| {
        let job = job.map_or("JOB".into(), shell);
        format!("`lodpack build --job {job} --part {part}` makes it")
    };
    let mut plan: Option<P> = None;
    let mut found: BTreeMap<u32, PathBuf> = BTreeMap::new();
    let (mut regions, mut all_regions) = (0, None);
    // A part that exists but is unusable is not also reported as missing.
    let (mut problems, mut broken) = (vec![], BTreeSet::new());
    progress.begin("check", files.len() as u64);
    for path in files {
        progress.advance(1);
        let named = path.display();
        // Nothing that a damaged file says of itself counts, only its name.
        let problem = match check(&path) {
            Err(error) => format!("{named}: {}; {}", error.source, again(&path, &repair)),
            Ok(found_part) => {
                let FoundPart { job: id, part: number, parts: count, plan: of_part, .. } = found_part;
                let Expected { job, parts } = *expected.get_or_insert(Expected { job: id, parts: count });
                if id != job {
                    format!("{named} belongs to another job ({id} instead of {job}); remove it")
                } else if count != parts {
                    let again = again(&path, &repair);
                    format!(
                        "{named} is part {number} of {count} of the same job, but the job has {parts} parts; {again}"
                    )
                } else if plan.as_ref().is_some_and(|plan| *plan != of_part) {
                    format!("{named} was built from another plan; {}", repair(number))
                } else if let Some(other) = found.get(&number).filter(|other| !same(other, &path)) {
                    format!("{named} and {} are both part {number}, but differ; remove one", other.display())
                } else {
                    plan.get_or_insert(of_part);
                    if found.insert(number, path).is_none() {
                        regions += u64::from(found_part.regions);
                        all_regions = all_regions.or(found_part.all_regions);
                    }
                    continue;
                }
            }
        };
        broken.extend(number_of(&path));
        problems.push(problem);
    }
    let parts = expected.map_or(0, |expected| expected.parts);
    // Where all regions are there, parts that are not have none.
    let is_complete = all_regions.is_some_and(|all| regions == u64::from(all));
    let missing = (0..parts).filter(|part| {
        !is_complete
            && !found.contains_key(part)
            && !broken.contains(part)
            && !manifest.is_some_and(|m| m.is_empty_part(*part))
    });
    problems.extend(missing.map(|part| format!("part {part} is missing; {}", repair(part))));
    match plan {
        Some(plan) if problems.is_empty() && (is_complete || found.len() == parts as usize) => {
            Ok((plan, found.into_values().collect()))
        }
        _ => Err(JobError::Parts { parts, problems }),
    }
}

/// How to make a file again of which only the name is known.
fn again(path: &Path, repair: &impl Fn(u32) -> String) -> String {
    number_of(path).map_or("remove it".into(), repair)
}

/// The number of a part, as its file is named.
fn number_of(path: &Path) -> Option<u32> {
    let stem = path.file_stem()?.to_str()?;
    stem.rsplit(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

/// Whether two files have the same content.
fn same(a: &Path, b: &Path) -> bool {
    let read = |path| fs::read(path).ok();
    fs::metadata(a).ok().map(|m| m.len()) == fs::metadata(b).ok().map(|m| m.len()) && read(a) == read(b)
}

/// Joins parts to a file. A few regions are in memory at a time; symbols and pages wait in files in the directory
/// `scratch`.
///
/// # Errors
/// If a part can no longer be read, regions disagree, or `out` cannot be written.
pub fn merge(
    parts: &Parts,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    if let Some((folder, manifest)) = &parts.encoded
        && let Some(stages) = manifest.stages
    {
        match (BuiltJob { folder, manifest, stages }).join(scratch, out, progress) {
            // Nothing was written: the parts have everything, too.
            Err(PipelineError::Region(RegionError::Work(error))) => {
                progress.note(&format!("{}; the parts are merged instead", chain(&error)));
                let expected = Expected { job: manifest.part_id(), parts: manifest.parts.len() as u32 };
                let files = parts.files.clone();
                let (plan, files) =
                    checked(files, Some(expected), (Some(folder), Some(manifest)), progress, PartReader::check)?;
                let parts = Parts { plan: Some(plan), files, encoded: None, changed_inputs: vec![] };
                return merge(&parts, scratch, out, progress);
            }
            done => return Ok(done?),
        }
    }
    let Some(plan) = &parts.plan else { return Err(JobError::NoParts { path: scratch.to_owned() }.into()) };
    let files = PartProducts { paths: parts.files.clone() };
    Ok(join(plan, &files, scratch, out, progress, Stopwatch::default(), Times::default())?)
}

/// The products of regions in parts.
pub(super) struct PartProducts {
    /// By number.
    pub paths: Vec<PathBuf>,
}

impl Products for PartProducts {
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, ProductStats>, Cow<'_, PieceIndex>), PipelineError>> {
        let heads = self.paths.iter().flat_map(|path| RegionsOfPart::new(path, PartReader::head, false));
        heads.map(|head| head.map(|(stats, index)| (Cow::Owned(stats), Cow::Owned(index))))
    }

    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, PipelineError>> {
        self.paths
            .iter()
            .flat_map(|path| RegionsOfPart::new(path, PartReader::piece, true))
            .map(|piece| piece.map(Cow::Owned))
    }
}

/// Reads something of each region of a part.
struct RegionsOfPart<F> {
    part: Option<PartReader>,
    failure: Option<WorkError>,
    left: u32,
    read: F,
    /// Whether `read` reads every byte, so the hash can be checked.
    is_checked: bool,
}

impl<F> RegionsOfPart<F> {
    fn new(path: &Path, read: F, is_checked: bool) -> Self {
        match PartReader::open(path) {
            Ok(part) => {
                Self { left: part.head.regions.len() as u32, part: Some(part), failure: None, read, is_checked }
            }
            Err(error) => Self { left: 0, part: None, failure: Some(error), read, is_checked },
        }
    }
}

impl<T, F: Fn(&mut PartReader) -> Result<T, WorkError>> Iterator for RegionsOfPart<F> {
    type Item = Result<T, PipelineError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.left > 0 {
            self.left -= 1;
            return Some((self.read)(self.part.as_mut()?).map_err(PipelineError::from));
        }
        // The hash follows the last region.
        let part = self.part.take().filter(|_| self.is_checked);
        let failure = self.failure.take().or_else(|| part.and_then(|part| part.finish().err()));
        failure.map(|error| Err(error.into()))
    }
}
