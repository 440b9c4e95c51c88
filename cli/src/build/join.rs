//! From the products of regions to one model.

use super::borders::ARC_TANGENT_SHIFT;
use super::grid::grid_quantisation;
use super::region::RegionProduct;
use super::scale::Scale;
use lodpack::{ArcRecord, LevelInfo, Model, SourceInfo};
use std::collections::BTreeMap;

/// Takes the products of regions, one after the other.
pub(super) struct Joiner {
    model: Model,
    /// Model corner of each shared corner that came so far.
    corners: BTreeMap<u32, u32>,
    /// Model arc of each seam that came so far.
    seams: BTreeMap<u32, u32>,
}

impl Joiner {
    pub fn new(scale: &Scale, source: SourceInfo) -> Self {
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
    pub fn add(&mut self, product: RegionProduct) -> lodpack::Result<()> {
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

    /// The model of all regions.
    pub fn finish(self) -> Model {
        self.model
    }
}

fn disagreement(what: &str) -> lodpack::Error {
    lodpack::Error::Model { what: format!("two regions disagree about {what} on the seam between them") }
}
