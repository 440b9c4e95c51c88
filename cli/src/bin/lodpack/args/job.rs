//! Arguments of the commands that build in parts: `plan`, `add`, `work`, `merge`, `submit`, `status`.

use super::build::{ModelArgs, RunArgs};
use super::values::{PartRange, ProgressStyle, parse_size};
use clap::{Args, ValueEnum};
use lodpack_cli::job::Stage;
use std::path::PathBuf;

/// Arguments of `plan`.
#[derive(Args, Debug)]
pub struct PlanArgs {
    /// Input meshes, joined into one model; rasters of heights, joined into one mosaic; or one atlas directory.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The job's directory, which everyone who builds parts must see; it takes about 80 bytes per triangle. By default
    /// it lies beside the (first) input and has its name: mesh.obj becomes mesh.job.
    #[arg(short, long, value_name = "JOB")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub model: ModelArgs,
    /// What the mesh stands on, as with `build --ground`. The job keeps the ground beside its parts, and `lodpack
    /// merge` puts it under the mesh.
    #[arg(long, value_name = "DEM", conflicts_with_all = ["heights", "extensible"])]
    pub ground: Vec<PathBuf>,
    #[command(flatten)]
    pub job: JobArgs,
}

/// Arguments of `add`.
#[derive(Args, Debug)]
pub struct AddArgs {
    /// The earlier job, planned with --extensible. It stays as it is; its inputs are read again.
    pub earlier: PathBuf,
    /// Input meshes to add.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The new job's directory, which everyone who builds parts must see; it takes about 80 bytes per triangle.
    #[arg(short, long, value_name = "JOB")]
    pub output: PathBuf,
    #[command(flatten)]
    pub job: JobArgs,
}

/// How a job is planned.
#[derive(Args, Debug)]
pub struct JobArgs {
    /// Number of parts. By default one for each region (of at most two million triangles), and of heights one for 16
    /// million samples; there cannot be more than regions that have anything to do.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub parts: Option<u32>,
    /// Memory available to each part. The plan is refused if a part needs more, and kept for --resume with more memory.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub part_memory: Option<u64>,
    /// Divide the planning, too: this only begins the job, and `lodpack work` does the rest, on any number of machines.
    #[arg(long, conflicts_with = "part_memory")]
    pub stages: bool,
    /// Least bytes of input in a task, for tests.
    #[arg(long, value_name = "SIZE", hide = true, requires = "stages", value_parser = parse_size)]
    pub range_bytes: Option<u64>,
    #[command(flatten)]
    pub run: RunArgs,
    /// Continue a stopped or killed plan; start one if there is none.
    #[arg(long)]
    pub resume: bool,
    /// First remove an existing job of that name, with all its parts.
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Print the manifest as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `work`.
#[derive(Args, Debug)]
pub struct WorkArgs {
    /// The job's directory.
    pub job: PathBuf,
    /// Do only the tasks of this stage, whose earlier stages must be done. By default all stages, one after the other.
    #[arg(long, value_enum)]
    pub stage: Option<StageName>,
    /// Number of a task of the stage, from 0; or the first and the last of several, as 0-15. By default all.
    #[arg(long, value_name = "K")]
    pub task: Option<PartRange>,
    #[command(flatten)]
    pub run: RunArgs,
    /// End when the standard input ends.
    #[arg(long, hide = true)]
    pub with_parent: bool,
    /// Print what was done as JSON.
    #[arg(long)]
    pub json: bool,
}

/// The stages of a job, as people type them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StageName {
    /// Read inputs that have no ranges: one task, or none for binary STL and plain binary PLY.
    Import,
    /// Check and measure ranges of the input.
    Scan,
    /// Count triangles by place.
    Count,
    /// Cut space into regions: one task.
    Cut,
    /// Send triangles to their regions.
    Divide,
    /// Repair regions.
    Repair,
    /// Find where regions meet: one task.
    Match,
    /// Cut regions into charts.
    Segment,
    /// Find what regions share, and write the plan: one task.
    Seams,
    /// Build parts.
    Build,
    /// Order what all parts have: one task.
    Arrange,
    /// Make pages of the file.
    Encode,
}

impl From<StageName> for Stage {
    fn from(name: StageName) -> Self {
        match name {
            StageName::Import => Self::Import,
            StageName::Scan => Self::Scan,
            StageName::Count => Self::Count,
            StageName::Cut => Self::Cut,
            StageName::Divide => Self::Divide,
            StageName::Repair => Self::Repair,
            StageName::Match => Self::Match,
            StageName::Segment => Self::Segment,
            StageName::Seams => Self::Seams,
            StageName::Build => Self::Build,
            StageName::Arrange => Self::Arrange,
            StageName::Encode => Self::Encode,
        }
    }
}

/// Arguments of `merge`.
#[derive(Args, Debug)]
pub struct MergeArgs {
    /// A job, a directory of parts, or parts one by one; with --ground also a finished file of a mesh.
    #[arg(required = true, value_name = "PARTS")]
    pub parts: Vec<PathBuf>,
    /// Put this file of heights, built from rasters, under the mesh: the file then holds both. A ground that it had,
    /// or that the job was planned with, is replaced. Nothing is built again, so no other byte of the mesh changes.
    /// Both must be in the same coordinate reference system, as far as they name one.
    #[arg(long, value_name = "TERRAIN.lodpack")]
    pub ground: Option<PathBuf>,
    /// The file to write. By default it lies beside the job (or the directory of parts) and has the planned name.
    #[arg(short, long, value_name = "OUT.lodpack")]
    pub output: Option<PathBuf>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressStyle,
    /// Overwrite an existing output.
    #[arg(long)]
    pub force: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Schedulers that can run a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Slurm: an array of parts, and a merge that waits for it.
    #[default]
    Slurm,
}

/// Arguments of `submit`.
#[derive(Args, Debug)]
pub struct SubmitArgs {
    /// The job's directory, which all nodes must see under the same name.
    pub job: PathBuf,
    /// The file that the merge writes; an existing one is overwritten. By default it lies beside the job, has the
    /// planned name, and must not exist.
    #[arg(short, long, value_name = "OUT.lodpack")]
    pub output: Option<PathBuf>,
    /// The scheduler.
    #[arg(long, value_enum, default_value_t)]
    pub engine: Engine,
    /// Threads of each task.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: u32,
    /// Path of lodpack on the nodes, if it differs from the path here.
    #[arg(long, value_name = "PATH")]
    pub program: Option<PathBuf>,
    /// Only print the scripts and the commands that would submit them.
    #[arg(long)]
    pub dry_run: bool,
    /// Print the scheduler's job numbers as JSON; with --dry-run the scripts.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `status`.
#[derive(Args, Debug)]
pub struct StatusArgs {
    /// The job's directory.
    pub job: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}
