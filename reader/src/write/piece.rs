//! Pieces: runs of whole clusters, ordered and turned into symbols, whose place in the file is not known yet.

use super::{
    check,
    order::{Order, Place},
};
use crate::{
    arc::{Path, encode_corner},
    entropy::{Mark, SymbolBuffer, Symbols, Tally},
    error::{Error, Result},
    error_code::ErrorCode,
    index::{BlockEntry, ClusterIndex, RootEntry},
    model::{HalfArc, Model},
    patch::LatticePoint,
    sections::{MAX_BOX, MAX_CLUSTER_ROOTS},
};

/// A stream of a block part ends after the block that brings it to this many symbols, which is about half a kilobyte: then
/// a stream's own four to six bytes weigh less than one percent, and to reach a block few others have to be decoded.
const STREAM_SYMBOLS: usize = 2048;

/// A corner or an arc that several pieces of a file have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Its number among all that are shared; below 2^31.
    pub number: u32,
    /// Whether no piece before has it.
    pub is_first: bool,
}

/// What of a model other pieces of the same file have, too. Empty lists where there are none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shares {
    /// Per corner of the model.
    pub corners: Vec<Option<Share>>,
    /// Per arc of the model.
    pub arcs: Vec<Option<Share>>,
}

/// A part of a model on its way into a file: see [`crate::Assembly`].
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Piece {
    /// What is where.
    pub index: PieceIndex,
    /// What it will be decoded from.
    pub symbols: PieceSymbols,
}

/// The roots, arcs and corners of a piece. Arcs and corners are numbered from 0 as clusters use them first, those that pieces
/// before have first not among them.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PieceIndex {
    pub(super) clusters: Vec<PieceCluster>,
    /// Number among all that are shared, and own number, of what this piece is the first to have.
    pub(super) shared_corners: Vec<[u32; 2]>,
    pub(super) shared_arcs: Vec<[u32; 2]>,
    pub(super) corner_tally: Tally,
    /// By level.
    pub(super) arc_tallies: Vec<Tally>,
    pub(super) block_tallies: Vec<Tally>,
    /// Which root of the model each root is; known where the piece was made.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub(super) root_order: Vec<u32>,
}

/// A cluster; arcs and corners by [`Place`].
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct PieceCluster {
    pub roots: Vec<RootEntry>,
    pub arc_ends: Vec<[u32; 2]>,
    /// Per arc and level.
    pub new_samples: Vec<u32>,
    pub corner_count: u32,
    pub bounds: [LatticePoint; 2],
}

/// The symbols of a piece.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PieceSymbols {
    pub(super) clusters: Vec<ClusterSymbols>,
}

#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct ClusterSymbols {
    pub corners: SymbolBuffer,
    /// By level.
    pub arcs: Vec<ArcSymbols>,
    /// By stream.
    pub blocks: Vec<SymbolBuffer>,
}

/// The new samples that arcs have at a level.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct ArcSymbols {
    all: SymbolBuffer,
    /// Where those of each arc end.
    ends: Vec<Mark>,
}

impl ArcSymbols {
    fn push(&mut self, symbols: &SymbolBuffer) {
        self.all.append(symbols);
        self.ends.push(self.all.mark());
    }

    /// How many arcs there are.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// The symbols of a run of arcs.
    pub fn of(&self, arcs: std::ops::Range<u32>) -> Symbols<'_> {
        let before = |arc: u32| arc.checked_sub(1).and_then(|last| self.ends.get(last as usize).copied());
        self.all.within(before(arcs.start).unwrap_or_default()..before(arcs.end).unwrap_or_default())
    }
}

