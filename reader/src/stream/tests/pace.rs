//! Frames that may draw only so many bytes of new surfaces.

use std::collections::BTreeMap;

use super::{
    trees::{check, random_antichain, tree},
    *,
};
use crate::stream::{Shows, Simulation};

#[test]
fn no_frame_draws_more_that_is_new_than_its_pace_but_for_one_step_and_all_of_it_comes() {
    for (seed, upload_bytes) in [(1, 0), (2, 20_000), (3, 60_000), (4, 1 << 40)] {
        let file = tree(seed);
        let mut random = Random::new(seed);
        let mut session = session(&file, Options { upload_bytes, ..APART });
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        let (mut limited, mut most_frames) = (0, 0);
        for step in 0..16 {
            let depth = random.below(8);
            let wanted = random_antichain(&file, depth, &mut random);
            // Some cuts are left before they are drawn.
            let patience = if step % 4 == 0 { 3 } else { 2000 };
            for frame_count in 0..patience {
                let before = session.picture().nodes();
                let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
                simulation.settle(&session);
                assert_eq!(frame.shows, Shows::Picture);
                check(&file, session.picture());
                let was_drawn = |root: &u32| before.binary_search_by_key(root, |node| node.root).is_ok();
                let mut steps: BTreeMap<u32, u64> = BTreeMap::new();
                for root in &frame.changes.surfaces {
                    let above = std::iter::successors(Some(*root), |root| file.parent(*root).unwrap());
                    let bytes = session.picture().root(*root).unwrap().surface.byte_count();
                    *steps.entry(above.into_iter().find(was_drawn).unwrap_or(*root)).or_default() += bytes;
                }
                let sum: u64 = steps.values().sum();
                assert!(before.is_empty() || steps.len() <= 1 || sum <= upload_bytes, "{steps:?}");
                limited += u32::from(!before.is_empty() && frame.late_roots == 0 && !frame.is_complete);
                most_frames = most_frames.max(frame_count);
                if frame.is_complete {
                    break;
                }
                assert!(frame_count < 1999, "what waits never comes");
            }
            if patience > 3 {
                let drawn = session.picture().nodes();
                let as_drawn = |node: &Node| file.decode_root(node.root, node.level).unwrap().level;
                assert!(drawn.iter().map(|n| (n.root, n.level)).eq(wanted.iter().map(|n| (n.root, as_drawn(n)))));
                for _ in 0..5 {
                    let changes = simulation.frame(&mut session, &wanted, &[]).unwrap().changes;
                    assert!(changes.surfaces.is_empty() && changes.removed.is_empty());
                }
            }
        }
        println!("{upload_bytes}: {limited} frames, at most {most_frames} for a cut");
        assert_eq!(limited > 0, upload_bytes < 1 << 40);
    }
}
