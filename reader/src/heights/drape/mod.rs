//! An image over a grid of heights (SPEC.md, "Section DRAPE").
//!
//! - `section`: where texels are, the levels of the image, and directories of its tiles,
//! - `window`: what is read of it for a rectangle of the grid,
//! - `open`: what is known of the image of an open file, and its texels,
//! - `write`: its section.
//!
//! The image keeps its own texels, which need not meet the samples: nothing is lost by sampling again, and tiles of
//! heights that meet show the same texels along their border. It is stored in square tiles at levels that are each an
//! eighth of the finer one along each side; images in scales show all halvings between.

mod open;
mod section;
mod window;
#[cfg(feature = "write")]
mod write;

pub(super) use open::OpenDrape;
pub use section::Drape;
pub(super) use section::HEAD_BYTES;
pub use section::ImageId;
pub use window::{DrapeImage, DrapeWindow};
#[cfg(feature = "write")]
pub use write::DrapeWriter;
