//! `lodpack plan` and `lodpack add`

use super::build::options;
use super::work::remove_job;
use super::{print_json, use_threads};
use crate::args::{AddArgs, JobArgs, PlanArgs};
use crate::interrupt;
use crate::output::{bytes, count, say};
use crate::progress_bar::Terminal;
use anyhow::{Result, bail};
use lodpack_cli::build::BuildOptions;
use lodpack_cli::job::{Job, MANIFEST_NAME, Manifest, PartEntry};
use lodpack_cli::memory::machine_bytes;
use std::process::ExitCode;

/// Plans a job and shows its parts.
pub fn run(args: &PlanArgs) -> Result<ExitCode> {
    let job = &args.job;
    begin(job)?;
    let options = BuildOptions { resume: job.resume, ..options(&args.inputs, &args.model, &job.run) };
    let manifest = {
        let progress = Terminal::new(job.run.progress, Some(&job.output));
        Job::plan(&job.output, job.parts, job.part_memory, &options, &progress)?
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
        let progress = Terminal::new(job.run.progress, Some(&job.output));
        Job::add(&args.earlier, &job.output, job.parts, job.part_memory, &options, &progress)?
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
    let job = &args.output;
    if job.join(MANIFEST_NAME).exists() && !args.resume {
        if !args.force {
            bail!("{} holds a job; go on with --resume, or begin again with --force", job.display());
        }
        remove_job(job)?;
    }
    interrupt::on_stop(job, "run the same command with --resume to go on");
    Ok(())
}

fn print(args: &JobArgs, manifest: &Manifest, taken_over: Option<[u32; 2]>) -> Result<()> {
    let (job, parts) = (args.output.display(), &manifest.parts);
    let total: u64 = parts.iter().map(|part| part.triangles).sum();
    let most = |of: fn(&PartEntry) -> u64| parts.iter().map(of).max().unwrap_or(0);
    say!("{job}");
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
