//! Building files of heights: rasters whose samples stay a grid (thesis 3.3 and 3.4).
//!
//! Samples are rounded to steps (`samples`), so every tile knows its values without any other one. Tiles are worked on
//! in units whose samples fit in memory (`unit`); those above the units are few, and are judged by every unit below
//! them (`above`). What all units have in common is found first (`basis`); then any process builds any of them
//! (`build`), and one joins them. `tile` chooses the resolutions of a tile. How far their triangles are from all
//! samples follows for most tiles of planes from a table of `squares`, and so do their `needs`; `facets` and `even`
//! measure the others, without those in `blocks` that cannot matter. `drape` codes the image over the
//! heights, `coding` writes, `geotiff` takes rasters out of
//! such files again, and `tin` few triangles.

mod above;
mod basis;
mod beyond;
mod blocks;
mod build;
mod coding;
mod drape;
mod even;
mod facets;
mod georeference;
mod geotiff;
mod mask;
mod needs;
mod samples;
mod spill;
mod squares;
mod tile;
mod tin;
mod unit;
mod window;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::pipeline::ColourQuality;
use crate::pipeline::summary::{StageTime, Stopwatch};
pub use above::Seen;
pub use basis::Basis;
pub use build::{Builder, BuiltUnit, Joint};
pub use drape::DrapeSummary;
pub use georeference::Georeference;
pub use geotiff::{range_of, raster_window_of, rounding_of, window_of, write_geotiff};
use lodpack_import::ImportError;
use lodpack_import::raster::{HeightDrape, HeightSource};
use lodpack_mesh::tolerance::Tolerance;
use lodpack_runtime::progress::Progress;
pub use samples::{About, Keep, Samples};
pub use tin::{Patch, Tin, Uneven, UnevenPatch, triangulate, triangulate_patch, triangulate_uneven};
pub use window::RasterWindow;

/// Why a file of heights cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum HeightsError {
    /// A raster is unusable.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The tolerance does not fit the input.
    #[error("{what}")]
    Tolerance {
        /// What is wrong, and what to do.
        what: String,
    },
    /// Heights in steps of the tolerance are too large numbers.
    #[error(
        "a height of {height} is more than a billion steps of {step}, which is what the tolerance asks for; pass a larger --tolerance"
    )]
    TooFine {
        /// The height.
        height: f64,
        /// The step.
        step: f64,
    },
    /// A temporary file cannot be used.
    #[error("a temporary file in {} cannot be used; free some space, or name another directory with --temp", folder.display())]
    Work {
        /// Where it is.
        folder: PathBuf,
        /// The reason that the system gave.
        source: std::io::Error,
    },
    /// A file of samples is not what it was.
    #[error(
        "{} is not as it was when the job was planned: it was changed, or the disk is damaged; plan the job again with --force",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// Nothing can be drawn.
    #[error("the grid has no cell whose four samples have data; check --nodata")]
    Empty,
    /// The samples that were put aside cannot be written or read.
    #[error("the temporary file of samples cannot be used; free some space, or name another directory with --temp")]
    Samples {
        /// The reason that the system gave.
        source: std::io::Error,
    },
    /// Images over heights are coded in one way alone.
    #[error(
        "the image over heights cannot be kept without loss; --color-quality 100 is almost exact, and so small a difference cannot be seen"
    )]
    Lossless,
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] lodpack::Error),
}

impl HeightsError {
    /// The file of samples cannot be written or read.
    fn samples(source: std::io::Error) -> Self {
        Self::Samples { source }
    }
}

/// What to build.
#[derive(Clone, Debug)]
pub struct HeightsOptions {
    /// The largest distance of a sample from its height in the file.
    pub tolerance: Tolerance,
    /// Bytes of memory that the build may take.
    pub memory: u64,
    /// Where samples and blocks go that do not fit in memory.
    pub folder: PathBuf,
    /// How good the image over the heights is, if there is one.
    pub colour_quality: ColourQuality,
}

/// What was built.
#[derive(Clone, Debug, Serialize)]
pub struct HeightsSummary {
    /// Samples of the grid, with those that have no data.
    pub samples: u64,
    /// Columns and rows of cells.
    pub cells: [u64; 2],
    /// Tiles that are stored.
    pub tiles: u64,
    /// The greatest depth.
    pub depth: u32,
    /// Triangles of the finest resolution of the finest tiles.
    pub triangles: u64,
    /// The tolerance, in units of coordinates.
    pub tolerance: f64,
    /// How far a sample is from its height in the file at most.
    pub sample_error: f64,
    /// The error of the finest cut.
    pub certified_error: f64,
    /// Size of the file.
    pub bytes: u64,
    /// The image over the heights, if there is one.
    pub drape: Option<DrapeSummary>,
    /// Bits of the file for each sample, without those of the image.
    pub bits_per_sample: f64,
    /// Time of each stage.
    pub stages: Vec<StageTime>,
    /// Elapsed time.
    pub wall_seconds: f64,
    /// Processor time.
    pub cpu_seconds: f64,
    /// The most memory that the process has taken.
    pub peak_memory_bytes: u64,
}

/// Builds a file of heights.
///
/// # Errors
/// [`HeightsError`].
pub fn build(
    source: &HeightSource,
    options: &HeightsOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<HeightsSummary, HeightsError> {
    let mut watch = Stopwatch::default();
    let [columns, rows] = source.grid.samples();
    let in_file = 4 * columns * rows > options.memory / 3;
    let keep = if in_file { Keep::Nameless(&options.folder) } else { Keep::Memory };
    let (basis, samples) = Basis::new(source, options.tolerance, keep, progress, &mut watch)?;
    let code = |image: &HeightDrape| drape::code(image, options.colour_quality, &options.folder, progress);
    let drape = source.drape.as_ref().map(code);
    let drape = drape.transpose()?;
    watch.lap("image");
    progress.begin("tiles", columns * rows);
    let units = basis.units();
    let mut builder = Builder::new(&basis, &units)?;
    let mut joint = Joint::new(&options.folder)?;
    builder.build(&samples, &units, progress, |unit| joint.put(unit))?;
    if joint.is_empty() {
        return Err(source.without_cells().into());
    }
    joint.finish(&builder, drape, out, progress, watch)
}

/// A new file that lives as long as it is open.
fn nameless(folder: &Path) -> Result<File, HeightsError> {
    tempfile::tempfile_in(folder).map_err(|source| HeightsError::Work { folder: folder.to_owned(), source })
}
