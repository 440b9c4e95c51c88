//! What a patch would show of a surface whose colours are known, without images of it: each point of the surface is
//! seen at the closest one of the patch, and a cell of the patch shows the mean of all points that are seen there.

use glam::DVec3;
use rayon::prelude::*;

use lodpack_stage::certify::{Closest, Hint, TriangleBvh};
use lodpack_stage::nearest::{Finder, NOWHERE, OPPOSITE, Places, Rows, SHARE_OF_OPPOSITE, SPACING, doubled_area};

/// Points are kept as far off if the square of their difference is this many times the mean one.
const FAR: f64 = 2.0;
/// The most cells of a patch, unless it has more triangles: they become larger if need be.
pub(crate) const MOST_CELLS: u64 = 1 << 22;

/// About this many points of a patch tell how far it is from the surface.
const OWN_POINTS: f64 = 16384.0;

/// Points of a surface with their colours.
pub struct Sampled {
    triangles: Vec<[DVec3; 3]>,
    rows: Vec<Rows>,
    /// The number of each triangle's first point.
    first: Vec<usize>,
    colours: Vec<[f32; 3]>,
    /// The size of a cell.
    size: f64,
    /// All of the surface, also what has no colours.
    bvh: TriangleBvh,
}

/// How far off the colours are that are seen.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// The sum of squares of all points, by area.
    pub sum: f64,
    /// The area of what they stand for.
    pub area: f64,
    /// The sum of squares of their distances from the patch, by area.
    pub distances: f64,
    /// The mean square of distances of the patch from the surface.
    pub of_patch: f64,
    /// Points where colours are far off, with their part of the sum.
    pub far: Vec<(DVec3, f64)>,
}

impl Seen {
    /// The mean square. None if nothing is seen.
    pub fn mean(&self) -> Option<f64> {
        (self.area > 0.0).then(|| self.sum / self.area)
    }

    /// How far surface and patch are from each other, in the root mean square both ways: points of the surface do not
    /// see what a patch has too much.
    pub fn distance(&self) -> f64 {
        (0.5 * (self.distances / self.area + self.of_patch)).sqrt()
    }

    /// How bad all of it is: the mean square of colours times the distance; infinite if nothing is seen. What is twice
    /// as far off in the mean must show 3 dB more: the largest distance says little of outlines.
    pub fn value(&self) -> f64 {
        self.mean().map_or(f64::INFINITY, |mean| mean * self.distance().max(f64::MIN_POSITIVE))
    }

    /// The points where colours are farthest off, which make up a share of all squares.
    pub fn worst(&self, share: f64) -> Vec<DVec3> {
        let mut far = self.far.clone();
        far.sort_by(|(_, one), (_, other)| other.total_cmp(one));
        let mut rest = share * self.sum;
        let is_wanted = |&(_, square): &(DVec3, f64)| {
            let is_wanted = rest > 0.0;
            rest -= square;
            is_wanted
        };
        far.into_iter().take_while(is_wanted).map(|(point, _)| point).collect()
    }
}

impl Sampled {
    /// Samples the triangles of a surface with about the given number of cells, none smaller than `least`. `colour`
    /// says what a triangle shows where its corners have some weights.
    pub fn new(
        triangles: Vec<[DVec3; 3]>,
        cells: f64,
        least: f64,
        colour: impl Fn(usize, [f64; 3]) -> Option<[f64; 3]>,
    ) -> Self {
        let area = 0.5 * triangles.iter().map(|&corners| doubled_area(corners).length()).sum::<f64>();
        let size = (area / cells).sqrt().max(least);
        let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let bvh = TriangleBvh::new(triangles.as_flattened(), &numbers);
        let mut this = Self { triangles: vec![], rows: vec![], first: vec![], colours: vec![], size, bvh };
        if size.is_nan() || size <= 0.0 {
            return this;
        }
        for (triangle, corners) in triangles.into_iter().enumerate() {
            let rows = Rows::new(corners, size * SPACING);
            let weights = rows.rows.iter().flat_map(|row| row.weights());
            let before = this.colours.len();
            this.colours.extend(
                weights.filter_map(|weights| colour(triangle, weights.map(f64::from))).map(|c| c.map(|c| c as f32)),
            );
            if this.colours.len() - before == rows.count() {
                this.first.push(before);
                this.triangles.push(corners);
                this.rows.push(rows);
            } else {
                this.colours.truncate(before);
            }
        }
        this
    }

