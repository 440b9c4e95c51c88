//! An account of a file, section by section and level by level, for people.

use crate::{
    codec::{
        arc,
        entropy::context::{self, Use},
        filling::{Filling, FillingCounts},
    },
    error::Result,
    format::{
        clusters::Cluster,
        header::{ENTRY_BYTES, HEADER_BYTES, kind},
        index_block::{self, ClusterIndex},
    },
    index::Index,
};

/// An account of everything that a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileSummary {
    /// Size of the file.
    pub bytes: u64,
    /// Name and size of each section, header and directory first. The sizes add up to `bytes`.
    pub sections: Vec<(&'static str, u64)>,
    /// Coarse to fine.
    pub levels: Vec<LevelContents>,
    /// Roots by filling.
    pub roots: FillingCounts,
    /// Roots without a border, of any filling.
    pub closed_roots: u64,
    /// Tables of symbol frequencies.
    pub table_count: u64,
    /// For each kind of symbols, how many of its contexts have a table.
    pub contexts: Vec<ContextContents>,
    /// Bytes of the section INDEX that lists of clusters take. The topmost list lies in CLUSTERS.
    pub list_bytes: u64,
    /// Bytes of the index that describe roots, blocks and arcs.
    pub record_bytes: u64,
    /// Bytes of the index that hold positions: of corners, and of the arc samples of the coarsest levels.
    pub index_arc_bytes: u64,
    /// Bytes of the index with size and checksum of each stream in pages.
    pub place_bytes: u64,
    /// Number of coarsest levels whose arc samples are in the index instead of in pages.
    pub index_arc_levels: u64,
    /// Arc runs: arcs whose samples lie together in pages.
    pub arc_run_count: u64,
    /// Samples of all arcs at all levels.
    pub sample_count: u64,
    /// Arcs without any sample.
    pub bare_arc_count: u64,
}

/// One kind of symbols: how many contexts the format has for it, and how many of these have a table in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContextContents {
    /// What the symbols describe.
    pub name: &'static str,
    /// Contexts that the format has.
    pub count: u64,
    /// Contexts with a table in the file. Symbols of the others do not occur.
    pub used_count: u64,
}

/// What one level adds to the coarser ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelContents {
    /// Triangles with every root drawn at this level, before stitching adds any.
    pub triangle_count: u64,
    /// Largest certified error of that cut, world units.
    pub max_error: f64,
    /// Bytes of the level's arc samples in pages. Those of the coarsest levels are in the index.
    pub arc_bytes: u64,
    /// Bytes of the level's blocks.
    pub block_bytes: u64,
    /// Roots that have a block at this level.
    pub block_count: u64,
    /// The same by filling.
    pub blocks: FillingCounts,
    /// Triangles of the level's blocks.
    pub block_triangle_count: u64,
    /// Streams of blocks.
    pub block_stream_count: u64,
    /// Streams of arc samples in pages, without empty ones.
    pub arc_stream_count: u64,
    /// Empty streams, of blocks or of arc samples in pages.
    pub empty_stream_count: u64,
    /// Samples that the level adds to arcs, in the index or in pages.
    pub sample_count: u64,
    /// Arcs that the level adds samples to.
    pub refined_arc_count: u64,
}

impl Index {
    /// Adds up the whole index. Needs all index blocks.
    ///
    /// # Errors
    /// [`crate::Error::Missing`], [`crate::Error::Format`], [`crate::Error::Limit`].
    pub fn summary(&self) -> Result<FileSummary> {
        self.load_indices(0..self.cluster_count())?;
        let sections = self.sections();
        let mut summary = FileSummary {
            bytes: (HEADER_BYTES + sections.len() * ENTRY_BYTES) as u64,
            table_count: self.tables().count() as u64,
            contexts: self.contexts(),
            index_arc_levels: u64::from(self.levels().index_arc_levels),
            list_bytes: self.list_bytes(),
            ..FileSummary::default()
        };
        summary.sections.push(("header", summary.bytes));
        for (number, _, length) in sections {
            summary.sections.push((kind::name(number), length));
            summary.bytes += length;
        }
        let records = (0..self.level_count()).filter_map(|level| self.level(level));
        summary.levels.extend(records.map(|record| LevelContents {
            triangle_count: record.triangle_count,
            max_error: record.max_error,
            ..LevelContents::default()
        }));
        for (number, cluster) in (0..).zip(self.clusters()?) {
            summary.add(cluster, self.cluster_index(number)?, self.levels().index_arc_levels);
        }
        Ok(summary)
    }

    fn contexts(&self) -> Vec<ContextContents> {
        let fillings = Filling::all().map(|filling| filling.descriptor().uses);
        let uses: Vec<Use> = [index_block::contexts::USES, arc::contexts::USES]
            .into_iter()
            .chain(fillings)
            .chain([index_block::contexts::TREE_USES])
            .flatten()
            .copied()
            .collect();
        let ends = uses.iter().skip(1).map(|next| next.first).chain([context::TREE.end]);
        let contents = uses.iter().zip(ends).map(|(&Use { name, first }, end)| ContextContents {
            name,
            count: u64::from(end - first),
            used_count: (first..end).filter(|&context| self.tables().has(context)).count() as u64,
        });
        contents.collect()
    }
}

impl FileSummary {
    fn add(&mut self, cluster: &Cluster, index: &ClusterIndex, index_arc_levels: u8) {
        for root in &index.roots {
            self.roots.count(root.filling);
            self.closed_roots += u64::from(root.loops.is_empty());
            for block in &root.blocks {
                let Some(level) = self.levels.get_mut(usize::from(block.level)) else { continue };
                level.block_count += 1;
                level.blocks.count(root.filling);
                level.block_triangle_count += u64::from(block.triangle_count);
            }
        }
        let arc_count = index.arc_ends.len() as u32;
        let finest = self.levels.len().saturating_sub(1) as u8;
        self.bare_arc_count += (0..arc_count).filter(|&arc| index.sample_count(arc, finest) == 0).count() as u64;
        self.arc_run_count += index.arc_runs.len() as u64;
        let mut places = Vec::new();
        for ((number, level), pages) in (0..).zip(&mut self.levels).zip(&cluster.levels) {
            level.arc_bytes += pages.arcs.length;
            level.block_bytes += pages.blocks.length;
            for count in (0..arc_count).map(|arc| index.new_sample_count(arc, number)).filter(|&count| count > 0) {
                level.sample_count += u64::from(count);
                level.refined_arc_count += 1;
            }
            let arc_streams = if number < index_arc_levels { 0 } else { index.arc_runs.len() };
            for (place, part) in index.parts(index_arc_levels, number).enumerate() {
                part.write(&mut places);
                level.empty_stream_count += u64::from(part.length == 0);
                level.arc_stream_count += u64::from(place < arc_streams && part.length > 0);
                level.block_stream_count += u64::from(place >= arc_streams);
            }
        }
        self.sample_count = self.levels.iter().map(|level| level.sample_count).sum();
        self.index_arc_bytes += index.arc_stream_bytes();
        self.place_bytes += places.len() as u64;
        // The rest of the block, with the sizes of its two streams.
        let rest = index.arc_stream_bytes() + places.len() as u64;
        self.record_bytes += cluster.index.length.saturating_sub(rest);
    }
}
