//! Files of heights as a pyramid of terrain tiles for Cesium: quantized-mesh 1.0 in the geographic scheme of TMS, and a
//! `layer.json`.
//!
//! Level z divides the globe into 2^(z+1) x 2^z squares of degrees. Cesium takes a tile of level 0 to be 77 km off, and
//! half as much at each further level, and knows no other error. So each tile gets as many triangles as a quarter of
//! that asks for, measured in space at 65 x 65 samples that lie between those of the file, at the depth where these are
//! as close. Vertices of the last level are the file's samples themselves (`finest`). Vertices on the border of a tile
//! depend on the samples there alone: neighbours of a level have the same ones. Where levels differ, Cesium draws
//! skirts. Nothing has a hole: what has no data lies on the ellipsoid.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use lodpack::ReadAt;
use lodpack::heights::{Base, CELLS, Heights, SIDE, Surface, TileId, TileValues};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

use super::finest::finest_tile;
use super::geodesy::A;
use super::{TilesetError, write};
use crate::heights::triangulate_patch;
use crate::progress::Progress;

/// The file that leads to all tiles.
pub const LAYER: &str = "layer.json";
/// Metres that Cesium takes a tile of level 0 to be off: a quarter of the distance of 65 samples in each of two tiles
/// around the equator.
const LEVEL_ZERO_ERROR: f64 = A * std::f64::consts::TAU * 0.25 / (65.0 * 2.0);
/// The share of that which a tile may be off. Cesium draws tiles that are two pixels off, so this is half a pixel.
const TOLERANCE_SHARE: f64 = 0.25;
/// The share of the error of the file's samples that fewer triangles may add to it at the last level.
const SAMPLE_SHARE: f64 = 0.02;
/// Cells along the side of a tile.
const TILE_CELLS: usize = 64;
const TILE_SIDE: usize = TILE_CELLS + 1;
/// Samples of the last level are at most this many times as far apart as those of the file: half of a step between
/// levels.
const NEARLY_AS_CLOSE: f64 = std::f64::consts::SQRT_2;
/// Cells of the file in a tile of the last level at most, so that the numbers of its vertices have 16 bits.
const MOST_CELLS: usize = 250;
/// Samples beside the tile, for its normals.
const MARGIN_SIDE: usize = TILE_SIDE + 2;
/// Positions within a tile are from 0 to this.
pub(super) const LAST: f64 = 32_767.0;
/// The largest equatorial and the polar radius of WGS 84.
const RADII: [f64; 3] = [A, A, 6_356_752.314_245_179];
/// Cesium numbers tiles with 32 bits.
const MAX_LEVEL: u32 = 28;
/// A point this many radii away is never behind the horizon.
const NEVER_HIDDEN: f64 = 1e3;
/// Normals of vertices follow triangles.
const NORMALS: u8 = 1;

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct QuantizedSummary {
    /// Levels, from 0.
    pub levels: u32,
    /// Tiles of all levels.
    pub tiles: u64,
    /// Triangles of all tiles.
    pub triangles: u64,
    /// Triangles of the finest level.
    pub finest_triangles: u64,
    /// No sample that the file was made from is further from the triangles of the finest level, as they are written, in
    /// metres.
    pub finest_error: f64,
    /// Of all files.
    pub bytes: u64,
}

/// A file that is written.
struct Pyramid<'a, S> {
    file: &'a Heights<S>,
    /// From the first to the last column, and from the last to the first row, in degrees.
    reach: [[f64; 2]; 2],
    /// The last level, and how far its triangles may be off.
    last: (u32, f64),
}

/// Whether a file lies on the ellipsoid of WGS 84, which Cesium's globe is.
pub fn is_on_wgs84(surface: &Surface) -> bool {
    matches!(surface.base, Base::Ellipsoid { axis, eccentricity } if axis == RADII[0] && eccentricity > 0.0)
}

