//! The regular n-gon onto which a chart is mapped, and its n quads.
//!
//! Quad i is spanned by the centre, the midpoint of side i-1, corner i and the midpoint of side i. Its coordinates (s,
//! t) are bilinear in these four points: centre (0, 0), midpoint of side i-1 (1, 0), corner (1, 1), midpoint of side i
//! (0, 1). So the edge s = 1 runs along the second half of side i-1, and the edge t = 1 runs backwards along the first
//! half of side i; both are linear in the side's parameter. The edges s = 0 and t = 0 are the spokes that neighbouring
//! quads share.
//!
//! Everything here uses only + - * / and sqrt, never a library's sine, so that all platforms get the same bits.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};
use std::sync::OnceLock;

use glam::DVec2;

/// The fewest corners of a chart that is mapped onto a polygon.
pub const MIN_CORNERS: usize = 3;
/// The most corners of a chart that is mapped onto a polygon. With more, the quads become slivers.
pub const MAX_CORNERS: usize = 32;

/// Quad coordinates this close to 0 or 1 are on the border: the inverse map is exact only to a few units of 2^-53.
const BORDER_SNAP: f64 = 1e-12;

/// The corners and side midpoints of one regular polygon.
#[derive(Debug)]
struct Polygon {
    corners: Vec<DVec2>,
    midpoints: Vec<DVec2>,
}

/// The polygon with `corner_count` corners, clamped to [`MIN_CORNERS`] ..= [`MAX_CORNERS`].
fn polygon(corner_count: usize) -> &'static Polygon {
    static POLYGONS: OnceLock<Vec<Polygon>> = OnceLock::new();
    let polygons = POLYGONS.get_or_init(|| {
        (MIN_CORNERS..=MAX_CORNERS)
            .map(|n| {
                let corners: Vec<DVec2> = (0..n).map(|i| unit_vector(i, n)).collect();
                let midpoints = (0..n).map(|i| corners[i] + (corners[(i + 1) % n] - corners[i]) * 0.5).collect();
                Polygon { corners, midpoints }
            })
            .collect()
    });
    &polygons[corner_count.clamp(MIN_CORNERS, MAX_CORNERS) - MIN_CORNERS]
}

/// (cos, sin) of the angle 2 pi i / n: exact at multiples of a quarter turn, and symmetric about axes and diagonals.
fn unit_vector(i: usize, n: usize) -> DVec2 {
    // Eighths of a turn, and the remaining angle from the nearer axis: at most pi / 4.
    let (octant, rest) = (8 * i / n, 8 * i % n);
    let from_axis = if octant.is_multiple_of(2) { rest } else { n - rest };
    let angle = FRAC_PI_4 * from_axis as f64 / n as f64;
    // At an eighth of a turn the two series differ in the last bit.
    let (cos, sin) = if from_axis == n { (FRAC_1_SQRT_2, FRAC_1_SQRT_2) } else { (series(angle, 0), series(angle, 1)) };
    match octant % 8 {
        0 => DVec2::new(cos, sin),
        1 => DVec2::new(sin, cos),
        2 => DVec2::new(-sin, cos),
        3 => DVec2::new(-cos, sin),
        4 => DVec2::new(-cos, -sin),
        5 => DVec2::new(-sin, -cos),
        6 => DVec2::new(sin, -cos),
        _ => DVec2::new(cos, -sin),
    }
}

/// The Taylor series of cosine (`first` 0) or sine (`first` 1) in Horner form, for |x| <= pi / 4.
fn series(x: f64, first: u32) -> f64 {
    let mut sum = 1.0;
    for k in (1..=10).rev() {
        let m = f64::from(2 * k + first);
        sum = 1.0 - x * x / (m * (m - 1.0)) * sum;
    }
    if first == 0 { sum } else { x * sum }
}

/// Corner `corner` of the regular polygon, at the angle 2 pi corner / corner_count on the unit circle.
pub fn corner_point(corner_count: usize, corner: usize) -> DVec2 {
    let corners = &polygon(corner_count).corners;
    corners[corner % corners.len()]
}

/// The point at parameter `param` (0 ..= 1) of side `side`, which runs from corner `side` to the next one.
pub fn side_point(corner_count: usize, side: usize, param: f64) -> DVec2 {
    let corners = &polygon(corner_count).corners;
    let n = corners.len();
    let (a, b) = (corners[side % n], corners[(side + 1) % n]);
    // a + (b - a) need not be b.
    if param == 1.0 { b } else { a + (b - a) * param }
}

