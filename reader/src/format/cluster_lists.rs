//! Cluster lists: the tree in which a reader finds clusters (SPEC.md, "Section CLUSTERS").
//!
//! The topmost list lies in CLUSTERS, and every other one in INDEX, before everything below it. No list says where anything is: numbers and
//! offsets are running sums, along the path from the topmost list. So a list cannot name itself, or anything above it.

use super::clusters::{Entry, Place};
use crate::{
    codec::bytes::{Cursor, put_varint},
    error::{Error, Result},
    format::levels::Levels,
    limits::{Limits, within},
};

/// The fewest bytes that an entry takes without its levels, and that one of its levels takes.
const MIN_ENTRY_BYTES: usize = 15;
const MIN_LEVEL_BYTES: usize = 3;

/// Writes section CLUSTERS: root, arc and corner count of the file, then the topmost list.
pub(crate) fn write_clusters(top: &[Entry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let total = |count: fn(&Entry) -> u32| top.iter().map(|entry| u64::from(count(entry))).sum();
    put_varint(&mut bytes, total(|entry| entry.sums.root_count));
    put_varint(&mut bytes, total(|entry| entry.sums.arc_count));
    put_varint(&mut bytes, total(|entry| entry.sums.corner_count));
    bytes.extend(write_list(top));
    bytes
}

/// Writes a list: the number of its entries, and these.
pub(crate) fn write_list(entries: &[Entry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    put_varint(&mut bytes, entries.len() as u64);
    entries.iter().for_each(|entry| entry.write(&mut bytes));
    bytes
}

/// Reads section CLUSTERS. The entries must fill INDEX, and their pages the levels.
pub(crate) fn parse_clusters(bytes: &[u8], levels: &Levels, index_bytes: u64, limits: &Limits) -> Result<Vec<Entry>> {
    let mut cursor = Cursor::new(bytes);
    let id_limit = u64::from(u32::MAX - 1);
    let mut totals = [0; 3];
    for total in &mut totals {
        *total = cursor.varint_up_to(id_limit, "there are more than 2^32 - 2 roots, arcs or corners")? as u32;
    }
    let [root_count, ..] = totals;
    within(limits.root_count, u64::from(root_count), "number of roots")?;
    let mut place = Place { pages: vec![[0; 2]; levels.levels.len()], ..Place::default() };
    let mut entries = parse_entries(&mut cursor, &mut place, limits)?;
    cursor.finish()?;
    let whole = place.pages.iter().map(|&[arcs, blocks]| arcs.checked_add(blocks));
    let page_bytes = levels.levels.iter().map(|level| Some(level.page_bytes));
    if [place.root, place.arc, place.corner] != totals || place.index != index_bytes || !page_bytes.eq(whole) {
        return Err(Error::format("the clusters do not add up to what the file has"));
    }
    number_children(entries.iter_mut().map(|entry| &mut entry.sums), root_count)?;
    for entry in &mut entries {
        for (pages, (level, [arc_bytes, _])) in entry.sums.levels.iter_mut().zip(levels.levels.iter().zip(&place.pages))
        {
            // Below the end of the level's pages, which is below 2^64.
            pages.arcs.offset += level.page_offset;
            pages.blocks.offset += level.page_offset + arc_bytes;
        }
    }
    Ok(entries)
}

/// Reads a list that an entry stands for.
pub(crate) fn parse_list(bytes: &[u8], list: &Entry, limits: &Limits) -> Result<Vec<Entry>> {
    let mut cursor = Cursor::new(bytes);
    let entries = parse_entries(&mut cursor, &mut Place::within(list), limits)?;
    cursor.finish()?;
    let Some(mut over) = Entry::over(&entries) else {
        return Err(Error::format("a list has no entries, or sums that are too large"));
    };
    over.sums.index = list.sums.index;
    if over.height != list.height {
        return Err(Error::format("a list has another height than its entry says"));
    }
    if over != *list {
        return Err(Error::format("the entries of a list do not add up to what its own entry says"));
    }
    Ok(entries)
}

fn parse_entries(cursor: &mut Cursor<'_>, place: &mut Place, limits: &Limits) -> Result<Vec<Entry>> {
    let count = cursor.varint()?;
    let least = MIN_ENTRY_BYTES + place.pages.len() * MIN_LEVEL_BYTES;
    if count > (cursor.left() / least) as u64 {
        return Err(Error::format("there are more clusters than the list has room for"));
    }
    (0..count).map(|_| Entry::parse(cursor, place, limits)).collect()
}

/// Gives clusters, or entries in their place, the numbers of their roots' children: roots that are nobody's children come first.
pub(crate) fn number_children<'c>(
    clusters: impl Iterator<Item = &'c mut super::clusters::Cluster>,
    root_count: u32,
) -> Result<()> {
    let clusters: Vec<_> = clusters.collect();
    let child_count = clusters.iter().map(|cluster| u64::from(cluster.child_count)).sum::<u64>();
    let top_count = u64::from(root_count).checked_sub(child_count).filter(|&tops| tops > 0 || root_count == 0);
    let mut next = top_count.ok_or_else(|| Error::format("every root is another's child"))? as u32;
    for cluster in clusters {
        cluster.first_child = next;
        next += cluster.child_count;
    }
    Ok(())
}
