//! `lodpack merge`

use super::print_json;
use super::state::{folder_beside, naming};
use super::summary::print;
use crate::args::MergeArgs;
use crate::interrupt;
use crate::output::PendingFile;
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::heights::HeightsSummary;
use lodpack_cli::job::{PART_EXTENSION, PARTS_NAME, Parts, merge, merge_heights, merged_file};
use lodpack_cli::pipeline::summary::BuildSummary;
use lodpack_cli::progress::Progress;
use std::fs;
use std::io::{BufWriter, ErrorKind};
use std::path::Path;
use std::process::ExitCode;

/// What was merged.
#[derive(serde::Serialize)]
#[serde(untagged)]
enum Merged {
    Mesh(Box<BuildSummary>),
    Heights(Box<HeightsSummary>),
}

/// Checks parts, joins them and prints a summary.
pub fn run(args: &MergeArgs) -> Result<ExitCode> {
    args.parts.iter().try_for_each(|path| check_parts(path))?;
    let output = &match &args.output {
        Some(output) => output.clone(),
        None => merged_file(&args.parts)?
            .context("single parts do not tell the name of the file to write; add -o OUT.lodpack")?,
    };
    interrupt::on_stop_leave_nothing();
    // Refused before the parts are read.
    let (pending, file) = PendingFile::create(output, args.force, args.parts.iter().map(|p| p.as_path()))?;
    let summary = {
        let progress = Terminal::new(args.progress, progress_bar::MERGE);
        let parts = Parts::check(&args.parts, &progress)?;
        for input in &parts.changed_inputs {
            let input = input.display();
            progress
                .note(&format!("{input} has changed since the job was planned; the file shows the earlier version"));
        }
        let scratch = folder_beside(output);
        let mut out = BufWriter::new(file);
        let merged = match parts.are_heights() {
            true => merge_heights(&parts, &scratch, &mut out, &progress).map(|s| Merged::Heights(Box::new(s))),
            false => merge(&parts, &scratch, &mut out, &progress).map(|s| Merged::Mesh(Box::new(s))),
        };
        let summary = merged.map_err(|error| naming(error, output, Some("-o")))?;
        let written = out.into_inner().map_err(|error| error.into_error());
        pending.finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
        progress.complete();
        summary
    };
    if args.json {
        print_json(&summary)?;
        return Ok(ExitCode::SUCCESS);
    }
    match summary {
        Merged::Mesh(summary) => print(&summary, output)?,
        Merged::Heights(summary) => super::heights::build::print(&summary, output)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses parts that do not exist or may not be read: unlike damaged ones, building them again would not help.
fn check_parts(path: &Path) -> Result<()> {
    let is_part = |path: &Path| path.extension().is_some_and(|extension| extension == PART_EXTENSION);
    let parts_in = |folder: &Path| {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        entries.filter(|path| is_part(path)).collect::<Vec<_>>()
    };
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_dir() => {
            let all = parts_in(path).into_iter().chain(parts_in(&path.join(PARTS_NAME)));
            all.into_iter().try_for_each(|part| check_readable(&part))
        }
        Ok(_) => check_readable(path),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            bail!("{} does not exist; name a job, a directory of parts, or parts (*.{PART_EXTENSION})", path.display())
        }
        Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
    }
}

fn check_readable(part: &Path) -> Result<()> {
    match fs::File::open(part) {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            bail!("{} may not be read; check its permissions", part.display())
        }
        _ => Ok(()),
    }
}
