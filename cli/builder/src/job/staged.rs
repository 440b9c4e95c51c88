//! Jobs whose planning is divided into tasks, too: their beginning, and one task at a time.
//!
//! Processes meet in the job's directory alone. A task takes a lock, hands on a sealed file, and can be done again
//! after any end of the process that had it.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell, RefCell};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::file_name::product_name;
use super::planned::chain;
use super::stage::TaskFiles;
use super::status::PartReport;
use super::tasks::{AllRuns, Task};
use super::{BuildError, BuildOptions, JobError, Manifest, PartOptions, PlannedJob, Stage, Stages};
use crate::pipeline::PipelineError;
use crate::pipeline::summary::Stopwatch;
use lodpack_import::{RangedMesh, Ways};
use lodpack_runtime::machine::peak_memory_bytes;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::{least_bytes, region_bytes};
use lodpack_runtime::storage::{Lock, STAGES_NAME, WorkDirectory, WorkError};

/// The least bytes of input in a range by default: a range of less would hardly be worth a process.
const RANGE_BYTES: u64 = 64 << 20;

/// A job whose tasks can be done by any number of processes at the same time.
#[derive(Debug)]
pub struct StagedJob {
    directory: WorkDirectory,
    manifest: Manifest,
    stages: Stages,
    /// The last stage that was found to be able to begin.
    begun: Cell<Option<Stage>>,
    /// The parts, once one is built.
    planned: OnceCell<PlannedJob>,
    /// What [`Stage::Divide`] has sent to the regions, once a task of this process has needed it.
    runs: OnceCell<AllRuns>,
    /// Sizes and time stamps with which the inputs were found to be unchanged.
    unchanged: RefCell<Option<Vec<(u64, u64)>>>,
}

/// What became of a task.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// This process did it.
    Done(PartReport),
    /// It was done before.
    WasDone,
    /// Another process is doing it.
    Taken,
}

/// Bytes of memory for the largest region that is to be expected.
fn region_memory(mesh: Option<&RangedMesh>, region_triangles: u64) -> u64 {
    // Where no triangle shares a vertex, there are three for each. Where most do, regions along the border of a surface
    // have more.
    let (vertices, triangles) = mesh.map_or((3, 1), |mesh| (mesh.vertex_count() * 3 / 2, mesh.triangle_count()));
    let largest = if mesh.is_some() { triangles.min(region_triangles) } else { region_triangles };
    let share = (vertices as f64 / triangles.max(1) as f64).min(3.0);
    least_bytes(region_bytes((share * largest as f64) as u64, largest))
}

