//! `lodpack plan` and `lodpack add`

use super::build::options;
use super::work::{begin_job, naming};
use super::{print_json, use_threads};
use crate::args::{AddArgs, JobArgs, PlanArgs};
use crate::interrupt;
use crate::output::{bytes, count, say, shell};
use crate::progress_bar::{self, Terminal};
use crate::talk;
use anyhow::{Result, anyhow, bail};
use lodpack_cli::job::{BuildError, BuildOptions, Job, Manifest, PartEntry};
use lodpack_cli::progress::Progress;
use lodpack_cli::storage::memory::machine_bytes;
use std::process::ExitCode;

/// Plans a job and shows its parts.
pub fn run(args: &PlanArgs) -> Result<ExitCode> {
    let job = &args.job;
    begin(job)?;
    let options = BuildOptions { resume: job.resume, ..options(&args.inputs, &args.model, &job.run) };
    let manifest = {
        let progress = Terminal::working_in(job.run.progress, progress_bar::PLAN, &job.output);
        let planned = Job::plan(&job.output, job.parts, job.part_memory, &options, &progress);
        let manifest = planned.map_err(|error| advised(error, job))?;
        note_empty_parts(&manifest, &progress);
        progress.complete();
        manifest
    };
    if job.json {
        print_json(&manifest)?;
    } else {
        print(job, &manifest, None)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Plans a job that adds to an earlier one.
pub fn run_add(args: &AddArgs) -> Result<ExitCode> {
    let job = &args.job;
    let [earlier, output] =
        [&args.earlier, &job.output].map(|path| path.canonicalize().unwrap_or_else(|_| path.clone()));
    if earlier == output {
        bail!("{} cannot be added to in its own place; name another directory with -o", args.earlier.display());
    }
    begin(job)?;
    let memory = job.run.memory.unwrap_or_else(|| machine_bytes() / 2);
    let options = BuildOptions { inputs: args.inputs.clone(), memory, resume: job.resume, ..BuildOptions::default() };
    let added = {
        let progress = Terminal::working_in(job.run.progress, progress_bar::PLAN, &job.output);
        let added = Job::add(&args.earlier, &job.output, job.parts, job.part_memory, &options, &progress);
        let added = added.map_err(|error| advised(error, job))?;
        note_empty_parts(&added.manifest, &progress);
        progress.complete();
        added
    };
    if job.json {
        print_json(&added)?;
    } else {
        print(job, &added.manifest, Some([added.taken_over, added.regions]))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Sees to it that there is room for a job.
fn begin(args: &JobArgs) -> Result<()> {
    use_threads(args.run.threads)?;
    begin_job(&args.output, args.resume, args.force)?;
    interrupt::on_stop(&args.output, "run the same command with --resume to go on");
    Ok(())
}

/// Says how to go on where a plan is kept.
fn advised(error: BuildError, args: &JobArgs) -> anyhow::Error {
    let has_plan = error.is_lack_of_memory() && args.output.exists();
    let error = naming(error, &args.output, Some("-o"));
    match has_plan {
        true => anyhow!("{}; the plan is kept: --resume goes on with it", talk::told(&error)),
        false => error,
    }
}

/// There are as many parts as were asked for, since scripts count on it; but some may have nothing to do.
fn note_empty_parts(manifest: &Manifest, progress: &Terminal) {
    let (parts, empty) = (manifest.parts.len(), manifest.parts.iter().filter(|part| part.regions == 0).count());
    let regions: u32 = manifest.parts.iter().map(|part| part.regions).sum();
    if empty > 0 {
        progress.note(&format!(
            "{} of {} parts have nothing to do: there are {} regions (of at most two million triangles), and none of them is divided",
            count(empty as u64),
            count(parts as u64),
            count(regions.into())
        ));
    }
}

fn print(args: &JobArgs, manifest: &Manifest, taken_over: Option<[u32; 2]>) -> Result<()> {
    let (job, parts) = (shell(&args.output), &manifest.parts);
    let total: u64 = parts.iter().map(|part| part.triangles).sum();
    let most = |of: fn(&PartEntry) -> u64| parts.iter().map(of).max().unwrap_or(0);
    say!("{}", args.output.display());
    say!("  triangles  {}, at most {} a part", count(total), count(most(|part| part.triangles)));
    if let Some([taken_over, regions]) = taken_over {
        let [taken_over, regions] = [taken_over, regions].map(|number| count(number.into()));
        say!("  regions    {regions}, of which {taken_over} are built already");
    }
    say!("  parts      {}, each with --memory {} or more", count(parts.len() as u64), bytes(most(|part| part.memory)));
    say!("  next       lodpack build --job {job} --part K      for K from 0 to {}", parts.len() - 1);
    say!("  then       lodpack merge {job} -o OUT.lodpack");
    Ok(())
}
