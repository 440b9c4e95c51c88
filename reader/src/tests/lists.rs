//! Files whose clusters are in several lists give the same answers as files with one list, and read only the branches
//! that they need.

use std::sync::Arc;

use super::synthetic::{Options, Random, cube, file_of, listed_file_of};
use crate::{
    Cut, File, Limits, Outside, Query, View,
    select::{Hierarchy, select_in},
    source::Recording,
};

const TREE: Options = Options { levels: 3, seed: 5, grids_of_four: 1, heights: 4 };

fn queries() -> Vec<Query> {
    let mut random = Random::new(3);
    let mut queries = vec![Query::default(), Query { max_nodes: Some(1), ..Query::default() }];
    for k in 0..30 {
        let low = [0; 3].map(|_: i32| random.unit() * 8.0);
        let volume = (k % 3 > 0).then(|| [low, low.map(|x| x + 1.5)].into());
        let tolerance = (k % 4 > 0).then(|| 4_f64.powf(-random.unit() * 6.0));
        let max_nodes = (k % 5 == 0).then(|| 6 + random.below(200));
        let max_triangles = (k % 5 == 1).then(|| 200 + random.below(20000));
        let max_bytes = (k % 10 == 2).then(|| 3000 + random.below(50000));
        let outside = if k % 7 == 0 { Outside::Coarsest } else { Outside::Drop };
        queries.push(Query { volume, tolerance, max_nodes, max_triangles, max_bytes, outside, ..Query::default() });
    }
    let view = |distance: f64| View {
        position: [5.0 + distance, 5.0, 5.0],
        forward: [-1.0, 0.0, 0.0],
        up: [0.0, 0.0, 1.0],
        near: 1e-3,
        ..View::default()
    };
    queries.extend([7.0, 20.0, 300.0].map(|distance| Query { view: Some(view(distance)), ..Query::default() }));
    queries
}

#[test]
fn several_lists_give_the_same_answers_as_one() {
    let (one, several) = (file_of(&cube(8), TREE), listed_file_of(&cube(8), TREE));
    let [one, several] = [&one, &several].map(|bytes| File::open(bytes.as_slice(), Limits::default()).unwrap());
    several.verify().unwrap();
    assert_eq!(
        several.summary().unwrap().sections.iter().map(|(_, bytes)| bytes).sum::<u64>(),
        several.source().len() as u64
    );
    for query in queries() {
        match (one.select(&query), several.select(&query)) {
            (Ok(cut), Ok(other)) => {
                assert_ne!(other.file, cut.file);
                assert_eq!(Cut { file: cut.file, ..other.clone() }, cut, "{query:?}");
                assert_eq!(several.extract(&other).unwrap(), one.extract(&cut).unwrap());
            }
            (one, several) => assert_eq!(several.unwrap_err().to_string(), one.unwrap_err().to_string()),
        }
    }
    for level in 0..one.level_count() as u8 {
        assert_eq!(several.uniform_cut(level).unwrap().nodes, one.uniform_cut(level).unwrap().nodes);
    }
    assert_eq!(several.borders().unwrap(), one.borders().unwrap());
}

#[test]
fn what_is_known_already_does_not_change_a_cut() {
    let bytes = listed_file_of(&cube(8), TREE);
    let known = File::open(bytes.as_slice(), Limits::default()).unwrap();
    known.summary().unwrap();
    for query in queries() {
        let fresh = File::open(bytes.as_slice(), Limits::default()).unwrap();
        assert_eq!(fresh.select(&query).ok(), known.select(&query).ok(), "{query:?}");
    }
}

#[test]
fn walking_down_reaches_the_tolerance_that_a_complete_hierarchy_reaches() {
    let bytes = listed_file_of(&cube(8), TREE);
    let file = File::open(bytes.as_slice(), Limits::default()).unwrap();
    let hierarchy = Arc::new(file.hierarchy().unwrap());
    for query in queries().into_iter().filter(|query| query.volume.is_none()) {
        let (Ok(cut), Ok(best)) = (file.select(&query), select_in(&hierarchy, &query)) else { continue };
        assert_eq!((cut.error, cut.limited_by), (best.error, best.limited_by), "{query:?}");
        assert!(cut.triangle_count * 100 <= best.triangle_count * 105, "{query:?}");
    }
    assert_eq!(Hierarchy::from_index(file.index()).unwrap().node_count(), file.root_count());
}

