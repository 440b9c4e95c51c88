//! The first pass over the pieces of a file: they are numbered, and what decides about the tables is counted.

use super::{
    check::tolerance_codes,
    encoder::Encoder,
    numbering::{Numbering, Placed},
    piece::{PieceCluster, PieceIndex},
};
use crate::{
    entropy::{SymbolBuffer, Tables, Tally},
    error::Result,
    error_code::ErrorCode,
    header::{ENTRY_BYTES, HEADER_BYTES},
    index::ClusterIndex,
    model::{Lattice, LevelInfo, Model, OverviewRecord, SourceInfo},
    sections::{Cluster, ClusterLevel, LevelRecord, Levels},
};

/// So many times the bytes of the records may go to arcs in index blocks.
const ARCS_PER_RECORD: u64 = 3;

/// A group of arcs ends with the arc that brings its samples in pages to this number: about 0.9 kB over all levels. A region
/// at its borders needs few arcs of many clusters; smaller groups would lie farther apart, so that more requests were needed.
const ARC_GROUP_SAMPLES: u16 = 1024;

/// A file of which pieces are taken in one after the other. Pieces are made by themselves, wherever and whenever; what has to be known
/// of all of them is little. So a file can be larger than memory:
///
/// ```text
/// Assembly::new, count(index of each piece), seal    ->  Encoder
/// Encoder::encode(each piece), side by side          ->  EncodedPiece
/// Output::add(each of these), finish                 ->  the file
/// ```
#[derive(Clone, Debug)]
pub struct Assembly {
    pub(super) lattice: Lattice,
    pub(super) source: SourceInfo,
    pub(super) tolerances: Vec<ErrorCode>,
    pub(super) levels: Levels,
    numbering: Numbering,
    /// Of everything, and of what decides what goes where.
    all: Tally,
    records: Tally,
    corners: Tally,
    arcs: Vec<Tally>,
    coarsest: Tally,
    cluster_count: u64,
    stream_count: u64,
}

impl Assembly {
    /// A file of no pieces yet. Of the model only what is of the whole file counts: lattice, steps, levels, source.
    ///
    /// # Errors
    /// [`Error::Model`] where levels break a rule.
    pub fn new(head: &Model) -> Result<Self> {
        let record = |info: &LevelInfo| LevelRecord {
            tolerance: info.tolerance,
            quantisation: info.quantisation,
            ..LevelRecord::default()
        };
        Ok(Self {
            lattice: head.lattice,
            source: head.source.clone(),
            tolerances: tolerance_codes(head)?,
            levels: Levels {
                arc_tangent_shift: head.arc_tangent_shift,
                grid_quantisation: head.grid_quantisation,
                index_arc_levels: 1,
                arc_group_samples: ARC_GROUP_SAMPLES,
                levels: head.levels.iter().map(record).collect(),
            },
            numbering: Numbering::default(),
            all: Tally::default(),
            records: Tally::default(),
            corners: Tally::default(),
            arcs: vec![Tally::default(); head.levels.len()],
            coarsest: Tally::default(),
            cluster_count: 0,
            stream_count: 0,
        })
    }

    /// Takes in the next piece. Pieces that share something come in the order that [`super::Share::is_first`] speaks of.
    ///
    /// # Errors
    /// [`Error::Model`] where it does not fit the pieces before.
    pub fn count(&mut self, piece: &PieceIndex) -> Result<()> {
        piece.check(self.levels.levels.len())?;
        let number = self.numbering.add(piece)?;
        let (mut records, mut streams) = (Vec::new(), 0);
        for cluster in self.clusters(number, piece) {
            let (cluster, index) = cluster?;
            records.push(index.records(&cluster, &self.tolerances)?);
            streams += index.streams.len() as u64;
        }
        let records = Tally::of(records.iter().map(SymbolBuffer::iter));
        self.records.add(&records);
        self.stream_count += streams;
        self.cluster_count += piece.clusters.len() as u64;
        self.corners.add(&piece.corner_tally);
        piece.arc_tallies.iter().zip(&mut self.arcs).for_each(|(tally, sum)| sum.add(tally));
        piece.block_tallies.iter().take(1).for_each(|tally| self.coarsest.add(tally));
        let tallies = [&piece.corner_tally, &records].into_iter().chain(&piece.arc_tallies).chain(&piece.block_tallies);
        tallies.for_each(|tally| self.all.add(tally));
        Ok(())
    }

