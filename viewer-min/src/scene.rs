//! A file that is being viewed: the boundary between the reader and the GPU.

use std::{cell::OnceCell, sync::Arc, time::Duration};

use anyhow::{Context, Result, bail};
use lodpack::{
    Cut, File, Ground, GroundFrame, Lattice, Limiter, Limits, Mesh, Node, Opened, Outside, Query, ReadAt, View,
    heights::Heights,
    index::{ChannelInfo, UpAxis},
    select::{Coherence, FrameTimes, TileTree, Tiles, Unification},
    source::{Http, HttpOptions, Within},
    stream::{Counters, HeightsStreamer, Mode, Options, Picture, Streamed, Streamer, StreamerOptions},
};

use crate::{
    args::{Args, Tile},
    camera::{Bounds, Extent, Subject},
    channel::{ShownChannel, after, channels_of_heights, drawing, find, normals},
    objects::{Selected, ShownObjects, ray_at},
};

/// The bytes of a file.
pub type Source = Arc<dyn ReadAt + Send + Sync>;

/// Opens the file or URL at an address.
pub(crate) fn open_source(address: &str) -> Result<Source> {
    if address.starts_with("http://") || address.starts_with("https://") {
        return Ok(Arc::new(Http::new(address, HttpOptions::default())));
    }
    Ok(Arc::new(std::fs::File::open(address).with_context(|| format!("{address} cannot be opened"))?))
}

/// Times and counters of a frame: a row of the table of frames. Times are in milliseconds; those of fetching and
/// decoding are summed over all threads, and `update_ms` lasts until the picture was updated, waiting included.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
#[expect(missing_docs, reason = "the columns of the table have these names and units")]
pub struct Report {
    pub frame: usize,
    pub select_ms: f64,
    pub fetch_ms: f64,
    pub decode_ms: f64,
    pub update_ms: f64,
    /// Of the processor: for handing over what is new, and for writing the commands.
    pub upload_ms: f64,
    pub record_ms: f64,
    /// Of the device, which does this beside the next frame.
    pub draw_ms: f64,
    /// How long the processor waited for the device.
    pub wait_ms: f64,
    /// Of the processor: all of the frame, waiting included.
    pub frame_ms: f64,
    pub nodes: usize,
    pub triangles: u64,
    /// Bytes that were read.
    pub bytes: u64,
    /// Bytes that were uploaded.
    pub uploaded: u64,
    /// 1 if the frame waited for pages.
    pub stalls: u8,
    /// Roots drawn coarser than wanted.
    pub late: u32,
    /// Roots drawn without images that they need.
    pub late_textures: u32,
    /// Largest screen error of the visible nodes, in pixels.
    pub error_px: f64,
    /// Size of the largest visible texel, in pixels.
    pub texel_px: f64,
    /// 1 if a whole surface is drawn: the overview or all roots.
    pub surface: u8,
    /// Whether everything is drawn as wanted.
    #[serde(skip)]
    pub is_complete: bool,
    /// The budget that even the coarsest cut of the view exceeds, if there is one. That cut is drawn.
    #[serde(skip)]
    pub exceeded: Option<Limiter>,
}

impl Report {
    /// Of two things in one picture.
    fn and(self, other: &Self) -> Self {
        Self {
            select_ms: self.select_ms + other.select_ms,
            fetch_ms: self.fetch_ms + other.fetch_ms,
            decode_ms: self.decode_ms + other.decode_ms,
            update_ms: self.update_ms + other.update_ms,
            nodes: self.nodes + other.nodes,
            triangles: self.triangles + other.triangles,
            bytes: self.bytes + other.bytes,
            stalls: self.stalls.max(other.stalls),
            late: self.late + other.late,
            late_textures: self.late_textures + other.late_textures,
            error_px: self.error_px.max(other.error_px),
            texel_px: self.texel_px.max(other.texel_px),
            surface: self.surface.min(other.surface),
            is_complete: self.is_complete && other.is_complete,
            exceeded: self.exceeded.or(other.exceeded),
            ..self
        }
    }

