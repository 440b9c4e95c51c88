//! Trees: any nodes that cover everything once are a watertight cut, however many levels apart neighbours are.

use super::{
    cuts::{euler_characteristic, open_edges, within_budgets},
    synthetic::{Options, Random, cube, file_of, model},
};
use crate::{Cut, File, Limiter, Limits, Node, Outside, Query};

const OPTIONS: Options = Options { levels: 3, seed: 1, grids_of_four: 1, heights: 3 };

fn open(seed: u64) -> File<Vec<u8>> {
    File::open(file_of(&cube(4), Options { seed, ..OPTIONS }), Limits::default()).unwrap()
}

/// Nodes that cover everything once, each at one of its levels.
pub(super) fn random_cut(file: &File<Vec<u8>>, random: &mut Random) -> Cut {
    let mut nodes = Vec::new();
    let mut pending: Vec<u32> = (0..file.top_count()).collect();
    while let Some(root) = pending.pop() {
        let children = file.children(root).unwrap();
        if !children.is_empty() && random.below(5) > 0 {
            pending.extend(children);
            continue;
        }
        let blocks = file.root_contents(root).unwrap().blocks;
        nodes.push(Node { root, level: blocks[random.below(blocks.len() as u64) as usize].level });
    }
    nodes.sort_unstable_by_key(|node| node.root);
    Cut { nodes, ..Cut::default() }
}

#[test]
fn trees_survive_writing_and_reading() {
    for seed in 1..5 {
        let (model, patches) = model(&cube(4), Options { seed, ..OPTIONS });
        let mut bytes = Vec::new();
        let report = crate::write::write_file(&model, &mut bytes).unwrap();
        let file = File::open(bytes, Limits::default()).unwrap();
        file.verify().unwrap();
        assert_eq!((file.root_count(), file.top_count()), (96 + 24 + 6 + 1, 1));
        for (root, &of_model) in (0..).zip(&report.root_order) {
            let record = &model.roots[of_model as usize];
            let parent = file.parent(root).unwrap();
            assert_eq!(parent.map(|parent| report.root_order[parent as usize]), record.parent);
            for child in file.children(root).unwrap() {
                assert_eq!(file.parent(child).unwrap(), Some(root));
            }
            for (level, patch) in (0..).zip(&patches[of_model as usize]) {
                let Some(patch) = patch else { continue };
                assert_eq!(&file.decode_root(root, level).unwrap().patch, patch);
            }
        }
        let borders = file.borders().unwrap();
        let mut levels = [borders.corner_levels, model.corner_levels];
        levels.iter_mut().for_each(|levels| levels.sort_unstable());
        assert_eq!(levels[0], levels[1]);
    }
}

#[test]
fn any_nodes_that_cover_everything_once_are_watertight() {
    let mut random = Random::new(5);
    for seed in 1..6 {
        let file = open(seed);
        for _ in 0..100 {
            let cut = random_cut(&file, &mut random);
            let mesh = file.extract(&cut).unwrap();
            assert_eq!((open_edges(&mesh), euler_characteristic(&mesh)), (0, 2));
            assert_eq!(file.boundary_edge_count(&cut).unwrap(), 0);
        }
        for level in 0..6 {
            let cut = file.uniform_cut(level).unwrap();
            assert_eq!(cut.nodes.len(), [1, 6, 24, 96, 96, 96][usize::from(level)]);
            let mesh = file.extract(&cut).unwrap();
            assert_eq!((mesh.triangles.len() as u64, open_edges(&mesh)), (cut.triangle_count, 0));
            assert!(file.level(usize::from(level)).unwrap().triangle_count <= cut.triangle_count);
        }
    }
}

#[test]
fn part_of_a_cut_has_the_boundary_edges_that_it_says() {
    let mut random = Random::new(9);
    for seed in 1..6 {
        let file = open(seed);
        for _ in 0..100 {
            let mut cut = random_cut(&file, &mut random);
            cut.nodes.retain(|_| random.below(4) > 0);
            let mesh = file.extract(&cut).unwrap();
            assert_eq!(file.boundary_edge_count(&cut).unwrap(), open_edges(&mesh) as u64);
        }
    }
}

#[test]
fn queries_choose_nodes_and_keep_budgets() {
    let mut random = Random::new(3);
    for seed in 1..6 {
        let file = open(seed);
        let finest = file.select(&Query::default()).unwrap();
        assert!(finest.nodes.len() == 96 && finest.limited_by == Limiter::Finest);
        let top = file.select(&Query { max_nodes: Some(1), ..Query::default() }).unwrap();
        assert_eq!((top.nodes, top.limited_by), (vec![Node { root: 0, level: 0 }], Limiter::Nodes));
        for _ in 0..100 {
            let corner = |random: &mut Random| [0; 3].map(|_: i32| random.below(1000) as f64 * 0.016 - 2.0);
            let (a, b) = (corner(&mut random), corner(&mut random));
            let region = [0, 1].map(|side| [0, 1, 2].map(|k| if side == 0 { a[k].min(b[k]) } else { a[k].max(b[k]) }));
            let query = Query {
                volume: (random.below(2) == 0).then_some(region.into()),
                outside: if random.below(2) == 0 { Outside::Drop } else { Outside::Coarsest },
                tolerance: (random.below(2) == 0).then(|| random.below(100) as f64 * 0.01),
                max_triangles: (random.below(2) == 0).then(|| random.below(finest.triangle_count + 100)),
                max_nodes: (random.below(3) == 0).then(|| random.below(100)),
                max_bytes: (random.below(4) == 0).then(|| random.below(20_000)),
                ..Query::default()
            };
            let Some((_, mesh)) = within_budgets(&file, &query) else { continue };
            if query.volume.is_none() || query.outside == Outside::Coarsest {
                assert_eq!(open_edges(&mesh), 0);
            }
        }
    }
}

#[test]
fn prefixes_of_trees_are_whole_coarser_models() {
    let bytes = file_of(&cube(4), OPTIONS);
    let whole = File::open(bytes.as_slice(), Limits::default()).unwrap();
    let corners = whole.borders().unwrap().corners;
    let mut end = whole.index().sections().last().unwrap().1;
    for level in 0..6 {
        end += whole.level(level).unwrap().page_bytes;
        let prefix = File::open_prefix(&bytes[..end as usize], Limits::default()).unwrap();
        prefix.verify().unwrap();
        assert_eq!(prefix.borders().unwrap().corners, corners);
        let cut = prefix.select(&Query::default()).unwrap();
        assert_eq!(cut.nodes.len(), [1, 6, 24, 96, 96, 96][level]);
        assert_eq!(prefix.extract(&cut).unwrap(), whole.extract(&cut).unwrap());
    }
}

#[test]
fn a_tolerance_that_the_finest_cut_meets_is_met() {
    let mut random = Random::new(8);
    for seed in 1..12 {
        let file = open(seed);
        let finest = file.select(&Query::default()).unwrap();
        for _ in 0..200 {
            let middle = [0; 3].map(|_: i32| random.below(1000) as f64 * 0.01);
            let half = random.unit() * 4.0;
            let volume = [middle.map(|x| x - half), middle.map(|x| x + half)];
            let tolerance = finest.error * 1.001 * 4_f64.powf(random.unit() * 5.0);
            let outside = if random.below(2) == 0 { Outside::Drop } else { Outside::Coarsest };
            let query = Query { volume: Some(volume.into()), tolerance: Some(tolerance), outside, ..Query::default() };
            let cut = file.select(&query).unwrap();
            assert!(cut.error <= tolerance, "{} {tolerance} {query:?}", cut.error);
        }
    }
}
