//! What can be typed.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use lodpack_cli::measure::selftest::RowId;
use lodpack_cli::mesh::tolerance::{Tolerance, Unit};
use lodpack_cli::pipeline::{Effort, Fillings, ModelOptions};
use lodpack_cli::region::REGION_TRIANGLES;
use std::path::PathBuf;
use std::str::FromStr;

/// Turns triangle meshes of any size into one compact, streamable file with proven error bounds, and reads it back.
#[derive(Debug, Parser)]
#[command(name = "lodpack", version, propagate_version = true)]
#[command(
    after_help = "Exit status: 0 success; 1 verify or selftest found a problem, or status a part that is not done; 2 the command could not run;\n130 stopped by Ctrl-C or SIGTERM."
)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build a .lodpack file from meshes (OBJ, PLY, STL, glTF/GLB) or from an atlas directory.
    #[command(
        after_help = "Examples:\n  lodpack build scan.ply -o scan.lodpack\n  lodpack build part.stl --unit mm --tolerance 0.05mm -o part.lodpack\n  lodpack build a.glb b.glb --effort best --json -o both.lodpack\n  lodpack build huge.ply --memory 2GiB --resume -o huge.lodpack   (after a stop)\n  lodpack build --job job/ --part 3"
    )]
    Build(BuildArgs),
    /// Prepare a build that is done in parts: on several machines, or with little memory and many stops.
    #[command(
        after_help = "Examples:\n  lodpack plan scan.ply -o job/ --parts 16\n  lodpack build --job job/ --part 3      (each of 0 to 15, anywhere, in any order)\n  lodpack merge job/ -o scan.lodpack"
    )]
    Plan(PlanArgs),
    /// Plan a job of all that an earlier one has and of more; regions that do not change are taken over as they are built.
    #[command(
        after_help = "Examples:\n  lodpack plan tiles/*.ply --extensible --tolerance 0.05 -o job-1/\n  lodpack build --job job-1/ --part 0-7 && lodpack merge job-1/ -o land.lodpack\n  lodpack add job-1/ new.ply -o job-2/\n  lodpack build --job job-2/ --part 0-8 && lodpack merge job-2/ -o land.lodpack --force\n\nThe file is the one that a plan of all inputs at once gives. A .lodpack file itself holds no more than what it shows, so\nthat it takes the job to add to it; once the new job is planned, the earlier one can be removed."
    )]
    Add(AddArgs),
    /// Join the parts of a job to a .lodpack file.
    #[command(
        after_help = "Examples:\n  lodpack merge job/ -o scan.lodpack\n  lodpack merge parts/ -o scan.lodpack\n  lodpack merge part-0.lodpart part-1.lodpart -o scan.lodpack"
    )]
    Merge(MergeArgs),
    /// Show which parts of a job are done, running, failed or missing.
    #[command(
        after_help = "Examples:\n  lodpack status job/\n  lodpack status job/ --json | jq '.parts[] | select(.state != \"done\") | .part'\n\nExit status: 0 all parts are done, 1 not yet, 2 could not run."
    )]
    Status(StatusArgs),
    /// Hand the parts of a job, and their merge, to a cluster's scheduler. Submitting again runs what is not done.
    #[command(
        after_help = "Examples:\n  lodpack submit --engine slurm job/ -o scan.lodpack\n  lodpack submit --engine slurm job/ -o scan.lodpack --dry-run\n\nRecipes for Dask, Snakemake, GNU parallel and Kubernetes are in cli/engines."
    )]
    Submit(SubmitArgs),
    /// Show what a file holds, by section and level, and what was left out and why.
    #[command(
        after_help = "Examples:\n  lodpack info scan.lodpack\n  lodpack info scan.lodpack --why\n  lodpack info https://example.org/scan.lodpack --json | jq .levels\n  lodpack info scan.lodpack --why --json | jq '.left_out[] | {what, bytes: .saved.bytes}'"
    )]
    Info(InfoArgs),
    /// Check a file: every checksum and rule, random cuts, and with --against the stored errors themselves.
    #[command(
        override_usage = "lodpack verify [OPTIONS] <FILE>\n       lodpack verify [OPTIONS] <FILE> --against <MESH>...",
        after_help = "Examples:\n  lodpack verify scan.lodpack\n  lodpack verify scan.lodpack --against scan.ply\n\nExit status: 0 sound, 1 a problem was found, 2 could not run."
    )]
    Verify(VerifyArgs),
    /// Write one mesh out of a file: a tolerance, a triangle budget, a box.
    #[command(
        after_help = "Examples:\n  lodpack extract scan.lodpack -o finest.ply\n  lodpack extract scan.lodpack --triangles 50000 -o small.glb\n  lodpack extract scan.lodpack --bbox 0,0,0,1,1,1 --tolerance 0.002 -o corner.obj\n  lodpack extract scan.lodpack --tolerance 0.4edge -o near.ply           (as many mean edges of the input)\n  lodpack extract scan.lodpack --bbox 0,0,0,1,1,1 --context -o focus.ply\n  lodpack extract scan.lodpack --format ply -o - | other-program\n\nA root is a piece of the surface, drawn at one level. A file does not say what unit its coordinates are in, so that lengths\nwith a unit (2mm) only work when it is built. --json has certified_error (of all that is written), certified_error_in_box and\nlimited_by (tolerance, finest, triangles, nodes)."
    )]
    Extract(ExtractArgs),
    /// Write the atlas of a mesh as geometry images (EXR) and atlas.json; `build DIR` goes on from there.
    #[command(after_help = "Examples:\n  lodpack atlas scan.ply -o atlas/\n  lodpack build atlas/ -o scan.lodpack")]
    Atlas(AtlasArgs),
    /// Build and verify generated meshes from easy to impossible; every one has to end in a sound file or a clear error.
    #[command(
        after_help = "Examples:\n  lodpack selftest --quick\n  lodpack selftest --case finger --case fan\n  lodpack selftest --csv stability.csv\n\nExit status: 0 all rows are good, 1 some are not, 2 could not run."
    )]
    Selftest(SelftestArgs),
    /// Measure error against run time, bytes and triangles over a sweep of settings; writes plots, tables and what follows.
    #[command(
        override_usage = "lodpack report [OPTIONS] -o <DIR> <MESH>\n       lodpack report [OPTIONS] -o <DIR> <FILE> [--against <MESH>...]",
        after_help = "Examples:\n  lodpack report scan.ply -o report/\n  lodpack report scan.lodpack --against scan.ply -o report/\n  lodpack report scan.ply --peers peers.csv --json -o report/ | jq .default_check"
    )]
    Report(ReportArgs),
}