    /// How far off the colours are that are seen on a patch.
    pub fn seen(&self, positions: Vec<DVec3>, triangles: &[[u32; 3]]) -> Seen {
        // There may be no size of cells either.
        if self.is_empty() {
            return Seen::default();
        }
        let of_patch = self.square_distance(triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect());
        let cells = Cells::new(&positions, triangles, self.size);
        let mut sums = vec![[0.0_f32; 4]; cells.count];
        let finder = Finder::new(positions, triangles, cells, self.size);
        let find = |(&corners, rows): (&[DVec3; 3], &Rows)| finder.find(corners, rows);
        let found: Vec<(Vec<u32>, f64)> = self.triangles.par_iter().zip(&self.rows).map(find).collect();
        let (found, distances): (Vec<Vec<u32>>, Vec<f64>) = found.into_iter().unzip();
        for ((texels, rows), &first) in found.iter().zip(&self.rows).zip(&self.first) {
            let weight = rows.area / texels.len().max(1) as f64 / (self.size * self.size);
            for (&texel, colour) in texels.iter().zip(&self.colours[first..]) {
                if texel != NOWHERE {
                    let sum = &mut sums[(texel & !OPPOSITE) as usize];
                    let weight = weight as f32 * if texel & OPPOSITE == 0 { 1.0 } else { SHARE_OF_OPPOSITE };
                    (0..3).for_each(|k| sum[k] += weight * colour[k]);
                    sum[3] += weight;
                }
            }
        }
        for sum in &mut sums {
            let share = 1.0 / sum[3];
            (0..3).for_each(|k| sum[k] *= share);
        }
        let square = |texel: u32, colour: &[f32; 3]| {
            let Some(shown) = sums.get((texel & !OPPOSITE) as usize) else { return 0.0 };
            let [x, y, z] = [0, 1, 2].map(|k| shown[k] - colour[k]);
            f64::from(x * x + y * y + z * z) / 3.0
        };
        let mut seen = Seen { of_patch, ..Seen::default() };
        for (((texels, distances), rows), &first) in found.iter().zip(distances).zip(&self.rows).zip(&self.first) {
            let squares = texels.iter().zip(&self.colours[first..]).map(|(&texel, colour)| square(texel, colour));
            let weight = rows.area / texels.len().max(1) as f64;
            seen.sum += squares.sum::<f64>() * weight;
            seen.distances += distances * weight;
            seen.area += rows.area;
        }
        let far = FAR * seen.sum / seen.area;
        for ((texels, rows), &first) in found.iter().zip(&self.rows).zip(&self.first) {
            let is_far = |(at, &texel): (usize, &u32)| square(texel, &self.colours[first + at]) > far;
            if texels.iter().enumerate().any(is_far) {
                let weight = rows.area / texels.len() as f64;
                let points =
                    rows.points_of_all().map(|(at, point)| (point, square(texels[at], &self.colours[first + at])));
                seen.far
                    .extend(points.filter(|(_, square)| *square > far).map(|(point, square)| (point, square * weight)));
            }
        }
        seen
    }
}

impl Sampled {
    /// Whether nothing has colours.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The size of a cell.
    pub(crate) fn size(&self) -> f64 {
        self.size
    }

    /// The triangles that have colours, their points and the colours of these.
    pub(crate) fn of_triangles(&self) -> impl Iterator<Item = ([DVec3; 3], &Rows, &[[f32; 3]])> {
        let all = self.triangles.iter().zip(&self.rows).zip(&self.first);
        all.map(|((&corners, rows), &first)| (corners, rows, &self.colours[first..first + rows.count()]))
    }

