//! The order of a file: the roots of its clusters, and the numbers that follow from them.

use super::{
    catalogue::{Catalogue, first_blocks},
    order::{UNSET, cluster_roots, from_the_top},
    piece::NO_ROOT,
};
use crate::{
    error::{Error, Result},
    format::{
        cluster_lists::number_children,
        clusters::{Cluster, ClusterLevel},
        index_block::{ClusterIndex, RootEntry},
    },
    lattice::{Lattice, LatticePoint},
};

/// A stream of blocks ends after the block that brings it to this many symbols, about half a kilobyte. Then a stream's
/// own four to six bytes cost less than one percent, and few other blocks have to be decoded to reach one.
const STREAM_SYMBOLS: usize = 2048;

/// A cluster of several roots ends before it has more half-arcs than this. The border of a group that stands for
/// thousands of leaves consists of the leaves' arcs, and a query for a small region needs one such group of each depth.
/// Leaves have about ten half-arcs, so that their clusters are never that large.
const CLUSTER_HALF_ARCS: usize = 1024;

/// A catalogue in the order of the file. Roots that are near each other in space are near each other in the file,
/// whatever pieces they come from: pieces are divided for the builder, and the order is for readers.
#[derive(Clone, Debug, Default)]
pub(super) struct Arrangement {
    pub catalogue: Catalogue,
    pub roots: Numbers,
    pub arcs: Numbers,
    pub corners: Numbers,
    /// The clusters, as far as they are known before they are encoded.
    pub clusters: Vec<Cluster>,
    pub level_count: usize,
}

/// From numbers in the catalogue to those in the file, and back.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbers {
    /// By number in the file.
    pub order: Vec<u32>,
    /// By number in the catalogue.
    pub numbers: Vec<u32>,
}

impl Numbers {
    fn new(count: usize) -> Self {
        Self { order: Vec::with_capacity(count), numbers: vec![UNSET; count] }
    }

    /// Gives an item the next number, unless it has one.
    fn number(&mut self, item: u32) {
        let number = &mut self.numbers[item as usize];
        if *number == UNSET {
            *number = self.order.len() as u32;
            self.order.push(item);
        }
    }

    fn is_complete(&self) -> bool {
        self.order.len() == self.numbers.len()
    }
}

impl Arrangement {
    /// Orders the roots. The arcs and corners that a cluster is the first to use get consecutive numbers.
    ///
    /// # Errors
    /// [`Error::Model`] if an arc is used more than twice, or an arc or corner is not used.
    pub fn new(mut catalogue: Catalogue, level_count: usize) -> Result<Self> {
        let cluster_roots = cluster_roots(catalogue.roots.len());
        for &parent in catalogue.parents.iter().filter(|&&parent| parent != NO_ROOT) {
            catalogue.roots[parent as usize].child_count += 1;
        }
        let siblings = siblings(&catalogue)?;
        let centres = std::mem::take(&mut catalogue.centres);
        let order = from_the_top(centres, &siblings, &catalogue.parents, cluster_roots);
        drop(siblings);
        let mut result = Self {
            roots: Numbers::new(catalogue.roots.len()),
            arcs: Numbers::new(catalogue.arc_ends.len()),
            corners: Numbers::new(catalogue.corners.len()),
            clusters: Vec::with_capacity(order.len().div_ceil(cluster_roots)),
            catalogue,
            level_count,
        };
        let clusters = clusters_of(&order, cluster_roots, &result.catalogue.roots);
        result.mark_streams(&clusters);
        for roots in clusters {
            let cluster = result.append(roots);
            result.clusters.push(cluster);
        }
        number_children(result.clusters.iter_mut(), order.len() as u32)?;
        if !(result.arcs.is_complete() && result.corners.is_complete()) {
            return Err(Error::model("an arc or a corner is not used"));
        }
        result.catalogue.shrink();
        Ok(result)
    }

