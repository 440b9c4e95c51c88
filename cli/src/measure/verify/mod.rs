//! `lodpack verify`: what a file claims, checked by code that shares nothing with the builder.

mod cuts;
pub mod distance;
mod errors;
mod polygon;
mod topology;
mod tree;

pub use topology::{EdgeReport, inspect_edges};

use crate::mesh::Mesh;
use crate::progress::Progress;
use crate::text::count;
use cuts::check_cuts;
use errors::check_errors;
use glam::DVec3;
use lodpack::{File, Query, ReadAt};
use serde::Serialize;

/// What is checked, and how much.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Number of random cuts.
    pub cuts: u32,
    /// Seed of the random cuts.
    pub seed: u64,
}

/// One finding that makes a file unsound.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Problem {
    /// Where: a level, a node, a cut.
    pub place: String,
    /// What is wrong there.
    pub what: String,
}

/// The stored errors of one level against measured ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelCheck {
    /// 0 is the coarsest.
    pub level: u8,
    /// Triangles of the level.
    pub triangles: u64,
    /// Largest stored error.
    pub stored: f64,
    /// Largest distance found, both ways (a distance that occurs).
    pub measured: f64,
    /// Stored over measured error, over the level's nodes: median.
    pub ratio_median: f64,
    /// Stored over measured error, over the level's nodes: largest.
    pub ratio_max: f64,
    /// Root mean square of the distance of the input's vertices to the level.
    pub vertex_rms: f64,
}

/// The outcome of a verification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// Everything that is wrong; empty for a sound file.
    pub problems: Vec<Problem>,
    /// Random cuts that were stitched and inspected.
    pub cuts: u32,
    /// Edges with more than two triangles over all cuts; thin surfaces may touch themselves.
    pub crowded_edges: u64,
    /// Boundary edges of the finest cut: the input's own boundary as sampled. None where that could not be drawn.
    pub boundary_edges: Option<u64>,
    /// Error checks by level, coarsest first; only against a mesh.
    pub levels: Vec<LevelCheck>,
    /// Median over all nodes and levels of stored over measured error.
    pub ratio_median: Option<f64>,
    /// Random cuts whose errors were compared, beside the levels.
    pub measured_cuts: u32,
    /// Nodes whose error was compared, over all levels and measured cuts.
    pub nodes: u64,
    /// Of these those for which the search ended before their error was either refuted or proven.
    pub unproven_nodes: u64,
}

/// Checks a file; `against` is the repaired input.
///
/// # Errors
/// [`lodpack::Error`] where the file cannot be read at all; damage is a [`Problem`].
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
        report.problem("--against", &format!("this mesh is not the one that the file was built from: {what}"));
    } else if let Some(mesh) = against {
        progress.begin("errors", u64::from(level_count));
        check_errors(file, mesh, options, &mut report, progress)?;
    }
    Ok(report)
}

/// How much a file's box may be off that of its input, over its size: bounds are rounded.
const BOX_SLACK: f64 = 1e-6;
/// A mesh with other details has about the same area; what differs by more has another size. Details are for the errors to tell.
const AREA_SLACK: f64 = 1e-3;

/// What says that a file was built from another mesh than this one.
fn difference<R: ReadAt>(file: &File<R>, mesh: &Mesh) -> Option<String> {
    let source = file.source_info().filter(|source| source.triangle_count > 0)?;
    let (triangles, area) = (mesh.triangles.len() as u64, mesh_area(mesh));
    if triangles != source.triangle_count {
        let [here, there] = [triangles, source.triangle_count].map(count);
        return Some(format!("it has {here} triangles after repair, that one had {there}"));
    }
    if (area - source.area).abs() > AREA_SLACK * source.area.max(area) {
        return Some(format!("its area is {area:.6e}, that one's was {:.6e}", source.area));
    }
    let ([low, high], [file_low, file_high]) = (mesh.bounds(), file.bounds()?.map(DVec3::from_array));
    // What a root stands for lies in its box.
    let slack = DVec3::splat(BOX_SLACK * (file_high - file_low).max_element());
    let lies_within = low.cmpge(file_low - slack).all() && high.cmple(file_high + slack).all();
    (!lies_within).then(|| format!("it reaches from {low} to {high}, the file from {file_low} to {file_high}"))
}

fn mesh_area(mesh: &Mesh) -> f64 {
    0.5 * (0..mesh.triangles.len() as u32).map(|t| mesh.doubled_area(t).length()).sum::<f64>()
}

impl VerifyReport {
    fn problem(&mut self, place: &str, what: &str) {
        self.problems.push(Problem { place: place.into(), what: what.into() });
    }
}
