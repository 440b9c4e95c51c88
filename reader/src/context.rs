//! The entropy contexts of SPEC.md: which symbol is coded with which statistics. One list for all codecs.

/// A context number, below [`COUNT`].
pub type Context = u16;

/// First context of the irregular filling's codec.
pub(crate) const IRREGULAR: Context = 0;
/// First context of the arcs' codec.
pub(crate) const ARC: Context = 64;
/// First context of the grid filling's codec.
pub(crate) const GRID: Context = 128;
/// How many contexts there are.
pub const COUNT: Context = 256;

/// Contexts of the grid filling.
pub(crate) mod grid {
    use super::{Context, GRID};

    /// Classes of a residual's expected size: its bit length, the largest open ended.
    pub(crate) const SIZE_CLASSES: usize = 8;
    /// Shape of a level, one context for each shape of the coarser level.
    pub(crate) const SHAPE: Context = GRID;
    /// Residual of the centre: normal, first and second tangent.
    pub(crate) const CENTRE: Context = GRID + 3;
    const SPLIT: Context = GRID + 6;
    const NORMAL: Context = SPLIT + 32;
    const TANGENT: Context = NORMAL + 2 * SIZE_CLASSES as Context;

    /// Split flag of a cell: whether the cell is new at this level, the size class of the split that made it, how many
    /// of its edges have a split cell beyond.
    pub(crate) fn split(is_new: bool, size_class: usize, finer_neighbour_count: usize) -> Context {
        let size = match size_class {
            0 | 1 => 0,
            2 => 1,
            3 => 2,
            _ => 3,
        };
        SPLIT + (is_new as Context * 4 + size) * 4 + finer_neighbour_count.min(3) as Context
    }

    /// Normal component of a residual; kind 0 is an edge's middle, 1 a cell's.
    pub(crate) fn normal(kind: usize, size_class: usize) -> Context {
        NORMAL + (kind * SIZE_CLASSES + size_class) as Context
    }

    /// Tangential components of a residual: first and second, each after a zero and after a non-zero normal component.
    pub(crate) fn tangents(kind: usize, size_class: usize) -> [[Context; 2]; 2] {
        let base = TANGENT + ((kind * SIZE_CLASSES + size_class) * 4) as Context;
        [[base, base + 1], [base + 2, base + 3]]
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn contexts_stay_below_the_count() {
            assert!(tangents(1, SIZE_CLASSES - 1)[1][1] < crate::context::COUNT);
            assert!(split(true, 7, 4) < NORMAL);
        }
    }
}
