//! Files of heights: what they say about the rasters that they were made from holds, on planes and on globes.

use crate::commands::lodpack;
use lodpack::Limits;
use lodpack::heights::{Heights, HeightsQuery};
use lodpack_cli::heights::{HeightsOptions, HeightsSummary, build};
use lodpack_cli::import::raster::{HeightSource, RasterOptions, SurfaceKind};
use lodpack_cli::measure::heights::{HeightsChecks, verify};
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::pipeline::ColourQuality;
use lodpack_cli::progress::Silent;
use lodpack_tests::terrain::{Fractal, Grid};
use std::path::{Path, PathBuf};

/// Builds a file of heights in memory.
pub fn built(path: &Path, raster: &RasterOptions, tolerance: Tolerance, memory: u64) -> (Vec<u8>, HeightsSummary) {
    let source = HeightSource::open(&[path.to_owned()], raster, &Silent).expect("sound").expect("a raster");
    let options =
        HeightsOptions { tolerance, memory, folder: std::env::temp_dir(), colour_quality: ColourQuality::Auto };
    let mut bytes = vec![];
    let summary = build(&source, &options, &mut bytes, &Silent).expect("a sound raster builds");
    (bytes, summary)
}

/// Builds a file and compares it with its raster.
pub fn is_sound(path: &Path, raster: &RasterOptions, tolerance: Tolerance, cuts: u32) -> (Vec<u8>, HeightsSummary) {
    let (bytes, summary) = built(path, raster, tolerance, 1 << 30);
    let source = HeightSource::open(&[path.to_owned()], raster, &Silent).expect("sound").expect("a raster");
    let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
    let report = verify(&file, Some(&source), HeightsChecks { cuts, seed: 7 }, &Silent).expect("readable");
    assert!(report.problems.is_empty(), "{}: {:?}", path.display(), report.problems);
    assert_eq!((report.tiles - report.level_tiles, report.cuts), (summary.tiles, cuts));
    assert!(report.sample_distance.is_some_and(|distance| distance <= summary.sample_error * (1.0 + 1e-9)));
    (bytes, summary)
}

/// Whether rasters cannot become a file of heights.
pub fn is_refused(paths: &[PathBuf], raster: &RasterOptions) -> bool {
    let options = HeightsOptions {
        tolerance: Tolerance::Auto,
        memory: 1 << 30,
        folder: std::env::temp_dir(),
        colour_quality: ColourQuality::Auto,
    };
    match HeightSource::open(paths, raster, &Silent) {
        Ok(Some(source)) => build(&source, &options, &mut vec![], &Silent).is_err(),
        Ok(None) => false,
        Err(_) => true,
    }
}

/// Files for other tests, on a plane and on a globe.
pub fn files() -> Vec<(&'static str, Vec<u8>)> {
    let folder = Folder::new();
    let flat = folder.fractal("flat.tif", &Grid::utm([1025, 769]), false, |_, _| false);
    let globe = folder.fractal("globe.tif", &Grid::globe([1024, 513]), true, |_, _| false);
    let on_globe = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    vec![
        ("heights-flat", built(&flat, &RasterOptions::default(), Tolerance::Metres(1.0), 1 << 30).0),
        ("heights-globe", built(&globe, &on_globe, Tolerance::Metres(5.0), 1 << 30).0),
    ]
}

pub struct Folder(pub tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    /// Writes fractal terrain.
    pub fn fractal(&self, name: &str, grid: &Grid, is_globe: bool, without: impl Fn(u32, u32) -> bool) -> PathBuf {
        let path = self.0.path().join(name);
        let fractal = Fractal::of_samples(5, grid.size[0].max(grid.size[1]));
        let mut file = std::fs::File::create(&path).expect("writable");
        let fill = |row: u32, heights: &mut [f32]| {
            match is_globe {
                true => fractal.globe_row(grid.size, row, 0, heights),
                false => fractal.flat_row(grid.size, row, 0, heights),
            }
            for (column, height) in (0..).zip(heights) {
                if without(column, row) {
                    *height = f32::NAN;
                }
            }
        };
        grid.write(&mut file, fill).expect("writable");
        path
    }
}

