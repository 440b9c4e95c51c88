//! How far the samples of a plane are from the triangles of all squares of 2^k cells: the table from which both the
//! needs and the errors of tiles with even lines follow (SPEC.md 22.5).
//!
//! A square has a triangle on each of its four sides, whose apex is its middle, and two halves, which meet in a
//! diagonal: from the north-west where its column and its row make an even sum. Whatever the depth of a tile, its
//! triangles are among these, so samples are looked at once for all depths. Slopes are a difference of heights by a
//! power of two; in numbers of 24 bits, heights that differ by no more than 2^16 steps have exact distances in squares
//! of up to 64 cells, and nearly exact ones in larger ones. Small squares are looked at side by side, large ones row by
//! row.

/// Heights differ by at most this many steps.
pub const MOST_STEPS: i64 = 1 << 16;
/// Cells along a side of the largest squares whose distances are exact.
const EXACT: usize = 64;
/// What distances in larger squares may lose by rounding, as a share of the largest difference of heights.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;
/// Samples of a run that are compared side by side.
const RUN: usize = 8;

/// The larger of two numbers that are not NaN: one instruction, which `f32::max` is not.
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Heights in steps above the lowest, row by row.
pub struct Ground {
    heights: Vec<f32>,
    width: usize,
    range: f32,
}

impl Ground {
    /// From steps, row by row; none if they differ by too much.
    pub fn new(steps: impl Iterator<Item = i32> + Clone, width: usize) -> Option<Self> {
        let (low, high) = steps.clone().fold((i32::MAX, i32::MIN), |(low, high), step| (low.min(step), high.max(step)));
        let range = i64::from(high) - i64::from(low);
        // Nothing overflows, since differences have been looked at.
        let heights = || steps.map(|step| (step - low) as f32).collect();
        (range <= MOST_STEPS).then(|| Self { heights: heights(), width, range: range as f32 })
    }

    fn rows(&self) -> usize {
        self.heights.len() / self.width
    }
}

/// The squares of one size: how far samples are from their triangles at most, in steps, row by row.
pub struct Squares {
    /// Cells along a side.
    pub size: usize,
    /// Squares in a row, and rows.
    pub counts: [usize; 2],
    /// Whether the first square's column and row make an odd sum.
    is_odd: bool,
    /// In the triangles on the sides in the north, the south, the west and the east, these included.
    pub sides: [Vec<f32>; 4],
    /// Along the same sides alone.
    pub along: [Vec<f32>; 4],
    /// In the half in the north and that in the south.
    pub halves: [Vec<f32>; 2],
}

/// What is found of some squares.
struct Off<const LANES: usize> {
    sides: [[f32; LANES]; 4],
    along: [[f32; LANES]; 4],
    halves: [[f32; LANES]; 2],
}

impl Squares {
    /// All sizes from 2 cells up to the largest, of which there is one square. It `falls` if its diagonal is from the
    /// north-west.
    pub fn all(ground: &Ground, largest: usize, falls: bool) -> Vec<Self> {
        let sizes = (1..=largest.ilog2()).map(|k| 1usize << k);
        sizes.map(|size| Self::new(ground, size, size == largest && !falls)).collect()
    }

    fn new(ground: &Ground, size: usize, is_odd: bool) -> Self {
        let counts = [(ground.width - 1) / size, (ground.rows() - 1) / size];
        let none = || vec![0.0; counts[0] * counts[1]];
        let mut this = Self {
            size,
            counts,
            is_odd,
            sides: [(); 4].map(|()| none()),
            along: [(); 4].map(|()| none()),
            halves: [(); 2].map(|()| none()),
        };
        for row in 0..counts[1] {
            match size {
                2 => this.side_by_side::<2, 8>(ground, row),
                4 => this.side_by_side::<4, 8>(ground, row),
                8 => this.side_by_side::<8, 4>(ground, row),
                _ => {
                    for column in 0..counts[0] {
                        let off = square(ground, [column, row], size, this.falls([column, row]));
                        this.put([column, row], &off);
                    }
                }
            }
        }
        if size > EXACT {
            let rounding = ground.range * ROUNDING;
            let all = this.sides.iter_mut().chain(&mut this.along).chain(&mut this.halves);
            all.flatten().for_each(|off| *off += rounding);
        }
        this
    }

