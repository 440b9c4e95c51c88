//! Where a sample is in space: on a plane, on a sphere or on an ellipsoid (SPEC.md, "Surface of heights").
//!
//! Sines and cosines are computed by fixed polynomials, so every machine gets the same bits.

use crate::error::{Error, Result};

/// What heights stand on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Base {
    /// A plane: x to the east, y to the north, z up.
    Plane,
    /// An ellipsoid around the origin, in degrees; a sphere where it is not flattened. x goes through longitude 0, z
    /// through the north pole.
    Ellipsoid {
        /// Half axis at the equator.
        axis: f64,
        /// The square of the eccentricity: 0 for a sphere.
        eccentricity: f64,
    },
}

/// Where the samples of a grid are.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Surface {
    /// What heights stand on.
    pub base: Base,
    /// Coordinates of the first column and the first row: x and y of a plane, degrees of longitude and latitude on a
    /// globe.
    pub first: [f64; 2],
    /// What each column and each row adds. Rows go to the south, so theirs is negative.
    pub spacing: [f64; 2],
    /// Coordinates in a unit of heights.
    pub height_scale: f64,
}

/// The directions at a place, and how far apart samples are there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Compass {
    /// Of length 1, as the others; on an ellipsoid the normal of the ellipsoid.
    pub up: [f64; 3],
    pub east: [f64; 3],
    pub north: [f64; 3],
    /// The length of a column to the east and of a row to the north, which is negative, in units of space.
    pub lengths: [f64; 2],
}

/// A column or a row of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The coordinate on a plane, else the sine of the angle.
    sine: f64,
    /// The cosine of the angle; on a plane without meaning.
    cosine: f64,
    /// Of a row on a globe, the radius of curvature across the meridian.
    across: f64,
}

impl Line {
    /// The cosine of its angle; without meaning on a plane.
    pub(super) fn cosine(self) -> f64 {
        self.cosine
    }
}

impl Surface {
    /// Checks what a file says.
    ///
    /// # Errors
    /// [`Error::Format`] if a number is not finite or has a wrong sign.
    pub fn check(&self) -> Result<()> {
        let [dx, dy] = self.spacing;
        let is_placed = self.first.iter().all(|x| x.abs() < 1e15) && dx > 0.0 && dx < 1e15 && dy < 0.0 && dy > -1e15;
        let has_height = self.height_scale > 0.0 && self.height_scale < 1e15;
        let has_base = match self.base {
            Base::Plane => true,
            Base::Ellipsoid { axis, eccentricity } => axis > 0.0 && axis < 1e15 && (0.0..0.5).contains(&eccentricity),
        };
        match is_placed && has_height && has_base {
            true => Ok(()),
            false => Err(Error::format("the place of a grid of heights is not finite, or has a wrong sign")),
        }
    }

    /// A column or a row.
    pub fn line(&self, axis: usize, line: u64) -> Line {
        let at = self.first[axis] + line as f64 * self.spacing[axis];
        let (sine, cosine) = match (self.base, axis) {
            (Base::Plane, _) => (at, 0.0),
            (Base::Ellipsoid { .. }, 0) => sin_cos_degrees(at),
            // Rows behind a pole are the pole.
            (Base::Ellipsoid { .. }, _) => sin_cos_degrees(at.clamp(-90.0, 90.0)),
        };
        let across = match (self.base, axis) {
            (Base::Ellipsoid { axis, eccentricity }, 1) => axis / (1.0 - eccentricity * sine * sine).sqrt(),
            _ => 0.0,
        };
        Line { sine, cosine, across }
    }

    /// The number of a row; where a row lies behind a pole, that of the pole, which lies between two rows.
    pub fn row_in_space(&self, row: u64) -> f64 {
        let degrees = self.first[1] + row as f64 * self.spacing[1];
        match self.is_globe() && degrees.abs() > 90.0 {
            true => (90f64.copysign(degrees) - self.first[1]) / self.spacing[1],
            false => row as f64,
        }
    }

    /// Where a sample is.
    #[inline]
    pub fn position(&self, column: Line, row: Line, height: f64) -> [f64; 3] {
        let height = height * self.height_scale;
        match self.base {
            Base::Plane => [column.sine, row.sine, height],
            Base::Ellipsoid { eccentricity, .. } => {
                let out = (row.across + height) * row.cosine;
                let up = (row.across * (1.0 - eccentricity) + height) * row.sine;
                [out * column.cosine, out * column.sine, up]
            }
        }
    }

