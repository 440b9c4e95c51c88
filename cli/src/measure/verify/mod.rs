//! `lodpack verify`: checks the claims of a file.
//!
//! This module shares nothing with the builder, on purpose. It has its own bounding volume hierarchy, its own
//! point-triangle distance and its own branch and bound, although `stage::certify` has all three: an error there would
//! otherwise confirm itself here. Do not unite them. It uses the reader, whose decoding is what users see, and
//! [`crate::mesh`].

mod cuts;
pub mod distance;
mod errors;
mod nodes;
mod objects;
mod polygon;
mod topology;
mod tree;

pub use objects::{NamedMesh, verify_objects};
pub use topology::{EdgeReport, inspect_edges};

use crate::mesh::Mesh;
use crate::progress::Progress;
use crate::text::count;
use cuts::check_cuts;
use errors::check_errors;
use glam::DVec3;
use lodpack::{File, Query, ReadAt};
use serde::Serialize;

/// Options of [`verify`].
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Number of random cuts.
    pub cuts: u32,
    /// Seed of the random cuts.
    pub seed: u64,
}

/// A finding that makes a file unsound.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Problem {
    /// Where: a level, a node, or a cut.
    pub location: String,
    /// What is wrong.
    pub what: String,
}

/// The stored errors of one level, compared with measured ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelCheck {
    /// 0 is the coarsest.
    pub level: u8,
    /// Triangles of the level.
    pub triangles: u64,
    /// Largest stored error.
    pub stored: f64,
    /// Largest measured distance, of both directions (a distance that occurs).
    pub measured: f64,
    /// Stored over measured error of the level's nodes: median.
    pub ratio_median: f64,
    /// Stored over measured error of the level's nodes: largest.
    pub ratio_max: f64,
    /// Root mean square distance of the input's vertices from the level.
    pub vertex_rms: f64,
}

/// The result of a verification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// All problems; empty for a sound file.
    pub problems: Vec<Problem>,
    /// Random cuts that were stitched and inspected.
    pub cuts: u32,
    /// Edges with more than two triangles, over all cuts. Thin surfaces may touch themselves.
    pub crowded_edges: u64,
    /// Boundary edges of the finest cut: the input's own boundary, as sampled. None if that cut could not be drawn.
    pub boundary_edges: Option<u64>,
    /// Checks of errors by level, coarsest first; only against a mesh.
    pub levels: Vec<LevelCheck>,
    /// Stored over measured error: median over all nodes and levels.
    pub ratio_median: Option<f64>,
    /// Random cuts whose errors were compared, besides the levels.
    pub measured_cuts: u32,
    /// Objects that were compared one by one with those of the input.
    pub objects: u64,
    /// Nodes whose error was compared, over all levels and measured cuts.
    pub nodes: u64,
    /// Of these, nodes for which the search ended before their error was either refuted or proven.
    pub unproven_nodes: u64,
}

/// Checks a file. `against` is the repaired input.
///
/// # Errors
///
/// [`lodpack::Error`] if the file cannot be read at all; any damage is a [`Problem`].
pub fn verify<R: ReadAt + Sync>(
    file: &File<R>,
    against: Option<&Mesh>,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> lodpack::Result<VerifyReport> {
    let mut report = VerifyReport::default();
    progress.begin("structure", 0);
    if let Err(error) = file.verify() {
        report.problem("file", &error.to_string());
        return Ok(report);
    }
    let level_count = file.level_count() as u8;
    let finest_cut = file.select(&Query::default())?;
    let finest = match file.extract(&finest_cut) {
        Ok(mesh) => mesh,
        Err(error) => {
            report.problem("finest level", &error.to_string());
            return Ok(report);
        }
    };
    report.boundary_edges = Some(inspect_edges(&finest.triangles).boundary.len() as u64);

    progress.begin("cuts", u64::from(options.cuts));
    check_cuts(file, options, &mut report, progress)?;

    if let Some(what) = against.and_then(|mesh| difference(file, mesh)) {
        report.problem("--against", &format!("the file was built from another mesh: {what}"));
    } else if let Some(mesh) = against {
        progress.begin("errors", u64::from(level_count));
        check_errors(file, mesh, options, &mut report, progress)?;
    }
    Ok(report)
}

/// How much a file's box may differ from its input's, relative to its size: bounds are rounded.
const BOX_SLACK: f64 = 1e-6;
/// A mesh that differs only in detail has nearly the same area; a larger difference means another model. The check of
/// errors finds differences in detail.
const AREA_SLACK: f64 = 1e-3;

/// Evidence that a file was built from a mesh other than this one.
fn difference<R: ReadAt>(file: &File<R>, mesh: &Mesh) -> Option<String> {
    let source = file.source_info().filter(|source| source.triangle_count > 0)?;
    let (triangles, area) = (mesh.triangles.len() as u64, mesh_area(mesh));
    if triangles != source.triangle_count {
        let [here, there] = [triangles, source.triangle_count].map(count);
        return Some(format!("this mesh has {here} triangles after repair, that one had {there}"));
    }
    if (area - source.area).abs() > AREA_SLACK * source.area.max(area) {
        return Some(format!("this mesh has the area {area:.6e}, that one had {:.6e}", source.area));
    }
    let ([low, high], [file_low, file_high]) = (mesh.bounds(), file.bounds()?.map(DVec3::from_array));
    // The part of the input that a root approximates lies in the root's box.
    let slack = DVec3::splat(BOX_SLACK * (file_high - file_low).max_element());
    let lies_within = low.cmpge(file_low - slack).all() && high.cmple(file_high + slack).all();
    (!lies_within).then(|| format!("this mesh reaches from {low} to {high}, the file from {file_low} to {file_high}"))
}

fn mesh_area(mesh: &Mesh) -> f64 {
    0.5 * mesh.doubled_areas().iter().sum::<f64>()
}

impl VerifyReport {
    fn problem(&mut self, location: &str, what: &str) {
        self.problems.push(Problem { location: location.into(), what: what.into() });
    }
}
