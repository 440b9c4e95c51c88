//! Tiles whose samples are equally far apart: how far their triangles are from the samples below.
//!
//! On a globe, a point of a triangle is compared with the sample of the same column and row. Between them lies the
//! point of the same height as that of the triangle, if heights changed evenly along the globe: it is as far from the
//! sample as the heights differ, and as far from the triangle as the globe bends there. So both together bound the
//! distance, and no sample has to be placed in space.

use lodpack::heights::{Base, CELLS, DrawnTile, SIDE, TileTriangle};

use super::facets::{Corner, Judge, Plane, ROUNDED_DOWN, Steps};

/// Distances are sums of a few products, of which each is rounded.
const ROUNDED_UP: f64 = 1.0 + 1e-12;
/// Triangles have sides of up to this many cells, a power of two.
const SIZES: usize = CELLS.ilog2() as usize + 1;

/// A tile with its samples at a distance of a power of two, all of whose samples lie in a window.
pub struct Even<'a> {
    steps: &'a Steps,
    /// Samples from one of the tile to the next, as a power of two.
    shift: u32,
    /// The first column and the first row.
    first: [i64; 2],
    /// By kind of triangle and size, what the globe adds; none on a plane.
    bends: Option<[[Bend; SIZES]; 3]>,
}

/// How far a triangle is from the globe that it stands for.
#[derive(Clone, Copy, Debug, Default)]
struct Bend {
    /// Where it is level.
    level: f64,
    /// For each unit that its corners differ in height.
    risen: f64,
}

impl<'a> Even<'a> {
    /// A tile that is even: all its cells are drawn, its samples lie in the window of the judge and none is at a pole.
    pub fn new(judge: &Judge<'_>, tile: &DrawnTile, steps: &'a Steps, is_full: bool) -> Option<Self> {
        let [across, down] = tile.lines.distances().filter(|[across, _]| across.is_power_of_two())?;
        let is_within = |[first, last]: [u64; 2], lines: &[u64; SIDE]| first <= lines[0] && lines[CELLS] <= last;
        let window = judge.window;
        let is_inside = is_within(window.columns, &tile.lines.columns) && is_within(window.rows, &tile.lines.rows);
        let is_globe = judge.surface.is_globe();
        let rows = [tile.lines.rows[0], tile.lines.rows[CELLS]];
        let has_pole = is_globe && rows.iter().any(|&row| latitude(judge, row).abs() >= 90.0);
        if across != down || !is_full || !is_inside || judge.has_voids() || has_pole {
            return None;
        }
        let bends = is_globe.then(|| bends(judge, across, rows));
        let first = [tile.lines.columns[0], tile.lines.rows[0]].map(|line| line as i64);
        Some(Self { steps, shift: across.trailing_zeros(), first, bends })
    }

    /// A bound of the distance of samples from a triangle, or some smaller number than `known` if the bound is not
    /// above that.
    pub fn distance(&self, judge: &Judge<'_>, triangle: TileTriangle, known: f64) -> f64 {
        // The longest side runs from the first to the second corner.
        let index = triangle.map(|at| [usize::from(at) % SIDE, usize::from(at) / SIDE]);
        let heights = triangle.map(|at| self.steps[usize::from(at)]);
        let is_smallest = index[0][0].abs_diff(index[1][0]) == 1 && index[0][1].abs_diff(index[1][1]) == 1;
        if is_smallest && self.shift == 0 {
            return 0.0;
        }
        let bend = match &self.bends {
            None => 0.0,
            Some(bends) => {
                let [a, b, _] = index;
                let [across, down] = [0, 1].map(|axis| a[axis].abs_diff(b[axis]));
                let kind = if across == down { 0 } else { 1 + usize::from(across == 0) };
                let Bend { level, risen } = bends[kind][across.max(down).trailing_zeros() as usize];
                let (low, high) = heights.iter().fold((i32::MAX, i32::MIN), |(a, b), &h| (a.min(h), b.max(h)));
                level + risen * (f64::from(high) - f64::from(low)) * judge.step()
            }
        };
        let least = ((known - bend) / judge.step() * ROUNDED_DOWN).max(0.0);
        let heights = heights.map(f64::from);
        let corner = |k: usize| Corner {
            column: self.first[0] + ((index[k][0] as i64) << self.shift),
            row: self.first[1] + ((index[k][1] as i64) << self.shift),
            height: heights[k],
        };
        let corners @ [a, b, c] = [corner(0), corner(1), corner(2)];
        if let Some(off) = judge.of_square(&corners) {
            return (off * judge.step() + bend) * ROUNDED_UP;
        }
        let off = match self.shift {
            // Two samples lie between corners, and no others.
            1 if is_smallest => {
                let middle = |p: Corner, q: Corner| {
                    let (column, row) = ((p.column + q.column) / 2, (p.row + q.row) / 2);
                    let step = judge.window.step(column as u64, row as u64);
                    (0.5 * (p.height + q.height) - f64::from(step)).abs()
                };
                middle(a, b).max(middle(b, c)).max(middle(c, a))
            }
            _ => {
                // The shorter sides are equally long and at a right angle, so slopes along them add up.
                let [[ax, ay], [bx, by]] = [a, b].map(|p| [(p.column - c.column) as f64, (p.row - c.row) as f64]);
                let share = 1.0 / (ax * ax + ay * ay);
                let (to_a, to_b) = ((a.height - c.height) * share, (b.height - c.height) * share);
                let plane = Plane { east: to_a * ax + to_b * bx, south: to_a * ay + to_b * by, first: c };
                let mut most = least;
                judge.in_even(&corners, &plane, &mut most);
                most
            }
        };
        (off * judge.step() + bend) * ROUNDED_UP
    }
}

