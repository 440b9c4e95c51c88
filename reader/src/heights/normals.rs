//! The normals of a tile, from the slopes of its heights: what light needs. A file stores none.
//!
//! A slope is the difference of the samples on both sides, in the directions that the base has there: so a globe is
//! shaded as a globe, however far apart its samples are (thesis, figure 5.7). On the border of a tile, the samples
//! beyond come from the tile across. A coarser one decides alone: its samples are among those of the finer tile, which
//! takes their slopes, and what lies between them. So both sides of a border have the same normals, but for the sample
//! at a corner where tiles of three depths meet.

use super::{
    codec::known_samples,
    drawn::{Outline, TileValues},
    grid::{CELLS, Grid, Lines, SIDE, TileId},
    section::HeightsInfo,
    surface::Line,
};

/// A normal of length 1, in 32,767ths.
pub type Normal = [i16; 3];

/// The largest component.
const ONE: f64 = 32767.0;

/// The tile across a side, at the same depth or a smaller one.
#[derive(Clone, Copy, Debug)]
pub struct Across<'a> {
    /// The tile.
    pub id: TileId,
    /// Its samples.
    pub values: &'a TileValues,
}

/// The sides of a tile: west, north, east, south.
pub(crate) const SIDES: usize = 4;

/// 0 for a side along a column, 1 for one along a row.
pub(crate) fn axis_of(side: usize) -> usize {
    side % 2
}

/// Whether a tile begins with a side, as it does in the west and in the north.
pub(crate) fn is_first(side: usize) -> bool {
    side < 2
}

/// The tile of the same depth across a side; none if the grid ends there.
pub(crate) fn across(grid: &Grid, id: TileId, side: usize) -> Option<TileId> {
    let mut across = id;
    let place = if axis_of(side) == 0 { &mut across.column } else { &mut across.row };
    if !is_first(side) {
        *place += 1;
    } else if let Some(before) = place.checked_sub(1) {
        *place = before;
    } else {
        // The last one that is not empty.
        *place = u64::MAX;
    }
    if grid.has(across) {
        return Some(across);
    }
    let wraps = axis_of(side) == 0 && grid.wraps();
    let cells = CELLS as u64 * grid.distance(id);
    let around = if is_first(side) { grid.cells()[0].div_ceil(cells) - 1 } else { 0 };
    wraps.then_some(TileId { column: around, ..id })
}

/// A sample beside another one: how many lines away it is, and its height in steps.
pub(super) type Beside = Option<(u64, i32)>;

/// Steps a line, by the parabola through three samples, or the straight line through two.
fn slope(here: i32, before: Beside, after: Beside) -> f64 {
    let rise = |(lines, steps): (u64, i32), sign: f64| sign * (f64::from(steps) - f64::from(here)) / lines as f64;
    match (before, after) {
        // Nearly all are. Divisions are what normals cost.
        (Some((lines, before)), Some((same, after))) if lines == same => {
            (f64::from(after) - f64::from(before)) / (2 * lines) as f64
        }
        (Some(before), Some(after)) => {
            let (a, b) = (before.0 as f64, after.0 as f64);
            (rise(before, -1.0) * b + rise(after, 1.0) * a) / (a + b)
        }
        (Some(before), None) => rise(before, -1.0),
        (None, Some(after)) => rise(after, 1.0),
        (None, None) => 0.0,
    }
}

/// A sample, and those beside it in the west, the north, the east and the south.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cross {
    pub steps: i32,
    pub beside: [Beside; SIDES],
}

impl Cross {
    /// Takes what another tile knows of the same sample: of two samples on one side the nearer one counts.
    pub fn join(&mut self, other: &Self) {
        for (own, other) in self.beside.iter_mut().zip(other.beside) {
            let lines = |beside: Beside| beside.map_or(u64::MAX, |(lines, _)| lines);
            if lines(other) < lines(*own) {
                *own = other;
            }
        }
    }

    /// Steps a column and a row.
    fn slopes(&self) -> [f64; 2] {
        [0, 1].map(|axis| slope(self.steps, self.beside[axis], self.beside[axis + 2]))
    }

    /// The normal at a column and a row.
    pub fn normal(&self, info: &HeightsInfo, [column, row]: [u64; 2]) -> Normal {
        let is_pole = [(0, 0), (1, info.grid.cells()[1])].iter().any(|&(k, at)| info.grid.poles()[k] && row == at);
        let lines = [info.surface.line(0, column), info.surface.line(1, row)];
        normal_at(info, lines, self.steps, if is_pole { None } else { Some(self.slopes()) })
    }
}

/// A tile's samples, as far as they are known.
pub(super) struct Field<'a> {
    lines: Lines,
    steps: &'a [i32; SIDE * SIDE],
    known: Option<Box<[bool; SIDE * SIDE]>>,
}

impl<'a> Field<'a> {
    /// What a tile knows around one of its samples.
    pub fn cross(&self, at: usize) -> Cross {
        let mut side = 0..SIDES;
        let beside = [(); SIDES].map(|()| {
            let side = side.next()?;
            self.next(at, axis_of(side), is_first(side))
        });
        Cross { steps: self.steps[at], beside }
    }

