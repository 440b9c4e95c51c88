//! A chart atlas as files that other programs can read and make: one EXR geometry image per root, and `atlas.json`.
//!
//! An n-corner chart gives n square roots, its quads ([`crate::stage::embed::quad_point`]). A root of resolution r is an image of
//! (2^r + 1)^2 pixels with the channels R, G, B = x, y, z: 32-bit floats, relative to the origin in `atlas.json`. Column x is
//! s = x / 2^r, row y is t = y / 2^r. Going right, then down, then back is counter-clockwise on the outside of the surface. So
//! the left edge is s = 0, the top edge (the image's first row) t = 0, the right edge s = 1, the bottom edge t = 1.
//!
//! `atlas.json` says for each edge which edge of which root it is the same line as, and whether it runs the other way there;
//! samples along both are then bit-identical. An edge without a neighbour is on the border of the surface, or borders on a patch.
//!
//! A patch is what no map could be found for: a PLY mesh, positions relative to the origin too. `atlas.json` lists for each edge of
//! an image that it borders on the patch's vertices along that edge. The edge's samples are among them, in order; those in
//! between are inserted into the image's triangles.

pub mod atlas_build;
mod border_edges;
mod image;
mod manifest;
mod patch;
mod product;
mod read;
mod sides;
mod weld;
mod write;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

pub use manifest::ImageEdge;
pub use product::{ArcKnot, AtlasChart, AtlasHeader, AtlasPatch, AtlasProduct, PatchBorder};
pub use read::read_atlas;
pub use write::write_atlas;

/// Largest resolution of a root: 4097 x 4097 samples.
pub const MAX_RESOLUTION: u32 = 12;

/// The name of the file that describes the atlas.
pub const MANIFEST_NAME: &str = "atlas.json";

/// What that file is called until it is complete.
pub const UNFINISHED_MANIFEST: &str = "atlas.json.tmp";

/// Why an atlas could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AtlasError {
    /// The folder or a file in it could not be opened or read.
    #[error("{} cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A directory is no atlas.
    #[error(
        "{} is no atlas: there is no atlas.json in it; name the meshes in it, as {}", folder.display(), meshes.display()
    )]
    NoAtlas {
        /// The directory.
        folder: PathBuf,
        /// A pattern that meshes in it would have.
        meshes: PathBuf,
    },
    /// A file could not be written.
    #[error("{} cannot be written", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// `atlas.json` is not what it should be.
    #[error("{} is not as lodpack's atlas folders have it", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// `atlas.json` breaks a rule that holds for a root or the whole atlas.
    #[error("{}: {what}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The root and the rule.
        what: String,
    },
    /// A geometry image is missing or is not an EXR image with the channels R, G and B.
    #[error("{} is no EXR image with channels R, G and B, which a root needs", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// What the decoder says.
        source: exr::error::Error,
    },
    /// A geometry image has not the size that its resolution asks for.
    #[error(
        "{}: {width} x {height} pixels, but resolution {resolution} needs {expected} x {expected}; \
         resample the image or correct atlas.json",
        path.display()
    )]
    ImageSize {
        /// The image.
        path: PathBuf,
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
        /// As `atlas.json` has it.
        resolution: u32,
        /// Pixels, 2^resolution + 1.
        expected: usize,
    },
    /// A sample is not a finite number, or does not fit in 32 bits.
    #[error("{}: the sample at column {column}, row {row} is not a finite 32-bit number", path.display())]
    NotFinite {
        /// The image.
        path: PathBuf,
        /// Pixel column.
        column: usize,
        /// Pixel row.
        row: usize,
    },
    /// A patch is no readable mesh.
    #[error(transparent)]
    Patch(#[from] crate::import::ImportError),
    /// Two roots, or a root and a patch, are declared neighbours but differ along their common edge.
    #[error("{first} and {second} do not agree along their common edge: {what}; both must hold the same samples")]
    EdgesDisagree {
        /// File of one root, and its edge.
        first: String,
        /// File of the other root and its edge, or file of the patch.
        second: String,
        /// How they differ.
        what: String,
    },
}
