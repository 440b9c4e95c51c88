//! The contexts of grids (SPEC.md, "Grid blocks").

use crate::codec::entropy::context::{Context, GRID, Use};

/// Classes of a residual's expected size: its bit length; the last class is open ended.
pub(super) const SIZE_CLASSES: usize = 8;
/// Shape of a level, one context for each shape of the coarser level.
pub(super) const SHAPE: Context = GRID.first;
/// Residual of the centre: normal, first and second tangent.
pub(super) const CENTRE: Context = SHAPE + 3;
const SPLIT: Context = CENTRE + 3;
const NORMAL: Context = SPLIT + 32;
const TANGENT: Context = NORMAL + 2 * SIZE_CLASSES as Context;
const _: () = assert!(TANGENT + 8 * SIZE_CLASSES as Context == GRID.end);

/// What these contexts are for.
pub(super) const USES: &[Use] = &[Use { name: "grids", first: SHAPE }];

/// Split flag of a cell: whether the cell is new at this level, the size class of the split that made it, and how many
/// of its edges have a split cell beyond.
pub(super) fn split(is_new: bool, size_class: usize, finer_neighbour_count: usize) -> Context {
    let size = match size_class {
        0 | 1 => 0,
        2 => 1,
        3 => 2,
        _ => 3,
    };
    SPLIT + (is_new as Context * 4 + size) * 4 + finer_neighbour_count.min(3) as Context
}

/// Normal component of a residual; kind 0 is the middle of an edge, 1 that of a cell.
pub(super) fn normal(kind: usize, size_class: usize) -> Context {
    NORMAL + (kind * SIZE_CLASSES + size_class) as Context
}

/// Tangential components of a residual: first and second, each after a zero and after a non-zero normal component.
pub(super) fn tangents(kind: usize, size_class: usize) -> [[Context; 2]; 2] {
    let base = TANGENT + ((kind * SIZE_CLASSES + size_class) * 4) as Context;
    [[base, base + 1], [base + 2, base + 3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contexts_stay_in_their_range() {
        assert_eq!(split(true, 7, 4) + 1, NORMAL);
        assert_eq!(normal(1, SIZE_CLASSES - 1) + 1, TANGENT);
        assert_eq!(tangents(1, SIZE_CLASSES - 1)[1][1] + 1, GRID.end);
    }
}
