//! Objects are hidden, shown alone and marked: extractions, streams, picks and boxes agree with owners, triangle by
//! triangle.

use std::{collections::BTreeSet, sync::Arc, time::Duration};

use super::{objects::file_of, synthetic::Random};
use crate::{
    Cut, Error, File, Limits, Mesh, Node, Outside, Query, Volume,
    index::Ray,
    objects::{ObjectChoice, ObjectFilter, ObjectState},
    select::{Adapter, Coherence},
    source::Counting,
    stream::{Follower, Mode, Options, Picture, Simulation},
};

/// Of files without objects.
const PLAIN: super::synthetic::Options = super::synthetic::Options { levels: 2, seed: 1, grids_of_four: 0, heights: 0 };

type Triangle = [[u64; 3]; 3];

/// A triangle that begins with its least corner.
fn triangle(corners: [[f64; 3]; 3]) -> Triangle {
    let corners = corners.map(|corner| corner.map(f64::to_bits));
    [0, 1, 2].map(|first| [0, 1, 2].map(|k| corners[(first + k) % 3])).into_iter().min().unwrap()
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    let corners = |of: &[u32; 3]| triangle(of.map(|vertex| mesh.positions[vertex as usize]));
    let mut all: Vec<Triangle> = mesh.triangles.iter().map(corners).collect();
    all.sort_unstable();
    all
}

/// Files with objects: of leaves with several ones, of objects with several leaves, and both.
fn files() -> Vec<Vec<u8>> {
    let vectors = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors");
    let vector = |name: &str| std::fs::read(vectors.join(name)).unwrap();
    vec![vector("objects.lodpack"), vector("object_by_hand.lodpack"), file_of(3, 40, 7), file_of(21, 90, 4)]
}

fn open(bytes: &[u8]) -> File<&[u8]> {
    File::open(bytes, Limits::default()).unwrap()
}

/// The objects below some nodes, by going up from each.
fn below(file: &File<&[u8]>, nodes: &[u32]) -> BTreeSet<u32> {
    let objects = file.objects().unwrap();
    let is_below = |object: &u32| {
        nodes.contains(object) || objects.above(*object).unwrap().iter().any(|above| nodes.contains(above))
    };
    (0..objects.count()).filter(is_below).collect()
}

fn state_of(file: &File<&[u8]>, choice: &ObjectChoice) -> impl Fn(u32) -> ObjectState + use<> {
    let only = choice.only.as_ref().map(|only| below(file, only));
    let [hidden, marked] = [&choice.hidden, &choice.marked].map(|nodes| below(file, nodes));
    let only_marked = choice.only_marked;
    move |object| match () {
        () if hidden.contains(&object) || only.as_ref().is_some_and(|only| !only.contains(&object)) => {
            ObjectState::Hidden
        }
        () if marked.contains(&object) => ObjectState::Marked,
        () if only_marked => ObjectState::Hidden,
        () => ObjectState::Shown,
    }
}

fn random_choice(file: &File<&[u8]>, random: &mut Random) -> ObjectChoice {
    let count = u64::from(file.objects().unwrap().node_count());
    let mut some = |most: u64| -> Vec<u32> {
        let most = [0, 1, most][random.below(3) as usize];
        (0..most).map(|_| random.below(count) as u32).collect()
    };
    let (hidden, marked, only) = (some(count / 4 + 1), some(count / 8 + 1), some(count / 3 + 1));
    let only = (only.len() % 3 == 1).then_some(only);
    ObjectChoice { only, hidden, marked, only_marked: random.below(6) == 0 }
}

/// The leaves below a root.
fn leaves(file: &File<&[u8]>, root: u32) -> Vec<u32> {
    let children = file.children(root).unwrap();
    if children.is_empty() { vec![root] } else { children.flat_map(|child| leaves(file, child)).collect() }
}

