//! Checks random cuts: they must stitch, and keep their promises.

use super::topology::repeated_in_one_node;
use super::{Problem, VerifyOptions, VerifyReport, inspect_edges};
use crate::measure::random::Random;
use crate::progress::Progress;
use glam::DVec3;
use lodpack::{Cut, File, Outside, Query, ReadAt};
use rayon::prelude::*;

/// Random boxes, tolerances and budgets over the whole extent of a file.
pub(super) struct RandomQueries {
    random: Random,
    bounds: [DVec3; 2],
    /// Smallest and largest error and triangle count.
    errors: [f64; 2],
    triangles: [f64; 2],
}

impl RandomQueries {
    /// `None` for a file without a surface.
    pub fn new<R: ReadAt>(file: &File<R>, seed: u64) -> lodpack::Result<Option<Self>> {
        let Some(bounds) = file.bounds().map(|bounds| bounds.map(DVec3::from_array)) else { return Ok(None) };
        let (coarsest, finest) = (file.uniform_cut(0)?, file.uniform_cut(file.level_count() as u8 - 1)?);
        Ok(Some(Self {
            random: Random(seed),
            bounds,
            errors: [finest.error, coarsest.error],
            triangles: [coarsest.triangle_count as f64, finest.triangle_count as f64],
        }))
    }

    pub fn next(&mut self) -> Query {
        let mut query = Query::default();
        let mut unit = || self.random.unit();
        if unit() < 0.5 {
            let [low, high] = self.bounds;
            let centre = low + (high - low) * DVec3::new(unit(), unit(), unit());
            let half = (high - low) * (0.02 + 0.5 * unit());
            query.volume = Some([(centre - half).to_array(), (centre + half).to_array()].into());
            query.outside = if unit() < 0.5 { Outside::Drop } else { Outside::Coarsest };
        }
        if unit() < 0.6 {
            let (small, large) = (self.errors[0].max(1e-300), self.errors[1].max(1e-300) * 1.5);
            query.tolerance = Some(small * (large / small).powf(unit()));
        }
        if unit() < 0.6 {
            let (few, many) = (self.triangles[0], self.triangles[1] * 1.2);
            query.max_triangles = Some((few * (many / few.max(1.0)).powf(unit())).ceil() as u64);
        }
        query
    }
}

/// Stitches random cuts. Each must be closed, except along arcs that only one root of the cut has.
pub(super) fn check_cuts<R: ReadAt + Sync>(
    file: &File<R>,
    options: &VerifyOptions,
    report: &mut VerifyReport,
    progress: &dyn Progress,
) -> lodpack::Result<()> {
    let Some(mut queries) = RandomQueries::new(file, options.seed)? else { return Ok(()) };
    let finest_error = queries.errors[0];
    let queries: Vec<(u32, Query)> = (0..options.cuts).map(|number| (number, queries.next())).collect();
    let findings: Vec<(Vec<String>, u64)> = queries
        .par_iter()
        .map(|(_, query)| {
            let finding = match file.select(query) {
                Ok(cut) => check_cut(file, &cut, query, finest_error),
                // A box may miss everything, and a budget may be below the coarsest cut: both are valid answers.
                Err(lodpack::Error::Query { .. }) => Ok((vec![], 0)),
                Err(error) => Err(error),
            };
            progress.advance(1);
            finding.unwrap_or_else(|error| (vec![error.to_string()], 0))
        })
        .collect();
    for ((number, query), (problems, crowded)) in queries.iter().zip(findings) {
        let location = format!("random cut {number} ({query:?})");
        report.problems.extend(problems.into_iter().map(|what| Problem { location: location.clone(), what }));
        report.crowded_edges += crowded;
        report.cuts += 1;
    }
    Ok(())
}

/// The problems of a cut, and the number of its edges with more than two triangles.
fn check_cut<R: ReadAt>(
    file: &File<R>,
    cut: &Cut,
    query: &Query,
    finest_error: f64,
) -> lodpack::Result<(Vec<String>, u64)> {
    let mut problems = vec![];
    if query.max_triangles.is_some_and(|limit| cut.triangle_count > limit) {
        problems.push(format!("{} triangles exceed its budget", cut.triangle_count));
    }
    let too_coarse = query.tolerance.is_some_and(|tolerance| cut.error > tolerance);
    if too_coarse && query.max_triangles.is_none() && cut.error > finest_error {
        problems.push(format!("error {} exceeds its tolerance", cut.error));
    }
    let mesh = file.extract(cut)?;
    let edges = inspect_edges(&mesh.triangles);
    if mesh.triangles.len() as u64 != cut.triangle_count {
        problems.push(format!("{} triangles instead of the promised {}", mesh.triangles.len(), cut.triangle_count));
    }
    let repeated = if edges.repeated > 0 { repeated_in_one_node(&mesh.triangles, &mesh.triangle_nodes) } else { 0 };
    if repeated + edges.degenerate > 0 {
        problems.push(format!("{repeated} repeated triangles, {} degenerate ones", edges.degenerate));
    }
    let (boundary, expected) = (edges.boundary.len() as u64, file.boundary_edge_count(cut)?);
    if boundary != expected {
        problems.push(format!("{boundary} boundary edges instead of {expected}"));
    }
    Ok((problems, edges.crowded))
}
