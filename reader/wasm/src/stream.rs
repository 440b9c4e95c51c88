//! A session that follows a camera, and what a frame changes, packed for the GPU.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    sync::Arc,
    time::Duration,
};

use lodpack::{
    Index, Query, Result, View,
    select::{Coherence, Hierarchy},
    stream::{DrawnRoot, Follower, Frame, Job, Options, Read, Session, Shows},
};

use crate::{
    answer::{Put, put_all, put_triangles, wrong},
    state::limiter,
};

/// The result of [`Stream::poll`].
pub enum Polled {
    /// There is nothing to do now.
    Idle,
    /// The output holds a read: its number, offset and length (f64).
    Read,
    /// Something was decoded.
    Decoded,
}

/// A session, its follower, and its reads in flight.
pub struct Stream {
    follower: Follower,
    session: Session,
    flying: BTreeMap<u64, Read>,
    origin: [f64; 3],
    /// Whether the next frame packs everything, not only what is new.
    is_lost: bool,
    /// Of the picture. Counting takes a while.
    triangle_count: u64,
}

/// Milliseconds since any moment. What is no time counts as that moment.
pub fn time(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms / 1000.0).unwrap_or_default()
}

impl Stream {
    pub fn new(index: &Arc<Index>, options: Options, ahead_ms: f64, origin: [f64; 3]) -> Result<Self> {
        if !origin.iter().all(|x| x.is_finite()) {
            return Err(wrong("the origin must be finite"));
        }
        let session = Session::new(Arc::clone(index), options)?;
        let hierarchy = Arc::new(Hierarchy::from_index(index)?);
        let follower = Follower::new(hierarchy, Coherence::default(), time(ahead_ms));
        Ok(Self { follower, session, flying: BTreeMap::new(), origin, is_lost: false, triangle_count: 0 })
    }

    /// Draws a frame, and packs what is new in it.
    pub fn frame(&mut self, query: &Query, now: Duration, output: &mut Vec<u8>) -> Result<()> {
        let (wanted, expected) = self.follower.follow(query, now)?;
        self.session.begin(&wanted.nodes, &expected, now)?;
        // It never waits, so it ends at once.
        let Some(frame) = self.session.end(now) else { return Err(wrong("a stream must not wait")) };
        let is_as_wanted = frame.shows == Shows::Picture && frame.is_complete && self.session.counters().failures == 0;
        let error_px = match query.view {
            // The cut knows. Asking every root takes a third of a frame.
            Some(_) if is_as_wanted => wanted.pixel_error,
            Some(view) => self.drawn_error_px(&view)?,
            None => 0.0,
        };
        let exceeded = wanted.exceeded.map_or(0, limiter);
        let wanted = [f64::from(limiter(wanted.limited_by)), f64::from(exceeded), wanted.nodes.len() as f64];
        self.pack(&frame, wanted, error_px, output);
        Ok(())
    }

    /// The largest error on the screen of what is drawn.
    fn drawn_error_px(&self, view: &View) -> Result<f64> {
        let index = self.session.index();
        self.session.picture().roots().try_fold(0.0, |most: f64, drawn| {
            Ok(view.error_px(index.root_bounds(drawn.surface.root)?, drawn.error())?.max(most))
        })
    }

    /// Makes the next frame pack everything that is drawn, for a GPU that has lost it.
    pub fn lose(&mut self) {
        self.is_lost = true;
    }

