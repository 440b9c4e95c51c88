//! Sessions of a file with a large index read the parts of it that their frames want.

use std::{sync::Arc, time::Duration};

use crate::{
    File, Limits, Query, View,
    source::Recording,
    stream::{Mode, Options, Simulation, StreamerOptions},
    tests::synthetic::{self, cube, listed_file_of},
};

fn large() -> Vec<u8> {
    let options = synthetic::Options { levels: 3, seed: 5, grids_of_four: 1, heights: 5 };
    listed_file_of(&cube(16), options)
}

fn view(distance: f64) -> View {
    View {
        position: [5.0 + distance, 5.0, 5.0],
        forward: [-1.0, 0.0, 0.0],
        up: [0.0, 0.0, 1.0],
        near: 1e-3,
        ..View::default()
    }
}

#[test]
fn a_session_reads_the_index_of_what_it_draws() {
    let bytes = large();
    let file_bytes = bytes.len() as u64;
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    let read = || file.source().take().iter().map(|range| range.end - range.start).sum::<u64>();
    let index_bytes = file.index().index_bytes();
    assert!(index_bytes > 64 << 10);
    read();
    let options = Options { mode: Mode::Asynchronous, ..Options::default() };
    let mut session = file.session(options).unwrap();
    assert!(read() * 4 < index_bytes);
    let query = Query { volume: Some([[0.0; 3], [1.0; 3]].into()), ..Query::default() };
    let cut = file.select(&query).unwrap();
    let mut simulation = Simulation::new(file.source(), Duration::from_millis(50));
    let first = simulation.frame(&mut session, &cut.nodes, &[]).unwrap();
    assert!(!first.is_complete);
    simulation.settle(&session);
    assert!(simulation.frame(&mut session, &cut.nodes, &[]).unwrap().is_complete);
    assert_eq!(session.picture().nodes().len(), cut.nodes.len());
    assert_eq!(session.picture().triangle_count(), cut.triangle_count);
    let more = read();
    assert!(more * 4 < file_bytes * 3, "{more} of {file_bytes}");
    // What nobody has chosen is not known.
    let far = crate::Node { root: file.root_count() - 1, level: 7 };
    assert!(matches!(session.begin(&[far], &[], simulation.now()), Err(crate::Error::Missing { .. })));
}

#[test]
fn a_streamer_walks_down_to_what_its_view_wants() {
    let bytes: Arc<[u8]> = large().into();
    let file = File::open(Arc::clone(&bytes), Limits::default()).unwrap();
    let best = File::open(Arc::clone(&bytes), Limits::default()).unwrap();
    let mut streamer = file.streamer(StreamerOptions::default()).unwrap();
    for distance in [300.0, 30.0, 7.0] {
        let query = Query { view: Some(view(distance)), ..Query::default() };
        // From near, the file has nothing within a pixel.
        let tolerance = best.select(&query).unwrap().pixel_error.max(1.0);
        let complete = (0..20).any(|_| {
            let streamed = streamer.frame(&query).unwrap();
            assert!(streamed.is_whole());
            streamer.settle();
            streamed.is_complete() && streamer.error_px(&view(distance)).unwrap() <= tolerance
        });
        assert!(complete, "{distance}");
    }
    assert!(streamer.take_problems().is_empty());
}
