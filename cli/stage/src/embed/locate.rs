//! Point location in a map, by walking from triangle to triangle.

use glam::{DVec2, DVec3};

use lodpack_mesh::{Adjacency, NONE};

/// How far outside a triangle a point may lie and still count as found, in barycentric coordinates: edges are subject
/// to rounding.
const SLACK: f64 = 1e-9;

/// A point of a map: a triangle and the weights of its three vertices, which are not negative and add up to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Index into the map's triangles.
    pub triangle: u32,
    /// Weights of the triangle's vertices.
    pub barycentric: [f64; 3],
}

/// Finds points in a triangulation of a convex domain.
#[derive(Clone, Copy, Debug)]
pub struct Locator<'a> {
    uv: &'a [DVec2],
    triangles: &'a [[u32; 3]],
    opposite: &'a [u32],
}

impl<'a> Locator<'a> {
    /// A locator for counter-clockwise triangles and their neighbours.
    pub fn new(uv: &'a [DVec2], triangles: &'a [[u32; 3]], adjacency: &'a Adjacency) -> Self {
        Self { uv, triangles, opposite: &adjacency.opposite }
    }

    /// The triangle that contains a point. The search starts at triangle `hint`: the result for a nearby point is best,
    /// but any value is allowed. A point outside the domain yields a point of the nearest triangle. `None` only if
    /// there are no triangles or the point is not finite.
    ///
    /// This is a visibility walk (Devillers, Pion and Teillaud, "Walking in a triangulation", 2001): cross any edge
    /// that has the point on its other side. In a triangulation that is not Delaunay the walk can circle, so it varies
    /// which edge it tries first; if it still does not arrive, all triangles are searched.
    pub fn find(&self, point: DVec2, hint: u32) -> Option<Location> {
        if !point.is_finite() || self.triangles.is_empty() {
            return None;
        }
        let mut triangle = if (hint as usize) < self.triangles.len() { hint } else { 0 };
        let mut random = 0x9e37_79b9_u32;
        let mut entered_by = NONE;
        for _ in 0..self.triangles.len() + 64 {
            let corners = self.corners(triangle);
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let first = (u64::from(random) * 3) >> 32;
            let mut exit = NONE;
            for k in 0..3 {
                let k = (first as usize + k) % 3;
                let half_edge = triangle * 3 + k as u32;
                // The point is on the inner side of the edge by which the walk entered.
                if half_edge != entered_by && side(corners[k], corners[(k + 1) % 3], point) < 0.0 {
                    let opposite = self.opposite[half_edge as usize];
                    if opposite != NONE {
                        exit = opposite;
                        break;
                    }
                }
            }
            if exit == NONE {
                // The point is inside, or only border edges have it on their outer side.
                let raw = raw_barycentric(corners, point);
                if raw.iter().all(|&w| w >= -SLACK) {
                    return Some(Location { triangle, barycentric: clamped(raw) });
                }
                break;
            }
            entered_by = exit;
            triangle = exit / 3;
        }
        self.nearest(point)
    }

    /// Searches all triangles for the nearest one.
    fn nearest(&self, point: DVec2) -> Option<Location> {
        let mut best: Option<(f64, Location)> = None;
        for triangle in 0..self.triangles.len() as u32 {
            let (distance, barycentric) = nearest_in_triangle(self.corners(triangle), point);
            if best.is_none_or(|(least, _)| distance < least) {
                best = Some((distance, Location { triangle, barycentric }));
            }
        }
        best.map(|(_, location)| location)
    }

    /// The weighted sum of per-vertex values, such as surface positions, at a location.
    pub fn evaluate(&self, values: &[DVec3], location: Location) -> DVec3 {
        let [a, b, c] = self.triangles[location.triangle as usize].map(|v| values[v as usize]);
        let [u, v, w] = location.barycentric;
        a * u + b * v + c * w
    }

    fn corners(&self, triangle: u32) -> [DVec2; 3] {
        self.triangles[triangle as usize].map(|v| self.uv[v as usize])
    }
}

/// Positive when `p` is left of the line from `a` to `b`.
fn side(a: DVec2, b: DVec2, p: DVec2) -> f64 {
    (b - a).perp_dot(p - a)
}

fn raw_barycentric([a, b, c]: [DVec2; 3], p: DVec2) -> [f64; 3] {
    let area = side(a, b, c);
    if area <= 0.0 {
        return [f64::NAN; 3]; // Rounding hides the answer, so let no weight pass.
    }
    let (u, v) = (side(b, c, p) / area, side(c, a, p) / area);
    [u, v, 1.0 - u - v]
}

/// The weights, clamped to at least 0 and scaled to add up to 1.
fn clamped(raw: [f64; 3]) -> [f64; 3] {
    let positive = raw.map(|w| w.max(0.0));
    let sum: f64 = positive.iter().sum();
    positive.map(|w| w / sum)
}

/// Squared distance of a point from a triangle, and the weights of the nearest point in it.
fn nearest_in_triangle(corners: [DVec2; 3], point: DVec2) -> (f64, [f64; 3]) {
    let raw = raw_barycentric(corners, point);
    if raw.iter().all(|&w| w >= 0.0) {
        return (0.0, clamped(raw));
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let f = ((point - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let distance = point.distance_squared(a + (b - a) * f);
        if distance < best.0 {
            let mut weights = [0.0; 3];
            weights[k] = 1.0 - f;
            weights[(k + 1) % 3] = f;
            best = (distance, weights);
        }
    }
    best
}
