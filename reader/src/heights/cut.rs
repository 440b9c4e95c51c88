//! Cuts of a grid of heights: which tiles are drawn, and at which of their resolutions.
//!
//! A cut begins with the tiles at depth 0, each at its coarsest resolution. As long as something is coarser than the
//! tolerance, that with the largest error becomes finer: the tile's next resolution, or else its quarters. A tile
//! without quarters in the file stays.

use std::{cmp::Ordering, collections::BinaryHeap, sync::Arc};

use super::{
    file::Heights,
    grid::{CELLS, TileId},
    page::{Entry, Found, MOST_LEVEL, Page, Resolution},
};
use crate::{
    error::{Error, Result},
    format::header::FileId,
    select::Limiter,
    source::ReadAt,
};

/// Pages of tiles are read together whose errors are at least this share of the largest one.
const READ_AHEAD: f64 = 0.5;

/// What to draw, and how finely. The default asks for everything at the finest resolution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeightsQuery {
    /// The least and the greatest coordinates: x and y on a plane, degrees of longitude and latitude on a globe. Tiles
    /// that meet it are drawn. It may be infinite. Around a globe, the least longitude may be larger than the greatest:
    /// then the box crosses the end of the grid.
    pub bounds: Option<[[f64; 2]; 2]>,
    /// The error to reach, in units of space.
    pub tolerance: Option<f64>,
    /// The most triangles, without those that stitching adds.
    pub max_triangles: Option<u64>,
}

/// A tile at a resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutTile {
    /// The tile.
    pub id: TileId,
    /// How it is drawn.
    pub resolution: Resolution,
}

/// Tiles that cover what is asked for, none of them twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightsCut {
    /// Along a Z.
    pub tiles: Vec<CutTile>,
    /// The largest error among them: no sample that the heights were made from is further from the cut's mesh.
    pub error: f64,
    /// Triangles, without those that stitching adds.
    pub triangle_count: u64,
    /// Why it is not finer.
    pub limiter: Limiter,
    /// The file that it was selected in: another file refuses it. None for cuts that were put together by hand.
    pub file: Option<FileId>,
}

/// Columns and rows of cells that a query wants: on a globe also once around to the west.
struct Wanted {
    columns: [f64; 2],
    rows: [f64; 2],
    /// Columns of a whole turn around the globe; none on a plane.
    around: Option<f64>,
}

impl Wanted {
    fn new<S: ReadAt>(heights: &Heights<S>, [least, greatest]: [[f64; 2]; 2]) -> Result<Self> {
        let wrong = |what: &str| Err(Error::Query { what: format!("the bounds {what}") });
        if least.iter().chain(&greatest).any(|x| x.is_nan()) {
            return wrong("are not numbers");
        }
        let (surface, cells) = (heights.surface(), heights.grid().cells());
        let cell = |axis: usize, at: f64| (at - surface.first[axis]) / surface.spacing[axis];
        let mut columns = [cell(0, least[0]), cell(0, greatest[0])];
        // Longitudes a turn apart are one place, also where a grid covers a part of the globe.
        let turn = if heights.grid().wraps() { cells[0] as f64 } else { 360.0 / surface.spacing[0] };
        let around = surface.is_globe().then_some(turn);
        if let Some(around) = around
            && columns[1] - columns[0] == f64::INFINITY
        {
            columns = [0.0, around];
        } else if let Some(around) = around {
            let width = columns[1] - columns[0];
            let width = if width < 0.0 { width.rem_euclid(around) } else { width.min(around) };
            let west = columns[0].rem_euclid(around);
            columns = [west, west + width];
        }
        // Rows go to the south.
        let rows = [cell(1, greatest[1]), cell(1, least[1])];
        // Around a globe, no number of turns leads from one infinity to a longitude.
        if !(columns[0] <= columns[1] && rows[0] <= rows[1]) {
            return wrong("end before they begin: give the least coordinates first");
        }
        Ok(Self { columns, rows, around })
    }

    /// Whether a tile is among what is wanted: more than its border, unless the bounds have no width.
    fn has(&self, columns: [f64; 2], rows: [f64; 2]) -> bool {
        let meet = |[from, to]: [f64; 2], [start, end]: [f64; 2]| match from == to {
            true => start <= from && from <= end,
            false => start < to && from < end,
        };
        let [west, east] = self.columns;
        let meets = |shift: f64| meet([west - shift, east - shift], columns);
        meet(self.rows, rows) && (meets(0.0) || self.around.is_some_and(meets))
    }
}

/// A tile of a cut that is being made.
struct Drawn {
    page: Arc<Page>,
    entry: Entry,
    /// Which of its resolutions is drawn.
    number: usize,
}

impl Drawn {
    fn resolution(&self) -> Resolution {
        self.entry.record.resolutions.get(self.number).copied().unwrap_or_default()
    }

    fn key(&self) -> (f64, TileId) {
        (self.resolution().error, self.entry.record.id)
    }
}

