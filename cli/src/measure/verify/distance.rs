//! The verifier's own distance measurement. It shares no code with `stage::certify`, on purpose.
//!
//! Branch and bound over convex polygons encloses the largest distance from a set of triangles to a surface. Two facts
//! bound the distance within a polygon. The polygon lies in a ball, and the distance of points changes no faster than
//! they move; and the distance to one triangle of the surface, which is convex, is largest at a corner of the polygon.
//! The distance of any point of a polygon bounds the largest distance from below. Polygons that cannot exceed a
//! distance known to occur elsewhere are not resolved further. From the others, worst first, the part above a near
//! triangle is cut out and settled with it, and the rest is divided further.

pub use super::tree::BoxTree;

use super::polygon::Polygon;
use glam::DVec3;
use std::collections::BinaryHeap;

/// A triangle by its corners.
pub type Corners = [DVec3; 3];

/// Bounds on the largest distance from some triangles to a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Enclosure {
    /// A distance that occurs.
    pub lower: f64,
    /// No larger distance occurs, up to the rounding of coordinates.
    pub upper: f64,
    /// Where the lower bound occurs.
    pub at: DVec3,
}

/// How tightly to enclose a distance.
#[derive(Clone, Copy, Debug)]
pub struct Goal {
    /// Upper over lower bound, minus 1.
    pub relative_gap: f64,
    /// Distances up to this length need no resolution.
    pub floor: f64,
    /// A length that the distance is claimed not to exceed. The claim is proven or refuted, however small the gap must
    /// be.
    pub claim: f64,
}

impl Default for Goal {
    fn default() -> Self {
        Self { relative_gap: 0.02, floor: 0.0, claim: f64::INFINITY }
    }
}

/// Polygons to divide at most while a claim is in doubt.
const POLYGON_LIMIT: usize = 2_000_000;
/// Polygons to divide, per initial triangle, once the claim is proven. Surfaces that lie in each other have distances
/// that are only rounding errors; enclosing those would take forever and say nothing.
const PROVEN_POLYGON_FACTOR: usize = 8;
const PROVEN_POLYGON_LIMIT: usize = 2_000;
/// Triangles whose corners are measured first, so that pruning starts with a good lower bound.
const SEEDS: usize = 64;
/// The search for a triangle to continue with ends at this share of the (squared) length that does not matter.
const NEAR: f64 = 0.1;
/// How far beyond its edges a triangle may still be used, relative to what its height leaves. Less than half, because
/// two edges that meet at an acute angle continue for more than twice that.
const BEYOND: f64 = 0.3;
/// A part that reaches farther by only this share is not cut off: slivers would lie on their own edges and never get
/// smaller.
const SLIVER: f64 = 0.1;
/// A polygon is halved after this many cuts, so that polygons shrink whatever rounding does.
const CUTS: u8 = 8;

/// Encloses the largest distance from some triangles to the surface in `tree`: within the gap, or down to the floor, or
/// until many polygons have been divided (then `upper` is sound but loose). Infinite if there is no surface.
pub fn largest_distance(positions: &[DVec3], triangles: &[[u32; 3]], tree: &BoxTree, goal: &Goal) -> Enclosure {
    if triangles.is_empty() {
        return Enclosure::default();
    }
    let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
    if tree.triangles().is_empty() {
        return Enclosure { lower: f64::INFINITY, upper: f64::INFINITY, at: corners(&triangles[0])[0] };
    }
    let mut search = Search { tree, goal, hint: 0, lower: 0.0, at: corners(&triangles[0])[0], settled: 0.0 };
    for triangle in triangles.iter().step_by(triangles.len().div_ceil(SEEDS)) {
        search.measure(corners(triangle)[0]);
    }
    let mut open = BinaryHeap::new();
    for triangle in triangles {
        open.extend(search.examine(Polygon::triangle(corners(triangle)), f64::INFINITY, 0, true));
    }
    let proven_limit = PROVEN_POLYGON_LIMIT + PROVEN_POLYGON_FACTOR * triangles.len();
    let mut divided = 0;
    while let Some(polygon) = open.pop() {
        let limit = if polygon.upper <= goal.claim { proven_limit } else { POLYGON_LIMIT };
        if polygon.upper <= search.enough() || divided > limit {
            search.settled = search.settled.max(polygon.upper);
            break;
        }
        divided += 1;
        search.divide(&polygon, &mut open);
    }
    Enclosure { lower: search.lower, upper: search.settled.max(search.lower), at: search.at }
}

struct Search<'a> {
    tree: &'a BoxTree<'a>,
    goal: &'a Goal,
    /// Slot of the triangle that was near last time.
    hint: u32,
    /// The largest distance found to occur, and where.
    lower: f64,
    at: DVec3,
    /// The largest bound of all polygons set aside.
    settled: f64,
}

