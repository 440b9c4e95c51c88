//! Pictures without a window: one camera, a path, a tile, or all tiles.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    process::Command,
    sync::Arc,
    time::Instant,
};

use anyhow::{Context, Result, bail};
use lodpack::session::Mode;

use crate::{
    args::Args,
    blocks::Triangles,
    camera::{self, Camera, Frame},
    draw::Renderer,
    gpu::{Gpu, Targets},
    overlay::{Canvas, Panel},
    picture::Picture,
    pipelines::Pipelines,
    scene::{Budget, Report, Scene, milliseconds},
    source::open_source,
};

/// First line of a table of frames.
pub const CSV_HEAD: &str = "frame,select_ms,fetch_ms,decode_ms,update_ms,upload_ms,draw_ms,nodes,triangles,bytes,stalls,late,error_px,surface\n";

/// Appends a frame to a table.
pub fn csv_line(table: &mut String, number: usize, report: &Report) {
    let Report { select, fetch, decode, update, upload, draw, nodes, triangles, bytes, stalls, late, error_px, .. } =
        report;
    let surface = u8::from(report.shows_surface);
    let _ = writeln!(
        table,
        "{number},{select:.3},{fetch:.3},{decode:.3},{update:.3},{upload:.3},{draw:.3},{nodes},{triangles},{bytes},\
         {stalls},{late},{error_px:.3},{surface}"
    );
}

/// Opens the file that is named, with the budgets that are.
///
/// # Errors
/// Where it cannot be read.
pub fn open_scene(args: &Args, mode: Mode) -> Result<Scene> {
    let place = args.file.as_deref().context("which file? lodpack-view FILE; --help says more")?;
    let mut scene = Scene::open(open_source(place)?, mode).with_context(|| place.to_string())?;
    scene.budget = budget_of(args);
    Ok(scene)
}

/// The budgets that are typed.
pub fn budget_of(args: &Args) -> Budget {
    let Args { max_triangles, max_nodes, tolerance, .. } = *args;
    Budget { tolerance_px: tolerance, max_triangles, max_nodes, keeps_all: false }
}

/// The camera that is typed, or one that sees everything.
///
/// # Errors
/// Where what is typed is no camera.
pub fn first_camera(args: &Args, bounds: [[f64; 3]; 2]) -> Result<Camera> {
    let default = Camera::around(bounds, args.up(), 0.5, 0.25);
    args.camera.as_ref().map_or(Ok(default), |text| Camera::parse(text, &default))
}

fn path_of(args: &Args, bounds: [[f64; 3]; 2]) -> Result<Vec<Camera>> {
    let first = first_camera(args, bounds)?;
    let Some(path) = &args.path else { return Ok(vec![first]) };
    if let Some(count) = path.strip_prefix("circle:") {
        let count = count
            .parse()
            .ok()
            .filter(|&n| (1..=1_000_000).contains(&n))
            .context("circle:N needs a number of frames")?;
        return Ok(camera::circling(bounds, args.up(), count));
    }
    let text = std::fs::read_to_string(path).with_context(|| format!("{path} cannot be read"))?;
    camera::path_from_json(&text, &first).with_context(|| path.clone())
}

