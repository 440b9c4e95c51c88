//! Arguments of the commands that measure: `verify`, `report`, `selftest`.

use super::build::{ModelArgs, RunArgs};
use super::raster::RasterArgs;
use super::values::{parse_count, parse_size, parse_threads};
use clap::Args;
use lodpack_cli::measure::selftest::RowId;
use std::path::PathBuf;

/// Arguments of `verify`.
#[derive(Args, Debug)]
pub struct VerifyArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: Option<PathBuf>,
    /// The meshes or rasters that the file was built from: measures every stored error against them. They are held in
    /// memory. If no FILE comes before this option, its last value is the file.
    #[arg(long, value_name = "MESH", num_args = 1..)]
    pub against: Vec<PathBuf>,
    /// Number of random cuts to stitch and check.
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
    #[command(flatten)]
    pub raster: RasterArgs,
}

/// Arguments of `selftest`.
#[derive(Args, Debug)]
pub struct SelftestArgs {
    /// Only list the cases and the positions of their dials.
    #[arg(long)]
    pub list: bool,
    /// Run only this case; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub case: Vec<String>,
    /// Run only a fast selection of rows, which takes some 20 seconds of processor time.
    #[arg(long)]
    pub quick: bool,
    /// Also write the whole table to this file.
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
    /// Memory that each row may take, generation and verification included. By default 1GiB.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub memory: Option<u64>,
    /// Directory for temporary files. By default the system's.
    #[arg(long, value_name = "DIR")]
    pub temp: Option<PathBuf>,
    /// Run one row in this process and print it as JSON.
    #[arg(long, value_name = "CASE:DIAL", hide = true)]
    pub row: Option<RowId>,
}

/// Arguments of `report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// A mesh: builds it at many settings, then queries the default file. Or a .lodpack file (path or address): only
    /// queries it.
    #[arg(value_name = "MESH|FILE")]
    pub input: Option<PathBuf>,
    /// The directory for report.html, report.csv and report.json.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// With a .lodpack file: the mesh that it was built from, to measure errors against. If no FILE comes before this
    /// option, its last value is the file.
    #[arg(long, value_name = "MESH", num_args = 1..)]
    pub against: Vec<PathBuf>,
    /// Results of other programs to draw on the same axes: a table with columns name, mesh, cpu_seconds, bytes,
    /// triangles, rms, max. Lengths are in input units; mesh is the input's name without extension, or empty.
    #[arg(long, value_name = "CSV")]
    pub peers: Option<PathBuf>,
    /// How often each build and query runs. By default 3 times; once above 300,000 triangles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub runs: Option<u32>,
    /// Few settings, for a first look.
    #[arg(long)]
    pub quick: bool,
    /// Sample points for root mean squares, in each direction.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u32).range(100..=100_000_000))]
    pub samples: u32,
    /// The default that the settings depart from.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Input triangles per chart in that default.
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
    /// Build INPUT once to the file -o, and print the summary: a report starts this for each of its builds.
    #[arg(long, hide = true)]
    pub trial: bool,
}
