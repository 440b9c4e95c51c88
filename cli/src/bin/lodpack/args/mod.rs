//! The command line: what can be typed, and what `--help` says about it.

mod build;
mod compare;
mod examples;
mod export;
mod job;
mod measure;
mod raster;
mod read;
mod serve;
mod shell;
mod values;

pub use build::{AtlasArgs, BuildArgs, ModelArgs, RunArgs};
pub use compare::CompareArgs;
pub use export::{ExportArgs, ExportFormat};
pub use job::{AddArgs, JobArgs, MergeArgs, PlanArgs, StatusArgs, SubmitArgs, WorkArgs};
pub use measure::{ReportArgs, SelftestArgs, VerifyArgs};
pub use read::{ExtractArgs, GroundChoice, ImagesChoice, InfoArgs, NormalsChoice, OutputFormat, ViewArgs};
pub use serve::ServeArgs;
pub use shell::{CompletionsArgs, ManArgs};
pub use values::{BoundingBox, LevelChoice, PartRange, ProgressStyle, TexelsChoice, UpAxis};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;

/// Turns triangle meshes and terrain of any size into one compact, streamable file with proven error bounds, and reads
/// it back.
#[derive(Debug, Parser)]
#[command(name = "lodpack", version, propagate_version = true, after_help = examples::LODPACK)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build a .lodpack file from meshes (OBJ, OFF, PLY, STL, glTF/GLB), from rasters of heights (GeoTIFF, HGT, ASC,
    /// BIL, PNG), or from an atlas directory.
    #[command(after_help = examples::BUILD)]
    Build(BuildArgs),
    /// Show a file in a window; starts the viewer, `lodpack-view`, which is installed separately.
    #[command(after_help = examples::VIEW)]
    View(ViewArgs),
    /// Serve files on the web with the viewer page, or tell what is wrong with another server.
    #[command(
        override_usage = "lodpack serve [OPTIONS] <FILE>...\n       lodpack serve --check <URL>",
        after_help = examples::SERVE
    )]
    Serve(ServeArgs),
    /// Show what a file holds, by section and level, and what was left out and why.
    #[command(after_help = examples::INFO)]
    Info(InfoArgs),
    /// Write one mesh out of a file, chosen by tolerance, triangle budget or box.
    #[command(after_help = examples::EXTRACT)]
    Extract(ExtractArgs),
    /// Write a file in a format of levels that other viewers know: 3D Tiles 1.1, which stream, or one GLB with all
    /// levels.
    #[command(after_help = examples::EXPORT)]
    Export(ExportArgs),
    /// Check a file: every checksum and rule, random cuts, and with --against the stored errors themselves.
    #[command(
        override_usage = "lodpack verify [OPTIONS] <FILE>\n       lodpack verify [OPTIONS] <FILE> --against <MESH>...",
        after_help = examples::VERIFY
    )]
    Verify(VerifyArgs),
    /// Measure how far two surfaces are apart, between certified bounds in both directions: meshes, rasters, .lodpack
    /// files, glTF with levels, tilesets and terrain tiles of any maker, beside what they claim.
    #[command(after_help = examples::COMPARE)]
    Compare(Box<CompareArgs>),
    /// Prepare a build in parts, for several machines, or for little memory and many interruptions.
    #[command(after_help = examples::PLAN)]
    Plan(PlanArgs),
    /// Plan a job that adds meshes to an earlier job; regions that do not change are not built again.
    #[command(after_help = examples::ADD)]
    Add(AddArgs),
    /// Do tasks of a job until none is left, beside any number of other workers on any machines.
    #[command(after_help = examples::WORK)]
    Work(WorkArgs),
    /// Show which parts of a job are done, running, failed or missing.
    #[command(after_help = examples::STATUS)]
    Status(StatusArgs),
    /// Join the parts of a job into one .lodpack file.
    #[command(after_help = examples::MERGE)]
    Merge(MergeArgs),
    /// Hand the parts of a job, and their merge, to a cluster's scheduler; submitting again runs only what is not done.
    #[command(after_help = examples::SUBMIT)]
    Submit(SubmitArgs),
    /// Write a mesh as geometry images (EXR) and atlas.json, which `lodpack build DIR` turns into a file.
    #[command(after_help = examples::ATLAS)]
    Atlas(AtlasArgs),
    /// Measure error against run time, bytes and triangles over many settings; writes plots, tables and conclusions.
    #[command(
        override_usage = "lodpack report [OPTIONS] -o <DIR> <MESH>\n       lodpack report [OPTIONS] -o <DIR> <FILE> [--against <MESH>...]",
        after_help = examples::REPORT
    )]
    Report(ReportArgs),
    /// Build and verify generated meshes, from easy to impossible; each must end in a sound file or a clear error.
    #[command(after_help = examples::SELFTEST)]
    Selftest(SelftestArgs),
    /// Print what a shell needs to complete commands, options and their values.
    #[command(after_help = examples::COMPLETIONS)]
    Completions(CompletionsArgs),
    /// Print the manual page of a command, or write those of all commands to a directory.
    #[command(after_help = examples::MAN)]
    Man(ManArgs),
}

/// The command line: parsing, help, completions and man pages come from this.
pub fn command() -> clap::Command {
    // A negative number after an option is a value of that option, not another option.
    let takes_number = |arg: clap::Arg| match arg.get_action().takes_values() && !arg.is_positional() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    };
    Cli::command().mut_subcommands(|command| command.mut_args(takes_number))
}

/// Parses what was typed, beginning with the program's name.
pub fn parse(words: &[OsString]) -> Result<Cli, clap::Error> {
    let mut command = command();
    let matches = command.try_get_matches_from_mut(words)?;
    Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}
