//! What a process does when: a file in the trace-event format of Chrome, which `chrome://tracing` and Perfetto draw.
//!
//! Every event says when something began, how long it took, and how much processor time its thread used meanwhile. Its
//! category says how it may be divided, from which `tests/bench/spans.py` computes work and span:
//!
//! | category | meaning |
//! |---|---|
//! | `stage` | a stage of the command, whose time is serial but for what lies in it |
//! | `loop` | a loop whose passes may run side by side; the events `pass` in it say how long each takes |
//! | `pass` | one of them |
//! | `even` | a loop over very many passes that take equally long |
//! | `step` | something else that has a name |
//!
//! Where nobody asked for a trace, each costs one load of an atomic value.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::machine::thread_cpu_time;
use crate::progress::Progress;

static IS_ON: AtomicBool = AtomicBool::new(false);
static TRACE: Mutex<Option<Trace>> = Mutex::new(None);
static THREADS: AtomicU32 = AtomicU32::new(1);

thread_local! {
    /// The number of this thread in the trace; 0 until it has written something.
    static THREAD: Cell<u32> = const { Cell::new(0) };
}

struct Trace {
    out: BufWriter<File>,
    start: Instant,
    is_first: bool,
    /// The first failure, which [`finish`] returns.
    failure: Option<io::Error>,
}

/// Begins the trace of this process in a new file.
///
/// # Errors
/// If the file cannot be written.
pub fn begin(file: File) -> io::Result<()> {
    let mut out = BufWriter::new(file);
    out.write_all(b"[")?;
    let trace = Trace { out, start: Instant::now(), is_first: true, failure: None };
    *TRACE.lock().unwrap_or_else(PoisonError::into_inner) = Some(trace);
    IS_ON.store(true, Ordering::Relaxed);
    Ok(())
}

/// Ends the trace. Nothing happens where none was begun.
///
/// # Errors
/// If the file cannot be written.
pub fn finish() -> io::Result<()> {
    IS_ON.store(false, Ordering::Relaxed);
    let Some(mut trace) = TRACE.lock().unwrap_or_else(PoisonError::into_inner).take() else { return Ok(()) };
    match trace.failure {
        Some(error) => Err(error),
        None => trace.out.write_all(b"\n]\n").and_then(|()| trace.out.flush()),
    }
}

/// A loop whose passes may run side by side, until what this returns is dropped.
pub fn parallel(name: &'static str) -> Span {
    Span::begin(name, "loop")
}

/// A pass of a loop.
pub fn pass(name: &'static str) -> Span {
    Span::begin(name, "pass")
}

/// A loop over very many passes that take equally long.
pub fn even(name: &'static str) -> Span {
    Span::begin(name, "even")
}

/// A step of a stage.
pub fn step(name: &'static str) -> Span {
    Span::begin(name, "step")
}

/// Something that has begun; it ends when this is dropped, on the same thread.
#[must_use = "it ends when it is dropped"]
#[derive(Debug)]
pub struct Span(Option<Begun>);

#[derive(Debug)]
struct Begun {
    name: &'static str,
    category: &'static str,
    at: Instant,
    cpu: Duration,
}

impl Span {
    fn begin(name: &'static str, category: &'static str) -> Self {
        let is_on = IS_ON.load(Ordering::Relaxed);
        Self(is_on.then(|| Begun { name, category, at: Instant::now(), cpu: thread_cpu_time() }))
    }
}

impl Drop for Span {
    fn drop(&mut self) {
        let Some(Begun { name, category, at, cpu }) = self.0.take() else { return };
        let (took, cpu) = (at.elapsed(), thread_cpu_time().saturating_sub(cpu));
        let thread = THREAD.with(|thread| {
            if thread.get() == 0 {
                thread.set(THREADS.fetch_add(1, Ordering::Relaxed));
            }
            thread.get()
        });
        let mut trace = TRACE.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(trace) = trace.as_mut() else { return };
        let [begin, took, cpu] =
            [at.saturating_duration_since(trace.start), took, cpu].map(|time| time.as_nanos() as f64 / 1e3);
        let comma = if std::mem::take(&mut trace.is_first) { "" } else { "," };
        // Names are of this program, without anything to escape.
        let written = write!(
            trace.out,
            "{comma}\n{{\"name\":\"{name}\",\"cat\":\"{category}\",\"ph\":\"X\",\"pid\":1,\"tid\":{thread},\
             \"ts\":{begin:.3},\"dur\":{took:.3},\"tdur\":{cpu:.3}}}"
        );
        if let Err(error) = written {
            trace.failure.get_or_insert(error);
        }
    }
}

/// Hands progress on, and traces the stages.
pub struct Traced<'a> {
    inner: &'a dyn Progress,
    stage: Mutex<Span>,
}

impl<'a> Traced<'a> {
    /// In front of another listener.
    pub fn new(inner: &'a dyn Progress) -> Self {
        Self { inner, stage: Mutex::new(Span(None)) }
    }
}

impl Progress for Traced<'_> {
    fn begin(&self, stage: &'static str, total: u64) {
        {
            let mut current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
            if current.0.as_ref().is_none_or(|current| current.name != stage) {
                // The one before ends first.
                drop(std::mem::replace(&mut *current, Span(None)));
                *current = Span::begin(stage, "stage");
            }
        }
        self.inner.begin(stage, total);
    }

    fn advance(&self, amount: u64) {
        self.inner.advance(amount);
    }

    fn skip(&self, amount: u64) {
        self.inner.skip(amount);
    }

    fn note(&self, message: &str) {
        self.inner.note(message);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    #[test]
    fn what_was_begun_is_in_the_file_with_its_times() {
        drop(pass("before"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        begin(File::create(&path).unwrap()).unwrap();
        let progress = Traced::new(&Silent);
        progress.begin("import", 0);
        progress.begin("import", 7);
        progress.begin("roots", 3);
        {
            let _all = parallel("charts");
            std::thread::scope(|scope| {
                scope.spawn(|| drop(pass("chart")));
            });
        }
        drop(progress);
        finish().unwrap();
        finish().unwrap();
        drop(pass("behind"));
        let text = std::fs::read_to_string(&path).unwrap();
        let names: Vec<&str> =
            text.lines().filter_map(|line| line.strip_prefix("{\"name\":\"")?.split('"').next()).collect();
        assert_eq!(names, ["import", "chart", "charts", "roots"]);
        assert!(text.starts_with('[') && text.ends_with("\n]\n"));
        let is_whole = |line: &str| line.contains("\"ph\":\"X\"") && line.trim_end_matches(',').ends_with('}');
        assert!(text.lines().skip(1).take(4).all(is_whole), "{text}");
    }
}
