//! Flights: every frame of a moving camera, with what is loaded by then, has no crack and shows the surface wherever it
//! lies.

use anyhow::{Context, Result};
use glam::DVec3;
use lodpack::{View, stream::Mode};

use super::cracks;
use crate::{
    args::Way,
    draw::Renderer,
    gpu::{Gpu, Targets},
    scene::Scene,
    surface::Source,
};

/// What was seen during a flight.
#[derive(Clone, Debug, Default)]
pub struct Flight {
    /// Pictures.
    pub frames: usize,
    /// Those that showed something coarser than asked for, because it was not loaded yet.
    pub late_frames: usize,
    /// Those before the first tile was there, which show nothing.
    pub empty_frames: usize,
    /// Pixels that saw through a crack, in all pictures.
    pub cracks: usize,
    /// Pixels in front of the ball that showed nothing, in all pictures but the empty ones.
    pub bare: usize,
    /// Pixels in front of the ball, in all pictures but the empty ones.
    pub covered: usize,
    /// The most triangles of a picture.
    pub most_triangles: u64,
    /// Bytes that were loaded.
    pub bytes: u64,
    /// Parts of the file that could not be loaded.
    pub problems: Vec<String>,
}

/// Flies along a path. Frames never wait for what is loaded meanwhile. `ball` is the radius of a ball around the origin
/// that lies within the surface at any level.
///
/// # Errors
/// If the file cannot be opened, or there is no adapter.
pub fn fly(source: Source, path: &[View], ball: f64) -> Result<Flight> {
    let gpu = std::sync::Arc::new(Gpu::headless()?);
    let mut scene = Scene::open(source, Mode::AsynchronousWithPrefetch)?;
    let (mut renderer, mut other) = (Renderer::new(&gpu, Way::Stitched), Renderer::new(&gpu, Way::Stitched));
    let targets = Targets::new(&gpu, path.first().context("a flight needs views")?.viewport);
    let mut flight = Flight::default();
    for view in path {
        let report = scene.follow(view)?;
        flight.frames += 1;
        flight.problems.extend(scene.take_problems());
        flight.late_frames += usize::from(!report.is_complete);
        flight.most_triangles = flight.most_triangles.max(report.triangles);
        flight.bytes += report.bytes;
        if flight.empty_frames + 1 == flight.frames && report.nodes == 0 {
            flight.empty_frames += 1;
            continue;
        }
        renderer.update(scene.first.picture());
        let picture = renderer.picture(&targets, view)?;
        for pixel in (0..picture.roots.len()).filter(|&pixel| hits(view, pixel, ball)) {
            flight.covered += 1;
            flight.bare += usize::from(picture.roots[pixel].is_none());
        }
        let caps = cracks::caps(&scene.first)?;
        other.set_mesh(&caps.positions, &caps.triangles);
        flight.cracks += cracks::uneven_pixels(&gpu, &targets, [&renderer, &other], view)?.len();
    }
    Ok(flight)
}

/// Whether the ray through the middle of a pixel hits a ball around the origin.
fn hits(view: &View, pixel: usize, ball: f64) -> bool {
    let [width, height] = view.viewport.map(f64::from);
    let (x, y) = ((pixel % view.viewport[0] as usize) as f64, (pixel / view.viewport[0] as usize) as f64);
    let forward = DVec3::from(view.forward).normalize();
    let right = forward.cross(DVec3::from(view.up)).normalize();
    let up = right.cross(forward);
    let half = (0.5 * view.vertical_fov).tan();
    let across = (2.0 * (x + 0.5) / width - 1.0) * half * width / height;
    let ray = (forward + right * across + up * (1.0 - 2.0 * (y + 0.5) / height) * half).normalize();
    let position = DVec3::from(view.position);
    let along = -position.dot(ray);
    along > 0.0 && position.length_squared() - along * along < ball * ball
}
