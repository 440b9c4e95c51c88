//! `lodpack merge`

use super::ground::{self, Target, WithGround};
use super::print_json;
use super::state::{check_extension, folder_beside, naming};
use super::summary::print;
use crate::args::MergeArgs;
use crate::interrupt;
use crate::output::{PendingFile, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::heights::HeightsSummary;
use lodpack_cli::job::{
    FILE_EXTENSION, PART_EXTENSION, PARTS_NAME, Parts, kept_ground, merge, merge_heights, merged_file,
};
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
    if let ([file], Some(ground)) = (args.parts.as_slice(), &args.ground)
        && file.extension().is_some_and(|extension| extension == FILE_EXTENSION)
    {
        return put_under(file, ground, args);
    }
    args.parts.iter().try_for_each(|path| check_parts(path))?;
    let output = &match &args.output {
        Some(output) => output.clone(),
        None => merged_file(&args.parts)?
            .context("single parts do not tell the name of the file to write; add -o OUT.lodpack")?,
    };
    check_extension(output)?;
    interrupt::on_stop_leave_nothing();
    // Refused before the parts are read.
    let inputs = args.parts.iter().chain(&args.ground).map(|path| path.as_path());
    let (pending, file) = PendingFile::create(output, args.force, inputs)?;
    let kept = if args.ground.is_some() { None } else { kept_ground(&args.parts)? };
    let under = args.ground.as_ref().or(kept.as_ref()).map(|path| ground::open_file(path)).transpose()?;
    let (target, file) = Target::new(file, under, &folder_beside(output))?;
    let (summary, ground) = {
        let progress = Terminal::new(args.progress, progress_bar::MERGE);
        let parts = Parts::check(&args.parts, &progress)?;
        if let (Some(ground), true) = (&args.ground, parts.are_heights()) {
            bail!("{}: the parts are heights, which have no ground; omit --ground", ground.display());
        }
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
        let (written, ground) =
            target.finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
        pending.finish(written)?;
        progress.complete();
        (summary, ground)
    };
    if args.json {
        print_json(&WithGround { summary, ground })?;
        return Ok(ExitCode::SUCCESS);
    }
    match summary {
        Merged::Mesh(summary) => print(&summary, output)?,
        Merged::Heights(summary) => super::heights::build::print(&summary, output)?,
    }
    ground.iter().try_for_each(ground::print)?;
    Ok(ExitCode::SUCCESS)
}

/// Puts a ground under a file that is there already.
fn put_under(path: &Path, ground: &Path, args: &MergeArgs) -> Result<ExitCode> {
    let Some(output) = &args.output else { bail!("name the file that will hold both with -o OUT.lodpack") };
    interrupt::on_stop_leave_nothing();
    let (pending, file) = PendingFile::create(output, args.force, [path, ground])?;
    let surface = fs::File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    let heights = ground::open_file(ground)?;
    let (file, joined) = ground::join(surface, &heights, file).with_context(|| path.display().to_string())?;
    pending.finish(file)?;
    match args.json {
        true => print_json(&joined)?,
        false => {
            say!("{}", output.display());
            ground::print(&joined)?;
        }
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
        Ok(_) if path.extension().is_some_and(|extension| extension == FILE_EXTENSION) => bail!(
            "{} is finished: merge joins the parts of one job (*.{PART_EXTENSION}). `lodpack build A.{FILE_EXTENSION} B.{FILE_EXTENSION} -o OUT.{FILE_EXTENSION}` \
             makes one file of several",
            path.display()
        ),
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
