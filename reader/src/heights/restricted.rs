//! The restricted triangulation of a tile: right triangles, halved where the surface asks for it (thesis 3.4; SPEC.md,
//! "Drawn tiles").
//!
//! A square is two triangles; a triangle is halved at the middle of its longest side. The middle of a longest side
//! *needs* the largest distance of samples from the two triangles that meet there, or more where middles behind it need
//! more. So needs do not grow from a triangle to its halves, and a tolerance, which halves each triangle whose middle
//! needs more, leaves no cracks inside of a tile: both triangles at a longest side agree.

use super::grid::{CELLS, SIDE};

/// What a middle needs whose triangles lie neither within what is drawn nor outside of it: no tolerance joins them.
const ALWAYS: f64 = f64::INFINITY;

/// How much the distances of samples from a side along the border of a tile count: samples of neighbours move the
/// triangle behind it by as much once more.
const AT_BORDER: f64 = 2.0;

/// Distances are compared in this many lanes, which do not wait for each other.
const LANES: usize = 4;

fn largest([a, b, c, d]: [f64; LANES]) -> f64 {
    let of_two = |a: f64, b: f64| if a > b { a } else { b };
    of_two(of_two(a, b), of_two(c, d))
}

/// Three samples of a tile, row by row from the north-west, counter-clockwise seen from above.
pub type TileTriangle = [u16; 3];

/// What each sample of a tile needs.
#[derive(Clone, Debug)]
pub struct Needs {
    of: Box<[f64; SIDE * SIDE]>,
    /// Whether the longest side of the two largest triangles begins in the north-west.
    from_north_west: bool,
}

/// Bits of cells that are drawn, row by row; none if all are.
type Cells<'a> = Option<&'a [u64; CELLS]>;

fn sample(column: usize, row: usize) -> usize {
    row * SIDE + column
}

/// Whether cells of a rectangle are drawn: none, some or all.
fn drawn(cells: &[u64; CELLS], columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> [bool; 2] {
    let width = columns.end - columns.start;
    let mask = (u64::MAX >> (CELLS - width)) << columns.start;
    let (mut some, mut all) = (false, true);
    for row in &cells[rows] {
        some |= row & mask != 0;
        all &= row & mask == mask;
    }
    [some, all]
}

/// The samples of a tile, as far as its triangles depend on them.
pub struct Field<'a, Bend> {
    /// Of index columns, in columns of the grid.
    pub columns: &'a [f64; SIDE],
    /// Of index rows.
    pub rows: &'a [f64; SIDE],
    /// In units of space, row by row.
    pub heights: &'a [f64; SIDE * SIDE],
    /// What a straight side between two samples is off by itself: a globe is round.
    pub bend: Bend,
}

