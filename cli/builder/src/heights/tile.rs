//! One tile: its samples, its resolutions, and whether the tiles below it say anything.

use lodpack::heights::{
    Base, CELLS, DrawnTile, Grid, LevelErrors, Line, Lines, MAX_RESOLUTIONS, Resolution, SIDE, Surface, TileId,
    TileTriangle, TileValues, storable_tolerance, tile_symbols,
};
use lodpack::write::SymbolBuffer;

use serde::{Deserialize, Serialize};

use super::HeightsError;
use super::even::Even;
use super::facets::{Facet, Judge};
use super::needs::{Needs, Place};
use super::samples::{Scale, Window};
use super::squares::{Ground, Squares};

/// Tolerances of tiles whose quarters say more, as shares of how far the quarters' samples are off.
const COARSE: [f64; 3] = [1.0, 1.8, 3.0];
/// The same for level tiles on a globe: halves of cells, and halves of squares of cells, which are off by twice as
/// much.
const LEVEL: [f64; 2] = [0.0, 2.1];
/// The coarsest tolerance of tiles that have all samples, as a share of how far their parent is from these.
const COARSEST: f64 = 2.0;
/// The same for a tile without a parent, as a share of the range of its heights.
const RANGE: f64 = 0.25;
/// The tolerances of such a tile decrease by this factor.
const FINER: f64 = 0.6;
/// A tolerance is rounded down when it is stored, and shall not fall below a distance of whole steps.
const ABOVE: f64 = 1.01;
/// Distances of heights are summed from a few products, of which each is rounded.
const ROUNDED_UP: f64 = 1.0 + 1e-12;
/// A resolution has at most this share of the triangles of the one before.
const FEWER: f64 = 0.85;

/// What all tiles share.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    pub grid: &'a Grid,
    pub surface: &'a Surface,
    pub scale: Scale,
    /// How far a sample is from its rounded height at most, in units of coordinates.
    pub error: f64,
    /// What follows below level tiles, on a globe.
    pub level: Option<LevelErrors>,
    /// The highest sample, in units of coordinates.
    pub highest: f64,
}

impl Setting<'_> {
    /// What errors have beside the distance of drawn triangles from rounded samples.
    pub fn added(&self) -> f64 {
        self.level.map_or(self.error, |level| level.least())
    }
}

/// Numbers of triangles of a surface, and how far samples are from them: inside, and along the border of the tile.
/// Others are not off.
pub type SeenFacets = Vec<(u32, [f64; 2])>;

/// A surface that a tile may be drawn as, and how far it has been seen from the samples.
#[derive(Clone, Debug)]
pub struct Drawn {
    tolerance: f64,
    triangle_count: u32,
    /// Of a tile above the units: triangles that samples below the tile are compared with.
    facets: Vec<Facet>,
    /// Of each of them, inside and along the border of the tile.
    distances: Vec<[f64; 2]>,
    /// A bound of all distances, or anything up to that of a finer surface if the bound is not above it.
    off: f64,
}

impl Drawn {
    /// Takes over what another has seen of the same surface.
    pub fn join(&mut self, other: &SeenFacets) {
        for &(number, seen) in other {
            if let Some(known) = self.distances.get_mut(number as usize) {
                *known = [known[0].max(seen[0]), known[1].max(seen[1])];
            }
        }
    }

    /// What a judge sees. Only the largest distance is of interest.
    pub fn seen(&self, judge: &Judge<'_>) -> SeenFacets {
        let mut most = 0.0f64;
        let look = |(number, facet): (u32, &Facet)| {
            let seen = judge.distances(facet, most);
            most = most.max(seen[0] + seen[1]);
            (number, seen)
        };
        (0..).zip(&self.facets).map(look).filter(|(_, seen)| *seen != [0.0; 2]).collect()
    }

    /// What all judges together have seen.
    pub fn all_seen(&self) -> SeenFacets {
        (0..).zip(self.distances.iter().copied()).filter(|(_, seen)| *seen != [0.0; 2]).collect()
    }

    /// A triangle at the border may get samples of neighbours, which move it by as much as its side is off.
    fn error(&self) -> f64 {
        self.distances.iter().fold(self.off, |most: f64, [inside, border]| most.max(inside + border))
    }
}

