//! Rasters of files of heights.

use super::super::open::{Opened, in_file, open_any, open_ground, tolerance_in_heights};
use super::super::print_json;
use crate::args::{ExtractArgs, ProgressStyle};
use crate::messages;
use crate::output::{PendingFile, bound, bytes, count, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::heights::{Georeference, raster_window_of, rounding_of, write_geotiff};
use serde::Serialize;
use std::process::ExitCode;

#[derive(Serialize)]
struct RasterSummary {
    columns: u64,
    rows: u64,
    /// Samples of the grid from one to the next.
    stride: u64,
    /// Samples without data.
    missing: u64,
    /// Of the surface of these samples, as they are written.
    certified_error: f64,
    tolerance: Option<f64>,
    bytes_read: u64,
    requests: u64,
}

/// Writes a window of a grid as GeoTIFF.
pub fn run(args: &ExtractArgs) -> Result<ExitCode> {
    let name = args.file.display();
    if args.triangles.is_some() || args.nodes.is_some() || args.context {
        bail!("{name}: a raster has no triangles and no nodes: choose it with --bbox and --tolerance");
    }
    let (pending, out) = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
    // A box in the coordinates of a mesh is one in those of its ground, too.
    let (file, bounds) = match open_any(&args.file)? {
        Opened::Heights(file) => (file, args.bbox.map(|bbox| bbox.0)),
        Opened::Mesh(mesh) => match open_ground(&args.file, &mesh)? {
            Some((ground, frame)) => (ground, args.bbox.map(|bbox| frame.bounds_of_ground(bbox.0))),
            None => {
                bail!("{name} holds a mesh, and only grids of heights become rasters; write .ply, .obj, .stl or .glb")
            }
        },
    };
    let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(&file, tolerance)).transpose()?;
    let bounds = bounds.map(|bounds| bounds.map(|[x, y, _]| [x, y]));
    let window = match raster_window_of(&file, bounds, tolerance) {
        Err(lodpack::Error::Query { .. }) => {
            bail!("{name}: nothing touches the box; the grid reaches {}", super::reach(&file))
        }
        window => in_file(&args.file, window)?,
    };
    let progress = Terminal::new(ProgressStyle::Auto, progress_bar::RASTER);
    let missing = write_geotiff(&file, &window, &out, &progress);
    let missing = missing.with_context(|| format!("cannot write {} from {name}", args.output.display()))?;
    let size = out.metadata().map_or(0, |metadata| metadata.len());
    pending.finish(out)?;
    progress.complete();
    for note in Georeference::of(&file, &window).notes {
        messages::tell("note", &format!("{}: {note}", args.output.display()));
    }
    let summary = RasterSummary {
        columns: window.size[0],
        rows: window.size[1],
        stride: window.stride,
        missing,
        certified_error: window.error + in_file(&args.file, rounding_of(&file, &window))?,
        tolerance,
        bytes_read: file.source().byte_count(),
        requests: file.source().read_count(),
    };
    if args.json {
        print_json(&summary)?;
        return Ok(ExitCode::SUCCESS);
    }
    let every =
        if window.stride == 1 { String::new() } else { format!(", one of {} in each direction", window.stride) };
    say!(
        "{}: {} x {} samples{every}, certified error {}; {} written, {} read in {} requests",
        args.output.display(),
        count(summary.columns),
        count(summary.rows),
        bound(summary.certified_error),
        bytes(size),
        bytes(summary.bytes_read),
        summary.requests
    );
    Ok(ExitCode::SUCCESS)
}
