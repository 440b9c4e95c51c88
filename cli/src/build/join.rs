//! From the products of regions to one model.

use super::borders::ARC_TANGENT_SHIFT;
use super::grid::grid_quantisation;
use super::idle::remove_idle_levels;
use super::overview::overview;
use super::region::RegionProduct;
use super::root::Times;
use super::scale::Scale;
use super::{BuildError, Plan};
use crate::progress::Progress;
use crate::summary::{BuildSummary, Fallbacks, LevelSummary, Stopwatch, peak_memory_bytes};
use lodpack::{ArcRecord, Filling, LevelInfo, Model, SourceInfo};
use std::collections::BTreeMap;
use std::io::Write;

/// Makes one model of the products of all regions, in the order of the regions, and writes it. `times` were spent before on
/// products that come from files.
pub(crate) fn join(
    plan: &Plan,
    products: impl Iterator<Item = Result<RegionProduct, BuildError>>,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
    mut times: Times,
) -> Result<BuildSummary, BuildError> {
    let scale = &plan.scale;
    let mut joiner = Joiner::new(scale, plan.source.clone());
    let (mut fallbacks, mut interior_vertices) = (Fallbacks::default(), 0);
    for (region, product) in products.enumerate() {
        let product = product?;
        fallbacks = fallbacks.plus(product.fallbacks.clone());
        times.add(&product.times);
        interior_vertices += product.interior_vertices;
        joiner.add(product).map_err(|error| match error {
            lodpack::Error::Model { what } => lodpack::Error::Model { what: format!("region {region}: {what}") },
            other => other,
        })?;
    }
    watch.lap("roots");
    watch.stages.extend(times.stages());

    progress.begin("pack", 0);
    let mut model = joiner.model;
    remove_idle_levels(&mut model);
    model.overview = overview(&model, scale)?;
    let arc_samples: usize = model.arcs.iter().map(|arc| arc.samples.len()).sum();
    let samples = (model.corners.len() + arc_samples) as u64 + interior_vertices;
    let (irregular_roots, grid_roots) = model.roots.iter().fold((0, 0), |(i, g), root| match root.filling {
        Filling::Grid => (i, g + 1),
        _ => (i + 1, g),
    });
    let report = lodpack::write_file(&model, out)?;
    watch.lap("pack");

    let vertices = plan.source.vertex_count;
    let levels = level_summaries(&model, &report.levels);
    let certified_error = levels.last().map_or(0.0, |l| l.certified_error);
    if certified_error > scale.tolerance {
        let tolerance = scale.tolerance;
        progress.note(&format!(
            "the tolerance of {tolerance:.3e} is not reached: the certified error is {certified_error:.3e}"
        ));
    }
    Ok(BuildSummary {
        input_triangles: plan.input_triangles,
        input_vertices: vertices,
        triangles: plan.source.triangle_count,
        mean_edge_length: scale.mean_edge_length,
        repairs: plan.repairs.clone(),
        charts: plan.charts,
        irregular_roots,
        grid_roots,
        samples_per_input_vertex: samples as f64 / vertices as f64,
        bytes: report.total_bytes,
        bits_per_input_vertex: report.total_bytes as f64 * 8.0 / vertices as f64,
        tolerance: scale.tolerance,
        certified_error,
        levels,
        fallbacks,
        wall_seconds: watch.total().0.as_secs_f64(),
        cpu_seconds: watch.total().1.as_secs_f64(),
        stages: watch.stages,
        peak_memory_bytes: peak_memory_bytes(),
        temporary_bytes: 0,
    })
}

/// Triangles, errors and bytes by level, every root drawn at that level.
fn level_summaries(model: &lodpack::Model, level_bytes: &[[u64; 2]]) -> Vec<LevelSummary> {
    let summary = |level: usize| {
        let drawn = model.roots.iter().filter_map(|root| root.blocks[..=level].iter().rev().flatten().next());
        let (triangles, error) =
            drawn.fold((0, 0.0f64), |(n, e), block| (n + u64::from(block.triangle_count), e.max(block.error)));
        let bytes = level_bytes.get(level).map_or(0, |parts| parts.iter().sum());
        LevelSummary { level: level as u8, triangles, certified_error: error, bytes }
    };
    (0..model.levels.len()).map(summary).collect()
}

/// Takes the products of regions, one after the other.
struct Joiner {
    model: Model,
    /// Model corner of each shared corner that came so far.
    corners: BTreeMap<u32, u32>,
    /// Model arc of each seam that came so far.
    seams: BTreeMap<u32, u32>,
}

impl Joiner {
    fn new(scale: &Scale, source: SourceInfo) -> Self {
        let level =
            |level: &super::LevelPlan| LevelInfo { tolerance: level.tolerance, quantisation: level.quantisation };
        let model = Model {
            lattice: scale.lattice,
            arc_tangent_shift: ARC_TANGENT_SHIFT,
            grid_quantisation: grid_quantisation(scale),
            levels: scale.levels.iter().map(level).collect(),
            source,
            corners: vec![],
            arcs: vec![],
            roots: vec![],
            overview: None,
        };
        Self { model, corners: BTreeMap::new(), seams: BTreeMap::new() }
    }

    /// Adds a region.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] where it has another idea of a seam than a region before it.
    fn add(&mut self, product: RegionProduct) -> lodpack::Result<()> {
        check_numbers(&product)?;
        let Model { corners, arcs, roots, .. } = &mut self.model;
        let mut corner_ids = Vec::with_capacity(product.corners.len());
        for (position, shared) in product.corners {
            let next = corners.len() as u32;
            let id = shared.map_or(next, |number| *self.corners.entry(number).or_insert(next));
            if id == next {
                corners.push(position);
            } else if corners[id as usize] != position {
                return Err(disagreement("the place of a corner"));
            }
            corner_ids.push(id);
        }
        let mut arc_ids = Vec::with_capacity(product.arcs.len());
        for (arc, seam) in product.arcs {
            let record = ArcRecord { ends: arc.ends.map(|end| corner_ids[end as usize]), samples: arc.samples };
            let next = arcs.len() as u32;
            let id = seam.map_or(next, |number| *self.seams.entry(number).or_insert(next));
            if id == next {
                arcs.push(record);
            } else if arcs[id as usize] != record {
                return Err(disagreement("the samples of an arc"));
            }
            arc_ids.push(id);
        }
        roots.extend(product.roots.into_iter().map(|mut root| {
            root.loops.iter_mut().flatten().for_each(|half_arc| half_arc.arc = arc_ids[half_arc.arc as usize]);
            root
        }));
        Ok(())
    }
}

/// Refuses numbers of corners and arcs that the product does not have: it may come from a file.
fn check_numbers(product: &RegionProduct) -> lodpack::Result<()> {
    let mut ends = product.arcs.iter().flat_map(|(arc, _)| arc.ends);
    let mut half_arcs = product.roots.iter().flat_map(|root| root.loops.iter().flatten());
    if ends.all(|end| (end as usize) < product.corners.len())
        && half_arcs.all(|half_arc| (half_arc.arc as usize) < product.arcs.len())
    {
        return Ok(());
    }
    Err(lodpack::Error::Model { what: "a region names a corner or an arc that it does not have".into() })
}

fn disagreement(what: &str) -> lodpack::Error {
    lodpack::Error::Model { what: format!("two regions disagree about {what} on the seam between them") }
}
