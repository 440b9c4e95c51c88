//! Checks that what is drawn is right: over many views, and at many tolerances.
//!
//! - **cracks**: in every pixel front faces less back faces are zero, as for any closed surface; the boundary of an open one
//!   is closed by cones first. This sees every gap, whatever lies behind it.
//! - **error**: every point drawn is as near to the original mesh as the certified error of its root says, and the reverse.
//! - **ways**: pulled and stitched pictures are equal, and equal to the picture of the extracted mesh.
//! - **accuracy**: the part of pixels that are as at full resolution (Correa 2004, section 4.6); told, not judged.

mod cracks;
mod error;
pub mod mesh_file;
pub mod reference;
pub mod views;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context, Result};
use glam::DVec3;
use lodpack::{Cut, Node, session::Mode};

use crate::{
    args::Args,
    blocks::Triangles,
    camera::{Camera, Frame},
    draw::{Renderer, Style, Way},
    gpu::{Gpu, Targets},
    picture::Picture,
    pipelines::Pipelines,
    scene::Scene,
    source::{Source, open_source},
};
use error::ErrorCheck;
use mesh_file::{InputMesh, read_mesh};
use views::{Looked, View, views};

/// What is checked.
#[derive(Clone, Debug)]
pub struct Options {
    /// How many views.
    pub views: usize,
    /// Pixels of a picture's side.
    pub size_px: u32,
    /// Where difference pictures go; nowhere if none.
    pub difference: Option<PathBuf>,
    /// A fault that has to be found.
    pub fault: Option<Fault>,
}

impl From<&Args> for Options {
    fn from(args: &Args) -> Self {
        Self { views: args.views, size_px: 320, difference: Some(args.difference.clone()), fault: None }
    }
}

/// What tests plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The border of a root is drawn elsewhere.
    ShiftedBorder(u32, DVec3),
    /// A root's error is taken to be this part of what the file says.
    LessError(u32, f64),
}

/// What a check says.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// For people.
    pub lines: Vec<String>,
    /// What is wrong; empty if nothing is.
    pub failures: Vec<String>,
}

impl Outcome {
    /// Whether nothing is wrong.
    pub fn is_right(&self) -> bool {
        self.failures.is_empty()
    }
}

/// Checks a file.
///
/// # Errors
/// Where it cannot be checked.
pub fn check_file(place: &str, against: Option<&Path>, options: &Options) -> Result<Outcome> {
    let input = against.map(read_mesh).transpose()?;
    check(open_source(place)?, input, options).with_context(|| place.to_string())
}

/// Counts over all views.
#[derive(Default)]
struct Tally {
    views: usize,
    triangles: u64,
    crack_views: usize,
    crack_pixels: usize,
    way_views: usize,
    different_pixels: usize,
    mesh_views: usize,
    mesh_pixels: usize,
    /// By tolerance: pixels that are equal, and all.
    accuracy: Vec<(f64, u64, u64)>,
}