    /// What performance mode has to know: the slower one of processor and device decides, since they work side by side.
    pub(crate) fn times(&self) -> FrameTimes {
        FrameTimes {
            frame: self.draw_ms.max(self.frame_ms - self.wait_ms),
            adapt: self.select_ms,
            node_count: self.nodes as u64,
            triangle_count: self.triangles,
            upload_bytes: self.uploaded,
        }
    }

    /// Says that a budget is too small for the view, if it is.
    pub(crate) fn complaint(&self) -> Option<String> {
        let what = match self.exceeded? {
            Limiter::Nodes => "--max-nodes",
            Limiter::Triangles => "--max-triangles",
            _ => "a budget",
        };
        Some(format!("{what} is too small for this view: its coarsest cut takes more; raise it"))
    }
}

/// An open file, with everything needed to draw it.
pub struct Scene {
    /// The box of the model in world coordinates.
    pub bounds: Bounds,
    /// The limits of cuts. The view is set per frame.
    pub(crate) query: Query,
    /// The channel that is shown.
    pub(crate) channel: Option<ShownChannel>,
    /// Whether roots have normals for smooth light, because the file stores none.
    pub(crate) has_light: bool,
    content: Content,
    /// What a mesh stands on, drawn into the same picture.
    ground: Option<Box<GroundScene>>,
    /// What is drawn of its objects.
    pub(crate) objects: ShownObjects,
}

/// The ground of a mesh: a scene of its own, which is looked at in its own space.
pub(crate) struct GroundScene {
    pub scene: Scene,
    pub frame: GroundFrame,
    /// The box of the mesh alone.
    mesh_bounds: Bounds,
}

/// What a file holds, and what decides how it is drawn.
enum Content {
    Mesh(Box<MeshContent>),
    Heights(Box<HeightsContent>),
}

/// A file of a mesh.
pub(crate) struct MeshContent {
    pub streamer: Streamer,
    pub file: File<Source>,
    tree: OnceCell<Tree>,
}

/// What only checks and tiles of pictures ask of all roots: it takes the whole index.
pub(crate) struct Tree {
    /// The arcs of each root, each as often as the root's loops contain it.
    pub arcs: Vec<Vec<u32>>,
    /// The roots without children.
    pub leaves: Vec<u32>,
}

impl Tree {
    fn of(file: &File<Source>) -> lodpack::Result<Self> {
        let arcs_of =
            |root| Ok(file.root_contents(root)?.loops.iter().flatten().map(|half_arc| half_arc.arc).collect());
        let arcs = (0..file.root_count()).map(arcs_of).collect::<lodpack::Result<_>>()?;
        let mut leaves = vec![];
        for root in 0..file.root_count() {
            leaves.extend(file.children(root)?.is_empty().then_some(root));
        }
        Ok(Self { arcs, leaves })
    }
}

/// A file of heights.
pub(crate) struct HeightsContent {
    pub streamer: HeightsStreamer,
    pub file: Heights<Source>,
    pub channels: Vec<ChannelInfo>,
}

/// No dependence on previous frames, so pictures do not depend on their division into tiles.
pub(crate) const STILL: Coherence = Coherence { hysteresis: 0.0, play: 0.0 };
/// How a file is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Looks {
    /// Whether frames wait for what they want.
    pub mode: Mode,
    /// How large samples of heights may be on the screen, in pixels; if infinite, tiles are as fine as triangles have
    /// to be.
    pub sample_px: f64,
    /// Whether triangles are shaded flat where the file stores no normals.
    pub is_flat: bool,
}

impl Default for Looks {
    fn default() -> Self {
        Self { mode: Mode::default(), sample_px: SAMPLE_PX, is_flat: false }
    }
}

/// A sample of heights may be so large on the screen, in pixels.
const SAMPLE_PX: f64 = 3.0;
/// Frames for one picture, at most. A tree has fewer heights of lists.
const MOST_FRAMES: usize = 64;

