//! Triangulated irregular networks: windows of a grid as few triangles of any shape, whose vertices are samples.
//!
//! Greedy insertion (Garland and Heckbert, "Fast polygonal approximation of terrains and height fields", 1995): a
//! Delaunay triangulation gets the sample that is furthest from it, until none is further than the tolerance. Every
//! sample of the window is compared, so the distance that is stated is exact. A window is divided into blocks, so that
//! memory holds few of them; what lies on the line between two blocks is chosen from that line alone, so both have the
//! same vertices there. Along the border of missing data all samples are vertices: sides of one cell are edges of every
//! Delaunay triangulation of a grid, so triangles lie within or outside of what is drawn.
//!
//! - [`delaunay`]: the triangulation,
//! - [`ground`]: samples, and how far they are from triangles,
//! - [`uneven`]: the same of samples at any distances, which become vertices at rounded places.

mod delaunay;
mod ground;
mod uneven;

use std::collections::{BinaryHeap, HashMap};

use lodpack::heights::{Heights, Line, Surface};
use lodpack::{Error, ReadAt, Result};
use rayon::prelude::*;

use super::geotiff::window_of;
use delaunay::{Delaunay, MAX_SIDE};
use ground::{Furthest, Ground, Round};
use lodpack_runtime::progress::Progress;
pub use uneven::{Uneven, UnevenPatch, triangulate_uneven};

/// Cells along a side of a block: 33 MB of heights, and 300 MB of triangles where nearly every sample is one.
const BLOCK_CELLS: u64 = 2048;
const _: () = assert!(BLOCK_CELLS as i64 <= MAX_SIDE);
/// Heights are known to this share of the largest one: what is less is lost by rounding.
const ROUNDING: f64 = 1e-14;
/// Positions on a globe are rounded by this share of them.
const ROUNDING_OF_GLOBE: f64 = 1e-15;

/// A mesh whose vertices are samples.
#[derive(Clone, Debug, Default)]
pub struct Tin {
    /// In space. Each sample occurs once.
    pub positions: Vec<[f64; 3]>,
    /// The height of each vertex, in units of heights.
    pub heights: Vec<f64>,
    /// Column and row of each vertex.
    pub samples: Vec<[u64; 2]>,
    /// Counter-clockwise seen from above.
    pub triangles: Vec<[u32; 3]>,
    /// No sample that the heights were made from is further from it: along the vertical on a plane, in space on a
    /// globe.
    pub error: f64,
    /// How many samples were compared.
    pub sample_count: u64,
}

/// All of a square of samples, as few triangles.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Column and row of each vertex.
    pub vertices: Vec<[i32; 2]>,
    /// Counter-clockwise seen from above.
    pub triangles: Vec<[u32; 3]>,
    /// No sample is further from them: along the vertical on a plane, in space on a globe.
    pub error: f64,
}

/// Triangulates a square of samples. `surface` says where its columns and rows are, of which none lies behind a pole;
/// heights are in units of coordinates, row by row from the north-west. Vertices on a side depend on the samples on it
/// alone, so squares beside each other have the same ones there.
pub fn triangulate_patch(surface: &Surface, side: usize, heights: Vec<f64>, tolerance: f64) -> Patch {
    debug_assert!(heights.len() == side * side && heights.iter().all(|height| height.is_finite()));
    let lines = |axis: usize| (0..side as u64).map(|line| surface.line(axis, line)).collect();
    let down = (0..side).map(|row| row as f64).collect();
    let round = surface.is_globe().then(|| Round { surface: *surface, columns: lines(0), rows: lines(1), down });
    let ground = Ground { width: side, height: side, heights, round };
    let Made { all, off, .. } = triangulate_block(Around { ground, coast: vec![] }, tolerance);
    let triangles = (0..all.count() as u32).map(|number| all.triangle(number)).collect();
    Patch { vertices: all.points().to_vec(), triangles, error: off }
}

/// A rectangle of cells, by its first and last lines.
#[derive(Clone, Copy, Debug)]
struct Block {
    columns: [u64; 2],
    rows: [u64; 2],
}

