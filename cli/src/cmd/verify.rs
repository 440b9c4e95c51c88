//! `lodpack verify`

use super::{open, print_json, use_threads};
use crate::args::{ProgressStyle, VerifyArgs};
use crate::output::{count, length, say};
use crate::progress_bar::Terminal;
use anyhow::Result;
use lodpack_cli::import::import_meshes;
use lodpack_cli::progress::Progress;
use lodpack_cli::repair::repair;
use lodpack_cli::verify::{Problem, VerifyOptions, VerifyReport, verify};
use std::process::ExitCode;

/// Checks a file; exit code 1 where it is unsound.
pub fn run(args: &VerifyArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    let progress = Terminal::new(ProgressStyle::Auto, None);
    let against = if args.against.is_empty() {
        None
    } else {
        progress.begin("import", 0);
        // The file promises distances to the repaired surface; repair moves no point and drops no area.
        Some(repair(import_meshes(&args.against, &progress)?).0)
    };
    let report = match open(&args.file) {
        Ok(file) => {
            let options = VerifyOptions { cuts: args.cuts, seed: args.seed };
            verify(&file, against.as_ref(), &options, &progress)?
        }
        Err(error) if error.downcast_ref::<lodpack::Error>().is_some_and(is_damage) => {
            let problem = Problem { place: "file".into(), what: format!("{error:#}") };
            VerifyReport { problems: vec![problem], ..VerifyReport::default() }
        }
        Err(error) => return Err(error),
    };
    drop(progress);
    if args.json {
        print_json(&report)?;
    } else {
        print(&report, args)?;
    }
    Ok(if report.problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn is_damage(error: &lodpack::Error) -> bool {
    matches!(error, lodpack::Error::Format { .. })
}

fn print(report: &VerifyReport, args: &VerifyArgs) -> Result<()> {
    for level in &report.levels {
        say!(
            "level {:<3} {:>12} triangles   stored {:>10}   measured {:>10}   ratio median {:.3} max {:.3}   vertex RMS {}",
            level.level,
            count(level.triangles),
            length(level.stored),
            length(level.measured),
            level.ratio_median,
            level.ratio_max,
            length(level.vertex_rms)
        );
    }
    if let Some(ratio) = report.ratio_median {
        say!("stored over measured error, median over all nodes and levels: {ratio:.3}");
    }
    say!(
        "{} random cuts, {} boundary edges at the finest level, {} edges with more than two triangles over all cuts",
        report.cuts,
        count(report.boundary_edges),
        count(report.crowded_edges)
    );
    const SHOWN: usize = 20;
    for problem in report.problems.iter().take(SHOWN) {
        say!("PROBLEM {}: {}", problem.place, problem.what);
    }
    if report.problems.len() > SHOWN {
        say!("... and {} more problems", report.problems.len() - SHOWN);
    }
    if report.problems.is_empty() {
        say!("{}: sound", args.file.display());
    }
    Ok(())
}
