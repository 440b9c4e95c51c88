//! The lists of clusters as far as they are known, with the index blocks of their clusters: the paged part of an index.
//!
//! A list or index block is parsed once, when its bytes come, and then stays. What a question needs and does not find
//! is missing ([`Error::Missing`]); where several parts are missing they are named together, so that they are read
//! together.

use std::{
    ops::Range,
    sync::{OnceLock, PoisonError},
};

use super::{Index, absolute, checked_part};
use crate::{
    error::{Error, Result},
    format::{
        cluster_lists::parse_list,
        clusters::{Cluster, Entry},
        index_block::ClusterIndex,
    },
    source::{Fetched, requests::plan},
};

/// A list of clusters.
#[derive(Debug)]
pub(crate) struct List {
    slots: Vec<Slot>,
}

/// An entry, and the part that it stands for once that is known.
#[derive(Debug)]
pub(crate) struct Slot {
    pub(crate) entry: Entry,
    block: OnceLock<Box<ClusterIndex>>,
    list: OnceLock<List>,
}

impl Slot {
    fn is_cluster(&self) -> bool {
        self.entry.height == 0
    }

    fn is_known(&self) -> bool {
        if self.is_cluster() { self.block.get().is_some() } else { self.list.get().is_some() }
    }

    /// Its bytes within INDEX, with everything below it.
    fn extent(&self) -> Range<u64> {
        let start = self.entry.sums.index.offset;
        start..start.saturating_add(self.entry.index_bytes().unwrap_or(u64::MAX))
    }

    fn location(&self) -> String {
        let Entry { first_cluster, cluster_count, .. } = self.entry;
        if self.is_cluster() {
            format!("index block of cluster {first_cluster}")
        } else {
            format!("list of the {cluster_count} clusters from {first_cluster} on")
        }
    }
}

impl List {
    pub(super) fn new(entries: Vec<Entry>) -> Self {
        let slot = |entry| Slot { entry, block: OnceLock::new(), list: OnceLock::new() };
        Self { slots: entries.into_iter().map(slot).collect() }
    }

    pub(super) fn cluster_count(&self) -> u32 {
        self.entries().next_back().map_or(0, |last| last.first_cluster + last.cluster_count)
    }

    pub(super) fn entries(&self) -> impl DoubleEndedIterator<Item = &Entry> {
        self.slots.iter().map(|slot| &slot.entry)
    }
}

/// All answers, or the ranges that any of them lacks.
pub(crate) fn together<T, A: FromIterator<T>>(answers: impl IntoIterator<Item = Result<T>>) -> Result<A> {
    let mut missing = Vec::new();
    let keep = |answer| match answer {
        Ok(answer) => Some(Ok(answer)),
        Err(Error::Missing { ranges }) => {
            missing.extend(ranges);
            None
        }
        Err(error) => Some(Err(error)),
    };
    let answers = answers.into_iter().filter_map(keep).collect::<Result<A>>()?;
    if missing.is_empty() { Ok(answers) } else { Err(Error::Missing { ranges: plan(missing) }) }
}

impl Index {
    /// Keeps the index blocks and lists among the bytes that have been read, so that they need not be read again. The
    /// next call that needs a damaged one returns its error.
    pub fn supply(&self, fetched: &Fetched) {
        for range in fetched.ranges() {
            self.supply_list(&self.top, fetched, &range);
        }
    }

    fn supply_list(&self, list: &List, fetched: &Fetched, range: &Range<u64>) {
        let offset = |within: u64| self.index_offset.saturating_add(within);
        let first = list.slots.partition_point(|slot| offset(slot.extent().end) <= range.start);
        let rest = list.slots.get(first..).unwrap_or(&[]);
        for slot in rest.iter().take_while(|slot| offset(slot.extent().start) < range.end) {
            if let Err(error) = self.take(slot, fetched) {
                let mut damaged = self.damaged.lock().unwrap_or_else(PoisonError::into_inner);
                damaged.insert(slot.entry.sums.index.offset, error);
            }
            if let Some(list) = slot.list.get() {
                self.supply_list(list, fetched, range);
            }
        }
    }

    /// Parses what a slot stands for if its bytes have been fetched, unless that has been done. Returns whether it is
    /// known.
    fn take(&self, slot: &Slot, fetched: &Fetched) -> Result<bool> {
        if slot.is_known() {
            return Ok(true);
        }
        let part = slot.entry.sums.index;
        let bytes = checked_part(fetched, self.index_offset, part).map_err(|error| error.at(|| slot.location()))?;
        let Some(bytes) = bytes else { return Ok(false) };
        // Another thread may be first; its result is the same.
        if slot.is_cluster() {
            let block = ClusterIndex::parse(bytes, &slot.entry.sums, &self.scheme());
            let _ = slot.block.set(Box::new(block.map_err(|error| error.at(|| slot.location()))?));
        } else {
            let list = parse_list(bytes, &slot.entry, self.limits()).map_err(|error| error.at(|| slot.location()))?;
            let _ = slot.list.set(List::new(list));
        }
        Ok(true)
    }

    /// Makes sure that what a slot stands for is known.
    fn load(&self, slot: &Slot) -> Result<()> {
        if slot.is_known() {
            return Ok(());
        }
        let part = slot.entry.sums.index;
        if let Some(error) = self.damaged.lock().unwrap_or_else(PoisonError::into_inner).remove(&part.offset) {
            return Err(error);
        }
        if self.take(slot, &self.head)? {
            return Ok(());
        }
        Err(Error::Missing { ranges: vec![self.head.rest_of(absolute(self.index_offset, part))] })
    }

