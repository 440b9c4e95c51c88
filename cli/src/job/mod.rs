//! Jobs: builds whose state is on disk, so that they can be gone on with after a kill, and divided among machines.
//!
//! A job's directory holds
//!
//! - `job.json`, the [`Manifest`]: inputs, options and parts,
//! - while it is planned: the input's positions and triangles, then its regions, stage by stage,
//! - `plan`, when all regions are cut into charts and know the arcs that they share,
//! - the parts, `part-K.lodpart`, of which any can be built without the others,
//! - for each part that is being built a lock, that was built a small report, or that failed the reason.
//!
//! Every file is written under another name first, carries the job's number and is checked when it is read. Nothing depends on
//! clocks.

mod add;
mod build;
mod error;
mod file_name;
mod manifest;
mod merge;
mod part;
mod planned;
mod slurm;
mod status;
#[cfg(test)]
mod tests;

pub use add::Added;
pub use build::Job;
pub use error::JobError;
pub use file_name::{FILE_EXTENSION, JOB_EXTENSION, beside, merged_file};
pub use manifest::{InputFile, JobOptions, MANIFEST_NAME, Manifest, PartEntry};
pub use merge::{Parts, merge};
pub use part::{PART_EXTENSION, part_name};
pub use planned::{BuiltPart, PARTS_NAME, PlannedJob};
pub use slurm::{SLURM_NAME, SlurmScripts, Submitted};
pub use status::{JobStatus, PartReport, PartState, PartStatus};