/// A tile that is being worked on.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Of a tile in a unit, until it has been judged.
    laid: Option<Box<DrawnTile>>,
    /// What it needs says how far it is from its samples.
    is_known: bool,
    /// It has all samples itself.
    is_finest: bool,
    /// What its samples need, in steps, if its lines are even and it lies on a plane.
    needs: Option<Needs>,
    pub id: TileId,
    pub lines: Lines,
    pub values: TileValues,
    /// Finest first.
    pub drawn: Vec<Drawn>,
    /// How far what is drawn may lie from what there is where some cells are only partly there.
    partly: Option<[f64; 2]>,
}

impl Tile {
    /// A tile of its samples. `off` says how far samples that only its quarters have are from it, if there are any, and
    /// `above` the distance of its own from its parent. A tile above the units has no judge here, and is judged by
    /// parts.
    pub fn new(
        setting: &Setting<'_>,
        (id, judge): (TileId, Option<&Judge<'_>>),
        values: TileValues,
        off: Option<Off>,
        above: Option<f64>,
    ) -> Result<Self, HeightsError> {
        let Setting { grid, surface, scale, .. } = *setting;
        let is_globe = surface.is_globe();
        let lines = grid.lines(id);
        let step = scale.step * surface.height_scale;
        // Where a tile has all samples of a square on a plane, what they need says how far they are from its triangles.
        let is_known = off.is_none() && values.cells.is_none() && !is_globe && lines.are_whole();
        let [low, high] = range_of(&values);
        let tolerances: Vec<f64> = match off {
            Some(Off { most, is_level: true }) if is_globe => LEVEL.map(|share| share * most).to_vec(),
            Some(Off { most, .. }) if most > 0.0 => COARSE.map(|share| share * most).to_vec(),
            _ => {
                let range = || RANGE * (f64::from(high) - f64::from(low)) * step;
                let (count, finer) =
                    if is_known { (MAX_RESOLUTIONS, FINER) } else { (MAX_RESOLUTIONS / 2, FINER * FINER) };
                let coarsest = above.map_or_else(range, |off| COARSEST * off);
                // None lies below a step, since the first one is exact.
                let coarse_to_fine = std::iter::successors(Some(coarsest), |tolerance| Some(tolerance * finer));
                let mut all: Vec<f64> =
                    coarse_to_fine.take_while(|&tolerance| tolerance >= step).take(count - 1).collect();
                all.iter_mut().for_each(|tolerance| *tolerance *= ABOVE);
                all.push(0.0);
                all.reverse();
                all
            }
        };
        let coarsest = tolerances.iter().copied().fold(0.0, f64::max);
        let exact = Exact::new(setting, [low, high]);
        let mut are_exact = tolerances.iter().map(|&tolerance| exact.tolerance(tolerance).is_ok_and(|of| of.is_some()));
        let judge_of_exact = judge.filter(|_| are_exact.all(|is_exact| is_exact));
        let needs = judge_of_exact.and_then(|judge| needs_of(judge, &lines, id, &values));
        let laid = match &needs {
            Some(_) => None,
            None => Some(Box::new(DrawnTile::new(grid, surface, [scale.zero, scale.step], (id, &values), coarsest))),
        };
        let mut drawn: Vec<Drawn> = vec![];
        for tolerance in tolerances {
            let (tolerance, count) = match (&needs, &laid) {
                (Some(needs), _) => match exact.tolerance(tolerance)? {
                    Some(tolerance) => (tolerance, needs.triangle_count(exact.in_steps(tolerance))),
                    None => continue,
                },
                (None, Some(tile)) => {
                    let tolerance = storable_tolerance(tolerance)?;
                    let mut count = 0;
                    match is_known || is_whole(tile, &values) {
                        true => count = tile.needs.triangle_count(tolerance),
                        false => tile.for_each_face(tolerance, |_, is_drawn| count += usize::from(is_drawn)),
                    }
                    (tolerance, count)
                }
                (None, None) => continue,
            };
            let is_new = drawn.last().is_none_or(|last| (count as f64) < FEWER * f64::from(last.triangle_count));
            if !is_new {
                continue;
            }
            let mut facets = vec![];
            if let (None, Some(tile)) = (judge, &laid) {
                tile.for_each_face(tolerance, |triangle, _| facets.push(Facet::new(tile, &values.steps, triangle)));
            }
            let distances = vec![[0.0; 2]; facets.len()];
            drawn.push(Drawn { tolerance, triangle_count: count as u32, distances, facets, off: 0.0 });
        }
        let laid = laid.filter(|_| judge.is_some());
        Ok(Self { id, laid, is_known, is_finest: off.is_none(), needs, lines, values, drawn, partly: None })
    }

    /// Looks at the samples of a window, which are all that lie below it. No error will be below `least`.
    pub fn judge(&mut self, judge: &Judge<'_>, least: f64) {
        if let (Some(needs), Some(place)) = (self.needs.take(), judge.table_of(&self.lines)) {
            let mut most = least.max(0.0);
            for drawn in &mut self.drawn {
                let tolerance = in_steps(drawn.tolerance, judge.step());
                let off = match place.shift {
                    0 => needs.bound(tolerance, place),
                    _ => needs.distance(tolerance, place, in_steps(most, judge.step())),
                };
                most = most.max(f64::from(off) * judge.step() * ROUNDED_UP);
                drawn.off = most;
            }
            return;
        }
        let Some(tile) = self.laid.take() else { return };
        let steps = &*self.values.steps;
        let even = Even::new(judge, &tile, steps, self.values.cells.is_none());
        let mut most = least.max(0.0);
        for drawn in &mut self.drawn {
            if self.partly.is_some() {
                // There these distances are added to others.
                most = 0.0;
            }
            if self.is_finest && drawn.tolerance == 0.0 {
                // All samples are corners.
                continue;
            }
            if self.is_known {
                most = most.max(tile.needs.bound(drawn.tolerance) * ROUNDED_UP);
                most = most.max(judge.at_border(&tile, steps, drawn.tolerance));
            } else if let Some(even) = &even {
                tile.needs.for_each_triangle(drawn.tolerance, None, |triangle| {
                    let border = match has_border_side(triangle) {
                        true => judge.along_border(&Facet::new(&tile, steps, triangle)),
                        false => 0.0,
                    };
                    most = most.max(border + even.distance(judge, triangle, most - border));
                });
            } else {
                tile.for_each_face(drawn.tolerance, |triangle, _| {
                    let [inside, border] = judge.distances(&Facet::new(&tile, steps, triangle), most);
                    most = most.max(inside + border);
                });
            }
            drawn.off = most;
        }
    }

    /// What is stored of its resolutions. `least` is the finest error of the tiles below, which no tile above falls
    /// short of.
    pub fn resolutions(&self, setting: &Setting<'_>, least: f64) -> Vec<Resolution> {
        let mut before = least;
        let of = |drawn: &Drawn| {
            let vertical = drawn.error();
            let off = match self.partly {
                None => vertical,
                Some([across, range]) => vertical.max(libm::hypot(across, range + 2.0 * drawn.tolerance + vertical)),
            };
            let error = (off + setting.added()).max(before);
            before = error;
            Resolution { tolerance: drawn.tolerance, error, triangle_count: drawn.triangle_count }
        };
        self.drawn.iter().map(of).collect()
    }

    /// Notes cells that are drawn but only partly there: the largest diagonal of them, and the largest range of their
    /// heights.
    pub fn note_partly(&mut self, setting: &Setting<'_>, is_whole: impl Fn(usize, usize) -> bool) {
        let is_drawn = |column: usize, row: usize| match &self.values.cells {
            None => true,
            Some(cells) => cells[row] >> column & 1 != 0,
        };
        let to_length = match setting.surface.base {
            Base::Plane => 1.0,
            // No degree is longer than one of the equator, at the highest height.
            Base::Ellipsoid { axis, .. } => 1.01 * (axis + setting.highest.max(0.0)) * std::f64::consts::PI / 180.0,
        };
        let mut most: Option<[f64; 2]> = None;
        for row in 0..CELLS {
            for column in (0..CELLS).filter(|&column| is_drawn(column, row) && !is_whole(column, row)) {
                let size = [&self.lines.columns, &self.lines.rows].into_iter().zip([column, row]);
                let extent: Vec<f64> = size
                    .zip(setting.surface.spacing)
                    .map(|((lines, k), spacing)| (lines[k + 1] - lines[k]) as f64 * spacing.abs() * to_length)
                    .collect();
                let at = row * SIDE + column;
                let corners = [at, at + 1, at + SIDE, at + SIDE + 1].map(|at| self.values.steps[at]);
                let range = f64::from(corners.iter().max().unwrap_or(&0) - corners.iter().min().unwrap_or(&0));
                let range = range * setting.scale.step * setting.surface.height_scale;
                let known = most.unwrap_or([0.0; 2]);
                most = Some([known[0].max(libm::hypot(extent[0], extent[1])), known[1].max(range)]);
            }
        }
        self.partly = most;
    }
}

/// Whether all triangles of a tile are drawn.
fn is_whole(tile: &DrawnTile, values: &TileValues) -> bool {
    tile.lines.distances().is_some()
        && values.cells.is_none()
        && ![0, SIDE * CELLS].iter().any(|&at| tile.is_at_pole(at as u16))
}

/// What a tile with even lines on a plane needs; none of others.
fn needs_of(judge: &Judge<'_>, lines: &Lines, id: TileId, values: &TileValues) -> Option<Needs> {
    let place = judge.table_of(lines).filter(|_| values.cells.is_none())?;
    if place.shift == 0 {
        return Some(Needs::new(place));
    }
    // Readers know no other samples of the tile than its own.
    let ground = Ground::new(values.steps.iter().copied(), SIDE)?;
    let squares = Squares::all(&ground, CELLS, (id.column + id.row).is_multiple_of(2));
    Some(Needs::new(Place { squares: &squares, first: [0; 2], shift: 0 }))
}

/// A length in steps, rounded down to what is compared with exact distances in steps.
fn in_steps(length: f64, step: f64) -> f32 {
    let steps = length / step;
    let rounded = steps as f32;
    if f64::from(rounded) > steps { rounded.next_down() } else { rounded }
}

/// Tolerances of tiles whose needs are known in steps. Readers compute these in other units, with rounding: so no
/// tolerance may be so near to what a sample can need that the two could differ.
struct Exact {
    step: f64,
    /// Readers do not round: steps have few bits.
    is_exact: bool,
    /// The largest height, in steps.
    most: f64,
}

impl Exact {
    /// Needs are multiples of this share of a step.
    const SHARES: f64 = CELLS as f64;
    /// Numbers lose less than this share of the largest height when they are computed from heights.
    const ROUNDING: f64 = 1.0 / (1u64 << 44) as f64;
    /// Heights of 31 bits, steps of this many and shares of six fit into a number of 53 bits.
    const FEW_BITS: u32 = 14;