impl PartialEq for Drawn {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Drawn {}

impl PartialOrd for Drawn {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Drawn {
    /// By error; of equal ones the coarser and then the first tile comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        let ((error, id), (other_error, other_id)) = (self.key(), other.key());
        error.total_cmp(&other_error).then_with(|| other_id.cmp(&id))
    }
}

impl<S: ReadAt> Heights<S> {
    /// Chooses what to draw. Reads index pages, as far as they are not known yet.
    ///
    /// # Errors
    /// [`Error::Query`] if the query is impossible; [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn cut(&self, query: &HeightsQuery) -> Result<HeightsCut> {
        let tolerance = query.tolerance.unwrap_or(0.0);
        if tolerance.is_nan() || tolerance < 0.0 {
            return Err(Error::Query { what: format!("the tolerance {tolerance} is not zero or more") });
        }
        let wanted = query.bounds.map(|bounds| Wanted::new(self, bounds)).transpose()?;
        let max_triangles = query.max_triangles.unwrap_or(u64::MAX);
        let mut cut =
            HeightsCut { limiter: Limiter::Tolerance, file: Some(self.index().id()), ..HeightsCut::default() };
        let mut waiting: BinaryHeap<Drawn> = BinaryHeap::new();
        for &root in self.roots() {
            if self.is_wanted(root, wanted.as_ref())
                && let Some(page) = self.index().known_page(root)
                && let Some(entry) = page.top().cloned()
            {
                waiting.push(Drawn { page, entry, number: 0 });
            }
        }
        cut.triangle_count = waiting.iter().map(|tile| u64::from(tile.resolution().triangle_count)).sum();
        if cut.triangle_count > max_triangles {
            return Err(Error::Query { what: format!("the query needs at least {} triangles", cut.triangle_count) });
        }
        let mut done = Vec::new();
        let mut level_count = 0;
        while let Some(tile) = waiting.pop() {
            if tile.resolution().error <= tolerance {
                waiting.push(tile);
                break;
            }
            level_count += u64::from(tile.entry.record.is_level);
            let is_last = tile.entry.record.is_level && level_count > MOST_LEVEL;
            let finer = if is_last { None } else { self.finer(&tile, wanted.as_ref(), &waiting, tolerance)? };
            let Some(finer) = finer else {
                cut.limiter = Limiter::Finest;
                done.push(tile);
                continue;
            };
            let count = |tile: &Drawn| u64::from(tile.resolution().triangle_count);
            let triangle_count = cut.triangle_count - count(&tile) + finer.iter().map(count).sum::<u64>();
            if triangle_count > max_triangles {
                cut.limiter = Limiter::Triangles;
                done.push(tile);
                break;
            }
            cut.triangle_count = triangle_count;
            waiting.extend(finer);
        }
        done.extend(waiting);
        let tiles = done.iter().map(|tile| CutTile { id: tile.entry.record.id, resolution: tile.resolution() });
        cut.tiles = tiles.collect();
        cut.tiles.sort_unstable_by_key(|tile| tile.id.along_z(self.grid().depth()));
        cut.error = cut.tiles.iter().fold(0.0, |most, tile| tile.resolution.error.max(most));
        Ok(cut)
    }

    fn is_wanted(&self, id: TileId, wanted: Option<&Wanted>) -> bool {
        let ends =
            |axis: usize, tile: u64| [0, 1].map(|k| self.grid().line(axis, id.depth, (tile + k) * CELLS as u64) as f64);
        wanted.is_none_or(|wanted| wanted.has(ends(0, id.column), ends(1, id.row)))
    }

    /// What replaces a tile to be finer; none if there is nothing. `waiting` are the tiles that may come next.
    fn finer(
        &self,
        tile: &Drawn,
        wanted: Option<&Wanted>,
        waiting: &BinaryHeap<Drawn>,
        tolerance: f64,
    ) -> Result<Option<Vec<Drawn>>> {
        let Drawn { page, entry, number } = tile;
        if number + 1 < entry.record.resolutions.len() {
            return Ok(Some(vec![Drawn { page: Arc::clone(page), entry: entry.clone(), number: number + 1 }]));
        }
        if entry.record.children == 0 {
            return Ok(None);
        }
        let below = |tile: &Drawn| -> Vec<TileId> {
            tile.entry.record.child_tiles().filter(|&id| self.is_wanted(id, wanted)).collect()
        };
        let children = below(tile);
        if children.iter().any(|&id| self.index().missing_page(id).is_some()) {
            // Those that come next anyway save requests.
            let least = tolerance.max(READ_AHEAD * tile.resolution().error);
            let next = waiting.iter().filter(|tile| tile.resolution().error > least);
            let next = next.filter(|tile| tile.number + 1 == tile.entry.record.resolutions.len());
            let ids: Vec<TileId> = next.flat_map(below).chain(children.iter().copied()).collect();
            self.load_pages_of(&ids)?;
        }
        let child = |id: TileId| -> Option<Drawn> {
            match page.find(id)? {
                Found::Here(entry) => Some(Drawn { page: Arc::clone(page), entry: entry.clone(), number: 0 }),
                Found::Level(entry) => Some(Drawn { page: Arc::clone(page), entry, number: 0 }),
                Found::Below { top, .. } => {
                    let page = self.index().known_page(top)?;
                    let entry = page.top()?.clone();
                    Some(Drawn { page, entry, number: 0 })
                }
                Found::Missing(_) => None,
            }
        };
        Ok(Some(children.into_iter().filter_map(child).collect()))
    }
}
