//! All that is drawn into one picture: a file, what its mesh stands on, and any number of further files, with one
//! budget of triangles.

use std::sync::Arc;

use anyhow::{Context, Result, bail};
use lodpack::{
    Ground, GroundFrame, Limits, Node, Opened, Query, View,
    heights::Heights,
    index::{Placement, UpAxis},
    select::SharedBudget,
    source::{Http, HttpOptions, Within},
    stream::Mode,
};

use crate::{
    args::Args,
    camera::{Bounds, Extent, Subject},
    objects::{Selected, ray_at},
    report::{Report, until_it_stays},
    surface::{Looks, Source, Surface},
};

/// Opens the file or URL at an address.
pub(crate) fn open_source(address: &str) -> Result<Source> {
    if address.starts_with("http://") || address.starts_with("https://") {
        return Ok(Arc::new(Http::new(address, HttpOptions::default())));
    }
    Ok(Arc::new(std::fs::File::open(address).with_context(|| format!("{address} cannot be opened"))?))
}

/// What is drawn into one picture.
pub struct Scene {
    /// The box of all of it, in the coordinates of the first file.
    pub bounds: Bounds,
    /// The first file, in whose coordinates the picture is taken.
    pub first: Surface,
    placement: Placement,
    beside: Vec<Beside>,
    budget: SharedBudget,
}

/// Something beside the first file, which is looked at in its own space.
pub(crate) struct Beside {
    pub surface: Surface,
    pub frame: GroundFrame,
}

/// A surface and where it is.
type Placed = (Surface, Placement);

/// Where heights are: z is up.
fn placement_of(heights: &Heights<Source>) -> Placement {
    Placement { up: UpAxis::Z, ..heights.index().placement().cloned().unwrap_or_default() }
}

/// The surfaces of a file: a mesh, what it stands on, or heights.
fn surfaces_of(source: Source, looks: Looks) -> Result<Vec<Placed>> {
    let bytes = Arc::clone(&source);
    match Opened::open(source, Limits::default()).context("the file cannot be opened")? {
        Opened::Heights(heights) => {
            let placement = placement_of(&heights);
            Ok(vec![(Surface::of_heights(heights, looks)?, placement)])
        }
        Opened::Mesh(file) => {
            let placement = file.placement().cloned().unwrap_or_default();
            let mut ground = None;
            if let Some(range) = file.index().ground_range() {
                let part: Source = Arc::new(Within::new(bytes, range));
                let opened = Ground::within(file.index(), part).context("the ground of the mesh cannot be opened")?;
                let placement = placement_of(&opened.heights);
                ground = Some((Surface::of_heights(opened.heights, looks)?, placement));
            }
            Ok([(Surface::of_mesh(file, looks)?, placement)].into_iter().chain(ground).collect())
        }
    }
}

impl Scene {
    /// Opens a file. Surfaces are shaded smoothly.
    pub fn open(source: Source, mode: Mode) -> Result<Self> {
        Self::open_with(source, Looks { mode, ..Looks::default() })
    }

    /// Opens a file that is drawn in another way.
    pub fn open_with(source: Source, looks: Looks) -> Result<Self> {
        let mut surfaces = surfaces_of(source, looks)?.into_iter();
        let (first, placement) = surfaces.next().context("the file is empty")?;
        let (bounds, budget) = (first.bounds, SharedBudget::default());
        let mut scene = Self { bounds, first, placement, beside: Vec::new(), budget };
        surfaces.try_for_each(|surface| scene.put(surface))?;
        Ok(scene)
    }

    /// Adds what another file has, where both say that they are.
    ///
    /// # Errors
    /// If it cannot be opened, or not placed: one of them lies on a globe, or they are in different coordinate
    /// reference systems.
    pub fn add(&mut self, source: Source, looks: Looks) -> Result<()> {
        surfaces_of(source, looks)?.into_iter().try_for_each(|surface| self.put(surface))
    }

    fn put(&mut self, (surface, placement): Placed) -> Result<()> {
        if self.first.is_globe() || surface.is_globe() {
            bail!("heights on a globe have no place beside another file");
        }
        let frame = GroundFrame::between(Some(&placement), Some(&self.placement))?;
        let ([low, high], [least, most]) = (frame.bounds(surface.bounds), self.bounds);
        self.bounds = [[0, 1, 2].map(|k| least[k].min(low[k])), [0, 1, 2].map(|k| most[k].max(high[k]))];
        self.beside.push(Beside { surface, frame });
        Ok(())
    }

    /// What is drawn beside the first file.
    pub(crate) fn beside(&self) -> &[Beside] {
        &self.beside
    }

    fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        std::iter::once(&self.first).chain(self.beside.iter().map(|beside| &beside.surface))
    }

    fn surfaces_mut(&mut self) -> impl Iterator<Item = &mut Surface> {
        std::iter::once(&mut self.first).chain(self.beside.iter_mut().map(|beside| &mut beside.surface))
    }

    /// What a view of all of it has to know.
    pub(crate) fn extent(&self) -> Extent {
        let has_ground = self.beside.iter().any(|beside| beside.surface.heights().is_some());
        let subject = match self.first.heights() {
            Some(_) => Subject::Heights,
            None => Subject::Mesh { up: self.placement.up, has_ground },
        };
        Extent::of(self.bounds, subject)
    }

    /// What the first view has to know: of what the command line finds, or of all of it.
    pub(crate) fn first_extent(&self) -> Result<Extent> {
        let extent = self.extent();
        let bounds = self.first.selected_bounds()?.unwrap_or(extent.bounds);
        Ok(Extent { bounds, ..extent })
    }

    /// What is selected.
    pub(crate) fn selected(&self) -> Option<&Selected> {
        self.surfaces().find_map(|surface| surface.objects.selected.as_ref())
    }

    /// Selects nothing.
    pub(crate) fn deselect(&mut self) {
        self.surfaces_mut().for_each(|surface| surface.objects.selected = None);
    }

    /// Selects what a place of the picture shows of meshes: 0 to 1 from the upper left corner. Nothing where it shows
    /// nothing, or files without objects.
    ///
    /// # Errors
    /// If a file is damaged or cannot be read.
    pub(crate) fn pick_object(&mut self, view: &View, place: [f64; 2]) -> Result<()> {
        self.deselect();
        let mut nearest = self.first.pick_object(ray_at(view, place))?.map(|(distance, found)| (distance, 0, found));
        for (number, Beside { surface, frame }) in (1..).zip(&self.beside) {
            // Its directions have the same lengths, in its own unit.
            let picked = surface.pick_object(ray_at(&frame.view_of_ground(view), place))?;
            let picked = picked.map(|(distance, found)| (distance * frame.scale(), number, found));
            nearest = [nearest, picked].into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0));
        }
        if let Some((_, number, found)) = nearest
            && let Some(surface) = self.surfaces_mut().nth(number)
        {
            surface.objects.selected = found;
        }
        Ok(())
    }

    /// Carries out what a key asks of what is selected.
    ///
    /// # Errors
    /// If a file is damaged or cannot be read.
    pub(crate) fn obey_objects(&mut self, letter: &str) -> Result<()> {
        self.surfaces_mut().try_for_each(|surface| surface.obey_objects(letter))
    }

    /// Tries again what has been given up.
    pub fn retry_failed(&mut self) {
        self.surfaces_mut().for_each(Surface::retry_failed);
    }

    fn settle(&self) {
        self.surfaces().for_each(Surface::settle);
    }

    /// Takes the limits of cuts from the command line.
    pub fn limit(&mut self, args: &Args) {
        (self.first.query.max_triangles, self.first.query.max_nodes) = (args.max_triangles, args.max_nodes);
    }

    /// Shows the channel of the command line. A name is one of the first file; others show their colours, or nothing
    /// as well.
    ///
    /// # Errors
    /// If the file has no such channel.
    pub fn choose_channel(&mut self, args: &Args) -> Result<()> {
        let named = args.channel.as_deref().filter(|&name| name == "none");
        self.beside.iter_mut().try_for_each(|beside| beside.surface.show_named(named))?;
        self.first.choose_channel(args)
    }

    /// Draws what the view shows, as far as it is loaded. Budgets are those of the first file's query: triangles are
    /// those of all together, nodes those of each.
    pub fn follow(&mut self, view: &View) -> Result<Report> {
        let Query { max_triangles, max_nodes, .. } = self.first.query;
        let whole = max_triangles.unwrap_or(u64::MAX);
        let shares = self.budget.limits(whole, view.pixel_tolerance, 1 + self.beside.len());
        let view = View { pixel_tolerance: shares.tolerance, ..*view };
        let frames = std::iter::once(None).chain(self.beside.iter().map(|beside| Some(beside.frame)));
        let views: Vec<View> = frames.map(|frame| frame.map_or(view, |frame| frame.view_of_ground(&view))).collect();
        let (mut whole, mut taken) = (None::<Report>, Vec::with_capacity(views.len()));
        for ((surface, view), share) in self.surfaces_mut().zip(views).zip(shares.budgets) {
            let max_triangles = max_triangles.map(|_| share);
            let (report, streamed) =
                surface.follow(&Query { view: Some(view), max_triangles, max_nodes, ..Query::default() })?;
            taken.push(streamed.taken());
            whole = Some(whole.map_or(report, |whole| whole.and(&report)));
        }
        self.budget.record(&taken);
        whole.context("there is nothing to draw")
    }

    /// Draws what the view shows, after everything for it is loaded: of a large file, more of the tree is known after
    /// each frame, and budgets are shared out anew.
    pub fn follow_to_the_end(&mut self, view: &View) -> Result<Report> {
        until_it_stays(|| {
            let before = self.budget.clone();
            let report = self.follow(view)?;
            self.settle();
            Ok((report, self.budget == before))
        })
    }

    /// Draws these nodes of the first file for a tile of the picture that a view shows, as far as they are loaded, or
    /// waits for them. What is beside it is that of the whole picture, so that it is the same in all tiles.
    pub fn show_tile(&mut self, nodes: &[Node], whole: &View, waits: bool) -> Result<Report> {
        let mut report = self.first.show(nodes)?;
        for Beside { surface, frame } in &mut self.beside {
            let Query { max_triangles, max_nodes, .. } = self.first.query;
            let view = Some(frame.view_of_ground(whole));
            let query = Query { view, max_triangles, max_nodes, ..Query::default() };
            let mut follow = || {
                let (report, _) = surface.follow(&query)?;
                if waits {
                    surface.settle();
                }
                Ok((report, true))
            };
            let of_surface = if waits { until_it_stays(follow)? } else { follow()?.0 };
            report = report.and(&of_surface);
        }
        Ok(report)
    }

    /// The failures to load since the last call.
    pub fn take_problems(&self) -> Vec<String> {
        let of_first = self.first.take_problems();
        let beside = self.beside.iter().flat_map(|beside| {
            let name = if beside.surface.heights().is_some() { "ground" } else { "beside" };
            beside.surface.take_problems().into_iter().map(move |problem| format!("{name}: {problem}"))
        });
        of_first.into_iter().chain(beside).collect()
    }
}
