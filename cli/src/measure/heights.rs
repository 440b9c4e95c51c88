//! Checks of files of heights: whether everything can be read, whether cuts are closed, and whether rasters are as
//! close as is stored.

use std::fmt::Write;

use lodpack::ReadAt;
use lodpack::heights::{CELLS, Heights, HeightsCut, HeightsMesh, HeightsQuery, TileId};
use serde::Serialize;

use super::closed;
use super::random::Random;
use crate::import::ImportError;
use crate::import::raster::HeightSource;
use crate::progress::Progress;

/// The most problems of one kind that are named.
const MAX_NAMED: usize = 5;
/// The most tiles that are decoded although the file does not have them, because they follow from level ones.
const MOST_LEVEL_DECODED: u64 = 4096;
/// A share that two ways of computing a distance may differ by.
const ROUNDING: f64 = 1e-7;
/// Coordinates are sums of a few products, each rounded.
const ROUNDING_OF_PLACES: f64 = 1e-14;

/// What to check.
#[derive(Clone, Copy, Debug)]
pub struct HeightsChecks {
    /// Cuts whose meshes are made.
    pub cuts: u32,
    /// Where the choice of cuts begins.
    pub seed: u64,
}

/// What was found.
#[derive(Debug, Default, Serialize)]
pub struct HeightsReport {
    /// Tiles that were decoded.
    pub tiles: u64,
    /// Those of them that the file does not have, because they follow from level ones.
    pub level_tiles: u64,
    /// Cuts whose meshes were made.
    pub cuts: u32,
    /// The largest distance of a height of the rasters from that in the file; none without rasters.
    pub sample_distance: Option<f64>,
    /// The largest share of its error that a tile of a cut has been seen to be off; none without rasters.
    pub largest_share: Option<f64>,
    /// The median of these shares over all cuts' tiles.
    pub median_share: Option<f64>,
    /// What is wrong.
    pub problems: Vec<String>,
}

impl HeightsReport {
    fn complain(&mut self, kind: &str, what: String) {
        let known = self.problems.iter().filter(|problem| problem.starts_with(kind)).count();
        if known < MAX_NAMED {
            self.problems.push(format!("{kind}{what}"));
        }
    }
}

/// Checks a file, and compares it with the rasters that it was made from, if there are any.
///
/// # Errors
/// If a raster cannot be read. What is wrong with the file is in the report.
pub fn verify<S: ReadAt>(
    file: &Heights<S>,
    against: Option<&HeightSource>,
    checks: HeightsChecks,
    progress: &dyn Progress,
) -> Result<HeightsReport, ImportError> {
    let mut report = HeightsReport::default();
    progress.begin("read", 0);
    for &root in file.roots() {
        walk(file, root, false, &mut report);
    }
    if let Err(error) = file.verify_drape() {
        report.complain("image: ", error.to_string());
    }
    let known = match against {
        Some(source) => heights_of(file, source, &mut report)?,
        None => None,
    };
    progress.begin("cuts", checks.cuts.into());
    let mut random = Random(checks.seed);
    let mut shares = vec![];
    for _ in 0..checks.cuts {
        let query = some_query(file, &mut random);
        let checked = file.cut(&query).and_then(|cut| Ok((file.mesh(&cut)?, cut)));
        match checked {
            Err(error) => report.complain("cut: ", format!("{}: {error}", words(&query))),
            Ok((mesh, cut)) => {
                report.cuts += 1;
                match closed::fault(file, &cut, &mesh) {
                    Ok(None) => {}
                    Ok(Some(fault)) => report.complain("mesh: ", format!("{fault}, in {}", words(&query))),
                    Err(error) => report.complain("cut: ", format!("{}: {error}", words(&query))),
                }
                if let Some(known) = &known {
                    shares.extend(check_errors(file, known, (&query, &cut, &mesh), &mut report));
                }
            }
        }
        progress.advance(1);
    }
    if !shares.is_empty() {
        shares.sort_unstable_by(f64::total_cmp);
        report.largest_share = shares.last().copied();
        report.median_share = shares.get(shares.len() / 2).copied();
    }
    Ok(report)
}

