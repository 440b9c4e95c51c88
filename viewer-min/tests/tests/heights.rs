//! Files of heights: checks pass on planes, coasts and globes and find planted faults; the program draws them.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU32, Ordering},
    },
};

use glam::DVec3;
use lodpack::{
    File, Limits, View,
    heights::Heights,
    index::{Placement, UpAxis},
    join_ground,
};
use lodpack_cli::{
    heights::{HeightsOptions, build},
    import::raster::{HeightSource, RasterOptions, SurfaceKind},
    job::{BuildOptions, build as build_mesh},
    mesh::Mesh,
    mesh::tolerance::Tolerance,
    pipeline::{ColourQuality, ModelOptions},
    progress::Silent,
};
use lodpack_tests::{
    generate::{save_ply, torus},
    terrain::{Fractal, Grid},
};
use lodpack_view::{
    check::{Fault, Options, Outcome, check, fly},
    picture::{BACKGROUND, load},
};

use crate::{folder, has_gpu, program};

/// A file of fractal terrain, with the cells that `is_there` names.
fn terrain(name: &str, grid: &Grid, surface: SurfaceKind, is_there: impl Fn(u32, u32) -> bool) -> PathBuf {
    terrain_with(name, grid, RasterOptions { surface, ..RasterOptions::default() }, is_there)
}

fn terrain_with(name: &str, grid: &Grid, options: RasterOptions, is_there: impl Fn(u32, u32) -> bool) -> PathBuf {
    // Several tests draw the same terrain at the same time.
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let folder = folder(&format!("heights-{name}-{}", COUNT.fetch_add(1, Ordering::Relaxed)));
    let (raster, out) = (folder.join("dem.tif"), folder.join("dem.lodpack"));
    let fractal = Fractal::of_samples(5, grid.size[0].max(grid.size[1]));
    let fill = |row: u32, heights: &mut [f32]| {
        match options.surface {
            SurfaceKind::Plane => fractal.flat_row(grid.size, row, 0, heights),
            _ => fractal.globe_row(grid.size, row, 0, heights),
        }
        for (column, height) in (0..).zip(heights) {
            if !is_there(column, row) {
                *height = f32::NAN;
            }
        }
    };
    grid.write(&mut std::fs::File::create(&raster).unwrap(), fill).unwrap();
    let source = HeightSource::open(&[raster], &options, &Silent).unwrap().unwrap();
    let options = HeightsOptions {
        tolerance: Tolerance::InputUnits(2.0),
        memory: 1 << 30,
        folder: std::env::temp_dir(),
        colour_quality: ColourQuality::Auto,
    };
    build(&source, &options, &mut std::fs::File::create(&out).unwrap(), &Silent).unwrap();
    out
}

pub(crate) fn flat() -> PathBuf {
    terrain("flat", &Grid::utm([300, 173]), SurfaceKind::Plane, |_, _| true)
}

fn globe() -> PathBuf {
    terrain("globe", &Grid::globe([256, 129]), SurfaceKind::Wgs84, |_, _| true)
}

fn checked(path: &PathBuf, views: usize, fault: Option<Fault>) -> Outcome {
    let source = Arc::new(std::fs::read(path).unwrap());
    check(source, None, &Options { views, size_px: 120, difference: None, fault }).unwrap()
}

#[test]
fn terrain_is_drawn_correctly() {
    if !has_gpu() {
        return;
    }
    let island = |column: u32, row: u32| (column.abs_diff(150).pow(2) + row.abs_diff(80).pow(2)) / 400 % 9 < 6;
    let coast = terrain("coast", &Grid::utm([300, 173]), SurfaceKind::Plane, island);
    for (name, path) in [("flat", flat()), ("globe", globe()), ("coast", coast)] {
        let outcome = checked(&path, 30, None);
        println!("{name}: {:#?}", outcome.lines);
        assert!(outcome.failures.is_empty(), "{name}");
    }
}

#[test]
fn a_shifted_tile_and_an_error_that_is_too_small_are_found() {
    if !has_gpu() {
        return;
    }
    let path = flat();
    // The first tiles below the root have numbers from 1.
    let shifted = checked(&path, 30, Some(Fault::ShiftedBorder(2, DVec3::new(0.0, 0.0, 40.0))));
    assert!(shifted.failures.iter().any(|failure| failure.starts_with("cracks")), "{:?}", shifted.lines);
    // Which tiles are drawn coarsely depends on the views.
    let is_found = |number: u32| {
        let less = checked(&path, 30, Some(Fault::LessError(number, 1e-3)));
        less.failures.iter().any(|failure| failure.starts_with("error"))
    };
    assert!((0..12).any(is_found));
}

