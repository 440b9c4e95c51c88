//! Cluster lists: the tree in which a reader finds clusters (SPEC.md, "Section CLUSTERS").
//!
//! The topmost list lies in CLUSTERS, and every other one in INDEX, before everything below it. No list says where
//! anything is: numbers and offsets are running sums, along the path from the topmost list. So a list cannot name
//! itself, or anything above it.

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

/// Gives clusters, or entries in their place, the numbers of their roots' children: roots that are nobody's children
/// come first.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{
        clusters::{Cluster, ClusterLevel},
        error_code::ErrorCode,
        levels::LevelRecord,
        sections::{Extent, Part},
    };

    const INDEX_BLOCK: u64 = 500;

    fn levels() -> Levels {
        let record = |page_offset| LevelRecord { page_offset, page_bytes: 600, ..LevelRecord::default() };
        Levels { levels: vec![record(0), record(600)], ..Levels::default() }
    }

    /// A cluster of a file of four.
    fn cluster(k: u32) -> Cluster {
        let at = u64::from(k);
        let level = |start: u64, arcs: u64, blocks: u64| ClusterLevel {
            arcs: Extent { offset: start + at * arcs, length: arcs },
            blocks: Extent { offset: start + 4 * arcs + at * blocks, length: blocks },
            triangle_count: 1000 * u64::from(k % 2),
            max_error: ErrorCode(if k % 2 == 1 { 321 + k as u16 } else { 0 }),
        };
        Cluster {
            first_root: 32 * k,
            root_count: 32,
            first_arc: 99 * k,
            arc_count: 99,
            first_corner: 41 * k,
            corner_count: 41,
            first_child: 32 + 96 * k.min(1),
            child_count: if k == 0 { 96 } else { 0 },
            bounds: [[-5 - i64::from(k), -6, 700], [80, -6, 1 << 40]],
            index: Part { offset: at * INDEX_BLOCK, length: INDEX_BLOCK, checksum: 0xdead_beef },
            levels: vec![level(0, 50, 100), level(600, 0, 150)],
        }
    }

    fn entries(clusters: impl IntoIterator<Item = u32>) -> Vec<Entry> {
        clusters.into_iter().map(|k| Entry::of_cluster(k, cluster(k))).collect()
    }

    /// The entry of a list of the last clusters, as it is parsed, and the bytes of that list.
    fn listed(change: impl FnOnce(&mut Entry, &mut Vec<Entry>)) -> Result<(Entry, Vec<u8>)> {
        let mut below = entries(1..4);
        let mut list = Entry::over(&below).unwrap();
        list.sums.index = Part { offset: 0, length: 100, checksum: 7 };
        change(&mut list, &mut below);
        let mut top = entries([0]);
        top.push(list);
        // Lengths that lie may have no sum.
        let index_bytes = top.iter().map(|entry| entry.index_bytes().unwrap()).fold(0, u64::wrapping_add);
        let top = parse_clusters(&write_clusters(&top), &levels(), index_bytes, &Limits::default())?;
        Ok((top[1].clone(), write_list(&below)))
    }

    fn message(result: Result<impl std::fmt::Debug>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_single_list_survives_and_its_prefixes_are_refused() {
        let (levels, limits) = (levels(), Limits::default());
        let clusters = entries(0..4);
        let bytes = write_clusters(&clusters);
        assert_eq!(parse_clusters(&bytes, &levels, 2000, &limits).unwrap(), clusters);
        assert!(parse_clusters(&bytes, &levels, 1999, &limits).is_err());
        assert!((0..bytes.len()).all(|end| parse_clusters(&bytes[..end], &levels, 2000, &limits).is_err()));
        let few = Limits { root_count: 127, ..limits };
        assert!(matches!(parse_clusters(&bytes, &levels, 2000, &few), Err(Error::Limit { .. })));
    }

    #[test]
    fn a_list_says_the_same_of_its_clusters_as_the_topmost_one_would() {
        let (list, bytes) = listed(|_, _| ()).unwrap();
        let found = parse_list(&bytes, &list, &Limits::default()).unwrap();
        assert_eq!(found.len(), 3);
        for (k, mut found) in (1..).zip(found) {
            // The list lies before its blocks.
            found.sums.index.offset -= 100;
            assert_eq!(found, Entry::of_cluster(k, cluster(k)));
        }
        assert!((0..bytes.len()).all(|end| parse_list(&bytes[..end], &list, &Limits::default()).is_err()));
    }

    #[test]
    fn a_list_in_place_of_itself_is_refused() {
        // Its only entry has its own height: so would a list that names itself.
        let (list, bytes) = listed(|list, below| *below = vec![list.clone()]).unwrap();
        assert!(message(parse_list(&bytes, &list, &Limits::default())).contains("another height"));
    }

    #[test]
    fn two_hundred_lists_below_each_other_are_refused() {
        assert!(message(listed(|list, _| list.height = 200)).contains("more than 8 lists"));
        let deep = |height: u8| {
            let (list, bytes) = listed(|list, below| {
                (list.height, below[0].height) = (height, height - 1);
                below[0].cluster_count = 1;
            })?;
            parse_list(&bytes, &list, &Limits::default())
        };
        assert!(deep(8).is_ok());
        assert!(message(deep(9)).contains("more than 8 lists"));
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        let limits = Limits::default();
        let parse = |(list, bytes): (Entry, Vec<u8>)| parse_list(&bytes, &list, &limits);
        assert!(message(listed(|list, _| list.below += 1).and_then(parse)).contains("do not add up"));
        assert!(message(listed(|_, below| below[1].sums.index.length += 1).and_then(parse)).contains("do not add up"));
        let beyond = listed(|list, _| list.below = u64::MAX - 550).and_then(parse);
        assert!(matches!(beyond, Err(Error::Format { .. })), "{beyond:?}");
        let large = listed(|list, _| list.sums.index.length = limits.part_bytes + 1);
        assert!(matches!(large, Err(Error::Limit { .. })), "{large:?}");
        let pages = listed(|list, _| list.sums.levels[0].arcs.length = u64::MAX);
        assert!(matches!(pages, Err(Error::Format { .. })), "{pages:?}");
    }

    #[test]
    fn counts_that_do_not_add_up_are_refused() {
        type Change = fn(&mut Entry, &mut Vec<Entry>);
        let changes: [Change; 8] = [
            |_, below| below[0].sums.root_count -= 1,
            |_, below| below[0].sums.arc_count += 1,
            |_, below| below[2].sums.corner_count += 1,
            |_, below| below[2].sums.child_count += 1,
            |list, _| list.cluster_count += 1,
            |_, below| below[2].sums.bounds[1][0] += 1,
            |_, below| below[2].sums.levels[1].triangle_count += 1,
            |_, below| below[2].sums.levels[1].max_error.0 += 1,
        ];
        for change in changes {
            let result = listed(change).and_then(|(list, bytes)| parse_list(&bytes, &list, &Limits::default()));
            assert!(message(result).contains("do not add up"));
        }
        let (list, _) = listed(|_, _| ()).unwrap();
        assert!(message(parse_list(&[0], &list, &Limits::default())).contains("no entries"));
        let count = [255, 255, 255, 255, 15];
        assert!(message(parse_list(&count, &list, &Limits::default())).contains("room"));
    }
}