/// Decodes a tile and all below. `follows` says that it is below a level one.
fn walk<S: ReadAt>(file: &Heights<S>, id: TileId, follows: bool, report: &mut HeightsReport) {
    if follows && report.level_tiles == MOST_LEVEL_DECODED {
        return;
    }
    let name = format!("{}/{}/{}", id.depth, id.column, id.row);
    let read = file.record(id).and_then(|record| Ok((record, file.tile(id)?)));
    let (record, tile) = match read {
        Ok((Some(record), Some(tile))) => (record, tile),
        Ok(_) => return report.complain("tile ", format!("{name} is missing")),
        Err(error) => return report.complain("tile ", format!("{name}: {error}")),
    };
    report.tiles += 1;
    report.level_tiles += u64::from(follows);
    let drawn = file.draw(id, &tile, f64::INFINITY);
    for resolution in &record.resolutions {
        let (mut count, mut range) = (0, [i32::MAX, i32::MIN]);
        drawn.for_each_triangle(resolution.tolerance, |triangle| {
            count += 1;
            for at in triangle {
                let step = tile.steps[usize::from(at)];
                range = [range[0].min(step), range[1].max(step)];
            }
        });
        if count != resolution.triangle_count {
            let stored = resolution.triangle_count;
            report.complain("tile ", format!("{name} has {count} triangles, and {stored} are stored"));
        }
        if count > 0 && (range[0] < record.lowest || range[1] > record.highest) {
            report.complain("tile ", format!("{name} has heights outside of those stored"));
        }
    }
    record.child_tiles().for_each(|child| walk(file, child, record.is_level, report));
}

/// Heights of rasters.
struct Known {
    rows: Vec<Vec<f64>>,
    wraps: bool,
}

impl Known {
    /// A height. Columns beyond the last one are around the globe.
    fn at(&self, column: i64, row: i64) -> Option<f64> {
        let row = self.rows.get(usize::try_from(row).ok()?)?;
        let column = if self.wraps { column.rem_euclid(row.len() as i64) } else { column };
        row.get(usize::try_from(column).ok()?).copied()
    }

    /// Whether one of the four cells around a sample has all of its heights.
    fn is_drawn(&self, column: i64, row: i64) -> bool {
        let has = |column: i64, row: i64| self.at(column, row).is_some_and(|height| !height.is_nan());
        [(0, 0), (1, 0), (0, 1), (1, 1)].into_iter().any(|(x, y)| {
            let (west, north) = (column - x, row - y);
            has(west, north) && has(west + 1, north) && has(west, north + 1) && has(west + 1, north + 1)
        })
    }
}

/// All heights of the rasters, which are compared with those in the file; none if they do not belong together.
fn heights_of<S: ReadAt>(
    file: &Heights<S>,
    source: &HeightSource,
    report: &mut HeightsReport,
) -> Result<Option<Known>, ImportError> {
    let (grid, surface) = (file.grid(), file.surface());
    if source.grid != *grid || source.surface != *surface {
        let [[columns, rows], [of_columns, of_rows]] = [source.grid.samples(), grid.samples()];
        let what = format!(
            "they have {columns} x {rows} samples, and the file {of_columns} x {of_rows}, or they lie in another place or on another surface"
        );
        report.complain("rasters: ", what);
        return Ok(None);
    }
    let mut all = Known { rows: vec![], wraps: grid.wraps() };
    source.for_each_row::<ImportError>(|_, heights| {
        all.rows.push(heights.to_vec());
        Ok(())
    })?;
    let [columns, rows] = grid.samples();
    let bound = file.info().sample_error * (1.0 + ROUNDING);
    let mut most = 0.0f64;
    // Tiles are decoded for a whole strip at once.
    for first in (0..rows).step_by(CELLS) {
        let last = (first + CELLS as u64).min(rows);
        let stored = match file.window(0..columns, first..last) {
            Ok(stored) => stored,
            Err(error) => {
                report.complain("rows ", format!("{first} to {last}: {error}"));
                continue;
            }
        };
        for (number, stored) in stored.into_iter().enumerate() {
            let (column, row) = (number as u64 % columns, first + number as u64 / columns);
            let (column, row) = (column as i64, row as i64);
            let height = all.at(column, row).unwrap_or(f64::NAN);
            let off = (stored - height).abs();
            let is_wrong = match (stored.is_nan(), height.is_nan()) {
                (false, false) => off > bound,
                // A sample that no whole cell touches is not stored, but corners of coarse cells are.
                (true, _) => all.is_drawn(column, row),
                (false, true) => true,
            };
            if is_wrong {
                report.complain("sample ", format!("{column}, {row} is {stored}, and {height} in the raster"));
            }
            most = most.max(off);
        }
    }
    report.sample_distance = Some(most * surface.height_scale);
    Ok(Some(all))
}

