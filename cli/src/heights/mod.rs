//! Building files of heights: rasters whose samples stay a grid (thesis 3.3 and 3.4).
//!
//! Samples are rounded to steps (`samples`), so every tile knows its values without any other one. Tiles are worked on in units whose
//! samples fit in memory (`unit`); those above the units are few, and are judged by every unit below them (`above`). `tile` chooses the
//! resolutions of a tile. How far their triangles are from all samples follows for most tiles of planes from a table of `squares`, and so do their `needs`;
//! `facets` and `even` measure the others, without those in `blocks` that cannot matter. `coding` writes, `geotiff` takes rasters out of such files
//! again, and `tin` few triangles.

mod above;
mod blocks;
mod coding;
mod even;
mod facets;
mod geotiff;
mod mask;
mod needs;
mod samples;
mod squares;
mod tile;
mod tin;
mod unit;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use lodpack::heights::{CELLS, Grid, HeightsInfo, LevelErrors, TileEncoder, TileId};
use rayon::prelude::*;
use serde::Serialize;

use crate::import::ImportError;
use crate::import::raster::HeightSource;
use crate::machine::peak_memory_bytes;
use crate::mesh::tolerance::Tolerance;
use crate::pipeline::summary::{StageTime, Stopwatch};
use crate::progress::Progress;
pub use geotiff::{RasterWindow, range_of, window_of, write_geotiff};
pub use tin::{Tin, triangulate};

use above::Above;
use coding::Spill;
use facets::Judge;
use samples::{Gather, Samples, Scale};
use tile::Setting;
use unit::Unit;

/// Depths within a unit, of which the finest tiles have 64 cells along a side: 1,024 cells.
const UNIT_DEPTHS: u32 = 4;
/// Units are taken larger rather than that more tiles than this lie above them.
const MAX_ABOVE: u64 = 700;
/// The symbols of so many units say how often each symbol occurs.
const SAMPLED_UNITS: usize = 64;
/// Of more units than this, not all tiles are taken, but for so many depths one of four.
const FEW_UNITS: usize = 4;
const THINNED_DEPTHS: u32 = 2;
/// `auto` is this share of how far samples are from the middle of their neighbours on average.
const AUTO_BEND: f64 = 0.5;
/// No step is larger, in units of heights.
const MAX_STEP: f64 = 1e12;
/// `auto` of a flat grid, as a share of its spacing.
const AUTO_FLAT: f64 = 0.01;

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
    /// The samples that were put aside cannot be written or read.
    #[error("the temporary file of samples cannot be used; free some space, or name another directory with --temp")]
    Samples {
        /// The reason that the system gave.
        source: std::io::Error,
    },
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
    /// Bits of the file for each sample.
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
    let grid = &source.grid;
    let [columns, rows] = grid.samples();
    progress.begin("import", columns * rows);
    let (scale, tolerance) = scale_of(source, options.tolerance)?;
    let in_file = 4 * columns * rows > options.memory / 3;
    let folder = in_file.then_some(options.folder.as_path());
    let samples = gather(source, scale, folder, progress)?;
    watch.lap("import");

    let height_scale = source.surface.height_scale;
    let highest = scale.zero + f64::from(samples.range[1]) * scale.step;
    let setting = Setting {
        grid,
        surface: &source.surface,
        scale,
        error: samples.error * height_scale,
        level: LevelErrors::new(grid, &source.surface, samples.error),
        highest: highest * height_scale,
    };
    let roots: Vec<_> = units(grid);
    let mut above = Above::new(&setting, &samples, &roots)?;
    let encoder = encoder(&setting, &samples, &roots, &above)?;
    watch.lap("tables");

    progress.begin("tiles", columns * rows);
    let spill = Spill::new(&options.folder)?;
    // Units are taken in bunches, so that few wait for their turn to be joined.
    let mut below = vec![];
    for bunch in roots.chunks(4 * rayon::current_num_threads()) {
        let work = |&root: &_| -> Result<_, HeightsError> {
            let unit = Unit::read(&setting, &samples, root)?;
            let (cells, falls) = (CELLS << (grid.depth() - root.depth), (root.column + root.row).is_multiple_of(2));
            let judge = Judge::new((&unit.window, cells, falls), scale, &source.surface, setting.highest);
            let seen = above.seen(root, &judge);
            let Some(values) = unit.values(root) else { return Ok((None, seen)) };
            let (below, finished) = unit.finish(&encoder, &judge, root, above.parent(root), values)?;
            spill.put(finished)?;
            let [[west, east], [north, south]] = [unit.window.columns, unit.window.rows];
            progress.advance((east - west) * (south - north));
            Ok((Some(below), seen))
        };
        let done = bunch.par_iter().map(work).collect::<Vec<_>>();
        for done in done {
            let (said, seen) = done?;
            below.extend(said);
            above.join(seen);
        }
    }
    if below.is_empty() {
        return Err(source.without_cells().into());
    }
    above.finish(&setting, &encoder, below, &spill)?;
    watch.lap("tiles");

    progress.begin("write", 0);
    let ramp = source.ramp(samples.range.map(|steps| scale.zero + f64::from(steps) * scale.step))?;
    let info = HeightsInfo {
        grid: grid.clone(),
        surface: source.surface,
        zero: scale.zero,
        step: scale.step,
        sample_error: samples.error,
        unit: source.unit.map(|unit| unit.metres * height_scale),
        ramp: ramp.as_ref().map_or_else(String::new, |(_, name)| name.clone()),
    };
    let written = spill.write((source, ramp.map(|(ramp, _)| ramp)), info, &encoder, out)?;
    watch.lap("write");
    let (wall, cpu) = watch.total();
    Ok(HeightsSummary {
        samples: columns * rows,
        cells: grid.cells(),
        tiles: written.tiles,
        depth: grid.depth(),
        triangles: written.triangles,
        tolerance,
        sample_error: setting.error,
        certified_error: written.error,
        bytes: written.bytes,
        bits_per_sample: 8.0 * written.bytes as f64 / (columns * rows) as f64,
        stages: watch.stages,
        wall_seconds: wall.as_secs_f64(),
        cpu_seconds: cpu.as_secs_f64(),
        peak_memory_bytes: peak_memory_bytes(),
    })
}

