//! Sources that fail and pages that are damaged: the rest is drawn.

use super::*;
use crate::{
    Error,
    stream::{Mode, Shows, Simulation},
    tests::cuts::open_edges,
};

const LATENCY: Duration = Duration::from_millis(20);

#[test]
fn a_source_that_fails_now_and_then_only_takes_longer() {
    let file = model(3);
    for mode in [Mode::Synchronous, Mode::Asynchronous] {
        let faulty = Faulty::new(file.source());
        let offsets = reads_of(&file, &[uniform(&file, 3)]);
        *faulty.failures.lock().unwrap() = offsets.iter().step_by(2).map(|&offset| (offset, 2)).collect();
        let mut session = session(&file, Options { mode, ..APART });
        let mut simulation = Simulation::new(faulty, LATENCY);
        let wanted = uniform(&file, 3);
        let mut frames = 0;
        while !simulation.frame(&mut session, &wanted, &[]).unwrap().is_complete {
            simulation.advance(&session, LATENCY / 2);
            frames += 1;
            assert!(frames < 1000);
        }
        let counters = session.counters();
        assert_eq!(counters.retries, 2 * offsets.len().div_ceil(2) as u64);
        assert_eq!((counters.failures, session.take_problems().len()), (0, 0));
        assert_eq!(triangles(&session.picture().mesh()), triangles(&file.extract(&cut_of(&wanted)).unwrap()));
    }
}

#[test]
fn damage_in_the_middle_of_a_session_leaves_the_rest_drawable_and_is_told_once() {
    let file = model(4);
    let [coarse, fine] = [0, 3].map(|level| uniform(&file, level));
    let known = reads_of(&file, std::slice::from_ref(&coarse));
    let all = reads_of(&file, &[coarse.clone(), fine.clone()]);
    let fine_pages: Vec<u64> = all.into_iter().filter(|offset| !known.contains(offset)).collect();
    let mut lost_some = 0;
    for &page in &fine_pages {
        let mut faulty = Faulty::new(file.source());
        faulty.damaged.insert(page);
        let mut session = session(&file, APART);
        let mut simulation = Simulation::new(faulty, LATENCY);
        simulation.frame(&mut session, &coarse, &[]).unwrap();
        simulation.settle(&session);
        let mut problems = Vec::new();
        for _ in 0..12 {
            let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
            assert_eq!(frame.shows, Shows::Picture);
            assert_eq!(open_edges(&session.picture().mesh()), 0);
            problems.extend(session.take_problems());
            simulation.advance(&session, Duration::from_millis(50));
        }
        assert_eq!(problems.len(), 1, "{problems:?}");
        assert!(matches!(&problems[0].error, Error::Format { what: "the checksum does not match", .. }));
        let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
        assert!(frame.is_complete && frame.lost_roots.is_empty(), "what is lost is no longer wanted");
        let drawn = session.picture().nodes();
        let coarser = drawn.iter().zip(&file.uniform_cut(3).unwrap().nodes).filter(|(a, b)| a.level < b.level).count();
        assert!(coarser > 0);
        lost_some += usize::from(coarser < drawn.len());
        assert_eq!(triangles(&session.picture().mesh()), triangles(&file.extract(&cut_of(&drawn)).unwrap()));
    }
    assert!(lost_some * 2 > fine_pages.len());
}

#[test]
fn a_synchronous_session_does_not_wait_for_what_is_lost() {
    let file = model(3);
    let fine = uniform(&file, 3);
    let pages = reads_of(&file, std::slice::from_ref(&fine));
    for page in pages {
        let faulty = Faulty::new(file.source());
        faulty.failures.lock().unwrap().insert(page, u32::MAX);
        let mut session = session(&file, Options { mode: Mode::Synchronous, ..APART });
        let mut simulation = Simulation::new(faulty, LATENCY);
        let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
        assert!(frame.is_complete);
        assert_eq!(session.take_problems().len(), 1);
        let drawn = session.picture().roots().len();
        assert_eq!(drawn + frame.lost_roots.len(), file.root_count() as usize);
        // Once the source is well again, so is the picture.
        simulation.source().failures.lock().unwrap().clear();
        session.retry_failed();
        let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
        assert!(frame.is_complete && frame.lost_roots.is_empty());
        assert_eq!(triangles(&session.picture().mesh()), triangles(&file.extract(&cut_of(&fine)).unwrap()));
    }
}

#[test]
fn a_slow_source_that_fails_often_costs_time_and_no_frame_a_crack() {
    let file = model(4);
    let known = reads_of(&file, &[uniform(&file, 0)]);
    for mode in [Mode::Asynchronous, Mode::AsynchronousWithPrefetch] {
        let mut random = Random::new(77);
        let faulty = Faulty::new(file.source());
        // Pages of finer levels: two of three fail, and one of ten for good.
        let failures = reads_of(&file, &[uniform(&file, 0), uniform(&file, 3)]).into_iter();
        let failures = failures.filter(|at| !known.contains(at)).map(|at| match random.below(10) {
            0 => (at, u32::MAX),
            count => (at, count as u32 % 3),
        });
        *faulty.failures.lock().unwrap() = failures.collect();
        let (byte_cache, decoded_cache) = (3000, 60_000);
        let mut session = session(&file, Options { mode, byte_cache, decoded_cache, ..APART });
        let mut simulation = Simulation::new(faulty, LATENCY);
        let (mut problems, mut pictures) = (Vec::new(), 0);
        let mut expected = random_cut(&file, &mut random);
        for step in 0..120 {
            let wanted = expected.clone();
            if step % 3 == 2 {
                let root = random.below(u64::from(file.root_count())) as usize;
                expected[root..].iter_mut().take(9).for_each(|node| node.level = random.below(4) as u8);
            }
            let frame = simulation.frame(&mut session, &wanted, &expected).unwrap();
            problems.extend(session.take_problems());
            assert!(frame.lost_roots.is_empty());
            if frame.shows == Shows::Nothing {
                assert_eq!(pictures, 0);
            } else {
                pictures += 1;
                assert_eq!(session.picture().roots().len(), file.root_count() as usize);
                assert_eq!(open_edges(&session.picture().mesh()), 0, "{mode:?}, frame {step}");
            }
            let (cached, held) = (session.cached_bytes(), session.held_bytes());
            assert!(cached[0] <= byte_cache.max(held[0]) && cached[1] <= decoded_cache.max(held[1]));
            simulation.advance(&session, Duration::from_millis(7));
        }
        let counters = session.counters();
        assert!(
            pictures > 100 && counters.retries > 10 && counters.decoded > 3 && counters.stalls == 0,
            "{counters:?}"
        );
        assert!(problems.iter().all(|problem| matches!(&problem.error, Error::Io { .. })));
        assert_eq!(problems.len() as u64, counters.failures);
    }
}