/// Reads a choice by the names that the library gives, with the library's word on each in the help.
fn parse_choice<T>(all: [(&'static str, T, &'static str); 3]) -> impl TypedValueParser<Value = T>
where
    T: Clone + FromStr<Err = String> + Send + Sync + 'static,
{
    let values = all.map(|(name, _, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<T>())
}

/// A box in input units: the smaller corner, then the larger one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region(pub [[f64; 3]; 2]);

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
        let numbers = numbers.map_err(|_| "a box is six numbers: x0,y0,z0,x1,y1,z1".to_string())?;
        let &[x0, y0, z0, x1, y1, z1] = numbers.as_slice() else {
            return Err(format!("a box is six numbers, not {}: x0,y0,z0,x1,y1,z1", numbers.len()));
        };
        // Also refuses what is no number.
        if !(x0 <= x1 && y0 <= y1 && z0 <= z1) {
            return Err("a box has its smaller corner first: x0,y0,z0,x1,y1,z1".into());
        }
        Ok(Self([[x0, y0, z0], [x1, y1, z1]]))
    }
}

/// Numbers of parts: one, or the first and last of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartRange {
    pub first: u32,
    pub last: u32,
}

impl FromStr for PartRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<u32>().map_err(|_| "a part is a number from 0, as 3, or a run, as 0-15");
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        let range = Self { first: number(first)?, last: number(last)? };
        if range.first <= range.last { Ok(range) } else { Err("the first part comes before the last".into()) }
    }
}