impl<Bend: Fn(usize, usize) -> f64> Field<'_, Bend> {
    /// The largest vertical distance between the samples of a triangle and the triangle; 0 for one without area.
    fn distance(&self, corners: [usize; 3]) -> f64 {
        let Some([first, east, south]) = self.plane(corners) else { return 0.0 };
        let mut at = corners.map(|k| [(k % SIDE) as isize, (k / SIDE) as isize]);
        at.sort_unstable_by_key(|[_, row]| *row);
        let [top, middle, bottom] = at;
        // Sides of right triangles go down by a column a row, or by none.
        let slope = |from: [isize; 2], to: [isize; 2]| (to[0] - from[0]) / (to[1] - from[1]).max(1);
        let (long, upper, lower) = (slope(top, bottom), slope(top, middle), slope(middle, bottom));
        let mut most = [0.0; LANES];
        for row in top[1]..=bottom[1] {
            let one = top[0] + long * (row - top[1]);
            let other = match row <= middle[1] && middle[1] > top[1] {
                true => top[0] + upper * (row - top[1]),
                false => middle[0] + lower * (row - middle[1]),
            };
            let (from, to) = (one.min(other) as usize, one.max(other) as usize);
            let row = row as usize;
            let base = first + south * self.rows[row];
            let heights = &self.heights[sample(from, row)..=sample(to, row)];
            let (columns, rest_of_columns) = self.columns[from..=to].as_chunks::<LANES>();
            let (heights, rest) = heights.as_chunks::<LANES>();
            for (heights, columns) in heights.iter().zip(columns) {
                for (most, (height, column)) in most.iter_mut().zip(heights.iter().zip(columns)) {
                    let off = (base + east * column - height).abs();
                    *most = if off > *most { off } else { *most };
                }
            }
            for (most, (height, column)) in most.iter_mut().zip(rest.iter().zip(rest_of_columns)) {
                let off = (base + east * column - height).abs();
                *most = if off > *most { off } else { *most };
            }
        }
        largest(most)
    }

    /// The plane through three samples: the height at column 0 and row 0, and what a column and a row add; none if they
    /// are on a line.
    fn plane(&self, corners: [usize; 3]) -> Option<[f64; 3]> {
        let [a, b, c] = corners.map(|k| [self.columns[k % SIDE], self.rows[k / SIDE], self.heights[k]]);
        let ([u, v, p], [x, y, q]) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let determinant = u * y - x * v;
        if determinant == 0.0 {
            return None;
        }
        let (east, south) = ((p * y - q * v) / determinant, (q * u - p * x) / determinant);
        Some([a[2] - east * a[0] - south * a[1], east, south])
    }

    /// What the middles of the smallest triangles need: these have no other sample.
    fn smallest(&self, of: &mut [f64; SIDE * SIDE], cells: Cells) {
        let shares = |lines: &[f64; SIDE]| -> [f64; CELLS / 2] {
            std::array::from_fn(|k| {
                let [first, middle, last] = [0, 1, 2].map(|at| lines[2 * k + at]);
                if first < last { (middle - first) / (last - first) } else { 0.0 }
            })
        };
        let (east, south) = (shares(self.columns), shares(self.rows));
        let h = self.heights;
        for line in 0..=CELLS / 2 {
            let factor = if line % (CELLS / 2) == 0 { AT_BORDER } else { 1.0 };
            let need = |[a, middle, b]: [usize; 3], share: f64| {
                factor * (h[a] + share * (h[b] - h[a]) - h[middle]).abs() + (self.bend)(a, b)
            };
            let across = (2 * line).saturating_sub(1)..(2 * line + 1).min(CELLS);
            for from in 0..CELLS / 2 {
                let along = 2 * from..2 * from + 2;
                let side = [0, 1, 2].map(|k| sample(2 * from + k, 2 * line));
                of[side[1]] = masked(need(side, east[from]), cells, along.clone(), across.clone());
                let side = [0, 1, 2].map(|k| sample(2 * line, 2 * from + k));
                of[side[1]] = masked(need(side, south[from]), cells, across.clone(), along);
            }
        }
        for (row, &south) in south.iter().enumerate() {
            for (column, &east) in east.iter().enumerate() {
                let at = |x: usize, y: usize| sample(2 * column + x, 2 * row + y);
                let corners @ [north_west, north_east, south_west, south_east] =
                    [at(0, 0), at(2, 0), at(0, 2), at(2, 2)];
                let [a, b, c, d] = corners.map(|corner| h[corner]);
                // The middle of a square, on the planes of the two triangles that meet in its diagonal.
                let (ends, [one, other]) = match (column + row).is_multiple_of(2) {
                    true => (
                        [north_west, south_east],
                        [a + east * (b - a) + south * (d - b), a + south * (c - a) + east * (d - c)],
                    ),
                    false => (
                        [north_east, south_west],
                        [a + east * (b - a) + south * (c - a), d + (1.0 - east) * (c - d) + (1.0 - south) * (b - d)],
                    ),
                };
                let middle = at(1, 1);
                let own = (one - h[middle]).abs().max((other - h[middle]).abs()) + (self.bend)(ends[0], ends[1]);
                let need = [at(1, 0), at(1, 2), at(0, 1), at(2, 1)].iter().fold(own, |need, &side| need.max(of[side]));
                of[middle] = masked(need, cells, 2 * column..2 * column + 2, 2 * row..2 * row + 2);
            }
        }
    }

    /// The largest vertical distance between a side along a row or a column and the samples on it.
    fn along(&self, [a, b]: [usize; 2]) -> f64 {
        let is_row = a / SIDE == b / SIDE;
        let at = |k: usize| if is_row { self.columns[k % SIDE] } else { self.rows[k / SIDE] };
        let length = at(b) - at(a);
        if length <= 0.0 {
            return 0.0;
        }
        let rise = self.heights[b] - self.heights[a];
        let off = |k: usize| (self.heights[a] + (at(k) - at(a)) / length * rise - self.heights[k]).abs();
        (a..b).step_by(if is_row { 1 } else { SIDE }).fold(0.0, |most, k| off(k).max(most))
    }

    /// What the middle of a side needs by itself, from the corners that it connects and those before it on both sides.
    fn need(&self, [a, b]: [usize; 2], apexes: [Option<usize>; 2]) -> f64 {
        let of = |apex: Option<usize>| apex.map_or(0.0, |apex| self.distance([a, b, apex]));
        let off = of(apexes[0]).max(of(apexes[1]));
        off + (self.bend)(a, b)
    }
}