/// Triangulates what a box touches. `tolerance` bounds the distance of the samples that the heights were made from.
///
/// # Errors
/// [`Error::Query`] if nothing touches the box, or the file's heights are further off than the tolerance; those of
/// reading the file.
pub fn triangulate<S: ReadAt>(
    file: &Heights<S>,
    bounds: Option<[[f64; 2]; 2]>,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Tin> {
    let (grid, surface) = (file.grid(), file.surface());
    let sample_error = file.info().sample_error * surface.height_scale;
    if tolerance.is_nan() || tolerance < sample_error {
        let what = format!(
            "heights in the file are off by {sample_error} at most, so nothing made of them is within {tolerance}; ask for more, or build the \
             file with a smaller --tolerance"
        );
        return Err(Error::Query { what });
    }
    let window = window_of(file, bounds, None)?;
    let [first, size] = [window.first, window.size];
    // Around a globe the last column of cells ends at the first column.
    let is_closed = grid.wraps() && size[0] == grid.cells()[0];
    let ends = [0, 1].map(|axis| [first[axis], first[axis] + size[axis] - 1 + u64::from(is_closed && axis == 0)]);
    if ends.iter().any(|[from, to]| from == to) {
        return Err(Error::Query { what: "the box touches no cell".into() });
    }
    let divided = |[from, to]: [u64; 2], least: u64| -> Vec<[u64; 2]> {
        let count = (to - from).div_ceil(BLOCK_CELLS).max(least);
        let line = |k: u64| from + (to - from) * k / count;
        (0..count).map(|k| [line(k), line(k + 1)]).filter(|[from, to]| from < to).collect()
    };
    // No window has a column twice.
    let (columns, rows) = (divided(ends[0], 1 + u64::from(is_closed)), divided(ends[1], 1));
    let blocks: Vec<Block> =
        rows.iter().flat_map(|&rows| columns.iter().map(move |&columns| Block { columns, rows })).collect();
    let window = Window { file, ends, is_closed };
    progress.begin("triangulate", size[0] * size[1]);
    let mut joined = Joined { window: &window, tin: Tin::default(), shared: HashMap::new() };
    for blocks in blocks.chunks(rayon::current_num_threads().max(1)) {
        let grounds = blocks.iter().map(|&block| Ok((block, window.read(block)?))).collect::<Result<Vec<_>>>()?;
        let work = |(block, around): (Block, Around)| {
            let made = triangulate_block(around, tolerance - sample_error);
            progress.advance((block.columns[1] - block.columns[0]) * (block.rows[1] - block.rows[0]));
            (block, made)
        };
        let made: Vec<(Block, Made)> = grounds.into_par_iter().map(work).collect();
        made.into_iter().try_for_each(|(block, made)| joined.add(block, made))?;
    }
    let mut tin = joined.tin;
    if tin.triangles.is_empty() {
        return Err(Error::Query { what: "the box touches no cell with data".into() });
    }
    tin.error += sample_error;
    tin.sample_count = size[0] * size[1];
    Ok(tin)
}

/// The part of a grid that is triangulated.
struct Window<'a, S> {
    file: &'a Heights<S>,
    /// The first and the last column and row.
    ends: [[u64; 2]; 2],
    /// The last column is the first one.
    is_closed: bool,
}

/// The samples of a block, and those of them that have to be vertices.
struct Around {
    ground: Ground,
    /// On the border of missing data.
    coast: Vec<[i32; 2]>,
}

