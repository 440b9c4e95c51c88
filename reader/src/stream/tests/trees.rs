//! Sessions on trees: every frame is whole, whatever is wanted and whatever is there.

use super::*;
use crate::{
    Outside, Query,
    select::{Adapter, Coherence, View},
    stream::{Frame, Job, Mode, Picture, Shows, Simulation},
    tests::cuts::{euler_characteristic, open_edges},
};

/// A closed surface: a top of six groups of four groups of four roots, each of these with up to three levels.
pub(super) fn tree(seed: u64) -> Arc<File<Vec<u8>>> {
    let bytes = file_of(&cube(4), ModelOptions { levels: 3, seed, grids_of_four: 1, heights: 3 });
    Arc::new(File::open(bytes, Limits::default()).unwrap())
}

/// Nodes that cover everything once. The higher `depth`, the more of them are deep in the tree.
pub(super) fn random_antichain(file: &File<Vec<u8>>, depth: u64, random: &mut Random) -> Vec<Node> {
    let mut nodes = Vec::new();
    let mut pending: Vec<u32> = (0..file.top_count()).collect();
    while let Some(root) = pending.pop() {
        let children = file.children(root).unwrap();
        if !children.is_empty() && random.below(depth + 1) > 0 {
            pending.extend(children);
            continue;
        }
        let blocks = file.root_contents(root).unwrap().blocks;
        nodes.push(Node { root, level: blocks[random.below(blocks.len() as u64) as usize].level });
    }
    nodes.sort_unstable_by_key(|node| node.root);
    nodes
}

fn is_below(file: &File<Vec<u8>>, root: u32, above: u32) -> bool {
    let parent = |root: &u32| file.parent(*root).unwrap();
    std::iter::successors(parent(&root), parent).any(|root| root == above)
}

/// Checks that a picture is one closed surface, which is that of its nodes, with the strips that would be made now.
pub(super) fn check(file: &Arc<File<Vec<u8>>>, picture: &Picture) {
    let mesh = picture.mesh();
    assert_eq!((open_edges(&mesh), euler_characteristic(&mesh)), (0, 2));
    assert_eq!(triangles(&mesh), triangles(&file.extract(&cut_of(&picture.nodes())).unwrap()));
    let mut fresh = Picture::default();
    let surfaces = picture.roots().map(|root| root.surface.clone()).collect();
    fresh.update(Difference { surfaces, ..Difference::default() });
    for (kept, made) in picture.roots().zip(fresh.roots()) {
        assert_eq!(kept.strips, made.strips);
    }
}

/// Does some of a session's jobs, and the reads in flight in any order.
fn do_some(
    file: &File<Vec<u8>>,
    session: &Session,
    flying: &mut Vec<crate::stream::Read>,
    most: u64,
    random: &mut Random,
) {
    for _ in 0..random.below(most) {
        match session.poll(Duration::ZERO) {
            Some(Job::Read(read)) => flying.push(read),
            Some(Job::Decode(decoding)) => session.finish(decoding.run(), Duration::ZERO),
            None => {}
        }
        if random.below(2) == 0 && !flying.is_empty() {
            let read = flying.swap_remove(random.below(flying.len() as u64) as usize);
            session.supply(&read, read.run(file.source()), Duration::ZERO);
        }
    }
}

#[test]
fn every_frame_is_one_closed_surface_whatever_is_there() {
    for (seed, may_stay_finer) in [(1, true), (2, false), (3, true), (4, true)] {
        let file = tree(seed);
        let mut random = Random::new(seed);
        let decoded_cache = if seed == 3 { 1 } else { 64 << 20 };
        let mut session = session(&file, Options { may_stay_finer, decoded_cache, ..APART });
        let mut flying = Vec::new();
        let mut wanted = random_antichain(&file, 4, &mut random);
        let (mut complete, mut late) = (0, 0);
        for step in 0..300 {
            if step % 4 == 0 {
                let depth = random.below(8);
                wanted = random_antichain(&file, depth, &mut random);
            }
            session.begin(&wanted, &[], Duration::ZERO).unwrap();
            let frame = session.end(Duration::ZERO).unwrap();
            // The coarsest level was loaded with the session.
            assert_eq!((frame.shows, frame.lost_roots.len()), (Shows::Picture, 0));
            check(&file, session.picture());
            complete += u32::from(frame.is_complete);
            late += frame.late_roots;
            assert!(!frame.is_complete || frame.late_roots == 0);
            if frame.is_complete {
                let drawn = session.picture().nodes();
                let file = &file;
                let as_drawn =
                    |node: &Node| Node { level: file.decode_root(node.root, node.level).unwrap().level, ..*node };
                assert!(drawn.iter().copied().eq(wanted.iter().map(as_drawn)));
            }
            do_some(&file, &session, &mut flying, 30, &mut random);
        }
        assert!(complete > 20 && late > 100, "{complete} {late}");
    }
}