    pub fn new(grid: &Grid, id: TileId, values: &'a TileValues) -> Self {
        let lines = grid.lines(id);
        Self { known: known_samples(values, &lines), steps: &values.steps, lines }
    }

    fn along(&self, axis: usize) -> &[u64; SIDE] {
        if axis == 0 { &self.lines.columns } else { &self.lines.rows }
    }

    /// Of the index lines on a tile's last line of samples the first one.
    fn last(&self, axis: usize) -> usize {
        let lines = self.along(axis);
        lines.partition_point(|&line| line < lines[CELLS])
    }

    fn get(&self, at: usize) -> Option<i32> {
        self.known.as_ref().is_none_or(|known| known[at]).then(|| self.steps[at])
    }

    /// The sample next to one, along an axis; none beyond the tile, or where no cell is drawn.
    fn next(&self, at: usize, axis: usize, is_before: bool) -> Beside {
        let (place, stride) = if axis == 0 { (at % SIDE, 1) } else { (at / SIDE, SIDE) };
        let lines = self.along(axis);
        let line = lines[place];
        let mut other = if is_before { place.checked_sub(1)? } else { place + 1 };
        if lines.get(other) == Some(&line) {
            // Several index lines lie on one line of samples.
            other = match is_before {
                true => lines.partition_point(|&other| other < line).checked_sub(1)?,
                false => lines.partition_point(|&other| other <= line),
            };
        }
        let apart = lines.get(other)?.abs_diff(line);
        Some((apart, self.get(at - place * stride + other * stride)?))
    }
}

/// What a side takes from the tile across it.
struct Border<'a> {
    across: Field<'a>,
    /// The index line of the tile across that lies on the side.
    shared: usize,
    axis: usize,
    is_first: bool,
    /// How many lines lie between samples of the tile across, and whether these are more than in the tile itself.
    spacing: u64,
    is_coarser: bool,
}

