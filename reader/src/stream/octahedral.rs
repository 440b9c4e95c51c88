//! Directions in two numbers: the sphere as an octahedron that is unfolded to a square (Meyer, Süssmuth, Sussner,
//! Stamminger and Greiner, "On Floating-Point Normal Vectors", 2010).

use crate::codec::vector::{Vec3, dot, scale};

/// A direction: see [`direction`].
pub(crate) type Octahedral = [i16; 2];

/// No direction.
pub(crate) const NONE: Octahedral = [i16::MIN; 2];

const MOST: f64 = i16::MAX as f64;

/// A direction of any length but zero, as near as two numbers are.
pub(crate) fn octahedral(vector: Vec3) -> Octahedral {
    let sum = vector[0].abs() + vector[1].abs() + vector[2].abs();
    let [x, y, z] = scale(vector, 1.0 / sum);
    let [x, y] = if z < 0.0 { folded(x, y) } else { [x, y] };
    // The conversion saturates, and what is no number becomes 0.
    [x, y].map(|x| (x * MOST).round() as i16)
}

/// The direction, of length 1, of two numbers from -32767 to 32767: the point of the octahedron |x| + |y| + |z| = 1
/// above (x, y) where |x| + |y| is at most 1, and below its reflection (1 - |y|, 1 - |x|), with the signs of x and y,
/// elsewhere. It is within 0.004 degrees of what was stored.
pub fn direction([x, y]: [i16; 2]) -> [f64; 3] {
    let [x, y] = [x, y].map(|x| f64::from(x) / MOST);
    let z = 1.0 - x.abs() - y.abs();
    let [x, y] = if z < 0.0 { folded(x, y) } else { [x, y] };
    let vector = [x, y, z];
    scale(vector, 1.0 / dot(vector, vector).sqrt())
}

/// A place in the square for its other half.
fn folded(x: f64, y: f64) -> [f64; 2] {
    [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::vector::sub;

    #[test]
    fn directions_survive_two_numbers() {
        let ends = [-1.0, -0.3, -0.0, 0.0, 1e-9, 0.7, 1.0];
        let all = ends.into_iter().flat_map(|x| ends.into_iter().flat_map(move |y| ends.map(|z| [x, y, z])));
        for vector in all.filter(|vector| dot(*vector, *vector) > 1e-6) {
            let unit = scale(vector, 1.0 / dot(vector, vector).sqrt());
            let stored = octahedral(vector);
            let off = sub(direction(stored), unit);
            assert!(dot(off, off).sqrt() < 7e-5, "{vector:?}");
            assert_ne!(stored, NONE);
            // What has been stored stays.
            assert_eq!(direction(octahedral(direction(stored))), direction(stored));
        }
        assert_eq!(direction([0, 0]), [0.0, 0.0, 1.0]);
        assert_eq!(octahedral([f64::NAN; 3]), [0, 0]);
    }
}
