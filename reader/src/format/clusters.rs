//! Clusters, and the entries of cluster lists that stand for them (SPEC.md, "Section CLUSTERS").

use std::ops::Range;

use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::{unzigzag, zigzag},
    },
    error::{Error, Result},
    format::{
        error_code::ErrorCode,
        sections::{Extent, Part},
    },
    lattice::LatticePoint,
    limits::{Limits, within},
};

/// The most roots that a cluster may have: 32 roots of a few thousand triangles take some hundred kilobytes of pages at
/// the finest level and one kilobyte at the coarsest.
pub(crate) const MAX_CLUSTER_ROOTS: usize = 32;

/// The most lists that may lie one below another. Lists of 64 entries need six for 2^32 - 2 clusters.
pub(crate) const MAX_HEIGHT: u8 = 8;

/// Largest absolute box coordinate: boxes may reach beyond the lattice's 2^40.
pub(crate) const MAX_BOX: i64 = 1 << 41;

/// A cluster at one level. Its index block has the sizes and checksums of the single pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct ClusterLevel {
    /// The arc pages; empty where the index block holds the samples.
    pub arcs: Extent,
    /// The block pages.
    pub blocks: Extent,
    /// Triangles of the cluster's roots where everything is drawn at this level.
    pub triangle_count: u64,
    /// The largest error of the cluster's roots then.
    pub max_error: ErrorCode,
}

/// Consecutive roots, and the arcs and corners that they are the first to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Cluster {
    pub first_root: u32,
    pub root_count: u32,
    pub first_arc: u32,
    pub arc_count: u32,
    pub first_corner: u32,
    pub corner_count: u32,
    /// The roots' children follow each other, from this number on.
    pub first_child: u32,
    pub child_count: u32,
    /// Smallest and largest coordinates of the roots' boxes.
    pub bounds: [LatticePoint; 2],
    /// The index block, within the INDEX section.
    pub index: Part,
    /// Pages, within the PAGES section.
    pub levels: Vec<ClusterLevel>,
}

impl Cluster {
    /// Its roots.
    pub(crate) fn roots(&self) -> Range<u32> {
        self.first_root..self.first_root.saturating_add(self.root_count)
    }

    /// Its arcs.
    pub(crate) fn arcs(&self) -> Range<u32> {
        self.first_arc..self.first_arc.saturating_add(self.arc_count)
    }

    /// Its corners.
    pub(crate) fn corners(&self) -> Range<u32> {
        self.first_corner..self.first_corner.saturating_add(self.corner_count)
    }

    /// How many of its roots are tops, given the number of tops in the file.
    pub(crate) fn top_count(&self, of_file: u32) -> u32 {
        of_file.saturating_sub(self.first_root).min(self.root_count)
    }
}

/// An entry of a cluster list: a cluster, or a list of further entries.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Entry {
    /// How many lists lie one below another here; 0 for a cluster.
    pub height: u8,
    pub first_cluster: u32,
    pub cluster_count: u32,
    /// The cluster. For a list: the sums, the common box and the largest errors of its clusters, and its own bytes as
    /// the part.
    pub sums: Cluster,
    /// The bytes of INDEX that follow the part and belong to the list's entries.
    pub below: u64,
}

impl Entry {
    pub(crate) fn of_cluster(number: u32, cluster: Cluster) -> Self {
        Self { height: 0, first_cluster: number, cluster_count: 1, sums: cluster, below: 0 }
    }

    /// The entry for a list of these entries, at least one. Its part is unknown yet. None if a sum is too large.
    pub(crate) fn over(entries: &[Self]) -> Option<Self> {
        let (first, rest) = entries.split_first()?;
        let mut over = Self { height: 0, below: 0, ..first.clone() };
        over.sums.index = Part::default();
        for entry in rest {
            let (sums, more) = (&mut over.sums, &entry.sums);
            over.cluster_count = over.cluster_count.checked_add(entry.cluster_count)?;
            sums.root_count = sums.root_count.checked_add(more.root_count)?;
            sums.arc_count = sums.arc_count.checked_add(more.arc_count)?;
            sums.corner_count = sums.corner_count.checked_add(more.corner_count)?;
            sums.child_count = sums.child_count.checked_add(more.child_count)?;
            for axis in 0..3 {
                sums.bounds[0][axis] = sums.bounds[0][axis].min(more.bounds[0][axis]);
                sums.bounds[1][axis] = sums.bounds[1][axis].max(more.bounds[1][axis]);
            }
            for (sum, more) in sums.levels.iter_mut().zip(&more.levels) {
                sum.arcs.length = sum.arcs.length.checked_add(more.arcs.length)?;
                sum.blocks.length = sum.blocks.length.checked_add(more.blocks.length)?;
                sum.triangle_count = sum.triangle_count.checked_add(more.triangle_count)?;
                sum.max_error = sum.max_error.max(more.max_error);
            }
        }
        for entry in entries {
            over.height = over.height.max(entry.height.checked_add(1)?);
            over.below = over.below.checked_add(entry.index_bytes()?)?;
        }
        Some(over)
    }

    /// The bytes of INDEX that it takes, with everything below it.
    pub(crate) fn index_bytes(&self) -> Option<u64> {
        self.sums.index.length.checked_add(self.below)
    }

