//! Index blocks: one per cluster, with its roots' loops, boxes and blocks, its arcs and corners (SPEC.md, "Section
//! INDEX").
//!
//! A block is: the size of its records (varint); the records, an rANS stream ([`records`]); the size of the arc stream
//! (varint); the arc stream, with the cluster's corners, then its arcs' samples of the coarsest levels; then size and
//! checksum of every page of the cluster, level by level: the arc pages (one per arc run), then the block pages.

pub(crate) mod contexts;
mod records;

use std::{ops::Range, sync::OnceLock};

use crate::{
    codec::{
        arc::{Path, Split, decode_corner},
        bytes::{Cursor, put_varint},
        entropy::{Decoder, Position, Tables},
    },
    error::{Error, Result},
    format::{
        clusters::Cluster,
        error_code::{ErrorCode, sum_of_bounds},
        levels::Levels,
        records::{Filling, HalfArc},
        sections::Part,
    },
    lattice::{Lattice, LatticePoint},
    limits::Limits,
};

/// The data that all index blocks of a file rely on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scheme<'a> {
    pub tables: &'a Tables,
    pub levels: &'a Levels,
    /// Codes of the levels' tolerances.
    pub tolerances: &'a [ErrorCode],
    pub limits: &'a Limits,
}

/// A root at one level that it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct BlockEntry {
    pub level: u8,
    pub error: ErrorCode,
    pub border_deviation: ErrorCode,
    pub triangle_count: u32,
    /// Whether the block begins a stream.
    pub begins_stream: bool,
}

/// A root.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct RootEntry {
    pub filling: Filling,
    pub loops: Vec<Vec<HalfArc>>,
    /// Smallest and largest coordinates.
    pub bounds: [LatticePoint; 2],
    /// The number of roots that it stands for together.
    pub child_count: u32,
    /// Coarse to fine, at least one.
    pub blocks: Vec<BlockEntry>,
}

impl RootEntry {
    /// Index in `blocks` of the block to draw at a level: the finest one that is not finer.
    pub(crate) fn block_at(&self, level: u8) -> usize {
        self.blocks.partition_point(|block| block.level <= level).saturating_sub(1)
    }

    /// Its coarsest and its finest level.
    pub(crate) fn end_levels(&self) -> [u8; 2] {
        [self.blocks.first(), self.blocks.last()].map(|block| block.map_or(0, |block| block.level))
    }

    /// The block to draw where all that is drawn is of one level, unless the root is not drawn then: its parent or its
    /// children are.
    pub(crate) fn uniform_block(&self, level: u8, is_top: bool) -> Option<&BlockEntry> {
        let block = self.blocks.get(self.block_at(level))?;
        let is_finest = self.blocks.last().is_some_and(|last| last.level < level);
        ((is_top || block.level <= level) && (self.child_count == 0 || !is_finest)).then_some(block)
    }

    /// All half-arcs, loop after loop.
    pub(crate) fn half_arcs(&self) -> impl Iterator<Item = HalfArc> + '_ {
        self.loops.iter().flatten().copied()
    }
}

/// A stream of blocks of one level, which are decoded together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stream {
    pub level: u8,
    /// Roots of the cluster, counted from its first; those that have the level.
    pub roots: Range<u32>,
    /// Its bytes within the PAGES section.
    pub part: Part,
}

/// The content of an index block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ClusterIndex {
    pub roots: Vec<RootEntry>,
    /// Corners at both ends of each arc of the cluster.
    pub arc_ends: Vec<[u32; 2]>,
    /// Per arc and level the number of samples of this and coarser levels.
    sample_counts: Vec<u32>,
    level_count: usize,
    /// Positions of the cluster's corners.
    pub corners: Vec<LatticePoint>,
    /// The coarsest level at which each of them is a vertex.
    pub corner_levels: Vec<u8>,
    /// Corners, then the samples of the levels that are not in pages; and where these samples begin.
    arc_stream: Vec<u8>,
    after_corners: Position,
    /// The samples of the arc stream, decoded when first needed: those of all arcs at the coarsest level, then at the
    /// next one.
    arc_splits: OnceLock<Vec<Split>>,
    /// The arc runs, whose samples are coded together. Arcs are counted from the cluster's first.
    pub arc_runs: Vec<Range<u32>>,
    /// The arc pages, level by level and run by run.
    arc_parts: Vec<Part>,
    /// By level and position.
    pub streams: Vec<Stream>,
}