    /// The mean square of distances of triangles from the surface.
    fn square_distance(&self, triangles: Vec<[DVec3; 3]>) -> f64 {
        let area = |&corners: &[DVec3; 3]| 0.5 * doubled_area(corners).length();
        // Lines have hardly any area, but would have rows of any number of points.
        let spacing = (triangles.iter().map(area).sum::<f64>() / OWN_POINTS).sqrt().max(self.size);
        let all: Vec<[f64; 2]> = triangles.par_iter().map(|&corners| self.squares_of(corners, spacing)).collect();
        let [squares, area] = [0, 1].map(|k| all.iter().map(|each| each[k]).sum::<f64>());
        if area > 0.0 { squares / area } else { 0.0 }
    }

    /// Squares of the distances of a triangle's points from the surface, by area, and its area.
    pub(crate) fn squares_of(&self, corners: [DVec3; 3], spacing: f64) -> [f64; 2] {
        let (rows, mut hint) = (Rows::new(corners, spacing), Hint::default());
        let square = |(_, point)| {
            let Closest { distance, .. } = self.bvh.closest(point, &mut hint);
            distance * distance
        };
        let sum: f64 = rows.points_of_all().map(square).sum();
        [sum * rows.area / rows.count().max(1) as f64, rows.area]
    }
}

/// Cells of the triangles of a patch, in rows along the longest side of each.
struct Cells {
    triangles: Vec<InTriangle>,
    count: usize,
}

/// The cells of one triangle.
struct InTriangle {
    corner: DVec3,
    /// What is multiplied with an offset from the corner to count cells.
    axes: [DVec3; 2],
    counts: [u32; 2],
    /// The number of the first one.
    first: u32,
}

impl Cells {
    fn new(positions: &[DVec3], triangles: &[[u32; 3]], mut size: f64) -> Self {
        loop {
            let (cells, count) = Self::of_size(positions, triangles, size);
            if count <= MOST_CELLS.max(triangles.len() as u64) || size.is_infinite() {
                return cells;
            }
            size *= 2.0;
        }
    }

    /// Cells of a size, and how many there would be if their numbers could not overflow.
    fn of_size(positions: &[DVec3], triangles: &[[u32; 3]], size: f64) -> (Self, u64) {
        let mut count = 0_u64;
        let mut cells = |corners: &[u32; 3]| {
            let corners = corners.map(|v| positions[v as usize]);
            let side = |k: usize| corners[(k + 1) % 3].distance(corners[k]);
            let longest = (0..3).max_by(|&a, &b| side(a).total_cmp(&side(b))).unwrap_or(0);
            let [a, b, c] = [0, 1, 2].map(|k| corners[(longest + k) % 3]);
            let (normal, length) = (doubled_area([a, b, c]), side(longest));
            let along = (b - a) / length;
            let across = normal.cross(along).normalize_or_zero();
            let height = normal.length() / length;
            let low = (c - a).dot(along).min(0.0);
            // The conversions saturate.
            let counts =
                [length.max((c - a).dot(along)) - low, height].map(|length| (length / size).ceil().max(1.0) as u32);
            let first = count as u32;
            count = count.saturating_add(u64::from(counts[0]) * u64::from(counts[1]));
            InTriangle { corner: a + along * low, axes: [along / size, across / size], counts, first }
        };
        let triangles = triangles.iter().map(&mut cells).collect();
        (Self { triangles, count: count as usize }, count)
    }
}

impl Places for Cells {
    fn place(&self, triangle: u32, point: DVec3) -> [f64; 2] {
        let InTriangle { corner, axes, .. } = &self.triangles[triangle as usize];
        axes.map(|axis| axis.dot(point - corner))
    }

