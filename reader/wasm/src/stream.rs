//! A session that follows a camera, and what a frame changes, packed for the GPU.

use std::{collections::BTreeMap, io, sync::Arc, time::Duration};

use lodpack::{
    Index, Query, Result, View,
    decode::Appearance,
    select::{Coherence, Hierarchy},
    stream::{Follower, Frame, Job, Options, Read, Session, Shows},
};

use crate::{
    answer::{Put, wrong},
    pack::{Painter, change_count, put_changes},
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
    /// By numbers of its own: those of a session are larger than what an f64 holds.
    flying: BTreeMap<u32, Read>,
    next_read: u32,
    origin: [f64; 3],
    /// Whether the next frame packs everything, not only what is new.
    is_lost: bool,
    /// Of the picture. Counting takes a while.
    triangle_count: u64,
    /// Of the channel that is shown, if there is one.
    painter: Option<Painter>,
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
        Ok(Self {
            follower,
            session,
            flying: BTreeMap::new(),
            next_read: 0,
            origin,
            is_lost: false,
            triangle_count: 0,
            painter: None,
        })
    }

    /// Shows a channel from now on, by number, or none. The next frame packs everything.
    pub fn show(&mut self, channel: Option<(u8, Appearance)>) -> Result<()> {
        let numbers: Vec<u8> = channel.iter().map(|&(number, _)| number).collect();
        self.session.show_channels(&numbers)?;
        self.painter = channel.map(|(_, appearance)| Painter::new(appearance));
        self.is_lost = true;
        Ok(())
    }

    /// Draws a frame, and packs what is new in it.
    pub fn frame(&mut self, query: &Query, now: Duration, output: &mut Vec<u8>) -> Result<()> {
        let (wanted, expected) = self.follower.follow(query, now)?;
        self.session.look_from(query.view.as_ref())?;
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

    /// Header (f64), and what [`put_changes`] says: `js/frame.js` reads it.
    fn pack(&mut self, frame: &Frame, wanted: [f64; 3], error_px: f64, output: &mut Vec<u8>) {
        let picture = self.session.picture();
        if !(frame.changes.surfaces.is_empty() && frame.changes.strips.is_empty() && frame.changes.removed.is_empty()) {
            self.triangle_count = picture.triangle_count();
        }
        let is_all = std::mem::take(&mut self.is_lost);
        if let Some(painter) = self.painter.as_mut().filter(|_| is_all) {
            painter.lose();
        }
        let shows = match frame.shows {
            Shows::Nothing => 0.0,
            Shows::Overview => 1.0,
            Shows::Picture => 2.0,
        };
        let (counters, texels) = (self.session.counters(), self.session.texel_counters());
        let count = |count: usize| count as f64;
        let changed = change_count(picture, &frame.changes, is_all);
        output.put_floats([shows, f64::from(u8::from(frame.is_complete)), f64::from(frame.late_roots)]);
        output.put_floats([count(frame.lost_roots.len()), count(frame.changes.removed.len()), count(changed)]);
        output.put_floats([self.triangle_count as f64, count(picture.roots().len()), error_px]);
        output.put_floats(wanted);
        let sums = [
            counters.requests + texels.requests,
            counters.bytes_read + texels.bytes_read,
            counters.decoded + texels.decoded,
            counters.failures + texels.failures,
        ];
        output.put_floats(sums.map(|n| n as f64));
        output.put_floats([f64::from(frame.late_textures), self.session.texel_cached_bytes()[1] as f64]);
        let lattice = self.session.index().lattice();
        let surface = (picture, &lattice, self.origin);
        put_changes(output, surface, (&frame.changes, &frame.lost_roots), (self.painter.as_mut(), is_all));
    }

    /// Does the next job: starts a read, or decodes.
    pub fn poll(&mut self, now: Duration, output: &mut Vec<u8>) -> Polled {
        match self.session.poll(now) {
            None => Polled::Idle,
            Some(Job::Read(read)) => {
                let number = self.next_read;
                self.next_read = number.wrapping_add(1);
                output.put_floats([f64::from(number), read.offset as f64, read.length as f64]);
                self.flying.insert(number, read);
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
        if let Some(read) = self.flying.remove(&(id as u32)) {
            self.session.supply(&read, result, now);
        }
    }

    /// Whether anything still wants a read. If not, it may be aborted.
    pub fn is_wanted(&self, id: f64) -> bool {
        self.flying.get(&(id as u32)).is_some_and(|read| self.session.is_wanted(read))
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
