//! Sessions of files of heights.

use std::{
    collections::{BTreeMap, HashSet},
    io,
    sync::Arc,
    time::Duration,
};

use crate::{
    Limits, Opened,
    heights::{Heights, HeightsIndex, SIDE, enclosed_ball, is_hidden, tile_box},
    select::{Limiter, Query, View},
    source::Recording,
    stream::{Frame, HeightsSession, Job, Mode, Options, Picture, Read, Shows},
    tests::{
        synthetic::Random,
        terrain::{Terrain, hash},
    },
};

const NOW: Duration = Duration::ZERO;

pub(super) fn terrains() -> Vec<(&'static str, Terrain)> {
    let island = |column: u64, row: u64| {
        let away = column.abs_diff(120).pow(2) + row.abs_diff(80).pow(2);
        away < 60_u64.pow(2) && away > 15_u64.pow(2) || column + row == 77 || column > 200 && row % 37 == 5
    };
    vec![
        ("plane", Terrain::plane([700, 500])),
        ("odd sizes", Terrain::plane([300, 173])),
        ("globe", Terrain::globe([600, 300])),
        ("part of a globe", Terrain::part_of_globe([130, 100])),
        ("islands", Terrain::plane([300, 173]).with_cells(island)),
        ("globe with islands", Terrain::globe([300, 150]).with_cells(island)),
        ("wraps within a tile", Terrain::globe([60, 30])),
        (
            "sea within a globe",
            Terrain::globe([300, 150]).level_but(|x, y| (200..230).contains(&x) && (40..60).contains(&y)),
        ),
    ]
}

pub(super) fn open(bytes: &[u8]) -> Heights<&[u8]> {
    Heights::open(bytes, Limits::default()).unwrap()
}

pub(super) fn options(mode: Mode) -> Options {
    Options { mode, ..Options::default() }
}

/// A view from anywhere around the terrain, mostly towards it.
pub(super) fn random_view(index: &HeightsIndex, random: &mut Random) -> View {
    let (grid, surface) = (index.grid(), index.surface());
    let mut at = |height: f64| {
        let [column, row] = grid.cells().map(|count| random.below(count + 1));
        surface.position(surface.line(0, column), surface.line(1, row), height)
    };
    let target = at(100.0);
    let mut position = at(10.0);
    let size = if surface.is_globe() { 1000.0 } else { 300.0 };
    // From just above to far away.
    let away = size * 10_f64.powf(random.below(300) as f64 / 100.0 - 2.0);
    match surface.is_globe() {
        true => position = position.map(|x| x * (1.2 + away / 1000.0)),
        false => position[2] += 60.0 + away,
    }
    let forward = [0, 1, 2].map(|k| target[k] - position[k]);
    let tolerance = 10_f64.powf(random.below(300) as f64 / 100.0 - 1.0);
    View { position, forward, up: [0.1, 0.2, 1.0], near: 0.1, pixel_tolerance: tolerance, ..View::default() }
}

/// Corners of triangles, in space, beginning with the least.
type Triangles = HashSet<[[u64; 3]; 3]>;

fn add(triangles: &mut Triangles, corners: [[f64; 3]; 3], name: &str) {
    // Zero has no sign here.
    let mut corners = corners.map(|corner| corner.map(|x| (x + 0.0).to_bits()));
    let first = (0..3).min_by_key(|&k| corners[k]).unwrap();
    corners.rotate_left(first);
    assert!(triangles.insert(corners), "{name}: a triangle is there twice");
}

fn triangles_of(picture: &Picture, name: &str) -> Triangles {
    let mut all = Triangles::new();
    for drawn in picture.roots() {
        let (positions, triangles) = drawn.joined();
        triangles.iter().for_each(|triangle| add(&mut all, triangle.map(|k| positions[k as usize]), name));
    }
    all
}

/// Jobs of a session, done in a random order.
#[derive(Default)]
pub(super) struct Worker {
    flying: Vec<Read>,
    pub(super) now: Duration,
}

impl Worker {
    /// Does some jobs; all if `most` is large.
    pub(super) fn work(&mut self, session: &HeightsSession, source: &[u8], most: u64, random: &mut Random) {
        for _ in 0..most {
            match session.poll(self.now) {
                Some(Job::Read(read)) => self.flying.push(read),
                Some(Job::Decode(decoding)) => session.finish(decoding.run(), self.now),
                None if self.flying.is_empty() => return,
                None => {
                    let read = self.flying.swap_remove(random.below(self.flying.len() as u64) as usize);
                    session.supply(&read, read.run(source), self.now);
                }
            }
        }
    }
}