#[test]
fn strips_name_every_edge_of_a_loop_once_from_end_to_end() {
    let mut random = Random::new(7);
    for seed in 1..4 {
        let file = tree(seed);
        let mut session = session(&file, APART);
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        let mut longest = 0;
        for _ in 0..10 {
            let wanted = random_antichain(&file, 2, &mut random);
            simulation.frame(&mut session, &wanted, &[]).unwrap();
            simulation.settle(&session);
            assert!(simulation.frame(&mut session, &wanted, &[]).unwrap().is_complete);
            for drawn in session.picture().roots() {
                let mut of_side = vec![Vec::new(); drawn.surface.half_arcs().len()];
                for edge in drawn.surface.border_triangles().flat_map(|(_, edges)| edges) {
                    longest = longest.max(edge.len());
                    assert!(edge.windows(2).all(|pair| pair[0].side + 1 == pair[1].side));
                    edge.iter().for_each(|part| of_side[part.side as usize].push(part.params));
                }
                for (half_arc, mut params) in drawn.surface.half_arcs().zip(of_side) {
                    if half_arc.reversed {
                        params.iter_mut().for_each(|params| params.reverse());
                    }
                    params.sort_unstable();
                    let ends = (params.first().unwrap()[0], params.last().unwrap()[1]);
                    assert_eq!(ends, (0, crate::write::PARAM_END));
                    assert!(params.windows(2).all(|pair| pair[0][1] == pair[1][0]));
                }
            }
        }
        assert!(longest > 1);
    }
}

/// A session that has drawn a cut, and its clock.
fn drawn<'f>(file: &'f Arc<File<Vec<u8>>>, options: Options, nodes: &[Node]) -> (Session, Simulation<&'f Vec<u8>>) {
    let mut session = session(file, options);
    let mut simulation = Simulation::new(file.source(), Duration::from_millis(20));
    simulation.frame(&mut session, nodes, &[]).unwrap();
    simulation.settle(&session);
    assert!(simulation.frame(&mut session, nodes, &[]).unwrap().is_complete);
    (session, simulation)
}

#[test]
fn a_parent_is_drawn_until_all_of_its_children_are_there() {
    let file = tree(5);
    let group = file.children(0).unwrap().start;
    let coarse = file.uniform_cut(1).unwrap().nodes;
    let (mut session, mut simulation) = drawn(&file, APART, &coarse);
    let mut wanted: Vec<Node> = coarse.iter().copied().filter(|node| node.root != group).collect();
    wanted.extend(file.children(group).unwrap().map(|root| Node { root, level: 2 }));
    wanted.sort_unstable_by_key(|node| node.root);
    let mut frames = 0;
    loop {
        let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
        check(&file, session.picture());
        if frame.is_complete {
            assert_eq!((session.picture().nodes(), frame.late_roots), (wanted.clone(), 0));
            assert_eq!(frame.changes.removed, [group]);
            break;
        }
        assert_eq!((session.picture().nodes(), frame.late_roots > 0), (coarse.clone(), true));
        assert_eq!(frame.changes, Default::default());
        simulation.advance(&session, Duration::from_millis(5));
        frames += 1;
    }
    assert!(frames > 1);
    // And nothing is left to look at.
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    assert_eq!(session.open_count(), 0);
}

