//! From the index of a file to a hierarchy, and to cuts: each root becomes a node, each of its blocks a resolution,
//! each arc a border.
//!
//! Everything that adaptation asks of a file stands here: its clusters and their index blocks.

use std::{collections::HashMap, sync::Arc};

use super::{
    adaptation::Adaptation,
    cut::{Cut, Limiter, Outside, Query, adapt_from_scratch},
    front::Front,
    hierarchy::{Hierarchy, HierarchyNode, Resolution},
    known::{Known, coarsest_level},
    lines::Lines,
    weights::{Scope, Weights},
};
use crate::{
    error::{Error, Result},
    format::{
        clusters::{Cluster, Entry},
        index_block::{BlockEntry, RootEntry},
        levels::LevelRecord,
    },
    index::Index,
    lattice::LatticePoint,
    objects::ObjectState,
    sorted::SortedMap,
};

/// Where a file's whole INDEX has at most this many bytes, all index blocks that a query may reach are read at once: a
/// round trip costs more.
pub(crate) const SMALL_INDEX_BYTES: u64 = 64 << 10;

/// Finds the cut for a query, from the index alone: it walks down from the tops, and splits what the query wants finer.
///
/// # Errors
/// [`Error::Missing`] until the needed lists and index blocks have been supplied; [`Error::Query`] as
/// [`super::select_in`];
/// [`Error::Format`], [`Error::Limit`].
pub fn select_cut(index: &Index, query: &Query) -> Result<Cut> {
    Ok(walk(index, query, Above::Forgets)?.cut())
}

/// What becomes of roots that no cut within the tolerance can draw.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Above {
    /// Nobody looks at them again. They have most of the arcs, since the borders of large groups are long.
    Forgets,
    /// They stay for later queries.
    Keeps,
}

/// Walks down until nothing that the cut wants finer is left unknown.
fn walk(index: &Index, query: &Query, above: Above) -> Result<Adaptation> {
    let scope = query.scope()?;
    let keeps_all = query.outside == Outside::Coarsest;
    let factor = |bounds: [LatticePoint; 2]| scope.factor(bounds.map(|point| index.lattice().world(point)));
    let meets = |bounds: [LatticePoint; 2]| keeps_all || factor(bounds) > 0.0;
    let filter = query.objects.as_ref();
    filter.map_or(Ok(()), |filter| index.id().check_filter(filter.file))?;
    // Where most objects are hidden, most of what a query probably needs is not drawn.
    if filter.is_none_or(|filter| filter.rest != ObjectState::Hidden) {
        look_ahead(index, query, &factor)?;
    }
    let contents = Contents { with_bytes: query.max_bytes.is_some() };
    let mut known = Known::tops(index, &meets, filter)?;
    known.split_mixed()?;
    loop {
        if !(query.has_budget() || query.max_nodes.is_some()) {
            split_needed(index, &mut known, above, query, &factor)?;
        }
        let hierarchy = hierarchy_of(index, &known.roots(), &|root| Ok(known.parent(root)), contents)?;
        let hierarchy = Arc::new(hierarchy.of_objects(query.objects.clone()));
        let mut adaptation = adapt_from_scratch(&hierarchy, query)?;
        let open = open_roots(index, &known, &adaptation)?;
        if open.is_empty() {
            return Ok(adaptation);
        }
        if holds_tops(index, query, &known)? {
            // As the adaptation says where it knows the children.
            adaptation.blocked_by = Some(Limiter::Nodes);
            return Ok(adaptation);
        }
        known.split(&open)?;
    }
}

