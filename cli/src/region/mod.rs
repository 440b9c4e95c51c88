//! Regions: the pieces of an input that are worked on one by one, so that memory depends on a region and not on the input.
//!
//! The surface is divided by the places of its triangles ([`Decomposition`]), a function of the input and of the limit alone:
//! how much memory there is, and on how many machines the work is done, changes nothing of it. Each region is repaired by
//! itself; then boundary edges at the same place are joined again ([`match_borders`]). The arcs along them, the **seams**, get
//! their corners from the charts of both sides and their samples from their path alone ([`find_seams`]), so that neither side
//! has to see the inside of the other. Between the stages regions are in memory or on disk ([`RegionStore`]).

mod border;
mod decompose;
mod divide;
mod extent;
mod matching;
mod seams;
mod sketch;
mod split;
mod store;
#[cfg(test)]
mod tests;

pub use border::{Border, BorderEdge, components, reverse_components};
pub use decompose::{Decomposition, ForEachCentroid};
pub use extent::Extent;
pub use matching::{EdgeId, Matching, match_borders};
pub use seams::find_seams;
pub use sketch::{BorderSketch, LoopSketch};
pub use split::split_mesh;
pub use store::{Region, RegionDirectory, RegionStore};

use rayon::prelude::*;

use crate::import::Imported;
use crate::memory::least_bytes;
use crate::mesh::Mesh;
use crate::repair::{RepairReport, repair};
use crate::temporary::TemporaryError;
use divide::DividedMesh;

/// Triangles that a region has at most. Files depend on it, so that it never depends on how much memory there is.
pub const REGION_TRIANGLES: u64 = 1 << 21;

/// Why there are no regions.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegionError {
    /// Temporary files cannot be used.
    #[error(transparent)]
    Temporary(#[from] TemporaryError),
    /// One region takes more memory than there may be.
    #[error("--memory {}MiB is too little: a part of this input that has to be built at once needs --memory {}MiB", memory >> 20, least.div_ceil(1 << 20))]
    Memory {
        /// Bytes that the build may take.
        memory: u64,
        /// Bytes that would do.
        least: u64,
    },
}

/// All regions of an input, repaired and turned to one winding.
#[derive(Debug)]
pub struct Regions {
    /// The regions, some of them perhaps without any triangle.
    pub store: RegionStore,
    /// The boundary of each; empty where there is but one region.
    pub borders: Vec<Border>,
    /// The size of each.
    pub extents: Vec<Extent>,
    /// Which of their boundary edges are one.
    pub matching: Matching,
    /// What repair did, all regions together.
    pub repairs: RepairReport,
}

/// A region as repair leaves it.
struct Repaired {
    region: Region,
    border: Border,
    extent: Extent,
    repairs: RepairReport,
}

impl Regions {
    /// Divides, repairs and matches. An input on disk is worked on with as many regions at once as fit in `memory`.
    ///
    /// # Errors
    /// [`RegionError`]; never for an input in memory.
    pub fn new(input: Imported, limit: u64, memory: u64) -> Result<Self, RegionError> {
        let (store, known) = match input {
            Imported::Memory(mesh) => {
                let meshes = split_mesh(mesh, limit);
                let alone = meshes.len() == 1;
                let repaired: Vec<Repaired> = meshes.into_par_iter().map(|mesh| Repaired::new(mesh, alone)).collect();
                let (regions, known) = repaired.into_iter().map(Repaired::split).unzip();
                (RegionStore::Memory(regions), known)
            }
            Imported::Spilled(mesh) => repair_on_disk(DividedMesh::new(mesh, limit)?, memory)?,
        };
        let mut regions = Self {
            store,
            borders: vec![],
            extents: vec![],
            matching: Matching::default(),
            repairs: RepairReport::default(),
        };
        let mut reports = vec![];
        for (border, extent, report) in known {
            regions.borders.push(border);
            regions.extents.push(extent);
            reports.push(report);
        }
        regions.repairs = reports.into_iter().reduce(RepairReport::plus).unwrap_or_default();
        regions.matching = match_borders(&regions.borders);
        if regions.store.count() > 1 {
            regions.matching.report(&mut regions.repairs);
            regions.store.reverse(&mut regions.borders, &regions.matching.reversed)?;
        }
        Ok(regions)
    }
}

/// What stays in memory of a region.
type Known = (Border, Extent, RepairReport);

impl Repaired {
    fn new(mesh: Mesh, alone: bool) -> Self {
        let (mesh, adjacency, repairs) = repair(mesh);
        let border = if alone { Border::default() } else { Border::new(&mesh, &adjacency, &components(&adjacency)) };
        let extent = Extent::of(&mesh);
        Self { region: Region { mesh, adjacency, labels: vec![] }, border, extent, repairs }
    }

    fn split(self) -> (Region, Known) {
        (self.region, (self.border, self.extent, self.repairs))
    }
}

fn repair_on_disk(divided: DividedMesh, memory: u64) -> Result<(RegionStore, Vec<Known>), RegionError> {
    let (largest, count) = (divided.largest_region_bytes(), divided.region_count());
    let least = least_bytes(largest);
    if memory < least {
        return Err(RegionError::Memory { memory, least });
    }
    let more = usize::try_from((memory - least) / largest.max(1)).unwrap_or(usize::MAX);
    let at_once = rayon::current_num_threads().min(more.saturating_add(1));
    let store = RegionDirectory::new(divided.directory.clone(), count, at_once);
    let mut known = vec![];
    for first in (0..count).step_by(at_once) {
        let meshes: Result<Vec<Mesh>, _> = (first..count.min(first + at_once)).map(|r| divided.take(r)).collect();
        let repaired: Vec<Repaired> = meshes?.into_par_iter().map(|mesh| Repaired::new(mesh, count == 1)).collect();
        for (index, repaired) in (first..).zip(repaired) {
            let (region, facts) = repaired.split();
            store.save(index, &region)?;
            known.push(facts);
        }
    }
    divided.finish();
    Ok((RegionStore::Directory(store), known))
}
