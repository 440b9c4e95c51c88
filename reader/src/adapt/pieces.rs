//! Which parts of pages a root's blocks need: an upper bound, since what the other roots of the cut need is not known yet.
//!
//! A block needs its stream up to itself (the part as a whole, for a part is what is checked and read), the arcs of all
//! roots in there, the arcs of its neighbours up to its own level, because a coarser neighbour's border gets its samples,
//! and the corners at the ends of all these arcs; besides the coarser blocks, which come first in the file.

use std::collections::BTreeSet;

use super::hierarchy::HierarchyNode;
use crate::{error::Result, file::File, source::ReadAt};

/// Sets the pieces of the resolutions of all nodes; `roots` are their roots, ascending. Returns the sizes of the pieces.
pub(super) fn add_pieces<S: ReadAt>(file: &File<S>, roots: &[u32], nodes: &mut [HierarchyNode]) -> Result<Vec<u64>> {
    let level_count = file.level_count() as u32;
    let piece = |cluster: u32, level: u8, is_blocks: u32| (cluster * level_count + u32::from(level)) * 2 + is_blocks;
    let mut piece_bytes = Vec::new();
    for cluster in file.clusters() {
        for level in cluster.levels.iter().take(level_count as usize) {
            piece_bytes.extend([level.arcs.length, level.blocks.length]);
        }
    }

    // Per root of the clusters that take part: who owns its arcs.
    let mut clusters = Vec::new();
    for &root in roots {
        clusters.push(file.owner(root, |cluster| cluster.first_root)?);
    }
    clusters.dedup();
    let mut all_owners = BTreeSet::new();
    let mut owners_of = Vec::new();
    for &number in &clusters {
        let mut of_cluster = Vec::new();
        for entry in &file.index(number)?.roots {
            let mut owners = BTreeSet::new();
            for half_arc in entry.half_arcs() {
                owners.insert(file.owner(half_arc.arc, |cluster| cluster.first_arc)?);
            }
            all_owners.extend(&owners);
            of_cluster.push(owners);
        }
        owners_of.push(of_cluster);
    }
    file.load_indices(all_owners.iter().copied())?;
    let mut corners_of = vec![BTreeSet::new(); file.clusters().len()];
    for &owner in &all_owners {
        for &corner in file.index(owner)?.arc_ends.iter().flatten() {
            corners_of[owner as usize].insert(file.owner(corner, |cluster| cluster.first_corner)?);
        }
    }

    // Whose arcs the neighbours use.
    let border_count = nodes.iter().flat_map(|node| &node.borders).max().map_or(0, |&border| border as usize + 1);
    let mut owners_at = vec![BTreeSet::new(); border_count];
    let place = |root: u32| -> Result<(usize, usize)> {
        let owner = file.owner(root, |cluster| cluster.first_root)?;
        Ok((clusters.partition_point(|&cluster| cluster < owner), (root - file.cluster(owner)?.first_root) as usize))
    };
    for (&root, node) in roots.iter().zip(nodes.iter()) {
        let (cluster, local) = place(root)?;
        for &border in &node.borders {
            owners_at[border as usize].extend(&owners_of[cluster][local]);
        }
    }

    for (&root, node) in roots.iter().zip(nodes.iter_mut()) {
        let (slot, local) = place(root)?;
        let index = file.index(clusters[slot])?;
        let near: BTreeSet<u32> =
            node.borders.iter().flat_map(|&border| &owners_at[border as usize]).copied().collect();
        let mut known = BTreeSet::new();
        for resolution in &mut node.resolutions {
            let level = resolution.level;
            let mut owners = near.clone();
            let streams = index.streams.iter().filter(|stream| stream.level == level);
            for stream in streams.filter(|stream| stream.roots.contains(&(local as u32))) {
                for before in stream.roots.start as usize..=local {
                    if index.roots[before].blocks.iter().any(|block| block.level == level) {
                        owners.extend(&owners_of[slot][before]);
                    }
                }
            }
            let mut needed = BTreeSet::from([piece(clusters[slot], level, 1)]);
            for &owner in &owners {
                needed.extend((0..=level).map(|level| piece(owner, level, 0)));
                needed.extend(corners_of[owner as usize].iter().map(|&corners| piece(corners, 0, 0)));
            }
            resolution.pieces = needed.difference(&known).copied().collect();
            known.extend(needed);
        }
    }
    Ok(piece_bytes)
}
