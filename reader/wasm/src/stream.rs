//! A session that follows a camera, and what a frame changes, packed for the GPU.

use std::{io, sync::Arc, time::Duration};

use lodpack::{
    Index, Lattice, Query, Result,
    heights::HeightsIndex,
    objects::ObjectFilter,
    select::{Coherence, Hierarchy},
    stream::{Expecter, Follower, Frame, HeightsSession, Job, Options, Read, Session, Shows},
};

use crate::{
    answer::{Put, wrong},
    dress::Dresser,
    pack::{Painter, change_count, put_changes},
    state::HasHeights,
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

/// A session, and what it follows a camera with.
enum Following {
    Mesh(Box<(Follower, Session)>),
    Heights(Box<(Expecter, HeightsSession)>, HasHeights),
}

/// What a frame wants: why it is not finer, the budget that it exceeds, and how many roots and triangles it has.
type WantedNumbers = [f64; 4];

/// A session, and its reads in flight.
pub struct Stream {
    following: Following,
    /// By numbers of its own: those of a session are larger than what an f64 holds.
    flying: Vec<(u32, Read)>,
    next_read: u32,
    origin: [f64; 3],
    /// Whether the next frame packs everything, not only what is new.
    is_lost: bool,
    /// Of the picture. Counting takes a while.
    triangle_count: u64,
    /// Of the channel that is shown, if there is one.
    painter: Option<Painter>,
    /// Of tiles of heights.
    dresser: Dresser,
    /// Which objects are drawn.
    objects: Option<Arc<ObjectFilter>>,
}

/// Milliseconds since any moment. What is no time counts as that moment.
pub fn time(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms / 1000.0).unwrap_or_default()
}

impl Stream {
    pub fn new(index: &Arc<Index>, options: Options, ahead_ms: f64, origin: [f64; 3]) -> Result<Self> {
        let session = Session::new(Arc::clone(index), options)?;
        let hierarchy = Arc::new(Hierarchy::from_index(index)?);
        let follower = Follower::new(hierarchy, Coherence::default(), time(ahead_ms));
        Self::of(Following::Mesh(Box::new((follower, session))), origin)
    }

    /// The same for heights.
    pub fn of_heights(
        (index, has): (&Arc<HeightsIndex>, HasHeights),
        options: Options,
        ahead_ms: f64,
        origin: [f64; 3],
    ) -> Result<Self> {
        let session = HeightsSession::new(Arc::clone(index), options)?;
        Self::of(Following::Heights(Box::new((Expecter::new(time(ahead_ms)), session)), has), origin)
    }

    fn of(following: Following, origin: [f64; 3]) -> Result<Self> {
        if !origin.iter().all(|x| x.is_finite()) {
            return Err(wrong("the origin must be finite"));
        }
        Ok(Self {
            following,
            flying: Vec::new(),
            next_read: 0,
            origin,
            is_lost: false,
            triangle_count: 0,
            painter: None,
            dresser: Dresser::default(),
            objects: None,
        })
    }

    /// Shows the first of some channels from now on, by number, or none. The next frame packs everything.
    pub fn show(&mut self, channels: Option<(Vec<u8>, Painter)>) -> Result<()> {
        let (numbers, painter) = channels.unzip();
        if let Following::Mesh(mesh) = &mut self.following {
            mesh.1.show_channels(numbers.as_deref().unwrap_or_default())?;
        }
        self.painter = painter;
        self.is_lost = true;
        Ok(())
    }

    /// Shows the colours of heights from now on, or does not. The next frame packs everything.
    pub fn show_colours(&mut self, shows_colours: bool) {
        self.dresser.shows_colours = shows_colours;
        self.is_lost = true;
    }

    /// Draws these objects from the next frame on.
    #[cfg(feature = "channels")]
    pub fn show_objects(&mut self, filter: Option<Arc<ObjectFilter>>) {
        self.objects = filter;
    }

    /// Draws a frame, and packs what is new in it.
    pub fn frame(&mut self, mut query: Query, now: Duration, output: &mut Vec<u8>) -> Result<()> {
        // It never waits, so it ends at once.
        let waits = || wrong("a stream must not wait");
        let (frame, wanted, error_px) = match &mut self.following {
            Following::Mesh(mesh) => {
                let (follower, session) = &mut **mesh;
                query.objects = self.objects.clone();
                let (wanted, expected) = follower.follow(&query, now)?;
                session.show_objects(query.objects)?;
                session.look_from(query.view.as_ref())?;
                session.begin(&wanted.nodes, &expected, now)?;
                let frame = session.end(now).ok_or_else(waits)?;
                let is_as_wanted =
                    frame.shows == Shows::Picture && frame.is_complete && session.counters().failures == 0;
                let error_px = match query.view {
                    // The cut knows. Asking every root takes a third of a frame.
                    Some(_) if is_as_wanted => wanted.pixel_error,
                    Some(view) => session.picture().error_px(&view)?,
                    None => 0.0,
                };
                let exceeded = wanted.exceeded.map_or(0, limiter);
                let [nodes, triangles] = [wanted.nodes.len() as f64, wanted.triangle_count as f64];
                (frame, [f64::from(limiter(wanted.limited_by)), f64::from(exceeded), nodes, triangles], error_px)
            }
            Following::Heights(heights, _) => {
                let (expecter, session) = &mut **heights;
                let expected = expecter.expect(&query, now);
                session.begin(&query, expected.as_ref(), now)?;
                let frame = session.end(now).ok_or_else(waits)?;
                let exceeded = session.exceeded().map_or(0, limiter);
                let [nodes, triangles] = [session.wanted_count(), session.wanted_triangle_count()].map(|n| n as f64);
                let wanted = [f64::from(limiter(session.limiter())), f64::from(exceeded), nodes, triangles];
                (frame, wanted, session.frame_error_px())
            }
        };
        self.pack(&frame, wanted, error_px, output);
        Ok(())
    }

