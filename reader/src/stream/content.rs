//! The content of a file for a loader: pages, and units of roots that are decoded together.

use std::{collections::BTreeMap, ops::Range, sync::Arc};

use super::{drawn_surface::DrawnSurface, job::Content, queue::ByteSpan};
use crate::{
    decode::Decoded,
    error::{Error, Result},
    index::{
        Index,
        needs::{PartKey, Wanted, find_stream, part_of, parts_of},
    },
    select::Node,
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
    /// The coarsest unit of each top, ascending: the units that are never evicted.
    coarsest: Vec<Unit>,
    tree: Tree,
}

/// Who is whose child; empty where nobody is anybody's.
#[derive(Debug, Default)]
struct Tree {
    /// For each root its parent, or no root.
    parents: Vec<u32>,
    /// For each root where its children begin, and one more entry at the end.
    first_children: Vec<u32>,
}

impl FileContent {
    /// # Errors
    /// [`Error::Missing`] until the whole index has been supplied; [`Error::Format`] if a root's levels do not continue its parent's.
    pub fn new(index: Arc<Index>) -> Result<Self> {
        index.load_indices(0..index.cluster_count())?;
        let (first_blocks, coarsest) = (vec![0], Vec::new());
        let mut content =
            Self { first_blocks, blocks: Vec::new(), coarsest, tree: Tree::new(&index)?, index: index.clone() };
        for number in 0..index.cluster_count() {
            let (cluster, block) = (index.cluster(number)?, index.cluster_index(number)?);
            for (local, entry) in (0..).zip(&block.roots) {
                let levels = entry.blocks.iter().map(|block| block.level);
                for level in levels.filter(|&level| usize::from(level) < index.level_count()) {
                    let stream = find_stream(block, level, local)? as u32;
                    content.blocks.push(Unit { level, cluster: number, stream });
                }
                content.first_blocks.push(content.blocks.len() as u32);
                if cluster.first_root + local < index.top_count() {
                    let coarsest = content.blocks(cluster.first_root + local).first().copied();
                    content.coarsest.extend(coarsest);
                }
            }
        }
        content.coarsest.sort_unstable();
        content.coarsest.dedup();
        Ok(content)
    }

    pub fn index(&self) -> &Arc<Index> {
        &self.index
    }

    pub fn root_count(&self) -> u32 {
        self.first_blocks.len() as u32 - 1
    }

    /// A root's own blocks, coarse to fine. None for a root that does not exist, or that begins at a level which a prefix lacks.
    pub fn blocks(&self, root: u32) -> &[Unit] {
        let at = |root: usize| self.first_blocks.get(root).map(|&first| first as usize);
        let range = at(root as usize).zip(at(root as usize + 1));
        range.and_then(|(start, end)| self.blocks.get(start..end)).unwrap_or(&[])
    }

    /// The coarsest unit of each top: together they draw everything.
    pub fn coarsest(&self) -> &[Unit] {
        &self.coarsest
    }

    /// Whether any root has children.
    pub fn has_tree(&self) -> bool {
        !self.tree.parents.is_empty()
    }

    /// The root that a root is a child of.
    pub fn parent(&self, root: u32) -> Option<u32> {
        self.tree.parents.get(root as usize).copied().filter(|&parent| parent != NONE)
    }

    /// The children of a root.
    pub fn children(&self, root: u32) -> Range<u32> {
        let at = |root: usize| self.tree.first_children.get(root).copied();
        at(root as usize).zip(at(root as usize + 1)).map_or(0..0, |(start, end)| start..end)
    }

    /// Checks that none of these roots, which are sorted, is above another.
    ///
    /// # Errors
    /// [`Error::Query`] if one is.
    pub fn check_antichain(&self, nodes: &[Node]) -> Result<()> {
        let mut above: Vec<u32> = nodes.iter().map(|node| node.root).collect();
        loop {
            // Siblings follow each other, and so do the children of parents that do: these are sorted too.
            above = above.into_iter().filter_map(|root| self.parent(root)).collect();
            above.dedup();
            if above.is_empty() {
                return Ok(());
            }
            let mut nodes = nodes.iter().peekable();
            for &root in &above {
                while nodes.next_if(|node| node.root < root).is_some() {}
                if nodes.peek().is_some_and(|node| node.root == root) {
                    return Err(Error::Query { what: format!("root {root} and a root below it are both in the cut") });
                }
            }
        }
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

impl Tree {
    /// # Errors
    /// As [`FileContent::new`].
    fn new(index: &Index) -> Result<Self> {
        let mut tree = Self::default();
        if !index.has_tree() {
            return Ok(tree);
        }
        tree.parents.resize(index.top_count() as usize, NONE);
        let mut finest_levels: Vec<u8> = Vec::new();
        for number in 0..index.cluster_count() {
            let first_root = index.cluster(number)?.first_root;
            for (root, entry) in (first_root..).zip(&index.cluster_index(number)?.roots) {
                let [coarsest, finest] = entry.end_levels();
                // Parents come before their children. Levels ascend from one to the next, so no branch is longer than there are levels.
                let parent = tree.parents.get(root as usize).copied().filter(|&parent| parent != NONE);
                let above = parent.and_then(|parent| finest_levels.get(parent as usize));
                if above.is_some_and(|&above| above.checked_add(1) != Some(coarsest)) {
                    let location = || format!("root {root}");
                    return Err(Error::format("a root's levels do not continue its parent's").at(location));
                }
                finest_levels.push(finest);
                tree.first_children.push(tree.parents.len() as u32);
                tree.parents.extend(std::iter::repeat_n(root, entry.child_count as usize));
            }
        }
        tree.first_children.push(tree.parents.len() as u32);
        Ok(tree)
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
        self.coarsest.binary_search(&unit).is_ok()
    }

    fn decode(&self, unit: Unit, pages: &[(PartKey, Arc<[u8]>)]) -> Result<Surfaces> {
        let (index, wanted) = (&*self.index, self.wanted(unit)?);
        let parts: BTreeMap<PartKey, &[u8]> = pages.iter().map(|(key, bytes)| (*key, &**bytes)).collect();
        let mut decoded = Decoded::of_parts(index, &wanted, parts)?;
        let surface = |wanted: &Wanted| {
            let entry = index.root_entry(wanted.root)?;
            let (loops, sides) = decoded.border_with_sides(entry, wanted.level)?;
            let patch = decoded.take_patch(wanted.root, wanted.level)?;
            let surface = DrawnSurface::new(wanted, entry, (&loops, sides), patch, &index.lattice());
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
