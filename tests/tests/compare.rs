//! One yardstick: `compare` measures what it should, and every accuracy that is printed holds for the file that was
//! written.

use crate::commands::lodpack;
use crate::heights::Folder;
use crate::scan;
use lodpack_tests::terrain::Grid;
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Runs a command; returns its JSON.
fn json(words: &[&OsStr]) -> Value {
    let out = lodpack().args(words).arg("--json").assert().success();
    serde_json::from_slice(&out.get_output().stdout).expect("JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The levels of B.
fn levels(a: &Path, b: &Path, more: &str) -> Vec<Value> {
    let mut words = vec![OsStr::new("compare"), a.as_os_str(), b.as_os_str()];
    words.extend(more.split_whitespace().map(OsStr::new));
    json(&words)["levels"].as_array().expect("levels").clone()
}

/// A distance that occurs, and one that none exceeds.
fn bounds(level: &Value) -> [f64; 2] {
    [0, 1].map(|k| number(&level["distance"][k]))
}

fn square(folder: &Path, name: &str, z: f64, side: f64) -> PathBuf {
    let path = folder.join(name);
    let far = 4_000_000.0;
    let corner = |x: f64, y: f64| format!("v {} {} {z}\n", far + x, y);
    let corners = [corner(0.0, 0.0), corner(side, 0.0), corner(side, side), corner(0.0, side)].concat();
    std::fs::write(&path, format!("{corners}f 1 2 3 4\n")).expect("writable");
    path
}

#[test]
fn squares_are_as_far_apart_as_they_were_lifted_and_directions_differ() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let small = square(folder.path(), "small.obj", 0.0, 1.0);
    let lifted = square(folder.path(), "lifted.obj", 0.25, 1.0);
    let large = square(folder.path(), "large.obj", 0.0, 3.0);
    let level = &levels(&small, &lifted, "--gap 0.1%")[0];
    let [lower, upper] = bounds(level);
    assert!(lower <= 0.25 + 1e-9 && upper >= 0.25 - 1e-9 && upper - lower <= 0.0003, "{level}");
    assert!((number(&level["a_to_b"]["rms"]) - 0.25).abs() < 1e-9);
    let level = &levels(&small, &large, "")[0];
    assert!(number(&level["a_to_b"]["upper"]) < 1e-6, "{level}");
    let (farthest, corner) = (number(&level["b_to_a"]["lower"]), 8f64.sqrt());
    assert!((0.99 * corner..=corner + 1e-6).contains(&farthest), "{level}");
    let at: Vec<f64> = level["b_to_a"]["at"].as_array().expect("a place").iter().map(number).collect();
    assert!((at[0] - 4_000_003.0).abs() < 0.1 && (at[1] - 3.0).abs() < 0.1, "{level}");
    // Sixteen numbers take one to the other.
    let lift = "--matrix 1,0,0,0,0,1,0,0,0,0,1,0,0,0,0.25,1";
    assert!(bounds(&levels(&small, &lifted, lift)[0])[1] < 1e-6);
}

#[test]
fn what_is_said_of_every_kind_of_mesh_holds_for_the_file_that_is_written() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| folder.path().join(name);
    // So far from the origin that single precision shows.
    let (mesh, ..) = lodpack_cli::stage::repair::repair(
        lodpack_cli::import::import_meshes(&[scan()], &lodpack_cli::progress::Silent).expect("it is readable"),
    );
    let mut mesh = mesh;
    let [low, high] = mesh.bounds();
    let away = 100_000.0 * (high - low).max_element();
    mesh.positions.iter_mut().for_each(|p| p.x += away);
    let (input, file) = (at("scan.ply"), at("scan.lodpack"));
    lodpack_tests::generate::save_ply(&mesh, &input).expect("writable");
    lodpack().arg("build").arg(&input).arg("-o").arg(&file).assert().success();
    let stated = levels(&input, &file, "--level all");
    assert!(stated.len() >= 3);
    for level in &stated {
        assert!(number(&level["claimed"]) >= bounds(level)[0] * (1.0 - 1e-9), "{level}");
    }
    let mut roundings = 0;
    for extension in ["ply", "obj", "stl", "glb"] {
        let output = at(&format!("cut.{extension}"));
        let summary = json(&[OsStr::new("extract"), file.as_os_str(), OsStr::new("-o"), output.as_os_str()]);
        let measured = bounds(&levels(&input, &output, "")[0])[0];
        assert!(number(&summary["certified_error"]) >= measured * (1.0 - 1e-9), "{extension}: {summary} {measured}");
        roundings += usize::from(number(&summary["rounding"]) > 0.0);
    }
    assert!(roundings > 0);
    let lod = at("lod.glb");
    lodpack().arg("export").arg(&file).args(["--as", "glb-lod", "-o"]).arg(&lod).assert().success();
    let levels = levels(&input, &lod, "");
    assert!(levels.len() >= 3);
    for level in &levels {
        assert!(number(&level["claimed"]) >= bounds(level)[0] * (1.0 - 1e-9), "{level}");
    }
}

