//! `lodpack plan` and `lodpack add`

use super::build::options;
use super::ground::{self, Under};
use super::inputs::{Notes, become_heights, find_inputs};
use super::state::{begin_job, beside_first, folder_beside, naming};
use super::{print_json, use_threads};
use crate::args::{AddArgs, JobArgs, PlanArgs};
use crate::interrupt;
use crate::messages;
use crate::output::{bytes, count, say, shell};
use crate::progress_bar::{self, Terminal};
use anyhow::{Result, anyhow, bail};
use lodpack_cli::job::{
    BuildError, BuildOptions, GROUND_NAME, JOB_EXTENSION, Job, Manifest, PartEntry, PartOptions, Stage, StagedJob,
    keep_ground,
};
use lodpack_cli::pipeline::ColourQuality;
use lodpack_cli::progress::Progress;
use lodpack_cli::storage::default_memory;
use std::path::Path;
use std::process::ExitCode;

/// Plans a job and shows its parts.
pub fn run(args: &PlanArgs) -> Result<ExitCode> {
    let job = &args.job;
    let inputs = find_inputs(&args.inputs)?;
    let output = &match &args.output {
        Some(output) => output.clone(),
        None => beside_first(&args.inputs, &inputs, JOB_EXTENSION)?,
    };
    begin(output, job)?;
    let model = &args.model;
    let others = [
        (job.stages, "--stages"),
        (!args.ground.is_empty(), "--ground"),
        (model.raster.drape.is_some(), "--drape"),
        (model.color_quality != ColourQuality::default(), "--color-quality"),
    ];
    let heights = become_heights(&inputs, model, &others)?;
    let mut options = BuildOptions { resume: job.resume, heights, ..options(inputs, &args.model, &job.run) };
    // The job's directory itself, once it exists, would pass for a device.
    let under =
        ground::open(&args.ground, &mut options, &job.run, &folder_beside(&output.with_file_name(GROUND_NAME)))?;
    options.ground = under.as_ref().map(|under| under.inputs.clone()).unwrap_or_default();
    if job.stages {
        return begin_stages(output, job, &options, under.as_ref());
    }
    let manifest = {
        let stages = if heights { progress_bar::PLAN_HEIGHTS } else { progress_bar::PLAN };
        let progress = Terminal::working_in(job.run.progress, stages, output);
        let planned = Job::plan(output, part_options(job), &options, &progress);
        let manifest = planned.map_err(|error| advised(error, output))?;
        keep(under.as_ref(), output)?;
        note_empty_parts(&manifest, &progress);
        progress.complete();
        manifest
    };
    if job.json {
        print_json(&manifest)?;
    } else {
        print(output, &manifest, None)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Plans a job that adds inputs to an earlier one, and shows its parts.
pub fn run_add(args: &AddArgs) -> Result<ExitCode> {
    let (job, new) = (&args.job, &args.output);
    let [earlier, output] = [&args.earlier, new].map(|path| path.canonicalize().unwrap_or_else(|_| path.clone()));
    if job.stages {
        bail!("adding cannot be divided into stages yet: omit --stages, or plan all inputs anew with it");
    }
    if earlier == output {
        bail!(
            "the new job cannot replace {}, to which it adds; name another directory with -o",
            args.earlier.display()
        );
    }
    begin(new, job)?;
    let memory = job.run.memory.unwrap_or_else(default_memory);
    let options =
        BuildOptions { inputs: find_inputs(&args.inputs)?, memory, resume: job.resume, ..BuildOptions::default() };
    let added = {
        let progress = Terminal::working_in(job.run.progress, progress_bar::PLAN, new);
        let added = Job::add(&args.earlier, new, part_options(job), &options, &progress);
        let added = added.map_err(|error| advised(error, new))?;
        note_empty_parts(&added.manifest, &progress);
        progress.complete();
        added
    };
    if job.json {
        print_json(&added)?;
    } else {
        print(new, &added.manifest, Some([added.taken_over, added.regions]))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Prepares a directory for a job.
fn begin(job: &Path, args: &JobArgs) -> Result<()> {
    use_threads(args.run.threads)?;
    begin_job(job, args.resume, args.force)?;
    interrupt::on_stop(job, "run the same command with --resume to continue");
    Ok(())
}

fn part_options(args: &JobArgs) -> PartOptions {
    PartOptions { count: args.parts, memory: args.part_memory, range_bytes: args.range_bytes }
}

/// Puts the ground of a job's mesh into its directory, for the merge.
fn keep(under: Option<&Under>, job: &Path) -> Result<()> {
    match under {
        Some(under) => Ok(keep_ground(job, under.heights.source())?),
        None => Ok(()),
    }
}

/// Begins a job that workers plan, and shows its stages.
fn begin_stages(output: &Path, args: &JobArgs, options: &BuildOptions, under: Option<&Under>) -> Result<ExitCode> {
    let manifest = StagedJob::begin(output, part_options(args), options, &Notes);
    let manifest = manifest.map_err(|error| naming(error, output, Some("-o")))?;
    keep(under, output)?;
    if args.json {
        print_json(&manifest)?;
        return Ok(ExitCode::SUCCESS);
    }
    let (job, stages) = (shell(output), StagedJob::open(output)?.stages());
    say!("{}", output.display());
    if stages.tasks(Stage::Import) == 1 {
        say!("  import     1 task: an input cannot be read in ranges, or has channels, so one worker reads everything");
    }
    say!("  stages     {} of ranges of the input, {} of regions", tasks(stages.ranges), tasks(stages.parts));
    say!("  next       lodpack work {job}      on as many machines as there are, or: lodpack submit {job}");
    say!("  then       lodpack merge {job}     writes {} beside it", manifest.output.display());
    Ok(ExitCode::SUCCESS)
}

fn tasks(number: u32) -> String {
    if number == 1 { "1 task".into() } else { format!("{} tasks", count(number.into())) }
}

/// Adds to an error how to continue, if the plan is kept.
fn advised(error: BuildError, job: &Path) -> anyhow::Error {
    let has_plan = error.is_lack_of_memory() && job.exists();
    let error = naming(error, job, Some("-o"));
    match has_plan {
        true => anyhow!("{}; the plan is kept: continue it with --resume", messages::with_reasons(&error)),
        false => error,
    }
}

/// Notes parts that have nothing to do: scripts count on as many parts as were asked for, so they exist.
fn note_empty_parts(manifest: &Manifest, progress: &Terminal) {
    let (parts, empty) = (manifest.parts.len(), manifest.parts.iter().filter(|part| part.regions == 0).count());
    let regions: u32 = manifest.parts.iter().map(|part| part.regions).sum();
    if empty > 0 {
        let size = if manifest.heights { "about 1,024 x 1,024 cells" } else { "at most two million triangles" };
        progress.note(&format!(
            "{} of {} parts have nothing to do: the input has {} regions (of {size}), which cannot be divided",
            count(empty as u64),
            count(parts as u64),
            count(regions.into())
        ));
    }
}

fn print(path: &Path, manifest: &Manifest, taken_over: Option<[u32; 2]>) -> Result<()> {
    let (job, parts) = (shell(path), &manifest.parts);
    let total: u64 = parts.iter().map(|part| part.triangles).sum();
    let most = |of: fn(&PartEntry) -> u64| parts.iter().map(of).max().unwrap_or(0);
    say!("{}", path.display());
    match manifest.heights {
        true => say!("  cells      {}, at most {} a part", count(total / 2), count(most(|part| part.triangles / 2))),
        false => say!("  triangles  {}, at most {} a part", count(total), count(most(|part| part.triangles))),
    }
    if let Some([taken_over, regions]) = taken_over {
        let [taken_over, regions] = [taken_over, regions].map(|number| count(number.into()));
        say!("  regions    {regions}, of which {taken_over} are already built");
    }
    say!("  parts      {}, each needs --memory {} or more", count(parts.len() as u64), bytes(most(|part| part.memory)));
    match parts.len() {
        1 => say!("  next       lodpack build --job {job} --part 0"),
        count => say!("  next       lodpack build --job {job} --part K      for each K from 0 to {}", count - 1),
    }
    say!("  then       lodpack merge {job}      writes {} beside it", manifest.output.display());
    Ok(())
}
