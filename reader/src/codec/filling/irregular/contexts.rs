//! The contexts of irregular fillings (SPEC.md, "Irregular blocks").

use crate::codec::entropy::context::{Context, IRREGULAR, Use};

/// Head of a block: its number of components without a border, and the refinement of its tangential step.
pub(super) const HEAD: Context = IRREGULAR.first;
/// Coordinates of the first triangle of a component without a border.
pub(super) const SEED: Context = HEAD + 1;
/// Offset of a Split.
pub(super) const SPLIT: Context = HEAD + 2;
/// Index of a Union.
pub(super) const UNION_LOOP: Context = HEAD + 3;
/// Offset of a Union.
pub(super) const UNION: Context = HEAD + 4;
/// Operations: 8 classes of the angle at the gate's end, times 4 of the angle at its start.
pub(super) const OPERATION: Context = HEAD + 5;
/// Residuals along, across and normal to the surface, each with [`SIZES`] classes of expected size.
pub(super) const RESIDUAL: Context = OPERATION + 32;
/// The number of classes of a residual's expected size.
pub(super) const SIZES: Context = 9;
const _: () = assert!(RESIDUAL + 3 * SIZES == IRREGULAR.end);

/// What these contexts are for.
pub(super) const USES: &[Use] = &[
    Use { name: "heads of irregular fillings", first: HEAD },
    Use { name: "closed pieces in irregular fillings", first: SEED },
    Use { name: "splits in irregular fillings", first: SPLIT },
    Use { name: "holes and handles in irregular fillings", first: UNION_LOOP },
    Use { name: "triangles in irregular fillings", first: OPERATION },
    Use { name: "vertices in irregular fillings", first: RESIDUAL },
];