/// Checks the nodes of a filtered cut, and returns the triangles that are to be drawn: leaf by leaf by their owners,
/// and of groups all.
fn expected(file: &File<&[u8]>, nodes: &[Node], state: &dyn Fn(u32) -> ObjectState) -> Vec<Triangle> {
    let objects = file.objects().unwrap();
    let states = |leaf: u32| objects.of_leaf(leaf).unwrap().into_iter().map(state);
    let mut all = vec![];
    let mut covered = BTreeSet::new();
    for &node in nodes {
        let below = leaves(file, node.root);
        assert!(below.iter().all(|&leaf| covered.insert(leaf)), "{node:?}");
        let cut = Cut { nodes: vec![node], ..Cut::default() };
        if below == [node.root] {
            let (mesh, owners) = file.extract_objects(&cut).unwrap();
            for (corners, owner) in mesh.triangles.iter().zip(owners) {
                if state(owner) != ObjectState::Hidden {
                    all.push(triangle(corners.map(|vertex| mesh.positions[vertex as usize])));
                }
            }
        } else {
            let first = states(below[0]).next().unwrap();
            assert!(below.iter().all(|&leaf| states(leaf).all(|state| state == first)), "{node:?}");
            assert_ne!(first, ObjectState::Hidden);
            all.extend(triangles(&file.extract(&cut).unwrap()));
        }
    }
    let tops = 0..file.top_count();
    for leaf in tops.flat_map(|top| leaves(file, top)) {
        let is_shown = states(leaf).any(|state| state != ObjectState::Hidden);
        assert_eq!(covered.contains(&leaf), is_shown, "{leaf}");
    }
    all.sort_unstable();
    all
}

#[test]
fn what_is_extracted_is_what_is_not_hidden_at_every_tolerance() {
    let mut seen = [0; 3];
    for (number, bytes) in files().iter().enumerate() {
        let file = open(bytes);
        let mut random = Random::new(number as u64);
        let tolerances: Vec<Option<f64>> = (0..file.level_count())
            .map(|level| Some(file.level(level).unwrap().max_error))
            .chain([None, Some(f64::MAX)])
            .collect();
        for _ in 0..40 {
            let choice = random_choice(&file, &mut random);
            let state = state_of(&file, &choice);
            (0..file.objects().unwrap().count()).for_each(|object| seen[state(object) as usize] += 1);
            let filter = file.filter_objects(&choice).unwrap();
            for &tolerance in &tolerances {
                let query = Query { tolerance, objects: Some(Arc::clone(&filter)), ..Query::default() };
                let cut = file.select(&query).unwrap();
                let wanted = expected(&file, &cut.nodes, &state);
                let mesh = file.extract(&cut).unwrap();
                assert!(triangles(&mesh) == wanted, "{number}: {choice:?} at {tolerance:?}");
                assert!(mesh.triangles.len() as u64 <= cut.triangle_count);
                // No vertex is left over, and none is missing.
                let used: BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
                assert!(used.iter().copied().eq(0..mesh.positions.len() as u32));
                if let Some(tolerance) = tolerance.filter(|tolerance| *tolerance >= cut.error) {
                    assert!(cut.error <= tolerance);
                }
                // A whole hierarchy gives the same cut as the index.
                let hierarchy = Arc::new(file.hierarchy().unwrap());
                let adapter = Adapter::new(hierarchy, &query, Coherence { hysteresis: 0.0, play: 0.0 }).unwrap();
                assert_eq!(adapter.cut().nodes, cut.nodes);
            }
        }
    }
    assert!(seen.iter().all(|&count| count > 500), "{seen:?}");
}

