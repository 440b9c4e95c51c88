//! Threads draw what the state machine alone does.

use super::*;
use crate::session::{Loaders, Mode};

#[test]
fn threads_load_what_frames_want_and_end_with_their_owner() {
    let file = model(3);
    for mode in [Mode::Synchronous, Mode::AsynchronousWithPrefetch] {
        let mut session = session(&file, Options { mode, ..APART });
        let loaders = Loaders::spawn(&session, Arc::new(file.source().clone()), 3);
        let mut random = Random::new(2);
        for _ in 0..10 {
            let [wanted, expected] = [(); 2].map(|()| random_cut(&file, &mut random));
            let mut frame = loaders.frame(&mut session, &wanted, &expected).unwrap();
            assert!(mode != Mode::Synchronous || frame.is_complete);
            while !frame.is_complete {
                loaders.settle();
                frame = loaders.frame(&mut session, &wanted, &expected).unwrap();
            }
            let mesh = session.picture().mesh();
            assert_eq!(triangles(&mesh), triangles(&file.extract(&cut_of(&wanted)).unwrap()));
        }
        drop(loaders);
        assert!(session.take_problems().is_empty());
        assert_eq!(session.counters().failures, 0);
    }
}
