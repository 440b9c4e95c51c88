//! The objects of an open file: parts that were read last, and answers from them. Nothing here reads.

use std::{
    collections::HashMap,
    ops::Range,
    sync::{Arc, Mutex, PoisonError},
};

use super::{
    MOST_ABOVE, ObjectNode, PAGE_LOG2, hash,
    list::{self, Entry, ListKind},
    owners::{self, LeafOwners, LeafShape},
    pairs::{Pair, Pairs},
    section::Head,
};
use crate::{
    codec::bytes::has_checksum,
    error::{Error, Result},
    format::{header::Section, sections::Part},
    limits::Limits,
    source::Fetched,
};

/// Parts that are kept decoded, those used last.
const MOST_KEPT: usize = 96;

/// Bytes that a first question reads behind the roots of lists.
const BEHIND_ROOTS: u64 = 4 << 10;

/// The objects of a file, as far as they are known.
#[derive(Debug)]
pub(crate) struct OpenObjects {
    pub(super) head: Head,
    section: Section,
    clusters: u32,
    limits: Limits,
    kept: Mutex<Kept>,
}

/// A directory (from height 1 on) or a page of a list, by number.
type Key = (ListKind, u32, u32);

#[derive(Clone, Debug)]
enum Item {
    Directory(Arc<Vec<Entry>>),
    Nodes(Arc<Vec<ObjectNode>>),
    Pairs(Arc<Vec<Pair>>),
    Owners(Arc<(Vec<LeafOwners>, u32)>),
}

#[derive(Debug, Default)]
struct Kept {
    items: HashMap<Key, (u64, Item)>,
    uses: u64,
}

fn wrong() -> Error {
    Error::format("a list of objects has another part here")
}

impl OpenObjects {
    /// Reads the section OBJECTS of a file with so many clusters; `section` is the one with the lists.
    pub fn parse(bytes: &[u8], section: Section, clusters: u32, limits: &Limits) -> Result<Self> {
        let head = Head::parse(bytes, limits)?;
        if clusters == 0 || head.roots.iter().map(|part| part.offset + part.length).max() > Some(section.length) {
            return Err(Error::format("a file without roots has objects, or their lists end early"));
        }
        Ok(Self { head, section, clusters, limits: *limits, kept: Mutex::default() })
    }

    pub fn count(&self) -> u32 {
        self.head.objects
    }

    pub fn node_count(&self) -> u32 {
        self.head.nodes
    }

    pub(super) fn pages(&self, kind: ListKind) -> u32 {
        match kind {
            ListKind::Owners => self.clusters,
            ListKind::Nodes => self.head.of_nodes().pages(),
            _ => self.pairs(kind).map_or(0, Pairs::pages),
        }
    }

    pub(super) fn pairs(&self, kind: ListKind) -> Option<Pairs> {
        let pairs = self.head.pairs(kind)?;
        Some(if kind == ListKind::Further { Pairs { places: self.clusters, ..pairs } } else { pairs })
    }

    /// Bytes of the sections' lists.
    pub(super) fn section_bytes(&self) -> u64 {
        self.section.length
    }