#[test]
fn zooming_out_leaves_what_is_drawn_until_the_wanted_root_is_there() {
    let file = tree(6);
    let fine = file.uniform_cut(5).unwrap().nodes;
    let coarse = file.uniform_cut(1).unwrap().nodes;
    for may_stay_finer in [true, false] {
        let (mut session, mut simulation) = drawn(&file, Options { may_stay_finer, ..APART }, &fine);
        let frame = simulation.frame(&mut session, &coarse, &[]).unwrap();
        assert!(!frame.is_complete);
        check(&file, session.picture());
        if may_stay_finer {
            assert_eq!((session.picture().roots().len(), frame.late_roots), (fine.len(), 0));
        } else {
            assert_eq!((session.picture().nodes(), frame.late_roots), (vec![Node { root: 0, level: 0 }], 6));
        }
        simulation.settle(&session);
        assert!(simulation.frame(&mut session, &coarse, &[]).unwrap().is_complete);
        assert_eq!(session.picture().nodes(), coarse);
        // Back again: everything is still there.
        assert!(simulation.frame(&mut session, &fine, &[]).unwrap().is_complete);
        check(&file, session.picture());
    }
}

#[test]
fn what_is_lost_is_drawn_by_the_root_above_it() {
    let file = tree(8);
    let fine = file.uniform_cut(5).unwrap().nodes;
    let known = reads_of(&file, &[file.uniform_cut(2).unwrap().nodes]);
    let leaves = reads_of(&file, std::slice::from_ref(&fine));
    let mut shown = 0;
    for &page in leaves.iter().filter(|offset| !known.contains(offset)) {
        let mut faulty = Faulty::new(file.source());
        faulty.damaged.insert(page);
        let mut session = session(&file, APART);
        let mut simulation = Simulation::new(faulty, Duration::from_millis(20));
        let mut problems = Vec::new();
        for _ in 0..12 {
            let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
            assert_eq!((frame.shows, frame.lost_roots.len()), (Shows::Picture, 0));
            check(&file, session.picture());
            problems.extend(session.take_problems());
            simulation.advance(&session, Duration::from_millis(50));
        }
        assert_eq!(problems.len(), 1, "{problems:?}");
        let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
        assert!(frame.is_complete && frame.late_roots == 0, "what is lost is no longer wanted");
        assert_eq!(session.open_count(), 0);
        let drawn = session.picture().nodes();
        let above = drawn.iter().filter(|node| fine.binary_search_by_key(&node.root, |fine| fine.root).is_err());
        assert!(above.clone().all(|node| fine.iter().any(|leaf| is_below(&file, leaf.root, node.root))));
        shown += usize::from(above.count() > 0);
        // Once the source is well again, so is the picture.
        let faulty = Faulty::new(file.source());
        let mut simulation = Simulation::new(faulty, Duration::ZERO);
        session.retry_failed();
        simulation.frame(&mut session, &fine, &[]).unwrap();
        simulation.settle(&session);
        assert!(simulation.frame(&mut session, &fine, &[]).unwrap().is_complete);
        assert_eq!(session.picture().roots().len(), fine.len());
    }
    assert!(shown > 0);
}

#[test]
fn without_anything_above_what_is_lost_is_lost() {
    let file = tree(9);
    let cuts: Vec<Vec<Node>> = (0..6).map(|level| file.uniform_cut(level).unwrap().nodes).collect();
    let pages = top_reads(&file).into_iter().chain(reads_of(&file, &cuts));
    let faulty = Faulty::new(file.source());
    *faulty.failures.lock().unwrap() = pages.map(|page| (page, u32::MAX)).collect();
    let mut session = Session::new(file.index().clone(), Options { mode: Mode::Synchronous, ..APART }).unwrap();
    let mut simulation = Simulation::new(faulty, Duration::from_millis(20));
    let wanted = &cuts[5];
    let frame = simulation.frame(&mut session, wanted, &[]).unwrap();
    assert!(frame.is_complete && frame.late_roots == 0);
    assert!(frame.lost_roots.into_iter().eq(wanted.iter().map(|node| node.root)));
    simulation.source().failures.lock().unwrap().clear();
    session.retry_failed();
    let frame = simulation.frame(&mut session, wanted, &[]).unwrap();
    assert!(frame.is_complete && frame.lost_roots.is_empty());
    check(&file, session.picture());
}

