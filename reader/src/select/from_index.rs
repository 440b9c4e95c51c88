//! From the index of a file to a hierarchy, and to cuts: each root becomes a node, each of its blocks a resolution, each arc a border.
//!
//! Everything that adaptation asks of a file stands here: its clusters and their index blocks.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

use super::{
    cut::{Cut, Limiter, Outside, Query, select_in},
    front::{ABSENT, Front},
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
    let near = index.clusters_in(&mut |entry| meets(entry.sums.bounds))?;
    let near: Vec<u32> = near.into_iter().map(|entry| entry.first_cluster).collect();
    let contents = Contents { with_bytes: query.max_bytes.is_some() };
    let hierarchy = hierarchy_of(index, &near, &mut |_, entry| meets(entry.bounds), contents)?;
    select_in(&Arc::new(hierarchy), query)
}

/// The cut that draws everything at `level`: leaves at the next coarser level that they have, tops at the next finer one where they
/// have no coarser one.
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
        let root = front.hierarchy.id(node);
        let block = index.root_entry(root)?.uniform_block(level, root < index.top_count());
        front.place(node, if block.is_some() { front.hierarchy.resolution_at(node, level) } else { ABSENT });
    }
    Ok(Cut { limited_by: Limiter::Finest, ..front.cut() })
}

/// The number of boundary edges in the mesh of a cut: those on arcs that only one of its roots uses. Two chords without samples
/// between the same corners, as around a narrow hole, close it.
///
/// # Errors
/// As [`select_cut`].
pub fn boundary_edge_count(index: &Index, cut: &Cut) -> Result<u64> {
    index.load_indices(index.owners(cut.nodes.iter().map(|node| node.root), |cluster| cluster.first_root)?)?;
    let entries = cut.nodes.iter().map(|node| Ok((node.root, index.root_entry(node.root)?)));
    let entries = entries.collect::<Result<Vec<_>>>()?;
    let borders = Borders { index, numbers: HashMap::new(), sample_counts: Vec::new() };
    borders.load(&entries)?;
    // For each arc the number of its uses; for each arc and corner the finest level of its users.
    let mut uses: HashMap<u32, (u32, u8)> = HashMap::new();
    let mut corner_levels: HashMap<u32, u8> = HashMap::new();
    for (node, (_, entry)) in cut.nodes.iter().zip(&entries) {
        let level = entry.blocks[entry.block_at(node.level)].level;
        for half_arc in entry.half_arcs() {
            let (count, finest) = uses.entry(half_arc.arc).or_insert((0, 0));
            (*count, *finest) = (*count + 1, level.max(*finest));
            for corner in borders.ends(half_arc)? {
                let finest = corner_levels.entry(corner).or_insert(0);
                *finest = level.max(*finest);
            }
        }
    }
    let is_drawn = |corner: u32| -> Result<bool> {
        let coarsest = if borders.has_tree() { borders.corner_level(corner)? } else { 0 };
        Ok(corner_levels.get(&corner).is_some_and(|&level| level >= coarsest))
    };
    let (mut edges, mut chords) = (0, BTreeMap::<[u32; 2], i64>::new());
    for half_arcs in entries.iter().flat_map(|(_, entry)| &entry.loops) {
        let Some(first) = half_arcs.first() else { continue };
        // Every loop begins with a corner that is drawn.
        let mut from = borders.ends(*first)?[0];
        let mut samples = 0;
        for &half_arc in half_arcs {
            let [_, to] = borders.ends(half_arc)?;
            let (count, level) = uses.get(&half_arc.arc).copied().unwrap_or_default();
            samples += u64::from(borders.sample_count(half_arc.arc, level)?);
            if !is_drawn(to)? {
                continue;
            }
            match (count, samples) {
                (1, 0) => *chords.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 },
                (1, _) => edges += samples + 1,
                _ => {}
            }
            (from, samples) = (to, 0);
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
    let ids = kept_roots(index, clusters, keep)?;
    let mut borders = Borders { index, numbers: HashMap::new(), sample_counts: Vec::new() };
    borders.load(&ids)?;
    let number = |root: u32| ids.binary_search_by_key(&root, |&(root, _)| root).ok().map(|number| number as u32);
    let mut nodes = Vec::with_capacity(ids.len());
    for &(root, entry) in &ids {
        nodes.push(HierarchyNode {
            bounds: entry.bounds.map(|point| index.lattice().world(point)),
            parent: index.parent(root)?.and_then(number),
            resolutions: resolutions(index, entry),
            borders: borders.of(entry)?,
        });
    }
    let (sample_counts, level_count) = (borders.sample_counts, index.level_count() as u8);
    let roots: Vec<u32> = ids.iter().map(|&(root, _)| root).collect();
    let page_bytes =
        if contents.with_bytes { super::page_bytes::add_pages(index, &roots, &mut nodes)? } else { Vec::new() };
    Ok(Hierarchy::new(&nodes, sample_counts, level_count, page_bytes)?.with_ids(roots))
}

/// Leaves of some clusters that take part, and all above them, ascending. In a prefix of a file, roots whose children have no level in it
/// are leaves.
fn kept_roots<'i>(index: &'i Index, clusters: &[u32], keep: &mut Keep<'_>) -> Result<Vec<(u32, &'i RootEntry)>> {
    index.load_indices(clusters.iter().copied())?;
    let mut kept = BTreeSet::new();
    for &number in clusters {
        let roots = (index.cluster(number)?.first_root..).zip(&index.cluster_index(number)?.roots);
        let has_level = |level: u8| usize::from(level) < index.level_count();
        let is_leaf = |entry: &RootEntry| {
            let last = entry.blocks.last().is_some_and(|block| has_level(block.level + 1));
            entry.blocks.first().is_some_and(|block| has_level(block.level)) && !(last && entry.child_count > 0)
        };
        kept.extend(roots.filter(|(root, entry)| is_leaf(entry) && keep(*root, entry)).map(|(root, _)| root));
    }
    // What has no leaf inside is not inside, whatever its box is.
    let mut above = kept.clone();
    while let Some(root) = above.pop_last() {
        if let Some(parent) = index.parent(root)?
            && kept.insert(parent)
        {
            above.insert(parent);
        }
    }
    kept.into_iter().map(|root| Ok((root, index.root_entry(root)?))).collect()
}