impl MeshContent {
    fn new(file: File<Source>, session: Options) -> Result<Self> {
        let waits = session.mode == Mode::Synchronous;
        let coherence = if waits { STILL } else { Coherence::default() };
        let mut streamer = file.streamer(StreamerOptions { session, coherence, ..StreamerOptions::default() })?;
        // The first frame must have a surface. Files with an overview have one at once.
        if streamer.session().overview().is_none() {
            let coarsest = file.uniform_cut(0)?.nodes;
            streamer.show(&coarsest)?;
            streamer.settle();
            streamer.show(&coarsest)?;
        }
        Ok(Self { tree: OnceCell::new(), streamer, file })
    }

    /// All roots. The first call reads the whole index.
    pub(crate) fn tree(&self) -> lodpack::Result<&Tree> {
        match self.tree.get() {
            Some(tree) => Ok(tree),
            None => Tree::of(&self.file).map(|tree| self.tree.get_or_init(|| tree)),
        }
    }
}

fn session(mode: Mode) -> Options {
    Options { mode, may_stay_finer: mode != Mode::Synchronous, ..Options::default() }
}

impl Scene {
    /// Opens a file. Surfaces are shaded smoothly.
    pub fn open(source: Source, mode: Mode) -> Result<Self> {
        Self::open_with(source, Looks { mode, ..Looks::default() })
    }

    /// Opens a file that is drawn in another way.
    pub fn open_with(source: Source, Looks { mode, sample_px, is_flat }: Looks) -> Result<Self> {
        let bytes = Arc::clone(&source);
        match Opened::open(source, Limits::default()).context("the file cannot be opened")? {
            Opened::Mesh(file) => {
                let mesh_bounds = file.bounds().context("the file is empty: it has no roots")?;
                let mut bounds = mesh_bounds;
                let mut ground = None;
                if let Some(range) = file.index().ground_range() {
                    let part: Source = Arc::new(Within::new(bytes, range));
                    let opened = Ground::within(file.index(), part);
                    let Ground { heights, frame } = opened.context("the ground of the mesh cannot be opened")?;
                    let scene = Self::of_heights(heights, mode, sample_px)?;
                    let [low, high] = frame.bounds(scene.bounds);
                    let [least, most] = bounds;
                    bounds = [[0, 1, 2].map(|k| least[k].min(low[k])), [0, 1, 2].map(|k| most[k].max(high[k]))];
                    ground = Some(Box::new(GroundScene { scene, frame, mesh_bounds }));
                }
                // In a tree, what comes into view is drawn by a root above it until it is there. Where all that is
                // outside is drawn too, at its coarsest, that one is near; otherwise it could be the top, in place of
                // the whole picture.
                let has_tree = file.top_count() < file.root_count();
                let outside = if has_tree && mode != Mode::Synchronous { Outside::Coarsest } else { Outside::Drop };
                let has_light = !is_flat && normals(file.channels()).is_none();
                let mesh = MeshContent::new(file, Options { light: has_light, ..session(mode) })?;
                let query = Query { outside, ..Query::default() };
                let (content, objects) = (Content::Mesh(Box::new(mesh)), ShownObjects::default());
                Ok(Self { bounds, query, channel: None, has_light, content, ground, objects })
            }
            Opened::Heights(file) => Self::of_heights(file, mode, sample_px),
        }
    }

    fn of_heights(file: Heights<Source>, mode: Mode, sample_px: f64) -> Result<Self> {
        let bounds = file.index().bounds().context("the file is empty: it has no tiles")?;
        let source = Arc::new(Arc::clone(file.source()));
        let session = Options { sample_px, ..session(mode) };
        let options = StreamerOptions { session, ..StreamerOptions::default() };
        let streamer = HeightsStreamer::new(Arc::clone(file.index()), source, options)?;
        let channels = channels_of_heights(file.ramp().is_some() || file.drape().is_some());
        let content = Content::Heights(Box::new(HeightsContent { streamer, channels, file }));
        let (query, objects) = (Query::default(), ShownObjects::default());
        Ok(Self { bounds, query, channel: None, has_light: false, content, ground: None, objects })
    }

