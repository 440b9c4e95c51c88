//! The small sections SOURCE and CLUSTERS.

use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::{unzigzag, zigzag},
    },
    error::{Error, Result},
    format::{error_code::ErrorCode, levels::Levels, records::SourceInfo},
    lattice::LatticePoint,
    limits::{Limits, within},
};

/// The most roots that a cluster may have: 32 roots of a few thousand triangles take some hundred kilobytes of pages at the finest
/// level and one kilobyte at the coarsest.
pub(crate) const MAX_CLUSTER_ROOTS: usize = 32;

/// Largest absolute box coordinate: boxes may reach beyond the lattice's 2^40.
pub(crate) const MAX_BOX: i64 = 1 << 41;

/// Section SOURCE: two u64 (triangles, vertices), two f64 (mean edge length, area), then the generator in UTF-8.
pub(crate) fn write_source(info: &SourceInfo) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(info.triangle_count.to_le_bytes());
    bytes.extend(info.vertex_count.to_le_bytes());
    bytes.extend(info.mean_edge_length.to_le_bytes());
    bytes.extend(info.area.to_le_bytes());
    bytes.extend(info.generator.as_bytes());
    bytes
}

/// Reads what [`write_source`] wrote.
pub(crate) fn parse_source(bytes: &[u8]) -> Result<SourceInfo> {
    let mut cursor = Cursor::new(bytes);
    let (triangle_count, vertex_count) = (cursor.u64()?, cursor.u64()?);
    let (mean_edge_length, area) = (cursor.f64()?, cursor.f64()?);
    let generator = String::from_utf8(cursor.bytes(cursor.left())?.to_vec())
        .map_err(|_| Error::format("the generator's name is not UTF-8"))?;
    Ok(SourceInfo { triangle_count, vertex_count, mean_edge_length, area, generator })
}

/// A part (an index block or a page): its place within its section, and its CRC-32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Part {
    pub offset: u64,
    pub length: u64,
    pub checksum: u32,
}

impl Part {
    /// Writes the length and, unless that is 0, the checksum.
    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        put_varint(bytes, self.length);
        if self.length > 0 {
            bytes.extend(self.checksum.to_le_bytes());
        }
    }

    /// Reads what [`Part::write`] wrote. The part lies at `next`, which moves to its end.
    pub(crate) fn parse(cursor: &mut Cursor<'_>, next: &mut u64, limits: &Limits) -> Result<Self> {
        let Extent { offset, length } = Extent::parse(cursor, next, limits)?;
        Ok(Self { offset, length, checksum: if length > 0 { cursor.u32()? } else { 0 } })
    }
}

impl Extent {
    /// Reads the length (varint) of an extent at `next`, which moves to its end.
    fn parse(cursor: &mut Cursor<'_>, next: &mut u64, limits: &Limits) -> Result<Self> {
        let (offset, length) = (*next, cursor.varint()?);
        within(limits.part_bytes, length, "size of an index block or of pages")?;
        *next = offset.checked_add(length).ok_or_else(|| Error::format("a part ends beyond 2^64"))?;
        Ok(Self { offset, length })
    }
}

/// A run of bytes within a section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Extent {
    pub offset: u64,
    pub length: u64,
}

/// A cluster at one level. Its index block has the sizes and checksums of the single pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    /// How many of its roots are tops, given the number of tops in the file.
    pub(crate) fn top_count(&self, of_file: u32) -> u32 {
        of_file.saturating_sub(self.first_root).min(self.root_count)
    }
}

