//! The pipeline: import, repair, segment, mip (arcs), then chart by chart simplify, choose and certify, then pack.

mod borders;
mod choose;
mod coarse;
mod grid;
mod idle;
mod irregular;
mod join;
mod options;
mod overview;
mod plan;
mod region;
mod root;
mod scale;
pub mod summary;

pub(crate) use join::{Products, join};
pub use options::{BuildError, BuildOptions, Effort, Fillings};
pub use overview::{OVERVIEW_FROM_BYTES, OVERVIEW_FROM_ROOTS, OVERVIEW_TRIANGLES};
pub(crate) use plan::{Plan, Prepared, RegionSize, prepare};
pub(crate) use region::{RegionFacts, RegionProduct, build_region};
pub(crate) use root::Times;
pub use scale::{LevelPlan, Scale};

use crate::geometry_images::atlas_build::read_input;
use crate::import::Imported;
use crate::job::Job;
use crate::mesh::{Adjacency, Mesh};
use crate::pipeline::summary::{BuildSummary, Stopwatch};
use crate::progress::Progress;
use crate::region::{RegionError, RegionStore, Regions};
use crate::stage::arcs::Atlas;
use std::io::Write;
use std::path::{Path, PathBuf};

/// How far certified errors may be above true ones: tight, and where time matters more.
const CERTIFY_GAP: f64 = 0.05;
const FAST_CERTIFY_GAP: f64 = 0.25;

/// Builds a file from meshes. The bytes depend on the inputs and the options alone.
///
/// # Errors
/// [`BuildError`], by culprit. Nothing useful has been written to `out` then.
pub fn build(
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    let options = &options.checked()?;
    let mut watch = Stopwatch::default();
    if options.resume && options.work.exists() {
        let job = Job::resume(&options.work, options)?;
        return job.build(options, None, out, progress, watch);
    }
    progress.begin("import", 0);
    let input = read_input(&options.inputs, &options.room(), progress)?;
    watch.lap("import");
    build_imported(input, options, out, progress, watch)
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
    build_imported(input, options, out, progress, Stopwatch::default())
}

pub(crate) fn build_imported(
    input: Imported,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
    watch: Stopwatch,
) -> Result<BuildSummary, BuildError> {
    match input {
        Imported::Memory(mesh) => build_in_memory(mesh, options, out, progress, watch),
        Imported::Spilled(mesh) => {
            let job = Job::begin(mesh.directory.clone(), options)?;
            job.build(options, Some(mesh), out, progress, watch)
        }
    }
}

fn build_in_memory(
    mesh: Mesh,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
) -> Result<BuildSummary, BuildError> {
    let input_triangles = mesh.triangles.len() as u64;
    Scale::check_size(mesh.bounds())?;
    // From here on every edge has one or two triangles of one winding, and every vertex one fan.
    progress.begin("repair", 0);
    let regions = Regions::in_memory(mesh, options.division());
    watch.lap("repair");
    let Prepared { store, plan, seams, .. } = prepare(regions, input_triangles, options, None, progress)?;
    watch.lap("segment");
    let RegionStore::Memory(regions) = store else { unreachable!("nothing has been written") };

    progress.begin("roots", plan.charts);
    let regions = regions.into_iter().zip(&seams);
    let products = regions.map(|(region, seams)| build_region(&region, seams, &plan, progress));
    let products = products.collect::<lodpack::Result<Vec<_>>>()?;
    join(&plan, &products, &scratch(options), out, progress, watch, Times::default())
}

/// Where symbols and pages wait that do not fit in memory: beside what is built.
fn scratch(options: &BuildOptions) -> PathBuf {
    let beside = options.work.parent().filter(|folder| folder.is_dir());
    beside.map_or_else(std::env::temp_dir, Path::to_owned)
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
