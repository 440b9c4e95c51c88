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
mod earlier;
mod extent;
mod matching;
mod seams;
mod sketch;
mod split;
mod store;
#[cfg(test)]
pub(crate) mod tests;

pub use border::{Border, BorderEdge, components, reverse_components};
pub use decompose::{Decomposition, Division, ForEachCentroid};
pub use divide::DividedMesh;
pub use earlier::Earlier;
pub use extent::Extent;
pub use matching::{EdgeId, Matching, match_borders};
pub use seams::find_seams;
pub use sketch::{BorderSketch, LoopSketch};
pub use split::split_mesh;
pub use store::{Region, RegionDirectory, RegionFacts, RegionStore};

use rayon::prelude::*;

use crate::mesh::Mesh;
use crate::progress::Progress;
use crate::stage::repair::{RepairReport, repair};
use crate::storage::WorkError;
use crate::storage::memory::least_bytes;

/// Triangles that a region has at most. Files depend on it, so that it never depends on how much memory there is.
pub const REGION_TRIANGLES: u64 = 1 << 21;

/// Why there are no regions.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegionError {
    /// Temporary files cannot be used.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// One region takes more memory than there may be.
    #[error("{option} {} is too little: a part of this input that has to be built at once needs {option} {}MiB", mebibytes(*memory), least.div_ceil(1 << 20))]
    Memory {
        /// What says how much there may be.
        option: &'static str,
        /// Bytes that the build may take.
        memory: u64,
        /// Bytes that would do.
        least: u64,
    },
}

/// The option that says how much memory a build may take.
pub const MEMORY_OPTION: &str = "--memory";

/// Bytes in the unit in which needs are told; what is less than one of it is not nothing.
fn mebibytes(bytes: u64) -> String {
    if bytes < 1 << 20 { format!("{:.2}MiB", bytes as f64 / f64::from(1 << 20)) } else { format!("{}MiB", bytes >> 20) }
}

/// All regions of an input, repaired and turned to one winding.
#[derive(Debug)]
pub struct Regions {
    /// The regions, some of them perhaps without any triangle.
    pub store: RegionStore,
    /// What is known of each.
    pub facts: Vec<RegionFacts>,
    /// Which of their boundary edges are one.
    pub matching: Matching,
    /// How many vertices of regions are there twice, because another region has them, too.
    pub doubled_vertices: u64,
    /// What repair did, all regions together.
    pub repairs: RepairReport,
}

impl Regions {
    /// Divides, repairs and matches a mesh.
    pub fn in_memory(mesh: Mesh, division: Division) -> Self {
        let meshes = split_mesh(mesh, division);
        let alone = meshes.len() == 1;
        let (regions, facts) = meshes.into_par_iter().map(|mesh| repaired(mesh, alone)).unzip();
        Self::matched(RegionStore::Memory(regions), facts)
    }

    /// Repairs and matches a divided mesh, as many regions at once as fit in `memory`; what is repaired already stays so, and what an
    /// earlier job has repaired is taken from there. For a later one inputs are hashed. Progress is in triangles.
    ///
    /// # Errors
    /// [`RegionError`].
    pub fn on_disk(
        divided: DividedMesh,
        memory: u64,
        for_later: bool,
        earlier: Option<&Earlier>,
        progress: &dyn Progress,
    ) -> Result<Self, RegionError> {
        let (largest, count) = (divided.largest_region_bytes(), divided.region_count());
        let least = least_bytes(largest);
        if memory < least {
            return Err(RegionError::Memory { option: MEMORY_OPTION, memory, least });
        }
        let more = usize::try_from((memory - least) / largest.max(1)).unwrap_or(usize::MAX);
        let at_once = rayon::current_num_threads().min(more.saturating_add(1));
        let store = RegionDirectory::new(divided.directory.clone(), divided.job, count, at_once);
        let repair = |mesh: Mesh| {
            let (triangles, input) = (mesh.triangles.len() as u64, if for_later { mesh.hash() } else { 0 });
            let earlier = earlier.filter(|_| count > 1).and_then(|earlier| earlier.repaired(input));
            let (region, facts) = earlier.unwrap_or_else(|| repaired(mesh, count == 1));
            let result = (region, RegionFacts { input, ..facts });
            progress.advance(triangles);
            result
        };
        let facts = store.repair(|region| divided.take(region), repair, |region| divided.discard(region))?;
        divided.finish();
        Ok(Self::matched(RegionStore::Directory(store), facts))
    }

    fn matched(mut store: RegionStore, mut facts: Vec<RegionFacts>) -> Self {
        let mut repairs =
            facts.iter().map(|facts| facts.repairs.clone()).reduce(RepairReport::plus).unwrap_or_default();
        let borders: Vec<&Border> = facts.iter().map(|facts| &facts.border).collect();
        let mut matching = match_borders(&borders);
        let doubled_vertices = matching.doubled_vertices(&borders);
        if store.count() > 1 {
            matching.report(&mut repairs);
            let reversed = std::mem::take(&mut matching.reversed);
            facts.iter_mut().zip(&reversed).for_each(|(facts, reversed)| facts.border.reverse(reversed));
            store.reverse(reversed);
        }
        Self { store, facts, matching, doubled_vertices, repairs }
    }
}

fn repaired(mesh: Mesh, alone: bool) -> (Region, RegionFacts) {
    let (mesh, adjacency, repairs) = repair(mesh);
    let border = if alone { Border::default() } else { Border::new(&mesh, &adjacency, &components(&adjacency)) };
    let facts = RegionFacts { border, extent: Extent::of(&mesh, &adjacency), repairs, input: 0 };
    (Region { mesh, adjacency, labels: vec![] }, facts)
}
