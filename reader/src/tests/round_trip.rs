//! What is written is what is read.

use super::synthetic::{Options, Random, cube, file_of, model, tetrahedron};
use crate::{
    Error, File, Limits, Query, ReadAt,
    source::Counting,
    write::{WriteReport, write_file},
};

const OPTIONS: Options = Options { levels: 4, seed: 1, grids_of_four: 1, heights: 0 };

#[test]
fn models_survive_writing_and_reading() {
    for (seed, faces) in [(1, cube(1)), (2, cube(2)), (3, cube(4)), (4, tetrahedron())] {
        let (model, patches) = model(&faces, Options { seed, ..OPTIONS });
        let mut bytes = Vec::new();
        let report = write_file(&model, &mut bytes).unwrap();
        assert_eq!(report.total_bytes, bytes.len() as u64);
        let file = File::open(bytes, Limits::default()).unwrap();
        file.verify().unwrap();
        assert_eq!(file.source_info(), Some(&model.source));
        assert_eq!(file.lattice(), model.lattice);
        assert_eq!(file.level_count(), model.levels.len());
        assert_eq!(file.index().arc_count() as usize, model.arcs.len());
        assert_eq!(file.index().corner_count() as usize, model.corners.len());
        assert_eq!(file.root_count() as usize, model.roots.len());
        for (root, &of_model) in (0..).zip(&report.root_order) {
            let record = &model.roots[of_model as usize];
            for level in 0..4_u8 {
                let present = (0..=level).rev().find(|&level| record.blocks[usize::from(level)].is_some()).unwrap();
                let read = file.decode_root(root, level).unwrap();
                assert_eq!(read.level, present);
                assert_eq!(Some(&read.patch), patches[of_model as usize][usize::from(present)].as_ref());
                let mut border = Vec::new();
                for half_arc in &record.loops[0] {
                    let arc = &model.arcs[half_arc.arc as usize];
                    border.push(model.corners[arc.ends[usize::from(half_arc.reversed)] as usize]);
                    let mut samples: Vec<_> =
                        arc.samples.iter().filter(|s| s.level <= present).map(|s| s.position).collect();
                    if half_arc.reversed {
                        samples.reverse();
                    }
                    border.extend(samples);
                }
                assert_eq!(read.loops.concat().iter().map(|vertex| vertex.position).collect::<Vec<_>>(), border);
            }
        }
    }
}

#[test]
fn the_same_model_gives_the_same_bytes() {
    assert_eq!(file_of(&cube(3), OPTIONS), file_of(&cube(3), OPTIONS));
}

#[test]
fn a_model_without_roots_is_a_file_too() {
    let (mut model, _) = model(&tetrahedron(), OPTIONS);
    model.roots.clear();
    model.arcs.clear();
    model.corners.clear();
    let mut bytes = Vec::new();
    write_file(&model, &mut bytes).unwrap();
    let file = File::open(bytes, Limits::default()).unwrap();
    file.verify().unwrap();
    assert!(file.bounds().is_none());
    let cut = file.select(&Query::default()).unwrap();
    assert!(cut.nodes.is_empty() && file.extract(&cut).unwrap().triangles.is_empty());
}

#[test]
fn tiny_files_are_tiny() {
    let (mut model, _) = model(&tetrahedron(), Options { levels: 1, seed: 5, grids_of_four: 0, heights: 0 });
    model.source = Default::default();
    let report: WriteReport = write_file(&model, &mut Vec::new()).unwrap();
    let size = |name| report.sections.iter().find(|section| section.0 == name).unwrap().1;
    assert!(size("tables") < 90, "{report:?}");
    assert!(report.total_bytes < 750, "{report:?}");
}

#[test]
fn a_small_file_is_opened_and_drawn_in_one_read() {
    let source = Counting::new(file_of(&cube(2), OPTIONS));
    assert!(source.size().unwrap() <= 16 << 10);
    let file = File::open(&source, Limits::default()).unwrap();
    let cut = file.select(&Query::default()).unwrap();
    file.extract(&cut).unwrap();
    assert_eq!((source.read_count(), source.byte_count()), (1, source.size().unwrap()));
}

