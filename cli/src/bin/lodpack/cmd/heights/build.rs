//! Building files of heights.

use super::super::print_json;
use super::image_line;
use crate::args::BuildArgs;
use crate::interrupt;
use crate::output::{PendingFile, bound, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::heights::{HeightsOptions, HeightsSummary, build as build_heights};
use lodpack_cli::import::raster::HeightSource;
use lodpack_cli::job::typed_raster;
use lodpack_cli::pipeline::ColourQuality;
use lodpack_cli::storage::default_memory;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Builds a file of heights, and prints a summary.
pub fn build(args: &BuildArgs, inputs: &[PathBuf], output: &Path) -> Result<ExitCode> {
    let model = args.model.options();
    let folder = args.temp.clone().or_else(|| output.parent().map(Path::to_owned)).unwrap_or_default();
    let folder = if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder };
    let options = HeightsOptions {
        tolerance: model.tolerance,
        memory: args.run.memory.unwrap_or_else(default_memory),
        folder,
        colour_quality: model.colour_quality,
    };
    let (pending, file) = PendingFile::create(output, args.force, inputs.iter().map(|p| p.as_path()))?;
    interrupt::on_stop_leave_nothing();
    let mut out = BufWriter::with_capacity(1 << 20, file);
    let summary = {
        let progress = Terminal::new(args.run.progress, progress_bar::BUILD_HEIGHTS);
        let Some(source) = HeightSource::open(inputs, &typed_raster(&model), &progress)? else {
            bail!("--as heights is for rasters of heights, and the inputs are none; omit it");
        };
        if source.drape.is_none() && model.colour_quality != ColourQuality::Auto {
            bail!("--color-quality is for an image over the heights; add one with --drape, or omit it");
        }
        let summary = build_heights(&source, &options, &mut out, &progress)?;
        let written = out.into_inner().map_err(|error| error.into_error());
        pending.finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
        progress.complete();
        summary
    };
    if args.json {
        print_json(&summary)?;
    } else {
        print(&summary, output)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints the summary.
pub fn print(s: &HeightsSummary, output: &Path) -> Result<()> {
    say!("{}", output.display());
    say!("  holds      heights on the grid of the raster; --as mesh makes triangles of it");
    say!("  input      {} samples, {} x {} cells", count(s.samples), count(s.cells[0]), count(s.cells[1]));
    say!("  tiles      {} in {} depths, {} triangles at the finest", count(s.tiles), s.depth + 1, count(s.triangles));
    let image = s.drape.as_ref();
    let of = if image.is_some() { " of the heights" } else { "" };
    say!("  size       {}, {:.2} bits per sample{of}", bytes(s.bytes), s.bits_per_sample);
    if let Some(image) = image {
        say!("{}", image_line(image.size, image.components, image.bytes));
    }
    say!(
        "  error      samples {} at most, surface {} certified, tolerance {}",
        bound(s.sample_error),
        bound(s.certified_error),
        length(s.tolerance)
    );
    let stages: Vec<String> = s.stages.iter().map(|t| format!("{} {:.2}", t.stage, t.cpu_seconds)).collect();
    say!("  CPU        {:.2} s ({})", s.cpu_seconds, stages.join(", "));
    say!("  elapsed    {:.2} s, peak memory {}", s.wall_seconds, bytes(s.peak_memory_bytes));
    Ok(())
}