/// A query of any tolerance; a third of all have a budget instead, and a third bounds, too.
fn some_query<S: ReadAt>(file: &Heights<S>, random: &mut Random) -> HeightsQuery {
    let errors = |pick: fn(f64, f64) -> f64, from: f64| {
        let records = file.roots().iter().filter_map(|&root| file.record(root).ok().flatten());
        records.filter_map(|record| Some(record.resolutions.first()?.error)).fold(from, pick)
    };
    let finest = file.info().sample_error * file.surface().height_scale;
    let coarsest = errors(f64::max, finest).max(f64::MIN_POSITIVE);
    let least = finest.max(1e-6 * coarsest);
    let tolerance = least * (coarsest / least).powf(random.unit());
    let mut query = HeightsQuery { tolerance: Some(tolerance), ..HeightsQuery::default() };
    match (3.0 * random.unit()) as u32 {
        0 => {
            let coarsest = file.cut(&HeightsQuery { tolerance: Some(f64::MAX), ..HeightsQuery::default() });
            let least = coarsest.map_or(0, |cut| cut.triangle_count);
            query.max_triangles = Some(((8.0 * 30_000f64.powf(random.unit())) as u64).max(least));
        }
        1 => {
            let (surface, cells) = (file.surface(), file.grid().cells());
            let mut bounds = [[0.0; 2]; 2];
            for axis in 0..2 {
                let ends = [random.unit(), random.unit()]
                    .map(|share| surface.first[axis] + surface.spacing[axis] * share * cells[axis] as f64);
                bounds[0][axis] = ends[0].min(ends[1]);
                bounds[1][axis] = ends[0].max(ends[1]);
            }
            query.bounds = Some(bounds);
        }
        _ => {}
    }
    query
}

/// A query in words.
fn words(query: &HeightsQuery) -> String {
    let HeightsQuery { bounds, tolerance, max_triangles } = query;
    let mut words = "the cut".to_owned();
    if let Some(tolerance) = tolerance {
        write!(words, " of tolerance {tolerance}").expect("strings take anything");
    }
    if let Some(most) = max_triangles {
        write!(words, " of at most {most} triangles").expect("strings take anything");
    }
    if let Some([[west, south], [east, north]]) = bounds {
        write!(words, " from {west}, {south} to {east}, {north}").expect("strings take anything");
    }
    words
}

/// How far the samples of the rasters are from the triangles that cover them, as shares of the errors of these
/// triangles' tiles.
fn check_errors<S: ReadAt>(
    file: &Heights<S>,
    known: &Known,
    (query, cut, mesh): (&HeightsQuery, &HeightsCut, &HeightsMesh),
    report: &mut HeightsReport,
) -> Vec<f64> {
    let (grid, surface) = (file.grid(), file.surface());
    let ([columns, last_row], poles) = (grid.cells(), grid.poles());
    let is_pole = |row: i64| row == 0 && poles[0] || row == last_row as i64 && poles[1];
    let ends: Vec<[u64; 2]> =
        cut.tiles.iter().map(|tile| grid.lines(tile.id).columns).map(|c| [c[0], c[CELLS]]).collect();
    let mut most = vec![0.0f64; cut.tiles.len()];
    for (triangle, &tile) in mesh.triangles.iter().zip(&mesh.triangle_tiles) {
        let mut corners = triangle.map(|at| {
            let [column, row] = mesh.samples[at as usize];
            ([column as i64, row as i64], mesh.positions[at as usize])
        });
        if grid.wraps() {
            unroll(&mut corners, columns as i64, ends[tile as usize], is_pole);
        }
        for corners in without_poles(corners, is_pole) {
            let down = |row: i64| surface.row_in_space(row as u64);
            for_each_sample(corners.map(|(at, _)| at), down, |[column, row], shares| {
                let Some(height) = known.at(column, row).filter(|height| !height.is_nan()) else { return };
                let line = if grid.wraps() { column.rem_euclid(columns as i64) } else { column };
                let place = surface.position(surface.line(0, line as u64), surface.line(1, row as u64), height);
                let off = [0, 1, 2].map(|k| (0..3).map(|c| shares[c] * corners[c].1[k]).sum::<f64>() - place[k]);
                let off = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt();
                let most = &mut most[tile as usize];
                *most = most.max(off);
            });
        }
    }
    let mut shares = vec![];
    let size = mesh.positions.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
    let room = size * ROUNDING_OF_PLACES;
    for (tile, most) in cut.tiles.iter().zip(most) {
        let error = tile.resolution.error;
        if most > error * (1.0 + ROUNDING) + room {
            let id = tile.id;
            let name = format!("{}/{}/{}", id.depth, id.column, id.row);
            report.complain(
                "error: ",
                format!("tile {name} is off by {most}, and {error} is stored, in {}", words(query)),
            );
        }
        if error > 0.0 {
            shares.push(most / error);
        }
    }
    shares
}

