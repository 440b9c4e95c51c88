//! Building the parts of a planned job.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::heights::HeightsPlan;
use super::part::{PartHead, PartReader, PartWriter, part_name};
use super::plan::read_plan;
use super::status::PartReport;
use super::{BuildError, JobError, Manifest, PartEntry};
use crate::pipeline::summary::{Stopwatch, Times};
use crate::pipeline::{Plan, RegionProduct, RegionSize, Studio, build_region};
use crate::region::{MEMORY_OPTION, RegionDirectory, RegionError};
use lodpack_runtime::machine::peak_memory_bytes;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::{JobId, Lock, WorkDirectory, WorkError};

/// A part that was built, or was there already.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BuiltPart {
    /// Its file.
    pub path: PathBuf,
    /// What building it took; none if it existed already.
    pub report: Option<PartReport>,
}

/// A job whose parts can be built, by any number of processes at the same time.
#[derive(Debug)]
pub struct PlannedJob {
    directory: WorkDirectory,
    manifest: Manifest,
    content: Content,
}

/// What the parts of a job are made of.
#[derive(Debug)]
enum Content {
    Mesh { plan: Box<Plan>, sizes: Vec<RegionSize> },
    Heights(Box<HeightsPlan>),
}

impl PlannedJob {
    /// Opens the directory of a job that has been planned.
    ///
    /// # Errors
    /// [`JobError`] if there is no job, or its planning has not finished.
    pub fn open(path: &Path) -> Result<Self, JobError> {
        let manifest = Manifest::read(path)?;
        if manifest.parts.is_empty() {
            return Err(JobError::NotPlanned { path: path.to_owned() });
        }
        let directory = WorkDirectory::visit(path)?;
        let content = match manifest.heights {
            true => Content::Heights(Box::new(HeightsPlan::read(path, manifest.id())?)),
            false => {
                let (plan, sizes) = read_plan(path, manifest.id())?;
                Content::Mesh { plan: Box::new(plan), sizes }
            }
        };
        let parts = path.join(PARTS_NAME);
        fs::create_dir_all(&parts).map_err(|source| WorkError::new(&parts, "made", source))?;
        Ok(Self { directory, manifest, content })
    }

    /// The number of parts.
    pub fn parts(&self) -> u32 {
        self.manifest.parts.len() as u32
    }

    /// Whether the job makes a file of heights.
    pub fn is_of_heights(&self) -> bool {
        self.manifest.heights
    }

    /// The number of input triangles in a part; 0 where there is no such part.
    pub fn triangles(&self, part: u32) -> u64 {
        self.manifest.parts.get(part as usize).map_or(0, |entry| entry.triangles)
    }

    /// Checks that there is a part of this number.
    ///
    /// # Errors
    /// [`JobError::NoPart`].
    pub fn check_part(&self, part: u32) -> Result<(), JobError> {
        let parts = self.parts();
        if part < parts { Ok(()) } else { Err(JobError::NoPart { part, parts }) }
    }

    /// Whether a part is there, by the beginning of its file. Whoever uses it checks the rest.
    pub(super) fn has_part(&self, part: u32) -> bool {
        let Some(entry) = self.manifest.parts.get(part as usize) else { return false };
        let regions = entry.first_region..entry.first_region + entry.regions;
        PartReader::open(&PartFiles::new(self.directory.folder(), part).path)
            .is_ok_and(|there| there.job == self.manifest.part_id() && there.head.regions == regions)
    }

    /// Builds a part, unless it exists already, in the job's directory or to `output`.
    ///
    /// # Errors
    /// [`JobError`], and [`RegionError::Memory`] if `memory` bytes are too few. The job's directory keeps the reason.
    pub fn build(
        &self,
        part: u32,
        memory: u64,
        output: Option<&Path>,
        progress: &dyn Progress,
    ) -> Result<BuiltPart, BuildError> {
        let files = PartFiles::new(self.directory.folder(), part);
        let entry = self.manifest.parts.get(part as usize).ok_or(JobError::NoPart { part, parts: self.parts() })?;
        let lock = Lock::try_take(&files.lock)?;
        let built = self.build_locked(part, entry, memory, output.unwrap_or(&files.path), progress);
        let noted = match &built {
            Ok(BuiltPart { report: Some(report), .. }) => {
                let text = serde_json::to_string(report).map_err(std::io::Error::other);
                text.and_then(|text| fs::write(&files.report, text)).and(fs::remove_file(&files.failure))
            }
            Ok(_) => Ok(()),
            Err(error) => fs::write(&files.failure, chain(error)),
        };
        // Only `status` reads these notes, so a failure to write them is ignored.
        drop((noted, lock));
        built
    }