impl Needs {
    /// From the samples of a tile. `is_even` says whether the tile's column and row make an even sum: then its largest
    /// triangles meet in a side from its north-west. Needs above `most` are only known to be above it, and no tolerance
    /// may be larger.
    pub fn new(
        is_even: bool,
        cells: Option<&[u64; CELLS]>,
        field: &Field<'_, impl Fn(usize, usize) -> f64>,
        most: f64,
    ) -> Self {
        let mut of: Box<[f64; SIDE * SIDE]> = Box::new([0.0; SIDE * SIDE]);
        let mut size = 2;
        field.smallest(&mut of, cells);
        size *= 2;
        while size <= CELLS {
            let half = size / 2;
            // Middles of sides: the triangles behind them meet in the middles of squares of half the size.
            for line in (0..=CELLS).step_by(size) {
                for from in (0..CELLS).step_by(size) {
                    for is_row in [true, false] {
                        let at = |along: usize, across: usize| match is_row {
                            true => sample(along, across),
                            false => sample(across, along),
                        };
                        let middle = at(from + half, line);
                        let apexes = [line.checked_sub(half), Some(line + half).filter(|&line| line <= CELLS)];
                        let apexes = apexes.map(|apex| apex.map(|line| at(from + half, line)));
                        let across = line.saturating_sub(half)..(line + half).min(CELLS);
                        let mut need = 0.0f64;
                        for square in across.clone().step_by(half) {
                            need = need.max(of[at(from + half / 2, square + half / 2)]);
                            need = need.max(of[at(from + half + half / 2, square + half / 2)]);
                        }
                        let ends = [at(from, line), at(from + size, line)];
                        if need <= most {
                            need = need.max(field.need(ends, apexes));
                        }
                        if need <= most && line % CELLS == 0 {
                            need = need.max(AT_BORDER * field.along(ends) + (field.bend)(ends[0], ends[1]));
                        }
                        let along = from..from + size;
                        of[middle] = match is_row {
                            true => masked(need, cells, along, across),
                            false => masked(need, cells, across, along),
                        };
                    }
                }
            }
            for row in (0..CELLS).step_by(size) {
                for column in (0..CELLS).step_by(size) {
                    let middle = sample(column + half, row + half);
                    let corner = |x: usize, y: usize| sample(column + x * size, row + y * size);
                    let falls = if size < CELLS { (column / size + row / size).is_multiple_of(2) } else { is_even };
                    let (ends, apexes) = match falls {
                        true => ([corner(0, 0), corner(1, 1)], [corner(1, 0), corner(0, 1)]),
                        false => ([corner(1, 0), corner(0, 1)], [corner(0, 0), corner(1, 1)]),
                    };
                    let sides = [
                        sample(column + half, row),
                        sample(column + half, row + size),
                        sample(column, row + half),
                        sample(column + size, row + half),
                    ];
                    let mut need = sides.iter().fold(0.0f64, |need, &side| need.max(of[side]));
                    if need <= most {
                        need = need.max(field.need(ends, apexes.map(Some)));
                    }
                    of[middle] = masked(need, cells, column..column + size, row..row + size);
                }
            }
            size *= 2;
        }
        // Corners are in the middle of nothing.
        for corner in [sample(0, 0), sample(CELLS, 0), sample(0, CELLS), sample(CELLS, CELLS)] {
            of[corner] = f64::NEG_INFINITY;
        }
        Self { of, from_north_west: is_even }
    }

