//! The session of a file of heights.

use std::{collections::HashSet, io, sync::Arc, time::Duration};

use super::{
    content::HeightsContent,
    seams::{Seams, ToDraw},
    wanted::{Chooser, Sight, WantedTiles},
};
use crate::{
    error::Result,
    heights::{CutTile, HeightsCut, HeightsIndex, TileId},
    select::{Limiter, Query, View},
    stream::{
        Changes, Counters, Decoded, Frame, Job, Mode, Options, Picture, Problem, Read, Shows,
        loader::{Loader, UnitState},
        loading::{Loading, Shared},
        queue::Class,
        streaming::rules,
    },
};

/// Draws a file of heights frame by frame while it is being loaded. It asks for reads and decoding as
/// [`super::super::Session`] does.
///
/// Times are counted from any moment that the caller chooses, and never go back.
pub struct HeightsSession {
    shared: Arc<Shared<HeightsContent>>,
    content: Arc<HeightsContent>,
    options: Options,
    picture: Picture,
    chooser: Chooser,
    seams: Seams,
    /// What the running frame asks for.
    query: Option<(Query, Sight)>,
    wanted: WantedTiles,
    begun: Duration,
    has_stalled: bool,
    error_px: f64,
}

/// The most texels of an image for each sample of a tile that has finer ones below, along each direction.
const MOST_TEXELS: f64 = 4.0;

/// What a frame can draw.
#[derive(Default)]
struct Drawable {
    tiles: Vec<(TileId, usize)>,
    /// Tiles that are wanted and not there.
    late: u32,
    /// Weighted.
    error: f64,
}

impl HeightsSession {
    /// A session for an index. The caller does its jobs.
    ///
    /// # Errors
    /// [`crate::Error::Format`] or [`crate::Error::Limit`] if the tiles at depth 0 are damaged.
    pub fn new(index: Arc<HeightsIndex>, options: Options) -> Result<Self> {
        // A sample is at most so many pixels large, where there are finer ones.
        let most_texels = (options.sample_px * options.texels_per_pixel).ceil().clamp(1.0, MOST_TEXELS) as u32;
        let content = Arc::new(HeightsContent::new(index, most_texels));
        let rules = rules(&options, [options.byte_cache, options.decoded_cache]);
        let this = Self {
            shared: Arc::new(Shared::new(Loading::new(Loader::new(content.clone(), rules)))),
            chooser: Chooser::new(content.index(), &options),
            content,
            options,
            picture: Picture::default(),
            seams: Seams::default(),
            query: None,
            wanted: WantedTiles::default(),
            begun: Duration::ZERO,
            has_stalled: false,
            error_px: 0.0,
        };
        this.load_roots()?;
        Ok(this)
    }

    /// Decodes the tiles at depth 0, whose blocks came with opening. Under an image they come as all others do: its
    /// texels have to be read.
    fn load_roots(&self) -> Result<()> {
        if self.index().drape().is_some() {
            return Ok(());
        }
        let mut loading = self.shared.lock();
        for &root in self.index().roots() {
            loading.geometry.want(root, Class::Demand, u8::MAX, Duration::ZERO);
        }
        loading.geometry.end_wants();
        while let Some(Job::Decode(decoding)) = loading.poll(Duration::ZERO, false) {
            loading.finish(decoding.run(), Duration::ZERO);
        }
        loading.take_problems().pop().map_or(Ok(()), |problem| Err(problem.error))
    }

    /// Begins a frame: `wanted` says what it shows, and `expected` what later ones will probably show, which only
    /// [`Mode::AsynchronousWithPrefetch`] uses. A query's volume, view, tolerance and budgets of triangles and nodes
    /// count. What is outside is never drawn.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in a query is not finite or makes no sense, or if it has a budget of bytes.
    pub fn begin(&mut self, wanted: &Query, expected: Option<&Query>, now: Duration) -> Result<()> {
        let sight = Sight::new(wanted)?;
        let expected = expected.map(|query| Sight::new(query).map(|sight| (query.clone(), sight))).transpose()?;
        self.query = Some((wanted.clone(), sight));
        self.begun = now;
        self.shared.lock().geometry.begin_frame();
        self.demand(Class::Demand, now);
        if let Some((query, sight)) = expected.filter(|_| self.options.mode == Mode::AsynchronousWithPrefetch) {
            let later = self.chooser.choose(self.content.index(), &query, &sight);
            self.want(&later, Class::Prefetch, now);
        }
        self.shared.lock().geometry.end_wants();
        self.has_stalled = self.options.mode == Mode::Synchronous && self.is_late();
        self.shared.changed.notify_all();
        Ok(())
    }

