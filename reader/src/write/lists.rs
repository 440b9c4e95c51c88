//! The lists in which readers find clusters: how many there are, and what each holds.

use std::io::{self, Write};

use crate::{
    error::{Error, Result},
    format::{
        cluster_lists::write_list,
        clusters::{Cluster, Entry},
        sections::Part,
    },
};

/// How clusters are divided among lists. A file whose clusters all fit in the topmost list has no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ListSizes {
    /// The most entries of a list. A list of 64 clusters takes about 4 kB, so a small region reads little for others;
    /// with fewer, lists would lie deeper, and each height is a round trip.
    pub entries: usize,
    /// The most bytes of the topmost list, which everybody reads: with header, levels and tables, opening takes at most
    /// 16 KiB.
    pub top_bytes: usize,
    /// In files of several lists, this many clusters stay in the topmost one. They hold the coarsest roots, which every
    /// query needs.
    pub top_clusters: usize,
}

impl Default for ListSizes {
    fn default() -> Self {
        Self { entries: 64, top_bytes: 8 << 10, top_clusters: 16 }
    }
}

/// The entries of the topmost list, with everything below them.
#[derive(Debug)]
pub(super) struct Lists {
    top: Vec<Branch>,
}

/// An entry; the bytes of its list, and what is in it. Clusters have none.
#[derive(Debug)]
struct Branch {
    entry: Entry,
    list: Vec<u8>,
    below: Vec<Branch>,
}

impl Lists {
    /// Divides clusters, in the order of the file, among lists.
    ///
    /// # Errors
    /// [`Error::Model`] if a sum over the clusters is too large.
    pub fn new(clusters: Vec<Cluster>, sizes: ListSizes) -> Result<Self> {
        let most = sizes.entries.max(2);
        let branch = |(number, cluster)| Branch {
            entry: Entry::of_cluster(number, cluster),
            list: Vec::new(),
            below: Vec::new(),
        };
        let mut top: Vec<Branch> = (0..).zip(clusters).map(branch).collect();
        loop {
            let is_small = top.len() <= most && bytes_of(&top).len() <= sizes.top_bytes;
            if is_small || top.len() <= sizes.top_clusters + 1 {
                return Ok(Self { top });
            }
            let mut rest = top.split_off(sizes.top_clusters).into_iter();
            let (count, lists) = (rest.len(), rest.len().div_ceil(most));
            for list in 0..lists {
                // All lists are equally long.
                let size = count * (list + 1) / lists - count * list / lists;
                top.push(Branch::over(rest.by_ref().take(size).collect())?);
            }
        }
    }

    /// The entries of the topmost list.
    pub fn top(&self) -> Vec<Entry> {
        self.top.iter().map(|branch| branch.entry.clone()).collect()
    }

    /// The size of section INDEX.
    pub fn index_bytes(&self) -> u64 {
        self.top.iter().filter_map(|branch| branch.entry.index_bytes()).sum()
    }

    /// Writes section INDEX; `copy` writes the next bytes of index blocks, as many as it is told.
    pub fn write_index<W: Write>(
        &self,
        out: &mut W,
        copy: &mut dyn FnMut(u64, &mut W) -> io::Result<()>,
    ) -> io::Result<()> {
        write_branches(&self.top, out, copy)
    }
}

impl Branch {
    fn over(below: Vec<Self>) -> Result<Self> {
        let entries: Vec<Entry> = below.iter().map(|branch| branch.entry.clone()).collect();
        let mut entry = Entry::over(&entries).ok_or_else(|| Error::model("the file is too large to be listed"))?;
        let list = write_list(&entries);
        entry.sums.index = Part { offset: 0, length: list.len() as u64, checksum: crc32fast::hash(&list) };
        Ok(Self { entry, list, below })
    }
}

fn bytes_of(branches: &[Branch]) -> Vec<u8> {
    let mut bytes = Vec::new();
    branches.iter().for_each(|branch| branch.entry.write(&mut bytes));
    bytes
}

fn write_branches<W: Write>(
    branches: &[Branch],
    out: &mut W,
    copy: &mut dyn FnMut(u64, &mut W) -> io::Result<()>,
) -> io::Result<()> {
    for branch in branches {
        if branch.below.is_empty() {
            copy(branch.entry.sums.index.length, out)?;
        } else {
            out.write_all(&branch.list)?;
            write_branches(&branch.below, out, copy)?;
        }
    }
    Ok(())
}
