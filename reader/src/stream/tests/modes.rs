//! The three modes: what they draw, what they wait for, and what they keep.

use std::time::Duration;

use super::*;
use crate::{
    stream::{Frame, Mode, Shows, Simulation},
    tests::cuts::open_edges,
};

const LATENCY: Duration = Duration::from_millis(50);
const FRAME: Duration = Duration::from_millis(16);
const MODES: [Mode; 3] = [Mode::Synchronous, Mode::Asynchronous, Mode::AsynchronousWithPrefetch];

fn simulate(file: &Arc<File<Vec<u8>>>) -> Simulation<&Vec<u8>> {
    Simulation::new(file.source(), LATENCY)
}

#[test]
fn once_loaded_all_modes_draw_what_extracting_the_cut_gives() {
    for n in [1, 3] {
        let file = model(n);
        for mode in MODES {
            let mut session = session(&file, Options { mode, ..APART });
            let mut simulation = simulate(&file);
            let mut random = Random::new(9);
            for _ in 0..12 {
                let wanted = random_cut(&file, &mut random);
                simulation.frame(&mut session, &wanted, &[]).unwrap();
                simulation.settle(&session);
                let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
                assert!(frame.is_complete && frame.late_roots == 0 && frame.lost_roots.is_empty());
                let mesh = session.picture().mesh();
                assert_eq!(triangles(&mesh), triangles(&file.extract(&cut_of(&wanted)).unwrap()));
                assert_eq!(mesh.triangles.len() as u64, session.picture().triangle_count());
            }
        }
    }
}

/// Draws frames of a wandering cut; calls `check` with each.
fn wander(file: &Arc<File<Vec<u8>>>, options: Options, mut check: impl FnMut(&Session, &Frame, u32)) -> Session {
    let mut session = session(file, options);
    let mut simulation = simulate(file);
    for step in 0..120 {
        // The cut moves on every fourth frame, and that is known eight frames before.
        let (wanted, expected) = (wandering_cut(file, step / 4), wandering_cut(file, step / 4 + 2));
        let frame = simulation.frame(&mut session, &wanted, &expected).unwrap();
        check(&session, &frame, step);
        simulation.advance(&session, FRAME);
    }
    session
}

#[test]
fn every_frame_is_watertight_and_asynchronous_ones_never_wait() {
    let file = model(4);
    for mode in MODES {
        let mut pictures = 0;
        let session = wander(&file, Options { mode, ..APART }, |session, frame, step| {
            // Without an overview, too: the coarsest level came with the session.
            assert_eq!(frame.shows, Shows::Picture, "{mode:?}, frame {step}");
            pictures += 1;
            let mesh = session.picture().mesh();
            assert_eq!(open_edges(&mesh), 0, "{mode:?}, frame {step}");
            assert_eq!(session.picture().roots().len(), file.root_count() as usize);
            let drawn = session.picture().nodes();
            if !frame.is_complete {
                assert_ne!(mode, Mode::Synchronous);
                // As a cut of the file, whatever is there.
                assert_eq!(triangles(&mesh), triangles(&file.extract(&cut_of(&drawn)).unwrap()));
            }
        });
        let counters = session.counters();
        assert_eq!((counters.frames, pictures), (120, 120));
        if mode == Mode::Synchronous {
            // Never longer than the arcs and blocks that are asked for at once take, four at a time.
            assert!(counters.stalls > 5 && counters.stall_time > 5 * LATENCY, "{counters:?}");
            assert_eq!(counters.late_roots, 0);
        } else {
            assert_eq!((counters.stalls, counters.stall_time), (0, Duration::ZERO));
            assert!(counters.late_roots > 0);
        }
    }
}

#[test]
fn prefetch_lowers_demand_misses_and_is_mostly_used() {
    let file = model(4);
    let run = |mode| {
        // What the first frames miss is nobody's fault.
        let mut first = 0;
        let count_first = |session: &Session, _: &Frame, step| {
            if step == 12 {
                first = session.counters().misses;
            }
        };
        let counters = wander(&file, Options { mode, max_reads: 16, ..APART }, count_first).counters();
        (counters, counters.misses - first)
    };
    let [_, (without, missed), (with, missed_with)] = MODES.map(run);
    assert!(missed > 4 && missed_with * 2 <= missed, "{missed_with} against {missed}");
    assert!(with.late_roots < without.late_roots);
    assert!(with.wasted_prefetch_bytes() * 2 < with.prefetch_bytes);
    assert_eq!(without.prefetch_bytes, 0);
}