/// Writes a file on the ellipsoid of WGS 84 as terrain tiles into a folder, which exists and is empty. No level is
/// finer than the file's samples, or than the first one that reaches `tolerance`, in metres.
///
/// # Errors
/// [`TilesetError`].
pub fn write_quantized<S: ReadAt + Sync>(
    file: &Heights<S>,
    folder: &Path,
    tolerance: Option<f64>,
    progress: &dyn Progress,
) -> Result<QuantizedSummary, TilesetError> {
    if file.roots().is_empty() {
        return Err(TilesetError::Empty);
    }
    let (surface, cells) = (file.surface(), file.grid().cells());
    let end = |axis: usize| surface.first[axis] + surface.spacing[axis] * cells[axis] as f64;
    let pole = |latitude: f64| latitude.clamp(-90.0, 90.0);
    let reach = [[surface.first[0], end(0)], [pole(end(1)), pole(surface.first[1])]];
    let spacing = surface.spacing[0].min(-surface.spacing[1]);
    let is_fine = |level: u32| degrees_of(level) / TILE_CELLS as f64 <= NEARLY_AS_CLOSE * spacing;
    let is_enough = |level: u32| {
        tolerance.is_some_and(|tolerance| tolerance_of(level) <= tolerance)
            && degrees_of(level) <= MOST_CELLS as f64 * spacing
    };
    let last = (0..MAX_LEVEL).find(|&level| is_fine(level) || is_enough(level)).unwrap_or(MAX_LEVEL);
    // Nothing is finer than the last level, so it is as fine as the file, or as is asked for.
    let sample_error = file.info().sample_error * surface.height_scale;
    let least = (tolerance.unwrap_or(0.0) - sample_error).max(SAMPLE_SHARE * sample_error);
    let pyramid = Pyramid { file, reach, last: (last, tolerance_of(last).min(least)) };
    let levels: Vec<Vec<[[u64; 2]; 2]>> = (0..=last).map(|level| pyramid.tiles(level)).collect();
    let count = |ranges: &Vec<[[u64; 2]; 2]>| -> u64 {
        ranges.iter().map(|range| range.iter().map(|[from, to]| to - from + 1).product::<u64>()).sum()
    };
    progress.begin("tiles", levels.iter().map(count).sum());
    let mut summary = QuantizedSummary { levels: last + 1, ..QuantizedSummary::default() };
    for (level, ranges) in (0..).zip(&levels) {
        let columns = ranges.iter().flat_map(|[[west, east], rows]| (*west..=*east).map(move |x| (x, *rows)));
        let columns: Vec<(u64, [u64; 2])> = columns.collect();
        let of_column = |&(x, [south, north]): &(u64, [u64; 2])| -> Result<QuantizedSummary, TilesetError> {
            let mut done = QuantizedSummary::default();
            for y in south..=north {
                let tile = pyramid.tile(level, [x, y])?;
                write(folder, &format!("{level}/{x}/{y}.terrain"), &tile.bytes)?;
                done.tiles += 1;
                done.triangles += tile.triangles;
                done.bytes += tile.bytes.len() as u64;
                done.finest_error = done.finest_error.max(tile.error);
                progress.advance(1);
            }
            Ok(done)
        };
        let done: Vec<QuantizedSummary> = columns.par_iter().map(of_column).collect::<Result<_, _>>()?;
        (summary.finest_triangles, summary.finest_error) = (0, 0.0);
        for column in done {
            summary.tiles += column.tiles;
            summary.triangles += column.triangles;
            summary.finest_triangles += column.triangles;
            summary.finest_error = summary.finest_error.max(column.finest_error);
            summary.bytes += column.bytes;
        }
    }
    let layer = layer(&pyramid, &levels);
    write(folder, LAYER, layer.as_bytes())?;
    summary.bytes += layer.len() as u64;
    Ok(summary)
}

/// What Cesium reads first.
fn layer<S: ReadAt>(pyramid: &Pyramid<'_, S>, levels: &[Vec<[[u64; 2]; 2]>]) -> String {
    let range = |[[west, east], [south, north]]: &[[u64; 2]; 2]| json!({ "startX": west, "startY": south, "endX": east, "endY": north });
    let available: Vec<Vec<_>> = levels.iter().map(|ranges| ranges.iter().map(range).collect()).collect();
    let [[west, east], [south, north]] = pyramid.reach;
    let bounds = if east > 180.0 { [-180.0, south, 180.0, north] } else { [west, south, east, north] };
    let text = json!({
        "tilejson": "2.1.0",
        "name": "terrain",
        "version": "1.0.0",
        "format": "quantized-mesh-1.0",
        "scheme": "tms",
        "projection": "EPSG:4326",
        "extensions": ["octvertexnormals"],
        "tiles": ["{z}/{x}/{y}.terrain"],
        "minzoom": 0,
        "maxzoom": levels.len() - 1,
        "bounds": bounds,
        "available": available,
    });
    format!("{text:#}\n")
}

/// The side of a tile in degrees.
pub(super) fn degrees_of(level: u32) -> f64 {
    180.0 / (1u64 << level) as f64
}