#[test]
fn planes_of_any_size_keep_their_promises() {
    let folder = Folder::new();
    for (number, size) in [[2, 2], [65, 65], [129, 64], [300, 173], [517, 3], [2, 400]].into_iter().enumerate() {
        let path = folder.fractal(&format!("{number}.tif"), &Grid::utm(size), false, |_, _| false);
        for tolerance in [Tolerance::Auto, Tolerance::InputUnits(20.0)] {
            is_sound(&path, &RasterOptions::default(), tolerance, 12);
        }
    }
}

#[test]
fn the_coarsest_triangles_of_a_single_tile_are_measured() {
    let folder = Folder::new();
    let path = folder.0.path().join("step.asc");
    let height =
        |c: f64, r: f64| 30.0 * c + if c > 32.0 { 300.0 } else { 0.0 } + 3.0 * (0.3 * c).sin() * (0.2 * r).cos();
    let row = |r: u32| (0..61).map(|c| format!("{:.3} ", height(c.into(), r.into()))).collect::<String>() + "\n";
    let head = "ncols 61\nnrows 61\nxllcorner 0\nyllcorner 0\ncellsize 10\n";
    std::fs::write(&path, head.to_owned() + &(0..61).map(row).collect::<String>()).expect("writable");
    is_sound(&path, &RasterOptions::default(), Tolerance::InputUnits(0.5), 60);
    let path = folder.fractal("globe.tif", &Grid::globe([100, 50]), true, |_, _| false);
    is_sound(&path, &RasterOptions { surface: SurfaceKind::Sphere, ..RasterOptions::default() }, Tolerance::Auto, 40);
}

