//! `lodpack export --as quantized-mesh`

use super::super::open::{Opened, open_any, tolerance_in_heights};
use super::super::print_json;
use crate::args::ExportArgs;
use crate::interrupt;
use crate::output::{PendingFolder, bound, bytes, count, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::progress::Progress;
use lodpack_cli::tileset::{ARCHIVE_EXTENSION, LAYER, is_on_wgs84, is_product, write_quantized};
use std::process::ExitCode;

/// Writes a file of heights as terrain tiles.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    interrupt::on_stop_leave_nothing();
    if args.local || args.up.is_some() {
        bail!("terrain tiles always lie on the globe, with z up: omit --local and --up");
    }
    if args.output.extension().is_some_and(|extension| extension == ARCHIVE_EXTENSION) {
        bail!("{}: terrain tiles go into a folder; name one with -o", args.output.display());
    }
    let folder = PendingFolder::create(&args.output, args.force, is_product)?;
    let name = args.file.display();
    let Opened::Heights(file) = open_any(&args.file)? else {
        bail!("{name} holds a mesh, and only grids of heights become terrain tiles; export it --as 3dtiles");
    };
    if !is_on_wgs84(file.surface()) {
        bail!(
            "{name} does not lie on the ellipsoid of WGS 84, on which terrain tiles lie; build it from a raster in degrees with --as heights --surface wgs84"
        );
    }
    let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(&file, tolerance)).transpose()?;
    let progress = Terminal::new(args.progress, progress_bar::EXPORT);
    progress.begin("index", 0);
    let written = write_quantized(&file, folder.unfinished(), tolerance, &progress);
    let summary = written.with_context(|| format!("cannot export {name}"))?;
    folder.finish()?;
    progress.complete();
    if args.json {
        print_json(&summary)?;
        return Ok(ExitCode::SUCCESS);
    }
    say!("{}", args.output.join(LAYER).display());
    say!("  tiles      {}, in {} levels; {} in all", count(summary.tiles), summary.levels, bytes(summary.bytes));
    say!(
        "  triangles  {}, of which the finest level has {}; no sample of the input is more than {} m off these",
        count(summary.triangles),
        count(summary.finest_triangles),
        bound(summary.finest_error)
    );
    Ok(ExitCode::SUCCESS)
}
