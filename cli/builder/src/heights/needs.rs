//! What the samples of a tile with even lines on a plane need (SPEC.md 22.5), from the distances of squares: the same
//! triangles as readers draw.
//!
//! A triangle is drawn at the tolerances that its own longest side does not exceed and that of the triangle it is half
//! of does. So the error at a tolerance is the largest distance of those triangles whose needs lie on both sides of it,
//! size by size.

use lodpack::heights::CELLS;

use super::squares::{Squares, larger};

/// How much distances from sides along the border of a tile count.
const AT_BORDER: f32 = 2.0;
/// Triangles that are looked at side by side.
const LANES: usize = 8;
/// Sizes of squares in a tile: from 2 cells on.
const SIZES: usize = CELLS.ilog2() as usize;

/// The largest of some numbers and the distances of those triangles that are drawn at a tolerance: their own needs do
/// not exceed it, and those of the triangles before they were halved do.
#[inline(always)]
fn find_drawn(most: &mut [f32; LANES], tolerance: f32, [off, own, before]: [&[f32]; 3]) {
    let of = |most: &mut f32, off: f32, own: f32, before: f32| {
        let is_drawn = (own <= tolerance) & (before > tolerance);
        *most = larger(*most, if is_drawn { off } else { 0.0 });
    };
    let [(off, last_off), (own, last_own), (before, last_before)] = [off, own, before].map(<[f32]>::as_chunks::<LANES>);
    for ((off, own), before) in off.iter().zip(own).zip(before) {
        for lane in 0..LANES {
            of(&mut most[lane], off[lane], own[lane], before[lane]);
        }
    }
    for ((most, &off), (&own, &before)) in most.iter_mut().zip(last_off).zip(last_own.iter().zip(last_before)) {
        of(most, off, own, before);
    }
}

/// What the middles of squares of one size need, and of their sides.
#[derive(Clone, Debug, Default)]
struct Level {
    /// Squares in a row.
    count: usize,
    /// Of sides along rows, line by line.
    rows: Vec<f32>,
    /// Of sides along columns, row by row; one more than squares in each.
    columns: Vec<f32>,
    /// Of squares, row by row.
    middles: Vec<f32>,
}

/// What a tile needs, in steps.
#[derive(Clone, Debug)]
pub struct Needs {
    /// From squares of two cells on.
    levels: [Level; SIZES],
}

/// A tile within a table of squares.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    pub squares: &'a [Squares],
    /// Its first column and row, in cells of the table.
    pub first: [usize; 2],
    /// The distance of its samples in these, as a power of two.
    pub shift: u32,
}

impl<'a> Place<'a> {
    /// The squares of the tile's cells, and the number of the first one in a row of the tile.
    fn row(&self, size: usize, row: usize) -> (&'a Squares, usize) {
        let squares = &self.squares[(size << self.shift).ilog2() as usize - 1];
        let [column, first] = self.first.map(|at| at / squares.size);
        (squares, (first + row) * squares.counts[0] + column)
    }
}

impl Needs {
    /// Of a tile that has all samples of the table in its place.
    pub fn new(place: Place<'_>) -> Self {
        let mut levels: [Level; SIZES] = Default::default();
        for number in 0..SIZES {
            let size = 2 << number;
            let (before, rest) = levels.split_at_mut(number);
            rest[0] = Level::new(place, size, before.last());
        }
        Self { levels }
    }

    /// How many triangles there are at a tolerance.
    pub fn triangle_count(&self, tolerance: f32) -> usize {
        let above = |needs: &[f32]| needs.iter().map(|&need| u32::from(need > tolerance)).sum::<u32>() as usize;
        let mut count = 2;
        for Level { count: n, rows, columns, middles } in &self.levels {
            let inner = 2 * (above(rows) + above(columns) + above(middles));
            let border = above(&rows[..*n]) + above(&rows[n * n..]);
            let ends =
                columns.chunks_exact(n + 1).map(|row| u32::from(row[0] > tolerance) + u32::from(row[*n] > tolerance));
            // A halving makes one triangle more, and of a side within the tile two.
            count += inner - border - ends.sum::<u32>() as usize;
        }
        count
    }

