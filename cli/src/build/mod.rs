//! The pipeline: import, repair, segment, mip (arcs), then chart by chart simplify, choose and certify, then pack.

mod borders;
mod choose;
mod grid;
mod irregular;
mod join;
mod overview;
mod region;
mod root;
mod scale;

pub use scale::{LevelPlan, Scale};

use crate::atlas::{Atlas, Seams};
use crate::atlas_build::{InputError, read_input};
use crate::atlas_export::AtlasError;
use crate::import::{ImportError, Imported, Room};
use crate::mesh::{Adjacency, Mesh};
use crate::progress::Progress;
use crate::region::{Border, BorderSketch, Extent, REGION_TRIANGLES, Region, RegionError, Regions, find_seams};
use crate::segment::{SegmentOptions, segment_charts};
use crate::summary::{BuildSummary, Fallbacks, LevelSummary, Stopwatch, peak_memory_bytes};
use crate::tolerance::{Tolerance, Unit};
use join::Joiner;
use lodpack::{Filling, SourceInfo};
use region::build_region;
use root::Times;
use std::io::Write;
use std::path::PathBuf;

/// How far certified errors may be above true ones: tight, and where time matters more.
const CERTIFY_GAP: f64 = 0.05;
const FAST_CERTIFY_GAP: f64 = 0.25;

/// How much a build may try.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// One filling, one certificate per level with accumulation where that is cheaper.
    Fast,
    /// Grids are tried where they are likely to pay.
    #[default]
    Default,
    /// Grids are tried on every disk.
    Best,
}

/// Which fillings a build may use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fillings {
    /// Per chart the one that is smaller at equal error, as far as the effort allows to find out.
    #[default]
    Auto,
    /// No grids. For comparisons.
    IrregularOnly,
    /// Grids wherever a chart can be one within the tolerance, whatever they cost. For tests and comparisons.
    GridWherePossible,
}

/// What a build is asked for.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Input files, or one atlas directory.
    pub inputs: Vec<PathBuf>,
    /// Bound on the certified error of the finest level.
    pub tolerance: Tolerance,
    /// Unit of the input's coordinates, where known.
    pub unit: Option<Unit>,
    /// Run time against bytes.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Input triangles per chart aimed at, up to the automatic tolerance; a coarser one gets larger charts. 8 to 16 thousand: smaller charts lose bytes to borders, larger ones stream coarsely.
    pub chart_triangles: u32,
    /// Triangles per region at most; see [`crate::region`].
    pub region_triangles: u64,
    /// Bytes of memory that the build may take; where it needs more, it uses temporary files. The result does not depend on it.
    pub memory: u64,
    /// The directory in which one for temporary files is made.
    pub temporary: PathBuf,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            inputs: vec![],
            tolerance: Tolerance::Auto,
            unit: None,
            effort: Effort::Default,
            fillings: Fillings::Auto,
            chart_triangles: 8192,
            region_triangles: REGION_TRIANGLES,
            memory: u64::MAX,
            temporary: std::env::temp_dir(),
        }
    }
}

impl BuildOptions {
    fn room(&self) -> Room {
        Room { memory: self.memory, temporary: self.temporary.clone() }
    }
}

/// Why a build failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// An input is unusable.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// An atlas directory is unusable.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// The tolerance does not fit the input.
    #[error("{what}")]
    Tolerance {
        /// What is wrong and what would do.
        what: String,
    },
    /// Lengths that cannot be computed with.
    #[error(
        "the model reaches over {size:e} units: only sizes from {smallest:e} to {largest:e} can be built; scale its coordinates"
    )]
    Size {
        /// Extent, or distance from the origin.
        size: f64,
        /// Smallest possible extent.
        smallest: f64,
        /// Largest possible coordinate.
        largest: f64,
    },
    /// Nothing is left of the input.
    #[error(
        "{input}: no triangle with an area is left after repair ({dropped} degenerate or duplicate triangles were dropped)"
    )]
    Empty {
        /// The first input.
        input: String,
        /// How many triangles were dropped.
        dropped: u64,
    },
    /// The memory or the disk space does not do.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// The format layer refused the model.
    #[error("cannot write the file: {0}")]
    Write(#[from] lodpack::Error),
}

/// Builds a file from meshes. The bytes depend on the inputs and the options alone.
///
/// # Errors
/// [`BuildError`], by culprit. Nothing useful has been written to `out` then.
pub fn build(
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    progress.begin("import", 0);
    let watch = Stopwatch::default();
    let input = read_input(&options.inputs, &options.room(), progress).map_err(|error| match error {
        InputError::Import(error) => BuildError::Import(error),
        InputError::Atlas(error) => BuildError::Atlas(error),
        InputError::Temporary(error) => BuildError::Region(error.into()),
    })?;
    build_timed(input, options, out, progress, watch)
}

/// Builds a file from a mesh wherever it is.
#[cfg(test)]
pub(crate) fn build_imported(
    input: Imported,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    build_timed(input, options, out, progress, Stopwatch::default())
}

/// Builds a file from a mesh in memory; `options.inputs` serve messages alone.
///
/// # Errors
/// As [`build`].
pub fn build_mesh(
    input: Mesh,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    let input = Imported::new(input, &options.room()).map_err(RegionError::from)?;
    build_timed(input, options, out, progress, Stopwatch::default())
}

