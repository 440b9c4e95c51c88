//! From the index of a file to a hierarchy, and to cuts: each root becomes a node without children, each of its blocks a resolution,
//! each arc a border.
//!
//! Everything that adaptation asks of a file stands here: its clusters and their index blocks.

use std::{
    collections::{BTreeMap, HashMap},
    sync::Arc,
};

use super::{
    cut::{Cut, Limiter, Outside, Query, select_in},
    front::Front,
    hierarchy::{Hierarchy, HierarchyNode, Resolution},
    weights::{Scope, Weights},
};
use crate::{
    error::{Error, Result},
    format::{
        index_block::{BlockEntry, RootEntry},
        records::HalfArc,
    },
    index::Index,
    lattice::LatticePoint,
};

/// Finds the cut for a query, from the index alone.
///
/// # Errors
/// [`Error::Missing`] until the needed index blocks have been supplied; [`Error::Query`] as [`select_in`]; [`Error::Format`],
/// [`Error::Limit`].
pub fn select_cut(index: &Index, query: &Query) -> Result<Cut> {
    let scope = query.scope()?;
    let keeps_all = query.outside == Outside::Coarsest;
    let meets =
        |bounds: [LatticePoint; 2]| keeps_all || scope.factor(bounds.map(|point| index.lattice().world(point))) > 0.0;
    let numbered = (0..).zip(index.clusters());
    let near: Vec<u32> = numbered.filter(|(_, c)| meets(c.bounds)).map(|(number, _)| number).collect();
    let contents = Contents { with_bytes: query.max_bytes.is_some() };
    let hierarchy = hierarchy_of(index, &near, &mut |_, entry| meets(entry.bounds), contents)?;
    select_in(&Arc::new(hierarchy), query)
}

/// The cut that draws every root at `level`, or at the next coarser one that it has.
///
/// # Errors
/// [`Error::Missing`]; [`Error::Query`] if the file has no such level; [`Error::Format`], [`Error::Limit`].
pub fn uniform_cut(index: &Index, level: u8) -> Result<Cut> {
    if usize::from(level) >= index.level_count() {
        return Err(Error::Query { what: format!("level {level} does not exist: there are {}", index.level_count()) });
    }
    let clusters: Vec<u32> = (0..index.cluster_count()).collect();
    let mut front = front_of(index, &clusters)?;
    for node in 0..front.hierarchy.node_count() {
        front.place(node, front.hierarchy.resolution_at(node, level));
    }
    Ok(Cut { limited_by: Limiter::Finest, ..front.cut() })
}

/// The number of boundary edges in the mesh of a cut: those on arcs that only one of its roots uses. Two such arcs without samples
/// between the same corners, as around a narrow hole, close it.
///
/// # Errors
/// As [`select_cut`].
pub fn boundary_edge_count(index: &Index, cut: &Cut) -> Result<u64> {
    let owner_of_root = |root| index.owner(root, |cluster| cluster.first_root);
    index.load_indices(cut.nodes.iter().map(|node| owner_of_root(node.root)).collect::<Result<Vec<_>>>()?)?;
    // For each arc, the number of its uses, the finest level of these, and whether the first is reversed.
    let mut uses: BTreeMap<u32, (u32, u8, bool)> = BTreeMap::new();
    for node in &cut.nodes {
        let entry = index.root_entry(node.root)?;
        let level = entry.blocks[entry.block_at(node.level)].level;
        for HalfArc { arc, reversed } in entry.half_arcs() {
            let (count, finest, _) = uses.entry(arc).or_insert((0, 0, reversed));
            (*count, *finest) = (*count + 1, level.max(*finest));
        }
    }
    let owner_of_arc = |arc| index.owner(arc, |cluster| cluster.first_arc);
    index.load_indices(uses.keys().map(|&arc| owner_of_arc(arc)).collect::<Result<Vec<_>>>()?)?;
    let (mut edges, mut chords) = (0, BTreeMap::<[u32; 2], i64>::new());
    for (arc, (count, level, reversed)) in uses {
        if count > 1 {
            continue;
        }
        let owner = owner_of_arc(arc)?;
        let (of_cluster, local) = (index.cluster_index(owner)?, arc - index.cluster(owner)?.first_arc);
        match (of_cluster.sample_count(local, level), of_cluster.arc_ends.get(local as usize)) {
            (0, Some(&[a, b])) => {
                *chords.entry([a.min(b), a.max(b)]).or_default() += if (a < b) == reversed { 1 } else { -1 };
            }
            (samples, _) => edges += u64::from(samples) + 1,
        }
    }
    Ok(edges + chords.into_values().map(i64::unsigned_abs).sum::<u64>())
}

