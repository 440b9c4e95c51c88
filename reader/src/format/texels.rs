//! Section TEXELS: the texel streams of all blocks, cluster by cluster (SPEC.md, "Section TEXELS").
//!
//! ```text
//! table, in chunks of up to 256 clusters        per cluster with texels
//!   per cluster, 16 bytes                          texel directory: a part per texel stream of each block
//!     offset of its directory   u64, in TEXELS     the streams
//!     size of its directory     u32
//!     CRC-32 of its directory   u32
//!   end of the last one's texels u64
//!   CRC-32 of the above          u32
//! ```
//!
//! Chunks have places that follow from the number of clusters. So a reader finds the texels of any root with one
//! request for a chunk, one for a directory and one for streams, and opening takes no byte of them, however large the
//! file is. Blocks are ordered by level, then by root, so that the streams of a block are adjacent. Where images are in
//! scales, the streams of a level are ordered by their number before they are by root.

use crate::{
    codec::bytes::{Cursor, has_checksum},
    error::{Error, Result},
    format::{
        channels::StreamOrder,
        index_block::ClusterIndex,
        sections::{Extent, Part},
    },
    limits::{Limits, within},
};

/// The most clusters of a chunk: 4108 bytes, which cost little more than a request for fewer.
const CHUNK_CLUSTERS: u32 = 256;
const ENTRY_BYTES: u64 = 16;
const CHUNK_END_BYTES: u64 = 12;

/// The chunk of the table that has a cluster.
pub(crate) fn chunk_of(cluster: u32) -> u32 {
    cluster / CHUNK_CLUSTERS
}

/// The first cluster of a chunk.
pub(crate) fn first_of_chunk(chunk: u32) -> u32 {
    chunk.saturating_mul(CHUNK_CLUSTERS)
}

/// The number of chunks.
pub(crate) fn chunk_count(cluster_count: u32) -> u32 {
    cluster_count.div_ceil(CHUNK_CLUSTERS)
}

/// The size of the table.
pub(crate) fn table_bytes(cluster_count: u32) -> u64 {
    u64::from(cluster_count) * ENTRY_BYTES + u64::from(chunk_count(cluster_count)) * CHUNK_END_BYTES
}

/// Where a chunk lies in the section.
pub(crate) fn chunk_extent(chunk: u32, cluster_count: u32) -> Extent {
    let first = first_of_chunk(chunk).min(cluster_count);
    let count = (cluster_count - first).min(CHUNK_CLUSTERS);
    let offset = u64::from(first) * ENTRY_BYTES + u64::from(chunk) * CHUNK_END_BYTES;
    Extent { offset, length: u64::from(count) * ENTRY_BYTES + CHUNK_END_BYTES }
}

/// The texels of a cluster: its directory, and the end of the streams, which follow the directory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct TexelEntry {
    /// Within the section; empty if no block of the cluster has texels.
    pub directory: Part,
    pub end: u64,
}

/// Writes the table.
pub(crate) fn write_table(entries: &[TexelEntry]) -> Vec<u8> {
    let mut table = Vec::new();
    for chunk in entries.chunks(CHUNK_CLUSTERS as usize) {
        let start = table.len();
        for TexelEntry { directory, .. } in chunk {
            table.extend(directory.offset.to_le_bytes());
            table.extend((directory.length as u32).to_le_bytes());
            table.extend(directory.checksum.to_le_bytes());
        }
        table.extend(chunk.last().map_or(0, |last| last.end).to_le_bytes());
        table.extend(crc32fast::hash(&table[start..]).to_le_bytes());
    }
    table
}

/// Reads a chunk of the table of a section of `section_bytes`.
pub(crate) fn parse_chunk(
    bytes: &[u8],
    cluster_count: u32,
    section_bytes: u64,
    limits: &Limits,
) -> Result<Vec<TexelEntry>> {
    let Some((bytes, checksum)) = bytes.split_last_chunk() else {
        return Err(Error::format("the texel table ends early"));
    };
    if !has_checksum(bytes, u32::from_le_bytes(*checksum)) {
        return Err(Error::format("the checksum does not match"));
    }
    let mut cursor = Cursor::new(bytes);
    let mut entries: Vec<TexelEntry> = Vec::new();
    while cursor.left() as u64 >= ENTRY_BYTES {
        let (offset, length, checksum) = (cursor.u64()?, u64::from(cursor.u32()?), cursor.u32()?);
        within(limits.part_bytes, length, "size of a texel directory")?;
        if let Some(before) = entries.last_mut() {
            before.end = offset;
        }
        entries.push(TexelEntry { directory: Part { offset, length, checksum }, end: 0 });
    }
    let end = cursor.u64()?;
    cursor.finish()?;
    if let Some(last) = entries.last_mut() {
        last.end = end;
    }
    for &TexelEntry { directory: Part { offset, length, checksum }, end } in &entries {
        // An empty directory is one without streams.
        let has_room = match length {
            0 => offset == end && checksum == 0,
            _ => offset.checked_add(length).is_some_and(|after| after < end),
        };
        if !has_room || offset < table_bytes(cluster_count) || end > section_bytes {
            return Err(Error::format("the texels of a cluster do not lie where the table leaves room for them"));
        }
    }
    Ok(entries)
}

/// Where the texel streams of a cluster's blocks are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct TexelDirectory {
    /// Level and root of each block, the root counted from the cluster's first; in ascending order.
    blocks: Vec<(u8, u32)>,
    /// The streams of each block, within the section; none if no block has texels.
    parts: Vec<Part>,
    order: StreamOrder,
}