fn build_timed(
    input: Imported,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
) -> Result<BuildSummary, BuildError> {
    let input_triangles = input.triangle_count();
    Scale::check_size(input.bounds())?;
    watch.lap("import");

    // From here on every edge has one or two triangles of one winding, and every vertex one fan.
    progress.begin("repair", 0);
    let Regions { mut store, borders, extents, matching, repairs } =
        Regions::new(input, options.region_triangles, options.memory)?;
    let extents = extents.into_iter().filter(|extent| extent.triangles > 0);
    let Some(extent) = extents.reduce(Extent::plus) else {
        let input = options.inputs.first().map(|p| p.display().to_string()).unwrap_or_default();
        return Err(BuildError::Empty { input, dropped: input_triangles });
    };
    watch.lap("repair");
    let scale = Scale::new(&extent, options.tolerance, options.unit, options.chart_triangles)?;

    // Every chart is connected; every loop of a chart has at least three arcs.
    progress.begin("segment", 0);
    let segment_options = SegmentOptions { target_triangles: scale.chart_triangles, ..SegmentOptions::default() };
    let alone = store.count() == 1;
    let charted = store.set_labels(&borders, |region, border| chart_region(region, border, &segment_options, alone));
    let (counts, sketches): (Vec<u64>, Vec<BorderSketch>) = charted.map_err(RegionError::from)?.into_iter().unzip();
    let chart_count: u64 = counts.iter().sum();
    let seams = if alone { vec![Seams::default()] } else { find_seams(&borders, &matching, &sketches) };
    drop((borders, matching, sketches));
    watch.lap("segment");

    progress.begin("roots", chart_count);
    let source = SourceInfo {
        triangle_count: extent.triangles,
        vertex_count: extent.vertices,
        mean_edge_length: scale.mean_edge_length,
        area: extent.area,
        generator: concat!("lodpack ", env!("CARGO_PKG_VERSION")).into(),
    };
    let mut joiner = Joiner::new(&scale, source);
    let (mut fallbacks, mut times, mut interior_vertices) = (Fallbacks::default(), Times::default(), 0);
    for (index, seams) in seams.iter().enumerate() {
        let region = store.take(index).map_err(RegionError::from)?;
        let product = build_region(&region, seams, &scale, options, progress)?;
        fallbacks = fallbacks.plus(product.fallbacks.clone());
        times.add(&product.times);
        interior_vertices += product.interior_vertices;
        joiner.add(product)?;
    }
    watch.lap("roots");
    watch.stages.extend(times.stages());

    progress.begin("pack", 0);
    let mut model = joiner.finish();
    model.overview = overview::overview(&model, &scale)?;
    let arc_samples: usize = model.arcs.iter().map(|arc| arc.samples.len()).sum();
    let samples = (model.corners.len() + arc_samples) as u64 + interior_vertices;
    let (irregular_roots, grid_roots) = model.roots.iter().fold((0, 0), |(i, g), root| match root.filling {
        Filling::Grid => (i, g + 1),
        _ => (i + 1, g),
    });
    let report = lodpack::write_file(&model, out)?;
    watch.lap("pack");

    let vertices = extent.vertices;
    let levels = level_summaries(&model, &report.levels);
    let certified_error = levels.last().map_or(0.0, |l| l.certified_error);
    if certified_error > scale.tolerance {
        let tolerance = scale.tolerance;
        progress.note(&format!(
            "the tolerance of {tolerance:.3e} is not reached: the certified error is {certified_error:.3e}"
        ));
    }
    Ok(BuildSummary {
        input_triangles,
        input_vertices: vertices,
        triangles: extent.triangles,
        mean_edge_length: scale.mean_edge_length,
        repairs,
        charts: chart_count,
        irregular_roots,
        grid_roots,
        samples_per_input_vertex: samples as f64 / vertices as f64,
        bytes: report.total_bytes,
        bits_per_input_vertex: report.total_bytes as f64 * 8.0 / vertices as f64,
        tolerance: scale.tolerance,
        certified_error,
        levels,
        fallbacks,
        wall_seconds: watch.total().0.as_secs_f64(),
        cpu_seconds: watch.total().1.as_secs_f64(),
        stages: watch.stages,
        peak_memory_bytes: peak_memory_bytes(),
        temporary_bytes: store.temporary_bytes(),
    })
}

/// Cuts a region into charts; how many there are and, unless it is all there is, what they do at its border.
fn chart_region(
    Region { mesh, adjacency, .. }: &Region,
    border: &Border,
    options: &SegmentOptions,
    alone: bool,
) -> (Vec<u32>, (u64, BorderSketch)) {
    let labels = segment_charts(mesh, adjacency, options);
    let count = labels.iter().max().map_or(0, |&last| u64::from(last) + 1);
    let sketch = if alone { BorderSketch::default() } else { BorderSketch::new(mesh, adjacency, border, &labels) };
    (labels, (count, sketch))
}

/// Triangles, errors and bytes by level, every root drawn at that level.
fn level_summaries(model: &lodpack::Model, level_bytes: &[[u64; 2]]) -> Vec<LevelSummary> {
    let summary = |level: usize| {
        let drawn = model.roots.iter().filter_map(|root| root.blocks[..=level].iter().rev().flatten().next());
        let (triangles, error) =
            drawn.fold((0, 0.0f64), |(n, e), block| (n + u64::from(block.triangle_count), e.max(block.error)));
        let bytes = level_bytes.get(level).map_or(0, |parts| parts.iter().sum());
        LevelSummary { level: level as u8, triangles, certified_error: error, bytes }
    };
    (0..model.levels.len()).map(summary).collect()
}

/// The input, cut into charts: what every later stage reads and none changes.
#[derive(Clone, Copy)]
pub(crate) struct Surface<'a> {
    pub mesh: &'a Mesh,
    pub adjacency: &'a Adjacency,
    pub labels: &'a [u32],
    pub atlas: &'a Atlas,
    pub scale: &'a Scale,
    /// Share by which a certified error may exceed the true one.
    pub certify_gap: f64,
}