    /// The largest need that a tolerance does not meet with a halving: no sample is further from its triangle in
    /// height, if lines are even.
    pub fn bound(&self, tolerance: f64) -> f64 {
        let mut most = [0.0; LANES];
        let (chunks, rest) = self.of.as_chunks::<LANES>();
        for needs in chunks {
            for (most, &need) in most.iter_mut().zip(needs) {
                let need = if need <= tolerance { need } else { 0.0 };
                *most = if need > *most { need } else { *most };
            }
        }
        rest.iter().fold(largest(most), |most, &need| if need <= tolerance && need > most { need } else { most })
    }

    /// How many triangles there are at a tolerance, if all cells are drawn.
    pub fn triangle_count(&self, tolerance: f64) -> usize {
        let count = |needs: &mut dyn Iterator<Item = &f64>| needs.filter(|&&need| need > tolerance).count();
        // A halving makes one triangle more, and of a side within the tile two.
        let all = count(&mut self.of.iter());
        let border = (1..CELLS).flat_map(|k| [sample(k, 0), sample(k, CELLS), sample(0, k), sample(CELLS, k)]);
        2 + 2 * all - count(&mut border.map(|at| &self.of[at]))
    }

    /// Hands out the sides of triangles at a tolerance that lie on the border, each with what bounds the distance of
    /// samples from the triangle behind it.
    pub fn for_each_border_side(&self, tolerance: f64, mut with: impl FnMut([u16; 2], f64)) {
        /// A sample so far along a border and so far within the tile.
        type At = fn(usize, usize) -> usize;
        let sides: [At; 4] = [
            |along, within| sample(along, within),
            |along, within| sample(along, CELLS - within),
            |along, within| sample(within, along),
            |along, within| sample(CELLS - within, along),
        ];
        let mut waiting = Vec::with_capacity(8);
        for at in sides {
            waiting.push([0, CELLS]);
            while let Some([from, to]) = waiting.pop() {
                let (middle, length) = ((from + to) / 2, to - from);
                if length > 1 && self.of[at(middle, 0)] > tolerance {
                    waiting.push([middle, to]);
                    waiting.push([from, middle]);
                    continue;
                }
                // The triangle is half of a square, or has its longest side on the border.
                let square = if length > 1 { self.of[at(middle, length / 2)] } else { f64::INFINITY };
                let bound = match (square <= tolerance, length) {
                    (true, _) => square,
                    (false, 1) => 0.0,
                    (false, _) => self.of[at(middle, 0)],
                };
                with([at(from, 0) as u16, at(to, 0) as u16], bound);
            }
        }
    }

    /// Hands out the triangles at a tolerance, also those of empty cells, but none of cells that are not drawn.
    pub fn for_each_triangle(&self, tolerance: f64, cells: Option<&[u64; CELLS]>, with: impl FnMut(TileTriangle)) {
        halve(self.from_north_west, |at| self.of[at] > tolerance, cells, with);
    }