#[test]
fn filters_that_hide_everything_show_nothing_and_those_that_hide_nothing_everything() {
    for bytes in files() {
        let file = open(&bytes);
        let all: Vec<u32> = (0..file.objects().unwrap().count()).collect();
        for filter in [file.hide(&all).unwrap(), file.only(&[]).unwrap()] {
            for outside in [Outside::Drop, Outside::Coarsest] {
                let query = Query { objects: Some(Arc::clone(&filter)), outside, ..Query::default() };
                let cut = file.select(&query).unwrap();
                assert!(cut.nodes.is_empty());
                assert_eq!(file.extract(&cut).unwrap(), Mesh::default());
            }
            assert_eq!(file.pick_shown(down(&file), Some(&filter)).unwrap(), None);
        }
        let query = Query { tolerance: Some(f64::MAX), ..Query::default() };
        let plain = file.select(&query).unwrap();
        for filter in [file.hide(&[]).unwrap(), file.only(&all).unwrap()] {
            let cut = file.select(&Query { objects: Some(filter), ..query.clone() }).unwrap();
            assert_eq!(cut.nodes, plain.nodes);
            assert_eq!(file.extract(&cut).unwrap(), file.extract(&plain).unwrap());
        }
    }
}

/// A ray through everything.
fn down(file: &File<&[u8]>) -> Ray {
    let [low, high] = file.bounds().unwrap();
    let origin = [0, 1, 2].map(|k| high[k] + 1.0);
    Ray { origin, direction: [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0 - origin[k]) }
}

#[test]
fn budgets_and_volumes_hold_for_what_is_shown() {
    let bytes = file_of(5, 64, 6);
    let file = open(&bytes);
    let mut random = Random::new(8);
    for _ in 0..30 {
        let choice = random_choice(&file, &mut random);
        let state = state_of(&file, &choice);
        let objects = Some(file.filter_objects(&choice).unwrap());
        let coarsest = file.select(&Query { tolerance: Some(f64::MAX), objects: objects.clone(), ..Query::default() });
        let coarsest = coarsest.unwrap();
        let most = coarsest.triangle_count + random.below(2000);
        let query = Query { max_triangles: Some(most), objects: objects.clone(), ..Query::default() };
        let cut = file.select(&query).unwrap();
        assert!(cut.triangle_count <= most);
        assert!(triangles(&file.extract(&cut).unwrap()) == expected(&file, &cut.nodes, &state));
        if coarsest.triangle_count > 0 {
            let less = Query { max_triangles: Some(coarsest.triangle_count - 1), ..query.clone() };
            assert!(matches!(file.select(&less), Err(Error::Query { .. })));
        }
        let [low, high] = file.bounds().unwrap();
        let volume = Volume::Box([low, [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * random.unit())]);
        let inside = file.select(&Query { volume: Some(volume), objects, ..Query::default() }).unwrap();
        for node in &inside.nodes {
            assert!(volume.meets(file.root_bounds(node.root).unwrap()));
            let mut of_leaf = file.objects().unwrap().of_leaf(node.root).unwrap().into_iter().map(&state);
            assert!(of_leaf.any(|state| state != ObjectState::Hidden));
        }
    }
}

/// Checks that a picture has the triangles of its nodes that are not hidden, and marks.
fn check_picture(file: &File<&[u8]>, picture: &Picture, filter: Option<&Arc<ObjectFilter>>) {
    let cut = Cut { nodes: picture.nodes(), objects: filter.cloned(), ..Cut::default() };
    assert!(triangles(&picture.mesh()) == triangles(&file.extract(&cut).unwrap()));
    assert_eq!(picture.triangle_count(), picture.mesh().triangles.len() as u64);
    let state = filter.map(|filter| state_of(file, filter.choice()));
    for drawn in picture.roots() {
        let (positions, joined) = drawn.joined();
        let marks = drawn.marks();
        assert!(marks.is_empty() || marks.len() == positions.len());
        let corners = |of: &[u32; 3]| triangle(of.map(|vertex| positions[vertex as usize]));
        let mut marked: Vec<Triangle> = joined
            .iter()
            .filter(|of| {
                let mut of = of.iter().map(|&vertex| marks.get(vertex as usize).copied().unwrap_or(false));
                let first = of.next().unwrap();
                assert!(of.all(|other| other == first));
                first
            })
            .map(corners)
            .collect();
        marked.sort_unstable();
        let root = drawn.surface.root;
        let mut wanted = vec![];
        if let Some(state) = &state {
            let cut = Cut { nodes: vec![Node { root, level: drawn.surface.level }], ..Cut::default() };
            if file.children(root).unwrap().is_empty() {
                let (mesh, owners) = file.extract_objects(&cut).unwrap();
                let of_owner = mesh.triangles.iter().zip(owners).filter(|(_, o)| state(*o) == ObjectState::Marked);
                wanted.extend(of_owner.map(|(of, _)| triangle(of.map(|vertex| mesh.positions[vertex as usize]))));
            } else if leaves(file, root)
                .into_iter()
                .flat_map(|leaf| file.objects().unwrap().of_leaf(leaf).unwrap())
                .all(|object| state(object) == ObjectState::Marked)
            {
                wanted.extend(triangles(&file.extract(&cut).unwrap()));
            }
        }
        wanted.sort_unstable();
        assert!(marked == wanted, "root {root}");
    }
}

