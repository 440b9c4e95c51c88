//! Why a build failed, and why a job cannot be worked on.

use std::path::PathBuf;

use super::Stage;
use crate::geometry_images::AtlasError;
use crate::heights::HeightsError;
use crate::pipeline::PipelineError;
use crate::region::RegionError;
use lodpack_import::ImportError;
use lodpack_runtime::storage::WorkError;
use lodpack_runtime::text::shell;

/// Why a build failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A mesh is unusable.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// An atlas directory is unusable.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// Nothing is left of the input.
    #[error("{input}: {reason}")]
    Empty {
        /// The first input.
        input: String,
        /// What became of it.
        reason: PipelineError,
    },
    /// A file of heights cannot be built.
    #[error(transparent)]
    Heights(#[from] HeightsError),
    /// The options do not fit the input, or memory, disk space or the output failed the build.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The job's state is unusable.
    #[error(transparent)]
    Job(#[from] JobError),
}

impl BuildError {
    /// An error of the pipeline, with the name of the input where nothing else names it.
    pub(super) fn of_inputs(error: PipelineError, inputs: &[PathBuf]) -> Self {
        match error {
            reason @ PipelineError::Empty { .. } => {
                let input = inputs.first().map(|path| path.display().to_string()).unwrap_or_default();
                Self::Empty { input, reason }
            }
            other => Self::Pipeline(other),
        }
    }

    /// The file of a build's state, or the temporary file, that is unusable, if that is the reason.
    pub fn work(&self) -> Option<&WorkError> {
        match self {
            Self::Pipeline(PipelineError::Region(RegionError::Work(error)))
            | Self::Import(ImportError::Work(error))
            | Self::Job(JobError::Work(error)) => Some(error),
            _ => None,
        }
    }

    /// What the system said where the output could not be written; the error itself otherwise.
    pub fn into_output_error(self) -> Result<std::io::Error, Self> {
        match self {
            Self::Pipeline(PipelineError::Write(lodpack::Error::Write { source }))
            | Self::Heights(HeightsError::Write(lodpack::Error::Write { source })) => Ok(source),
            other => Err(other),
        }
    }

    /// Whether another attempt, perhaps with more space, can resume where this one stopped.
    pub fn can_be_resumed(&self) -> bool {
        match self {
            Self::Pipeline(PipelineError::Region(RegionError::Work(error))) => {
                error.source.kind() != std::io::ErrorKind::WouldBlock
            }
            Self::Pipeline(PipelineError::Write(_)) => true,
            _ => false,
        }
    }

    /// Whether a part needs more memory than it may have.
    pub fn is_lack_of_memory(&self) -> bool {
        matches!(self, Self::Pipeline(PipelineError::Region(RegionError::Memory { .. })))
    }
}

impl From<RegionError> for BuildError {
    fn from(error: RegionError) -> Self {
        Self::Pipeline(error.into())
    }
}

impl From<WorkError> for BuildError {
    fn from(error: WorkError) -> Self {
        Self::Pipeline(error.into())
    }
}

impl From<lodpack::Error> for BuildError {
    fn from(error: lodpack::Error) -> Self {
        Self::Pipeline(error.into())
    }
}

/// Why a job cannot be worked on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// A file is unusable.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// The directory holds no job.
    #[error("{} holds no job: there is no job.json in it; `lodpack plan` makes one", path.display())]
    NoJob {
        /// The directory.
        path: PathBuf,
    },
    /// Planning has not finished, so the job has no parts yet.
    #[error("planning of the job {} has not finished; run the same `lodpack plan` again with --resume", path.display())]
    NotPlanned {
        /// The directory.
        path: PathBuf,
    },
    /// Another version planned the job.
    #[error(
        "the job {} was planned by lodpack {version}; this is {}, which could build other bytes: plan it again",
        path.display(), env!("CARGO_PKG_VERSION")
    )]
    Version {
        /// The directory.
        path: PathBuf,
        /// The version that planned it.
        version: String,
    },
    /// The directory holds a job of other inputs or options.
    #[error("cannot resume {}: {what}; remove it, or start again with --force", path.display())]
    Changed {
        /// The directory.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// Nothing can be added to the job.
    #[error("{}: {what}", path.display())]
    Extend {
        /// The job, or one of its inputs.
        path: PathBuf,
        /// Why, and what to do.
        what: String,
    },
    /// An input has changed while the job was planned.
    #[error("{} has changed since the job {} was begun; plan it anew with --force", input.display(), path.display())]
    Stale {
        /// The directory.
        path: PathBuf,
        /// The input.
        input: PathBuf,
    },
    /// The job has no task of that number.
    #[error("the stage {stage} of this job has no task {task}; it has {tasks}, numbered from 0")]
    NoTask {
        /// The stage.
        stage: Stage,
        /// The number that was asked for.
        task: u32,
        /// The number of tasks.
        tasks: u32,
    },
    /// A stage cannot begin yet.
    #[error(
        "the stage {stage} has to wait: task {missing} of the stage {earlier} is not done; `lodpack work {}` does what is left, in order",
        shell(path)
    )]
    Early {
        /// The directory.
        path: PathBuf,
        /// The stage that cannot begin.
        stage: Stage,
        /// The stage before it.
        earlier: Stage,
        /// The first task of it that is not done.
        missing: u32,
    },
    /// The job has no part of that number.
    #[error("the job has no part {part}; its {parts} parts are numbered from 0")]
    NoPart {
        /// The number that was asked for.
        part: u32,
        /// The number of parts.
        parts: u32,
    },
    /// Parts cannot be merged.
    #[error("{} of {parts} parts cannot be merged:\n{}", problems.len(), listed(problems))]
    Parts {
        /// How many parts there should be.
        parts: u32,
        /// What is wrong with each, and what to do.
        problems: Vec<String>,
    },
    /// A scheduler cannot be started, or refuses the job.
    #[error("{what}")]
    Engine {
        /// Why, and what to do.
        what: String,
    },
    /// There is nothing to merge.
    #[error("{} holds no part (*.lodpart)", path.display())]
    NoParts {
        /// The directory.
        path: PathBuf,
    },
}

/// The most problems that a message lists: ten thousand would not be read.
const LISTED: usize = 20;

fn listed(problems: &[String]) -> String {
    let mut lines: Vec<String> = problems.iter().take(LISTED).map(|problem| format!("  {problem}")).collect();
    if problems.len() > LISTED {
        lines.push(format!("  and {} more", problems.len() - LISTED));
    }
    lines.join("\n")
}
