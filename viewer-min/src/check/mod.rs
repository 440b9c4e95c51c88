//! Checks that a file is drawn correctly, over many views and at many tolerances.
//!
//! - **cracks**: in every pixel, front faces minus back faces are zero, as for any closed surface; cones close the
//!   boundary of an open one first. This finds every gap, whatever lies behind it.
//! - **error**: every drawn point is as near to the original mesh as the certified error of its root says, and vice
//!   versa.
//! - **ways**: pulled and stitched pictures are equal, and equal to the picture of the extracted mesh.
//! - **together**: in a picture of a mesh on its ground, each pixel shows whichever of both is nearer where each is
//!   drawn alone.
//! - **accuracy**: the share of pixels that look as at full resolution (Correa 2004, section 4.6); reported, not
//!   judged.

mod cracks;
mod error;
mod flight;
pub mod mesh_file;
pub mod reference;
mod together;
mod views;

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use anyhow::{Context, Result, bail};
use glam::DVec3;
use lodpack::{
    Cut, Limits, Mesh, Node, Opened, Outside, Query, View,
    heights::{HeightsMesh, HeightsQuery},
    source::Within,
    stream::Mode,
};

use crate::{
    args::{Args, Way},
    draw::Renderer,
    gpu::{Gpu, Targets},
    picture::{Picture, different_colours, marked, save},
    scene::{Scene, open_source},
    surface::{HeightsContent, Looks, MeshContent, Source, Surface},
};
use error::ErrorCheck;
pub use flight::{Flight, fly};
use mesh_file::read_mesh;
use views::{mixed_levels, views};

/// Options of [`check`].
#[derive(Clone, Debug)]
pub struct Options {
    /// Number of views.
    pub views: usize,
    /// Side of a picture, in pixels.
    pub size_px: u32,
    /// Where to write difference pictures, if anywhere.
    pub difference: Option<PathBuf>,
    /// A planted fault, which must be found.
    pub fault: Option<Fault>,
}

/// Faults that tests plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The border of a root is drawn shifted.
    ShiftedBorder(u32, DVec3),
    /// A root's error counts as this share of the error in the file.
    LessError(u32, f64),
}

/// The result of a check.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Sentences for people.
    pub lines: Vec<String>,
    /// All failures; empty if there are none.
    pub failures: Vec<String>,
}

/// Runs the check of the command line and prints its result. Returns whether everything is correct.
pub fn check_file(args: &Args) -> Result<bool> {
    let [address] = &*args.files else { bail!("--check needs one file") };
    let input = args.against.as_deref().map(read_mesh).transpose()?;
    let difference = Some(args.difference.clone());
    let options = Options { views: args.views, size_px: 320, difference, fault: None };
    let outcome = check(open_source(address)?, input, &options).with_context(|| address.clone())?;
    outcome.lines.iter().for_each(|line| println!("{line}"));
    Ok(outcome.failures.is_empty())
}

/// Checks a file against the mesh from which it was built or, without one, against its own finest level. A ground is
/// checked like a file of its own, and then both in one picture.
pub fn check(source: Source, input: Option<Mesh>, options: &Options) -> Result<Outcome> {
    let mut outcome = check_alone(Arc::clone(&source), input, options)?;
    let range = match Opened::open(Arc::clone(&source), Limits::default())? {
        Opened::Mesh(file) => file.index().ground_range(),
        Opened::Heights(_) => None,
    };
    if let Some(range) = range {
        let ground = Arc::new(Within::new(Arc::clone(&source), range));
        let others = [check_alone(ground, None, options)?, together::check_together(source, options)?];
        for (other, name) in others.into_iter().zip(["its ground: ", "both in one picture: "]) {
            outcome.lines.extend(other.lines.into_iter().map(|line| format!("{name}{line}")));
            outcome.failures.extend(other.failures);
        }
    }
    Ok(outcome)
}

