//! `lodpack status`

use super::print_json;
use crate::args::StatusArgs;
use crate::output::{bytes, count, say, shell};
use anyhow::Result;
use lodpack_cli::job::{JobStatus, PartState, PartStatus};
use std::path::Path;
use std::process::ExitCode;

/// The most failures of a stage that are printed.
const MOST_FAILED: usize = 5;

/// Shows which parts of a job are done.
pub fn run(args: &StatusArgs) -> Result<ExitCode> {
    let status = JobStatus::of(&args.job)?;
    let is_done = status.planned && status.done() == status.parts.len();
    let exit = if is_done { ExitCode::SUCCESS } else { ExitCode::from(1) };
    if args.json {
        print_json(&status)?;
        return Ok(exit);
    }
    say!("{}   job {}", args.job.display(), status.job);
    for input in &status.changed_inputs {
        say!("  {input} has changed since the job was planned");
    }
    if !status.stages.is_empty() {
        print_stages(&args.job, &status)?;
    }
    if !status.planned && !status.stages.is_empty() {
        return Ok(exit);
    }
    if !status.planned {
        say!("  the plan is incomplete: run the same `lodpack plan` again with --resume");
        return Ok(exit);
    }
    say!("  {:>6} {:>8} {:>13} {:<8}", "part", "regions", "triangles", "state");
    for part in &status.parts {
        print_part(part)?;
    }
    say!("  {} of {} parts are done", count(status.done() as u64), count(status.parts.len() as u64));
    Ok(exit)
}

fn print_stages(job: &Path, status: &JobStatus) -> Result<()> {
    say!(
        "  {:>8} {:>7} {:>7} {:>7} {:>7} {:>10} {:>9} {:>9} {:>10}",
        "stage",
        "tasks",
        "done",
        "running",
        "failed",
        "CPU s",
        "median s",
        "most s",
        "bytes"
    );
    let time = |seconds: Option<f64>| seconds.map_or(String::new(), |seconds| format!("{seconds:.2}"));
    for stage in &status.stages {
        say!(
            "  {:>8} {:>7} {:>7} {:>7} {:>7} {:>10.2} {:>9} {:>9} {:>10}",
            stage.stage.name(),
            stage.tasks,
            stage.done,
            stage.running.len(),
            stage.failed.len(),
            stage.cpu_seconds,
            time(stage.median_seconds),
            time(stage.longest_seconds),
            bytes(stage.bytes)
        );
    }
    for stage in &status.stages {
        for task in &stage.running {
            let late = if task.is_late { ", late: others took much less" } else { "" };
            let since = task.seconds.map_or(String::new(), |seconds| format!(" for {seconds:.0} s"));
            say!("  {} {} is with {}{since}{late}", stage.stage, task.task, task.by);
        }
        for task in stage.failed.iter().take(MOST_FAILED) {
            say!("  {} {} failed: {}", stage.stage, task.task, task.reason);
            say!("    {}", task.note.display());
        }
        if stage.failed.len() > MOST_FAILED {
            say!("  and {} more; --json has all", stage.failed.len() - MOST_FAILED);
        }
    }
    match status.remaining_seconds {
        Some(0.0) => say!("  all tasks are done: lodpack merge {}", shell(job)),
        Some(seconds) => say!("  about {seconds:.0} s left with as many workers as now"),
        None => say!("  next       lodpack work {}", shell(job)),
    }
    Ok(())
}

fn print_part(part: &PartStatus) -> Result<()> {
    let (state, more) = match &part.state {
        PartState::Done { bytes: size, report: Some(r) } => {
            let memory = bytes(r.peak_memory_bytes);
            ("done", format!("{}, {:.2} s, CPU {:.2} s, peak memory {memory}", bytes(*size), r.seconds, r.cpu_seconds))
        }
        PartState::Done { bytes: size, report: None } => ("done", bytes(*size)),
        PartState::Running { by } => ("running", by.clone()),
        PartState::Failed { reason } => ("failed", reason.clone()),
        PartState::Broken { reason } => ("broken", reason.clone()),
        PartState::Missing => ("missing", String::new()),
        PartState::Empty => ("empty", "nothing to do".into()),
    };
    say!("  {:>6} {:>8} {:>13} {state:<8} {more}", part.part, part.regions, count(part.triangles));
    Ok(())
}
