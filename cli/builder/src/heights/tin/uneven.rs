//! Samples on columns and rows at any distances, as few triangles whose vertices are drawn at rounded places.
//!
//! The triangulation is that of the places before they are rounded. Then vertices get heights such that the surface
//! passes through their samples, though they stand a little beside them, and what is left is measured.

use glam::DVec3;

use super::delaunay::Delaunay;
use super::{Furthest, refine};

/// How far from a side of a triangle a sample lies on it, in units of positions.
const ON_SIDE: f64 = 1e-6;
/// How far two rounded places may be off together, in such units, with some more.
const NEAR: f64 = 1.5;
/// How often heights are corrected: each time by a thousandth of the time before, where lines are as many units apart.
const ROUNDS: usize = 4;
/// A vertex has at least this share in the height of the surface at its sample, and no other vertex has less than the
/// second one.
const LEAST_OWN_SHARE: f64 = 0.5;
const LEAST_SHARE: f64 = -0.25;

/// Samples of a rectangle.
pub struct Uneven<'a> {
    /// Where columns and rows are drawn, in units of which there are at most a million: each behind the one before, and
    /// the first at 0.
    pub columns: &'a [i32],
    /// From north to south.
    pub rows: &'a [i32],
    /// Where columns and rows are, in the same units.
    pub exact: [&'a [f64]; 2],
    /// Where samples are in space, row by row.
    pub places: &'a [DVec3],
}

/// Samples as triangles.
pub struct UnevenPatch {
    /// Numbers of the column and row of each vertex.
    pub vertices: Vec<[usize; 2]>,
    /// Counter-clockwise seen from above.
    pub triangles: Vec<[u32; 3]>,
}

/// The vertices that the surface hangs on at the sample of a vertex, and their shares in its height there.
#[derive(Clone, Copy)]
struct Holders {
    vertices: [u32; 3],
    shares: [f64; 3],
    /// How much of a correction counts. On walls a sample is near the surface whatever its height is, and their upper
    /// ends are those of something flat.
    weight: f64,
}

impl Holders {
    fn new(vertices: [u32; 3], shares: [f64; 3], samples: &Uneven, patch: &UnevenPatch) -> Self {
        let [a, b, c] = vertices.map(|vertex| samples.place(patch.sample(vertex)));
        let up = a.normalize_or_zero();
        let along = (b - a).normalize_or_zero().dot(up);
        // The square of the slope: of a plane, or of a line.
        let square = match (b - a).cross(c - a).try_normalize() {
            Some(normal) => {
                let cosine = normal.dot(up);
                1.0 / (cosine * cosine).max(f64::MIN_POSITIVE) - 1.0
            }
            None => along * along / (1.0 - along * along).max(f64::MIN_POSITIVE),
        };
        Self { vertices, shares, weight: 1.0 / (1.0 + square * square) }
    }
}

/// The shares of three corners in what is straight between them.
fn shares_at([a, b, c]: [[f64; 2]; 3], at: [f64; 2]) -> [f64; 3] {
    let cross =
        |p: [f64; 2], q: [f64; 2], at: [f64; 2]| (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0]);
    let area = cross(a, b, c);
    [cross(b, c, at), cross(c, a, at), cross(a, b, at)].map(|part| part / area)
}

fn mix(corners: [DVec3; 3], shares: [f64; 3]) -> DVec3 {
    corners[0] * shares[0] + corners[1] * shares[1] + corners[2] * shares[2]
}