/// The point at (s, t) of quad `quad`, bilinear. Points on the outer edges have the same bits as [`side_point`], and
/// points on a spoke have the same bits from both quads.
pub fn quad_point(corner_count: usize, quad: usize, s: f64, t: f64) -> DVec2 {
    let polygon = polygon(corner_count);
    let n = polygon.corners.len();
    let quad = quad % n;
    let previous = (quad + n - 1) % n;
    if s == 1.0 {
        side_point(n, previous, 0.5 + 0.5 * t)
    } else if t == 1.0 {
        side_point(n, quad, 0.5 - 0.5 * s)
    } else {
        polygon.midpoints[previous] * (s * (1.0 - t))
            + polygon.midpoints[quad] * ((1.0 - s) * t)
            + polygon.corners[quad] * (s * t)
    }
}

/// The quad that contains a point of the polygon, and the point's (s, t) there, both in 0 ..= 1: the inverse of
/// [`quad_point`].
///
/// A point on a spoke may be given to either quad. Coordinates within 1e-12 of 0 or 1 are returned as exactly 0 or 1. A
/// point outside the polygon gets the coordinates of a nearby point on its border.
pub fn quad_coordinates(corner_count: usize, uv: DVec2) -> (usize, f64, f64) {
    let polygon = polygon(corner_count);
    // The quad of the corner in whose direction the point lies farthest.
    let mut quad = 0;
    let mut along = f64::NEG_INFINITY;
    for (i, corner) in polygon.corners.iter().enumerate() {
        let projection = corner.dot(uv);
        if projection > along {
            (quad, along) = (i, projection);
        }
    }
    let across = polygon.corners[quad].perp_dot(uv);
    // In the basis of the corner the midpoints are (a, -b) and (a, b), so along = a (s + t) + (1 - 2 a) s t and across
    // = b (t - s). With m = s + t and d = t - s, s t = (m^2 - d^2) / 4: a quadratic equation for m, solved in the form
    // without cancellation.
    let half = polygon.midpoints[quad];
    let (a, b) = (polygon.corners[quad].dot(half), polygon.corners[quad].perp_dot(half));
    let d = across / b;
    let k = (1.0 - 2.0 * a) / 4.0;
    let c = along + k * d * d;
    let m = 2.0 * c / (a + (a * a + 4.0 * k * c).max(0.0).sqrt());
    (quad, snap((m - d) * 0.5), snap((m + d) * 0.5))
}

fn snap(x: f64) -> f64 {
    if x > 1.0 - BORDER_SNAP {
        1.0
    } else if x > BORDER_SNAP {
        x
    } else {
        0.0 // Also for not-a-number.
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_lie_on_the_unit_circle_where_the_library_puts_them() {
        for n in MIN_CORNERS..=MAX_CORNERS {
            for i in 0..n {
                let angle = std::f64::consts::TAU * i as f64 / n as f64;
                assert!(corner_point(n, i).distance(DVec2::new(angle.cos(), angle.sin())) < 2e-15, "{n} {i}");
            }
        }
        assert_eq!(corner_point(4, 1), DVec2::new(0.0, 1.0));
        assert_eq!(corner_point(8, 1).x, corner_point(8, 1).y);
    }

    #[test]
    fn quad_edges_run_along_half_sides_and_shared_spokes() {
        for n in MIN_CORNERS..=MAX_CORNERS {
            for i in 0..n {
                assert_eq!(quad_point(n, i, 1.0, 1.0), corner_point(n, i));
                assert_eq!(quad_point(n, i, 0.0, 0.0), DVec2::ZERO);
                for f in [0.0, 0.125, 0.3, 0.75, 1.0] {
                    assert_eq!(quad_point(n, i, 1.0, f), side_point(n, (i + n - 1) % n, 0.5 + 0.5 * f));
                    assert_eq!(quad_point(n, i, f, 1.0), side_point(n, i, 0.5 - 0.5 * f));
                    assert_eq!(quad_point(n, i, 0.0, f), quad_point(n, (i + 1) % n, f, 0.0));
                }
            }
        }
    }

    #[test]
    fn quad_coordinates_invert_quad_point() {
        for n in MIN_CORNERS..=MAX_CORNERS {
            for i in 0..n {
                for x in 0..=16 {
                    for y in 0..=16 {
                        let (s, t) = (f64::from(x) / 16.0, f64::from(y) / 16.0);
                        let point = quad_point(n, i, s, t);
                        let (quad, s1, t1) = quad_coordinates(n, point);
                        assert!(quad_point(n, quad, s1, t1).distance(point) < 1e-14);
                        if quad == i {
                            assert!((s - s1).abs() < 1e-12 && (t - t1).abs() < 1e-12, "{n} {i} {s} {t}: {s1} {t1}");
                            for (exact, found) in [(s, s1), (t, t1)] {
                                assert!((exact != 0.0 && exact != 1.0) || exact == found);
                            }
                        } else {
                            // Only the spokes belong to two quads.
                            assert!(x == 0 || y == 0);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn points_outside_get_coordinates_on_the_border() {
        let (_, s, t) = quad_coordinates(5, DVec2::new(3.0, 0.1));
        assert!(s == 1.0 && (0.0..=1.0).contains(&t));
    }
}
