//! Files with channels: pixels have the colours of the input, arcs are not seen, and nothing else changes.

use std::{io::Write, path::PathBuf, sync::OnceLock};

use glam::DVec3;
use image::RgbaImage;
use lodpack::View;
use lodpack_cli::{
    job::{BuildOptions, build},
    mesh::tolerance::Tolerance,
    pipeline::ModelOptions,
    progress::Silent,
};
use lodpack_tests::generate::bumpy_sphere;
use lodpack_view::{
    camera::parse,
    check::reference::{depth_map, point},
    picture::{different_colours, load},
};

use crate::{folder, has_gpu, program};

/// A smooth colour for each place.
fn colour(p: DVec3) -> [f64; 3] {
    [p.x * 3.0 + p.y, p.y * 4.0, p.z * 5.0].map(|x| 127.5 + 100.0 * x.sin())
}

/// A number for each place.
fn height(p: DVec3) -> f64 {
    20.0 + 10.0 * p.z
}

/// A sphere of 40,368 triangles with a colour and a number at each vertex: the file, and the mesh.
fn coloured() -> &'static (PathBuf, lodpack::Mesh) {
    static MODEL: OnceLock<(PathBuf, lodpack::Mesh)> = OnceLock::new();
    MODEL.get_or_init(|| {
        let (folder, mesh) = (folder("coloured"), bumpy_sphere(58));
        let (input, path) = (folder.join("coloured.ply"), folder.join("coloured.lodpack"));
        let mut ply = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float height\n\
             element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            mesh.positions.len(),
            mesh.triangles.len()
        )
        .into_bytes();
        for &p in &mesh.positions {
            p.to_array().iter().for_each(|x| ply.extend(x.to_le_bytes()));
            ply.extend(colour(p).map(|x| (x + 0.5) as u8));
            ply.extend((height(p) as f32).to_le_bytes());
        }
        for triangle in &mesh.triangles {
            ply.push(3);
            triangle.iter().for_each(|vertex| ply.extend(vertex.to_le_bytes()));
        }
        std::fs::write(&input, ply).unwrap();
        let tolerance = "0.1%".parse::<Tolerance>().unwrap();
        let model = ModelOptions { tolerance, chart_triangles: Some(2048), ..ModelOptions::default() };
        let options = BuildOptions { inputs: vec![input], model, ..BuildOptions::default() };
        let mut file = std::fs::File::create(&path).unwrap();
        build(&options, &mut file, &Silent).unwrap();
        file.flush().unwrap();
        let positions = mesh.positions.iter().map(|p| p.to_array()).collect();
        (path, lodpack::Mesh { positions, triangles: mesh.triangles, ..Default::default() })
    })
}

const SIDE: u32 = 300;
const CAMERA: &str = "1.2,1.1,2.9:0,0,0:0,1,0:45";