    /// The clusters of a counted piece, in the numbers of the file.
    pub(super) fn clusters<'a>(
        &'a self,
        number: usize,
        piece: &'a PieceIndex,
    ) -> impl Iterator<Item = Result<(Cluster, ClusterIndex)>> + 'a {
        let first = self.numbering.first(number);
        piece.clusters.iter().scan(first, move |next, cluster| {
            Some(self.numbering.placed(cluster, first, next).and_then(|placed| self.cluster(cluster, placed)))
        })
    }

    fn cluster(&self, piece: &PieceCluster, (mut cluster, roots, ends): Placed) -> Result<(Cluster, ClusterIndex)> {
        let level_count = self.levels.levels.len();
        let mut index = ClusterIndex::new(roots, ends, &piece.new_samples, level_count);
        index.find_streams()?;
        for level in 0..level_count as u8 {
            let (triangle_count, max_error) = index.summary(level, &self.lattice)?;
            cluster.levels.push(ClusterLevel { triangle_count, max_error, ..ClusterLevel::default() });
        }
        Ok((cluster, index))
    }

    /// All that has been counted.
    fn tables(&self, overview: Option<&OverviewRecord>) -> Tables {
        let mut all = self.all.clone();
        overview.into_iter().for_each(|overview| all.add(&Tally::of([overview.symbols.iter()])));
        Tables::of(&all)
    }

    /// About how many bytes a file without an overview has up to the end of the coarsest level: a few percent up or down.
    pub fn first_picture_bytes(&self) -> u64 {
        // Counts, box, lengths, checksum and the states of two streams; lengths, triangles and error of a level; length and checksum
        // of a stream.
        const CLUSTER_BYTES: u64 = 42;
        const CLUSTER_LEVEL_BYTES: u64 = 9;
        const STREAM_BYTES: u64 = 6;
        let tables = self.tables(None);
        let levels = self.levels.levels.len() as u64;
        let head = HEADER_BYTES as u64 + 6 * ENTRY_BYTES as u64 + 40 + 48 * levels + tables.write().len() as u64;
        let bytes = |tally: &Tally| tally.bytes(&tables);
        let arcs: u64 = self.arcs.iter().take(self.index_arc_levels(&tables).into()).map(bytes).sum();
        let clusters =
            self.cluster_count * (CLUSTER_BYTES + levels * CLUSTER_LEVEL_BYTES) + self.stream_count * STREAM_BYTES;
        head + clusters + bytes(&self.records) + bytes(&self.corners) + arcs + bytes(&self.coarsest)
    }

    /// How many levels' samples go into the index blocks: as many as take, with the corners, at most [`ARCS_PER_RECORD`] times the
    /// bytes of the records. Coarse samples are few and needed by whoever needs finer ones; in pages of their own they would cost
    /// a request or two a level.
    fn index_arc_levels(&self, tables: &Tables) -> u8 {
        let bytes = |tally: &Tally| tally.bytes(tables);
        let (room, mut taken) = (ARCS_PER_RECORD * bytes(&self.records), bytes(&self.corners));
        let mut levels = 0;
        for arcs in &self.arcs {
            taken += bytes(arcs);
            if levels >= 1 && taken > room {
                break;
            }
            levels += 1;
        }
        levels.max(1)
    }

    /// Ends the first pass.
    pub fn seal(mut self, overview: Option<OverviewRecord>) -> Encoder {
        let tables = self.tables(overview.as_ref());
        self.levels.index_arc_levels = self.index_arc_levels(&tables);
        Encoder::new(self, tables, overview)
    }
}
