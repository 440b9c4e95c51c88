//! The way from inputs to a file: in memory where they fit, as a job in a work directory where they do not.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::input::read_input;
use super::{BuildError, BuildOptions, Job};
use crate::pipeline::build_in_memory;
use crate::pipeline::summary::{BuildSummary, Stopwatch};
use crate::region::MEMORY_OPTION;
use lodpack_import::Imported;
use lodpack_mesh::attributes::Surface;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::WorkDirectory;
use lodpack_runtime::storage::memory::least_for_maps;

/// Builds a file from meshes. The bytes depend on the inputs and the options alone.
///
/// # Errors
/// [`BuildError`], by culprit. Nothing useful has been written to `out` then.
pub fn build(
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    let options = &options.checked(progress)?;
    let mut watch = Stopwatch::default();
    if options.resume && options.work.exists() {
        let job = Job::resume(&options.work, options)?;
        return job.build(options, None, out, progress, watch);
    }
    if options.resume && is_worth_resuming(options) {
        // Whoever says so at first wants to continue whatever happens, also where the input fits in memory.
        let job = Job::begin(WorkDirectory::create(&options.work)?, options)?;
        return job.build(options, None, out, progress, watch);
    }
    progress.begin("import", 0);
    let input = read_input(&options.inputs, &options.room(), &options.model, progress)?;
    watch.lap("import");
    build_imported(input, options, out, progress, watch)
}

/// Whether a build takes long enough for its state to be worth a place on the disk.
fn is_worth_resuming(options: &BuildOptions) -> bool {
    let sizes = options.inputs.iter().filter_map(|input| std::fs::metadata(input).ok());
    sizes.filter(|metadata| metadata.is_file()).map(|metadata| metadata.len()).sum::<u64>() >= RESUMABLE_BYTES
}

/// Bytes of input that take more than some seconds.
const RESUMABLE_BYTES: u64 = 4 << 20;

/// Builds a file from a mesh or a surface in memory; `options.inputs` only serve messages.
///
/// # Errors
/// As [`build`].
pub fn build_mesh(
    input: impl Into<Surface>,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, BuildError> {
    let input = Imported::new(input, &options.room())?;
    build_imported(input, options, out, progress, Stopwatch::default())
}

pub(super) fn build_imported(
    input: Imported,
    options: &BuildOptions,
    out: &mut impl Write,
    progress: &dyn Progress,
    watch: Stopwatch,
) -> Result<BuildSummary, BuildError> {
    note_maps(&input, options.memory, progress);
    match input {
        Imported::Memory(surface) => {
            let built =
                build_in_memory(surface, &options.model, options.memory, &scratch(options), out, progress, watch);
            built.map_err(|error| BuildError::of_inputs(error, &options.inputs))
        }
        Imported::Spilled(mesh) => {
            let job = Job::begin(mesh.directory.clone(), options)?;
            job.build(options, Some(mesh), out, progress, watch)
        }
    }
}

/// Says it where textures take more memory than allowed.
fn note_maps(input: &Imported, memory: u64, progress: &dyn Progress) {
    let appearance = match input {
        Imported::Memory(surface) => &surface.appearance,
        Imported::Spilled(mesh) => &mesh.appearance,
    };
    let least = least_for_maps(appearance.texels);
    if least > memory {
        progress.note(&format!(
            "parts of these textures are baked at once, which takes about {}MiB, more than {MEMORY_OPTION} {}MiB",
            least >> 20,
            memory >> 20
        ));
    }
}

/// The directory for symbols and pages that do not fit in memory: beside the output.
fn scratch(options: &BuildOptions) -> PathBuf {
    let beside = options.work.parent().filter(|folder| folder.is_dir());
    beside.map_or_else(std::env::temp_dir, Path::to_owned)
}
