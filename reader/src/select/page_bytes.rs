//! The pages that a root's blocks need: an upper bound, because the needs of the other roots of the cut are not known
//! yet.
//!
//! A block needs its stream, the arcs of all roots before it in that stream, and the arcs of its neighbours up to its
//! own level, because a coarser neighbour's border takes its samples. It also needs what the coarser blocks of its root
//! need.

use super::hierarchy::HierarchyNode;
use crate::{
    error::{Error, Result},
    index::{
        Index,
        needs::{Wanted, parts_of_block},
    },
    sorted::{SortedMap, SortedSet},
    source::requests::plan,
};

/// Sets the pages of the resolutions of all nodes; `roots` are their roots, ascending. Returns the sizes of the pages.
pub(super) fn add_pages(index: &Index, roots: &[u32], nodes: &mut [HierarchyNode]) -> Result<Vec<u64>> {
    let border_count = nodes.iter().flat_map(|node| &node.borders).max().map_or(0, |&border| border as usize + 1);
    let mut users = vec![Vec::new(); border_count];
    for (&root, node) in roots.iter().zip(nodes.iter()) {
        node.borders.iter().for_each(|&border| users[border as usize].push(root));
    }
    // Streams by their place in the file.
    let (mut page_of, mut page_bytes) = (SortedMap::new(), Vec::new());
    let mut missing = Vec::new();
    for (&root, node) in roots.iter().zip(nodes.iter_mut()) {
        let near: SortedSet<u32> = node.borders.iter().flat_map(|&border| &users[border as usize]).copied().collect();
        let mut known = SortedSet::new();
        for resolution in &mut node.resolutions {
            let level = resolution.level;
            let parts = match parts_of_block(index, Wanted { root, level, arc_level: level }, &near) {
                // All index blocks are asked for at once.
                Err(Error::Missing { ranges }) => {
                    missing.extend(ranges);
                    continue;
                }
                parts => parts?,
            };
            for part in parts.into_iter().filter(|part| part.length > 0) {
                let page = *page_of.or_insert_with(part.offset, || {
                    page_bytes.push(part.length);
                    page_bytes.len() as u32 - 1
                });
                if known.insert(page) {
                    resolution.pages.push(page);
                }
            }
            resolution.pages.sort_unstable();
        }
    }
    if missing.is_empty() { Ok(page_bytes) } else { Err(Error::Missing { ranges: plan(missing) }) }
}
