//! Threads draw what the state machine alone does, and end with their owner.

use super::*;
use crate::{
    Error,
    stream::{Loaders, Mode, Shows},
    tests::cuts::open_edges,
};

#[test]
fn threads_load_what_frames_want() {
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
        assert!(session.take_problems().is_empty());
        assert_eq!(session.counters().failures, 0);
    }
}

#[test]
fn threads_end_with_the_session_or_the_loaders_whichever_goes_first() {
    let file = model(2);
    for drops_session in [false, true] {
        let source = Arc::new(file.source().clone());
        let mut session = session(&file, APART);
        let loaders = Loaders::spawn(&session, source.clone(), 4);
        loaders.frame(&mut session, &uniform(&file, 3), &[]).unwrap();
        if drops_session {
            drop(session);
            // Each thread has a share of the source.
            for _ in 0..1000 {
                if Arc::strong_count(&source) == 1 {
                    break;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        } else {
            drop(loaders);
        }
        assert_eq!(Arc::strong_count(&source), 1);
    }
}

/// A source that panics where some reads begin.
struct Panicking(Vec<u8>, BTreeSet<u64>);

impl ReadAt for Panicking {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        assert!(!self.1.contains(&offset), "on purpose");
        self.0.read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        self.0.size()
    }
}

#[test]
fn a_source_that_panics_is_reported_and_the_rest_is_drawn() {
    let file = model(2);
    let [coarse, fine] = [0, 3].map(|level| uniform(&file, level));
    let known = reads_of(&file, std::slice::from_ref(&coarse));
    let bad: BTreeSet<u64> =
        reads_of(&file, &[coarse, fine.clone()]).into_iter().filter(|at| !known.contains(at)).step_by(5).collect();
    for mode in [Mode::Synchronous, Mode::Asynchronous] {
        let retry_delay = Duration::from_millis(1);
        let mut session = session(&file, Options { mode, max_attempts: 2, retry_delay, ..APART });
        let source = Arc::new(Panicking(file.source().clone(), bad.clone()));
        let loaders = Loaders::spawn(&session, source, 2);
        let mut frame = loaders.frame(&mut session, &fine, &[]).unwrap();
        while !frame.is_complete {
            loaders.settle();
            frame = loaders.frame(&mut session, &fine, &[]).unwrap();
        }
        assert!(frame.shows == Shows::Picture && frame.lost_roots.is_empty());
        assert_eq!(open_edges(&session.picture().mesh()), 0);
        let problems = session.take_problems();
        assert!(!problems.is_empty());
        assert!(problems.iter().all(
            |problem| matches!(&problem.error, Error::Io { source, .. } if source.to_string().contains("panicked"))
        ));
    }
}
