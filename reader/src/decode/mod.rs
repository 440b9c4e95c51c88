//! Decoding: from the blocks that are wanted to the pages they need, and from these to patches.
//!
//! A block needs the blocks before it in its stream, a grid's block also that of the grid's next coarser level; each needs
//! the samples of its root's arcs, which lie in the index blocks and arc streams of the clusters that own the arcs; and an arc
//! needs the corners at its ends, which lie in the index blocks of the clusters that own these. Everything is found from the
//! index, asked for at once, and decoded once, coarse to fine. Nothing here reads.

mod blocks;
pub(crate) mod contents;
pub(crate) mod overview;
pub(crate) mod stitch;

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    codec::{
        arc::{HalfPath, PARAM_END, Path},
        filling::RootBorder,
        patch::{LatticePoint, Patch},
    },
    error::{Error, Result},
    format::index_block::RootEntry,
    index::resident::Index,
    source::fetched::Fetched,
};

use crate::index::needs::{GroupNeed, Needs, Run, corner_owners, find_needs, find_parts, index_blocks, raise};
pub(crate) use crate::index::needs::{PartKey, Wanted, find_stream, own_bytes, part_of, parts_of, parts_of_block};
use blocks::{Blocks, Scratch};

/// Which vertex of the whole surface a border vertex is; equal for all roots that touch it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BorderKey {
    /// A corner.
    Corner(u32),
    /// A sample of an arc.
    Sample {
        /// The arc.
        arc: u32,
        /// The sample's parameter in 1/65536.
        param: u32,
    },
}

/// A border vertex of a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BorderVertex {
    /// Which vertex it is.
    pub key: BorderKey,
    /// Where it is.
    pub position: LatticePoint,
}

/// Arcs and patches.
#[derive(Debug)]
pub(crate) struct Decoded<'i> {
    index: &'i Index,
    /// Per cluster its arcs; those that are not needed have no positions.
    paths: BTreeMap<u32, Vec<Path>>,
    patches: BTreeMap<(u32, u8), Patch>,
}

/// Decoding under way: arcs are there, blocks follow cluster by cluster, so that not all patches need memory at once.
pub(crate) struct Decoding<'i, 'b> {
    decoded: Decoded<'i>,
    /// Per cluster and level the runs that are needed.
    runs: BTreeMap<u32, Vec<Vec<Run>>>,
    parts: BTreeMap<PartKey, &'b [u8]>,
    /// Root and level.
    wanted: BTreeSet<(u32, u8)>,
    scratch: Scratch,
}

impl<'i, 'b> Decoding<'i, 'b> {
    /// Decodes the arcs that blocks need from what has been read.
    ///
    /// # Errors
    /// [`Error::Missing`] where that does not suffice.
    pub(crate) fn new(index: &'i Index, fetched: &'b Fetched, wanted: &[Wanted]) -> Result<Self> {
        let needs = find_needs(index, wanted, &[])?;
        // Asked for at once.
        let blocks = index.load_indices(corner_owners(index, &needs)?);
        let parts = index.pages(find_parts(index, &needs)?, fetched, PartKey::place, || index_blocks(index, &needs));
        let parts = match (blocks, parts) {
            (Err(Error::Missing { ranges: blocks }), Err(Error::Missing { ranges: pages })) => {
                return Err(Error::Missing { ranges: [blocks, pages].concat() });
            }
            (blocks, parts) => blocks.and(parts)?,
        };
        Self::of_needs(index, wanted, needs, parts)
    }

    fn of_needs(index: &'i Index, wanted: &[Wanted], needs: Needs, parts: BTreeMap<PartKey, &'b [u8]>) -> Result<Self> {
        let part = |key| parts.get(&key).copied().unwrap_or(&[]);
        let decoded = Decoded { index, paths: decode_arcs(index, &needs, &part)?, patches: BTreeMap::new() };
        let mut runs: BTreeMap<u32, Vec<Vec<Run>>> = BTreeMap::new();
        for (level, level_runs) in needs.runs.into_iter().enumerate() {
            for run in level_runs {
                let levels = runs.entry(run.cluster).or_default();
                levels.resize_with(level + 1, Vec::new);
                levels[level].push(run);
            }
        }
        let wanted = wanted.iter().map(|wanted| (wanted.root, wanted.level)).collect();
        Ok(Self { decoded, runs, parts, wanted, scratch: Scratch::default() })
    }

