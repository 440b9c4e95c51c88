//! A file as it is looked at: adapts the cut to the camera, loads, and says what is to be drawn.
//!
//! This is the boundary between the reader and the GPU: [`Scene::surfaces`] is all that drawing needs to know.

use std::{sync::Arc, time::Instant};

use anyhow::{Context, Result, bail};
use glam::DVec3;
use lodpack::{
    Adapter, Coherence, Cut, File, Hierarchy, Limits, Mesh, Node, Outside, Query, RootContents, TileTree, Unification,
    session::{
        Counters, DrawnRoot, Frame as Shown, Loaders, Mode, Motion, Options, Picture, Pose, Session, Shows, Surface,
    },
    unify_cuts,
};

use crate::{
    camera::{Camera, Frame},
    source::Source,
};

/// What limits the cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Screen error to be reached, pixels.
    pub tolerance_px: f64,
    /// Most triangles.
    pub max_triangles: Option<u64>,
    /// Most nodes.
    pub max_nodes: Option<u64>,
    /// What is out of sight is drawn too, at its coarsest.
    pub keeps_all: bool,
}

impl Default for Budget {
    fn default() -> Self {
        Self { tolerance_px: 1.0, max_triangles: None, max_nodes: None, keeps_all: false }
    }
}

/// What a frame took and shows. Times in milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Adapting the cut.
    pub select: f64,
    /// Reading, all threads together.
    pub fetch: f64,
    /// Decoding, all threads together.
    pub decode: f64,
    /// Until the picture was updated, waiting included.
    pub update: f64,
    /// Sending blocks to the GPU.
    pub upload: f64,
    /// Drawing.
    pub draw: f64,
    /// Roots drawn.
    pub nodes: usize,
    /// Triangles drawn.
    pub triangles: u64,
    /// Bytes read for it.
    pub bytes: u64,
    /// 1 where the frame waited for pages.
    pub stalls: u64,
    /// Roots drawn coarser than wanted.
    pub late: u32,
    /// Largest screen error of what is drawn, pixels.
    pub error_px: f64,
    /// Whether a surface is drawn at all: the overview or roots.
    pub shows_surface: bool,
    /// Whether everything is as wanted.
    pub is_complete: bool,
}

/// An open file with everything that drawing it needs.
pub struct Scene {
    /// The file.
    pub file: File<Source>,
    /// What the index says about each root.
    pub roots: Vec<RootContents>,
    /// World box.
    pub bounds: [[f64; 3]; 2],
    /// What limits cuts.
    pub budget: Budget,
    hierarchy: Arc<Hierarchy>,
    adapter: Option<Adapter>,
    ahead: Option<Adapter>,
    motion: Motion,
    session: Session,
    loaders: Loaders,
    mode: Mode,
    shows: Shows,
}

/// Threads that load. Reading waits, so that more than processors are of use.
const LOADERS: usize = 4;
/// How far ahead the camera's motion is followed.
const AHEAD: std::time::Duration = std::time::Duration::from_millis(300);

impl Scene {
    /// Opens a file.
    ///
    /// # Errors
    /// Where it cannot be read, or is damaged.
    pub fn open(source: Source, mode: Mode) -> Result<Self> {
        let file = File::open(source.clone(), Limits::default()).context("the file cannot be opened")?;
        let hierarchy = Arc::new(file.hierarchy()?);
        let options = Options { mode, may_stay_finer: mode != Mode::Synchronous, ..Options::default() };
        let session = Session::open(&file, options)?;
        let loaders = Loaders::spawn(&session, Arc::new(source), LOADERS);
        let roots = (0..file.root_count()).map(|root| file.root_contents(root)).collect::<lodpack::Result<_>>()?;
        let bounds = file.bounds().context("the file is empty: it has no roots")?;
        let (motion, budget) = (Motion::new(), Budget::default());
        let (adapter, ahead, shows) = (None, None, Shows::Nothing);
        let mut scene =
            Self { file, roots, bounds, budget, hierarchy, adapter, ahead, motion, session, loaders, mode, shows };
        scene.load_coarsest()?;
        Ok(scene)
    }

