//! The index of an open file: its resident part, the ranges that a query lacks, and summaries.
//!
//! An [`Index`] knows header, levels, tables and the topmost list of clusters, and the lists and index blocks that were
//! needed so far. Nothing here reads: a call that needs bytes that are not there returns [`Error::Missing`] with their
//! ranges. So the same code serves blocking and asynchronous readers.

mod contents;
mod filter;
pub(crate) mod lists;
pub(crate) mod needs;
pub(crate) mod objects;
pub(crate) mod opener;
mod pick;
mod summary;
pub(crate) mod texels;

pub use crate::format::channels::{ChannelInfo, ChannelKind};
pub use crate::format::header::FileId;
pub use crate::format::placement::{Placement, UpAxis};
pub use crate::format::records::{Filling, FillingCounts, HalfArc, SourceInfo};
pub use contents::{BlockContents, RootContents};
use lists::List;
pub use objects::Objects;
pub use opener::Opener;
pub use pick::Ray;
pub use summary::{ContextContents, FileSummary, LevelContents};
use texels::Texels;
pub use texels::{Scale, TexelBytes};

use std::{ops::Range, sync::Mutex};

use crate::{
    codec::{bytes::has_checksum, entropy::Tables},
    error::{Error, Result},
    format::{
        error_code::ErrorCode,
        header::Header,
        index_block::{RootEntry, Scheme},
        levels::{LevelRecord, Levels},
        overview::OverviewSection,
        sections::Part,
    },
    lattice::Lattice,
    limits::Limits,
    objects::OpenObjects,
    sorted::SortedMap,
    source::{
        Fetched,
        requests::{Before, plan_after},
    },
};

/// What a file says about one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSummary {
    /// The error that the level was built for, world units.
    pub tolerance: f64,
    /// Bound of the error with everything drawn at this level, world units.
    pub max_error: f64,
    /// Triangles with everything drawn at this level.
    pub triangle_count: u64,
    /// Bytes that this level adds to the coarser ones.
    pub page_bytes: u64,
}

/// The index of an open file: everything that is known without reading more. An [`Opener`] makes one; a [`crate::File`]
/// has one.
///
/// Programs that read bytes themselves ask an index through [`crate::select`] and [`crate::decode`]. Where an answer
/// needs bytes that are not there, the call returns [`Error::Missing`]: read the ranges, insert them into [`Fetched`],
/// call
/// [`Index::supply`], and ask again.
#[derive(Debug)]
pub struct Index {
    limits: Limits,
    header: Header,
    levels: Levels,
    /// Levels whose pages are complete: all of them unless opened as a prefix.
    whole_level_count: u8,
    tables: Tables,
    info: Option<SourceInfo>,
    overview: Option<OverviewSection>,
    placement: Option<Placement>,
    tolerances: Vec<ErrorCode>,
    /// The topmost list of clusters; those below it are known as far as they were needed.
    top: List,
    /// The bytes that were read on opening.
    head: Fetched,
    /// Offsets of the sections INDEX and PAGES.
    index_offset: u64,
    pages_offset: u64,
    /// The sections CHANNELS and TEXELS, if the file has them.
    texels: Option<Texels>,
    /// The objects, if the file has them.
    objects: Option<OpenObjects>,
    /// Why lists and index blocks that were supplied could not be parsed, by offset in INDEX. Each error is returned
    /// once; then the part may be supplied again.
    damaged: Mutex<SortedMap<u64, Error>>,
}

impl Index {
    /// Where the lattice of coordinates lies.
    pub fn lattice(&self) -> Lattice {
        self.header.lattice
    }

    /// What tells this file from others.
    pub fn id(&self) -> FileId {
        self.header.id
    }

    /// Major and minor version of the format that the file was written in.
    pub fn version(&self) -> (u16, u16) {
        self.header.version
    }

    /// How many levels can be drawn: all, or those that a prefix holds.
    pub fn level_count(&self) -> usize {
        usize::from(self.whole_level_count)
    }

    /// What the file says about a level; 0 is the coarsest.
    pub fn level(&self, level: usize) -> Option<LevelSummary> {
        let LevelRecord { tolerance, max_error, triangle_count, page_bytes, .. } = *self.levels.levels.get(level)?;
        Some(LevelSummary { tolerance, max_error, triangle_count, page_bytes })
    }

    /// What the file was made from, if it says so.
    pub fn source_info(&self) -> Option<&SourceInfo> {
        self.info.as_ref()
    }

    /// Where the surface is in the world, if the file says so.
    pub fn placement(&self) -> Option<&Placement> {
        self.placement.as_ref()
    }

    /// Number of roots.
    pub fn root_count(&self) -> u32 {
        self.top.entries().next_back().map_or(0, |last| last.sums.first_root + last.sums.root_count)
    }

    /// Number of roots that are nobody's children; they come first, and together they stand for everything.
    pub fn top_count(&self) -> u32 {
        self.top.entries().next().map_or(0, |first| first.sums.first_child)
    }

    /// Whether any root has children.
    pub fn has_tree(&self) -> bool {
        self.top_count() < self.root_count()
    }

    /// Number of arcs.
    pub fn arc_count(&self) -> u32 {
        self.top.entries().next_back().map_or(0, |last| last.sums.first_arc + last.sums.arc_count)
    }

    /// Number of corners.
    pub fn corner_count(&self) -> u32 {
        self.top.entries().next_back().map_or(0, |last| last.sums.first_corner + last.sums.corner_count)
    }

    /// Number of clusters of roots.
    pub fn cluster_count(&self) -> u32 {
        self.top.cluster_count()
    }