#[test]
fn a_coarse_query_reads_few_branches() {
    // So large that not all of its index is read at once.
    let bytes = listed_file_of(&cube(16), Options { heights: 5, ..TREE });
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    file.source().take();
    let read = |file: &File<Recording<Vec<u8>>>| file.source().take().iter().map(|r| r.end - r.start).sum::<u64>();
    let coarse = file.select(&Query { max_nodes: Some(1), ..Query::default() }).unwrap();
    assert_eq!(coarse.nodes.len(), 1);
    let few = read(&file);
    file.select(&Query::default()).unwrap();
    assert!(few * 3 < read(&file), "{few}");
}

#[test]
fn a_cut_of_the_top_reads_the_index_of_the_top_alone() {
    // A small index, of which finer queries read all at once.
    let bytes = file_of(&cube(8), TREE);
    let fresh = || File::open(Recording::new(bytes.as_slice()), Limits::default()).unwrap();
    let index = fresh().summary().unwrap();
    let index_bytes = index.sections.iter().find(|(kind, _)| kind.contains("index")).map(|&(_, bytes)| bytes).unwrap();
    assert!(index_bytes > 20_000 && index_bytes <= crate::select::SMALL_INDEX_BYTES, "{index_bytes}");
    let top = Query { max_nodes: Some(1), ..Query::default() };
    let coarsest = fresh().select(&Query { tolerance: Some(f64::MAX), ..Query::default() }).unwrap();
    let queries = [
        top.clone(),
        Query { max_nodes: Some(2), ..top.clone() },
        Query { tolerance: Some(f64::MAX), ..Query::default() },
        Query { max_triangles: Some(coarsest.triangle_count), ..Query::default() },
        Query { max_nodes: Some(1), outside: Outside::Coarsest, ..top.clone() },
    ];
    for query in queries {
        let file = fresh();
        let opened: u64 = file.source().take().iter().map(|range| range.end - range.start).sum();
        let cut = file.select(&query).unwrap();
        let read: u64 = file.source().take().iter().map(|range| range.end - range.start).sum();
        assert_eq!(cut.nodes.len(), 1, "{query:?}");
        assert!(opened + read < index_bytes / 2, "{query:?}: {opened} and {read} of {index_bytes}");
        let all = fresh();
        all.summary().unwrap();
        assert_eq!(cut, all.select(&query).unwrap());
    }
    // All of it in one request where the query may need it.
    let file = fresh();
    file.source().take();
    file.select(&Query { max_nodes: Some(1000), ..Query::default() }).unwrap();
    assert_eq!(file.source().take().len(), 1);
}

#[test]
fn a_cut_of_another_file_is_refused() {
    let files = [5, 6].map(|seed| file_of(&cube(4), Options { seed, heights: 3, ..TREE }));
    let [one, same, other] = [0, 0, 1].map(|k| File::open(files[k].as_slice(), Limits::default()).unwrap());
    let cut = one.select(&Query::default()).unwrap();
    assert_eq!(same.extract(&cut).unwrap(), one.extract(&cut).unwrap());
    let refused = [
        other.extract(&cut).map(drop),
        other.extract_textured(&cut, &[]).map(drop),
        other.extract_with_borders(&cut, 1).map(drop),
        other.own_bytes(&cut).map(drop),
        other.boundary_edge_count(&cut).map(drop),
    ];
    for answer in refused {
        assert!(answer.unwrap_err().to_string().contains("another file"));
    }
    // What was put together by hand is drawn as far as it exists.
    assert_eq!(other.extract(&Cut { file: None, ..cut.clone() }).is_ok(), one.root_count() == other.root_count());
}