    /// The mesh of the file.
    ///
    /// # Errors
    /// If it holds heights.
    pub(crate) fn mesh(&self) -> Result<&MeshContent> {
        match &self.content {
            Content::Mesh(mesh) => Ok(mesh),
            Content::Heights(_) => bail!("this file holds a grid of heights, for which this does not work"),
        }
    }

    /// The heights of the file, if it holds any.
    pub(crate) fn heights(&self) -> Option<&HeightsContent> {
        match &self.content {
            Content::Mesh(_) => None,
            Content::Heights(heights) => Some(heights),
        }
    }

    /// What the mesh stands on.
    pub(crate) fn ground(&self) -> Option<&GroundScene> {
        self.ground.as_deref()
    }

    /// Takes the ground away, so that only the mesh is drawn.
    pub(crate) fn take_ground(&mut self) -> Option<GroundScene> {
        let ground = self.ground.take()?;
        self.bounds = ground.mesh_bounds;
        Some(*ground)
    }

    /// What a view of all of it has to know.
    pub(crate) fn extent(&self) -> Extent {
        let subject = match &self.content {
            Content::Heights(_) => Subject::Heights,
            Content::Mesh(mesh) => {
                let up = mesh.file.placement().map_or(UpAxis::Unknown, |placement| placement.up);
                Subject::Mesh { up, has_ground: self.ground.is_some() }
            }
        };
        Extent::of(self.bounds, subject)
    }

    /// What the first view has to know: of what the command line finds, or of all of it.
    pub(crate) fn first_extent(&self) -> Result<Extent> {
        let extent = self.extent();
        let (Some(selected), Ok(mesh)) = (&self.objects.selected, self.mesh()) else { return Ok(extent) };
        let objects = mesh.file.objects().context("this file has no objects")?;
        let bounds = objects.bounds(&[selected.number])?.unwrap_or(extent.bounds);
        Ok(Extent { bounds, ..extent })
    }

    /// Draws the objects of the command line, and selects the one that it finds.
    ///
    /// # Errors
    /// If the file has no such objects.
    pub fn choose_objects(&mut self, args: &Args) -> Result<()> {
        if args.hide.is_empty() && args.only.is_empty() && args.find.is_none() {
            return Ok(());
        }
        self.objects = ShownObjects::of_args(&self.mesh()?.file, args)?;
        self.show_objects()
    }

    fn show_objects(&mut self) -> Result<()> {
        let choice = &self.objects.choice;
        let is_everything = choice.is_everything();
        self.query.objects = if is_everything { None } else { Some(self.mesh()?.file.filter_objects(choice)?) };
        Ok(())
    }

