//! How far triangles of a coarse tile are from the samples below them.
//!
//! Heights are whole steps. Most tiles are *even*: their samples are equally far apart, a power of two, and triangles
//! are halves of squares. Then slopes are sums of a few bits, and nothing is rounded (`even`). Everything else is a
//! [`Facet`] between any samples.

use lodpack::heights::{DrawnTile, Line, Lines, SIDE, Surface, TileTriangle};

use super::blocks::{BLOCK_SIDES, Blocks, largest};
use super::needs::Place;
use super::samples::{Scale, Stored, Window};
use super::squares::{Ground, Squares};

/// How far from a side of a triangle a sample lies on it, in columns.
const ON_SIDE: f64 = 1e-6;
/// What is compared with sums of a few products is made smaller by more than these can be rounded.
pub const ROUNDED_DOWN: f64 = 1.0 - 1e-9;

/// A triangle between samples.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    corners: [Corner; 3],
    /// Sides to which neighbours may add samples: from this corner to the next one.
    on_border: [bool; 3],
    /// A pole is at all columns.
    at_pole: [bool; 3],
}

/// A sample, with its height in steps.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    pub column: i64,
    pub row: i64,
    pub height: f64,
}

/// The steps of a tile's samples.
pub type Steps = [i32; SIDE * SIDE];

impl Corner {
    fn new(tile: &DrawnTile, steps: &Steps, at: u16) -> Self {
        let at = usize::from(at);
        let (column, row) = (tile.lines.columns[at % SIDE] as i64, tile.lines.rows[at / SIDE] as i64);
        Self { column, row, height: f64::from(steps[at]) }
    }
}

/// Corners from north to south.
fn by_row([mut a, mut b, mut c]: [Corner; 3]) -> [Corner; 3] {
    if b.row < a.row {
        std::mem::swap(&mut a, &mut b);
    }
    if c.row < a.row {
        std::mem::swap(&mut a, &mut c);
    }
    if c.row < b.row {
        std::mem::swap(&mut b, &mut c);
    }
    [a, b, c]
}

impl Facet {
    /// A triangle of a tile.
    pub fn new(tile: &DrawnTile, steps: &Steps, triangle: TileTriangle) -> Self {
        let corners = triangle.map(|at| Corner::new(tile, steps, at));
        let on_border = [0, 1, 2].map(|k| tile.is_open_side(triangle[k], triangle[(k + 1) % 3]));
        let at_pole = triangle.map(|at| tile.is_at_pole(at));
        Self { corners, on_border, at_pole }
    }
}

/// The samples of a window in space.
pub struct Judge<'a> {
    pub window: &'a Window,
    pub scale: Scale,
    pub surface: &'a Surface,
    /// The highest sample of the grid, in units of coordinates.
    pub highest: f64,
    blocks: Blocks,
    /// Where all samples have data; empty elsewhere.
    squares: Vec<Squares>,
    has_voids: bool,
    columns: Vec<Line>,
    rows: Vec<Line>,
}

impl<'a> Judge<'a> {
    /// Looks at a window. `highest` is the highest sample of the grid, in units of coordinates. The tile of the window
    /// has `cells` cells along a side, and its diagonal `falls` from the north-west, or rises.
    pub fn new(
        (window, cells, falls): (&'a Window, usize, bool),
        scale: Scale,
        surface: &'a Surface,
        highest: f64,
    ) -> Self {
        let lines =
            |axis: usize, [first, last]: [u64; 2]| (first..=last).map(|line| surface.line(axis, line)).collect();
        let (columns, rows) = match surface.is_globe() {
            true => (lines(0, window.columns), lines(1, window.rows)),
            false => (vec![], vec![]),
        };
        let (blocks, has_voids) = (Blocks::new(window), window.has_voids());
        let (stored, width) = window.all();
        let steps = || stored.iter().map(|step| step >> 1);
        let ground = if has_voids { None } else { Ground::new(steps(), width) };
        let squares = ground.map_or_else(Vec::new, |ground| Squares::all(&ground, cells, falls));
        Self { window, scale, surface, highest, blocks, squares, has_voids, columns, rows }
    }

    /// Where a tile of a plane lies in the table of squares, if its lines are equally far apart, a power of two.
    pub fn table_of(&self, lines: &Lines) -> Option<Place<'_>> {
        let [across, down] = lines.distances()?;
        if self.surface.is_globe() || self.squares.is_empty() || across != down || !across.is_power_of_two() {
            return None;
        }
        let first = [lines.columns[0] - self.window.columns[0], lines.rows[0] - self.window.rows[0]];
        Some(Place { squares: &self.squares, first: first.map(|at| at as usize), shift: across.trailing_zeros() })
    }