pub(super) fn frame(session: &mut HeightsSession, view: &View) -> Frame {
    session.begin(&Query { view: Some(*view), ..Query::default() }, None, NOW).unwrap();
    session.end(NOW).unwrap()
}

/// Draws a frame after everything for it has come.
pub(super) fn settled(session: &mut HeightsSession, view: &View, source: &[u8]) -> Frame {
    for second in 0..50 {
        let now = Duration::from_secs(second);
        session.begin(&Query { view: Some(*view), ..Query::default() }, None, now).unwrap();
        Worker { now, ..Worker::default() }.work(session, source, u64::MAX, &mut Random::new(1));
        let frame = session.end(now).unwrap();
        if frame.is_complete {
            return frame;
        }
    }
    panic!("it is never complete")
}

#[test]
fn every_frame_is_the_mesh_of_its_cut() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(12.0);
        let heights = open(&bytes);
        let mut random = Random::new(7);
        let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Asynchronous)).unwrap();
        let mut worker = Worker::default();
        let mut sizes = HashSet::new();
        let mut late = 0;
        let count = if name.contains("globe") || name == "plane" { 200 } else { 60 };
        let mut view = random_view(heights.index(), &mut random);
        for step in 0..count {
            // Some frames look from where the one before did.
            if random.below(3) > 0 {
                view = random_view(heights.index(), &mut random);
            }
            let frame = frame(&mut session, &view);
            assert_eq!(frame.shows, Shows::Picture);
            late += u32::from(!frame.is_complete);
            let cut = session.cut();
            let mesh = heights.mesh(&cut).unwrap();
            let mut expected = Triangles::new();
            for triangle in &mesh.triangles {
                add(&mut expected, triangle.map(|k| mesh.positions[k as usize]), name);
            }
            let drawn = triangles_of(session.picture(), name);
            assert!(drawn == expected, "{name} {step}: {} triangles, {} in the mesh", drawn.len(), expected.len());
            assert_eq!(session.picture().triangle_count(), drawn.len() as u64);
            for root in session.picture().roots() {
                let id = session.tile(root.surface.root).unwrap();
                let tile = cut.tiles.iter().find(|tile| tile.id == id).unwrap();
                assert_eq!((root.error(), u32::from(root.surface.level)), (tile.resolution.error, id.depth));
            }
            sizes.insert(drawn.len());
            let most = random.below(30);
            worker.work(&session, &bytes, most, &mut random);
        }
        assert!(sizes.len() > 10 && late > 0 || name.contains("within"), "{name}: {} {late}", sizes.len());
    }
}

#[test]
fn changes_say_what_is_new_and_leave_the_rest_as_it_is() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(12.0);
        let heights = open(&bytes);
        let mut random = Random::new(11);
        let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Asynchronous)).unwrap();
        let mut worker = Worker::default();
        let mut shown = BTreeMap::new();
        let (mut kept, mut strips) = (0, 0);
        for _ in 0..60 {
            let view = random_view(heights.index(), &mut random);
            let frame = frame(&mut session, &view);
            let changes = &frame.changes;
            changes.removed.iter().for_each(|root| drop(shown.remove(root).unwrap()));
            for drawn in session.picture().roots() {
                let root = drawn.surface.root;
                let now = (Arc::clone(&drawn.surface), Arc::clone(&drawn.strips[0]));
                if changes.surfaces.contains(&root) {
                    shown.insert(root, now);
                    continue;
                }
                let before = shown.get_mut(&root).unwrap();
                assert!(Arc::ptr_eq(&before.0, &now.0), "{name}");
                assert_eq!(!Arc::ptr_eq(&before.1, &now.1), changes.strips.contains(&(root, 0)), "{name}");
                assert!(Arc::ptr_eq(&before.1, &now.1) || before.1 != now.1, "{name}");
                kept += 1;
                strips += u32::from(changes.strips.contains(&(root, 0)));
                *before = now;
            }
            assert_eq!(shown.len(), session.picture().roots().len());
            worker.work(&session, &bytes, 20, &mut random);
        }
        assert!(kept > strips && strips > 0 || name.contains("within"), "{name}: {kept} kept, {strips} strips");
    }
}