/// The normal at a place, with the ways to the samples east of those west of it, and south of those north of it.
pub(super) fn normal_at(here: DVec3, east: DVec3, south: DVec3) -> DVec3 {
    let out = south.cross(east).normalize_or_zero();
    // At a pole all columns are one place.
    if east.length_squared() < 1e-6 || out.dot(here) <= 0.0 { here.normalize_or_zero() } else { out }
}

/// Metres that Cesium takes the tiles of a level to be off.
pub(super) fn level_error(level: u32) -> f64 {
    LEVEL_ZERO_ERROR / (1u64 << level) as f64
}

/// How far triangles of a tile may be off, in metres.
fn tolerance_of(level: u32) -> f64 {
    TOLERANCE_SHARE * level_error(level)
}

/// A tile as it is written.
pub(super) struct Tile {
    pub bytes: Vec<u8>,
    pub triangles: u64,
    /// Of the finest level: no sample that the heights were made from is further off, in metres.
    pub error: f64,
}

impl<S: ReadAt> Pyramid<'_, S> {
    /// The tiles of a level that lie where the grid does, as ranges of columns and rows; both tiles of level 0.
    fn tiles(&self, level: u32) -> Vec<[[u64; 2]; 2]> {
        let side = degrees_of(level);
        let columns = 2u64 << level;
        let [[west, east], [south, north]] = self.reach;
        let numbers = |from: f64, to: f64, count: u64| {
            let (first, last) = ((from / side).floor().max(0.0) as u64, (to / side).ceil() as u64);
            [first.min(count - 1), last.saturating_sub(1).clamp(first.min(count - 1), count - 1)]
        };
        let rows = numbers(south + 90.0, north + 90.0, 1 << level);
        if level == 0 || self.file.grid().wraps() || east - west >= 360.0 {
            return vec![[[0, columns - 1], rows]];
        }
        let start = (west + 180.0).rem_euclid(360.0);
        let end = start + (east - west);
        match end > 360.0 {
            true => vec![[numbers(0.0, end - 360.0, columns), rows], [numbers(start, 360.0, columns), rows]],
            false => vec![[numbers(start, end, columns), rows]],
        }
    }

    fn tile(&self, level: u32, [x, y]: [u64; 2]) -> Result<Tile, TilesetError> {
        if level == self.last.0 {
            return finest_tile(self.file, level, [x, y], self.last.1);
        }
        let side = degrees_of(level);
        let (west, north) = (-180.0 + side * x as f64, -90.0 + side * (y + 1) as f64);
        let step = side / TILE_CELLS as f64;
        let surface = Surface { first: [west, north], spacing: [step, -step], ..*self.file.surface() };
        // With a line more on each side.
        let mut sampler = Sampler::new(self.file, step);
        let mut wide = Vec::with_capacity(MARGIN_SIDE * MARGIN_SIDE);
        let places = |axis: usize, k: usize| surface.first[axis] + surface.spacing[axis] * (k as f64 - 1.0);
        let columns: Vec<Option<Between>> = (0..MARGIN_SIDE).map(|k| sampler.column(places(0, k))).collect();
        for row in 0..MARGIN_SIDE {
            let row = sampler.row(places(1, row).clamp(-90.0, 90.0));
            for column in &columns {
                let height = match (column, &row) {
                    (Some(column), Some(row)) => sampler.height(column, row)?,
                    _ => None,
                };
                wide.push(height.unwrap_or(0.0) * surface.height_scale);
            }
        }
        let inner = |at: usize| wide[(at / TILE_SIDE + 1) * MARGIN_SIDE + at % TILE_SIDE + 1];
        let heights: Vec<f64> = (0..TILE_SIDE * TILE_SIDE).map(inner).collect();
        let patch = triangulate_patch(&surface, TILE_SIDE, heights.clone(), tolerance_of(level));
        let in_space = |column: i32, row: i32| {
            let [longitude, latitude] = [(0, column), (1, row)].map(|(axis, k)| places(axis, (k + 1) as usize));
            let at = Surface { first: [longitude, latitude.clamp(-90.0, 90.0)], ..surface };
            let height = wide[(row + 1) as usize * MARGIN_SIDE + (column + 1) as usize] / surface.height_scale;
            DVec3::from_array(at.position(at.line(0, 0), at.line(1, 0), height))
        };
        let normal = |&[column, row]: &[i32; 2]| {
            let east = in_space(column + 1, row) - in_space(column - 1, row);
            let south = in_space(column, row + 1) - in_space(column, row - 1);
            normal_at(in_space(column, row), east, south)
        };
        let normals = patch.vertices.iter().map(normal).collect();
        let triangles = patch.triangles.len() as u64;
        let range = range_of(&heights);
        let units = |k: i32| (f64::from(k) * LAST / TILE_CELLS as f64).round() as i32;
        let vertex = |&[column, row]: &[i32; 2]| {
            let height = heights[row as usize * TILE_SIDE + column as usize];
            [units(column), LAST as i32 - units(row), quantized(height, range)]
        };
        let vertices = patch.vertices.iter().map(vertex).collect();
        let places = patch.vertices.iter().map(|&[column, row]| in_space(column, row)).collect();
        let bytes = encoded(Content { vertices, triangles: patch.triangles, range, places, normals });
        Ok(Tile { bytes, triangles, error: 0.0 })
    }
}