#[test]
fn a_session_that_changes_what_it_shows_draws_what_is_extracted() {
    for (number, bytes) in files().iter().enumerate() {
        let file = open(bytes);
        let mut random = Random::new(50 + number as u64);
        let mode = [Mode::Asynchronous, Mode::Synchronous][number % 2];
        let mut session = file.session(Options { mode, light: number < 2, ..Options::default() }).unwrap();
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        let hierarchy = Arc::new(file.hierarchy().unwrap());
        let mut follower = Follower::new(hierarchy, Coherence::default(), Duration::ZERO);
        let mut filter = None;
        for step in 0..60 {
            if step % 2 == 0 {
                let choice = random_choice(&file, &mut random);
                filter = (random.below(5) > 0).then(|| file.filter_objects(&choice).unwrap());
            }
            let level = random.below(file.level_count() as u64) as usize;
            let tolerance = (random.below(3) > 0).then(|| file.level(level).unwrap().max_error);
            let query = Query { tolerance, objects: filter.clone(), ..Query::default() };
            let (cut, _) = follower.follow(&query, Duration::ZERO).unwrap();
            session.show_objects(filter.clone()).unwrap();
            simulation.frame(&mut session, &cut.nodes, &[]).unwrap();
            simulation.settle(&session);
            let frame = simulation.frame(&mut session, &cut.nodes, &[]).unwrap();
            assert!(frame.is_complete);
            assert_eq!(session.picture().nodes(), cut.nodes);
            check_picture(&file, session.picture(), filter.as_ref());
            // What stays the same is not drawn anew.
            let frame = simulation.frame(&mut session, &cut.nodes, &[]).unwrap();
            assert!(frame.changes.surfaces.is_empty() && frame.changes.removed.is_empty());
        }
    }
}

/// A large file is walked by a thread, which finds what other objects need.
#[cfg(feature = "threads")]
#[test]
fn a_streamer_of_a_large_file_shows_other_objects_once_it_knows_their_roots() {
    use crate::stream::StreamerOptions;
    let bytes = file_of(5, 6000, 3);
    let file = open(&bytes);
    let streamed = File::open(bytes.clone(), Limits::default()).unwrap();
    assert!(streamed.index().index_bytes() > crate::select::SMALL_INDEX_BYTES);
    let session = Options { mode: Mode::Synchronous, may_stay_finer: false, ..Options::default() };
    let mut streamer = streamed.streamer(StreamerOptions { session, ..StreamerOptions::default() }).unwrap();
    let some: Vec<u32> = (0..40).map(|k| k * 137).collect();
    let choices = [
        Some(ObjectChoice::only(&some)),
        None,
        Some(ObjectChoice::hide(&some)),
        Some(ObjectChoice { hidden: some[..20].to_vec(), marked: some[20..].to_vec(), ..ObjectChoice::default() }),
        Some(ObjectChoice::only(&[])),
        None,
    ];
    let bounds = file.bounds().unwrap();
    for choice in choices {
        let objects = choice.map(|choice| file.filter_objects(&choice).unwrap());
        let volume = Some(Volume::Box([bounds[0], [0, 1, 2].map(|k| (bounds[0][k] + bounds[1][k]) / 2.0)]));
        let query = Query { volume, tolerance: Some(0.0), objects: objects.clone(), ..Query::default() };
        let wanted = file.select(&query).unwrap();
        for _ in 0..20 {
            streamer.frame(&query).unwrap();
            streamer.settle();
        }
        assert!(streamer.frame(&query).unwrap().is_complete());
        assert_eq!(streamer.picture().nodes(), wanted.nodes);
        check_picture(&file, streamer.picture(), objects.as_ref());
    }
}

