//! Which streams a set of blocks needs: streams of blocks, and the arc runs around them.

use crate::{
    error::{Error, Result},
    format::{clusters::Cluster, index_block::ClusterIndex, sections::Part},
    index::Index,
    sorted::{SortedMap, SortedSet},
    source::requests::Before,
};

/// A block to decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub root: u32,
    /// A level that the root has.
    pub level: u8,
    /// The finest level wanted of the root's arcs; at least `level`.
    pub arc_level: u8,
}

/// A stream in PAGES.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PartKey {
    /// Samples of an arc run.
    Arcs { level: u8, cluster: u32, run: u32 },
    /// A stream of blocks, by its index in the cluster's.
    Blocks { level: u8, cluster: u32, stream: usize },
}

impl PartKey {
    pub(crate) fn location(self) -> String {
        match self {
            Self::Arcs { level, cluster, run } => format!("arcs of level {level}, cluster {cluster}, run {run}"),
            Self::Blocks { level, cluster, .. } => format!("blocks of level {level}, cluster {cluster}"),
        }
    }
}

/// The beginning of a stream of blocks, up to the last block that is needed.
#[derive(Clone, Debug)]
pub(crate) struct StreamPrefix {
    pub(crate) cluster: u32,
    /// Index in the cluster's streams.
    pub(crate) stream: usize,
    /// The last root that is needed, counted from the cluster's first.
    pub(crate) last: u32,
}

/// The part of an arc run that is needed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArcRunNeed {
    pub(crate) finest: u8,
    /// The last arc that is needed, counted from the cluster's first. Decoding stops after it.
    pub(crate) last: u32,
}

/// Everything that has to be read and decoded.
#[derive(Debug, Default)]
pub(crate) struct Needs {
    /// Per level, by cluster and stream.
    pub(crate) prefixes: Vec<Vec<StreamPrefix>>,
    /// Per arc the finest level needed.
    pub(crate) arcs: SortedMap<u32, u8>,
    /// Arc runs, by cluster and number in it.
    pub(crate) arc_runs: SortedMap<(u32, u32), ArcRunNeed>,
}

/// Finds what the wanted blocks need. `near` names roots whose arcs are needed too, up to the levels given.
pub(crate) fn find_needs(file: &Index, wanted: &[Wanted], near: &[(u32, u8)]) -> Result<Needs> {
    let mut needs = Needs { prefixes: vec![Vec::new(); file.level_count()], ..Needs::default() };
    let mut roots = vec![SortedSet::new(); file.level_count()];
    let mut root_arcs: SortedMap<u32, u8> = near.iter().copied().collect();
    for wanted in wanted {
        let level = roots.get_mut(usize::from(wanted.level.max(wanted.arc_level)));
        level.ok_or_else(|| Error::format("a level does not exist"))?;
        roots[usize::from(wanted.level)].insert(wanted.root);
        raise(&mut root_arcs, wanted.root, wanted.arc_level);
    }
    for level in (0..file.level_count()).rev() {
        let mut last_roots: SortedMap<(u32, usize), u32> = SortedMap::new();
        file.load_indices(file.owners(roots[level].iter().copied(), Cluster::roots)?)?;
        for &root in roots[level].iter() {
            let owner = file.owner(root, |cluster| cluster.first_root)?;
            let (cluster, index) = (file.cluster(owner)?, file.cluster_index(owner)?);
            let stream = find_stream(index, level as u8, root - cluster.first_root)?;
            // Roots ascend, so the last one counts.
            last_roots.insert((owner, stream), root - cluster.first_root);
        }
        for ((owner, stream), last) in last_roots {
            let (cluster, index) = (file.cluster(owner)?, file.cluster_index(owner)?);
            for local in index.streams[stream].roots.start..=last {
                let entry = &index.roots[local as usize];
                let block = entry.block_at(level as u8);
                if usize::from(entry.blocks[block].level) != level {
                    continue;
                }
                raise(&mut root_arcs, cluster.first_root + local, level as u8);
                if entry.filling.is_nested() && block > 0 {
                    roots[usize::from(entry.blocks[block - 1].level)].insert(cluster.first_root + local);
                }
            }
            needs.prefixes[level].push(StreamPrefix { cluster: owner, stream, last });
        }
    }
    file.load_indices(file.owners(root_arcs.keys().copied(), Cluster::roots)?)?;
    for (root, level) in root_arcs {
        let owner = file.owner(root, |cluster| cluster.first_root)?;
        let entry = &file.cluster_index(owner)?.roots[(root - file.cluster(owner)?.first_root) as usize];
        for half_arc in entry.half_arcs() {
            raise(&mut needs.arcs, half_arc.arc, level);
        }
    }
    file.load_indices(file.owners(needs.arcs.keys().copied(), Cluster::arcs)?)?;
    for (&arc, &level) in needs.arcs.iter() {
        let number = file.owner(arc, |cluster| cluster.first_arc)?;
        let last = arc - file.cluster(number)?.first_arc;
        let run = file.cluster_index(number)?.arc_run_of(last)?;
        // Arcs ascend, so the last one counts.
        let need = needs.arc_runs.or_insert_with((number, run), || ArcRunNeed { finest: level, last });
        *need = ArcRunNeed { finest: level.max(need.finest), last };
    }
    Ok(needs)
}