impl Piece {
    /// Makes a piece of a model: of `root_count` roots that the whole file has, these are neighbours; [`u64::MAX`] if it is not known how
    /// many these are. The overview and what else
    /// is of the whole file are not looked at, but for lattice and levels.
    ///
    /// # Errors
    /// [`Error::Model`] where the model breaks a rule.
    pub fn new(model: &Model, shares: &Shares, root_count: u64) -> Result<Self> {
        check::check(model)?;
        let order = Order::new(model, shares, root_count)?;
        let mut piece = Self::default();
        let (mut arcs, mut corners) = (0, 0);
        for roots in order.roots.chunks(order.cluster_roots) {
            let (first_arc, first_corner) = (arcs, corners);
            let (cluster, index) = cluster(model, &order, roots, [&mut arcs, &mut corners])?;
            let own_arcs = &order.arcs.things[first_arc as usize..arcs as usize];
            let own_corners = &order.corners.things[first_corner as usize..corners as usize];
            piece.symbols.clusters.push(symbols(model, roots, (&cluster, &index), own_arcs, own_corners)?);
            piece.index.clusters.push(cluster);
        }
        let clusters = &piece.symbols.clusters;
        piece.index.corner_tally = Tally::of(clusters.iter().map(|cluster| cluster.corners.iter()));
        let arcs_at = |level: usize| clusters.iter().map(move |cluster| cluster.arcs[level].all.iter());
        piece.index.arc_tallies = (0..model.levels.len()).map(|level| Tally::of(arcs_at(level))).collect();
        let blocks_at = |level: usize| {
            let blocks = model.roots.iter().filter_map(move |root| root.blocks[level].as_ref());
            blocks.map(|block| block.symbols.iter())
        };
        piece.index.block_tallies = (0..model.levels.len()).map(|level| Tally::of(blocks_at(level))).collect();
        piece.index.shared_corners = order.corners.firsts();
        piece.index.shared_arcs = order.arcs.firsts();
        piece.index.root_order = order.roots;
        Ok(piece)
    }
}

impl PieceIndex {
    /// Gives everything that is shared another number, as it has in another file of which the piece is a part, too.
    ///
    /// # Errors
    /// [`Error::Model`] where there is none for something.
    pub fn renumber(&mut self, corner: impl Fn(u32) -> Option<u32>, arc: impl Fn(u32) -> Option<u32>) -> Result<()> {
        let missing = || Error::model("a piece shares an arc or corner that has no number");
        let [corner, arc]: [&dyn Fn(u32) -> Option<u32>; 2] = [&corner, &arc];
        let place = |place: &mut u32, number: &dyn Fn(u32) -> Option<u32>| -> Result<()> {
            if let Some(shared) = Place(*place).shared() {
                *place = Place::of_shared(number(shared).ok_or_else(missing)?).0;
            }
            Ok(())
        };
        for (shared, number) in [(&mut self.shared_corners, corner), (&mut self.shared_arcs, arc)] {
            shared
                .iter_mut()
                .try_for_each(|[shared, _]| number(*shared).map(|new| *shared = new).ok_or_else(missing))?;
        }
        for cluster in &mut self.clusters {
            let half_arcs = cluster.roots.iter_mut().flat_map(|root| root.loops.iter_mut().flatten());
            half_arcs.map(|half_arc| &mut half_arc.arc).try_for_each(|number| place(number, arc))?;
            cluster.arc_ends.iter_mut().flatten().try_for_each(|end| place(end, corner))?;
        }
        Ok(())
    }

    /// Checks what an assembly relies on: a piece may come from a file.
    pub(super) fn check(&self, level_count: usize) -> Result<()> {
        let is_sound = |root: &RootEntry| {
            let levels = || root.blocks.iter().map(|block| usize::from(block.level));
            root.blocks.first().is_some_and(|block| block.level == 0)
                && levels().is_sorted_by(|a, b| a < b)
                && levels().all(|level| level < level_count)
        };
        let holds = |[outer_low, outer_high]: [LatticePoint; 2], [low, high]: [LatticePoint; 2]| {
            (0..3).all(|k| -MAX_BOX <= outer_low[k] && outer_low[k] <= low[k] && low[k] <= high[k])
                && (0..3).all(|k| high[k] <= outer_high[k] && outer_high[k] <= MAX_BOX)
        };
        let fits = |cluster: &PieceCluster| {
            (1..=MAX_CLUSTER_ROOTS).contains(&cluster.roots.len())
                && cluster.new_samples.len() == cluster.arc_ends.len() * level_count
                && cluster.roots.iter().all(|root| is_sound(root) && holds(cluster.bounds, root.bounds))
        };
        let tallies = [self.arc_tallies.len(), self.block_tallies.len()];
        if tallies == [level_count; 2] && self.clusters.iter().all(fits) {
            return Ok(());
        }
        Err(Error::model("a piece has other levels than its file, or is damaged"))
    }
}

