//! The objects of an open file: what the input named, found by number, name and id, and the islands of leaves that
//! belong to them. Nothing here reads.

use std::sync::Arc;

use crate::{
    error::{Error, Result},
    index::Index,
    objects::{LeafOwners, LeafShape, ObjectNode, OpenObjects},
    source::Fetched,
};

/// The objects of a file, which [`Index::objects`] returns.
///
/// Objects are numbered from 0, in the order in which the file's leaves hold them; assemblies, which only hold others,
/// follow. Every call takes the bytes that have been read, and returns [`Error::Missing`] where it needs others. A name
/// of a file with a million objects is found with three reads; [`crate::File::objects`] reads by itself.
#[derive(Clone, Copy, Debug)]
pub struct Objects<'i> {
    index: &'i Index,
    open: &'i OpenObjects,
}

impl Index {
    /// What the input named, if the file says so.
    pub fn objects(&self) -> Option<Objects<'_>> {
        self.objects.as_ref().map(|open| Objects { index: self, open })
    }
}

impl<'i> Objects<'i> {
    /// How many objects there are.
    pub fn count(&self) -> u32 {
        self.open.count()
    }

    /// How many objects and assemblies there are.
    pub fn node_count(&self) -> u32 {
        self.open.node_count()
    }

    pub(crate) fn open(&self) -> &'i OpenObjects {
        self.open
    }

    pub(crate) fn index(&self) -> &'i Index {
        self.index
    }

    fn check(&self, number: u32, count: u32, what: &str) -> Result<()> {
        if number < count {
            return Ok(());
        }
        Err(Error::Query { what: format!("there is no {what} {number}: the file has {count}") })
    }

    /// Name, id and parent of an object or assembly.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is none of this number; [`Error::Format`], [`Error::Limit`].
    pub fn node(&self, number: u32, fetched: &Fetched) -> Result<ObjectNode> {
        self.check(number, self.node_count(), "object or assembly")?;
        self.open.node(number, fetched)
    }

    /// The objects and assemblies of a name, ascending.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::Format`], [`Error::Limit`].
    pub fn find_name(&self, name: &str, fetched: &Fetched) -> Result<Vec<u32>> {
        self.open.find_name(name, fetched)
    }

    /// The objects and assemblies of an id, ascending.
    ///
    /// # Errors
    /// As [`Self::find_name`].
    pub fn find_id(&self, id: &str, fetched: &Fetched) -> Result<Vec<u32>> {
        self.open.find_id(id, fetched)
    }

    /// What an object or assembly consists of, ascending; without a number, all that is a part of nothing.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn children(&self, parent: Option<u32>, fetched: &Fetched) -> Result<Vec<u32>> {
        parent.map_or(Ok(()), |parent| self.check(parent, self.node_count(), "object or assembly"))?;
        self.open.children(parent, fetched)
    }

    /// The pages of 1024 nodes in which children of an object or assembly are, ascending: who shows a tree need not
    /// read all at once ([`Self::children_in`]).
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn child_pages(&self, parent: Option<u32>, fetched: &Fetched) -> Result<Vec<u32>> {
        parent.map_or(Ok(()), |parent| self.check(parent, self.node_count(), "object or assembly"))?;
        self.open.child_pages(parent, fetched)
    }

    /// The children of an object or assembly in a page of nodes, ascending.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn children_in(&self, parent: Option<u32>, page: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        self.check(page, self.node_count().div_ceil(1024), "page of nodes")?;
        self.open.children_in(parent, page, fetched)
    }

    /// What an object or assembly is a part of: its parent, that one's parent, and so on.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn above(&self, number: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        self.check(number, self.node_count(), "object or assembly")?;
        self.open.above(number, fetched)
    }

    /// The objects of a leaf. A group above shows those of its leaves.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no such root, or it is a group; [`Error::Format`],
    /// [`Error::Limit`].
    pub fn of_leaf(&self, root: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        self.with_leaf(root, fetched, |leaf| Ok(leaf.objects.clone()))
    }

    /// For each of [`crate::islands`] of a leaf's block the object that it belongs to.
    ///
    /// # Errors
    /// As [`Self::of_leaf`]; [`Error::Query`] if it has no block at this level.
    pub fn owners(&self, root: u32, level: u8, fetched: &Fetched) -> Result<Vec<u32>> {
        let block = |leaf: &LeafOwners| {
            let blocks = &self.index.root_entry(root)?.blocks;
            let block = blocks.iter().position(|block| block.level == level);
            let block = block.ok_or_else(|| Error::Query { what: format!("root {root} has no level {level}") })?;
            Ok(leaf.of_block(block))
        };
        self.with_leaf(root, fetched, block)
    }

    /// The leaves that hold an object, ascending.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no object of this number; [`Error::Format`], [`Error::Limit`].
    pub fn leaves(&self, object: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        self.check(object, self.count(), "object")?;
        let mut roots = vec![];
        for cluster in self.open.clusters_of(object, fetched)? {
            let owners = self.cluster(cluster, fetched)?;
            let leaves = self.leaves_of(cluster)?;
            let holds = |leaf: &LeafOwners| leaf.objects.contains(&object);
            let before = roots.len();
            roots.extend(leaves.into_iter().zip(&owners.0).filter(|(_, leaf)| holds(leaf)).map(|(root, _)| root));
            if before == roots.len() {
                let location = || format!("objects, owners of cluster {cluster}");
                return Err(Error::format("a cluster does not hold an object that is looked for there").at(location));
            }
        }
        Ok(roots)
    }

    fn with_leaf<T>(&self, root: u32, fetched: &Fetched, answer: impl FnOnce(&LeafOwners) -> Result<T>) -> Result<T> {
        self.index.check_root(root)?;
        let cluster = self.index.owner(root, |cluster| cluster.first_root)?;
        let place = self.leaves_of(cluster)?.into_iter().position(|leaf| leaf == root);
        let what = || Error::Query { what: format!("root {root} is a group; only leaves have objects") };
        let place = place.ok_or_else(what)?;
        let owners = self.cluster(cluster, fetched)?;
        answer(owners.0.get(place).ok_or_else(|| Error::format("a leaf has no owners"))?)
    }

    /// The leaves of a cluster.
    pub(crate) fn leaves_of(&self, cluster: u32) -> Result<Vec<u32>> {
        let first = self.index.cluster(cluster)?.first_root;
        let roots = (first..).zip(&self.index.cluster_index(cluster)?.roots);
        Ok(roots.filter(|(_, root)| root.child_count == 0).map(|(number, _)| number).collect())
    }

    /// The owners of a cluster's leaves, and the first object that none of them nor of those before holds.
    pub(crate) fn cluster(&self, cluster: u32, fetched: &Fetched) -> Result<Arc<(Vec<LeafOwners>, u32)>> {
        let roots = self.index.cluster_index(cluster)?.roots.iter().filter(|root| root.child_count == 0);
        let shape = |blocks: &[crate::format::index_block::BlockEntry]| -> LeafShape {
            blocks.iter().map(|block| (block.level, block.triangle_count)).collect()
        };
        let shapes: Vec<LeafShape> = roots.map(|root| shape(&root.blocks)).collect();
        self.open.owners(cluster, &shapes, fetched)
    }
}