/// The borders of a hierarchy: arcs, and corners that are no vertices at some level, as if each were an arc with one sample.
struct Borders<'i> {
    index: &'i Index,
    numbers: HashMap<(bool, u32), u32>,
    sample_counts: Vec<u32>,
}

impl Borders<'_> {
    /// Makes sure that what the index says of the arcs and corners of these roots is there.
    fn load(&self, roots: &[(u32, &RootEntry)]) -> Result<()> {
        let index = self.index;
        let half_arcs = || roots.iter().flat_map(|(_, entry)| entry.half_arcs());
        index.load_indices(index.owners(half_arcs().map(|half_arc| half_arc.arc), |cluster| cluster.first_arc)?)?;
        if !self.has_tree() {
            return Ok(());
        }
        let mut corners = BTreeSet::new();
        for half_arc in half_arcs() {
            corners.extend(self.ends(half_arc)?);
        }
        index.load_indices(index.owners(corners, |cluster| cluster.first_corner)?)
    }

    fn has_tree(&self) -> bool {
        self.index.top_count() < self.index.root_count()
    }

    fn ends(&self, half_arc: HalfArc) -> Result<[u32; 2]> {
        let owner = self.index.owner(half_arc.arc, |cluster| cluster.first_arc)?;
        let local = half_arc.arc - self.index.cluster(owner)?.first_arc;
        let ends = self.index.cluster_index(owner)?.arc_ends.get(local as usize).copied();
        Ok(half_arc.directed(ends.ok_or_else(|| Error::format("an arc does not exist"))?))
    }

    /// The number of samples that an arc has at a level.
    fn sample_count(&self, arc: u32, level: u8) -> Result<u32> {
        let owner = self.index.owner(arc, |cluster| cluster.first_arc)?;
        Ok(self.index.cluster_index(owner)?.sample_count(arc - self.index.cluster(owner)?.first_arc, level))
    }

    /// The coarsest level at which a corner is a vertex.
    fn corner_level(&self, corner: u32) -> Result<u8> {
        let owner = self.index.owner(corner, |cluster| cluster.first_corner)?;
        let local = (corner - self.index.cluster(owner)?.first_corner) as usize;
        let level = self.index.cluster_index(owner)?.corner_levels.get(local).copied();
        level.ok_or_else(|| Error::format("a corner does not exist"))
    }

    /// The borders of a root, in the order of its loops.
    fn of(&mut self, entry: &RootEntry) -> Result<Vec<u32>> {
        let level_count = self.index.level_count() as u8;
        let mut borders = Vec::new();
        for half_arc in entry.half_arcs() {
            let next = self.numbers.len() as u32;
            let border = *self.numbers.entry((false, half_arc.arc)).or_insert(next);
            if border == next {
                for level in 0..level_count {
                    self.sample_counts.push(self.sample_count(half_arc.arc, level)?);
                }
            }
            borders.push(border);
            if !self.has_tree() {
                continue;
            }
            let [corner, _] = self.ends(half_arc)?;
            let coarsest = self.corner_level(corner)?;
            if coarsest > 0 {
                let next = self.numbers.len() as u32;
                let border = *self.numbers.entry((true, corner)).or_insert(next);
                if border == next {
                    self.sample_counts.extend((0..level_count).map(|level| u32::from(level >= coarsest)));
                }
                borders.push(border);
            }
        }
        Ok(borders)
    }
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