#[test]
fn the_byte_bounds_are_exceeded_only_by_what_the_frame_needs() {
    let file = model(4);
    for mode in MODES {
        let limits = [3000, 60_000];
        let options = Options { mode, byte_cache: limits[0], decoded_cache: limits[1], ..APART };
        let session = wander(&file, options, |session, _, step| {
            let (cached, held) = (session.cached_bytes(), session.held_bytes());
            for k in 0..2 {
                assert!(cached[k] <= limits[k].max(held[k]), "{mode:?}, frame {step}: {cached:?}, held {held:?}");
            }
        });
        assert!(session.counters().evictions > 10);
    }
}

#[test]
fn the_same_steps_have_the_same_result() {
    let file = model(3);
    let run = || wander(&file, Options { mode: Mode::AsynchronousWithPrefetch, ..APART }, |_, _, _| ()).counters();
    assert_eq!(run(), run());
}

#[test]
fn looking_at_what_changed_alone_does_what_looking_at_everything_does() {
    let file = model(4);
    for mode in MODES {
        // Too small for the path, so that much is evicted and loaded again.
        let options = Options { mode, byte_cache: 3000, decoded_cache: 60_000, ..APART };
        let mut sessions = [0, 1].map(|_| session(&file, options));
        let mut simulations = [0, 1].map(|_| simulate(&file));
        let mut random = Random::new(3);
        for step in 0..200 {
            let mut wanted = wandering_cut(&file, step / 4);
            // Roots leave the cut and come back.
            wanted.retain(|node| node.root % 7 != step / 10 % 7 || random.below(30) > 0);
            let expected = wandering_cut(&file, step / 4 + 2);
            // After this, nothing of the frame before counts.
            sessions[1].retry_failed();
            let frames = [0, 1].map(|k| simulations[k].frame(&mut sessions[k], &wanted, &expected).unwrap());
            assert_eq!(frames[0], frames[1], "{mode:?}, frame {step}");
            assert_eq!(sessions[0].picture().nodes(), sessions[1].picture().nodes());
            assert_eq!(sessions[0].counters(), sessions[1].counters(), "{mode:?}, frame {step}");
            assert_eq!(sessions[0].cached_bytes(), sessions[1].cached_bytes());
            assert_eq!(sessions[0].held_bytes(), sessions[1].held_bytes());
            [0, 1].into_iter().for_each(|k| simulations[k].advance(&sessions[k], FRAME));
        }
        assert!(sessions[0].counters().evictions > 10);
    }
}

#[test]
fn roots_that_are_drawn_as_wanted_are_not_looked_at_again() {
    let file = model(3);
    let mut session = session(&file, APART);
    let mut simulation = simulate(&file);
    let mut wanted = uniform(&file, 1);
    let mut hits = |session: &mut Session, wanted: &[Node]| {
        let before = session.counters().hits;
        simulation.frame(session, wanted, &[]).unwrap();
        let hits = session.counters().hits - before;
        simulation.settle(session);
        hits
    };
    hits(&mut session, &wanted);
    assert!(session.open_count() > 20);
    let all = hits(&mut session, &wanted);
    assert!(session.open_count() == 0 && all > 0);
    let other = wanted.iter().position(|node| file.root_contents(node.root).unwrap().blocks.len() == 4).unwrap();
    wanted[other].level = 3;
    hits(&mut session, &wanted);
    assert_eq!(session.open_count(), 1);
    // What was there before still is.
    wanted[other].level = 1;
    assert_eq!((hits(&mut session, &wanted), session.open_count()), (all, 0));
}

#[test]
fn odd_cuts_are_refused_and_partial_ones_drawn() {
    let file = model(2);
    let mut session = session(&file, APART);
    let node = |root| Node { root, level: 9 };
    for wrong in [vec![node(24)], vec![node(1), node(0)], vec![node(1), node(1)]] {
        assert!(session.begin(&wrong, &[], Duration::ZERO).is_err());
        assert!(session.begin(&[], &wrong, Duration::ZERO).is_err());
    }
    let mut simulation = simulate(&file);
    let wanted = [node(3), node(7), node(8)];
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    simulation.settle(&session);
    let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
    assert!(frame.is_complete);
    assert_eq!(frame.changes.surfaces, [3, 7, 8]);
    assert_eq!(session.picture().nodes().iter().map(|node| node.root).collect::<Vec<_>>(), [3, 7, 8]);
    let frame = simulation.frame(&mut session, &wanted[1..], &[]).unwrap();
    assert_eq!(frame.changes.removed, [3]);
    assert_eq!(session.picture().roots().len(), 2);
}
