//! Error bounds in 16 bits, rounded up (SPEC.md, "Error codes").

use crate::{
    error::{Error, Result},
    lattice::{Lattice, power_of_two},
};

/// An error bound as it is stored: 0 means 0; code c means (256 + c mod 256) * 2^(floor(c / 256) - 64) lattice steps,
/// so that rounding up adds at most 0.4 %. Larger codes are larger bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct ErrorCode(pub(crate) u16);

impl ErrorCode {
    /// The smallest code whose bound is at least `error` world units.
    ///
    /// # Errors
    /// [`Error::Model`] if it is negative, not finite, or too large for a code (2^199 lattice steps).
    pub(crate) fn at_least(error: f64, lattice: &Lattice) -> Result<Self> {
        let fits = |code: u16| Self(code).bound(lattice) >= error;
        if !(error >= 0.0 && fits(u16::MAX)) {
            return Err(Error::model(format!("error bound {error} is negative, not finite or too large")));
        }
        let (mut below, mut code) = (-1_i32, i32::from(u16::MAX));
        while code - below > 1 {
            let middle = below + (code - below) / 2;
            if fits(middle as u16) { code = middle } else { below = middle }
        }
        Ok(Self(code as u16))
    }

    /// The bound in world units; exact.
    pub(crate) fn bound(self, lattice: &Lattice) -> f64 {
        if self.0 == 0 {
            return 0.0;
        }
        let mantissa = f64::from(256 + (self.0 & 0xff));
        mantissa * power_of_two(i32::from(self.0 >> 8) - 64 + lattice.step_log2)
    }
}

/// The bound that a file stores for an error, rounded up, world units. With a `border_deviation` it is the bound where
/// a neighbour is finer.
///
/// # Errors
/// [`Error::Model`] if it is negative, not finite, or too large.
pub fn stored_error(error: f64, border_deviation: f64, lattice: &Lattice) -> Result<f64> {
    let bound = |error| Ok(ErrorCode::at_least(error, lattice)?.bound(lattice));
    bound(sum_of_bounds(bound(error)?, bound(border_deviation)?))
}

/// The largest bound that a file can store without exceeding `error`, world units. Errors up to this bound are still
/// within a tolerance of `error` once they are stored.
///
/// # Errors
/// As [`stored_error`].
pub fn storable_error(error: f64, lattice: &Lattice) -> Result<f64> {
    let ErrorCode(code) = ErrorCode::at_least(error, lattice)?;
    let is_exact = ErrorCode(code).bound(lattice) == error;
    Ok(ErrorCode(if is_exact { code } else { code.saturating_sub(1) }).bound(lattice))
}

/// A bound of the sum of two bounds: rounded up by an ulp or two, since adding may have rounded down.
pub(crate) fn sum_of_bounds(a: f64, b: f64) -> f64 {
    if b == 0.0 { a } else { (a + b) * (1.0 + f64::EPSILON) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_round_up_by_little() {
        let lattice = Lattice { origin: [0.0; 3], step_log2: -13 };
        for i in 0..2000 {
            let error = 1e-9 * 1.013_f64.powi(i);
            let bound = ErrorCode::at_least(error, &lattice).unwrap().bound(&lattice);
            assert!(error <= bound && bound <= error * 1.004);
            assert_eq!(stored_error(error, 0.0, &lattice).unwrap(), bound);
            let below = storable_error(error, &lattice).unwrap();
            assert!(below <= error && error * 0.996 <= below);
            assert_eq!(
                [storable_error(bound, &lattice).unwrap(), stored_error(below, 0.0, &lattice).unwrap()],
                [bound, below]
            );
            assert!(stored_error(error, error, &lattice).unwrap() >= 2.0 * bound);
        }
        assert_eq!(ErrorCode::at_least(0.0, &lattice).unwrap(), ErrorCode(0));
        assert!(ErrorCode::at_least(f64::NAN, &lattice).is_err());
        assert!(ErrorCode::at_least(f64::INFINITY, &lattice).is_err());
        assert!(ErrorCode::at_least(-1.0, &lattice).is_err());
        assert!((0..u16::MAX).all(|c| ErrorCode(c).bound(&lattice) < ErrorCode(c + 1).bound(&lattice)));
    }
}