#[test]
fn complete_frames_reach_the_tolerance_within_the_budgets() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(12.0);
        let heights = open(&bytes);
        let mut random = Random::new(5);
        let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Synchronous)).unwrap();
        for step in 0..40 {
            let view = random_view(heights.index(), &mut random);
            let max_triangles = (step % 2 == 1).then(|| 500 + random.below(20_000));
            let max_nodes = (step % 4 == 2).then(|| 1 + random.below(20));
            let query = Query { view: Some(view), max_triangles, max_nodes, ..Query::default() };
            session.begin(&query, None, NOW).unwrap();
            let frame = loop {
                Worker::default().work(&session, &bytes, u64::MAX, &mut random);
                if let Some(frame) = session.end(NOW) {
                    break frame;
                }
            };
            assert!(frame.is_complete && frame.late_roots == 0);
            let error_px = session.error_px(&view).unwrap();
            assert_eq!(error_px, session.frame_error_px());
            let cut = session.cut();
            let is_exceeded = session.exceeded().is_some();
            assert!(max_triangles.is_none_or(|most| cut.triangle_count <= most) || is_exceeded);
            assert!(max_nodes.is_none_or(|most| cut.tiles.len() as u64 <= most) || is_exceeded);
            match session.limiter() {
                Limiter::Tolerance => assert!(error_px <= view.pixel_tolerance, "{name}: {error_px}"),
                Limiter::Finest => {}
                Limiter::Triangles => assert!(max_triangles.is_some()),
                Limiter::Nodes => assert!(max_nodes.is_some()),
                Limiter::Bytes => panic!(),
            }
        }
    }
}

#[test]
fn boxes_hold_tiles_and_nothing_that_a_globe_hides_is_seen() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(12.0);
        let heights = open(&bytes);
        let index = heights.index();
        let ball = enclosed_ball(index);
        assert_eq!(ball.is_some(), name == "globe" || name.contains("within"), "{name}");
        let mut random = Random::new(3);
        let mut hidden = 0;
        let mut waiting = heights.roots().to_vec();
        while let Some(id) = waiting.pop() {
            let record = heights.record(id).unwrap().unwrap();
            let bounds = tile_box(index, &record);
            let tile = heights.tile(id).unwrap().unwrap();
            let drawn = heights.draw(id, &tile, 0.0);
            let used: HashSet<u16> = drawn.triangles(0.0).into_iter().flatten().collect();
            let camera = random_view(index, &mut random).position;
            let is_hidden = ball.is_some_and(|radius| is_hidden(camera, radius, &bounds));
            hidden += u32::from(is_hidden);
            for at in used.into_iter().map(usize::from) {
                assert!(at < SIDE * SIDE);
                let position = drawn.position(at);
                for (axis, half) in bounds.axes.iter().zip(bounds.half) {
                    let along: f64 = (0..3).map(|k| axis[k] * (position[k] - bounds.centre[k])).sum();
                    assert!(along.abs() <= half * (1.0 + 1e-9) + 1e-9, "{name} {id:?} {along} {half}");
                }
                if let (true, Some(radius)) = (is_hidden, ball) {
                    // The way from the camera passes through the ball.
                    let way = [0, 1, 2].map(|k| position[k] - camera[k]);
                    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                    let share = (-dot(way, camera) / dot(way, way)).clamp(0.0, 1.0);
                    let nearest = [0, 1, 2].map(|k| camera[k] + share * way[k]);
                    assert!(dot(nearest, nearest) <= radius * radius, "{name} {id:?}");
                }
            }
            waiting.extend(record.child_tiles());
        }
        assert!(hidden > 3 || name != "globe", "{name}: {hidden}");
    }
}

#[test]
fn few_requests_bring_all_that_a_view_wants() {
    let bytes = Terrain::globe([2000, 1000]).file(12.0);
    let heights = open(&bytes);
    let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Asynchronous)).unwrap();
    let recording = Recording::new(bytes.as_slice());
    let position = [1500.0, 300.0, 200.0];
    let view = View { position, forward: position.map(|x| -x), pixel_tolerance: 0.01, ..View::default() };
    let mut frames = 0;
    loop {
        frames += 1;
        let frame = frame(&mut session, &view);
        if frame.is_complete {
            break;
        }
        while let Some(job) = session.poll(NOW) {
            match job {
                Job::Read(read) => session.supply(&read, read.run(&recording), NOW),
                Job::Decode(decoding) => session.finish(decoding.run(), NOW),
            }
        }
    }
    let requests = recording.take();
    let tiles = session.cut().tiles.len();
    assert!(tiles > 60 && requests.len() <= tiles / 4, "{} requests, {tiles} tiles", requests.len());
    assert!(frames <= 4, "{frames}");
    let all: u64 = requests.iter().map(|request| request.end - request.start).sum();
    assert!(all < bytes.len() as u64, "{all} of {}", bytes.len());
}

