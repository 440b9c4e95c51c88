//! The contexts of corners and arcs (SPEC.md, "Corners and arcs").

use crate::codec::entropy::context::{ARC, Context, Use};

/// Classes of a residual's expected size: the bit length of the residual one interval above. Intervals below a corner
/// have the last class.
pub(super) const SIZE_CLASSES: usize = 8;
/// Coordinates of a corner, one context an axis.
pub(super) const CORNER: Context = ARC.first;
const SPLIT: Context = CORNER + 3;
const RESIDUAL: Context = SPLIT + 24;
const END: Context = RESIDUAL + 3 * SIZE_CLASSES as Context;
const _: () = assert!(END == ARC.end);

/// What these contexts are for.
pub(crate) const USES: &[Use] = &[Use { name: "corners", first: CORNER }, Use { name: "arc samples", first: SPLIT }];

/// Split flag of an interval: whether it is new at this level, how many of its two neighbours are shorter, and its
/// depth.
pub(super) fn split(is_new: bool, shorter_neighbour_count: usize, depth: u32) -> Context {
    SPLIT + (is_new as Context * 3 + shorter_neighbour_count.min(2) as Context) * 4 + depth.min(3) as Context
}

/// Component of a residual: 0 and 1 lie across the arc, 2 along it.
pub(super) fn residual(component: usize, size_class: usize) -> Context {
    RESIDUAL + (component * SIZE_CLASSES + size_class.min(SIZE_CLASSES - 1)) as Context
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contexts_stay_in_their_range() {
        assert_eq!(split(true, 9, 16) + 1, RESIDUAL);
        assert_eq!(residual(2, 99) + 1, END);
    }
}