    /// Kind, offset and length of each section.
    pub fn sections(&self) -> Vec<(u32, u64, u64)> {
        self.header.sections.iter().map(|section| (section.kind, section.offset, section.length)).collect()
    }

    /// World box around everything; `None` for a file without roots.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let boxes = self.top.entries().map(|entry| entry.sums.bounds.map(|point| self.lattice().world(point)));
        boxes.reduce(|[low, high], [other_low, other_high]| {
            let each = |a: [f64; 3], b: [f64; 3], pick: fn(f64, f64) -> f64| [0, 1, 2].map(|k| pick(a[k], b[k]));
            [each(low, other_low, f64::min), each(high, other_high, f64::max)]
        })
    }

    /// Bound of the overview's error, world units, and its number of triangles; `None` for a file without an overview.
    pub fn overview_summary(&self) -> Option<(f64, u64)> {
        let section = self.overview.as_ref()?;
        Some((section.error.bound(&self.lattice()), u64::from(section.triangle_count)))
    }

    /// The bytes that were read on opening. Callers that fetch more add to these.
    pub fn fetched(&self) -> Fetched {
        self.head.clone()
    }

    pub(crate) fn overview(&self) -> Option<&OverviewSection> {
        self.overview.as_ref()
    }

    /// Where section PAGES begins in the file.
    pub(crate) fn pages_offset(&self) -> u64 {
        self.pages_offset
    }

    pub(crate) fn scheme(&self) -> Scheme<'_> {
        Scheme { tables: &self.tables, levels: &self.levels, tolerances: &self.tolerances, limits: &self.limits }
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    pub(crate) fn levels(&self) -> &Levels {
        &self.levels
    }

    pub(crate) fn tables(&self) -> &Tables {
        &self.tables
    }

    /// The children of a root, which follow each other.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no such root; [`Error::Format`], [`Error::Limit`].
    pub fn children(&self, root: u32) -> Result<Range<u32>> {
        self.check_root(root)?;
        let owner = self.owner(root, |cluster| cluster.first_root)?;
        let (cluster, index) = (self.cluster(owner)?, self.cluster_index(owner)?);
        let local = (root - cluster.first_root) as usize;
        let before: u32 = index.roots.iter().take(local).map(|root| root.child_count).sum();
        let first = cluster.first_child.saturating_add(before);
        Ok(first..first.saturating_add(index.roots.get(local).map_or(0, |root| root.child_count)))
    }

    /// The root that a root is a child of, if there is one.
    ///
    /// # Errors
    /// As [`Index::children`].
    pub fn parent(&self, root: u32) -> Result<Option<u32>> {
        self.check_root(root)?;
        if root < self.top_count() {
            return Ok(None);
        }
        // Clusters without children begin theirs where the next ones do: the last of these has the root.
        let owner = self.owner(root, |cluster| cluster.first_child)?;
        let (cluster, index) = (self.cluster(owner)?, self.cluster_index(owner)?);
        let mut next = cluster.first_child;
        for (number, entry) in (cluster.first_root..).zip(&index.roots) {
            next = next.saturating_add(entry.child_count);
            if root < next {
                return Ok(Some(number));
            }
        }
        Err(Error::format("a root has no parent"))
    }

    /// What the index says about a root; it has to exist.
    pub(crate) fn root_entry(&self, root: u32) -> Result<&RootEntry> {
        let owner = self.owner(root, |cluster| cluster.first_root)?;
        let local = root - self.cluster(owner)?.first_root;
        self.cluster_index(owner)?.roots.get(local as usize).ok_or_else(|| Error::format("a root does not exist"))
    }

    /// Finds parts of PAGES among the bytes that have been read, and checks them. Returns [`Error::Missing`] for all
    /// that are not there. `before` tells which index blocks had to be read for them.
    pub(crate) fn pages<'b, K: Copy + Ord>(
        &self,
        parts: impl IntoIterator<Item = (K, Part)>,
        fetched: &'b Fetched,
        location: impl Fn(K) -> String,
        before: impl FnOnce() -> Result<Before>,
    ) -> Result<SortedMap<K, &'b [u8]>> {
        checked_parts(self.pages_offset, parts, fetched, location, before)
    }
}

/// Finds parts of the section at `base` among the bytes that have been read: see [`Index::pages`].
fn checked_parts<K: Copy + Ord>(
    base: u64,
    parts: impl IntoIterator<Item = (K, Part)>,
    fetched: &Fetched,
    location: impl Fn(K) -> String,
    before: impl FnOnce() -> Result<Before>,
) -> Result<SortedMap<K, &[u8]>> {
    let (mut found, mut missing) = (SortedMap::new(), Vec::new());
    for (key, part) in parts {
        match checked_part(fetched, base, part).map_err(|error| error.at(|| location(key)))? {
            Some(bytes) => {
                found.insert(key, bytes);
            }
            None => missing.push(fetched.rest_of(absolute(base, part))),
        }
    }
    if missing.is_empty() {
        return Ok(found);
    }
    Err(Error::Missing { ranges: plan_after(before()?, missing) })
}

/// The bytes of the file that hold a part of the section at `base`.
fn absolute(base: u64, part: Part) -> Range<u64> {
    let start = base.saturating_add(part.offset);
    start..start.saturating_add(part.length)
}

/// The bytes of a part, if they have been fetched.
fn checked_part(fetched: &Fetched, base: u64, part: Part) -> Result<Option<&[u8]>> {
    match fetched.get(absolute(base, part)) {
        Some(bytes) if !bytes.is_empty() && !has_checksum(bytes, part.checksum) => {
            Err(Error::format("the checksum does not match"))
        }
        found => Ok(found),
    }
}
