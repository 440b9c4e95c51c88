//! One file in the picture, a mesh or heights: the boundary between the reader and the GPU.

use std::{cell::OnceCell, sync::Arc};

use anyhow::{Context, Result, bail};
use lodpack::{
    Cut, File, Lattice, Mesh, Node, Outside, Query, ReadAt, View,
    heights::{Heights, HeightsCut},
    index::{ChannelInfo, Ray},
    select::{Coherence, Hierarchy, TileTree, Tiles, Unification},
    stream::{Counters, Mode, Options, Picture, Streamed, Streamer, StreamerOptions},
};

use crate::{
    args::{Args, Tile},
    camera::Bounds,
    channel::{ShownChannel, after, channels_of_heights, drawing, find, normals},
    objects::{Selected, ShownObjects},
    report::{Report, milliseconds, rounded},
};

/// The bytes of a file.
pub type Source = Arc<dyn ReadAt + Send + Sync>;

/// An open file, with everything needed to draw it.
pub struct Surface {
    /// The box of it in its own coordinates.
    pub(crate) bounds: Bounds,
    /// The limits of cuts. The view is set per frame.
    pub(crate) query: Query,
    /// The channel that is shown.
    pub(crate) channel: Option<ShownChannel>,
    /// Whether roots have normals for smooth light, because the file stores none.
    pub(crate) has_light: bool,
    /// What is drawn of its objects.
    pub(crate) objects: ShownObjects,
    content: Content,
    streamer: Streamer,
}

/// What a file holds, and what decides how it is drawn.
enum Content {
    Mesh(Box<MeshContent>),
    Heights(Box<HeightsContent>),
}

/// A file of a mesh.
pub(crate) struct MeshContent {
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

impl MeshContent {
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

impl Surface {
    /// A mesh.
    pub(crate) fn of_mesh(file: File<Source>, looks: Looks) -> Result<Self> {
        let Looks { mode, is_flat, .. } = looks;
        let bounds = file.bounds().context("the file is empty: it has no roots")?;
        // In a tree, what comes into view is drawn by a root above it until it is there. Where all that is outside is
        // drawn too, at its coarsest, that one is near; otherwise it could be the top, in place of the whole picture.
        let (waits, has_tree) = (mode == Mode::Synchronous, file.top_count() < file.root_count());
        let outside = if has_tree && !waits { Outside::Coarsest } else { Outside::Drop };
        let has_light = !is_flat && normals(file.channels()).is_none();
        let coherence = if waits { STILL } else { Coherence::default() };
        let session = Options { light: has_light, ..session(mode) };
        let mut streamer = file.streamer(StreamerOptions { session, coherence, ..StreamerOptions::default() })?;
        // The first frame must have a surface. Files with an overview have one at once.
        if streamer.session().is_none_or(|session| session.overview().is_none()) {
            let coarsest = file.uniform_cut(0)?.nodes;
            streamer.show(&coarsest)?;
            streamer.settle();
            streamer.show(&coarsest)?;
        }
        let query = Query { outside, ..Query::default() };
        let content = Content::Mesh(Box::new(MeshContent { tree: OnceCell::new(), file }));
        Ok(Self { bounds, query, channel: None, has_light, objects: ShownObjects::default(), content, streamer })
    }

    /// Heights.
    pub(crate) fn of_heights(file: Heights<Source>, Looks { mode, sample_px, .. }: Looks) -> Result<Self> {
        let bounds = file.index().bounds().context("the file is empty: it has no tiles")?;
        let session = Options { sample_px, ..session(mode) };
        let streamer = file.streamer(StreamerOptions { session, ..StreamerOptions::default() })?;
        let channels = channels_of_heights(file.ramp().is_some() || file.drape().is_some());
        let content = Content::Heights(Box::new(HeightsContent { channels, file }));
        let (query, objects) = (Query::default(), ShownObjects::default());
        Ok(Self { bounds, query, channel: None, has_light: false, objects, content, streamer })
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

    /// Whether it holds heights on a globe.
    pub(crate) fn is_globe(&self) -> bool {
        self.heights().is_some_and(|heights| heights.file.surface().is_globe())
    }

    /// The heights of the file, if it holds any.
    pub(crate) fn heights(&self) -> Option<&HeightsContent> {
        match &self.content {
            Content::Mesh(_) => None,
            Content::Heights(heights) => Some(heights),
        }
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

    /// The object that a ray meets first in what is shown, and how far away, in lengths of the ray's direction. None
    /// where it meets nothing, or in a file without objects.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub(crate) fn pick_object(&self, ray: Ray) -> Result<Option<(f64, Option<Selected>)>> {
        let Content::Mesh(mesh) = &self.content else { return Ok(None) };
        if mesh.file.index().objects().is_none() {
            return Ok(None);
        }
        let Some(pick) = mesh.file.pick_shown(ray, self.query.objects.as_deref())? else { return Ok(None) };
        let selected = pick.object.map(|number| Selected::new(&mesh.file, number)).transpose()?;
        Ok(Some((pick.distance, selected)))
    }

    /// The box of what is selected.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub(crate) fn selected_bounds(&self) -> Result<Option<Bounds>> {
        let (Some(selected), Ok(mesh)) = (&self.objects.selected, self.mesh()) else { return Ok(None) };
        let objects = mesh.file.objects().context("this file has no objects")?;
        Ok(objects.bounds(&[selected.number])?)
    }

    /// The picture to draw, unless [`Surface::overview`] returns a mesh.
    pub fn picture(&self) -> &Picture {
        self.streamer.picture()
    }

