//! Cuts are watertight whatever their levels, and within their budgets.

use std::collections::BTreeMap;

use super::synthetic::{Options, Random, cube, file_of, tetrahedron};
use crate::{Cut, Error, File, Limiter, Limits, Mesh, Node, Outside, Query, select::View};

const OPTIONS: Options = Options { levels: 4, seed: 3, grids_of_four: 1, heights: 0 };

fn open(n: i64, seed: u64) -> File<Vec<u8>> {
    let faces = if n == 0 { tetrahedron() } else { cube(n) };
    File::open(file_of(&faces, Options { seed, ..OPTIONS }), Limits::default()).unwrap()
}

/// How often each directed edge occurs less its opposite; zero everywhere for a closed surface.
pub(crate) fn open_edges(mesh: &Mesh) -> usize {
    let mut edges: BTreeMap<[u32; 2], i64> = BTreeMap::new();
    for triangle in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|&&balance| balance != 0).count()
}

pub(crate) fn euler_characteristic(mesh: &Mesh) -> i64 {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
    assert!(!used.contains(&false), "a vertex is used by no triangle");
    // Closed: three edges for two triangles.
    mesh.positions.len() as i64 - mesh.triangles.len() as i64 / 2
}

/// The cut of a query and its mesh, which keep all budgets; none if none can, and the error says what can.
pub(crate) fn within_budgets(file: &File<Vec<u8>>, query: &Query) -> Option<(Cut, Mesh)> {
    let cut = match file.select(query) {
        Ok(cut) => cut,
        Err(Error::Query { what }) => {
            assert!(what.contains("at least"), "{what}");
            return None;
        }
        Err(error) => panic!("{error}"),
    };
    let mesh = file.extract(&cut).unwrap();
    assert_eq!(mesh.triangles.len() as u64, cut.triangle_count);
    assert!(query.max_triangles.is_none_or(|most| cut.triangle_count <= most));
    assert!(query.max_nodes.is_none_or(|most| cut.nodes.len() as u64 <= most));
    assert!(query.max_bytes.is_none_or(|most| cut.byte_count <= most));
    Some((cut, mesh))
}

fn cut_of(nodes: Vec<Node>) -> Cut {
    Cut { nodes, ..Cut::default() }
}

#[test]
fn any_combination_of_levels_is_watertight() {
    let mut random = Random::new(77);
    for (n, seed) in [(0, 1), (0, 2), (0, 3), (1, 4), (1, 5), (2, 6), (3, 7)] {
        let file = open(n, seed);
        for _ in 0..40 {
            let nodes = (0..file.root_count()).map(|root| Node { root, level: random.below(4) as u8 }).collect();
            let mesh = file.extract(&cut_of(nodes)).unwrap();
            assert_eq!(open_edges(&mesh), 0);
            assert_eq!(euler_characteristic(&mesh), 2);
            assert_eq!(mesh.triangles.len(), mesh.triangle_nodes.len());
            assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        }
    }
}

#[test]
fn random_queries_keep_budgets_and_promises() {
    let mut random = Random::new(5);
    for (n, seed) in [(1, 11), (2, 12), (4, 13)] {
        let file = open(n, seed);
        let finest = file.select(&Query::default()).unwrap();
        for _ in 0..300 {
            let corner = |random: &mut Random| [0; 3].map(|_: i32| random.below(1000) as f64 * 0.016 - 2.0);
            let (a, b) = (corner(&mut random), corner(&mut random));
            let region = [0, 1].map(|side| [0, 1, 2].map(|k| if side == 0 { a[k].min(b[k]) } else { a[k].max(b[k]) }));
            let view = (random.below(3) == 0).then(|| {
                let position = corner(&mut random).map(|x| 2.0 * x);
                let (forward, pixel_tolerance) = (position.map(|x| 5.0 - x), random.below(300) as f64 * 0.1);
                View { position, forward, up: [0.1, 0.3, 1.0], pixel_tolerance, ..View::default() }
            });
            let query = Query {
                volume: (random.below(2) == 0).then_some(region.into()),
                view,
                max_bytes: (random.below(4) == 0).then(|| random.below(20_000)),
                outside: if random.below(2) == 0 { Outside::Drop } else { Outside::Coarsest },
                tolerance: (view.is_none() && random.below(2) == 0).then(|| random.below(100) as f64 * 0.01),
                max_triangles: (random.below(2) == 0).then(|| random.below(finest.triangle_count + 100)),
                max_nodes: (random.below(4) == 0).then(|| random.below(u64::from(file.root_count()) + 3)),
                objects: None,
            };
            let Some((cut, mesh)) = within_budgets(&file, &query) else { continue };
            let error = if view.is_some() { cut.pixel_error } else { cut.error };
            let tolerance = view.map(|view| view.pixel_tolerance).or(query.tolerance);
            let meets = tolerance.is_some_and(|tolerance| error <= tolerance);
            assert_eq!(meets, cut.limited_by == Limiter::Tolerance);
            match cut.limited_by {
                Limiter::Triangles => assert!(query.max_triangles.or(query.max_bytes).is_some()),
                Limiter::Bytes => assert!(query.max_bytes.is_some()),
                Limiter::Nodes => panic!("roots cannot be split"),
                Limiter::Tolerance | Limiter::Finest => {}
            }
            if query.volume.is_none() && view.is_none() || query.outside == Outside::Coarsest {
                assert_eq!(open_edges(&mesh), 0);
            }
        }
    }
}

#[test]
fn a_tolerance_alone_gives_the_coarsest_cut_that_meets_it() {
    let file = open(2, 21);
    for tolerance in [2.0, 0.9, 0.3, 0.05] {
        let cut = file.select(&Query { tolerance: Some(tolerance), ..Query::default() }).unwrap();
        // Any root one block coarser would break the tolerance, with these neighbours.
        for (index, node) in cut.nodes.iter().enumerate().filter(|(_, node)| node.level > 0) {
            let coarser = file.decode_root(node.root, node.level - 1).unwrap().level;
            let entry = file.root_entry(node.root).unwrap();
            let block = entry.blocks[entry.block_at(coarser)];
            let error = block.error.bound(&file.lattice());
            let worst = error + block.border_deviation.bound(&file.lattice());
            assert!(worst * 1.0001 > tolerance, "node {index}");
        }
        let budget = Query { tolerance: Some(tolerance), max_triangles: Some(u64::MAX), ..Query::default() };
        assert_eq!(file.select(&budget).unwrap(), cut);
    }
}

#[test]
fn without_wishes_everything_is_finest_and_with_little_budget_coarsest() {
    let file = open(2, 31);
    let cut = file.select(&Query::default()).unwrap();
    assert_eq!(cut.limited_by, Limiter::Finest);
    for node in &cut.nodes {
        assert_eq!(file.decode_root(node.root, 3).unwrap().level, node.level);
    }
    let least = file.level(0).unwrap().triangle_count;
    let coarsest = file.select(&Query { max_triangles: Some(least), ..Query::default() }).unwrap();
    assert_eq!(coarsest.triangle_count, least);
    let error = file.select(&Query { max_triangles: Some(least - 1), ..Query::default() }).unwrap_err();
    assert!(error.to_string().contains(&format!("at least {least} triangles")));
    assert!(file.select(&Query { tolerance: Some(f64::NAN), ..Query::default() }).is_err());
    let inverted = [[1.0; 3], [0.0; 3]];
    assert!(file.select(&Query { volume: Some(inverted.into()), ..Query::default() }).is_err());
}
