//! From a choice of objects to what it says of roots.

use std::{cmp::Reverse, ops::Range, sync::Arc};

use crate::{
    error::{Error, Result},
    index::{Index, Objects},
    objects::{LeafOwners, ObjectChoice, ObjectFilter, ObjectState, has_filters},
    sorted::{SortedMap, SortedSet},
    source::{Fetched, requests::plan},
};

/// Bytes that several questions lack, to ask for them at once.
#[derive(Default)]
struct Lacking(Vec<Range<u64>>);

impl Lacking {
    /// The answer, unless bytes are missing.
    fn note<T>(&mut self, answer: Result<T>) -> Result<Option<T>> {
        match answer {
            Ok(answer) => Ok(Some(answer)),
            Err(Error::Missing { ranges }) => {
                self.0.extend(ranges);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    fn finish(self) -> Result<()> {
        match self.0.is_empty() {
            true => Ok(()),
            false => Err(Error::Missing { ranges: plan(self.0) }),
        }
    }
}

impl Objects<'_> {
    /// The objects among some nodes and everything below these, ascending.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no node of one of these numbers; [`Error::Format`],
    /// [`Error::Limit`].
    pub fn below(&self, nodes: &[u32], fetched: &Fetched) -> Result<Vec<u32>> {
        let mut seen: SortedSet<u32> = nodes.iter().copied().collect();
        let mut generation: Vec<u32> = seen.iter().copied().collect();
        while !generation.is_empty() {
            let (mut lacking, mut next) = (Lacking::default(), vec![]);
            for node in generation {
                let children = lacking.note(self.children(Some(node), fetched))?;
                next.extend(children.into_iter().flatten().filter(|&child| seen.insert(child)));
            }
            lacking.finish()?;
            generation = next;
        }
        Ok(seen.iter().copied().filter(|&node| node < self.count()).collect())
    }

    /// What a choice of objects says of the file's roots. It reads owners of the leaves that hold objects of the
    /// choice, and the index blocks of these leaves and of the groups above them.
    ///
    /// # Errors
    /// As [`Self::below`]; [`Error::Unsupported`] without the feature `channels`.
    pub fn filter(&self, choice: &ObjectChoice, fetched: &Fetched) -> Result<Arc<ObjectFilter>> {
        let proof = has_filters()?;
        let mut lacking = Lacking::default();
        let mut below =
            |nodes: &[u32]| -> Result<Vec<u32>> { Ok(lacking.note(self.below(nodes, fetched))?.unwrap_or_default()) };
        let only = choice.only.as_deref().map(&mut below).transpose()?;
        let [hidden, marked] = [below(&choice.hidden)?, below(&choice.marked)?];
        lacking.finish()?;
        let is_rest_hidden = only.is_some() || choice.only_marked;
        let rest = if is_rest_hidden { ObjectState::Hidden } else { ObjectState::Shown };
        let has = |objects: &[u32], object: u32| objects.binary_search(&object).is_ok();
        let state = |object: u32| match &only {
            _ if has(&hidden, object) => ObjectState::Hidden,
            Some(only) if !has(only, object) => ObjectState::Hidden,
            _ if has(&marked, object) => ObjectState::Marked,
            _ if choice.only_marked => ObjectState::Hidden,
            _ => ObjectState::Shown,
        };
        let mut filter = ObjectFilter {
            file: self.index().id(),
            choice: choice.clone(),
            rest,
            roots: SortedMap::new(),
            leaves: SortedMap::new(),
            has: proof,
        };
        let named: SortedSet<u32> = only.iter().flatten().chain(&hidden).chain(&marked).copied().collect();
        for cluster in self.clusters_of(named.iter().copied().filter(|&object| state(object) != rest), fetched)? {
            let owners = self.cluster(cluster, fetched)?;
            for (root, leaf) in self.leaves_of(cluster)?.into_iter().zip(&owners.0) {
                self.add_leaf(&mut filter, (root, leaf), &state)?;
            }
        }
        add_groups(self.index(), &mut filter)?;
        Ok(Arc::new(filter))
    }

    /// The clusters with leaves of some objects, whose owners and index blocks are there then.
    fn clusters_of(&self, objects: impl Iterator<Item = u32>, fetched: &Fetched) -> Result<SortedSet<u32>> {
        let (mut lacking, mut clusters) = (Lacking::default(), SortedSet::new());
        for object in objects {
            let of_object = lacking.note(self.open().clusters_of(object, fetched))?;
            clusters.extend(&of_object.unwrap_or_default());
        }
        lacking.note(self.index().load_indices(clusters.iter().copied()))?;
        lacking.finish()?;
        let mut lacking = Lacking::default();
        for &cluster in clusters.iter() {
            lacking.note(self.cluster(cluster, fetched))?;
        }
        lacking.finish()?;
        Ok(clusters)
    }

    fn add_leaf(
        &self,
        filter: &mut ObjectFilter,
        (root, leaf): (u32, &LeafOwners),
        state: &dyn Fn(u32) -> ObjectState,
    ) -> Result<()> {
        let mut states = leaf.objects.iter().map(|&object| state(object));
        let Some(first) = states.next() else { return Ok(()) };
        if states.all(|other| other == first) {
            if first != filter.rest {
                filter.roots.insert(root, Some(first));
            }
            return Ok(());
        }
        let blocks = self.index().root_entry(root)?.blocks.iter().enumerate();
        let of_block = |(number, block): (usize, &crate::format::index_block::BlockEntry)| {
            (block.level, leaf.of_block(number).into_iter().map(state).collect())
        };
        filter.leaves.insert(root, blocks.map(of_block).collect());
        filter.roots.insert(root, None);
        Ok(())
    }
}

/// Adds the groups above the leaves of a filter.
fn add_groups(index: &Index, filter: &mut ObjectFilter) -> Result<()> {
    let mut lacking = Lacking::default();
    // How many children each group has among the roots that the filter names, and their state. Groups come before what
    // is below them, so the last one has all of its children here.
    let mut waiting: SortedMap<Reverse<u32>, (u32, Option<ObjectState>)> = SortedMap::new();
    let leaves: Vec<_> = filter.roots.iter().map(|(&root, &state)| (root, state)).collect();
    let add =
        |waiting: &mut SortedMap<Reverse<u32>, (u32, Option<ObjectState>)>, (root, state), lacking: &mut Lacking| {
            let Some(Some(parent)) = lacking.note(index.parent(root))? else { return Ok(()) };
            if parent >= root {
                return Err(Error::format("a group comes after what is below it").at(|| format!("root {root}")));
            }
            match waiting.get_mut(&Reverse(parent)) {
                Some((count, of_children)) => {
                    *count += 1;
                    *of_children = of_children.filter(|of_children| state == Some(*of_children));
                }
                None => _ = waiting.insert(Reverse(parent), (1, state)),
            }
            Ok(())
        };
    for leaf in leaves {
        add(&mut waiting, leaf, &mut lacking)?;
    }
    while let Some((Reverse(group), (count, of_children))) = waiting.pop_first() {
        let Some(children) = lacking.note(index.children(group))? else { continue };
        let state = of_children.filter(|_| count == children.len() as u32);
        filter.roots.insert(group, state);
        add(&mut waiting, (group, state), &mut lacking)?;
    }
    lacking.finish()
}
