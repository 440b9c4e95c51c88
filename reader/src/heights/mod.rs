//! Regular grids of heights: terrain, on a plane or on a globe (thesis 3.3 and 3.4; SPEC.md, "Heights").
//!
//! - [`grid`]: tiles and the lines of samples in them,
//! - [`surface`]: where samples are in space,
//! - [`restricted`]: triangles of a tile at a tolerance,
//! - [`drawn`]: a tile laid out,
//! - `codec`: the samples of a tile as symbols,
//! - `section` and `page`: what a file says about the whole and about each tile,
//! - `index`, `file`, `tree`, `tiles`: an open file, its tiles and their samples,
//! - `cut`, `mesh` and `on_lines`: what is drawn at a tolerance, and its triangles without cracks,
//! - `normals`, `ramp`, `drape` and `colours`: what tiles look like,
//! - `ready`, `covering` and `bounds`: tiles for sessions ([`crate::stream`]), the image over them, and boxes around
//!   them,
//! - `write`: writing a file.

mod bounds;
pub(crate) mod codec;
mod colours;
mod covering;
mod cut;
mod drape;
pub mod drawn;
mod file;
pub mod grid;
mod index;
mod mesh;
mod normals;
mod on_lines;
mod page;
mod ramp;
mod ready;
pub mod restricted;
mod section;
pub mod surface;
mod tiles;
mod tree;
#[cfg(feature = "write")]
mod write;

pub(crate) use bounds::{enclosed_ball, is_hidden, tile_box};
#[cfg(test)]
pub(crate) use codec::known_samples;
#[cfg(feature = "write")]
pub use codec::tile_symbols;
pub use colours::BARE;
pub(crate) use covering::{Covering, TileColours};
pub use cut::{CutTile, HeightsCut, HeightsQuery};
#[cfg(feature = "write")]
pub use drape::DrapeWriter;
pub(crate) use drape::ImageId;
pub use drape::{Drape, DrapeImage, DrapeWindow};
pub use drawn::{DrawnTile, TileValues};
pub use file::Heights;
pub use grid::{CELLS, Grid, Lines, SIDE, TileId};
pub use index::HeightsIndex;
pub use mesh::HeightsMesh;
pub(crate) use mesh::{LineName, fan, line_name};
pub use normals::{Across, Normal, normals};
pub(crate) use normals::{SIDES, across, axis_of, is_first};
pub use page::{LevelErrors, MAX_RESOLUTIONS, MOST_LEVEL, Resolution, TileRecord, storable_tolerance};
pub use ramp::{Ramp, RampStop};
pub(crate) use ready::{ReadyTile, TileFaces};
pub use restricted::TileTriangle;
pub use section::HeightsInfo;
pub use surface::{Base, Line, Surface};
pub(crate) use tree::{Place, WantedPage};
#[cfg(feature = "write")]
pub use write::{HeightsWriter, TileEncoder};
