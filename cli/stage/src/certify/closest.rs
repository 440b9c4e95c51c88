//! The closest point of one triangle, in a basis whose first axis is the longest edge.
//!
//! With the longest edge on the axis, both angles at its ends are at most 90 degrees. So below the axis only that edge
//! can be closest, and above it only the edge on the point's own side of the apex. That makes three cases without a
//! division, and in none of them do needles or triangles of zero area lose digits. (Ericson's barycentric form,
//! "Real-Time Collision Detection" 5.1.5, loses all of them there.)

use glam::DVec3;

use super::bvh::Single;

/// Apex heights below this share of the longest edge count as zero: the direction of such a height is mostly rounding,
/// and moving the apex that far is well within the inflation of the final bound.
const FLAT: f64 = 1e-14;

/// A side of the triangle, seen from its end on the axis: unit direction towards the apex, and length.
#[derive(Clone, Copy, Debug)]
struct Side {
    along: f64,
    across: f64,
    length: f64,
}

impl Side {
    fn new(along: f64, across: f64) -> Self {
        let length = (along * along + across * across).sqrt();
        if length > 0.0 {
            Self { along: along / length, across: across / length, length }
        } else {
            Self { along: 1.0, across: 0.0, length: 0.0 }
        }
    }
}

/// One triangle, prepared for distance queries.
#[derive(Clone, Copy, Debug)]
pub(super) struct PreparedTriangle {
    /// Where the longest edge starts.
    start: DVec3,
    /// Orthonormal basis: along the longest edge, towards the apex, normal.
    axes: [DVec3; 3],
    /// Length of the longest edge.
    base: f64,
    /// Coordinate of the apex along the longest edge, in `0..=base`.
    apex: f64,
    /// The sides left and right of the apex, each from its end on the longest edge.
    sides: [Side; 2],
}

impl PreparedTriangle {
    /// Prepares any three finite points; they may coincide or lie on a line.
    pub(super) fn new(corners: [DVec3; 3]) -> Self {
        let square = |k: usize| corners[k].distance_squared(corners[(k + 1) % 3]);
        let (s0, s1, s2) = (square(0), square(1), square(2));
        let k = if s0 >= s1 && s0 >= s2 {
            0
        } else if s1 >= s2 {
            1
        } else {
            2
        };
        let [start, end, tip] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
        let base = (end - start).length();
        if !(base > 0.0 && base.is_finite()) {
            // A single point. (Also if squares underflow or overflow: one point of the triangle still gives an upper
            // bound.)
            let side = Side::new(0.0, 0.0);
            return Self { start, axes: DVec3::AXES, base: 0.0, apex: 0.0, sides: [side; 2] };
        }
        let along = (end - start) / base;
        let apex = (tip - start).dot(along).clamp(0.0, base);
        let mut across = (tip - start) - along * apex;
        across -= along * across.dot(along);
        let mut height = across.length();
        if height > FLAT * base {
            across /= height;
        } else {
            height = 0.0;
            across = along.any_orthonormal_vector();
        }
        let sides = [Side::new(apex, height), Side::new(base - apex, height)];
        Self { start, axes: [along, across, along.cross(across)], base, apex, sides }
    }

