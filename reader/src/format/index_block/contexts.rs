//! The contexts of index blocks (SPEC.md, "Records").

use crate::codec::entropy::context::{Context, INDEX, TREE, Use};

/// Loops and filling of a root.
pub(super) const ROOT: Context = INDEX.first;
/// Half-arcs of a loop.
pub(super) const LOOP: Context = ROOT + 1;
/// Reference to an arc, and its direction.
pub(super) const HALF_ARC: Context = ROOT + 2;
/// Box coordinate of a root.
pub(super) const BOX: Context = ROOT + 3;
/// Levels of a root.
pub(super) const LEVELS: Context = ROOT + 4;
/// Error of a block, relative to its level's tolerance.
pub(super) const ERROR: Context = ROOT + 5;
/// Border deviation of a block, relative to its error.
pub(super) const DEVIATION: Context = ROOT + 6;
/// Triangles of a block.
pub(super) const TRIANGLES: Context = ROOT + 7;
/// Whether a block begins a stream.
pub(super) const STREAM: Context = ROOT + 8;
/// Reference to a corner.
pub(super) const ARC_END: Context = ROOT + 9;
/// New samples of an arc at level 0.
pub(super) const FIRST_SAMPLES: Context = ROOT + 10;
/// New samples of an arc at a finer level: after a level with none, and after one with some.
pub(super) const SAMPLES: [Context; 2] = [ROOT + 11, ROOT + 12];
const _: () = assert!(SAMPLES[1] + 1 == INDEX.end);
/// Children of a root.
pub(super) const CHILDREN: Context = TREE.first;
/// The coarsest level of a corner: after a corner that is no vertex at level 0, and otherwise.
pub(super) const CORNER_LEVEL: [Context; 2] = [TREE.first + 1, TREE.first + 2];
const _: () = assert!(CORNER_LEVEL[1] + 1 == TREE.end);

/// What these contexts are for.
pub(crate) const USES: &[Use] =
    &[Use { name: "roots and blocks of the index", first: ROOT }, Use { name: "arcs of the index", first: ARC_END }];
/// What the contexts of the tree are for.
pub(crate) const TREE_USES: &[Use] =
    &[Use { name: "children of roots", first: CHILDREN }, Use { name: "levels of corners", first: CORNER_LEVEL[0] }];