/// An EXR of one channel without compression, from the layout of its specification.
fn exr(size: [i32; 2], channel: &str, height: impl Fn(i32, i32) -> f32) -> Vec<u8> {
    let [columns, rows] = size;
    let mut out = vec![0x76, 0x2f, 0x31, 1, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        out.extend([name.as_bytes(), &[0], kind.as_bytes(), &[0]].concat());
        out.extend((value.len() as i32).to_le_bytes());
        out.extend(value);
    };
    let ints = |numbers: &[i32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let window = ints(&[0, 0, columns - 1, rows - 1]);
    attribute("channels", "chlist", &[channel.as_bytes(), &[0], &ints(&[2, 0, 1, 1]), &[0]].concat());
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    out.push(0);
    let (first, row_bytes) = (out.len() as u64 + 8 * rows as u64, 4 * columns);
    (0..rows as u64).for_each(|row| out.extend((first + row * (8 + row_bytes as u64)).to_le_bytes()));
    for row in 0..rows {
        out.extend(ints(&[row, row_bytes]));
        out.extend((0..columns).flat_map(|column| height(column, row).to_le_bytes()));
    }
    out
}

#[test]
fn images_of_one_channel_of_floats_are_read() {
    let folder = Folder::new();
    let path = folder.0.path().join("a.exr");
    let height =
        |column: i32, row: i32| if column == 9 { f32::NAN } else { (column * column) as f32 * 0.25 - row as f32 };
    let raster = RasterOptions { spacing: Some(2.0), ..RasterOptions::default() };
    for channel in ["Z", "anything"] {
        let bytes = exr([70, 40], channel, height);
        std::fs::write(&path, &bytes).expect("writable");
        let (file, _) = is_sound(&path, &raster, Tolerance::InputUnits(0.01), 5);
        let file = Heights::open(file.as_slice(), Limits::default()).expect("it was just written");
        let heights = file.window(0..70, 0..40).expect("readable");
        for (at, found) in (0..).zip(heights) {
            let expected = f64::from(height(at % 70, at / 70));
            assert!((found - expected).abs() < 0.0101 || found.is_nan() && expected.is_nan());
        }
        for cut in [9, 100, bytes.len() - 5] {
            std::fs::write(&path, &bytes[..cut]).expect("writable");
            assert!(is_refused(std::slice::from_ref(&path), &raster));
        }
    }
}

#[test]
fn the_height_of_the_origin_is_taken_off() {
    let folder = Folder::new();
    let path = folder.fractal("a.tif", &Grid::utm([70, 70]), false, |_, _| false);
    let lowest = |origin: [f64; 3]| {
        let raster = RasterOptions { origin: Some(origin), ..RasterOptions::default() };
        let (bytes, _) = is_sound(&path, &raster, Tolerance::InputUnits(0.5), 5);
        let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
        let root = file.record(file.roots()[0]).expect("readable").expect("a root");
        file.info().height(root.lowest) + file.placement().expect("a place").origin[2]
    };
    assert!((lowest([500_000.0, 5_190_000.0, 0.0]) - lowest([500_000.0, 5_190_000.0, 1234.5])).abs() <= 1.0);
}

#[test]
fn rows_without_data_cost_no_error_wherever_they_are() {
    let folder = Folder::new();
    let build = |name: &str, is_void: fn(u32) -> bool| {
        let path = folder.fractal(name, &Grid::utm([150, 150]), false, |_, row| is_void(row));
        let (bytes, _) = is_sound(&path, &RasterOptions::default(), Tolerance::InputUnits(0.5), 10);
        let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
        let root = file.record(file.roots()[0]).expect("readable").expect("a root");
        (root.resolutions[0].error, [file.info().height(root.lowest), file.info().height(root.highest)])
    };
    let (_, [lowest, highest]) = build("whole.tif", |_| false);
    let range = highest - lowest;
    for (name, is_void) in [("north.tif", (|row| row < 37) as fn(u32) -> bool), ("south.tif", |row| row >= 113)] {
        let (error, [low, high]) = build(name, is_void);
        assert!(lowest - 1.0 <= low && high <= highest + 1.0 && error < 2.0 * range, "{name}: {error} {low} {high}");
    }
}

#[test]
fn other_rasters_and_lost_terrain_are_noticed() {
    let folder = Folder::new();
    let whole = folder.fractal("whole.tif", &Grid::utm([100, 90]), false, |_, _| false);
    let holes = folder.fractal("holes.tif", &Grid::utm([100, 90]), false, |x, y| x > 30 && x < 50 && y > 20 && y < 60);
    let other = folder.fractal("other.tif", &Grid::utm([90, 100]), false, |_, _| false);
    let raster = RasterOptions::default();
    let (bytes, _) = built(&holes, &raster, Tolerance::Auto, 1 << 30);
    let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
    for (path, kind) in [(&whole, "sample"), (&other, "rasters")] {
        let source =
            HeightSource::open(std::slice::from_ref(path), &raster, &Silent).expect("sound").expect("a raster");
        let report = verify(&file, Some(&source), HeightsChecks { cuts: 2, seed: 7 }, &Silent).expect("readable");
        assert!(report.problems.iter().any(|problem| problem.starts_with(kind)), "{:?}", report.problems);
    }
}

#[test]
fn globes_close_around_and_at_both_poles() {
    let folder = Folder::new();
    let path = folder.fractal("globe.tif", &Grid::globe([300, 150]), true, |_, _| false);
    for surface in [SurfaceKind::Sphere, SurfaceKind::Wgs84] {
        let raster = RasterOptions { surface, ..RasterOptions::default() };
        let (bytes, _) = is_sound(&path, &raster, Tolerance::Auto, 25);
        let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
        assert!(file.grid().wraps() && file.grid().poles() == [true; 2]);
        // Every edge of the closed surface has two triangles: V - E + F = 2.
        let mesh = file.mesh(&file.cut(&HeightsQuery::default()).expect("readable")).expect("readable");
        assert_eq!(2 * mesh.positions.len(), mesh.triangles.len() + 4);
    }
}

#[test]
fn coasts_and_islands_keep_their_promises() {
    let folder = Folder::new();
    let coast = |column: u32, row: u32| {
        let away = f64::from(column) - 180.0 - 40.0 * (f64::from(row) * 0.05).sin();
        away > 0.0 && (column % 61 > 20 || row % 47 > 11) || (column * 7 + row * 13).is_multiple_of(509)
    };
    let path = folder.fractal("coast.tif", &Grid::utm([333, 210]), false, coast);
    is_sound(&path, &RasterOptions::default(), Tolerance::Auto, 25);
    // Roots draw all of their cells, and tiles below them do not.
    let path = folder.fractal("edge.tif", &Grid::utm([129, 129]), false, |column, _| column == 0);
    is_sound(&path, &RasterOptions::default(), Tolerance::Auto, 25);
    let path = folder.fractal("hole.tif", &Grid::utm([257, 200]), false, |x, y| x / 3 == 27 && y / 2 == 50);
    is_sound(&path, &RasterOptions::default(), Tolerance::Auto, 25);
    let path = folder.fractal("islands.tif", &Grid::globe([256, 128]), true, |x, y| (x / 9 + y / 7) % 3 == 0);
    is_sound(&path, &RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() }, Tolerance::Auto, 15);
}