    fn new(setting: &Setting<'_>, range: [i32; 2]) -> Self {
        let (step, scale) = (setting.scale.step, setting.surface.height_scale);
        let bits = |number: f64| 53 - (number.to_bits() | 1 << 52).trailing_zeros().min(52);
        let most = range.into_iter().map(i32::unsigned_abs).max().unwrap_or(0);
        Self { step: step * scale, is_exact: bits(step) + bits(scale) <= Self::FEW_BITS, most: most.into() }
    }

    fn in_steps(&self, tolerance: f64) -> f32 {
        in_steps(tolerance, self.step)
    }

    /// The tolerance to store for one, nearly as large; none if there is no such.
    fn tolerance(&self, tolerance: f64) -> Result<Option<f64>, HeightsError> {
        /// A stored number has nine bits, so this leads to the next ones.
        const NEXT: f64 = 1.005;
        // What is exactly straight for one is nearly so for the other.
        let mut tolerance = if tolerance > 0.0 || self.is_exact { tolerance } else { 0.25 * self.step / Self::SHARES };
        for _ in 0..8 {
            tolerance = storable_tolerance(tolerance)?;
            let shares = tolerance / self.step * Self::SHARES;
            let rounding = Self::SHARES * (self.most + tolerance / self.step) * Self::ROUNDING;
            if self.is_exact || (shares - shares.round()).abs() > rounding {
                return Ok(Some(tolerance));
            }
            tolerance *= NEXT;
        }
        Ok(None)
    }
}

/// A tile's samples, laid out only as far as is needed.
struct Laid<'a> {
    values: &'a TileValues,
    lines: Lines,
    axes: Option<[[Line; SIDE]; 2]>,
    setting: &'a Setting<'a>,
}

