//! `lodpack status`

use super::print_json;
use crate::args::StatusArgs;
use crate::output::{bytes, count, say};
use anyhow::Result;
use lodpack_cli::job::{JobStatus, PartState, PartStatus};
use std::process::ExitCode;

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
    };
    say!("  {:>6} {:>8} {:>13} {state:<8} {more}", part.part, part.regions, count(part.triangles));
    Ok(())
}