    /// Chooses what the running frame wants, from what is known by now, and asks for it.
    fn demand(&mut self, class: Class, now: Duration) {
        let Some((query, sight)) = &self.query else { return };
        self.wanted = self.chooser.choose(self.content.index(), query, sight);
        self.want(&self.wanted, class, now);
    }

    fn want(&self, wanted: &WantedTiles, class: Class, now: Duration) {
        let pages: Vec<_> = wanted.pages.iter().map(|&(page, _)| page).collect();
        self.content.want_pages(&pages);
        let mut loading = self.shared.lock();
        let loader = &mut loading.geometry;
        for (page, urgency) in &wanted.pages {
            loader.want(page.top, class, urgency_of(*urgency), now);
        }
        // What has been given up takes all below it along. Those above come first.
        let mut lost = HashSet::new();
        for (&id, tile) in &wanted.tiles {
            let is_lost = id.parent().is_some_and(|parent| lost.contains(&parent));
            if is_lost || loader.want(id, class, urgency_of(tile.urgency), now) == UnitState::Failed {
                lost.insert(id);
            }
        }
    }

    /// What is there of what is wanted.
    fn drawable(&self) -> Drawable {
        let mut drawable = Drawable::default();
        let loading = self.shared.lock();
        let state = |id: TileId| loading.geometry.state(id);
        let mut waiting: Vec<TileId> = self.index().roots().iter().rev().copied().collect();
        while let Some(id) = waiting.pop() {
            let Some(tile) = self.wanted.tiles.get(&id).filter(|tile| tile.factor > 0.0) else { continue };
            let mut resolution = tile.resolution;
            if tile.is_divided {
                // Those that are not shown come later.
                let is_shown = |id: &TileId| self.wanted.tiles.get(id).is_some_and(|tile| tile.factor > 0.0);
                let shown = || tile.record.child_tiles().filter(is_shown);
                let states = || shown().map(state);
                if states().all(|state| state == UnitState::Decoded) {
                    waiting.extend(shown());
                    continue;
                }
                drawable.late += u32::from(states().all(|state| state != UnitState::Failed));
                resolution = tile.record.resolutions.len().saturating_sub(1);
            }
            // Only one at depth 0 may not be there: what is below another is drawn when all of it is.
            let state = state(id);
            if state != UnitState::Decoded {
                drawable.late += u32::from(state == UnitState::Coming);
                continue;
            }
            let error = tile.record.resolutions.get(resolution).map_or(0.0, |resolution| resolution.error);
            drawable.error = drawable.error.max(tile.factor * error);
            drawable.tiles.push((id, resolution));
        }
        drop(loading);
        drawable.late += self.late_pages();
        drawable
    }

    /// Index pages that may still come.
    fn late_pages(&self) -> u32 {
        let loading = self.shared.lock();
        let is_coming = |id: TileId| loading.geometry.state(id) == UnitState::Coming;
        self.wanted.pages.iter().filter(|(page, _)| is_coming(page.top)).count() as u32
    }

    fn is_late(&self) -> bool {
        self.drawable().late > 0
    }

    /// Ends the frame and updates the picture. Returns `None` in [`Mode::Synchronous`] while something is missing: do
    /// jobs and call again.
    pub fn end(&mut self, now: Duration) -> Option<Frame> {
        let waits = self.options.mode == Mode::Synchronous;
        let mut drawable = self.drawable();
        if waits {
            // What has come may tell of more.
            self.demand(Class::Demand, now);
            self.shared.changed.notify_all();
            drawable = self.drawable();
            if drawable.late > 0 {
                return None;
            }
        }
        let mut loading = self.shared.lock();
        let wanted = &self.wanted;
        let tiles: Vec<ToDraw<'_>> = drawable
            .tiles
            .iter()
            .filter_map(|&(id, resolution)| {
                let record = &wanted.tiles.get(&id)?.record;
                Some(ToDraw { record, resolution, data: loading.geometry.take(id)? })
            })
            .collect();
        let counters = &mut loading.geometry.counters;
        counters.late_roots += u64::from(drawable.late);
        counters.hits += tiles.len() as u64;
        if std::mem::take(&mut self.has_stalled) {
            counters.stalls += 1;
            counters.stall_time += now.saturating_sub(self.begun);
        }
        drop(loading);
        let peek = |id: TileId| self.shared.lock().geometry.peek(id);
        let changes = self.seams.update((self.content.index(), &peek), &tiles, &mut self.picture);
        self.count_borders(&changes);
        self.error_px =
            if self.query.as_ref().is_some_and(|(query, _)| query.view.is_some()) { drawable.error } else { 0.0 };
        let (is_complete, late_roots) = (drawable.late == 0, drawable.late);
        let shows = Shows::Picture;
        Some(Frame { shows, is_complete, changes, late_roots, lost_roots: Vec::new(), late_textures: 0 })
    }