    /// Numbers a cluster's roots, and the arcs and corners that they are the first to use.
    fn append(&mut self, roots: &[u32]) -> Cluster {
        let first = [&self.roots, &self.arcs, &self.corners].map(|numbers| numbers.order.len() as u32);
        let Self { catalogue, .. } = self;
        let entries = || roots.iter().map(|&root| &catalogue.roots[root as usize]);
        roots.iter().for_each(|&root| self.roots.number(root));
        entries().flat_map(RootEntry::half_arcs).for_each(|half_arc| self.arcs.number(half_arc.arc));
        let arcs = self.arcs.order.iter().skip(first[1] as usize);
        let ends = arcs.flat_map(|&arc| catalogue.arc_ends[arc as usize]);
        ends.for_each(|corner| self.corners.number(corner));
        let next = [&self.roots, &self.arcs, &self.corners].map(|numbers| numbers.order.len() as u32);
        Cluster {
            first_root: first[0],
            root_count: next[0] - first[0],
            first_arc: first[1],
            arc_count: next[1] - first[1],
            first_corner: first[2],
            corner_count: next[2] - first[2],
            child_count: entries().map(|root| root.child_count).sum(),
            bounds: entries().map(|root| root.bounds).reduce(union).unwrap_or_default(),
            ..Cluster::default()
        }
    }

    /// Decides which blocks begin a stream: see [`STREAM_SYMBOLS`].
    fn mark_streams(&mut self, clusters: &[&[u32]]) {
        let Catalogue { roots, block_symbols, .. } = &mut self.catalogue;
        let first_blocks = first_blocks(roots);
        for &cluster in clusters {
            let mut filled = vec![STREAM_SYMBOLS; self.level_count];
            for &root in cluster {
                let symbols = block_symbols.iter().skip(first_blocks[root as usize]);
                for (block, &symbols) in roots[root as usize].blocks.iter_mut().zip(symbols) {
                    let (filled, symbols) = (&mut filled[usize::from(block.level)], symbols as usize);
                    block.begins_stream = *filled >= STREAM_SYMBOLS;
                    *filled = if block.begins_stream { symbols } else { filled.saturating_add(symbols) };
                }
            }
        }
    }

    /// What is known of a cluster before it is encoded, in the numbers of the file.
    pub fn content(&self, number: usize) -> Result<ClusterContent> {
        let cluster = self.clusters.get(number).cloned().ok_or_else(|| Error::model("there is no such cluster"))?;
        let Catalogue { roots, arc_ends, new_samples, .. } = &self.catalogue;
        let placed = |&root: &u32| {
            let mut root = roots[root as usize].clone();
            let half_arcs = root.loops.iter_mut().flatten();
            half_arcs.for_each(|half_arc| half_arc.arc = self.arcs.numbers[half_arc.arc as usize]);
            root
        };
        let ends = |&arc: &u32| arc_ends[arc as usize].map(|corner| self.corners.numbers[corner as usize]);
        let arcs = self.arcs_of(&cluster);
        let samples = |&arc: &u32| new_samples.iter().skip(arc as usize * self.level_count).take(self.level_count);
        Ok(ClusterContent {
            entries: self.roots_of(&cluster).iter().map(placed).collect(),
            arc_ends: arcs.iter().map(ends).collect(),
            new_samples: arcs.iter().flat_map(samples).copied().collect(),
            corners: self.corners_of(&cluster).collect(),
            corner_levels: self.corner_levels_of(&cluster),
            top_count: cluster.top_count(self.clusters.first().map_or(0, |first| first.first_child)),
            level_count: self.level_count,
            cluster,
        })
    }

    /// The roots of a cluster, in the order of the file and the numbers of the catalogue.
    pub fn roots_of(&self, cluster: &Cluster) -> &[u32] {
        &self.roots.order[cluster.first_root as usize..][..cluster.root_count as usize]
    }

    /// Its arcs, likewise.
    pub fn arcs_of(&self, cluster: &Cluster) -> &[u32] {
        &self.arcs.order[cluster.first_arc as usize..][..cluster.arc_count as usize]
    }

    /// The positions of its corners.
    fn corners_of(&self, cluster: &Cluster) -> impl Iterator<Item = LatticePoint> {
        let corners = &self.corners.order[cluster.first_corner as usize..][..cluster.corner_count as usize];
        corners.iter().map(|&corner| self.catalogue.corners[corner as usize])
    }

