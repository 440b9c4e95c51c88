//! Decoding: from a cut to the pages that it needs, and from these to triangles. Nothing here reads.
//!
//! A block needs the blocks before it in its stream; a block of a nested filling also needs that of its root's next
//! coarser level. Each needs the samples of its root's arcs, which lie in the index blocks and arc streams of the
//! clusters that own the arcs. An arc needs the corners at its ends, which lie in the index blocks of the clusters that
//! own them. All of this is found from the index, asked for at once, and decoded once, coarse to fine.

mod appearance;
mod arc_contents;
mod arcs;
mod blocks;
mod border;
mod covered;
mod cut;
mod drawing;
mod islands;
mod objects;
mod overview;
mod packing;
mod pages;
mod pick;
mod stitch;
mod textured;

/// What a surface carries: maps from patches to images, and images.
pub mod texels {
    pub use crate::codec::texels::{Image, Map, Piece, SCALES};
}

pub use crate::codec::{arc::PARAM_END, patch::Patch};
pub use appearance::{Appearance, Look};
pub use arc_contents::{ArcContents, ArcPoint, Borders, borders};
pub use border::{BorderKey, BorderVertex};
pub use cut::{RootPatch, decode_root, extract, extract_with_borders, own_bytes};
pub use drawing::{AlphaMode, DEFAULT_CUTOFF, Drawing, coverages};
pub use objects::{extract_objects, extract_objects_with_borders, object_bounds};
pub use overview::{Overview, overview};
pub use pages::PagedMesh;
#[cfg(test)]
pub(crate) use pick::meets;
pub use pick::{Pick, pick, pick_shown};
pub use stitch::Mesh;
pub use textured::{
    ChannelImage, Texture, TexturedMesh, extract_textured, extract_textured_scaled, extract_textured_with_borders,
};

pub(crate) use border::{BorderEdges, BorderSide};
pub(crate) use covered::Covered;
pub(crate) use stitch::insert_samples;

use std::collections::HashMap;

use crate::{
    codec::arc::Path,
    error::{Error, Result},
    index::{
        Index,
        needs::{Needs, PartKey, StreamPrefix, Wanted, corner_owners, find_needs, find_parts, index_blocks},
    },
    sorted::{SortedMap, SortedSet},
    source::Fetched,
};
use arcs::decode_arcs;
use blocks::{Blocks, Scratch};

/// Decoded arcs and patches.
#[derive(Debug)]
pub(crate) struct Decoded<'i> {
    index: &'i Index,
    /// For each cluster its arcs. Arcs that are not needed have no positions.
    paths: SortedMap<u32, Vec<Path>>,
    patches: SortedMap<(u32, u8), Patch>,
}

/// Decoding in progress: the arcs are decoded, and blocks follow cluster by cluster, so that not all patches need
/// memory at once.
pub(crate) struct Decoding<'i, 'b> {
    decoded: Decoded<'i>,
    /// Per cluster and level the blocks that are needed, by stream.
    prefixes: SortedMap<u32, Vec<Vec<StreamPrefix>>>,
    parts: SortedMap<PartKey, &'b [u8]>,
    /// The roots and levels of wanted blocks.
    wanted: SortedSet<(u32, u8)>,
    scratch: Scratch,
}

impl<'i, 'b> Decoding<'i, 'b> {
    /// Decodes the arcs that the wanted blocks need.
    ///
    /// # Errors
    /// [`Error::Missing`] if bytes are not there.
    pub(crate) fn new(index: &'i Index, fetched: &'b Fetched, wanted: &[Wanted]) -> Result<Self> {
        Self::with_arcs(index, fetched, wanted, &[])
    }

    /// Also decodes the arcs of some roots, up to the levels given.
    fn with_arcs(index: &'i Index, fetched: &'b Fetched, wanted: &[Wanted], roots: &[(u32, u8)]) -> Result<Self> {
        let needs = find_needs(index, wanted, roots)?;
        // Both are asked for at once.
        let blocks = corner_owners(index, &needs).and_then(|owners| index.load_indices(owners));
        let before = || Ok(index_blocks(index, &needs).unwrap_or_default());
        let parts = index.pages(find_parts(index, &needs)?, fetched, PartKey::location, before);
        let parts = match (blocks, parts) {
            (Err(Error::Missing { ranges: blocks }), Err(Error::Missing { ranges: pages })) => {
                return Err(Error::Missing { ranges: [blocks, pages].concat() });
            }
            (blocks, parts) => blocks.and(parts)?,
        };
        Self::of_needs(index, wanted, needs, parts)
    }

    fn of_needs(
        index: &'i Index,
        wanted: &[Wanted],
        needs: Needs,
        parts: SortedMap<PartKey, &'b [u8]>,
    ) -> Result<Self> {
        let part = |key| parts.get(&key).copied().unwrap_or(&[]);
        let decoded = Decoded { index, paths: decode_arcs(index, &needs, &part)?, patches: SortedMap::new() };
        let mut prefixes: SortedMap<u32, Vec<Vec<StreamPrefix>>> = SortedMap::new();
        for (level, of_level) in needs.prefixes.into_iter().enumerate() {
            for prefix in of_level {
                let levels = prefixes.or_default(prefix.cluster);
                levels.resize_with(level + 1, Vec::new);
                levels[level].push(prefix);
            }
        }
        let wanted = wanted.iter().map(|wanted| (wanted.root, wanted.level)).collect();
        Ok(Self { decoded, prefixes, parts, wanted, scratch: Scratch::default() })
    }