    /// The list that a slot stands for.
    fn list<'s>(&self, slot: &'s Slot) -> Result<&'s List> {
        self.load(slot)?;
        slot.list.get().ok_or_else(|| Error::format("a list of clusters does not exist"))
    }

    /// The cluster in whose range a number lies; `first` picks the first number of an entry.
    fn slot(&self, id: u32, first: impl Fn(&Entry) -> u32) -> Result<&Slot> {
        let mut list = &self.top;
        loop {
            // One without arcs has the same first arc as the next one: the last of these owns it.
            let after = list.slots.partition_point(|slot| first(&slot.entry) <= id);
            let slot = after.checked_sub(1).and_then(|last| list.slots.get(last));
            let slot = slot.ok_or_else(|| Error::format("a reference leaves the file"))?;
            if slot.is_cluster() {
                return Ok(slot);
            }
            list = self.list(slot)?;
        }
    }

    fn cluster_slot(&self, cluster: u32) -> Result<&Slot> {
        if cluster >= self.cluster_count() {
            return Err(Error::format("a cluster does not exist"));
        }
        self.slot(cluster, |entry| entry.first_cluster)
    }

    /// A cluster by its number, which comes from this file.
    pub(crate) fn cluster(&self, cluster: u32) -> Result<&Cluster> {
        self.cluster_slot(cluster).map(|slot| &slot.entry.sums)
    }

    /// The cluster that owns a root, arc or corner; `first` picks the cluster's first one.
    pub(crate) fn owner(&self, id: u32, first: fn(&Cluster) -> u32) -> Result<u32> {
        self.slot(id, |entry| first(&entry.sums)).map(|slot| slot.entry.first_cluster)
    }

    /// The cluster that owns a root, arc or corner, with its index block; `span` picks those of a cluster.
    pub(crate) fn owner_of(&self, id: u32, span: fn(&Cluster) -> Range<u32>) -> Result<(&Entry, &ClusterIndex)> {
        let slot = self.slot(id, |entry| span(&entry.sums).start)?;
        self.load(slot)?;
        let block = slot.block.get().ok_or_else(|| Error::format("a cluster does not exist"))?;
        Ok((&slot.entry, block))
    }

    /// The clusters that own some roots, arcs or corners, ascending; `span` picks those of a cluster.
    pub(crate) fn owners(
        &self,
        ids: impl IntoIterator<Item = u32>,
        span: fn(&Cluster) -> Range<u32>,
    ) -> Result<Vec<u32>> {
        // Numbers that follow each other mostly have one owner.
        let mut last = 0..0;
        let owner = |id: u32| {
            if last.contains(&id) {
                return None;
            }
            let slot = self.slot(id, |entry| span(&entry.sums).start);
            Some(slot.map(|slot| {
                last = span(&slot.entry.sums);
                slot.entry.first_cluster
            }))
        };
        let mut owners: Vec<u32> = together(ids.into_iter().filter_map(owner))?;
        owners.sort_unstable();
        owners.dedup();
        Ok(owners)
    }

    /// All clusters. Needs all lists.
    pub(crate) fn clusters(&self) -> Result<Vec<&Cluster>> {
        Ok(self.clusters_in(&mut |_| true)?.into_iter().map(|entry| &entry.sums).collect())
    }

    /// The entries of the clusters that `is_wanted` accepts. An entry for a list must be accepted if any of its
    /// clusters is.
    pub(crate) fn clusters_in(&self, is_wanted: &mut dyn FnMut(&Entry) -> bool) -> Result<Vec<&Entry>> {
        let (mut found, mut missing) = (Vec::new(), Vec::new());
        self.visit(&self.top, is_wanted, &mut found, &mut missing)?;
        if missing.is_empty() { Ok(found) } else { Err(Error::Missing { ranges: plan(missing) }) }
    }

    fn visit<'i>(
        &'i self,
        list: &'i List,
        is_wanted: &mut dyn FnMut(&Entry) -> bool,
        found: &mut Vec<&'i Entry>,
        missing: &mut Vec<Range<u64>>,
    ) -> Result<()> {
        for slot in &list.slots {
            if !is_wanted(&slot.entry) {
                continue;
            }
            if slot.is_cluster() {
                found.push(&slot.entry);
                continue;
            }
            match self.list(slot) {
                Ok(list) => self.visit(list, is_wanted, found, missing)?,
                Err(Error::Missing { ranges }) => missing.extend(ranges),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Makes sure that the index blocks of these clusters are parsed, or returns [`Error::Missing`].
    pub(crate) fn load_indices(&self, clusters: impl IntoIterator<Item = u32>) -> Result<()> {
        together(clusters.into_iter().map(|number| self.load(self.cluster_slot(number)?)))
    }

    /// The index block of a cluster.
    pub(crate) fn cluster_index(&self, cluster: u32) -> Result<&ClusterIndex> {
        let slot = self.cluster_slot(cluster)?;
        self.load(slot)?;
        slot.block.get().map(|block| &**block).ok_or_else(|| Error::format("a cluster does not exist"))
    }

    /// The size of section INDEX.
    pub(crate) fn index_bytes(&self) -> u64 {
        self.top.slots.last().map_or(0, |slot| slot.extent().end)
    }

    /// Bytes of INDEX that the known lists take.
    pub(crate) fn list_bytes(&self) -> u64 {
        fn of(list: &List) -> u64 {
            let lists = list.slots.iter().filter(|slot| !slot.is_cluster());
            lists.map(|slot| slot.entry.sums.index.length + slot.list.get().map_or(0, of)).sum()
        }
        of(&self.top)
    }
}
