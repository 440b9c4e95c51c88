//! Where nodes meet: the arcs between them and the corners of these.

use super::super::{ChartedMesh, shared_arcs::SharedArcs};
use lodpack::{LatticePoint, write::ArcSample};
use lodpack_mesh::NONE;
use lodpack_stage::arcs::HalfArc;

/// The arcs around the nodes that groups are made of: those of a region's charts, or those between regions.
pub(in super::super) struct Net<'a> {
    pub corners: &'a [LatticePoint],
    /// Of each corner the coarsest level at which it is a vertex of the nodes at the bottom; at most the level of these
    /// where they all have it.
    pub corner_levels: Vec<u8>,
    /// Whether what lies beyond is not known here, so that the corner has to stay.
    pub is_fixed: Vec<bool>,
    /// Of each arc the corners at its ends.
    pub ends: Vec<[u32; 2]>,
    /// Of each arc the nodes on its left and on its right, [`lodpack_mesh::NONE`] for none.
    pub sides: Vec<[u32; 2]>,
    /// Of each arc its samples, ends excluded.
    pub samples: &'a [Vec<ArcSample>],
}

impl<'a> Net<'a> {
    /// The arcs of a region. Corners on its boundary to other regions stay.
    pub fn of_region(charted: &ChartedMesh, arcs: &'a SharedArcs) -> Self {
        let atlas = charted.atlas;
        let mut is_fixed = vec![false; atlas.corners.len()];
        let on_seams = atlas.arcs.iter().filter(|arc| arc.seam.is_some()).flat_map(|arc| arc.ends);
        on_seams.for_each(|end| is_fixed[end as usize] = true);
        Self {
            corners: &arcs.corners,
            corner_levels: vec![charted.coarsest; atlas.corners.len()],
            is_fixed,
            ends: atlas.arcs.iter().map(|arc| arc.ends).collect(),
            sides: atlas.arcs.iter().map(|arc| arc.charts).collect(),
            samples: &arcs.samples,
        }
    }

    /// The corners where a half-arc begins and ends.
    pub fn ends_of(&self, half_arc: HalfArc) -> [u32; 2] {
        let [a, b] = self.ends[half_arc.arc as usize];
        if half_arc.reversed { [b, a] } else { [a, b] }
    }

    /// Whether the surface ends at an arc. Where both of its corners are fixed, something unknown may lie beyond.
    pub fn is_boundary(&self, arc: u32) -> bool {
        let arc = arc as usize;
        self.sides[arc].contains(&NONE) && !self.ends[arc].iter().all(|&end| self.is_fixed[end as usize])
    }

    /// The samples of a half-arc's arc up to a level.
    pub fn samples_of(&self, half_arc: HalfArc, level: u8) -> Vec<ArcSample> {
        let samples = &self.samples[half_arc.arc as usize];
        samples.iter().filter(|sample| sample.level <= level).copied().collect()
    }
}
