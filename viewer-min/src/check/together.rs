//! A mesh and its ground in one picture: each pixel shows whichever of both is nearer.

use std::sync::Arc;

use anyhow::{Context, Result};
use lodpack::stream::Mode;

use super::{Options, Outcome, views::views};
use crate::{
    args::Way,
    draw::{Renderer, Turn},
    gpu::{Gpu, Targets},
    picture::Picture,
    scene::{Beside, Scene},
    surface::Source,
};

/// Depths that differ by less than this share are equal: those of the ground are computed in its own space, whose unit
/// may be another.
const EQUAL: f32 = 1e-5;

/// Draws a mesh and its ground each alone and then together, and compares the pictures.
pub fn check_together(source: Source, options: &Options) -> Result<Outcome> {
    let gpu = Arc::new(Gpu::headless()?);
    let targets = Targets::new(&gpu, [options.size_px; 2]);
    let mut scene = Scene::open(source, Mode::Synchronous)?;
    let [mut of_mesh, mut of_ground] = [(); 2].map(|()| Renderer::new(&gpu, Way::Stitched));
    let views = views(&scene.first, scene.bounds, options.views, options.size_px);
    let mut outcome = Outcome::default();
    let [mut in_front, mut behind, mut wrong_pixels] = [0_usize; 3];
    for (number, view) in views.iter().enumerate() {
        scene.follow_to_the_end(view)?;
        let Beside { surface: ground, frame } = scene.beside().first().context("the mesh stands on no ground")?;
        let below = frame.view_of_ground(view);
        of_mesh.update(scene.first.picture());
        of_ground.update(ground.picture());
        let alone = [of_mesh.picture(&targets, view)?, of_ground.picture(&targets, &below)?];
        of_mesh.draw_in_turn(&targets, view, Turn::First);
        of_ground.draw_in_turn(&targets, &below, Turn::Last);
        let both = targets.read(&gpu)?;
        let mut wrong = 0;
        for pixel in 0..both.roots.len() {
            let nearer = nearer_at(&alone, pixel, frame.scale() as f32);
            wrong += usize::from(!nearer.iter().any(|&which| is_same(&both, &alone[which], pixel)));
            if alone.iter().all(|picture| picture.roots[pixel].is_some()) {
                in_front += usize::from(nearer == [0]);
                behind += usize::from(nearer == [1]);
            }
        }
        wrong_pixels += wrong;
        if wrong > 0 {
            outcome.failures.push(format!("together: view {number}: {wrong} pixels do not show what is nearer"));
        }
    }
    outcome.lines.push(format!("{} views, {wrong_pixels} pixels do not show what is nearer", views.len()));
    outcome.lines.push(format!("the mesh hides its ground in {in_front} pixels, and the ground the mesh in {behind}"));
    outcome.lines.push(if outcome.failures.is_empty() { "all is right".into() } else { "something is wrong".into() });
    Ok(outcome)
}

/// Which of two pictures a pixel of both together may show: the nearer one, or either where they are equally near.
fn nearer_at([mesh, ground]: &[Picture; 2], pixel: usize, scale: f32) -> Vec<usize> {
    match (mesh.roots[pixel], ground.roots[pixel]) {
        (Some(_), Some(_)) => {
            let [near, far] = [mesh.depths[pixel], ground.depths[pixel] * scale];
            match (near - far).abs() <= EQUAL * near.max(far) {
                true => vec![0, 1],
                false => vec![usize::from(far < near)],
            }
        }
        (Some(_), None) => vec![0],
        (None, _) => vec![1],
    }
}

/// Whether a pixel looks the same in two pictures.
fn is_same(one: &Picture, other: &Picture, pixel: usize) -> bool {
    let colour = |picture: &Picture| picture.colours.as_raw().get(4 * pixel..4 * pixel + 4).map(<[u8]>::to_vec);
    match (one.roots[pixel], other.roots[pixel]) {
        (None, None) => true,
        (Some(a), Some(b)) => a == b && one.depths[pixel] == other.depths[pixel] && colour(one) == colour(other),
        _ => false,
    }
}
