//! Regular grids of heights: terrain, on a plane or on a globe (thesis 3.3 and 3.4; SPEC.md, "Heights").
//!
//! - [`grid`]: tiles and the lines of samples in them,
//! - [`surface`]: where samples are in space,
//! - [`restricted`]: triangles of a tile at a tolerance,
//! - [`drawn`]: a tile laid out,
//! - `codec`: the samples of a tile as symbols,
//! - `section` and `page`: what a file says about the whole and about each tile,
//! - `file`, `tree`, `tiles`: an open file, its tiles and their samples,
//! - `cut`, `mesh` and `on_lines`: what is drawn at a tolerance, and its triangles without cracks,
//! - `write`: writing a file.

pub(crate) mod codec;
mod cut;
pub mod drawn;
mod file;
pub mod grid;
mod mesh;
mod on_lines;
mod page;
pub mod restricted;
mod section;
pub mod surface;
mod tiles;
mod tree;
#[cfg(feature = "write")]
mod write;

#[cfg(test)]
pub(crate) use codec::known_samples;
#[cfg(feature = "write")]
pub use codec::tile_symbols;
pub use cut::{CutTile, HeightsCut, HeightsQuery};
pub use drawn::{DrawnTile, TileValues};
pub use file::Heights;
pub use grid::{CELLS, Grid, Lines, SIDE, TileId};
pub use mesh::HeightsMesh;
pub use page::{MAX_RESOLUTIONS, Resolution, TileRecord, storable_tolerance};
pub use restricted::TileTriangle;
pub use section::HeightsInfo;
pub use surface::{Base, Line, Surface};
#[cfg(feature = "write")]
pub use write::{HeightsWriter, TileEncoder};
