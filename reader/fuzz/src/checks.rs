//! What must hold for any bytes: an error or an answer that keeps its promises, never a panic, never more memory or
//! time than the limits allow. The fuzz targets call these; the tests of the reader do too, with a few thousand changed
//! files.
//!
//! With `--cfg fuzzing` (which `cargo fuzz` sets) the reader takes every checksum for right.

use std::{io, sync::Arc, time::Duration};

use lodpack::{
    Cut, Error, File, Limits, Node, Outside, Query, ReadAt, Result, View,
    heights::{Heights, HeightsQuery, TileId},
    index::{Ray, Scale},
    select::{Adapter, Coherence},
    source::Request,
    stream::{HeightsSession, Job, Lit, Options, Picture, Simulation},
};

/// Small, so that what a hostile file can ask for stays quick.
const LIMITS: Limits = Limits {
    root_count: 1 << 8,
    root_vertex_count: 1 << 8,
    cluster_record_count: 1 << 10,
    part_bytes: 1 << 16,
    texel_count: 1 << 12,
};

/// Opens the bytes, whole and as a beginning; the overview decodes or is refused.
pub fn open(bytes: &[u8]) {
    for file in [File::open(bytes, LIMITS), File::open_prefix(bytes, LIMITS)].into_iter().flatten() {
        assert!(file.level_count() > 0);
        assert!((0..file.level_count()).all(|level| file.level(level).is_some()));
        if let Ok(Some(overview)) = file.overview() {
            let mesh = overview.mesh(&file.lattice());
            check_indices(&mesh);
        }
        if let Ok(Some(ground)) = file.ground() {
            assert!(ground.frame.scale() > 0.0 && ground.frame.point([1e15; 3]).iter().all(|x| x.is_finite()));
            let matrices = [ground.frame.surface_from_ground(), ground.frame.ground_from_surface()];
            assert!(matrices.iter().flatten().flatten().all(|x| x.is_finite()));
            let coarse = HeightsQuery { max_triangles: Some(1000), ..HeightsQuery::default() };
            if let Ok(mesh) = ground.heights.cut(&coarse).and_then(|cut| ground.heights.mesh(&cut)) {
                assert!(mesh.positions.iter().all(|&point| ground.frame.point(point).iter().all(|x| x.is_finite())));
            }
        }
    }
}

/// Opens the bytes as heights, and draws and reads some of them.
pub fn heights(bytes: &[u8]) {
    let Ok(heights) = Heights::open(bytes, LIMITS) else { return };
    let (grid, [columns, rows]) = (heights.grid().clone(), heights.grid().samples());
    // The last bytes decide what is asked for.
    let byte = |from_end: usize| bytes.get(bytes.len().wrapping_sub(from_end)).copied().unwrap_or(0);
    let tolerance = Some(f64::from(byte(1)) * f64::from(byte(2)));
    let query = HeightsQuery { tolerance, max_triangles: Some(100 * u64::from(byte(3))), ..HeightsQuery::default() };
    if let Ok(cut) = heights.cut(&query) {
        assert!(cut.tiles.iter().all(|tile| tile.resolution.error <= cut.error));
        assert!(cut.tiles.iter().all(|tile| heights.record(tile.id).is_ok_and(|record| record.is_some())));
        if let Ok(mesh) = heights.mesh(&cut) {
            assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
            assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions.len()));
            assert_eq!(mesh.triangle_tiles.len(), mesh.triangles.len());
        }
    }
    let [column, row] = [(columns, byte(4)), (rows, byte(5))].map(|(count, byte)| (count - 1) * u64::from(byte) / 255);
    let window = heights.window(column..columns.min(column + 70), row..rows.min(row + 3));
    assert!(window.is_err() || window.is_ok_and(|window| window.iter().all(|x| x.is_nan() || x.abs() < 1e25)));
    let deepest = TileId { depth: grid.depth(), column: column / 64, row: row / 64 };
    let _ = heights.tile(deepest);
    if let Some(&drape) = heights.drape() {
        let [halvings, width] = [byte(6) % (drape.most_halvings() + 2), byte(7) % 80];
        let columns = [column as f64 - f64::from(width), column as f64];
        if let Some(window) = drape.window(columns, [row as f64, row as f64 + 3.0], halvings)
            && let Ok(found) = heights.drape_image(&window)
        {
            let texels = window.size[0] as usize * window.size[1] as usize;
            assert_eq!(
                (found.image.size, found.image.data.len()),
                (window.size, texels * usize::from(found.image.components))
            );
        }
        let _ = heights.tile_image(deepest, 1 + u32::from(width));
        let _ = heights.verify();
    }
    heights_session(&heights, bytes);
}

