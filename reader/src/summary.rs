//! What a file holds, section by section and level by level, for people.

use crate::{
    error::Result,
    header::{ENTRY_BYTES, HEADER_BYTES, kind},
    model::Filling,
    resident::Index,
};

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileSummary {
    /// Size of the file.
    pub bytes: u64,
    /// Name and size of each section, header and directory first; they add up to `bytes`.
    pub sections: Vec<(&'static str, u64)>,
    /// Coarse to fine.
    pub levels: Vec<LevelContents>,
    /// Roots with an irregular filling.
    pub irregular_roots: u64,
    /// Roots with a grid filling.
    pub grid_roots: u64,
}

/// What one level adds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelContents {
    /// Triangles when every root is drawn at this level, before stitching adds any.
    pub triangle_count: u64,
    /// Largest certified error then, world units.
    pub max_error: f64,
    /// Bytes of arc samples that the level has in pages; those of the coarsest levels are in the index.
    pub arc_bytes: u64,
    /// Bytes of the level's blocks.
    pub block_bytes: u64,
    /// Roots that have a block at this level.
    pub block_count: u64,
}

impl Index {
    /// Adds up the whole index.
    ///
    /// # Errors
    /// [`crate::Error::Missing`], [`crate::Error::Format`], [`crate::Error::Limit`].
    pub fn summary(&self) -> Result<FileSummary> {
        self.load_indices(0..self.cluster_count())?;
        let sections = self.sections();
        let mut summary =
            FileSummary { bytes: (HEADER_BYTES + sections.len() * ENTRY_BYTES) as u64, ..FileSummary::default() };
        summary.sections.push(("header", summary.bytes));
        for (number, _, length) in sections {
            summary.sections.push((kind::name(number), length));
            summary.bytes += length;
        }
        for level in 0..self.level_count() {
            let Some(record) = self.level(level) else { continue };
            let mut contents = LevelContents {
                triangle_count: record.triangle_count,
                max_error: record.max_error,
                ..LevelContents::default()
            };
            for parts in self.clusters().iter().filter_map(|cluster| cluster.levels.get(level)) {
                contents.arc_bytes += parts.arcs.length;
                contents.block_bytes += parts.blocks.length;
            }
            summary.levels.push(contents);
        }
        for number in 0..self.cluster_count() {
            for root in &self.index(number)?.roots {
                match root.filling {
                    Filling::Grid => summary.grid_roots += 1,
                    Filling::Irregular => summary.irregular_roots += 1,
                }
                for block in &root.blocks {
                    if let Some(level) = summary.levels.get_mut(usize::from(block.level)) {
                        level.block_count += 1;
                    }
                }
            }
        }
        Ok(summary)
    }
}