    /// How far samples are from a triangle that is half of a square or lies on a side of one, in steps, with the
    /// longest side from the first to the second corner; none if there is no table.
    pub fn of_square(&self, [a, b, c]: &[Corner; 3]) -> Option<f64> {
        let [west, north] = [self.window.columns[0], self.window.rows[0]].map(|line| line as i64);
        let [across, down] = [(a.column - b.column).unsigned_abs(), (a.row - b.row).unsigned_abs()];
        let squares = self.squares.get((across.max(down).ilog2() as usize).checked_sub(1)?)?;
        let size = squares.size as i64;
        let (left, top) = (a.column.min(b.column) - west, a.row.min(b.row) - north);
        let (column, row) = (left / size, top / size);
        let at = |column: i64, row: i64| row as usize * squares.counts[0] + column as usize;
        let found = match (down == 0, across == 0) {
            (false, false) => squares.halves[usize::from(c.row - north != top)].get(at(column, row)),
            // Its middle lies to the south, to the north, to the east or to the west of a side.
            (true, _) if c.row > a.row => squares.sides[0].get(at(column, row)),
            (true, _) => squares.sides[1].get(at(column, row - 1)),
            _ if c.column > a.column => squares.sides[2].get(at(column, row)),
            _ => squares.sides[3].get(at(column - 1, row)),
        };
        found.map(|&off| f64::from(off))
    }

    /// The length of a step.
    pub fn step(&self) -> f64 {
        self.scale.step * self.surface.height_scale
    }

    /// Whether some samples of the window have no data.
    pub fn has_voids(&self) -> bool {
        self.has_voids
    }

    /// The largest distance between a triangle and those samples of the window that lie above, below or on it, matched
    /// by column and row; and the same along those of its sides that lie on the border of its tile. Where their sum is
    /// not above `known`, the first one may be anything from itself up to what makes the sum `known`.
    pub fn distances(&self, facet: &Facet, known: f64) -> [f64; 2] {
        let border = self.along_border(facet);
        let inside = match self.surface.is_globe() {
            true => self.on_globe(facet),
            false => self.on_plane(facet, ((known - border) / self.step() * ROUNDED_DOWN).max(0.0)) * self.step(),
        };
        [inside, border]
    }

    /// The largest distance of samples from those sides of a triangle that lie on the border of its tile.
    pub fn along_border(&self, facet: &Facet) -> f64 {
        let border = (0..3).filter(|&k| facet.on_border[k]).map(|k| {
            let next = (k + 1) % 3;
            let [mut a, mut b] = [facet.corners[k], facet.corners[next]];
            match [facet.at_pole[k], facet.at_pole[next]] {
                [true, false] => a.column = b.column,
                [false, true] => b.column = a.column,
                _ => {}
            }
            self.along(a, b)
        });
        border.fold(0.0, f64::max)
    }

    /// How far samples may be from triangles at the border of a tile, whatever samples its neighbours add there.
    pub fn at_border(&self, tile: &DrawnTile, steps: &Steps, tolerance: f64) -> f64 {
        let mut most = 0.0f64;
        tile.needs.for_each_border_side(tolerance, |side, inside| {
            let [a, b] = side.map(|at| Corner::new(tile, steps, at));
            most = most.max(inside + self.along(a, b));
        });
        most
    }

    /// Whether a triangle is one for [`EvenRows`], and lies within the window.
    fn is_even(&self, [a, b, c]: &[Corner; 3]) -> bool {
        let is_straight = |p: &Corner, q: &Corner| {
            let (columns, rows) = ((p.column - q.column).abs(), (p.row - q.row).abs());
            columns == 0 || rows == 0 || columns == rows
        };
        let ([west, east], [north, south]) = (self.window.columns, self.window.rows);
        let is_within = |p: &Corner| {
            (west as i64..=east as i64).contains(&p.column) && (north as i64..=south as i64).contains(&p.row)
        };
        let is_in_place = |p: &Corner| self.down(p.row) == p.row as f64;
        let mut all = [a, b, c].into_iter();
        is_straight(a, b) && is_straight(b, c) && is_straight(c, a) && all.all(|p| is_within(p) && is_in_place(p))
    }

