//! Which of a few triangles is closest to each of many points that lie near one another: in single precision, sixteen
//! points at a time, in loops that compilers turn into vectors.

use glam::DVec3;

use super::around::AROUND;
use super::{Around, PreparedTriangle, TriangleBvh};

/// How many points are looked at together.
pub const TOGETHER: usize = 16;

/// For each of some points a number.
pub type Numbers = [f32; TOGETHER];

/// A few triangles, relative to a point near which they are looked at.
#[derive(Clone, Debug)]
pub struct Few {
    triangles: [Single; AROUND],
    count: usize,
}

/// A triangle in single precision, in a basis whose first axis is its longest side.
#[derive(Clone, Copy, Debug, Default)]
pub struct Single {
    pub(in super::super) start: [f32; 3],
    pub(in super::super) axes: [[f32; 3]; 3],
    pub(in super::super) base: f32,
    pub(in super::super) apex: f32,
    /// Of the sides left and right of the apex the unit direction towards it, and the length.
    pub(in super::super) sides: [[f32; 3]; 2],
}

/// What is closest to some points.
#[derive(Clone, Debug)]
pub struct Feet {
    /// The number of the triangle.
    pub which: [u32; TOGETHER],
    /// How far the closest point is from where the triangle's longest side starts: along that side, and across it in
    /// the triangle's plane.
    pub at: [Numbers; 2],
    /// The square of its distance.
    pub squares: Numbers,
}

impl Feet {
    /// Of nothing yet.
    pub fn nowhere() -> Self {
        Self { which: [0; TOGETHER], at: [[0.0; TOGETHER]; 2], squares: [f32::INFINITY; TOGETHER] }
    }

    /// Looks at one more triangle, which has a number.
    #[inline(always)]
    pub fn add(&mut self, number: u32, triangle: &Single, points: &[Numbers; 3]) {
        // Two loops: of one alone compilers make no vectors.
        let (mut squares, mut x, mut y) = ([0.0; TOGETHER], [0.0; TOGETHER], [0.0; TOGETHER]);
        for k in 0..TOGETHER {
            (squares[k], [x[k], y[k]]) = triangle.closest([points[0][k], points[1][k], points[2][k]]);
        }
        for k in 0..TOGETHER {
            let is_closer = squares[k] < self.squares[k];
            self.squares[k] = if is_closer { squares[k] } else { self.squares[k] };
            self.which[k] = if is_closer { number } else { self.which[k] };
            self.at[0][k] = if is_closer { x[k] } else { self.at[0][k] };
            self.at[1][k] = if is_closer { y[k] } else { self.at[1][k] };
        }
    }
}

impl Few {
    /// The closest of these to each of some points, whose coordinates are relative to what these are relative to.
    #[inline]
    pub fn closest(&self, points: &[Numbers; 3]) -> Feet {
        let mut feet = Feet::nowhere();
        for (number, triangle) in (0..).zip(&self.triangles[..self.count]) {
            feet.add(number, triangle, points);
        }
        feet
    }
}

impl Single {
    /// Of any three points.
    pub fn new(corners: [DVec3; 3]) -> Self {
        PreparedTriangle::new(corners).single(DVec3::ZERO)
    }

    /// How far it reaches from where its longest side starts: along that side, and across it.
    pub fn extent(&self) -> [f32; 2] {
        [self.base, self.sides[0][1] * self.sides[0][2]]
    }

    /// The squared distance of a point, and where the closest one is.
    #[inline(always)]
    fn closest(&self, point: [f32; 3]) -> (f32, [f32; 2]) {
        let d = [0, 1, 2].map(|k| point[k] - self.start[k]);
        let [x, y, z] = self.axes.map(|axis| d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2]);
        let is_left = x < self.apex;
        let from_end = if is_left { x } else { self.base - x };
        let [left, right] = self.sides;
        let [along, across, length] = [0, 1, 2].map(|k| if is_left { left[k] } else { right[k] });
        let on_side = least(most(from_end * along + y * across, 0.0), length);
        let is_inside = from_end * across - y * along > 0.0;
        let above = if is_inside { [from_end, y] } else { [on_side * along, on_side * across] };
        let below = [most(from_end, 0.0), 0.0];
        let at = [0, 1].map(|k| if y <= 0.0 { below[k] } else { above[k] });
        let (beyond, out) = (from_end - at[0], y - at[1]);
        (beyond * beyond + out * out + z * z, [if is_left { at[0] } else { self.base - at[0] }, at[1]])
    }
}

/// The larger number; comparisons that hardware has, without thought of NaN.
#[inline(always)]
fn most(one: f32, other: f32) -> f32 {
    if one > other { one } else { other }
}

#[inline(always)]
fn least(one: f32, other: f32) -> f32 {
    if one < other { one } else { other }
}

impl TriangleBvh {
    /// Some triangles, relative to a point.
    pub fn few(&self, around: &Around, about: DVec3) -> Few {
        let mut few = Few { triangles: [Single::default(); AROUND], count: around.count() };
        for (single, &slot) in few.triangles.iter_mut().zip(around.slots()) {
            *single = self.prepared[slot as usize].single(about - self.origin);
        }
        few
    }

    /// Of some triangles where the longest side starts, and unit vectors along it and across it, as the feet of
    /// [`Few::closest`] count them.
    pub fn frames(&self, around: &Around) -> impl Iterator<Item = [DVec3; 3]> {
        around.slots().iter().map(|&slot| {
            let [start, along, across] = self.prepared[slot as usize].frame();
            [start + self.origin, along, across]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Hint;
    use super::super::tests::soup;
    use super::*;
    use crate::certify::tests::Random;

    #[test]
    fn points_together_have_the_closest_points_of_each_alone() {
        let (positions, triangles) = soup(300, &mut Random(9), 0.2);
        let surface = TriangleBvh::new(&positions, &triangles);
        let (mut random, mut several) = (Random(5), 0);
        for _ in 0..300 {
            let (middle, radius) = (random.point(), 0.1 * random.point().x.abs());
            let Some(around) = surface.around(middle, radius, &mut Hint::default()) else { continue };
            several += u32::from(around.count() > 1);
            let few = surface.few(&around, middle);
            let frames: Vec<[DVec3; 3]> = surface.frames(&around).collect();
            let points = [(); TOGETHER].map(|()| middle + random.point().clamp_length_max(1.0) * radius);
            let feet = few.closest(&[0, 1, 2].map(|axis| points.map(|point| (point - middle)[axis] as f32)));
            for (k, point) in points.into_iter().enumerate() {
                let [start, along, across] = frames[feet.which[k] as usize];
                let found = start + along * f64::from(feet.at[0][k]) + across * f64::from(feet.at[1][k]);
                let alone = surface.closest_of(&around, point);
                assert!((found.distance(point) - alone.distance).abs() < 1e-5, "{found} {alone:?}");
            }
        }
        assert!(several > 50, "{several}");
    }
}