/// A picture of the sphere, unless options say otherwise.
fn picture(name: &str, options: &[&str]) -> RgbaImage {
    let out = folder(&format!("channel-{name}")).join("picture.png");
    let (path, size) = (coloured().0.to_str().unwrap(), format!("{SIDE}x{SIDE}"));
    let mut arguments = vec![path, "--screenshot", out.to_str().unwrap(), "--size", &size, "--camera", CAMERA];
    arguments.extend(options);
    let output = program(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    load(&out).unwrap()
}

/// The point of the input that each pixel shows; none at the background and near silhouettes.
fn points() -> Vec<Option<DVec3>> {
    let view = View { viewport: [SIDE; 2], near: 0.01, ..View::default() };
    let view = parse(CAMERA, &view).unwrap();
    let mesh = &coloured().1;
    let depths = depth_map(&mesh.positions, &mesh.triangles, &view);
    let side = SIDE as i32;
    let at = |x: i32, y: i32| match (0..side).contains(&x) && (0..side).contains(&y) {
        true => depths[(y * side + x) as usize],
        false => f64::INFINITY,
    };
    let known = |pixel: i32| {
        let (x, y) = (pixel % side, pixel / side);
        let around = (-2..=2).flat_map(|v| (-2..=2).map(move |u| (x + u, y + v)));
        let depth = at(x, y);
        let is_smooth = around.map(|(x, y)| at(x, y)).all(|other| (other - depth).abs() < 0.2);
        is_smooth.then(|| point(&view, pixel as usize, depth))
    };
    (0..side * side).map(known).collect()
}

/// The mean difference of pixels from what belongs there, and the largest one of 999 pixels in 1000, in levels of 255.
fn differences(picture: &RgbaImage, wanted: impl Fn(DVec3) -> [f64; 3]) -> [f64; 2] {
    let mut all = vec![];
    for (pixel, place) in picture.pixels().zip(points()) {
        let Some(place) = place else { continue };
        let wanted = wanted(place);
        all.push((0..3).map(|k| (f64::from(pixel[k]) - wanted[k]).abs()).fold(0.0, f64::max));
    }
    assert!(all.len() > 10_000, "{} pixels show the surface", all.len());
    all.sort_by(f64::total_cmp);
    [all.iter().sum::<f64>() / all.len() as f64, all[all.len() - all.len() / 1000 - 1]]
}

#[test]
fn pixels_have_the_colours_of_the_input_at_every_tolerance() {
    if !has_gpu() {
        return;
    }
    // At six pixels the top is drawn. The group below it is farther off than the top, and colours that went through its
    // surface have moved along it.
    for (tolerance, most_mean, most) in [("0.01", 3.5, 20.0), ("1", 3.5, 20.0), ("6", 10.0, 60.0)] {
        let picture = picture(&format!("colours-{tolerance}"), &["--unlit", "--tolerance", tolerance]);
        let [mean, largest] = differences(&picture, colour);
        println!("{tolerance} pixels: {mean:.2} on average, {largest:.0} at most");
        assert!(mean <= most_mean && largest <= most, "{tolerance} pixels: {mean} {largest}");
    }
}

#[test]
fn no_line_shows_along_arcs() {
    if !has_gpu() {
        return;
    }
    // The finest cut has all roots at one level, the others have several; each is drawn with borders inserted.
    let finest = picture("finest", &["--unlit", "--tolerance", "0.001"]);
    let known = points();
    for tolerance in ["1", "3"] {
        let coarser = picture(&format!("coarser-{tolerance}"), &["--unlit", "--tolerance", tolerance]);
        let different = different_colours(&finest, &coarser, 30);
        let different: Vec<_> = different.into_iter().filter(|&pixel| known[pixel].is_some()).collect();
        assert!(different.len() < 4, "{tolerance}: {} pixels", different.len());
    }
}

#[test]
fn numbers_have_the_colours_of_a_ramp() {
    if !has_gpu() {
        return;
    }
    const STOPS: [[f64; 3]; 5] =
        [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let ramp = |low: f64, high: f64| {
        move |p: DVec3| {
            let x = ((height(p) - low) / (high - low)).clamp(0.0, 1.0) * 4.0;
            let k = (x as usize).min(3);
            [0, 1, 2].map(|c| STOPS[k][c] + (STOPS[k + 1][c] - STOPS[k][c]) * (x - k as f64))
        }
    };
    // The range is that of the coarsest level, whose means are a little narrower than the input's 10 to 30 or so.
    let mesh = &coloured().1;
    let all = || mesh.positions.iter().map(|&p| height(p.into()));
    let [low, high] = [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)];
    let [mean, most] = differences(&picture("height", &["--unlit", "--channel", "height"]), ramp(low, high));
    assert!(mean < 6.0 && most < 40.0, "{mean} {most}");
    let options = ["--unlit", "--channel", "height", "--range", "18:24.5"];
    let [mean, most] = differences(&picture("range", &options), ramp(18.0, 24.5));
    // Near the outline a pixel spans much of the ramp.
    assert!(mean < 2.0 && most < 100.0, "{mean} {most}");
}

#[test]
fn both_ways_show_the_same_and_lines_lie_over_it() {
    if !has_gpu() {
        return;
    }
    let [stitched, pulled] = ["stitched", "pulled"].map(|way| picture(way, &["--draw", way, "--tolerance", "2"]));
    let different = different_colours(&stitched, &pulled, 2).len();
    assert!(different * 1000 <= stitched.pixels().len(), "{different}");
    let lines = picture("wire", &["--overlay", "wire", "--tolerance", "2"]);
    let changed = different_colours(&stitched, &lines, 10).len();
    assert!(changed > 2000 && changed < stitched.pixels().len(), "{changed}");
    // What has a meaning of its own hides the channel.
    let [with, without] = ["colour", "none"].map(|channel| {
        picture(&format!("levels-{channel}"), &["--channel", channel, "--overlay", "levels", "--tolerance", "2"])
    });
    assert!(with == without);
    let plain = picture("none", &["--channel", "none", "--tolerance", "2"]);
    let grey = |picture: &RgbaImage| picture.pixels().filter(|p| p[0].abs_diff(p[2]) < 40).count();
    // A fold that is smaller than the tolerance may show its back, which is red, in a pixel of the outline.
    assert!(grey(&plain) + 2 >= plain.pixels().len() && grey(&stitched) < plain.pixels().len() * 3 / 4);
}

#[test]
fn tiles_and_paths_show_channels_too() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (coloured().0.to_str().unwrap(), folder("channel-tiles"));
    let out = folder.join("joined.png");
    let output =
        program(&[path, "--screenshot", out.to_str().unwrap(), "--size", "400x320", "--tiles", "2x2", "--unlit"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    for wait in [None, Some("--wait")] {
        let mut arguments = vec![path, "--path", "circle:30", "--csv", "-", "--size", "160x120"];
        arguments.extend(wait);
        let output = program(&arguments);
        let table = String::from_utf8(output.stdout).unwrap();
        let column = table.lines().next().unwrap().split(',').position(|name| name == "late_textures").unwrap();
        let late: Vec<f64> =
            table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
        assert_eq!(late.len(), 30);
        assert!(wait.is_none() || late.iter().all(|&late| late == 0.0), "{late:?}");
    }
}

#[test]
fn a_file_with_channels_passes_the_check_and_wrong_options_are_named() {
    let path = coloured().0.to_str().unwrap();
    if has_gpu() {
        let output = program(&[path, "--check", "--views", "20"]);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
    }
    let said = |options: &[&str]| {
        let mut arguments = vec![path, "--screenshot", "/nowhere/x.png"];
        arguments.extend(options);
        let output = program(&arguments);
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(said(&["--channel", "temperature"]).contains("it has colour, height"));
    for range in ["3:1", "x:1", "1", "1:1", "nan:2"] {
        assert!(said(&["--channel", "height", "--range", range]).contains("LOW:HIGH"), "{range}");
    }
}

/// Whether the page can be tried, as in `tests/tests/browser.rs`.
fn has_browser(package: &std::path::Path) -> bool {
    let runs = |name: &str| std::process::Command::new(name).arg("--version").output().is_ok();
    let is_there = package.join("lodpack.wasm").is_file()
        && package.join("node_modules/playwright-core").is_dir()
        && runs("node")
        && runs("chromium");
    let needed = std::env::var_os("LODPACK_REQUIRE_BROWSER").is_some_and(|value| value == "1");
    assert!(is_there || !needed, "this test needs Node, Chromium, and what reader/wasm/README.md builds");
    if !is_there {
        eprintln!("skipped: this test needs Node, Chromium, and what reader/wasm/README.md builds");
    }
    is_there
}

#[test]
fn the_page_in_a_browser_shows_the_same_colours() {
    let package = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../reader/wasm");
    if !has_gpu() || !has_browser(&package) {
        return;
    }
    let folder = folder("pictures-for-the-page");
    std::fs::copy(&coloured().0, folder.join("coloured.lodpack")).unwrap();
    let pictures: [(&str, &[&str]); 4] = [
        ("lit", &[]),
        ("unlit", &["--unlit"]),
        ("height", &["--channel", "height", "--unlit"]),
        ("band", &["--channel", "height", "--range", "15:25"]),
    ];
    for (name, options) in pictures {
        picture(&format!("page-{name}"), options).save(folder.join(format!("{name}.png"))).unwrap();
    }
    let node = std::process::Command::new("node")
        .args(["--test", "test/native.test.js"])
        .current_dir(package)
        .env("LODPACK_PICTURES", &folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&node.stdout);
    assert!(node.status.success(), "{said}\n{}", String::from_utf8_lossy(&node.stderr));
    assert!(said.contains("# skipped 0") || said.contains("ℹ skipped 0"), "something was skipped: {said}");
}