    /// The clusters that have blocks to be decoded.
    pub(crate) fn clusters(&self) -> Vec<u32> {
        self.runs.keys().copied().collect()
    }

    /// About how many triangles the wanted blocks have; no more than their bytes make credible.
    pub(crate) fn triangle_estimate(&self) -> Result<usize> {
        let mut count = 0_u64;
        for &(root, level) in &self.wanted {
            let entry = self.decoded.index.root_entry(root)?;
            count += entry.blocks.iter().find(|block| block.level == level).map_or(0, |b| u64::from(b.triangle_count));
        }
        // Eight times what scans have.
        let most = 8 * self.parts.values().map(|part| part.len() as u64).sum::<u64>();
        Ok(count.min(most) as usize)
    }

    /// Decodes the blocks of a cluster and returns where they are.
    pub(crate) fn decode_cluster(&mut self, cluster: u32) -> Result<&mut Decoded<'i>> {
        let runs = self.runs.remove(&cluster).unwrap_or_default();
        for (level, runs) in (0..).zip(runs) {
            let Self { decoded, parts, wanted, scratch, .. } = self;
            Blocks { level, decoded, parts, wanted, scratch }.decode(&runs)?;
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
    /// Decodes blocks from what has been read.
    ///
    /// # Errors
    /// [`Error::Missing`] where that does not suffice.
    pub(crate) fn new(index: &'i Index, fetched: &Fetched, wanted: &[Wanted]) -> Result<Self> {
        Decoding::new(index, fetched, wanted)?.finish()
    }

    /// Decodes blocks from the streams that [`parts_of`] says; their checksums have been looked at.
    pub(crate) fn of_parts(index: &'i Index, wanted: &[Wanted], parts: BTreeMap<PartKey, &[u8]>) -> Result<Self> {
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
        let ends = self.index.index(owner)?.arc_ends.get(local);
        path.zip(ends.copied()).ok_or_else(|| Error::format("an arc does not exist"))
    }

    /// The border vertices of a root at a level, loop after loop.
    pub(crate) fn border(&self, root: &RootEntry, level: u8) -> Result<Vec<Vec<BorderVertex>>> {
        root.loops.iter().map(|half_arcs| self.loop_border(half_arcs, level)).collect()
    }

    /// The half-arcs around a root, for its fillings.
    fn root_border(&self, root: &RootEntry, level: u8) -> Result<RootBorder<'_>> {
        let half_paths = |half_arcs: &Vec<crate::HalfArc>| {
            let mut corners = Vec::with_capacity(half_arcs.len());
            let mut half_paths = Vec::with_capacity(half_arcs.len());
            for &crate::HalfArc { arc, reversed } in half_arcs {
                let (path, mut ends) = self.arc(arc)?;
                if reversed {
                    ends.reverse();
                }
                corners.push(ends);
                half_paths.push(HalfPath { path, reversed });
            }
            check_cycle(&corners)?;
            Ok(half_paths)
        };
        Ok(RootBorder { loops: root.loops.iter().map(half_paths).collect::<Result<_>>()?, level })
    }

    fn loop_border(&self, half_arcs: &[crate::HalfArc], level: u8) -> Result<Vec<BorderVertex>> {
        let mut border = Vec::new();
        let mut corners = Vec::with_capacity(half_arcs.len());
        for &crate::HalfArc { arc, reversed } in half_arcs {
            let (path, mut ends) = self.arc(arc)?;
            if reversed {
                ends.reverse();
            }
            HalfPath { path, reversed }.walk(level, |param, position| {
                let key = match param {
                    0 => BorderKey::Corner(ends[0]),
                    _ => BorderKey::Sample { arc, param: if reversed { PARAM_END - param } else { param } },
                };
                border.push(BorderVertex { key, position });
            });
            corners.push(ends);
        }
        check_cycle(&corners)?;
        Ok(border)
    }
}

/// Checks that each half-arc of a loop, given by its corners, ends where the next one begins.
fn check_cycle(corners: &[[u32; 2]]) -> Result<()> {
    let next = corners.iter().cycle().skip(1);
    if corners.iter().zip(next).any(|(here, next)| here[1] != next[0]) {
        return Err(Error::format("a half-arc does not end where the next one begins"));
    }
    Ok(())
}

