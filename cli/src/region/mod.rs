//! Regions: the pieces of an input that are worked on one by one, so that memory depends on a region and not on the input.
//!
//! The surface is divided by the places of its triangles ([`Decomposition`]), a function of the input and of the limit alone:
//! how much memory there is, and on how many machines the work is done, changes nothing of it. Each region is repaired by
//! itself; then boundary edges at the same place are joined again ([`match_borders`]). The arcs along them, the **seams**, get
//! their corners from the charts of both sides and their samples from their path alone ([`find_seams`]), so that neither side
//! has to see the inside of the other.

mod border;
mod decompose;
mod matching;
mod seams;
mod sketch;
mod split;
#[cfg(test)]
mod tests;

pub use border::{Border, BorderEdge, components, reverse_components};
pub use decompose::{Decomposition, ForEachCentroid};
pub use matching::{EdgeId, Matching, match_borders};
pub use seams::find_seams;
pub use sketch::{BorderSketch, LoopSketch};
pub use split::split_mesh;

use rayon::prelude::*;

use crate::mesh::{Adjacency, Mesh};
use crate::repair::{RepairReport, repair};

/// Triangles that a region has at most. A build needs some 90 bytes of memory for each.
pub const REGION_TRIANGLES: u64 = 1 << 21;

/// A region after repair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// Its triangles.
    pub mesh: Mesh,
    /// Who meets whom within the region.
    pub adjacency: Adjacency,
    /// Its boundary; empty where there is but one region.
    pub border: Border,
}

/// All regions of an input, repaired and turned to one winding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Regions {
    /// The regions, some of them perhaps without any triangle.
    pub regions: Vec<Region>,
    /// Which of their boundary edges are one.
    pub matching: Matching,
    /// What repair did, all regions together.
    pub repairs: RepairReport,
}

impl Regions {
    /// Divides, repairs and matches.
    pub fn new(input: Mesh, limit: u64) -> Self {
        let meshes = split_mesh(input, limit);
        let alone = meshes.len() == 1;
        let repaired: Vec<(Region, RepairReport, Vec<u32>)> = meshes
            .into_par_iter()
            .map(|mesh| {
                let (mesh, adjacency, repairs) = repair(mesh);
                let pieces = if alone { vec![] } else { components(&adjacency) };
                let border = if alone { Border::default() } else { Border::new(&mesh, &adjacency, &pieces) };
                (Region { mesh, adjacency, border }, repairs, pieces)
            })
            .collect();
        let (mut regions, mut reports, mut pieces) = (vec![], vec![], vec![]);
        for (region, report, piece) in repaired {
            regions.push(region);
            reports.push(report);
            pieces.push(piece);
        }
        let borders: Vec<&Border> = regions.iter().map(|region| &region.border).collect();
        let matching = match_borders(&borders);
        let mut repairs = reports.into_iter().reduce(RepairReport::plus).unwrap_or_default();
        if !alone {
            matching.report(&mut repairs);
            let turned = regions.par_iter_mut().zip(&pieces).zip(&matching.reversed);
            turned.filter(|(_, reversed)| reversed.contains(&true)).for_each(|((region, pieces), reversed)| {
                let Region { mesh, adjacency, border } = region;
                reverse_components(mesh, adjacency, border, pieces, reversed);
            });
        }
        Self { regions, matching, repairs }
    }
}
