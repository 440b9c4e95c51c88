//! Adapting a picture in parts, side by side: screen tiles, one cut each, and the unification of these (Niski 2007,
//! sections 7.2 to 7.5; Niski and Cohen 2007, sections 3 to 5).
//!
//! A [`TileTree`] cuts the screen; each tile has an [`crate::Adapter`] of its own, all over one hierarchy, which may be
//! updated on as many threads as there are; [`unify_cuts`] then makes what several tiles show the same in all of them;
//! and
//! [`TileTree::rebalance`] moves the borders so that the next frame's work is shared more evenly.

mod overlap;
mod tiles;

#[cfg(test)]
mod tests;

pub use overlap::{Unification, Unified, unify_cuts};
pub use tiles::TileTree;
