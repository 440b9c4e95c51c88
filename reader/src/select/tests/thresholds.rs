//! Cuts that begin with the one of a threshold, beside those of the quad-queue that climbs from the coarsest cut.

use std::{collections::BTreeMap, sync::Arc};

use super::{check_cut, query_of, synthetic::Plane};
use crate::{
    Cut, Limiter, Outside, Query,
    select::{
        Adapter, Coherence, Hierarchy,
        adaptation::Adaptation,
        cut::check_budgets,
        front::Front,
        quad_queue::{self, Effort},
        select_in,
        weights::Weights,
    },
    tests::synthetic::Random,
};

/// The cut to which the quad-queue climbs, if the coarsest one keeps the budgets.
fn climbed(hierarchy: &Arc<Hierarchy>, query: &Query) -> Option<Cut> {
    let weights = Weights::new(hierarchy, query.scope().unwrap(), 0.0);
    let front = Front::new(Arc::clone(hierarchy), weights, query.outside == Outside::Coarsest);
    let goal = query.goal(0.0);
    check_budgets(&goal, &front).ok()?;
    let mut adaptation = Adaptation::new(front, goal, quad_queue::NEEDED, -1.0);
    adaptation.adapt_quad_queue(Effort::FULL);
    Some(adaptation.cut())
}

fn error_of(query: &Query, cut: &Cut) -> f64 {
    if query.view.is_some() { cut.pixel_error } else { cut.error }
}

fn finest_count(hierarchy: &Arc<Hierarchy>) -> u64 {
    select_in(hierarchy, &Query { tolerance: Some(0.0), ..Query::default() }).unwrap().triangle_count
}

#[test]
fn errors_are_those_of_the_quad_queue_in_any_case() {
    let mut random = Random::new(77);
    let (mut worse, mut better, mut count, mut fewer, mut more) = (0, 0, 0, 0, 0);
    for round in 0..200 {
        let (size, depth) = (2 + round as u32 % 6, round as u32 % 3);
        let plane = Plane { size, depth, seed: 1000 + round, ..Plane::default() };
        let hierarchy = plane.hierarchy();
        let finest = finest_count(&hierarchy) as f64;
        for _ in 0..CASES {
            let mut query = query_of(f64::from(size), &mut random);
            query.max_triangles = Some((finest * random.unit() * random.unit()) as u64);
            let Some(climbed) = climbed(&hierarchy, &query) else {
                assert!(select_in(&hierarchy, &query).is_err());
                continue;
            };
            let cut = select_in(&hierarchy, &query).unwrap();
            check_cut(&hierarchy, &query, &cut);
            let (error, least) = (error_of(&query, &cut), error_of(&query, &climbed));
            let meets = |cut: &Cut| cut.limited_by == Limiter::Tolerance;
            assert!(meets(&cut) || !meets(&climbed));
            if meets(&cut) {
                (fewer, more) = (
                    fewer + u32::from(cut.triangle_count < climbed.triangle_count),
                    more + u32::from(cut.triangle_count > climbed.triangle_count),
                );
                continue;
            }
            // In trees both propose splits from where they are, and neither finds the best of all.
            assert!(error <= least || depth > 0, "{error} {least} {query:?}");
            (worse, better, count) = (worse + u32::from(error > least), better + u32::from(error < least), count + 1);
        }
    }
    println!("{count} cases within budgets: {worse} with larger errors, {better} with smaller ones");
    println!("cases within tolerances: {more} with more triangles, {fewer} with fewer");
    assert!(worse < better && more * 10 < fewer, "{worse} {better} {more} {fewer}");
}

/// Enough for every branch; 10,000 cases with 50.
const CASES: u32 = 10;

#[test]
fn budgets_are_used_up_and_never_exceeded() {
    let mut random = Random::new(5);
    let mut shares = BTreeMap::new();
    for depth in [0, 2] {
        let hierarchy = Plane { size: 48 >> depth, depth, seed: 9, ..Plane::default() }.hierarchy();
        let finest = finest_count(&hierarchy) as f64;
        for _ in 0..20 {
            let query =
                Query { max_triangles: Some((finest * (0.05 + 0.9 * random.unit())) as u64), ..Query::default() };
            let cut = select_in(&hierarchy, &query).unwrap();
            check_cut(&hierarchy, &query, &cut);
            let share = cut.triangle_count as f64 / query.max_triangles.unwrap() as f64;
            shares.entry(depth).or_insert_with(Vec::new).push(share);
        }
    }
    for (depth, shares) in shares {
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        println!("depth {depth}: {mean:.5} of a budget");
        assert!(mean >= 0.995, "{mean}");
    }
}

#[test]
fn budgets_of_nothing_and_of_more_than_there_is_are_no_trouble() {
    for depth in 0..3 {
        let hierarchy = Plane { size: 3, depth, ..Plane::default() }.hierarchy();
        let all = select_in(&hierarchy, &Query::default()).unwrap();
        for which in 0..3 {
            let query = |budget: u64| {
                let of = |k: u32| (k == which).then_some(budget);
                Query { max_triangles: of(0), max_nodes: of(1), max_bytes: of(2), ..Query::default() }
            };
            let error = select_in(&hierarchy, &query(0)).unwrap_err().to_string();
            assert!(error.contains("at least"), "{error}");
            let mut adapter = Adapter::new(Arc::clone(&hierarchy), &query(0), Coherence::default()).unwrap();
            assert!(adapter.update(&query(0)).unwrap().exceeded.is_some());
            for much in [1 << 63, u64::MAX] {
                let cut = select_in(&hierarchy, &query(much)).unwrap();
                check_cut(&hierarchy, &query(much), &cut);
                assert_eq!((cut.error, cut.limited_by), (all.error, Limiter::Finest));
            }
        }
    }
}
