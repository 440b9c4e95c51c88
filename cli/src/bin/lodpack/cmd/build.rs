//! `lodpack build`

use super::ground::{self, Joined, Target, WithGround};
use super::inputs::{become_heights, find_inputs};
use super::state::{begin_in, beside_first, check_extension, folder_beside, naming, with_advice, work_directory};
use super::summary::print;
use super::{print_json, use_threads, workers};
use crate::args::{BuildArgs, ModelArgs, PartRange, RunArgs};
use crate::interrupt;
use crate::output::{PendingFile, bytes, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::job::{BuildOptions, BuiltPart, FILE_EXTENSION, PlannedJob, build};
use lodpack_cli::storage::default_memory;
use lodpack_cli::trace::{self, Traced};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Builds a file, or parts of a job, and prints a summary.
pub fn run(args: &BuildArgs) -> Result<ExitCode> {
    use_threads(args.run.threads)?;
    let Some(path) = &args.trace else { return run_once(args) };
    let cannot = || format!("cannot write the trace {}", path.display());
    let (pending, file) = PendingFile::create(path, args.force, args.inputs.iter().map(PathBuf::as_path))?;
    trace::begin(file.try_clone().with_context(cannot)?).with_context(cannot)?;
    let status = run_once(args);
    // What failed is traced, too.
    trace::finish().with_context(cannot)?;
    pending.finish(file)?;
    status
}

fn run_once(args: &BuildArgs) -> Result<ExitCode> {
    if let (Some(job), Some(parts)) = (&args.job, args.part) {
        return run_parts(args, job, parts);
    }
    if args.part.is_some() {
        // The parser does not ask for --job where there are inputs, which it excludes.
        bail!("--part needs a job instead of inputs: lodpack build --job JOB --part K");
    }
    let inputs = find_inputs(&args.inputs)?;
    let output = &match &args.output {
        Some(output) => output.clone(),
        None => beside_first(&args.inputs, &inputs, FILE_EXTENSION)?,
    };
    check_extension(output)?;
    if become_heights(&inputs, &args.model, &[(!args.ground.is_empty(), "--ground")])? {
        if args.workers.is_some() {
            bail!("heights are built by one process: omit --workers, or take --as mesh");
        }
        return super::heights::build::build(args, &inputs, output);
    }
    let work = work_directory(output, args.temp.as_deref());
    begin_in(&work, args.resume, args.force)?;
    let mut options =
        BuildOptions { work: work.clone(), resume: args.resume, ..options(inputs, &args.model, &args.run) };
    // A build that was killed at the very end has left both the file and its state.
    let overwrite = args.force || args.resume && work.exists();
    let inputs = options.inputs.iter().chain(&args.ground).map(|path| path.as_path());
    let (pending, file) = PendingFile::create(output, overwrite, inputs)?;
    interrupt::on_stop(&work, "run the same command with --resume to continue");
    let folder = args.temp.clone().unwrap_or_else(|| folder_beside(output));
    let under = ground::open(&args.ground, &mut options, &args.run, &folder)?;
    let (target, file) = Target::new(file, under.map(|under| under.heights), &folder)?;
    let finish = |mesh| -> Result<Option<Joined>> {
        let (written, ground) = target.finish(mesh)?;
        pending.finish(written)?;
        Ok(ground)
    };
    let (summary, ground) = match args.workers {
        Some(workers) => workers::run(args, workers, &options, output, file, finish)?,
        None => {
            let mut out = BufWriter::new(file);
            let progress = Terminal::working_in(args.run.progress, progress_bar::BUILD, &work);
            let built = build(&options, &mut out, &Traced::new(&progress));
            let summary = built.map_err(|error| with_advice(error, output, &work))?;
            let written = out.into_inner().map_err(|error| error.into_error());
            let ground = finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
            progress.complete();
            (summary, ground)
        }
    };
    if args.json {
        print_json(&WithGround { summary, ground })?;
        return Ok(ExitCode::SUCCESS);
    }
    print(&summary, output)?;
    ground.iter().try_for_each(ground::print)?;
    Ok(ExitCode::SUCCESS)
}

fn run_parts(args: &BuildArgs, path: &Path, PartRange { first, last }: PartRange) -> Result<ExitCode> {
    if first < last && args.output.is_some() {
        bail!("-o names one file, which cannot take several parts; omit -o, and they go to the job's directory");
    }
    interrupt::on_stop(path, "run the same command again; finished parts are kept");
    let memory = args.run.memory.unwrap_or_else(default_memory);
    let job = PlannedJob::open(path)?;
    // Before the first part is built.
    job.check_part(last)?;
    let mut built = vec![];
    let stage = if job.is_of_heights() { "tiles" } else { "roots" };
    let progress = Terminal::repeated(args.run.progress, stage, (first..=last).map(|part| job.triangles(part)));
    for part in first..=last {
        let done = job.build(part, memory, args.output.as_deref(), &progress);
        let part = done.map_err(|error| naming(error, path, args.output.as_ref().map(|_| "-o")))?;
        if args.json { built.push(part) } else { print_part(&part)? }
    }
    progress.complete();
    if args.json {
        print_json(&built)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print_part(BuiltPart { path, report }: &BuiltPart) -> Result<()> {
    match report {
        None => say!("{} is already built", path.display()),
        Some(report) => say!(
            "{}   {}, {:.2} s, CPU {:.2} s, peak memory {}",
            path.display(),
            bytes(report.bytes),
            report.seconds,
            report.cpu_seconds,
            bytes(report.peak_memory_bytes)
        ),
    }
    Ok(())
}

/// The options of a build of files, as they were typed.
pub fn options(inputs: Vec<PathBuf>, model: &ModelArgs, run: &RunArgs) -> BuildOptions {
    BuildOptions {
        inputs,
        model: model.options(),
        memory: run.memory.unwrap_or_else(default_memory),
        ..BuildOptions::default()
    }
}
