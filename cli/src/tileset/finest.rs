//! Tiles of the last level of terrain tiles: their vertices are the file's own samples and, along their borders, the
//! places where lines between these cross.
//!
//! Nothing is resampled, so what a tile is off is what fewer triangles and roundings to numbers of 15 bits cost, and
//! all of it is measured: at each of the file's samples, against the triangles as a decoder has them. Rounded places
//! cost next to nothing, because heights make up for them. Rounded heights cost half a step, 1/65,534 of the range of a
//! tile.

use glam::DVec3;
use lodpack::ReadAt;
use lodpack::heights::{Heights, Surface};

use super::TilesetError;
use super::quantized::{Content, LAST, Tile, degrees_of, encoded, normal_at, quantized, range_of};
use crate::heights::{Uneven, triangulate_uneven};

/// Lines at most this many spacings apart are one.
const SAME: f64 = 1e-6;

/// A column or a row of a tile.
#[derive(Clone, Copy, Debug)]
struct TileLine {
    degrees: f64,
    /// The lines of the file on both sides, and how far it is from the first to the second; none beyond the file.
    between: Option<([i64; 2], f64)>,
}

/// The lines of a tile along an axis: one beyond its border, the border, those of the file, the border, and one beyond.
struct TileLines {
    lines: Vec<TileLine>,
    /// Where they are in the tile, the first and the last one left out.
    units: Vec<i32>,
    /// The same before they are rounded.
    exact: Vec<f64>,
}

/// One axis of a file.
struct Axis {
    first: f64,
    spacing: f64,
    /// The last line.
    last: i64,
    wraps: bool,
    most: f64,
}

impl Axis {
    fn degrees(&self, line: i64) -> f64 {
        (self.first + self.spacing * line as f64).clamp(-self.most, self.most)
    }

    /// The lines of a tile from a border to the other, in the direction in which the file counts.
    fn lines(&self, [from, to]: [f64; 2]) -> TileLines {
        let number = |degrees: f64| (degrees - self.first) / self.spacing;
        let (start, end) = (number(from), number(to));
        let has = |line: i64| self.wraps || (0..=self.last).contains(&line);
        let border = |degrees: f64, at: f64| {
            let near = at.round() as i64;
            // A line of the file, which may be the pole.
            if (at - near as f64).abs() < SAME && has(near) {
                return TileLine { degrees, between: Some(([near; 2], 0.0)) };
            }
            let lines = [at.floor() as i64, at.floor() as i64 + 1];
            let [a, b] = lines.map(|line| self.degrees(line));
            let share = if a == b { 0.0 } else { ((degrees - a) / (b - a)).clamp(0.0, 1.0) };
            TileLine { degrees, between: lines.iter().any(|&line| has(line)).then_some((lines, share)) }
        };
        // What lies beside a file is flat from a spacing away from it on.
        let all = (start.floor() as i64).max(if self.wraps { i64::MIN } else { -2 })
            ..=(end.ceil() as i64).min(if self.wraps { i64::MAX } else { self.last + 2 });
        let line = |line: i64| TileLine {
            degrees: self.first + self.spacing * line as f64,
            between: has(line).then_some(([line; 2], 0.0)),
        };
        let beside = |at: i64| TileLine { degrees: self.degrees(at), ..line(at) };
        let is_within =
            |k: &i64| (*k as f64) > start + SAME && (*k as f64) < end - SAME && self.degrees(*k).abs() < self.most;
        let inner: Vec<TileLine> = all.filter(is_within).map(line).collect();
        let mut lines = vec![beside((start - SAME).ceil() as i64 - 1), border(from, start)];
        lines.extend(inner);
        lines.extend([border(to, end), beside((end + SAME).floor() as i64 + 1)]);
        let count = lines.len() as i32 - 2;
        let share = |line: &TileLine| (line.degrees - from) / (to - from) * LAST;
        let unit = |(k, line): (i32, &TileLine)| match k {
            0 => 0,
            k if k == count - 1 => LAST as i32,
            k => (share(line).round() as i32).clamp(k, LAST as i32 - (count - 1 - k)),
        };
        let units = (0..).zip(&lines[1..lines.len() - 1]).map(unit).collect();
        let exact = lines[1..lines.len() - 1].iter().map(share).collect();
        TileLines { lines, units, exact }
    }
}

/// Heights of the file around a tile.
struct Window {
    first: [i64; 2],
    size: [i64; 2],
    heights: Vec<f64>,
}

impl Window {
    /// Reads what the lines lie between.
    fn read<S: ReadAt>(file: &Heights<S>, lines: [&[TileLine]; 2]) -> lodpack::Result<Self> {
        let samples = file.grid().samples();
        let mut range = [[0i64; 2]; 2];
        for axis in 0..2 {
            let all = lines[axis].iter().filter_map(|line| line.between).flat_map(|(lines, _)| lines);
            let (low, high) = all.fold((i64::MAX, i64::MIN), |(low, high), line| (low.min(line), high.max(line)));
            let is_closed = axis == 0 && file.grid().wraps();
            let last = samples[axis] as i64 - 1;
            range[axis] = if is_closed { [low, high] } else { [low.max(0), high.min(last)] };
            if range[axis][0] > range[axis][1] {
                return Ok(Self { first: [0; 2], size: [0; 2], heights: vec![] });
            }
        }
        let start = range[0][0].rem_euclid(samples[0] as i64) as u64;
        let width = range[0][1] - range[0][0] + 1;
        let columns = start..start + width as u64;
        let heights = file.window(columns, range[1][0] as u64..range[1][1] as u64 + 1)?;
        Ok(Self { first: range.map(|[first, _]| first), size: [width, range[1][1] - range[1][0] + 1], heights })
    }

