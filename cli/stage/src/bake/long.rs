//! Texels that are longer than wide: images that are stretched over a surface have more of their texels along one
//! direction than along the other, as wood has along a beam.

use glam::{DMat3, DVec3};
use lodpack::write::{LongTexels, texel_size};

/// Texels are at most this many times as long as wide.
const LONGEST: f64 = 16.0;
/// The same as a power of two.
const MOST_COARSER: u8 = 4;
/// Texels are square where images are stretched by less than this.
const SHORTEST: f64 = 1.99;
/// Along the direction in which an image has fewest texels, this share of the square of the usual number is added to
/// that of theirs: a wall in a picture from above has none, but what is above and below it is not where its texels are.
const LEAST: f64 = 0.125;
/// What one shape of texels shows may take this many times the texels that it would take apart, squared.
const MOST_MORE: f64 = 6.0;
/// What differs by less from a power of two is one.
const ROUNDED: f64 = 1.01;
/// The largest coordinate of a direction.
const DIRECTION_LENGTH: f64 = 127.0;

/// How fast the coordinates of what is shown grow, as the sum of squares in each direction, weighted by area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Growth {
    squares: DMat3,
    weight: f64,
}

impl Default for Growth {
    /// Nothing is known.
    fn default() -> Self {
        Self { squares: DMat3::ZERO, weight: 0.0 }
    }
}

impl Growth {
    /// That of the coordinates of an image.
    pub fn of_image(coordinates: [DVec3; 2]) -> Self {
        let this = Self::of(coordinates);
        Self { squares: this.squares + DMat3::IDENTITY * (LEAST * this.weight), ..this }
    }

    /// That of two coordinates.
    pub fn of(coordinates: [DVec3; 2]) -> Self {
        let square = |c: DVec3| DMat3::from_cols(c * c.x, c * c.y, c * c.z);
        let all: f64 = coordinates.iter().map(|c| c.length_squared()).sum();
        // So that slivers do not count more than what surrounds them.
        let share = (LONGEST * LONGEST / all).min(1.0);
        let squares = (square(coordinates[0]) + square(coordinates[1])) * share;
        if squares.is_finite() { Self { squares, weight: 1.0 } } else { Self::default() }
    }

    pub fn add(&mut self, other: &Self, weight: f64) {
        if other.weight > 0.0 && weight > 0.0 {
            self.squares += other.squares * (weight / other.weight);
            self.weight += weight;
        }
    }

    /// The mean of several.
    pub fn mean(all: impl IntoIterator<Item = Self>) -> Self {
        let mut sum = Self::default();
        all.into_iter().for_each(|one| sum.add(&one, 1.0));
        sum
    }

    /// Whether texels of one shape show both on a plane, without being many more.
    pub fn fits(&self, other: &Self, normal: DVec3) -> bool {
        let (Some([a, b, c]), Some([p, q, r])) = (self.within(normal), other.within(normal)) else { return true };
        let of_one = |[a, b, c]: [f64; 3]| {
            let [most, least] = roots([a, b, c]);
            most * least.max(most / (LONGEST * LONGEST))
        };
        let both = of_one([a + p, b + q, c + r].map(|sum| 0.5 * sum));
        both * both <= MOST_MORE * of_one([a, b, c]) * of_one([p, q, r])
    }

    /// Products of two directions in a plane.
    fn within(&self, normal: DVec3) -> Option<[f64; 3]> {
        if self.weight <= 0.0 || normal == DVec3::ZERO {
            return None;
        }
        let (u, v) = normal.any_orthonormal_pair();
        let product = |one: DVec3, other: DVec3| one.dot(self.squares * other) / self.weight;
        Some([product(u, u), product(u, v), product(v, v)])
    }

    /// The shape of texels, longer than wide, that show this on a plane: about as many as square ones, or fewer.
    pub fn long(&self, normal: DVec3) -> Option<LongTexels> {
        let products = self.within(normal)?;
        let ([a, b, c], (u, v)) = (products, normal.any_orthonormal_pair());
        let [most, least] = roots(products).map(f64::sqrt);
        let times = (most / least).min(LONGEST);
        if times.is_nan() || times < SHORTEST {
            return None;
        }
        let coarser = rounded(times);
        // No more than there are.
        let finer = rounded(most * most).min(coarser);
        // Where most of them are needed.
        let [x, y] = if a >= c { [most * most - c, b] } else { [b, most * most - a] };
        let across = (u * x + v * y).normalize_or_zero() * DIRECTION_LENGTH;
        Some(LongTexels { across: across.to_array().map(|x| x.round() as i8), finer, coarser })
    }
}

/// The greatest and the least that a direction has, of a symmetric matrix.
fn roots([a, b, c]: [f64; 3]) -> [f64; 2] {
    let (half, root) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
    [half + root, (half - root).max(0.0)]
}

/// The power of two that is nearest to a number of at least 1.
fn rounded(times: f64) -> u8 {
    (1..=MOST_COARSER).take_while(|&power| texel_size(2 * u32::from(power) - 1) <= times * ROUNDED).last().unwrap_or(0)
}

