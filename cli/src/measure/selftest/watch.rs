//! Runs rows in processes of their own and watches them: none may take too long or use too much memory, and a crash is
//! a result.

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

/// How often a process is checked.
const LOOK: Duration = Duration::from_millis(10);

/// Limits for a row.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Elapsed time: far more than any row needs, because the machine may be busy.
    pub time: Duration,
    /// Resident memory. A process is checked a hundred times a second (on Linux), and once more when it ends.
    pub memory_bytes: u64,
    /// Rows that run in parallel.
    pub processes: usize,
}

/// Why rows could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SelftestError {
    /// The directory for meshes cannot be used.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// The program does not start.
    #[error("cannot run {}", program.display())]
    Program {
        /// The program.
        program: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// Runs every row as `program selftest --row CASE:DIAL --memory BYTES --temp DIR`, which prints it as JSON. `done` is
/// called with each row when it ends, in no particular order; the result is in the order of `rows`.
///
/// # Errors
///
/// If the program, or a directory in `temporary`, cannot be used at all.
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
        // A worker does not panic; if one did, its rows would be missing below.
        workers.into_iter().try_for_each(|worker| worker.join().unwrap_or(Ok(())))
    })?;
    Ok(finished.into_inner().unwrap_or_default().into_iter().flatten().collect())
}

/// The processes of running rows. While a thread holds the lock, no other starts one.
static RUNNING: Mutex<Vec<Arc<Mutex<Child>>>> = Mutex::new(vec![]);

/// Before the program itself ends: ends all rows, prevents further ones, and removes what they left in `temporary`.
pub fn stop_rows(temporary: &Path) {
    let Ok(running) = RUNNING.lock() else { return };
    for child in running.iter() {
        if let Ok(mut child) = child.lock() {
            // It may have ended by itself already.
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

/// The first part of the names of rows' directories.
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
    let (printed, said) = (directory.folder().join("row.json"), directory.folder().join("said.txt"));
    let child = Command::new(program)
        .args(["selftest", "--row", &id.to_string(), "--memory", &limits.memory_bytes.to_string(), "--temp"])
        .arg(directory.folder())
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
        // It may have ended by itself already.
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
                    row.problems.push(format!("used {} bytes of memory", row.peak_memory_bytes));
                }
                row
            })
        }
        _ => None,
    };
    Ok(row.unwrap_or_else(|| {
        let (outcome, problem) = match ended {
            Ok(status) => (Outcome::Crashed, format!("ended with {status}")),
            Err(Outcome::Memory) => (Outcome::Memory, format!("used {most_memory} bytes of memory")),
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

/// The first lines of what a process printed.
fn first_lines(path: &Path) -> String {
    let mut text = vec![];
    // Output that cannot be read counts as empty.
    let _ = std::fs::File::open(path).and_then(|file| file.take(600).read_to_end(&mut text));
    String::from_utf8_lossy(&text).split_whitespace().collect::<Vec<_>>().join(" ")
}
