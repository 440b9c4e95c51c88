//! `lodpack verify`

use super::ground::WithGround;
use super::heights;
use super::inputs::find_inputs;
use super::open::{Opened, in_file, open_ground_in, source_of_all, try_open_in};
use super::{print_json, use_threads};
use crate::args::{ProgressStyle, VerifyArgs};
use crate::interrupt;
use crate::messages;
use crate::output::{count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result};
use lodpack_cli::import::raster::is_raster;
use lodpack_cli::import::{import_named, import_shape};
use lodpack_cli::measure::verify::{NamedMesh, Problem, VerifyOptions, VerifyReport, verify, verify_objects};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::attributes::{ObjectNode, Surface};
use lodpack_cli::progress::Progress;
use lodpack_cli::stage::repair::{repair, repair_with_origins};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Checks a file; exit status 1 if it is unsound.
pub fn run(args: &VerifyArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    interrupt::on_stop_leave_nothing();
    let (name, meshes) = file_and_meshes(args.file.as_deref(), &args.against)
        .context("no file to verify; type lodpack verify FILE, or lodpack verify FILE --against MESH")?;
    let meshes = &find_inputs(meshes)?;
    let stages = if meshes.is_empty() { progress_bar::VERIFY } else { progress_bar::VERIFY_AGAINST };
    let progress = Terminal::new(ProgressStyle::Auto, stages);
    let source = source_of_all(name, &progress)?;
    let opened = match try_open_in(name, &source)? {
        Ok(Opened::Heights(file)) => {
            let is_sound = heights::verify::run(&file, meshes, progress, args, name)?;
            return Ok(if is_sound { ExitCode::SUCCESS } else { ExitCode::from(1) });
        }
        Ok(Opened::Mesh(file)) => Ok(file),
        Err(error) => Err(error),
    };
    // What is wrong with a ground that cannot be opened, the check of the mesh finds, too.
    let ground =
        opened.as_ref().ok().map(|file| open_ground_in(name, source, file)).transpose().unwrap_or_default().flatten();
    let (rasters, meshes): (Vec<PathBuf>, Vec<PathBuf>) =
        meshes.iter().cloned().partition(|path| ground.is_some() && is_raster(path));
    let meshes = &meshes;
    let against = if meshes.is_empty() {
        None
    } else {
        progress.begin("import", 0);
        // Stored errors are distances to the repaired surface; repair moves no point and drops no area.
        let raster = args.raster.options().like_file(opened.as_ref().ok().and_then(|file| file.placement()));
        let has_objects = opened.as_ref().is_ok_and(|file| file.objects().is_some());
        Some(if has_objects {
            Against::with_objects(import_named(meshes, &raster, &progress)?)
        } else {
            let (mesh, ..) = repair(import_shape(meshes, &raster, &progress)?);
            Against { mesh, ..Against::default() }
        })
    };
    let report = match opened {
        Ok(file) => {
            let options = VerifyOptions { cuts: args.cuts, seed: args.seed };
            let mesh = against.as_ref().map(|against| &against.mesh);
            let mut report = in_file(name, verify(&file, mesh, &options, &progress))?;
            let is_sound = report.problems.is_empty();
            if let Some(Against { mesh, objects, nodes }) = against.as_ref().filter(|_| is_sound) {
                // Files are assemblies by their names, which may have changed.
                let named = NamedMesh { mesh, objects, nodes, skipped: usize::from(meshes.len() > 1) };
                match (nodes.is_empty(), file.objects().is_some()) {
                    (true, true) => progress.note("the mesh names no objects: those of the file are not compared"),
                    _ => in_file(name, verify_objects(&file, &named, &mut report, &progress))?,
                }
            }
            report
        }
        Err(error) => {
            let problem = Problem { location: "file".into(), what: messages::with_reasons(&error) };
            VerifyReport { problems: vec![problem], ..VerifyReport::default() }
        }
    };
    let of_ground = match ground.filter(|_| report.problems.is_empty()) {
        Some((ground, _)) => Some(heights::verify::check(&ground, &rasters, &progress, args, name)?),
        None => None,
    };
    drop(progress);
    let problems = report.problems.len() + of_ground.as_ref().map_or(0, |ground| ground.problems.len());
    if args.json {
        print_json(&WithGround { summary: report, ground: of_ground })?;
    } else {
        print(&report, name)?;
        if let Some(ground) = &of_ground {
            say!("its ground:");
            heights::verify::print(ground, name)?;
        }
    }
    Ok(if problems == 0 { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// What a file is compared with: its repaired input, and the objects of that if the file has some.
#[derive(Default)]
struct Against {
    mesh: Mesh,
    objects: Vec<u32>,
    nodes: Vec<ObjectNode>,
}

impl Against {
    fn with_objects(Surface { mesh, attributes, .. }: Surface) -> Self {
        let of_triangles: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| attributes.object(t)).collect();
        let (mesh, .., origins) = repair_with_origins(mesh, &of_triangles);
        let objects = origins.iter().map(|&(triangle, _)| of_triangles[triangle as usize]).collect();
        Self { mesh, objects, nodes: attributes.nodes }
    }
}

/// The file, and the meshes that it is compared with. If no file comes before `--against`, its last value is the file.
pub fn file_and_meshes<'a>(file: Option<&'a Path>, against: &'a [PathBuf]) -> Option<(&'a Path, &'a [PathBuf])> {
    match (file, against) {
        (Some(file), meshes) => Some((file, meshes)),
        (None, [meshes @ .., file]) if !meshes.is_empty() => Some((file, meshes)),
        _ => None,
    }
}

fn print(report: &VerifyReport, file: &Path) -> Result<()> {
    for level in &report.levels {
        say!(
            "level {:<3} {:>12} triangles   stored {:>10}   measured {:>10}   ratio median {:.3} max {:.3}   vertex RMS {}",
            level.level,
            count(level.triangles),
            length(level.stored),
            length(level.measured),
            level.ratio_median,
            level.ratio_max,
            length(level.vertex_rms)
        );
    }
    if let Some(ratio) = report.ratio_median {
        say!("stored over measured error, median over all roots and levels: {ratio:.3}");
    }
    if report.objects > 0 {
        say!("{} objects compared one by one", count(report.objects));
    }
    if let Some(boundary_edges) = report.boundary_edges {
        say!(
            "{} random cuts, {} boundary edges at the finest level, {} edges with more than two triangles over all cuts",
            count(report.cuts.into()),
            count(boundary_edges),
            count(report.crowded_edges)
        );
    }
    const SHOWN: usize = 20;
    for problem in report.problems.iter().take(SHOWN) {
        say!("PROBLEM {}: {}", problem.location, problem.what);
    }
    if report.problems.len() > SHOWN {
        say!("... and {} more problems", report.problems.len() - SHOWN);
    }
    if report.problems.is_empty() {
        say!("{}: sound", file.display());
    }
    Ok(())
}
