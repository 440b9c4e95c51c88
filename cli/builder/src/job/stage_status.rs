//! The state of the stages of a job: what is done, who is at work and since when, and what failed.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::stage::TaskFiles;
use super::{PartReport, Stage};
use lodpack_runtime::storage::Lock;

/// A running task is late once it takes this many times as long as those that are done.
const LATE: f64 = 2.0;
/// The least share of a job that has to be done before the rest is estimated.
const ENOUGH: f64 = 0.02;

/// The state of a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageStatus {
    /// Which one.
    pub stage: Stage,
    /// The number of its tasks.
    pub tasks: u32,
    /// How many are done.
    pub done: u32,
    /// Those that a process is doing.
    pub running: Vec<RunningTask>,
    /// Those whose last attempt failed.
    pub failed: Vec<FailedTask>,
    /// Elapsed time of all tasks that are done and have a report.
    pub seconds: f64,
    /// Their processor time.
    pub cpu_seconds: f64,
    /// Bytes that they handed on.
    pub bytes: u64,
    /// The most memory that a process had that did one.
    pub peak_memory_bytes: u64,
    /// The median of their elapsed times.
    pub median_seconds: Option<f64>,
    /// The longest of their elapsed times.
    pub longest_seconds: Option<f64>,
}

/// A task that a process is doing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunningTask {
    /// Its number.
    pub task: u32,
    /// The process.
    pub by: String,
    /// For how long, by the clocks of this machine and of the disk. Only people need it.
    pub seconds: Option<f64>,
    /// Whether others took much less. Another worker that is told to do it waits for this one; if this one is killed,
    /// it does it.
    pub is_late: bool,
}

/// A task that failed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FailedTask {
    /// Its number.
    pub task: u32,
    /// Why.
    pub reason: String,
    /// The file that says so.
    pub note: PathBuf,
}

impl StageStatus {
    pub(super) fn of(job: &Path, stage: Stage, tasks: u32) -> Self {
        let (mut done, mut running, mut failed) = (0, vec![], vec![]);
        let mut reports: Vec<PartReport> = vec![];
        for task in 0..tasks {
            let files = TaskFiles::new(job, stage, task);
            if files.product.exists() {
                done += 1;
                reports.extend(fs::read(&files.report).ok().and_then(|text| serde_json::from_slice(&text).ok()));
            } else if let Some(by) = Lock::holder(&files.lock) {
                let since = fs::metadata(&files.lock).and_then(|metadata| metadata.modified()).ok();
                let seconds = since.and_then(|since| since.elapsed().ok()).map(|elapsed| elapsed.as_secs_f64());
                running.push(RunningTask { task, by, seconds, is_late: false });
            } else if let Ok(reason) = fs::read_to_string(&files.failure) {
                failed.push(FailedTask { task, reason, note: files.failure });
            }
        }
        let mut seconds: Vec<f64> = reports.iter().map(|report| report.seconds).collect();
        seconds.sort_by(f64::total_cmp);
        let median_seconds = seconds.get(seconds.len() / 2).copied();
        for task in &mut running {
            task.is_late = median_seconds.zip(task.seconds).is_some_and(|(median, now)| now > LATE * median + 1.0);
        }
        Self {
            stage,
            tasks,
            done,
            running,
            failed,
            seconds: seconds.iter().sum(),
            cpu_seconds: reports.iter().map(|report| report.cpu_seconds).sum(),
            bytes: reports.iter().map(|report| report.bytes).sum(),
            peak_memory_bytes: reports.iter().map(|report| report.peak_memory_bytes).max().unwrap_or(0),
            median_seconds,
            longest_seconds: seconds.last().copied(),
        }
    }
}

/// About how many seconds are left for as many workers as are at work now.
pub(super) fn remaining(stages: &[StageStatus]) -> Option<f64> {
    let share = |stage: &StageStatus| stage.stage.share() * f64::from(stage.done) / f64::from(stage.tasks.max(1));
    let counted = || stages.iter().filter(|stage| stage.tasks > 0);
    let (done, all): (f64, f64) = (counted().map(share).sum(), counted().map(|stage| stage.stage.share()).sum());
    let (busy, running): (f64, usize) =
        (counted().map(|stage| stage.seconds).sum(), counted().map(|stage| stage.running.len()).sum());
    if all > 0.0 && done >= all {
        return Some(0.0);
    }
    (done > ENOUGH && running > 0).then(|| busy * (all - done) / done / running as f64)
}
