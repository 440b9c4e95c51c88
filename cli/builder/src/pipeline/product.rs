//! What a region contributes to the file.

use std::collections::{BTreeMap, BTreeSet};

use super::coarse::coarse_surfaces;
use super::drawn::{DrawnLevel, drawn};
use super::fillings::level_steps;
use super::groups::above_regions::Top;
use super::shared_arcs::{ARC_TANGENT_SHIFT, SharedArcs};
use super::summary::{Fallbacks, Times};
use super::texels::channels;
use super::{LevelPlan, Plan, Scale};
use crate::reduce::CoarseSurface;
use lodpack::{
    LatticePoint,
    index::FillingCounts,
    write::{ArcRecord, LevelInfo, Model, Piece, RootRecord, Share, Shares},
};
use lodpack_stage::arcs::{Atlas, Seams};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

/// The product of a region: its piece of the file, and what the file as a whole has to know of it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RegionProduct {
    pub stats: ProductStats,
    pub piece: Piece,
}

impl RegionProduct {
    /// Encodes a region's model. `shares` says what it has in common with other regions.
    pub fn new(model: &Model, plan: &Plan, shares: Shares, interior_vertices: u64) -> lodpack::Result<Self> {
        let stats = stats(model, &shares, interior_vertices)?;
        let coarse = coarse_surfaces(model, plan)?;
        Ok(Self { stats: ProductStats { coarse, ..stats }, piece: Piece::new(model, &shares)? })
    }

    /// Gives the corners and seams that the region shares with others the numbers that they have in another job.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if one of them has no such number.
    pub fn renumber(&mut self, corners: &BTreeMap<u32, u32>, seams: &BTreeMap<u32, u32>) -> lodpack::Result<()> {
        let [corner, seam] = [corners, seams].map(|numbers| |number: u32| numbers.get(&number).copied());
        self.piece.index.renumber(corner, seam)?;
        // What the piece shares is the same.
        let ProductStats { corners, seams, .. } = &mut self.stats;
        corners.iter_mut().for_each(|(number, _)| *number = corner(*number).unwrap_or(*number));
        seams.iter_mut().for_each(|(number, _)| *number = seam(*number).unwrap_or(*number));
        Ok(())
    }

    /// Gives the product the levels of a later plan that builds like the one from which it was built: only the number
    /// of levels above regions, and their steps, may differ.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if the region has something at these levels.
    pub fn move_levels(&mut self, from: &Scale, to: &Scale) -> lodpack::Result<()> {
        let [before, now] = [from, to].map(|scale| scale.coarsest_of_regions);
        self.stats.levels = level_infos(to);
        if before == now {
            return Ok(());
        }
        self.piece.move_levels(before, now)?;
        let ProductStats { drawn, tops, .. } = &mut self.stats;
        // Above the region all levels draw its top.
        let first = drawn.first().copied().unwrap_or_default();
        drawn.splice(..usize::from(before), vec![first; now.into()]);
        tops.iter_mut().for_each(|top| top.move_levels(before, now));
        Ok(())
    }
}

/// The levels as the file has them.
fn level_infos(scale: &Scale) -> Vec<LevelInfo> {
    let info = |level: &LevelPlan| LevelInfo { tolerance: level.tolerance, steps: level_steps(scale, level) };
    scale.levels.iter().map(info).collect()
}

/// What the file as a whole has to know of a region's product, beside its piece.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct ProductStats {
    /// The levels of its blocks: those of the plan, unless it is the only region and does not need them all.
    pub levels: Vec<LevelInfo>,
    /// Totals by level.
    pub drawn: Vec<DrawnLevel>,
    /// The coarsest levels, the finer one first; none if the file has too few roots for an overview.
    pub coarse: Vec<CoarseSurface>,
    /// Its roots without a parent, if there may be groups above regions.
    pub(super) tops: Vec<Top>,
    /// Number and position of each corner that other regions have too.
    pub corners: Vec<(u32, LatticePoint)>,
    /// Number of each seam, and a hash of its corners and samples.
    pub seams: Vec<(u32, u64)>,
    /// Corners, arc samples and interior vertices of all blocks, except those that an earlier region counts.
    pub samples: u64,
    pub roots: FillingCounts,
    pub fallbacks: Fallbacks,
    /// Not stored: a part's file is the same whenever it is made.
    #[serde(skip)]
    pub times: Times,
}

