//! Cuts of synthetic hierarchies: budgets, tolerances and wholeness; the best there is on small ones; coherence.

mod brute_force;
mod budgets;
mod coherent;
mod queries;
pub(crate) mod synthetic;
mod thresholds;

use crate::{
    Cut, Query,
    select::{Hierarchy, View},
    tests::synthetic::Random,
};

/// Checks that a cut covers everything, or with a scope everything inside, exactly once, and that its counts and errors
/// are what its nodes make of them.
pub(crate) fn check_cut(hierarchy: &Hierarchy, query: &Query, cut: &Cut) {
    let scope = query.scope().unwrap();
    let mut levels = vec![None; hierarchy.node_count() as usize];
    for node in &cut.nodes {
        levels[node.root as usize] = Some(node.level);
    }
    for leaf in (0..hierarchy.node_count()).filter(|&node| hierarchy.children(node).is_empty()) {
        let mut cover = 0;
        let mut at = Some(leaf);
        while let Some(node) = at {
            cover += usize::from(levels[node as usize].is_some());
            at = hierarchy.parent(node);
        }
        let is_wanted = query.outside == crate::Outside::Coarsest || scope.factor(hierarchy.bounds(leaf)) > 0.0;
        assert!(cover <= 1 && (cover == 1 || !is_wanted), "leaf {leaf} is covered {cover} times");
    }

    let (mut triangles, mut bytes, mut errors) = (0, 0, Vec::new());
    for node in &cut.nodes {
        let resolution = hierarchy.resolution_at(node.root, node.level);
        assert_eq!(hierarchy.level(node.root, resolution), node.level);
        let grade = hierarchy.grade(node.root, resolution);
        triangles += grade.triangle_count;
        let pages = (0..=resolution).flat_map(|resolution| hierarchy.pages(node.root, resolution));
        bytes += pages.map(|&page| hierarchy.page_bytes()[page as usize]).sum::<u64>();
        let mut is_refined = false;
        for &border in hierarchy.borders(node.root) {
            let users = hierarchy.users(border).iter().filter_map(|&user| levels[user as usize]);
            let drawn = hierarchy.sample_count(border, users.max().unwrap());
            let own = hierarchy.sample_count(border, node.level);
            is_refined |= drawn > own;
            let uses = hierarchy.users(border).iter().filter(|&&user| user == node.root).count() as u64;
            triangles += uses * u64::from(drawn - own);
        }
        errors.push(if is_refined { grade.refined_error } else { grade.error });
    }
    assert_eq!(cut.triangle_count, triangles);
    assert_eq!(cut.byte_count, bytes);
    assert_eq!(cut.node_errors, errors);
    assert!(query.max_triangles.is_none_or(|most| triangles <= most));
    assert!(query.max_nodes.is_none_or(|most| cut.nodes.len() as u64 <= most));
    assert!(query.max_bytes.is_none_or(|most| bytes <= most));
}

/// A camera above the plane that looks down at it at a slant.
pub(crate) fn view_of(size: f64, random: &mut Random) -> View {
    let position = [random.unit() * size, random.unit() * size, 0.1 + random.unit() * size * 0.5];
    let forward = [random.unit() - 0.5, random.unit() - 0.5, -0.3 - random.unit()];
    View {
        position,
        forward,
        up: [0.1, 1.0, 0.2],
        near: 0.01,
        pixel_tolerance: 1.0 + random.unit() * 100.0,
        ..View::default()
    }
}

/// Any query.
pub(crate) fn query_of(size: f64, random: &mut Random) -> Query {
    let mut query = Query::default();
    if random.below(2) == 0 {
        query.view = Some(view_of(size, random));
    } else if random.below(3) > 0 {
        query.tolerance = Some(random.unit() * random.unit());
    }
    if random.below(3) == 0 {
        let low = [random.unit() * size, random.unit() * size, -1.0];
        let extent = random.unit() * size;
        query.volume = Some([low, [low[0] + extent, low[1] + extent, 1.0]].into());
    }
    if random.below(3) == 0 {
        query.outside = crate::Outside::Coarsest;
    }
    let scale = (size * size) as u64;
    query.max_triangles = (random.below(2) == 0).then(|| random.below(scale * 150));
    query.max_nodes = (random.below(2) == 0).then(|| random.below(scale * 4));
    query.max_bytes = (random.below(4) == 0).then(|| random.below(scale * 300));
    query
}
