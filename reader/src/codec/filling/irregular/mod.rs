//! The irregular filling's codec: connectivity and interior vertices of one root at one level, given its border's samples
//! (SPEC.md, "Irregular blocks").
//!
//! A cut-border machine ([`connectivity`]) grows the patch from its border loops inward, triangle by triangle. Each new
//! vertex is a residual to a forecast ([`geometry`]), coarse along the surface and fine across it. Any orientable topology
//! will do: disks, holes, handles, several components, components without a border.
//!
//! Symbols, in order: four times the number of components without a border plus the refinement of the tangential step; then, while unknown loops are left, one operation a
//! triangle with what belongs to it (three residuals for a new vertex, an offset for Split, an index and an offset for
//! Union); when none is left, the nine coordinates of the next borderless component's first triangle, and so on.

mod connectivity;
mod decode;
mod encode;
mod geometry;
mod target;
#[cfg(test)]
mod tests;

pub use connectivity::PatchLimits;
pub(crate) use decode::{PatchDecoder, decode_patch};
pub use encode::{EncodeError, PatchTarget, Slide, encode_patch, encode_refined_patch};

/// How many refinements of the tangential step there are; the first symbol of a patch is the number of components without a
/// border times this, plus the refinement.
const REFINEMENTS: u64 = 4;

/// How coarsely vertices are stored: those of one irregular level, or those of all levels of the grids, which never move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quantisation {
    /// The step along the surface normal is 2^normal_shift lattice steps; at most 40.
    pub normal_shift: u8,
    /// The step along the surface is 2^tangent_shift normal steps; at most 40. 2 to 4 is good.
    pub tangent_shift: u8,
}

impl Quantisation {
    /// The tangential step 2^refinement times smaller, down to the normal step.
    fn refined(self, refinement: u8) -> Self {
        Self { tangent_shift: self.tangent_shift.saturating_sub(refinement), ..self }
    }

    /// Normal and tangential step in lattice steps, powers of two.
    pub(crate) fn steps(self) -> (f64, f64) {
        let normal = (1u64 << self.normal_shift.min(40)) as f64;
        (normal, normal * (1u64 << self.tangent_shift.min(40)) as f64)
    }
}