/// The lowest and the highest height, as numbers of single precision around all of them.
pub(super) fn range_of(heights: &[f64]) -> [f64; 2] {
    let [low, high] = heights.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &h| [a.min(h), b.max(h)]);
    let below = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    [f64::from(below(low)), -f64::from(below(-high))]
}

/// A height in steps of the range.
pub(super) fn quantized(height: f64, [low, high]: [f64; 2]) -> i32 {
    if high > low { ((height - low) / (high - low) * LAST).round() as i32 } else { 0 }
}

/// Two lines of a file's tiles, and how far a place is from the first to the second.
struct Between {
    lines: [u64; 2],
    share: f64,
}

/// Reads heights between samples.
struct Sampler<'a, S> {
    file: &'a Heights<S>,
    /// Where samples are as close as those that are asked for.
    depth: u32,
    tiles: HashMap<TileId, Option<Arc<TileValues>>>,
}

impl<'a, S: ReadAt> Sampler<'a, S> {
    /// A sampler for places that are `step` degrees apart.
    fn new(file: &'a Heights<S>, step: f64) -> Self {
        let (grid, surface) = (file.grid(), file.surface());
        let spacing = surface.spacing[0].max(-surface.spacing[1]);
        let is_close = |depth: &u32| spacing * (1u64 << (grid.depth() - depth)) as f64 <= step * (1.0 + 1e-9);
        Self { file, depth: (0..=grid.depth()).find(is_close).unwrap_or(grid.depth()), tiles: HashMap::new() }
    }

    /// The index lines on both sides of a line of samples. `place` says where a line is.
    fn between(&self, axis: usize, line: f64, place: impl Fn(u64) -> f64, at: f64) -> Between {
        let grid = self.file.grid();
        let stride = 1u64 << (grid.depth() - self.depth);
        let first = (line.max(0.0) as u64).min(grid.cells()[axis] - 1) / stride;
        let [from, to] = [first, first + 1].map(|index| place(grid.line(axis, self.depth, index)));
        let share = if to == from { 0.0 } else { ((at - from) / (to - from)).clamp(0.0, 1.0) };
        Between { lines: [first, first + 1], share }
    }

    fn column(&self, longitude: f64) -> Option<Between> {
        let (surface, cells) = (self.file.surface(), self.file.grid().cells()[0] as f64);
        let turn = if self.file.grid().wraps() { cells } else { 360.0 / surface.spacing[0] };
        let line = ((longitude - surface.first[0]) / surface.spacing[0]).rem_euclid(turn);
        // What rounding has moved to the end of a turn.
        let line = if turn - line < 1e-9 { 0.0 } else { line };
        (line <= cells + 1e-9).then(|| self.between(0, line, |line| line as f64, line))
    }

    fn row(&self, latitude: f64) -> Option<Between> {
        let (surface, cells) = (self.file.surface(), self.file.grid().cells()[1] as f64);
        let line = (latitude - surface.first[1]) / surface.spacing[1];
        let place = |row: u64| (surface.first[1] + surface.spacing[1] * row as f64).clamp(-90.0, 90.0);
        (-1e-9..=cells + 1e-9).contains(&line).then(|| self.between(1, line, place, latitude))
    }