impl Uneven<'_> {
    fn index(&self, [column, row]: [usize; 2]) -> usize {
        row * self.columns.len() + column
    }

    fn place(&self, sample: [usize; 2]) -> DVec3 {
        self.places[self.index(sample)]
    }

    /// Where a sample is drawn.
    fn at(&self, [column, row]: [usize; 2]) -> [i32; 2] {
        [self.columns[column], self.rows[row]]
    }

    fn exact(&self, [column, row]: [usize; 2]) -> [f64; 2] {
        [self.exact[0][column], self.exact[1][row]]
    }

    /// The column and the row at a position that has both.
    fn sample(&self, at: [i32; 2]) -> [usize; 2] {
        let find = |lines: &[i32], at: i32| lines.partition_point(|&line| line < at);
        [find(self.columns, at[0]), find(self.rows, at[1])]
    }

    /// Calls `with` for all samples that are drawn within a triangle, or at most so far beside it.
    fn for_each_within(&self, corners: [[i32; 2]; 3], beside: f64, mut with: impl FnMut([usize; 2])) {
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let north = a[1].min(b[1]).min(c[1]);
        let south = a[1].max(b[1]).max(c[1]);
        let first = self.rows.partition_point(|&row| f64::from(row) < north - beside);
        for row in (first..self.rows.len()).take_while(|&row| f64::from(self.rows[row]) <= south + beside) {
            let y = f64::from(self.rows[row]).clamp(north, south);
            let mut reach = [f64::INFINITY, f64::NEG_INFINITY];
            for [p, q] in [[a, b], [b, c], [c, a]] {
                if p[1].min(q[1]) > y || p[1].max(q[1]) < y {
                    continue;
                }
                let crossed =
                    if p[1] == q[1] { [p[0], q[0]] } else { [p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]); 2] };
                reach = [reach[0].min(crossed[0]).min(crossed[1]), reach[1].max(crossed[0]).max(crossed[1])];
            }
            let first = self.columns.partition_point(|&column| f64::from(column) < reach[0] - beside);
            let is_within = |&column: &usize| f64::from(self.columns[column]) <= reach[1] + beside;
            (first..self.columns.len()).take_while(is_within).for_each(|column| with([column, row]));
        }
    }

    /// The sample that is furthest from a triangle, of those within it.
    fn furthest(&self, corners: [[i32; 2]; 3]) -> Furthest {
        let samples = corners.map(|corner| self.sample(corner));
        let (exact, places) = (samples.map(|sample| self.exact(sample)), samples.map(|sample| self.place(sample)));
        let mut found = Furthest::default();
        self.for_each_within(corners, ON_SIDE, |sample| {
            let off = mix(places, shares_at(exact, self.exact(sample))).distance(self.place(sample));
            if off > found.off && !samples.contains(&sample) {
                found = Furthest { off, at: self.at(sample) };
            }
        });
        found
    }

    /// Chooses vertices between the ends of a side, by the samples on it alone: the tile on the other side chooses the
    /// same ones.
    fn choose_on_side(&self, [from, to]: [[usize; 2]; 2], tolerance: f64, out: &mut Vec<[i32; 2]>) {
        let axis = usize::from(from[0] == to[0]);
        let sample = |k: usize| {
            let mut sample = from;
            sample[axis] = k;
            sample
        };
        let along = |k: usize| self.exact(sample(k))[axis];
        let place = |k: usize| self.place(sample(k));
        let mut waiting = vec![[from[axis], to[axis]]];
        while let Some([a, b]) = waiting.pop() {
            let mut most = (tolerance, None);
            for k in a + 1..b {
                let share = (along(k) - along(a)) / (along(b) - along(a));
                let off = place(a).lerp(place(b), share).distance(place(k));
                if off > most.0 {
                    most = (off, Some(k));
                }
            }
            if let Some(k) = most.1 {
                out.push(self.at(sample(k)));
                waiting.extend([[a, k], [k, b]]);
            }
        }
    }
}

/// Triangulates all samples: none is further than the tolerance from triangles between samples.
///
/// # Panics
/// If there are fewer than two columns or rows.
pub fn triangulate_uneven(samples: &Uneven, tolerance: f64) -> UnevenPatch {
    let ends = [samples.columns.len() - 1, samples.rows.len() - 1];
    let mut all = Delaunay::new(samples.at(ends));
    let sides = [[[0, 0], [ends[0], 0]], [[0, ends[1]], ends], [[0, 0], [0, ends[1]]], [[ends[0], 0], ends]];
    let mut needed = vec![];
    for side in sides {
        samples.choose_on_side(side, tolerance, &mut needed);
    }
    let mut near = 0;
    for point in needed {
        near = all.locate(point, near);
        all.insert(point, near);
    }
    refine(&mut all, tolerance, |all, number| samples.furthest(all.places(number)));
    let triangles = (0..all.count() as u32).map(|number| all.triangle(number)).collect();
    let vertices = all.points().iter().map(|&at| samples.sample(at)).collect();
    UnevenPatch { vertices, triangles }
}

