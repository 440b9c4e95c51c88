//! Lists of pages, below directories: a page is found by its number, or by its first key (SPEC.md, "Lists").

use super::{PAGE, PAGE_LOG2};
#[cfg(feature = "write")]
use crate::codec::bytes::put_varint;
use crate::{
    codec::bytes::Cursor,
    error::{Error, Result},
    format::sections::Part,
    limits::Limits,
};

/// The lists of a file, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum ListKind {
    /// A page a cluster, empty where no root of it is a leaf. The key is the first object that is new in it.
    Owners,
    /// Pages of nodes, without keys.
    Nodes,
    /// Where a name is, by its hash.
    Names,
    /// Where an id is, by its hash.
    Ids,
    /// Where the children of a node are, by its number plus 1; by 0 where the nodes without a parent are.
    Children,
    /// Clusters that hold an object beside the first one.
    Further,
}

impl ListKind {
    pub const ALL: [Self; 6] = [Self::Owners, Self::Nodes, Self::Names, Self::Ids, Self::Children, Self::Further];

    pub fn has_keys(self) -> bool {
        self != Self::Nodes
    }

    /// In messages.
    pub fn name(self) -> &'static str {
        ["owners", "nodes", "names", "ids", "children", "further clusters"][self as usize]
    }
}

/// How many directories lie above a page, given the number of pages.
pub(super) fn height(pages: u32) -> u32 {
    let mut height = 0;
    let mut rest = pages;
    while rest > 0 {
        height += 1;
        rest = if rest > PAGE { rest.div_ceil(PAGE) } else { 0 };
    }
    height
}

/// How many directories there are of a height, or pages at height 0.
pub(super) fn count_at(pages: u32, height: u32) -> u32 {
    (0..height).fold(pages, |count, _| count.div_ceil(PAGE))
}

/// How many entries a directory has, which is number `number` of its height, at least 1.
fn entries(pages: u32, height: u32, number: u32) -> u32 {
    count_at(pages, height - 1).saturating_sub(number << PAGE_LOG2).min(PAGE)
}

/// An entry: the first key below, and where what is below lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Entry {
    pub key: u32,
    pub part: Part,
}

/// Writes a directory, of which the first part begins at `first`.
#[cfg(feature = "write")]
pub(super) fn write(entries: &[Entry], first: u64, has_keys: bool) -> Vec<u8> {
    let mut bytes = Vec::from(first.to_le_bytes());
    let mut before = 0;
    for &Entry { key, part } in entries {
        if has_keys {
            put_varint(&mut bytes, (key - before).into());
            before = key;
        }
        part.write(&mut bytes);
    }
    bytes
}

/// Reads a directory.
pub(super) fn parse(
    bytes: &[u8],
    pages: u32,
    height: u32,
    number: u32,
    has_keys: bool,
    limits: &Limits,
) -> Result<Vec<Entry>> {
    let mut cursor = Cursor::new(bytes);
    let mut next = cursor.u64()?;
    let mut key = 0_u64;
    let mut found = Vec::new();
    for _ in 0..entries(pages, height, number) {
        if has_keys {
            key += cursor.varint_up_to(u32::MAX.into(), "a key of objects exceeds 32 bits")?;
        }
        let key = u32::try_from(key).map_err(|_| Error::format("a key of objects exceeds 32 bits"))?;
        found.push(Entry { key, part: Part::parse(&mut cursor, &mut next, limits)? });
    }
    cursor.finish()?;
    Ok(found)
}

/// Puts directories above pages. Returns those below the root, the topmost ones first, and the root; offsets count from
/// where the first of them will lie, whose own offset is given, as is that of the first page.
#[cfg(feature = "write")]
pub(super) fn directories(pages: &[Entry], has_keys: bool, below: u64) -> (Vec<u8>, Vec<u8>) {
    // Sizes do not depend on offsets, so they come first.
    let mut heights: Vec<Vec<Entry>> = vec![pages.to_vec()];
    while let Some(last) = heights.last().filter(|last| last.len() > PAGE as usize) {
        let above = last.chunks(PAGE as usize).map(|entries| Entry {
            key: entries[0].key,
            part: Part { offset: 0, length: write(entries, 0, has_keys).len() as u64, checksum: 1 },
        });
        heights.push(above.collect());
    }
    let sizes: Vec<u64> = heights.iter().skip(1).map(|of| of.iter().map(|entry| entry.part.length).sum()).collect();
    let mut bytes: Vec<Vec<u8>> = vec![];
    for height in 1..heights.len() {
        // What lies below begins behind all directories above it.
        let mut first = below + sizes[height - 1..].iter().sum::<u64>();
        let mut of_height = vec![];
        for number in 0..heights[height].len() {
            let lower = &heights[height - 1];
            let entries = &lower[number * PAGE as usize..lower.len().min((number + 1) * PAGE as usize)];
            let directory = write(entries, first, has_keys);
            first += entries.iter().map(|entry| entry.part.length).sum::<u64>();
            heights[height][number].part.checksum = crc32fast::hash(&directory);
            of_height.extend(directory);
        }
        bytes.push(of_height);
    }
    bytes.reverse();
    let top = heights.last().map(Vec::as_slice).unwrap_or_default();
    let root = if top.is_empty() { vec![] } else { write(top, below, has_keys) };
    (bytes.concat(), root)
}
