//! A note on stderr when a server does not answer for some time.

use crate::messages;
use lodpack::{ReadAt, source::Request};
use std::io;
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

/// Without an answer for this long, the first note is due.
const FIRST_NOTE: Duration = Duration::from_secs(3);
/// The time between two notes.
const NEXT_NOTE: Duration = Duration::from_secs(15);

/// A source whose requests a thread watches, until it is dropped.
pub struct Watched<S> {
    source: S,
    waiting: Arc<Mutex<Waiting>>,
}

/// The requests under way, and since when no answer has come.
struct Waiting {
    open: u32,
    since: Instant,
    /// When the last note was written.
    noted: Option<Instant>,
}

impl<S> Watched<S> {
    pub fn new(source: S, name: String) -> Self {
        let waiting = Arc::new(Mutex::new(Waiting { open: 0, since: Instant::now(), noted: None }));
        let watched = Arc::downgrade(&waiting);
        std::thread::spawn(move || watch(&watched, &name));
        Self { source, waiting }
    }

    fn watched<T>(&self, request: impl FnOnce(&S) -> T) -> T {
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
        let is_due = waiting.noted.is_none_or(|noted| noted.elapsed() >= NEXT_NOTE);
        if waiting.open > 0 && waited >= FIRST_NOTE && is_due {
            waiting.noted = Some(Instant::now());
            let seconds = waited.as_secs();
            messages::tell(
                "note",
                &format!("{name}: no answer for {seconds} s; still waiting, and retrying where that can help"),
            );
        }
    }
}

impl<S: ReadAt> ReadAt for Watched<S> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.watched(|source| source.read_at(offset, buf))
    }

    fn size(&self) -> io::Result<u64> {
        self.watched(|source| source.size())
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        self.watched(|source| source.read_start(length))
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        self.watched(|source| source.read_ranges(requests))
    }
}