impl<'a> Laid<'a> {
    fn new(setting: &'a Setting<'a>, id: TileId, values: &'a TileValues) -> Self {
        let lines = setting.grid.lines(id);
        let surface = setting.surface;
        let axes = || [lines.columns.map(|column| surface.line(0, column)), lines.rows.map(|row| surface.line(1, row))];
        let axes = surface.is_globe().then(axes);
        Self { values, lines, axes, setting }
    }

    fn height(&self, at: usize) -> f64 {
        f64::from(self.values.steps[at]) * self.setting.scale.step
    }

    fn line(&self, at: usize) -> [f64; 2] {
        let row = self.lines.rows[at / SIDE];
        let row = if self.axes.is_some() { self.setting.surface.row_in_space(row) } else { row as f64 };
        [self.lines.columns[at % SIDE] as f64, row]
    }

    /// How far the globe is from straight connections between the samples, if these are equally far apart and none is
    /// at a pole.
    fn bend(&self) -> Option<f64> {
        let surface = self.setting.surface;
        self.lines.distances()?;
        let Some([columns, rows]) = &self.axes else { return Some(0.0) };
        let latitude = |row: u64| surface.first[1] + row as f64 * surface.spacing[1];
        if [0, CELLS].iter().any(|&k| latitude(self.lines.rows[k]).abs() >= 90.0) {
            return None;
        }
        let chord = |row: &[Line]| {
            let ends = [(columns[0], row[0]), (columns[1], row[1])];
            let [a, b] = ends.map(|(column, row)| surface.position(column, row, self.setting.scale.zero));
            (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
        };
        Some(surface.bend(rows.windows(2).map(chord).fold(0.0, f64::max)))
    }

    fn place(&self, at: usize) -> [f64; 3] {
        let height = self.setting.scale.zero + self.height(at);
        match &self.axes {
            None => [0.0, 0.0, height * self.setting.surface.height_scale],
            Some([columns, rows]) => self.setting.surface.position(columns[at % SIDE], rows[at / SIDE], height),
        }
    }
}

/// Whether a triangle may have a side on the border of its tile.
fn has_border_side(triangle: TileTriangle) -> bool {
    let index = triangle.map(|at| [usize::from(at) % SIDE, usize::from(at) / SIDE]);
    (0..2).any(|axis| [0, CELLS].iter().any(|&end| index.iter().filter(|at| at[axis] == end).count() > 1))
}

/// The samples that quarters of a tile have, and it does not.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Off {
    /// How far they are from the straight connections of the tile's samples at most.
    pub most: f64,
    /// Whether they have all the same height, as the tile's own have.
    pub is_level: bool,
}

