//! From a region to its part of the file.

use std::collections::{BTreeMap, BTreeSet};

use super::borders::{ARC_TANGENT_SHIFT, Borders};
use super::coarse::{CoarseSurface, coarse_surfaces};
use super::grid::grid_quantisation;
use super::idle::remove_idle_levels;
use super::root::{Times, build_roots};
use super::{CERTIFY_GAP, Effort, FAST_CERTIFY_GAP, LevelPlan, Plan, Surface};
use crate::pipeline::summary::{Fallbacks, thread_cpu_time};
use crate::progress::Progress;
use crate::region::Region;
use crate::stage::arcs::{Atlas, Seams, trace_arcs};
use lodpack::{ArcRecord, Filling, LatticePoint, LevelInfo, LevelSteps, Model, Piece, RootRecord, Share, Shares};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

/// What a region adds to the file.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RegionProduct {
    pub facts: RegionFacts,
    pub piece: Piece,
}

impl RegionProduct {
    /// Gives corners and seams that other regions have, too, the numbers of another job.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] where there is none for something.
    pub fn renumber(&mut self, corners: &BTreeMap<u32, u32>, seams: &BTreeMap<u32, u32>) -> lodpack::Result<()> {
        let [corner, seam] = [corners, seams].map(|numbers| |number: u32| numbers.get(&number).copied());
        self.piece.index.renumber(corner, seam)?;
        // The piece shares the same.
        let RegionFacts { corners, seams, .. } = &mut self.facts;
        corners.iter_mut().for_each(|(number, _)| *number = corner(*number).unwrap_or(*number));
        seams.iter_mut().for_each(|(number, _)| *number = seam(*number).unwrap_or(*number));
        Ok(())
    }
}

/// What the whole has to know of a region, beside its piece.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RegionFacts {
    /// The levels that its blocks are of: those of the plan, unless it is the only region and does not need them all.
    pub levels: Vec<LevelInfo>,
    /// By level what is drawn.
    pub drawn: Vec<DrawnLevel>,
    /// The coarsest levels, the finer one first; none where the file has too few roots for an overview.
    pub coarse: Vec<CoarseSurface>,
    /// Corners that other regions have, too: number among these, and place.
    pub corners: Vec<(u32, LatticePoint)>,
    /// Seams: number, and hash of its corners and samples.
    pub seams: Vec<(u32, u64)>,
    /// Corners, samples of arcs and inner vertices of all blocks, but for those that a region before has.
    pub samples: u64,
    pub irregular_roots: u64,
    pub grid_roots: u64,
    pub fallbacks: Fallbacks,
    /// Not in files, which are the same whenever they are made.
    #[serde(skip)]
    pub times: Times,
}

/// A region with all roots drawn at a level: triangles, and the largest error that the file stores.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct DrawnLevel {
    pub triangles: u64,
    pub error: f64,
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

    let start = thread_cpu_time();
    let mut model = model(plan, &atlas, borders, roots);
    if plan.regions == 1 {
        remove_idle_levels(&mut model);
    }
    let shares = shares(&atlas, seams);
    let facts = RegionFacts { fallbacks, ..facts(&model, &shares, interior_vertices)? };
    let coarse = coarse_surfaces(&model, plan)?;
    let piece = Piece::new(&model, &shares)?;
    times.encode += thread_cpu_time() - start;
    Ok(RegionProduct { facts: RegionFacts { coarse, times, ..facts }, piece })
}

/// The region as if it were all there is.
fn model(plan: &Plan, atlas: &Atlas, borders: Borders, roots: Vec<RootRecord>) -> Model {
    let level = |level: &LevelPlan| LevelInfo {
        tolerance: level.tolerance,
        steps: LevelSteps::new(|filling| match filling {
            Filling::Grid => grid_quantisation(&plan.scale),
            _ => level.quantisation,
        }),
    };
    let arcs = atlas.arcs.iter().zip(borders.samples);
    Model {
        levels: plan.scale.levels.iter().map(level).collect(),
        corners: borders.corners,
        arcs: arcs.map(|(arc, samples)| ArcRecord { ends: arc.ends, samples }).collect(),
        roots,
        ..head(plan)
    }
}

