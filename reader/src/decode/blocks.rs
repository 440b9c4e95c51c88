//! Blocks of one level, two at a time.
//!
//! Each triangle of an irregular block waits for the one before it: the next gate and its statistics follow from where the last
//! vertex came to lie. So a thread decodes two blocks of different streams in turn, a triangle each; while one waits, the
//! other goes on.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
};

use super::{Decoded, check_patch};
use crate::index::needs::{PartKey, Run};
use crate::{
    codec::{
        entropy::Decoder,
        filling::{
            grid::{self, GridState},
            irregular::{PatchDecoder, PatchLimits},
        },
        patch::Patch,
    },
    error::{Error, Result},
    format::records::Filling,
    limits::within,
};

/// How many blocks are decoded in turn.
const LANES: usize = 2;

/// What goes from block to block.
#[derive(Default)]
pub(super) struct Scratch {
    /// Grids so far, by root.
    pub(super) grids: BTreeMap<u32, GridState>,
    /// Their memory.
    decoders: [PatchDecoder; LANES],
}

/// Blocks of one level and cluster on their way to patches.
pub(super) struct Blocks<'d, 'i> {
    pub(super) level: u8,
    pub(super) decoded: &'d mut Decoded<'i>,
    pub(super) parts: &'d BTreeMap<PartKey, &'d [u8]>,
    /// Root and level.
    pub(super) wanted: &'d BTreeSet<(u32, u8)>,
    pub(super) scratch: &'d mut Scratch,
}

/// What is decoded in turn with another one: a run of blocks of one stream.
#[derive(Default)]
struct Lane<'d> {
    reading: Option<Reading<'d>>,
    /// An irregular block that is being decoded.
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
    border_count: usize,
    triangle_count: u32,
}

impl<'d, 'i: 'd> Blocks<'d, 'i> {
    /// Decodes runs of blocks.
    pub(super) fn decode(mut self, runs: &[Run]) -> Result<()> {
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
            self.end_block(number, &mut lanes[number])?;
        }
    }

    fn open(&self, run: &Run) -> Result<Reading<'d>> {
        let key = PartKey::Blocks { level: self.level, cluster: run.cluster, stream: run.stream };
        let file = self.decoded.index;
        let roots = file.cluster_index(run.cluster)?.streams[run.stream].roots.clone();
        let part = self.parts.get(&key).copied().unwrap_or(&[]);
        let symbols = Decoder::new(file.tables(), part).map_err(|error| error.at(|| key.place()))?;
        let (roots, is_whole) = (roots.start..run.last + 1, run.last + 1 == roots.end);
        Ok(Reading { key, cluster: run.cluster, symbols, roots, is_whole })
    }

    /// Begins the next block of a lane's stream, decodes it if it is a grid's, or ends the stream.
    fn begin_block(&mut self, number: usize, lane: &mut Lane<'d>) -> Result<()> {
        let Some(reading) = &mut lane.reading else { return Ok(()) };
        let key = reading.key;
        match reading.roots.next() {
            Some(local) => lane.block = self.block(number, reading, local).map_err(|error| error.at(|| key.place()))?,
            None => {
                let Some(Reading { symbols, is_whole: true, .. }) = lane.reading.take() else { return Ok(()) };
                symbols.finish().map_err(|error| error.at(|| key.place()))?;
            }
        }
        Ok(())
    }

    fn block(&mut self, number: usize, reading: &mut Reading<'_>, local: u32) -> Result<Option<Block>> {
        let (level, cluster, file) = (self.level, reading.cluster, self.decoded.index);
        let entry = &file.cluster_index(cluster)?.roots[local as usize];
        let Some(block) = entry.blocks.iter().find(|block| block.level == level) else { return Ok(None) };
        let (root, triangle_count) = (file.cluster(cluster)?.first_root + local, block.triangle_count);
        let vertex_limit = file.limits().root_vertex_count;
        let check = |border_count| within(vertex_limit, border_count as u64, "number of border vertices of a root");
        match entry.filling {
            Filling::Irregular => {
                let loops = self.decoded.border_positions(entry, level)?;
                let border_count = loops.iter().map(Vec::len).sum();
                check(border_count)?;
                let limits = PatchLimits { vertices: vertex_limit, triangles: u64::from(triangle_count) };
                let quantisation = file.levels().levels[usize::from(level)].quantisation;
                self.scratch.decoders[number].begin(&mut reading.symbols, &loops, quantisation, limits)?;
                Ok(Some(Block { root, border_count, triangle_count }))
            }
            Filling::Grid => {
                let sides = self.decoded.grid_sides(entry, level)?;
                let border_count = sides.sides.iter().map(Vec::len).sum();
                check(border_count)?;
                let quantisation = file.levels().grid_quantisation;
                let limits = grid::GridLimits { vertex_count: vertex_limit };
                let coarser = self.scratch.grids.remove(&root);
                let state = grid::decode_level(&mut reading.symbols, coarser, &sides, quantisation, limits)?;
                if self.wanted.contains(&(root, level)) {
                    self.keep(&Block { root, border_count, triangle_count }, state.patch(&sides)?)?;
                }
                self.scratch.grids.insert(root, state);
                Ok(None)
            }
        }
    }

    /// Decodes until a block ends, and returns its lane; nothing where there is none.
    fn advance(&mut self, lanes: &mut [Lane<'_>; LANES]) -> Result<Option<usize>> {
        let busy = lanes.iter_mut().zip(&mut self.scratch.decoders).enumerate();
        let busy = busy.filter(|(_, (lane, _))| lane.block.is_some());
        let mut busy: Vec<_> =
            busy.filter_map(|(n, (lane, decoder))| Some((n, lane.reading.as_mut()?, decoder))).collect();
        while !busy.is_empty() {
            for (number, Reading { key, symbols, .. }, decoder) in &mut busy {
                if !decoder.advance(symbols).map_err(|violation| Error::from(violation).at(|| key.place()))? {
                    return Ok(Some(*number));
                }
            }
        }
        Ok(None)
    }

    fn end_block(&mut self, number: usize, lane: &mut Lane<'_>) -> Result<()> {
        let Some(block) = lane.block.take() else { return Ok(()) };
        let patch = self.scratch.decoders[number].take_patch();
        let result = self.keep(&block, patch);
        let place = || lane.reading.as_ref().map(|reading| reading.key.place()).unwrap_or_default();
        result.map_err(|error| error.at(place))
    }

    fn keep(&mut self, &Block { root, border_count, triangle_count }: &Block, patch: Patch) -> Result<()> {
        check_patch(&patch, border_count, triangle_count)?;
        if self.wanted.contains(&(root, self.level)) {
            self.decoded.patches.insert((root, self.level), patch);
        }
        Ok(())
    }
}