    /// The largest need that a tolerance does not meet with a halving, with what neighbours may add on the border: no
    /// sample of a tile that has all samples is further from its triangle. Looser than [`Self::distance`], and found
    /// faster.
    pub fn bound(&self, tolerance: f32, place: Place<'_>) -> f32 {
        let mut most = [0.0f32; LANES];
        let met = |need: f32| if need <= tolerance { need } else { 0.0 };
        for needs in self.levels.iter().flat_map(|level| [&level.rows, &level.columns, &level.middles]) {
            let (chunks, rest) = needs.as_chunks::<LANES>();
            for chunk in chunks {
                for lane in 0..LANES {
                    most[lane] = larger(most[lane], met(chunk[lane]));
                }
            }
            most[0] = rest.iter().fold(most[0], |most, &need| larger(most, met(need)));
        }
        let mut most = most.into_iter().fold(0.0, larger);
        for (number, level) in self.levels.iter().enumerate() {
            let n = level.count;
            for k in 0..n {
                let needs = level.on_border(k);
                let before = self.levels.get(number + 1).map_or([f32::INFINITY; 4], |above| above.on_border(k / 2));
                let squares = [[k, 0], [k, n - 1], [0, k], [n - 1, k]];
                for side in (0..4).filter(|&side| needs[side] <= tolerance && before[side] > tolerance) {
                    let [column, row] = squares[side];
                    let middle = level.middles[row * n + column];
                    // The triangle is half of the square, or has its longest side on the border.
                    let inside = if middle <= tolerance { middle } else { needs[side] };
                    let (squares, first) = place.row(CELLS / n, row);
                    most = larger(most, inside + squares.along[side][first + column]);
                }
            }
        }
        most
    }

    /// The largest distance of all samples of the table from the triangles at a tolerance, if it is more than `least`.
    pub fn distance(&self, tolerance: f32, place: Place<'_>, least: f32) -> f32 {
        let mut most = [least; LANES];
        if place.shift > 0 {
            self.halves(CELLS, None, Some(&self.levels[0]), tolerance, place, &mut most);
        }
        for (number, level) in self.levels.iter().enumerate() {
            self.halves(level.count, Some(level), self.levels.get(number + 1), tolerance, place, &mut most);
            level.sides(tolerance, place, &mut most);
        }
        most.into_iter().fold(least, larger)
    }

    /// The same for halves of squares, of which there are `count` in a row. Those of a cell have no middle. Each is
    /// half of a triangle on a side of a square of twice the size, unless there is none.
    fn halves(
        &self,
        count: usize,
        level: Option<&Level>,
        above: Option<&Level>,
        tolerance: f32,
        place: Place<'_>,
        most: &mut [f32; LANES],
    ) {
        for row in 0..count {
            let (squares, first) = place.row(CELLS / count, row);
            let mut before = [[f32::INFINITY; CELLS]; 2];
            if let Some(above) = above {
                // Halves in the north of squares in the north lie on rows, and those in the south of squares in the
                // south.
                let (n, half) = (above.count, row % 2);
                let lines = &above.rows[(row / 2 + half) * n..][..n];
                let columns = &above.columns[row / 2 * (n + 1)..][..=n];
                for k in 0..n {
                    before[half][2 * k] = lines[k];
                    before[half][2 * k + 1] = lines[k];
                    before[1 - half][2 * k] = columns[k];
                    before[1 - half][2 * k + 1] = columns[k + 1];
                }
            }
            let mut own = [f32::NEG_INFINITY; CELLS];
            if let Some(level) = level {
                own[..count].copy_from_slice(&level.middles[row * count..][..count]);
            }
            for half in 0..2 {
                let off = &squares.halves[half][first..][..count];
                let before = &before[half][..count];
                find_drawn(most, tolerance, [off, &own[..count], before]);
                // Neighbours add samples to sides on the border.
                let mut at_border = |column: usize, sides: &[usize]| {
                    if own[column] <= tolerance && before[column] > tolerance {
                        let along =
                            sides.iter().fold(0.0, |most, &side| larger(most, squares.along[side][first + column]));
                        most[0] = larger(most[0], off[column] + along);
                    }
                };
                let falls = squares.falls([first % squares.counts[0], first / squares.counts[0]]);
                let is_end = row == 0 || row + 1 == count;
                for column in (0..count).step_by(if is_end { 1 } else { (count - 1).max(1) }) {
                    let falls = falls == column.is_multiple_of(2);
                    // A half has a side along a row and one along a column.
                    let upright = if (half == 0) == falls { 3 } else { 2 };
                    let is_border = [row == 0, row + 1 == count, column == 0, column + 1 == count];
                    match [is_border[half], is_border[upright]] {
                        [false, false] => {}
                        [true, false] => at_border(column, &[half]),
                        [false, true] => at_border(column, &[upright]),
                        [true, true] => at_border(column, &[half, upright]),
                    }
                }
            }
        }
    }
}

