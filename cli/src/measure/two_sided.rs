//! How far two surfaces are apart: the largest distance of each from the other, between two bounds, and its root mean
//! square.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::verify::distance::{BoxTree, Goal, largest_distance};

/// Runs of triangles searched in parallel.
const RUNS: usize = 64;
/// Points that share a hint.
const CHUNK: usize = 4096;
/// A claim that every distance exceeds: with none in reach, each run is searched to the end.
const NO_CLAIM: f64 = -1.0;
/// Upper over lower bound of the largest distance, minus 1, by default.
pub const RELATIVE_GAP: f64 = 0.02;
/// Distances below this share of a mean edge are not told apart, by default.
pub const FLOOR: f64 = 1e-6;

/// How far one surface is from another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OneSided {
    /// A distance that occurs.
    pub lower: f64,
    /// No larger one occurs, up to the rounding of coordinates.
    pub upper: f64,
    /// Where the lower bound occurs.
    pub at: DVec3,
    /// Root mean square over points spread evenly over the area.
    pub rms: f64,
}

/// A surface, and the accumulated area up to each triangle of its tree.
pub struct Side<'a> {
    positions: &'a [DVec3],
    tree: BoxTree<'a>,
    running: Vec<f64>,
    /// Of the edges of all triangles.
    pub mean_edge: f64,
}

/// What was found at points: the sum of squares, the largest distance, and where it is.
type Found = (f64, f64, DVec3);

impl<'a> Side<'a> {
    /// Builds a tree over the triangles of a surface.
    pub fn new(positions: &'a [DVec3], triangles: &[[u32; 3]]) -> Self {
        let tree = BoxTree::new(positions, triangles);
        let (mut running, mut area, mut edges) = (Vec::with_capacity(triangles.len()), 0.0, 0.0);
        for triangle in tree.triangles() {
            let [a, b, c] = triangle.map(|v| positions[v as usize]);
            area += (b - a).cross(c - a).length() * 0.5;
            edges += a.distance(b) + b.distance(c) + c.distance(a);
            running.push(area);
        }
        let mean_edge = edges / (3 * triangles.len()).max(1) as f64;
        Self { positions, tree, running, mean_edge }
    }

    /// Both bounds of the largest distance of this side from the other, to a relative gap or below a floor, and its
    /// root mean square at some number of points. `done` is called 64 times at most.
    pub fn measured(&self, other: &Side, samples: usize, goal: (f64, f64), done: &(dyn Fn() + Sync)) -> OneSided {
        let (rms, most, at) = self.sampled(other, samples);
        OneSided { rms, ..self.enclosed(other, goal, (most, at), done) }
    }

    /// Root mean square and largest distance of points of this side from the other, and where that is. Point i lies
    /// where the accumulated area passes (i + 1/2) / n of the total, so points are spread evenly.
    fn sampled(&self, other: &Side, samples: usize) -> (f64, f64, DVec3) {
        let Some(&total) = self.running.last() else { return Default::default() };
        let point = |i: usize| {
            let at = total * (i as f64 + 0.5) / samples as f64;
            let slot = self.running.partition_point(|&r| r < at).min(self.running.len() - 1);
            point_in(self.tree.corners(slot as u32), i as u64)
        };
        other.found_at(samples, point)
    }

    /// The same of some points, all of which count.
    pub fn of_points(&self, points: &[DVec3]) -> OneSided {
        let (rms, most, at) = self.found_at(points.len(), |i| points[i]);
        OneSided { lower: most, upper: most, at, rms }
    }

