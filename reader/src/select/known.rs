//! The part of a file's tree that a question has walked to: the tops in its scope, and the children of the roots that
//! it has split.
//!
//! A root whose children are not known is drawn itself. So a question begins with the tops, and asks for the children
//! of those roots alone that it wants finer; of the index it needs these roots' blocks, and the lists on the way to
//! them.

use std::{ops::Range, sync::Arc};

use crate::{
    error::Result,
    format::{clusters::Entry, index_block::RootEntry},
    index::Index,
    lattice::LatticePoint,
    objects::{ObjectFilter, ObjectState},
    sorted::SortedMap,
};

/// Decides whether something with a box takes part.
pub(super) type Meets<'k> = dyn Fn([LatticePoint; 2]) -> bool + 'k;

/// What is known of a tree.
pub(super) struct Known<'i, 'k> {
    index: &'i Index,
    meets: &'k Meets<'k>,
    filter: Option<&'k Arc<ObjectFilter>>,
    /// Each root's parent.
    roots: SortedMap<u32, Option<u32>>,
    /// Roots whose children are known, each with the number of children that take part.
    split: SortedMap<u32, u32>,
}

impl<'i, 'k> Known<'i, 'k> {
    /// The tops.
    pub fn tops(index: &'i Index, meets: &'k Meets<'k>, filter: Option<&'k Arc<ObjectFilter>>) -> Result<Self> {
        let mut known = Self { index, meets, filter, roots: SortedMap::new(), split: SortedMap::new() };
        let tops = 0..index.top_count();
        for root in known.meeting(std::slice::from_ref(&tops))? {
            known.roots.insert(root, None);
        }
        Ok(known)
    }

    /// The roots, ascending.
    pub fn roots(&self) -> Vec<u32> {
        self.roots.keys().copied().collect()
    }

    pub fn parent(&self, root: u32) -> Option<u32> {
        self.roots.get(&root).copied().flatten()
    }

    /// Whether a root has children that are not known yet. In a prefix, a root whose children have no level in it is a
    /// leaf.
    pub fn is_open(&self, root: u32, entry: &RootEntry) -> bool {
        let has_next = |last: u8| usize::from(last) + 1 < self.index.level_count();
        let goes_on = entry.blocks.last().is_some_and(|block| has_next(block.level));
        entry.child_count > 0 && goes_on && !self.split.contains_key(&root)
    }

    /// Adds the children of some open roots, ascending, as far as they take part. A root none of whose children does
    /// takes no part itself: its box is larger than what it stands for.
    pub fn split(&mut self, roots: &[u32]) -> Result<()> {
        self.walk_past(roots, true)
    }

    /// Puts what is below them in the place of all groups that show objects of several states. What is below other
    /// groups has one state. Where nothing is below, in the beginning of a file, nothing is drawn.
    pub fn split_mixed(&mut self) -> Result<()> {
        let Some(filter) = self.filter else { return Ok(()) };
        filter.is_there();
        loop {
            let mixed: Vec<u32> = self.roots().into_iter().filter(|&root| filter.splits(root)).collect();
            if mixed.is_empty() {
                return Ok(());
            }
            let mut open = Vec::new();
            for root in mixed {
                if self.is_open(root, self.index.root_entry(root)?) {
                    open.push(root);
                } else {
                    self.roots.remove(&root);
                }
            }
            self.replace(&open)?;
        }
    }

    /// Puts the children of some open roots, ascending, in their place.
    pub fn replace(&mut self, roots: &[u32]) -> Result<()> {
        self.walk_past(roots, false)
    }

    fn walk_past(&mut self, roots: &[u32], stays: bool) -> Result<()> {
        let ranges = roots.iter().map(|&root| self.index.children(root)).collect::<Result<Vec<_>>>()?;
        let mut children = self.meeting(&ranges)?.into_iter().peekable();
        let mut empty = Vec::new();
        for (&root, range) in roots.iter().zip(&ranges) {
            let mut count = 0;
            while let Some(child) = children.next_if(|&child| child < range.end) {
                self.roots.insert(child, stays.then_some(root));
                count += 1;
            }
            if count == 0 || !stays {
                empty.push(root);
            } else {
                self.split.insert(root, count);
            }
        }
        while let Some(root) = empty.pop() {
            let parent = self.roots.remove(&root).flatten();
            if let Some(parent) = parent
                && let Some(count) = self.split.get_mut(&parent)
            {
                *count -= 1;
                if *count == 0 {
                    empty.push(parent);
                }
            }
        }
        Ok(())
    }

    /// The roots in some ascending ranges that take part and have a level in the file.
    fn meeting(&self, ranges: &[Range<u32>]) -> Result<Vec<u32>> {
        let in_ranges = |first: u32, end: u32| {
            let range = ranges.get(ranges.partition_point(|range| range.end <= first));
            range.is_some_and(|range| range.start < end)
        };
        let mut is_wanted = |entry: &Entry| {
            let first = entry.sums.first_root;
            in_ranges(first, first.saturating_add(entry.sums.root_count)) && (self.meets)(entry.sums.bounds)
        };
        let clusters = self.index.clusters_in(&mut is_wanted)?;
        self.index.load_indices(clusters.iter().map(|entry| entry.first_cluster))?;
        let mut found = Vec::new();
        for cluster in clusters {
            let roots = (cluster.sums.first_root..).zip(&self.index.cluster_index(cluster.first_cluster)?.roots);
            let is_shown = |root: u32| self.filter.is_none_or(|filter| filter.state(root) != Some(ObjectState::Hidden));
            let has_level = |entry: &RootEntry| {
                entry.blocks.first().is_some_and(|block| usize::from(block.level) < self.index.level_count())
            };
            let takes_part = |&(root, entry): &(u32, &RootEntry)| {
                let takes_part = in_ranges(root, root.saturating_add(1)) && is_shown(root);
                takes_part && has_level(entry) && (self.meets)(entry.bounds)
            };
            found.extend(roots.filter(takes_part).map(|(root, _)| root));
        }
        Ok(found)
    }
}

/// The coarsest level at which anything of an entry's clusters is drawn.
pub(super) fn coarsest_level(entry: &Entry) -> usize {
    entry.sums.levels.iter().position(|level| level.triangle_count > 0).unwrap_or(0)
}
