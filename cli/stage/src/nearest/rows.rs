//! Points of a triangle in rows, and blocks of them: where one triangle of another surface is closest to all of a
//! block, it is looked for once.

use std::ops::Range;

use glam::DVec3;

/// Distance between the points of the source that are looked at, in texels.
pub const SPACING: f64 = 0.7;

/// Points that can be divided into blocks whose points lie close together.
pub trait Blocks {
    /// Some of the points.
    type Block;
    /// The corners of a body that holds points.
    type Corners: AsRef<[DVec3]>;

    /// The block of all points.
    fn whole(&self) -> Self::Block;

    /// How many points of a block there are, and the corners of a convex body that holds all of them, if there are any.
    fn bounds(&self, block: &Self::Block) -> (usize, Self::Corners);

    /// The two halves of a block, which is divided along its longer side.
    fn halves(&self, block: Self::Block) -> [Self::Block; 2];
}

/// Points of a triangle in rows along its longest side.
pub struct Rows {
    /// The longest side, then the third corner.
    corners: [DVec3; 3],
    /// From the longest side on.
    pub rows: Vec<Points>,
    /// The number of the first point of each row, and of all of them.
    starts: Vec<usize>,
    /// The area of the triangle.
    pub area: f64,
}

/// Evenly spaced points of a triangle on a line: a row of texels.
#[derive(Clone, Copy, Debug)]
pub struct Points {
    /// The weights of the triangle's corners at the first one.
    pub first: [f64; 3],
    /// What is added to the weights from each point to the next.
    pub growth: [f64; 3],
    /// How many.
    pub count: u32,
}

impl Points {
    /// A single point.
    pub fn one(weights: [f64; 3]) -> Self {
        Self { first: weights, growth: [0.0; 3], count: 1 }
    }

    /// The weights at each of them.
    pub fn weights(self) -> impl Iterator<Item = [f32; 3]> {
        let Self { first, growth, count } = self;
        (0..count).map(move |k| [0, 1, 2].map(|corner| (first[corner] + f64::from(k) * growth[corner]) as f32))
    }
}

/// Points in some rows, at a share of the way along each.
pub struct Block {
    rows: Range<usize>,
    along: [f64; 2],
}

impl Rows {
    /// Points about as far from one another as asked for; none if the triangle has no length.
    pub fn new(corners: [DVec3; 3], spacing: f64) -> Self {
        let side = |k: usize| corners[(k + 1) % 3].distance(corners[k]);
        let longest = (0..3).max_by(|&a, &b| side(a).total_cmp(&side(b))).unwrap_or(0);
        let order = [0, 1, 2].map(|k| (longest + k) % 3);
        let (area, length) = (0.5 * doubled_area(corners).length(), side(longest));
        let mut this = Self { corners: order.map(|k| corners[k]), rows: vec![], starts: vec![0], area };
        if length <= 0.0 || !length.is_finite() {
            this.area = 0.0;
            return this;
        }
        // The conversions saturate.
        let count = (2.0 * area / length / spacing).ceil().max(1.0) as u32;
        let mut points = 0;
        for row in 0..count {
            let up = (f64::from(row) + 0.5) / f64::from(count);
            let columns = (length * (1.0 - up) / spacing).ceil().max(1.0);
            let weights = |along: f64| {
                let mut weights = [0.0; 3];
                (0..3).for_each(|k| weights[order[k]] = [(1.0 - up) * (1.0 - along), (1.0 - up) * along, up][k]);
                weights
            };
            let (first, second) = (weights(0.5 / columns), weights(1.5 / columns));
            let growth = [0, 1, 2].map(|k| second[k] - first[k]);
            this.rows.push(Points { first, growth, count: columns as u32 });
            points += columns as usize;
            this.starts.push(points);
        }
        this
    }

    /// How many points there are.
    pub fn count(&self) -> usize {
        self.starts[self.rows.len()]
    }

    /// How far a row is from the longest side, as a share of the height.
    fn up(&self, row: usize) -> f64 {
        (row as f64 + 0.5) / self.rows.len() as f64
    }

    /// A place at a height, at a share of the way along it.
    fn place(&self, up: f64, along: f64) -> DVec3 {
        let [a, b, c] = self.corners;
        (a * (1.0 - along) + b * along) * (1.0 - up) + c * up
    }

    /// The points of a row that lie in a block.
    fn columns(&self, row: usize, block: &Block) -> Range<usize> {
        let count = f64::from(self.rows[row].count);
        let first = |along: f64| {
            let at = along * count - 0.5;
            // The conversion saturates; to round up by hand takes a third of the time.
            let whole = at as usize;
            whole + usize::from((whole as f64) < at)
        };
        let [start, end] = block.along.map(first);
        start..end
    }