    /// So that the first frame has a surface. Files with an overview have one at once.
    fn load_coarsest(&mut self) -> Result<()> {
        if self.session.overview().is_none() {
            let coarsest = self.file.uniform_cut(0)?.nodes;
            self.show(&coarsest, &[])?;
            self.loaders.settle();
            self.show(&coarsest, &[])?;
        }
        Ok(())
    }

    fn query(&self, camera: &Camera, frame: Frame) -> Query {
        Query {
            view: Some(camera.view(frame, self.budget.tolerance_px)),
            outside: if self.budget.keeps_all { Outside::Coarsest } else { Outside::Drop },
            max_triangles: self.budget.max_triangles,
            max_nodes: self.budget.max_nodes,
            ..Query::default()
        }
    }

    /// Draws what a camera should see, as far as it is there.
    ///
    /// # Errors
    /// Where a budget cannot be kept.
    pub fn follow(&mut self, camera: &Camera, frame: Frame) -> Result<Report> {
        let begun = Instant::now();
        let query = self.query(camera, frame);
        let cut = adapted(&mut self.adapter, &self.hierarchy, &query)?;
        let pose = |c: &Camera| Pose { position: c.position.into(), forward: c.forward.into(), up: c.axes()[1].into() };
        self.motion.observe(self.loaders.now(), pose(camera));
        let expected = match self.motion.predict(AHEAD) {
            Some(pose) if self.mode == Mode::AsynchronousWithPrefetch => {
                let there = Camera { position: pose.position.into(), forward: pose.forward.into(), ..*camera };
                let query = self.query(&there, frame);
                adapted(&mut self.ahead, &self.hierarchy, &query)?.nodes
            }
            _ => Vec::new(),
        };
        let select = milliseconds(begun);
        let report = self.show(&cut.nodes, &expected)?;
        let error_px = self.screen_error(camera, frame);
        Ok(Report { select, error_px, ..report })
    }