/// The latitude of a row in degrees.
fn latitude(judge: &Judge<'_>, row: u64) -> f64 {
    judge.surface.first[1] + row as f64 * judge.surface.spacing[1]
}

/// What the globe adds for each kind of triangle (longest side along a diagonal, a row or a column) and size, in a tile
/// between two rows.
///
/// A smooth surface f is off a triangle between its points by half the sum, over its sides, of the products of both
/// ends' shares and the second derivative of f along the side. Shares of the ends of one side have a product of a
/// quarter at most, so the whole is at most an eighth of the longest side's derivative or of the two others' together.
fn bends(judge: &Judge<'_>, distance: u64, rows: [u64; 2]) -> [[Bend; SIZES]; 3] {
    let Base::Ellipsoid { axis, eccentricity } = judge.surface.base else { return Default::default() };
    let latitudes = rows.map(|row| latitude(judge, row).to_radians());
    let sine = latitudes.iter().fold(0.0f64, |most, &at| most.max(libm::sin(at).abs()));
    let cosine = match latitudes[0] > 0.0 && latitudes[1] < 0.0 {
        true => 1.0,
        false => latitudes.iter().fold(0.0f64, |most, &at| most.max(libm::cos(at))),
    };
    // No radius of curvature is larger.
    let radius = axis / (1.0 - eccentricity).sqrt() + judge.highest.max(0.0);
    let [to_east, to_south] = judge.surface.spacing.map(|degrees| degrees.abs().to_radians() * distance as f64);
    // Of a side over that many cells: the second derivative, and the angle that it spans.
    let side = |across: f64, down: f64| {
        let [x, y] = [across * to_east, down * to_south];
        let vertical = radius * (cosine * cosine * x * x + y * y);
        let north = radius * (cosine * sine * x * x + 2.0 * eccentricity * y * y);
        let east = 2.0 * radius * sine * x * y;
        let angle = (cosine * cosine * x * x + y * y).sqrt();
        [(vertical * vertical + north * north + east * east).sqrt(), angle]
    };
    let of = |sides: [[f64; 2]; 3]| {
        let [longest, one, other] = sides.map(|[across, down]| side(across, down));
        let both = |k: usize| longest[k].max(one[k] + other[k]) / 8.0;
        // The normal turns by the angle, twice: along a side both the height and the normal change.
        Bend { level: both(0), risen: 2.0 * both(1) }
    };
    let size = |k: usize| (1u64 << k) as f64;
    let kind = |sides: &dyn Fn(f64) -> [[f64; 2]; 3]| std::array::from_fn(|k| of(sides(size(k))));
    [
        kind(&|l| [[l, l], [l, 0.0], [0.0, l]]),
        kind(&|l| [[l, 0.0], [l / 2.0, l / 2.0], [l / 2.0, l / 2.0]]),
        kind(&|l| [[0.0, l], [l / 2.0, l / 2.0], [l / 2.0, l / 2.0]]),
    ]
}