    /// The small mesh to draw until the coarsest level is loaded.
    pub(crate) fn overview(&self) -> Option<&Mesh> {
        self.streamer.overview()
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
        self.streamer.counters()
    }

    /// Bytes in the caches of pages, of surfaces and of images.
    pub(crate) fn cached_bytes(&self) -> [u64; 3] {
        let of_heights = self.streamer.heights_session().map(|session| (session.cached_bytes(), 0));
        let of_mesh =
            || self.streamer.session().map(|session| (session.cached_bytes(), session.texel_cached_bytes()[1]));
        let ([pages, surfaces], images) = of_heights.or_else(of_mesh).unwrap_or_default();
        [pages, surfaces, images]
    }

    /// Tries again what has been given up.
    pub(crate) fn retry_failed(&mut self) {
        self.streamer.retry_failed();
    }

    pub(crate) fn settle(&self) {
        self.streamer.settle();
    }

    /// Shows the channel of the command line.
    ///
    /// # Errors
    /// If the file has no such channel.
    pub fn choose_channel(&mut self, args: &Args) -> Result<()> {
        self.show_named(args.channel.as_deref())?;
        if let (Some(channel), Some(range)) = (&mut self.channel, args.range) {
            channel.set_values(range);
        }
        Ok(())
    }

    /// Shows the channel of a name, or without one that of colours.
    pub(crate) fn show_named(&mut self, name: Option<&str>) -> Result<()> {
        self.show_channel(find(self.channels(), name)?)
    }

    /// Shows the next channel, or none after the last.
    pub(crate) fn next_channel(&mut self) -> Result<()> {
        self.show_channel(after(self.channels(), self.channel.as_ref().map(|channel| channel.number)))
    }

    pub(crate) fn channels(&self) -> &[ChannelInfo] {
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
        Ok(self.streamer.show_channels(&numbers)?)
    }

    /// Draws what a view in its own coordinates shows, as far as it is loaded; an error if a budget cannot be kept.
    pub(crate) fn follow(&mut self, query: &Query) -> Result<(Report, Streamed)> {
        let view = query.view.as_ref().context("a frame has a view")?;
        let query = Query { outside: self.query.outside, objects: self.query.objects.clone(), ..query.clone() };
        let streamed = self.streamer.frame(&query)?;
        let texel_px = if self.channel.is_some() { self.streamer.texel_px(view)? } else { 0.0 };
        let [error_px, texel_px] = [self.streamer.error_px(view)?, texel_px].map(rounded);
        Ok((Report { error_px, texel_px, ..self.report(&streamed) }, streamed))
    }

    /// Draws these nodes, sorted by root, as far as they are loaded.
    pub fn show(&mut self, nodes: &[Node]) -> Result<Report> {
        let streamed = self.streamer.show(nodes)?;
        Ok(self.report(&streamed))
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

    /// Draws what a query wants, as far as it is loaded.
    pub(crate) fn ask(&mut self, query: &Query) -> Result<Report> {
        let streamed = self.streamer.frame(query)?;
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
            triangles: self.streamer.triangle_count(),
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
    pub(crate) fn take_problems(&self) -> Vec<String> {
        let problems = self.streamer.take_problems();
        problems.iter().map(|problem| format!("{}: {}", problem.location, problem.error)).collect()
    }

    /// The tiles of heights that are drawn.
    pub(crate) fn heights_cut(&self) -> Option<HeightsCut> {
        Some(self.streamer.heights_session()?.cut())
    }

    /// What cuts of the mesh are chosen from.
    fn hierarchy(&self) -> Result<&Arc<Hierarchy>> {
        Ok(self
            .streamer
            .follower()
            .context("this file holds a grid of heights, for which this does not work")?
            .hierarchy())
    }

    /// The cut for a view from scratch, independent of previous frames.
    pub(crate) fn select(&self, view: &View) -> Result<Cut> {
        Ok(lodpack::select::select_in(self.hierarchy()?, &Query { view: Some(*view), ..self.query.clone() })?)
    }

    /// The view and the nodes of one tile of a picture: tile `at` of `counts`, from the upper left corner. Every
    /// process finds and unifies the cuts of all tiles for itself.
    pub(crate) fn tile(&self, view: &View, [at, counts]: Tile) -> Result<(View, Vec<Node>)> {
        let hierarchy = self.hierarchy().context("pictures cannot be drawn in tiles")?;
        let ([columns, rows], [width, height]) = (counts, view.viewport);
        if !columns.is_power_of_two() || !(columns == rows || columns == 2 * rows) {
            bail!("tiles come in powers of two, as many rows as columns or half as many: 1x1, 2x1, 2x2, 4x2 and so on");
        }
        if at[0] >= columns || at[1] >= rows || !width.is_multiple_of(columns) || !height.is_multiple_of(rows) {
            bail!("there is no tile {},{} of {columns}x{rows} in {width}x{height} pixels", at[0], at[1]);
        }
        let tiles = TileTree::new((columns * rows).trailing_zeros())?;
        let queries = tiles.queries(&Query { view: Some(*view), ..self.query.clone() })?;
        let mut tiles = Tiles::new(hierarchy, &queries, STILL, Unification::Quality)?;
        let unified = tiles.update(&queries)?.unified;
        let corner = [f64::from(at[0]) / f64::from(columns), 1.0 - f64::from(at[1] + 1) / f64::from(rows)];
        let mut tiles = queries.iter().filter_map(|query| query.view).zip(tiles.with_neighbours(&unified));
        tiles.find(|(view, _)| view.window[0] == corner).context("the tile is missing in its tree")
    }
}