/// What all regions have in common, but for the levels.
pub(super) fn head(plan: &Plan) -> Model {
    Model {
        lattice: plan.scale.lattice,
        arc_tangent_shift: ARC_TANGENT_SHIFT,
        source: plan.source.clone(),
        ..Model::default()
    }
}

fn shares(atlas: &Atlas, seams: &Seams) -> Shares {
    let corner =
        |&vertex: &u32| seams.corner(vertex).map(|corner| Share { number: corner.number, is_first: corner.is_first });
    let firsts: BTreeSet<u32> = seams.starts.iter().filter(|start| !start.reversed).map(|start| start.seam).collect();
    let arc = |seam: Option<u32>| seam.map(|number| Share { number, is_first: firsts.contains(&number) });
    Shares {
        corners: atlas.corners.iter().map(corner).collect(),
        arcs: atlas.arcs.iter().map(|path| arc(path.seam)).collect(),
    }
}

fn facts(model: &Model, shares: &Shares, interior_vertices: u64) -> lodpack::Result<RegionFacts> {
    let is_own = |share: &Option<Share>| share.is_none_or(|share| share.is_first);
    let corners = shares.corners.iter().filter(|share| is_own(share)).count() as u64;
    let arcs = model.arcs.iter().zip(&shares.arcs).filter(|(_, share)| is_own(share));
    let arc_samples: usize = arcs.map(|(arc, _)| arc.samples.len()).sum();
    let grid_roots = model.roots.iter().filter(|root| root.filling == Filling::Grid).count() as u64;
    let shared_corners = shares.corners.iter().zip(&model.corners);
    let shared_arcs = shares.arcs.iter().zip(&model.arcs);
    Ok(RegionFacts {
        levels: model.levels.clone(),
        drawn: (0..model.levels.len()).map(|level| drawn(model, level)).collect::<lodpack::Result<_>>()?,
        corners: shared_corners.filter_map(|(share, &position)| Some((share.as_ref()?.number, position))).collect(),
        seams: shared_arcs.filter_map(|(share, arc)| Some((share.as_ref()?.number, hash(model, arc)))).collect(),
        samples: corners + arc_samples as u64 + interior_vertices,
        irregular_roots: model.roots.len() as u64 - grid_roots,
        grid_roots,
        ..RegionFacts::default()
    })
}

/// As a file adds it up (SPEC.md, "Levels"): a root that lacks the level is drawn coarser than a neighbour may be.
fn drawn(model: &Model, level: usize) -> lodpack::Result<DrawnLevel> {
    let mut sum = DrawnLevel::default();
    for root in &model.roots {
        let mut blocks = root.blocks[..=level].iter().enumerate().rev();
        let Some((at, block)) = blocks.find_map(|(at, block)| Some((at, block.as_ref()?))) else { continue };
        let deviation = if at < level { block.border_deviation } else { 0.0 };
        sum.triangles += u64::from(block.triangle_count);
        sum.error = sum.error.max(lodpack::stored_error(block.error, deviation, &model.lattice)?);
    }
    Ok(sum)
}

/// Of all that both sides of a seam have to agree on.
fn hash(model: &Model, arc: &ArcRecord) -> u64 {
    let mut hash = Xxh3::new();
    let mut point = |position: LatticePoint| position.iter().for_each(|x| hash.update(&x.to_le_bytes()));
    arc.ends.iter().for_each(|&end| point(model.corners[end as usize]));
    for sample in &arc.samples {
        point([i64::from(sample.param), i64::from(sample.level), 0]);
        point(sample.position);
    }
    hash.digest()
}
