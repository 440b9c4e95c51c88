//! Blocks of one level, two at a time.
//!
//! A thread decodes blocks of [`LANES`] different streams in turn, since a filling may have to wait for its own
//! results: see
//! [`BlockDecoder`]. Which filling a block has is looked up in the table of fillings.

use std::ops::Range;

use super::{Decoded, check_patch};
use crate::index::needs::{PartKey, StreamPrefix};
use crate::{
    codec::{
        entropy::Decoder,
        filling::{BlockDecoder, BlockTask, Filling, LANES, LaneSymbols},
    },
    error::{Error, Result},
    limits::within,
    sorted::{SortedMap, SortedSet},
};

/// What goes from block to block: a decoder for each filling.
pub(super) struct Scratch {
    decoders: Vec<Box<dyn BlockDecoder>>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self { decoders: Filling::all().map(|filling| (filling.descriptor().decoder)()).collect() }
    }
}

impl Scratch {
    /// Forgets all roots: no block of theirs comes any more.
    pub(super) fn forget_roots(&mut self) {
        self.decoders.iter_mut().for_each(|decoder| decoder.forget_roots());
    }

    fn decoder(&mut self, filling: Filling) -> &mut dyn BlockDecoder {
        self.decoders[filling as usize].as_mut()
    }
}

/// Blocks of one level and cluster on their way to patches.
pub(super) struct Blocks<'d, 'i> {
    pub(super) level: u8,
    pub(super) decoded: &'d mut Decoded<'i>,
    pub(super) parts: &'d SortedMap<PartKey, &'d [u8]>,
    /// Root and level.
    pub(super) wanted: &'d SortedSet<(u32, u8)>,
    pub(super) scratch: &'d mut Scratch,
}

/// What is decoded in turn with another one: a run of blocks of one stream.
#[derive(Default)]
struct Lane<'d> {
    reading: Option<Reading<'d>>,
    /// The block that has been begun.
    block: Option<Block>,
}

struct Reading<'d> {
    key: PartKey,
    cluster: u32,
    symbols: Decoder<'d>,
    /// Roots whose blocks are still to be decoded, counted from the cluster's first.
    roots: Range<u32>,
    /// Whether these are all that the stream has.
    is_whole: bool,
}

struct Block {
    root: u32,
    filling: Filling,
    border_count: usize,
    triangle_count: u32,
}

impl<'d, 'i: 'd> Blocks<'d, 'i> {
    /// Decodes runs of blocks.
    pub(super) fn decode(mut self, runs: &[StreamPrefix]) -> Result<()> {
        let mut runs = runs.iter();
        let mut lanes: [Lane<'d>; LANES] = Default::default();
        loop {
            for (number, lane) in lanes.iter_mut().enumerate() {
                while lane.block.is_none() {
                    if lane.reading.is_none() {
                        let Some(run) = runs.next() else { break };
                        lane.reading = Some(self.open(run)?);
                    }
                    self.begin_block(number, lane)?;
                }
            }
            let Some(number) = self.advance(&mut lanes)? else { return Ok(()) };
            let lane = &mut lanes[number];
            let (Some(block), Some(Reading { key, .. })) = (lane.block.take(), &lane.reading) else { continue };
            self.keep(number, &block).map_err(|error| error.at(|| key.location()))?;
        }
    }

    fn open(&self, run: &StreamPrefix) -> Result<Reading<'d>> {
        let key = PartKey::Blocks { level: self.level, cluster: run.cluster, stream: run.stream };
        let file = self.decoded.index;
        let roots = file.cluster_index(run.cluster)?.streams[run.stream].roots.clone();
        let part = self.parts.get(&key).copied().unwrap_or(&[]);
        let symbols = Decoder::new(file.tables(), part).map_err(|error| error.at(|| key.location()))?;
        let (roots, is_whole) = (roots.start..run.last + 1, run.last + 1 == roots.end);
        Ok(Reading { key, cluster: run.cluster, symbols, roots, is_whole })
    }

    /// Begins the next block of a lane's stream, or ends the stream.
    fn begin_block(&mut self, number: usize, lane: &mut Lane<'d>) -> Result<()> {
        let Some(reading) = &mut lane.reading else { return Ok(()) };
        let key = reading.key;
        match reading.roots.next() {
            Some(local) => {
                lane.block = self.block(number, reading, local).map_err(|error| error.at(|| key.location()))?
            }
            None => {
                let Some(Reading { symbols, is_whole: true, .. }) = lane.reading.take() else { return Ok(()) };
                symbols.finish().map_err(|error| error.at(|| key.location()))?;
            }
        }
        Ok(())
    }

    /// Begins the block of a root, if it has one at this level; returns it where it does not end at once.
    fn block(&mut self, number: usize, reading: &mut Reading<'_>, local: u32) -> Result<Option<Block>> {
        let (level, cluster, file) = (self.level, reading.cluster, self.decoded.index);
        let entry = &file.cluster_index(cluster)?.roots[local as usize];
        let Some(block) = entry.blocks.iter().find(|block| block.level == level) else { return Ok(None) };
        let (root, filling, triangle_count) =
            (file.cluster(cluster)?.first_root + local, entry.filling, block.triangle_count);
        let border = self.decoded.root_border(entry, level)?;
        let (border_count, vertex_limit) = (border.vertex_count(), file.limits().root_vertex_count);
        within(vertex_limit, border_count as u64, "number of border vertices of a root")?;
        let task = BlockTask {
            root,
            border: &border,
            quantisation: file.levels().quantisation(filling, level),
            triangle_count,
            vertex_limit,
            is_wanted: self.wanted.contains(&(root, level)),
        };
        let block = Block { root, filling, border_count, triangle_count };
        if self.scratch.decoder(filling).begin(number, &task, &mut reading.symbols)? {
            return Ok(Some(block));
        }
        self.keep(number, &block)?;
        Ok(None)
    }

    /// Continues blocks of one filling until one of them ends, and returns its lane; nothing where there are none.
    fn advance(&mut self, lanes: &mut [Lane<'_>; LANES]) -> Result<Option<usize>> {
        let Some(filling) = lanes.iter().find_map(|lane| Some(lane.block.as_ref()?.filling)) else { return Ok(None) };
        let busy = lanes.iter_mut().enumerate();
        let busy = busy.filter(|(_, lane)| lane.block.as_ref().is_some_and(|block| block.filling == filling));
        let busy = busy.filter_map(|(lane, Lane { reading, .. })| {
            Some(LaneSymbols { lane, symbols: &mut reading.as_mut()?.symbols })
        });
        let mut busy: Vec<_> = busy.collect();
        let result = self.scratch.decoder(filling).advance(&mut busy);
        drop(busy);
        let number = result.map_err(|(number, violation)| {
            let location = || lanes[number].reading.as_ref().map(|reading| reading.key.location()).unwrap_or_default();
            Error::from(violation).at(location)
        })?;
        Ok(Some(number))
    }

    /// Keeps the patch of the block that ended in a lane, if it is wanted.
    fn keep(&mut self, number: usize, block: &Block) -> Result<()> {
        let &Block { root, filling, border_count, triangle_count } = block;
        let Some(patch) = self.scratch.decoder(filling).take_patch(number) else { return Ok(()) };
        check_patch(&patch, border_count, triangle_count)?;
        if self.wanted.contains(&(root, self.level)) {
            self.decoded.patches.insert((root, self.level), patch);
        }
        Ok(())
    }
}