impl UnevenPatch {
    fn sample(&self, vertex: u32) -> [usize; 2] {
        self.vertices[vertex as usize]
    }

    /// Heights of the vertices with which the surface passes through their samples. `heights` are those of the samples,
    /// and `draw` says where a vertex at a column and a row is in space at a height. Those on a side depend on the
    /// vertices on it alone.
    pub fn fitted(&self, samples: &Uneven, mut heights: Vec<f64>, draw: impl Fn([usize; 2], f64) -> DVec3) -> Vec<f64> {
        let (holders, start) = (self.holders(samples), heights.clone());
        for _ in 0..ROUNDS {
            for (vertex, holders) in holders.iter().enumerate() {
                let Some(Holders { vertices, shares, weight }) = holders else { continue };
                let drawn = vertices.map(|v| draw(self.vertices[v as usize], heights[v as usize]));
                let place = samples.place(self.sample(vertex as u32));
                let off = (place - mix(drawn, *shares)).dot(place.normalize_or_zero());
                heights[vertex] = start[vertex] + weight * (heights[vertex] + off - start[vertex]);
            }
        }
        heights
    }

    /// What the surface hangs on at the sample of each vertex; none where that is the vertex alone.
    fn holders(&self, samples: &Uneven) -> Vec<Option<Holders>> {
        let last = [samples.columns.len() - 1, samples.rows.len() - 1];
        let drawn = |vertex: u32| samples.at(self.sample(vertex)).map(f64::from);
        let exact = |vertex: u32| samples.exact(self.sample(vertex));
        let is_on_side = |vertex: u32| (0..2).any(|k| [0, last[k]].contains(&self.vertices[vertex as usize][k]));
        let mut found: Vec<Option<Holders>> = vec![None; self.vertices.len()];
        let mut least = vec![LEAST_SHARE; self.vertices.len()];
        for triangle in &self.triangles {
            let corners = triangle.map(drawn);
            for (k, &vertex) in triangle.iter().enumerate().filter(|(_, vertex)| !is_on_side(**vertex)) {
                let shares = shares_at(corners, exact(vertex));
                let smallest = shares.into_iter().fold(f64::INFINITY, f64::min);
                if smallest > least[vertex as usize] && shares[k] > LEAST_OWN_SHARE {
                    least[vertex as usize] = smallest;
                    found[vertex as usize] = Some(Holders::new(*triangle, shares, samples, self));
                }
            }
        }
        for (axis, line) in [(0, 0), (0, last[1]), (1, 0), (1, last[0])] {
            let is_on = |vertex: &u32| self.vertices[*vertex as usize][1 - axis] == line;
            let mut side: Vec<u32> = (0..self.vertices.len() as u32).filter(is_on).collect();
            side.sort_unstable_by_key(|&vertex| self.vertices[vertex as usize][axis]);
            for three in side.windows(3) {
                let [before, vertex, behind] = [three[0], three[1], three[2]];
                let away = exact(vertex)[axis] - drawn(vertex)[axis];
                let other = if away < 0.0 { before } else { behind };
                let share = away / (drawn(other)[axis] - drawn(vertex)[axis]);
                if share < 1.0 - LEAST_OWN_SHARE {
                    found[vertex as usize] =
                        Some(Holders::new([vertex, other, other], [1.0 - share, share, 0.0], samples, self));
                }
            }
        }
        found
    }

