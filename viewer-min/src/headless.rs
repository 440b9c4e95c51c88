//! Pictures without a window: one camera, a path, a tile, or all tiles.

use std::{
    io::Write,
    path::{Path, PathBuf},
    process::Command,
    sync::Arc,
    time::Instant,
};

use anyhow::{Context, Result, bail};
use image::{RgbaImage, imageops};
use lodpack::{View, stream::Mode};
use serde::Serialize;

use crate::{
    args::{Args, Overlay, Size},
    controls::Controls,
    devices::Devices,
    draw::Renderer,
    frames::Frames,
    gpu::{Gpu, Targets},
    overlay::Panel,
    picture::{different_colours, is_numbered, load, marked, numbered, save},
    report::{Report, milliseconds},
    scene::{Scene, open_source},
    shot::Shot,
    surface::Looks,
};

/// Opens the files of the command line.
///
/// # Errors
/// If there is none; as [`open_at`].
pub(crate) fn open_scene(args: &Args, mode: Mode) -> Result<Scene> {
    open_at(&args.files, args, mode)
}

/// Opens files that are drawn into one picture, with what the command line says of looks, channels and objects.
///
/// # Errors
/// If a file cannot be opened or placed, or the first one does not have these.
pub(crate) fn open_at(addresses: &[String], args: &Args, mode: Mode) -> Result<Scene> {
    let looks = Looks { mode, is_flat: args.flat, ..Looks::default() };
    let (first, others) = addresses.split_first().context("no file given: lodpack-view FILE; see --help")?;
    let mut scene =
        open_source(first).and_then(|source| Scene::open_with(source, looks)).with_context(|| first.clone())?;
    for other in others {
        open_source(other).and_then(|source| scene.add(source, looks)).with_context(|| other.clone())?;
    }
    let choose = |scene: &mut Scene| -> Result<()> {
        scene.limit(args);
        scene.choose_channel(args)?;
        scene.first.choose_objects(args)
    };
    choose(&mut scene).with_context(|| first.clone())?;
    Ok(scene)
}

/// Writes a row for each frame, where the command line says.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write_table<T: Serialize>(args: &Args, frames: &[T]) -> Result<()> {
    let Some(path) = &args.csv else { return Ok(()) };
    let mut table = csv::Writer::from_writer(Vec::new());
    frames.iter().try_for_each(|frame| table.serialize(frame))?;
    let table = table.into_inner()?;
    if path == Path::new("-") {
        return Ok(std::io::stdout().write_all(&table)?);
    }
    std::fs::write(path, table).with_context(|| format!("{} cannot be written", path.display()))
}

/// Draws the camera or path of the command line; writes the last picture and the table of frames.
pub fn draw_picture(args: &Args) -> Result<()> {
    let waits = args.wait || args.path.is_none();
    let mode = if waits { Mode::Synchronous } else { Mode::AsynchronousWithPrefetch };
    let mut scene = open_scene(args, mode)?;
    scene.selected().into_iter().for_each(|selected| eprintln!("lodpack-view: {}", selected.text));
    if args.devices > 1 {
        return draw_with_devices(args, scene, waits);
    }
    let mut path = args.views(scene.first_extent()?)?;
    let gpu = Arc::new(Gpu::headless()?);
    let mut renderer = Renderer::new(&gpu, args.way());
    let (mut size, mut tile_nodes) = (args.size, None);
    if let Some(tile @ [_, counts]) = args.tile {
        let (view, nodes) = scene.first.tile(&path[0], tile)?;
        (path, tile_nodes) = (vec![view], Some((nodes, path[0])));
        size = [0, 1].map(|k| args.size[k] / counts[k]);
    }
    let targets = Targets::smooth(&gpu, size);
    let mut frames = Frames::new(&gpu, args.in_flight.into());
    let mut controls = Controls::of(args);
    let mut reports: Vec<Report> = Vec::with_capacity(path.len());
    for (number, view) in path.iter().enumerate() {
        let (begun, wait_ms) = (Instant::now(), frames.begin()?);
        let drawn = frames.take_drawn();
        drawn.iter().for_each(|report| controls.record(report));
        reports.extend(drawn);
        let view = &View { pixel_tolerance: controls.limit(&mut scene), ..*view };
        let mut report = match &tile_nodes {
            Some((nodes, whole)) => scene.show_tile(nodes, whole, true)?,
            None if waits => scene.follow_to_the_end(view)?,
            None => scene.follow(view)?,
        };
        if let Some(complaint) = report.complaint().filter(|_| !controls.wants_speed()) {
            bail!("{complaint}");
        }
        (report.frame, report.wait_ms) = (number, report.wait_ms + wait_ms);
        renderer.draw_scene(&targets, &scene, (view, &args.overlay, args.unlit), &mut report)?;
        let problems = scene.take_problems().into_iter().chain(renderer.take_problems());
        problems.for_each(|problem| eprintln!("lodpack-view: {problem}"));
        report.frame_ms = milliseconds(begun.elapsed());
        frames.end(report)?;
        if let Some(path) = args.screenshot.as_ref().filter(|path| is_numbered(path)) {
            save(targets.colours(&gpu)?, &numbered(path, number as u64 + 1))?;
        }
    }
    frames.finish()?;
    reports.extend(frames.take_drawn());
    let mut panel = Panel::default();
    reports.iter().for_each(|report| panel.record(report.frame_ms));
    controls.costs().iter().for_each(|costs| eprintln!("lodpack-view: {costs}"));
    let report = reports.last().copied().unwrap_or_default();
    let single = args.screenshot.as_ref().filter(|path| !is_numbered(path));
    if let (Some(file), Some(view)) = (single, path.last()) {
        let mut picture = targets.colours(&gpu)?;
        if args.has(Overlay::Text) {
            let mut canvas = RgbaImage::new(size[0], size[1]);
            panel.draw(&mut canvas, &scene, (view, args.way()), &report, "");
            imageops::overlay(&mut picture, &canvas, 0, 0);
        }
        save(picture, file)?;
    }
    if args.csv.is_none() {
        eprintln!("{} triangles, {} nodes, {:.2} pixels", report.triangles, report.nodes, report.error_px);
    }
    write_table(args, &reports)
}