    /// Whether the diagonal of a square is from its north-west.
    pub fn falls(&self, [column, row]: [usize; 2]) -> bool {
        (column + row + usize::from(self.is_odd)).is_multiple_of(2)
    }

    /// A row of small squares, of which every second one has the same diagonal.
    fn side_by_side<const SIZE: usize, const LANES: usize>(&mut self, ground: &Ground, row: usize) {
        let count = self.counts[0];
        let lines: [&[f32]; 9] =
            std::array::from_fn(|y| &ground.heights[(row * SIZE + y.min(SIZE)) * ground.width..][..ground.width]);
        for first in (0..count).step_by(2 * LANES) {
            for odd in 0..2 {
                // Beyond the last one, the last one is looked at again.
                let at = |x: usize, y: usize| -> [f32; LANES] {
                    let line = lines[y];
                    match (first + 2 * LANES) <= count {
                        true => {
                            let run = &line[(first + odd) * SIZE + x..];
                            std::array::from_fn(|lane| run[2 * lane * SIZE])
                        }
                        false => std::array::from_fn(|lane| line[(first + 2 * lane + odd).min(count - 1) * SIZE + x]),
                    }
                };
                let off = match (row + odd) % 2 {
                    0 => squares::<SIZE, LANES, true>(at),
                    _ => squares::<SIZE, LANES, false>(at),
                };
                for lane in 0..LANES {
                    let column = first + 2 * lane + odd;
                    if column < count {
                        let at = row * count + column;
                        (0..4).for_each(|side| self.sides[side][at] = off.sides[side][lane]);
                        (0..4).for_each(|side| self.along[side][at] = off.along[side][lane]);
                        (0..2).for_each(|half| self.halves[half][at] = off.halves[half][lane]);
                    }
                }
            }
        }
    }

    fn put(&mut self, [column, row]: [usize; 2], off: &Off<1>) {
        let at = row * self.counts[0] + column;
        (0..4).for_each(|side| self.sides[side][at] = off.sides[side][0]);
        (0..4).for_each(|side| self.along[side][at] = off.along[side][0]);
        (0..2).for_each(|half| self.halves[half][at] = off.halves[half][0]);
    }
}

/// Looks at squares together whose diagonals are alike. `at` has the samples of all of them at a place in the square.
#[inline(always)]
fn squares<const SIZE: usize, const LANES: usize, const FALLS: bool>(
    at: impl Fn(usize, usize) -> [f32; LANES],
) -> Off<LANES> {
    let [a, b, c, d] = [at(0, 0), at(SIZE, 0), at(0, SIZE), at(SIZE, SIZE)];
    let middle = at(SIZE / 2, SIZE / 2);
    let mut off = Off { sides: [[0.0; LANES]; 4], along: [[0.0; LANES]; 4], halves: [[0.0; LANES]; 2] };
    let share = |k: usize| k as f32 / SIZE as f32;
    for k in 1..SIZE {
        let along = share(k);
        let sides = [(k, 0, &a, &b), (k, SIZE, &c, &d), (0, k, &a, &c), (SIZE, k, &b, &d)];
        for (side, (x, y, from, to)) in sides.into_iter().enumerate() {
            let own = at(x, y);
            for lane in 0..LANES {
                let distance = (from[lane] + along * (to[lane] - from[lane]) - own[lane]).abs();
                off.along[side][lane] = larger(off.along[side][lane], distance);
            }
        }
    }
    off.sides = off.along;
    // The halves have two sides each.
    for (half, side) in [(0, 0), (1, 1), (usize::from(FALLS), 2), (usize::from(!FALLS), 3)] {
        for lane in 0..LANES {
            off.halves[half][lane] = larger(off.halves[half][lane], off.along[side][lane]);
        }
    }
    for y in 1..SIZE {
        for x in 1..SIZE {
            let own = at(x, y);
            let (east, south) = (share(x), share(y));
            let is_in =
                [x >= y && x + y <= SIZE, y >= x && x + y >= SIZE, y >= x && x + y <= SIZE, x >= y && x + y >= SIZE];
            // Along the side, and on towards the middle of the square.
            let (from, to, along, away) = match is_in {
                [true, ..] => (&a, &b, east, south),
                [_, true, ..] => (&c, &d, east, 1.0 - south),
                [_, _, true, _] => (&a, &c, south, east),
                _ => (&b, &d, south, 1.0 - east),
            };
            if 2 * x != SIZE || 2 * y != SIZE {
                let distance: [f32; LANES] = std::array::from_fn(|lane| {
                    let (from, to) = (from[lane], to[lane]);
                    (from + along * (to - from) + away * (2.0 * middle[lane] - from - to) - own[lane]).abs()
                });
                for (of, _) in off.sides.iter_mut().zip(is_in).filter(|&(_, is_in)| is_in) {
                    for lane in 0..LANES {
                        of[lane] = larger(of[lane], distance[lane]);
                    }
                }
            }
            // From a corner to its neighbours in the same row and in the same column.
            let is_north = if FALLS { x >= y } else { x + y <= SIZE };
            let is_south = if FALLS { x <= y } else { x + y >= SIZE };
            let (from, beside, above, [right, down]) = match (FALLS, is_north) {
                (true, true) => (&b, &a, &d, [1.0 - east, south]),
                (true, false) => (&c, &d, &a, [east, 1.0 - south]),
                (false, true) => (&a, &b, &c, [east, south]),
                (false, false) => (&d, &c, &b, [1.0 - east, 1.0 - south]),
            };
            for lane in 0..LANES {
                let from = from[lane];
                let distance = (from + right * (beside[lane] - from) + down * (above[lane] - from) - own[lane]).abs();
                if is_north {
                    off.halves[0][lane] = larger(off.halves[0][lane], distance);
                }
                if is_south {
                    off.halves[1][lane] = larger(off.halves[1][lane], distance);
                }
            }
        }
    }
    off
}

