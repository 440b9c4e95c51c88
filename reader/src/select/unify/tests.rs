use std::sync::Arc;

use super::{TileTree, Tiles, Unification, unify_cuts};
use crate::{
    Node, Query,
    select::{Adapter, Coherence, Hierarchy, View, tests::synthetic::Plane},
};

fn plane(depth: u32) -> Plane {
    Plane { size: 32 >> depth, depth, resolutions: 5, seed: 6, ..Plane::default() }
}

/// A slow path over a plane of `side` units.
fn view(frame: u32, side: u32) -> View {
    let scale = f64::from(side) / 32.0;
    let t = f64::from(frame) * 0.005;
    View {
        position: [16.0 + 6.0 * t.sin(), 14.0 + 6.0 * (0.7 * t).cos(), 4.0 + 2.0 * (0.3 * t).sin()].map(|x| x * scale),
        forward: [(0.5 * t).cos(), (0.5 * t).sin(), -1.0],
        up: [0.0, 0.0, 1.0],
        near: 0.01,
        pixel_tolerance: 4.0 / scale,
        ..View::default()
    }
}

fn query(frame: u32, side: u32) -> Query {
    Query { view: Some(view(frame, side)), max_nodes: Some(8000), ..Query::default() }
}

fn adapters(hierarchy: &Arc<Hierarchy>, queries: &[Query]) -> Vec<Adapter> {
    let start = |query| Adapter::new(Arc::clone(hierarchy), query, Coherence::default()).unwrap();
    queries.iter().map(start).collect()
}

/// Levels of what covers each leaf in a tile; panics where one is covered twice.
fn cover(hierarchy: &Hierarchy, nodes: &[Node]) -> Vec<Option<u8>> {
    let mut levels = vec![None; hierarchy.node_count() as usize];
    nodes.iter().for_each(|node| levels[node.root as usize] = Some(node.level));
    let leaf_level = |leaf: u32| {
        let above = std::iter::successors(Some(leaf), |&node| hierarchy.parent(node));
        let found: Vec<u8> = above.filter_map(|node| levels[node as usize]).collect();
        assert!(found.len() <= 1, "leaf {leaf} is covered twice");
        found.first().copied()
    };
    (0..hierarchy.node_count()).map(|node| leaf_level(node).filter(|_| hierarchy.children(node).is_empty())).collect()
}

/// Checks that every tile covers what it shows, and that what two tiles show has one level in both. Borders are drawn
/// at the finer of their sides, and both sides of a border that two tiles show are shown by both: so these agree as
/// well.
fn check_unified(hierarchy: &Hierarchy, queries: &[Query], tiles: &[Vec<Node>]) -> usize {
    let mut shared = 0;
    let mut levels = vec![None; hierarchy.node_count() as usize];
    for (query, nodes) in queries.iter().zip(tiles) {
        let scope = query.scope().unwrap();
        let cover = cover(hierarchy, nodes);
        for leaf in (0..hierarchy.node_count()).filter(|&node| hierarchy.children(node).is_empty()) {
            if scope.factor(hierarchy.bounds(leaf)) == 0.0 {
                continue;
            }
            let level = cover[leaf as usize];
            assert!(level.is_some(), "leaf {leaf} is seen and not covered");
            let before = levels[leaf as usize].replace(level);
            shared += usize::from(before.is_some());
            assert!(before.is_none_or(|before| before == level), "leaf {leaf} is cracked: {before:?} {level:?}");
        }
    }
    shared
}

#[test]
fn unified_tiles_have_no_crack_and_no_double_cover() {
    for (tree_depth, depth, mode) in [
        (2, 0, Unification::Quality),
        (2, 2, Unification::Performance),
        (4, 1, Unification::Quality),
        (4, 2, Unification::Performance),
    ] {
        let (hierarchy, side) = (plane(depth).hierarchy(), plane(depth).size);
        let mut tree = TileTree::new(tree_depth).unwrap();
        let mut tiles = adapters(&hierarchy, &tree.queries(&query(0, side)).unwrap());
        let (mut shared, mut changed) = (0, 0);
        for frame in 0..1000 {
            let queries = tree.queries(&query(frame, side)).unwrap();
            let mut times = Vec::new();
            for (tile, query) in tiles.iter_mut().zip(&queries) {
                times.push(tile.update(query).unwrap().node_count as f64);
            }
            let unified = unify_cuts(&tiles, mode).unwrap();
            changed += unified.change_count;
            shared += check_unified(&hierarchy, &queries, &unified.tiles);
            if frame % 10 == 9 {
                tree.rebalance(&times);
            }
        }
        println!("{} tiles: {shared} shared leaves, {changed} changes by unification", tree.tile_count());
        assert!(shared > 1000 && (depth == 0 || changed > 0));
    }
}

#[test]
fn in_quality_mode_no_error_grows_and_in_performance_mode_no_level_does() {
    let hierarchy = plane(0).hierarchy();
    let queries = TileTree::new(2).unwrap().queries(&Query { max_triangles: Some(6000), ..query(0, 32) }).unwrap();
    let tiles = adapters(&hierarchy, &queries);
    let plain: Vec<Vec<Node>> = tiles.iter().map(|tile| tile.cut().nodes).collect();
    for (mode, grows) in [(Unification::Quality, true), (Unification::Performance, false)] {
        let unified = unify_cuts(&tiles, mode).unwrap();
        assert!(unified.change_count > 0 && unified.change_count <= unified.boundary_count);
        for (before, after) in plain.iter().flatten().zip(unified.tiles.iter().flatten()) {
            assert_eq!(before.root, after.root);
            assert!(if grows { before.level <= after.level } else { before.level >= after.level });
        }
    }
}