#[test]
fn neither_threads_nor_memory_change_the_bytes() {
    let folder = Folder::new();
    let path = folder.fractal("a.tif", &Grid::utm([700, 650]), false, |x, y| x + y < 90);
    let build = |threads: usize, memory: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| built(&path, &RasterOptions::default(), Tolerance::Auto, memory).0)
    };
    let first = build(1, 1 << 30);
    assert!(first == build(4, 1 << 30) && first == build(3, 1 << 20));
}

#[test]
fn integers_are_kept_exactly() {
    let folder = Folder::new();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain/int-deflate.tif");
    let (_, summary) = is_sound(&path, &RasterOptions::default(), Tolerance::InputUnits(0.0), 10);
    assert_eq!((summary.sample_error, summary.certified_error), (0.0, 0.0));
    // A tolerance that is no integer is as good as the one below it.
    let (_, summary) = is_sound(&path, &RasterOptions::default(), Tolerance::InputUnits(1.7), 10);
    assert_eq!(summary.sample_error, 1.0);
    drop(folder);
}

#[test]
fn a_flat_ocean_with_an_island_costs_less_than_a_hundredth_of_relief() {
    let folder = Folder::new();
    let size = [1024, 512];
    let path = folder.fractal("relief.tif", &Grid::utm(size), false, |_, _| false);
    let raster = RasterOptions::default();
    let relief = built(&path, &raster, Tolerance::InputUnits(1.0), 1 << 30).0.len();
    let flat = folder.0.path().join("flat.tif");
    let mut file = std::fs::File::create(&flat).expect("writable");
    let island = |row: u32, heights: &mut [f32]| {
        for (column, height) in (0..).zip(heights) {
            let away = f64::hypot(f64::from(column) - 300.0, f64::from(row) - 200.0);
            *height = (300.0 - 30.0 * away).max(0.0) as f32;
        }
    };
    Grid::utm(size).write(&mut file, island).expect("writable");
    let ocean = built(&flat, &raster, Tolerance::InputUnits(1.0), 1 << 30).0.len();
    assert!(100 * ocean < relief, "{ocean} of {relief} bytes");
}

#[test]
fn level_sea_around_a_globe_takes_next_to_nothing() {
    let folder = Folder::new();
    let size = [2048, 1025];
    let (grid, fractal) = (Grid::globe(size), Fractal::of_samples(5, size[0]));
    let on_globe = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    let planet = |name: &str, is_land: &dyn Fn(u32, u32) -> bool| {
        let path = folder.0.path().join(name);
        let mut file = std::fs::File::create(&path).expect("writable");
        let fill = |row: u32, heights: &mut [f32]| {
            fractal.globe_row(size, row, 0, heights);
            for (column, height) in (0..).zip(heights) {
                *height = if is_land(column, row) { height.abs() } else { 0.0 };
            }
        };
        grid.write(&mut file, fill).expect("writable");
        let (bytes, summary) = built(&path, &on_globe, Tolerance::Metres(5.0), 1 << 30);
        (path, bytes, summary)
    };
    let (_, relief, _) = planet("relief.tif", &|_, _| true);
    let island = |column: u32, row: u32| f64::from(column.abs_diff(900)).hypot(row.abs_diff(400).into()) < 25.0;
    let (path, bytes, summary) = planet("island.tif", &island);
    assert!(100 * bytes.len() < relief.len(), "{} of {} bytes", bytes.len(), relief.len());

    let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
    let source = HeightSource::open(&[path], &on_globe, &Silent).expect("sound").expect("a raster");
    let report = verify(&file, Some(&source), HeightsChecks { cuts: 8, seed: 3 }, &Silent).expect("readable");
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    // What is not in the file is drawn as finely as the rest.
    assert!(report.level_tiles > 4 * summary.tiles && summary.certified_error < 1.001 * summary.sample_error);
    let finest = file.cut(&HeightsQuery::default()).expect("readable");
    assert_eq!((finest.error, finest.triangle_count), (summary.certified_error, summary.triangles));
    for tolerance in [2.0 * summary.certified_error, 100.0, 3000.0] {
        let cut = file.cut(&HeightsQuery { tolerance: Some(tolerance), ..HeightsQuery::default() }).expect("readable");
        assert!(cut.error <= tolerance);
        assert!(file.mesh(&cut).is_ok_and(|mesh| mesh.error <= tolerance));
    }
}

