//! Closest points on triangles.

use glam::DVec3;

/// Barycentric coordinates of the point of a triangle that is closest to `p` (Ericson, "Real-Time Collision Detection",
/// 5.1.5).
pub(super) fn closest(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return DVec3::X;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return DVec3::Y;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3).max(f64::MIN_POSITIVE);
        return DVec3::new(1.0 - v, v, 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return DVec3::Z;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6).max(f64::MIN_POSITIVE);
        return DVec3::new(1.0 - w, 0.0, w);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6)).max(f64::MIN_POSITIVE);
        return DVec3::new(0.0, 1.0 - w, w);
    }
    let sum = va + vb + vc;
    if sum > 0.0 { DVec3::new(va, vb, vc) / sum } else { DVec3::X }
}

/// The point with given barycentric coordinates.
pub(super) fn at([a, b, c]: [DVec3; 3], w: DVec3) -> DVec3 {
    a * w.x + b * w.y + c * w.z
}

/// Squared distance between a point and a triangle.
pub(super) fn squared_distance(p: DVec3, triangle: [DVec3; 3]) -> f64 {
    at(triangle, closest(p, triangle)).distance_squared(p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closest_points_beat_all_points_of_a_fine_raster() {
        let t = [DVec3::new(0.0, 0.0, 1.0), DVec3::new(3.0, 0.5, 0.0), DVec3::new(1.0, 2.0, -1.0)];
        for i in 0..200 {
            let p = DVec3::new((i % 7) as f64 - 2.0, (i % 11) as f64 * 0.5 - 2.0, (i % 5) as f64 - 2.0);
            let found = squared_distance(p, t);
            for j in 0..=20 {
                for k in 0..=20 - j {
                    let w = DVec3::new(j as f64, k as f64, (20 - j - k) as f64) / 20.0;
                    assert!(found <= at(t, w).distance_squared(p) + 1e-12);
                }
            }
        }
    }
}