fn check_alone(source: Source, input: Option<Mesh>, options: &Options) -> Result<Outcome> {
    let mut check = Check::new(source, options)?;
    let finest = check.finest()?;
    let (reference, slack, against) = match input {
        Some(mesh) => (mesh, 0.0, "the original mesh"),
        None => {
            let (mesh, slack) = check.finest_mesh()?;
            (mesh, slack, "its own finest level")
        }
    };
    let mut error = ErrorCheck::new(&reference, slack, options.fault);
    let coarsest = check.coarsest()?;
    check.show(&coarsest)?;
    let views = views(&check.surface, check.surface.bounds, options.views, options.size_px);
    for (number, view) in views.iter().enumerate() {
        check.look(number, view, &mut error)?;
        if number < 40 && number.is_multiple_of(4) {
            check.accuracy(view, &finest)?;
        }
    }
    let (gpu, side, triangles) = (check.gpu.name(), options.size_px, check.triangles / views.len().max(1) as u64);
    let average = format!("{triangles} triangles on average");
    let mut lines = vec![format!("{} views of {side}x{side} pixels, {average}, on {gpu}", views.len())];
    let findings = check.findings;
    lines.extend(findings.tallies.iter().map(|([name, explain], [pixels, pictures])| {
        format!("{name}: {pixels} pixels of {pictures} pictures {explain}")
    }));
    lines.push(format!("error against {against}: {}", error.summary()));
    lines.extend(check.accuracy.iter().map(|[tolerance, equal, all]| {
        let share = 100.0 * equal / all.max(1.0);
        format!("accuracy at {tolerance} pixels: {share:.1} % of the surface's pixels as at full resolution")
    }));
    const MOST: usize = 20;
    lines.extend(findings.failures.iter().take(MOST).map(|failure| format!("WRONG {failure}")));
    if findings.failures.len() > MOST {
        lines.push(format!("WRONG and {} more", findings.failures.len() - MOST));
    }
    lines.push(if findings.failures.is_empty() { "all is right".into() } else { "something is wrong".into() });
    Ok(Outcome { lines, failures: findings.failures })
}

