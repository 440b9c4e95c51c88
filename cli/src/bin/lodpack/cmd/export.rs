//! `lodpack export`

use super::open::{Source, open, tolerance_in};
use super::{print_json, use_threads};
use crate::args::{ExportArgs, ExportFormat, UpAxis};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFolder, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result};
use lodpack::File;
use lodpack::index::Placement;
use lodpack_cli::tileset::{ENTRY, Frame, TilesetOptions, TilesetSummary, is_product, place, write_tileset};
use std::process::ExitCode;

/// Writes a file in a format of levels.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    interrupt::on_stop_leave_nothing();
    // An unsuitable output is refused before anything is read.
    let output = PendingFolder::create(&args.output, args.force, is_product)?;
    let file = open(&args.file)?;
    let tolerance = args.tolerance.map(|tolerance| tolerance_in(&file, tolerance)).transpose()?;
    let progress = Terminal::new(args.progress, progress_bar::EXPORT);
    let summary = match args.format {
        ExportFormat::Tiles3d => {
            let options =
                TilesetOptions { tolerance, frame: frame(&file, args)?, with_channels: args.channels == "auto" };
            write_tileset(&file, output.unfinished(), &options, &progress)
                .with_context(|| format!("cannot export {}", args.file.display()))?
        }
    };
    output.finish()?;
    progress.complete();
    if args.json {
        print_json(&summary)?
    } else {
        print(&summary, args)?
    }
    Ok(ExitCode::SUCCESS)
}

/// Where the file says that it is, or a local frame.
fn frame(file: &File<Source>, args: &ExportArgs) -> Result<Frame> {
    let mut placement = file.placement().cloned().unwrap_or_default();
    if args.local {
        placement = Placement { crs: String::new(), origin: [0.0; 3], ..placement };
    }
    let placed = place(&placement, args.up.map(UpAxis::axis), file.bounds().unwrap_or_default())
        .with_context(|| format!("cannot export {}", args.file.display()))?;
    let unit = placement.unit.unwrap_or(1.0);
    let certified =
        file.level_count().checked_sub(1).and_then(|level| file.level(level)).map_or(0.0, |level| level.max_error);
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
    say!("{}", args.output.join(ENTRY).display());
    say!("  tiles      {}, in {} files of JSON; {} in all", count(s.tiles), count(s.tilesets), bytes(s.bytes));
    say!("  triangles  {}, of which borders at their finest add {share:.1} %", count(s.triangles));
    say!("  finest     {} triangles, certified error {}", count(s.finest_triangles), length(s.certified_error));
    say!("  first      {} in {} requests show everything", bytes(s.first_picture_bytes), s.first_picture_requests);
    Ok(())
}
