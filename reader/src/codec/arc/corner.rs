//! Corners: each is coded as the difference from the corner before it.

use super::contexts;
use crate::{
    codec::{
        entropy::{SymbolBuffer, SymbolSource, context::Context},
        patch::LatticePoint,
    },
    error::{Error, Result},
};

/// Writes a corner.
pub(crate) fn encode_corner(position: LatticePoint, before: LatticePoint, symbols: &mut SymbolBuffer) {
    for axis in 0..3 {
        symbols.put_signed(contexts::CORNER + axis as Context, position[axis] - before[axis]);
    }
}

/// Reads a corner.
///
/// # Errors
/// [`Error::Format`] if it leaves the lattice.
pub(crate) fn decode_corner(before: LatticePoint, symbols: &mut impl SymbolSource) -> Result<LatticePoint> {
    let mut position = before;
    for axis in 0..3 {
        let step = symbols.get_signed(contexts::CORNER + axis as Context)?;
        position[axis] = before[axis]
            .checked_add(step)
            .filter(|x| x.unsigned_abs() <= 1 << 40)
            .ok_or_else(|| Error::format("a corner leaves the lattice"))?;
    }
    Ok(position)
}
