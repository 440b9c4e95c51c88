//! Clusters that other processes encode: what each of them needs for its share, and what is left for the one that puts
//! the file together.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{
    arrangement::{Arrangement, ClusterContent},
    assembly::FileHead,
    catalogue::first_blocks,
    encoder::{EncodedCluster, Encoder, encode_cluster},
    model::OverviewRecord,
    piece::Piece,
    sorting::ClusterSymbols,
};
use crate::{
    codec::entropy::Tables,
    error::{Error, Result},
    format::{channels::stream_count, clusters::Cluster},
};

/// Some clusters of a file, with all that is needed to encode them but their symbols. It has about half a kilobyte for
/// each of their roots, however large the file is:
///
/// ```text
/// Encoder::share(clusters)                 ->  EncoderShare, for another process
/// EncoderShare::pieces, take(each of these), encode  ->  EncodedCluster for each, for Output::add
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EncoderShare {
    head: FileHead,
    /// The section TABLES.
    tables: Vec<u8>,
    clusters: Vec<Planned>,
    /// The symbols that have been taken, by cluster.
    #[serde(skip)]
    symbols: Vec<ClusterSymbols>,
    /// The pieces that have been taken.
    #[serde(skip)]
    taken: BTreeSet<u32>,
}

/// A cluster and where its symbols are.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Planned {
    content: ClusterContent,
    /// For each root its piece and its number in it.
    roots: Vec<[u32; 2]>,
    /// For each arc.
    arcs: Vec<[u32; 2]>,
}

/// What a file has beside its clusters, once its order is known. [`Self::encoder`] adds clusters that were encoded
/// elsewhere to an
/// [`super::Output`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EncoderHead {
    head: FileHead,
    tables: Vec<u8>,
    overview: Option<OverviewRecord>,
    /// Of each cluster.
    first_roots: Vec<u32>,
}

impl Encoder {
    /// The pieces from which the roots of a cluster come, ascending, and how many come from each. Coarse groups come
    /// first in a file, so clusters that follow each other may need all pieces; those of one piece need that one and a
    /// few around it.
    ///
    /// # Errors
    /// [`Error::Model`] if there is no such cluster.
    pub fn pieces_of(&self, cluster: usize) -> Result<BTreeMap<u32, usize>> {
        let Arrangement { catalogue, clusters, .. } = &self.arrangement;
        let cluster = clusters.get(cluster).ok_or_else(|| Error::model("there is no such cluster"))?;
        let mut counts = BTreeMap::new();
        for &root in self.arrangement.roots_of(cluster) {
            *counts.entry(catalogue.place_of_root(root)[0]).or_default() += 1;
        }
        Ok(counts)
    }

    /// What another process needs to encode some clusters.
    ///
    /// # Errors
    /// [`Error::Model`] if there are no such clusters.
    pub fn share(&self, clusters: &[usize]) -> Result<EncoderShare> {
        let planned = |&number: &usize| {
            let Arrangement { catalogue, .. } = &self.arrangement;
            let content = self.arrangement.content(number)?;
            let root = |&root: &u32| catalogue.place_of_root(root);
            let arc = |&arc: &u32| catalogue.place_of_arc(arc);
            let roots = self.arrangement.roots_of(&content.cluster).iter().map(root).collect();
            let arcs = self.arrangement.arcs_of(&content.cluster).iter().map(arc).collect();
            Ok(Planned { content, roots, arcs })
        };
        let clusters = clusters.iter().map(planned).collect::<Result<_>>()?;
        let (head, tables) = (self.head.clone(), self.tables.write());
        Ok(EncoderShare { head, tables, clusters, symbols: Vec::new(), taken: BTreeSet::new() })
    }

    /// What is needed to put the file together from its clusters.
    pub fn head(&self) -> EncoderHead {
        EncoderHead {
            head: self.head.clone(),
            tables: self.tables.write(),
            overview: self.overview.clone(),
            first_roots: self.arrangement.clusters.iter().map(|cluster| cluster.first_root).collect(),
        }
    }
}

