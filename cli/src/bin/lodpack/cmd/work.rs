//! `lodpack work`

use super::state::naming;
use super::{print_json, use_threads};
use crate::args::{PartRange, WorkArgs};
use crate::interrupt;
use crate::output::{bytes, say};
use crate::progress_bar::Terminal;
use anyhow::{Result, bail};
use lodpack_cli::job::{Outcome, PartReport, Share, Stage, work};
use lodpack_cli::storage::default_memory;
use serde::Serialize;
use std::io::Read;
use std::process::ExitCode;

/// A task that this process did.
#[derive(Serialize)]
struct Did {
    stage: Stage,
    task: u32,
    #[serde(flatten)]
    report: PartReport,
}

/// Does tasks of a job until none is left.
pub fn run(args: &WorkArgs) -> Result<ExitCode> {
    use_threads(args.run.threads)?;
    if args.task.is_some() && args.stage.is_none() {
        bail!("--task needs the stage whose task it is: --stage repair --task 3");
    }
    if args.with_parent {
        end_with_parent();
    }
    interrupt::on_stop(&args.job, "run the same command again; finished tasks are kept");
    let memory = args.run.memory.unwrap_or_else(default_memory);
    let share =
        Share { stage: args.stage.map(Into::into), tasks: args.task.map(|PartRange { first, last }| [first, last]) };
    let (mut did, mut failure) = (vec![], None);
    let progress = Terminal::working_in(args.run.progress, &[], &args.job);
    let worked = work(&args.job, share, memory, &progress, &mut |stage, task, outcome| {
        let Outcome::Done(report) = outcome else { return };
        let report = report.clone();
        if !args.json
            && let Err(error) = print(stage, task, &report)
        {
            failure.get_or_insert(error);
        }
        did.push(Did { stage, task, report });
    });
    worked.map_err(|error| naming(error, &args.job, None))?;
    failure.map_or(Ok(()), Err)?;
    progress.complete();
    if args.json {
        print_json(&did)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(stage: Stage, task: u32, report: &PartReport) -> Result<()> {
    let memory = bytes(report.peak_memory_bytes);
    let (size, seconds, cpu) = (bytes(report.bytes), report.seconds, report.cpu_seconds);
    say!("{:<8} {task:>6}   {size}, {seconds:.2} s, CPU {cpu:.2} s, peak memory {memory}", stage.name());
    Ok(())
}

/// Ends this process when the one that has started it ends, however that happens: its end of the pipe is closed then.
fn end_with_parent() {
    std::thread::spawn(|| {
        let _ = std::io::stdin().lock().read_to_end(&mut vec![]);
        std::process::exit(interrupt::STOPPED);
    });
}
