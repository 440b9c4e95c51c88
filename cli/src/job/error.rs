//! What can be wrong with jobs.

use std::path::PathBuf;

use crate::storage::WorkError;

/// A job that cannot be worked on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// A file cannot be used.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// There is no job.
    #[error("{} holds no job: there is no job.json in it; `lodpack plan` makes one", path.display())]
    NoJob {
        /// The directory.
        path: PathBuf,
    },
    /// The job has no parts yet.
    #[error("the job {} is not planned to its end; run the same `lodpack plan` again with --resume", path.display())]
    NotPlanned {
        /// The directory.
        path: PathBuf,
    },
    /// The job is of another version.
    #[error(
        "the job {} was planned by lodpack {version}; this is {}, which could build other bytes: plan it again",
        path.display(), env!("CARGO_PKG_VERSION")
    )]
    Version {
        /// The directory.
        path: PathBuf,
        /// Who planned it.
        version: String,
    },
    /// A job of other inputs or options is in the way.
    #[error("{} cannot be gone on with: {what}; remove it, or start again with --force", path.display())]
    Changed {
        /// The directory.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// Nothing can be added to a job.
    #[error("{}: {what}", path.display())]
    Extend {
        /// The job, or an input of it.
        path: PathBuf,
        /// Why, and what to do.
        what: String,
    },
    /// There is no such part.
    #[error("the job has no part {part}; its {parts} parts are numbered from 0")]
    NoPart {
        /// What was asked for.
        part: u32,
        /// How many there are.
        parts: u32,
    },
    /// Parts that cannot be merged.
    #[error("{} of {parts} parts cannot be merged:\n{}", problems.len(), listed(problems))]
    Parts {
        /// How many parts there should be.
        parts: u32,
        /// Each with what is to be done.
        problems: Vec<String>,
    },
    /// Whoever was to run the parts does not take them.
    #[error("{what}")]
    Engine {
        /// Why.
        what: String,
    },
    /// Nothing to merge.
    #[error("{} holds no part (*.lodpart)", path.display())]
    NoParts {
        /// The directory.
        path: PathBuf,
    },
}

/// Problems that are printed; with 10,000 parts missing nobody reads on.
const LISTED: usize = 20;

fn listed(problems: &[String]) -> String {
    let mut lines: Vec<String> = problems.iter().take(LISTED).map(|problem| format!("  {problem}")).collect();
    if problems.len() > LISTED {
        lines.push(format!("  and {} more", problems.len() - LISTED));
    }
    lines.join("\n")
}