    fn build_locked(
        &self,
        part: u32,
        entry: &PartEntry,
        memory: u64,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<BuiltPart, BuildError> {
        if memory < entry.memory {
            return Err(RegionError::Memory { option: MEMORY_OPTION, memory, least: entry.memory }.into());
        }
        let watch = Stopwatch::default();
        let bytes = match &self.content {
            Content::Mesh { plan, sizes } => self.build_regions(part, entry, (plan, sizes), memory, path, progress)?,
            Content::Heights(plan) => {
                let of = (part, self.parts(), entry.first_region..entry.first_region + entry.regions);
                plan.build_part(self.directory.folder(), self.manifest.id(), of, path, progress)?
            }
        };
        let Some(bytes) = bytes else { return Ok(BuiltPart { path: path.to_owned(), report: None }) };
        let (wall, cpu) = watch.total();
        let report = PartReport {
            bytes,
            seconds: wall.as_secs_f64(),
            cpu_seconds: cpu.as_secs_f64(),
            peak_memory_bytes: peak_memory_bytes(),
        };
        Ok(BuiltPart { path: path.to_owned(), report: Some(report) })
    }

    /// Builds a part of a mesh, and returns the size of its file; none if it existed already.
    fn build_regions(
        &self,
        part: u32,
        entry: &PartEntry,
        (plan, all_sizes): (&Plan, &[RegionSize]),
        memory: u64,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<u64>, BuildError> {
        let (id, of_part) = (self.manifest.id(), self.manifest.part_id());
        let regions = entry.first_region..entry.first_region + entry.regions;
        let head = PartHead::new([part, self.parts()], regions.clone(), plan);
        let sizes = all_sizes.get(regions.start as usize..regions.end as usize).unwrap_or_default();
        let charts = sizes.iter().map(|size| size.charts).sum();
        progress.begin("roots", charts);
        let is_same = |there: &PartReader| there.job == of_part && there.head == head;
        if PartReader::open(path).is_ok_and(|there| is_same(&there) && there.finish().is_ok()) {
            progress.skip(charts);
            return Ok(None);
        }
        let store = RegionDirectory::charted(self.directory.clone(), id, all_sizes.len());
        // An empty part can be made again at once, so it need not reach the disk.
        let sync = !regions.is_empty();
        let (bytes, _) = write_part(&store, of_part, &head, path, sync, memory, progress)?;
        Ok(Some(bytes))
    }
}

/// Builds the regions of a part, or takes products that exist already, and writes them to its file one by one. Returns
/// the file's size, and the processor time by stage.
pub(super) fn write_part(
    store: &RegionDirectory,
    job: JobId,
    head: &PartHead,
    path: &Path,
    sync: bool,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(u64, Times), BuildError> {
    let mut times = Times::default();
    let mut writer = PartWriter::create(path, job, head)?;
    let note = |text: &str| progress.note(text);
    let studio = Studio::new(&head.plan.appearance, Some(store.folder()), store.folder(), memory, &note);
    for region in head.regions.clone() {
        if let Some(product) = store.product::<RegionProduct>(region as usize) {
            progress.skip(product.stats.roots.total());
            writer.put(&product)?;
            continue;
        }
        let (region, seams) = store.load_charted(region as usize)?;
        let product = build_region(&region, &seams, &head.plan, &studio, progress)?;
        drop(region);
        times.add(&product.stats.times);
        writer.put(&product)?;
    }
    Ok((writer.finish(sync)?, times))
}

/// The files of a part within a job.
pub(super) struct PartFiles {
    pub path: PathBuf,
    pub lock: PathBuf,
    pub report: PathBuf,
    pub failure: PathBuf,
}

/// The folder of parts within a job's directory.
pub const PARTS_NAME: &str = "parts";

impl PartFiles {
    pub fn new(job: &Path, part: u32) -> Self {
        let named = |extension: &str| job.join(PARTS_NAME).join(format!("part-{part}.{extension}"));
        Self {
            path: job.join(PARTS_NAME).join(part_name(part)),
            lock: named("lock"),
            report: named("json"),
            failure: named("failed"),
        }
    }
}

/// An error's message with those of all its causes.
pub(super) fn chain(error: &dyn std::error::Error) -> String {
    let reasons = std::iter::successors(Some(error), |error| error.source());
    reasons.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}