    /// The height of a sample; 0 where there is no data.
    fn at(&self, column: i64, row: i64) -> f64 {
        let [x, y] = [column - self.first[0], row - self.first[1]];
        let is_within = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        let height = if is_within { self.heights[(y * self.size[0] + x) as usize] } else { 0.0 };
        if height.is_nan() { 0.0 } else { height }
    }

    /// The height where two lines cross.
    fn between(&self, column: &TileLine, row: &TileLine) -> f64 {
        let (Some(([west, east], across)), Some(([north, south], down))) = (column.between, row.between) else {
            return 0.0;
        };
        let mix = |a: f64, b: f64, share: f64| if share == 0.0 { a } else { a + share * (b - a) };
        let along = |row: i64| mix(self.at(west, row), self.at(east, row), across);
        mix(along(north), along(south), down)
    }
}

/// Makes a tile whose triangles are no further than the tolerance from the samples of the file.
pub(super) fn finest_tile<S: ReadAt>(
    file: &Heights<S>,
    level: u32,
    [x, y]: [u64; 2],
    tolerance: f64,
) -> Result<Tile, TilesetError> {
    let (surface, cells) = (file.surface(), file.grid().cells().map(|cells| cells as i64));
    let side = degrees_of(level);
    let [west, east] = [x, x + 1].map(|x| -180.0 + side * x as f64);
    let [south, north] = [y, y + 1].map(|y| -90.0 + side * y as f64);
    let axis = |axis: usize, wraps: bool, most: f64| Axis {
        first: surface.first[axis],
        spacing: surface.spacing[axis],
        last: cells[axis],
        wraps,
        most,
    };
    let [across, down] = [axis(0, file.grid().wraps(), f64::INFINITY), axis(1, false, 90.0)];
    // The turn of the globe at which the tile has most of the file.
    let end = across.first + across.spacing * across.last as f64;
    let common = |turn: f64| (east + turn).min(end) - (west + turn).max(across.first);
    let turn =
        [0.0, 360.0, -360.0].into_iter().fold(0.0, |best, turn| if common(turn) > common(best) { turn } else { best });
    let mut columns = across.lines([west + turn, east + turn]);
    columns.lines.iter_mut().for_each(|line| line.degrees -= turn);
    let rows = down.lines([north, south]);
    let window = Window::read(file, [&columns.lines, &rows.lines])?;

    let at = |column: &TileLine, row: &TileLine, height: f64| {
        let latitude = row.degrees.clamp(-90.0, 90.0);
        let here = Surface { first: [column.degrees, latitude], ..*surface };
        DVec3::from_array(here.position(here.line(0, 0), here.line(1, 0), height / surface.height_scale))
    };
    let width = columns.lines.len();
    let heights: Vec<f64> = rows
        .lines
        .iter()
        .flat_map(|row| {
            columns.lines.iter().map(|column| window.between(column, row) * surface.height_scale).collect::<Vec<_>>()
        })
        .collect();
    let index = |column: usize, row: usize| row * width + column;
    let place = |column: usize, row: usize| at(&columns.lines[column], &rows.lines[row], heights[index(column, row)]);
    let inner = |f: &dyn Fn(usize, usize) -> DVec3| -> Vec<DVec3> {
        (1..rows.lines.len() - 1).flat_map(|row| (1..width - 1).map(move |column| f(column, row))).collect()
    };
    let unit = |column: usize, row: usize| [columns.units[column], LAST as i32 - rows.units[row]];
    // Where a decoder has a vertex with a height.
    let draw = |[column, row]: [usize; 2], height: f64| {
        let [u, v] = unit(column, row).map(|unit| f64::from(unit) / LAST);
        let line = |degrees: f64| TileLine { degrees, between: None };
        at(&line(west + u * side), &line(south + v * side), height)
    };
    let places = inner(&place);
    let exact = [&columns.exact[..], &rows.exact];
    let samples = Uneven { columns: &columns.units, rows: &rows.units, exact, places: &places };
    let patch = triangulate_uneven(&samples, tolerance);
    let own = patch.vertices.iter().map(|&[column, row]| heights[index(column + 1, row + 1)]).collect();
    let fitted = patch.fitted(&samples, own, draw);
    let range = range_of(&fitted);
    let steps: Vec<i32> = fitted.iter().map(|&height| quantized(height, range)).collect();
    let kept = |step: i32| range[0] + f64::from(step) / LAST * (range[1] - range[0]);
    let drawn: Vec<DVec3> =
        patch.vertices.iter().zip(&steps).map(|(&vertex, &step)| draw(vertex, kept(step))).collect();
    let error = patch.error(&samples, &drawn) + file.info().sample_error * surface.height_scale;

    let normal = |&[column, row]: &[usize; 2]| {
        let (column, row) = (column + 1, row + 1);
        let to_east = place(column + 1, row) - place(column - 1, row);
        let to_south = place(column, row + 1) - place(column, row - 1);
        normal_at(place(column, row), to_east, to_south)
    };
    let vertex = |(&[column, row], &step): (&[usize; 2], &i32)| {
        let [u, v] = unit(column, row);
        [u, v, step]
    };
    let content = Content {
        vertices: patch.vertices.iter().zip(&steps).map(vertex).collect(),
        range,
        places: drawn,
        normals: patch.vertices.iter().map(normal).collect(),
        triangles: patch.triangles,
    };
    let triangles = content.triangles.len() as u64;
    Ok(Tile { bytes: encoded(content), triangles, error })
}