    /// The directions at a sample, in units of heights as [`Surface::position`] takes it.
    pub(crate) fn compass(&self, column: Line, row: Line, height: f64) -> Compass {
        let Base::Ellipsoid { axis, eccentricity } = self.base else {
            let (up, east, north) = ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
            return Compass { up, east, north, lengths: self.spacing };
        };
        let height = height * self.height_scale;
        // The radius of curvature along the meridian.
        let along = row.across * (row.across / axis) * (row.across / axis) * (1.0 - eccentricity);
        let radians = std::f64::consts::PI / 180.0;
        Compass {
            up: [row.cosine * column.cosine, row.cosine * column.sine, row.sine],
            east: [-column.sine, column.cosine, 0.0],
            north: [-row.sine * column.cosine, -row.sine * column.sine, row.cosine],
            lengths: [
                (row.across + height) * row.cosine * self.spacing[0] * radians,
                (along + height) * self.spacing[1] * radians,
            ],
        }
    }

    /// How far the base lies above the middle of a chord of it, from the square of the chord's length: a bound for
    /// short chords.
    #[inline]
    pub fn bend(&self, chord: f64) -> f64 {
        match self.base {
            Base::Plane => 0.0,
            Base::Ellipsoid { axis, eccentricity } => chord / (8.0 * axis * (1.0 - eccentricity)),
        }
    }

    /// Whether it is no plane.
    pub fn is_globe(&self) -> bool {
        self.base != Base::Plane
    }
}

/// Sine and cosine of an angle in degrees; exact at multiples of 90.
#[expect(clippy::excessive_precision, reason = "the digits of the polynomials are those of their source")]
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    let turned = degrees - 360.0 * (degrees / 360.0).floor();
    let quarter = (turned / 90.0 + 0.5).floor();
    let x = (turned - 90.0 * quarter) * (std::f64::consts::PI / 180.0);
    let z = x * x;
    let w = z * z;
    // Polynomials of fdlibm (Sun Microsystems, 1993) on -pi/4 to pi/4.
    let odd = 8.33333333332248946124e-03
        + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
        + z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10);
    let sin = x + z * x * (-1.66666666666666324348e-01 + z * odd);
    let even = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05))
        + w * w * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    let half = 0.5 * z;
    let rest = 1.0 - half;
    let cos = rest + (((1.0 - rest) - half) + z * even);
    match quarter as i64 & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WGS84: Base = Base::Ellipsoid { axis: 6_378_137.0, eccentricity: 6.694_379_990_141_316e-3 };

    #[test]
    fn sines_agree_with_those_of_the_machine() {
        for k in -7200..7200 {
            let degrees = f64::from(k) * 0.1;
            let (sin, cos) = sin_cos_degrees(degrees);
            let radians = degrees.to_radians();
            assert!((sin - radians.sin()).abs() < 4e-15 && (cos - radians.cos()).abs() < 4e-15, "{degrees}");
        }
        assert_eq!([0.0, 90.0, 180.0, 270.0].map(sin_cos_degrees), [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]);
        assert_eq!([-90.0, 360.0].map(sin_cos_degrees), [(-1.0, 0.0), (0.0, 1.0)]);
    }

    #[test]
    fn places_on_the_ellipsoid_are_right() {
        // EPSG:4979 to EPSG:4978 of 46.5, 7.25, 1234.5.
        let surface = Surface { base: WGS84, first: [7.25, 46.5], spacing: [1.0, -1.0], height_scale: 1.0 };
        let at = surface.position(surface.line(0, 0), surface.line(1, 0), 1234.5);
        let expected = [4_363_851.981_909, 555_152.090_477, 4_604_575.873_307];
        assert!(at.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{at:?}");
        let pole = Surface { first: [0.0, 90.5], spacing: [1.0, -1.0], ..surface };
        let [a, b] = [0, 100].map(|column| pole.position(pole.line(0, column), pole.line(1, 0), 10.0));
        assert_eq!(a, b);
        assert!((a[2] - 6_356_762.314_245_2).abs() < 1e-3 && a[0] == 0.0);
    }

    #[test]
    fn numbers_that_are_no_places_are_refused() {
        let good = Surface { base: WGS84, first: [0.0; 2], spacing: [1.0, -1.0], height_scale: 1.0 };
        assert!(good.check().is_ok());
        let bad = [
            Surface { first: [f64::NAN, 0.0], ..good },
            Surface { spacing: [1.0, 1.0], ..good },
            Surface { height_scale: 0.0, ..good },
            Surface { base: Base::Ellipsoid { axis: 1.0, eccentricity: 0.5 }, ..good },
        ];
        assert!(bad.iter().all(|surface| surface.check().is_err()));
    }
}