    /// Where a row is, in rows.
    fn down(&self, row: i64) -> f64 {
        if self.surface.is_globe() { self.surface.row_in_space(row as u64) } else { row as f64 }
    }

    /// Calls `with` for each row of the window in a triangle: the row, and its first and last column.
    fn for_each_row(&self, corners: &[Corner; 3], mut with: impl FnMut(i64, [i64; 2])) {
        if self.is_even(corners) {
            let rows = EvenRows::new(corners);
            return (rows.first..=rows.last).for_each(|row| with(row, rows.columns(row)));
        }
        let of_window = |[first, last]: [u64; 2]| [first as i64, last as i64];
        let ([west, east], [north, south]) = (of_window(self.window.columns), of_window(self.window.rows));
        let [a, b, c] = by_row(*corners);
        let (least, most) =
            (a.column.min(b.column).min(c.column).max(west), a.column.max(b.column).max(c.column).min(east));
        let (first, last) = (a.row.max(north), c.row.min(south));
        if least > most || first > last {
            return;
        }
        let [top, middle, bottom] = [a, b, c].map(|corner| self.down(corner.row));
        let slope = |from: Corner, to: Corner, down: f64| match to.row - from.row {
            0 => 0.0,
            _ => (to.column - from.column) as f64 / down,
        };
        let (long, upper, lower) = (slope(a, c, bottom - top), slope(a, b, middle - top), slope(b, c, bottom - middle));
        for row in first..=last {
            let down = self.down(row);
            let one = a.column as f64 + long * (down - top);
            let other = match row <= b.row && b.row > a.row {
                true => a.column as f64 + upper * (down - top),
                false => b.column as f64 + lower * (down - middle),
            };
            // Columns on a side count, whatever is lost by rounding. None is negative, so casts round down.
            let (from, to) = (one.min(other) + (1.0 - ON_SIDE), one.max(other) + ON_SIDE);
            let (from, to) = ((from as i64).max(least), (to as i64).min(most));
            if from <= to {
                with(row, [from, to]);
            }
        }
    }

    /// The largest height between samples and a triangle on a plane in steps, if it is above `least`; otherwise at most
    /// that.
    fn on_plane(&self, Facet { corners, .. }: &Facet, least: f64) -> f64 {
        let [a, b, c] = *corners;
        let slope = Slope::new(corners.map(|corner| [corner.column as f64, corner.row as f64]));
        let [east, south] = slope.of([a, b, c].map(|corner| corner.height));
        let plane = Plane { east, south, first: a };
        let mut most = least;
        if self.is_even(corners) {
            self.in_even(corners, &plane, &mut most);
        } else {
            self.for_each_row(corners, |row, ends| most = self.along_row(&plane, row, ends, most));
        }
        most
    }

    /// The largest of `most` and the heights between samples of a run of a row and a plane, in steps.
    #[inline]
    fn along_row(&self, plane: &Plane, row: i64, [from, to]: [i64; 2], most: f64) -> f64 {
        let (first, east) = (plane.at(from, row), plane.east);
        let run = self.window.run(row as u64, [from as u64, to as u64]);
        let off = |k: f64, sample: Stored| (first + east * k - f64::from(sample >> 1)).abs();
        match self.has_voids {
            false => largest(run, most, off),
            true => largest(run, most, |k, sample| if sample & 1 == 0 { off(k, sample) } else { 0.0 }),
        }
    }

    /// The same for a triangle whose sides run along rows, columns and diagonals, and which lies within the window.
    /// Looks only into those blocks of samples that may be further from it than what is known: no sample is further
    /// from it than the furthest corner of its block and the roughness of the block together.
    pub fn in_even(&self, corners: &[Corner; 3], plane: &Plane, most: &mut f64) {
        let rows = EvenRows::new(corners);
        let extent = (rows.last - rows.first) as usize;
        let all = [rows.first, rows.last];
        match BLOCK_SIDES.iter().position(|&side| side <= extent) {
            Some(size) => self.in_blocks_of(size, &rows, (all, rows.columns_within(all)), plane, most),
            None => {
                for row in rows.first..=rows.last {
                    *most = self.along_row(plane, row, rows.columns(row), *most);
                }
            }
        }
    }

