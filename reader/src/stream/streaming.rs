//! The session: one object over wanted cut, loader and picture.

use std::{io, sync::Arc, time::Duration};

use super::{
    Mode, Options,
    antichain::Antichain,
    content::{FileContent, Unit},
    counters::Counters,
    frame::{Drawable, Frame, Shows, WantedCut},
    job::Read,
    loader::{Loader, Problem, Rules, UnitState},
    loading::{Decoded, Job, Loading, Shared, TexelLoader, has_channels},
    picture::{Changes, Picture},
    queue::{Class, Joining},
    texel_content::TexelContent,
    textures::{Textures, Wishes},
};
use crate::{
    decode::{Mesh, overview},
    error::{Error, Result},
    index::Index,
    objects::ObjectFilter,
    select::{Node, Projection, View},
    source::ReadAt,
};

/// How often a frame that waits looks at all that it lacks while some of it may still come. To look for thousands of
/// roots takes milliseconds, in which nobody else gets at the loader.
const LOOK: Duration = Duration::from_millis(50);

/// Draws a file frame by frame while it is being loaded: see the [module](super).
///
/// Times are counted from any moment that the caller chooses, and never go back.
pub struct Session {
    shared: Arc<Shared>,
    content: Arc<FileContent>,
    options: Options,
    picture: Picture,
    overview: Option<Mesh>,
    /// Units of the coarsest cut that are not loaded yet.
    coarsest: Vec<Unit>,
    wanted: WantedCut,
    antichain: Antichain,
    drawable: Drawable,
    begun: Duration,
    /// When the running frame last looked at all that it lacks.
    looked: Duration,
    has_stalled: bool,
    textures: Textures,
    /// What the view shows gets its images first.
    view: Option<Projection>,
    /// The frame that waits for images only.
    waiting: Option<Frame>,
}

impl Session {
    /// Loads the coarsest level at once. The jobs of the first frames retry what fails.
    pub(crate) fn load_coarsest(&self, source: &impl ReadAt) {
        let now = Duration::ZERO;
        let mut loading = self.shared.lock();
        for &unit in &self.coarsest {
            loading.geometry.want(unit, Class::Demand, u8::MAX, now);
        }
        loading.geometry.end_wants();
        drop(loading);
        while let Some(job) = self.poll(now) {
            match job {
                Job::Read(read) => self.supply(&read, read.run(source), now),
                Job::Decode(decoding) => self.finish(decoding.run(), now),
            }
        }
    }

    /// A session for an index. The caller does its jobs.
    ///
    /// # Errors
    /// [`Error::Missing`] until the index blocks of all tops have been supplied ([`Index::supply`]); draw
    /// [`crate::decode::overview`] until then.
    /// [`Error::Format`], [`Error::Limit`].
    pub fn new(index: Arc<Index>, options: Options) -> Result<Self> {
        let content = Arc::new(FileContent::new(index, options.light)?);
        let index = content.index();
        let overview = overview(index)?.map(|overview| overview.mesh(&index.lattice()));
        let rules = rules(&options, [options.byte_cache, options.decoded_cache]);
        Ok(Self {
            shared: Arc::new(Shared::new(Loading::new(Loader::new(content.clone(), rules)))),
            coarsest: content.coarsest().to_vec(),
            content,
            options,
            picture: Picture::default(),
            overview,
            wanted: WantedCut::default(),
            antichain: Antichain::default(),
            drawable: Drawable::default(),
            begun: Duration::ZERO,
            looked: Duration::ZERO,
            has_stalled: false,
            textures: Textures::default(),
            view: None,
            waiting: None,
        })
    }

