//! Where the nodes of a document are.

use glam::{DMat4, DQuat, DVec3};

use super::document::{Document, Node};

/// The nodes that are no children.
pub(super) fn roots_of_forest(document: &Document) -> Vec<usize> {
    let mut is_child = vec![false; document.nodes.len()];
    for &child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_child) = is_child.get_mut(usize::from(child)) {
            *is_child = true;
        }
    }
    (0..is_child.len()).filter(|&number| !is_child[number]).collect()
}

/// Where all nodes are, in a scene or not. Those of circles, which no tree has, are where they stand.
pub(super) fn worlds_of_nodes(document: &Document) -> Vec<DMat4> {
    let mut worlds = vec![DMat4::IDENTITY; document.nodes.len()];
    let mut seen = vec![false; document.nodes.len()];
    let mut open: Vec<(usize, DMat4)> =
        roots_of_forest(document).into_iter().map(|root| (root, DMat4::IDENTITY)).collect();
    while let Some((number, world_from_parent)) = open.pop() {
        let Some(node) = document.nodes.get(number) else { continue };
        if std::mem::replace(&mut seen[number], true) {
            continue;
        }
        worlds[number] = world_from_parent * parent_from_node(node);
        open.extend(node.children.iter().map(|&child| (usize::from(child), worlds[number])));
    }
    worlds
}

/// A node's own transform.
pub(super) fn parent_from_node(node: &Node) -> DMat4 {
    match &node.matrix {
        Some(matrix) => DMat4::from_cols_array(matrix),
        None => transform(node.translation, node.rotation, node.scale),
    }
}

pub(super) fn transform(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DMat4 {
    let rotation = DQuat::from_array(rotation);
    // As it is written, the norm is only near 1.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(DVec3::from(scale), rotation, DVec3::from(translation))
}