    fn count_borders(&self, changes: &Changes) {
        let counters = &mut self.shared.lock().geometry.counters;
        counters.borders_rebuilt += (changes.strips.len() + changes.surfaces.len()) as u64;
        counters.borders_drawn += self.picture.roots().len() as u64;
    }

    /// The next job, if one can be done now: as [`super::super::Session::poll`].
    pub fn poll(&self, now: Duration) -> Option<Job> {
        self.shared.lock().poll(now, false)
    }

    /// When the next failed read is to be retried. [`HeightsSession::poll`] returns it from then on.
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

    /// The picture to draw. Its roots are tiles: their numbers stay the same while they are drawn, and their levels are
    /// depths.
    pub fn picture(&self) -> &Picture {
        &self.picture
    }

    /// The tile that a root of the picture is.
    pub fn tile(&self, root: u32) -> Option<TileId> {
        self.seams.tile(root)
    }

    /// The tiles that are drawn as a cut: its mesh ([`crate::heights::Heights::mesh`]) has the same triangles as the
    /// picture.
    pub fn cut(&self) -> HeightsCut {
        let grid = self.index().grid();
        let record = |id: TileId| self.wanted.tiles.get(&id).map(|tile| &tile.record);
        let resolution = |id: TileId, number: usize| record(id)?.resolutions.get(number).copied();
        let tiles =
            self.seams.tiles().filter_map(|(id, number)| Some(CutTile { id, resolution: resolution(id, number)? }));
        let mut tiles: Vec<CutTile> = tiles.collect();
        tiles.sort_unstable_by_key(|tile| tile.id.along_z(grid.depth()));
        let error = tiles.iter().fold(0.0, |most: f64, tile| most.max(tile.resolution.error));
        let triangle_count = tiles.iter().map(|tile| u64::from(tile.resolution.triangle_count)).sum();
        HeightsCut { tiles, error, triangle_count, limiter: self.wanted.limiter, file: Some(self.index().id()) }
    }

    /// Why the tiles that the running frame wants are not finer.
    pub fn limiter(&self) -> Limiter {
        self.wanted.limiter
    }

    /// The budget that even the coarsest tiles of the running frame exceed.
    pub fn exceeded(&self) -> Option<Limiter> {
        self.wanted.exceeded
    }

    /// How many triangles the running frame wants.
    pub fn wanted_triangle_count(&self) -> u64 {
        self.wanted.triangle_count
    }

    /// How many tiles the running frame wants.
    pub fn wanted_count(&self) -> u64 {
        self.wanted.tile_count
    }

    /// The largest error of the picture in the view of the last frame, pixels; 0 without a view.
    pub fn frame_error_px(&self) -> f64 {
        self.error_px
    }

    /// The largest error of the picture in a view, pixels.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the view is not finite or makes no sense.
    pub fn error_px(&mut self, view: &View) -> Result<f64> {
        let sight = Sight::new(&Query { view: Some(*view), ..Query::default() })?;
        let mut most = 0.0_f64;
        for (id, number) in self.seams.tiles() {
            let Some(tile) = self.wanted.tiles.get(&id) else { continue };
            let factor = self.chooser.factor(self.content.index(), &tile.record, &sight);
            most = most.max(factor * tile.record.resolutions.get(number).map_or(0.0, |resolution| resolution.error));
        }
        Ok(most)
    }

    /// The file's index.
    pub fn index(&self) -> &Arc<HeightsIndex> {
        self.content.index()
    }

    /// Counters of its work so far.
    pub fn counters(&self) -> Counters {
        self.shared.lock().geometry.counters
    }

    /// Bytes in the caches of blocks and of decoded tiles.
    pub fn cached_bytes(&self) -> [u64; 2] {
        let loader = &self.shared.lock().geometry;
        [loader.byte_cache().bytes(), loader.decoded_cache().bytes()]
    }

    /// Everything that has been given up since the last call.
    pub fn take_problems(&self) -> Vec<Problem> {
        self.shared.lock().take_problems()
    }

    /// Forgets all failures, so the next frames try again.
    pub fn retry_failed(&mut self) {
        self.content.retry();
        self.shared.lock().retry_failed();
    }

    #[cfg(feature = "threads")]
    pub(crate) fn shared(&self) -> &Arc<Shared<HeightsContent>> {
        &self.shared
    }
}

/// How urgent a tile is, from the weighted error of what is drawn until it is there: an eighth of an octave counts.
fn urgency_of(error: f64) -> u8 {
    // The exponent and the first digits of a number grow with it.
    match error > 0.0 {
        true => (i64::from((error as f32).to_bits() >> 20) - i64::from(1e-3_f32.to_bits() >> 20)).clamp(1, 255) as u8,
        false => 0,
    }
}

impl Drop for HeightsSession {
    fn drop(&mut self) {
        self.shared.end();
    }
}