    /// Draws roots with the images of these channels from the next frame on, by number; none at first. What was shown
    /// before is forgotten.
    ///
    /// # Errors
    /// [`Error::Query`] if a channel does not exist or occurs twice; [`Error::Unsupported`] without the feature
    /// `channels`.
    pub fn show_channels(&mut self, channels: &[u8]) -> Result<()> {
        let content = match channels {
            [] => None,
            _ => {
                let has = has_channels()?;
                Some((TexelContent::new(Arc::clone(self.content.index()), channels)?, has))
            }
        };
        // Streams are decoded once, so few of them are worth keeping.
        let texel_cache = self.options.texel_cache;
        let rules = rules(&self.options, [texel_cache / 8, texel_cache]);
        self.shared.lock().show(content, rules);
        self.textures.restart(&mut self.picture);
        Ok(())
    }

    /// Draws these objects from the next frame on: all of them without a filter, as at first. Triangles of hidden ones
    /// are not in the picture; those of marked ones are told apart ([`super::DrawnRoot::marks`]). Choose the cuts with
    /// the same filter ([`crate::Query::objects`]). Groups that stand in for what is not loaded yet show hidden objects
    /// until it is.
    ///
    /// # Errors
    /// [`Error::Query`] if the filter is one of another file.
    pub fn show_objects(&mut self, filter: Option<Arc<ObjectFilter>>) -> Result<()> {
        filter.as_ref().map_or(Ok(()), |filter| self.index().id().check_filter(filter.file))?;
        self.wanted.show_objects(filter);
        Ok(())
    }

    /// Says what the next frames show: roots that this view shows get their images, the largest ones first, and as fine
    /// as it shows them. Without a view all roots get them whole.
    ///
    /// # Errors
    /// [`Error::Query`] if something in the view is not finite or makes no sense.
    pub fn look_from(&mut self, view: Option<&View>) -> Result<()> {
        self.view = view.map(Projection::new).transpose()?;
        Ok(())
    }

    /// Begins a frame with the cut that it wants, as [`crate::File::select`] returns it, and the cut that later frames
    /// will probably want (see [`super::Motion`]), which only [`Mode::AsynchronousWithPrefetch`] uses. Both are sorted
    /// by root. Roots outside the wanted cut are not drawn, except in place of its own until these are loaded.
    ///
    /// # Errors
    /// [`Error::Query`] if a node does not exist, a root occurs twice, or one root of the wanted cut is above another.
    /// [`Error::Missing`] if the index blocks of wanted roots, or of those above them, are not known: supply them
    /// ([`Index::supply`]). Whoever chose the cut knew them.
    pub fn begin(&mut self, wanted: &[Node], expected: &[Node], now: Duration) -> Result<()> {
        self.check(wanted)?;
        self.check(expected)?;
        if !self.wanted.is(wanted) {
            self.antichain.set(&self.content, wanted)?;
        }
        (self.begun, self.looked) = (now, now);
        self.waiting = None;
        let mut loading = self.shared.lock();
        let loader = &mut loading.geometry;
        loader.begin_frame();
        self.coarsest.retain(|&unit| loader.want(unit, Class::Demand, u8::MAX, now) == UnitState::Coming);
        self.wanted.follow(loader, wanted);
        self.drawable = self.wanted.demand(loader, &self.picture, self.options.may_stay_finer, now);
        loader.counters.hits += self.drawable.hits;
        // The frame waits for anything that is missing here, however briefly.
        self.has_stalled = self.options.mode == Mode::Synchronous && !self.drawable.is_complete;
        if self.options.mode == Mode::AsynchronousWithPrefetch {
            self.wanted.prefetch(loader, expected, now);
        }
        loader.end_wants();
        drop(loading);
        self.shared.changed.notify_all();
        Ok(())
    }

    fn check(&self, nodes: &[Node]) -> Result<()> {
        let missing = nodes.iter().find(|node| node.root >= self.content.root_count());
        if let Some(node) = missing {
            return Err(Error::Query { what: format!("root {} does not exist", node.root) });
        }
        if nodes.windows(2).any(|pair| pair[0].root >= pair[1].root) {
            return Err(Error::Query { what: "the nodes of a cut must be sorted by root, each root once".into() });
        }
        Ok(())
    }