#[test]
fn changes_of_a_filter_are_told_as_a_viewer_needs_them() {
    let bytes = file_of(3, 40, 7);
    let file = open(&bytes);
    let hierarchy = Arc::new(file.hierarchy().unwrap());
    let mut random = Random::new(2);
    let query = |objects| Query { tolerance: Some(f64::MAX), objects, ..Query::default() };
    let mut adapter = Adapter::new(hierarchy, &query(None), Coherence::default()).unwrap();
    let mut drawn = std::collections::BTreeMap::new();
    for _ in 0..30 {
        let choice = random_choice(&file, &mut random);
        let objects = (random.below(4) > 0).then(|| file.filter_objects(&choice).unwrap());
        let report = adapter.update(&query(objects)).unwrap();
        assert!(report.changes.is_sorted_by_key(|change| change.root));
        for change in report.changes {
            match change.level {
                Some(level) => assert_ne!(drawn.insert(change.root, level), Some(level)),
                None => assert!(drawn.remove(&change.root).is_some()),
            }
        }
        let nodes: Vec<Node> = drawn.iter().map(|(&root, &level)| Node { root, level }).collect();
        assert_eq!(adapter.cut().nodes, nodes);
    }
}

#[test]
fn picks_go_past_hidden_objects() {
    let bytes = file_of(11, 70, 9);
    let file = open(&bytes);
    let mut random = Random::new(6);
    let [low, high] = file.bounds().unwrap();
    let mut hits = 0;
    for _ in 0..12 {
        let choice = random_choice(&file, &mut random);
        let state = state_of(&file, &choice);
        let filter = file.filter_objects(&choice).unwrap();
        let query = Query { objects: Some(Arc::clone(&filter)), ..Query::default() };
        let (mesh, owners) = file.extract_objects(&file.select(&query).unwrap()).unwrap();
        assert!(owners.iter().all(|&owner| state(owner) != ObjectState::Hidden));
        for _ in 0..40 {
            let mut point = || [0, 1, 2].map(|k| low[k] - 1.0 + (high[k] - low[k] + 2.0) * random.unit());
            let (origin, to) = (point(), point());
            let direction = [0, 1, 2].map(|k| to[k] - origin[k]);
            let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
            let ray = Ray { origin, direction: direction.map(|x| x / length) };
            let of = |corners: &[u32; 3]| corners.map(|vertex| mesh.positions[vertex as usize]);
            let met = mesh.triangles.iter().zip(&owners);
            let met = met.filter_map(|(corners, &owner)| Some((crate::decode::meets(&ray, of(corners))?, owner)));
            let wanted = met.min_by(|a, b| a.0.total_cmp(&b.0));
            let pick = file.pick_shown(ray, Some(&filter)).unwrap();
            assert_eq!(pick.map(|pick| pick.object), wanted.map(|(_, owner)| Some(owner)));
            hits += usize::from(pick.is_some());
        }
    }
    assert!(hits > 25, "{hits}");
}

