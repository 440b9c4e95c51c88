//! Borders are made anew only where a neighbour has changed (Niski 2007, section 5.2.2).

use std::sync::Arc;

use super::*;
use crate::{
    stream::{Picture, Simulation},
    write::PARAM_END,
};

fn neighbours(file: &File<Vec<u8>>, root: u32) -> BTreeSet<u32> {
    let arcs = |root: u32| file.root_contents(root).unwrap().loops.concat().into_iter().map(|half_arc| half_arc.arc);
    let own: BTreeSet<u32> = arcs(root).collect();
    (0..file.root_count()).filter(|&other| arcs(other).any(|arc| own.contains(&arc))).collect()
}

#[test]
fn only_strips_beside_a_change_are_made_anew_and_no_other_vertex_moves() {
    let file = model(3);
    let mut session = session(&file, APART);
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let mut random = Random::new(21);
    let mut wanted = random_cut(&file, &mut random);
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    simulation.settle(&session);
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    let mut rebuilt = 0;
    for _ in 0..60 {
        let before: Picture = session.picture().clone();
        let changed = random.below(u64::from(file.root_count())) as u32;
        wanted[changed as usize].level = random.below(4) as u8;
        // Drawn coarser at first, if the level is not there.
        let mut strips = simulation.frame(&mut session, &wanted, &[]).unwrap().changes.strips;
        simulation.settle(&session);
        strips.extend(simulation.frame(&mut session, &wanted, &[]).unwrap().changes.strips);
        let after = session.picture();
        let near = neighbours(&file, changed);
        assert!(strips.iter().all(|(root, _)| near.contains(root)));
        rebuilt += strips.len();
        for (old, new) in before.roots().zip(after.roots()) {
            let root = new.surface.root;
            let is_same = Arc::ptr_eq(&old.surface, &new.surface) || old.surface == new.surface;
            assert!(is_same || root == changed);
            for (side, (old, new)) in old.strips.iter().zip(&new.strips).enumerate() {
                let is_kept = Arc::ptr_eq(old, new);
                assert!(is_kept || near.contains(&root), "root {root}, side {side}");
            }
        }
        // What was kept is what would be made now.
        let mut fresh = Picture::default();
        let surfaces = after.roots().map(|root| root.surface.clone()).collect();
        fresh.update(Difference { surfaces, ..Difference::default() });
        for (kept, made) in after.roots().zip(fresh.roots()) {
            assert_eq!(kept.strips, made.strips);
        }
    }
    assert!(rebuilt > 20, "{rebuilt}");
    let counters = session.counters();
    assert!(counters.borders_rebuilt * 10 < counters.borders_drawn, "{counters:?}");
}

#[test]
fn a_root_is_joined_to_what_is_drawn_and_its_border_edges_follow_each_arc_from_end_to_end() {
    let file = model(3);
    let mut session = session(&file, APART);
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let wanted = random_cut(&file, &mut Random::new(8));
    for _ in 0..2 {
        simulation.frame(&mut session, &wanted, &[]).unwrap();
        simulation.settle(&session);
    }
    let mut all = Mesh::default();
    for drawn in session.picture().roots() {
        let (positions, joined) = drawn.joined();
        assert_eq!(joined.len(), drawn.triangle_count());
        let before = all.positions.len() as u32;
        all.positions.extend(positions);
        all.triangles.extend(joined.iter().map(|triangle| triangle.map(|vertex| before + vertex)));
        let edges = drawn.surface.border_triangles().flat_map(|(_, edges)| edges.concat());
        let mut edges: Vec<_> = edges.collect();
        edges.sort_by_key(|edge| (edge.side, edge.params));
        for (side, half_arc) in (0..).zip(drawn.surface.half_arcs()) {
            let of_side = edges.iter().filter(|edge| edge.side == side).map(|edge| edge.params);
            let mut params: Vec<[u32; 2]> = of_side.collect();
            if half_arc.reversed {
                params.iter_mut().for_each(|params| params.reverse());
            }
            assert_eq!((params.first().unwrap()[0], params.last().unwrap()[1]), (0, PARAM_END));
            assert!(params.windows(2).all(|pair| pair[0][1] == pair[1][0]));
        }
    }
    assert_eq!(triangles(&all), triangles(&session.picture().mesh()));
}

#[test]
fn a_frame_without_news_changes_nothing() {
    let file = model(2);
    let mut session = session(&file, APART);
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let wanted = random_cut(&file, &mut Random::new(3));
    for _ in 0..3 {
        simulation.frame(&mut session, &wanted, &[]).unwrap();
        simulation.settle(&session);
    }
    let before = session.counters();
    let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
    assert_eq!(frame.changes, Default::default());
    let after = session.counters();
    assert_eq!((after.borders_rebuilt, after.requests), (before.borders_rebuilt, before.requests));
    assert!(after.borders_drawn > before.borders_drawn);
}

#[test]
fn a_drawn_root_has_its_blocks_error_and_more_beside_finer_ones() {
    let file = model(3);
    let mut session = session(&file, APART);
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let wanted = random_cut(&file, &mut Random::new(22));
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    simulation.settle(&session);
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    let mut beside_finer = 0;
    for drawn in session.picture().roots() {
        let root = drawn.surface.root;
        let blocks = file.root_contents(root).unwrap().blocks;
        let block = blocks.iter().find(|block| block.level == drawn.surface.level).unwrap();
        let has_more = drawn.strips.iter().any(|strip| !strip.positions.is_empty());
        let is_coarser = |other: &u32| wanted[*other as usize].level > drawn.surface.level;
        assert!(!has_more || neighbours(&file, root).iter().any(is_coarser), "root {root}");
        assert_eq!(drawn.error(), block.error + if has_more { block.border_deviation } else { 0.0 });
        beside_finer += usize::from(has_more);
    }
    assert!((1..session.picture().roots().len()).contains(&beside_finer), "{beside_finer}");
}