impl ClusterIndex {
    /// An index whose streams are not known yet. `new_samples` are per arc and level.
    pub(crate) fn new(roots: Vec<RootEntry>, arc_ends: Vec<[u32; 2]>, new_samples: &[u32], level_count: usize) -> Self {
        let mut sample_counts = new_samples.to_vec();
        for counts in sample_counts.chunks_mut(level_count.max(1)) {
            for level in 1..counts.len() {
                counts[level] += counts[level - 1];
            }
        }
        Self { roots, arc_ends, sample_counts, level_count, ..Self::default() }
    }

    /// The number of samples that an arc of the cluster has at a level, with coarser ones.
    pub(crate) fn sample_count(&self, arc: u32, level: u8) -> u32 {
        let at = arc as usize * self.level_count + usize::from(level);
        self.sample_counts.get(at).copied().unwrap_or(0)
    }

    /// The number of samples that a level adds to an arc of the cluster.
    pub(crate) fn new_sample_count(&self, arc: u32, level: u8) -> u32 {
        let coarser = if level == 0 { 0 } else { self.sample_count(arc, level - 1) };
        self.sample_count(arc, level) - coarser
    }

    /// Triangles and largest error of those of the cluster's roots that are drawn at a level; the first `top_count` are
    /// tops. A root that lacks the level may be coarser than a neighbour, so its border deviation is added.
    pub(crate) fn summary(&self, level: u8, top_count: u32, lattice: &Lattice) -> Result<(u64, ErrorCode)> {
        let (mut triangle_count, mut max_error) = (0, ErrorCode::default());
        for (number, root) in (0..).zip(&self.roots) {
            let Some(block) = root.uniform_block(level, number < top_count) else { continue };
            triangle_count += u64::from(block.triangle_count);
            max_error = max_error.max(block.error);
            if block.level < level {
                let sum = sum_of_bounds(block.error.bound(lattice), block.border_deviation.bound(lattice));
                max_error = max_error.max(ErrorCode::at_least(sum, lattice)?);
            }
        }
        Ok((triangle_count, if triangle_count > 0 { max_error } else { ErrorCode::default() }))
    }

    /// The run of an arc of the cluster.
    pub(crate) fn arc_run_of(&self, arc: u32) -> Result<u32> {
        let run = self.arc_runs.partition_point(|run| run.end <= arc);
        if run < self.arc_runs.len() { Ok(run as u32) } else { Err(Error::format("an arc does not exist")) }
    }

    /// The page of an arc run at a level.
    pub(crate) fn arc_part(&self, index_arc_levels: u8, level: u8, run: u32) -> Result<Part> {
        let place = level.checked_sub(index_arc_levels).map(|row| usize::from(row) * self.arc_runs.len());
        let part = place.and_then(|place| self.arc_parts.get(place + run as usize)).copied();
        part.ok_or_else(|| Error::format("an arc run does not exist"))
    }

    /// Gives the arcs of the cluster their samples of the coarsest levels, up to `finest`. Skips absent arcs.
    pub(crate) fn place_arcs(&self, scheme: &Scheme<'_>, paths: &mut [Path], finest: u8) -> Result<()> {
        let splits = match self.arc_splits.get() {
            Some(splits) => splits,
            // If another thread was first, its result is the same.
            None => {
                let splits = self.decode_arcs(scheme)?;
                self.arc_splits.get_or_init(|| splits)
            }
        };
        let mut first = 0;
        for level in 0..scheme.levels.index_arc_levels.min(finest.saturating_add(1)) {
            for (arc, path) in (0..).zip(paths.iter_mut()) {
                let after = first + self.new_sample_count(arc, level) as usize;
                if !path.is_absent() {
                    let splits = splits.get(first..after).unwrap_or(&[]);
                    path.repeat_level(level, scheme.levels.arc_tangent_shift, splits)?;
                }
                first = after;
            }
        }
        Ok(())
    }

