//! What a filling is given to decode a block, and what it must do with it.

use super::Quantisation;
use crate::{
    codec::{
        arc::HalfPath,
        entropy::Decoder,
        patch::{LatticePoint, Patch},
    },
    error::{Error, Result, Violation},
};

/// How many blocks a thread decodes in turn.
pub(crate) const LANES: usize = 2;

/// A block to be decoded.
#[derive(Debug)]
pub(crate) struct BlockTask<'a> {
    /// The root, under whose number nested fillings keep their state.
    pub root: u32,
    /// The root's border at the block's level.
    pub border: &'a RootBorder<'a>,
    /// The filling's steps at this level.
    pub quantisation: Quantisation,
    /// The number of triangles that the index gives.
    pub triangle_count: u32,
    /// The most vertices that the caller accepts, those of the border included.
    pub vertex_limit: u64,
    /// Whether the patch is wanted. A block of a nested filling may be decoded only because a finer one needs it.
    pub is_wanted: bool,
}

/// The symbols of a block that a lane has begun.
pub(crate) struct LaneSymbols<'s, 'd> {
    /// Which lane.
    pub lane: usize,
    /// Its stream.
    pub symbols: &'s mut Decoder<'d>,
}

/// Decodes the blocks of one filling.
///
/// A thread decodes up to [`LANES`] blocks of different streams in turn: while one waits for a result, another
/// continues. A filling that gains nothing by that decodes a block in [`BlockDecoder::begin`].
pub(crate) trait BlockDecoder {
    /// Begins a block in a lane and returns whether there is more to come. Blocks of one root come from coarse to fine.
    ///
    /// # Errors
    /// If the symbols break a rule of the filling, or exceed a limit.
    fn begin(&mut self, lane: usize, task: &BlockTask<'_>, symbols: &mut Decoder<'_>) -> Result<bool>;

    /// Continues the blocks of these lanes in turn until one of them ends, and returns its lane.
    ///
    /// # Errors
    /// The lane where a rule is broken, and which rule.
    fn advance(&mut self, lanes: &mut [LaneSymbols<'_, '_>]) -> Result<usize, (usize, Violation)> {
        // Nothing is left to do after `begin`.
        Ok(lanes.first().map_or(0, |first| first.lane))
    }

    /// Takes the patch of the block that ended in a lane, if it was made: nested fillings leave out those that are not
    /// wanted.
    fn take_patch(&mut self, lane: usize) -> Option<Patch>;

    /// Forgets what was kept for finer blocks: no root comes again.
    fn forget_roots(&mut self) {}
}

/// The border of a root at a level.
#[derive(Debug)]
pub(crate) struct RootBorder<'a> {
    /// The half-arcs of each loop.
    pub loops: Vec<Vec<HalfPath<'a>>>,
    /// Samples of finer levels are left out.
    pub level: u8,
}

impl RootBorder<'_> {
    /// The number of border vertices.
    pub(crate) fn vertex_count(&self) -> usize {
        self.loops.iter().flatten().map(|half_arc| half_arc.vertex_count(self.level)).sum()
    }

    /// The positions of the border vertices, loop after loop.
    pub(crate) fn positions(&self) -> Vec<Vec<LatticePoint>> {
        let of_loop = |half_arcs: &Vec<HalfPath<'_>>| {
            let count = half_arcs.iter().map(|half_arc| half_arc.vertex_count(self.level)).sum();
            let mut positions = Vec::with_capacity(count);
            half_arcs.iter().for_each(|half_arc| half_arc.walk(self.level, |_, position| positions.push(position)));
            positions
        };
        self.loops.iter().map(of_loop).collect()
    }

    /// For a disk, the parameters and positions of the border vertices of each side.
    ///
    /// # Errors
    /// [`Error::Format`] if there is not exactly one loop.
    pub(crate) fn sides(&self) -> Result<Vec<Vec<(u32, LatticePoint)>>> {
        let [half_arcs] = self.loops.as_slice() else {
            return Err(Error::format("a root that must be a disk does not have exactly one loop"));
        };
        let side = |half_arc: &HalfPath<'_>| {
            let mut side = Vec::with_capacity(half_arc.vertex_count(self.level));
            half_arc.walk(self.level, |param, position| side.push((param, position)));
            side
        };
        Ok(half_arcs.iter().map(side).collect())
    }
}
