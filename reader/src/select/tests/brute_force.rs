use std::sync::Arc;

use proptest::prelude::*;

use super::{check_cut, synthetic::Plane};
use crate::{
    Query,
    select::{
        Hierarchy, View, Volume,
        front::{ABSENT, Front},
        select_in,
        weights::{Scope, Weights},
    },
};

/// Every cut of a hierarchy, as resolutions; without splits only those of roots.
fn all_cuts(hierarchy: &Hierarchy) -> Vec<Vec<u8>> {
    fn of(hierarchy: &Hierarchy, node: u32) -> Vec<Vec<(u32, u8)>> {
        let count = hierarchy.grades(node).len() as u8;
        let mut cuts: Vec<_> = (0..count).map(|resolution| vec![(node, resolution)]).collect();
        let children = hierarchy.children(node);
        if !children.is_empty() {
            cuts.extend(product(children.iter().map(|&child| of(hierarchy, child))));
        }
        cuts
    }
    fn product(lists: impl Iterator<Item = Vec<Vec<(u32, u8)>>>) -> Vec<Vec<(u32, u8)>> {
        lists.fold(vec![vec![]], |all, list| {
            all.iter().flat_map(|head| list.iter().map(|tail| [head.as_slice(), tail].concat())).collect()
        })
    }
    let cuts = product(hierarchy.roots().iter().map(|&root| of(hierarchy, root)));
    let place = |cut: Vec<(u32, u8)>| {
        let mut resolutions = vec![ABSENT; hierarchy.node_count() as usize];
        cut.into_iter().for_each(|(node, resolution)| resolutions[node as usize] = resolution);
        resolutions
    };
    cuts.into_iter().map(place).collect()
}