    /// The clusters whose blocks have to be decoded.
    pub(crate) fn clusters(&self) -> Vec<u32> {
        self.prefixes.keys().copied().collect()
    }

    /// An estimate of the wanted blocks' triangles, no more than their bytes make credible.
    pub(crate) fn triangle_estimate(&self) -> Result<usize> {
        let mut count = 0_u64;
        for &(root, level) in self.wanted.iter() {
            let entry = self.decoded.index.root_entry(root)?;
            count += entry.blocks.iter().find(|block| block.level == level).map_or(0, |b| u64::from(b.triangle_count));
        }
        // Scans have an eighth of this.
        let most = 8 * self.parts.values().map(|part| part.len() as u64).sum::<u64>();
        Ok(count.min(most) as usize)
    }

    /// The levels at which corners are drawn, `border_level` or finer: see [`Decoded::corner_levels`].
    fn corner_levels(&self, wanted: &[Wanted], border_level: u8) -> Result<HashMap<u32, u8>> {
        let level = |wanted: &Wanted| wanted.level.max(border_level);
        let entries = wanted.iter().map(|wanted| Ok((self.decoded.index.root_entry(wanted.root)?, level(wanted))));
        self.decoded.corner_levels(entries.collect::<Result<Vec<_>>>()?.into_iter())
    }

    /// Decodes the blocks of a cluster.
    pub(crate) fn decode_cluster(&mut self, cluster: u32) -> Result<&mut Decoded<'i>> {
        let prefixes = self.prefixes.remove(&cluster).unwrap_or_default();
        for (level, prefixes) in (0..).zip(prefixes) {
            let Self { decoded, parts, wanted, scratch, .. } = self;
            Blocks { level, decoded, parts, wanted, scratch }.decode(&prefixes)?;
        }
        self.scratch.forget_roots();
        Ok(&mut self.decoded)
    }

    fn finish(mut self) -> Result<Decoded<'i>> {
        for cluster in self.clusters() {
            self.decode_cluster(cluster)?;
        }
        Ok(self.decoded)
    }
}

impl<'i> Decoded<'i> {
    /// Decodes blocks.
    ///
    /// # Errors
    /// [`Error::Missing`] if bytes are not there.
    pub(crate) fn new(index: &'i Index, fetched: &Fetched, wanted: &[Wanted]) -> Result<Self> {
        Decoding::new(index, fetched, wanted)?.finish()
    }

    /// Decodes the arcs of some roots, up to the levels given.
    ///
    /// # Errors
    /// As [`Decoded::new`].
    pub(crate) fn arcs_of(index: &'i Index, fetched: &Fetched, roots: &[(u32, u8)]) -> Result<Self> {
        Decoding::with_arcs(index, fetched, &[], roots)?.finish()
    }

    /// Decodes blocks from the streams that [`crate::index::needs::parts_of`] lists, whose checksums have been
    /// compared.
    pub(crate) fn of_parts(index: &'i Index, wanted: &[Wanted], parts: SortedMap<PartKey, &[u8]>) -> Result<Self> {
        Decoding::of_needs(index, wanted, find_needs(index, wanted, &[])?, parts)?.finish()
    }

    /// Takes the patch of a wanted block.
    pub(crate) fn take_patch(&mut self, root: u32, level: u8) -> Result<Patch> {
        self.patches.remove(&(root, level)).ok_or_else(|| Error::format("a block does not exist"))
    }

    /// An arc and the corners at its ends.
    pub(crate) fn arc(&self, arc: u32) -> Result<(&Path, [u32; 2])> {
        let owner = self.index.owner(arc, |cluster| cluster.first_arc)?;
        let local = (arc - self.index.cluster(owner)?.first_arc) as usize;
        let path = self.paths.get(&owner).and_then(|paths| paths.get(local)).filter(|path| path.is_placed());
        let ends = self.index.cluster_index(owner)?.arc_ends.get(local);
        path.zip(ends.copied()).ok_or_else(|| Error::format("an arc does not exist"))
    }
}

/// Checks the counts and indices of a patch, which everything after decoding relies on.
pub(crate) fn check_patch(patch: &Patch, border_count: usize, triangle_count: u32) -> Result<()> {
    if patch.border_count as usize != border_count || patch.triangles.len() != triangle_count as usize {
        return Err(Error::format("a patch does not have the counts that the index says"));
    }
    let vertex_count = border_count + patch.interior.len();
    // Without an early exit, so that the compiler compares many at once.
    let is_beyond = |&vertex: &u32| u8::from(vertex as usize >= vertex_count);
    if patch.triangles.as_flattened().iter().fold(0, |any, vertex| any | is_beyond(vertex)) != 0 {
        return Err(Error::format("a triangle names a vertex that does not exist"));
    }
    Ok(())
}
