//! The first pass over the pieces of a file: it lists and orders their content, and counts symbols for the tables.

use super::{
    arrangement::Arrangement,
    catalogue::Catalogue,
    check::{check_channels, tolerance_codes},
    encoder::Encoder,
    piece::PieceIndex,
};
use crate::{
    codec::{
        arc::encode_corner,
        entropy::{SymbolBuffer, Tables, Tally},
        filling::Filling,
    },
    error::{Error, Result},
    format::{
        channels::{ChannelInfo, Channels},
        error_code::ErrorCode,
        header::{ENTRY_BYTES, HEADER_BYTES},
        levels::{FillingSteps, LevelRecord, Levels},
        placement::Placement,
        records::SourceInfo,
    },
    lattice::{Lattice, LatticePoint},
    write::model::{LevelInfo, Model, OverviewRecord},
};

/// Arcs in index blocks may take this many times the bytes of the records.
const ARCS_PER_RECORD: u64 = 3;

/// An arc run ends with the arc that brings its samples in pages to this number: about 0.9 kB over all levels. A region
/// at its borders needs few arcs of many clusters; smaller runs would lie farther apart, so that more requests would be
/// needed.
const ARC_RUN_SAMPLES: u16 = 1024;

/// A file that is put together from pieces, which may be made anywhere and at any time. All roots determine the order
/// of the file, so that neighbours in space are near each other in it. Only the symbols of one piece, or of some
/// clusters, are in memory. So a file can be larger than memory:
///
/// ```text
/// Assembly::new, count(index of each piece), perhaps count_above, arrange, seal    ->  Encoder
/// Output::new, perhaps with_nodes, take(each piece)           symbols wait, by cluster
/// Output::symbols(each cluster)                               ->  ClusterSymbols
/// Encoder::encode(each of these), side by side                ->  EncodedCluster
/// Output::add(each of these), finish                          ->  the file
/// ```
#[derive(Clone, Debug)]
pub struct Assembly {
    head: FileHead,
    pub(super) catalogue: Catalogue,
    /// Tallies of all symbols, and of those that decide where arcs are stored.
    pub(super) all: Tally,
    pub(super) arcs: Vec<Tally>,
    pub(super) coarsest: Tally,
}

/// The parts of a file that do not come with pieces.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct FileHead {
    pub lattice: Lattice,
    pub source: SourceInfo,
    pub placement: Option<Placement>,
    pub tolerances: Vec<ErrorCode>,
    pub levels: Levels,
    pub channels: Vec<ChannelInfo>,
}

impl Assembly {
    /// A file without pieces yet. Uses only what the model says about the whole file: lattice, steps, levels, source
    /// and channels.
    ///
    /// # Errors
    /// [`crate::Error::Model`] if levels or channels break a rule.
    pub fn new(head: &Model) -> Result<Self> {
        let record = |info: &LevelInfo| LevelRecord { tolerance: info.tolerance, ..LevelRecord::default() };
        let steps =
            |filling| FillingSteps { filling, levels: head.levels.iter().map(|level| level.steps[filling]).collect() };
        let levels = Levels {
            arc_tangent_shift: head.arc_tangent_shift,
            index_arc_levels: 1,
            arc_run_samples: ARC_RUN_SAMPLES,
            levels: head.levels.iter().map(record).collect(),
            fillings: Filling::all().map(steps).collect(),
        };
        let tolerances = tolerance_codes(head)?;
        check_channels(&head.channels)?;
        let (lattice, source, channels) = (head.lattice, head.source.clone(), head.channels.clone());
        Ok(Self {
            head: FileHead { lattice, source, placement: head.placement.clone(), tolerances, levels, channels },
            catalogue: Catalogue::default(),
            all: Tally::default(),
            arcs: vec![Tally::default(); head.levels.len()],
            coarsest: Tally::default(),
        })
    }

    /// Counts the next piece. Pieces that share something come in the order that [`super::Share::is_first`] refers to.
    ///
    /// # Errors
    /// [`crate::Error::Model`] if the piece does not fit those before.
    pub fn count(&mut self, piece: &PieceIndex) -> Result<()> {
        self.check(piece)?;
        self.catalogue.add(piece)?;
        self.tally(piece);
        Ok(())
    }

    /// Checks that a piece is sound and of this file.
    pub(super) fn check(&self, piece: &PieceIndex) -> Result<()> {
        piece.check(self.head.levels.levels.len())?;
        if piece.channels == self.head.channels {
            Ok(())
        } else {
            Err(Error::model("a piece does not have the channels of its file"))
        }
    }