/// Offsets of the reads that draw the top.
fn top_reads(file: &Arc<File<Vec<u8>>>) -> Vec<u64> {
    let mut session = Session::new(file.index().clone(), APART).unwrap();
    session.begin(&[Node { root: 0, level: 0 }], &[], Duration::ZERO).unwrap();
    let mut offsets = Vec::new();
    while let Some(job) = session.poll(Duration::ZERO) {
        match job {
            Job::Read(read) => {
                offsets.push(read.offset);
                session.supply(&read, read.run(file.source()), Duration::ZERO);
            }
            Job::Decode(decoding) => session.finish(decoding.run(), Duration::ZERO),
        }
    }
    offsets
}

#[test]
fn a_cut_has_no_root_above_another() {
    let file = tree(1);
    let mut session = session(&file, APART);
    let leaf = file.root_count() - 1;
    for above in 0..leaf {
        let nodes = [Node { root: above, level: 5 }, Node { root: leaf, level: 5 }];
        assert_eq!(session.begin(&nodes, &[], Duration::ZERO).is_err(), is_below(&file, leaf, above), "{above}");
    }
    let mut random = Random::new(1);
    for _ in 0..200 {
        let wanted = random_antichain(&file, 3, &mut random);
        session.begin(&wanted, &[], Duration::ZERO).unwrap();
    }
}

#[test]
fn a_camera_moves_through_a_tree() {
    let file = tree(2);
    let hierarchy = Arc::new(file.hierarchy().unwrap());
    let bounds = file.bounds().unwrap();
    let query = |step: u32, outside| {
        let near = 0.6 + 0.55 * (f64::from(step) * 0.07).cos();
        let pixel_tolerance = 10_f64.powf(1.0 + 1.5 * (f64::from(step) * 0.11).cos());
        let mut view = View { pixel_tolerance, ..View::around(bounds, [0.0, 0.0, 1.0], f64::from(step) * 0.05, 0.3) };
        let middle = [0, 1, 2].map(|k| (bounds[0][k] + bounds[1][k]) / 2.0);
        view.position = [0, 1, 2].map(|k| middle[k] + (view.position[k] - middle[k]) * near);
        Query { view: Some(view), outside, ..Query::default() }
    };
    for outside in [Outside::Coarsest, Outside::Drop] {
        for mode in [Mode::Asynchronous, Mode::AsynchronousWithPrefetch, Mode::Synchronous] {
            let options = Options { mode, decoded_cache: 20_000, byte_cache: 4000, ..APART };
            let mut session = session(&file, options);
            let mut simulation = Simulation::new(file.source(), Duration::from_millis(20));
            let mut adapter = Adapter::new(hierarchy.clone(), &query(0, outside), Coherence::default()).unwrap();
            let (mut depths, mut complete) = (BTreeSet::new(), 0);
            for step in 0..150 {
                adapter.update(&query(step, outside)).unwrap();
                let wanted = adapter.cut().nodes;
                adapter.update(&query(step + 3, outside)).unwrap();
                let expected = adapter.cut().nodes;
                let frame: Frame = simulation.frame(&mut session, &wanted, &expected).unwrap();
                assert_eq!(frame.shows, Shows::Picture);
                assert!(mode != Mode::Synchronous || frame.is_complete);
                complete += u32::from(frame.is_complete);
                depths.extend(wanted.iter().map(|node| file.root_contents(node.root).unwrap().blocks[0].level));
                if outside == Outside::Coarsest {
                    check(&file, session.picture());
                }
                let (cached, held) = (session.cached_bytes(), session.held_bytes());
                assert!(cached[0] <= options.byte_cache.max(held[0]));
                assert!(cached[1] <= options.decoded_cache.max(held[1]));
                simulation.advance(&session, Duration::from_millis(16));
            }
            assert!(depths.len() > 2 && complete > 30, "{depths:?} {complete}");
        }
    }
}
