//! Writing objects (feature `write`): clusters come in the order of the file, and give objects their numbers.

use std::collections::BTreeSet;

use super::{
    MOST_ABOVE, MOST_NODES, ObjectNode, PAGE, hash,
    list::{self, Entry, ListKind},
    owners::{self, LeafOwners},
    page::{self, Nodes},
    pairs::Pair,
    section::Head,
};
use crate::{
    error::{Error, Result},
    format::sections::Part,
};

/// No number yet.
const NONE: u32 = u32::MAX;

/// The objects of a file that is written.
#[derive(Debug)]
pub(crate) struct ObjectsWriter {
    nodes: Vec<ObjectNode>,
    /// Of each node, once a leaf holds it.
    numbers: Vec<u32>,
    /// The nodes by number: objects, and then assemblies.
    order: Vec<u32>,
    /// Of each cluster.
    owners: Vec<Entry>,
    further: Vec<Pair>,
}

/// The sections OBJECTS and OBJECT_PAGES; between the two halves of the latter lie the pages of owners.
pub(crate) struct Written {
    pub head: Vec<u8>,
    pub before_owners: Vec<u8>,
    pub after_owners: Vec<u8>,
}

impl ObjectsWriter {
    /// A file with these nodes, none of which a leaf holds yet.
    ///
    /// # Errors
    /// [`Error::Model`] if a file cannot have them.
    pub fn new(nodes: Vec<ObjectNode>) -> Result<Self> {
        if nodes.len() as u64 > MOST_NODES {
            return Err(Error::model("2^31 or more objects and assemblies"));
        }
        if let Some(fault) = nodes.iter().find_map(page::fault) {
            return Err(Error::model(fault));
        }
        let numbers = vec![NONE; nodes.len()];
        let this = Self { nodes, numbers, order: vec![], owners: vec![], further: vec![] };
        this.check_depths()?;
        Ok(this)
    }

    /// Checks that parents exist and are in no circle.
    fn check_depths(&self) -> Result<()> {
        let deep = || Error::model("objects lie above one another in a circle, or more than 4096 deep");
        let mut depths = vec![NONE; self.nodes.len()];
        let mut path = vec![];
        for node in 0..self.nodes.len() as u32 {
            let mut at = Some(node);
            let mut depth = 0;
            while let Some(node) = at {
                let known =
                    *depths.get(node as usize).ok_or_else(|| Error::model("the parent of an object is missing"))?;
                if known != NONE {
                    depth = known + 1;
                    break;
                }
                path.push(node);
                if path.len() > MOST_ABOVE as usize + 1 {
                    return Err(deep());
                }
                at = self.nodes[node as usize].parent;
            }
            while let Some(node) = path.pop() {
                depths[node as usize] = depth;
                if depth > MOST_ABOVE {
                    return Err(deep());
                }
                depth += 1;
            }
        }
        Ok(())
    }

    /// Takes the leaves of the next cluster: for each and for each of its blocks the nodes that own its islands.
    /// Returns the page of owners.
    ///
    /// # Errors
    /// [`Error::Model`] if a node does not exist.
    pub fn add(&mut self, leaves: &[Vec<Vec<u32>>]) -> Result<Vec<u8>> {
        let first = self.order.len() as u32;
        let mut owned = Vec::with_capacity(leaves.len());
        let mut further = BTreeSet::new();
        for blocks in leaves {
            // Objects in the order in which the finest block has them first, and then those of coarser ones.
            let mut leaf = LeafOwners::default();
            let mut locals = std::collections::HashMap::new();
            for &node in blocks.iter().rev().flatten() {
                if locals.contains_key(&node) {
                    continue;
                }
                let number = self.numbers.get_mut(node as usize);
                let number = number.ok_or_else(|| Error::model("an owner is beyond the number of objects"))?;
                if *number == NONE {
                    *number = self.order.len() as u32;
                    self.order.push(node);
                }
                if *number < first {
                    further.insert(*number);
                }
                locals.insert(node, leaf.objects.len() as u32);
                leaf.objects.push(*number);
            }
            for block in blocks {
                let local = |node: &u32| locals.get(node).copied().unwrap_or(0);
                leaf.blocks.push(match leaf.objects.len() {
                    0 | 1 => owners::Islands::All(block.len() as u32),
                    _ => owners::Islands::Each(block.iter().map(local).collect()),
                });
            }
            owned.push(leaf);
        }
        let cluster = self.owners.len() as u32;
        self.further.extend(further.into_iter().map(|object| (object, cluster)));
        let page = if owned.is_empty() { vec![] } else { owners::write(&owned, first)? };
        self.owners.push(Entry { key: first, part: part(&page) });
        Ok(page)
    }