impl Level {
    fn new(place: Place<'_>, size: usize, before: Option<&Self>) -> Self {
        let n = CELLS / size;
        let mut this =
            Self { count: n, rows: vec![0.0; n * (n + 1)], columns: vec![0.0; n * (n + 1)], middles: vec![0.0; n * n] };
        let Self { rows, columns, middles, .. } = &mut this;
        for row in 0..n {
            let (squares, first) = place.row(size, row);
            let [north, south, west, east] = [0, 1, 2, 3].map(|side| &squares.sides[side][first..][..n]);
            let along = |side: usize| squares.along[side][first..][..n].iter().map(|&off| AT_BORDER * off);
            let (above, below) = rows[row * n..][..2 * n].split_at_mut(n);
            above.iter_mut().zip(north).for_each(|(need, &off)| *need = larger(*need, off));
            below.iter_mut().zip(south).for_each(|(need, &off)| *need = larger(*need, off));
            if row == 0 {
                above.iter_mut().zip(along(0)).for_each(|(need, off)| *need = larger(*need, off));
            }
            if row + 1 == n {
                below.iter_mut().zip(along(1)).for_each(|(need, off)| *need = larger(*need, off));
            }
            let line = &mut columns[row * (n + 1)..][..=n];
            line.iter_mut().zip(west).for_each(|(need, &off)| *need = larger(*need, off));
            line[1..].iter_mut().zip(east).for_each(|(need, &off)| *need = larger(*need, off));
            line[0] = larger(line[0], AT_BORDER * squares.along[2][first]);
            line[n] = larger(line[n], AT_BORDER * squares.along[3][first + n - 1]);
            middles[row * n..][..n].copy_from_slice(&squares.halves[0][first..][..n]);
            middles[row * n..][..n]
                .iter_mut()
                .zip(&squares.halves[1][first..][..n])
                .for_each(|(need, &off)| *need = larger(*need, off));
        }
        if let Some(before) = before {
            for (row, smaller) in before.middles.chunks_exact(2 * n).enumerate() {
                let (pairs, _) = smaller.as_chunks::<2>();
                // A square of half the size has two sides of itself on sides of this size.
                let line = &mut rows[row.div_ceil(2) * n..][..n];
                line.iter_mut().zip(pairs).for_each(|(need, &[a, b])| *need = larger(*need, larger(a, b)));
                let line = &mut columns[row / 2 * (n + 1)..][..=n];
                for (k, &[a, b]) in pairs.iter().enumerate() {
                    line[k] = larger(line[k], a);
                    line[k + 1] = larger(line[k + 1], b);
                }
            }
        }
        for row in 0..n {
            let (north, south) = (&rows[row * n..][..n], &rows[(row + 1) * n..][..n]);
            let sides = &columns[row * (n + 1)..][..=n];
            for (k, middle) in middles[row * n..][..n].iter_mut().enumerate() {
                *middle = larger(*middle, larger(larger(north[k], south[k]), larger(sides[k], sides[k + 1])));
            }
        }
        this
    }

    /// What the sides in the north, the south, the west and the east need, so far along these.
    fn on_border(&self, k: usize) -> [f32; 4] {
        let n = self.count;
        [self.rows[k], self.rows[n * n + k], self.columns[k * (n + 1)], self.columns[k * (n + 1) + n]]
    }