    fn number(&self, triangle: u32, place: [f64; 2]) -> u32 {
        let InTriangle { counts, first, .. } = &self.triangles[triangle as usize];
        // The conversions saturate.
        let [x, y] = [0, 1].map(|axis| (place[axis] as u32).min(counts[axis] - 1));
        first + y * counts[0] + x
    }

    fn are_together(&self, _: u32, _: u32) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

    fn square(height: f64) -> Vec<DVec3> {
        [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]].map(|[x, y]| DVec3::new(x, y, height)).to_vec()
    }

    fn corners(positions: &[DVec3], [a, b, c]: [u32; 3]) -> [DVec3; 3] {
        [a, b, c].map(|v| positions[v as usize])
    }

    #[test]
    fn the_other_side_of_a_sheet_weighs_less() {
        // A grey sheet, and one below it that is seen from below.
        let [above, below] = [square(0.0), square(-1.0)];
        let mut triangles: Vec<[DVec3; 3]> = SQUARE.map(|t| corners(&above, t)).to_vec();
        triangles.extend(SQUARE.map(|[a, b, c]| corners(&below, [a, c, b])));
        let grey = |triangle: usize, _| Some([if triangle < 2 { 100.0 } else { 200.0 }; 3]);
        // A number of cells whose borders lie between points.
        let seen = Sampled::new(triangles, 700.0, 0.0, grey).seen(square(1.0), &SQUARE);
        let share = f64::from(SHARE_OF_OPPOSITE) / (1.0 + f64::from(SHARE_OF_OPPOSITE));
        let wanted = 1e4 * 0.5 * (share * share + (1.0 - share) * (1.0 - share));
        assert!(seen.mean().is_some_and(|mean| (mean / wanted - 1.0).abs() < 0.02), "{:?} {wanted}", seen.mean());
        assert_eq!(seen.area, 128.0);
        // One of them is twice as far from the patch as the other, and the patch is as far from the nearer one.
        assert!((seen.distance() / 1.75_f64.sqrt() - 1.0).abs() < 1e-9, "{}", seen.distance());
    }

    #[test]
    fn what_has_no_area_or_no_colours_is_not_seen() {
        let line = vec![[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]];
        assert!(Sampled::new(line, 256.0, 0.0, |_, _| Some([1.0; 3])).seen(square(0.0), &SQUARE).mean().is_none());
        let whole = SQUARE.map(|t| corners(&square(0.0), t)).to_vec();
        assert!(Sampled::new(whole, 256.0, 0.0, |_, _| None).seen(square(0.0), &SQUARE).mean().is_none());
    }

    #[test]
    fn a_needle_has_few_points() {
        let whole = SQUARE.map(|t| corners(&square(0.0), t)).to_vec();
        let sampled = Sampled::new(whole, 256.0, 0.0, |_, _| Some([1.0; 3]));
        // As long as the square, and without any width to speak of: it would have billions of points.
        let needle = [DVec3::ZERO, DVec3::X * 8.0, DVec3::new(4.0, 1e-18, 0.0)].map(|point| point + DVec3::Z).to_vec();
        let seen = sampled.seen(needle, &[[0, 1, 2]]);
        assert!((seen.of_patch - 1.0).abs() < 1e-9, "{}", seen.of_patch);
    }

    #[test]
    fn cells_of_each_triangle_are_its_own_and_not_too_many() {
        let positions = square(0.0);
        for size in [100.0, 0.3, 1e-9, 1e-300] {
            let cells = Cells::new(&positions, &SQUARE, size);
            assert!(cells.count as u64 <= MOST_CELLS && (size > 1.0 || cells.count > 64), "{}", cells.count);
            let mut before = 0;
            for (triangle, corners) in (0..).zip(SQUARE) {
                let place = |v: u32| cells.number(triangle, cells.place(triangle, positions[v as usize]));
                let numbers = corners.map(place);
                assert!(numbers.iter().all(|&number| (before..cells.count as u32).contains(&number)));
                before = numbers.into_iter().max().unwrap_or(0) + 1;
            }
        }
    }
}