/// As [`draw_picture`], with several devices.
fn draw_with_devices(args: &Args, mut scene: Scene, waits: bool) -> Result<()> {
    if !scene.beside().is_empty() || args.tile.is_some() {
        bail!("several devices draw whole pictures of one thing, not a mesh on its ground, and no tiles");
    }
    let path = args.views(scene.first_extent()?)?;
    let mut devices = Devices::new(args.devices.into(), args.cuts, args.size, args.way())?;
    let mut reports = Vec::with_capacity(path.len());
    for (number, view) in path.iter().enumerate() {
        let begun = Instant::now();
        let report = if waits { scene.follow_to_the_end(view)? } else { scene.follow(view)? };
        let mut report = Report { frame: number, ..report };
        let picture = devices.draw(&Shot::of(&scene.first, *view, &args.overlay, args.unlit), &mut report)?;
        let problems = scene.take_problems().into_iter().chain(devices.take_problems());
        problems.for_each(|problem| eprintln!("lodpack-view: {problem}"));
        report.frame_ms = milliseconds(begun.elapsed());
        reports.push(report);
        let is_last = number + 1 == path.len();
        let wanted = |path: &&PathBuf| is_last || is_numbered(path);
        if let Some(path) = args.screenshot.as_ref().filter(wanted) {
            save(picture, &numbered(path, number as u64 + 1))?;
        }
    }
    write_table(args, &reports)
}

/// Share of the pixels that may differ where tiles are joined.
const TILE_DIFFERENCE: f64 = 0.001;
/// Levels of 255 that rounding may change, because a tile's pixels are counted from another corner.
const ROUNDING: u8 = 2;

/// Draws all tiles, one process each, joins them, and compares them with the whole picture. Returns whether they agree.
pub fn draw_tiles(args: &Args, [columns, rows]: Size) -> Result<bool> {
    let out = args.screenshot.clone().unwrap_or_else(|| PathBuf::from("tiles.png"));
    let name = |label: &str| out.with_extension(format!("{label}.png"));
    let program = std::env::current_exe()?;
    // The last of repeated options counts.
    let start = |option: &str, value: &str, to: &Path| {
        let mut command = Command::new(&program);
        command.args(std::env::args().skip(1)).args([option, value, "--screenshot"]).arg(to);
        command.spawn().context("cannot start a process")
    };
    let whole_path = name("whole");
    let mut running = vec![(start("--tiles", "1x1", &whole_path)?, None)];
    for [x, y] in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
        let path = name(&format!("{x}-{y}"));
        running.push((start("--tile", &format!("{x},{y}/{columns}x{rows}"), &path)?, Some((path, [x, y]))));
    }
    let mut joined = RgbaImage::new(args.size[0], args.size[1]);
    for (mut process, tile) in running {
        if !process.wait()?.success() {
            bail!("a tile could not be drawn");
        }
        let Some((path, [x, y])) = tile else { continue };
        let part = load(&path)?;
        imageops::replace(&mut joined, &part, (x * part.width()).into(), (y * part.height()).into());
        std::fs::remove_file(&path)?;
    }
    let whole = load(&whole_path)?;
    let touched = different_colours(&joined, &whole, 0);
    let different_count = different_colours(&joined, &whole, ROUNDING).len();
    if touched.is_empty() {
        std::fs::remove_file(&whole_path)?;
    } else {
        save(marked(&joined, &touched), &name("difference"))?;
    }
    save(joined, &out)?;
    let (touched_count, all) = (touched.len(), whole.pixels().len());
    println!("{touched_count} of {all} pixels differ, {different_count} of them by more than {ROUNDING} of 255 levels");
    Ok(different_count as f64 <= TILE_DIFFERENCE * all as f64)
}