impl<S: ReadAt> Window<'_, S> {
    /// Reads a block, with a line of samples more on each side to know where data ends.
    fn read(&self, block: Block) -> Result<Around> {
        let (grid, surface) = (self.file.grid(), self.file.surface());
        let before = [block.columns[0], block.rows[0]];
        let margins = [0, 1].map(|axis| {
            let [from, to] = [[block.columns[0], block.columns[1]], [block.rows[0], block.rows[1]]][axis];
            let goes_on = self.is_closed && axis == 0;
            [from > self.ends[axis][0] || goes_on, to < self.ends[axis][1] || goes_on].map(u64::from)
        });
        let count = grid.samples();
        let start = match before[0].checked_sub(margins[0][0]) {
            Some(start) => start,
            None => count[0] - 1,
        };
        let width = block.columns[1] - block.columns[0] + 1;
        let height = block.rows[1] - block.rows[0] + 1;
        let start = if grid.wraps() { start % count[0] } else { start };
        let all = width + margins[0][0] + margins[0][1];
        // A block that goes nearly around has no room for the margins, nor needs what it has already.
        let (start, margins) = match all > count[0] {
            true => (before[0] % count[0], [[0, 0], margins[1]]),
            false => (start, margins),
        };
        let columns = start..start + width + margins[0][0] + margins[0][1];
        let rows = before[1] - margins[1][0]..block.rows[1] + 1 + margins[1][1];
        let row_length = (columns.end - columns.start) as usize;
        let mut heights = self.file.window(columns, rows.clone())?;
        let [west, north] = [margins[0][0], margins[1][0]].map(|margin| margin as usize);
        let scale = surface.height_scale;
        heights.iter_mut().for_each(|height| *height *= scale);
        let has_voids = heights.iter().any(|height| height.is_nan());
        let mut coast = vec![];
        if has_voids {
            let wide = Ground { width: row_length, height: (rows.end - rows.start) as usize, heights, round: None };
            let is_drawn = |column: i64, row: i64| {
                let is_there =
                    (0..row_length as i64 - 1).contains(&column) && (0..wide.height as i64 - 1).contains(&row);
                is_there.then(|| wide.is_drawn([column as i32, row as i32]))
            };
            for row in 0..height as i64 {
                for column in 0..width as i64 {
                    let [x, y] = [column + west as i64, row + north as i64];
                    let around = [(-1, -1), (0, -1), (-1, 0), (0, 0)].map(|(dx, dy)| is_drawn(x + dx, y + dy));
                    if around.contains(&Some(true)) && around.contains(&Some(false)) {
                        coast.push([column as i32, row as i32]);
                    }
                }
            }
            heights = wide.heights;
        }
        if row_length != width as usize || north > 0 || margins[1][1] > 0 {
            let rows = heights.chunks(row_length).skip(north).take(height as usize);
            heights = rows.flat_map(|row| &row[west..west + width as usize]).copied().collect();
        }
        let round = surface.is_globe().then(|| {
            let lines = |axis: usize, [from, to]: [u64; 2]| -> Vec<Line> {
                (from..=to).map(|at| surface.line(axis, if axis == 0 { grid.vertex(at, 1)[0] } else { at })).collect()
            };
            Round {
                surface: *surface,
                columns: lines(0, block.columns),
                rows: lines(1, block.rows),
                down: (block.rows[0]..=block.rows[1]).map(|row| surface.row_in_space(row)).collect(),
            }
        });
        Ok(Around { ground: Ground { width: width as usize, height: height as usize, heights, round }, coast })
    }
}

/// A block as triangles.
struct Made {
    all: Delaunay,
    ground: Ground,
    has_voids: bool,
    /// The largest distance of a sample of the block.
    off: f64,
}

fn triangulate_block(Around { ground, coast }: Around, tolerance: f64) -> Made {
    let last = [ground.width as i32 - 1, ground.height as i32 - 1];
    let highest = ground.heights.iter().fold(0.0f64, |most, height| most.max(height.abs()));
    let size = ground.round.as_ref().map_or(0.0, |round| {
        let place = round.surface.position(round.columns[0], round.rows[0], 0.0);
        place.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
    });
    // Where every difference counts, those that rounding makes do not.
    let tolerance = tolerance.max(ROUNDING * highest + ROUNDING_OF_GLOBE * size);
    let mut all = Delaunay::new(last);
    let mut near = 0;
    let on_border = [[[0, 0], [last[0], 0]], [[0, last[1]], last], [[0, 0], [0, last[1]]], [[last[0], 0], last]];
    let is_coast: std::collections::HashSet<[i32; 2]> = coast.iter().copied().collect();
    let mut needed = vec![];
    for [from, to] in on_border {
        choose_on_line(&ground, from, to, &is_coast, tolerance, &mut needed);
    }
    for point in needed.into_iter().chain(coast.iter().copied()) {
        near = all.locate(point, near);
        all.insert(point, near);
    }
    let off = refine(&mut all, tolerance, |all, number| ground.furthest(all, number));
    let has_voids = !coast.is_empty() || ground.heights.iter().any(|height| height.is_nan());
    Made { all, ground, has_voids, off }
}

