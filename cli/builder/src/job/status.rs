//! The state of a job and of its parts.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::heights::HeightsPart;
use super::part::PartReader;
use super::planned::PartFiles;
use super::stage_status::{StageStatus, remaining};
use super::{JobError, Manifest, Stage};
use lodpack_runtime::storage::Lock;

/// What building a part took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartReport {
    /// Size of its file.
    pub bytes: u64,
    /// Elapsed time.
    pub seconds: f64,
    /// Processor time.
    pub cpu_seconds: f64,
    /// Peak memory.
    pub peak_memory_bytes: u64,
}

/// The state of a part.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum PartState {
    /// Its file exists and is sound.
    Done {
        /// Size of the file.
        bytes: u64,
        /// What building it took, where that is known.
        report: Option<PartReport>,
    },
    /// A process is building it.
    Running {
        /// Which one.
        by: String,
    },
    /// The last attempt ended with an error.
    Failed {
        /// Which one.
        reason: String,
    },
    /// Its file exists but is unusable.
    Broken {
        /// Why.
        reason: String,
    },
    /// Nobody has tried to build it.
    Missing,
    /// There is nothing to build: it has no regions, and the merge does without its file.
    Empty,
}

/// A part of a job.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartStatus {
    /// Its number.
    pub part: u32,
    /// The number of its regions.
    pub regions: u32,
    /// Their triangles.
    pub triangles: u64,
    /// Bytes of memory that building it takes.
    pub memory: u64,
    /// Its state.
    #[serde(flatten)]
    pub state: PartState,
}

/// The state of a job.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobStatus {
    /// Its number.
    pub job: String,
    /// Whether its planning has finished.
    pub planned: bool,
    /// Inputs that have changed since it was planned.
    pub changed_inputs: Vec<String>,
    /// The stages of its planning, where that is divided, and that of its parts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageStatus>,
    /// About how many more seconds the tasks will take, if as many run as now. None where that cannot be told yet. The
    /// merge is not counted.
    pub remaining_seconds: Option<f64>,
    /// Its parts.
    pub parts: Vec<PartStatus>,
}

impl JobStatus {
    /// Looks at a job's directory.
    ///
    /// # Errors
    /// [`JobError`] if there is no job in it.
    pub fn of(job: &Path) -> Result<Self, JobError> {
        let manifest = Manifest::read(job)?;
        let parts = (0..).zip(&manifest.parts).map(|(part, entry)| PartStatus {
            part,
            regions: entry.regions,
            triangles: entry.triangles,
            memory: entry.memory,
            state: state_of(job, &manifest, part),
        });
        let stages: Vec<StageStatus> = match manifest.stages {
            Some(stages) => {
                Stage::ALL.into_iter().map(|stage| StageStatus::of(job, stage, stages.tasks(stage))).collect()
            }
            None => vec![],
        };
        Ok(Self {
            remaining_seconds: remaining(&stages),
            stages: stages.into_iter().filter(|stage| stage.tasks > 0).collect(),
            job: manifest.job.clone(),
            planned: !manifest.parts.is_empty(),
            changed_inputs: manifest.changed_inputs(job).iter().map(|path| path.display().to_string()).collect(),
            parts: parts.collect(),
        })
    }

    /// The number of parts that are done, or have nothing to do.
    pub fn done(&self) -> usize {
        self.parts.iter().filter(|part| matches!(part.state, PartState::Done { .. } | PartState::Empty)).count()
    }
}

fn state_of(job: &Path, manifest: &Manifest, part: u32) -> PartState {
    let files = PartFiles::new(job, part);
    if let Some(by) = Lock::holder(&files.lock) {
        return PartState::Running { by };
    }
    let report = || serde_json::from_slice(&fs::read(&files.report).ok()?).ok();
    let found = match manifest.heights {
        true => HeightsPart::check(&files.path).map(|found| (found.job, found.parts)),
        false => PartReader::check(&files.path).map(|found| (found.job, found.parts)),
    };
    match found {
        _ if !files.path.exists() => match fs::read_to_string(&files.failure) {
            Ok(reason) => PartState::Failed { reason },
            Err(_) if manifest.is_empty_part(part) => PartState::Empty,
            Err(_) => PartState::Missing,
        },
        Ok((job, parts)) if job != manifest.part_id() || parts as usize != manifest.parts.len() => {
            PartState::Broken { reason: "it belongs to another plan".into() }
        }
        Ok(_) => PartState::Done { bytes: fs::metadata(&files.path).map_or(0, |m| m.len()), report: report() },
        Err(error) => PartState::Broken { reason: error.source.to_string() },
    }
}
