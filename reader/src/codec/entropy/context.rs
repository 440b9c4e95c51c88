//! The entropy contexts of SPEC.md: which symbol is coded with which statistics. One list for all codecs.

/// A context number, below [`COUNT`].
pub type Context = u16;

/// First context of the irregular filling's codec.
pub(crate) const IRREGULAR: Context = 0;
/// Irregular: number of components without a border.
pub(crate) const IRREGULAR_COMPONENTS: Context = IRREGULAR;
/// Irregular: coordinates of such a component's first triangle.
pub(crate) const IRREGULAR_SEED: Context = IRREGULAR + 1;
/// Irregular: offset of a Split.
pub(crate) const IRREGULAR_SPLIT: Context = IRREGULAR + 2;
/// Irregular: index of a Union.
pub(crate) const IRREGULAR_LOOP: Context = IRREGULAR + 3;
/// Irregular: offset of a Union.
pub(crate) const IRREGULAR_UNION: Context = IRREGULAR + 4;
/// Irregular, 32 contexts: operations; 8 classes of the angle at the gate's end, in each 4 of the one at its start.
pub(crate) const IRREGULAR_OPERATION: Context = IRREGULAR + 5;
/// Irregular, 27 contexts: residuals; along, across and normal, in each [`IRREGULAR_SIZES`] classes of expected size.
pub(crate) const IRREGULAR_RESIDUAL: Context = IRREGULAR + 37;
/// How many classes of residual size there are.
pub(crate) const IRREGULAR_SIZES: Context = 9;
/// First context of the arcs' codec.
pub(crate) const ARC: Context = 64;
/// First context of the grid filling's codec.
pub(crate) const GRID: Context = 128;
/// The first one after the grid filling's.
const GRID_END: Context = 246;
/// How many contexts there are.
pub const COUNT: Context = 256;
/// What contexts are for, and the first of each: each run ends where the next one begins. The last ones are for nothing.
pub(crate) const USES: [(&str, Context); 12] = [
    ("heads of irregular fillings", IRREGULAR_COMPONENTS),
    ("closed pieces in irregular fillings", IRREGULAR_SEED),
    ("splits in irregular fillings", IRREGULAR_SPLIT),
    ("holes and handles in irregular fillings", IRREGULAR_LOOP),
    ("triangles in irregular fillings", IRREGULAR_OPERATION),
    ("vertices in irregular fillings", IRREGULAR_RESIDUAL),
    ("corners", arc::CORNER),
    ("arc samples", arc::FIRST_OF_SAMPLES),
    ("roots and blocks of the index", index::ROOT),
    ("arcs of the index", index::ARC_END),
    ("grids", GRID),
    ("nothing", GRID_END),
];

/// Contexts of the arcs.
pub(crate) mod arc {
    use super::{ARC, Context};

    /// Classes of a residual's expected size: the bit length of the one above, the last one for intervals with none above.
    pub(crate) const SIZE_CLASSES: usize = 8;
    /// Corner coordinates, one context an axis.
    pub(crate) const CORNER: Context = ARC;
    const SPLIT: Context = CORNER + 3;
    /// All from here to the index blocks' are of samples.
    pub(crate) const FIRST_OF_SAMPLES: Context = SPLIT;
    const RESIDUAL: Context = SPLIT + 24;

    /// Split flag of an interval: whether it is new at this level, how many of its two neighbours are shorter, its depth.
    pub(crate) fn split(is_new: bool, shorter_neighbour_count: usize, depth: u32) -> Context {
        SPLIT + (is_new as Context * 3 + shorter_neighbour_count.min(2) as Context) * 4 + depth.min(3) as Context
    }

    /// Residual component: 0 and 1 across the arc, 2 along it.
    pub(crate) fn residual(component: usize, size_class: usize) -> Context {
        RESIDUAL + (component * SIZE_CLASSES + size_class.min(SIZE_CLASSES - 1)) as Context
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::codec::entropy::context::GRID;

        #[test]
        fn contexts_stay_in_their_range() {
            assert!(split(true, 9, 16) < RESIDUAL);
            assert!(residual(2, 99) < GRID);
        }
    }
}

/// Contexts of the index blocks.
pub(crate) mod index {
    use super::{ARC, Context};

    const INDEX: Context = ARC + 51;
    /// Four times the number of loops of a root, plus its filling.
    pub(crate) const ROOT: Context = INDEX;
    /// Half-arcs of a loop.
    pub(crate) const LOOP: Context = INDEX + 1;
    /// Reference to an arc, and its direction.
    pub(crate) const HALF_ARC: Context = INDEX + 2;
    /// Box coordinate of a root.
    pub(crate) const BOX: Context = INDEX + 3;
    /// Levels that a root has, but for level 0.
    pub(crate) const LEVELS: Context = INDEX + 4;
    /// Error of a block against its level's tolerance.
    pub(crate) const ERROR: Context = INDEX + 5;
    /// Border deviation of a block against its error.
    pub(crate) const DEVIATION: Context = INDEX + 6;
    /// Triangles of a block.
    pub(crate) const TRIANGLES: Context = INDEX + 7;
    /// Whether a block begins a stream.
    pub(crate) const STREAM: Context = INDEX + 8;
    /// Reference to a corner.
    pub(crate) const ARC_END: Context = INDEX + 9;
    /// New samples of an arc at level 0.
    pub(crate) const FIRST_SAMPLES: Context = INDEX + 10;
    /// New samples of an arc at finer levels: after a level with none, and after one with some.
    pub(crate) const SAMPLES: [Context; 2] = [INDEX + 11, INDEX + 12];
}

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
            assert_eq!(tangents(1, SIZE_CLASSES - 1)[1][1] + 1, crate::codec::entropy::context::GRID_END);
            assert!(crate::codec::entropy::context::USES.is_sorted_by(|a, b| a.1 < b.1));
            assert!(split(true, 7, 4) < NORMAL);
        }
    }
}
