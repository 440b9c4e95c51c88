use std::sync::Arc;

use super::{check_cut, synthetic::Plane};
use crate::{
    Limiter, Query,
    select::{
        Adapter, Coherence, Controls, FrameTimes, Hierarchy, HierarchyNode, PerformanceMode, PerformanceTarget,
        Resolution, View, select_in,
    },
};

/// Looks down at the middle of a plane from a height.
fn view_from(size: f64, height: f64) -> View {
    let position = [size * 0.5, size * 0.5, height];
    View { position, forward: [0.0, 0.0, -1.0], near: 0.01, pixel_tolerance: 4.0, ..View::default() }
}

/// Adapting always takes too long, so the mode asks for fewer nodes again and again, while the camera rises and sees
/// more roots.
#[test]
fn a_node_budget_of_performance_mode_stops_no_frame() {
    for depth in [0, 2] {
        let plane = Plane { size: 16 >> depth, depth, ..Plane::default() };
        let (hierarchy, size) = (plane.hierarchy(), f64::from(plane.size));
        let most = u64::from(hierarchy.node_count());
        let target =
            PerformanceTarget { tolerance: 4.0, adapt_time: 1e-3, nodes: [1, most], ..PerformanceTarget::default() };
        let mut mode = PerformanceMode::new(target).unwrap();
        let query = |frame: u32, controls: Controls| {
            let view = View { pixel_tolerance: controls.tolerance, ..view_from(size, 0.2 + f64::from(frame) * 0.05) };
            Query { view: Some(view), max_nodes: Some(controls.max_nodes), ..Query::default() }
        };
        let mut adapter =
            Adapter::new(Arc::clone(&hierarchy), &query(0, mode.controls()), Coherence::default()).unwrap();
        let mut node_counts = Vec::new();
        for frame in 1..300 {
            let query = query(frame, mode.controls());
            let report = adapter.update(&query).unwrap();
            node_counts.push(report.node_count);
            let cut = adapter.cut();
            check_cut(&hierarchy, &Query { max_nodes: None, ..query.clone() }, &cut);
            // The node budget costs no accuracy where there are no trees: every root in sight is one node.
            let finest = select_in(&hierarchy, &Query { max_nodes: None, ..query.clone() }).unwrap();
            let most = finest.pixel_error.max(mode.controls().tolerance);
            assert!(depth > 0 || cut.pixel_error <= most * (1.0 + Coherence::default().play));
            let (node_count, triangle_count) = (report.node_count, report.triangle_count);
            mode.record(FrameTimes { frame: 15.0, adapt: 5.0, node_count, triangle_count, upload_bytes: 0 });
        }
        assert!(depth > 0 || node_counts[0] * 2 < *node_counts.last().unwrap());
    }
}

#[test]
fn frames_go_on_where_even_the_coarsest_cut_breaks_a_budget() {
    for depth in [0, 1] {
        let plane = Plane { size: 8, depth, ..Plane::default() };
        let hierarchy = plane.hierarchy();
        let wide = Query { view: Some(view_from(8.0, 6.0)), ..Query::default() };
        let coarsest =
            |max_triangles, max_nodes, max_bytes| Query { max_triangles, max_nodes, max_bytes, ..wide.clone() };
        for (tight, limiter) in [
            (coarsest(Some(5), None, None), Some(Limiter::Triangles)),
            (coarsest(None, Some(3), None), Some(Limiter::Nodes)),
            (coarsest(None, None, Some(7)), Some(Limiter::Bytes)),
        ] {
            assert!(select_in(&hierarchy, &tight).is_err());
            let mut adapter = Adapter::new(Arc::clone(&hierarchy), &tight, Coherence::default()).unwrap();
            for query in [&tight, &wide, &tight, &wide] {
                let report = adapter.update(query).unwrap();
                let cut = adapter.cut();
                check_cut(&hierarchy, &wide, &cut);
                assert_eq!(report.node_count, cut.nodes.len() as u64);
                assert_eq!(
                    (report.exceeded, cut.exceeded),
                    if query == &tight { (limiter, limiter) } else { (None, None) }
                );
                let is_least = cut.nodes.iter().all(|node| hierarchy.parent(node.root).is_none());
                assert!(query == &wide || is_least, "roots alone are the fewest nodes, triangles and bytes");
                assert!(query == &tight || cut.pixel_error <= 4.0);
            }
        }
    }
}

/// Two roots with the given number of children each. At a tolerance of 0.1 the first one's children save triangles, at
/// 0.01 the second one's save more, and the first one's hardly any.
fn two_trees(child_count: u64) -> Arc<Hierarchy> {
    let node = |parent: Option<u32>, resolutions: &[(f64, u64)]| {
        let resolution = |(level, &(error, triangle_count)): (usize, &(f64, u64))| Resolution {
            level: level as u8,
            error,
            triangle_count,
            ..Resolution::default()
        };
        let resolutions = resolutions.iter().enumerate().map(resolution).collect();
        HierarchyNode { bounds: [[0.0; 3], [1.0; 3]], parent, resolutions, borders: Vec::new() }
    };
    let mut nodes =
        vec![node(None, &[(1.0, 10), (0.1, 1000), (0.01, 1100)]), node(None, &[(1.0, 10), (0.1, 400), (0.01, 4000)])];
    let child =
        |parent, sums: [u64; 2]| node(Some(parent), &[(0.1, sums[0] / child_count), (0.01, sums[1] / child_count)]);
    nodes.extend((0..child_count).map(|_| child(0, [450, 1080])));
    nodes.extend((0..child_count).map(|_| child(1, [540, 900])));
    Arc::new(Hierarchy::new(&nodes, Vec::new(), 3, Vec::new()).unwrap())
}

#[test]
fn room_for_a_split_is_made_only_where_it_lacks_however_many_children_there_are() {
    // Two children: there is room for both splits. Nine: there is none, though there is for three nodes more.
    for (child_count, max_nodes, triangle_count) in [(2, 4, 1080 + 900), (9, 14, 1100 + 900)] {
        let hierarchy = two_trees(child_count);
        let query = |tolerance| Query { tolerance: Some(tolerance), max_nodes: Some(max_nodes), ..Query::default() };
        let mut adapter = Adapter::new(hierarchy, &query(0.1), Coherence::default()).unwrap();
        assert_eq!(adapter.cut().triangle_count, 450 + 400, "the first root is split");
        assert_eq!(adapter.update(&query(0.01)).unwrap().triangle_count, triangle_count, "{child_count} children");
    }
}