/// The blocks of a cluster in the order of its texels: level and root.
fn blocks_of(index: &ClusterIndex) -> Vec<(u8, u32)> {
    let roots = (0..).zip(&index.roots);
    let mut blocks: Vec<_> =
        roots.flat_map(|(root, entry)| entry.blocks.iter().map(move |block| (block.level, root))).collect();
    blocks.sort_unstable();
    blocks
}

impl TexelDirectory {
    /// Reads the directory of a cluster; `index` is its index block.
    pub(crate) fn parse(
        bytes: &[u8],
        entry: &TexelEntry,
        index: &ClusterIndex,
        order: &StreamOrder,
        limits: &Limits,
    ) -> Result<Self> {
        let mut result = Self { blocks: blocks_of(index), parts: Vec::new(), order: order.clone() };
        if bytes.is_empty() {
            return Ok(result);
        }
        let mut cursor = Cursor::new(bytes);
        let mut next = entry.directory.offset.saturating_add(entry.directory.length);
        for _ in 0..result.blocks.len() * order.count() {
            result.parts.push(Part::parse(&mut cursor, &mut next, limits)?);
        }
        cursor.finish()?;
        if next != entry.end {
            return Err(Error::format("the texels of a cluster do not add up to their size in the table"));
        }
        Ok(result)
    }

    /// A stream of a block, by level, root and number; empty if the cluster has no texels.
    pub(crate) fn part(&self, level: u8, root: u32, stream: usize) -> Result<Part> {
        match self.blocks.binary_search(&(level, root)) {
            Ok(block) => Ok(self.part_of(block, stream)),
            Err(_) => Err(Error::format("a block does not exist")),
        }
    }

    fn part_of(&self, block: usize, stream: usize) -> Part {
        self.parts.get(self.place(block, stream)).copied().unwrap_or_default()
    }

    /// Where a stream of a block lies among all.
    fn place(&self, block: usize, stream: usize) -> usize {
        let level = self.blocks[block].0;
        let before = self.blocks.partition_point(|&(other, _)| other < level);
        let of_level = self.blocks.partition_point(|&(other, _)| other <= level) - before;
        self.order.place(stream, block, [before, of_level])
    }

    /// All streams in the order of the file, each with level, root and number.
    pub(crate) fn streams(&self) -> impl Iterator<Item = ((u8, u32, usize), Part)> + '_ {
        // Without any there is no part.
        let blocks = if self.parts.is_empty() { 0 } else { self.blocks.len() };
        let all = (0..blocks).flat_map(|block| (0..self.order.count()).map(move |stream| (block, stream)));
        let mut all: Vec<(usize, usize)> = all.collect();
        all.sort_by_cached_key(|&(block, stream)| self.place(block, stream));
        let key = |(block, stream): (usize, usize)| (self.blocks[block].0, self.blocks[block].1, stream);
        all.into_iter().map(key).zip(self.parts.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(count: u32) -> Vec<TexelEntry> {
        let mut next = table_bytes(count);
        let entry = |k: u32| {
            // Every fifth cluster has no texels.
            let length = if k % 5 == 4 { 0 } else { 40 };
            let directory = Part { offset: next, length, checksum: length as u32 * k };
            next += length * 100;
            TexelEntry { directory, end: next }
        };
        (0..count).map(entry).collect()
    }

    fn parse(entries: &[TexelEntry], section_bytes: u64) -> Result<Vec<TexelEntry>> {
        let (table, count) = (write_table(entries), entries.len() as u32);
        assert_eq!(table.len() as u64, table_bytes(count));
        let mut found = Vec::new();
        for chunk in 0..chunk_count(count) {
            let Extent { offset, length } = chunk_extent(chunk, count);
            let bytes = &table[offset as usize..(offset + length) as usize];
            found.extend(parse_chunk(bytes, count, section_bytes, &Limits::default())?);
        }
        Ok(found)
    }

    #[test]
    fn tables_of_any_length_survive() {
        for count in [0, 1, 4, 5, 255, 256, 257, 512, 1000] {
            let entries = entries(count);
            let end = entries.last().map_or(0, |last| last.end);
            assert_eq!(parse(&entries, end).unwrap(), entries);
            assert!((0..count).all(|k| chunk_extent(chunk_of(k), count).length >= ENTRY_BYTES + CHUNK_END_BYTES));
        }
        // A count from a file is never a reason to overflow.
        assert_eq!(table_bytes(u32::MAX), (1 << 32) * 16 - 16 + (1 << 24) * 12);
        assert_eq!(chunk_extent(u32::MAX, u32::MAX).length, CHUNK_END_BYTES);
    }

    #[test]
    fn tables_that_lie_are_refused() {
        type Change = fn(&mut [TexelEntry], u64);
        let end = entries(9)[8].end;
        let changes: [Change; 7] = [
            // Into the table, backwards, beyond the section.
            |all, _| all[0].directory.offset -= 1,
            |all, _| all[3].directory.offset = all[2].directory.offset - 1,
            |all, end| all[8].end = end + 1,
            |all, _| all[5].directory.offset = u64::MAX,
            // Directories without room for streams; room without a directory.
            |all, _| all[2].directory.length = 4000,
            |all, _| all[2].directory.length = 0,
            |all, _| all[4].directory.checksum = 1,
        ];
        for (number, change) in changes.iter().enumerate() {
            let mut changed = entries(9);
            change(&mut changed, end);
            assert!(parse(&changed, end).is_err(), "change {number}");
        }
        let mut table = write_table(&entries(9));
        table[70] ^= 1;
        assert!(parse_chunk(&table, 9, end, &Limits::default()).is_err());
        assert!((0..4).all(|length| parse_chunk(&table[..length], 9, end, &Limits::default()).is_err()));
    }
}