impl<'a> Border<'a> {
    fn new(grid: &Grid, (id, tile): (TileId, &Field<'_>), side: usize, across: &Across<'a>) -> Option<Self> {
        let (axis, is_first) = (axis_of(side), is_first(side));
        let other = Field::new(grid, across.id, across.values);
        let mut line = if is_first { tile.along(axis)[0] } else { tile.along(axis)[CELLS] };
        if axis == 0 && grid.wraps() && line == if is_first { 0 } else { grid.cells()[0] } {
            line = grid.cells()[0] - line;
        }
        let lines = other.along(axis);
        let shared = lines.partition_point(|&other| other < line);
        let is_shared = lines.get(shared) == Some(&line);
        let spacing = grid.distance(across.id);
        let is_coarser = across.id.depth < id.depth;
        is_shared.then_some(Self { across: other, shared, axis, is_first, spacing, is_coarser })
    }

    /// The sample of the tile across that lies at a place along the side.
    fn at(&self, place: u64) -> Option<usize> {
        let along = self.across.along(1 - self.axis).binary_search(&place).ok()?;
        Some(if self.axis == 0 { along * SIDE + self.shared } else { self.shared * SIDE + along })
    }

    /// The sample beyond the side.
    fn beyond(&self, place: u64) -> Beside {
        self.across.next(self.at(place)?, self.axis, self.is_first)
    }
}

/// The normals of a tile's samples, row by row from the north-west, each of length 1. Where a tile across is not given,
/// slopes are those within the tile. `across` is in the order west, north, east, south.
pub fn normals(
    info: &HeightsInfo,
    (id, values): (TileId, &TileValues),
    across: [Option<Across<'_>>; SIDES],
) -> Box<[Normal; SIDE * SIDE]> {
    let grid = &info.grid;
    let tile = Field::new(grid, id, values);
    let mut side = 0..SIDES;
    let borders = across.map(|across| {
        let side = side.next()?;
        Border::new(grid, (id, &tile), side, &across?)
    });
    let painter = Painter::new(info, &tile);
    let mut all = Box::new([[0; 3]; SIDE * SIDE]);
    let ends = [0, 1].map(|axis| tile.last(axis));
    for row in 0..=ends[1] {
        for column in 0..=ends[0] {
            let (at, here) = (row * SIDE + column, tile.steps[row * SIDE + column]);
            let beside = |axis: usize, is_before: bool| {
                let [place, along] = [[column, row], [row, column]].map(|places| places[axis]);
                let side = axis + if is_before { 0 } else { 2 };
                let is_on_side = if is_before { place == 0 } else { place == ends[axis] };
                match is_on_side {
                    true => borders[side].as_ref()?.beyond(tile.along(1 - axis)[along]),
                    false => tile.next(at, axis, is_before),
                }
            };
            let slopes = [0, 1].map(|axis| slope(here, beside(axis, true), beside(axis, false)));
            all[at] = painter.normal(at, slopes);
        }
    }
    for (side, border) in borders.iter().enumerate() {
        let Some(border) = border.as_ref().filter(|border| border.is_coarser) else { continue };
        let end = if is_first(side) { 0 } else { ends[axis_of(side)] };
        take_coarser(&painter, border, &borders, end, &mut all);
    }
    // Where the grid ends within the tile, all lines beyond are its last one.
    for row in 0..SIDE {
        for column in 0..SIDE {
            all[row * SIDE + column] = all[row.min(ends[1]) * SIDE + column.min(ends[0])];
        }
    }
    all
}

/// Gives the samples on a side the normals that the coarser tile across has there, and those between them what lies
/// between.
fn take_coarser(
    painter: &Painter<'_>,
    border: &Border<'_>,
    borders: &[Option<Border<'_>>; SIDES],
    end: usize,
    all: &mut [Normal; SIDE * SIDE],
) {
    let (tile, axis) = (painter.tile, border.axis);
    let places = tile.along(1 - axis);
    let number = |along: usize| if axis == 0 { along * SIDE + end } else { end * SIDE + along };
    let mut before: Option<usize> = None;
    for along in 0..=tile.last(1 - axis) {
        let Some(at) = border.at(places[along]) else { continue };
        let here = tile.steps[number(along)];
        // As the tile across sees it: its own sample, and that of this tile which is as far away.
        let own = tile.along(axis);
        let beyond = border.beyond(places[along]);
        let inside = || {
            let line = match border.is_first {
                true => own[CELLS].min(own[end] + border.spacing),
                false => own[end].checked_sub(border.spacing)?,
            };
            let place = own.binary_search(&line).ok()?;
            let at = if axis == 0 { along * SIDE + place } else { place * SIDE + along };
            Some((line.abs_diff(own[end]), tile.get(at)?))
        };
        let (first, last) = if border.is_first { (beyond, inside()) } else { (inside(), beyond) };
        let mut slopes = [0.0; 2];
        slopes[axis] = slope(here, first, last);
        let along_side = [true, false].map(|is_before| {
            let of_other = borders[1 - axis + if is_before { 0 } else { 2 }].as_ref();
            let is_end = if is_before { along == 0 } else { along == tile.last(1 - axis) };
            let of_corner = || of_other.filter(|_| is_end)?.beyond(own[end]);
            border.across.next(at, 1 - axis, is_before).or_else(of_corner)
        });
        slopes[1 - axis] = slope(here, along_side[0], along_side[1]);
        all[number(along)] = painter.normal(number(along), slopes);
        if let Some(before) = before {
            let width = (places[along] - places[before]) as f64;
            for between in before + 1..along {
                let share = (places[between] - places[before]) as f64 / width;
                let [from, to] = [before, along].map(|along| all[number(along)].map(f64::from));
                all[number(between)] = stored([0, 1, 2].map(|k| from[k] + share * (to[k] - from[k])));
            }
        }
        before = Some(along);
    }
}

/// Makes normals of slopes.
struct Painter<'a> {
    info: &'a HeightsInfo,
    tile: &'a Field<'a>,
    columns: [Line; SIDE],
    rows: [Line; SIDE],
}

impl<'a> Painter<'a> {
    fn new(info: &'a HeightsInfo, tile: &'a Field<'a>) -> Self {
        let (surface, grid) = (&info.surface, &info.grid);
        let columns = tile.lines.columns.map(|column| surface.line(0, grid.vertex(column, 1)[0]));
        Self { info, tile, columns, rows: tile.lines.rows.map(|row| surface.line(1, row)) }
    }

    /// The normal of a sample with these slopes.
    fn normal(&self, at: usize, slopes: [f64; 2]) -> Normal {
        let is_pole = Outline::new(&self.info.grid, &self.tile.lines).is_at_pole(at as u16);
        let lines = [self.columns[at % SIDE], self.rows[at / SIDE]];
        normal_at(self.info, lines, self.tile.steps[at], (!is_pole).then_some(slopes))
    }
}

/// The normal at a column and a row, from slopes in steps a column and a row. Without slopes it goes up: at a pole all
/// columns meet.
fn normal_at(info: &HeightsInfo, [column, row]: [Line; 2], steps: i32, slopes: Option<[f64; 2]>) -> Normal {
    let compass = info.surface.compass(column, row, info.height(steps));
    let rise = |axis: usize| match compass.lengths[axis] {
        0.0 => 0.0,
        length => slopes.map_or(0.0, |slopes| slopes[axis] * info.step * info.surface.height_scale / length),
    };
    let [east, north] = [rise(0), rise(1)];
    stored([0, 1, 2].map(|k| compass.up[k] - east * compass.east[k] - north * compass.north[k]))
}

/// A direction of any length, stored.
fn stored(direction: [f64; 3]) -> Normal {
    let [x, y, z] = direction;
    let length = (x * x + y * y + z * z).sqrt();
    if !(length > 0.0 && length.is_finite()) {
        return [0, 0, ONE as i16];
    }
    let scale = ONE / length;
    direction.map(|x| (x * scale).round() as i16)
}