    /// Root mean square and largest distance of points from this side.
    fn found_at(&self, count: usize, point: impl Fn(usize) -> DVec3 + Sync) -> (f64, f64, DVec3) {
        let of_chunk = |range: Range<usize>| -> Found {
            let mut found = (0.0, 0.0, point(range.start));
            let mut hint = 0;
            for p in range.map(&point) {
                let Some((distance, near, _)) = self.tree.nearest(p, hint) else {
                    return (f64::INFINITY, f64::INFINITY, p);
                };
                hint = near;
                found.0 += distance * distance;
                if distance > found.1 {
                    (found.1, found.2) = (distance, p);
                }
            }
            found
        };
        let firsts: Vec<usize> = (0..count).step_by(CHUNK).collect();
        let chunks: Vec<Found> =
            firsts.into_par_iter().map(|first| of_chunk(first..(first + CHUNK).min(count))).collect();
        let Some(&first) = chunks.first() else { return Default::default() };
        let join = |all: Found, one: &Found| {
            let (most, at) = if one.1 > all.1 { (one.1, one.2) } else { (all.1, all.2) };
            (all.0 + one.0, most, at)
        };
        let (sum, most, at) = chunks[1..].iter().fold(first, join);
        ((sum / count as f64).sqrt(), most, at)
    }

    /// Encloses the largest distance of this side from the other. `known` is a distance that occurs at a place.
    fn enclosed(
        &self,
        other: &Side,
        (gap, floor): (f64, f64),
        known: (f64, DVec3),
        done: &(dyn Fn() + Sync),
    ) -> OneSided {
        let triangles = self.tree.triangles();
        let floor = floor.max(known.0 * (1.0 + gap));
        let goal = Goal { relative_gap: gap, floor, claim: NO_CLAIM };
        let runs: Vec<&[[u32; 3]]> = triangles.chunks(triangles.len().div_ceil(RUNS).max(1)).collect();
        let of_run = |run: &&[[u32; 3]]| {
            let found = largest_distance(self.positions, run, &other.tree, &goal);
            done();
            found
        };
        let found: Vec<_> = runs.par_iter().map(of_run).collect();
        let mut all = OneSided { lower: known.0, upper: known.0, at: known.1, rms: 0.0 };
        for one in found {
            all.upper = all.upper.max(one.upper);
            if one.lower > all.lower {
                (all.lower, all.at) = (one.lower, one.at);
            }
        }
        all
    }
}

/// The i-th point of a low-discrepancy sequence, folded into the triangle.
fn point_in([a, b, c]: [DVec3; 3], i: u64) -> DVec3 {
    let fraction = |step: u64| (i.wrapping_mul(step) >> 11) as f64 / (1u64 << 53) as f64;
    let (mut u, mut v) = (fraction(0xC13F_A9A9_02A6_328F), fraction(0x91E1_0DA5_C79E_7B1D));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    a + (b - a) * u + (c - a) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_as_far_from_another_as_it_was_lifted_and_the_bounds_enclose_it() {
        let triangles = [[0, 1, 2]];
        let [low, high] = [0.0, 0.25].map(|z| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, z)));
        let [low, high] = [Side::new(&low, &triangles), Side::new(&high, &triangles)];
        let (rms, most, at) = high.sampled(&low, 1000);
        assert!((rms - 0.25).abs() < 1e-12 && (most - 0.25).abs() < 1e-12 && at.z == 0.25);
        let found = high.enclosed(&low, (0.01, 0.0), (0.0, at), &|| {});
        assert!(found.lower <= 0.25 + 1e-12 && found.upper >= 0.25 - 1e-12 && found.upper <= 0.2526, "{found:?}");
        let same = low.enclosed(&low, (0.01, 1e-9), (0.0, at), &|| {});
        assert!(same.upper <= 1e-9);
        assert_eq!(low.of_points(&[DVec3::new(0.1, 0.1, 2.0), DVec3::ZERO]).upper, 2.0);
    }

    #[test]
    fn a_surface_without_triangles_is_infinitely_far_away() {
        let points = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let [one, none] = [Side::new(&points, &[[0, 1, 2]]), Side::new(&points, &[])];
        assert_eq!(one.sampled(&none, 10).1, f64::INFINITY);
        assert_eq!(none.sampled(&one, 10).1, 0.0);
    }
}