    /// Ends the frame and updates the picture. Returns `None` in [`Mode::Synchronous`] while something is missing: do
    /// jobs and call again.
    pub fn end(&mut self, now: Duration) -> Option<Frame> {
        let waits = self.options.mode == Mode::Synchronous;
        if self.waiting.is_some() {
            let has_coming = self.shared.lock().texels.as_ref().is_some_and(|texels| texels.loader.has_coming());
            if !looks_again(&mut self.looked, has_coming, now) {
                return None;
            }
        }
        let mut frame = match self.waiting.take() {
            Some(frame) => frame,
            None => self.end_geometry(now)?,
        };
        frame.late_textures = self.demand_textures(&mut frame, now);
        if frame.late_textures > 0 && waits {
            self.has_stalled = true;
            self.waiting = Some(frame);
            return None;
        }
        frame.is_complete = frame.is_complete && frame.late_textures == 0;
        if std::mem::take(&mut self.has_stalled) {
            let counters = &mut self.shared.lock().geometry.counters;
            counters.stalls += 1;
            counters.stall_time += now.saturating_sub(self.begun);
        }
        Some(frame)
    }

    /// Gives the picture the images that are there. Returns how many roots lack those that they need.
    fn demand_textures(&mut self, frame: &mut Frame, now: Duration) -> u32 {
        let mut loading = self.shared.lock();
        let Some(loader) = loading.texels.as_mut().filter(|_| frame.shows == Shows::Picture) else { return 0 };
        let Options { texels_per_pixel, texel_cache, .. } = self.options;
        // Room for images that come while others are still drawn.
        let budget = texel_cache - texel_cache / 8;
        let wishes = Wishes { view: self.view.as_ref(), texels_per_pixel, budget };
        let late = self.textures.demand(&mut loader.loader, (&mut self.picture, &mut frame.changes), &wishes, now);
        drop(loading);
        if late > 0 {
            self.shared.changed.notify_all();
        }
        late
    }

    /// Updates the picture. None while a frame waits for geometry.
    fn end_geometry(&mut self, now: Duration) -> Option<Frame> {
        let mut loading = self.shared.lock();
        let loader = &mut loading.geometry;
        if self.options.mode == Mode::Synchronous && !self.drawable.is_complete {
            if !looks_again(&mut self.looked, loader.has_coming(), now) {
                return None;
            }
            self.drawable = self.wanted.demand(loader, &self.picture, self.options.may_stay_finer, now);
            if !self.drawable.is_complete {
                return None;
            }
        }
        let Drawable { is_complete, late_roots, lost_roots, lacks_roots, .. } = std::mem::take(&mut self.drawable);
        let shows = match (lacks_roots, &self.overview) {
            (false, _) => Shows::Picture,
            (true, Some(_)) => Shows::Overview,
            (true, None) => Shows::Nothing,
        };
        let mut changes = Changes::default();
        let waits = self.options.mode == Mode::Synchronous;
        let upload_bytes = if waits { u64::MAX } else { self.options.upload_bytes };
        if shows == Shows::Picture
            && let Some(difference) = self.wanted.take_changed(&self.content, &self.picture, upload_bytes)
        {
            changes = self.picture.update(difference);
        }
        let is_complete = is_complete && self.wanted.wait_count == 0;
        let counters = &mut loader.counters;
        counters.late_roots += u64::from(late_roots);
        let strips_of = |root: &u32| self.picture.root(*root).map_or(0, |root| root.strips.len() as u64);
        counters.borders_rebuilt += changes.strips.len() as u64 + changes.surfaces.iter().map(strips_of).sum::<u64>();
        counters.borders_drawn += self.picture.strip_count();
        if let Some(texels) = &mut loading.texels {
            self.textures.follow(&mut texels.loader, &self.content, &mut self.picture, &changes);
        }
        Some(Frame { shows, is_complete, changes, late_roots, lost_roots, late_textures: 0 })
    }

    /// The next job, if one can be done now. Call it until it returns `None`, after the beginning of each frame and
    /// after each result.
    pub fn poll(&self, now: Duration) -> Option<Job> {
        self.shared.lock().poll(now, true)
    }