    /// Looks into the blocks of a size within some rows and columns. Blocks share the samples on their borders.
    fn in_blocks_of(
        &self,
        size: usize,
        rows: &EvenRows,
        ([first, last], [left, right]): ([i64; 2], [i64; 2]),
        plane: &Plane,
        most: &mut f64,
    ) {
        let [west, north] = [self.window.columns[0], self.window.rows[0]].map(|line| line as i64);
        let side = BLOCK_SIDES[size] as i64;
        let mut top = first - (first - north) % side;
        while top < last {
            let ends = [top.max(first), (top + side).min(last)];
            let [from, to] = rows.columns_within(ends);
            let (from, to) = (from.max(left), to.min(right));
            if from <= to {
                let mut edge = from - (from - west) % side;
                loop {
                    let columns = [edge.max(left), (edge + side).min(right)];
                    self.in_block(size, [edge, top], rows, (ends, columns), plane, most);
                    edge += side;
                    if edge >= to {
                        break;
                    }
                }
            }
            top += side;
        }
    }

    fn in_block(
        &self,
        size: usize,
        [west, north]: [i64; 2],
        rows: &EvenRows,
        (ends, columns): ([i64; 2], [i64; 2]),
        plane: &Plane,
        most: &mut f64,
    ) {
        let window = self.window;
        let [first_column, first_row] = [window.columns[0], window.rows[0]].map(|line| line as i64);
        let side = BLOCK_SIDES[size] as i64;
        let block = [(west - first_column) / side, (north - first_row) / side].map(|k| k as usize);
        if let Some(roughness) = self.blocks.roughness(size, block) {
            let east = (west + side).min(window.columns[1] as i64);
            let south = (north + side).min(window.rows[1] as i64);
            let off = |column: i64, row: i64| {
                (plane.at(column, row) - f64::from(window.step(column as u64, row as u64))).abs()
            };
            let corners = off(west, north).max(off(east, north)).max(off(west, south)).max(off(east, south));
            if corners + roughness <= *most * ROUNDED_DOWN {
                return;
            }
        }
        if size + 1 < BLOCK_SIDES.len() && ends[0] < ends[1] {
            return self.in_blocks_of(size + 1, rows, (ends, columns), plane, most);
        }
        for row in ends[0]..=ends[1] {
            let [first, last] = rows.columns(row);
            let ends = [first.max(columns[0]), last.min(columns[1])];
            if ends[0] <= ends[1] {
                *most = self.along_row(plane, row, ends, *most);
            }
        }
    }

    fn on_globe(&self, Facet { corners, .. }: &Facet) -> f64 {
        let slope = Slope::new(corners.map(|corner| [corner.column as f64, self.down(corner.row)]));
        let places = corners.map(|corner| self.place(corner));
        let slopes = [0, 1, 2].map(|axis| slope.of(places.map(|place| place[axis])));
        let a = corners[0];
        let mut most = 0.0;
        self.for_each_row(corners, |row, [from, to]| {
            let line = self.rows[(row as u64 - self.window.rows[0]) as usize];
            let columns = &self.columns[(from as u64 - self.window.columns[0]) as usize..];
            let run = self.window.run(row as u64, [from as u64, to as u64]);
            let down = self.down(row) - self.down(a.row);
            for (k, (&sample, &column)) in run.iter().zip(columns).enumerate() {
                if sample & 1 != 0 {
                    continue;
                }
                let height = self.scale.zero + f64::from(sample >> 1) * self.scale.step;
                let place = self.surface.position(column, line, height);
                let right = (from - a.column) as f64 + k as f64;
                let off = [0, 1, 2]
                    .map(|axis| places[0][axis] + slopes[axis][0] * right + slopes[axis][1] * down - place[axis]);
                let square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                most = if square > most { square } else { most };
            }
        });
        most.sqrt()
    }

