//! The samples of a block, and how far they are from straight triangles and lines between some of them.

use lodpack::heights::{Line, Surface};

use super::delaunay::Delaunay;

/// How far from a side of a triangle a sample lies on it, in columns: sides pass others at a distance of at least one
/// over their length.
const ON_SIDE: f64 = 1e-6;
/// Distances are compared in this many lanes.
const LANES: usize = 4;

/// Samples of a rectangle.
#[derive(Debug)]
pub struct Ground {
    pub width: usize,
    pub height: usize,
    /// In units of coordinates, row by row; NaN without data.
    pub heights: Vec<f64>,
    /// Of a globe.
    pub round: Option<Round>,
}

/// Where the samples of a block lie on a globe.
#[derive(Debug)]
pub struct Round {
    pub surface: Surface,
    pub columns: Vec<Line>,
    pub rows: Vec<Line>,
    /// Numbers of rows, of which those behind a pole lie at the pole.
    pub down: Vec<f64>,
}

/// The sample that is furthest from a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Furthest {
    /// Its distance, along the vertical on a plane, and in space on a globe.
    pub off: f64,
    pub at: [i32; 2],
}

/// What changes evenly over a triangle.
#[derive(Clone, Copy)]
struct Plane {
    first: f64,
    east: f64,
    south: f64,
}

impl Ground {
    #[inline]
    fn at(&self, [column, row]: [i32; 2]) -> f64 {
        self.heights[row as usize * self.width + column as usize]
    }

    pub fn has_data(&self, at: [i32; 2]) -> bool {
        !self.at(at).is_nan()
    }

    /// Whether all four corners of the cell to the south-east of a sample have data.
    pub fn is_drawn(&self, [column, row]: [i32; 2]) -> bool {
        [[0, 0], [1, 0], [0, 1], [1, 1]].into_iter().all(|[x, y]| self.has_data([column + x, row + y]))
    }

    fn down(&self, row: i32) -> f64 {
        self.round.as_ref().map_or(f64::from(row), |round| round.down[row as usize])
    }

    fn place(&self, round: &Round, at: [i32; 2]) -> [f64; 3] {
        let height = self.at(at) / round.surface.height_scale;
        round.surface.position(round.columns[at[0] as usize], round.rows[at[1] as usize], height)
    }

