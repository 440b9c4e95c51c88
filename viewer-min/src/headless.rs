//! Pictures without a window: one camera, a path, a tile, or all tiles.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::Arc,
};

use anyhow::{Context, Result, bail};
use lodpack::session::Mode;

use crate::{
    args::{Args, Overlay, Size},
    camera::Frame,
    draw::Renderer,
    gpu::{Gpu, Targets},
    overlay::{Canvas, Panel},
    picture::Picture,
    scene::{Report, Scene, open_source},
};

/// Draws the camera or path that is typed; writes the last picture and the table of frames.
///
/// # Errors
/// Where something cannot be read, drawn or written.
pub fn draw_picture(args: &Args) -> Result<()> {
    let place = args.file.as_deref().context("which file? lodpack-view FILE; --help says more")?;
    let waits = args.wait || args.path.is_none();
    let mode = if waits { Mode::Synchronous } else { Mode::AsynchronousWithPrefetch };
    let mut scene = Scene::open(open_source(place)?, mode).with_context(|| place.to_string())?;
    scene.limit(args);
    let path = args.cameras(scene.bounds)?;
    let gpu = Arc::new(Gpu::headless()?);
    let mut renderer = Renderer::new(&gpu, args.way());
    let (mut frame, mut tile_nodes) = (Frame::whole(args.size), None);
    if let Some(tile) = args.tile {
        let (part, nodes) = scene.tile(&path[0], args.size, tile)?;
        (frame, tile_nodes) = (part, Some(nodes));
    }
    let targets = Targets::new(&gpu, frame.size);
    let mut table = csv::Writer::from_writer(Vec::new());
    let (mut panel, mut report) = (Panel::default(), Report::default());
    for (number, camera) in path.iter().enumerate() {
        report = match &tile_nodes {
            Some(nodes) => scene.show(nodes, &[])?,
            None => scene.follow(camera, frame)?,
        };
        report.frame = number;
        renderer.draw_scene(&targets, &scene, &scene.look(*camera, frame, &args.overlay), &mut report)?;
        scene.take_problems().iter().for_each(|problem| eprintln!("lodpack-view: {problem}"));
        panel.record(report.select_ms + report.update_ms + report.upload_ms + report.draw_ms);
        table.serialize(report)?;
    }
    if let Some(path) = &args.screenshot {
        let mut picture = targets.read(&gpu)?;
        if args.has(Overlay::Text) {
            let mut canvas = Canvas::new(frame.size);
            panel.draw(&mut canvas, &scene, &report, args.way(), "");
            canvas.put_over(&mut picture);
        }
        picture.save(path)?;
    }
    let table = String::from_utf8(table.into_inner()?)?;
    match &args.csv {
        Some(path) if path == Path::new("-") => print!("{table}"),
        Some(path) => std::fs::write(path, table).with_context(|| format!("{} cannot be written", path.display()))?,
        None => eprintln!("{} triangles, {} nodes, {:.2} pixels", report.triangles, report.nodes, report.error_px),
    }
    Ok(())
}

/// Pixels that may differ where tiles are joined, as a part of all.
const TILE_DIFFERENCE: f64 = 0.001;
/// Levels of 255 that rounding makes: a tile's pixels are counted from another corner.
const ROUNDING: u8 = 2;

/// Draws all tiles, one process each, joins them, and compares with the picture drawn at once. Says whether these agree.
///
/// # Errors
/// Where a tile cannot be drawn.
pub fn draw_tiles(args: &Args, [columns, rows]: Size) -> Result<bool> {
    let out = args.screenshot.clone().unwrap_or_else(|| PathBuf::from("tiles.png"));
    let name = |label: &str| out.with_extension(format!("{label}.png"));
    let program = std::env::current_exe()?;
    // What is typed last holds.
    let start = |option: &str, value: &str, to: &Path| {
        let mut command = Command::new(&program);
        command.args(std::env::args().skip(1)).args([option, value, "--screenshot"]).arg(to);
        command.spawn().context("no process")
    };
    let whole_path = name("whole");
    let mut running = vec![(start("--tiles", "1x1", &whole_path)?, None)];
    for [x, y] in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
        let path = name(&format!("{x}-{y}"));
        running.push((start("--tile", &format!("{x},{y}/{columns}x{rows}"), &path)?, Some((path, [x, y]))));
    }
    let mut joined = Picture::empty(args.size);
    for (mut process, tile) in running {
        if !process.wait()?.success() {
            bail!("a tile could not be drawn");
        }
        let Some((path, [x, y])) = tile else { continue };
        let part = Picture::load(&path)?;
        joined.insert(&part, [x * part.size[0], y * part.size[1]]);
        std::fs::remove_file(&path)?;
    }
    let whole = Picture::load(&whole_path)?;
    let [touched, different] = [0, ROUNDING].map(|levels| joined.different_colours(&whole, levels));
    let [touched_count, different_count, all] = [touched.len(), different.len(), joined.colours.len()];
    joined.save(&out)?;
    if touched.is_empty() {
        std::fs::remove_file(&whole_path)?;
    } else {
        joined.marked(&touched).save(&name("difference"))?;
    }
    println!("{touched_count} of {all} pixels differ, {different_count} of them by more than {ROUNDING} of 255 levels");
    Ok(different_count as f64 <= TILE_DIFFERENCE * all as f64)
}
