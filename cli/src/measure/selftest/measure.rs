//! Makes one row: generates, builds, verifies and measures.

use super::{Measured, Outcome, Row, RowId};
use crate::geometry_images::{AtlasOptions, build_atlas};
use crate::import::import_meshes;
use crate::job::{BuildError, BuildOptions, build};
use crate::machine::{peak_memory_bytes, process_cpu_time};
use crate::measure::verify::distance::{BoxTree, Goal, largest_distance};
use crate::measure::verify::{VerifyOptions, verify};
use crate::mesh::Mesh;
use crate::mesh::export::{MeshFormat, write_mesh};
use crate::pipeline::summary::BuildSummary;
use crate::pipeline::{Fillings, ModelOptions};
use crate::progress::Silent;
use crate::stage::repair::repair;
use glam::DVec3;
use lodpack::{File, Limits, Query, ReadAt, index::Filling};
use std::collections::HashSet;
use std::path::Path;

/// Random cuts stitched and inspected per file.
const CUTS: u32 = 20;
const SEED: u64 = 6;
/// Points in each direction at which distances are sampled.
const POINTS: usize = 400;
/// Problems of a file that are listed one by one.
const TOLD: usize = 3;
/// Meshes with more triangles are built with the default options only.
const MOST_TRIANGLES_TWICE: usize = 100_000;

/// Builds and verifies one position of a dial, with a file in `directory`. The row records everything that goes wrong.
///
/// # Errors
///
/// If the directory cannot be written.
pub fn run_row(id: RowId, memory: u64, directory: &Path) -> std::io::Result<Row> {
    let mut row = Row { case: id.case.name.into(), dial: id.dial, ..Row::default() };
    let input = id.case.input(id.dial);
    row.triangles = input.mesh.triangles.len() as u64;
    let path = directory.join("mesh.ply");
    let positions: Vec<[f64; 3]> = input.mesh.positions.iter().map(|p| p.to_array()).collect();
    write_mesh(std::fs::File::create(&path)?, MeshFormat::Ply, &positions, &input.mesh.triangles)?;
    drop(positions);

    let options = BuildOptions {
        inputs: vec![path.clone()],
        model: ModelOptions { tolerance: input.tolerance, ..ModelOptions::default() },
        memory,
        work: directory.join("work"),
        ..BuildOptions::default()
    };
    let before = process_cpu_time();
    let built = build_bytes(&options);
    row.build_seconds = (process_cpu_time() - before).as_secs_f64();
    match built {
        Err(error) => {
            row.outcome = Outcome::Refused;
            row.message = error.to_string();
            if !id.case.refused.contains(&id.dial) {
                row.problems.push("refused, although it should be built".into());
            }
        }
        Ok((bytes, summary)) => {
            row.outcome = Outcome::File;
            if id.case.refused.contains(&id.dial) {
                row.problems.push("built, although it should be refused".into());
            }
            let r = &summary.repairs;
            row.repairs = [
                r.welded_vertices,
                r.degenerate_faces + r.duplicate_faces,
                r.nonmanifold_edges_cut + r.unorientable_edges_cut + r.further_edges_cut,
                r.nonmanifold_vertices_split,
                r.flipped_faces,
            ];
            match import_meshes(&[path], &Silent) {
                Ok(imported) => compare(&mut row, imported, &input, (&bytes, &summary), &options),
                Err(error) => row.problems.push(format!("built, but cannot be read: {error}")),
            }
        }
    }
    row.cpu_seconds = process_cpu_time().as_secs_f64();
    row.peak_memory_bytes = peak_memory_bytes();
    Ok(row)
}

fn build_bytes(options: &BuildOptions) -> Result<(Vec<u8>, BuildSummary), BuildError> {
    let mut bytes = vec![];
    let summary = build(options, &mut bytes, &Silent)?;
    Ok((bytes, summary))
}

/// Checks a file against its mesh.
fn compare(
    row: &mut Row,
    imported: Mesh,
    input: &super::Input,
    (bytes, summary): (&[u8], &BuildSummary),
    options: &BuildOptions,
) {
    let (repaired, ..) = repair(imported);
    if let Some(distance) = lost_by_repair(&input.mesh, &repaired, summary.tolerance) {
        row.problems.push(format!("repair lost triangles {distance:e} away from all that it kept"));
    }
    row.file = measured(bytes, summary, (&repaired, input.sampled), "", &mut row.problems);
    if input.mesh.triangles.len() <= MOST_TRIANGLES_TWICE {
        let model = ModelOptions { fillings: Fillings::GridWherePossible, ..options.model.clone() };
        let forced = BuildOptions { model, ..options.clone() };
        match build_bytes(&forced) {
            Ok((bytes, summary)) => {
                row.grids = measured(&bytes, &summary, (&repaired, input.sampled), "with grids: ", &mut row.problems);
            }
            Err(error) => row.problems.push(format!("with grids: {error}")),
        }
        let mut atlas = AtlasOptions::default();
        atlas.embed.weight_decades = input.weight_decades;
        (atlas.embed.stretch_limit, atlas.embed.undersampled_limit) = (f64::INFINITY, f64::INFINITY);
        let built = build_atlas(repaired, &atlas, &Silent);
        (row.embedding, row.splits) = (Some(built.embedding), built.retried_charts);
    }
}

