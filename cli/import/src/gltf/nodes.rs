//! Where the nodes of a document are.

use glam::DMat4;

use super::document::Document;
use super::fields::{Index, Whole};

/// The nodes that are no children.
pub(super) fn roots_of_forest(document: &Document) -> Vec<Index> {
    let mut is_child = vec![false; document.nodes.len()];
    for &child in document.nodes.iter().flat_map(|node| node.children) {
        if let Some(is_child) = is_child.get_mut(usize::from(child)) {
            *is_child = true;
        }
    }
    (0..).zip(is_child).filter(|(_, is_child)| !is_child).map(|(number, _)| Whole(number)).collect()
}

/// Where all nodes are, in a scene or not. Those of circles, which no tree has, are where they stand.
pub(super) fn worlds_of_nodes(document: &Document) -> Vec<DMat4> {
    let mut worlds = vec![DMat4::IDENTITY; document.nodes.len()];
    let mut seen = vec![false; document.nodes.len()];
    let mut open: Vec<(usize, DMat4)> =
        roots_of_forest(document).into_iter().map(|root| (root.into(), DMat4::IDENTITY)).collect();
    while let Some((number, world_from_parent)) = open.pop() {
        let Some(node) = document.nodes.get(number) else { continue };
        if std::mem::replace(&mut seen[number], true) {
            continue;
        }
        worlds[number] = world_from_parent * node.parent_from_node();
        open.extend(node.children.iter().map(|&child| (usize::from(child), worlds[number])));
    }
    worlds
}
