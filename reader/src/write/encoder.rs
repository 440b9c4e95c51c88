//! The second pass over the pieces of a file: they become bytes.

use super::{assembly::Assembly, piece::Piece};
use crate::{
    entropy::{Codes, Symbols, Tables, encode},
    error::{Error, Result},
    model::OverviewRecord,
    sections::{Cluster, Levels, Part},
};

/// Encodes pieces.
#[derive(Clone, Debug)]
pub struct Encoder {
    pub(super) assembly: Assembly,
    pub(super) tables: Tables,
    pub(super) codes: Codes,
    pub(super) overview: Option<OverviewRecord>,
}

/// A piece as bytes.
#[derive(Clone, Debug, Default)]
pub struct EncodedPiece {
    pub(super) clusters: Vec<Cluster>,
    /// Index blocks.
    pub(super) index: Vec<u8>,
    /// By level the arc parts and the block parts.
    pub(super) pages: Vec<[Vec<u8>; 2]>,
}

impl Encoder {
    pub(super) fn new(assembly: Assembly, tables: Tables, overview: Option<OverviewRecord>) -> Self {
        Self { assembly, codes: tables.codes(), tables, overview }
    }

    /// Encodes a piece; `number` says the how many-th it was that was counted, from 0.
    ///
    /// # Errors
    /// [`Error::Model`] where it is another one than was counted.
    pub fn encode(&self, number: usize, piece: &Piece) -> Result<EncodedPiece> {
        piece.index.check(self.assembly.levels.levels.len())?;
        let mut encoded = EncodedPiece {
            pages: vec![<[Vec<u8>; 2]>::default(); self.assembly.levels.levels.len()],
            ..EncodedPiece::default()
        };
        if piece.symbols.clusters.len() != piece.index.clusters.len() {
            return Err(Error::model("a piece has more or fewer clusters than its index says"));
        }
        let clusters = self.assembly.clusters(number, &piece.index);
        for (cluster, symbols) in clusters.zip(&piece.symbols.clusters) {
            let (mut cluster, mut index) = cluster?;
            let in_index = usize::from(self.assembly.levels.index_arc_levels);
            index.find_groups(&self.assembly.levels);
            let mut arc_parts = Vec::new();
            for ((arcs, place), [pages, _]) in
                symbols.arcs.iter().zip(&mut cluster.levels).zip(&mut encoded.pages).skip(in_index)
            {
                let start = pages.len();
                let groups = index.arc_groups.iter().map(|group| self.append(pages, arcs.of(group.clone())));
                arc_parts.push(groups.collect::<Result<Vec<_>>>()?);
                place.arcs.length = (pages.len() - start) as u64;
            }
            let (arc_count, level_count) = (cluster.arc_count as usize, cluster.levels.len());
            if index.streams.len() != symbols.blocks.len()
                || symbols.arcs.len() != level_count
                || symbols.arcs.iter().any(|arcs| arcs.count() != arc_count)
            {
                return Err(Error::model("a piece has more or fewer streams or arcs than its index says"));
            }
            for (stream, symbols) in index.streams.iter_mut().zip(&symbols.blocks) {
                let level = usize::from(stream.level);
                stream.part = self.append(&mut encoded.pages[level][1], symbols.iter())?;
                cluster.levels[level].blocks.length += stream.part.length;
            }
            let records = index.records(&cluster, &self.assembly.tolerances)?;
            let records = encode(&self.codes, [records.iter()])?;
            let all = 0..cluster.arc_count;
            let coarse = symbols.arcs.iter().take(in_index).map(|arcs| arcs.of(all.clone()));
            let arc_stream = encode(&self.codes, [symbols.corners.iter()].into_iter().chain(coarse))?;
            cluster.index = append(&mut encoded.index, &index.write(&records, &arc_stream, &arc_parts));
            encoded.clusters.push(cluster);
        }
        Ok(encoded)
    }

    /// What the file says of its levels, with these bytes of arc parts and block parts each.
    pub(super) fn levels_of(&self, clusters: &[Cluster], bytes: &[[u64; 2]]) -> Levels {
        let mut levels = self.assembly.levels.clone();
        let mut page_offset = 0;
        for (number, (level, bytes)) in levels.levels.iter_mut().zip(bytes).enumerate() {
            let at_level = || clusters.iter().map(|cluster| cluster.levels[number]);
            level.max_error =
                at_level().map(|cluster| cluster.max_error).max().unwrap_or_default().bound(&self.assembly.lattice);
            level.triangle_count = at_level().map(|cluster| cluster.triangle_count).sum();
            (level.page_offset, level.page_bytes) = (page_offset, bytes.iter().sum());
            page_offset += level.page_bytes;
        }
        levels
    }

    /// Appends a stream.
    fn append(&self, section: &mut Vec<u8>, symbols: Symbols<'_>) -> Result<Part> {
        Ok(append(section, &encode(&self.codes, [symbols])?))
    }
}

/// Appends a part of a section.
fn append(section: &mut Vec<u8>, bytes: &[u8]) -> Part {
    let offset = section.len() as u64;
    section.extend(bytes);
    let checksum = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
    Part { offset, length: bytes.len() as u64, checksum }
}