#[test]
fn the_program_draws_heights_with_z_up() {
    if !has_gpu() {
        return;
    }
    for (path, name) in [(flat(), "flat"), (globe(), "globe")] {
        let out = folder(&format!("heights-picture-{name}")).join("picture.png");
        let arguments = [path.to_str().unwrap(), "--size", "300x200", "--screenshot", out.to_str().unwrap()];
        for more in [&["--overlay", "levels,wire,text"][..], &["--overlay", "errors"], &["--path", "circle:20"], &[]] {
            let output = program(&[&arguments[..], more].concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        let picture = load(&out).unwrap();
        let covered = picture.pixels().filter(|&&colour| colour != BACKGROUND).count();
        assert!((0.05..0.9).contains(&(covered as f64 / picture.pixels().len() as f64)), "{covered}");
        for wrong in [["--channel", "paint"], ["--tile", "0,0/2x2"]] {
            let output = program(&[&arguments[..], &wrong].concat());
            assert_eq!(output.status.code(), Some(2), "{wrong:?}");
        }
    }
}

/// A file whose requests take as long as those of a server.
struct Far(Vec<u8>);

impl lodpack::ReadAt for Far {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> std::io::Result<()> {
        std::thread::sleep(std::time::Duration::from_millis(30));
        self.0.as_slice().read_at(offset, buf)
    }

    fn size(&self) -> std::io::Result<u64> {
        Ok(self.0.len() as u64)
    }
}

/// Down from far away, low around the globe over both poles and twice across the date line, and away again.
fn global_flight(frames: usize, size_px: u32) -> Vec<View> {
    const RADIUS: f64 = 6_378_137.0;
    let view = |frame: usize| {
        let share = frame as f64 / frames as f64;
        let angle = share * std::f64::consts::TAU;
        // A great circle through the poles that turns a little, so that it crosses the date line elsewhere.
        let around = |angle: f64| {
            let turn = 3.0 + 0.3 * angle;
            DVec3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos())
        };
        // Near the ground in the middle of the flight.
        let height = RADIUS * (0.01 + 2.0 * (2.0 * share - 1.0).abs().powi(3));
        let (here, ahead) = (around(angle), around(angle + 0.05));
        let position = here * (RADIUS + height);
        let forward = (ahead * RADIUS - position).normalize();
        View {
            position: position.into(),
            forward: forward.into(),
            up: here.into(),
            viewport: [size_px; 2],
            near: 0.1 * height,
            ..View::default()
        }
    };
    (0..frames).map(view).collect()
}

#[test]
fn a_flight_around_the_globe_shows_no_crack_and_no_frame_without_a_surface() {
    if !has_gpu() {
        return;
    }
    let path = terrain("flight", &Grid::globe([1024, 513]), SurfaceKind::Wgs84, |_, _| true);
    // The coarsest tiles are chords of 2.8 degrees, which lie 2 km below the ellipsoid, and no sea is deeper than 7 km.
    let ball = 6_356_752.0 - 20_000.0;
    for (name, source) in [("near", None), ("far", Some(()))] {
        let bytes = std::fs::read(&path).unwrap();
        let source: lodpack_view::surface::Source = match source {
            None => Arc::new(bytes),
            Some(()) => Arc::new(Far(bytes)),
        };
        let flight = fly(source, &global_flight(240, 160), ball).unwrap();
        println!("{name}: {flight:?}");
        assert_eq!((flight.cracks, flight.bare), (0, 0), "{name}: {flight:?}");
        assert!(flight.problems.is_empty() && flight.frames == 240, "{name}: {flight:?}");
        assert!(flight.covered > 240 * 160 * 160 / 8 && flight.most_triangles > 5_000, "{name}: {flight:?}");
        // Nothing can be shown before the first answer.
        assert!(flight.empty_frames < 30, "{name}: {flight:?}");
    }
}

/// The mean difference of two pictures, of 255.
fn difference(a: &image::RgbaImage, b: &image::RgbaImage) -> f64 {
    let sum: u64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.as_raw().len() as f64
}

#[test]
fn few_triangles_are_lit_as_many() {
    if !has_gpu() {
        return;
    }
    for (name, path) in [("flat", flat()), ("globe", globe())] {
        let folder = folder(&format!("heights-light-{name}"));
        let picture = |more: &[&str]| {
            let out = folder.join("picture.png");
            let arguments = [path.to_str().unwrap(), "--size", "300x200", "--screenshot", out.to_str().unwrap()];
            let output = program(&[&arguments[..], more].concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            load(&out).unwrap()
        };
        let best = picture(&["--tolerance", "0.1"]);
        let lit = difference(&picture(&["--tolerance", "1.5"]), &best);
        let facets = difference(&picture(&["--tolerance", "1.5", "--channel", "none"]), &best);
        println!("{name}: {lit:.2} from the picture of all triangles, {facets:.2} with facets");
        assert!(lit < 0.7 * facets, "{name}: {lit} {facets}");
    }
}

#[test]
fn a_ramp_colours_the_picture() {
    if !has_gpu() {
        return;
    }
    let options = RasterOptions { ramp: "viridis".parse().ok(), ..RasterOptions::default() };
    let path = terrain_with("ramp", &Grid::utm([300, 173]), options, |_, _| true);
    let out = folder("heights-ramp-picture").join("picture.png");
    let arguments = [path.to_str().unwrap(), "--size", "300x200", "--screenshot", out.to_str().unwrap(), "--unlit"];
    let output = program(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let stops: [[f64; 3]; 6] = [
        [68.0, 1.0, 84.0],
        [65.0, 68.0, 135.0],
        [42.0, 120.0, 142.0],
        [34.0, 168.0, 132.0],
        [122.0, 209.0, 81.0],
        [253.0, 231.0, 37.0],
    ];
    let away = |colour: [f64; 3]| {
        let to = |pair: &[[f64; 3]]| {
            let way: Vec<f64> = (0..3).map(|k| pair[1][k] - pair[0][k]).collect();
            let along: f64 = (0..3).map(|k| (colour[k] - pair[0][k]) * way[k]).sum();
            let share = (along / way.iter().map(|x| x * x).sum::<f64>()).clamp(0.0, 1.0);
            (0..3).map(|k| (colour[k] - pair[0][k] - share * way[k]).powi(2)).sum::<f64>().sqrt()
        };
        stops.windows(2).map(to).fold(f64::INFINITY, f64::min)
    };
    let picture = load(&out).unwrap();
    let (mut count, mut mixed, mut greens) = (0, 0, std::collections::HashSet::new());
    for pixel in picture.pixels().filter(|&&colour| colour != BACKGROUND) {
        let [red, green, blue] = [0, 1, 2].map(|k| f64::from(pixel.0[k]));
        // Colours are mixed as light is, so they lie a little beside the lines between the stops; bare ground is 100
        // away.
        mixed += u32::from(away([red, green, blue]) >= 40.0);
        greens.insert(pixel.0[1]);
        count += 1;
    }
    assert!(count > 1000 && greens.len() > 40, "{count} {}", greens.len());
    // Smooth edges are mixed with the background.
    assert!(mixed < count / 10, "{mixed} of {count}");
}

/// The file of a mesh that says where it is.
pub(crate) fn placed(mesh: &Mesh, placement: Placement) -> Vec<u8> {
    let path = folder("heights-placed").join("mesh.ply");
    save_ply(mesh, &path).unwrap();
    let model = ModelOptions { placement: Some(placement), ..ModelOptions::default() };
    let options = BuildOptions { inputs: vec![path], model, ..BuildOptions::default() };
    let mut bytes = vec![];
    build_mesh(&options, &mut bytes, &Silent).unwrap();
    bytes
}

#[test]
fn a_mesh_and_its_ground_share_a_depth_buffer() {
    if !has_gpu() {
        return;
    }
    let heights = Heights::open(std::fs::read(flat()).unwrap(), Limits::default()).unwrap();
    // A ring that is half in the ground and half above it, in kilometres around a sample of it, with y up: the ground
    // has to be turned, scaled and moved to it.
    let (sample, surface) = ([150_u64, 86], heights.surface());
    let [x, y] = [0, 1].map(|k| surface.first[k] + surface.spacing[k] * sample[k] as f64);
    let height = heights.window(sample[0]..sample[0] + 1, sample[1]..sample[1] + 1).unwrap()[0];
    let placement = Placement { up: UpAxis::Y, unit: Some(1000.0), origin: [x, y, height], crs: String::new() };
    let file = placed(&torus(24), placement);
    let surface = File::open(file, Limits::default()).unwrap();
    let mut both = vec![];
    join_ground(&surface, &heights, &mut both).unwrap();
    let options = Options { views: 8, size_px: 120, difference: None, fault: None };
    let outcome = check(Arc::new(both.clone()), None, &options).unwrap();
    assert!(outcome.failures.is_empty(), "{:#?}", outcome.lines);
    let hidden = outcome.lines.iter().find(|line| line.contains("hides its ground")).expect("both are compared");
    let counts: Vec<u32> = hidden.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(counts.len() == 2 && counts.iter().all(|&count| count > 10), "each hides the other somewhere: {hidden}");
    // Tiles of such a picture join to it.
    let folder = folder("ground-tiles");
    let [path, out] = ["both.lodpack", "joined.png"].map(|name| folder.join(name).to_str().unwrap().to_owned());
    std::fs::write(&path, both).unwrap();
    for camera in ["3,3,3:0,0,0:0,1,0", "0.5,1.5,2.5:0,0,0:0,1,0"] {
        let output = program(&[&path, "--screenshot", &out, "--size", "320x256", "--tiles", "2x2", "--camera", camera]);
        assert!(output.status.success(), "{output:?}");
        let picture = load(Path::new(&out)).unwrap();
        let covered = picture.pixels().filter(|&&pixel| pixel != BACKGROUND).count();
        assert!(covered > 10_000, "{covered}");
    }
}
