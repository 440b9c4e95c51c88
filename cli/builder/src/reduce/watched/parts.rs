//! What is known of the groups of points, of the triangles of a watched patch and of all of it.

use glam::{DVec3, Vec3};

use crate::reduce::cells::Seen;
use crate::reduce::grouped::Bounds;
use lodpack_stage::certify::{Numbers, Single, TOGETHER};
use lodpack_stage::nearest::SHARE_OF_OPPOSITE;

/// Where each point of a group is seen.
#[derive(Clone)]
pub(super) struct Found {
    pub triangles: [u32; TOGETHER],
    /// Squared distances.
    pub squares: Numbers,
    /// Cells of the triangles.
    pub cells: [u32; TOGETHER],
    pub is_opposite: [bool; TOGETHER],
}

/// Decides whether moving a vertex can change where a group is seen. All groups are asked at each move.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    pub bounds: Bounds,
    /// The largest squared distance of its points.
    pub most: f32,
    /// A bit for each of the triangles that its points are seen on, which several may share.
    pub bits: u64,
}

/// What a cell of a triangle has.
#[derive(Clone, Copy, Default)]
pub(super) struct Cell {
    /// Weight, colours and squares of colours of all its points.
    pub all: [f64; 5],
    /// Weight and colours as they count for what is shown.
    pub shown: [f64; 4],
}

/// A triangle of the patch, and what is seen on it.
#[derive(Clone)]
pub(super) struct Triangle {
    pub single: Single,
    pub normal: DVec3,
    pub bounds: Bounds,
    /// How many cells there are along the longest side.
    pub columns: u32,
    pub cells: Vec<Cell>,
    /// The sum of squares that its cells are off.
    pub error: f64,
    /// Squared distances of its own points from the surface, by area, and the area.
    pub own: [f64; 2],
}

/// Sums over all points.
#[derive(Clone, Copy, Default)]
pub(super) struct Totals {
    pub error: f64,
    pub distances: f64,
    pub own: [f64; 2],
}

impl Cell {
    pub fn add(&mut self, colour: [f32; 3], weight: f64, is_opposite: bool) {
        let [red, green, blue] = colour.map(f64::from);
        let values = [1.0, red, green, blue, red * red + green * green + blue * blue];
        let share = if is_opposite { f64::from(SHARE_OF_OPPOSITE) } else { 1.0 };
        (0..5).for_each(|k| self.all[k] += weight * values[k]);
        (0..4).for_each(|k| self.shown[k] += weight * share * values[k]);
    }

    /// The sum of squares by which its points are off what it shows.
    pub fn error(&self) -> f64 {
        let [weight, shown @ ..] = self.shown;
        if weight <= 0.0 {
            return 0.0;
        }
        let [mut product, mut square] = [0.0; 2];
        for (shown, all) in shown.into_iter().zip(&self.all[1..4]) {
            let mean = shown / weight;
            (product, square) = (product + mean * all, square + mean * mean);
        }
        (self.all[4] - 2.0 * product + square * self.all[0]) / 3.0
    }
}

impl Found {
    pub fn new(of_point: impl Fn(usize) -> (u32, f32, u32, bool)) -> Self {
        let known: [_; TOGETHER] = std::array::from_fn(of_point);
        Self {
            triangles: known.map(|(triangle, ..)| triangle),
            squares: known.map(|(_, square, ..)| square),
            cells: known.map(|(_, _, cell, _)| cell),
            is_opposite: known.map(|(.., is_opposite)| is_opposite),
        }
    }

    pub fn reach(&self, bounds: Bounds) -> Reach {
        let most = self.squares.iter().copied().fold(0.0, f32::max);
        Reach { bounds, most, bits: self.triangles.iter().fold(0, |bits, &triangle| bits | bit(triangle)) }
    }
}

pub(super) fn bit(triangle: u32) -> u64 {
    1 << (triangle % u64::BITS)
}

impl Triangle {
    /// What is seen at a point of a group, whose foot on this triangle is known.
    pub fn seen(&self, size: f32, at: [f32; 2], normal: Vec3) -> (u32, bool) {
        // The conversions saturate.
        let [column, row] = at.map(|at| (at / size) as u32);
        let rows = self.cells.len() as u32 / self.columns;
        let cell = row.min(rows - 1) * self.columns + column.min(self.columns - 1);
        (cell, self.normal.dot(normal.as_dvec3()) <= 0.0)
    }

    pub fn error(&self) -> f64 {
        self.cells.iter().map(Cell::error).sum()
    }
}

impl Totals {
    pub fn value(&self, area: f64) -> f64 {
        let [squares, of_patch] = self.own;
        let &Self { error: sum, distances, .. } = self;
        Seen { sum, area, distances, of_patch: squares / of_patch, far: vec![] }.value()
    }

    /// Counts what is seen on a triangle, once more or once less.
    pub fn add(&mut self, triangle: &Triangle, sign: f64) {
        self.error += sign * triangle.error;
        (0..2).for_each(|k| self.own[k] += sign * triangle.own[k]);
    }
}