/// Frames of a moving camera over heights, from a source that now and then fails or ends early: each is the mesh of its
/// cut.
fn heights_session(heights: &Heights<&[u8]>, bytes: &[u8]) {
    let source = Failing { bytes, calls: Default::default() };
    let caches = Options { byte_cache: 1 << 12, decoded_cache: 1 << 16, max_attempts: 3, ..Options::default() };
    let Ok(mut session) = HeightsSession::new(Arc::clone(heights.index()), caches) else { return };
    let Some([low, high]) = heights.index().bounds() else { return };
    let share = |k: u32| (dice(bytes) >> (8 * k) & 0xff) as f64 / 255.0;
    for step in 0..6_u32 {
        let now = Duration::from_millis(200 * u64::from(step));
        let at = |t: f64| [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * t);
        let view =
            View { position: at(1.5 - share(step % 4)), forward: [-1.0, -0.9, -0.8], near: 1e-3, ..View::default() };
        let budget = (step % 2 == 1).then_some(4000);
        let query = Query { view: Some(view), max_triangles: budget, ..Query::default() };
        if session.begin(&query, None, now).is_err() {
            continue;
        }
        for _ in 0..30 {
            match session.poll(now) {
                Some(Job::Read(read)) => session.supply(&read, read.run(&source), now),
                Some(Job::Decode(decoding)) => session.finish(decoding.run(), now),
                None => break,
            }
        }
        assert!(session.end(now).is_some());
        for drawn in session.picture().roots() {
            let (positions, triangles) = drawn.joined();
            assert!(triangles.iter().flatten().all(|&vertex| (vertex as usize) < positions.len()));
            assert!(session.tile(drawn.surface.root).is_some());
        }
        if let Ok(mesh) = heights.mesh(&session.cut()) {
            assert_eq!(mesh.triangles.len() as u64, session.picture().triangle_count());
        }
    }
}

/// Reads the whole index and asks it.
pub fn index(bytes: &[u8]) {
    let Ok(file) = File::open(bytes, LIMITS) else { return };
    let _ = (file.summary(), file.hierarchy());
    for root in (0..file.root_count()).take(64) {
        let _ = (file.root_contents(root), file.root_bounds(root));
    }
    objects(&file, bytes);
    for query in queries(&file, bytes) {
        if let Ok(cut) = file.select(&query) {
            check_cut(&cut, &query);
            let _ = file.own_bytes(&cut);
        }
    }
}

/// Asks for objects, and for what a ray meets.
fn objects(file: &File<&[u8]>, bytes: &[u8]) {
    let share = |k: u32| (dice(bytes) >> (8 * k) & 0xff) as f64 / 255.0;
    if let Some([low, high]) = file.bounds() {
        let at = |from: u32| [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * share((k as u32 + from) % 8));
        let (origin, to) = (at(0), at(3));
        let ray = Ray { origin, direction: [0, 1, 2].map(|k| to[k] - origin[k]) };
        if let Ok(Some(pick)) = file.pick(ray) {
            assert!(pick.distance >= 0.0 && pick.object.is_some() == file.objects().is_some());
        }
    }
    let Some(objects) = file.objects() else { return };
    for number in (0..objects.node_count()).take(8) {
        let Ok(node) = objects.node(number) else { continue };
        assert!(node.parent.is_none_or(|parent| parent < objects.node_count()));
        let _ = (objects.above(number), objects.children(Some(number)), objects.children(node.parent));
        if let Some(found) = node.name.as_ref().and_then(|name| objects.find_name(name).ok()) {
            assert!(found.is_sorted() && found.iter().all(|&other| objects.node(other).unwrap().name == node.name));
        }
        let _ = node.id.as_ref().map(|id| objects.find_id(id));
    }
    for object in (0..objects.count()).take(8) {
        for root in objects.leaves(object).unwrap_or_default() {
            assert!(objects.of_leaf(root).unwrap().contains(&object));
        }
    }
    for root in (0..file.root_count()).take(16) {
        let Ok(blocks) = file.root_contents(root).map(|contents| contents.blocks) else { continue };
        for block in blocks {
            let owners = objects.owners(root, block.level).unwrap_or_default();
            assert!(owners.iter().all(|&owner| owner < objects.count()));
        }
    }
}

