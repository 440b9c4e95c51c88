//! From a region to its part of the model.

use super::borders::Borders;
use super::root::{Times, build_roots};
use super::{CERTIFY_GAP, Effort, FAST_CERTIFY_GAP, Plan, Surface};
use crate::atlas::{Seams, trace_arcs};
use crate::progress::Progress;
use crate::region::Region;
use crate::summary::{Fallbacks, thread_cpu_time};
use lodpack::{ArcRecord, LatticePoint, RootRecord};
use serde::{Deserialize, Serialize};

/// What a region adds to the model. Numbers of corners and arcs are the region's own.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RegionProduct {
    /// Positions, and the number among all regions where the corner is one of a seam.
    pub corners: Vec<(LatticePoint, Option<u32>)>,
    /// Arcs, and the number of the seam where the arc is one.
    pub arcs: Vec<(ArcRecord, Option<u32>)>,
    pub roots: Vec<RootRecord>,
    /// Interior vertices of all blocks.
    pub interior_vertices: u64,
    pub fallbacks: Fallbacks,
    /// Not in files, which are the same whenever they are made.
    #[serde(skip)]
    pub times: Times,
}

/// Builds all roots of a region that is cut into charts.
pub(crate) fn build_region(
    region: &Region,
    seams: &Seams,
    plan: &Plan,
    progress: &dyn Progress,
) -> lodpack::Result<RegionProduct> {
    let Region { mesh, adjacency, labels } = region;
    let start = thread_cpu_time();
    let atlas = trace_arcs(mesh, adjacency, labels, seams);
    let scale = &plan.scale;
    let certify_gap = match plan.effort {
        Effort::Fast => FAST_CERTIFY_GAP,
        _ => CERTIFY_GAP,
    };
    let surface = Surface { mesh, adjacency, labels, atlas: &atlas, scale, certify_gap };
    // Both sides of an arc see the same samples, bit for bit, from here on.
    let mut borders = Borders::new(&surface)?;
    let mut fallbacks = Fallbacks::default();
    let arcs_time = thread_cpu_time() - start;
    let fill = (plan.fillings, plan.effort);
    let (roots, interior_vertices, mut times) = build_roots(&surface, fill, &mut borders, &mut fallbacks, progress)?;
    times.arcs += arcs_time;
    let shared = |&vertex: &u32| seams.corner(vertex);
    let arcs = atlas.arcs.iter().zip(borders.samples);
    Ok(RegionProduct {
        corners: borders.corners.into_iter().zip(atlas.corners.iter().map(shared)).collect(),
        arcs: arcs.map(|(arc, samples)| (ArcRecord { ends: arc.ends, samples }, arc.seam)).collect(),
        roots,
        interior_vertices,
        fallbacks,
        times,
    })
}