    /// How far samples are from the triangles at most if the vertices are at these places.
    pub fn error(&self, samples: &Uneven, drawn: &[DVec3]) -> f64 {
        let mut off = vec![f64::INFINITY; samples.places.len()];
        for triangle in &self.triangles {
            let corners = triangle.map(|vertex| samples.at(self.sample(vertex)));
            let (at, places) = (corners.map(|corner| corner.map(f64::from)), triangle.map(|v| drawn[v as usize]));
            samples.for_each_within(corners, NEAR, |sample| {
                // A point of the triangle: what is beside it is measured from its side.
                let shares = shares_at(at, samples.exact(sample)).map(|share| share.max(0.0));
                let sum: f64 = shares.iter().sum();
                let nearest = &mut off[samples.index(sample)];
                *nearest = nearest.min(mix(places, shares.map(|share| share / sum)).distance(samples.place(sample)));
            });
        }
        off.into_iter().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: [i32; 7] = [0, 1, 400, 800, 1200, 9000, 32_767];
    const ROWS: [i32; 6] = [0, 300, 600, 20_000, 32_766, 32_767];
    /// Lines are drawn up to half a unit beside where they are; those on the sides are where they are drawn.
    const EXACT: [[f64; 7]; 2] = [
        [0.0, 1.4, 399.6, 800.5, 1199.9, 9000.2, 32_767.0],
        [0.0, 300.5, 599.7, 20_000.1, 32_765.5, 32_767.0, f64::NAN],
    ];
    /// The middle of the globe is so far below that heights are along one axis.
    const FAR: f64 = 1e9;

    fn height([x, y]: [f64; 2]) -> f64 {
        (x / 100.0 * 7.0 + y / 100.0 * 13.0) % 50.0
    }

    fn place([x, y]: [f64; 2], height: f64) -> DVec3 {
        DVec3::new(x, -y, FAR + height)
    }

    fn with_samples(with: impl Fn(&Uneven)) {
        let exact = [&EXACT[0][..], &EXACT[1][..ROWS.len()]];
        let at = |row: usize| EXACT[0].map(|x| [x, EXACT[1][row]]);
        let places: Vec<DVec3> = (0..ROWS.len()).flat_map(at).map(|at| place(at, height(at))).collect();
        with(&Uneven { columns: &COLUMNS, rows: &ROWS, exact, places: &places });
    }

    #[test]
    fn all_of_a_square_is_covered_and_no_sample_is_further_off_than_is_said() {
        with_samples(|samples| {
            for tolerance in [0.0, 5.0, 30.0, 1e6] {
                let patch = triangulate_uneven(samples, tolerance);
                let at = |vertex: u32| samples.at(patch.sample(vertex)).map(f64::from);
                let area: f64 = (patch.triangles.iter())
                    .map(|triangle| {
                        let [a, b, c] = triangle.map(|vertex| place(at(vertex), 0.0));
                        0.5 * (b - a).cross(c - a).z
                    })
                    .sum();
                assert_eq!(area, 32_767.0 * 32_767.0, "{tolerance}");
                let drawn: Vec<DVec3> = (0..patch.vertices.len() as u32)
                    .map(|v| place(at(v), samples.place(patch.sample(v)).z - FAR))
                    .collect();
                let error = patch.error(samples, &drawn);
                // Slopes are less than one.
                assert!(error <= tolerance + 1.0, "{tolerance} {error}");
                let raised: Vec<DVec3> = drawn.iter().map(|place| place + DVec3::Z * 1000.0).collect();
                assert!((patch.error(samples, &raised) - 1000.0).abs() <= error + 1e-9);
            }
            let all = triangulate_uneven(samples, 0.0).vertices.len();
            assert!(all > 30 && triangulate_uneven(samples, 1e6).vertices.len() == 4, "{all}");
        });
    }

    #[test]
    fn fitted_surfaces_pass_through_the_samples_of_their_vertices() {
        with_samples(|samples| {
            let patch = triangulate_uneven(samples, 0.0);
            let start: Vec<f64> =
                (0..patch.vertices.len() as u32).map(|v| samples.place(patch.sample(v)).z - FAR).collect();
            let draw = |vertex: [usize; 2], height: f64| place(samples.at(vertex).map(f64::from), height);
            let error = |heights: &[f64]| {
                let drawn: Vec<DVec3> =
                    patch.vertices.iter().zip(heights).map(|(&vertex, &height)| draw(vertex, height)).collect();
                patch.error(samples, &drawn)
            };
            let fitted = patch.fitted(samples, start.clone(), draw);
            let (before, after) = (error(&start), error(&fitted));
            assert!(before > 0.01 && after < 0.02 * before, "{before} {after}");
        });
    }
}
