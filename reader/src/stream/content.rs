//! The content of a file for a loader: pages, and units of roots that are decoded together. What is asked for here is
//! known of the index, or missing.

use std::{ops::Range, sync::Arc};

use super::{drawn_surface::DrawnSurface, job::Content, queue::ByteSpan};
use crate::{
    decode::Decoded,
    error::{Error, Result},
    format::{clusters::Cluster, records::MAX_LEVELS},
    index::{
        Index,
        needs::{PartKey, Wanted, corner_owners, find_needs, find_parts, find_stream, part_of},
    },
    sorted::{SortedMap, SortedSet},
};

/// The roots of one stream at one level. Coarse units sort first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Unit {
    pub level: u8,
    pub cluster: u32,
    pub stream: u32,
}

/// A file, as far as its index is known.
#[derive(Debug)]
pub(crate) struct FileContent {
    index: Arc<Index>,
    /// The coarsest unit of each top, ascending: the units that are never evicted.
    coarsest: Vec<Unit>,
    /// Whether surfaces get what smooth light needs.
    has_light: bool,
}

impl FileContent {
    /// # Errors
    /// [`Error::Missing`] until the index blocks of all tops have been supplied; [`Error::Format`].
    pub fn new(index: Arc<Index>, has_light: bool) -> Result<Self> {
        let tops = index.clusters_in(&mut |entry| entry.sums.first_root < index.top_count())?;
        index.load_indices(tops.iter().map(|entry| entry.first_cluster))?;
        let mut content = Self { coarsest: Vec::new(), index: Arc::clone(&index), has_light };
        let mut units = SortedSet::new();
        for top in 0..index.top_count() {
            let coarsest = content.find_blocks(top)?.first().copied();
            units.extend(coarsest);
        }
        content.coarsest.extend(units);
        Ok(content)
    }

    pub fn index(&self) -> &Arc<Index> {
        &self.index
    }

    pub fn root_count(&self) -> u32 {
        self.index.root_count()
    }

    /// A root's own blocks, coarse to fine: none for a root that begins at a level which a prefix lacks.
    ///
    /// # Errors
    /// [`Error::Missing`] if the root's index block is not known; [`Error::Format`].
    pub fn find_blocks(&self, root: u32) -> Result<Vec<Unit>> {
        let (cluster, index) = self.index.owner_of(root, Cluster::roots)?;
        let local = root - cluster.sums.first_root;
        let entry = index.roots.get(local as usize).ok_or_else(|| Error::format("a root does not exist"))?;
        let levels = entry.blocks.iter().map(|block| block.level);
        let levels = levels.filter(|&level| usize::from(level) < self.index.level_count());
        let unit = |level| {
            Ok(Unit { level, cluster: cluster.first_cluster, stream: find_stream(index, level, local)? as u32 })
        };
        levels.map(unit).collect()
    }

    /// [`FileContent::find_blocks`] of a root that a frame has asked for, whose index block is known; none of any
    /// other.
    pub fn blocks(&self, root: u32) -> Vec<Unit> {
        self.find_blocks(root).unwrap_or_default()
    }

    /// The coarsest unit of each top: together they draw everything.
    pub fn coarsest(&self) -> &[Unit] {
        &self.coarsest
    }

    /// The root that a root is a child of.
    pub fn parent(&self, root: u32) -> Option<u32> {
        self.index.parent(root).ok().flatten()
    }

    /// The roots above a root, the nearest first. Levels ascend from each to the next, so that there are fewer than
    /// levels.
    pub fn above(&self, root: u32) -> impl Iterator<Item = u32> + '_ {
        std::iter::successors(self.parent(root), |&root| self.parent(root)).take(MAX_LEVELS)
    }

    /// The children of a root; none while they are not known.
    pub fn children(&self, root: u32) -> Range<u32> {
        self.index.children(root).unwrap_or_default()
    }

    /// The roots that a unit holds.
    fn wanted(&self, unit: Unit) -> Result<Vec<Wanted>> {
        let (cluster, index) = (self.index.cluster(unit.cluster)?, self.index.cluster_index(unit.cluster)?);
        let stream = index.streams.get(unit.stream as usize).ok_or_else(|| Error::format("a stream does not exist"))?;
        let has_level = |local: &u32| {
            let entry = index.roots.get(*local as usize);
            entry.is_some_and(|entry| entry.blocks.iter().any(|block| block.level == unit.level))
        };
        let wanted = |local| Wanted { root: cluster.first_root + local, level: unit.level, arc_level: unit.level };
        Ok(stream.roots.clone().filter(has_level).map(wanted).collect())
    }
}

/// Surfaces of some roots, by root.
pub(crate) type Surfaces = Vec<Arc<DrawnSurface>>;

impl Content for FileContent {
    type Page = PartKey;
    type Unit = Unit;
    type Data = Surfaces;

    fn pages(&self, unit: Unit) -> Result<Vec<PartKey>> {
        let needs = find_needs(&self.index, &self.wanted(unit)?, &[])?;
        // Decoding needs these, too.
        self.index.load_indices(corner_owners(&self.index, &needs)?)?;
        let parts = find_parts(&self.index, &needs)?;
        Ok(parts.into_iter().filter(|(_, part)| part.length > 0).map(|(key, _)| key).collect())
    }

    fn span(&self, page: PartKey) -> ByteSpan {
        let part = part_of(&self.index, page).unwrap_or_default();
        ByteSpan { offset: self.index.pages_offset().saturating_add(part.offset), length: part.length }
    }

    fn is_sound(&self, page: PartKey, bytes: &[u8]) -> bool {
        part_of(&self.index, page).is_ok_and(|part| crc32fast::hash(bytes) == part.checksum)
    }

    fn supply(&self, offset: u64, bytes: Vec<u8>) {
        let mut fetched = self.index.fetched();
        fetched.insert(offset, bytes);
        self.index.supply(&fetched);
    }

    fn is_pinned(&self, unit: Unit) -> bool {
        self.coarsest.binary_search(&unit).is_ok()
    }

    fn decode(&self, unit: Unit, pages: &[(PartKey, Arc<[u8]>)], _: Option<&Surfaces>) -> Result<Surfaces> {
        let (index, wanted) = (&*self.index, self.wanted(unit)?);
        let parts: SortedMap<PartKey, &[u8]> = pages.iter().map(|(key, bytes)| (*key, &**bytes)).collect();
        let mut decoded = Decoded::of_parts(index, &wanted, parts)?;
        let surface = |wanted: &Wanted| {
            let entry = index.root_entry(wanted.root)?;
            let (loops, sides) = decoded.border_with_sides(entry, wanted.level)?;
            let patch = decoded.take_patch(wanted.root, wanted.level)?;
            let surface = DrawnSurface::new(wanted, entry, (&loops, sides), patch, (&index.lattice(), self.has_light));
            let location = || format!("root {}, level {}", wanted.root, wanted.level);
            let mut surface = surface.map_err(|error| error.at(location))?;
            if cfg!(feature = "channels") && index.objects().is_some() && entry.child_count == 0 {
                surface.find_islands();
            }
            if index.channels().is_empty() {
                surface.forget_origins();
            }
            Ok(Arc::new(surface))
        };
        wanted.iter().map(surface).collect()
    }

    fn byte_count(&self, data: &Surfaces) -> u64 {
        data.iter().map(|surface| surface.byte_count()).sum()
    }

    fn page_name(&self, page: PartKey) -> String {
        page.location()
    }

    fn unit_name(&self, unit: Unit) -> String {
        format!("blocks of level {}, cluster {}, stream {}", unit.level, unit.cluster, unit.stream)
    }
}
