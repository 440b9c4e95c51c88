//! Texels on their way into a file: bytes, whose meaning concerns nobody here.

use super::{encoder::append, sorting::ClusterSymbols};
use crate::format::channels::StreamOrder;
use crate::{
    error::{Error, Result},
    format::{
        sections::Part,
        texels::{TexelEntry, table_bytes, write_table},
    },
};

/// Texel streams one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct TexelRuns {
    all: Vec<u8>,
    /// Where each ends.
    ends: Vec<u64>,
}

impl TexelRuns {
    /// Appends the texels of a block, given its number of streams.
    pub fn push(&mut self, streams: &[Vec<u8>], stream_count: usize) -> Result<()> {
        if !streams.is_empty() && streams.len() != stream_count {
            let found = streams.len();
            return Err(Error::model(format!("a block has {found} texel streams; its channels need {stream_count}")));
        }
        for stream in 0..stream_count {
            self.all.extend(streams.get(stream).into_iter().flatten());
            self.ends.push(self.all.len() as u64);
        }
        Ok(())
    }

    /// Whether it has that number of streams, and nothing else. A piece may come from a damaged file.
    pub fn is_sound(&self, count: usize) -> bool {
        let end = self.ends.last().copied().unwrap_or(0);
        self.ends.len() == count && self.ends.is_sorted() && end == self.all.len() as u64
    }

    pub fn get(&self, stream: usize) -> &[u8] {
        let end_of = |stream: usize| self.ends.get(stream).map_or(0, |&end| end as usize);
        self.all.get(stream.checked_sub(1).map_or(0, end_of)..end_of(stream)).unwrap_or_default()
    }
}

/// The texels of a cluster as they stand in the file.
#[derive(Clone, Debug, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct EncodedTexels {
    /// Empty if there are no streams.
    pub directory: Vec<u8>,
    pub streams: Vec<u8>,
    /// Bytes of maps, and of the images of each channel.
    stream_bytes: Vec<u64>,
}

impl EncodedTexels {
    /// Collects the texels of blocks, each with its level, which come in the order of the file.
    pub fn new(symbols: &ClusterSymbols, blocks: &[(usize, u8)], order: &StreamOrder) -> Self {
        let count = order.count();
        let mut sources = vec![0; blocks.len() * count];
        let mut before = 0;
        for of_level in blocks.chunk_by(|(_, one), (_, other)| one == other) {
            for (number, &(block, _)) in (before..).zip(of_level) {
                for stream in 0..count {
                    sources[order.place(stream, number, [before, of_level.len()])] = block * count + stream;
                }
            }
            before += of_level.len();
        }
        let mut result = Self { stream_bytes: vec![0; order.size_count()], ..Self::default() };
        for source in sources {
            let part = append(&mut result.streams, symbols.texels(source));
            part.write(&mut result.directory);
            result.stream_bytes[order.size_number(source % count)] += part.length;
        }
        if result.streams.is_empty() {
            result.directory.clear();
        }
        result
    }
}

/// The table of a section that grows cluster by cluster.
#[derive(Clone, Debug)]
pub(super) struct TexelTable {
    entries: Vec<TexelEntry>,
    end: u64,
    stream_bytes: Vec<u64>,
}

impl TexelTable {
    pub fn new(cluster_count: usize, order: &StreamOrder) -> Self {
        let stream_bytes = vec![0; order.size_count()];
        Self { entries: Vec::new(), end: table_bytes(cluster_count as u32), stream_bytes }
    }

    /// Adds the next cluster.
    ///
    /// # Errors
    /// [`Error::Model`] if it is of another file.
    pub fn add(&mut self, texels: &EncodedTexels) -> Result<()> {
        let EncodedTexels { directory, streams, stream_bytes } = texels;
        if stream_bytes.len() != self.stream_bytes.len() {
            return Err(Error::model("a cluster does not have the channels of its file"));
        }
        let checksum = if directory.is_empty() { 0 } else { crc32fast::hash(directory) };
        let directory = Part { offset: self.end, length: directory.len() as u64, checksum };
        self.end += directory.length + streams.len() as u64;
        self.entries.push(TexelEntry { directory, end: self.end });
        self.stream_bytes.iter_mut().zip(stream_bytes).for_each(|(sum, bytes)| *sum += bytes);
        Ok(())
    }

    /// Bytes of all maps, and of all images of each channel.
    pub fn stream_bytes(&self) -> &[u64] {
        &self.stream_bytes
    }

    pub fn write(&self) -> Vec<u8> {
        write_table(&self.entries)
    }
}