impl Hierarchy {
    /// Everything that a file has to choose from, for a [`super::Adapter`]: all roots, and the bytes of their blocks. Needs the
    /// whole index.
    ///
    /// # Errors
    /// [`Error::Missing`] until the index has been supplied; [`Error::Format`], [`Error::Limit`].
    pub fn from_index(index: &Index) -> Result<Self> {
        let clusters: Vec<u32> = (0..index.cluster_count()).collect();
        hierarchy_of(index, &clusters, &mut |_, _| true, Contents { with_bytes: true })
    }
}

/// Decides whether a root takes part.
type Keep<'k> = dyn FnMut(u32, &RootEntry) -> bool + 'k;

/// What to put into a hierarchy.
#[derive(Clone, Copy)]
struct Contents {
    /// The pages that each resolution needs.
    with_bytes: bool,
}

/// All roots at their coarsest, without a scope.
fn front_of(index: &Index, clusters: &[u32]) -> Result<Front> {
    let hierarchy = Arc::new(hierarchy_of(index, clusters, &mut |_, _| true, Contents { with_bytes: false })?);
    let weights = Weights::new(&hierarchy, Scope::default(), 0.0);
    Ok(Front::new(hierarchy, weights, false))
}

fn hierarchy_of(index: &Index, clusters: &[u32], keep: &mut Keep<'_>, contents: Contents) -> Result<Hierarchy> {
    index.load_indices(clusters.iter().copied())?;
    let mut ids = Vec::new();
    let mut arc_owners = Vec::new();
    for &number in clusters {
        let (cluster, of_cluster) = (index.cluster(number)?, index.cluster_index(number)?);
        for (root, entry) in (cluster.first_root..).zip(&of_cluster.roots) {
            if keep(root, entry) {
                ids.push((root, entry));
                for half_arc in entry.half_arcs() {
                    arc_owners.push(index.owner(half_arc.arc, |cluster| cluster.first_arc)?);
                }
            }
        }
    }
    index.load_indices(arc_owners)?;

    let level_count = index.level_count() as u8;
    let mut sample_counts = Vec::new();
    let mut border_of: HashMap<u32, u32> = HashMap::new();
    let mut nodes = Vec::with_capacity(ids.len());
    for &(_, entry) in &ids {
        let mut node = HierarchyNode {
            bounds: entry.bounds.map(|point| index.lattice().world(point)),
            resolutions: resolutions(index, entry),
            ..HierarchyNode::default()
        };
        for half_arc in entry.half_arcs() {
            let next = border_of.len() as u32;
            let border = *border_of.entry(half_arc.arc).or_insert(next);
            if border == next {
                let owner = index.owner(half_arc.arc, |cluster| cluster.first_arc)?;
                let (of_cluster, local) = (index.cluster_index(owner)?, half_arc.arc - index.cluster(owner)?.first_arc);
                sample_counts.extend((0..level_count).map(|level| of_cluster.sample_count(local, level)));
            }
            node.borders.push(border);
        }
        nodes.push(node);
    }
    let roots: Vec<u32> = ids.iter().map(|&(root, _)| root).collect();
    let page_bytes =
        if contents.with_bytes { super::page_bytes::add_pages(index, &roots, &mut nodes)? } else { Vec::new() };
    Ok(Hierarchy::new(&nodes, sample_counts, level_count, page_bytes)?.with_ids(roots))
}

/// The blocks of a root that the file holds.
fn resolutions(index: &Index, entry: &RootEntry) -> Vec<Resolution> {
    let lattice = index.lattice();
    let blocks = entry.blocks.iter().take_while(|block| usize::from(block.level) < index.level_count());
    let resolution = |block: &BlockEntry| Resolution {
        level: block.level,
        error: block.error.bound(&lattice),
        border_deviation: block.border_deviation.bound(&lattice),
        triangle_count: u64::from(block.triangle_count),
        pages: Vec::new(),
    };
    blocks.map(resolution).collect()
}