/// Whether a node budget is too small for the children of any top: then nobody needs to know these. Of a query that
/// drops what is outside, a part of the children may be drawn, which is not known before.
fn holds_tops(index: &Index, query: &Query, known: &Known<'_, '_>) -> Result<bool> {
    let draws_all = query.outside == Outside::Coarsest || query.volume.is_none() && query.view.is_none();
    let Some(most) = query.max_nodes.filter(|_| draws_all && !query.has_budget()) else { return Ok(false) };
    let roots = known.roots();
    for &root in &roots {
        let children = u64::from(index.root_entry(root)?.child_count);
        if known.parent(root).is_some() || children > 0 && roots.len() as u64 - 1 + children <= most {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Asks at once for the index blocks that a query probably needs, so that it takes few round trips. What it asks for
/// does not decide which cut is found.
fn look_ahead(index: &Index, query: &Query, factor: &dyn Fn([LatticePoint; 2]) -> f64) -> Result<()> {
    let is_small = index.index_bytes() <= SMALL_INDEX_BYTES;
    let tolerance = query.goal(0.0).tolerance;
    let is_limited = query.max_nodes.is_some() || query.max_bytes.is_some();
    let is_everything = query.volume.is_none() && query.view.is_none();
    let levels = &index.levels().levels;
    // What a small index is read for at once. Budgets go further in a part of the surface, by nobody knows how much.
    let may_reach = |entry: &Entry, coarser: &LevelRecord, factor: f64| {
        let wants_finer = query.outside == Outside::Coarsest || factor * coarser.max_error > tolerance;
        // Roots come coarse to fine, and a cut has more nodes than roots above it.
        let first = u64::from(entry.sums.first_root);
        let fits = query.max_triangles.is_none_or(|most| coarser.triangle_count <= most)
            && query.max_bytes.is_none_or(|most| coarser.page_offset.saturating_add(coarser.page_bytes) <= most)
            && query.max_nodes.is_none_or(|most| first <= most.saturating_mul(2));
        wants_finer && (fits || !is_everything)
    };
    let mut is_needed = |entry: &Entry| {
        let factor = factor(entry.sums.bounds);
        // Where the next coarser level is fine enough, or already too much for a budget, nobody asks for this one.
        let coarser = coarsest_level(entry).checked_sub(1).and_then(|level| levels.get(level));
        let is_finer = |coarser: &LevelRecord| {
            let fits = query.max_triangles.is_none_or(|most| coarser.triangle_count <= most);
            factor > 0.0 && factor * coarser.max_error > tolerance && fits && !is_limited
        };
        let meets = factor > 0.0 || query.outside == Outside::Coarsest;
        meets && coarser.is_none_or(|coarser| is_finer(coarser) || is_small && may_reach(entry, coarser, factor))
    };
    let needed = index.clusters_in(&mut is_needed)?;
    index.load_indices(needed.into_iter().map(|entry| entry.first_cluster))
}

/// Splits the roots that no cut within the tolerance can draw: those whose own error is too large at their finest
/// level. So most of the way down takes no adaptation.
fn split_needed(
    index: &Index,
    known: &mut Known<'_, '_>,
    above: Above,
    query: &Query,
    factor: &dyn Fn([LatticePoint; 2]) -> f64,
) -> Result<()> {
    let tolerance = query.goal(0.0).tolerance;
    loop {
        let mut needed = Vec::new();
        for root in known.roots() {
            let entry = index.root_entry(root)?;
            let factor = factor(entry.bounds);
            let error = entry.blocks.last().map_or(0.0, |block| block.error.bound(&index.lattice()));
            if known.is_open(root, entry) && factor > 0.0 && factor * error > tolerance {
                needed.push(root);
            }
        }
        if needed.is_empty() {
            return Ok(());
        }
        match above {
            Above::Keeps => known.split(&needed)?,
            Above::Forgets => known.replace(&needed)?,
        }
    }
}

/// The roots of a cut whose children it would draw, if it knew them: drawn at their finest level, with an error that is
/// above the tolerance and above that of everything that a budget keeps from being finer.
fn open_roots(index: &Index, known: &Known<'_, '_>, adaptation: &Adaptation) -> Result<Vec<u32>> {
    let front = &adaptation.front;
    let inside: Vec<u32> =
        (0..front.hierarchy.node_count()).filter(|&node| front.is_drawn(node) && front.is_inside(node)).collect();
    let held = inside.iter().filter(|&&node| front.can_refine(node)).map(|&node| front.error(node));
    let enough = held.fold(adaptation.goal.tolerance, f64::max);
    let mut open = Vec::new();
    for node in inside {
        let root = front.hierarchy.id(node);
        if !front.can_refine(node) && front.error(node) > enough && known.is_open(root, index.root_entry(root)?) {
            open.push(root);
        }
    }
    Ok(open)
}

/// The cut that draws everything at `level`: leaves at the next coarser level that they have, tops at the next finer
/// one where they have no coarser one.
///
/// # Errors
/// [`Error::Missing`]; [`Error::Query`] if the file has no such level; [`Error::Format`], [`Error::Limit`].
pub fn uniform_cut(index: &Index, level: u8) -> Result<Cut> {
    if usize::from(level) >= index.level_count() {
        return Err(Error::Query { what: format!("level {level} does not exist: there are {}", index.level_count()) });
    }
    // Clusters that begin with a finer level are not drawn, except for tops, which lists count as drawn at every level.
    let clusters = index.clusters_in(&mut |entry| coarsest_level(entry) <= usize::from(level))?;
    index.load_indices(clusters.iter().map(|entry| entry.first_cluster))?;
    let mut roots = Vec::new();
    for cluster in clusters {
        let entries = (cluster.sums.first_root..).zip(&index.cluster_index(cluster.first_cluster)?.roots);
        let drawn = entries.filter(|(root, entry)| {
            let in_file = entry.blocks.first().is_some_and(|block| usize::from(block.level) < index.level_count());
            in_file && entry.uniform_block(level, *root < index.top_count()).is_some()
        });
        roots.extend(drawn.map(|(root, _)| root));
    }
    let hierarchy = hierarchy_of(index, &roots, &|_| Ok(None), Contents { with_bytes: false })?;
    let hierarchy = Arc::new(hierarchy);
    let weights = Weights::new(&hierarchy, Scope::default(), 0.0);
    let mut front = Front::new(hierarchy, weights, false);
    for node in 0..front.hierarchy.node_count() {
        front.place(node, front.hierarchy.resolution_at(node, level));
    }
    Ok(Cut { limited_by: Limiter::Finest, ..front.cut() })
}

/// The number of boundary edges in the mesh of a cut: those on arcs that only one of its roots uses. Two chords without
/// samples between the same corners, as around a narrow hole, close it.
///
/// # Errors
/// As [`select_cut`].
pub fn boundary_edge_count(index: &Index, cut: &Cut) -> Result<u64> {
    index.id().check_cut(cut.file)?;
    index.load_indices(index.owners(cut.nodes.iter().map(|node| node.root), Cluster::roots)?)?;
    let entries = cut.nodes.iter().map(|node| Ok((node.root, index.root_entry(node.root)?)));
    let entries = entries.collect::<Result<Vec<_>>>()?;
    let lines = Lines { index };
    lines.load(&entries)?;
    // For each arc the number of its uses; for each arc and corner the finest level of its users.
    let mut uses: HashMap<u32, (u32, u8)> = HashMap::new();
    let mut corner_levels: HashMap<u32, u8> = HashMap::new();
    for (node, (_, entry)) in cut.nodes.iter().zip(&entries) {
        let level = entry.blocks[entry.block_at(node.level)].level;
        for half_arc in entry.half_arcs() {
            let (count, finest) = uses.entry(half_arc.arc).or_insert((0, 0));
            (*count, *finest) = (*count + 1, level.max(*finest));
            for corner in lines.ends(half_arc)? {
                let finest = corner_levels.entry(corner).or_insert(0);
                *finest = level.max(*finest);
            }
        }
    }
    let is_drawn = |corner: u32| -> Result<bool> {
        let coarsest = if lines.has_tree() { lines.corner_level(corner)? } else { 0 };
        Ok(corner_levels.get(&corner).is_some_and(|&level| level >= coarsest))
    };
    let (mut edges, mut chords) = (0, SortedMap::<[u32; 2], i64>::new());
    for half_arcs in entries.iter().flat_map(|(_, entry)| &entry.loops) {
        let Some(first) = half_arcs.first() else { continue };
        // Every loop begins with a corner that is drawn.
        let mut from = lines.ends(*first)?[0];
        let mut samples = 0;
        for &half_arc in half_arcs {
            let [_, to] = lines.ends(half_arc)?;
            let (count, level) = uses.get(&half_arc.arc).copied().unwrap_or_default();
            samples += u64::from(lines.sample_count(half_arc.arc, level)?);
            if !is_drawn(to)? {
                continue;
            }
            match (count, samples) {
                (1, 0) => *chords.or_default([from.min(to), from.max(to)]) += if from < to { 1 } else { -1 },
                (1, _) => edges += samples + 1,
                _ => {}
            }
            (from, samples) = (to, 0);
        }
    }
    Ok(edges + chords.into_values().map(i64::unsigned_abs).sum::<u64>())
}

impl Hierarchy {
    /// The part of a file that a query has to choose from: what [`select_cut`] walks through to the query's cut. A root
    /// whose children are not in it is drawn itself, however fine a later query wants it. Where the query has objects,
    /// later queries have to have the same ones. It has the bytes of blocks
    /// only if the query has a byte budget.
    ///
    /// # Errors
    /// As [`select_cut`].
    pub fn for_query(index: &Index, query: &Query) -> Result<Arc<Self>> {
        Ok(walk(index, query, Above::Keeps)?.front.hierarchy)
    }

    /// Everything that a file has to choose from, for a [`super::Adapter`]: all roots, and the bytes of their blocks.
    /// Needs the whole index.
    ///
    /// # Errors
    /// [`Error::Missing`] until the index has been supplied; [`Error::Format`], [`Error::Limit`].
    pub fn from_index(index: &Index) -> Result<Self> {
        let clusters = index.clusters()?;
        index.load_indices(0..index.cluster_count())?;
        let mut roots = Vec::new();
        for (number, cluster) in (0..).zip(clusters) {
            let entries = (cluster.first_root..).zip(&index.cluster_index(number)?.roots);
            let first_level = |entry: &RootEntry| entry.blocks.first().map_or(u8::MAX, |block| block.level);
            let in_file = entries.filter(|(_, entry)| usize::from(first_level(entry)) < index.level_count());
            roots.extend(in_file.map(|(root, _)| root));
        }
        hierarchy_of(index, &roots, &|root| index.parent(root), Contents { with_bytes: true })
    }
}

/// What to put into a hierarchy.
#[derive(Clone, Copy)]
struct Contents {
    /// The pages that each resolution needs.
    with_bytes: bool,
}

/// A hierarchy of these roots, ascending; each but those without a parent comes with its parent.
fn hierarchy_of(
    index: &Index,
    roots: &[u32],
    parent: &dyn Fn(u32) -> Result<Option<u32>>,
    contents: Contents,
) -> Result<Hierarchy> {
    let entries = roots.iter().map(|&root| Ok((root, index.root_entry(root)?))).collect::<Result<Vec<_>>>()?;
    let lines = Lines { index };
    lines.load(&entries)?;
    let number = |root: u32| roots.binary_search(&root).ok().map(|number| number as u32);
    let mut nodes = Vec::with_capacity(roots.len());
    for &(root, entry) in &entries {
        nodes.push(HierarchyNode {
            bounds: entry.bounds.map(|point| index.lattice().world(point)),
            parent: parent(root)?.and_then(number),
            resolutions: resolutions(index, entry),
            borders: Vec::new(),
        });
    }
    let (sample_counts, level_count) = (lines.add_borders(&entries, &mut nodes)?, index.level_count() as u8);
    let page_bytes =
        if contents.with_bytes { super::page_bytes::add_pages(index, roots, &mut nodes)? } else { Vec::new() };
    Ok(Hierarchy::new(&nodes, sample_counts, level_count, page_bytes)?.with_ids(roots.to_vec()).of_file(index.id()))
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
