//! Texels: what a surface carries, as images over maps (SPEC.md, "Texels").
//!
//! A [`Map`] divides a patch into pieces and projects each onto a rectangle of an image. It follows from the patch and
//! a few bytes, and stores no coordinates. An [`Image`] has one value per texel and component. Colours, normals and
//! factors are transformed by blocks of 8 x 8 texels and quantised; other values are predicted from their neighbours,
//! exactly, and so are colours, normals and factors of which nothing may be lost. Both are coded bit by bit with
//! probabilities that adapt, so an image of a hundred texels needs no tables.

pub(crate) mod binary;
mod colours;
mod exact;
mod extrude;
#[cfg(feature = "write")]
mod form;
mod image;
#[cfg(feature = "write")]
mod loss;
mod map;
mod normals;
mod planes;
mod scaled;
#[cfg(feature = "write")]
mod seen;
mod shape;
mod transform;
mod values;

#[cfg(feature = "write")]
pub use exact::encode_exact_image;
pub use image::Image;
#[cfg(feature = "write")]
pub use image::{ImageStreams, encode_image, encode_seen_image};
#[cfg(feature = "write")]
pub use loss::lost_squares;
#[cfg(feature = "write")]
pub use map::encode_map;
pub(crate) use map::halved;
pub use map::{Map, Piece};
#[cfg(feature = "write")]
pub use normals::{encode_exact_normals, encode_normals};
pub use scaled::SCALES;
#[cfg(feature = "write")]
pub use seen::{Seen, SeenPoint};
#[cfg(feature = "write")]
pub use shape::{LongTexels, PieceShape, texel_size};
#[cfg(feature = "write")]
pub use values::encode_values;