    /// Header (f64), the error of each changed root (f64), lost roots, removed roots, four words for each changed root, and then
    /// for each its positions (f32) and triangles: `js/frame.js` reads it.
    fn pack(&mut self, frame: &Frame, wanted: [f64; 3], error_px: f64, output: &mut Vec<u8>) {
        let picture = self.session.picture();
        if !(frame.changes.surfaces.is_empty() && frame.changes.strips.is_empty() && frame.changes.removed.is_empty()) {
            self.triangle_count = picture.triangle_count();
        }
        let is_all = std::mem::take(&mut self.is_lost);
        let changed: BTreeSet<u32> = if is_all {
            picture.roots().map(|drawn| drawn.surface.root).collect()
        } else {
            let strips = frame.changes.strips.iter().map(|&(root, _)| root);
            frame.changes.surfaces.iter().copied().chain(strips).collect()
        };
        let changed: Vec<&DrawnRoot> = changed.into_iter().filter_map(|root| picture.root(root)).collect();
        let shows = match frame.shows {
            Shows::Nothing => 0.0,
            Shows::Overview => 1.0,
            Shows::Picture => 2.0,
        };
        let counters = self.session.counters();
        let count = |count: usize| count as f64;
        output.put_floats([shows, f64::from(u8::from(frame.is_complete)), f64::from(frame.late_roots)]);
        output.put_floats([count(frame.lost_roots.len()), count(frame.changes.removed.len()), count(changed.len())]);
        output.put_floats([self.triangle_count as f64, count(picture.roots().len()), error_px]);
        output.put_floats(wanted);
        output.put_floats(
            [counters.requests, counters.bytes_read, counters.decoded, counters.failures].map(|n| n as f64),
        );
        output.put_floats(changed.iter().map(|drawn| drawn.error()));
        output.put_words(frame.lost_roots.iter().chain(&frame.changes.removed).copied());
        let sizes = |drawn: &&DrawnRoot| {
            let vertices =
                drawn.surface.positions.len() + drawn.strips.iter().map(|s| s.positions.len()).sum::<usize>();
            [drawn.surface.root, u32::from(drawn.surface.level), vertices as u32, drawn.triangle_count() as u32]
        };
        output.put_words(changed.iter().flat_map(sizes));
        // Both roots at a border have the same world positions there, so they also have the same ones here: no crack can open.
        let place = |position: [f64; 3]| [0, 1, 2].map(|k| (position[k] - self.origin[k]) as f32);
        for drawn in changed {
            let (positions, triangles) = drawn.joined();
            put_all(output, &positions, |bytes: &mut [u8; 12], &position| {
                let (coordinates, _) = bytes.as_chunks_mut::<4>();
                coordinates.iter_mut().zip(place(position)).for_each(|(bytes, x)| *bytes = x.to_le_bytes());
            });
            put_triangles(output, &triangles);
        }
    }

    /// Does the next job: starts a read, or decodes.
    pub fn poll(&mut self, now: Duration, output: &mut Vec<u8>) -> Polled {
        match self.session.poll(now) {
            None => Polled::Idle,
            Some(Job::Read(read)) => {
                output.put_floats([read.id as f64, read.offset as f64, read.length as f64]);
                self.flying.insert(read.id, read);
                Polled::Read
            }
            Some(Job::Decode(decoding)) => {
                self.session.finish(decoding.run(), now);
                Polled::Decoded
            }
        }
    }

    /// Takes the bytes of a read, or why there are none.
    pub fn supply(&mut self, id: f64, result: io::Result<Vec<u8>>, now: Duration) {
        if let Some(read) = self.flying.remove(&(id as u64)) {
            self.session.supply(&read, result, now);
        }
    }

    /// Whether anything still wants a read. If not, it may be aborted.
    pub fn is_wanted(&self, id: f64) -> bool {
        self.flying.get(&(id as u64)).is_some_and(|read| self.session.is_wanted(read))
    }

    /// When the next failed read is to be retried, milliseconds.
    pub fn next_due(&self) -> Option<f64> {
        self.session.next_due().map(|due| due.as_secs_f64() * 1000.0)
    }

    /// What was given up since the last call: a line for each.
    pub fn problems(&self) -> String {
        let lines =
            self.session.take_problems().into_iter().map(|problem| problem.error.to_string().replace('\n', " "));
        lines.collect::<Vec<_>>().join("\n")
    }

    /// Tries again what was given up.
    pub fn retry(&mut self) {
        self.session.retry_failed();
    }
}