    /// The height of a place; none where there is no data.
    fn height(&mut self, column: &Between, row: &Between) -> lodpack::Result<Option<f64>> {
        let [x, y] = [column.lines[0], row.lines[0]].map(|line| line as usize % CELLS);
        let [tile_column, tile_row] = [column.lines[0], row.lines[0]].map(|line| line / CELLS as u64);
        let id = TileId { depth: self.depth, column: tile_column, row: tile_row };
        let tile = match self.tiles.get(&id) {
            Some(tile) => tile.clone(),
            None => {
                let tile = if self.file.grid().has(id) { self.file.tile(id)? } else { None };
                self.tiles.insert(id, tile.clone());
                tile
            }
        };
        let Some(tile) = tile else { return Ok(None) };
        if tile.cells.as_ref().is_some_and(|cells| cells[y] >> x & 1 == 0) {
            return Ok(None);
        }
        let at = |dx: usize, dy: usize| self.file.info().height(tile.steps[(y + dy) * SIDE + x + dx]);
        let mix = |a: f64, b: f64, share: f64| a + share * (b - a);
        let [north, south] = [0, 1].map(|dy| mix(at(0, dy), at(1, dy), column.share));
        Ok(Some(mix(north, south, row.share)))
    }
}

/// What a tile holds.
pub(super) struct Content {
    /// To the east, to the north and up, in numbers of 15 bits.
    pub vertices: Vec<[i32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// In metres.
    pub range: [f64; 2],
    /// Of the vertices, from the middle of the earth.
    pub places: Vec<DVec3>,
    pub normals: Vec<DVec3>,
}

/// The bytes of a tile.
pub(super) fn encoded(content: Content) -> Vec<u8> {
    // Near triangles follow each other, and vertices come in the order in which triangles need them.
    let key = |triangle: &[u32; 3]| {
        let corners = triangle.map(|corner| content.vertices[corner as usize]);
        let middle = [0, 1].map(|axis| (corners.iter().map(|corner| corner[axis]).sum::<i32>() as u32 / 3) >> 7);
        (0..8)
            .fold(0u32, |key, bit| key | (middle[0] >> bit & 1) << (2 * bit) | (middle[1] >> bit & 1) << (2 * bit + 1))
    };
    let mut triangles = content.triangles.clone();
    triangles.sort_by_key(key);
    let mut numbers = vec![u32::MAX; content.vertices.len()];
    let mut order: Vec<usize> = vec![];
    let mut codes: Vec<u32> = vec![];
    for corner in triangles.iter().flatten().map(|&corner| corner as usize) {
        let highest = order.len() as u32;
        if numbers[corner] == u32::MAX {
            numbers[corner] = highest;
            order.push(corner);
            codes.push(0);
        } else {
            codes.push(highest - numbers[corner]);
        }
    }
    let mut out = header(&content);
    out.extend((order.len() as u32).to_le_bytes());
    for axis in 0..3 {
        let mut before = 0;
        for &vertex in &order {
            let now = content.vertices[vertex][axis];
            let delta = now - before;
            out.extend((((delta << 1) ^ (delta >> 31)) as u16).to_le_bytes());
            before = now;
        }
    }
    // A tile has at most 2^16 vertices, so all numbers have 16 bits.
    let put = |out: &mut Vec<u8>, numbers: &mut dyn Iterator<Item = u32>| {
        numbers.for_each(|number| out.extend((number as u16).to_le_bytes()));
    };
    out.extend((triangles.len() as u32).to_le_bytes());
    put(&mut out, &mut codes.into_iter());
    let last = LAST as i32;
    // West, south, east, north.
    for (axis, line) in [(0, 0), (1, 0), (0, last), (1, last)] {
        let mut edge: Vec<(i32, u32)> = (0..)
            .zip(&order)
            .map(|(number, &vertex)| (content.vertices[vertex], number))
            .filter(|(vertex, _)| vertex[axis] == line)
            .map(|(vertex, number)| (vertex[1 - axis], number))
            .collect();
        edge.sort_unstable();
        out.extend((edge.len() as u32).to_le_bytes());
        put(&mut out, &mut edge.into_iter().map(|(_, number)| number));
    }
    out.push(NORMALS);
    out.extend((2 * order.len() as u32).to_le_bytes());
    order.iter().for_each(|&vertex| out.extend(oct_encoded(content.normals[vertex])));
    out
}

/// The first 88 bytes: the middle, the range of heights, a ball around everything, and a point that is behind the
/// horizon where everything is.
fn header(content: &Content) -> Vec<u8> {
    let (low, high) = content
        .places
        .iter()
        .fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(low, high), &place| {
            (low.min(place), high.max(place))
        });
    let middle = 0.5 * (low + high);
    // Vertices are moved by rounding.
    let radius = 1.0001 * content.places.iter().map(|place| place.distance(middle)).fold(0.0, f64::max) + 1.0;
    let mut out = vec![];
    let put = |out: &mut Vec<u8>, place: DVec3| place.to_array().iter().for_each(|x| out.extend(x.to_le_bytes()));
    put(&mut out, middle);
    content.range.iter().for_each(|&height| out.extend((height as f32).to_le_bytes()));
    put(&mut out, middle);
    out.extend(radius.to_le_bytes());
    put(&mut out, occluder(middle, &content.places));
    out
}