/// How fast two coordinates grow over a triangle, given their values at its corners. None if it has no area.
pub fn growth_over(corners: [DVec3; 3], values: [[f64; 2]; 3]) -> Option<[DVec3; 2]> {
    let [second, third] = weight_growth(corners);
    let growth = [0, 1].map(|k| second * (values[1][k] - values[0][k]) + third * (values[2][k] - values[0][k]));
    growth.iter().all(|growth| growth.is_finite()).then_some(growth)
}

/// How fast the weights of the second and the third corner of a triangle grow over it. Not finite if it has no area.
pub fn weight_growth(corners: [DVec3; 3]) -> [DVec3; 2] {
    let [second, third] = [1, 2].map(|k| corners[k] - corners[0]);
    let normal = second.cross(third);
    let square = normal.length_squared();
    [third.cross(normal) / square, normal.cross(second) / square]
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: DVec3 = DVec3::Z;

    fn of(most: DVec3, least: f64) -> Growth {
        Growth::of([most, most.cross(UP).normalize() * least])
    }

    fn long(growth: Growth) -> Option<[u8; 2]> {
        growth.long(UP).map(|long| [long.finer, long.coarser])
    }

    #[test]
    fn texels_are_as_long_as_images_are_stretched() {
        let stretched = |most, least| long(of(DVec3::X * most, least));
        assert_eq!(stretched(1.0, 1.0), None);
        assert_eq!(stretched(1.3, 0.7), None);
        // Twice as long as wide, or four times: as many as if they were square.
        assert_eq!(stretched(2.0_f64.sqrt(), 0.5_f64.sqrt()), Some([1, 1]));
        assert_eq!(stretched(2.0, 0.5), Some([2, 2]));
        // Fewer, where an image has fewer.
        assert_eq!(stretched(1.0, 0.25), Some([0, 2]));
        assert_eq!(stretched(1.0, 0.0), Some([0, 4]));
        assert_eq!(stretched(4.0, 1e-9), Some([4, 4]));
        // Nothing is shown, or nothing is known.
        assert_eq!(stretched(0.0, 0.0), None);
        assert_eq!(stretched(f64::NAN, 1.0), None);
        assert_eq!(long(Growth::default()), None);
        assert_eq!(of(DVec3::X * 2.0, 0.5).long(DVec3::ZERO), None);
    }

    #[test]
    fn images_with_hardly_any_texels_along_a_direction_have_texels_there() {
        let wall = |most: f64| long(Growth::of_image([DVec3::X * most, DVec3::ZERO]));
        assert_eq!([1.0, 2.0, 8.0].map(wall), [Some([0, 2]), Some([2, 3]), Some([4, 4])]);
    }

    #[test]
    fn they_are_finer_in_the_direction_in_which_images_are() {
        for step in 0..24 {
            let (sine, cosine) = (f64::from(step) * 0.26).sin_cos();
            let direction = DVec3::new(cosine, sine, 0.0);
            let across = of(direction * 3.0, 0.3).long(UP).expect("it is stretched").across;
            let found = DVec3::from(across.map(f64::from)).normalize();
            assert!(found.dot(direction).abs() > 0.9999, "{found} {direction}");
        }
    }

    #[test]
    fn means_count_by_area_and_slivers_no_more_than_that() {
        let mut sum = Growth::default();
        sum.add(&of(DVec3::X * 2.0, 0.5), 10.0);
        sum.add(&of(DVec3::Y * 1e9, 1.0), 0.001);
        sum.add(&Growth::default(), 100.0);
        let long = sum.long(UP).expect("it is stretched");
        assert_eq!([long.finer, long.coarser], [2, 2]);
        assert!(long.across[0].abs() > 126);
    }

    #[test]
    fn what_is_stretched_across_one_another_does_not_fit() {
        let [along, across] = [DVec3::X, DVec3::Y].map(|direction| of(direction * 2.0, 0.5));
        assert!(along.fits(&along, UP) && !along.fits(&across, UP));
        assert!(along.fits(&Growth::default(), UP));
        let even = of(DVec3::X, 1.0);
        assert!(even.fits(&of(DVec3::new(1.2, 0.5, 0.0), 0.7), UP));
        assert!(!of(DVec3::X * 4.0, 0.25).fits(&even, UP));
    }

    #[test]
    fn coordinates_grow_over_a_triangle_as_its_corners_say() {
        let corners = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 3.0), DVec3::new(1.0, 7.0, 3.0)];
        let [x, y] = growth_over(corners, [[0.0, 4.0], [8.0, 4.0], [0.0, 3.0]]).expect("it has an area");
        assert!(x.distance(DVec3::X * 4.0) < 1e-12 && y.distance(DVec3::Y * -0.2) < 1e-12, "{x} {y}");
        assert_eq!(growth_over([corners[0]; 3], [[0.0; 2], [1.0; 2], [2.0; 2]]), None);
    }
}
