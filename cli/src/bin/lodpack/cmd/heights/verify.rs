//! Checking files of heights.

use super::super::open::Source;
use super::super::print_json;
use crate::args::VerifyArgs;
use crate::output::{count, length, say};
use crate::progress_bar::Terminal;
use anyhow::{Context, Result, bail};
use lodpack::heights::Heights;
use lodpack_cli::import::raster::HeightSource;
use lodpack_cli::measure::heights::{HeightsChecks, HeightsReport, verify};
use std::path::{Path, PathBuf};

/// Checks a file, and compares it with rasters if there are any. Returns whether it is sound.
pub fn run(
    file: &Heights<Source>,
    rasters: &[PathBuf],
    progress: Terminal,
    args: &VerifyArgs,
    name: &Path,
) -> Result<bool> {
    let report = check(file, rasters, &progress, args, name)?;
    drop(progress);
    if args.json {
        print_json(&report)?;
    } else {
        print(&report, name)?;
    }
    Ok(report.problems.is_empty())
}

/// Checks a file or the ground of one, and compares it with rasters if there are any.
pub fn check(
    file: &Heights<Source>,
    rasters: &[PathBuf],
    progress: &Terminal,
    args: &VerifyArgs,
    name: &Path,
) -> Result<HeightsReport> {
    for path in rasters {
        std::fs::metadata(path).with_context(|| format!("cannot open {}", path.display()))?;
    }
    let options = args.raster.options().like_heights(file.surface(), file.placement());
    let source = match rasters {
        [] => None,
        _ => match HeightSource::open(rasters, &options, progress)? {
            None => bail!("{}: a grid of heights is compared with rasters, and --against names a mesh", name.display()),
            source => source,
        },
    };
    let checks = HeightsChecks { cuts: args.cuts, seed: args.seed };
    Ok(verify(file, source.as_ref(), checks, progress)?)
}

/// Prints the report.
pub fn print(report: &HeightsReport, name: &Path) -> Result<()> {
    say!("{} tiles decoded, {} cuts made", count(report.tiles), report.cuts);
    if report.sample_distance.is_none() && report.problems.is_empty() {
        say!("no errors were measured: --against RASTER does that");
    }
    if let Some(distance) = report.sample_distance {
        say!("heights in the file are off by {} at most", length(distance));
    }
    if let (Some(most), Some(median)) = (report.largest_share, report.median_share) {
        say!("samples are off by {most:.3} of a tile's error at most, {median:.3} in the median");
    }
    for problem in &report.problems {
        say!("problem: {problem}");
    }
    match report.problems.len() {
        0 => say!("{}: sound", name.display()),
        count => say!("{}: unsound, {count} problems", name.display()),
    }
    Ok(())
}
