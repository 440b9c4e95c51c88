//! Adapting a picture in parts, side by side: screen tiles, one cut each, and the unification of these (Niski 2007,
//! sections 7.2 to 7.5; Niski and Cohen 2007, sections 3 to 5).
//!
//! A [`TileTree`] cuts the screen; [`Tiles`] have an [`crate::Adapter`] each, all over one hierarchy, which are updated
//! on as many threads as there are; [`unify_cuts`] then makes what several tiles show the same in all of them; and
//! [`TileTree::rebalance`] moves the borders so that the next frame's work is shared more evenly.
//! Devices that draw parts of a picture side by side get them by [`balanced_cuts`].

mod devices;
mod following;
mod overlap;
mod tiles;

#[cfg(test)]
mod tests;

pub use devices::{ScreenLoad, balanced_cuts};
pub use following::{Tiles, TilesReport};
pub use overlap::{Unification, Unified, unify_cuts};
pub use tiles::TileTree;