/// Writes section CLUSTERS. In varints: root, arc, corner and cluster count; then per cluster root, arc, corner and child count,
/// the smallest box coordinates (zigzag), the box's extents, length of the index block and its CRC-32 (u32, absent if the
/// length is 0); and per level the sizes of the arc pages and of the block pages, the triangle count and, unless that is 0, the
/// largest error (u16 code). Offsets follow from the sizes: a level has the arc pages of all clusters, then their block pages.
pub(crate) fn write_clusters(clusters: &[Cluster]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let total = |count: fn(&Cluster) -> u32| clusters.iter().map(|cluster| u64::from(count(cluster))).sum();
    put_varint(&mut bytes, total(|cluster| cluster.root_count));
    put_varint(&mut bytes, total(|cluster| cluster.arc_count));
    put_varint(&mut bytes, total(|cluster| cluster.corner_count));
    put_varint(&mut bytes, clusters.len() as u64);
    for cluster in clusters {
        put_varint(&mut bytes, u64::from(cluster.root_count));
        put_varint(&mut bytes, u64::from(cluster.arc_count));
        put_varint(&mut bytes, u64::from(cluster.corner_count));
        put_varint(&mut bytes, u64::from(cluster.child_count));
        let [low, high] = cluster.bounds;
        low.iter().for_each(|&x| put_varint(&mut bytes, zigzag(x)));
        low.iter().zip(high).for_each(|(&low, high)| put_varint(&mut bytes, (high - low) as u64));
        cluster.index.write(&mut bytes);
        for level in &cluster.levels {
            put_varint(&mut bytes, level.arcs.length);
            put_varint(&mut bytes, level.blocks.length);
            put_varint(&mut bytes, level.triangle_count);
            if level.triangle_count > 0 {
                bytes.extend(level.max_error.0.to_le_bytes());
            }
        }
    }
    bytes
}

/// The fewest bytes that a cluster takes without its levels, and that one of its levels takes.
const MIN_CLUSTER_BYTES: usize = 15;
const MIN_LEVEL_BYTES: usize = 3;

/// Reads section CLUSTERS; the index blocks must tile INDEX, and the pages their levels.
pub(crate) fn parse_clusters(bytes: &[u8], levels: &Levels, index_bytes: u64, limits: &Limits) -> Result<Vec<Cluster>> {
    let mut cursor = Cursor::new(bytes);
    let id_limit = u64::from(u32::MAX - 1);
    let too_many = "there are more than 2^32 - 2 roots, arcs or corners";
    let root_count = cursor.varint_up_to(id_limit, too_many)? as u32;
    within(limits.root_count, u64::from(root_count), "number of roots")?;
    let arc_count = cursor.varint_up_to(id_limit, too_many)? as u32;
    let corner_count = cursor.varint_up_to(id_limit, too_many)? as u32;
    let cluster_count = cursor.varint()?;
    let least = MIN_CLUSTER_BYTES + levels.levels.len() * MIN_LEVEL_BYTES;
    if cluster_count > (cursor.left() / least) as u64 {
        return Err(Error::format("there are more clusters than the section has room for"));
    }
    let mut clusters: Vec<Cluster> = Vec::with_capacity(cluster_count as usize);
    let mut next = [0_u32; 3];
    let mut next_index = 0_u64;
    // For each level, where its arc pages and its block pages end so far, each counted from the first one's beginning.
    let mut ends = vec![[0_u64; 2]; levels.levels.len()];
    for _ in 0..cluster_count {
        let cluster = parse_cluster(&mut cursor, next, &mut next_index, &mut ends, limits)?;
        next = [
            next[0].checked_add(cluster.root_count),
            next[1].checked_add(cluster.arc_count),
            next[2].checked_add(cluster.corner_count),
        ]
        .map(|sum| sum.unwrap_or(u32::MAX));
        clusters.push(cluster);
    }
    cursor.finish()?;
    number_children(&mut clusters, root_count)?;
    let whole = ends.iter().map(|&[arcs, blocks]| arcs.checked_add(blocks));
    let page_bytes = levels.levels.iter().map(|level| Some(level.page_bytes));
    if next != [root_count, arc_count, corner_count] || next_index != index_bytes || !page_bytes.eq(whole) {
        return Err(Error::format("the clusters do not add up to what the file has"));
    }
    for cluster in &mut clusters {
        for (pages, (level, [arc_bytes, _])) in cluster.levels.iter_mut().zip(levels.levels.iter().zip(&ends)) {
            pages.arcs.offset += level.page_offset;
            pages.blocks.offset += level.page_offset + arc_bytes;
        }
    }
    Ok(clusters)
}

/// Gives clusters the numbers of their roots' children: those that are nobody's children come first.
pub(crate) fn number_children(clusters: &mut [Cluster], root_count: u32) -> Result<()> {
    let child_count = clusters.iter().map(|cluster| u64::from(cluster.child_count)).sum::<u64>();
    let top_count = u64::from(root_count).checked_sub(child_count).filter(|&tops| tops > 0 || root_count == 0);
    let mut next = top_count.ok_or_else(|| Error::format("every root is another's child"))? as u32;
    for cluster in clusters {
        cluster.first_child = next;
        next += cluster.child_count;
    }
    Ok(())
}