    /// Numbers and places of the points of a block.
    pub fn points<'a>(&'a self, block: &'a Block) -> impl Iterator<Item = (usize, DVec3)> + 'a {
        block.rows.clone().flat_map(move |row| {
            self.columns(row, block).map(move |column| (self.starts[row] + column, self.point(row, column)))
        })
    }

    /// Numbers and places of all points.
    pub fn points_of_all(&self) -> impl Iterator<Item = (usize, DVec3)> + '_ {
        (0..self.rows.len()).flat_map(move |row| {
            (0..self.rows[row].count as usize).map(move |column| (self.starts[row] + column, self.point(row, column)))
        })
    }

    fn corners(&self, block: &Block) -> [DVec3; 4] {
        let (low, high) = (self.up(block.rows.start), self.up(block.rows.end - 1));
        let [start, end] = block.along;
        [(low, start), (low, end), (high, start), (high, end)].map(|(up, along)| self.place(up, along))
    }

    fn point(&self, row: usize, column: usize) -> DVec3 {
        self.place(self.up(row), (column as f64 + 0.5) / f64::from(self.rows[row].count))
    }

    /// For each row of a block the number of its first point, the places of this one and of the next one, and how many
    /// there are.
    pub fn in_rows<'a>(&'a self, block: &'a Block) -> impl Iterator<Item = (usize, [DVec3; 2], usize)> + 'a {
        block.rows.clone().filter_map(move |row| {
            let columns = self.columns(row, block);
            let places = [columns.start, columns.start + 1].map(|column| self.point(row, column));
            (!columns.is_empty()).then(|| (self.starts[row] + columns.start, places, columns.len()))
        })
    }
}

impl Blocks for Rows {
    type Block = Block;
    type Corners = [DVec3; 4];

    fn whole(&self) -> Block {
        Block { rows: 0..self.rows.len(), along: [0.0, 1.0] }
    }

    fn bounds(&self, block: &Block) -> (usize, [DVec3; 4]) {
        (block.rows.clone().map(|row| self.columns(row, block).len()).sum(), self.corners(block))
    }

    fn halves(&self, block: Block) -> [Block; 2] {
        let [a, b, c, _] = self.corners(&block);
        let Block { rows: Range { start: first, end }, along: [left, right] } = block;
        if end - first > 1 && a.distance(c) > a.distance(b) {
            let middle = first.midpoint(end);
            return [first..middle, middle..end].map(|rows| Block { rows, ..block });
        }
        let middle = left.midpoint(right);
        [[left, middle], [middle, right]].map(|along| Block { rows: first..end, along })
    }
}

/// Twice the area of a triangle, as a vector along its normal.
pub fn doubled_area([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_have_each_point_once_and_lie_around_them() {
        let corners = [DVec3::ZERO, DVec3::new(7.0, 0.0, 0.0), DVec3::new(2.0, 5.0, 1.0)];
        let rows = Rows::new(corners, 0.3);
        let mut found = vec![0; rows.count()];
        let mut open = vec![rows.whole()];
        while let Some(block) = open.pop() {
            let points: Vec<(usize, DVec3)> = rows.points(&block).collect();
            let (count, around) = rows.bounds(&block);
            assert_eq!(points.len(), count);
            let of_rows: usize = rows.in_rows(&block).map(|(.., count)| count).sum();
            assert_eq!(of_rows, points.len());
            if points.is_empty() {
                continue;
            }
            let middle = around.iter().sum::<DVec3>() / 4.0;
            let radius = around.iter().map(|corner| corner.distance(middle)).fold(0.0, f64::max);
            assert!(points.iter().all(|(_, point)| point.distance(middle) <= radius + 1e-9));
            match points.len() {
                1..=4 => points.iter().for_each(|&(at, _)| found[at] += 1),
                _ => open.extend(rows.halves(block)),
            }
        }
        assert!(found.len() > 150 && found.iter().all(|&times| times == 1), "{found:?}");
    }

    #[test]
    fn points_are_where_their_weights_say() {
        let corners = [DVec3::new(3.0, 0.0, 0.0), DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.0, 0.0, 9.0)];
        let rows = Rows::new(corners, 0.5);
        let weights = rows.rows.iter().flat_map(|row| row.weights());
        for ((_, place), weights) in rows.points(&rows.whole()).zip(weights) {
            let of_weights: DVec3 = (0..3).map(|k| corners[k] * f64::from(weights[k])).sum();
            assert!(place.distance(of_weights) < 1e-5, "{place} {of_weights}");
        }
        assert_eq!(Rows::new([DVec3::ONE; 3], 0.5).count(), 0);
    }
}