/// Triangles, nodes and largest error of every cut.
fn measure_all(hierarchy: &Arc<Hierarchy>) -> Vec<(u64, u64, f64)> {
    let weights = Weights::new(hierarchy, Scope::default(), 0.0);
    let mut front = Front::new(Arc::clone(hierarchy), weights, false);
    let mut measured = Vec::new();
    for resolutions in all_cuts(hierarchy) {
        (0..).zip(&resolutions).filter(|(_, r)| **r == ABSENT).for_each(|(node, &r)| front.place(node, r));
        (0..).zip(&resolutions).for_each(|(node, &r)| front.place(node, r));
        let cut = front.cut();
        measured.push((cut.triangle_count, cut.nodes.len() as u64, cut.error));
        front.clear_journal();
    }
    measured
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Without trees the cut of the threshold is the best there is.
    #[test]
    fn a_tolerance_is_optimal_where_nothing_can_be_split(seed in 0_u64..1000, tolerance in 0.0_f64..0.5) {
        let hierarchy = Plane { size: 2, resolutions: 4, seed, ..Plane::default() }.hierarchy();
        let query = Query { tolerance: Some(tolerance), ..Query::default() };
        let cut = select_in(&hierarchy, &query).unwrap();
        check_cut(&hierarchy, &query, &cut);
        let all = measure_all(&hierarchy);
        if cut.error <= tolerance {
            // Nothing that meets the tolerance is coarser anywhere, hence none has fewer triangles in its blocks;
            // stitching may make a finer cut a little smaller.
            let best = all.iter().filter(|cut| cut.2 <= tolerance).map(|cut| cut.0).min().unwrap();
            prop_assert!(cut.triangle_count as f64 <= best as f64 * 1.25 + 4.0, "{} {best}", cut.triangle_count);
        } else {
            prop_assert!(all.iter().all(|cut| cut.2 > tolerance), "a cut meets what this one does not");
        }
    }

    /// With trees it is greedy; how far from the best is bounded here by experience.
    #[test]
    fn a_tolerance_is_near_the_best_with_a_node_budget(seed in 0_u64..1000, tolerance in 0.02_f64..0.5, nodes in 1_u64..6) {
        let plane = Plane { size: 1, depth: 1, resolutions: 4, seed, deviation: 0.3 };
        let hierarchy = plane.hierarchy();
        let query = Query { tolerance: Some(tolerance), max_nodes: Some(nodes), ..Query::default() };
        let cut = select_in(&hierarchy, &query).unwrap();
        check_cut(&hierarchy, &query, &cut);
        let all = measure_all(&hierarchy);
        let best = all.iter().filter(|cut| cut.2 <= tolerance && cut.1 <= nodes).map(|cut| cut.0).min();
        if let Some(best) = best {
            prop_assert!(cut.error <= tolerance);
            prop_assert!(cut.triangle_count as f64 <= best as f64 * 1.5 + 4.0, "{} {best}", cut.triangle_count);
        }
    }

    /// The quad-queue is greedy too.
    #[test]
    fn quad_queue_is_near_the_best(seed in 0_u64..1000, share in 0.0_f64..1.0, nodes in 1_u64..6) {
        let plane = Plane { size: 1, depth: 1, resolutions: 4, seed, deviation: 0.3 };
        let hierarchy = plane.hierarchy();
        let all = measure_all(&hierarchy);
        let (least, most) = (2, all.iter().map(|cut| cut.0).max().unwrap());
        let triangles = least + ((most - least) as f64 * share * share) as u64;
        let query = Query { max_triangles: Some(triangles), max_nodes: Some(nodes), ..Query::default() };
        let cut = select_in(&hierarchy, &query).unwrap();
        check_cut(&hierarchy, &query, &cut);
        let fits = all.iter().filter(|cut| cut.0 <= triangles && cut.1 <= nodes);
        let best = fits.map(|cut| cut.2).fold(f64::INFINITY, f64::min);
        // A resolution is a factor of four in error, and a split may need two steps at once.
        prop_assert!(cut.error <= best * 4.5, "{} {best}", cut.error);
    }

    /// Only with the tree cut away: the quad-queue is within one resolution of the best.
    #[test]
    fn quad_queue_without_splits_is_near_the_best(seed in 0_u64..1000, share in 0.0_f64..1.0) {
        let hierarchy = Plane { size: 2, resolutions: 3, seed, ..Plane::default() }.hierarchy();
        let all = measure_all(&hierarchy);
        let (least, most) = (all[0].0, all.iter().map(|cut| cut.0).max().unwrap());
        let triangles = least + ((most - least) as f64 * share * share) as u64;
        let query = Query { max_triangles: Some(triangles), ..Query::default() };
        let cut = select_in(&hierarchy, &query).unwrap();
        check_cut(&hierarchy, &query, &cut);
        let best = all.iter().filter(|cut| cut.0 <= triangles).map(|cut| cut.2).fold(f64::INFINITY, f64::min);
        prop_assert!(cut.error <= best * 2.0, "{} {best}", cut.error);
    }
}

#[test]
fn hostile_hierarchies_are_refused() {
    use crate::select::{HierarchyNode, Resolution};
    let node = |parent, level, border: u32| HierarchyNode {
        parent,
        resolutions: vec![Resolution { level, ..Resolution::default() }],
        borders: vec![border],
        ..HierarchyNode::default()
    };
    let make = |node: HierarchyNode| Hierarchy::new(&[node], vec![0, 1], 2, vec![]);
    assert!(make(node(None, 1, 0)).is_ok());
    assert!(make(node(Some(0), 1, 0)).is_err());
    assert!(make(node(None, 2, 0)).is_err());
    assert!(make(node(None, 1, 1)).is_err());
    assert!(make(HierarchyNode::default()).is_err());
    let view = View { forward: [0.0; 3], ..View::default() };
    let hierarchy = Arc::new(make(node(None, 1, 0)).unwrap());
    assert!(select_in(&hierarchy, &Query { view: Some(view), ..Query::default() }).is_err());
    let both = Query { view: Some(View::default()), tolerance: Some(1.0), ..Query::default() };
    assert!(select_in(&hierarchy, &both).is_err());
    let region = Volume::Sphere { centre: [0.0; 3], radius: f64::NAN };
    assert!(select_in(&hierarchy, &Query { volume: Some(region), ..Query::default() }).is_err());
}
