//! `lodpack export --as glb-lod`: all levels as nodes of one GLB.

use super::open::{Opened, Source, in_file, open_any, tolerance_in};
use super::print_json;
use crate::args::{ExportArgs, NormalsChoice};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFile, bound, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack::decode::PagedMesh as Pages;
use lodpack::index::UpAxis as AxisUp;
use lodpack_cli::mesh::encoded::Formats;
use lodpack_cli::mesh::export::{MeshFormat, rounding};
use lodpack_cli::mesh::glb::{GlbLevel, add_rounding, screen_coverages, write_levels_glb};
use lodpack_cli::mesh::layers::Look;
use lodpack_cli::mesh::pages::PagedMesh;
use lodpack_cli::mesh::upright::Upright;
use lodpack_cli::progress::Progress;
use serde::Serialize;
use std::process::ExitCode;

/// A level is left out unless the finer one has this many times its triangles.
const FEWER: f64 = 1.25;
/// Rounding to single precision is noted from this share of the finest error on.
const NOTABLE_ROUNDING: f64 = 0.1;

#[derive(Serialize)]
struct Summary {
    bytes: u64,
    /// The finest first.
    levels: Vec<LevelSummary>,
}

#[derive(Serialize)]
struct LevelSummary {
    name: String,
    triangles: usize,
    certified_error: f64,
    /// The least share of the picture that the model's bounding sphere covers while the level is shown.
    screen_coverage: f64,
}

/// Writes the levels of a file.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    interrupt::on_stop_leave_nothing();
    if args.output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("glb")) {
        bail!("{}: levels go into one file, whose name must end in .glb", args.output.display());
    }
    let (pending, out) = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
    let Opened::Mesh(file) = open_any(&args.file)? else {
        bail!(
            "{}: heights have no levels that are drawn alone; export them --as 3dtiles, or extract a mesh",
            args.file.display()
        );
    };
    if file.index().ground_range().is_some() {
        messages::tell("note", "the ground that the mesh stands on is left out; --as 3dtiles has both");
    }
    let progress = Terminal::new(args.progress, progress_bar::EXPORT_LEVELS);
    let (mut levels, formats) = levels_of(&file, args, &progress)?;
    add_rounding(&mut levels);
    let Some(finest) = levels.first() else { bail!("{}: the file has no triangle", args.file.display()) };
    let moved = rounding(MeshFormat::Glb, &finest.mesh.positions);
    if moved > finest.error * NOTABLE_ROUNDING {
        let moved = length(moved);
        messages::tell(
            "note",
            &format!("single precision moves coordinates by up to {moved}; tiles do not (--as 3dtiles)"),
        );
    }
    let cannot_write = || format!("cannot write {}", args.output.display());
    write_levels_glb(&out, &levels, formats, upright(&file, args)).with_context(cannot_write)?;
    let byte_count = out.metadata().with_context(cannot_write)?.len();
    pending.finish(out)?;
    progress.complete();
    let of_level = |(level, screen_coverage): (&GlbLevel, f64)| LevelSummary {
        name: level.name.clone(),
        triangles: level.mesh.triangles.iter().map(Vec::len).sum(),
        certified_error: level.error,
        screen_coverage,
    };
    let coverages = screen_coverages(&levels);
    let summary = Summary { bytes: byte_count, levels: levels.iter().zip(coverages).map(of_level).collect() };
    match args.json {
        true => print_json(&summary)?,
        false => print(&summary, args)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// The levels that are worth their bytes, the finest first, and the formats of their images.
fn levels_of(
    file: &lodpack::File<Source>,
    args: &ExportArgs,
    progress: &dyn Progress,
) -> Result<(Vec<GlbLevel>, Formats)> {
    let tolerance = args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?;
    let (look, channels) = if args.channels == "auto" { Look::of(file.channels(), true) } else { Default::default() };
    let errors: Vec<f64> =
        (0..file.level_count()).map_while(|level| file.level(level)).map(|level| level.max_error).collect();
    let is_enough = |error: &f64| tolerance.is_some_and(|tolerance| *error <= tolerance);
    let count = errors.iter().position(is_enough).map_or(errors.len(), |level| level + 1);
    progress.begin("levels", count as u64);
    let read = |level: usize| -> Result<GlbLevel> {
        let cut = in_file(&args.file, file.uniform_cut(level as u8))?;
        let with_normals = args.normals == NormalsChoice::Smooth;
        let mesh = if channels.is_empty() {
            let mesh = in_file(&args.file, file.extract(&cut))?;
            if with_normals { PagedMesh::bare(&mesh)? } else { PagedMesh::without_normals(mesh) }
        } else {
            let textured = in_file(&args.file, file.extract_textured(&cut, &channels))?;
            let paged = PagedMesh::new(&textured, &look, Pages::SIDE);
            if with_normals { paged.smooth(&textured.mesh)? } else { paged }
        };
        Ok(GlbLevel { mesh, name: String::new(), error: cut.error })
    };
    let triangle_count = |level: &GlbLevel| level.mesh.triangles.iter().map(Vec::len).sum::<usize>();
    let mut levels: Vec<GlbLevel> = vec![];
    for level in (0..count).rev() {
        let read = read(level)?;
        progress.advance(1);
        let fewer = |finer: &GlbLevel| triangle_count(&read) as f64 * FEWER <= triangle_count(finer) as f64;
        if triangle_count(&read) > 0 && levels.last().is_none_or(fewer) {
            // Engines that do not know the extension go by these names.
            levels.push(GlbLevel { name: format!("lodpack_LOD{}", levels.len()), ..read });
        }
    }
    Ok((levels, Formats::of(&look)))
}

/// The axis that points up and the unit, as typed or as the file says.
fn upright(file: &lodpack::File<Source>, args: &ExportArgs) -> Upright {
    let upright = Upright::of(file.placement());
    Upright { is_z_up: args.up.map_or(upright.is_z_up, |up| up.axis() == AxisUp::Z), ..upright }
}

fn print(summary: &Summary, args: &ExportArgs) -> Result<()> {
    say!("{}: {} levels, {}", args.output.display(), summary.levels.len(), bytes(summary.bytes));
    for level in &summary.levels {
        let share = 100.0 * level.screen_coverage;
        let triangles = count(level.triangles as u64);
        say!(
            "  {}  {triangles:>12} triangles   error {:>10}   from {share:.3} % of the picture on",
            level.name,
            bound(level.certified_error)
        );
    }
    Ok(())
}
