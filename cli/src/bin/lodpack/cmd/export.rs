//! `lodpack export`

use super::open::{Opened, Source, in_file, open_any, tolerance_in, tolerance_in_heights};
use super::{levels, print_json, use_threads};
use crate::args::{ExportArgs, ExportFormat, UpAxis};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFile, PendingFolder, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result};
use lodpack::heights::Heights;
use lodpack::index::{Placement, UpAxis as AxisUp};
use lodpack_cli::progress::Progress;
use lodpack_cli::tileset::{
    ARCHIVE_EXTENSION, ENTRY, Frame, Projection, TilesetOptions, TilesetSummary, bounds_of, is_product, place,
    write_archive, write_terrain, write_tileset,
};
use std::fs::File;
use std::process::ExitCode;

/// Writes a file in a format of levels.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    match args.format {
        ExportFormat::GlbLod => return levels::run(args),
        ExportFormat::QuantizedMesh => return super::heights::quantized::run(args),
        ExportFormat::Tiles3d => {}
    }
    interrupt::on_stop_leave_nothing();
    // An unsuitable output is refused before anything is read.
    let product = Product::create(args)?;
    let file = open_any(&args.file)?;
    let stages = if product.archive.is_some() { progress_bar::EXPORT_ARCHIVE } else { progress_bar::EXPORT };
    let progress = Terminal::new(args.progress, stages);
    let folder = product.folder.unfinished();
    let cannot_export = || format!("cannot export {}", args.file.display());
    let summary = match &file {
        Opened::Mesh(file) => {
            let options = TilesetOptions {
                tolerance: args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?,
                frame: frame(file, args)?,
                with_channels: args.channels == "auto",
            };
            write_tileset(file, folder, &options, &progress).with_context(cannot_export)?
        }
        Opened::Heights(file) => {
            let (frame, projection) = frame_of_heights(file, args)?;
            let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(file, tolerance)).transpose()?;
            let options = TilesetOptions { tolerance, frame, with_channels: false };
            write_terrain(file, folder, &options, projection.as_ref(), &progress).with_context(cannot_export)?
        }
    };
    let summary = TilesetSummary { bytes: product.finish(args, &progress)?.unwrap_or(summary.bytes), ..summary };
    progress.complete();
    if args.json {
        print_json(&summary)?
    } else {
        print(&summary, args)?
    }
    Ok(ExitCode::SUCCESS)
}

/// What is written: a folder, or an archive of a folder that does not stay.
struct Product {
    folder: PendingFolder,
    archive: Option<(PendingFile, File)>,
}

impl Product {
    fn create(args: &ExportArgs) -> Result<Self> {
        if args.output.extension().is_none_or(|extension| extension != ARCHIVE_EXTENSION) {
            return Ok(Self { folder: PendingFolder::create(&args.output, args.force, is_product)?, archive: None });
        }
        let archive = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
        let mut beside = args.output.clone().into_os_string();
        beside.push(".tiles");
        Ok(Self { folder: PendingFolder::create(beside.as_ref(), args.force, is_product)?, archive: Some(archive) })
    }

    /// Ends the folder, or packs it; returns the bytes of an archive.
    fn finish(self, args: &ExportArgs, progress: &dyn Progress) -> Result<Option<u64>> {
        let Some((pending, file)) = self.archive else {
            self.folder.finish()?;
            return Ok(None);
        };
        let cannot_write = || format!("cannot write {}", args.output.display());
        let packed = file.try_clone().and_then(|file| write_archive(self.folder.unfinished(), file, progress));
        let bytes = packed.with_context(cannot_write)?;
        pending.finish(file)?;
        Ok(Some(bytes))
    }
}

/// Where the file says that it is, or a local frame.
fn frame(file: &lodpack::File<Source>, args: &ExportArgs) -> Result<Frame> {
    let certified =
        file.level_count().checked_sub(1).and_then(|level| file.level(level)).map_or(0.0, |level| level.max_error);
    let placement = file.placement().cloned().unwrap_or_default();
    frame_at(placement, file.bounds().unwrap_or_default(), certified, args)
}

/// The same of heights, which have z up; or the projection in which they are, whose places are on the globe already.
fn frame_of_heights(file: &Heights<Source>, args: &ExportArgs) -> Result<(Frame, Option<Projection>)> {
    let placement = file.placement().cloned().unwrap_or_default();
    let up = if placement.up == AxisUp::Unknown { AxisUp::Z } else { placement.up };
    let placement = Placement { up, ..placement };
    let bounds = in_file(&args.file, bounds_of(file))?;
    if args.local || args.up.is_some() {
        return Ok((frame_at(placement, bounds, file.info().sample_error, args)?, None));
    }
    match Projection::of(&placement) {
        Some(projection) => {
            // Whether there is such a place at all.
            place(&placement, None, bounds).with_context(|| format!("cannot export {}", args.file.display()))?;
            Ok((Frame::local(false), Some(projection)))
        }
        None => Ok((frame_at(placement, bounds, file.info().sample_error, args)?, None)),
    }
}

fn frame_at(mut placement: Placement, bounds: [[f64; 3]; 2], certified: f64, args: &ExportArgs) -> Result<Frame> {
    if args.local {
        placement = Placement { crs: String::new(), origin: [0.0; 3], ..placement };
    }
    let placed = place(&placement, args.up.map(UpAxis::axis), bounds)
        .with_context(|| format!("cannot export {}", args.file.display()))?;
    let unit = placement.unit.unwrap_or(1.0);
    if placed.deviation > certified * unit {
        let moved = length(placed.deviation);
        let text = format!(
            "the corners of the box are up to {moved} m off their place on the globe, because tiles of one file are flat; export smaller files to \
             follow it closer"
        );
        messages::tell("note", &text);
    }
    Ok(placed.frame)
}

fn print(s: &TilesetSummary, args: &ExportArgs) -> Result<()> {
    let share = 100.0 * s.border_triangles as f64 / (s.triangles - s.border_triangles).max(1) as f64;
    match args.output.extension().is_some_and(|extension| extension == ARCHIVE_EXTENSION) {
        true => say!("{}", args.output.display()),
        false => say!("{}", args.output.join(ENTRY).display()),
    }
    say!("  tiles      {}, in {} files of JSON; {} in all", count(s.tiles), count(s.tilesets), bytes(s.bytes));
    say!("  triangles  {}, of which borders add {share:.1} %", count(s.triangles));
    say!("  finest     {} triangles, certified error {}", count(s.finest_triangles), length(s.certified_error));
    say!("  first      {} in {} requests show everything", bytes(s.first_picture_bytes), s.first_picture_requests);
    Ok(())
}
