use super::{check_cut, query_of, synthetic::Plane};
use crate::{Error, Limiter, Query, select::select_in, tests::synthetic::Random};

/// 10,000 queries: no budget is exceeded that the coarsest cut can meet, and the tolerance is met unless a budget or
/// the hierarchy forbids it.
#[test]
fn random_queries_keep_budgets_tolerances_and_wholeness() {
    let mut random = Random::new(8);
    let mut seen = std::collections::BTreeMap::new();
    for round in 0..100 {
        let plane = Plane { size: 3 + round as u32 % 4, depth: round as u32 % 3, seed: round, ..Plane::default() };
        let hierarchy = plane.hierarchy();
        for _ in 0..100 {
            let query = query_of(f64::from(plane.size), &mut random);
            let cut = match select_in(&hierarchy, &query) {
                Ok(cut) => cut,
                Err(Error::Query { what }) => {
                    assert!(what.contains("at least"), "{what}");
                    *seen.entry("refused").or_insert(0) += 1;
                    continue;
                }
                Err(error) => panic!("{error}"),
            };
            check_cut(&hierarchy, &query, &cut);
            let error = if query.view.is_some() { cut.pixel_error } else { cut.error };
            let tolerance = query.view.map(|view| view.pixel_tolerance).or(query.tolerance);
            let meets = tolerance.is_some_and(|tolerance| error <= tolerance);
            let name = match cut.limited_by {
                Limiter::Tolerance => "tolerance",
                Limiter::Finest => "finest",
                Limiter::Triangles => "triangles",
                Limiter::Nodes => "nodes",
                Limiter::Bytes => "bytes",
            };
            *seen.entry(name).or_insert(0) += 1;
            assert_eq!(meets, cut.limited_by == Limiter::Tolerance, "{query:?} {error}");
            match cut.limited_by {
                Limiter::Triangles => assert!(query.max_triangles.is_some() || query.max_bytes.is_some()),
                Limiter::Nodes => assert!(query.max_nodes.is_some()),
                Limiter::Bytes => assert!(query.max_bytes.is_some()),
                _ => {}
            }
        }
    }
    assert!(seen.len() == 6 && seen.values().all(|&count| count > 50), "{seen:?}");
}

#[test]
fn splitting_saves_triangles_and_more_nodes_save_more() {
    for seed in 0..20 {
        let hierarchy = Plane { size: 3, depth: 2, seed, deviation: 0.0, ..Plane::default() }.hierarchy();
        let triangles = |nodes: u64| {
            let query = Query { tolerance: Some(0.02), max_nodes: Some(nodes), ..Query::default() };
            let cut = select_in(&hierarchy, &query).unwrap();
            check_cut(&hierarchy, &query, &cut);
            assert_eq!(cut.limited_by, Limiter::Tolerance);
            cut.triangle_count
        };
        let counts = [9, 30, 60, 144].map(triangles);
        assert!(counts[0] > counts[1] && counts[1] >= counts[2] && counts[2] >= counts[3], "{counts:?}");
    }
}

#[test]
fn more_nodes_lower_the_error_within_a_triangle_budget() {
    let mut better = 0;
    for seed in 0..20 {
        let hierarchy = Plane { size: 3, depth: 2, seed, deviation: 0.2, ..Plane::default() }.hierarchy();
        let error = |nodes: u64| {
            let query = Query { max_triangles: Some(600), max_nodes: Some(nodes), ..Query::default() };
            let cut = select_in(&hierarchy, &query).unwrap();
            check_cut(&hierarchy, &query, &cut);
            cut.error
        };
        let (few, many) = (error(9), error(100));
        assert!(many <= few);
        better += usize::from(many < few);
    }
    assert!(better > 5, "{better}");
}