/// The cluster of a run of model roots. Its arcs and corners are the ones from `next` on; what comes after them is left there.
fn cluster(
    model: &Model,
    order: &Order,
    roots: &[u32],
    [next_arc, next_corner]: [&mut u32; 2],
) -> Result<(PieceCluster, ClusterIndex)> {
    let level_count = model.levels.len();
    let (first_arc, first_corner) = (*next_arc, *next_corner);
    let mut entries = Vec::with_capacity(roots.len());
    for &root in roots {
        let entry = root_entry(model, order, root)?;
        for half_arc in entry.half_arcs() {
            *next_arc = (*next_arc).max(Place(half_arc.arc).own().map_or(0, |arc| arc + 1));
        }
        entries.push(entry);
    }
    mark_streams(model, roots, &mut entries);
    let bounds = entries.iter().map(|entry| entry.bounds).reduce(union).unwrap_or_default();

    let arcs = &order.arcs.things[first_arc as usize..*next_arc as usize];
    let mut arc_ends = Vec::with_capacity(arcs.len());
    let mut new_samples = vec![0; arcs.len() * level_count];
    for (arc, counts) in arcs.iter().zip(new_samples.chunks_mut(level_count)) {
        let record = &model.arcs[*arc as usize];
        let ends = record.ends.map(|corner| order.corners.places[corner as usize]);
        ends.iter().filter_map(|end| end.own()).for_each(|corner| *next_corner = (*next_corner).max(corner + 1));
        arc_ends.push(ends.map(|end| end.0));
        record.samples.iter().for_each(|sample| counts[usize::from(sample.level)] += 1);
    }
    let mut index = ClusterIndex::new(entries.clone(), arc_ends.clone(), &new_samples, level_count);
    index.find_streams()?;
    let corner_count = *next_corner - first_corner;
    Ok((PieceCluster { roots: entries, arc_ends, new_samples, corner_count, bounds }, index))
}

/// The symbols of a cluster, whose arcs and corners are these.
fn symbols(
    model: &Model,
    roots: &[u32],
    (cluster, index): (&PieceCluster, &ClusterIndex),
    arcs: &[u32],
    corners: &[u32],
) -> Result<ClusterSymbols> {
    let mut result = ClusterSymbols::default();
    let mut before = cluster.bounds[0];
    for &corner in corners {
        let position = model.corners[corner as usize];
        encode_corner(position, before, &mut result.corners);
        before = position;
    }
    result.arcs = vec![ArcSymbols::default(); model.levels.len()];
    for (number, &arc) in (0..).zip(arcs) {
        let record = &model.arcs[arc as usize];
        let mut path = Path::new(record.ends.map(|corner| model.corners[corner as usize]));
        for (level, arcs) in (0..).zip(&mut result.arcs) {
            let mut symbols = SymbolBuffer::default();
            if index.new_sample_count(number, level) > 0 {
                path.encode_level(level, model.arc_tangent_shift, &record.samples, &mut symbols)?;
            }
            arcs.push(&symbols);
        }
    }
    for stream in &index.streams {
        let mut symbols = SymbolBuffer::default();
        let roots = &roots[stream.roots.start as usize..stream.roots.end as usize];
        let blocks =
            roots.iter().filter_map(|&root| model.roots[root as usize].blocks[usize::from(stream.level)].as_ref());
        blocks.for_each(|block| symbols.append(&block.symbols));
        result.blocks.push(symbols);
    }
    Ok(result)
}

/// A model root; its streams are not marked yet.
fn root_entry(model: &Model, order: &Order, root: u32) -> Result<RootEntry> {
    let record = &model.roots[root as usize];
    let placed = |half_arc: &HalfArc| HalfArc { arc: order.arcs.places[half_arc.arc as usize].0, ..*half_arc };
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
        loops: record.loops.iter().map(|half_arcs| half_arcs.iter().map(placed).collect()).collect(),
        bounds: lattice_box(model, record.bounds)?,
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

fn union(a: [LatticePoint; 2], b: [LatticePoint; 2]) -> [LatticePoint; 2] {
    let each = |side: usize, pick: fn(i64, i64) -> i64| [0, 1, 2].map(|axis| pick(a[side][axis], b[side][axis]));
    [each(0, i64::min), each(1, i64::max)]
}

/// Decides which blocks begin a stream: see [`STREAM_SYMBOLS`].
fn mark_streams(model: &Model, roots: &[u32], entries: &mut [RootEntry]) {
    let mut filled = vec![STREAM_SYMBOLS; model.levels.len()];
    for (entry, &root) in entries.iter_mut().zip(roots) {
        for block in &mut entry.blocks {
            let level = usize::from(block.level);
            let symbols = model.roots[root as usize].blocks[level].as_ref().map_or(0, |block| block.symbols.len());
            block.begins_stream = filled[level] >= STREAM_SYMBOLS;
            filled[level] = if block.begins_stream { symbols } else { filled[level] + symbols };
        }
    }
}