#[test]
fn the_commands_work_with_files_of_heights() {
    let folder = Folder::new();
    let at = |name: &str| folder.0.path().join(name);
    folder.fractal("a.tif", &Grid::utm([200, 150]), false, |_, _| false);
    let run = |args: &[&str]| lodpack().current_dir(folder.0.path()).args(args).assert();
    run(&["build", "a.tif", "-o", "a.lodpack", "--heights", "--tolerance", "2m"]).success();
    let info = run(&["info", "a.lodpack", "--json"]).success();
    let info: serde_json::Value = serde_json::from_slice(&info.get_output().stdout).expect("JSON");
    assert_eq!((&info["holds"], &info["samples"]), (&"heights".into(), &30_000.into()));
    run(&["extract", "a.lodpack", "-o", "a.ply", "--tolerance", "50m"]).success();
    let out = run(&["extract", "a.lodpack", "-o", "b.ply", "--triangles", "500", "--json"]).success();
    let out: serde_json::Value = serde_json::from_slice(&out.get_output().stdout).expect("JSON");
    assert!(out["triangles"].as_u64().is_some_and(|count| count <= 500), "{out}");
    run(&["extract", "a.lodpack", "-o", "c.ply", "--bbox", "501000,5196000,0,502000,5199000,0"]).success();
    run(&["verify", "a.lodpack", "--against", "a.tif", "--cuts", "5"]).success();
    run(&["export", "a.lodpack", "--as", "3dtiles", "-o", "tiles"]).success();
    // What does not read them says so.
    let failed = run(&["build", "a.lodpack", "-o", "again.lodpack"]).failure();
    let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(said.contains("a grid of heights is no input"), "{said}");
    let integers = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain/int-deflate.tif");
    let integers = integers.to_str().expect("a path in UTF-8");
    run(&["build", integers, "-o", "exact.lodpack", "--heights", "--tolerance", "0"]).success();
    run(&["build", "a.tif", "-o", "e.lodpack", "--heights", "--tolerance", "0"]).failure();
    let failed = run(&["build", "a.tif", "-o", "e.lodpack", "--heights", "--ramp", "eath"]).failure();
    assert!(String::from_utf8_lossy(&failed.get_output().stderr).contains("earth, grey, viridis"));
    run(&["build", "a.tif", "-o", "e.lodpack", "--tolerance", "0"]).failure();
    run(&["verify", "a.lodpack", "--against", "nothing.tif"]).failure();
    let failed = run(&["verify", "a.lodpack", "--against", "a.ply"]).failure();
    assert!(String::from_utf8_lossy(&failed.get_output().stderr).contains("rasters"));
    // A byte that changes is noticed.
    let mut bytes = std::fs::read(at("a.lodpack")).expect("readable");
    let middle = bytes.len() * 3 / 4;
    bytes[middle] ^= 4;
    std::fs::write(at("bad.lodpack"), bytes).expect("writable");
    run(&["verify", "bad.lodpack"]).failure();
    let failed = run(&["build", "a.ply", "-o", "d.lodpack", "--heights"]).failure();
    assert!(String::from_utf8_lossy(&failed.get_output().stderr).contains("--as heights"));
    assert!(!at("d.lodpack").exists());
}

#[test]
fn rasters_become_heights_unless_something_is_for_meshes() {
    let folder = Folder::new();
    folder.fractal("a.tif", &Grid::utm([200, 150]), false, |_, _| false);
    let run = |words: &str| lodpack().current_dir(folder.0.path()).args(words.split(' ')).output().expect("it runs");
    let ok = |words: &str| {
        let output = run(words);
        let said = String::from_utf8_lossy(&[&*output.stdout, &output.stderr].concat()).into_owned();
        assert!(output.status.success(), "{words}: {said}");
        said
    };
    let refused = |words: &str| {
        let output = run(words);
        assert!(!output.status.success(), "{words}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(ok("build a.tif -o heights.lodpack --tolerance 2m").contains("--as mesh"));
    assert!(!ok("build a.tif -o mesh.lodpack --as mesh --tolerance 2m").contains("--as mesh"));
    let noted = ok("build a.tif -o noted.lodpack --levels finest --tolerance 2m");
    assert!(noted.contains("--levels is for meshes"), "{noted}");
    let kinds = [("heights", "heights"), ("mesh", "mesh"), ("noted", "mesh")];
    for (name, kind) in kinds {
        let info = ok(&format!("info {name}.lodpack --json"));
        let info: serde_json::Value = serde_json::from_str(&info).expect("JSON");
        assert_eq!(info["holds"] == "heights", kind == "heights", "{info}");
        ok(&format!("extract {name}.lodpack --triangles 800 -o {name}.glb"));
        ok(&format!("verify {name}.lodpack --against a.tif --cuts 3"));
        ok(&format!("export {name}.lodpack --as 3dtiles -o {name}"));
    }
    assert!(refused("build a.tif -o no.lodpack --as heights --effort best").contains("--effort is for meshes"));
    assert!(refused("build a.tif -o no.lodpack --workers 2").contains("--as mesh"));
    assert!(ok("plan a.tif -o heights.job --parts 1 --json").contains("\"heights\": true"));
    assert!(ok("plan a.tif -o mesh.job --as mesh --parts 1 --json").contains("\"heights\": false"));
}

/// The JSON of a GLB, and the bytes behind it.
fn glb(path: &Path) -> (serde_json::Value, Vec<u8>) {
    let bytes = std::fs::read(path).expect("written");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).expect("JSON"), bytes[28 + length..].to_vec())
}

