//! A file as it is looked at: adapts the cut to the camera, loads, and says what is to be drawn.
//!
//! This is the boundary between the reader and the GPU: [`Scene::surfaces`] is all that drawing needs to know.

use std::{
    collections::HashSet,
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use glam::DVec3;
use lodpack::{
    Adapter, Coherence, Cut, File, Hierarchy, Http, HttpOptions, Limits, Mesh, Node, Outside, Query, ReadAt,
    RootContents, TileTree, Unification,
    session::{DrawnRoot, Loaders, Mode, Motion, Options, Picture, Pose, Session, Shows},
    unify_cuts,
};

use crate::{
    args::{Args, Overlay},
    camera::{Camera, Frame},
    draw::Look,
};

/// Where the bytes are.
pub type Source = Arc<dyn ReadAt + Send + Sync>;

/// Opens a file or a URL.
pub(crate) fn open_source(place: &str) -> Result<Source> {
    if place.starts_with("http://") || place.starts_with("https://") {
        return Ok(Arc::new(Http::new(place, HttpOptions::default())));
    }
    Ok(Arc::new(std::fs::File::open(place).with_context(|| format!("{place} cannot be opened"))?))
}

/// What a frame took and shows: a row of the table of frames. Times in milliseconds, those of fetching and decoding over
/// all threads; `update_ms` is until the picture was updated, waiting included.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
#[expect(missing_docs, reason = "names and units are those of the table's columns")]
pub struct Report {
    pub frame: usize,
    pub select_ms: f64,
    pub fetch_ms: f64,
    pub decode_ms: f64,
    pub update_ms: f64,
    pub upload_ms: f64,
    pub draw_ms: f64,
    pub nodes: usize,
    pub triangles: u64,
    pub bytes: u64,
    /// 1 where the frame waited for pages.
    pub stalls: u64,
    /// Roots drawn coarser than wanted.
    pub late: u32,
    /// Largest screen error of what is drawn, pixels.
    pub error_px: f64,
    /// 1 where a whole surface is drawn: the overview or all roots.
    pub surface: u8,
    /// Whether everything is as wanted.
    #[serde(skip)]
    pub is_complete: bool,
}

/// An open file with everything that drawing it needs.
pub struct Scene {
    /// World box.
    pub bounds: [[f64; 3]; 2],
    /// Screen error to be reached, pixels.
    pub tolerance_px: f64,
    /// What else limits cuts; the view is that of the camera.
    pub(crate) query: Query,
    pub(crate) file: File<Source>,
    /// What the index says about each root.
    pub(crate) roots: Vec<RootContents>,
    hierarchy: Arc<Hierarchy>,
    adapter: Option<Adapter>,
    ahead: Option<Adapter>,
    motion: Motion,
    pub(crate) session: Session,
    loaders: Loaders,
    mode: Mode,
    shows: Shows,
}

/// Threads that load. Reading waits, so that more than processors are of use.
const LOADERS: usize = 4;
/// Without frames before: pictures do not depend on how they are cut into tiles.
const STILL: Coherence = Coherence { hysteresis: 0.0, play: 0.0 };
/// How far ahead the camera's motion is followed.
const AHEAD: Duration = Duration::from_millis(300);

impl Scene {
    /// Opens a file.
    ///
    /// # Errors
    /// Where it cannot be read, or is damaged.
    pub fn open(source: Source, mode: Mode) -> Result<Self> {
        let file = File::open(source.clone(), Limits::default()).context("the file cannot be opened")?;
        let options = Options { mode, may_stay_finer: mode != Mode::Synchronous, ..Options::default() };
        let session = Session::open(&file, options)?;
        let mut scene = Self {
            bounds: file.bounds().context("the file is empty: it has no roots")?,
            tolerance_px: 1.0,
            query: Query { outside: Outside::Drop, ..Query::default() },
            roots: (0..file.root_count()).map(|root| file.root_contents(root)).collect::<lodpack::Result<_>>()?,
            hierarchy: Arc::new(file.hierarchy()?),
            adapter: None,
            ahead: None,
            motion: Motion::new(),
            loaders: Loaders::spawn(&session, Arc::new(source), LOADERS),
            session,
            file,
            mode,
            shows: Shows::Nothing,
        };
        // The first frame has a surface. Files with an overview have one at once.
        if scene.session.overview().is_none() {
            let coarsest = scene.file.uniform_cut(0)?.nodes;
            scene.show(&coarsest, &[])?;
            scene.loaders.settle();
            scene.show(&coarsest, &[])?;
        }
        Ok(scene)
    }

    /// Limits cuts as is typed.
    pub(crate) fn limit(&mut self, args: &Args) {
        self.tolerance_px = args.tolerance;
        (self.query.max_triangles, self.query.max_nodes) = (args.max_triangles, args.max_nodes);
    }

    /// How it is drawn from somewhere.
    pub(crate) fn look<'o>(&self, camera: Camera, frame: Frame, overlays: &'o [Overlay]) -> Look<'o> {
        Look { camera, frame, overlays, tolerance_px: self.tolerance_px, level_count: self.file.level_count() }
    }

    fn query(&self, camera: &Camera, frame: Frame) -> Query {
        Query { view: Some(camera.view(frame, self.tolerance_px)), ..self.query }
    }

    /// Draws what a camera should see, as far as it is there.
    ///
    /// # Errors
    /// Where a budget cannot be kept.
    pub fn follow(&mut self, camera: &Camera, frame: Frame) -> Result<Report> {
        let begun = Instant::now();
        let query = self.query(camera, frame);
        let coherence = if self.mode == Mode::Synchronous { STILL } else { Coherence::default() };
        let cut = adapted(&mut self.adapter, &self.hierarchy, &query, coherence)?;
        let pose =
            Pose { position: camera.position.into(), forward: camera.forward.into(), up: camera.axes()[1].into() };
        self.motion.observe(self.loaders.now(), pose);
        let expected = match self.motion.predict(AHEAD) {
            Some(pose) if self.mode == Mode::AsynchronousWithPrefetch => {
                let there = Camera { position: pose.position.into(), forward: pose.forward.into(), ..*camera };
                let query = self.query(&there, frame);
                adapted(&mut self.ahead, &self.hierarchy, &query, coherence)?.nodes
            }
            _ => Vec::new(),
        };
        let select_ms = milliseconds(begun);
        let report = self.show(&cut.nodes, &expected)?;
        Ok(Report { select_ms, error_px: self.screen_error(camera, frame), ..report })
    }

    /// Draws these nodes, sorted by root, as far as they are there.
    ///
    /// # Errors
    /// Where a node does not exist.
    pub fn show(&mut self, nodes: &[Node], expected: &[Node]) -> Result<Report> {
        let (begun, before, times) = (Instant::now(), self.session.counters(), self.loaders.work_times());
        let shown = self.loaders.frame(&mut self.session, nodes, expected)?;
        let (after, now) = (self.session.counters(), self.loaders.work_times());
        let [fetch_ms, decode_ms] = [0, 1].map(|k| rounded((now[k] - times[k]).as_secs_f64() * 1e3));
        self.shows = shown.shows;
        let overview = self.overview().map(|mesh| mesh.triangles.len() as u64);
        Ok(Report {
            fetch_ms,
            decode_ms,
            update_ms: milliseconds(begun),
            nodes: self.surfaces().roots().len(),
            triangles: overview.unwrap_or_else(|| self.surfaces().triangle_count()),
            bytes: after.bytes_read - before.bytes_read,
            stalls: after.stalls - before.stalls,
            late: shown.late_roots,
            surface: u8::from(self.shows != Shows::Nothing && shown.lost_roots.is_empty()),
            is_complete: shown.is_complete && shown.lost_roots.is_empty(),
            ..Report::default()
        })
    }

    /// What is drawn: the roots, unless [`Scene::overview`] says otherwise.
    pub fn surfaces(&self) -> &Picture {
        self.session.picture()
    }

    /// The small mesh that is drawn while there are no roots.
    pub fn overview(&self) -> Option<&Mesh> {
        self.session.overview().filter(|_| self.shows == Shows::Overview)
    }

    /// What could not be loaded since the last call.
    pub fn take_problems(&self) -> Vec<String> {
        self.session.take_problems().iter().map(|problem| format!("{}: {}", problem.place, problem.error)).collect()
    }

    /// Tries again what could not be loaded.
    pub fn retry(&mut self) {
        self.session.retry_failed();
    }

    /// Largest screen error of the roots that are drawn, pixels: of each at its least depth.
    fn screen_error(&self, camera: &Camera, frame: Frame) -> f64 {
        let pixels = camera.pixels_per_tangent(frame.whole[1]);
        let lattice = self.file.lattice();
        let of_root = |drawn: &DrawnRoot| {
            let Some(root) = self.roots.get(drawn.surface.root as usize) else { return 0.0 };
            let [low, high] = root.bounds.map(|point| DVec3::from(lattice.world(point)) - camera.position);
            let least = DVec3::select(camera.forward.cmpge(DVec3::ZERO), low, high);
            drawn.error() * pixels / camera.forward.dot(least).max(camera.near)
        };
        rounded(self.surfaces().roots().map(of_root).fold(0.0, f64::max))
    }

    /// The cut for a camera from scratch: not what frames before have left.
    pub(crate) fn select(&self, camera: &Camera, frame: Frame) -> Result<Cut> {
        Ok(lodpack::select(&self.hierarchy, &self.query(camera, frame))?)
    }

    /// What a tile of a picture draws, and where it lies: tile `at` of `counts`, from the upper left corner. The cuts of
    /// all tiles are found and unified by every process for itself; the roots beside those in sight come along, so that
    /// what is in sight is stitched as in all other tiles.
    pub(crate) fn tile(
        &self,
        camera: &Camera,
        size: [u32; 2],
        [at, counts]: [[u32; 2]; 2],
    ) -> Result<(Frame, Vec<Node>)> {
        let [columns, rows] = counts;
        if !columns.is_power_of_two() || !(columns == rows || columns == 2 * rows) {
            bail!("tiles come in powers of two, as many rows as columns or half as many: 1x1, 2x1, 2x2, 4x2 and so on");
        }
        if at[0] >= columns || at[1] >= rows || !size[0].is_multiple_of(columns) || !size[1].is_multiple_of(rows) {
            bail!("there is no tile {},{} of {columns}x{rows} in {}x{} pixels", at[0], at[1], size[0], size[1]);
        }
        let tree = TileTree::new((columns * rows).trailing_zeros())?;
        let queries = tree.queries(&self.query(camera, Frame::whole(size)))?;
        let adapters = queries.iter().map(|query| Adapter::new(self.hierarchy.clone(), query, STILL));
        let unified = unify_cuts(&adapters.collect::<lodpack::Result<Vec<_>>>()?, Unification::Quality)?;
        let corner = [f64::from(at[0]) / f64::from(columns), 1.0 - f64::from(at[1] + 1) / f64::from(rows)];
        let number = tree.tiles().iter().position(|tile| tile[0] == corner);
        let own = &unified.tiles[number.context("the tile is missing in its tree")?];
        let arcs_of = |node: &Node| self.roots[node.root as usize].loops.iter().flatten().map(|half_arc| half_arc.arc);
        let arcs: HashSet<u32> = own.iter().flat_map(arcs_of).collect();
        let is_near = |node: &Node| arcs_of(node).any(|arc| arcs.contains(&arc)) || own.contains(node);
        let part = [size[0] / columns, size[1] / rows];
        let frame = Frame { whole: size, origin: [at[0] * part[0], at[1] * part[1]], size: part };
        Ok((frame, unified.nodes.into_iter().filter(is_near).collect()))
    }
}

fn adapted(
    adapter: &mut Option<Adapter>,
    hierarchy: &Arc<Hierarchy>,
    query: &Query,
    coherence: Coherence,
) -> Result<Cut> {
    if let Some(adapter) = adapter {
        adapter.update(query)?;
        return Ok(adapter.cut());
    }
    Ok(adapter.insert(Adapter::new(hierarchy.clone(), query, coherence)?).cut())
}

/// Time since a moment.
pub(crate) fn milliseconds(since: Instant) -> f64 {
    rounded(since.elapsed().as_secs_f64() * 1e3)
}

/// To three digits, as tables have it.
fn rounded(number: f64) -> f64 {
    (number * 1e3).round() / 1e3
}
