//! Pieces: parts of a model as symbols, whose order and position in the file are not known yet.

use std::collections::BTreeMap;

use super::check;
use crate::{
    codec::{
        arc::{PARAM_END, Path},
        entropy::{Mark, SymbolBuffer, Symbols, Tally},
    },
    error::{Error, Result},
    format::{
        channels::{ChannelInfo, stream_count},
        clusters::MAX_BOX,
        error_code::ErrorCode,
        index_block::{BlockEntry, RootEntry},
    },
    lattice::LatticePoint,
    write::{
        model::{Model, RootRecord},
        owners,
        texels::TexelRuns,
    },
};

/// A corner or an arc that several pieces of a file share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Its shared number, below 2^31.
    pub number: u32,
    /// Whether this piece is the first that has it.
    pub is_first: bool,
}

/// The corners and arcs of a model that it shares with other pieces of the same file. Empty lists mean none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shares {
    /// For each corner of the model.
    pub corners: Vec<Option<Share>>,
    /// For each arc of the model.
    pub arcs: Vec<Option<Share>>,
}

/// No root: the parent of a top.
pub(super) const NO_ROOT: u32 = u32::MAX;

/// A piece's reference to an arc or corner: 2 n for number n of the piece itself, 2 n + 1 for shared number n, which an
/// earlier piece has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LocalRef(pub u32);

impl LocalRef {
    /// The number within the piece.
    pub fn own(self) -> Option<u32> {
        (self.0.is_multiple_of(2)).then_some(self.0 / 2)
    }

    /// The shared number.
    pub fn shared(self) -> Option<u32> {
        (!self.0.is_multiple_of(2)).then_some(self.0 / 2)
    }

    /// A reference to a shared number.
    pub fn of_shared(number: u32) -> Self {
        Self(number << 1 | 1)
    }
}

/// A part of a model on its way into a file: see [`crate::write::Assembly`].
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Piece {
    /// Its roots, arcs and corners.
    pub index: PieceIndex,
    /// Their symbols.
    pub symbols: PieceSymbols,
}

/// The roots, arcs and corners of a piece, in the order of its model, without arcs and corners that an earlier piece
/// has.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PieceIndex {
    /// No block begins a stream yet.
    pub(super) roots: Vec<RootEntry>,
    /// Centre of each root's box, which the order of the file follows; world units, since boxes on the lattice are
    /// rounded.
    pub(super) centres: Vec<[f64; 3]>,
    /// The number of symbols in each block, root after root.
    pub(super) block_symbols: Vec<u32>,
    /// For each root its parent in the piece, or [`NO_ROOT`].
    pub(super) parents: Vec<u32>,
    pub(super) arc_ends: Vec<[u32; 2]>,
    /// Per arc and level.
    pub(super) new_samples: Vec<u32>,
    pub(super) corners: Vec<LatticePoint>,
    /// The coarsest level at which each of them is a vertex.
    pub(super) corner_levels: Vec<u8>,
    /// Shared number and own number of those that this piece is the first to have.
    pub(super) shared_corners: Vec<[u32; 2]>,
    pub(super) shared_arcs: Vec<[u32; 2]>,
    /// By level.
    pub(super) arc_tallies: Vec<Tally>,
    pub(super) block_tallies: Vec<Tally>,
    /// Those of the file.
    pub(super) channels: Vec<ChannelInfo>,
}

/// The symbols of a piece, and its texels.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PieceSymbols {
    /// Of each block, root after root.
    pub(super) blocks: Runs,
    /// Of the new samples of each arc and level.
    pub(super) arcs: Runs,
    /// The texel streams of each block, root after root.
    pub(super) texels: TexelRuns,
    /// Who owns the islands of each block, likewise.
    pub(super) owners: TexelRuns,
}

/// Runs of symbols one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Runs {
    all: SymbolBuffer,
    /// Where each ends.
    pub(super) ends: Vec<Mark>,
}

impl Runs {
    fn push(&mut self, symbols: &SymbolBuffer) -> Result<()> {
        self.all.append(symbols);
        let end = self.all.checked_mark();
        self.ends
            .push(end.ok_or_else(|| Error::model("a piece has 4 GiB of symbols or more; divide it into several"))?);
        Ok(())
    }