/// Checks a file against the mesh that it was made from or, without one, against its own finest level.
///
/// # Errors
/// Where it cannot be checked.
pub fn check(source: Source, input: Option<InputMesh>, options: &Options) -> Result<Outcome> {
    let gpu = Gpu::headless()?;
    let mut scene = Scene::open(source, Mode::Synchronous)?;
    scene.budget.keeps_all = true;
    let pipelines = Arc::new(Pipelines::new(&gpu));
    let mut renderers = [Way::Stitched, Way::Pulled].map(|way| Renderer::new(&gpu, &pipelines, way));
    let mut other = Renderer::new(&gpu, &pipelines, Way::Stitched);
    let targets = Targets::new(&gpu, [options.size_px; 2]);
    let mut outcome = Outcome::default();
    let mut tally = Tally::default();
    let finest = scene.level_count().saturating_sub(1) as u8;
    let uniform = |scene: &Scene, level| scene.file.uniform_cut(level).map(|cut| cut.nodes);

    let level = uniform(&scene, 0)?;
    show(&mut scene, &level, &mut outcome)?;
    let aims = views::aims(&scene);
    let own_mesh = input.is_none();
    let reference = match input {
        Some(mesh) => mesh,
        None => {
            let cut = scene.file.uniform_cut(finest)?;
            let mesh = scene.file.extract(&cut)?;
            InputMesh { positions: mesh.positions, triangles: mesh.triangles }
        }
    };
    let slack = if own_mesh { scene.file.level(usize::from(finest)).map_or(0.0, |level| level.max_error) } else { 0.0 };
    let mut error_check = ErrorCheck::new(&reference, slack, options.fault);
    if let Some(Fault::ShiftedBorder(root, by)) = options.fault {
        renderers.iter_mut().for_each(|renderer| renderer.shifted = Some((root, by)));
    }

    for (number, view) in views(&scene, &aims, options.views, options.size_px).into_iter().enumerate() {
        let View { camera, tolerance_px, looked } = view;
        scene.budget.tolerance_px = tolerance_px;
        let frame = Frame::whole(targets.size);
        let nodes = match number % 5 {
            4 => views::mixed_levels(&scene, number as u64),
            _ => scene.select(&camera, frame)?.nodes,
        };
        show(&mut scene, &nodes, &mut outcome)?;
        tally.views += 1;
        tally.triangles += scene.surfaces().triangle_count();
        for renderer in &mut renderers {
            renderer.update(&gpu, scene.surfaces(), |drawn| scene.error_of(drawn));
        }
        let caps = cracks::caps(&scene);
        for renderer in &renderers {
            other.set_mesh(&gpu, &caps);
            let pixels = cracks::uneven_pixels(&gpu, &targets, renderer, &other, &camera)?;
            tally.crack_views += usize::from(!pixels.is_empty());
            tally.crack_pixels += pixels.len();
            if !pixels.is_empty() {
                let what = format!("view {number}: {} pixels see through a crack ({:?})", pixels.len(), renderer.way);
                let picture = renderer.picture(&gpu, &targets, &camera, Style::default())?;
                fail(&mut outcome, options, "cracks", what, &picture, &pixels)?;
            }
        }
        let [stitched, pulled] = &renderers;
        let drawn = stitched.picture(&gpu, &targets, &camera, Style::default())?;
        let again = pulled.picture(&gpu, &targets, &camera, Style::default())?;
        let pixels = drawn.different_depths(&again);
        tally.way_views += usize::from(!pixels.is_empty());
        tally.different_pixels += pixels.len();
        if !pixels.is_empty() {
            let what = format!("view {number}: pulled and stitched pictures differ in {} pixels", pixels.len());
            fail(&mut outcome, options, "ways", what, &again, &pixels)?;
        }
        if number % 4 == 0 {
            let extracted = scene.file.extract(&Cut { nodes: scene.surfaces().nodes(), ..Cut::default() })?;
            other.set_mesh(&gpu, &Triangles::of_mesh(&extracted.positions, &extracted.triangles));
            let again = other.picture(&gpu, &targets, &camera, Style::default())?;
            let pixels = drawn.different_depths(&again);
            tally.mesh_views += 1;
            tally.mesh_pixels += pixels.len();
            if !pixels.is_empty() {
                let what = format!("view {number}: the extracted mesh looks otherwise in {} pixels", pixels.len());
                fail(&mut outcome, options, "extracted", what, &again, &pixels)?;
            }
        }
        if looked != Looked::Close {
            let pixels = error_check.check(&scene, &drawn, &camera);
            if !pixels.is_empty() {
                let what = format!("view {number}: {} pixels are farther off than certified", pixels.len());
                fail(&mut outcome, options, "error", what, &drawn, &pixels)?;
            }
        }
        if looked == Looked::Whole && number < 40 {
            let level = uniform(&scene, finest)?;
            accuracy(&mut tally, &mut scene, &gpu, &targets, &mut other, &camera, &level)?;
        }
    }
    report(&mut outcome, &tally, &error_check, own_mesh, &gpu, options);
    Ok(outcome)
}