/// Walks the tree from its tops down, as queries do, with what is read as it is asked for.
pub fn tree(bytes: &[u8]) {
    let Ok(file) = File::open(bytes, LIMITS) else { return };
    let seed = dice(bytes);
    for root in (0..file.root_count()).take(64) {
        let Ok(children) = file.children(root) else { continue };
        assert!(children.end <= file.root_count() && (children.is_empty() || children.start > root));
        for child in children.take(16) {
            assert!(file.parent(child).is_ok_and(|parent| parent == Some(root)));
        }
    }
    let nodes = antichain(&file, seed);
    let cut = Cut { nodes, ..Cut::default() };
    let _ = file.boundary_edge_count(&cut);
    if let Ok(mesh) = file.extract(&cut) {
        check_indices(&mesh);
    }
    let query = queries(&file, bytes)[seed as usize % 3].clone();
    let Ok(hierarchy) = file.hierarchy_for(&query) else { return };
    let Ok(mut adapter) = Adapter::new(hierarchy, &query, Coherence::default()) else { return };
    let finer = Query { tolerance: query.tolerance.map(|tolerance| tolerance * 0.5), ..query.clone() };
    for query in [query, finer] {
        if adapter.update(&query).is_ok() {
            check_cut(&adapter.cut(), &query);
        }
    }
}

/// Decodes and draws every level, reads all texels, then does everything that `lodpack verify` does.
pub fn page(bytes: &[u8]) {
    let Ok(file) = File::open(bytes, LIMITS) else { return };
    let channels: Vec<u8> = (0..file.channels().len() as u8).collect();
    for root in (0..file.root_count()).take(64) {
        let wanted: Vec<(u32, u8)> = (0..file.level_count() as u8).map(|level| (root, level)).collect();
        for scale in [Scale::Eighth, Scale::Full] {
            let Ok(texels) = file.texels(&wanted, &channels, scale) else { continue };
            assert_eq!(texels.len(), wanted.len());
            // A stream is a part of the file.
            let streams = texels.iter().flat_map(|t| t.images.iter().flatten().chain([&t.map]));
            assert!(streams.into_iter().all(|stream| stream.len() < bytes.len()));
        }
    }
    let _ = file.borders();
    for level in 0..file.level_count() as u8 {
        if let Ok(cut) = file.uniform_cut(level) {
            let _ = file.extract(&cut).map(|mesh| check_indices(&mesh));
        }
    }
    let _ = file.verify();
}

/// Frames of a moving camera, and of cuts chosen at random, over a source that now and then fails or ends early.
pub fn session(bytes: &[u8]) {
    let source = Failing { bytes, calls: Default::default() };
    let Ok(file) = File::open(&source, LIMITS) else { return };
    let Ok(hierarchy) = again(|| file.hierarchy()) else { return };
    let hierarchy = Arc::new(hierarchy);
    let caches = Options { byte_cache: 1 << 12, decoded_cache: 1 << 14, texel_cache: 1 << 14, ..Options::default() };
    // One of these for each file: there are many files.
    let number = dice(bytes) >> 7;
    let options = Options { max_attempts: 3, light: !number.is_multiple_of(3), ..caches };
    let Ok(mut session) = again(|| file.session(options)) else { return };
    let channels: Vec<u8> = (0..file.channels().len() as u8).collect();
    assert!(session.show_channels(&channels).is_ok());
    let mut simulation = Simulation::new(&source, Duration::from_millis(20));
    for mut query in queries(&file, bytes).into_iter().skip(number as usize % 4).take(1) {
        let Ok(mut adapter) = Adapter::new(Arc::clone(&hierarchy), &query, Coherence::default()) else { continue };
        for frame in 0..3 {
            query.view = query.view.map(|view| View { position: view.position.map(|x| x * 0.5), ..view });
            query.tolerance = query.tolerance.map(|tolerance| tolerance * f64::from(frame));
            if adapter.update(&query).is_err() {
                break;
            }
            let cut = adapter.cut();
            check_cut(&cut, &query);
            // Now and then as it looks from there, with images of other sizes.
            let view = query.view.as_ref().filter(|_| frame > 0);
            assert!(session.look_from(view).is_ok() || view.is_some());
            if simulation.frame(&mut session, &cut.nodes, &cut.nodes).is_ok() {
                check_picture(session.picture(), options.light);
            }
            simulation.advance(&session, Duration::from_millis(33));
            if let Ok(mesh) = again(|| file.extract(&cut)) {
                assert_eq!(mesh.triangles.len() as u64, cut.triangle_count);
                check_indices(&mesh);
            }
        }
    }
    if number % 4 == 3 {
        let mut nodes = antichain(&file, dice(bytes));
        for _ in 0..4 {
            if simulation.frame(&mut session, &nodes, &[]).is_ok() {
                check_picture(session.picture(), options.light);
            }
            simulation.advance(&session, Duration::from_millis(33));
        }
        // A session refuses a cut with a root above another.
        let parent = nodes.iter().find_map(|node| again(|| file.parent(node.root)).ok().flatten());
        if let Some(root) = parent {
            nodes.push(Node { root, level: 0 });
            nodes.sort_unstable_by_key(|node| node.root);
            assert!(simulation.frame(&mut session, &nodes, &[]).is_err());
        }
    }
}

