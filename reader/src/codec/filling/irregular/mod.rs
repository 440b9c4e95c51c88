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

mod block;
mod connectivity;
mod contexts;
mod decode;
mod encode;
mod geometry;
mod target;
#[cfg(test)]
mod tests;

use block::BlockDecoder;
pub use connectivity::PatchLimits;
pub(crate) use decode::decode_patch;
pub use encode::{EncodeError, PatchTarget, encode_patch, encode_refined_patch};

use super::{Descriptor, Filling};

/// The filling's row in the table.
pub(super) const DESCRIPTOR: Descriptor = Descriptor {
    filling: Filling::Irregular,
    code: 0,
    name: "irregular",
    is_nested: false,
    uses: contexts::USES,
    decoder: || Box::<BlockDecoder>::default(),
};

/// How many refinements of the tangential step there are; the first symbol of a patch is the number of components without a
/// border times this, plus the refinement.
const REFINEMENTS: u64 = 4;