/// What an accessor of a GLB has for each vertex, as numbers of the given size in bytes.
fn numbers<const N: usize>(
    (json, bytes): &(serde_json::Value, Vec<u8>),
    name: &str,
    read: fn([u8; N]) -> f64,
) -> Vec<f64> {
    let accessor =
        &json["accessors"][json["meshes"][0]["primitives"][0]["attributes"][name].as_u64().expect(name) as usize];
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    let [first, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap_or(0) as usize);
    bytes[first..first + length].as_chunks::<N>().0.iter().map(|&bytes| read(bytes)).collect()
}

#[test]
fn a_ramp_is_kept_and_colours_what_is_taken_out() {
    let folder = Folder::new();
    let at = |name: &str| folder.0.path().join(name);
    folder.fractal("a.tif", &Grid::utm([200, 150]), false, |_, _| false);
    let run = |args: &[&str]| lodpack().current_dir(folder.0.path()).args(args).assert();
    let build = |out: &str, more: &[&str]| {
        run(&[&["build", "a.tif", "-o", out, "--heights", "--tolerance", "2m"], more].concat()).success();
        std::fs::metadata(at(out)).expect("written").len()
    };
    let bare = build("bare.lodpack", &[]);
    std::fs::write(at("two.txt"), "# red low, blue high\n-9000 200 0 0\n9000 0 0 200\n").expect("writable");
    let coloured = build("two.lodpack", &["--ramp", "two.txt"]);
    // A directory entry, the name, and two stops.
    assert_eq!(coloured, bare + 32 + 3 + 1 + 2 * 11);
    for name in ["earth", "grey", "viridis"] {
        build(&format!("{name}.lodpack"), &["--ramp", name]);
    }
    let info = run(&["info", "two.lodpack", "--json"]).success();
    let info: serde_json::Value = serde_json::from_slice(&info.get_output().stdout).expect("JSON");
    assert_eq!(
        info["ramp"],
        serde_json::json!({"name": "two", "stops": [[-9000.0, [200, 0, 0]], [9000.0, [0, 0, 200]]]})
    );
    run(&["extract", "two.lodpack", "-o", "two.glb", "--tolerance", "20m"]).success();
    run(&["extract", "bare.lodpack", "-o", "bare.glb", "--tolerance", "20m"]).success();
    run(&["extract", "two.lodpack", "-o", "plain.glb", "--tolerance", "20m", "--channels", "none"]).success();
    let has_colours = |name: &str| glb(&at(name)).0["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].is_number();
    assert_eq!(["two.glb", "bare.glb", "plain.glb"].map(has_colours), [true, false, false]);
    let two = glb(&at("two.glb"));
    let single = |bytes| f64::from(f32::from_le_bytes(bytes));
    let (places, normals) = (numbers::<4>(&two, "POSITION", single), numbers::<4>(&two, "NORMAL", single));
    let colours = numbers::<2>(&two, "COLOR_0", |bytes| f64::from(u16::from_le_bytes(bytes)) / 65535.0);
    // The node turns what has z up into y up, as glTF has it.
    let node = &two.0["nodes"][0];
    let zero = node["translation"][1].as_f64().expect("a number");
    let turned: Vec<f64> = (0..4).map(|k| node["rotation"][k].as_f64().expect("a number")).collect();
    assert!(turned[0] < -0.7 && turned[1..3] == [0.0, 0.0] && turned[3] > 0.7, "{turned:?}");
    let linear = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    assert!(places.len() > 300 && normals.len() == places.len());
    for ((place, normal), colour) in places.chunks(3).zip(normals.chunks(3)).zip(colours.chunks(4)) {
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-3 && normal[2] > 0.0, "{normal:?}");
        let share = (place[2] + zero + 9000.0) / 18_000.0;
        let expected = [1.0 - share, 0.0, share].map(|share| linear((share * 200.0).round() / 255.0));
        assert!((0..3).all(|k| (colour[k] - expected[k]).abs() < 0.01) && colour[3] == 1.0, "{colour:?} {expected:?}");
    }
    run(&["extract", "two.lodpack", "-o", "two.ply", "--tolerance", "20m"]).success();
    let ply = std::fs::read(at("two.ply")).expect("written");
    assert!(String::from_utf8_lossy(&ply[..400]).contains("property uchar red"));
    std::fs::write(at("bad.txt"), "0 1 2 3\n5 1 2\n").expect("writable");
    let failed = run(&["build", "a.tif", "-o", "e.lodpack", "--heights", "--ramp", "bad.txt"]).failure();
    assert!(String::from_utf8_lossy(&failed.get_output().stderr).contains("bad.txt: line 2"));
}

