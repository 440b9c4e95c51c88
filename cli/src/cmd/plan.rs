//! `lodpack plan`

use super::build::options;
use super::work::remove_job;
use super::{print_json, use_threads};
use crate::args::PlanArgs;
use crate::interrupt;
use crate::output::{bytes, count, say};
use crate::progress_bar::Terminal;
use anyhow::{Result, bail};
use lodpack_cli::build::BuildOptions;
use lodpack_cli::job::{Job, MANIFEST_NAME};
use std::process::ExitCode;

/// Plans a job and shows its parts.
pub fn run(args: &PlanArgs) -> Result<ExitCode> {
    use_threads(args.run.threads)?;
    let job = &args.output;
    if job.join(MANIFEST_NAME).exists() && !args.resume {
        if !args.force {
            bail!("{} holds a job; go on with --resume, or begin again with --force", job.display());
        }
        remove_job(job)?;
    }
    let options = BuildOptions { resume: args.resume, ..options(&args.inputs, &args.model, &args.run) };
    interrupt::on_stop(job, "run the same command with --resume to go on");
    let manifest = {
        let progress = Terminal::new(args.run.progress, Some(job));
        Job::plan(job, args.parts, args.part_memory, &options, &progress)?
    };
    if args.json {
        print_json(&manifest)?;
        return Ok(ExitCode::SUCCESS);
    }
    let parts = &manifest.parts;
    let total: u64 = parts.iter().map(|part| part.triangles).sum();
    let most = |of: fn(&lodpack_cli::job::PartEntry) -> u64| parts.iter().map(of).max().unwrap_or(0);
    say!("{}", job.display());
    say!("  triangles  {}, at most {} a part", count(total), count(most(|part| part.triangles)));
    say!("  parts      {}, each with --memory {} or more", count(parts.len() as u64), bytes(most(|part| part.memory)));
    say!("  next       lodpack build --job {} --part K      for K from 0 to {}", job.display(), parts.len() - 1);
    say!("  then       lodpack merge {} -o OUT.lodpack", job.display());
    Ok(ExitCode::SUCCESS)
}