/// Four tiles' evaluations against one's, from scratch and along the path.
#[test]
fn four_tiles_work_little_more_than_one() {
    // About a thousand nodes in the picture; with a quarter of these the nodes on the tiles' borders cost 1.4.
    for depth in [0, 2] {
        let side = 64 >> depth;
        let hierarchy = Plane { size: side, ..plane(depth) }.hierarchy();
        let (mut sums, mut node_count) = (Vec::new(), 0);
        for tree_depth in [0, 2] {
            let tree = TileTree::new(tree_depth).unwrap();
            let mut tiles = adapters(&hierarchy, &tree.queries(&query(0, side)).unwrap());
            let mut work = [0, 0];
            work[0] = tiles.iter().map(Adapter::evaluation_count).sum::<u64>();
            for frame in 1..1000 {
                for (tile, query) in tiles.iter_mut().zip(tree.queries(&query(frame, side)).unwrap()) {
                    work[1] += tile.update(&query).unwrap().evaluation_count;
                }
            }
            node_count = tiles.iter().map(|tile| tile.cut().nodes.len()).sum::<usize>();
            sums.push(work);
        }
        let ratio = |k: usize| sums[1][k] as f64 / sums[0][k] as f64;
        println!(
            "depth {depth}: {sums:?} for {} nodes: from scratch {:.2}, coherent {:.2}",
            node_count,
            ratio(0),
            ratio(1)
        );
        // From scratch there is so little work that looking at boxes, which each tile does, is most of it.
        assert!(ratio(1) <= 1.3 && ratio(0) <= 1.5, "{} {}", ratio(0), ratio(1));
    }
}

#[test]
fn borders_move_to_where_both_sides_take_equally_long() {
    // Work is spread with density 1 on the left third of the picture and 0.1 on the rest.
    let work = |from: f64, to: f64| {
        let dense = (to.min(1.0 / 3.0) - from).max(0.0);
        dense + 0.1 * (to - from - dense)
    };
    let mut tree = TileTree::new(2).unwrap();
    assert_eq!(tree.tiles()[3], [[0.5, 0.5], [1.0, 1.0]]);
    for _ in 0..30 {
        let tiles = tree.tiles();
        let times: Vec<f64> = tiles.iter().map(|[low, high]| work(low[0], high[0]) * (high[1] - low[1])).collect();
        tree.rebalance(&times);
    }
    let tiles = tree.tiles();
    let times: Vec<f64> = tiles.iter().map(|[low, high]| work(low[0], high[0]) * (high[1] - low[1])).collect();
    assert!(times.iter().all(|time| (time / times[0] - 1.0).abs() < 0.01), "{times:?}");
    let area: f64 = tiles.iter().map(|[low, high]| (high[0] - low[0]) * (high[1] - low[1])).sum();
    assert!((area - 1.0).abs() < 1e-12);
    tree.rebalance(&[0.0; 4]);
    tree.rebalance(&[1.0; 3]);
    assert_eq!(tree.tiles(), tiles);
    assert!(TileTree::new(30).is_err());
}

#[test]
fn without_budgets_tiles_draw_what_one_cut_for_the_picture_would() {
    let hierarchy = plane(0).hierarchy();
    let still = Coherence { hysteresis: 0.0, play: 0.0 };
    let mut changes = 0;
    for frame in (0..400).step_by(20) {
        let whole = Query { max_nodes: None, ..query(frame, 32) };
        let queries = TileTree::new(2).unwrap().queries(&whole).unwrap();
        let tiles: Vec<Adapter> =
            queries.iter().map(|query| Adapter::new(Arc::clone(&hierarchy), query, still).unwrap()).collect();
        let unified = unify_cuts(&tiles, Unification::Quality).unwrap();
        changes += unified.change_count;
        let cut = Adapter::new(Arc::clone(&hierarchy), &whole, still).unwrap().cut();
        assert!(unified.nodes == cut.nodes, "frame {frame}");
    }
    assert!(changes > 0);
}

#[test]
fn tiles_side_by_side_are_those_one_after_the_other_and_know_what_touches_them() {
    let hierarchy = plane(1).hierarchy();
    let side = plane(1).size;
    let tree = TileTree::new(3).unwrap();
    let queries = |frame| tree.queries(&query(frame, side)).unwrap();
    let mut one_by_one = adapters(&hierarchy, &queries(0));
    let mut tiles = Tiles::new(&hierarchy, &queries(0), Coherence::default(), Unification::Quality).unwrap();
    for frame in (0..200).step_by(10) {
        let report = tiles.update(&queries(frame)).unwrap();
        let alone = one_by_one.iter_mut().zip(queries(frame)).map(|(tile, query)| tile.update(&query).unwrap());
        assert_eq!(report.tiles, alone.collect::<Vec<_>>());
        let unified = unify_cuts(&one_by_one, Unification::Quality).unwrap();
        assert_eq!(report.unified, unified);
        for (own, all) in unified.tiles.iter().zip(tiles.with_neighbours(&unified)) {
            let bounds = |node: &Node| hierarchy.bounds(node.root);
            let touches = |a: [[f64; 3]; 2], b: [[f64; 3]; 2]| (0..3).all(|k| a[0][k] <= b[1][k] && b[0][k] <= a[1][k]);
            let expected = unified
                .nodes
                .iter()
                .filter(|node| own.contains(node) || own.iter().any(|other| touches(bounds(node), bounds(other))));
            assert_eq!(all, expected.copied().collect::<Vec<_>>());
        }
    }
    assert!(tiles.update(&queries(0)[1..]).is_err());
}