impl EncoderHead {
    /// The number of clusters.
    pub fn cluster_count(&self) -> usize {
        self.first_roots.len()
    }

    /// The encoder of a file whose clusters are all encoded elsewhere.
    ///
    /// # Errors
    /// [`Error::Format`] if its tables are damaged.
    pub fn encoder(self) -> Result<Encoder> {
        let Self { head, tables, overview, first_roots } = self;
        let clusters = first_roots.into_iter().map(|first_root| Cluster { first_root, ..Cluster::default() });
        let level_count = head.levels.levels.len();
        let arrangement = Arrangement { clusters: clusters.collect(), level_count, ..Arrangement::default() };
        Ok(Encoder::new(head, arrangement, Tables::parse(&tables)?, overview))
    }
}

impl EncoderShare {
    /// The numbers of the pieces that have symbols of these clusters, ascending.
    pub fn pieces(&self) -> Vec<u32> {
        let places = self.clusters.iter().flat_map(|cluster| cluster.roots.iter().chain(&cluster.arcs));
        let mut pieces: Vec<u32> = places.map(|&[piece, _]| piece).collect();
        pieces.sort_unstable();
        pieces.dedup();
        pieces
    }

    /// Takes the symbols of a piece; `number` is its position in counting order, from 0.
    ///
    /// # Errors
    /// [`Error::Model`] if it is not the piece that was counted.
    pub fn take(&mut self, number: u32, piece: &Piece) -> Result<()> {
        let (level_count, stream_count) = (self.head.levels.levels.len(), stream_count(&self.head.channels));
        piece.check_symbols(level_count, stream_count)?;
        let own_blocks = piece.first_blocks();
        self.symbols.resize_with(self.clusters.len(), ClusterSymbols::default);
        for (Planned { content, roots, arcs }, symbols) in self.clusters.iter().zip(&mut self.symbols) {
            let own = |places: &[[u32; 2]]| {
                let places = places.iter().enumerate().filter(|(_, [piece, _])| *piece == number);
                places.map(|(place, &[_, own])| (place, own as usize)).collect::<Vec<_>>()
            };
            let places = first_blocks(&content.entries);
            let block_count: usize = content.entries.iter().map(|root| root.blocks.len()).sum();
            symbols.make_room(block_count, arcs.len() * level_count, block_count * stream_count);
            for (root, own) in own(roots) {
                let blocks = content.entries[root].blocks.len();
                let first = own_blocks.get(own..own + 2).filter(|ends| ends[1] - ends[0] == blocks);
                let first = first.ok_or_else(|| Error::model("a piece is not the one that was counted"))?[0];
                for block in 0..blocks {
                    symbols.put_block(places[root] + block, piece, first + block, stream_count);
                }
            }
            for (arc, own) in own(arcs) {
                if own >= piece.index.arc_ends.len() {
                    return Err(Error::model("a piece is not the one that was counted"));
                }
                (0..level_count).for_each(|level| {
                    symbols.put_arc(arc * level_count + level, piece, own * level_count + level);
                });
            }
        }
        self.taken.insert(number);
        Ok(())
    }

    /// Encodes the clusters one after the other, once all pieces have been taken.
    ///
    /// # Errors
    /// [`Error::Model`] if a piece is missing, [`Error::Format`] if the tables are damaged.
    pub fn encode(self) -> Result<impl Iterator<Item = Result<EncodedCluster>>> {
        let codes = Tables::parse(&self.tables)?.codes();
        if !self.pieces().iter().all(|piece| self.taken.contains(piece)) {
            return Err(Error::model("a piece is missing"));
        }
        let clusters = self.clusters.into_iter().zip(self.symbols);
        Ok(clusters.map(move |(planned, symbols)| encode_cluster(&self.head, &codes, planned.content, &symbols)))
    }
}