#[test]
fn geometric_errors_of_tilesets_that_are_written_hold() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let [file, tiles, archive] = ["scan.lodpack", "tiles", "tiles.3tz"].map(|name| folder.path().join(name));
    lodpack().arg("build").arg(scan()).arg("-o").arg(&file).assert().success();
    for output in [&tiles, &archive] {
        lodpack().arg("export").arg(&file).args(["--as", "3dtiles", "-o"]).arg(output).assert().success();
    }
    for output in [tiles.join("tileset.json"), archive] {
        let levels = levels(&scan(), &output, "");
        assert!(levels.len() >= 3, "{}", output.display());
        for level in &levels {
            assert!(number(&level["claimed"]) >= bounds(level)[0] * (1.0 - 1e-9), "{}: {level}", output.display());
        }
    }
}

#[test]
fn terrain_tiles_say_how_near_they_are() {
    let folder = Folder::new();
    let mut grid = Grid::globe([36_000, 18_000]).window([18_700, 4300], [150, 120]);
    grid.is_point = true;
    let raster = folder.fractal("region.tif", &grid, false, |column, row| column + row < 30);
    let at = |name: &str| folder.0.path().join(name);
    let (file, tiles) = (at("file.lodpack"), at("tiles"));
    let words = ["--heights", "--surface", "wgs84", "--tolerance", "2m", "-o"];
    lodpack().arg("build").arg(&raster).args(words).arg(&file).assert().success();
    let export = [OsStr::new("export"), file.as_os_str(), OsStr::new("--as"), OsStr::new("quantized-mesh")];
    let summary = json(&[&export[..], &[OsStr::new("-o"), tiles.as_os_str()]].concat());
    let samples = |level: &Value| number(&level["samples_of_a_to_b"]["upper"]);
    let of_file = &levels(&raster, &file, "--surface wgs84")[0];
    assert!(number(&of_file["claimed"]) >= samples(of_file), "{of_file}");
    let of_tiles = &levels(&raster, &tiles.join("layer.json"), "--level finest")[0];
    let (stated, measured) = (number(&summary["finest_error"]), samples(of_tiles));
    assert!(stated >= measured && stated <= 1.6 * measured, "{stated} {measured} {of_file}");
    // Nothing but half a step of heights and fewer triangles is added to what the file is off.
    assert!(measured <= 1.06 * samples(of_file), "{measured} {of_file}");
}

#[test]
fn what_cannot_be_compared_is_named() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let sound = square(folder.path(), "sound.obj", 0.0, 1.0);
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("writable");
        path
    };
    let tile = |uri: &str| {
        format!(r#"{{"asset":{{"version":"1.1"}},"root":{{"geometricError":1,"content":{{"uri":"{uri}"}}}}}}"#)
    };
    for (other, words) in [
        (folder.path().join("gone.obj"), "cannot open"),
        (PathBuf::from("https://example.org/tileset.json"), "download it"),
        (write("self.json", &tile("self.json")), "leads back to it"),
        (write("away.json", &tile("https://example.org/a.glb")), "not in the folder of the tileset"),
        (write("none.json", &tile("none.glb")), "none.glb"),
        (write("layer.json", "{\"format\": \"heightmap-1.0\"}"), "only quantized-mesh-1.0"),
        (write("words.txt", "hello"), "words.txt"),
    ] {
        let out = lodpack().arg("compare").arg(&sound).arg(&other).assert().code(2);
        let text = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
        assert!(text.contains(words), "{}: {text}", other.display());
    }
    let out = lodpack().arg("compare").arg(&sound).arg(&sound).args(["--level", "7"]).assert().success();
    assert!(String::from_utf8_lossy(&out.get_output().stdout).contains("distance"));
}