#[test]
fn what_is_damaged_is_drawn_coarser_and_named_once() {
    let mut bytes = Terrain::plane([700, 500]).file(12.0);
    // Blocks of the finest tiles come last.
    let length = bytes.len();
    bytes[length - 2000..].iter_mut().for_each(|byte| *byte ^= 0x55);
    let heights = open(&bytes);
    let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Asynchronous)).unwrap();
    let view = View { position: [800.0, -300.0, 900.0], forward: [0.0, 0.0, -1.0], ..View::default() };
    let view = View { pixel_tolerance: 1e-3, ..view };
    settled(&mut session, &view, &bytes);
    let problems = session.take_problems();
    assert!(!problems.is_empty() && problems.len() < 30, "{problems:?}");
    let names: HashSet<String> = problems.iter().map(|problem| problem.location.clone()).collect();
    assert_eq!(names.len(), problems.len());
    assert!(frame(&mut session, &view).is_complete && session.take_problems().is_empty());
    // The surface has no hole: it is the mesh of a cut that covers everything in view.
    let mesh = heights.mesh(&session.cut()).unwrap();
    assert_eq!(mesh.triangles.len() as u64, session.picture().triangle_count());
    session.retry_failed();
    assert!(!frame(&mut session, &view).is_complete);
}

#[test]
fn reads_that_fail_are_tried_again() {
    let bytes = Terrain::globe([2000, 1000]).file(12.0);
    let heights = open(&bytes);
    let mut session = HeightsSession::new(Arc::clone(heights.index()), options(Mode::Asynchronous)).unwrap();
    let view = View { position: [1500.0, 0.0, 0.0], forward: [-1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0], ..View::default() };
    let mut now = NOW;
    for step in 0_u64.. {
        session.begin(&Query { view: Some(view), ..Query::default() }, None, now).unwrap();
        while let Some(job) = session.poll(now) {
            match job {
                Job::Read(read) if hash([read.id, step]) % 3 == 0 => {
                    session.supply(&read, Err(io::ErrorKind::TimedOut.into()), now);
                }
                Job::Read(read) => session.supply(&read, read.run(bytes.as_slice()), now),
                Job::Decode(decoding) => session.finish(decoding.run(), now),
            }
        }
        if session.end(now).unwrap().is_complete {
            break;
        }
        now += Duration::from_millis(500);
        assert!(step < 100);
    }
    assert!(session.take_problems().is_empty() && session.counters().retries > 0);
}

#[test]
fn what_the_camera_moves_to_is_there_before() {
    let bytes = Terrain::plane([2000, 2000]).file(12.0);
    let heights = open(&bytes);
    let at = |x: f64| View {
        position: [x, -1500.0, 300.0],
        forward: [0.2, 0.0, -1.0],
        up: [1.0, 0.0, 0.0],
        ..View::default()
    };
    let query = |view: View| Query { view: Some(view), ..Query::default() };
    let late = |mode: Mode| {
        let mut session = HeightsSession::new(Arc::clone(heights.index()), options(mode)).unwrap();
        let mut late = 0;
        for step in 0..40 {
            let x = 200.0 + 60.0 * f64::from(step);
            session.begin(&query(at(x)), Some(&query(at(x + 300.0))), NOW).unwrap();
            let frame = session.end(NOW).unwrap();
            late += if step > 8 { frame.late_roots } else { 0 };
            Worker::default().work(&session, &bytes, u64::MAX, &mut Random::new(1));
        }
        late
    };
    let (without, with) = (late(Mode::Asynchronous), late(Mode::AsynchronousWithPrefetch));
    assert!(without > 0 && with < without, "{without} late, {with} with prefetching");
}

#[test]
fn queries_that_make_no_sense_are_refused() {
    let bytes = Terrain::plane([300, 173]).file(5.0);
    let Opened::Heights(heights) = Opened::open(bytes.as_slice(), Limits::default()).unwrap() else { panic!() };
    let mut session = HeightsSession::new(Arc::clone(heights.index()), Options::default()).unwrap();
    for query in [
        Query { tolerance: Some(f64::NAN), ..Query::default() },
        Query { max_bytes: Some(1), ..Query::default() },
        Query { view: Some(View { forward: [0.0; 3], ..View::default() }), ..Query::default() },
    ] {
        assert!(session.begin(&query, None, NOW).is_err());
    }
    // Without a view, tolerances are lengths, and a volume says where.
    let volume = Some([[150.0, -100.0, -1e9], [180.0, -60.0, 1e9]].into());
    let whole = Query { tolerance: Some(0.5), ..Query::default() };
    let part = Query { volume, ..whole.clone() };
    let counts = [whole, part].map(|query| {
        session.begin(&query, None, NOW).unwrap();
        Worker::default().work(&session, &bytes, u64::MAX, &mut Random::new(1));
        session.end(NOW).unwrap();
        session.picture().roots().len()
    });
    assert!(counts[0] > counts[1] && counts[1] > 0, "{counts:?}");
}