    /// The largest of some numbers and the distances of samples from the triangles on sides that are drawn at a
    /// tolerance.
    fn sides(&self, tolerance: f32, place: Place<'_>, most: &mut [f32; LANES]) {
        let n = self.count;
        for row in 0..n {
            let (squares, first) = place.row(CELLS / n, row);
            let middles = &self.middles[row * n..][..n];
            let line = &self.columns[row * (n + 1)..][..=n];
            let needs = [&self.rows[row * n..][..n], &self.rows[(row + 1) * n..][..n], &line[..n], &line[1..]];
            for (side, needs) in needs.into_iter().enumerate() {
                let off = &squares.sides[side][first..][..n];
                find_drawn(most, tolerance, [off, needs, middles]);
                let on_border = match side {
                    0 if row == 0 => 0..n,
                    1 if row + 1 == n => 0..n,
                    2 => 0..1,
                    3 => n - 1..n,
                    _ => 0..0,
                };
                for k in on_border.filter(|&k| needs[k] <= tolerance && middles[k] > tolerance) {
                    most[0] = larger(most[0], off[k] + squares.along[side][first + k]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::squares::tests::{off, steps};
    use super::super::squares::{Ground, Squares};
    use super::*;

    type Corner = [usize; 2];

    /// What the middle of a longest side needs.
    fn need(needs: &Needs, [x, y]: Corner) -> f32 {
        let size: usize = 1 << (1 + x.trailing_zeros().min(y.trailing_zeros()));
        let of = |level: &Level, size: usize| match [x, y].map(|at| at % size != 0) {
            [true, true] => level.middles[y / size * level.count + x / size],
            [true, false] => level.rows[y / size * level.count + x / size],
            _ => level.columns[y / size * (level.count + 1) + x / size],
        };
        of(&needs.levels[size.ilog2() as usize - 1], size)
    }

    /// Halves triangles as readers do; the longest side is the first one.
    fn draw(needs: &Needs, tolerance: f32, [a, b, c]: [Corner; 3], out: &mut Vec<[Corner; 3]>) {
        let m = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
        if a[0].abs_diff(b[0]) != 1 && need(needs, m) > tolerance {
            draw(needs, tolerance, [c, a, m], out);
            draw(needs, tolerance, [b, c, m], out);
        } else {
            out.push([a, b, c]);
        }
    }

    #[test]
    fn triangles_and_their_distances_are_those_of_halving() {
        let side = 257;
        let steps = steps(side);
        let ground = Ground::new(steps.iter().copied(), side).unwrap();
        let squares = Squares::all(&ground, 256, true);
        let along = |a: Corner, b: Corner| {
            // A triangle without samples but those on its side.
            let length = a[0].abs_diff(b[0]).max(a[1].abs_diff(b[1]));
            let at = |k: usize| [0, 1].map(|axis| (a[axis] * (length - k) + b[axis] * k) / length);
            let height = |[x, y]: Corner| f64::from(steps[y * side + x]);
            let on = |k: usize| {
                let share = k as f64 / length as f64;
                (height(a) + share * (height(b) - height(a)) - height(at(k))).abs()
            };
            (0..=length).map(on).fold(0.0, f64::max)
        };
        for (shift, tile) in [(0, [1, 2]), (1, [1, 0]), (2, [0, 0])] {
            let first = tile.map(|at| (at * CELLS) << shift);
            let place = Place { squares: &squares, first, shift };
            let own =
                (0..65 * 65).map(|k| steps[(first[1] + ((k / 65) << shift)) * side + first[0] + ((k % 65) << shift)]);
            let own = Ground::new(own.collect::<Vec<_>>().into_iter(), 65).unwrap();
            let own = Squares::all(&own, CELLS, (tile[0] + tile[1]) % 2 == 0);
            let needs = Needs::new(Place { squares: &own, first: [0; 2], shift: 0 });
            for tolerance in [0.0, 3.0, 20.0, 70.0, 300.0, 5000.0] {
                let corner = |x: usize, y: usize| [x * CELLS, y * CELLS];
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
                let halves = match (tile[0] + tile[1]) % 2 {
                    0 => [[d, a, c], [a, d, b]],
                    _ => [[b, c, d], [c, b, a]],
                };
                let mut drawn = vec![];
                halves.into_iter().for_each(|half| draw(&needs, tolerance, half, &mut drawn));
                assert_eq!(needs.triangle_count(tolerance), drawn.len());
                let distance = |triangle: &[Corner; 3]| {
                    let at = triangle.map(|corner| [0, 1].map(|axis| first[axis] + (corner[axis] << shift)));
                    let on_border =
                        |p: Corner, q: Corner| (0..2).any(|axis| p[axis] == q[axis] && [0, CELLS].contains(&p[axis]));
                    let sides =
                        [(0, 1), (1, 2), (2, 0)].into_iter().filter(|&(p, q)| on_border(triangle[p], triangle[q]));
                    off(&steps, side, at) + sides.map(|(p, q)| along(at[p], at[q])).fold(0.0, f64::max)
                };
                let most = drawn.iter().map(distance).fold(0.0, f64::max);
                let found = f64::from(needs.distance(tolerance, place, 0.0));
                assert!(found >= most - 1e-9 && found <= most + 1e-2, "{shift} {tolerance}: {found} {most}");
                assert!(shift > 0 || f64::from(needs.bound(tolerance, place)) >= most - 1e-9);
            }
        }
    }
}
