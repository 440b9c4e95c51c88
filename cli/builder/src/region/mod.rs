//! Regions: an input is divided into them and worked on region by region, so memory depends on the size of a region,
//! not of the input.
//!
//! The surface is divided by the positions of its triangles ([`Decomposition`]). The result depends on the input and
//! the limit alone, not on the memory or on the number of machines. Each region is repaired by itself; then boundary
//! edges at the same position are joined again ([`match_boundaries`]). The arcs along them, the **seams**, get their
//! corners from the charts of both sides and their samples from their path alone ([`find_seams`]), so neither side has
//! to see the inside of the other. Between the stages regions are in memory or on disk ([`RegionStore`]).

mod boundary;
mod decompose;
mod divide;
mod earlier;
mod extent;
mod gather;
mod matching;
mod meeting;
mod nodes;
mod numbered;
mod packed;
mod runs;
mod seams;
mod settle;
mod sketch;
mod split;
mod store;
mod thickness;

pub use boundary::{BoundaryEdge, RegionBoundary, components, reverse_components};
pub use decompose::{CellCounts, Cutting, Decomposition, Division, ForEachCentroid};
pub use divide::{Counts, DividedMesh, remove_shared};
pub use earlier::Earlier;
pub use extent::Extent;
pub use lodpack_runtime::storage::memory::{REGION_TEXELS, REGION_TRIANGLES};
pub use matching::{EdgeId, Matching, match_boundaries};
pub use nodes::Nodes;
pub use numbered::NumberedMesh;
pub use runs::{RunFile, RunList};
pub use seams::find_seams;
pub use settle::settle_objects;
pub use sketch::{BoundarySketch, LoopSketch};
pub(crate) use split::centroid;
pub use split::split_mesh;
pub use store::{Region, RegionDirectory, RegionStats, RegionStore, Reversed};
pub use thickness::Thickness;

use std::ops::Range;

use rayon::prelude::*;
use xxhash_rust::xxh3::Xxh3;

use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::attributes::{RegionAttributes, Surface};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::least_bytes;
use lodpack_runtime::storage::{Record, WorkError};
use lodpack_runtime::trace;
use lodpack_stage::repair::{RepairReport, repair, repair_with_origins};
use lodpack_stage::subdivide::subdivide;

/// Why an input cannot be divided into regions, or a region cannot be worked on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegionError {
    /// A file of the work directory is unusable.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// One region takes more memory than the build may use.
    #[error(
        "{option} {} is too little: a part of this input that has to be built at once needs {option} {}MiB",
        mebibytes(*memory),
        least.div_ceil(1 << 20)
    )]
    Memory {
        /// The option that sets the limit.
        option: &'static str,
        /// The limit in bytes.
        memory: u64,
        /// Bytes that would be enough.
        least: u64,
    },
}

/// The option that limits the memory of a build.
pub const MEMORY_OPTION: &str = "--memory";

/// Bytes in mebibytes, with decimals below one.
fn mebibytes(bytes: u64) -> String {
    if bytes < 1 << 20 { format!("{:.2}MiB", bytes as f64 / f64::from(1 << 20)) } else { format!("{}MiB", bytes >> 20) }
}

/// All regions of an input, repaired and consistently wound.
#[derive(Debug)]
pub struct Regions {
    /// The regions, some of which may have no triangle.
    pub store: RegionStore,
    /// What stays in memory of each.
    pub stats: Vec<RegionStats>,
    /// Which of their boundary edges are the same edge.
    pub matching: Matching,
    /// How many vertices count twice because another region has them too.
    pub doubled_vertices: u64,
    /// What repair did in all regions.
    pub repairs: RepairReport,
    /// How the surface looks.
    pub appearance: Appearance,
    /// The objects and assemblies of the input that are kept, and how many there are of each.
    pub nodes: Nodes,
}

impl Regions {
    /// Divides, repairs and matches a mesh.
    pub fn in_memory(mut surface: Surface, division: Division) -> Self {
        let (appearance, nodes) = (surface.appearance.clone(), Nodes::taken(&mut surface.attributes));
        let meshes = split_mesh(surface, division);
        let alone = meshes.len() == 1;
        let of_all = trace::parallel("regions");
        let (regions, stats) = meshes.into_par_iter().map(|mesh| repaired(mesh, &appearance, alone)).unzip();
        drop(of_all);
        Self::matched(RegionStore::Memory(regions), stats, appearance, nodes)
    }

    /// Repairs and matches a divided mesh, as many regions at a time as fit in `memory`. Regions that are already
    /// repaired, here or in an earlier job, are not repaired again. `for_later` adds the hashes by which a later job
    /// finds regions. Progress is in triangles.
    ///
    /// # Errors
    /// [`RegionError`].
    pub fn on_disk(
        mut divided: DividedMesh,
        memory: u64,
        for_later: bool,
        earlier: Option<&Earlier>,
        progress: &dyn Progress,
    ) -> Result<Self, RegionError> {
        let (largest, count) = (divided.largest_region_bytes(), divided.region_count());
        let nodes = divided.take_nodes();
        // Names leave memory for fewer regions at once, but for one in any case.
        let at_once = at_once(largest, memory.saturating_sub(nodes.bytes()).max(memory.min(least_bytes(largest))))?;
        let store = RegionDirectory::new(divided.directory.clone(), divided.job, count, at_once);
        let stats = repair_regions(&store, &divided, 0..count, for_later, earlier, progress)?;
        let appearance = divided.appearance().clone();
        divided.finish();
        Ok(Self::matched(RegionStore::Directory(store), stats, appearance, nodes))
    }