    /// Whether any leaf holds an object.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Both sections, once all clusters have come.
    pub fn finish(mut self) -> Result<Written> {
        let objects = self.order.len() as u32;
        self.number_assemblies();
        let all = self.order.len() as u32;
        let (mut names, mut ids, mut children) = (vec![], vec![], vec![]);
        for (number, &node) in (0..).zip(&self.order) {
            let (place, node) = (number / PAGE, &self.nodes[node as usize]);
            names.extend(node.name.as_deref().map(|name| (hash(name, all), place)));
            ids.extend(node.id.as_deref().map(|id| (hash(id, all), place)));
            children.push((node.parent.map_or(0, |parent| self.numbers[parent as usize] + 1), place));
        }
        self.further.sort_unstable();
        let mut lists = [names, ids, children, std::mem::take(&mut self.further)];
        for pairs in &mut lists {
            pairs.sort_unstable();
            pairs.dedup();
        }
        let count = |pairs: &Vec<Pair>| {
            u32::try_from(pairs.len()).map_err(|_| Error::model("objects lie in too many clusters"))
        };
        let mut head = Head { objects, nodes: all, pairs: [0; 4], roots: Default::default() };
        for (known, pairs) in head.pairs.iter_mut().zip(&lists) {
            *known = count(pairs)?;
        }
        // The pages of each list, as entries and as bytes; those of owners are elsewhere.
        let of_nodes = Nodes { objects, all };
        let mut pages = vec![(std::mem::take(&mut self.owners), vec![]), (vec![], vec![])];
        for nodes in self.order.chunks(PAGE as usize) {
            let nodes: Vec<ObjectNode> = nodes.iter().map(|&node| self.placed(node)).collect();
            push(&mut pages[1], 0, of_nodes.write(&nodes)?);
        }
        for (&kind, pairs) in ListKind::ALL[2..].iter().zip(&lists) {
            let mut list = (vec![], vec![]);
            let known = head.pairs(kind).ok_or_else(|| Error::model("a list of objects is unknown"))?;
            for pairs in pairs.chunks(PAGE as usize) {
                push(&mut list, pairs.first().map_or(0, |pair| pair.0), known.write(pairs)?);
            }
            pages.push(list);
        }
        // Roots are as long wherever the rest lies.
        let lengths: Vec<u64> = (ListKind::ALL.iter().zip(&pages))
            .map(|(kind, (entries, _))| list::directories(entries, kind.has_keys(), 0).1.len() as u64)
            .collect();
        let mut next: u64 = lengths.iter().sum();
        let (mut before, mut after, mut roots) = (vec![], vec![], vec![]);
        for (number, (kind, (entries, bytes))) in ListKind::ALL.iter().zip(&pages).enumerate() {
            let (directories, root) = list::directories(entries, kind.has_keys(), next);
            head.roots[number] = part(&root);
            roots.extend(root);
            next += directories.len() as u64 + entries.iter().map(|entry| entry.part.length).sum::<u64>();
            let half = if number == 0 { &mut before } else { &mut after };
            half.extend(directories);
            half.extend(bytes);
        }
        roots.extend(before);
        Ok(Written { head: head.write(), before_owners: roots, after_owners: after })
    }

    /// Numbers the nodes above objects: for each object in turn those that have none, from the top down.
    fn number_assemblies(&mut self) {
        for object in 0..self.order.len() {
            let mut path = vec![];
            let mut at = self.nodes[self.order[object] as usize].parent;
            while let Some(node) = at.filter(|&node| self.numbers[node as usize] == NONE) {
                path.push(node);
                at = self.nodes[node as usize].parent;
            }
            // What lies above an object that is a parent itself comes with that one.
            while let Some(node) = path.pop() {
                self.numbers[node as usize] = self.order.len() as u32;
                self.order.push(node);
            }
        }
    }

    /// A node in the numbers of the file.
    fn placed(&self, node: u32) -> ObjectNode {
        let node = &self.nodes[node as usize];
        ObjectNode { parent: node.parent.map(|parent| self.numbers[parent as usize]), ..node.clone() }
    }
}

fn push((entries, bytes): &mut (Vec<Entry>, Vec<u8>), key: u32, page: Vec<u8>) {
    entries.push(Entry { key, part: part(&page) });
    bytes.extend(page);
}

fn part(bytes: &[u8]) -> Part {
    let checksum = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
    Part { offset: 0, length: bytes.len() as u64, checksum }
}
