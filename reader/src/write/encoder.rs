//! The second pass over a file: encodes clusters.

use super::{
    arrangement::{Arrangement, ClusterContent},
    assembly::{FileHead, corner_symbols},
    owners::{self, BlockOwners},
    sorting::ClusterSymbols,
    texels::EncodedTexels,
};
use crate::{
    codec::entropy::{Codes, Symbols, Tables, encode},
    error::Result,
    format::{
        channels::{StreamOrder, stream_count},
        clusters::Cluster,
        levels::Levels,
        sections::Part,
    },
    write::model::OverviewRecord,
};

/// Encodes clusters.
#[derive(Clone, Debug)]
pub struct Encoder {
    pub(super) head: FileHead,
    pub(super) arrangement: Arrangement,
    pub(super) tables: Tables,
    pub(super) codes: Codes,
    pub(super) overview: Option<OverviewRecord>,
}

/// A cluster as bytes.
#[derive(Clone, Debug, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct EncodedCluster {
    pub(super) cluster: Cluster,
    /// Its index block.
    pub(super) index: Vec<u8>,
    /// For each level the arc pages and the block pages.
    pub(super) pages: Vec<[Vec<u8>; 2]>,
    pub(super) texels: EncodedTexels,
    /// Of each block of each leaf.
    pub(super) owners: Vec<Vec<BlockOwners>>,
}

impl Encoder {
    pub(super) fn new(
        head: FileHead,
        arrangement: Arrangement,
        tables: Tables,
        overview: Option<OverviewRecord>,
    ) -> Self {
        Self { head, arrangement, codes: tables.codes(), tables, overview }
    }

    /// The number of clusters to encode.
    pub fn cluster_count(&self) -> usize {
        self.arrangement.clusters.len()
    }

    /// How many texel streams a block has.
    pub(super) fn stream_count(&self) -> usize {
        stream_count(&self.head.channels)
    }

    pub(super) fn stream_order(&self) -> StreamOrder {
        StreamOrder::new(&self.head.channels)
    }

    /// For each root of the file its number among the roots of all pieces, as they came.
    pub fn root_order(&self) -> &[u32] {
        &self.arrangement.roots.order
    }

    /// Encodes a cluster.
    ///
    /// # Errors
    /// [`crate::Error::Model`] if its symbols are not the ones that were counted.
    pub fn encode(&self, symbols: &ClusterSymbols) -> Result<EncodedCluster> {
        encode_cluster(&self.head, &self.codes, self.arrangement.content(symbols.cluster)?, symbols)
    }

    /// What the file says of its levels; each has these bytes of arc pages and of block pages.
    pub(super) fn levels_of(&self, clusters: &[Cluster], bytes: &[[u64; 2]]) -> Levels {
        let mut levels = self.head.levels.clone();
        let mut page_offset = 0;
        for (number, (level, bytes)) in levels.levels.iter_mut().zip(bytes).enumerate() {
            let at_level = || clusters.iter().map(|cluster| cluster.levels[number]);
            level.max_error =
                at_level().map(|cluster| cluster.max_error).max().unwrap_or_default().bound(&self.head.lattice);
            level.triangle_count = at_level().map(|cluster| cluster.triangle_count).sum();
            (level.page_offset, level.page_bytes) = (page_offset, bytes.iter().sum());
            page_offset += level.page_bytes;
        }
        levels
    }
}

/// Encodes a cluster of a file.
pub(super) fn encode_cluster(
    head: &FileHead,
    codes: &Codes,
    content: ClusterContent,
    symbols: &ClusterSymbols,
) -> Result<EncodedCluster> {
    let (mut cluster, mut index, corners) = content.index(&head.lattice)?;
    let level_count = cluster.levels.len();
    let mut pages = vec![<[Vec<u8>; 2]>::default(); level_count];
    let in_index = usize::from(head.levels.index_arc_levels);
    index.find_arc_runs(&head.levels);
    let mut arc_parts = Vec::new();
    for (level, ([page, _], place)) in pages.iter_mut().zip(&mut cluster.levels).enumerate().skip(in_index) {
        let runs = index.arc_runs.iter();
        let runs = runs.map(|run| append_stream(codes, page, symbols.arcs(run.clone(), level, level_count)));
        arc_parts.push(runs.collect::<Result<Vec<_>>>()?);
        place.arcs.length = page.len() as u64;
    }
    // The first block of each level begins a stream.
    let mut blocks: Vec<_> = index.roots.iter().flat_map(|root| root.blocks.iter().copied()).enumerate().collect();
    blocks.sort_by_key(|(_, block)| block.level);
    let streams = blocks.chunk_by(|_, (_, block)| !block.begins_stream);
    for (stream, blocks) in index.streams.iter_mut().zip(streams) {
        let level = usize::from(stream.level);
        let runs: Vec<_> = blocks.iter().map(|&(block, _)| symbols.block(block)).collect();
        stream.part = append_stream(codes, &mut pages[level][1], runs)?;
        cluster.levels[level].blocks.length += stream.part.length;
    }
    let blocks: Vec<(usize, u8)> = blocks.iter().map(|&(number, block)| (number, block.level)).collect();
    let texels = EncodedTexels::new(symbols, &blocks, &StreamOrder::new(&head.channels));
    let owners = owners::of_leaves(&index.roots, |block| symbols.owners(block))?;
    let records = encode(codes, [index.records(&cluster, &head.levels.fillings, &head.tolerances)?.iter()])?;
    let corners = corner_symbols(corners, cluster.bounds[0]);
    let coarse = (0..in_index).flat_map(|level| symbols.arcs(0..cluster.arc_count, level, level_count));
    let arc_stream = encode(codes, [corners.iter()].into_iter().chain(coarse))?;
    let mut block = Vec::new();
    cluster.index = append(&mut block, &index.write(&records, &arc_stream, &arc_parts));
    Ok(EncodedCluster { cluster, index: block, pages, texels, owners })
}

/// Appends a stream.
fn append_stream<'a, I>(codes: &Codes, section: &mut Vec<u8>, runs: I) -> Result<Part>
where
    I: IntoIterator<Item = Symbols<'a>, IntoIter: DoubleEndedIterator>,
{
    Ok(append(section, &encode(codes, runs)?))
}

/// Appends a part of a section.
pub(super) fn append(section: &mut Vec<u8>, bytes: &[u8]) -> Part {
    let offset = section.len() as u64;
    section.extend(bytes);
    let checksum = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
    Part { offset, length: bytes.len() as u64, checksum }
}