impl StagedJob {
    /// Begins a job in a new directory, or finds it there. Of its inputs only samples are read.
    ///
    /// # Errors
    /// As for plans, and where the inputs cannot be divided.
    pub fn begin(
        path: &Path,
        parts: PartOptions,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Manifest, BuildError> {
        let absolute = |path: &PathBuf| {
            std::path::absolute(path).map_err(|source| BuildError::from(WorkError::new(path, "read", source)))
        };
        // Workers may run anywhere.
        let inputs = options.inputs.iter().map(absolute).collect::<Result<_, _>>()?;
        let ground = options.ground.iter().map(absolute).collect::<Result<_, _>>()?;
        let options = BuildOptions { inputs, ground, ..options.clone() }.checked(progress)?;
        if let Some(atlas) = options.inputs.iter().find(|input| input.is_dir()) {
            let what = format!("{} is an atlas, which cannot be divided; omit --stages", atlas.display());
            return Err(PipelineError::Tolerance { what }.into());
        }
        let mut manifest = Manifest::sampled(&options)?;
        let ways = Ways::of(&options.inputs, &options.model.channels)?;
        let mesh = match ways {
            Ways::Places => RangedMesh::open(&options.inputs, &options.model.channels, None)?,
            Ways::Lines | Ways::Whole => None,
        };
        let bytes: u64 = manifest.inputs.iter().map(|file| file.bytes).sum();
        let count =
            parts.count.unwrap_or_else(|| u32::try_from(bytes.div_ceil(RANGE_BYTES)).unwrap_or(u32::MAX).max(1));
        let ranges = bytes.div_ceil(parts.range_bytes.unwrap_or(RANGE_BYTES).max(1));
        let ranges = u32::try_from(ranges).unwrap_or(u32::MAX).clamp(1, count);
        let memory = region_memory(mesh.as_ref(), options.model.region_triangles);
        manifest.stages = Some(Stages { ranges, parts: count, ways, memory });
        manifest.output = product_name(path, &options.inputs);
        if options.resume && path.exists() {
            match Manifest::read(path) {
                Ok(there) => {
                    let what = match there.difference(&manifest) {
                        None if there.stages == manifest.stages => match there.changed_since(path, &manifest) {
                            None => return Ok(there),
                            Some(input) => format!("{} has changed since it was begun", input.display()),
                        },
                        None => "it was begun with other parts or without --stages".into(),
                        Some(what) => what,
                    };
                    return Err(JobError::Changed { path: path.to_owned(), what }.into());
                }
                Err(JobError::NoJob { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        let directory = match path.exists() && options.resume {
            true => WorkDirectory::open(path)?,
            false => WorkDirectory::create(path)?,
        };
        let folder = path.join(STAGES_NAME);
        fs::create_dir_all(&folder).map_err(|source| WorkError::new(&folder, "made", source))?;
        manifest.write(path)?;
        directory.keep(true);
        Ok(manifest)
    }

    /// Opens a job. One that was planned at once has only its parts left.
    ///
    /// # Errors
    /// [`JobError`] if there is no job, or it is being planned at once.
    pub fn open(path: &Path) -> Result<Self, JobError> {
        let manifest = Manifest::read(path)?;
        let stages = match manifest.stages {
            Some(stages) => stages,
            None if manifest.parts.is_empty() => return Err(JobError::NotPlanned { path: path.to_owned() }),
            None => Stages { parts: manifest.parts.len() as u32, ..Stages::default() },
        };
        Ok(Self {
            directory: WorkDirectory::visit(path)?,
            manifest,
            stages,
            begun: Cell::new(None),
            planned: OnceCell::new(),
            runs: OnceCell::new(),
            unchanged: RefCell::default(),
        })
    }

    /// The job's directory.
    pub fn folder(&self) -> &Path {
        self.directory.folder()
    }

    /// How the job is divided.
    pub fn stages(&self) -> Stages {
        self.stages
    }

    /// The number of tasks of a stage that are left to do in this job at all.
    pub fn tasks(&self, stage: Stage) -> u32 {
        match self.manifest.stages {
            None if stage != Stage::Build => 0,
            _ => self.stages.tasks(stage),
        }
    }

    /// Checks that a stage has a task of this number.
    ///
    /// # Errors
    /// [`JobError::NoTask`].
    pub fn check_task(&self, stage: Stage, task: u32) -> Result<(), JobError> {
        let tasks = self.tasks(stage);
        if task < tasks { Ok(()) } else { Err(JobError::NoTask { stage, task, tasks }) }
    }

    /// Whether a task is done.
    pub fn is_done(&self, stage: Stage, task: u32) -> bool {
        TaskFiles::new(self.directory.folder(), stage, task).product.exists()
    }

    /// Rough measures of how long the tasks of a stage take: four steps for each factor of two. Empty where that is not
    /// known.
    pub(super) fn weights(&self, stage: Stage) -> Vec<u32> {
        let triangles = match stage {
            Stage::Build => {
                self.planned().ok().map(|planned| (0..planned.parts()).map(|part| planned.triangles(part)).collect())
            }
            _ => self.task(&self.manifest, 0, u64::MAX).triangles(stage),
        };
        // The leading bit and the two after it.
        let weight = |triangles: u64| {
            let leading = triangles.max(1).ilog2();
            4 * leading + ((triangles.unbounded_shl(2) >> leading) & 3) as u32
        };
        triangles.unwrap_or_default().into_iter().map(weight).collect()
    }

    fn task<'a>(&'a self, manifest: &'a Manifest, task: u32, memory: u64) -> Task<'a> {
        Task { directory: &self.directory, manifest, stages: self.stages, task, memory, runs: &self.runs }
    }

    /// The parts, once the job is planned.
    fn planned(&self) -> Result<&PlannedJob, JobError> {
        match self.planned.get() {
            Some(planned) => Ok(planned),
            None => {
                let planned = PlannedJob::open(self.directory.folder())?;
                Ok(self.planned.get_or_init(|| planned))
            }
        }
    }

    /// Does a task, unless it is done or another process is doing it. The job's directory keeps a report, or the reason
    /// of a failure.
    ///
    /// # Errors
    /// [`JobError::NoTask`], [`JobError::Early`] if an earlier stage is not done, and all that can go wrong with the
    /// task itself.
    pub fn run(&self, stage: Stage, task: u32, memory: u64, progress: &dyn Progress) -> Result<Outcome, BuildError> {
        self.check_task(stage, task)?;
        if stage != Stage::Build && self.is_done(stage, task) {
            return Ok(Outcome::WasDone);
        }
        self.check_earlier(stage)?;
        if stage == Stage::Build {
            return self.build(task, memory, progress);
        }
        let files = TaskFiles::new(self.directory.folder(), stage, task);
        let manifest = self.current(stage)?;
        let lock = match Lock::try_take(&files.lock) {
            Ok(lock) => lock,
            Err(error) if error.source.kind() == io::ErrorKind::WouldBlock => return Ok(Outcome::Taken),
            Err(error) => return Err(error.into()),
        };
        // Another process may have done it since.
        if self.is_done(stage, task) {
            return Ok(Outcome::WasDone);
        }
        let watch = Stopwatch::default();
        let task = Task {
            directory: &self.directory,
            manifest: &manifest,
            stages: self.stages,
            task,
            memory,
            runs: &self.runs,
        };
        let done = self.check_inputs(stage).map_err(BuildError::from);
        let done = done.and_then(|()| task.run(stage, progress));
        // They may have changed while the task read them.
        let done = done.and_then(|bytes| Ok(self.check_inputs(stage).map(|()| bytes)?));
        let (wall, cpu) = watch.total();
        let outcome = done.map(|bytes| PartReport {
            bytes,
            seconds: wall.as_secs_f64(),
            cpu_seconds: cpu.as_secs_f64(),
            peak_memory_bytes: peak_memory_bytes(),
        });
        // Only `status` reads these notes, so a failure to write them is ignored.
        let _ = match &outcome {
            Ok(report) => {
                let text = serde_json::to_string(report).map_err(io::Error::other);
                text.and_then(|text| fs::write(&files.report, text)).and(fs::remove_file(&files.failure))
            }
            Err(error) => fs::write(&files.failure, chain(error)),
        };
        drop(lock);
        outcome.map(Outcome::Done)
    }

    fn build(&self, part: u32, memory: u64, progress: &dyn Progress) -> Result<Outcome, BuildError> {
        let planned = self.planned()?;
        // A worker that looks for what is left need not read what others have built.
        if planned.has_part(part) {
            return Ok(Outcome::WasDone);
        }
        match planned.build(part, memory, None, progress) {
            Ok(built) => Ok(built.report.map_or(Outcome::WasDone, Outcome::Done)),
            Err(error) if error.work().is_some_and(|work| work.source.kind() == io::ErrorKind::WouldBlock) => {
                Ok(Outcome::Taken)
            }
            Err(error) => Err(error),
        }
    }

    /// The manifest as a stage needs it: the last stage of planning adds the parts.
    fn current(&self, stage: Stage) -> Result<Cow<'_, Manifest>, JobError> {
        match stage > Stage::Build && self.manifest.parts.is_empty() {
            true => Ok(Cow::Owned(Manifest::read(self.directory.folder())?)),
            false => Ok(Cow::Borrowed(&self.manifest)),
        }
    }

    /// Refuses to go on with a stage that reads inputs where one has changed.
    fn check_inputs(&self, stage: Stage) -> Result<(), JobError> {
        let stamps = self.manifest.stamps();
        if stage > Stage::Repair || stamps.is_some() && *self.unchanged.borrow() == stamps {
            return Ok(());
        }
        let folder = self.directory.folder();
        if let Some(&input) = self.manifest.changed_inputs(folder).first() {
            return Err(JobError::Stale { path: folder.to_owned(), input: input.to_owned() });
        }
        *self.unchanged.borrow_mut() = stamps;
        Ok(())
    }

    /// Checks that all tasks of earlier stages are done.
    fn check_earlier(&self, stage: Stage) -> Result<(), JobError> {
        if self.begun.get() >= Some(stage) {
            return Ok(());
        }
        for earlier in stage.earlier().rev() {
            let tasks = self.tasks(earlier);
            if let Some(missing) = (0..tasks).find(|&task| !self.is_done(earlier, task)) {
                let path = self.directory.folder().to_owned();
                return Err(JobError::Early { path, stage, earlier, missing });
            }
            // No task of a stage is done before all of the stages before it are.
            if tasks > 0 {
                break;
            }
        }
        self.begun.set(Some(stage));
        Ok(())
    }
}