/// Bytes, with or without a unit.
fn parse_size(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, u64); 8] = [
        ("kib", 1 << 10),
        ("mib", 1 << 20),
        ("gib", 1 << 30),
        ("tib", 1 << 40),
        ("kb", 1_000),
        ("mb", 1_000_000),
        ("gb", 1_000_000_000),
        ("tb", 1_000_000_000_000),
    ];
    let lower = text.trim().to_ascii_lowercase();
    let unit = UNITS.iter().find_map(|&(unit, bytes)| Some((lower.strip_suffix(unit)?, bytes)));
    let (number, bytes) = unit.unwrap_or((lower.strip_suffix('b').unwrap_or(&lower), 1));
    let size: f64 = number.trim_end().parse().map_err(|_| "a size is a number and a unit, as 512MiB or 2GB")?;
    if size.is_finite() && size > 0.0 { Ok((size * bytes as f64) as u64) } else { Err("a size is above zero".into()) }
}

/// A whole number, from 0.
fn parse_count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    let count = text.parse::<u64>().ok().and_then(|count| count.try_into().ok());
    count.ok_or_else(|| format!("'{text}' is no whole number from 0 on, or too large"))
}

/// Far more threads than cores only take memory, and the system refuses them at some number.
const MAX_THREADS: usize = 1024;

fn parse_threads(text: &str) -> Result<usize, String> {
    let number = text.parse().map_err(|_| "a number of threads is a whole number from 0 on".to_string())?;
    if number > MAX_THREADS {
        return Err(format!("at most {MAX_THREADS} threads; 0 takes all cores"));
    }
    Ok(number)
}

/// Meshes that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    /// Binary PLY, double precision.
    Ply,
    /// Wavefront OBJ, full precision.
    Obj,
    /// Binary STL, single precision.
    Stl,
    /// Binary glTF, single precision about the middle.
    Glb,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressStyle {
    /// Bars on a terminal, lines elsewhere.
    #[default]
    Auto,
    /// JSON objects on stderr, one a line: stage, percent, remaining seconds (null until they can be told), memory, disk; notes,
    /// and in the end the error, if there is one.
    Json,
    /// None.
    None,
}

/// What bytes depend on.
#[derive(Args, Debug)]
pub struct ModelArgs {
    /// Bound on the certified error of the finest level, the largest distance to the input both ways, as the file stores it: a length in input units (0.05), with a unit (0.05mm), of the diagonal (0.01%),
    /// of the mean edge (0.4edge), or auto.
    #[arg(long, default_value = "auto", value_name = "T", allow_hyphen_values = true)]
    pub tolerance: Tolerance,
    /// Unit of the input's coordinates (um, mm, cm, dm, m, km, in, ft, yd), for a tolerance with a unit. glTF is in metres unless
    /// this says otherwise.
    #[arg(long)]
    pub unit: Option<Unit>,
    /// Run time against bytes and triangles; every bound is certified at every effort.
    #[arg(long, default_value_t, value_parser = parse_choice(Effort::ALL))]
    pub effort: Effort,
    /// Fillings that may be used, for comparisons.
    #[arg(long, default_value_t, value_parser = parse_choice(Fillings::ALL), hide = true)]
    pub fillings: Fillings,
    /// Divide the input at places that stay when more is added later (`lodpack add`), by its place and not by its amount. Takes a
    /// tolerance that is a length. Regions become smaller and less even: some tenths of a percent more bytes.
    #[arg(long)]
    pub extensible: bool,
    /// Triangles per region at most, for tests.
    #[arg(long, value_name = "N", hide = true, default_value_t = REGION_TRIANGLES, value_parser = parse_count::<u64>)]
    pub region_triangles: u64,
}

impl ModelArgs {
    /// The options that the bytes of a file depend on.
    pub fn options(&self) -> ModelOptions {
        let &Self { tolerance, unit, effort, fillings, extensible, region_triangles } = self;
        ModelOptions { tolerance, unit, effort, fillings, chart_triangles: None, region_triangles, extensible }
    }
}

/// What a run may take.
#[derive(Args, Debug)]
pub struct RunArgs {
    /// Worker threads; 0 takes all cores. The file does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = parse_threads)]
    pub threads: usize,
    /// Memory that the build may take, as 512MiB or 2GB: what does not fit is worked on in temporary files. By default half of
    /// the machine's. The file does not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub memory: Option<u64>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressStyle,
}

