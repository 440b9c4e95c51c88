//! The triangles of a cut with the objects that they belong to.

use super::{Mesh, cut::joined};
use crate::{
    codec::patch::Patch,
    error::{Error, Result},
    index::Index,
    islands::islands,
    select::{Cut, Node},
    source::Fetched,
};

/// [`super::extract`] for a cut of leaves, and for each triangle of the mesh the object that it belongs to.
///
/// # Errors
/// As [`super::extract`]; [`Error::Query`] if the file has no objects, or a node is a group.
pub fn extract_objects(index: &Index, cut: &Cut, fetched: &Fetched) -> Result<(Mesh, Vec<u32>)> {
    let (mesh, objects) = owned(index, cut, 0, fetched)?;
    let what = || Error::Query { what: "a group has no objects of its own: ask for a cut of leaves".into() };
    let objects = objects.into_iter().collect::<Option<Vec<u32>>>().ok_or_else(what)?;
    Ok((mesh, objects))
}

/// [`super::extract_with_borders`], and for each triangle of a leaf the object that it belongs to. Groups have none.
///
/// # Errors
/// As [`super::extract_with_borders`]; [`Error::Query`] if the file has no objects.
pub fn extract_objects_with_borders(
    index: &Index,
    cut: &Cut,
    border_level: u8,
    fetched: &Fetched,
) -> Result<(Mesh, Vec<Option<u32>>)> {
    owned(index, cut, border_level, fetched)
}

fn owned(index: &Index, cut: &Cut, border_level: u8, fetched: &Fetched) -> Result<(Mesh, Vec<Option<u32>>)> {
    let what = || Error::Query { what: "this file has no objects; build it with --objects keep".into() };
    let objects = index.objects().ok_or_else(what)?;
    // Bytes of owners and of blocks are asked for one after the other: the former are few.
    let owners: Vec<Option<Vec<u32>>> = cut
        .nodes
        .iter()
        .map(|node| {
            if !index.children(node.root)?.is_empty() {
                return Ok(None);
            }
            let blocks = index.root_contents(node.root)?.blocks;
            let block = blocks.iter().rev().find(|block| block.level <= node.level).or(blocks.first());
            objects.owners(node.root, block.map_or(0, |block| block.level), fetched).map(Some)
        })
        .collect::<Result<_>>()?;
    let mut of_triangles: Vec<Vec<u32>> = vec![];
    let mut visit = |node: Node, patch: &Patch, _| {
        let Some(Some(owners)) = owners.get(of_triangles.len()) else {
            of_triangles.push(vec![]);
            return Ok(());
        };
        let (labels, count) = islands(&patch.triangles);
        if owners.len() != count as usize {
            let location = || format!("root {}, level {}", node.root, node.level);
            return Err(Error::format("a block has other islands than owners").at(location));
        }
        of_triangles.push(labels.into_iter().map(|label| owners[label as usize]).collect());
        Ok(())
    };
    let (mesh, origins) = joined(index, cut, border_level, fetched, Some(&mut visit))?;
    let object = |(&node, &origin): (&u32, &u32)| {
        let of_node = of_triangles.get(node as usize)?;
        of_node.get(origin as usize).copied()
    };
    let objects = mesh.triangle_nodes.iter().zip(&origins).map(object).collect();
    Ok((mesh, objects))
}