/// Checks what everything after decoding relies on.
pub(crate) fn check_patch(patch: &Patch, border_count: usize, triangle_count: u32) -> Result<()> {
    if patch.border_count as usize != border_count || patch.triangles.len() != triangle_count as usize {
        return Err(Error::format("a patch has other counts than its index says"));
    }
    let vertex_count = border_count + patch.interior.len();
    // All are looked at, so that many can be at once and no branch waits for any.
    let is_beyond = |&vertex: &u32| u8::from(vertex as usize >= vertex_count);
    if patch.triangles.as_flattened().iter().fold(0, |any, vertex| any | is_beyond(vertex)) != 0 {
        return Err(Error::format("a triangle names a vertex that does not exist"));
    }
    Ok(())
}

/// Decodes the groups of arcs that are needed.
fn decode_arcs<'b>(
    index: &Index,
    needs: &Needs,
    part: &dyn Fn(PartKey) -> &'b [u8],
) -> Result<BTreeMap<u32, Vec<Path>>> {
    let mut paths = place_arcs(index, needs)?;
    let scheme = index.scheme();
    let mut finest: BTreeMap<u32, u8> = BTreeMap::new();
    for (&(cluster, _), need) in &needs.groups {
        raise(&mut finest, cluster, need.finest);
    }
    for (&cluster, &finest) in &finest {
        let Some(paths) = paths.get_mut(&cluster) else { continue };
        let result = index.index(cluster)?.place_arcs(&scheme, paths, finest);
        result.map_err(|error| error.at(|| format!("arcs of the index block of cluster {cluster}")))?;
    }
    for (&(cluster, group), need) in &needs.groups {
        let Some(paths) = paths.get_mut(&cluster) else { continue };
        let cluster_index = index.index(cluster)?;
        for level in scheme.levels.index_arc_levels..=need.finest {
            let key = PartKey::Arcs { level, cluster, group };
            let result = cluster_index.decode_group(&scheme, paths, (level, group, need.last), part(key));
            result.map_err(|error| error.at(|| key.place()))?;
        }
    }
    Ok(paths)
}

/// The arcs of all clusters of which any arc is needed, without samples. Those that are needed get the positions of their
/// ends; the others need none, and so no index block that has these.
fn place_arcs(index: &Index, needs: &Needs) -> Result<BTreeMap<u32, Vec<Path>>> {
    let mut ends: Vec<(u32, u32, [u32; 2])> = Vec::with_capacity(needs.arcs.len());
    index.load_indices(corner_owners(index, needs)?)?;
    for &arc in needs.arcs.keys() {
        let owner = index.owner(arc, |cluster| cluster.first_arc)?;
        let local = arc - index.cluster(owner)?.first_arc;
        let corners = index.index(owner)?.arc_ends.get(local as usize).copied();
        let corners = corners.ok_or_else(|| Error::format("an arc does not exist"))?;
        ends.push((owner, local, corners));
    }
    let index_arc_levels = index.levels().index_arc_levels;
    let corner = |id: u32| -> Result<LatticePoint> {
        let owner = index.owner(id, |cluster| cluster.first_corner)?;
        let local = (id - index.cluster(owner)?.first_corner) as usize;
        index.index(owner)?.corners.get(local).copied().ok_or_else(|| Error::format("a corner does not exist"))
    };
    let mut paths: BTreeMap<u32, Vec<Path>> = BTreeMap::new();
    for (owner, local, corners) in ends {
        let arc_count = index.index(owner)?.arc_ends.len();
        let paths = paths.entry(owner).or_insert_with(|| vec![Path::absent(); arc_count]);
        paths[local as usize] = Path::new([corner(corners[0])?, corner(corners[1])?]);
    }
    // What lies before them in their groups' streams.
    for (&(owner, group), &GroupNeed { finest, last }) in &needs.groups {
        let (Some(paths), index) = (paths.get_mut(&owner), index.index(owner)?) else { continue };
        for local in index.group(group).start..last + 1 {
            let Some(path) = paths.get_mut(local as usize) else { continue };
            if path.is_absent() && finest >= index_arc_levels {
                *path = Path::skipped();
            }
            if !path.is_absent() {
                path.reserve(index.sample_count(local, finest));
            }
        }
    }
    Ok(paths)
}