    /// The number of runs.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// The symbols of a run.
    pub fn get(&self, run: usize) -> Symbols<'_> {
        let end_of = |run: usize| self.ends.get(run).copied().unwrap_or_default();
        self.all.within(run.checked_sub(1).map_or(Mark::default(), end_of)..end_of(run))
    }
}

impl Piece {
    /// Makes a piece of a model. Of what concerns the whole file, uses only lattice, steps, levels and channels.
    ///
    /// # Errors
    /// [`Error::Model`] if the model breaks a rule.
    pub fn new(model: &Model, shares: &Shares) -> Result<Self> {
        check::check(model)?;
        let arcs = LocalRefs::new(model.arcs.len(), &shares.arcs);
        let corners = LocalRefs::new(model.corners.len(), &shares.corners);
        let mut piece = Self::of_channels(&model.channels);
        (piece.index.shared_corners, piece.index.shared_arcs) = (corners.firsts, arcs.firsts);
        for root in &model.roots {
            let mut entry = root_entry(model, root)?;
            let half_arcs = entry.loops.iter_mut().flatten();
            half_arcs.for_each(|half_arc| half_arc.arc = arcs.places[half_arc.arc as usize].0);
            piece.index.parents.push(root.parent.unwrap_or(NO_ROOT));
            piece.push_root(entry, root)?;
        }
        let Self { index, symbols } = &mut piece;
        for &arc in &arcs.things {
            let record = &model.arcs[arc as usize];
            index.arc_ends.push(record.ends.map(|corner| corners.places[corner as usize].0));
            let mut path = Path::new(record.ends.map(|corner| model.corners[corner as usize]));
            for level in 0..model.levels.len() as u8 {
                let count = record.samples.iter().filter(|sample| sample.level == level).count();
                let mut added = SymbolBuffer::default();
                if count > 0 {
                    path.encode_level(level, model.arc_tangent_shift, &record.samples, &mut added)?;
                }
                index.new_samples.push(count as u32);
                symbols.arcs.push(&added)?;
            }
        }
        index.corners = corners.things.iter().map(|&corner| model.corners[corner as usize]).collect();
        let level = |&corner: &u32| model.corner_levels.get(corner as usize).copied().unwrap_or(0);
        index.corner_levels = corners.things.iter().map(level).collect();
        index.count(symbols, model.levels.len());
        Ok(piece)
    }

    /// Checks that there are symbols for each block and arc, because a piece may come from a damaged file.
    ///
    /// # Errors
    /// [`Error::Model`].
    #[cfg(feature = "serde")]
    pub(super) fn check_symbols(&self, level_count: usize, stream_count: usize) -> Result<()> {
        let Self { index, symbols } = self;
        let blocks: usize = index.roots.iter().map(|root| root.blocks.len()).sum();
        let is_sound = symbols.blocks.count() == blocks
            && symbols.arcs.count() == index.arc_ends.len() * level_count
            && symbols.texels.is_sound(blocks * stream_count)
            && symbols.owners.is_sound(blocks);
        if is_sound { Ok(()) } else { Err(Error::model("a piece is not the one that was counted")) }
    }

    /// The number of each root's first block, and that of all blocks.
    #[cfg(feature = "serde")]
    pub(super) fn first_blocks(&self) -> Vec<usize> {
        let mut firsts = super::catalogue::first_blocks(&self.index.roots);
        firsts.push(self.symbols.blocks.count());
        firsts
    }

    /// A piece without roots.
    pub(super) fn of_channels(channels: &[ChannelInfo]) -> Self {
        let mut piece = Self::default();
        piece.index.channels = channels.to_vec();
        piece
    }