/// Arguments of `build`.
#[derive(Args, Debug)]
pub struct BuildArgs {
    /// Input meshes, put together into one model; or one atlas directory.
    #[arg(required_unless_present = "job", value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.lodpack", required_unless_present = "job")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub model: ModelArgs,
    #[command(flatten)]
    pub run: RunArgs,
    /// Directory in which one for temporary files is made, instead of the output's.
    #[arg(long, value_name = "DIR")]
    pub temp: Option<PathBuf>,
    /// Go on with a build of the same output that was stopped or killed; if there is none, begin.
    #[arg(long)]
    pub resume: bool,
    /// Build a part of this job, which `lodpack plan` has prepared, into the job's directory or to -o.
    #[arg(long, value_name = "JOB", requires = "part", conflicts_with_all = ["inputs", "tolerance", "unit", "effort", "extensible", "temp", "resume"])]
    pub job: Option<PathBuf>,
    /// Number of the part, from 0; or first and last of several, as 0-15, one after the other.
    #[arg(long, value_name = "K", requires = "job")]
    pub part: Option<PartRange>,
    /// Overwrite an existing output, and begin again where a build was stopped.
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `plan`.
#[derive(Args, Debug)]
pub struct PlanArgs {
    /// Input meshes, put together into one model; or one atlas directory.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub model: ModelArgs,
    #[command(flatten)]
    pub job: JobArgs,
}

/// Arguments of `add`.
#[derive(Args, Debug)]
pub struct AddArgs {
    /// The job to which to add, planned with --extensible. It stays as it is. Its inputs are read again.
    pub earlier: PathBuf,
    /// Input meshes to add.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub job: JobArgs,
}

/// The job that is planned.
#[derive(Args, Debug)]
pub struct JobArgs {
    /// The job's directory, which all who build parts must see. It takes about 80 bytes a triangle.
    #[arg(short, long, value_name = "JOB")]
    pub output: PathBuf,
    /// How many parts; by default as many as the input has regions of at most two million triangles, which is the most that can
    /// be built side by side. Of more than that some have nothing to do.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub parts: Option<u32>,
    /// Memory that there will be for each part; refused if one takes more, and kept for --resume with more memory.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub part_memory: Option<u64>,
    #[command(flatten)]
    pub run: RunArgs,
    /// Go on with a plan that was stopped or killed; if there is none, begin.
    #[arg(long)]
    pub resume: bool,
    /// Remove an existing job of that name with all its parts first.
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Print the manifest as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `merge`.
#[derive(Args, Debug)]
pub struct MergeArgs {
    /// A job, a directory of parts, or parts.
    #[arg(required = true, value_name = "PARTS")]
    pub parts: Vec<PathBuf>,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.lodpack")]
    pub output: PathBuf,
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

/// Schedulers that can be submitted to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Slurm: an array of parts, and a merge that waits for it.
    Slurm,
}

/// Arguments of `submit`.
#[derive(Args, Debug)]
pub struct SubmitArgs {
    /// The job's directory, which all nodes must see under the same name.
    pub job: PathBuf,
    /// The file to write at the end; one that is there is overwritten.
    #[arg(short, long, value_name = "OUT.lodpack")]
    pub output: PathBuf,
    /// Who runs it.
    #[arg(long, value_enum)]
    pub engine: Engine,
    /// Threads of each task.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: u32,
    /// The program as the nodes name it, where it is not in the same place as here.
    #[arg(long, value_name = "PATH")]
    pub program: Option<PathBuf>,
    /// Print the scripts and what would be submitted, and do nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Print the numbers of what was submitted as JSON.
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

/// Arguments of `info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: PathBuf,
    /// Account for every byte: what is there and why it is needed, what is not there, why, and how many bytes that saves.
    #[arg(long)]
    pub why: bool,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `verify`.
#[derive(Args, Debug)]
pub struct VerifyArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: Option<PathBuf>,
    /// The mesh that it was built from, or all of them: measure every stored error against it. It is held in memory. If no FILE
    /// comes before, the last is the file.
    #[arg(long, value_name = "MESH", num_args = 1..)]
    pub against: Vec<PathBuf>,
    /// How many random cuts to stitch and check.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = parse_count::<u32>)]
    pub cuts: u32,
    /// Seed of the random cuts.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = parse_count::<u64>)]
    pub seed: u64,
    /// Worker threads; 0 takes all cores.
    #[arg(long, default_value_t = 0, value_parser = parse_threads)]
    pub threads: usize,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `extract`.
#[derive(Args, Debug)]
pub struct ExtractArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: PathBuf,
    /// The mesh to write: .ply, .obj, .stl or .glb; - for stdout, with --format.
    #[arg(short, long)]
    pub output: PathBuf,
    /// What to write, whatever the output's name is.
    #[arg(long, value_enum)]
    pub format: Option<OutputFormat>,
    /// Largest certified error, of the box if there is one: in input units (0.05), of the diagonal (0.1%) or of the input's mean
    /// edge (0.4edge). Without it as fine as the file is.
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    pub tolerance: Option<Tolerance>,
    /// At most this many triangles.
    #[arg(long, value_name = "N", value_parser = parse_count::<u64>)]
    pub triangles: Option<u64>,
    /// At most this many nodes: roots, each at a level.
    #[arg(long, value_name = "N", value_parser = parse_count::<u64>)]
    pub nodes: Option<u64>,
    /// Only what touches this box: x0,y0,z0,x1,y1,z1.
    #[arg(long, value_name = "BOX", allow_hyphen_values = true)]
    pub bbox: Option<Region>,
    /// With --bbox: keep the rest of the model at its coarsest instead of leaving it out.
    #[arg(long, requires = "bbox")]
    pub context: bool,
    /// Overwrite an existing output.
    #[arg(long)]
    pub force: bool,
    /// Print what was read as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `atlas`.
#[derive(Args, Debug)]
pub struct AtlasArgs {
    /// Input meshes.
    #[arg(required = true, value_name = "MESH")]
    pub inputs: Vec<PathBuf>,
    /// The directory to write.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Resolution r: images of 2^r + 1 samples a side; by default about one sample a vertex.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=11))]
    pub resolution: Option<u32>,
    /// Overwrite images in an existing directory.
    #[arg(long)]
    pub force: bool,
}

/// Arguments of `selftest`.
#[derive(Args, Debug)]
pub struct SelftestArgs {
    /// Only print the cases and the positions of their dials.
    #[arg(long)]
    pub list: bool,
    /// Only this case; may be given several times.
    #[arg(long, value_name = "NAME")]
    pub case: Vec<String>,
    /// Only a fast selection of the rows: some 20 seconds of processor time.
    #[arg(long)]
    pub quick: bool,
    /// Write the whole table, too.
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
    /// Memory that each row may take, generation and verification included; by default 1GiB.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub memory: Option<u64>,
    /// Directory for temporary files, instead of the system's.
    #[arg(long, value_name = "DIR")]
    pub temp: Option<PathBuf>,
    /// Run one row in this process and print it as JSON.
    #[arg(long, value_name = "CASE:DIAL", hide = true)]
    pub row: Option<RowId>,
}

/// Arguments of `report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// A mesh: builds it at many settings, then asks the default file. A .lodpack file (path or address): only asks it.
    #[arg(value_name = "MESH|FILE")]
    pub input: Option<PathBuf>,
    /// The directory to write report.html, report.csv and report.json to.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// With a .lodpack file: the mesh that it was built from, to measure errors against. If no FILE comes before, the last is the
    /// file.
    #[arg(long, value_name = "MESH", num_args = 1..)]
    pub against: Vec<PathBuf>,
    /// Results of other programs, drawn on the same axes: a table (CSV) with columns name, mesh, cpu_seconds, bytes, triangles,
    /// rms, max; lengths in input units; mesh is the input's name without extension, or empty.
    #[arg(long, value_name = "CSV")]
    pub peers: Option<PathBuf>,
    /// How often each build and query is repeated; by default 3, above 300,000 triangles 1.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub runs: Option<u32>,
    /// Few settings, for a first look.
    #[arg(long)]
    pub quick: bool,
    /// Points for root mean squares, each way.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u32).range(100..=100_000_000))]
    pub samples: u32,
    /// The default that settings are changed from.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Input triangles per chart, of the default that settings are changed from.
    #[arg(long, value_name = "N", hide = true, value_parser = parse_count::<u32>)]
    pub chart_triangles: Option<u32>,
    #[command(flatten)]
    pub run: RunArgs,
    /// Overwrite an existing report.
    #[arg(long)]
    pub force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
    /// Build INPUT once to the file -o, and print the summary: what a report starts for each of its builds.
    #[arg(long, hide = true)]
    pub trial: bool,
}
