//! What lies closest to the points of a surface: triangles get points in rows ([`Rows`]), and blocks of these are
//! looked for on another surface together ([`Finder`]), since one triangle is mostly closest to all points of a block.
//! What images show and what is compared without images are looked for in the same way.

mod finder;
mod rows;

pub use finder::{Below, Finder, NOWHERE, OPPOSITE, Places, SHARE_OF_OPPOSITE};
pub use rows::{Block, Blocks, Points, Rows, SPACING, doubled_area};
