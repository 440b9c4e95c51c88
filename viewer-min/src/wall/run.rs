//! Both programs of a wall, without windows.

use std::{sync::Arc, time::Duration};

use anyhow::{Context, Result};
use lodpack::{Query, select::Coherence, stream::Mode};

use super::{
    controller::{Adapted, Controller},
    display::{Display, Wanted},
};
use crate::{
    args::{Args, Size},
    draw::Renderer,
    gpu::{Gpu, Targets},
    headless::{open_scene, write_table},
    picture::{numbered, save},
    scene::Scene,
    surface::STILL,
};

/// How long the controller sleeps while displays are missing.
const WAIT: Duration = Duration::from_millis(50);

fn open(args: &Args) -> Result<Scene> {
    open_scene(args, if args.wait { Mode::Synchronous } else { Mode::Asynchronous })
}

/// The controller of a wall that shows a scene, which listens already.
pub(super) fn controller_of(args: &Args, scene: &Scene, counts: Size, address: &str) -> Result<Controller> {
    let file = &scene.first.mesh().context("walls show meshes")?.file;
    let known = (file.hierarchy()?, file.index().id().numbers());
    let (wall, at) = Controller::listen(address, known, counts, args.size)?;
    eprintln!("lodpack-view: listening at {at}");
    Ok(wall)
}

/// A display of the wall at an address, which shows the same.
pub(super) fn display_of(args: &Args, scene: &Scene, address: &str) -> Result<Display> {
    let file = scene.first.mesh().context("walls show meshes")?.file.index().id().numbers();
    Display::join(address, file, args.place)
}

/// Controls a wall: waits for all its displays, then sends them along the path of the command line. Writes a table of
/// frames.
///
/// # Errors
/// If the file or the address cannot be opened.
pub fn control_wall(args: &Args, counts: Size, address: &str) -> Result<()> {
    let scene = open(args)?;
    let path = args.views(scene.first_extent()?)?;
    let coherence = if args.wait { STILL } else { Coherence::default() };
    let mut wall = controller_of(args, &scene, counts, address)?;
    while wall.display_count() < (counts[0] * counts[1]) as usize {
        wall.seat(WAIT);
    }
    let mut reports = Vec::with_capacity(path.len());
    let mut adapted: Option<Adapted> = None;
    for view in path.iter().map(Some).chain([None]) {
        wall.seat(Duration::ZERO);
        if let Some(frame) = &adapted {
            wall.draw(frame);
        }
        // Beside the displays, which draw the frame before.
        let next = view.map(|view| wall.adapt(&Query { view: Some(*view), ..scene.first.query.clone() }, coherence));
        if adapted.is_some() {
            reports.push(wall.show());
        }
        adapted = next.transpose()?;
    }
    wall.end();
    write_table(args, &reports)
}

/// Is a display of the wall at an address until that ends. Writes pictures, if it is asked for some.
///
/// # Errors
/// If the file cannot be opened, there is no such wall, it does not want this display, or it goes away.
pub fn join_wall(args: &Args, address: &str) -> Result<()> {
    let mut scene = open(args)?;
    let mut display = display_of(args, &scene, address)?;
    eprintln!("lodpack-view: display {},{} of the wall at {address}", display.place[0], display.place[1]);
    let gpu = Arc::new(Gpu::headless()?);
    let mut renderer = Renderer::new(&gpu, args.way());
    let targets = Targets::smooth(&gpu, display.size);
    loop {
        match display.next(&mut scene, args.wait)? {
            Wanted::Frame(mut frame) => {
                let look = (&frame.view, &*args.overlay, args.unlit);
                renderer.draw_scene(&targets, &scene, look, &mut frame.report)?;
                gpu.wait()?;
                let problems = scene.take_problems().into_iter().chain(renderer.take_problems());
                problems.for_each(|problem| eprintln!("lodpack-view: {problem}"));
                display.answer(&frame)?;
            }
            Wanted::Show(number) => {
                if let Some(path) = &args.screenshot {
                    save(targets.colours(&gpu)?, &numbered(path, number))?;
                }
            }
            Wanted::End => return Ok(()),
        }
    }
}