/// Checks the indices of what is drawn, joined and root by root.
fn check_picture(picture: &Picture, has_light: bool) {
    check_indices(&picture.mesh());
    for drawn in picture.roots() {
        let (lit, light) = (drawn.lit(), drawn.light());
        assert_eq!((lit.is_some(), light.is_some()), (has_light, has_light));
        let (Some(Lit { positions, triangles, normals }), Some(light)) = (lit, light) else { continue };
        assert_eq!((positions.len(), triangles.len()), (normals.len(), drawn.triangle_count()));
        assert!(triangles.iter().flatten().all(|&vertex| (vertex as usize) < positions.len()));
        assert!(light.triangles.iter().flatten().all(|&vertex| (vertex as usize) < light.normals.len()));
        assert_eq!(light.normals.len(), drawn.surface.positions.len() + light.further.len());
    }
}

/// Nodes that cover everything once, if the file's tree is sound.
fn antichain(file: &File<impl ReadAt>, seed: u64) -> Vec<Node> {
    let (mut nodes, mut dice) = (Vec::new(), seed);
    let mut pending: Vec<u32> = (0..file.top_count()).collect();
    while let Some(root) = pending.pop() {
        dice = dice.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
        let children = again(|| file.children(root)).unwrap_or_default();
        if children.is_empty() || dice >> 62 == 0 {
            nodes.push(Node { root, level: (dice >> 40) as u8 % file.level_count() as u8 });
        } else {
            pending.extend(children);
        }
    }
    nodes.sort_unstable_by_key(|node| node.root);
    nodes
}

/// A number that depends on all bytes.
fn dice(bytes: &[u8]) -> u64 {
    bytes.iter().fold(17_u64, |sum, &byte| sum.wrapping_mul(31).wrapping_add(u64::from(byte)))
}

/// A region, a budget and a view, as the bytes happen to say.
fn queries(file: &File<impl ReadAt>, bytes: &[u8]) -> [Query; 3] {
    let dice = dice(bytes);
    let share = |k: u32| (dice >> (8 * k) & 0xff) as f64 / 255.0;
    let [low, high] = file.bounds().unwrap_or([[0.0; 3]; 2]);
    let at = |t: f64| [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * t);
    let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let region = [at(share(0) * 0.5), at(0.5 + share(1) * 0.5)];
    let view = View { position: at(1.0 + share(3)), forward: [-1.0; 3], near: 1e-3, ..View::default() };
    [
        Query {
            volume: Some(region.into()),
            tolerance: Some(share(2) * size),
            outside: Outside::Drop,
            ..Query::default()
        },
        Query { max_triangles: Some(dice >> 48 & 0xfff), max_nodes: Some(1 << 12), ..Query::default() },
        Query { view: Some(view), outside: Outside::Coarsest, ..Query::default() },
    ]
}

fn check_cut(cut: &Cut, query: &Query) {
    assert!(cut.nodes.windows(2).all(|pair| pair[0].root < pair[1].root));
    let keeps_budgets = query.max_triangles.is_none_or(|most| cut.triangle_count <= most)
        && query.max_nodes.is_none_or(|most| cut.nodes.len() as u64 <= most);
    assert_eq!(keeps_budgets, cut.exceeded.is_none());
}

fn check_indices(mesh: &lodpack::Mesh) {
    let count = mesh.positions.len();
    assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < count));
    assert_eq!(mesh.triangles.len(), mesh.triangle_nodes.len());
}

/// A source that fails at some of the calls is asked again.
fn again<T>(mut call: impl FnMut() -> Result<T>) -> Result<T> {
    for _ in 0..8 {
        match call() {
            Err(Error::Io { .. }) => {}
            other => return other,
        }
    }
    call()
}

/// Every third read fails, every ninth one with an early end.
struct Failing<'b> {
    bytes: &'b [u8],
    calls: std::sync::atomic::AtomicU32,
}

impl ReadAt for Failing<'_> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        match self.calls.fetch_add(1, std::sync::atomic::Ordering::Relaxed) % 9 {
            8 => Err(io::ErrorKind::UnexpectedEof.into()),
            2 | 5 => Err(io::ErrorKind::TimedOut.into()),
            _ => self.bytes.read_at(offset, buf),
        }
    }

    fn size(&self) -> io::Result<u64> {
        self.bytes.size()
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        requests.iter_mut().try_for_each(|request| self.read_at(request.offset, request.buf))
    }
}
