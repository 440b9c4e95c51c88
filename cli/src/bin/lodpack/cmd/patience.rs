//! Says on stderr when a server keeps one waiting.

use crate::talk;
use lodpack::{ReadAt, source::Request};
use std::io;
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

/// How long nothing is said.
const PATIENCE: Duration = Duration::from_secs(3);
/// Between two notes.
const AGAIN: Duration = Duration::from_secs(15);

/// A source that is watched by a thread while it is there.
pub struct Patient<S> {
    source: S,
    waiting: Arc<Mutex<Waiting>>,
}

/// Requests on their way, and since when nothing has come.
struct Waiting {
    open: u32,
    since: Instant,
    /// When it was said last.
    told: Option<Instant>,
}

impl<S> Patient<S> {
    pub fn new(source: S, name: String) -> Self {
        let waiting = Arc::new(Mutex::new(Waiting { open: 0, since: Instant::now(), told: None }));
        let watched = Arc::downgrade(&waiting);
        std::thread::spawn(move || watch(&watched, &name));
        Self { source, waiting }
    }

    fn waited<T>(&self, request: impl FnOnce(&S) -> T) -> T {
        self.change(|waiting| {
            waiting.since = if waiting.open == 0 { Instant::now() } else { waiting.since };
            waiting.open += 1;
        });
        let answer = request(&self.source);
        self.change(|waiting| {
            waiting.open -= 1;
            waiting.since = Instant::now();
        });
        answer
    }

    fn change(&self, change: impl FnOnce(&mut Waiting)) {
        if let Ok(mut waiting) = self.waiting.lock() {
            change(&mut waiting);
        }
    }
}

fn watch(watched: &Weak<Mutex<Waiting>>, name: &str) {
    loop {
        std::thread::sleep(Duration::from_millis(500));
        let Some(waiting) = watched.upgrade() else { return };
        let Ok(mut waiting) = waiting.lock() else { return };
        let waited = waiting.since.elapsed();
        let is_due = waiting.told.is_none_or(|told| told.elapsed() >= AGAIN);
        if waiting.open > 0 && waited >= PATIENCE && is_due {
            waiting.told = Some(Instant::now());
            let seconds = waited.as_secs();
            talk::tell(
                "note",
                &format!("{name}: no answer for {seconds} s; waiting, and trying again where that helps"),
            );
        }
    }
}

impl<S: ReadAt> ReadAt for Patient<S> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.waited(|source| source.read_at(offset, buf))
    }

    fn size(&self) -> io::Result<u64> {
        self.waited(|source| source.size())
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        self.waited(|source| source.read_start(length))
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        self.waited(|source| source.read_ranges(requests))
    }
}
