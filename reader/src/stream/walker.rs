//! A thread that walks down the tree of a large file, so that frames choose from what their query wants.
//!
//! Frames choose from the part of the tree that is known. Where that ends, a group stands for what is below it, until
//! the walker has read the index further and hands over a larger part. So no frame waits for the index.

use std::{
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use crate::{
    error::Result,
    select::{Adapter, Coherence, Hierarchy, Query, View},
};

/// Finds what a query has to choose from. Reads what it needs.
pub(crate) type Walk = dyn Fn(&Query) -> Result<Arc<Hierarchy>> + Send;

/// The walker looks further than the query: it looks for this share of the tolerance, so that what a camera that comes
/// nearer wants is known before it does.
const TOLERANCE_SHARE: f64 = 0.5;

/// Time before a walk that has failed is tried again for the same query.
const RETRY_DELAY: Duration = Duration::from_secs(1);

#[derive(Default)]
struct State {
    asked: Option<Query>,
    is_walking: bool,
    found: Option<Result<Adapter>>,
    is_over: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread; it ends when this is dropped.
pub(crate) struct Walker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    last: Option<Query>,
    /// When the last walk failed, if it did.
    failed: Option<Instant>,
}

impl Walker {
    /// Starts the thread.
    pub fn spawn(walk: Box<Walk>, coherence: Coherence) -> Self {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::spawn(move || work(&of_thread, &*walk, coherence));
        Self { shared, thread: Some(thread), last: None, failed: None }
    }

    /// Looks for what a query wants, unless it was the last one to be asked. Returns what was found since, for a query
    /// not long ago.
    pub fn follow(&mut self, query: &Query) -> Option<Result<Adapter>> {
        let mut state = self.shared.lock();
        let found = state.found.take();
        if matches!(found, Some(Err(_))) {
            self.failed = Some(Instant::now());
        }
        let is_due = self.failed.is_some_and(|failed| failed.elapsed() >= RETRY_DELAY);
        if self.last.as_ref() != Some(query) || is_due {
            (self.last, self.failed) = (Some(query.clone()), None);
            state.asked = Some(query.clone());
            self.shared.changed.notify_all();
        }
        found
    }

    /// Waits until the last query has been walked for.
    pub fn settle(&self) {
        let mut state = self.shared.lock();
        while state.asked.is_some() || state.is_walking {
            state = self.shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for Walker {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic has been reported by the thread.
            let _ = thread.join();
        }
    }
}

/// Ends a walk however it ends, so that no other thread waits for one that has panicked.
struct Walking<'s>(&'s Shared);

impl Drop for Walking<'_> {
    fn drop(&mut self) {
        self.0.lock().is_walking = false;
        self.0.changed.notify_all();
    }
}

fn work(shared: &Shared, walk: &Walk, coherence: Coherence) {
    loop {
        let mut state = shared.lock();
        let query = loop {
            if state.is_over {
                return;
            }
            if let Some(query) = state.asked.take() {
                break query;
            }
            state = shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        state.is_walking = true;
        drop(state);
        let walking = Walking(shared);
        let further = Query {
            view: query.view.map(|view| View { pixel_tolerance: view.pixel_tolerance * TOLERANCE_SHARE, ..view }),
            tolerance: query.tolerance.map(|tolerance| tolerance * TOLERANCE_SHARE),
            ..query.clone()
        };
        let found = walk(&further).and_then(|hierarchy| Adapter::new(hierarchy, &query, coherence));
        shared.lock().found = Some(found);
        drop(walking);
    }
}