fn show(scene: &mut Scene, nodes: &[Node], outcome: &mut Outcome) -> Result<()> {
    let report = scene.show(nodes, &[])?;
    let problems = scene.take_problems();
    if !report.is_complete && problems.is_empty() {
        outcome.failures.push("a cut is not complete".into());
    }
    outcome.failures.extend(problems.into_iter().map(|problem| format!("a part of the file is missing: {problem}")));
    Ok(())
}

/// Compares with full resolution at tolerances of half a pixel and up.
fn accuracy(
    tally: &mut Tally,
    scene: &mut Scene,
    gpu: &Gpu,
    targets: &Targets,
    renderer: &mut Renderer,
    camera: &Camera,
    finest: &[Node],
) -> Result<()> {
    let mut picture = |scene: &mut Scene, nodes: &[Node]| -> Result<Picture> {
        scene.show(nodes, &[])?;
        renderer.update(gpu, scene.surfaces(), |_| 0.0);
        renderer.picture(gpu, targets, camera, Style::default())
    };
    let full = picture(scene, finest)?;
    for (k, tolerance) in [0.5, 1.0, 2.0, 4.0, 8.0].into_iter().enumerate() {
        scene.budget.tolerance_px = tolerance;
        let nodes = scene.select(camera, Frame::whole(targets.size))?.nodes;
        let coarse = picture(scene, &nodes)?;
        let is_seen = |&i: &usize| full.roots[i].is_some() || coarse.roots[i].is_some();
        let seen: Vec<usize> = (0..full.colours.len()).filter(is_seen).collect();
        let equal = seen.iter().filter(|&&i| full.colours[i] == coarse.colours[i]).count();
        if tally.accuracy.len() == k {
            tally.accuracy.push((tolerance, 0, 0));
        }
        tally.accuracy[k].1 += equal as u64;
        tally.accuracy[k].2 += seen.len() as u64;
    }
    Ok(())
}

/// Notes a failure; the first one of each kind gets a picture.
fn fail(
    outcome: &mut Outcome,
    options: &Options,
    kind: &str,
    what: String,
    picture: &Picture,
    pixels: &[usize],
) -> Result<()> {
    let is_first = !outcome.failures.iter().any(|failure| failure.starts_with(kind));
    let mut failure = format!("{kind}: {what}");
    if let (true, Some(folder)) = (is_first, &options.difference) {
        let path = folder.join(format!("difference-{kind}.png"));
        picture.marked(pixels).save(&path)?;
        failure += &format!("; see {}", path.display());
    }
    outcome.failures.push(failure);
    Ok(())
}

fn report(outcome: &mut Outcome, tally: &Tally, error: &ErrorCheck, own: bool, gpu: &Gpu, options: &Options) {
    let Tally { views, triangles, crack_pixels, different_pixels, mesh_views, mesh_pixels, .. } = tally;
    let against = if own { "its own finest level" } else { "the original mesh" };
    let side = options.size_px;
    let mean = triangles / (*views).max(1) as u64;
    let mut lines = vec![
        format!("{views} views of {side}x{side} pixels, {mean} triangles on average, on {}", gpu.name()),
        format!("cracks: {crack_pixels} pixels in {} pictures (both ways)", tally.crack_views),
        format!("stitched and pulled: {different_pixels} pixels differ in {} views", tally.way_views),
        format!("cut and extracted mesh: {mesh_pixels} pixels differ in {mesh_views} views"),
    ];
    lines.push(format!("error against {against}: {}", error.summary()));
    for &(tolerance, equal, all) in &tally.accuracy {
        let share = 100.0 * equal as f64 / all.max(1) as f64;
        lines.push(format!(
            "accuracy at {tolerance} pixels: {share:.1} % of the surface's pixels as at full resolution"
        ));
    }
    const MOST: usize = 20;
    lines.extend(outcome.failures.iter().take(MOST).map(|failure| format!("WRONG {failure}")));
    if outcome.failures.len() > MOST {
        lines.push(format!("WRONG and {} more", outcome.failures.len() - MOST));
    }
    lines.push(if outcome.is_right() { "all is right".into() } else { "something is wrong".into() });
    outcome.lines = lines;
}