/// The largest distance from the repaired mesh of the triangles that repair dropped, if it exceeds what a build may
/// move anything by.
fn lost_by_repair(original: &Mesh, repaired: &Mesh, tolerance: f64) -> Option<f64> {
    // Adding zero turns -0.0 into 0.0.
    let key = |mesh: &Mesh, t: &[u32; 3]| {
        let mut corners = t.map(|v| (mesh.positions[v as usize] + DVec3::ZERO).to_array().map(f64::to_bits));
        corners.sort_unstable();
        corners
    };
    let kept: HashSet<[[u64; 3]; 3]> = repaired.triangles.iter().map(|t| key(repaired, t)).collect();
    let dropped: Vec<[u32; 3]> =
        original.triangles.iter().filter(|t| !kept.contains(&key(original, t))).copied().collect();
    let tree = BoxTree::new(&repaired.positions, &repaired.triangles);
    let goal = Goal { relative_gap: 0.1, floor: tolerance, claim: tolerance };
    let found = largest_distance(&original.positions, &dropped, &tree, &goal);
    (found.lower > tolerance).then_some(found.lower)
}

/// The largest distance of some triangles' centres from the other surface, in both directions, at the finest level.
fn sampled_distance<R: ReadAt>(file: &File<R>, repaired: &Mesh) -> lodpack::Result<f64> {
    let drawn = file.extract(&file.select(&Query::default())?)?;
    let drawn =
        Mesh { positions: drawn.positions.into_iter().map(DVec3::from_array).collect(), triangles: drawn.triangles };
    let mut largest = 0.0f64;
    for [from, to] in [[&drawn, repaired], [repaired, &drawn]] {
        let tree = BoxTree::new(&to.positions, &to.triangles);
        for t in (0..from.triangles.len()).step_by(from.triangles.len().div_ceil(POINTS).max(1)) {
            let [a, b, c] = from.corners(t as u32);
            largest = largest.max(tree.nearest((a + b + c) / 3.0, 0).map_or(f64::INFINITY, |found| found.0));
        }
    }
    Ok(largest)
}

/// Checks a file against the repaired mesh.
fn measured(
    bytes: &[u8],
    summary: &BuildSummary,
    (repaired, sampled): (&Mesh, bool),
    prefix: &str,
    problems: &mut Vec<String>,
) -> Option<Measured> {
    let mut problem = |what: String| problems.push(format!("{prefix}{what}"));
    let checked = File::open(bytes, Limits::default()).and_then(|file| {
        let against = (!sampled).then_some(repaired);
        let report = verify(&file, against, &VerifyOptions { cuts: CUTS, seed: SEED }, &Silent)?;
        Ok((report, if sampled { sampled_distance(&file, repaired)? } else { 0.0 }))
    });
    let (report, at_points) = match checked {
        Ok(checked) => checked,
        Err(error) => {
            problem(error.to_string());
            return None;
        }
    };
    for found in report.problems.iter().take(TOLD) {
        problem(format!("{}: {}", found.location, found.what));
    }
    if report.problems.len() > TOLD {
        problem(format!("{} more of these", report.problems.len() - TOLD));
    }
    if summary.certified_error > summary.tolerance {
        problem(format!("certified error {:e} exceeds the tolerance {:e}", summary.certified_error, summary.tolerance));
    }
    if at_points > summary.certified_error {
        problem(format!("certified error {:e}, but the error at some point is {at_points:e}", summary.certified_error));
    }
    let ratios = report.levels.iter().filter(|level| level.measured > 0.0).map(|level| level.stored / level.measured);
    let finest = report.levels.last();
    Some(Measured {
        certified: summary.certified_error,
        measured: finest.map_or(at_points, |level| level.measured),
        least_ratio: ratios.reduce(f64::min).or((at_points > 0.0).then(|| summary.certified_error / at_points)),
        levels: summary.levels.len() as u32,
        triangles: summary.levels.last().map_or(0, |level| level.triangles),
        bytes: summary.bytes,
        irregular_roots: summary.roots.of(Filling::Irregular),
        grid_roots: summary.roots.of(Filling::Grid),
        cuts: report.cuts,
        crowded_edges: report.crowded_edges,
        unproven_nodes: report.unproven_nodes,
        retried_charts: summary.fallbacks.retried_charts,
        unsimplified_charts: summary.fallbacks.unsimplified_charts,
        raised_samples: summary.fallbacks.raised_samples,
        embedding_failures: summary.fallbacks.embedding_failures,
    })
}