    /// Squared distance from a point.
    #[inline(always)]
    pub(super) fn distance_squared(&self, point: DVec3) -> f64 {
        let d = point - self.start;
        let (x, y, z) = (d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]));
        let left = x < self.apex;
        let from_end = if left { x } else { self.base - x };
        let in_plane = if y <= 0.0 {
            let beyond = if from_end < 0.0 { from_end } else { 0.0 };
            beyond * beyond + y * y
        } else {
            let side = &self.sides[usize::from(!left)];
            let inside = from_end * side.across - y * side.along;
            if inside > 0.0 {
                0.0
            } else {
                let t = from_end * side.along + y * side.across;
                let beyond = t - t.clamp(0.0, side.length);
                beyond * beyond + inside * inside
            }
        };
        in_plane + z * z
    }

    /// Where the longest edge starts, the direction of this, and that towards the apex.
    pub(super) fn frame(&self) -> [DVec3; 3] {
        [self.start, self.axes[0], self.axes[1]]
    }

    /// The same in single precision, relative to a point.
    pub(super) fn single(&self, about: DVec3) -> Single {
        let side = |side: Side| [side.along, side.across, side.length].map(|x| x as f32);
        Single {
            start: (self.start - about).as_vec3().to_array(),
            axes: self.axes.map(|axis| axis.as_vec3().to_array()),
            base: self.base as f32,
            apex: self.apex as f32,
            sides: self.sides.map(side),
        }
    }

    /// The closest point of the triangle.
    pub(super) fn closest_point(&self, point: DVec3) -> DVec3 {
        let d = point - self.start;
        let (x, y) = (d.dot(self.axes[0]), d.dot(self.axes[1]));
        let left = x < self.apex;
        let from_end = if left { x } else { self.base - x };
        let (from_end, y) = if y <= 0.0 {
            (from_end.max(0.0), 0.0)
        } else {
            let side = &self.sides[usize::from(!left)];
            if from_end * side.across - y * side.along > 0.0 {
                (from_end, y)
            } else {
                let t = (from_end * side.along + y * side.across).clamp(0.0, side.length);
                (t * side.along, t * side.across)
            }
        };
        self.start + self.axes[0] * if left { from_end } else { self.base - from_end } + self.axes[1] * y
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Random;
    use super::*;

    /// The minimum over a fine barycentric lattice, and the spacing of that lattice.
    fn sampled(corners: [DVec3; 3], point: DVec3) -> (f64, f64) {
        let n = 200;
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let q = corners[0]
                    + (corners[1] - corners[0]) * (i as f64 / n as f64)
                    + (corners[2] - corners[0]) * (j as f64 / n as f64);
                best = best.min(q.distance(point));
            }
        }
        let spacing = corners[0].distance(corners[1]).max(corners[0].distance(corners[2])) / n as f64;
        (best, spacing)
    }

    fn check(corners: [DVec3; 3], point: DVec3) {
        let triangle = PreparedTriangle::new(corners);
        let distance = triangle.distance_squared(point).sqrt();
        let (best, spacing) = sampled(corners, point);
        assert!(distance <= best + 1e-12 && distance >= best - 1.5 * spacing, "{distance} {best} {corners:?} {point}");
        let closest = triangle.closest_point(point);
        assert!((closest.distance(point) - distance).abs() < 1e-12);
        assert!(triangle.distance_squared(closest).sqrt() < 1e-12);
    }

    #[test]
    fn distance_agrees_with_samples_of_the_triangle() {
        let mut random = Random(1);
        for _ in 0..60 {
            let corners = [(); 3].map(|()| random.point());
            for _ in 0..4 {
                check(corners, random.point() * 2.0);
            }
        }
    }

    #[test]
    fn needles_segments_and_points_have_distances() {
        let mut random = Random(2);
        for _ in 0..20 {
            let (a, b) = (random.point(), random.point());
            for corners in [[a, a, a], [a, a, b], [a, b, a], [b, a, a], [a, b, a.lerp(b, 0.3)], [a, b, a * 2.0 - b]] {
                check(corners, random.point());
                check(corners, corners[0]);
            }
            for width in [1e-3, 1e-7, 1e-12, 1e-15] {
                check([a, b, a.lerp(b, 0.6) + random.point() * width], random.point());
            }
        }
    }

    #[test]
    fn points_in_line_with_a_right_angle_are_outside() {
        let triangle = PreparedTriangle::new([DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert!((triangle.distance_squared(DVec3::new(0.0, 3.0, 0.0)).sqrt() - 2.0).abs() < 1e-14);
        let flat = PreparedTriangle::new([DVec3::ZERO, DVec3::X, DVec3::X]);
        assert_eq!(flat.distance_squared(DVec3::new(1.0, 3.0, 0.0)).sqrt(), 3.0);
    }
}