/// Adds the furthest sample of all triangles until none is further than the tolerance, and says how far the furthest
/// one is. `furthest` finds that of a triangle.
fn refine(all: &mut Delaunay, tolerance: f64, furthest: impl Fn(&Delaunay, u32) -> Furthest) -> f64 {
    // Of each triangle its furthest sample. What is in the queue with another distance is old.
    let mut known: Vec<Furthest> = vec![];
    let mut queue = BinaryHeap::new();
    loop {
        while let Some(number) = all.next_changed() {
            let found = furthest(all, number);
            known.resize(known.len().max(all.count()), Furthest::default());
            known[number as usize] = found;
            if found.off > tolerance {
                // Not negative, so bits are in the order of numbers.
                queue.push((found.off.to_bits(), number, found.at));
            }
        }
        let Some((off, number, at)) = queue.pop() else { break };
        let now = known[number as usize];
        if now.off.to_bits() == off && now.at == at {
            all.insert(at, number);
        }
    }
    known.iter().fold(0.0f64, |most, found| most.max(found.off))
}

/// Chooses vertices on a side of a block, between vertices: those on the coast, and as many as the tolerance asks for.
fn choose_on_line(
    ground: &Ground,
    from: [i32; 2],
    to: [i32; 2],
    is_coast: &std::collections::HashSet<[i32; 2]>,
    tolerance: f64,
    out: &mut Vec<[i32; 2]>,
) {
    let axis = usize::from(from[0] == to[0]);
    let at = |k: i32| {
        let mut at = from;
        at[axis] = k;
        at
    };
    let mut start = from[axis];
    for end in from[axis] + 1..=to[axis] {
        let is_end = end == to[axis];
        if !is_end && !is_coast.contains(&at(end)) {
            continue;
        }
        if !is_end {
            out.push(at(end));
        }
        let mut waiting = vec![[start, end]];
        while let Some([a, b]) = waiting.pop() {
            let mut most = (tolerance, None);
            for k in a + 1..b {
                let off = ground.off_line(at(a), at(b), at(k));
                if off > most.0 {
                    most = (off, Some(k));
                }
            }
            if let Some(k) = most.1 {
                out.push(at(k));
                waiting.extend([[a, k], [k, b]]);
            }
        }
        start = end;
    }
}

/// What has been made so far.
struct Joined<'a, S> {
    window: &'a Window<'a, S>,
    tin: Tin,
    /// Vertices on the sides of blocks.
    shared: HashMap<[u64; 2], u32>,
}

impl<S: ReadAt> Joined<'_, S> {
    fn add(&mut self, block: Block, made: Made) -> Result<()> {
        let Made { all, ground, has_voids, off } = made;
        let (grid, surface) = (self.window.file.grid(), self.window.file.surface());
        self.tin.error = self.tin.error.max(off);
        let last = [ground.width as i32 - 1, ground.height as i32 - 1];
        let mut names = vec![u32::MAX; all.points().len()];
        for number in 0..all.count() as u32 {
            let places = all.places(number);
            // A triangle has no cell of the other kind in common with its middle.
            let middle = [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<i32>() / 3);
            let cell = [0, 1].map(|axis| middle[axis].min(last[axis] - 1));
            if has_voids && !ground.is_drawn(cell) {
                continue;
            }
            let corners = all.triangle(number);
            for corner in corners {
                if names[corner as usize] != u32::MAX {
                    continue;
                }
                let [column, row] = all.points()[corner as usize];
                let sample = [block.columns[0] + column as u64, block.rows[0] + row as u64];
                let sample = grid.vertex(sample[0], sample[1]);
                let is_shared = column == 0 || row == 0 || column == last[0] || row == last[1];
                let known = if is_shared { self.shared.get(&sample).copied() } else { None };
                names[corner as usize] = match known {
                    Some(vertex) => vertex,
                    None => {
                        let height =
                            ground.heights[row as usize * ground.width + column as usize] / surface.height_scale;
                        let place = surface.position(surface.line(0, sample[0]), surface.line(1, sample[1]), height);
                        let vertex = u32::try_from(self.tin.positions.len()).ok().filter(|&vertex| vertex != u32::MAX);
                        let too_many =
                            || Error::Query { what: "the mesh has more than 2^32 vertices; ask for less".into() };
                        let vertex = vertex.ok_or_else(too_many)?;
                        self.tin.positions.push(place);
                        self.tin.heights.push(height);
                        self.tin.samples.push(sample);
                        if is_shared {
                            self.shared.insert(sample, vertex);
                        }
                        vertex
                    }
                };
            }
            let [a, b, c] = corners.map(|corner| names[corner as usize]);
            // Two corners at a pole are one point.
            if a != b && b != c && c != a {
                self.tin.triangles.push([a, b, c]);
            }
        }
        Ok(())
    }
}