    /// Writes the entry, in varints: for a list a zero, its height and its number of clusters; root, arc, corner and
    /// child count; the smallest box coordinates (zigzag) and the box's extents; length of the index block or list and
    /// its CRC-32 (u32, absent if the length is 0); for a list the bytes of everything below it; and per level the
    /// sizes of the arc pages and of the block pages, the triangle count and, unless that is 0, the largest error (u16
    /// code).
    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        let sums = &self.sums;
        if self.height > 0 {
            [0, u64::from(self.height), u64::from(self.cluster_count)].into_iter().for_each(|x| put_varint(bytes, x));
        }
        let counts = [sums.root_count, sums.arc_count, sums.corner_count, sums.child_count];
        counts.into_iter().for_each(|count| put_varint(bytes, u64::from(count)));
        let [low, high] = sums.bounds;
        low.iter().for_each(|&x| put_varint(bytes, zigzag(x)));
        low.iter().zip(high).for_each(|(&low, high)| put_varint(bytes, (high - low) as u64));
        sums.index.write(bytes);
        if self.height > 0 {
            put_varint(bytes, self.below);
        }
        for level in &sums.levels {
            put_varint(bytes, level.arcs.length);
            put_varint(bytes, level.blocks.length);
            put_varint(bytes, level.triangle_count);
            if level.triangle_count > 0 {
                bytes.extend(level.max_error.0.to_le_bytes());
            }
        }
    }

    /// Reads what [`Entry::write`] wrote. The entry begins at `place`, which moves to its end.
    pub(crate) fn parse(cursor: &mut Cursor<'_>, place: &mut Place, limits: &Limits) -> Result<Self> {
        let many = u64::from(u32::MAX);
        let mut entry = Self { cluster_count: 1, first_cluster: place.cluster, ..Self::default() };
        let mut root_count = cursor.varint_up_to(MAX_CLUSTER_ROOTS as u64, "a cluster has more than 32 roots")?;
        if root_count == 0 {
            let height = cursor.varint_up_to(MAX_HEIGHT.into(), "more than 8 lists lie one below another")?;
            if height == 0 {
                return Err(Error::format("a cluster has no root, and is no list"));
            }
            entry.height = height as u8;
            entry.cluster_count = cursor.varint_up_to(many, "a list has too many clusters")? as u32;
            root_count = cursor.varint_up_to(many, "a list has too many roots")?;
        }
        let is_list = entry.height > 0;
        if root_count == 0 || entry.cluster_count == 0 {
            return Err(Error::format("a cluster has no root, or a list no cluster"));
        }
        let sums = &mut entry.sums;
        (sums.first_root, sums.root_count) = (place.root, root_count as u32);
        sums.first_arc = place.arc;
        sums.arc_count = cursor.varint_up_to(many, "a cluster has too many arcs")? as u32;
        sums.first_corner = place.corner;
        sums.corner_count = cursor.varint_up_to(many, "a cluster has too many corners")? as u32;
        sums.first_child = place.child;
        sums.child_count = cursor.varint_up_to(many, "a cluster has too many children")? as u32;
        if !is_list {
            let records = u64::from(sums.arc_count) + u64::from(sums.corner_count);
            within(limits.cluster_record_count, records, "number of arcs and corners of a cluster")?;
        }
        sums.bounds = parse_box(cursor)?;
        sums.index = Part::parse(cursor, &mut place.index, limits)?;
        if is_list {
            entry.below = cursor.varint()?;
            place.index = place.index.checked_add(entry.below).ok_or_else(too_large)?;
        }
        for [arc_end, block_end] in &mut place.pages {
            let mut extent = |next: &mut u64| match is_list {
                true => {
                    let (offset, length) = (*next, cursor.varint()?);
                    *next = offset.checked_add(length).ok_or_else(too_large)?;
                    Ok(Extent { offset, length })
                }
                false => Extent::parse(cursor, next, limits),
            };
            let (arcs, blocks) = (extent(arc_end)?, extent(block_end)?);
            let triangle_count = cursor.varint()?;
            let max_error = ErrorCode(if triangle_count > 0 { cursor.u16()? } else { 0 });
            sums.levels.push(ClusterLevel { arcs, blocks, triangle_count, max_error });
        }
        let counts = [
            (&mut place.cluster, entry.cluster_count),
            (&mut place.root, sums.root_count),
            (&mut place.arc, sums.arc_count),
            (&mut place.corner, sums.corner_count),
            (&mut place.child, sums.child_count),
        ];
        for (next, count) in counts {
            *next = next.checked_add(count).ok_or_else(too_large)?;
        }
        Ok(entry)
    }
}

fn too_large() -> Error {
    Error::format("the sums over clusters are too large")
}

fn parse_box(cursor: &mut Cursor<'_>) -> Result<[LatticePoint; 2]> {
    let mut bounds = [[0; 3]; 2];
    for x in &mut bounds[0] {
        *x = unzigzag(cursor.varint()?);
    }
    for axis in 0..3 {
        let low = bounds[0][axis];
        let extent = cursor.varint_up_to(2 * MAX_BOX as u64, "a box is too large")? as i64;
        let high = low.checked_add(extent).filter(|&high| low >= -MAX_BOX && high <= MAX_BOX);
        bounds[1][axis] = high.ok_or_else(|| Error::format("a box leaves the lattice"))?;
    }
    Ok(bounds)
}

/// Where the next entry begins: all of its first numbers and offsets.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    pub cluster: u32,
    pub root: u32,
    pub arc: u32,
    pub corner: u32,
    pub child: u32,
    /// Within INDEX.
    pub index: u64,
    /// For each level where the next arc pages and the next block pages begin, within PAGES.
    pub pages: Vec<[u64; 2]>,
}

impl Place {
    /// Where the first entry of a list begins.
    pub(crate) fn within(list: &Entry) -> Self {
        let Entry { first_cluster, sums, .. } = list;
        Self {
            cluster: *first_cluster,
            root: sums.first_root,
            arc: sums.first_arc,
            corner: sums.first_corner,
            child: sums.first_child,
            index: sums.index.offset.saturating_add(sums.index.length),
            pages: sums.levels.iter().map(|level| [level.arcs.offset, level.blocks.offset]).collect(),
        }
    }
}