    /// Orders all pieces that have been counted.
    ///
    /// # Errors
    /// [`crate::Error::Model`] if the pieces do not make up a whole.
    pub fn arrange(mut self) -> Result<Arranged> {
        let roots = &self.catalogue.roots;
        self.head.levels.fillings.retain(|steps| roots.iter().any(|root| root.filling == steps.filling));
        let arrangement = Arrangement::new(self.catalogue, self.head.levels.levels.len())?;
        let (mut records, mut corners, mut stream_count) = (Tally::default(), Tally::default(), 0);
        for number in 0..arrangement.clusters.len() {
            let (cluster, index, corners_of_cluster) = arrangement.content(number)?.index(&self.head.lattice)?;
            stream_count += index.streams.len() as u64;
            records
                .add(&Tally::of([index.records(&cluster, &self.head.levels.fillings, &self.head.tolerances)?.iter()]));
            let symbols = corner_symbols(corners_of_cluster, cluster.bounds[0]);
            corners.add(&Tally::of([symbols.iter()]));
        }
        [&records, &corners].into_iter().for_each(|tally| self.all.add(tally));
        let Self { head, all, arcs, coarsest, .. } = self;
        Ok(Arranged { head, arrangement, all, records, corners, arcs, coarsest, stream_count })
    }
}

/// The corners of a cluster as symbols; `before` is the low end of its box.
pub(super) fn corner_symbols(corners: Vec<LatticePoint>, mut before: LatticePoint) -> SymbolBuffer {
    let mut symbols = SymbolBuffer::default();
    for position in corners {
        encode_corner(position, before, &mut symbols);
        before = position;
    }
    symbols
}

/// A file whose order is known.
#[derive(Clone, Debug)]
pub struct Arranged {
    head: FileHead,
    arrangement: Arrangement,
    all: Tally,
    records: Tally,
    corners: Tally,
    arcs: Vec<Tally>,
    coarsest: Tally,
    stream_count: u64,
}

impl Arranged {
    /// Tables for all symbols that have been counted.
    fn tables(&self, overview: Option<&OverviewRecord>) -> Tables {
        let mut all = self.all.clone();
        overview.into_iter().for_each(|overview| all.add(&Tally::of([overview.symbols.iter()])));
        Tables::of(&all)
    }

    /// An estimate, within a few percent, of the bytes up to the end of the coarsest level in a file without an
    /// overview. Texels do not count: a picture without them reads none.
    pub fn first_picture_bytes(&self) -> u64 {
        // Counts, box, lengths, checksum and the states of two streams; lengths, triangles and error of a level; length
        // and checksum of a stream.
        const CLUSTER_BYTES: u64 = 42;
        const CLUSTER_LEVEL_BYTES: u64 = 9;
        const STREAM_BYTES: u64 = 6;
        let tables = self.tables(None);
        let levels = self.head.levels.levels.len() as u64;
        let sections = self.head.levels.write().len() + tables.write().len();
        let channels = match &self.head.channels[..] {
            [] => 0,
            channels => {
                let section = Channels { channels: channels.to_vec(), stream_bytes: vec![0; 1 + channels.len()] };
                let scales = section.write_scales().map_or(0, |scales| ENTRY_BYTES + scales.len());
                2 * ENTRY_BYTES + section.write().len() + scales
            }
        };
        let head = (HEADER_BYTES + 6 * ENTRY_BYTES + 40 + sections + channels) as u64;
        let bytes = |tally: &Tally| tally.bytes(&tables);
        let arcs: u64 = self.arcs.iter().take(self.index_arc_levels(&tables).into()).map(bytes).sum();
        let cluster_count = self.arrangement.clusters.len() as u64;
        let clusters =
            cluster_count * (CLUSTER_BYTES + levels * CLUSTER_LEVEL_BYTES) + self.stream_count * STREAM_BYTES;
        head + clusters + bytes(&self.records) + bytes(&self.corners) + arcs + bytes(&self.coarsest)
    }

    /// The number of levels whose samples go into the index blocks: with the corners, they take at most
    /// [`ARCS_PER_RECORD`] times the bytes of the records. Coarse samples are few, and every reader of finer ones needs
    /// them; in pages of their own they would cost a request or two per level.
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

    /// Ends the first pass, and makes the encoder for the second.
    pub fn seal(mut self, overview: Option<OverviewRecord>) -> Encoder {
        let tables = self.tables(overview.as_ref());
        self.head.levels.index_arc_levels = self.index_arc_levels(&tables);
        Encoder::new(self.head, self.arrangement, tables, overview)
    }
}