    /// Decodes the samples of all arcs at the coarsest levels.
    fn decode_arcs(&self, scheme: &Scheme<'_>) -> Result<Vec<Split>> {
        let mut symbols = Decoder::resume(scheme.tables, &self.arc_stream, self.after_corners);
        let mut paths = vec![Path::skipped(); self.arc_ends.len()];
        let mut splits = Vec::new();
        for level in 0..scheme.levels.index_arc_levels {
            for (arc, path) in (0..).zip(paths.iter_mut()) {
                let count = self.new_sample_count(arc, level);
                if count > 0 {
                    path.record_level(level, scheme.levels.arc_tangent_shift, count, &mut symbols, &mut splits)?;
                }
            }
        }
        symbols.finish()?;
        Ok(splits)
    }

    /// Decodes the samples of one arc run at a level in pages, up to its arc `last`; `paths` are those of the whole
    /// cluster. Checks the end of the stream only if the last arc ends the run, because decoding stops after `last`.
    pub(crate) fn decode_arc_run(
        &self,
        scheme: &Scheme<'_>,
        paths: &mut [Path],
        (level, run, last): (u8, u32, u32),
        bytes: &[u8],
    ) -> Result<()> {
        let mut symbols = Decoder::new(scheme.tables, bytes)?;
        let arcs = self.arc_run(run);
        for (arc, path) in arcs.clone().take_while(|&arc| arc <= last).zip(paths.iter_mut().skip(arcs.start as usize)) {
            let count = self.new_sample_count(arc, level);
            if count > 0 {
                path.decode_level(level, scheme.levels.arc_tangent_shift, count, &mut symbols)?;
            }
        }
        if last + 1 == arcs.end { symbols.finish() } else { Ok(()) }
    }

    /// The arcs of a run, counted from the cluster's first.
    pub(crate) fn arc_run(&self, run: u32) -> Range<u32> {
        self.arc_runs.get(run as usize).cloned().unwrap_or_default()
    }

    /// Size of the arc stream: corners and the coarsest levels' samples.
    pub(crate) fn arc_stream_bytes(&self) -> u64 {
        self.arc_stream.len() as u64
    }

    /// The streams of a level.
    pub(crate) fn level_streams(&self, level: u8) -> &[Stream] {
        let start = self.streams.partition_point(|stream| stream.level < level);
        let end = self.streams.partition_point(|stream| stream.level <= level);
        self.streams.get(start..end).unwrap_or(&[])
    }

