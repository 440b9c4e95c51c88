//! Sessions for files of heights: a [`HeightsSession`] draws tiles of a grid as a [`super::Session`] draws roots of a
//! mesh.
//!
//! A tile is decoded from its parent, so whatever is loaded has all that is above it. A frame wants tiles by their
//! errors on the screen (`wanted`); where these are not there yet, the tile above is drawn at its finest resolution.
//! Tiles beside them that are not shown are loaded last, for a camera that turns. Tiles at depth 0 come with opening,
//! so no frame is without a surface. Every tile is a [`super::DrawnRoot`] of the picture, with one strip: the triangles
//! along its border (`seams`), and has images of normals and colours (`images`).

mod content;
mod images;
mod seams;
mod session;
mod wanted;

pub(crate) use content::HeightsContent;
pub use images::TileImages;
pub use session::HeightsSession;