    /// Their coarsest levels.
    fn corner_levels_of(&self, cluster: &Cluster) -> Vec<u8> {
        let corners = &self.corners.order[cluster.first_corner as usize..][..cluster.corner_count as usize];
        corners.iter().map(|&corner| self.catalogue.corner_levels[corner as usize]).collect()
    }

    /// The cluster of a root of the file.
    pub fn cluster_of_root(&self, number: u32) -> usize {
        self.clusters.partition_point(|cluster| cluster.first_root <= number).saturating_sub(1)
    }

    /// The cluster that an arc of the file belongs to: the last one to begin before it, since those without arcs of
    /// their own begin where the next one does.
    pub fn cluster_of_arc(&self, number: u32) -> usize {
        self.clusters.partition_point(|cluster| cluster.first_arc <= number).saturating_sub(1)
    }
}

/// A cluster, in the numbers of the file. The parts in pages are still unknown.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct ClusterContent {
    pub cluster: Cluster,
    pub entries: Vec<RootEntry>,
    arc_ends: Vec<[u32; 2]>,
    /// Per arc and level.
    new_samples: Vec<u32>,
    pub corners: Vec<LatticePoint>,
    corner_levels: Vec<u8>,
    /// How many of its roots are tops.
    top_count: u32,
    level_count: usize,
}

impl ClusterContent {
    /// The cluster with the numbers of its levels, the content of its index block, and its corners.
    pub fn index(self, lattice: &Lattice) -> Result<(Cluster, ClusterIndex, Vec<LatticePoint>)> {
        let Self { mut cluster, entries, arc_ends, new_samples, corners, corner_levels, top_count, level_count } = self;
        let mut index = ClusterIndex::new(entries, arc_ends, &new_samples, level_count);
        index.corner_levels = corner_levels;
        index.find_streams()?;
        for level in 0..level_count as u8 {
            let (triangle_count, max_error) = index.summary(level, top_count, lattice)?;
            cluster.levels.push(ClusterLevel { triangle_count, max_error, ..ClusterLevel::default() });
        }
        Ok((cluster, index, corners))
    }
}

/// Divides the order of the file into clusters of the given number of roots, or fewer where these have many half-arcs.
fn clusters_of<'o>(order: &'o [u32], cluster_roots: usize, roots: &[RootEntry]) -> Vec<&'o [u32]> {
    let mut clusters = Vec::with_capacity(order.len().div_ceil(cluster_roots));
    for mut rest in order.chunks(cluster_roots) {
        let mut half_arcs = 0;
        let mut at = 0;
        while let Some(&root) = rest.get(at) {
            half_arcs += roots[root as usize].half_arcs().count();
            if at > 0 && half_arcs > CLUSTER_HALF_ARCS {
                let (cluster, after) = rest.split_at(at);
                clusters.push(cluster);
                (rest, at, half_arcs) = (after, 0, 0);
            } else {
                at += 1;
            }
        }
        clusters.push(rest);
    }
    clusters
}

/// Pairs of roots of one parent, or of none, that share an arc.
fn siblings(catalogue: &Catalogue) -> Result<Vec<[u32; 2]>> {
    // Each use: arc, parent, root.
    let mut uses = Vec::new();
    for ((root, entry), &parent) in (0..).zip(&catalogue.roots).zip(&catalogue.parents) {
        uses.extend(entry.half_arcs().map(|half_arc| (half_arc.arc, parent, root)));
    }
    uses.sort_unstable();
    let mut pairs = Vec::new();
    for of_parent in uses.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        match of_parent {
            [_] => {}
            &[(_, _, a), (_, _, b)] => pairs.push([a, b]),
            _ => return Err(Error::model("an arc is used more than twice")),
        }
    }
    Ok(pairs)
}

fn union(a: [LatticePoint; 2], b: [LatticePoint; 2]) -> [LatticePoint; 2] {
    let each = |side: usize, pick: fn(i64, i64) -> i64| [0, 1, 2].map(|axis| pick(a[side][axis], b[side][axis]));
    [each(0, i64::min), each(1, i64::max)]
}