/// The largest of some numbers and the distances of a run of samples from heights that rise evenly from its first one
/// on.
#[inline(always)]
fn run(most: &mut [f32; RUN], samples: &[f32], first: f32, rise: f32) {
    let mut places = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let (chunks, rest) = samples.as_chunks::<RUN>();
    for chunk in chunks {
        for lane in 0..RUN {
            most[lane] = larger(most[lane], (first + rise * places[lane] - chunk[lane]).abs());
            places[lane] += RUN as f32;
        }
    }
    for (lane, &own) in rest.iter().enumerate() {
        most[lane] = larger(most[lane], (first + rise * places[lane] - own).abs());
    }
}

/// Looks at a square row by row.
fn square(ground: &Ground, [column, row]: [usize; 2], size: usize, falls: bool) -> Off<1> {
    let line = |y: usize| &ground.heights[(row * size + y) * ground.width + column * size..][..=size];
    let [a, b, c, d] = [line(0)[0], line(0)[size], line(size)[0], line(size)[size]];
    let (middle, cell) = (line(size / 2)[size / 2], 1.0 / size as f32);
    let (mut sides, mut along, mut halves) = ([[0.0; RUN]; 4], [[0.0f32; RUN]; 4], [[0.0; RUN]; 2]);
    // What the triangle on a side rises from the side on, a cell.
    let inwards = |from: f32, to: f32| (2.0 * middle - from - to) * cell;
    let [from_north, from_south, from_west, from_east] =
        [(a, b), (c, d), (a, c), (b, d)].map(|(from, to)| inwards(from, to));
    run(&mut along[0], line(0), a, (b - a) * cell);
    run(&mut along[1], line(size), c, (d - c) * cell);
    for y in 1..size {
        let row = line(y);
        let (down, up) = (y as f32 * cell, (size - y) as f32 * cell);
        let [left, right] = [a + down * (c - a), b + down * (d - b)];
        along[2][0] = larger(along[2][0], (left - row[0]).abs());
        along[3][0] = larger(along[3][0], (right - row[size]).abs());
        // The triangle in the north or the south reaches from one of the square's diagonals to the other.
        let near = y.min(size - y);
        let (side, rise, first) = match 2 * y <= size {
            true => (0, (b - a) * cell, a + y as f32 * from_north),
            false => (1, (d - c) * cell, c + (size - y) as f32 * from_south),
        };
        run(&mut sides[side], &row[near..=size - near], first + near as f32 * rise, rise);
        run(&mut sides[2], &row[..=near], left, from_west);
        run(&mut sides[3], &row[size - near..], right + near as f32 * from_east, -from_east);
        match falls {
            true => {
                run(&mut halves[1], &row[..=y], left, (d - c) * cell);
                run(&mut halves[0], &row[y..], a + down * (d - b) + down * (b - a), (b - a) * cell);
            }
            false => {
                run(&mut halves[0], &row[..=size - y], left, (b - a) * cell);
                run(&mut halves[1], &row[size - y..], d + up * (b - d) + down * (c - d), (d - c) * cell);
            }
        }
    }
    let largest = |of: [f32; RUN]| of.into_iter().fold(0.0, larger);
    let along = along.map(largest);
    let sides: [f32; 4] = std::array::from_fn(|side| larger(largest(sides[side]), along[side]));
    let mut halves = halves.map(largest);
    for (half, side) in [(0, 0), (1, 1), (usize::from(falls), 2), (usize::from(!falls), 3)] {
        halves[half] = larger(halves[half], along[side]);
    }
    Off { sides: sides.map(|of| [of]), along: along.map(|of| [of]), halves: halves.map(|of| [of]) }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Rough ground with the given number of samples a side.
    pub fn steps(side: usize) -> Vec<i32> {
        let mut state = 7u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 24)
        };
        let hill = |x: usize, y: usize| 900.0 * libm::sin(0.04 * x as f64) * libm::cos(0.03 * y as f64);
        (0..side * side).map(|k| (hill(k % side, k / side) + 0.2 * noise()) as i32).collect()
    }

    /// The largest distance of samples from a triangle between samples, which are given by column and row.
    pub fn off(steps: &[i32], side: usize, corners: [[usize; 2]; 3]) -> f64 {
        let height = |[x, y]: [usize; 2]| f64::from(steps[y * side + x]);
        let cross = |[a, b, c]: [[usize; 2]; 3]| {
            let [[u, v], [x, y]] = [b, c].map(|p| [0, 1].map(|axis| p[axis] as i64 - a[axis] as i64));
            (u * y - x * v) as f64
        };
        let [a, b, c] = corners;
        let (area, mut most) = (cross(corners), 0.0f64);
        let ends = |axis: usize| {
            let all = corners.map(|corner| corner[axis]);
            *all.iter().min().unwrap()..=*all.iter().max().unwrap()
        };
        for at in ends(1).flat_map(|y| ends(0).map(move |x| [x, y])) {
            let shares = [[at, b, c], [a, at, c], [a, b, at]].map(|triangle| cross(triangle) / area);
            if shares.iter().all(|&share| share >= 0.0) {
                let drawn: f64 = shares.iter().zip(corners).map(|(share, corner)| share * height(corner)).sum();
                most = most.max((drawn - height(at)).abs());
            }
        }
        most
    }

    #[test]
    fn distances_are_those_of_all_samples_of_the_triangles() {
        let side = 257;
        let steps = steps(side);
        let ground = Ground::new(steps.iter().copied(), side).unwrap();
        let all = Squares::all(&ground, 256, false);
        assert_eq!(all.iter().map(|squares| squares.size).collect::<Vec<_>>(), [2, 4, 8, 16, 32, 64, 128, 256]);
        for squares in &all {
            let (n, [columns, rows]) = (squares.size, squares.counts);
            assert_eq!([columns, rows], [256 / n; 2]);
            for number in (0..columns * rows).step_by(1 + columns * rows / 50) {
                let [column, row] = [number % columns, number / columns];
                let at = |x: usize, y: usize| [column * n + x, row * n + y];
                let [a, b, c, d, m] = [at(0, 0), at(n, 0), at(0, n), at(n, n), at(n / 2, n / 2)];
                let halves = match squares.falls([column, row]) {
                    true => [[a, b, d], [a, d, c]],
                    false => [[a, b, c], [b, d, c]],
                };
                let slack = if n > EXACT { 2e-3 } else { 0.0 };
                let is_right = |found: f32, corners: [[usize; 2]; 3]| {
                    let distance = off(&steps, side, corners);
                    let off = f64::from(found);
                    assert!(off >= distance - 1e-9 && off <= distance + slack + 1e-9, "{n} {off} {distance}");
                };
                for (side, [p, q]) in [[a, b], [c, d], [a, c], [b, d]].into_iter().enumerate() {
                    is_right(squares.sides[side][number], [p, q, m]);
                    assert!(squares.along[side][number] <= squares.sides[side][number]);
                }
                (0..2).for_each(|half| is_right(squares.halves[half][number], halves[half]));
            }
        }
        let cliff = [0, 0, 0, 1 << 17];
        assert!(Ground::new(cliff.into_iter(), 2).is_none());
    }
}
