//! The integer lattice on which every coordinate of a file lies, and its place in the world.

use crate::error::{Error, Result};

/// Lattice coordinates: world = origin + coordinate * step, per axis. Absolute values stay at or below 2^40.
pub type LatticePoint = [i64; 3];

/// Where the integer coordinates of a file lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Lattice {
    /// World position of lattice point (0, 0, 0).
    pub origin: [f64; 3],
    /// The lattice step is 2^step_log2 world units; -256 to 256.
    pub step_log2: i32,
}

impl Lattice {
    /// The lattice step in world units.
    pub fn step(&self) -> f64 {
        power_of_two(self.step_log2)
    }

    /// World position of a lattice point: origin + coordinate * step.
    pub fn world(&self, point: LatticePoint) -> [f64; 3] {
        let step = self.step();
        [0, 1, 2].map(|axis| self.origin[axis] + point[axis] as f64 * step)
    }

    /// A world position in lattice units.
    pub fn units(&self, world: [f64; 3]) -> [f64; 3] {
        let step = self.step();
        [0, 1, 2].map(|axis| (world[axis] - self.origin[axis]) / step)
    }

    /// Checks that origin and step are in range.
    pub(crate) fn check(&self) -> Result<()> {
        if self.origin.iter().all(|x| x.is_finite()) && self.step_log2.unsigned_abs() <= 256 {
            Ok(())
        } else {
            Err(Error::format("the lattice is not finite or its step not within 2^-256 to 2^256"))
        }
    }
}

/// 2^exponent, exactly, for |exponent| below 1000.
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}
