//! The irregular filling: triangles and interior vertices of one root at one level, given the samples of its border
//! (SPEC.md, "Irregular blocks").
//!
//! A cut-border machine ([`connectivity`]) grows the patch from its border loops inward, triangle by triangle. Each new
//! vertex is coded as a residual from a forecast ([`geometry`]), coarsely along the surface and finely across it. Every
//! orientable topology is possible: disks, holes, handles, several components, components without a border.
//!
//! The first symbol is four times the number of components without a border, plus the refinement of the tangential
//! step. Then, while unknown loops are left, each triangle has one operation with its operands: three residuals for a
//! new vertex, an offset for a Split, an index and an offset for a Union. When no loop is left, the nine coordinates of
//! the first triangle of the next component without a border follow, and so on.

mod area;
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
    description: "vertices and triangles of their own at each level",
    is_nested: false,
    uses: contexts::USES,
    decoder: || Box::<BlockDecoder>::default(),
};

/// The number of refinements of the tangential step. The first symbol of a block is the number of components without a
/// border times this, plus the refinement.
const REFINEMENTS: u64 = 4;