    /// The largest distance of samples from a straight side along a row or a column.
    fn along(&self, a: Corner, b: Corner) -> f64 {
        let length = (b.column - a.column).abs().max((b.row - a.row).abs());
        let of_window = |[first, last]: [u64; 2]| [first as i64, last as i64];
        let (columns, rows) = (of_window(self.window.columns), of_window(self.window.rows));
        let is_within = |at: i64, [first, last]: [i64; 2]| (first..=last).contains(&at);
        let mut most = 0.0f64;
        let [start, end] = [a, b].map(|corner| if self.surface.is_globe() { self.place(corner) } else { [0.0; 3] });
        for k in 1..length {
            let at = |a: i64, b: i64| a + (b - a).signum() * k;
            let (column, row) = (at(a.column, b.column), at(a.row, b.row));
            if !is_within(column, columns) || !is_within(row, rows) {
                continue;
            }
            let sample = self.window.run(row as u64, [column as u64; 2])[0];
            if sample & 1 != 0 {
                continue;
            }
            let share = match a.row == b.row {
                true => k as f64 / length as f64,
                false => (self.down(row) - self.down(a.row)) / (self.down(b.row) - self.down(a.row)),
            };
            let height = f64::from(sample >> 1);
            let off = match self.surface.is_globe() {
                false => (a.height + share * (b.height - a.height) - height).abs() * self.step(),
                true => {
                    let place = self.place(Corner { column, row, height });
                    let off = [0, 1, 2].map(|axis| start[axis] + share * (end[axis] - start[axis]) - place[axis]);
                    (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt()
                }
            };
            most = most.max(off);
        }
        most
    }

    fn place(&self, Corner { column, row, height }: Corner) -> [f64; 3] {
        // A corner may lie outside of the window.
        let line = |axis: usize, known: &[Line], first: u64, line: i64| {
            let known = (line as u64).checked_sub(first).and_then(|at| known.get(at as usize));
            known.copied().unwrap_or_else(|| self.surface.line(axis, line as u64))
        };
        let column = line(0, &self.columns, self.window.columns[0], column);
        let row = line(1, &self.rows, self.window.rows[0], row);
        self.surface.position(column, row, self.scale.zero + height * self.scale.step)
    }
}

/// The rows of a triangle whose sides run along rows, columns and diagonals.
struct EvenRows {
    first: i64,
    last: i64,
    /// The last row of the upper of the two short sides.
    upper_end: i64,
    /// Column and row where the long side, and the upper and the lower short side begin, and columns to the east for
    /// each row.
    sides: [([i64; 2], i64); 3],
}

impl EvenRows {
    fn new(corners: &[Corner; 3]) -> Self {
        let [a, b, c] = by_row(*corners);
        let slope = |from: Corner, to: Corner| (to.column - from.column).signum();
        let start = |corner: Corner| [corner.column, corner.row];
        let sides = [(start(a), slope(a, c)), (start(a), slope(a, b)), (start(b), slope(b, c))];
        Self { first: a.row, last: c.row, upper_end: if a.row < b.row { b.row } else { a.row - 1 }, sides }
    }

    /// The first and the last column of a row.
    #[inline]
    fn columns(&self, row: i64) -> [i64; 2] {
        let at = |([column, start], slope): ([i64; 2], i64)| column + slope * (row - start);
        let (one, other) = (at(self.sides[0]), at(self.sides[if row <= self.upper_end { 1 } else { 2 }]));
        [one.min(other), one.max(other)]
    }

    /// The first and the last column of some rows together: triangles are convex, and bend in one row alone.
    fn columns_within(&self, [first, last]: [i64; 2]) -> [i64; 2] {
        let bend = self.upper_end.clamp(first, last);
        // The row behind a bend begins the lower side.
        let rows = [first, bend, (bend + 1).min(last), last].map(|row| self.columns(row));
        rows.into_iter().fold([i64::MAX, i64::MIN], |[low, high], [a, b]| [low.min(a), high.max(b)])
    }
}

/// Heights that change evenly, from a corner on.
pub struct Plane {
    pub east: f64,
    pub south: f64,
    pub first: Corner,
}

impl Plane {
    #[inline]
    fn at(&self, column: i64, row: i64) -> f64 {
        let Corner { column: west, row: north, height } = self.first;
        height + self.east * (column - west) as f64 + self.south * (row - north) as f64
    }
}

/// How a plane through three corners rises.
struct Slope {
    /// From the first corner to the two others: columns and rows.
    sides: [[f64; 2]; 2],
    determinant: f64,
}

impl Slope {
    /// From columns and rows of the corners.
    fn new([a, b, c]: [[f64; 2]; 3]) -> Self {
        let sides = [b, c].map(|corner| [corner[0] - a[0], corner[1] - a[1]]);
        Self { sides, determinant: sides[0][0] * sides[1][1] - sides[1][0] * sides[0][1] }
    }

    /// A value's rise a column and a row.
    fn of(&self, [a, b, c]: [f64; 3]) -> [f64; 2] {
        let [[u, v], [x, y]] = self.sides;
        let (b, c) = (b - a, c - a);
        [(b * y - c * v) / self.determinant, (c * u - b * x) / self.determinant]
    }
}