    /// Makes the next frame pack everything that is drawn, for a GPU that has lost it.
    pub fn lose(&mut self) {
        self.is_lost = true;
    }

    /// Header (f64), and what [`put_changes`] says: `js/frame.js` reads it.
    fn pack(&mut self, frame: &Frame, wanted: WantedNumbers, error_px: f64, output: &mut Vec<u8>) {
        let (picture, counters, (texels, image_bytes), lattice) = match &self.following {
            Following::Mesh(mesh) => {
                let session = &mesh.1;
                let texels = (session.texel_counters(), session.texel_cached_bytes()[1]);
                (session.picture(), session.counters(), texels, session.index().lattice())
            }
            Following::Heights(heights, _) => {
                (heights.1.picture(), heights.1.counters(), Default::default(), Lattice::default())
            }
        };
        if !(frame.changes.surfaces.is_empty() && frame.changes.strips.is_empty() && frame.changes.removed.is_empty()) {
            self.triangle_count = picture.triangle_count();
        }
        let is_all = std::mem::take(&mut self.is_lost);
        if let Some(painter) = self.painter.as_mut().filter(|_| is_all) {
            painter.lose();
        }
        if is_all {
            self.dresser.lose();
        }
        let shows = match frame.shows {
            Shows::Nothing => 0.0,
            Shows::Overview => 1.0,
            Shows::Picture => 2.0,
        };
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
        output.put_floats([f64::from(frame.late_textures), image_bytes as f64]);
        let surface = (picture, &lattice, self.origin);
        put_changes(
            output,
            surface,
            (&frame.changes, &frame.lost_roots),
            (self.painter.as_mut(), &mut self.dresser, is_all),
        );
    }

    /// Does the next job: starts a read, or decodes.
    pub fn poll(&mut self, now: Duration, output: &mut Vec<u8>) -> Polled {
        let job = match &self.following {
            Following::Mesh(mesh) => mesh.1.poll(now),
            Following::Heights(heights, _) => heights.1.poll(now),
        };
        match job {
            None => Polled::Idle,
            Some(Job::Read(read)) => {
                let number = self.next_read;
                self.next_read = number.wrapping_add(1);
                output.put_floats([f64::from(number), read.offset as f64, read.length as f64]);
                self.flying.push((number, read));
                Polled::Read
            }
            Some(Job::Decode(decoding)) => {
                let decoded = decoding.run();
                match &self.following {
                    Following::Mesh(mesh) => mesh.1.finish(decoded, now),
                    Following::Heights(heights, _) => heights.1.finish(decoded, now),
                }
                Polled::Decoded
            }
        }
    }

    /// Takes the bytes of a read, or why there are none.
    pub fn supply(&mut self, id: f64, result: io::Result<Vec<u8>>, now: Duration) {
        let Some(at) = self.flying.iter().position(|(number, _)| *number == id as u32) else { return };
        let (_, read) = self.flying.swap_remove(at);
        match &self.following {
            Following::Mesh(mesh) => mesh.1.supply(&read, result, now),
            Following::Heights(heights, _) => heights.1.supply(&read, result, now),
        }
    }

    /// Whether anything still wants a read. If not, it may be aborted.
    pub fn is_wanted(&self, id: f64) -> bool {
        self.flying.iter().find(|(number, _)| *number == id as u32).is_some_and(|(_, read)| match &self.following {
            Following::Mesh(mesh) => mesh.1.is_wanted(read),
            Following::Heights(heights, _) => heights.1.is_wanted(read),
        })
    }

    /// When the next failed read is to be retried, milliseconds.
    pub fn next_due(&self) -> Option<f64> {
        let due = match &self.following {
            Following::Mesh(mesh) => mesh.1.next_due(),
            Following::Heights(heights, _) => heights.1.next_due(),
        };
        due.map(|due| due.as_secs_f64() * 1000.0)
    }

    /// What was given up since the last call: a line for each.
    pub fn problems(&self) -> String {
        let problems = match &self.following {
            Following::Mesh(mesh) => mesh.1.take_problems(),
            Following::Heights(heights, _) => heights.1.take_problems(),
        };
        let lines = problems.into_iter().map(|problem| problem.error.to_string().replace('\n', " "));
        lines.collect::<Vec<_>>().join("\n")
    }

    /// Tries again what was given up.
    pub fn retry(&mut self) {
        match &mut self.following {
            Following::Mesh(mesh) => mesh.1.retry_failed(),
            Following::Heights(heights, _) => heights.1.retry_failed(),
        }
    }
}