impl Search<'_> {
    /// The length up to which a distance does not matter.
    fn enough(&self) -> f64 {
        let enough = (self.lower * (1.0 + self.goal.relative_gap)).max(self.goal.floor);
        if self.lower <= self.goal.claim { enough.min(self.goal.claim) } else { enough }
    }

    /// Measures the distance of a point of a polygon, if it exceeds what is known to occur.
    fn measure(&mut self, p: DVec3) {
        self.query(p, self.lower * self.lower);
    }

    /// The squared distance to any triangle within `enough` (squared), or to the nearest one if all are farther.
    fn query(&mut self, p: DVec3, enough: f64) -> f64 {
        let (square, slot) = self.tree.search(p, self.hint, enough);
        self.hint = slot;
        if square > enough.max(self.tree.rounding()) && square > self.lower * self.lower {
            (self.lower, self.at) = (square.sqrt(), p);
        }
        square
    }

    /// Sets a polygon aside if the triangle that was near last time is near enough to all of it.
    fn settle(&mut self, polygon: &Polygon) -> bool {
        let enough = self.enough();
        let mut largest = 0.0f64;
        for &p in polygon.corners() {
            largest = largest.max(self.tree.distance_squared(p, self.hint));
            if largest > enough * enough {
                return false;
            }
        }
        self.settled = self.settled.max(largest.sqrt());
        true
    }

    /// Sets a polygon aside, or returns what is known about it. `upper` is a bound that is already known, `cuts` the
    /// number of cuts since the polygon was halved, and `whole` asks to measure the corners too.
    fn examine(&mut self, polygon: Polygon, upper: f64, cuts: u8, whole: bool) -> Option<Open> {
        if self.settle(&polygon) {
            return None;
        }
        let (centre, radius) = polygon.ball();
        let enough = self.enough();
        let square = self.query(centre, enough * enough * NEAR);
        if self.settle(&polygon) {
            return None;
        }
        let slot = self.hint;
        if whole {
            for &p in polygon.corners() {
                self.measure(p);
            }
        }
        Some(Open { upper: upper.min(square.sqrt() + radius), polygon, slot, cuts })
    }

    /// Settles the part of a polygon above its near triangle and passes on the rest.
    fn divide(&mut self, open: &Open, rest: &mut BinaryHeap<Open>) {
        self.hint = open.slot;
        let mut left = [None; 3];
        let above = if open.cuts < CUTS { self.above(&open.polygon, &mut left) } else { None };
        let (parts, cuts) = if above.is_some_and(|part| self.settle(&part)) {
            (left, open.cuts + 1)
        } else {
            let [a, b] = open.polygon.halves();
            ([a, b, None], 0)
        };
        for part in parts.into_iter().flatten() {
            rest.extend(self.examine(part, open.upper, cuts, false));
            self.hint = open.slot;
        }
    }

    /// The part of a polygon that lies above the triangle that was near last time, or a little beyond its edges. The
    /// other parts go to `left`.
    fn above(&self, polygon: &Polygon, left: &mut [Option<Polygon>; 3]) -> Option<Polygon> {
        if !polygon.can_be_cut(left.len()) {
            return None;
        }
        let [a, b, c] = self.tree.corners(self.hint);
        let normal = (b - a).cross(c - a);
        let (centre, _) = polygon.ball();
        let height = (centre - a).dot(normal);
        let enough = self.enough();
        let room = enough * enough - height * height / normal.length_squared();
        // Not a number for degenerate triangles.
        if room.is_nan() || room <= 0.0 {
            return None;
        }
        let beyond = BEYOND * room.sqrt();
        let mut part = *polygon;
        for ((u, v), left) in [(a, b), (b, c), (c, a)].into_iter().zip(left) {
            let outwards = (v - u).cross(normal).normalize_or_zero();
            // The part must contain the middle, so that it is substantial.
            if (centre - u).dot(outwards) > beyond {
                return None;
            }
            let [inside, outside] = part.cut(u + outwards * beyond, outwards, SLIVER * beyond);
            *left = outside;
            part = inside?;
        }
        Some(part)
    }
}

/// A polygon whose distance is not settled, ordered by its upper bound.
struct Open {
    upper: f64,
    polygon: Polygon,
    /// A near triangle of the surface.
    slot: u32,
    /// Cuts made since it was halved.
    cuts: u8,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.upper.total_cmp(&other.upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Sheet = (Vec<DVec3>, Vec<[u32; 3]>);

    fn sheet(n: u32, height: impl Fn(f64, f64) -> f64) -> Sheet {
        let at = |i: u32, j: u32| {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            DVec3::new(x, y, height(x, y))
        };
        let positions = (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))).map(|(i, j)| at(i, j)).collect();
        let index = |i: u32, j: u32| i * (n + 1) + j;
        let triangles = (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        (positions, triangles)
    }