fn parse_cluster(
    cursor: &mut Cursor<'_>,
    first: [u32; 3],
    next_index: &mut u64,
    ends: &mut [[u64; 2]],
    limits: &Limits,
) -> Result<Cluster> {
    let mut cluster = Cluster {
        first_root: first[0],
        root_count: cursor.varint_up_to(MAX_CLUSTER_ROOTS as u64, "a cluster has more than 32 roots")? as u32,
        first_arc: first[1],
        arc_count: cursor.varint_up_to(u64::from(u32::MAX), "a cluster has too many arcs")? as u32,
        first_corner: first[2],
        corner_count: cursor.varint_up_to(u64::from(u32::MAX), "a cluster has too many corners")? as u32,
        child_count: cursor.varint_up_to(u64::from(u32::MAX), "a cluster has too many children")? as u32,
        ..Cluster::default()
    };
    if cluster.root_count == 0 {
        return Err(Error::format("a cluster has no root"));
    }
    let records = u64::from(cluster.arc_count) + u64::from(cluster.corner_count);
    within(limits.cluster_record_count, records, "number of arcs and corners of a cluster")?;
    for axis in 0..3 {
        cluster.bounds[0][axis] = unzigzag(cursor.varint()?);
    }
    for axis in 0..3 {
        let low = cluster.bounds[0][axis];
        let extent = cursor.varint_up_to(2 * MAX_BOX as u64, "a box is too large")? as i64;
        let high = low.checked_add(extent).filter(|&high| low >= -MAX_BOX && high <= MAX_BOX);
        cluster.bounds[1][axis] = high.ok_or_else(|| Error::format("a box leaves the lattice"))?;
    }
    cluster.index = Part::parse(cursor, next_index, limits)?;
    for [arc_end, block_end] in ends {
        let arcs = Extent::parse(cursor, arc_end, limits)?;
        let blocks = Extent::parse(cursor, block_end, limits)?;
        let triangle_count = cursor.varint()?;
        let max_error = ErrorCode(if triangle_count > 0 { cursor.u16()? } else { 0 });
        cluster.levels.push(ClusterLevel { arcs, blocks, triangle_count, max_error });
    }
    Ok(cluster)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::levels::LevelRecord;

    #[test]
    fn small_sections_survive_and_their_prefixes_are_refused() {
        let source = SourceInfo { triangle_count: 7, area: 2.5, generator: "é".into(), ..SourceInfo::default() };
        assert_eq!(parse_source(&write_source(&source)).unwrap(), source);

        let record = |page_offset| LevelRecord { page_offset, page_bytes: 300, ..LevelRecord::default() };
        let levels = Levels { levels: vec![record(0), record(300)], ..Levels::default() };
        let level = |[arc_offset, arcs]: [u64; 2], [block_offset, blocks]: [u64; 2]| ClusterLevel {
            arcs: Extent { offset: arc_offset, length: arcs },
            blocks: Extent { offset: block_offset, length: blocks },
            triangle_count: 1000,
            max_error: ErrorCode(321),
        };
        let cluster = |k: u32| Cluster {
            first_root: 32 * k,
            root_count: 32,
            first_arc: 99 * k,
            arc_count: 99,
            first_corner: 41 * k,
            corner_count: 41,
            first_child: 32 * (k + 1),
            child_count: 32 * (1 - k),
            bounds: [[-5, -6, 700], [80, -6, 1 << 40]],
            index: Part { offset: u64::from(k) * 500, length: 500, checksum: 0xdead_beef },
            levels: vec![
                level([u64::from(k) * 50, 50], [100 + u64::from(k) * 100, 100]),
                level([300, 0], [300 + u64::from(k) * 150, 150]),
            ],
        };
        let clusters = vec![cluster(0), cluster(1)];
        let bytes = write_clusters(&clusters);
        let limits = Limits::default();
        assert_eq!(parse_clusters(&bytes, &levels, 1000, &limits).unwrap(), clusters);
        assert!(parse_clusters(&bytes, &levels, 999, &limits).is_err());
        assert!((0..bytes.len()).all(|end| parse_clusters(&bytes[..end], &levels, 1000, &limits).is_err()));
        let few = Limits { root_count: 63, ..limits };
        assert!(matches!(parse_clusters(&bytes, &levels, 1000, &few), Err(Error::Limit { .. })));
    }
}
