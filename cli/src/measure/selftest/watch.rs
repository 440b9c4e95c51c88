//! Rows in processes of their own, watched: none may take too long or too much memory, and one that crashes is a result.

use super::{Outcome, Row, RowId};
use crate::machine::status_bytes;
use crate::storage::{WorkDirectory, WorkError};
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How often a process is looked at.
const LOOK: Duration = Duration::from_millis(10);

/// What a row may take.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Elapsed time. Far more than any row needs, since the machine may be busy.
    pub time: Duration,
    /// Resident memory. A process is looked at a hundred times a second (on Linux), and once more when it ends.
    pub memory_bytes: u64,
    /// Rows side by side.
    pub processes: usize,
}

/// Why rows cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SelftestError {
    /// No place for meshes.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// The program does not start.
    #[error("cannot run {}", program.display())]
    Program {
        /// What was to be started.
        program: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Runs every row as `program selftest --row CASE:DIAL --memory BYTES --temp DIR`, which prints it as JSON. `done` hears of
/// each when it ends, in no particular order; the result is in the order of `rows`.
///
/// # Errors
/// Where the program or a directory in `temporary` cannot be used at all.
pub fn run_rows(
    program: &Path,
    rows: &[RowId],
    limits: &Limits,
    temporary: &Path,
    done: &(dyn Fn(&Row) + Sync),
) -> Result<Vec<Row>, SelftestError> {
    let next = AtomicUsize::new(0);
    let finished: Mutex<Vec<Option<Row>>> = Mutex::new(vec![None; rows.len()]);
    let work = || -> Result<(), SelftestError> {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(&id) = rows.get(index) else { return Ok(()) };
            let row = watch_row(program, id, limits, temporary)?;
            done(&row);
            if let Ok(mut finished) = finished.lock() {
                finished[index] = Some(row);
            }
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..limits.processes.clamp(1, rows.len().max(1))).map(|_| scope.spawn(work)).collect();
        // A worker does not panic; if it did, its rows would be missing below.
        workers.into_iter().try_for_each(|worker| worker.join().unwrap_or(Ok(())))
    })?;
    Ok(finished.into_inner().unwrap_or_default().into_iter().flatten().collect())
}

/// Processes of rows that are running. Nobody starts one while somebody else holds this.
static RUNNING: Mutex<Vec<Arc<Mutex<Child>>>> = Mutex::new(vec![]);

/// Ends all rows, lets no other begin, and removes what they have left in `temporary`: before the program itself ends.
pub fn stop_rows(temporary: &Path) {
    let Ok(running) = RUNNING.lock() else { return };
    for child in running.iter() {
        if let Ok(mut child) = child.lock() {
            // It may just have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
    for entry in fs::read_dir(temporary).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(|name| name.starts_with(&own_prefix()) && name.ends_with(SUFFIX)) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
    std::mem::forget(running);
}

/// How names of the directories of rows begin and end.
fn own_prefix() -> String {
    format!("lodpack-{}-", std::process::id())
}

const SUFFIX: &str = ".selftest";

fn watch_row(program: &Path, id: RowId, limits: &Limits, temporary: &Path) -> Result<Row, SelftestError> {
    let failed = |source| SelftestError::Program { program: program.to_owned(), source };
    let locked = || failed(io::Error::other("another row has failed"));
    let start = Instant::now();
    let mut running = RUNNING.lock().map_err(|_| locked())?;
    let name = format!("{}{}{SUFFIX}", own_prefix(), id.to_string().replace(':', "-"));
    let directory = WorkDirectory::create(&temporary.join(name))?;
    let (printed, said) = (directory.path("row.json"), directory.path("said.txt"));
    let child = Command::new(program)
        .args(["selftest", "--row", &id.to_string(), "--memory", &limits.memory_bytes.to_string(), "--temp"])
        .arg(directory.path(""))
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&printed).map_err(failed)?)
        .stderr(std::fs::File::create(&said).map_err(failed)?)
        .spawn()
        .map_err(failed)?;
    let shared = Arc::new(Mutex::new(child));
    running.push(shared.clone());
    drop(running);
    let mut most_memory = 0;
    let ended = loop {
        let mut child = shared.lock().map_err(|_| locked())?;
        if let Some(status) = child.try_wait().map_err(failed)? {
            break Ok(status);
        }
        most_memory = most_memory.max(status_bytes(&child.id().to_string(), "VmRSS").unwrap_or(0));
        if most_memory > limits.memory_bytes {
            break Err(Outcome::Memory);
        }
        if start.elapsed() > limits.time {
            break Err(Outcome::Hung);
        }
        drop(child);
        std::thread::sleep(LOOK);
    };
    if ended.is_err() {
        let mut child = shared.lock().map_err(|_| locked())?;
        // It may just have ended by itself.
        let _ = child.kill();
        child.wait().map_err(failed)?;
    }
    RUNNING.lock().map_err(|_| locked())?.retain(|other| !Arc::ptr_eq(other, &shared));
    let row = match &ended {
        Ok(status) if status.success() => {
            let row: Option<Row> = std::fs::read(&printed).ok().and_then(|text| serde_json::from_slice(&text).ok());
            row.map(|mut row| {
                if row.peak_memory_bytes > limits.memory_bytes {
                    row.outcome = Outcome::Memory;
                    row.problems.push(format!("took {} bytes of memory", row.peak_memory_bytes));
                }
                row
            })
        }
        _ => None,
    };
    Ok(row.unwrap_or_else(|| {
        let (outcome, problem) = match ended {
            Ok(status) => (Outcome::Crashed, format!("ended with {status}")),
            Err(Outcome::Memory) => (Outcome::Memory, format!("took {most_memory} bytes of memory")),
            Err(outcome) => (outcome, format!("took more than {} s", limits.time.as_secs())),
        };
        Row {
            case: id.case.name.into(),
            dial: id.dial,
            outcome,
            message: first_lines(&said),
            problems: vec![problem],
            peak_memory_bytes: most_memory,
            ..Row::default()
        }
    }))
}

/// What a process said, at most a few lines of it.
fn first_lines(path: &Path) -> String {
    let mut text = vec![];
    // What cannot be read was not said.
    let _ = std::fs::File::open(path).and_then(|file| file.take(600).read_to_end(&mut text));
    String::from_utf8_lossy(&text).split_whitespace().collect::<Vec<_>>().join(" ")
}
