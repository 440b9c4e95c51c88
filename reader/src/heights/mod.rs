//! Regular grids of heights: terrain, on a plane or on a globe (thesis 3.3 and 3.4; SPEC.md, "Heights").
//!
//! - [`grid`]: tiles and the lines of samples in them,
//! - [`surface`]: where samples are in space,
//! - [`restricted`]: triangles of a tile at a tolerance,
//! - [`drawn`]: a tile laid out,
//! - `codec`: the samples of a tile as symbols.

pub(crate) mod codec;
pub mod drawn;
pub mod grid;
pub mod restricted;
pub mod surface;

#[cfg(feature = "write")]
pub use codec::tile_symbols;
pub use drawn::{DrawnTile, TileValues};
pub use grid::{CELLS, Grid, Lines, SIDE, TileId};
pub use restricted::TileTriangle;
pub use surface::{Base, Line, Surface};