    /// Appends a root, and the symbols and texels of its blocks.
    pub(super) fn push_root(&mut self, entry: RootEntry, root: &RootRecord) -> Result<()> {
        let Self { index, symbols } = self;
        index.roots.push(entry);
        index.centres.push([0, 1, 2].map(|axis| root.bounds[0][axis] * 0.5 + root.bounds[1][axis] * 0.5));
        for block in root.blocks.iter().flatten() {
            index.block_symbols.push(u32::try_from(block.symbols.len()).unwrap_or(u32::MAX));
            symbols.blocks.push(&block.symbols)?;
            symbols.texels.push(&block.texels, stream_count(&index.channels))?;
            symbols.owners.push(&[owners::to_bytes(&block.owners)], 1)?;
        }
        Ok(())
    }
}

impl PieceIndex {
    /// Counts how often tokens occur.
    pub(super) fn count(&mut self, symbols: &PieceSymbols, level_count: usize) {
        let arcs = |level: usize| (level..symbols.arcs.count()).step_by(level_count).map(|run| symbols.arcs.get(run));
        self.arc_tallies = (0..level_count).map(|level| Tally::of(arcs(level))).collect();
        let levels = || self.roots.iter().flat_map(|root| &root.blocks).map(|block| usize::from(block.level));
        let blocks = |level: usize| {
            let of_level = levels().enumerate().filter(move |&(_, of_block)| of_block == level);
            Tally::of(of_level.map(|(run, _)| symbols.blocks.get(run)))
        };
        self.block_tallies = (0..level_count).map(blocks).collect();
    }

    /// Gives everything that is shared the number that it has in another file, of which the piece becomes a part too.
    ///
    /// # Errors
    /// [`Error::Model`] if something has no number there.
    pub fn renumber(&mut self, corner: impl Fn(u32) -> Option<u32>, arc: impl Fn(u32) -> Option<u32>) -> Result<()> {
        let missing = || Error::model("a piece shares an arc or corner that has no number");
        let [corner, arc]: [&dyn Fn(u32) -> Option<u32>; 2] = [&corner, &arc];
        let place = |place: &mut u32, number: &dyn Fn(u32) -> Option<u32>| -> Result<()> {
            if let Some(shared) = LocalRef(*place).shared() {
                *place = LocalRef::of_shared(number(shared).ok_or_else(missing)?).0;
            }
            Ok(())
        };
        for (shared, number) in [(&mut self.shared_corners, corner), (&mut self.shared_arcs, arc)] {
            shared
                .iter_mut()
                .try_for_each(|[shared, _]| number(*shared).map(|new| *shared = new).ok_or_else(missing))?;
        }
        let half_arcs = self.roots.iter_mut().flat_map(|root| root.loops.iter_mut().flatten());
        half_arcs.map(|half_arc| &mut half_arc.arc).try_for_each(|number| place(number, arc))?;
        self.arc_ends.iter_mut().flatten().try_for_each(|end| place(end, corner))
    }

    /// Whether a root can be another's parent, or that has none.
    fn is_parent(&self, parent: u32, child: usize) -> bool {
        let levels = |root: usize| self.roots.get(root).map(|root| root.blocks.iter().map(|block| block.level));
        let coarsest = levels(child).and_then(|mut levels| levels.next());
        let above = levels(parent as usize).and_then(Iterator::last);
        parent == NO_ROOT || above.is_some_and(|above| above.checked_add(1) == coarsest)
    }