    /// The distance of a sample from what is straight between two others on its column or its row; 0 without data.
    pub fn off_line(&self, a: [i32; 2], b: [i32; 2], at: [i32; 2]) -> f64 {
        let along = |p: [i32; 2]| f64::from(p[0]) + self.down(p[1]);
        let share = (along(at) - along(a)) / (along(b) - along(a));
        let off = match &self.round {
            None => (self.at(a) + share * (self.at(b) - self.at(a)) - self.at(at)).abs(),
            Some(round) => {
                let [a, b, p] = [a, b, at].map(|at| self.place(round, at));
                let off = [0, 1, 2].map(|k| a[k] + share * (b[k] - a[k]) - p[k]);
                (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt()
            }
        };
        if off.is_nan() { 0.0 } else { off }
    }

    /// The sample that is furthest from a triangle, of those within it and on its sides; those without data count as on
    /// it.
    pub fn furthest(&self, all: &Delaunay, number: u32) -> Furthest {
        let corners = all.places(number);
        let found = match &self.round {
            None => self.furthest_on_plane(corners),
            Some(round) => self.furthest_on_globe(round, corners),
        };
        // What a corner is off has been lost by rounding.
        if corners.contains(&found.at) { Furthest::default() } else { found }
    }

    /// How a value changes over a triangle, from those at its corners.
    fn plane(&self, corners: [[i32; 2]; 3], values: [f64; 3]) -> Plane {
        let at = corners.map(|[column, row]| [f64::from(column), self.down(row)]);
        let [a, b, c] = at;
        let ([u, v], [x, y]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let (p, q) = (values[1] - values[0], values[2] - values[0]);
        let determinant = u * y - x * v;
        let (east, south) = ((p * y - q * v) / determinant, (q * u - p * x) / determinant);
        Plane { first: values[0] - east * a[0] - south * a[1], east, south }
    }

    fn furthest_on_plane(&self, corners: [[i32; 2]; 3]) -> Furthest {
        let Plane { first, east, south } = self.plane(corners, corners.map(|corner| self.at(corner)));
        let mut found = Furthest::default();
        for_each_row(corners, |row, [from, to]| {
            let first = first + south * f64::from(row);
            let start = row as usize * self.width;
            let run = &self.heights[start + from as usize..=start + to as usize];
            let off = |k: usize, height: f64| (first + east * (from as usize + k) as f64 - height).abs();
            if largest(run, off) > found.off {
                for (k, &height) in run.iter().enumerate() {
                    let off = off(k, height);
                    if off > found.off {
                        found = Furthest { off, at: [from + k as i32, row] };
                    }
                }
            }
        });
        found
    }

    fn furthest_on_globe(&self, round: &Round, corners: [[i32; 2]; 3]) -> Furthest {
        let places = corners.map(|corner| self.place(round, corner));
        let planes = [0, 1, 2].map(|axis| self.plane(corners, places.map(|place| place[axis])));
        let mut found = Furthest::default();
        for_each_row(corners, |row, [from, to]| {
            let down = self.down(row);
            for column in from..=to {
                let place = self.place(round, [column, row]);
                let off = [0, 1, 2].map(|k| {
                    let Plane { first, east, south } = planes[k];
                    first + east * f64::from(column) + south * down - place[k]
                });
                let square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                if square > found.off {
                    found = Furthest { off: square, at: [column, row] };
                }
            }
        });
        Furthest { off: found.off.sqrt(), ..found }
    }
}

/// The largest of some numbers that are not negative; those that are none do not count.
#[inline]
fn largest(run: &[f64], off: impl Fn(usize, f64) -> f64) -> f64 {
    let mut most = [0.0f64; LANES];
    let (chunks, rest) = run.as_chunks::<LANES>();
    for (number, chunk) in chunks.iter().enumerate() {
        for (lane, most) in most.iter_mut().enumerate() {
            let off = off(number * LANES + lane, chunk[lane]);
            *most = if off > *most { off } else { *most };
        }
    }
    let done = run.len() - rest.len();
    let rest = rest.iter().enumerate().fold(0.0, |most, (k, &height)| {
        let off = off(done + k, height);
        if off > most { off } else { most }
    });
    most.into_iter().fold(rest, f64::max)
}

/// Calls `with` for each row of a triangle with its first and last column.
fn for_each_row(mut corners: [[i32; 2]; 3], mut with: impl FnMut(i32, [i32; 2])) {
    corners.sort_unstable_by_key(|&[_, row]| row);
    let [a, b, c] = corners;
    let slope = |from: [i32; 2], to: [i32; 2]| match to[1] - from[1] {
        0 => 0.0,
        rows => f64::from(to[0] - from[0]) / f64::from(rows),
    };
    let (long, upper, lower) = (slope(a, c), slope(a, b), slope(b, c));
    let (least, most) = (a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]));
    for row in a[1]..=c[1] {
        let one = f64::from(a[0]) + long * f64::from(row - a[1]);
        let other = match row <= b[1] && b[1] > a[1] {
            true => f64::from(a[0]) + upper * f64::from(row - a[1]),
            false => f64::from(b[0]) + lower * f64::from(row - b[1]),
        };
        // No column is negative, so casts round down.
        let (from, to) = ((one.min(other) + (1.0 - ON_SIDE)) as i32, (one.max(other) + ON_SIDE) as i32);
        let (from, to) = (from.max(least), to.min(most));
        if from <= to {
            with(row, [from, to]);
        }
    }
}