/// The nearest point above the middle, in radii of the ellipsoid, that no camera sees over the horizon unless it sees
/// one of the places.
fn occluder(middle: DVec3, places: &[DVec3]) -> DVec3 {
    let scaled = |place: DVec3| place / DVec3::from_array(RADII);
    let towards = scaled(middle).normalize_or_zero();
    let distance = |place: &DVec3| {
        let place = scaled(*place);
        let (length, direction) = (place.length().max(1.0), place.normalize_or_zero());
        let (cos_alpha, sin_alpha) = (direction.dot(towards), direction.cross(towards).length());
        let cos_beta = 1.0 / length;
        let sin_beta = (length * length - 1.0).max(0.0).sqrt() * cos_beta;
        let along = cos_alpha * cos_beta - sin_alpha * sin_beta;
        // Beyond a quarter of the globe there is no such point.
        if along > 1.0 / NEVER_HIDDEN { 1.0 / along } else { NEVER_HIDDEN }
    };
    towards * places.iter().map(distance).fold(1.0, f64::max)
}

/// A direction as a point of an octahedron, in two bytes.
fn oct_encoded(normal: DVec3) -> [u8; 2] {
    let sum = normal.x.abs() + normal.y.abs() + normal.z.abs();
    let (x, y) = if sum > 0.0 { (normal.x / sum, normal.y / sum) } else { (0.0, 0.0) };
    let (x, y) = match normal.z < 0.0 {
        true => ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)),
        false => (x, y),
    };
    [x, y].map(|value| ((value * 0.5 + 0.5).clamp(0.0, 1.0) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cesium_takes_level_0_to_be_77_kilometres_off() {
        assert!((LEVEL_ZERO_ERROR - 77_067.339).abs() < 1e-2, "{LEVEL_ZERO_ERROR}");
    }

    #[test]
    fn a_camera_that_sees_a_place_sees_the_occluder() {
        let at = |longitude: f64, latitude: f64, height: f64| {
            let [[sin_l, cos_l], [sin_b, cos_b]] =
                [longitude, latitude].map(|angle: f64| [angle.to_radians().sin(), angle.to_radians().cos()]);
            let out = DVec3::new(cos_b * cos_l, cos_b * sin_l, sin_b);
            out * (DVec3::from_array(RADII) + DVec3::splat(height))
        };
        let places: Vec<DVec3> =
            (0..25).map(|k| at(f64::from(k % 5), f64::from(k / 5), 1000.0 * f64::from(k % 7))).collect();
        let middle = places.iter().sum::<DVec3>() / 25.0;
        let point = occluder(middle, &places);
        // In space where the ellipsoid is a ball of radius 1, a point is hidden behind the cone from the camera around
        // it.
        let is_hidden = |camera: DVec3, point: DVec3| {
            let (to, tangent) = (point - camera, camera.length_squared() - 1.0);
            let along = -to.dot(camera);
            along > tangent && along * along / to.length_squared() > tangent
        };
        for k in 0..2000 {
            let camera =
                at(f64::from(k % 50) * 3.6, f64::from(k / 50) * 4.0 - 80.0, 1e4 * f64::from(1 + k % 13).powi(3));
            let camera = camera / DVec3::from_array(RADII);
            let sees_one = places.iter().any(|&place| !is_hidden(camera, place / DVec3::from_array(RADII)));
            assert!(!(sees_one && is_hidden(camera, point)), "{camera:?}");
        }
    }

    #[test]
    fn directions_come_back_from_two_bytes() {
        for k in 0..500 {
            let angle = f64::from(k) * 0.7;
            let normal = DVec3::new(angle.sin(), (angle * 1.3).cos(), (angle * 0.37).sin()).normalize();
            let [x, y] = oct_encoded(normal).map(|byte| f64::from(byte) / 255.0 * 2.0 - 1.0);
            let z = 1.0 - x.abs() - y.abs();
            let (x, y) = if z < 0.0 { ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)) } else { (x, y) };
            assert!(DVec3::new(x, y, z).normalize().dot(normal) > 0.9998, "{normal:?}");
        }
    }
}