#[test]
fn boxes_of_objects_hold_them_and_little_else() {
    for bytes in files() {
        let file = open(&bytes);
        let objects = file.objects().unwrap();
        let finest = Query::default();
        for node in (0..objects.node_count()).step_by(3) {
            let [low, high] = objects.bounds(&[node]).unwrap().unwrap();
            let query = Query { objects: Some(file.only(&[node]).unwrap()), ..finest.clone() };
            let mesh = file.extract(&file.select(&query).unwrap()).unwrap();
            assert!(!mesh.positions.is_empty());
            let slack = file.level(0).unwrap().max_error;
            for k in 0..3 {
                let along = || mesh.positions.iter().map(|position| position[k]);
                let [least, most] = [along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)];
                assert!(low[k] <= least && most <= high[k]);
                assert!(least - low[k] <= 2.0 * slack && high[k] - most <= 2.0 * slack, "{node}");
            }
        }
        assert_eq!(objects.bounds(&[]).unwrap(), None);
    }
}

#[test]
fn children_come_page_by_page() {
    for bytes in files() {
        let file = open(&bytes);
        let objects = file.objects().unwrap();
        let parents = (0..objects.node_count()).map(Some).chain([None]);
        for parent in parents {
            let pages = objects.child_pages(parent).unwrap();
            let of_page = |page: u32| objects.children_in(parent, page).unwrap();
            let all: Vec<u32> = pages.into_iter().flat_map(of_page).collect();
            assert_eq!(all, objects.children(parent).unwrap());
        }
        assert!(objects.children_in(None, objects.page_count()).is_err());
    }
}

#[test]
fn an_object_alone_takes_few_requests_and_little_of_a_large_file() {
    let bytes = file_of(5, 900, 30);
    let counting = Counting::new(bytes.as_slice());
    let file = File::open(counting, Limits::default()).unwrap();
    let before = (file.source().read_count(), file.source().byte_count());
    let filter = file.only(&[700]).unwrap();
    let query = Query { objects: Some(filter), ..Query::default() };
    let cut = file.select(&query).unwrap();
    let mesh = file.extract(&cut).unwrap();
    assert!(!mesh.triangles.is_empty());
    let (reads, read) = (file.source().read_count() - before.0, file.source().byte_count() - before.1);
    assert!(reads <= 16 && read < bytes.len() as u64 / 50, "{reads} requests, {read} of {} bytes", bytes.len());
}

#[test]
fn filters_of_another_file_and_nodes_that_do_not_exist_are_refused() {
    let (bytes, other) = (file_of(3, 40, 7), file_of(4, 40, 7));
    let (file, other) = (open(&bytes), open(&other));
    let foreign = other.hide(&[0]).unwrap();
    let query = Query { objects: Some(Arc::clone(&foreign)), ..Query::default() };
    let is_refused = |result: Option<Error>| matches!(result, Some(Error::Query { .. }));
    assert!(is_refused(file.select(&query).err()));
    let cut = Cut { objects: Some(Arc::clone(&foreign)), ..file.select(&Query::default()).unwrap() };
    assert!(is_refused(file.extract(&cut).err()));
    assert!(is_refused(file.pick_shown(down(&file), Some(&foreign)).err()));
    assert!(is_refused(file.session(Options::default()).unwrap().show_objects(Some(foreign)).err()));
    assert!(is_refused(file.hide(&[file.objects().unwrap().node_count()]).err()));
    // A group that shows hidden objects beside others has no triangles of its own for these.
    let objects = Some(file.hide(&[0]).unwrap());
    let coarsest = file.uniform_cut(0).unwrap();
    assert!(is_refused(file.extract(&Cut { objects, ..coarsest }).err()));
    // What was made for some objects knows nothing of others.
    let query = Query { objects: Some(file.hide(&[0]).unwrap()), ..Query::default() };
    let of_some = file.hierarchy_for(&query).unwrap();
    assert!(Adapter::new(Arc::clone(&of_some), &query, Coherence::default()).is_ok());
    assert!(is_refused(Adapter::new(of_some, &Query::default(), Coherence::default()).err()));
    // Files without objects hide none.
    let plain = super::synthetic::file_of(&super::synthetic::cube(2), PLAIN);
    assert!(is_refused(File::open(plain.as_slice(), Limits::default()).unwrap().hide(&[]).err()));
}
