//! The triangles of a cut with the objects that they belong to.

use std::sync::Arc;

use super::{Mesh, cut::joined};
use crate::{
    codec::patch::Patch,
    error::{Error, Result},
    index::Index,
    islands::islands,
    objects::ObjectChoice,
    select::{Cut, Node, Query, select_cut},
    source::Fetched,
};

/// [`super::extract`] for a cut of leaves, and for each triangle of the mesh the object that it belongs to.
///
/// # Errors
/// As [`super::extract`]; [`Error::Query`] if the file has no objects, or a node is a group.
pub fn extract_objects(index: &Index, cut: &Cut, fetched: &Fetched) -> Result<(Mesh, Vec<u32>)> {
    let (mesh, objects) = extract_objects_with_borders(index, cut, 0, fetched)?;
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

/// A world box around some objects and assemblies with everything below them; None if there are none. Of roots that
/// show nothing else it is the index's box, which is around the input, too; of leaves with other objects besides that
/// of their triangles at the finest level, and as much larger as the leaf's error.
///
/// # Errors
/// As [`super::extract`] and [`crate::index::Objects::filter`]; [`Error::Query`] if the file has no objects.
pub fn object_bounds(index: &Index, nodes: &[u32], fetched: &Fetched) -> Result<Option<[[f64; 3]; 2]>> {
    let what = || Error::Query { what: "this file has no objects; build it with --objects keep".into() };
    let filter = index.objects().ok_or_else(what)?.filter(&ObjectChoice::only(nodes), fetched)?;
    let query = Query { tolerance: Some(f64::MAX), objects: Some(Arc::clone(&filter)), ..Query::default() };
    let coarsest = select_cut(index, &query)?;
    let (alone, shared): (Vec<Node>, Vec<Node>) =
        coarsest.nodes.iter().partition(|node| filter.state(node.root).is_some());
    let mut around: Option<[[f64; 3]; 2]> = None;
    let mut add = |[from, to]: [[f64; 3]; 2]| {
        let [low, high] = around.unwrap_or([from, to]);
        around = Some([[0, 1, 2].map(|k| low[k].min(from[k])), [0, 1, 2].map(|k| high[k].max(to[k]))]);
    };
    for node in alone {
        add(index.root_bounds(node.root)?);
    }
    let mut errors = Vec::with_capacity(shared.len());
    let mut finest = vec![];
    for node in shared {
        let blocks = index.root_contents(node.root)?.blocks;
        let block = blocks.last().ok_or_else(|| Error::format("a root has no block"))?;
        errors.push(block.error + block.border_deviation);
        finest.push(Node { level: block.level, ..node });
    }
    let cut = Cut { nodes: finest, objects: Some(filter), ..Cut::default() };
    let mesh = super::extract(index, &cut, fetched)?;
    let mut is_there = vec![false; cut.nodes.len()];
    for (corners, &node) in mesh.triangles.iter().zip(&mesh.triangle_nodes) {
        is_there[node as usize] = true;
        for &corner in corners {
            let (at, error) = (mesh.positions[corner as usize], errors[node as usize]);
            add([at.map(|x| x - error), at.map(|x| x + error)]);
        }
    }
    // An object may be so small that nothing of it is left.
    for (node, _) in cut.nodes.iter().zip(is_there).filter(|(_, is_there)| !is_there) {
        add(index.root_bounds(node.root)?);
    }
    Ok(around)
}
