//! The lines along which the roots of a file meet: arcs, and corners that are no vertices at some level. From them come
//! the borders of a hierarchy.

use std::{collections::HashMap, ops::Range};

use super::hierarchy::HierarchyNode;
use crate::{
    error::{Error, Result},
    format::{
        clusters::Cluster,
        index_block::{ClusterIndex, RootEntry},
        records::HalfArc,
    },
    index::Index,
};

/// What an index says of arcs and corners.
pub(super) struct Lines<'i> {
    pub index: &'i Index,
}

impl<'i> Lines<'i> {
    /// Makes sure that what the index says of the arcs and corners of these roots is there.
    pub fn load(&self, roots: &[(u32, &RootEntry)]) -> Result<()> {
        let index = self.index;
        let half_arcs = || roots.iter().flat_map(|(_, entry)| entry.half_arcs());
        index.load_indices(index.owners(half_arcs().map(|half_arc| half_arc.arc), Cluster::arcs)?)?;
        if !self.has_tree() {
            return Ok(());
        }
        let (mut corners, mut found) = (Vec::new(), Found::default());
        for half_arc in half_arcs() {
            let (local, of_cluster) = found.of(self.index, half_arc.arc, Cluster::arcs)?;
            corners.extend(of_cluster.arc_ends.get(local).into_iter().flatten());
        }
        index.load_indices(index.owners(corners, Cluster::corners)?)
    }

    pub fn has_tree(&self) -> bool {
        self.index.top_count() < self.index.root_count()
    }

    pub fn ends(&self, half_arc: HalfArc) -> Result<[u32; 2]> {
        let (local, of_cluster) = Found::default().of(self.index, half_arc.arc, Cluster::arcs)?;
        let ends = of_cluster.arc_ends.get(local).copied();
        Ok(half_arc.directed(ends.ok_or_else(|| Error::format("an arc does not exist"))?))
    }

    /// The number of samples that an arc has at a level.
    pub fn sample_count(&self, arc: u32, level: u8) -> Result<u32> {
        let (local, of_cluster) = Found::default().of(self.index, arc, Cluster::arcs)?;
        Ok(of_cluster.sample_count(local as u32, level))
    }

    /// The coarsest level at which a corner is a vertex.
    pub fn corner_level(&self, corner: u32) -> Result<u8> {
        let (local, of_cluster) = Found::default().of(self.index, corner, Cluster::corners)?;
        let level = of_cluster.corner_levels.get(local).copied();
        level.ok_or_else(|| Error::format("a corner does not exist"))
    }

    /// Gives nodes their borders. Returns how many samples each border has at each level.
    ///
    /// A border is all that the same nodes use: arcs, and corners that are no vertices at some level, each as if it
    /// were an arc with one sample. Whether a neighbour has more samples, and how many triangles these add, is the same
    /// for the sum as for each of them. So a group that stands for thousands of leaves has few borders, although its
    /// outline consists of the leaves' arcs.
    pub fn add_borders(&self, roots: &[(u32, &RootEntry)], nodes: &mut [HierarchyNode]) -> Result<Vec<u32>> {
        let level_count = self.index.level_count();
        // The uses of arcs, and of corners: the number of the line above that of the node, so that they sort fast.
        let mut uses: [Vec<u64>; 2] = Default::default();
        let used = |line: u32, node: u32| u64::from(line) << 32 | u64::from(node);
        let mut found = [Found::default(), Found::default()];
        for (node, (_, entry)) in (0..).zip(roots) {
            for half_arc in entry.half_arcs() {
                uses[0].push(used(half_arc.arc, node));
                if !self.has_tree() {
                    continue;
                }
                let (local, of_cluster) = found[0].of(self.index, half_arc.arc, Cluster::arcs)?;
                let ends = of_cluster.arc_ends.get(local).copied();
                let [corner, _] = half_arc.directed(ends.ok_or_else(|| Error::format("an arc does not exist"))?);
                let (local, of_cluster) = found[1].of(self.index, corner, Cluster::corners)?;
                if of_cluster.corner_levels.get(local).is_some_and(|&level| level > 0) {
                    uses[1].push(used(corner, node));
                }
            }
        }
        let mut borders: HashMap<Box<[u32]>, usize> = HashMap::new();
        let mut sample_counts: Vec<u32> = Vec::new();
        let mut users: Vec<u32> = Vec::new();
        for (is_corner, mut uses) in [false, true].into_iter().zip(uses) {
            uses.sort_unstable();
            for line in uses.chunk_by(|a, b| a >> 32 == b >> 32) {
                users.clear();
                users.extend(line.iter().map(|&used| used as u32));
                let border = match borders.get(&*users) {
                    Some(&border) => border,
                    None => {
                        let border = borders.len();
                        borders.insert(users.as_slice().into(), border);
                        users.iter().for_each(|&node| nodes[node as usize].borders.push(border as u32));
                        sample_counts.resize((border + 1) * level_count, 0);
                        border
                    }
                };
                let number = line.first().map_or(0, |first| (first >> 32) as u32);
                let counts = &mut sample_counts[border * level_count..][..level_count];
                let span = if is_corner { Cluster::corners } else { Cluster::arcs };
                let (local, of_cluster) = found[usize::from(is_corner)].of(self.index, number, span)?;
                let coarsest = of_cluster.corner_levels.get(local).copied().unwrap_or(0);
                for (level, count) in (0..).zip(counts.iter_mut()) {
                    let own = if is_corner {
                        u32::from(level >= coarsest)
                    } else {
                        of_cluster.sample_count(local as u32, level)
                    };
                    *count = count.saturating_add(own);
                }
            }
        }
        Ok(sample_counts)
    }
}

/// The cluster that was found last: numbers that follow each other mostly have one owner.
#[derive(Default)]
struct Found<'i> {
    span: Range<u32>,
    of_cluster: Option<&'i ClusterIndex>,
}

impl<'i> Found<'i> {
    /// The index block that has an arc or corner, and its place there.
    fn of(&mut self, index: &'i Index, id: u32, span: fn(&Cluster) -> Range<u32>) -> Result<(usize, &'i ClusterIndex)> {
        if let (true, Some(of_cluster)) = (self.span.contains(&id), self.of_cluster) {
            return Ok(((id - self.span.start) as usize, of_cluster));
        }
        let (entry, of_cluster) = index.owner_of(id, span)?;
        (self.span, self.of_cluster) = (span(&entry.sums), Some(of_cluster));
        Ok(((id - self.span.start) as usize, of_cluster))
    }
}