#[test]
fn prefixes_that_end_at_a_level_are_whole_coarser_models() {
    let bytes = file_of(&cube(2), OPTIONS);
    let whole = File::open(bytes.as_slice(), Limits::default()).unwrap();
    let pages = whole.index().sections().last().unwrap().1;
    let mut end = pages;
    for level in 0..4 {
        let before = end as usize;
        end += whole.level(level).unwrap().page_bytes;
        let prefix = File::open_prefix(&bytes[..end as usize], Limits::default()).unwrap();
        assert_eq!(prefix.level_count(), level + 1);
        prefix.verify().unwrap();
        let cut = prefix.select(&Query::default()).unwrap();
        assert!(cut.nodes.iter().all(|node| usize::from(node.level) <= level));
        assert_eq!(prefix.extract(&cut).unwrap(), whole.extract(&cut).unwrap());
        if level == 0 {
            assert!(File::open_prefix(&bytes[..before], Limits::default()).is_err());
        }
        assert_eq!(File::open(&bytes[..end as usize], Limits::default()).is_ok(), level == 3);
    }
}

#[test]
fn models_that_break_rules_are_refused() {
    let (good, _) = model(&cube(1), OPTIONS);
    let refused = |change: &dyn Fn(&mut crate::write::Model)| {
        let mut changed = good.clone();
        change(&mut changed);
        let result = write_file(&changed, &mut Vec::new());
        assert!(matches!(result, Err(Error::Model { .. })), "{result:?}");
    };
    refused(&|model| model.levels.clear());
    refused(&|model| model.levels[1].tolerance = 9.0);
    refused(&|model| model.lattice.origin[0] = f64::NAN);
    refused(&|model| model.roots[0].loops[0][0].reversed ^= true);
    refused(&|model| model.roots[0].loops[0][0].arc = 99);
    refused(&|model| model.roots[0].blocks.fill(None));
    refused(&|model| model.roots[0].parent = Some(1));
    refused(&|model| model.roots[0].parent = Some(99));
    refused(&|model| model.corner_levels = vec![0]);
    refused(&|model| model.corner_levels = vec![1; model.corners.len()]);
    refused(&|model| model.roots[0].bounds[0][1] = f64::NAN);
    refused(&|model| model.roots[0].blocks[0].as_mut().unwrap().error = -1.0);
    refused(&|model| model.arcs[0].ends[0] = model.arcs[0].ends[1]);
    refused(&|model| model.arcs.push(model.arcs[0].clone()));
    refused(&|model| model.corners.push([0; 3]));
    refused(&|model| model.corners[0] = [1 << 41, 0, 0]);
    refused(&|model| {
        let arc = model.arcs.iter_mut().find(|arc| !arc.samples.is_empty()).unwrap();
        arc.samples[0].position[0] += 1;
    });
}

#[test]
fn limits_are_kept() {
    let bytes = file_of(&cube(2), OPTIONS);
    let limited = |limits: Limits| {
        let result = File::open(bytes.as_slice(), limits).and_then(|file| file.verify());
        assert!(matches!(result, Err(Error::Limit { .. })), "{result:?}");
    };
    limited(Limits { root_count: 23, ..Limits::default() });
    limited(Limits { cluster_record_count: 100, ..Limits::default() });
    limited(Limits { part_bytes: 100, ..Limits::default() });
    limited(Limits { root_vertex_count: 3, ..Limits::default() });
}

#[test]
fn roots_that_do_not_exist_are_query_errors() {
    let file = File::open(file_of(&cube(1), OPTIONS), Limits::default()).unwrap();
    let mut random = Random::new(9);
    for (root, level) in [(6, 0), (u32::MAX, 0), (random.below(6) as u32, 4)] {
        assert!(matches!(file.decode_root(root, level), Err(Error::Query { .. })));
    }
}
