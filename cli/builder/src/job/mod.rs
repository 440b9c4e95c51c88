//! Builds: [`build`] makes a file in memory where the input fits, and otherwise as a job.
//!
//! A **job** is a build whose state is on disk, so it can be resumed after a kill and divided among machines. Its
//! directory holds
//!
//! - `job.json`, the [`Manifest`]: inputs, options and parts,
//! - while it is planned, the input's positions and triangles, then its regions, stage by stage,
//! - `plan`, once all regions are cut into charts and know the arcs that they share,
//! - the parts, `part-K.lodpart`, each of which can be built without the others,
//! - for each part a lock while it is built, a small report once it is built, or the reason why it failed.
//!
//! A job whose mesh stands on a ground has that in `ground.lodpack`, a file of heights that the merge puts under the
//! mesh.
//!
//! A job of heights (`heights`) has the same files; its plan comes with `samples`, the grid in steps, and its regions
//! are units of the grid.
//!
//! The planning itself can be divided, too ([`StagedJob`]): then the directory `stages` holds for each task of each
//! [`Stage`] a lock, what it hands on, and a report or the reason why it failed. Any number of processes, each in
//! [`work`], find their tasks there and nowhere else.
//!
//! Every file is first written under another name, carries the job's number, and is checked when it is read. Nothing
//! depends on clocks.

mod add;
mod build;
mod content;
mod encoded;
mod error;
mod file_name;
mod ground;
mod heights;
mod input;
mod manifest;
mod merge;
mod options;
mod part;
mod plan;
mod planned;
mod slurm;
mod stage;
mod stage_status;
mod staged;
mod status;
mod tasks;
#[cfg(test)]
mod tests;
mod worker;

pub use add::Added;
pub use build::{build, build_mesh};
pub use error::{BuildError, JobError};
pub use file_name::{FILE_EXTENSION, JOB_EXTENSION, beside, merged_file};
pub use ground::{GROUND_NAME, keep_ground, kept_ground};
pub use heights::merge_heights;
pub use lodpack_runtime::storage::MANIFEST_NAME;
pub use lodpack_runtime::storage::STAGES_NAME;
pub use manifest::{InputFile, Manifest, PartEntry};
pub use merge::{Parts, merge};
pub use options::{BuildOptions, typed_raster};
pub use part::{PART_EXTENSION, part_name};
pub use plan::{Job, PartOptions};
pub use planned::{BuiltPart, PARTS_NAME, PlannedJob};
pub use slurm::{SLURM_NAME, SlurmScripts, Submitted};
pub use stage::{Stage, Stages};
pub use stage_status::{FailedTask, RunningTask, StageStatus};
pub use staged::{Outcome, StagedJob};
pub use status::{JobStatus, PartReport, PartState, PartStatus};
pub use worker::{Share, work};
