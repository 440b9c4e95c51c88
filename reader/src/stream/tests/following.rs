//! A camera is followed: with threads, and by cuts alone.

use super::*;
#[cfg(feature = "threads")]
use crate::stream::{Mode, Shows, StreamerOptions};
use crate::{
    Outside, Query,
    select::{Coherence, View, select_in, tests::synthetic::Plane},
    stream::Follower,
};

/// Circles the cube.
fn query(file: &File<Vec<u8>>, step: u32) -> Query {
    let bounds = file.bounds().unwrap();
    let mut view = View { pixel_tolerance: 4.0, ..View::around(bounds, [0.0, 0.0, 1.0], f64::from(step) * 0.05, 0.3) };
    view.shift([0.0, 0.0, (bounds[1][0] - bounds[0][0]) * 0.5]);
    Query { view: Some(view), outside: Outside::Coarsest, ..Query::default() }
}

#[test]
fn what_is_expected_is_what_later_frames_want() {
    let file = model(3);
    let hierarchy = Arc::new(file.hierarchy().unwrap());
    let exact = Coherence { hysteresis: 0.0, play: 0.0 };
    let follower = |ahead: u32| Follower::new(hierarchy.clone(), exact, Duration::from_millis(ahead.into()));
    let [mut follower, mut idle] = [60, 0].map(follower);
    for step in 0..30 {
        let now = Duration::from_millis(20 * u64::from(step));
        let (wanted, expected) = follower.follow(&query(&file, step), now).unwrap();
        assert_eq!(wanted.nodes, select_in(&hierarchy, &query(&file, step)).unwrap().nodes);
        let later = select_in(&hierarchy, &query(&file, step + 3)).unwrap().nodes;
        let agreeing = expected.iter().zip(&later).filter(|(a, b)| a == b).count();
        assert!(if step == 0 { expected.is_empty() } else { agreeing * 10 > later.len() * 8 }, "{agreeing}");
        assert_eq!(idle.follow(&query(&file, step), now).unwrap(), (wanted, Vec::new()));
    }
    // It stands still.
    let (_, expected) = follower.follow(&query(&file, 29), Duration::from_secs(1)).unwrap();
    assert!(expected.is_empty());
}

#[test]
fn what_only_the_predicted_view_breaks_stops_no_frame() {
    let hierarchy = Plane { size: 24, ..Plane::default() }.hierarchy();
    let above = |height: f64| View {
        position: [12.0, 12.0, height],
        forward: [0.0, 0.0, -1.0],
        near: 0.01,
        pixel_tolerance: 4.0,
        ..View::default()
    };
    // The camera rises, so the predicted view has more roots than the budget; or the prediction is no view at all.
    for height in [|step: u32| 1.0 + f64::from(step), |step: u32| 1e307 * f64::from(step)] {
        let mut follower = Follower::new(hierarchy.clone(), Coherence::default(), Duration::from_millis(600));
        for step in 1..6 {
            let free = Query { view: Some(above(height(step))), ..Query::default() };
            let max_nodes = Some(select_in(&hierarchy, &free).unwrap().nodes.len() as u64);
            let now = Duration::from_millis(20 * u64::from(step));
            let (wanted, _) = follower.follow(&Query { max_nodes, ..free }, now).unwrap();
            assert_eq!(Some(wanted.nodes.len() as u64), max_nodes);
        }
    }
}

#[cfg(feature = "threads")]
#[test]
fn a_streamer_comes_to_draw_what_its_view_wants_as_exactly_as_that_asks() {
    let file = model(3);
    for mode in [Mode::Synchronous, Mode::AsynchronousWithPrefetch] {
        let options = StreamerOptions { session: Options { mode, ..APART }, ..StreamerOptions::default() };
        let mut streamer = file.streamer(options).unwrap();
        let (mut bytes, mut stalls) = (0, 0);
        for step in 0..20 {
            let query = query(&file, step);
            let mut streamed = streamer.frame(&query).unwrap();
            (bytes, stalls) = (bytes + streamed.bytes_read, stalls + u64::from(streamed.has_stalled));
            while mode != Mode::Synchronous && !streamed.is_complete() {
                streamer.settle();
                streamed = streamer.frame(&query).unwrap();
                bytes += streamed.bytes_read;
            }
            assert!(streamed.is_complete() && streamed.is_whole() && streamed.frame.shows == Shows::Picture);
            assert_eq!(streamer.triangle_count(), streamer.picture().mesh().triangles.len() as u64);
            let cut = cut_of(&streamer.picture().nodes());
            assert_eq!(triangles(&streamer.picture().mesh()), triangles(&file.extract(&cut).unwrap()));
            let (view, finest) = (query.view.unwrap(), file.level_count() as u8 - 1);
            let is_finest = |node: &Node| node.level == finest;
            let error_px = streamer.error_px(&view).unwrap();
            assert!(error_px > 0.0 && (error_px <= 4.0 || cut.nodes.iter().any(is_finest)), "{error_px}");
        }
        let counters = streamer.counters()[0];
        assert!(bytes <= counters.bytes_read && stalls == counters.stalls);
        assert!(
            mode != Mode::Synchronous || (bytes == counters.bytes_read && stalls > 0),
            "{bytes} {stalls} {counters:?}"
        );
        let coarsest = file.uniform_cut(0).unwrap().nodes;
        streamer.show(&coarsest).unwrap();
        streamer.settle();
        streamer.show(&coarsest).unwrap();
        assert_eq!(streamer.picture().nodes(), coarsest);
    }
}
