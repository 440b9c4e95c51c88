use std::sync::Arc;

use super::{check_cut, query_of, synthetic::Plane, view_of};
use crate::{
    Cut, Error, Limiter, Node, Outside, Query,
    select::{Adapter, Coherence, View, select_in},
    tests::synthetic::Random,
};

/// A cut made from the changes of all frames.
#[derive(Default)]
struct Follower(std::collections::BTreeMap<u32, u8>);

impl Follower {
    fn follow(&mut self, frame: &crate::select::AdaptReport) {
        for change in &frame.changes {
            match change.level {
                Some(level) => self.0.insert(change.root, level),
                None => self.0.remove(&change.root),
            };
        }
    }

    fn nodes(&self) -> Vec<Node> {
        self.0.iter().map(|(&root, &level)| Node { root, level }).collect()
    }
}

fn check_promises(query: &Query, cut: &Cut) {
    let error = if query.view.is_some() { cut.pixel_error } else { cut.error };
    let tolerance = query.view.map(|view| view.pixel_tolerance).or(query.tolerance);
    let meets = tolerance.is_some_and(|tolerance| error <= tolerance);
    assert_eq!(meets, cut.limited_by == Limiter::Tolerance, "{query:?}");
}

#[test]
fn any_sequence_of_queries_keeps_all_promises() {
    let mut random = Random::new(3);
    for round in 0..40 {
        let plane = Plane { size: 3 + round as u32 % 3, depth: round as u32 % 3, seed: round, ..Plane::default() };
        let hierarchy = plane.hierarchy();
        let mut adapter = Adapter::new(Arc::clone(&hierarchy), &Query::default(), Coherence::default()).unwrap();
        let mut follower = Follower::default();
        for _ in 0..60 {
            let query = query_of(f64::from(plane.size), &mut random);
            let report = adapter.update(&query).unwrap();
            follower.follow(&report);
            let cut = adapter.cut();
            assert_eq!(follower.nodes(), cut.nodes);
            assert_eq!(report.triangle_count, cut.triangle_count);
            assert_eq!((report.limited_by, report.exceeded), (cut.limited_by, cut.exceeded));
            let free = Query { max_triangles: None, max_nodes: None, max_bytes: None, ..query.clone() };
            check_cut(&hierarchy, if cut.exceeded.is_some() { &free } else { &query }, &cut);
            check_promises(&query, &cut);
            match select_in(&hierarchy, &query) {
                Ok(_) => assert_eq!(cut.exceeded, None),
                Err(Error::Query { what }) => assert!(what.contains("at least"), "{what}"),
                Err(error) => panic!("{error}"),
            }
        }
    }
}

fn path(size: f64, frame: u32) -> View {
    let t = f64::from(frame) * 0.01;
    View {
        position: [size * (0.5 + 0.3 * t.sin()), size * (0.4 + 0.3 * (0.7 * t).cos()), 0.6],
        forward: [(0.5 * t).cos(), (0.5 * t).sin(), -0.6],
        up: [0.0, 0.0, 1.0],
        near: 0.01,
        pixel_tolerance: 8.0,
        ..View::default()
    }
}

/// Along a path a coherent cut meets the same promises as one from scratch and costs little more, and much less work.
#[test]
fn coherent_cuts_follow_cuts_from_scratch() {
    for (max_triangles, depth) in [(None, 0), (Some(4000), 0), (None, 2), (Some(2500), 2)] {
        let plane = Plane { size: 24 >> depth, depth, resolutions: 5, seed: 5, ..Plane::default() };
        let hierarchy = plane.hierarchy();
        let query = |frame| Query {
            view: Some(path(f64::from(plane.size), frame)),
            max_triangles,
            max_nodes: Some(400),
            ..Query::default()
        };
        let mut adapter = Adapter::new(Arc::clone(&hierarchy), &query(0), Coherence::default()).unwrap();
        let (mut triangles, mut triangles_from_scratch) = (0, 0);
        let (mut error, mut error_from_scratch) = (0.0, 0.0);
        let mut work = 0;
        for frame in 1..400 {
            let query = query(frame);
            work += adapter.update(&query).unwrap().evaluation_count;
            let (cut, from_scratch) = (adapter.cut(), select_in(&hierarchy, &query).unwrap());
            check_cut(&hierarchy, &query, &cut);
            check_promises(&query, &cut);
            triangles += cut.triangle_count;
            triangles_from_scratch += from_scratch.triangle_count;
            error += cut.pixel_error;
            error_from_scratch += from_scratch.pixel_error;
        }
        let (more, worse) = (triangles as f64 / triangles_from_scratch as f64, error / error_from_scratch);
        println!(
            "{max_triangles:?} {depth}: {more:.3} triangles, {worse:.3} error, {} evaluations a frame",
            work / 399
        );
        assert!(more < 1.15, "{more} times the triangles");
        assert!(worse < 1.25, "{worse} times the error");
    }
}

#[test]
fn a_camera_that_rests_changes_nothing_and_costs_nothing() {
    let mut random = Random::new(17);
    for depth in 0..3 {
        let hierarchy = Plane { size: 6, depth, seed: 2, ..Plane::default() }.hierarchy();
        for budget in [None, Some(2000)] {
            let view = view_of(6.0, &mut random);
            let query =
                Query { view: Some(view), max_triangles: budget, outside: Outside::Coarsest, ..Query::default() };
            let mut adapter = Adapter::new(Arc::clone(&hierarchy), &query, Coherence::default()).unwrap();
            for _ in 0..100 {
                adapter.update(&query).unwrap();
            }
            let frame = adapter.update(&query).unwrap();
            assert_eq!(frame.changes, [], "{depth} {budget:?}");
            assert!(frame.evaluation_count < 400, "{depth} {budget:?}: {}", frame.evaluation_count);
        }
    }
}

#[test]
fn hysteresis_keeps_a_trembling_camera_from_flickering() {
    let hierarchy = Plane { size: 32, seed: 4, resolutions: 5, ..Plane::default() }.hierarchy();
    let changes = |coherence: Coherence| {
        let query = |frame: u32| {
            let height = if frame.is_multiple_of(2) { 30.0 } else { 31.0 };
            let (position, forward) = ([16.0, 16.0, height], [0.0, 0.0, -1.0]);
            let view = View { position, forward, pixel_tolerance: 0.5, ..View::default() };
            Query { view: Some(view), ..Query::default() }
        };
        let mut adapter = Adapter::new(Arc::clone(&hierarchy), &query(0), coherence).unwrap();
        adapter.update(&query(0)).unwrap();
        (1..100).map(|frame| adapter.update(&query(frame)).unwrap().changes.len()).sum::<usize>()
    };
    let (still, flickering) = (changes(Coherence::default()), changes(Coherence { hysteresis: 0.0, play: 0.0 }));
    assert!(flickering > 100 && still * 20 < flickering, "{still} {flickering}");
}