/// The region as a model of its own.
pub(super) fn model(plan: &Plan, atlas: &Atlas, arcs: SharedArcs, roots: Vec<RootRecord>) -> Model {
    let SharedArcs { corners, samples, .. } = arcs;
    let arcs = atlas.arcs.iter().zip(samples);
    Model {
        levels: level_infos(&plan.scale),
        corners,
        arcs: arcs.map(|(arc, samples)| ArcRecord { ends: arc.ends, samples }).collect(),
        roots,
        ..head(plan)
    }
}

/// What all regions have in common, except the levels.
pub(super) fn head(plan: &Plan) -> Model {
    Model {
        lattice: plan.scale.lattice,
        arc_tangent_shift: ARC_TANGENT_SHIFT,
        source: plan.source.clone(),
        channels: channels(&plan.appearance, plan.colour_step == 0),
        placement: plan.placement.clone(),
        ..Model::default()
    }
}

/// The corners and arcs of a region that other regions have too.
pub(super) fn shares(atlas: &Atlas, seams: &Seams) -> Shares {
    let corner =
        |&vertex: &u32| seams.corner(vertex).map(|corner| Share { number: corner.number, is_first: corner.is_first });
    let firsts: BTreeSet<u32> = seams.starts.iter().filter(|start| !start.reversed).map(|start| start.seam).collect();
    let arc = |seam: Option<u32>| seam.map(|number| Share { number, is_first: firsts.contains(&number) });
    Shares {
        corners: atlas.corners.iter().map(corner).collect(),
        arcs: atlas.arcs.iter().map(|path| arc(path.seam)).collect(),
    }
}

fn stats(model: &Model, shares: &Shares, interior_vertices: u64) -> lodpack::Result<ProductStats> {
    let is_own = |share: &Option<Share>| share.is_none_or(|share| share.is_first);
    let corners = shares.corners.iter().filter(|share| is_own(share)).count() as u64;
    let arcs = model.arcs.iter().zip(&shares.arcs).filter(|(_, share)| is_own(share));
    let arc_samples: usize = arcs.map(|(arc, _)| arc.samples.len()).sum();
    let shared_corners = shares.corners.iter().zip(&model.corners);
    let shared_arcs = shares.arcs.iter().zip(&model.arcs);
    Ok(ProductStats {
        levels: model.levels.clone(),
        drawn: (0..model.levels.len()).map(|level| drawn(model, level)).collect::<lodpack::Result<_>>()?,
        corners: shared_corners.filter_map(|(share, &position)| Some((share.as_ref()?.number, position))).collect(),
        seams: shared_arcs.filter_map(|(share, arc)| Some((share.as_ref()?.number, hash(model, arc)))).collect(),
        samples: corners + arc_samples as u64 + interior_vertices,
        roots: model.roots.iter().map(|root| root.filling).collect(),
        ..ProductStats::default()
    })
}

/// A hash of everything that both sides of a seam have to agree on. Levels are counted from the finest one, but for the
/// coarsest, so that it stays where these move ([`RegionProduct::move_levels`]).
fn hash(model: &Model, arc: &ArcRecord) -> u64 {
    let mut hash = Xxh3::new();
    let mut point = |position: LatticePoint| position.iter().for_each(|x| hash.update(&x.to_le_bytes()));
    arc.ends.iter().for_each(|&end| point(model.corners[end as usize]));
    for sample in &arc.samples {
        let up = if sample.level == 0 { 0 } else { model.levels.len() as i64 - i64::from(sample.level) };
        point([i64::from(sample.param), up, 0]);
        point(sample.position);
    }
    hash.digest()
}