/// Compares the samples of quarters of a tile with it.
pub fn distance_of_quarters<'a>(
    setting: &Setting<'_>,
    id: TileId,
    values: &TileValues,
    quarters: impl Iterator<Item = (TileId, &'a TileValues)>,
) -> Off {
    // On a plane nothing depends on it.
    let own = if setting.surface.is_globe() { range_of(values) } else { [0, 1] };
    let mut is_level = own[0] == own[1];
    let tile = Laid::new(setting, id, values);
    let (mut most, mut doubled) = (0.0f64, 0i64);
    let bend = tile.bend();
    for (quarter, values) in quarters {
        is_level = is_level && range_of(values) == own;
        if let Some(bend) = bend.filter(|_| values.cells.is_none()) {
            doubled = doubled.max(doubled_distance(tile.values, quarter, values));
            most = most.max(bend);
            continue;
        }
        let fine = Laid::new(setting, quarter, values);
        let [x, y] = [quarter.quarter() & 1, quarter.quarter() >> 1].map(|half| half * CELLS / 2);
        for at in 0..SIDE * SIDE {
            let (column, row) = (at % SIDE, at / SIDE);
            if column % 2 == 0 && row % 2 == 0 || !touches(values, column, row) {
                continue;
            }
            let (west, north) = (x + column / 2, y + row / 2);
            let (east, south) = (west + column % 2, north + row % 2);
            let corners = [[0, 0], [1, 0], [0, 1], [1, 1]]
                .map(|[x, y]| (north + y * (south - north)) * SIDE + west + x * (east - west));
            let ([low, high], middle) = ([tile.line(corners[0]), tile.line(corners[3])], fine.line(at));
            let share = |axis: usize| match high[axis] > low[axis] {
                true => (middle[axis] - low[axis]) / (high[axis] - low[axis]),
                false => 0.0,
            };
            // A cell has its diagonal from the north-west where its column and its row make an even sum.
            let shares = shares([share(0), share(1)], (west + north).is_multiple_of(2));
            let off = if setting.surface.is_globe() {
                let (places, middle) = (corners.map(|corner| tile.place(corner)), fine.place(at));
                let off = [0, 1, 2].map(|axis| (0..4).map(|k| shares[k] * places[k][axis]).sum::<f64>() - middle[axis]);
                (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt()
            } else {
                let height: f64 = (0..4).map(|k| shares[k] * tile.height(corners[k])).sum();
                (height - fine.height(at)).abs() * setting.surface.height_scale
            };
            most = most.max(off);
        }
    }
    let most = most.max(bend.unwrap_or(0.0) + 0.5 * doubled as f64 * setting.scale.step * setting.surface.height_scale);
    Off { most, is_level }
}

/// Twice the distance of the samples of a quarter from a tile's straight connections, in steps, where both divide a
/// plane evenly.
fn doubled_distance(tile: &TileValues, id: TileId, quarter: &TileValues) -> i64 {
    let [x, y] = [id.quarter() & 1, id.quarter() >> 1].map(|half| half * CELLS / 2);
    let at = |column: usize, row: usize| i64::from(tile.steps[(y + row) * SIDE + x + column]);
    let fine = |column: usize, row: usize| 2 * i64::from(quarter.steps[row * SIDE + column]);
    let mut most = 0;
    for row in 0..=CELLS / 2 {
        for column in 0..=CELLS / 2 {
            let north_west = at(column, row);
            let (has_east, has_south) = (column < CELLS / 2, row < CELLS / 2);
            if has_east {
                most = most.max((north_west + at(column + 1, row) - fine(2 * column + 1, 2 * row)).abs());
            }
            if has_south {
                most = most.max((north_west + at(column, row + 1) - fine(2 * column, 2 * row + 1)).abs());
            }
            if has_east && has_south {
                // A cell has its diagonal from the north-west where its column and its row make an even sum.
                let ends = match (x + column + y + row).is_multiple_of(2) {
                    true => north_west + at(column + 1, row + 1),
                    false => at(column + 1, row) + at(column, row + 1),
                };
                most = most.max((ends - fine(2 * column + 1, 2 * row + 1)).abs());
            }
        }
    }
    most
}

/// The shares that the corners of a cell (north-west, north-east, south-west, south-east) have in a point of its two
/// triangles.
fn shares([x, y]: [f64; 2], falls: bool) -> [f64; 4] {
    match (falls, if falls { y >= x } else { x + y <= 1.0 }) {
        (true, true) => [1.0 - y, 0.0, y - x, x],
        (true, false) => [1.0 - x, x - y, 0.0, y],
        (false, true) => [1.0 - x - y, x, y, 0.0],
        (false, false) => [0.0, 1.0 - y, 1.0 - x, x + y - 1.0],
    }
}

/// Whether a drawn cell touches a sample.
pub fn touches(values: &TileValues, column: usize, row: usize) -> bool {
    let Some(cells) = &values.cells else { return true };
    let is_drawn = |column: usize, row: usize| column < CELLS && row < CELLS && cells[row] >> column & 1 != 0;
    is_drawn(column, row)
        || is_drawn(column.wrapping_sub(1), row)
        || is_drawn(column, row.wrapping_sub(1))
        || is_drawn(column.wrapping_sub(1), row.wrapping_sub(1))
}

/// The values of a tile of which a window has all samples. `cells` are those that are drawn.
pub fn values_of(window: &Window, lines: &Lines, cells: Option<Box<[u64; CELLS]>>) -> TileValues {
    let mut steps = Box::new([0; SIDE * SIDE]);
    for (row, steps) in lines.rows.iter().zip(steps.as_chunks_mut::<SIDE>().0) {
        let run = window.run(*row, [lines.columns[0], lines.columns[CELLS]]);
        for (column, step) in lines.columns.iter().zip(steps) {
            *step = run[(column - lines.columns[0]) as usize] >> 1;
        }
    }
    TileValues { steps, cells }
}

/// The symbols of a tile.
pub fn symbols_of(
    grid: &Grid,
    id: TileId,
    above: Option<&TileValues>,
    values: &TileValues,
) -> Result<SymbolBuffer, HeightsError> {
    let mut symbols = SymbolBuffer::default();
    tile_symbols(grid, id, above, values, &mut symbols)?;
    Ok(symbols)
}

/// The lowest and the highest step of those of a tile's own samples that are drawn.
pub fn range_of(values: &TileValues) -> [i32; 2] {
    if values.cells.is_none() {
        // Two passes are faster than one, since each of them is done in lanes.
        let steps = || values.steps.iter().copied();
        return [steps().fold(i32::MAX, i32::min), steps().fold(i32::MIN, i32::max)];
    }
    let drawn = values.steps.iter().enumerate().filter(|(at, _)| touches(values, at % SIDE, at / SIDE));
    drawn.fold([i32::MAX, i32::MIN], |[low, high], (_, step)| [low.min(*step), high.max(*step)])
}
