//! Files whose clusters are in several lists give the same answers as files with one list, and read only the branches that they need.

use std::sync::Arc;

use super::synthetic::{Options, Random, cube, file_of, listed_file_of};
use crate::{
    File, Limits, Outside, Query, View,
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
                assert_eq!(other, cut, "{query:?}");
                assert_eq!(several.extract(&other).unwrap(), one.extract(&cut).unwrap());
            }
            (one, several) => assert_eq!(several.unwrap_err().to_string(), one.unwrap_err().to_string()),
        }
    }
    for level in 0..one.level_count() as u8 {
        assert_eq!(several.uniform_cut(level).unwrap(), one.uniform_cut(level).unwrap());
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