type Corner = ([i64; 2], [f64; 3]);

/// Gives the corners of a triangle of a tile columns in one run around the globe: the last column of samples is also
/// the first one.
fn unroll(corners: &mut [Corner; 3], around: i64, [first, last]: [u64; 2], is_pole: impl Fn(i64) -> bool) {
    let easternmost = corners.iter().filter(|(at, _)| !is_pole(at[1])).map(|(at, _)| at[0]).max().unwrap_or(0);
    for ([column, row], _) in corners {
        if is_pole(*row) {
            continue;
        }
        // A tile that goes all around has both.
        let is_end = *column == 0 && (first > 0 || last as i64 == around && easternmost > around / 2);
        *column += if is_end { around } else { 0 };
    }
}

/// A triangle in columns and rows. A pole has no column: it gets those of both other corners.
fn without_poles(corners: [Corner; 3], is_pole: impl Fn(i64) -> bool) -> Vec<[Corner; 3]> {
    let Some(pole) = (0..3).find(|&k| is_pole(corners[k].0[1])) else { return vec![corners] };
    let others = [(pole + 1) % 3, (pole + 2) % 3];
    let at = |column: i64| {
        let mut corners = corners;
        corners[pole].0[0] = column;
        corners
    };
    // Between the two ways to the pole.
    let [a, b] = others;
    let mut wedge = at(corners[a].0[0]);
    wedge[a] = wedge[pole];
    wedge[pole].0[0] = corners[b].0[0];
    vec![at(corners[a].0[0]), at(corners[b].0[0]), wedge]
}

/// Calls `with` for each sample in a triangle: its column and row, and the shares of the corners. `down` says where a
/// row is.
fn for_each_sample(corners: [[i64; 2]; 3], down: impl Fn(i64) -> f64, mut with: impl FnMut([i64; 2], [f64; 3])) {
    let cross =
        |p: [f64; 2], q: [f64; 2], at: [f64; 2]| (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0]);
    let place = |[column, row]: [i64; 2]| [column as f64, down(row)];
    let [a, b, c] = corners.map(place);
    let area = cross(a, b, c);
    if area == 0.0 {
        return;
    }
    let ends = |axis: usize| {
        let all = corners.map(|corner| corner[axis]);
        all[0].min(all[1]).min(all[2])..=all[0].max(all[1]).max(all[2])
    };
    let (columns, sides) = (ends(0), [[a, b], [b, c], [c, a]]);
    for row in ends(1) {
        let y = down(row);
        // Where the row crosses the sides.
        let mut reach = [f64::INFINITY, f64::NEG_INFINITY];
        for [p, q] in sides.iter().filter(|[p, q]| p[1].min(q[1]) <= y && y <= p[1].max(q[1])) {
            let crossed = match p[1] == q[1] {
                true => [p[0], q[0]],
                false => [p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]); 2],
            };
            reach = [reach[0].min(crossed[0]).min(crossed[1]), reach[1].max(crossed[0]).max(crossed[1])];
        }
        let [first, last] = [(reach[0] - ROUNDING).ceil() as i64, (reach[1] + ROUNDING).floor() as i64];
        for column in first.max(*columns.start())..=last.min(*columns.end()) {
            let at = place([column, row]);
            let shares = [cross(b, c, at), cross(c, a, at), cross(a, b, at)].map(|part| part / area);
            with([column, row], shares);
        }
    }
}