/// A kind of failure: its name, and what its pixels do.
type Kind = [&'static str; 2];

const CRACK: Kind = ["cracks", "see through a crack"];
const WAY: Kind = ["ways", "differ from stitched to pulled"];
const EXTRACTED: Kind = ["extracted", "look different in the extracted mesh"];
const ERROR: Kind = ["error", "are farther away than certified"];

/// The findings so far.
#[derive(Default)]
struct Findings {
    difference: Option<PathBuf>,
    failures: Vec<String>,
    /// Wrong pixels, and pictures examined.
    tallies: BTreeMap<Kind, [usize; 2]>,
}

impl Findings {
    /// Records the wrong pixels of a picture. The first picture of each kind that has any is written.
    fn judge(&mut self, kind @ [name, explain]: Kind, view: usize, picture: &Picture, pixels: &[usize]) -> Result<()> {
        let [so_far, pictures] = self.tallies.entry(kind).or_default();
        let is_first = *so_far == 0;
        *so_far += pixels.len();
        *pictures += 1;
        if pixels.is_empty() {
            return Ok(());
        }
        let mut failure = format!("{name}: view {view}: {} pixels {explain}", pixels.len());
        if let (true, Some(folder)) = (is_first, &self.difference) {
            let path = folder.join(format!("difference-{name}.png"));
            save(marked(&picture.colours, pixels), &path)?;
            failure += &format!("; see {}", path.display());
        }
        self.failures.push(failure);
        Ok(())
    }
}

/// What is to be drawn: nodes of a mesh, or what a query wants of heights.
enum Wanted {
    Nodes(Vec<Node>),
    Query(Box<Query>),
}

/// Everything needed for drawing, and the findings.
struct Check {
    gpu: Arc<Gpu>,
    targets: Targets,
    surface: Surface,
    /// One for each way of drawing.
    renderers: [Renderer; 2],
    /// For meshes and for other cuts.
    other: Renderer,
    findings: Findings,
    triangles: u64,
    /// For each tolerance: the tolerance, equal pixels, and all pixels.
    accuracy: [[f64; 3]; 5],
}

impl Check {
    fn new(source: Source, options: &Options) -> Result<Self> {
        let gpu = Arc::new(Gpu::headless()?);
        // What is checked is geometry, of tiles of all depths.
        let looks = Looks { mode: Mode::Synchronous, sample_px: f64::INFINITY, is_flat: true };
        let mut surface = Scene::open_with(source, looks)?.first;
        surface.query.outside = Outside::Coarsest;
        let renderer = |way| Renderer::new(&gpu, way);
        let mut renderers = [Way::Stitched, Way::Pulled].map(renderer);
        if let Some(Fault::ShiftedBorder(root, by)) = options.fault {
            renderers.iter_mut().for_each(|renderer| renderer.shifted = Some((root, by)));
        }
        let other = renderer(Way::Stitched);
        let targets = Targets::new(&gpu, [options.size_px; 2]);
        let findings = Findings { difference: options.difference.clone(), ..Findings::default() };
        let accuracy = [0.5, 1.0, 2.0, 4.0, 8.0].map(|tolerance| [tolerance, 0.0, 0.0]);
        Ok(Self { gpu, targets, surface, renderers, other, findings, triangles: 0, accuracy })
    }

    /// Everything at its finest.
    fn finest(&self) -> Result<Wanted> {
        let Ok(MeshContent { file, .. }) = self.surface.mesh() else { return Ok(Wanted::Query(Box::default())) };
        Ok(Wanted::Nodes(file.uniform_cut(file.level_count().saturating_sub(1) as u8)?.nodes))
    }

    /// Its mesh, and the mesh's error.
    fn finest_mesh(&self) -> Result<(Mesh, f64)> {
        if let Some(HeightsContent { file, .. }) = self.surface.heights() {
            let cut = file.cut(&HeightsQuery::default())?;
            return Ok((mesh_of(file.mesh(&cut)?), cut.error));
        }
        let file = &self.surface.mesh()?.file;
        let finest = file.uniform_cut(file.level_count().saturating_sub(1) as u8)?;
        let slack = finest.nodes.first().and_then(|node| file.level(usize::from(node.level)));
        Ok((file.extract(&finest)?, slack.map_or(0.0, |level| level.max_error)))
    }

    /// Everything at its coarsest.
    fn coarsest(&self) -> Result<Wanted> {
        Ok(match self.surface.mesh() {
            Ok(mesh) => Wanted::Nodes(mesh.file.uniform_cut(0)?.nodes),
            Err(_) => Wanted::Query(Box::new(Query { tolerance: Some(f64::MAX), ..Query::default() })),
        })
    }

    /// What a view wants.
    fn seen(&self, view: &View) -> Result<Wanted> {
        Ok(match self.surface.heights() {
            None => Wanted::Nodes(self.surface.select(view)?.nodes),
            Some(_) => Wanted::Query(Box::new(Query { view: Some(*view), ..self.surface.query.clone() })),
        })
    }

    /// Something that has to do with no view: neighbours differ by any number of levels, or tiles that are not shown
    /// are fine, too.
    fn mixed(&self, number: usize) -> Result<Wanted> {
        let Some(heights) = self.surface.heights() else {
            return Ok(Wanted::Nodes(mixed_levels(self.surface.mesh()?, number as u64)?));
        };
        // The larger the number, the finer.
        let records = heights.file.roots().first().map(|&root| heights.file.record(root)).transpose()?.flatten();
        let tolerance = records.map_or(0.0, |record| record.finest_error()) * 0.5_f64.powi(number as i32 / 5 % 8);
        Ok(Wanted::Query(Box::new(Query { tolerance: Some(tolerance), ..Query::default() })))
    }

    /// The mesh of what is drawn, as the file extracts it.
    fn extracted(&self) -> Result<Mesh> {
        if let (Some(HeightsContent { file, .. }), Some(cut)) = (self.surface.heights(), self.surface.heights_cut()) {
            return Ok(mesh_of(file.mesh(&cut)?));
        }
        let nodes = self.surface.picture().nodes();
        Ok(self.surface.mesh()?.file.extract(&Cut { nodes, ..Cut::default() })?)
    }

    fn show(&mut self, wanted: &Wanted) -> Result<()> {
        let report = match wanted {
            Wanted::Nodes(nodes) => self.surface.show(nodes)?,
            Wanted::Query(query) => self.surface.ask(query)?,
        };
        let problems = self.surface.take_problems();
        if !report.is_complete && problems.is_empty() {
            self.findings.failures.push("a cut is not complete".into());
        }
        let missing = problems.into_iter().map(|problem| format!("part of the file is missing: {problem}"));
        self.findings.failures.extend(missing);
        Ok(())
    }

    /// Runs all checks for one view. In every fifth cut, levels are random, whatever is visible.
    fn look(&mut self, number: usize, view: &View, error: &mut ErrorCheck<'_>) -> Result<()> {
        let wanted = if number % 5 == 4 { self.mixed(number)? } else { self.seen(view)? };
        self.show(&wanted)?;
        let Self { gpu, targets, surface, renderers, other, findings, .. } = self;
        self.triangles += surface.picture().triangle_count();
        for renderer in renderers.iter_mut() {
            renderer.update(surface.picture());
        }
        let [stitched, pulled] = &*renderers;
        let drawn = stitched.picture(targets, view)?;
        let again = pulled.picture(targets, view)?;
        findings.judge(WAY, number, &again, &drawn.different_depths(&again))?;
        let caps = cracks::caps(surface)?;
        other.set_mesh(&caps.positions, &caps.triangles);
        for (renderer, picture) in [(stitched, &drawn), (pulled, &again)] {
            let pixels = cracks::uneven_pixels(gpu, targets, [renderer, other], view)?;
            findings.judge(CRACK, number, picture, &pixels)?;
        }
        if number.is_multiple_of(4) {
            let extracted = self.extracted()?;
            let Self { targets, other, findings, .. } = self;
            other.set_mesh(&extracted.positions, &extracted.triangles);
            let again = other.picture(targets, view)?;
            findings.judge(EXTRACTED, number, &again, &drawn.different_depths(&again))?;
        }
        // Close views serve to find cracks.
        if number % 4 < 2 {
            let wrong = error.check(&self.surface, &drawn, view);
            self.findings.judge(ERROR, number, &drawn, &wrong)?;
        }
        Ok(())
    }

    /// Compares with full resolution, at tolerances of half a pixel and more.
    fn accuracy(&mut self, view: &View, finest: &Wanted) -> Result<()> {
        let full = self.picture(view, finest)?;
        for k in 0..self.accuracy.len() {
            let wanted = self.seen(&View { pixel_tolerance: self.accuracy[k][0], ..*view })?;
            let coarse = self.picture(view, &wanted)?;
            let seen = (0..full.roots.len()).filter(|&i| full.roots[i].is_some() || coarse.roots[i].is_some()).count();
            let different = different_colours(&full.colours, &coarse.colours, 0).len();
            self.accuracy[k][1] += (seen - different) as f64;
            self.accuracy[k][2] += seen as f64;
        }
        Ok(())
    }

    fn picture(&mut self, view: &View, wanted: &Wanted) -> Result<Picture> {
        self.show(wanted)?;
        self.other.update(self.surface.picture());
        self.other.picture(&self.targets, view)
    }
}

/// A mesh of heights as any other mesh.
fn mesh_of(mesh: HeightsMesh) -> Mesh {
    Mesh { positions: mesh.positions, triangles: mesh.triangles, triangle_nodes: mesh.triangle_tiles }
}
