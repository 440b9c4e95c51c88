//! `lodpack export`

use super::open::{Opened, Source, in_file, open_any, open_ground, tolerance_in, tolerance_in_heights};
use super::{levels, print_json, use_threads};
use crate::args::{ExportArgs, ExportFormat, GroundChoice, NormalsChoice, UpAxis};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFile, PendingFolder, bound, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack::heights::Heights;
use lodpack::index::{Placement, UpAxis as AxisUp};
use lodpack_cli::progress::Progress;
use lodpack_cli::tileset::{
    ARCHIVE_EXTENSION, ENTRY, Frame, Projection, TilesetOptions, TilesetSummary, bounds_of, folder_of, is_product,
    place, write_archive, write_joined, write_terrain, write_tileset,
};
use std::fs::File;
use std::path::Path;
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
    let file = match open_any(&args.file)? {
        Opened::Mesh(mesh) if args.ground == GroundChoice::Only => match open_ground(&args.file, &mesh)? {
            Some((ground, _)) => Opened::Heights(ground),
            None => bail!("{}: its mesh stands on no ground; omit --ground only", args.file.display()),
        },
        file => file,
    };
    let stages = if product.archive.is_some() { progress_bar::EXPORT_ARCHIVE } else { progress_bar::EXPORT };
    let progress = Terminal::new(args.progress, stages);
    let folder = product.folder.unfinished();
    let cannot_export = || format!("cannot export {}", args.file.display());
    let summary = match &file {
        Opened::Mesh(file) if file.index().ground_range().is_some() && args.ground != GroundChoice::None => {
            both(file, args, folder, &progress)?
        }
        Opened::Mesh(file) => {
            let options = TilesetOptions {
                tolerance: args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?,
                frame: frame(file, args)?,
                with_channels: args.channels == "auto",
                with_normals: args.normals == NormalsChoice::Smooth,
            };
            write_tileset(file, folder, &options, &progress).with_context(cannot_export)?
        }
        Opened::Heights(file) => {
            let (frame, projection) = frame_of_heights(file, args)?;
            let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(file, tolerance)).transpose()?;
            let options = TilesetOptions { tolerance, frame, with_channels: false, with_normals: true };
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

/// A mesh and its ground, each as a tileset in a folder of its own, in one that leads to both.
fn both(
    file: &lodpack::File<Source>,
    args: &ExportArgs,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<TilesetSummary> {
    let name = args.file.display();
    let cannot_export = || format!("cannot export {name}");
    if args.up.is_some() {
        bail!("{name}: --up would turn the mesh and not its ground; add --ground none, or build the file with --up");
    }
    let Some((ground, to_mesh)) = open_ground(&args.file, file)? else { bail!("{name}: its mesh stands on no ground") };
    let [mut of_mesh, mut of_ground] =
        [file.placement(), ground.placement()].map(|placement| placement.cloned().unwrap_or_default());
    // A ground goes along z, and a mesh on it, unless it says that y is up.
    of_ground.up = AxisUp::Z;
    if of_mesh.up == AxisUp::Unknown {
        of_mesh.up = AxisUp::Z;
    }
    // They are in the same space, so what one says of it counts for both.
    let crs = if of_mesh.crs.is_empty() { of_ground.crs.clone() } else { of_mesh.crs.clone() };
    let crs = if args.local { String::new() } else { crs };
    (of_mesh.crs, of_ground.crs) = (crs.clone(), crs);
    if args.local {
        of_ground.origin = [0, 1, 2].map(|k| of_ground.origin[k] - of_mesh.origin[k]);
        of_mesh.origin = [0.0; 3];
    }
    let tolerance = args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?;
    let frame = frame_of(&of_mesh, file.bounds().unwrap_or_default(), certified_of(file), args)?;
    let (with_channels, with_normals) = (args.channels == "auto", args.normals == NormalsChoice::Smooth);
    let options = TilesetOptions { tolerance, frame, with_channels, with_normals };
    let mesh = write_tileset(file, &folder.join(folder_of(0)), &options, progress).with_context(cannot_export)?;
    let bounds = in_file(&args.file, bounds_of(&ground))?;
    let projection = Projection::of(&of_ground);
    // This also says whether there is such a place at all.
    let placed =
        frame_of(&of_ground, bounds, if projection.is_some() { f64::MAX } else { ground.info().sample_error }, args)?;
    let frame = if projection.is_some() { Frame::local(false) } else { placed };
    let tolerance = tolerance.map(|tolerance| tolerance / to_mesh.scale());
    let options = TilesetOptions { tolerance, frame, with_channels: false, with_normals: true };
    let terrain = write_terrain(&ground, &folder.join(folder_of(1)), &options, projection.as_ref(), progress);
    let mut terrain = terrain.with_context(cannot_export)?;
    terrain.certified_error *= to_mesh.scale();
    write_joined(folder, &[mesh, terrain]).with_context(cannot_export)
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
    let placement = file.placement().cloned().unwrap_or_default();
    frame_at(placement, file.bounds().unwrap_or_default(), certified_of(file), args)
}

/// The error of the finest level.
fn certified_of(file: &lodpack::File<Source>) -> f64 {
    file.level_count().checked_sub(1).and_then(|level| file.level(level)).map_or(0.0, |level| level.max_error)
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
    frame_of(&placement, bounds, certified, args)
}

/// The frame of a placement as it is.
fn frame_of(placement: &Placement, bounds: [[f64; 3]; 2], certified: f64, args: &ExportArgs) -> Result<Frame> {
    let placed = place(placement, args.up.map(UpAxis::axis), bounds)
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
    say!("  finest     {} triangles, certified error {}", count(s.finest_triangles), bound(s.certified_error));
    say!("  first      {} in {} requests show everything", bytes(s.first_picture_bytes), s.first_picture_requests);
    Ok(())
}
