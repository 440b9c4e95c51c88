//! Samples on columns and rows at any distances, as few triangles whose vertices are drawn at rounded places.
//!
//! Distances are those of the samples, where they really are, from triangles as they are drawn: roundings are part of
//! them.

use std::collections::BinaryHeap;

use glam::DVec3;

use super::delaunay::Delaunay;
use super::{Furthest, Patch};

/// How far from a side of a triangle a sample lies on it, in units of positions.
const ON_SIDE: f64 = 1e-6;

/// Samples of a rectangle.
pub struct Uneven<'a> {
    /// Where columns and rows are, in units of which there are at most a million: each behind the one before, and the
    /// first at 0.
    pub columns: &'a [i32],
    /// From north to south.
    pub rows: &'a [i32],
    /// Where samples are in space, row by row.
    pub places: &'a [DVec3],
    /// Where they are drawn if they are vertices.
    pub drawn: &'a [DVec3],
}

/// The sample to insert, and how far any is off, corners included.
struct Found {
    next: Furthest,
    off: f64,
}

impl Uneven<'_> {
    fn index(&self, [column, row]: [usize; 2]) -> usize {
        row * self.columns.len() + column
    }

    fn at(&self, [column, row]: [usize; 2]) -> [i32; 2] {
        [self.columns[column], self.rows[row]]
    }

    /// The column and the row at a position that has both.
    fn sample(&self, at: [i32; 2]) -> [usize; 2] {
        let find = |lines: &[i32], at: i32| lines.partition_point(|&line| line < at);
        [find(self.columns, at[0]), find(self.rows, at[1])]
    }

    /// How far the samples within a triangle are from it.
    fn furthest(&self, corners: [[i32; 2]; 3]) -> Found {
        let drawn = corners.map(|corner| self.drawn[self.index(self.sample(corner))]);
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let cross =
            |p: [f64; 2], q: [f64; 2], at: [f64; 2]| (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0]);
        let area = cross(a, b, c);
        let mut lines = corners.map(|[_, row]| row);
        lines.sort_unstable();
        let [north, _, south] = lines;
        let rows = self.rows.partition_point(|&row| row < north)..self.rows.partition_point(|&row| row <= south);
        let mut found = Found { next: Furthest::default(), off: 0.0 };
        for row in rows {
            let y = f64::from(self.rows[row]);
            let mut reach = [f64::INFINITY, f64::NEG_INFINITY];
            for [p, q] in [[a, b], [b, c], [c, a]] {
                if p[1].min(q[1]) > y || p[1].max(q[1]) < y {
                    continue;
                }
                let crossed =
                    if p[1] == q[1] { [p[0], q[0]] } else { [p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]); 2] };
                reach = [reach[0].min(crossed[0]).min(crossed[1]), reach[1].max(crossed[0]).max(crossed[1])];
            }
            let first = self.columns.partition_point(|&column| f64::from(column) < reach[0] - ON_SIDE);
            for column in first..self.columns.len() {
                let x = f64::from(self.columns[column]);
                if x > reach[1] + ON_SIDE {
                    break;
                }
                let at = [x, y];
                let shares = [cross(b, c, at), cross(c, a, at), cross(a, b, at)].map(|part| part / area);
                let point = drawn[0] * shares[0] + drawn[1] * shares[1] + drawn[2] * shares[2];
                let off = point.distance(self.places[self.index([column, row])]);
                found.off = found.off.max(off);
                let at = self.at([column, row]);
                if off > found.next.off && !corners.contains(&at) {
                    found.next = Furthest { off, at };
                }
            }
        }
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
        let along = |k: usize| f64::from(self.at(sample(k))[axis]);
        let place = |k: usize| self.places[self.index(sample(k))];
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

/// Triangulates all samples: none is further than the tolerance from what is drawn, unless rounding moves it by more.
/// The vertices of the patch are numbers of columns and rows.
///
/// # Panics
/// If there are fewer than two columns or rows.
pub fn triangulate_uneven(samples: &Uneven, tolerance: f64) -> Patch {
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
    // Of each triangle its furthest sample. What is in the queue with another distance is old.
    let mut furthest: Vec<Found> = vec![];
    let mut queue = BinaryHeap::new();
    loop {
        while let Some(number) = all.next_changed() {
            let found = samples.furthest(all.places(number));
            furthest.resize_with(furthest.len().max(all.count()), || Found { next: Furthest::default(), off: 0.0 });
            if found.next.off > tolerance {
                // Not negative, so bits are in the order of numbers.
                queue.push((found.next.off.to_bits(), number, found.next.at));
            }
            furthest[number as usize] = found;
        }
        let Some((off, number, at)) = queue.pop() else { break };
        let known = furthest[number as usize].next;
        if known.off.to_bits() == off && known.at == at {
            all.insert(at, number);
        }
    }
    let error = furthest.iter().fold(0.0f64, |most, found| most.max(found.off));
    let triangles = (0..all.count() as u32).map(|number| all.triangle(number)).collect();
    let vertices = all.points().iter().map(|&at| samples.sample(at).map(|k| k as i32)).collect();
    Patch { vertices, triangles, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_sample_is_further_off_than_is_said_and_all_of_a_square_is_covered() {
        let columns = [0, 1, 400, 800, 1200, 9000, 32_767];
        let rows = [0, 300, 600, 20_000, 32_766, 32_767];
        let height = |x: i32, y: i32| f64::from((x / 100 * 7 + y / 100 * 13) % 50);
        let place = |shift: f64| -> Vec<DVec3> {
            rows.iter()
                .flat_map(|&y| columns.map(|x| DVec3::new(f64::from(x), f64::from(-y), height(x, y) + shift)))
                .collect()
        };
        let (places, drawn) = (place(0.0), place(0.25));
        let samples = Uneven { columns: &columns, rows: &rows, places: &places, drawn: &drawn };
        for tolerance in [0.0, 5.0, 30.0, 1e6] {
            let patch = triangulate_uneven(&samples, tolerance);
            let corner = |at: u32| patch.vertices[at as usize].map(|k| k as usize);
            let mut area = 0.0;
            for triangle in &patch.triangles {
                let [a, b, c] = triangle.map(|at| {
                    let [column, row] = corner(at);
                    drawn[row * columns.len() + column]
                });
                area += 0.5 * (b - a).cross(c - a).z;
            }
            assert_eq!(area, 32_767.0 * 32_767.0, "{tolerance}");
            assert!(patch.error >= 0.25 && patch.error <= tolerance.max(0.25) + 1e-9, "{tolerance} {}", patch.error);
        }
        let all = triangulate_uneven(&samples, 0.0).vertices.len();
        assert!(all > 30 && triangulate_uneven(&samples, 1e6).vertices.len() == 4, "{all}");
    }
}