/// Draws the camera or path that is typed; writes the last picture and the table.
///
/// # Errors
/// Where something cannot be read, drawn or written.
pub fn draw(args: &Args) -> Result<()> {
    let waits = args.wait || args.path.is_none();
    let mode = if waits { Mode::Synchronous } else { Mode::AsynchronousWithPrefetch };
    let mut scene = open_scene(args, mode)?;
    let path = path_of(args, scene.bounds)?;
    let gpu = Gpu::headless()?;
    let (style, has_text) = args.style();
    let mut renderer = Renderer::new(&gpu, &Arc::new(Pipelines::new(&gpu)), args.way());
    let (mut frame, mut tile_nodes) = (Frame::whole(args.size), None);
    if let Some([at, counts]) = args.tile {
        let camera = path.first().context("a tile needs a camera")?;
        let (part, nodes) = scene.tile(camera, args.size, at, counts)?;
        (frame, tile_nodes) = (part, Some(nodes));
    }
    let targets = Targets::new(&gpu, frame.size);
    let mut table = CSV_HEAD.to_string();
    let (mut panel, mut shown) = (Panel::default(), Report::default());
    for (number, camera) in path.iter().enumerate() {
        let mut report = match &tile_nodes {
            Some(nodes) => scene.show(nodes, &[])?,
            None => scene.follow(camera, frame)?,
        };
        let begun = Instant::now();
        upload(&gpu, &mut renderer, &scene);
        gpu.wait()?;
        report.upload = milliseconds(begun);
        let begun = Instant::now();
        renderer.look(&gpu, camera, frame, style, [args.tolerance as f32, scene.level_count() as f32]);
        renderer.draw(&gpu, &targets, frame);
        gpu.wait()?;
        report.draw = milliseconds(begun);
        scene.take_problems().iter().for_each(|problem| eprintln!("lodpack-view: {problem}"));
        panel.record(report.select + report.update + report.upload + report.draw);
        csv_line(&mut table, number, &report);
        shown = report;
    }
    if let Some(path) = &args.screenshot {
        let mut picture = targets.read(&gpu)?;
        if has_text {
            let mut canvas = Canvas::new(frame.size);
            panel.draw(&mut canvas, &scene, &shown, &scene.budget, args.way(), &[]);
            canvas.put_over(&mut picture);
        }
        picture.save(path)?;
    }
    match &args.csv {
        Some(path) if path == Path::new("-") => print!("{table}"),
        Some(path) => std::fs::write(path, table).with_context(|| format!("{} cannot be written", path.display()))?,
        None => eprintln!("{} triangles, {} nodes, {:.2} pixels", shown.triangles, shown.nodes, shown.error_px),
    }
    Ok(())
}

/// Sends what is to be drawn to the GPU.
pub fn upload(gpu: &Gpu, renderer: &mut Renderer, scene: &Scene) {
    match scene.overview() {
        Some(mesh) => renderer.set_mesh(gpu, &Triangles::of_mesh(&mesh.positions, &mesh.triangles)),
        None => renderer.update(gpu, scene.surfaces(), |drawn| scene.error_of(drawn)),
    }
}

/// Pixels that may differ where tiles are joined, as a part of all.
const TILE_DIFFERENCE: f64 = 0.001;

/// Levels of 255 that rounding makes: a tile's pixels are counted from another corner.
const ROUNDING: u8 = 2;

/// Draws all tiles, one process each, joins them, and compares with the picture drawn at once. Says whether these agree.
///
/// # Errors
/// Where a tile cannot be drawn.
pub fn draw_tiles(args: &Args) -> Result<bool> {
    let counts = args.tiles.context("--tiles says how many")?;
    let out = args.screenshot.clone().unwrap_or_else(|| PathBuf::from("tiles.png"));
    let program = std::env::current_exe()?;
    let mut typed: Vec<String> = std::env::args().skip(1).collect();
    drop_option(&mut typed, "--tiles");
    drop_option(&mut typed, "--screenshot");
    let name = |label: &str| out.with_extension(format!("{label}.png"));
    let start = |extra: &[&str], to: &Path| {
        Command::new(&program).args(&typed).args(extra).arg("--screenshot").arg(to).spawn().context("no process")
    };
    let whole_path = name("whole");
    let mut running = vec![(start(&[], &whole_path)?, None)];
    for [x, y] in (0..counts[1]).flat_map(|y| (0..counts[0]).map(move |x| [x, y])) {
        let tile = format!("{x},{y}/{}x{}", counts[0], counts[1]);
        let path = name(&format!("{x}-{y}"));
        running.push((start(&["--tile", &tile], &path)?, Some((path, [x, y]))));
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
    let share = different.len() as f64 / joined.colours.len() as f64;
    joined.save(&out)?;
    if touched.is_empty() {
        std::fs::remove_file(&whole_path)?;
    } else {
        joined.marked(&touched).save(&name("difference"))?;
    }
    let all = joined.colours.len();
    println!(
        "{} of {all} pixels differ, {} of them by more than {ROUNDING} of 255 levels",
        touched.len(),
        different.len()
    );
    Ok(share <= TILE_DIFFERENCE)
}

/// Removes an option with its value.
fn drop_option(typed: &mut Vec<String>, option: &str) {
    if let Some(at) = typed.iter().position(|text| text == option) {
        typed.drain(at..(at + 2).min(typed.len()));
    }
    typed.retain(|text| !text.starts_with(&format!("{option}=")));
}