/// Opens a raster that was taken out of a file.
fn opened(path: &Path, surface: SurfaceKind) -> HeightSource {
    let raster = RasterOptions { surface, ..RasterOptions::default() };
    HeightSource::open(&[path.to_owned()], &raster, &Silent).expect("sound").expect("a raster")
}

fn extracted(file: &Path, name: &str, more: &[&str]) -> (PathBuf, serde_json::Value) {
    let out = file.with_file_name(name);
    let ran = lodpack().arg("extract").arg(file).arg("-o").arg(&out).arg("--json").args(more).assert().success();
    let summary = serde_json::from_slice(&ran.get_output().stdout).expect("JSON");
    (out, summary)
}

#[test]
fn rasters_taken_out_are_those_that_went_in() {
    let folder = Folder::new();
    let lake = |column: u32, row: u32| (100..140).contains(&column) && (50..90).contains(&row) || column < 3;
    for (number, (size, has_voids)) in
        [([200, 150], false), ([200, 150], true), ([65, 129], false)].into_iter().enumerate()
    {
        let path = folder.fractal(&format!("in{number}.tif"), &Grid::utm(size), false, |c, r| has_voids && lake(c, r));
        let file = folder.0.path().join(format!("{number}.lodpack"));
        lodpack()
            .arg("build")
            .arg(&path)
            .arg("-o")
            .arg(&file)
            .args(["--heights", "--tolerance", "0.5"])
            .assert()
            .success();
        let (raster, summary) = extracted(&file, &format!("out{number}.tif"), &[]);
        assert_eq!((&summary["columns"], &summary["rows"]), (&size[0].into(), &size[1].into()));
        let bytes = std::fs::read(&file).expect("written");
        let heights = Heights::open(bytes.as_slice(), Limits::default()).expect("sound");
        let source = opened(&raster, SurfaceKind::Plane);
        assert_eq!(source.grid, *heights.grid());
        let first = [0, 1].map(|axis| source.surface.first[axis] - heights.surface().first[axis]);
        assert!(
            source.surface.spacing == heights.surface().spacing && first.iter().all(|x| x.abs() < 1e-6),
            "{first:?}"
        );
        let report = verify(&heights, Some(&source), HeightsChecks { cuts: 5, seed: 7 }, &Silent).expect("readable");
        assert!(report.problems.is_empty(), "{:?}", report.problems);
        // Single precision rounds heights of hundreds of metres by hundredths of a millimetre.
        assert!(report.sample_distance.is_some_and(|distance| distance < 1e-3), "{:?}", report.sample_distance);
    }
}