    /// Draws these nodes, sorted by root, as far as they are there.
    ///
    /// # Errors
    /// Where a node does not exist.
    pub fn show(&mut self, nodes: &[Node], expected: &[Node]) -> Result<Report> {
        let (begun, before, times) = (Instant::now(), self.session.counters(), self.loaders.work_times());
        let shown: Shown = self.loaders.frame(&mut self.session, nodes, expected)?;
        let (after, now) = (self.session.counters(), self.loaders.work_times());
        let work = [0, 1].map(|k| (now[k] - times[k]).as_secs_f64() * 1e3);
        self.shows = shown.shows;
        Ok(Report {
            fetch: work[0],
            decode: work[1],
            update: milliseconds(begun),
            nodes: self.session.picture().roots().len(),
            triangles: self
                .overview()
                .map_or(self.session.picture().triangle_count(), |mesh| mesh.triangles.len() as u64),
            bytes: after.bytes_read - before.bytes_read,
            stalls: after.stalls - before.stalls,
            late: shown.late_roots,
            shows_surface: self.shows != Shows::Nothing && shown.lost_roots.is_empty(),
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

    /// Number of levels.
    pub fn level_count(&self) -> usize {
        self.file.level_count()
    }

    /// What loading has done so far; bytes of pages and of surfaces kept.
    pub fn counters(&self) -> (Counters, [u64; 2]) {
        (self.session.counters(), self.session.cached_bytes())
    }

    /// What could not be loaded since the last call.
    pub fn take_problems(&self) -> Vec<String> {
        self.session.take_problems().iter().map(|problem| format!("{}: {}", problem.place, problem.error)).collect()
    }

    /// Tries again what could not be loaded.
    pub fn retry(&mut self) {
        self.session.retry_failed();
    }

    /// The certified error of a root as it is drawn, world units.
    pub fn error_of(&self, drawn: &DrawnRoot) -> f64 {
        let surface: &Surface = &drawn.surface;
        let blocks = self.roots.get(surface.root as usize).map_or(&[][..], |root| &root.blocks);
        let block = blocks.iter().find(|block| block.level == surface.level);
        let is_beside_finer = drawn.strips.iter().any(|strip| !strip.positions.is_empty());
        block.map_or(f64::INFINITY, |block| block.error + if is_beside_finer { block.border_deviation } else { 0.0 })
    }

    /// Largest screen error of the roots that are drawn, pixels: of each at its least depth.
    fn screen_error(&self, camera: &Camera, frame: Frame) -> f64 {
        let pixels = camera.pixels_per_tangent(frame.whole[1]);
        let lattice = self.file.lattice();
        let of_root = |drawn: &DrawnRoot| {
            let Some(root) = self.roots.get(drawn.surface.root as usize) else { return 0.0 };
            let [low, high] = root.bounds.map(|point| DVec3::from(lattice.world(point)) - camera.position);
            let least = DVec3::select(camera.forward.cmpge(DVec3::ZERO), low, high);
            self.error_of(drawn) * pixels / camera.forward.dot(least).max(camera.near)
        };
        self.surfaces().roots().map(of_root).fold(0.0, f64::max)
    }

    /// The cut for a camera from scratch: not what frames before have left.
    ///
    /// # Errors
    /// Where a budget cannot be kept.
    pub fn select(&self, camera: &Camera, frame: Frame) -> Result<Cut> {
        Ok(lodpack::select(&self.hierarchy, &self.query(camera, frame))?)
    }

    /// What a tile of a picture draws, and where it lies: tile `at` of `counts`, from the upper left corner. The cuts of
    /// all tiles are found and unified by every process for itself; the roots beside those in sight come along, so that
    /// what is in sight is stitched as in all other tiles.
    ///
    /// # Errors
    /// Where the picture cannot be cut so.
    pub fn tile(&self, camera: &Camera, size: [u32; 2], at: [u32; 2], counts: [u32; 2]) -> Result<(Frame, Vec<Node>)> {
        let [columns, rows] = counts;
        if !columns.is_power_of_two() || !(columns == rows || columns == 2 * rows) {
            bail!("tiles come in powers of two, as many rows as columns or half as many: 1x1, 2x1, 2x2, 4x2 and so on");
        }
        if at[0] >= columns || at[1] >= rows || !size[0].is_multiple_of(columns) || !size[1].is_multiple_of(rows) {
            bail!("there is no tile {},{} of {columns}x{rows} in {}x{} pixels", at[0], at[1], size[0], size[1]);
        }
        let tree = TileTree::new((columns * rows).trailing_zeros())?;
        let adapter =
            |query: &Query| Adapter::new(self.hierarchy.clone(), query, Coherence { hysteresis: 0.0, play: 0.0 });
        let queries = tree.queries(&self.query(camera, Frame::whole(size)))?;
        let tiles = queries.iter().map(adapter).collect::<lodpack::Result<Vec<Adapter>>>()?;
        let unified = unify_cuts(&tiles, Unification::Quality)?;
        let corner = [f64::from(at[0]) / f64::from(columns), 1.0 - f64::from(at[1] + 1) / f64::from(rows)];
        let number =
            tree.tiles().iter().position(|tile| tile[0] == corner).context("the tile is missing in its tree")?;
        let own: Vec<u32> = unified.tiles[number].iter().map(|node| node.root).collect();
        let arcs_of = |root: u32| self.roots[root as usize].loops.iter().flatten().map(|half_arc| half_arc.arc);
        let arcs: std::collections::HashSet<u32> = own.iter().flat_map(|&root| arcs_of(root)).collect();
        let is_near = |node: &Node| arcs_of(node.root).any(|arc| arcs.contains(&arc));
        let part = [size[0] / columns, size[1] / rows];
        let frame = Frame { whole: size, origin: [at[0] * part[0], at[1] * part[1]], size: part };
        Ok((frame, unified.nodes.into_iter().filter(is_near).collect()))
    }
}

fn adapted(adapter: &mut Option<Adapter>, hierarchy: &Arc<Hierarchy>, query: &Query) -> Result<Cut> {
    match adapter {
        Some(adapter) => {
            adapter.update(query)?;
            Ok(adapter.cut())
        }
        None => Ok(adapter.insert(Adapter::new(hierarchy.clone(), query, Coherence::default())?).cut()),
    }
}

/// Time since a moment.
pub fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
