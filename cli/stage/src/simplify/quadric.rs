//! Quadrics: the area-weighted sum of squared distances to a set of planes, as a function of a point (Garland and
//! Heckbert, "Surface Simplification Using Quadric Error Metrics", 1997).
//!
//! The minimum is searched from a given point, with damping, in the spirit of Trettner and Kobbelt, "Fast and Robust
//! QEF Minimization using Probabilistic Quadrics" (2020): in directions that the planes do not determine, the point
//! stays where it was.

use std::ops::{Add, AddAssign};

use glam::DVec3;

/// A quadratic function of a point `x`: `x·Ax + 2 b·x + c`, where A is symmetric and positive semidefinite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quadric {
    /// Diagonal of A: xx, yy, zz. Unit: area.
    pub diagonal: DVec3,
    /// The entries off the diagonal of A: yz, xz, xy. Unit: area.
    pub off_diagonal: DVec3,
    /// The linear part b. Unit: area times length.
    pub linear: DVec3,
    /// The constant part c. Unit: area times length squared.
    pub constant: f64,
    /// Accumulated area; the error divided by it is a mean squared distance. Importance does not scale it.
    pub weight: f64,
}

impl Quadric {
    /// `weight` times the squared distance to the plane through `point` with the unit normal `normal`.
    pub fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let distance = -normal.dot(point);
        let scaled = normal * weight;
        Self {
            diagonal: scaled * normal,
            off_diagonal: DVec3::new(scaled.y * normal.z, scaled.x * normal.z, scaled.x * normal.y),
            linear: scaled * distance,
            constant: weight * distance * distance,
            weight,
        }
    }

    /// The matrix A applied to a vector.
    fn apply(&self, x: DVec3) -> DVec3 {
        let (d, o) = (self.diagonal, self.off_diagonal);
        DVec3::new(
            d.x * x.x + o.z * x.y + o.y * x.z,
            o.z * x.x + d.y * x.y + o.x * x.z,
            o.y * x.x + o.x * x.y + d.z * x.z,
        )
    }

    /// The error at a point: area times length squared, never negative.
    pub fn error(&self, x: DVec3) -> f64 {
        (x.dot(self.apply(x) + 2.0 * self.linear) + self.constant).max(0.0)
    }

    /// Half the gradient at a point.
    pub fn half_gradient(&self, x: DVec3) -> DVec3 {
        self.apply(x) + self.linear
    }

    /// The mean squared distance for an error of this quadric.
    pub fn mean(&self, error: f64) -> f64 {
        if self.weight > 0.0 { error / self.weight } else { 0.0 }
    }

    /// The step from `start` to the minimum of error + damping x trace(A) x squared step length.
    ///
    /// The damping is relative, so the system is well conditioned at any scale. Directions whose eigenvalue is below
    /// damping x trace(A), which the planes hardly determine, stay nearly as they are.
    pub fn step_to_minimum(&self, start: DVec3, damping: f64) -> DVec3 {
        let trace = self.diagonal.x + self.diagonal.y + self.diagonal.z;
        if trace <= 0.0 {
            return DVec3::ZERO;
        }
        let rhs = -self.half_gradient(start);
        let (o, d) = (self.off_diagonal, self.diagonal + DVec3::splat(damping * trace));
        // LDL^T without pivoting: the damping makes the matrix positive definite.
        let l10 = o.z / d.x;
        let l20 = o.y / d.x;
        let d1 = d.y - l10 * o.z;
        let e21 = o.x - l10 * o.y;
        let l21 = e21 / d1;
        let d2 = d.z - l20 * o.y - l21 * e21;
        let y1 = rhs.y - l10 * rhs.x;
        let y2 = rhs.z - l20 * rhs.x - l21 * y1;
        let z = y2 / d2;
        let y = y1 / d1 - l21 * z;
        let x = rhs.x / d.x - l10 * y - l20 * z;
        DVec3::new(x, y, z)
    }

    /// The same function, with everything but the weight multiplied by a factor.
    pub fn amplified(&self, factor: f64) -> Self {
        Self {
            diagonal: self.diagonal * factor,
            off_diagonal: self.off_diagonal * factor,
            linear: self.linear * factor,
            constant: self.constant * factor,
            weight: self.weight,
        }
    }

    /// The same function of the offset from `centre`, in a unit `1 / scale` times as long as the present one.
    ///
    /// With `scale` as the present unit measured in the new one, `q.centred(c, s).error(s * d) == s^4 * q.error(c +
    /// d)`.
    pub fn centred(&self, centre: DVec3, scale: f64) -> Self {
        let area = scale * scale;
        Self {
            diagonal: self.diagonal * area,
            off_diagonal: self.off_diagonal * area,
            linear: self.half_gradient(centre) * (area * scale),
            constant: self.error(centre) * (area * area),
            weight: self.weight * area,
        }
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        self.diagonal += other.diagonal;
        self.off_diagonal += other.off_diagonal;
        self.linear += other.linear;
        self.constant += other.constant;
        self.weight += other.weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Quadric {
        Quadric::plane(DVec3::X, DVec3::new(1.0, 7.0, 3.0), 2.0)
            + Quadric::plane(DVec3::Y, DVec3::new(0.0, 2.0, 0.0), 0.5)
            + Quadric::plane(DVec3::new(0.6, 0.0, 0.8), DVec3::new(1.0, 2.0, 3.0), 1.0)
    }

    #[test]
    fn error_is_the_weighted_squared_distance() {
        let q = Quadric::plane(DVec3::Z, DVec3::new(5.0, 6.0, 2.0), 3.0);
        assert!((q.error(DVec3::new(-1.0, 9.0, 4.0)) - 12.0).abs() < 1e-12);
        assert_eq!(q.mean(q.error(DVec3::new(0.0, 0.0, 3.0))), 1.0);
    }

    #[test]
    fn three_planes_meet_at_the_minimum() {
        let start = DVec3::new(0.8, 2.1, 2.7);
        let step = corner().step_to_minimum(start, 1e-12);
        assert!((start + step - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9);
    }

    #[test]
    fn an_undetermined_direction_is_left_alone() {
        let crease = Quadric::plane(DVec3::X, DVec3::ZERO, 1.0) + Quadric::plane(DVec3::Y, DVec3::ZERO, 1.0);
        let step = crease.step_to_minimum(DVec3::new(0.1, 0.2, 0.7), 1e-9);
        assert!((step - DVec3::new(-0.1, -0.2, 0.0)).length() < 1e-7);
        assert_eq!(Quadric::default().step_to_minimum(DVec3::ONE, 1e-3), DVec3::ZERO);
    }

    #[test]
    fn a_centred_quadric_is_the_same_function_in_other_units() {
        let (q, c, s) = (corner(), DVec3::new(1.5, 1.0, 2.0), 10.0);
        let d = DVec3::new(0.25, -0.5, 0.125);
        let (there, here) = (q.centred(c, s).error(d * s), q.error(c + d) * s.powi(4));
        assert!((there - here).abs() < 1e-9 * here);
    }
}