    fn matched(mut store: RegionStore, mut stats: Vec<RegionStats>, appearance: Appearance, nodes: Nodes) -> Self {
        let Agreement { matching, doubled_vertices, repairs, reversed } = Agreement::of(&mut stats);
        if store.count() > 1 {
            store.reverse(reversed);
        }
        Self { store, stats, matching, doubled_vertices, repairs, appearance, nodes }
    }
}

/// What follows for all regions from how each was repaired.
#[derive(Debug)]
pub struct Agreement {
    /// Which boundary edges are the same edge.
    pub matching: Matching,
    /// How many vertices count twice because another region has them too.
    pub doubled_vertices: u64,
    /// What repair did in all regions.
    pub repairs: RepairReport,
    /// For each region and component whether it has to be reversed; nothing where there is only one region.
    pub reversed: Vec<Reversed>,
}

impl Agreement {
    /// Matches the boundaries of all regions, and reverses them as their components are reversed.
    pub fn of(stats: &mut [RegionStats]) -> Self {
        let mut repairs =
            stats.iter().map(|stats| stats.repairs.clone()).reduce(RepairReport::plus).unwrap_or_default();
        let boundaries: Vec<&RegionBoundary> = stats.iter().map(|stats| &stats.boundary).collect();
        let mut matching = match_boundaries(&boundaries);
        let doubled_vertices = matching.doubled_vertices(&boundaries);
        let reversed = std::mem::take(&mut matching.reversed);
        if stats.len() == 1 {
            return Self { matching, doubled_vertices, repairs, reversed: vec![] };
        }
        matching.report(&mut repairs);
        stats.iter_mut().zip(&reversed).for_each(|(stats, reversed)| stats.boundary.reverse(reversed));
        Self { matching, doubled_vertices, repairs, reversed }
    }
}

/// How many regions of at most `largest` bytes fit in memory at a time.
///
/// # Errors
/// [`RegionError::Memory`] if none does.
pub fn at_once(largest: u64, memory: u64) -> Result<usize, RegionError> {
    let least = least_bytes(largest);
    if memory < least {
        return Err(RegionError::Memory { option: MEMORY_OPTION, memory, least });
    }
    let more = usize::try_from((memory - least) / largest.max(1)).unwrap_or(usize::MAX);
    Ok(rayon::current_num_threads().min(more.saturating_add(1)))
}

/// Repairs a range of regions, as many at a time as the store allows. Those that are already repaired, here or in an
/// earlier job, are not repaired again. `for_later` adds the hashes by which a later job finds regions. Progress is in
/// triangles.
///
/// # Errors
/// If files cannot be read or written.
pub fn repair_regions(
    store: &RegionDirectory,
    divided: &DividedMesh,
    range: Range<usize>,
    for_later: bool,
    earlier: Option<&Earlier>,
    progress: &dyn Progress,
) -> Result<Vec<RegionStats>, WorkError> {
    let (count, appearance) = (divided.region_count(), divided.appearance());
    let repair = |(mesh, attributes): (Mesh, RegionAttributes)| {
        let (triangles, input) = (mesh.triangles.len() as u64, if for_later { hash(&mesh, &attributes) } else { 0 });
        let earlier = earlier.filter(|_| count > 1).and_then(|earlier| earlier.repaired(input));
        let (region, stats) = earlier.unwrap_or_else(|| repaired((mesh, attributes), appearance, count == 1));
        let result = (region, RegionStats { input, ..stats });
        progress.advance(triangles);
        result
    };
    store.repair(range, |region| divided.take(region), repair, |region| divided.discard(region))
}

fn repaired(
    (mesh, mut attributes): (Mesh, RegionAttributes),
    appearance: &Appearance,
    alone: bool,
) -> (Region, RegionStats) {
    let _pass = trace::pass("repair");
    let has_attributes = attributes != RegionAttributes::default();
    let (mut mesh, mut adjacency, repairs) = if has_attributes {
        let (mesh, adjacency, repairs, origins) = repair_with_origins(mesh, &attributes.objects);
        attributes.keep(origins.into_iter());
        (mesh, adjacency, repairs)
    } else {
        repair(mesh)
    };
    let mut extent = Extent::of(&mesh, &adjacency, repairs.components);
    if has_attributes {
        extent.add(subdivide(&mut mesh, &mut adjacency, &mut attributes, appearance, alone));
    }
    let boundary = match alone {
        true => RegionBoundary::default(),
        false => RegionBoundary::new(&mesh, &adjacency, &components(&adjacency), &attributes.objects),
    };
    let stats = RegionStats { boundary, extent, repairs, input: 0, attribute_bytes: attributes.bytes() };
    (Region { mesh, adjacency, labels: vec![], attributes }, stats)
}

/// Positions or triangles that are hashed at once.
const HASHED: usize = 4096;

/// XXH3 hash of positions, triangles and attributes.
fn hash(mesh: &Mesh, attributes: &RegionAttributes) -> u64 {
    let mut hash = Xxh3::new();
    add_records(&mut hash, &mesh.positions);
    add_records(&mut hash, &mesh.triangles);
    add_records(&mut hash, &attributes.corners);
    add_records(&mut hash, &attributes.records);
    add_records(&mut hash, &attributes.materials);
    add_records(&mut hash, &attributes.charts);
    add_records(&mut hash, &attributes.objects);
    hash.digest()
}

fn add_records<R: Record>(hash: &mut Xxh3, records: &[R]) {
    let mut bytes = vec![];
    for some in records.chunks(HASHED) {
        bytes.clear();
        some.iter().for_each(|record| record.put(&mut bytes));
        hash.update(&bytes);
    }
}