    /// All pages of a level: arc pages, then block pages.
    pub(crate) fn parts(&self, index_arc_levels: u8, level: u8) -> impl Iterator<Item = Part> + '_ {
        let run_count = self.arc_runs.len();
        let first = level.checked_sub(index_arc_levels).map(|row| usize::from(row) * run_count);
        let arcs = first.and_then(|first| self.arc_parts.get(first..first + run_count)).unwrap_or(&[]);
        arcs.iter().copied().chain(self.level_streams(level).iter().map(|stream| stream.part))
    }

    /// The bytes of the index block. `arc_stream` holds its corners and coarsest samples; `arc_parts` are its arc
    /// pages, level by level and run by run. The parts of block streams must be set.
    pub(crate) fn write(&self, records: &[u8], arc_stream: &[u8], arc_parts: &[Vec<Part>]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for stream in [records, arc_stream] {
            put_varint(&mut bytes, stream.len() as u64);
            bytes.extend(stream);
        }
        let page_levels = self.level_count - arc_parts.len();
        for level in 0..self.level_count {
            let runs = level.checked_sub(page_levels).and_then(|row| arc_parts.get(row));
            runs.into_iter().flatten().for_each(|part| part.write(&mut bytes));
            self.level_streams(level as u8).iter().for_each(|stream| stream.part.write(&mut bytes));
        }
        bytes
    }

    /// Finds the streams of blocks. Their parts still have to be set.
    pub(crate) fn find_streams(&mut self) -> Result<()> {
        self.streams.clear();
        for level in 0..self.level_count as u8 {
            let before = self.streams.len();
            for (index, root) in (0..).zip(&self.roots) {
                let Some(block) = root.blocks.iter().find(|block| block.level == level) else { continue };
                if block.begins_stream {
                    self.streams.push(Stream { level, roots: index..index + 1, part: Part::default() });
                } else if self.streams.len() > before
                    && let Some(stream) = self.streams.last_mut()
                {
                    stream.roots.end = index + 1;
                } else {
                    return Err(Error::format("the first block of a level does not begin a stream"));
                }
            }
        }
        Ok(())
    }

    /// Divides the arcs into runs. A run ends once it has `Levels::arc_run_samples` samples in pages.
    pub(crate) fn find_arc_runs(&mut self, levels: &Levels) {
        self.arc_runs.clear();
        let (mut start, mut samples) = (0, 0);
        let arc_count = self.arc_ends.len() as u32;
        for arc in 0..arc_count {
            let finest = self.level_count.saturating_sub(1) as u8;
            let in_index = self.sample_count(arc, levels.index_arc_levels.saturating_sub(1));
            samples += self.sample_count(arc, finest) - in_index;
            if samples >= u32::from(levels.arc_run_samples) || arc + 1 == arc_count {
                self.arc_runs.push(start..arc + 1);
                (start, samples) = (arc + 1, 0);
            }
        }
    }

    /// Reads an index block of a cluster.
    ///
    /// # Errors
    /// [`Error::Format`] if a rule is broken, [`Error::Limit`] above the limits.
    pub(crate) fn parse(bytes: &[u8], cluster: &Cluster, scheme: &Scheme<'_>) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let mut stream = || {
            let length = cursor.varint()?;
            cursor.bytes(usize::try_from(length).unwrap_or(usize::MAX))
        };
        let (records, arc_stream) = (stream()?, stream()?);
        let mut symbols = Decoder::new(scheme.tables, records)?;
        let mut index =
            Self::parse_records(&mut symbols, cluster, &scheme.levels.fillings, scheme.tolerances, scheme.limits)?;
        symbols.finish()?;
        index.find_streams()?;
        index.find_arc_runs(scheme.levels);

        let mut symbols = Decoder::new(scheme.tables, arc_stream)?;
        let mut before = cluster.bounds[0];
        for _ in 0..cluster.corner_count {
            before = decode_corner(before, &mut symbols)?;
            index.corners.push(before);
        }
        index.after_corners = symbols.position();
        index.arc_stream = arc_stream.to_vec();
        index.parse_parts(&mut cursor, cluster, scheme)?;
        cursor.finish()?;
        Ok(index)
    }

    fn parse_parts(&mut self, cursor: &mut Cursor<'_>, cluster: &Cluster, scheme: &Scheme<'_>) -> Result<()> {
        for (level, pages) in (0..).zip(&cluster.levels) {
            let mut next = pages.arcs.offset;
            if level >= scheme.levels.index_arc_levels {
                for _ in 0..self.arc_runs.len() {
                    self.arc_parts.push(Part::parse(cursor, &mut next, scheme.limits)?);
                }
            }
            let arcs_end = std::mem::replace(&mut next, pages.blocks.offset);
            for stream in self.streams.iter_mut().filter(|stream| stream.level == level) {
                stream.part = Part::parse(cursor, &mut next, scheme.limits)?;
            }
            if arcs_end - pages.arcs.offset != pages.arcs.length || next - pages.blocks.offset != pages.blocks.length {
                return Err(Error::format("the pages do not add up to their size in the cluster"));
            }
        }
        Ok(())
    }
}