/// A new file that lives as long as it is open.
fn nameless(folder: &Path) -> Result<File, HeightsError> {
    tempfile::tempfile_in(folder).map_err(|source| HeightsError::Work { folder: folder.to_owned(), source })
}

/// The tiles in which the finest ones are worked on together.
fn units(grid: &Grid) -> Vec<TileId> {
    let [columns, rows] = grid.roots();
    let above = |depth: u32| columns * rows * ((1u64 << (2 * depth)) - 1) / 3;
    let mut depth = grid.depth().saturating_sub(UNIT_DEPTHS);
    while above(depth) > MAX_ABOVE {
        depth -= 1;
    }
    let all = (0..rows << depth).flat_map(|row| (0..columns << depth).map(move |column| (column, row)));
    let tiles = all.map(|(column, row)| TileId { depth, column, row });
    tiles.filter(|&id| grid.has(id)).collect()
}

/// The step that a tolerance asks for, and the tolerance in units of coordinates.
fn scale_of(source: &HeightSource, tolerance: Tolerance) -> Result<(Scale, f64), HeightsError> {
    let height_scale = source.surface.height_scale;
    let wrong = |what: &str| HeightsError::Tolerance { what: what.to_owned() };
    let error = match tolerance {
        Tolerance::InputUnits(length) => length / height_scale,
        Tolerance::Metres(length) => {
            let unit = source.unit.ok_or_else(|| {
                wrong("the unit of the coordinates is unknown, so a tolerance with a unit has no meaning; pass --unit, too")
            })?;
            length / unit.metres / height_scale
        }
        Tolerance::Auto | Tolerance::OfBend(_) => {
            let bend = mean_bend(source)?;
            let spacing = source.surface.spacing[0].min(-source.surface.spacing[1]);
            let flat = if source.surface.is_globe() { 1.0 } else { AUTO_FLAT * spacing };
            if bend > 0.0 { AUTO_BEND * bend } else { flat / height_scale }
        }
        Tolerance::OfDiagonal(_) | Tolerance::OfMeanEdge(_) => {
            return Err(wrong("the tolerance of heights is a length, as 0.5 or 20cm, or auto"));
        }
    };
    let zero = source.zero;
    // Integers at odd steps are at most half a step off, rounded down.
    let step = match source.is_integer() && zero.fract() == 0.0 {
        true => 2.0 * error.floor() + 1.0,
        false => 2.0 * error,
    };
    if step == 0.0 {
        return Err(wrong("a tolerance of 0 keeps integers, and these heights are none; pass a small one, as 1cm"));
    }
    if step > MAX_STEP {
        return Err(wrong("the tolerance is larger than any height; pass a smaller --tolerance"));
    }
    Ok((Scale { zero, step }, error * height_scale))
}

/// How far samples are from the middle of their neighbours to the west and the east, on average.
fn mean_bend(source: &HeightSource) -> Result<f64, ImportError> {
    let (mut sum, mut count) = (0.0, 0u64);
    source.for_each_row::<ImportError>(|_, heights| {
        for run in heights.windows(3) {
            let bend = (run[1] - 0.5 * (run[0] + run[2])).abs();
            if !bend.is_nan() {
                sum += bend;
                count += 1;
            }
        }
        Ok(())
    })?;
    Ok(if count > 0 { sum / count as f64 } else { 0.0 })
}

/// Reads all samples.
fn gather(
    source: &HeightSource,
    scale: Scale,
    folder: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Samples, HeightsError> {
    let mut gather = Gather::new(&source.grid, scale, folder)?;
    let columns = source.grid.samples()[0];
    let absent = source.for_each_row::<HeightsError>(|_, heights| {
        gather.push(heights)?;
        progress.advance(columns);
        Ok(())
    })?;
    source.note_absent(absent, progress)?;
    gather.finish()
}

/// The statistics of symbols, from some of the units and all tiles above them.
fn encoder(
    setting: &Setting<'_>,
    samples: &Samples,
    roots: &[TileId],
    above: &Above,
) -> Result<TileEncoder, HeightsError> {
    let is_all = roots.len() <= FEW_UNITS;
    let thinned = if is_all { 0 } else { THINNED_DEPTHS };
    let every = roots.len().div_ceil(SAMPLED_UNITS).max(1);
    let sampled: Vec<_> = roots.iter().skip(every / 2).step_by(every).collect();
    let symbols = sampled.par_iter().map(|&&root| -> Result<_, HeightsError> {
        let unit = Unit::read(setting, samples, root)?;
        let mut symbols = vec![];
        if let Some(values) = unit.values(root) {
            unit.symbols((root, thinned), above.values(root.parent()), &values, &mut symbols)?;
        }
        Ok(symbols)
    });
    let mut symbols = symbols.collect::<Result<Vec<_>, _>>()?.concat();
    symbols.extend(above.symbols(setting)?);
    Ok(TileEncoder::new(&symbols, is_all))
}