    fn largest(from: &Sheet, to: &Sheet, goal: &Goal) -> Enclosure {
        largest_distance(&from.0, &from.1, &BoxTree::new(&to.0, &to.1), goal)
    }

    #[test]
    fn a_lifted_sheet_is_as_far_as_it_was_lifted() {
        let goal = Goal { relative_gap: 0.01, ..Goal::default() };
        let found = largest(&sheet(5, |_, _| 0.25), &sheet(7, |_, _| 0.0), &goal);
        assert!(found.lower <= 0.25 + 1e-12 && found.upper >= 0.25 - 1e-12 && found.upper <= 0.2526);
        assert_eq!(largest(&(vec![], vec![]), &sheet(2, |_, _| 0.0), &goal), Enclosure::default());
        assert_eq!(largest(&sheet(2, |_, _| 0.0), &(vec![], vec![]), &goal).lower, f64::INFINITY);
    }

    #[test]
    fn a_peak_between_vertices_is_found() {
        // A plane with a hole in its middle: the farthest point is inside a triangle.
        let (positions, mut triangles) = sheet(8, |_, _| 0.0);
        let middle = DVec3::new(0.5, 0.5, 0.0);
        triangles.retain(|t| t.iter().any(|&v| (positions[v as usize] - middle).length() > 0.3));
        let plane = (positions, triangles);
        let goal = Goal { relative_gap: 0.01, ..Goal::default() };
        let one = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
            (vec![a, b, c].into_iter().map(|[x, y]| DVec3::new(x, y, 0.0)).collect(), vec![[0, 1, 2]])
        };
        let outside = largest(&one([-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]), &plane, &goal);
        let inside = largest(&one([0.0, 0.0], [1.0, 0.0], [0.0, 1.0]), &plane, &goal);
        assert!(outside.lower > 1.9);
        assert!(inside.lower > 0.15 && inside.upper < inside.lower * 1.011);
        assert!((inside.at - middle).length() < 0.1);
    }

    #[test]
    fn bumpy_sheets_are_enclosed_as_by_dense_sampling() {
        let wave = |x: f64, y: f64| 0.1 * (9.0 * x).sin() * (7.0 * y).cos();
        let (fine, coarse) = (sheet(60, wave), sheet(9, wave));
        let tree = BoxTree::new(&coarse.0, &coarse.1);
        let sampled = sheet(600, |_, _| 0.0).0.into_iter().fold(0.0f64, |most, p| {
            let (i, j) = ((p.x * 60.0).min(59.999), (p.y * 60.0).min(59.999));
            // Points of the fine sheet, by its own triangles.
            let cell = (i.floor() as usize * 60 + j.floor() as usize) * 2;
            let lower = i.fract() >= j.fract();
            let [a, b, c] = fine.1[cell + usize::from(!lower)].map(|v| fine.0[v as usize]);
            let q = if lower {
                a + (b - a) * i.fract() + (c - b) * j.fract()
            } else {
                a + (b - c) * i.fract() + (c - a) * j.fract()
            };
            most.max(tree.nearest(q, 0).expect("a sheet").0)
        });
        let found = largest_distance(&fine.0, &fine.1, &tree, &Goal { relative_gap: 0.005, ..Goal::default() });
        assert!(found.upper >= sampled && found.lower >= sampled * 0.995, "{found:?} {sampled}");
        assert!(found.upper <= found.lower * 1.0051);
    }

    #[test]
    fn a_claim_is_decided_even_if_it_is_nearly_the_distance() {
        let (low, high) = (sheet(5, |_, _| 0.0), sheet(4, |x, _| 0.1 + 0.001 * x));
        let goal = |claim: f64| Goal { relative_gap: 0.5, floor: 0.0, claim };
        let truth = largest(&high, &low, &Goal { relative_gap: 1e-6, ..Goal::default() }).lower;
        let proven = largest(&high, &low, &goal(truth * 1.0001));
        assert!(proven.upper <= truth * 1.0001, "{proven:?}");
        assert!(largest(&high, &low, &goal(truth * 0.9999)).lower > truth * 0.9999);
    }

    #[test]
    fn a_proven_claim_ends_the_search_among_surfaces_that_lie_in_each_other() {
        // Coplanar, but no triangle of one lies within one of the other.
        let goal = Goal { relative_gap: 0.01, floor: 1e-12, claim: 0.001 };
        let found = largest(&sheet(1, |_, _| 0.0), &sheet(60, |_, _| 0.0), &goal);
        assert!(found.lower <= 1e-12 && found.upper <= 0.001);
    }
}