    fn known(&self, key: Key) -> Option<Item> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.uses += 1;
        let uses = kept.uses;
        let (used, item) = kept.items.get_mut(&key)?;
        *used = uses;
        Some(item.clone())
    }

    fn keep(&self, key: Key, item: Item) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.uses += 1;
        let uses = kept.uses;
        kept.items.insert(key, (uses, item));
        if kept.items.len() > MOST_KEPT {
            let oldest = kept.items.iter().min_by_key(|(_, (used, _))| *used).map(|(&key, _)| key);
            oldest.map(|key| kept.items.remove(&key));
        }
    }

    /// The bytes of a part.
    fn bytes<'b>(&self, part: Part, fetched: &'b Fetched) -> Result<&'b [u8]> {
        let end = part.offset.checked_add(part.length).filter(|&end| end <= self.section.length);
        let end = end.ok_or_else(|| Error::format("a part is not within its section"))?;
        let range = self.section.offset + part.offset..self.section.offset + end;
        match fetched.get(range.clone()) {
            Some(bytes) if has_checksum(bytes, part.checksum) || bytes.is_empty() => Ok(bytes),
            Some(_) => Err(Error::format("the checksum does not match")),
            None => Err(Error::Missing { ranges: vec![range] }),
        }
    }

    /// Where the roots of all lists are: a first question reads them at once, and some of what follows, which are the
    /// pages of owners of a small file.
    fn roots(&self) -> Range<u64> {
        let end = self.head.roots.iter().map(|part| part.offset + part.length).max().unwrap_or(0);
        self.section.offset..self.section.offset + end.saturating_add(BEHIND_ROOTS).min(self.section.length)
    }

    /// A directory; the root has the greatest height.
    pub(super) fn directory(
        &self,
        kind: ListKind,
        height: u32,
        number: u32,
        fetched: &Fetched,
    ) -> Result<Arc<Vec<Entry>>> {
        let key = (kind, height, number);
        if let Some(Item::Directory(entries)) = self.known(key) {
            return Ok(entries);
        }
        let top = list::height(self.pages(kind));
        let location = || format!("objects, list of {}, directory {number} of height {height}", kind.name());
        let (part, first) = match height.cmp(&top) {
            std::cmp::Ordering::Less => {
                let above = self.directory(kind, height + 1, number >> PAGE_LOG2, fetched)?;
                let entry = *above.get((number & ((1 << PAGE_LOG2) - 1)) as usize).ok_or_else(wrong)?;
                (entry.part, Some(entry.key))
            }
            _ => (self.head.roots[kind as usize], None),
        };
        let bytes = match self.bytes(part, fetched) {
            Err(Error::Missing { .. }) if first.is_none() => return Err(Error::Missing { ranges: vec![self.roots()] }),
            bytes => bytes.map_err(|error| error.at(location))?,
        };
        let parse = || {
            let entries = list::parse(bytes, self.pages(kind), height, number, kind.has_keys(), &self.limits)?;
            match entries.first() {
                Some(entry) if first.is_none_or(|first| first == entry.key) => Ok(Arc::new(entries)),
                _ => Err(Error::format("a directory of objects does not begin with the key that the one above says")),
            }
        };
        let entries = parse().map_err(|error| error.at(location))?;
        self.keep(key, Item::Directory(Arc::clone(&entries)));
        Ok(entries)
    }

    /// The entry of a page.
    pub(super) fn entry(&self, kind: ListKind, page: u32, fetched: &Fetched) -> Result<Entry> {
        let directory = self.directory(kind, 1, page >> PAGE_LOG2, fetched)?;
        directory.get((page & ((1 << PAGE_LOG2) - 1)) as usize).copied().ok_or_else(wrong)
    }

    /// The last page whose first key is not above a key, or below it.
    fn page_of(&self, kind: ListKind, key: u32, may_be_equal: bool, fetched: &Fetched) -> Result<u32> {
        let mut number = 0;
        for height in (1..=list::height(self.pages(kind))).rev() {
            let entries = self.directory(kind, height, number, fetched)?;
            let before = entries.partition_point(|entry| entry.key < key || may_be_equal && entry.key == key);
            number = (number << PAGE_LOG2) + before.saturating_sub(1) as u32;
        }
        Ok(number)
    }

    /// A page of nodes.
    pub fn nodes(&self, page: u32, fetched: &Fetched) -> Result<Arc<Vec<ObjectNode>>> {
        let key = (ListKind::Nodes, 0, page);
        if let Some(Item::Nodes(nodes)) = self.known(key) {
            return Ok(nodes);
        }
        let entry = self.entry(ListKind::Nodes, page, fetched)?;
        let bytes = self.bytes(entry.part, fetched);
        let nodes = bytes.and_then(|bytes| self.head.of_nodes().parse(page, bytes, &self.limits));
        let nodes = Arc::new(nodes.map_err(|error| error.at(|| format!("objects, page {page} of nodes")))?);
        self.keep(key, Item::Nodes(Arc::clone(&nodes)));
        Ok(nodes)
    }

    /// A page of pairs.
    pub(super) fn pair_page(&self, kind: ListKind, page: u32, fetched: &Fetched) -> Result<Arc<Vec<Pair>>> {
        let key = (kind, 0, page);
        if let Some(Item::Pairs(pairs)) = self.known(key) {
            return Ok(pairs);
        }
        let entry = self.entry(kind, page, fetched)?;
        let pairs = self.pairs(kind).ok_or_else(wrong)?;
        let found = self.bytes(entry.part, fetched).and_then(|bytes| pairs.parse(page, entry.key, bytes));
        let found = found.map_err(|error| error.at(|| format!("objects, page {page} of {}", kind.name())))?;
        let found = Arc::new(found);
        self.keep(key, Item::Pairs(Arc::clone(&found)));
        Ok(found)
    }

    /// The owners of a cluster's leaves, whose shapes are given.
    pub fn owners(&self, cluster: u32, shapes: &[LeafShape], fetched: &Fetched) -> Result<Arc<(Vec<LeafOwners>, u32)>> {
        let key = (ListKind::Owners, 0, cluster);
        if let Some(Item::Owners(owners)) = self.known(key) {
            return Ok(owners);
        }
        let entry = self.entry(ListKind::Owners, cluster, fetched)?;
        let parse = |bytes: &[u8]| {
            if bytes.is_empty() != shapes.is_empty() {
                return Err(Error::format("a cluster with leaves has no owners, or one without has some"));
            }
            match shapes {
                [] => Ok((vec![], entry.key)),
                _ => owners::parse(bytes, shapes, entry.key, self.head.objects, &self.limits),
            }
        };
        let owners = self.bytes(entry.part, fetched).and_then(parse);
        let owners = Arc::new(owners.map_err(|error| error.at(|| format!("objects, owners of cluster {cluster}")))?);
        self.keep(key, Item::Owners(Arc::clone(&owners)));
        Ok(owners)
    }

    /// A node; it has to exist.
    pub fn node(&self, number: u32, fetched: &Fetched) -> Result<ObjectNode> {
        let nodes = self.nodes(number >> PAGE_LOG2, fetched)?;
        nodes.get((number & ((1 << PAGE_LOG2) - 1)) as usize).cloned().ok_or_else(wrong)
    }

    /// The places of a key, ascending.
    fn places(&self, kind: ListKind, key: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        let mut places = vec![];
        if self.pages(kind) == 0 {
            return Ok(places);
        }
        let mut page = self.page_of(kind, key, false, fetched)?;
        loop {
            let pairs = self.pair_page(kind, page, fetched)?;
            let first = pairs.partition_point(|pair| pair.0 < key);
            let found = pairs.iter().skip(first).take_while(|pair| pair.0 == key);
            places.extend(found.map(|pair| pair.1));
            page += 1;
            if pairs.last().is_none_or(|pair| pair.0 > key) || page >= self.pages(kind) {
                return Ok(places);
            }
        }
    }

    /// Nodes of some pages that are as somebody wants them, ascending.
    fn in_pages(&self, pages: Vec<u32>, fetched: &Fetched, wanted: impl Fn(&ObjectNode) -> bool) -> Result<Vec<u32>> {
        let (mut found, mut missing) = (vec![], vec![]);
        for page in pages {
            match self.nodes(page, fetched) {
                Ok(nodes) => {
                    let first = page << PAGE_LOG2;
                    found
                        .extend((first..).zip(nodes.iter()).filter(|(_, node)| wanted(node)).map(|(number, _)| number));
                }
                Err(Error::Missing { ranges }) => missing.extend(ranges),
                Err(error) => return Err(error),
            }
        }
        match missing.is_empty() {
            true => Ok(found),
            false => Err(Error::Missing { ranges: crate::source::requests::plan(missing) }),
        }
    }

    /// The nodes of a name, ascending.
    pub fn find_name(&self, name: &str, fetched: &Fetched) -> Result<Vec<u32>> {
        let pages = self.places(ListKind::Names, hash(name, self.head.nodes), fetched)?;
        self.in_pages(pages, fetched, |node| node.name.as_deref() == Some(name))
    }

    /// The nodes of an id, ascending.
    pub fn find_id(&self, id: &str, fetched: &Fetched) -> Result<Vec<u32>> {
        let pages = self.places(ListKind::Ids, hash(id, self.head.nodes), fetched)?;
        self.in_pages(pages, fetched, |node| node.id.as_deref() == Some(id))
    }

    /// The children of a node, or the nodes without a parent.
    pub fn children(&self, parent: Option<u32>, fetched: &Fetched) -> Result<Vec<u32>> {
        let pages = self.child_pages(parent, fetched)?;
        self.in_pages(pages, fetched, |node| node.parent == parent)
    }

    /// The pages of nodes in which a node has children, ascending; without a node, those with nodes without a parent.
    pub fn child_pages(&self, parent: Option<u32>, fetched: &Fetched) -> Result<Vec<u32>> {
        self.places(ListKind::Children, parent.map_or(0, |parent| parent + 1), fetched)
    }

    /// The children of a node in a page.
    pub fn children_in(&self, parent: Option<u32>, page: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        self.in_pages(vec![page], fetched, |node| node.parent == parent)
    }

    /// The nodes above a node, its parent first.
    pub fn above(&self, number: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        let mut above = vec![];
        let mut node = self.node(number, fetched)?;
        while let Some(parent) = node.parent {
            if above.len() >= MOST_ABOVE as usize {
                let what = "nodes lie above one another in a circle, or more than 4096 deep";
                return Err(Error::format(what).at(|| format!("objects, node {number}")));
            }
            above.push(parent);
            node = self.node(parent, fetched)?;
        }
        Ok(above)
    }

    /// The clusters whose leaves hold an object: the first one, and others.
    pub fn clusters_of(&self, object: u32, fetched: &Fetched) -> Result<Vec<u32>> {
        let mut clusters = vec![self.page_of(ListKind::Owners, object, true, fetched)?];
        clusters.extend(self.places(ListKind::Further, object, fetched)?);
        Ok(clusters)
    }
}
