//! Which tiles a frame wants, at which resolutions: the largest error on the screen becomes smaller first (Niski 2007,
//! chapter 4).
//!
//! Images of tiles have an error of their own, the size of a sample on the screen: where that is too large
//! ([`Options::sample_px`]), a tile gives way to its quarters, too, and these are drawn with as few triangles as their
//! errors allow.
//!
//! It begins with the tiles at depth 0. As long as an error is larger than what is tolerated, the tile with the largest
//! one becomes finer: the next resolution, or else its quarters, without those that the view does not show or that the
//! globe hides. Everything is chosen from the index.

use std::{
    cmp::Ordering,
    collections::{BTreeMap, BinaryHeap, HashMap},
};

use crate::{
    error::{Error, Result},
    heights::{
        Base, HeightsIndex, MOST_LEVEL, Place, TileId, TileRecord, WantedPage, enclosed_ball, is_hidden, tile_box,
    },
    select::{Limiter, OrientedBox, Projection, Query, Volume},
    stream::Options,
};

/// Boxes that are kept.
const MOST_BOXES: usize = 1 << 16;

/// What a frame knows of a tile.
#[derive(Clone, Debug)]
pub(super) struct WantedTile {
    pub record: TileRecord,
    /// Pixels per unit of error, or 1 without a view; 0 if it is not shown.
    pub factor: f64,
    /// The resolution at which it is drawn, if it is.
    pub resolution: usize,
    /// Whether its quarters are wanted instead.
    pub is_divided: bool,
    /// The weighted error of what is drawn until it is there.
    pub urgency: f64,
}

impl WantedTile {
    /// The weighted error at the wanted resolution.
    fn error(&self) -> f64 {
        self.factor * self.record.resolutions.get(self.resolution).map_or(0.0, |resolution| resolution.error)
    }

    fn triangle_count(&self) -> u64 {
        self.record.resolutions.get(self.resolution).map_or(0, |resolution| resolution.triangle_count.into())
    }
}

/// The tiles that a frame wants, with all that are above them or beside those.
#[derive(Clone, Debug, Default)]
pub(super) struct WantedTiles {
    /// Those above come first.
    pub tiles: BTreeMap<TileId, WantedTile>,
    /// Index pages that are needed to know more, each with its urgency.
    pub pages: Vec<(WantedPage, f64)>,
    pub limiter: Limiter,
    /// The budget that even the coarsest tiles exceed.
    pub exceeded: Option<Limiter>,
    /// Tiles that are drawn once all is there, and their triangles.
    pub tile_count: u64,
    pub triangle_count: u64,
}

/// A tile that may become finer.
struct Candidate {
    error: f64,
    id: TileId,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// By error; of equal ones the coarser and then the first tile comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then_with(|| other.id.cmp(&self.id))
    }
}

/// How far apart the samples of a tile are at most, in units of space.
fn spacing(index: &HeightsIndex, id: TileId) -> f64 {
    let (grid, surface) = (index.grid(), index.surface());
    let lines = grid.distance(id) as f64;
    let [column, row] = surface.spacing.map(f64::abs);
    match surface.base {
        Base::Plane => lines * column.max(row),
        Base::Ellipsoid { axis, .. } => lines * column.max(row) * (std::f64::consts::PI / 180.0) * axis,
    }
}

/// What a query shows, and how large.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    volume: Option<Volume>,
    projection: Option<Projection>,
    /// Weighted: in pixels with a view.
    tolerance: f64,
}

impl Sight {
    /// # Errors
    /// [`Error::Query`] if something in the query is not finite or makes no sense.
    pub fn new(query: &Query) -> Result<Self> {
        if query.max_bytes.is_some() {
            return Err(Error::Query { what: "heights have no budget of bytes; give max_triangles".into() });
        }
        if let Some(volume) = &query.volume {
            volume.check()?;
        }
        let tolerance = query.view.map_or(query.tolerance.unwrap_or(0.0), |view| view.pixel_tolerance);
        if tolerance.is_nan() || tolerance < 0.0 {
            return Err(Error::Query { what: format!("the tolerance {tolerance} is not zero or more") });
        }
        let projection = query.view.as_ref().map(Projection::new).transpose()?;
        Ok(Self { volume: query.volume, projection, tolerance })
    }
}

/// Chooses tiles, and keeps their boxes.
#[derive(Debug, Default)]
pub(super) struct Chooser {
    boxes: HashMap<TileId, OrientedBox>,
    /// What hides the far side of a globe: see [`enclosed_ball`].
    ball: Option<f64>,
    sample_px: f64,
}

impl Chooser {
    pub fn new(index: &HeightsIndex, options: &Options) -> Self {
        Self { boxes: HashMap::new(), ball: enclosed_ball(index), sample_px: options.sample_px }
    }