    /// Carries out what a key asks of what is selected.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub(crate) fn obey_objects(&mut self, letter: &str) -> Result<()> {
        if self.objects.obey(letter) { self.show_objects() } else { Ok(()) }
    }

    /// Selects what a place of the picture shows of the mesh: 0 to 1 from the upper left corner. Nothing where it shows
    /// nothing, or in a file without objects.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub(crate) fn pick_object(&mut self, view: &View, place: [f64; 2]) -> Result<()> {
        self.objects.selected = None;
        let Ok(mesh) = self.mesh() else { return Ok(()) };
        if mesh.file.index().objects().is_none() {
            return Ok(());
        }
        let pick = mesh.file.pick_shown(ray_at(view, place), self.query.objects.as_deref())?;
        let object = pick.and_then(|pick| pick.object);
        self.objects.selected = object.map(|number| Selected::new(&mesh.file, number)).transpose()?;
        Ok(())
    }

    /// The picture to draw, unless [`Scene::overview`] returns a mesh.
    pub fn picture(&self) -> &Picture {
        match &self.content {
            Content::Mesh(mesh) => mesh.streamer.picture(),
            Content::Heights(heights) => heights.streamer.picture(),
        }
    }

    /// The small mesh to draw until the coarsest level is loaded.
    pub(crate) fn overview(&self) -> Option<&Mesh> {
        match &self.content {
            Content::Mesh(mesh) => mesh.streamer.overview(),
            Content::Heights(_) => None,
        }
    }

    /// The number of levels; of heights, of depths.
    pub(crate) fn level_count(&self) -> usize {
        match &self.content {
            Content::Mesh(mesh) => mesh.file.level_count(),
            Content::Heights(heights) => heights.file.grid().depth() as usize + 1,
        }
    }

    /// Where coordinates lie.
    pub(crate) fn lattice(&self) -> Lattice {
        self.mesh().map_or(Lattice::default(), |mesh| mesh.file.lattice())
    }

    /// The size of the smallest thing to see, world units: a lattice step, or the error of the finest tiles known.
    pub(crate) fn finest_step(&self) -> f64 {
        match &self.content {
            Content::Mesh(mesh) => mesh.file.lattice().step(),
            Content::Heights(heights) => heights.file.info().step * heights.file.surface().height_scale,
        }
    }

    /// How many roots there are; of heights, how many tiles are known to be there.
    pub(crate) fn root_count(&self) -> u64 {
        match &self.content {
            Content::Mesh(mesh) => mesh.file.root_count().into(),
            Content::Heights(heights) => heights.file.index().known_tile_count(),
        }
    }

    /// Counters of all work so far: of geometry, and of texels.
    pub(crate) fn counters(&self) -> [Counters; 2] {
        match &self.content {
            Content::Mesh(mesh) => [mesh.streamer.session().counters(), mesh.streamer.session().texel_counters()],
            Content::Heights(heights) => [heights.streamer.session().counters(), Counters::default()],
        }
    }

    /// Bytes in the caches of pages, of surfaces and of images.
    pub(crate) fn cached_bytes(&self) -> [u64; 3] {
        match &self.content {
            Content::Mesh(mesh) => {
                let session = mesh.streamer.session();
                let [pages, surfaces] = session.cached_bytes();
                [pages, surfaces, session.texel_cached_bytes()[1]]
            }
            Content::Heights(heights) => {
                let [pages, surfaces] = heights.streamer.session().cached_bytes();
                [pages, surfaces, 0]
            }
        }
    }

    /// Tries again what has been given up.
    pub fn retry_failed(&mut self) {
        match &mut self.content {
            Content::Mesh(mesh) => mesh.streamer.session_mut().retry_failed(),
            Content::Heights(heights) => heights.streamer.session_mut().retry_failed(),
        }
        self.ground.iter_mut().for_each(|ground| ground.scene.retry_failed());
    }

    fn settle(&self) {
        match &self.content {
            Content::Mesh(mesh) => mesh.streamer.settle(),
            Content::Heights(heights) => heights.streamer.settle(),
        }
        self.ground.iter().for_each(|ground| ground.scene.settle());
    }

    /// Takes the limits of cuts from the command line. A mesh and its ground have them each.
    pub(crate) fn limit(&mut self, args: &Args) {
        (self.query.max_triangles, self.query.max_nodes) = (args.max_triangles, args.max_nodes);
        self.ground.iter_mut().for_each(|ground| ground.scene.limit(args));
    }

    /// Shows the channel of the command line.
    ///
    /// # Errors
    /// If the file has no such channel.
    pub fn choose_channel(&mut self, args: &Args) -> Result<()> {
        if let Some(ground) = &mut self.ground {
            // A name is one of the mesh.
            let named = args.channel.as_deref().filter(|&name| name == "none");
            ground.scene.show_channel(find(ground.scene.channels(), named)?)?;
        }
        self.show_channel(find(self.channels(), args.channel.as_deref())?)?;
        if let (Some(channel), Some(range)) = (&mut self.channel, args.range) {
            channel.set_values(range);
        }
        Ok(())
    }

    /// Shows the next channel, or none after the last.
    pub(crate) fn next_channel(&mut self) -> Result<()> {
        self.show_channel(after(self.channels(), self.channel.as_ref().map(|channel| channel.number)))
    }

    fn channels(&self) -> &[ChannelInfo] {
        match &self.content {
            Content::Mesh(mesh) => mesh.file.channels(),
            Content::Heights(heights) => &heights.channels,
        }
    }

    fn show_channel(&mut self, number: Option<u8>) -> Result<()> {
        let mesh = match &mut self.content {
            Content::Mesh(mesh) => mesh,
            Content::Heights(heights) => {
                let shown = number.map(|number| ShownChannel::of_heights(&heights.channels, number));
                self.channel = shown.transpose()?;
                return Ok(());
            }
        };
        self.channel = number.map(|number| ShownChannel::new(&mesh.file, number)).transpose()?;
        // Normals light whatever is shown.
        let normals = normals(mesh.file.channels()).filter(|_| number.is_some());
        let drawing = number.and_then(|number| drawing(mesh.file.channels(), number));
        let beside = normals.filter(|&normals| number != Some(normals)).into_iter().chain(drawing);
        let numbers: Vec<u8> = number.into_iter().chain(beside).collect();
        Ok(mesh.streamer.session_mut().show_channels(&numbers)?)
    }

    /// Draws what the view shows, as far as it is loaded; an error if a budget cannot be kept.
    pub fn follow(&mut self, view: &View) -> Result<Report> {
        let query = Query { view: Some(*view), ..self.query.clone() };
        let (streamed, [error_px, texel_px]) = match &mut self.content {
            Content::Mesh(mesh) => {
                let streamed = mesh.streamer.frame(&query)?;
                let texel_px = if self.channel.is_some() { mesh.streamer.texel_px(view)? } else { 0.0 };
                (streamed, [mesh.streamer.error_px(view)?, texel_px])
            }
            Content::Heights(heights) => {
                let streamed = heights.streamer.frame(&query)?;
                (streamed, [heights.streamer.session_mut().error_px(view)?, 0.0])
            }
        };
        let [error_px, texel_px] = [error_px, texel_px].map(rounded);
        let report = Report { error_px, texel_px, ..self.report(&streamed) };
        match &mut self.ground {
            None => Ok(report),
            Some(ground) => Ok(report.and(&ground.scene.follow(&ground.frame.view_of_ground(view))?)),
        }
    }

    /// Draws what the view shows, after everything for it is loaded: of a large file, more of the tree is known after
    /// each frame.
    pub fn follow_to_the_end(&mut self, view: &View) -> Result<Report> {
        let mut report = self.follow(view)?;
        for _ in 0..MOST_FRAMES {
            self.settle();
            let next = self.follow(view)?;
            let of = |report: &Report| (report.nodes, report.triangles, report.error_px.to_bits());
            // What could not be loaded does not come either.
            if of(&next) == of(&report) {
                break;
            }
            report = next;
        }
        Ok(report)
    }

    /// Draws these nodes, sorted by root, as far as they are loaded.
    pub fn show(&mut self, nodes: &[Node]) -> Result<Report> {
        let Content::Mesh(mesh) = &mut self.content else { bail!("tiles of heights are not nodes") };
        let streamed = mesh.streamer.show(nodes)?;
        Ok(self.report(&streamed))
    }

    /// Draws these nodes for a tile of the picture that a view shows, as far as they are loaded, or waits for them. The
    /// ground is that of the whole picture, so that it is the same in all tiles.
    pub fn show_tile(&mut self, nodes: &[Node], whole: &View, waits: bool) -> Result<Report> {
        let report = self.show(nodes)?;
        let Some(ground) = &mut self.ground else { return Ok(report) };
        let view = ground.frame.view_of_ground(whole);
        let of_ground = if waits { ground.scene.follow_to_the_end(&view)? } else { ground.scene.follow(&view)? };
        Ok(report.and(&of_ground))
    }

    /// Reads what the index says of a root that somebody else chose, and of those above it.
    ///
    /// # Errors
    /// If there is no such root, or it cannot be read.
    pub(crate) fn know(&self, root: u32) -> Result<()> {
        let file = &self.mesh()?.file;
        let mut next = Some(root);
        while let Some(root) = next {
            next = file.parent(root)?;
        }
        Ok(())
    }

    /// Draws what a query wants of heights, as far as it is loaded.
    pub(crate) fn ask(&mut self, query: &Query) -> Result<Report> {
        let Content::Heights(heights) = &mut self.content else { bail!("this is a mesh") };
        let streamed = heights.streamer.frame(query)?;
        Ok(self.report(&streamed))
    }

    fn report(&self, streamed: &Streamed) -> Report {
        let [fetch_ms, decode_ms] = streamed.work_times.map(milliseconds);
        Report {
            select_ms: milliseconds(streamed.select_time),
            fetch_ms,
            decode_ms,
            update_ms: milliseconds(streamed.update_time),
            nodes: self.picture().roots().len(),
            triangles: self
                .overview()
                .map_or_else(|| self.picture().triangle_count(), |mesh| mesh.triangles.len() as u64),
            bytes: streamed.bytes_read,
            stalls: streamed.has_stalled.into(),
            late: streamed.frame.late_roots,
            late_textures: streamed.frame.late_textures,
            surface: streamed.is_whole().into(),
            is_complete: streamed.is_complete(),
            exceeded: streamed.exceeded,
            ..Report::default()
        }
    }

    /// The failures to load since the last call.
    pub fn take_problems(&self) -> Vec<String> {
        let problems = match &self.content {
            Content::Mesh(mesh) => mesh.streamer.session().take_problems(),
            Content::Heights(heights) => heights.streamer.session().take_problems(),
        };
        let own = problems.iter().map(|problem| format!("{}: {}", problem.location, problem.error));
        let of_ground = self.ground.iter().flat_map(|ground| ground.scene.take_problems());
        own.chain(of_ground.map(|problem| format!("ground: {problem}"))).collect()
    }

    /// The cut for a view from scratch, independent of previous frames.
    pub(crate) fn select(&self, view: &View) -> Result<Cut> {
        Ok(lodpack::select::select_in(
            self.mesh()?.streamer.follower().hierarchy(),
            &Query { view: Some(*view), ..self.query.clone() },
        )?)
    }

    /// The view and the nodes of one tile of a picture: tile `at` of `counts`, from the upper left corner. Every
    /// process finds and unifies the cuts of all tiles for itself.
    pub(crate) fn tile(&self, view: &View, [at, counts]: Tile) -> Result<(View, Vec<Node>)> {
        let mesh = self.mesh().context("pictures cannot be drawn in tiles")?;
        let ([columns, rows], [width, height]) = (counts, view.viewport);
        if !columns.is_power_of_two() || !(columns == rows || columns == 2 * rows) {
            bail!("tiles come in powers of two, as many rows as columns or half as many: 1x1, 2x1, 2x2, 4x2 and so on");
        }
        if at[0] >= columns || at[1] >= rows || !width.is_multiple_of(columns) || !height.is_multiple_of(rows) {
            bail!("there is no tile {},{} of {columns}x{rows} in {width}x{height} pixels", at[0], at[1]);
        }
        let tiles = TileTree::new((columns * rows).trailing_zeros())?;
        let queries = tiles.queries(&Query { view: Some(*view), ..self.query.clone() })?;
        let hierarchy = mesh.streamer.follower().hierarchy();
        let mut tiles = Tiles::new(hierarchy, &queries, STILL, Unification::Quality)?;
        let unified = tiles.update(&queries)?.unified;
        let corner = [f64::from(at[0]) / f64::from(columns), 1.0 - f64::from(at[1] + 1) / f64::from(rows)];
        let mut tiles = queries.iter().filter_map(|query| query.view).zip(tiles.with_neighbours(&unified));
        tiles.find(|(view, _)| view.window[0] == corner).context("the tile is missing in its tree")
    }
}

/// In milliseconds, as in tables.
pub(crate) fn milliseconds(time: Duration) -> f64 {
    rounded(time.as_secs_f64() * 1e3)
}

/// Rounded to three digits.
fn rounded(number: f64) -> f64 {
    (number * 1e3).round() / 1e3
}