/// The streams that the wanted blocks are decoded from.
#[cfg(test)]
pub(crate) fn parts_of(index: &Index, wanted: &[Wanted]) -> Result<Vec<(PartKey, Part)>> {
    find_parts(index, &find_needs(index, wanted, &[])?)
}

/// The streams that one block needs, and those that the arcs of roots near it need up to its level.
pub(crate) fn parts_of_block(index: &Index, wanted: Wanted, near: &SortedSet<u32>) -> Result<Vec<Part>> {
    let near: Vec<(u32, u8)> = near.iter().map(|&root| (root, wanted.level)).collect();
    let needs = find_needs(index, &[wanted], &near)?;
    Ok(find_parts(index, &needs)?.into_iter().map(|(_, part)| part).collect())
}

/// Sizes of the index blocks and streams that are needed.
pub(crate) fn own_bytes(index: &Index, wanted: &[Wanted]) -> Result<u64> {
    let needs = find_needs(index, wanted, &[])?;
    let parts: SortedMap<PartKey, Part> = find_parts(index, &needs)?.into_iter().collect();
    Ok(index_blocks(index, &needs)?.bytes + parts.values().map(|part| part.length).sum::<u64>())
}

/// The index blocks that are needed.
pub(crate) fn index_blocks(index: &Index, needs: &Needs) -> Result<Before> {
    let mut clusters = corner_owners(index, needs)?;
    clusters.extend(needs.arc_runs.keys().map(|&(cluster, _)| cluster));
    clusters.extend(needs.prefixes.iter().flatten().map(|prefix| prefix.cluster));
    clusters.sort_unstable();
    clusters.dedup();
    let lengths = clusters.iter().map(|&cluster| Ok(index.cluster(cluster)?.index.length));
    Ok(Before { bytes: lengths.sum::<Result<u64>>()?, parts: clusters.len() })
}

/// The clusters that own the corners at the ends of the needed arcs.
pub(crate) fn corner_owners(index: &Index, needs: &Needs) -> Result<Vec<u32>> {
    let mut corners = Vec::new();
    for &arc in needs.arcs.keys() {
        let owner = index.owner(arc, |cluster| cluster.first_arc)?;
        let local = (arc - index.cluster(owner)?.first_arc) as usize;
        corners.extend(index.cluster_index(owner)?.arc_ends.get(local).into_iter().flatten());
    }
    index.owners(corners, Cluster::corners)
}

/// The streams that hold all needs.
pub(crate) fn find_parts(index: &Index, needs: &Needs) -> Result<Vec<(PartKey, Part)>> {
    let mut keys = Vec::new();
    for (&(cluster, run), &ArcRunNeed { finest, .. }) in needs.arc_runs.iter() {
        let levels = index.levels().index_arc_levels..=finest;
        keys.extend(levels.map(|level| PartKey::Arcs { level, cluster, run }));
    }
    for (level, prefixes) in (0..).zip(&needs.prefixes) {
        keys.extend(prefixes.iter().map(|&StreamPrefix { cluster, stream, .. }| PartKey::Blocks {
            level,
            cluster,
            stream,
        }));
    }
    keys.into_iter().map(|key| Ok((key, part_of(index, key)?))).collect()
}

/// Where a stream lies within the section PAGES.
pub(crate) fn part_of(index: &Index, key: PartKey) -> Result<Part> {
    match key {
        PartKey::Arcs { level, cluster, run } => {
            index.cluster_index(cluster)?.arc_part(index.levels().index_arc_levels, level, run)
        }
        PartKey::Blocks { cluster, stream, .. } => {
            let stream = index.cluster_index(cluster)?.streams.get(stream);
            stream.map(|stream| stream.part).ok_or_else(|| Error::format("a stream does not exist"))
        }
    }
}

pub(crate) fn raise<K: Copy + Ord>(levels: &mut SortedMap<K, u8>, key: K, level: u8) {
    let entry = levels.or_insert_with(key, || level);
    *entry = level.max(*entry);
}

/// Index of the stream that holds a root's block at a level; the root is counted from the cluster's first.
pub(crate) fn find_stream(index: &ClusterIndex, level: u8, root: u32) -> Result<usize> {
    let after = index.streams.partition_point(|stream| (stream.level, stream.roots.start) <= (level, root));
    let stream = after.checked_sub(1).and_then(|last| index.streams.get(last));
    match stream.filter(|stream| stream.level == level && stream.roots.contains(&root)) {
        Some(_) => Ok(after - 1),
        None => Err(Error::format("a block does not exist")),
    }
}
