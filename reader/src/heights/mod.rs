//! Regular grids of heights: terrain, on a plane or on a globe (thesis 3.3 and 3.4; SPEC.md, "Heights").
//!
//! - [`grid`]: tiles and the lines of samples in them,
//! - [`surface`]: where samples are in space,
//! - [`restricted`]: triangles of a tile at a tolerance,
//! - [`drawn`]: a tile laid out.

pub mod drawn;
pub mod grid;
pub mod restricted;
pub mod surface;

pub use drawn::{DrawnTile, Resolution, TileValues};
pub use grid::{CELLS, Grid, Lines, SIDE, TileId};
pub use restricted::TileTriangle;
pub use surface::{Base, Line, Surface};