    /// What each sample needs, row by row.
    pub(super) fn of_samples(&self) -> &[f64; SIDE * SIDE] {
        &self.of
    }
}

/// Hands out the triangles of a tile whose triangles are halved where a sample says so: not those of cells that are not
/// drawn.
pub(super) fn halve(
    from_north_west: bool,
    is_halved: impl Fn(usize) -> bool,
    cells: Cells<'_>,
    mut with: impl FnMut(TileTriangle),
) {
    let corner = |column: usize, row: usize| [(column * CELLS) as u8, (row * CELLS) as u8];
    let [north_west, north_east, south_west, south_east] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
    let halves = match from_north_west {
        true => [[south_east, north_west, south_west], [north_west, south_east, north_east]],
        false => [[north_east, south_west, south_east], [south_west, north_east, north_west]],
    };
    // Longest sides run from the first to the second corner. 13 halvings lead to the smallest triangles.
    let mut waiting = Vec::with_capacity(16);
    for half in halves {
        waiting.push(half);
        while let Some([a, b, c]) = waiting.pop() {
            let middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
            // The smallest triangles have the diagonal of a cell.
            if a[0].abs_diff(b[0]) != 1 && is_halved(sample(usize::from(middle[0]), usize::from(middle[1]))) {
                waiting.push([b, c, middle]);
                waiting.push([c, a, middle]);
                continue;
            }
            let is_drawn = cells.is_none_or(|cells| {
                let third = |axis: usize| (usize::from(a[axis]) + usize::from(b[axis]) + usize::from(c[axis])) / 3;
                cells[third(1).min(CELLS - 1)] >> third(0).min(CELLS - 1) & 1 != 0
            });
            if is_drawn {
                with([a, b, c].map(|[column, row]| sample(usize::from(column), usize::from(row)) as u16));
            }
        }
    }
}

