//! Local frames (SPEC.md, "Local frames").
//!
//! Residuals are coded with coarse steps along the surface and fine steps across it, because only the error across it
//! is visible. No other measure saves as many bytes as a tangential step of several normal steps.

use crate::codec::{
    patch::LatticePoint,
    vector::{Vec3, add, cross, dot, scale},
};

/// Largest absolute lattice coordinate.
pub(crate) const COORDINATE_LIMIT: f64 = (1u64 << 40) as f64;

/// An orthonormal frame, right-handed: `along` x `across` = `normal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LocalFrame {
    /// Tangent in the given direction.
    pub along: Vec3,
    /// Tangent to the left of `along`, seen from the side that the normal points to.
    pub across: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// The frame where the geometry gives no direction.
pub(crate) const AXES: LocalFrame =
    LocalFrame { along: [1.0, 0.0, 0.0], across: [0.0, 1.0, 0.0], normal: [0.0, 0.0, 1.0] };

/// `a * (1 / sqrt(a . a))`, or none if the length is zero.
fn unit(a: Vec3) -> Option<Vec3> {
    let square = dot(a, a);
    // Unlike `square == 0`, this also refuses NaN and infinity. Hostile coordinates cannot lead to them, but callers
    // may pass them.
    (square > 0.0 && square < f64::INFINITY).then(|| scale(a, 1.0 / square.sqrt()))
}

impl LocalFrame {
    /// The frame with its normal in the direction of `normal` and its first tangent as close as possible to
    /// `direction`.
    ///
    /// `across` is normal x direction, made unit; `normal` is made unit; `along` is across x normal. The frame is that
    /// of the coordinate axes where the normal vanishes, or where `direction` is parallel to it.
    #[inline]
    pub(crate) fn new(normal: Vec3, direction: Vec3) -> Self {
        // The two square roots do not depend on each other, so they run at the same time.
        let (Some(across), Some(normal)) = (unit(cross(normal, direction)), unit(normal)) else { return AXES };
        Self { along: cross(across, normal), across, normal }
    }

    /// `point + along * a + across * b`, summed in this order.
    #[inline]
    pub(crate) fn slide(&self, point: Vec3, a: f64, b: f64) -> Vec3 {
        add(add(point, scale(self.along, a)), scale(self.across, b))
    }

    /// `point + normal * height`.
    #[inline]
    pub(crate) fn lift(&self, point: Vec3, height: f64) -> Vec3 {
        add(point, scale(self.normal, height))
    }
}

/// The nearest integer: floor(x + 0.5), so halves go up. The format has no other rounding rule.
pub(crate) fn round(x: f64) -> f64 {
    (x + 0.5).floor()
}

/// The lattice point nearest to `point`, or none if a coordinate exceeds 2^40 or is not a number.
#[inline]
pub(crate) fn to_lattice(point: Vec3) -> Option<LatticePoint> {
    // As `round`, without a call of the library's floor. Casts round towards zero, and NaN fails the comparison.
    let in_range = point.iter().all(|x| x.abs() <= 2.0 * COORDINATE_LIMIT);
    let nearest = |x: f64| {
        let above = x + 0.5;
        let cut = above as i64;
        // Far below all integers this wraps, and is out of range anyway.
        cut.wrapping_sub(i64::from(cut as f64 > above))
    };
    // `map` would be compiled to a call.
    let rounded = [nearest(point[0]), nearest(point[1]), nearest(point[2])];
    (in_range && rounded.iter().all(|x| x.unsigned_abs() <= COORDINATE_LIMIT as u64)).then_some(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_right_handed_and_orthonormal() {
        for (normal, direction) in [([0.0, 0.0, 5.0], [1.0, 1.0, 3.0]), ([1.0, -2.0, 0.5], [0.0, 4.0, 1.0])] {
            let f = LocalFrame::new(normal, direction);
            let c = cross(f.along, f.across);
            for k in 0..3 {
                assert!((c[k] - f.normal[k]).abs() < 1e-14);
            }
            assert!(dot(f.normal, normal) > 0.0 && dot(f.along, direction) > 0.0);
            assert!(dot(f.along, f.across).abs() < 1e-14 && (dot(f.across, f.across) - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn degenerate_frames_are_the_axes() {
        assert_eq!(LocalFrame::new([0.0; 3], [1.0, 0.0, 0.0]), AXES);
        assert_eq!(LocalFrame::new([0.0, 2.0, 0.0], [0.0, 1.0, 0.0]), AXES);
        assert_eq!(LocalFrame::new([f64::NAN; 3], [1.0, 0.0, 0.0]), AXES);
    }

    #[test]
    fn coordinates_beyond_all_integers_are_refused_on_both_sides() {
        for x in [1e13, 9.3e18, 1e19, 1e300, f64::MAX, f64::INFINITY] {
            for x in [x, -x] {
                assert_eq!(to_lattice([0.0, x, 0.0]), None, "{x}");
            }
        }
    }

    #[test]
    fn halves_round_upward_and_large_points_are_refused() {
        assert_eq!(to_lattice([0.5, -0.5, 1.49]), Some([1, 0, 1]));
        for x in [-1.5, -1.0, -0.51, -0.49, -0.0, 0.499_999_999_999_999_94, 2.5, 1e9 + 0.5, -1e9 - 0.5, -1e12 + 0.5] {
            assert_eq!(to_lattice([x; 3]), Some([round(x) as i64; 3]));
        }
        assert_eq!(to_lattice([f64::INFINITY, 0.0, 0.0]), None);
        assert_eq!(to_lattice([f64::MAX, 0.0, 0.0]), None);
        assert_eq!(to_lattice([COORDINATE_LIMIT, -COORDINATE_LIMIT, 0.0]), Some([1 << 40, -(1 << 40), 0]));
        assert_eq!(to_lattice([COORDINATE_LIMIT + 1.0, 0.0, 0.0]), None);
        assert_eq!(to_lattice([f64::NAN, 0.0, 0.0]), None);
    }
}