    /// When the next failed read is to be retried. [`Session::poll`] returns it from then on.
    pub fn next_due(&self) -> Option<Duration> {
        self.shared.lock().next_due()
    }

    /// Whether the running frame still wants any page of a read. If not, the read may be aborted with any error.
    pub fn is_wanted(&self, read: &Read) -> bool {
        self.shared.lock().is_wanted(read.id)
    }

    /// Takes the result of a read.
    pub fn supply(&self, read: &Read, result: io::Result<Vec<u8>>, now: Duration) {
        self.shared.supply(read.id, result, now);
    }

    /// Takes the result of decoding.
    pub fn finish(&self, decoded: Decoded, now: Duration) {
        self.shared.finish(decoded, now);
    }

    /// The picture to draw while frames show it.
    pub fn picture(&self) -> &Picture {
        &self.picture
    }

    /// The overview to draw while frames show it.
    pub fn overview(&self) -> Option<&Mesh> {
        self.overview.as_ref()
    }

    /// The file's index.
    pub fn index(&self) -> &Arc<Index> {
        self.content.index()
    }

    /// Counters of its work so far.
    pub fn counters(&self) -> Counters {
        self.shared.lock().geometry.counters
    }

    /// The same of texels, since the channels that are shown have been chosen.
    pub fn texel_counters(&self) -> Counters {
        self.shared.lock().texels.as_ref().map(|texels| texels.loader.counters).unwrap_or_default()
    }

    /// Bytes in the caches of texel streams and of images.
    pub fn texel_cached_bytes(&self) -> [u64; 2] {
        let loading = self.shared.lock();
        let bytes =
            |TexelLoader { loader, .. }: &TexelLoader| [loader.byte_cache().bytes(), loader.decoded_cache().bytes()];
        loading.texels.as_ref().map_or([0; 2], bytes)
    }

    /// Bytes in the caches of pages and of decoded surfaces.
    pub fn cached_bytes(&self) -> [u64; 2] {
        let loader = &self.shared.lock().geometry;
        [loader.byte_cache().bytes(), loader.decoded_cache().bytes()]
    }

    /// The part of [`Session::cached_bytes`] that the running frame uses or that is never evicted.
    pub fn held_bytes(&self) -> [u64; 2] {
        let loader = &self.shared.lock().geometry;
        [loader.byte_cache().held_bytes(), loader.decoded_cache().held_bytes()]
    }

    /// Everything that has been given up since the last call.
    pub fn take_problems(&self) -> Vec<Problem> {
        self.shared.lock().take_problems()
    }

    /// Counts something else that has been given up.
    #[cfg(feature = "threads")]
    pub(crate) fn report(&self, location: String, error: Error) {
        self.shared.lock().geometry.report(location, error);
    }

    /// Forgets all failures, so the next frames try again.
    pub fn retry_failed(&mut self) {
        self.shared.lock().retry_failed();
        self.coarsest = self.content.coarsest().to_vec();
        self.wanted.doubt();
        self.textures.doubt();
    }

    /// How many roots the next frame will look at even if it wants the same.
    #[cfg(test)]
    pub(crate) fn open_count(&self) -> usize {
        self.wanted.open_count()
    }

    #[cfg(feature = "threads")]
    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

/// Whether a frame that waits looks again at what it lacks.
fn looks_again(looked: &mut Duration, has_coming: bool, now: Duration) -> bool {
    let looks = !has_coming || now.saturating_sub(*looked) >= LOOK;
    *looked = if looks { now } else { *looked };
    looks
}

/// How a loader behaves whose caches have these bounds.
pub(super) fn rules(options: &Options, [byte_cache, decoded_cache]: [u64; 2]) -> Rules {
    Rules {
        byte_cache,
        decoded_cache,
        max_reads: options.max_reads.max(1),
        joining: Joining { max_gap: options.max_gap, max_length: options.max_read_bytes },
        prefetch_bytes: options.prefetch_bytes,
        max_attempts: options.max_attempts.max(1),
        retry_delay: options.retry_delay,
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.end();
    }
}