/// A need of triangles within a rectangle, of which perhaps not all cells are drawn.
fn masked(need: f64, cells: Cells, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> f64 {
    match cells.map(|cells| drawn(cells, columns, rows)) {
        None | Some([true, true]) => need,
        Some([true, false]) => ALWAYS,
        Some([false, _]) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Twice the area that the triangles cover, in cells; all turn counter-clockwise seen from above, where rows go to
    /// the south.
    fn area(triangles: &[TileTriangle]) -> i64 {
        let doubled = triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|s| [(usize::from(s) % SIDE) as i64, -((usize::from(s) / SIDE) as i64)]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(area > 0, "{triangle:?}");
            area
        });
        doubled.sum()
    }

    /// Edges that only one triangle has.
    fn border(triangles: &[TileTriangle]) -> usize {
        let mut edges = HashMap::<[u16; 2], i32>::new();
        for t in triangles {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        assert!(edges.values().all(|&count| count <= 2));
        edges.values().filter(|&&count| count == 1).count()
    }

    fn triangles(needs: &Needs, tolerance: f64, cells: Cells) -> Vec<TileTriangle> {
        let mut all = vec![];
        needs.for_each_triangle(tolerance, cells, |triangle| all.push(triangle));
        all
    }

    fn height(sample: usize) -> f64 {
        let [x, y] = [(sample % SIDE) as f64, (sample / SIDE) as f64];
        (x * 0.3).sin() * 5.0 + (y * y * 0.01) + f64::from((sample * 7919 % 101) as u32) * 0.02
    }

    fn of_heights(is_even: bool, cells: Cells, height: impl Fn(usize) -> f64) -> Needs {
        let lines: [f64; SIDE] = std::array::from_fn(|k| k as f64);
        let heights: Box<[f64; SIDE * SIDE]> = Box::new(std::array::from_fn(height));
        let bend = |_: usize, _: usize| 0.0;
        Needs::new(is_even, cells, &Field { columns: &lines, rows: &lines, heights: &heights, bend }, f64::INFINITY)
    }

    #[test]
    fn a_tolerance_bounds_the_distance_of_every_sample() {
        let needs = of_heights(true, None, height);
        for tolerance in [0.2, 1.0, 4.0] {
            let mut covered = vec![0; SIDE * SIDE];
            for triangle in triangles(&needs, tolerance, None) {
                let [a, b, c] = triangle.map(|k| [usize::from(k) % SIDE, usize::from(k) / SIDE].map(|x| x as f64));
                let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                for (k, covered) in covered.iter_mut().enumerate() {
                    let p = [(k % SIDE) as f64, (k / SIDE) as f64];
                    let share = |a: [f64; 2], b: [f64; 2]| {
                        ((a[0] - p[0]) * (b[1] - p[1]) - (a[1] - p[1]) * (b[0] - p[0])) / area
                    };
                    let shares = [share(b, c), share(c, a), share(a, b)];
                    if shares.iter().all(|&share| share >= 0.0) {
                        let drawn: f64 = shares.iter().zip(triangle).map(|(share, k)| share * height(k.into())).sum();
                        assert!((drawn - height(k)).abs() <= tolerance + 1e-9);
                        *covered += 1;
                    }
                }
            }
            assert!(covered.iter().all(|&count| count > 0));
        }
    }

    #[test]
    fn every_tolerance_tiles_the_square_without_cracks() {
        for is_even in [true, false] {
            let needs = of_heights(is_even, None, height);
            let mut before = usize::MAX;
            for tolerance in [-1.0, 0.1, 0.5, 2.0, 10.0, 1e9] {
                let triangles = triangles(&needs, tolerance, None);
                assert_eq!(area(&triangles), 2 * (CELLS * CELLS) as i64);
                border(&triangles);
                assert!(triangles.len() <= before);
                before = triangles.len();
            }
            assert_eq!(triangles(&needs, -1.0, None).len(), 2 * CELLS * CELLS);
            assert_eq!(triangles(&needs, 1e9, None).len(), 2);
        }
    }

    #[test]
    fn counts_bounds_and_borders_are_those_of_the_triangles() {
        let needs = of_heights(false, None, height);
        for tolerance in [-1.0, 0.1, 0.5, 2.0, 10.0, 1e9] {
            let triangles = triangles(&needs, tolerance, None);
            assert_eq!(needs.triangle_count(tolerance), triangles.len());
            let mut sides = 0;
            needs.for_each_border_side(tolerance, |_, bound| {
                assert!(bound <= tolerance.max(0.0));
                sides += 1;
            });
            assert_eq!(sides, border(&triangles));
            assert!(needs.bound(tolerance) <= tolerance.max(0.0));
        }
    }

    #[test]
    fn exactly_the_cells_that_are_drawn_are_covered() {
        let mut cells = [0; CELLS];
        for (row, bits) in cells.iter_mut().enumerate() {
            for column in 0..CELLS {
                let away = (column as f64 - 30.0).hypot(row as f64 - 20.0);
                *bits |= u64::from((5.0..28.0).contains(&away)) << column;
            }
        }
        let count: u32 = cells.iter().map(|row| row.count_ones()).sum();
        let needs = of_heights(true, Some(&cells), |_| 0.0);
        let triangles = triangles(&needs, 1.0, Some(&cells));
        assert_eq!(area(&triangles), 2 * i64::from(count));
        assert!(triangles.len() < count as usize);
        border(&triangles);
    }

    #[test]
    fn diagonals_meet_where_quarters_of_a_tile_have_theirs() {
        let mut needs = of_heights(false, None, |_| 0.0);
        for [column, row] in [[32, 32], [32, 0], [0, 32], [64, 32], [32, 64]] {
            needs.of[sample(column, row)] = 2.0;
        }
        let triangles = triangles(&needs, 1.0, None);
        let centre = sample(32, 32) as u16;
        assert!(triangles.len() == 8 && triangles.iter().all(|triangle| triangle.contains(&centre)));
    }
}