    /// What decides whether a tile becomes finer: its error or, in a view, that of its images, of which the tolerance
    /// is a sample's size.
    fn priority(&self, index: &HeightsIndex, tile: &WantedTile, sight: &Sight) -> f64 {
        let is_level = tile.record.lowest == tile.record.highest;
        if is_level || sight.projection.is_none() || !self.sample_px.is_finite() {
            return tile.error();
        }
        let samples = tile.factor * spacing(index, tile.record.id) / self.sample_px.max(f64::MIN_POSITIVE);
        tile.error().max(samples * sight.tolerance)
    }

    /// Pixels per unit of error, or 1 without a view; 0 for a tile that is not shown.
    pub fn factor(&mut self, index: &HeightsIndex, record: &TileRecord, sight: &Sight) -> f64 {
        if self.boxes.len() > MOST_BOXES {
            self.boxes.clear();
        }
        let bounds = *self.boxes.entry(record.id).or_insert_with(|| tile_box(index, record));
        if sight.volume.is_some_and(|volume| !volume.meets(bounds.bounds())) {
            return 0.0;
        }
        let Some(projection) = &sight.projection else { return 1.0 };
        if self.ball.is_some_and(|radius| is_hidden(projection.position(), radius, &bounds)) {
            return 0.0;
        }
        projection.look_at(&bounds).factor
    }

    /// Chooses for a query.
    pub fn choose(&mut self, index: &HeightsIndex, query: &Query, sight: &Sight) -> WantedTiles {
        let most = [query.max_triangles, query.max_nodes].map(|most| most.unwrap_or(u64::MAX));
        let mut wanted = WantedTiles { limiter: Limiter::Tolerance, ..WantedTiles::default() };
        let mut waiting = BinaryHeap::new();
        let (mut counts, mut level_count) = ([0, 0], 0);
        for &id in index.roots() {
            let Some(tile) = self.tile(index, id, sight, f64::INFINITY) else { continue };
            if tile.factor > 0.0 {
                counts = [counts[0] + tile.triangle_count(), counts[1] + 1];
                waiting.push(Candidate { error: self.priority(index, &tile, sight), id });
            }
            wanted.tiles.insert(id, tile);
        }
        let limiters = [Limiter::Triangles, Limiter::Nodes];
        wanted.exceeded = (0..2).find(|&k| counts[k] > most[k]).map(|k| limiters[k]);
        while let Some(Candidate { error, id }) = waiting.pop() {
            if error <= sight.tolerance {
                break;
            }
            let Some(tile) = wanted.tiles.get(&id) else { continue };
            // More triangles make no image finer.
            let is_near = tile.error() <= sight.tolerance;
            let finest = is_near || tile.resolution + 1 >= tile.record.resolutions.len();
            let before = tile.triangle_count();
            let new = if finest {
                level_count += u64::from(tile.record.is_level);
                if tile.record.children == 0 || tile.record.is_level && level_count > MOST_LEVEL {
                    if !is_near {
                        wanted.limiter = Limiter::Finest;
                    }
                    continue;
                }
                let urgency = tile.error();
                let children: Vec<TileId> = tile.record.child_tiles().collect();
                // All of them have to be known: those that are not shown are loaded last.
                let missing: Vec<WantedPage> = children.iter().filter_map(|&id| index.find(id).err()).collect();
                if !missing.is_empty() {
                    wanted.pages.extend(missing.into_iter().map(|page| (page, urgency)));
                    continue;
                }
                children.into_iter().filter_map(|id| self.tile(index, id, sight, urgency)).collect()
            } else {
                vec![WantedTile { resolution: tile.resolution + 1, ..tile.clone() }]
            };
            let shown = || new.iter().filter(|tile| tile.factor > 0.0);
            let after = [
                counts[0] - before + shown().map(WantedTile::triangle_count).sum::<u64>(),
                counts[1] - 1 + shown().count() as u64,
            ];
            if let Some(k) = (0..2).find(|&k| after[k] > most[k] && after[k] > counts[k]) {
                wanted.limiter = limiters[k];
                break;
            }
            counts = after;
            if finest && let Some(tile) = wanted.tiles.get_mut(&id) {
                tile.is_divided = true;
            }
            for tile in new {
                if tile.factor > 0.0 {
                    waiting.push(Candidate { error: self.priority(index, &tile, sight), id: tile.record.id });
                }
                wanted.tiles.insert(tile.record.id, tile);
            }
        }
        [wanted.triangle_count, wanted.tile_count] = counts;
        wanted
    }

    fn tile(&mut self, index: &HeightsIndex, id: TileId, sight: &Sight, urgency: f64) -> Option<WantedTile> {
        let Ok(Place::Here(entry)) = index.find(id) else { return None };
        let factor = self.factor(index, &entry.record, sight);
        // What is not shown is loaded last.
        let urgency = if factor > 0.0 { urgency } else { 0.0 };
        Some(WantedTile { record: entry.record, factor, resolution: 0, is_divided: false, urgency })
    }
}