    /// Checks what an assembly relies on, because a piece may come from a damaged file.
    pub(super) fn check(&self, level_count: usize) -> Result<()> {
        let is_there = |place: u32, count: usize| LocalRef(place).own().is_none_or(|own| (own as usize) < count);
        let is_sound = |root: &RootEntry| {
            let levels = || root.blocks.iter().map(|block| usize::from(block.level));
            let [low, high] = root.bounds;
            !root.blocks.is_empty()
                && levels().is_sorted_by(|a, b| a < b)
                && levels().all(|level| level < level_count)
                && (0..3).all(|k| -MAX_BOX <= low[k] && low[k] <= high[k] && high[k] <= MAX_BOX)
                && root.half_arcs().all(|half_arc| is_there(half_arc.arc, self.arc_ends.len()))
        };
        let block_count: usize = self.roots.iter().map(|root| root.blocks.len()).sum();
        let samples = |counts: &[u32]| counts.iter().map(|&count| u64::from(count)).sum::<u64>();
        let owns = |shared: &[[u32; 2]], count: usize| shared.iter().all(|&[_, own]| (own as usize) < count);
        if level_count > 0
            && [self.arc_tallies.len(), self.block_tallies.len()] == [level_count; 2]
            && self.roots.iter().all(is_sound)
            && self.centres.len() == self.roots.len()
            && self.parents.len() == self.roots.len()
            && (0..).zip(&self.parents).all(|(root, &parent)| self.is_parent(parent, root))
            && self.corner_levels.len() == self.corners.len()
            && self.corner_levels.iter().all(|&level| usize::from(level) < level_count)
            && self.block_symbols.len() == block_count
            && self.new_samples.len() == self.arc_ends.len() * level_count
            && self.new_samples.chunks(level_count).all(|counts| samples(counts) < u64::from(PARAM_END))
            && self.arc_ends.iter().flatten().all(|&end| is_there(end, self.corners.len()))
            && self.corners.iter().flatten().all(|x| x.unsigned_abs() <= 1 << 40)
            && owns(&self.shared_arcs, self.arc_ends.len())
            && owns(&self.shared_corners, self.corners.len())
        {
            return Ok(());
        }
        Err(Error::model("a piece does not have the levels of its file, or is damaged"))
    }
}

/// References to the arcs or corners of a model.
struct LocalRefs {
    /// Those that the piece is the first to have.
    things: Vec<u32>,
    /// For each of the model.
    places: Vec<LocalRef>,
    /// Shared number and own number of those that are shared and first here.
    firsts: Vec<[u32; 2]>,
}

impl LocalRefs {
    fn new(count: usize, shares: &[Option<Share>]) -> Self {
        let mut result = Self { things: Vec::new(), places: Vec::with_capacity(count), firsts: Vec::new() };
        // Several of the model may be the same shared one.
        let mut shared = BTreeMap::new();
        for thing in 0..count as u32 {
            let next = LocalRef(2 * result.things.len() as u32);
            let place = match shares.get(thing as usize).copied().flatten() {
                Some(Share { number, is_first: false }) => LocalRef::of_shared(number),
                Some(Share { number, .. }) => *shared.entry(number).or_insert_with(|| {
                    result.firsts.push([number, next.0 / 2]);
                    next
                }),
                None => next,
            };
            if place == next {
                result.things.push(thing);
            }
            result.places.push(place);
        }
        result
    }
}

/// A model root, with the arcs of the model.
pub(super) fn root_entry(model: &Model, record: &RootRecord) -> Result<RootEntry> {
    let mut blocks = Vec::new();
    for (level, block) in (0..).zip(&record.blocks) {
        let Some(block) = block else { continue };
        blocks.push(BlockEntry {
            level,
            error: ErrorCode::at_least(block.error, &model.lattice)?,
            border_deviation: ErrorCode::at_least(block.border_deviation, &model.lattice)?,
            triangle_count: block.triangle_count,
            begins_stream: false,
        });
    }
    Ok(RootEntry {
        filling: record.filling,
        loops: record.loops.clone(),
        bounds: lattice_box(model, record.bounds)?,
        child_count: 0,
        blocks,
    })
}

/// A world box on the lattice, rounded outward.
fn lattice_box(model: &Model, bounds: [[f64; 3]; 2]) -> Result<[LatticePoint; 2]> {
    // More than the rounding of `units` can be off below 2^41 steps.
    const MARGIN: f64 = 1.0 / 512.0;
    let [low, high] = bounds.map(|point| model.lattice.units(point));
    let mut result = [[0; 3]; 2];
    for axis in 0..3 {
        let (low, high) = ((low[axis] - MARGIN).floor(), (high[axis] + MARGIN).ceil());
        if !(low >= -MAX_BOX as f64 && low <= high && high <= MAX_BOX as f64) {
            return Err(Error::model("a root's bounds are empty, not finite or beyond 2^41 lattice steps"));
        }
        result[0][axis] = low as i64;
        result[1][axis] = high as i64;
    }
    Ok(result)
}