#[test]
fn windows_are_coarser_where_that_suffices_and_cross_the_date_line() {
    let folder = Folder::new();
    let path = folder.fractal("globe.tif", &Grid::globe([360, 180]), true, |_, _| false);
    let file = folder.0.path().join("globe.lodpack");
    let words = ["--heights", "--surface", "wgs84", "--tolerance", "1"];
    lodpack().arg("build").arg(&path).arg("-o").arg(&file).args(words).assert().success();
    let bytes = std::fs::read(&file).expect("written");
    let heights = Heights::open(bytes.as_slice(), Limits::default()).expect("sound");
    // From both sides of the date line, sample by sample.
    let (raster, summary) = extracted(&file, "date.tif", &["--bbox", "170,-10,0,190,10,0"]);
    let source = opened(&raster, SurfaceKind::Plane);
    let mut rows: Vec<Vec<f64>> = vec![];
    source
        .for_each_row(|_, row| {
            rows.push(row.to_vec());
            Ok::<(), lodpack_cli::heights::HeightsError>(())
        })
        .expect("readable");
    assert_eq!(
        (summary["columns"].as_u64(), summary["rows"].as_u64()),
        (Some(rows[0].len() as u64), Some(rows.len() as u64))
    );
    let column = |degrees: f64| ((degrees - heights.surface().first[0]) / heights.surface().spacing[0]).floor() as u64;
    let row = ((10.0 - heights.surface().first[1]) / heights.surface().spacing[1]).floor() as u64;
    let first = column(170.0);
    let expected =
        heights.window(first..first + rows[0].len() as u64, row..row + rows.len() as u64).expect("in the grid");
    let off = rows.concat().iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3 && rows[0].len() >= 20, "{off}");
    let (_, whole) = extracted(&file, "whole.tif", &[]);
    let (_, coarse) = extracted(&file, "coarse.tif", &["--tolerance", "20000"]);
    assert_eq!(whole["stride"], 1);
    assert!(coarse["stride"].as_u64() > Some(1) && coarse["certified_error"].as_f64() <= Some(20_000.0), "{coarse}");
    let said = lodpack().arg("extract").arg(&file).args(["-o", "x.tif", "--triangles", "5"]).assert().code(2);
    assert!(String::from_utf8_lossy(&said.get_output().stderr).contains("a raster has no triangles"));
}

#[test]
fn what_lies_beyond_the_last_sample_of_a_coarser_window_counts() {
    let folder = Folder::new();
    let file = folder.0.path().join("plane.lodpack");
    // Every second column and row leave the last ones out, every fourth also those before.
    for (size, void) in [([110, 102], None), ([107, 130], None), ([110, 102], Some(108))] {
        // A last column without data is no edge for what lies beyond it.
        let path = folder.fractal("plane.tif", &Grid::utm(size), false, |column, _| Some(column) == void);
        let words = ["--heights", "--tolerance", "1", "--force"];
        lodpack().arg("build").arg(&path).arg("-o").arg(&file).args(words).assert().success();
        for tolerance in ["30", "120", "500"] {
            let (raster, summary) = extracted(&file, "window.tif", &["--tolerance", tolerance, "--force"]);
            let out = lodpack().arg("compare").args([&path, &raster]).arg("--json").assert().success();
            let compared: serde_json::Value = serde_json::from_slice(&out.get_output().stdout).expect("JSON");
            let off = compared["levels"][0]["samples_of_a_to_b"]["upper"].as_f64().expect("a distance");
            let said = summary["certified_error"].as_f64().expect("a distance");
            assert!(said >= off * (1.0 - 1e-9), "{size:?} {tolerance}: {said} for {off}, {summary}");
        }
    }
}

#[test]
fn whole_numbers_stay_whole_in_rasters() {
    let folder = Folder::new();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain/int-deflate.tif");
    let file = folder.0.path().join("int.lodpack");
    lodpack().arg("build").arg(&path).arg("-o").arg(&file).args(["--heights", "--tolerance", "0"]).assert().success();
    let (raster, _) = extracted(&file, "int.tif", &[]);
    let again = folder.0.path().join("again.lodpack");
    lodpack()
        .arg("build")
        .arg(&raster)
        .arg("-o")
        .arg(&again)
        .args(["--heights", "--tolerance", "0"])
        .assert()
        .success();
    let report = {
        let bytes = std::fs::read(&again).expect("written");
        let heights = Heights::open(bytes.as_slice(), Limits::default()).expect("sound");
        verify(&heights, Some(&opened(&path, SurfaceKind::Plane)), HeightsChecks { cuts: 3, seed: 7 }, &Silent)
    };
    let report = report.expect("readable");
    assert!(report.problems.is_empty() && report.sample_distance == Some(0.0), "{report:?}");
}
