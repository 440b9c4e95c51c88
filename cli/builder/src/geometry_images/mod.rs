//! A chart atlas as files that other programs can read and make: one EXR geometry image per root, and `atlas.json`.
//!
//! A chart with n corners gives n square roots, its quads ([`lodpack_stage::embed::quad_point`]). A root of resolution
//! r is an image of (2^r + 1)^2 pixels with the channels R, G, B = x, y, z: 32-bit floats, relative to the origin in
//! `atlas.json`. Column x is s = x / 2^r, row y is t = y / 2^r. Going right, then down, then back is counter-clockwise
//! on the outside of the surface. So the left edge is s = 0, the top edge (the image's first row) t = 0, the right edge
//! s = 1, the bottom edge t = 1.
//!
//! `chart` in `atlas.json` says which roots are quads of one chart. `lodpack build` makes one root of a file of them,
//! and of each patch.
//!
//! For each edge, `atlas.json` names the edge of another root that is the same line, and says whether it runs the other
//! way there. The samples along both are bit-identical. An edge without a neighbour is on the boundary of the surface,
//! or borders on a patch.
//!
//! A patch is a piece of the surface for which no map was found: a PLY mesh, its positions relative to the origin too.
//! For each edge of an image on which the patch borders, `atlas.json` lists the patch's vertices along that edge. The
//! edge's samples are among them, in order; the vertices between are inserted into the image's triangles.
//!
//! What the surface carries has images of its own for each root, at the same places (s, t): PNG for what materials
//! have, at a resolution of its own, and EXR for numbers, at that of the root. Borders are as doubled in them as in the
//! images of positions: roots whose surface is drawn alike have the same bytes on both sides. Patches have images whose
//! places the corners of their PLY triangles name, and numbers at their vertices.
//!
//! Mips are folders `mip_01`, `mip_02` ... of the same layout, each with images of half the steps: their positions are
//! every second sample, and what else there is comes from the input again, averaged over what a sample stands for.

mod border_edges;
mod files;
mod from_mesh;
mod image;
mod import;
mod looks;
mod manifest;
mod numbers;
mod paint;
mod patch;
mod patch_file;
mod patch_image;
mod product;
mod quads;
mod read;
mod sides;
mod surface;
mod triangulate;
mod weld;
mod write;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

pub use files::{atlas_files, mip_folders};
pub use from_mesh::{AtlasOptions, BuiltAtlas, build_atlas};
pub use import::import_atlas;
pub use manifest::ImageEdge;
pub use product::{ArcKnot, AtlasChart, AtlasHeader, AtlasPatch, AtlasProduct, Looks, PatchBorder};
pub use read::read_atlas;
pub use write::{Resolutions, WriteOptions, write_atlas};

/// Largest resolution of a root: 4097 x 4097 samples.
pub const MAX_RESOLUTION: u32 = 12;

/// The name of the file that describes the atlas.
pub const MANIFEST_NAME: &str = "atlas.json";

/// The name of that file until it is complete.
const UNFINISHED_MANIFEST: &str = "atlas.json.tmp";

/// Why an atlas could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AtlasError {
    /// The folder or a file in it could not be opened or read.
    #[error("{} cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason that the system gave.
        source: std::io::Error,
    },
    /// A directory is not an atlas.
    #[error(
        "{} is not an atlas: there is no atlas.json in it; name the meshes in it instead, as in {}",
        folder.display(), meshes.display()
    )]
    NoAtlas {
        /// The directory.
        folder: PathBuf,
        /// A pattern that matches the meshes in it.
        meshes: PathBuf,
    },
    /// A file could not be written.
    #[error("{} cannot be written", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason that the system gave.
        source: std::io::Error,
    },
    /// `atlas.json` does not have the expected fields.
    #[error("{} is not a valid atlas.json; write it as `lodpack atlas` does", path.display())]
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
    /// There are more roots and patches than can have images.
    #[error(
        "{}: {count} roots and patches with images or drawings are more than the {most} of one build; pass --channels none to build the shape \
         alone, or write the surface as several atlases",
        path.display()
    )]
    Pieces {
        /// `atlas.json`.
        path: PathBuf,
        /// Their number.
        count: usize,
        /// The limit.
        most: usize,
    },
    /// A geometry image is missing or is not an EXR image with the channels R, G and B.
    #[error("{} is not an EXR image with the channels R, G and B; convert it", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// The reason that the decoder gave.
        source: exr::error::Error,
    },
    /// An image of numbers is not an EXR image with the channel Y.
    #[error("{} is not an EXR image with the channel Y; convert it", path.display())]
    Numbers {
        /// The image.
        path: PathBuf,
        /// The reason that the decoder gave.
        source: exr::error::Error,
    },
    /// An image with texels cannot be used.
    #[error("{} cannot be used: {what}", path.display())]
    Texels {
        /// The image.
        path: PathBuf,
        /// The reason.
        what: String,
    },
    /// A file for texels of the input's images cannot be made, written or read.
    #[error(transparent)]
    Work(#[from] lodpack_runtime::storage::WorkError),
    /// An image does not have the size of its resolution.
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
        /// The resolution in `atlas.json`.
        resolution: u32,
        /// Pixels in each direction, 2^resolution + 1.
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
    /// A patch is not a readable mesh.
    #[error(transparent)]
    Patch(#[from] lodpack_import::ImportError),
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

impl AtlasError {
    /// An EXR image could not be written.
    fn of_writing(path: &std::path::Path, error: exr::error::Error) -> Self {
        let source = match error {
            exr::error::Error::Io(source) => source,
            other => std::io::Error::other(other),
        };
        Self::Write { path: path.into(), source }
    }
}
