//! The ground under a mesh: what `build --ground` and `merge --ground` have in common.

use super::inputs::find_inputs;
use crate::args::RunArgs;
use crate::output::{bytes, count, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, anyhow, bail};
use lodpack::heights::Heights;
use lodpack::{GroundFrame, Limits, Opened, join_ground};
use lodpack_cli::heights::{HeightsOptions, build as build_heights};
use lodpack_cli::import::raster::{HeightSource, RasterOptions};
use lodpack_cli::job::{BuildOptions, FILE_EXTENSION, typed_raster};
use lodpack_cli::pipeline::ModelOptions;
use lodpack_cli::storage::default_memory;
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// A summary, and what it says of the ground beside it.
#[derive(Serialize)]
pub struct WithGround<T, G> {
    #[serde(flatten)]
    pub summary: T,
    /// None of a file without ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<G>,
}

/// What was put under a mesh.
#[derive(Serialize)]
pub struct Joined {
    samples: u64,
    bytes: u64,
    /// Of the file that holds both.
    total_bytes: u64,
}

/// The file that a mesh is written to: the output itself or, where it gets a ground, a file without a name before it.
pub struct Target {
    ground: Option<(Heights<File>, File)>,
}

/// A ground that is ready, and the files that it was made of.
pub struct Under {
    pub heights: Heights<File>,
    pub inputs: Vec<PathBuf>,
}

/// Heights of the rasters that were typed, or of one file that holds heights already; none where nothing was typed.
/// What will not fit under the mesh of `options` is refused here, and not after a long build. Options of rasters are
/// said of the ground, so the mesh loses them.
pub fn open(typed: &[PathBuf], options: &mut BuildOptions, run: &RunArgs, folder: &Path) -> Result<Option<Under>> {
    let paths = find_inputs(typed)?;
    let Some(first) = paths.first() else { return Ok(None) };
    let heights = open_any(first, &paths, &options.model, run, folder)?;
    if heights.surface().is_globe() {
        bail!("{}: heights on a globe cannot be the ground of a mesh; add --surface plane", first.display());
    }
    let RasterOptions { geoid, .. } = std::mem::take(&mut options.model.raster);
    let place = options.place()?;
    // No file is damaged by being elsewhere.
    let fits = GroundFrame::new(heights.placement(), place.as_ref()).map_err(|error| match error {
        lodpack::Error::Format { what, .. } => anyhow!(what),
        other => other.into(),
    });
    fits.with_context(|| {
        format!("{}: the ground does not fit under what the inputs, --crs and --origin say", first.display())
    })?;
    let inputs = paths.iter().cloned().chain(geoid).collect();
    Ok(Some(Under { heights, inputs }))
}

fn open_any(
    first: &Path,
    paths: &[PathBuf],
    model: &ModelOptions,
    run: &RunArgs,
    folder: &Path,
) -> Result<Heights<File>> {
    if first.extension().is_some_and(|extension| extension == FILE_EXTENSION) {
        if let Some(second) = paths.get(1) {
            bail!("{}: a file of heights is the whole ground; name no other --ground", second.display());
        }
        return open_file(first);
    }
    let progress = Terminal::new(run.progress, progress_bar::BUILD_HEIGHTS);
    let Some(source) = HeightSource::open(paths, &typed_raster(model), &progress)? else {
        bail!("{}: the ground is a raster of heights, or a file that was built from one", first.display());
    };
    let options = HeightsOptions {
        tolerance: model.tolerance,
        memory: run.memory.unwrap_or_else(default_memory),
        folder: folder.to_owned(),
        colour_quality: model.colour_quality,
    };
    let mut out = BufWriter::with_capacity(1 << 20, nameless_in(folder)?);
    build_heights(&source, &options, &mut out, &progress)?;
    progress.complete();
    let file =
        out.into_inner().map_err(|error| error.into_error()).context("cannot write the heights of the ground")?;
    Ok(Heights::open(file, Limits::default())?)
}

/// A file of heights.
pub fn open_file(path: &Path) -> Result<Heights<File>> {
    let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    match Opened::open(file, Limits::default()).with_context(|| path.display().to_string())? {
        Opened::Heights(heights) => Ok(heights),
        Opened::Mesh(_) => bail!(
            "{} holds a mesh; a ground is a file of heights, which `lodpack build --as heights` makes of a raster",
            path.display()
        ),
    }
}

/// A file without a name, which nobody has to remove.
pub fn nameless_in(folder: &Path) -> Result<File> {
    tempfile::tempfile_in(folder).with_context(|| format!("cannot write into {}", folder.display()))
}

impl Target {
    /// Where to write a mesh that becomes `output`, with this ground under it.
    pub fn new(output: File, ground: Option<Heights<File>>, folder: &Path) -> Result<(Self, File)> {
        Ok(match ground {
            None => (Self { ground: None }, output),
            Some(ground) => (Self { ground: Some((ground, output)) }, nameless_in(folder)?),
        })
    }

    /// The finished output, once the mesh is written.
    pub fn finish(self, mesh: File) -> Result<(File, Option<Joined>)> {
        match self.ground {
            None => Ok((mesh, None)),
            Some((ground, output)) => join(mesh, &ground, output).map(|(output, joined)| (output, Some(joined))),
        }
    }
}

/// Writes the file of a mesh again with a ground under it.
pub fn join(mut mesh: File, ground: &Heights<File>, output: File) -> Result<(File, Joined)> {
    mesh.rewind()?;
    let surface = lodpack::File::open(mesh, Limits::default())?;
    let mut out = BufWriter::with_capacity(1 << 20, output);
    let joined = join_ground(&surface, ground, &mut out);
    let total_bytes =
        joined.context("the ground does not fit under the mesh; check what --crs and --surface say of both")?;
    out.flush()?;
    let output = out.into_inner().map_err(|error| error.into_error())?;
    let [columns, rows] = ground.grid().samples();
    let bytes = ground.source().metadata()?.len();
    Ok((output, Joined { samples: columns * rows, bytes, total_bytes }))
}

/// Prints what was put under a mesh.
pub fn print(joined: &Joined) -> Result<()> {
    say!(
        "  ground     {} samples in {}; {} with the mesh",
        count(joined.samples),
        bytes(joined.bytes),
        bytes(joined.total_bytes)
    );
    Ok(())
}
