//! The content of a file for a loader: pages, and units of roots that are decoded together.

use std::{collections::BTreeMap, sync::Arc};

use super::{drawn_surface::DrawnSurface, job::Content, queue::ByteSpan};
use crate::{
    decode::Decoded,
    error::{Error, Result},
    format::records::HalfArc,
    index::{
        Index,
        needs::{PartKey, Wanted, find_stream, part_of, parts_of},
    },
};

/// The roots of one stream at one level. Coarse units sort first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Unit {
    pub level: u8,
    pub cluster: u32,
    pub stream: u32,
}

/// No root.
const NONE: u32 = u32::MAX;

/// A file, with tables for questions that a session asks in every frame.
#[derive(Debug)]
pub(crate) struct FileContent {
    index: Arc<Index>,
    /// For each root where its blocks begin, and one more entry at the end.
    first_blocks: Vec<u32>,
    /// Coarse to fine.
    blocks: Vec<Unit>,
    /// For each arc the roots on its sides.
    arc_roots: Vec<[u32; 2]>,
}

impl FileContent {
    /// # Errors
    /// [`Error::Missing`] until the whole index has been supplied.
    pub fn new(index: Arc<Index>) -> Result<Self> {
        index.load_indices(0..index.cluster_count())?;
        let mut content = Self {
            first_blocks: vec![0],
            blocks: Vec::new(),
            arc_roots: vec![[NONE; 2]; index.arc_count() as usize],
            index: index.clone(),
        };
        for number in 0..index.cluster_count() {
            let (cluster, block) = (index.cluster(number)?, index.cluster_index(number)?);
            for (local, entry) in (0..).zip(&block.roots) {
                let levels = entry.blocks.iter().map(|block| block.level);
                for level in levels.filter(|&level| usize::from(level) < index.level_count()) {
                    let stream = find_stream(block, level, local)? as u32;
                    content.blocks.push(Unit { level, cluster: number, stream });
                }
                content.first_blocks.push(content.blocks.len() as u32);
                for half_arc in entry.half_arcs() {
                    let users = content.arc_roots.get_mut(half_arc.arc as usize);
                    let users = users.ok_or_else(|| Error::format("a reference leaves the file"))?;
                    let free = users.iter_mut().find(|user| **user == NONE);
                    *free.ok_or_else(|| Error::format("an arc is used more than twice"))? = cluster.first_root + local;
                }
            }
        }
        Ok(content)
    }

    pub fn index(&self) -> &Arc<Index> {
        &self.index
    }

    pub fn root_count(&self) -> u32 {
        self.first_blocks.len() as u32 - 1
    }

    /// The blocks of a root, coarse to fine; level 0 is always there. None for a root that does not exist.
    pub fn blocks(&self, root: u32) -> &[Unit] {
        let at = |root: usize| self.first_blocks.get(root).map(|&first| first as usize);
        let range = at(root as usize).zip(at(root as usize + 1));
        range.and_then(|(start, end)| self.blocks.get(start..end)).unwrap_or(&[])
    }

    /// Units of level 0.
    pub fn coarsest(&self) -> Vec<Unit> {
        let mut units: Vec<Unit> =
            (0..self.root_count()).filter_map(|root| self.blocks(root).first().copied()).collect();
        units.dedup();
        units
    }

    /// The root on the other side of a root's half-arc; the root itself where it is on both sides.
    pub fn neighbour(&self, root: u32, half_arc: HalfArc) -> Option<u32> {
        let [first, second] = *self.arc_roots.get(half_arc.arc as usize)?;
        Some(if first == root { second } else { first }).filter(|&other| other != NONE)
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
        let parts = parts_of(&self.index, &self.wanted(unit)?)?;
        Ok(parts.into_iter().filter(|(_, part)| part.length > 0).map(|(key, _)| key).collect())
    }

    fn span(&self, page: PartKey) -> ByteSpan {
        let part = part_of(&self.index, page).unwrap_or_default();
        ByteSpan { offset: self.index.pages_offset().saturating_add(part.offset), length: part.length }
    }

    fn is_sound(&self, page: PartKey, bytes: &[u8]) -> bool {
        part_of(&self.index, page).is_ok_and(|part| crc32fast::hash(bytes) == part.checksum)
    }

    fn is_pinned(&self, unit: Unit) -> bool {
        unit.level == 0
    }

    fn decode(&self, unit: Unit, pages: &[(PartKey, Arc<[u8]>)]) -> Result<Surfaces> {
        let (index, wanted) = (&*self.index, self.wanted(unit)?);
        let parts: BTreeMap<PartKey, &[u8]> = pages.iter().map(|(key, bytes)| (*key, &**bytes)).collect();
        let mut decoded = Decoded::of_parts(index, &wanted, parts)?;
        let surface = |wanted: &Wanted| {
            let entry = index.root_entry(wanted.root)?;
            let border = decoded.border(entry, wanted.level)?;
            let patch = decoded.take_patch(wanted.root, wanted.level)?;
            let surface = DrawnSurface::new(wanted.root, wanted.level, entry, &border, patch, &index.lattice());
            Ok(Arc::new(surface.map_err(|error| error.at(|| format!("root {}, level {}", wanted.root, wanted.level)))?))
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
