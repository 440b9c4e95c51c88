//! Inputs as people have them: folders, patterns, lodpack files whose input is gone, and meshes that say where in the
//! world they are.

use crate::channels::save_coloured;
use crate::commands::lodpack;
use lodpack_tests::generate::{rough_sphere, save_ply, torus};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs a command in the folder; what it says on stderr and on stdout.
    fn run(&self, words: &[&str]) -> [String; 2] {
        let ran = lodpack().current_dir(self.0.path()).args(words).assert().success();
        let output = ran.get_output();
        [&output.stderr, &output.stdout].map(|text| String::from_utf8_lossy(text).into_owned())
    }

    fn refused(&self, words: &[&str]) -> String {
        let ran = lodpack().current_dir(self.0.path()).args(words).assert().code(2);
        String::from_utf8_lossy(&ran.get_output().stderr).into_owned()
    }

    fn info(&self, file: &str) -> Value {
        serde_json::from_str(&self.run(&["info", file, "--json"])[1]).expect("JSON")
    }
}

fn write(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().expect("in a folder")).expect("writable");
    fs::write(path, text).expect("writable");
}

#[test]
fn folders_and_patterns_build_the_same_file_as_their_names() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path("city/b")).unwrap();
    save_ply(&torus(24), &folder.path("city/a.ply")).expect("written");
    save_ply(&rough_sphere(12), &folder.path("city/b/c.ply")).expect("written");
    write(&folder.path("city/readme.txt"), "not a mesh");
    folder.run(&["build", "city/a.ply", "city/b/c.ply", "-o", "named.lodpack"]);
    let [said, _] = folder.run(&["build", "city"]);
    assert!(said.contains("city: 2 .ply files"), "{said}");
    folder.run(&["build", "city/**/*.ply", "-o", "pattern.lodpack"]);
    folder.run(&["plan", "city/", "--parts", "2"]);
    let named = fs::read(folder.path("named.lodpack")).unwrap();
    for other in ["city.lodpack", "pattern.lodpack"] {
        assert!(named == fs::read(folder.path(other)).unwrap(), "{other} has other bytes");
    }
    folder.run(&["verify", "named.lodpack", "--against", "city", "--cuts", "3"]);
    assert!(folder.refused(&["build", "city/*.stl"]).contains("no file matches"));
    fs::create_dir(folder.path("empty")).unwrap();
    assert!(folder.refused(&["build", "empty"]).contains("the folder has no meshes"));
}

#[test]
fn a_lodpack_file_is_an_input_with_all_that_it_carries() {
    let folder = Folder::new();
    save_coloured(&rough_sphere(40), &folder.path("scan.ply"));
    let place = ["--crs", "EPSG:32632", "--origin", "500000,5000000,100", "--unit", "m"];
    folder.run(&[&["build", "scan.ply", "--tolerance", "0.02edge"][..], &place].concat());
    assert!(folder.refused(&["build", "scan.lodpack"]).contains("onto itself"));
    let [said, _] = folder.run(&["build", "scan.lodpack", "--tolerance", "0.5edge", "-o", "coarse.lodpack"]);
    assert!(said.contains("is built again") && said.contains("EPSG:32632"), "{said}");
    let [fine, coarse] = ["scan.lodpack", "coarse.lodpack"].map(|file| folder.info(file));
    assert_eq!(fine["placement"], coarse["placement"]);
    let names = |info: &Value| -> Vec<String> {
        let channels = info["channels"].as_array().expect("channels").iter();
        channels.map(|channel| channel["name"].as_str().expect("a name").to_owned()).collect()
    };
    assert_eq!(names(&fine), names(&coarse));
    // Its errors are to the surface of the file that was built again, which has the input's shape but for its own
    // error.
    folder.run(&["extract", "scan.lodpack", "-o", "finest.ply"]);
    folder.run(&["verify", "coarse.lodpack", "--against", "finest.ply", "--cuts", "10"]);
    folder.run(&["build", "scan.lodpack", "--channels", "none", "--tolerance", "0.5edge", "-o", "bare.lodpack"]);
    assert!(folder.info("bare.lodpack")["channels"].as_array().is_none_or(Vec::is_empty));
    // A damaged one is named.
    let mut bytes = fs::read(folder.path("scan.lodpack")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    fs::write(folder.path("damaged.lodpack"), bytes).unwrap();
    assert!(folder.refused(&["build", "damaged.lodpack", "-o", "x.lodpack"]).contains("damaged.lodpack: "));
}

#[test]
fn what_inputs_say_of_their_place_is_kept_and_what_is_typed_counts_more() {
    let folder = Folder::new();
    let obj = "# offset 500000 5000000 100\n# EPSG:32632\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    write(&folder.path("a.obj"), obj);
    let [said, _] = folder.run(&["build", "a.obj"]);
    assert!(
        said.contains("a comment in a.obj places the coordinates: EPSG:32632, origin 500000 5000000 100"),
        "{said}"
    );
    let place = folder.info("a.lodpack")["placement"].clone();
    assert_eq!((&place["crs"], &place["origin"][1]), (&"EPSG:32632".into(), &5e6.into()), "{place}");
    folder.run(&["build", "a.obj", "--crs", "EPSG:25832", "--origin", "1,2,3", "-o", "b.lodpack"]);
    let place = folder.info("b.lodpack")["placement"].clone();
    assert_eq!((&place["crs"], &place["origin"][1]), (&"EPSG:25832".into(), &2.0.into()), "{place}");
    // glTF has y up and metres.
    folder.run(&["extract", "a.lodpack", "-o", "a.glb"]);
    folder.run(&["build", "a.glb", "-o", "c.lodpack"]);
    let place = folder.info("c.lodpack")["placement"].clone();
    assert_eq!((&place["up"], &place["unit"]), (&"y".into(), &1.0.into()), "{place}");
}

/// Writes a ball of few triangles as glTF, with normals of the ball or of its triangles.
fn write_ball(folder: &Path, name: &str, is_smooth: bool) {
    let (columns, rows) = (24, 12);
    let point = |i: u32, j: u32| {
        let (turn, down) =
            (f64::from(i % columns) / f64::from(columns) * std::f64::consts::TAU, f64::from(j) / f64::from(rows));
        let (sin, cos) = (down * std::f64::consts::PI).sin_cos();
        glam::DVec3::new(sin * turn.cos(), cos, -sin * turn.sin())
    };
    let cells = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1)];
        [[a, c, b], [b, c, d]]
    });
    let (mut positions, mut normals) = (vec![], vec![]);
    for corners in triangles {
        let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(corners[0]);
        positions.extend(corners);
        normals.extend(corners.map(|corner| if is_smooth { corner } else { face }));
    }
    let numbers = positions.iter().chain(&normals).flat_map(|p| p.to_array());
    let bytes: Vec<u8> = numbers.flat_map(|x| (x as f32).to_le_bytes()).collect();
    fs::write(folder.join(format!("{name}.bin")), &bytes).expect("writable");
    let (count, half) = (positions.len(), bytes.len() / 2);
    let view = |at: usize| serde_json::json!({"buffer": 0, "byteOffset": at, "byteLength": half});
    let document = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}],
        "buffers": [{"uri": format!("{name}.bin"), "byteLength": bytes.len()}], "bufferViews": [view(0), view(half)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"}],
    });
    fs::write(folder.join(format!("{name}.gltf")), document.to_string()).expect("writable");
}

#[test]
fn normals_of_models_of_few_triangles_are_kept_where_triangles_do_not_have_them() {
    let folder = Folder::new();
    for (name, is_smooth) in [("round", true), ("flat", false)] {
        write_ball(folder.0.path(), name, is_smooth);
        folder.run(&["build", &format!("{name}.gltf")]);
        let info = folder.info(&format!("{name}.lodpack"));
        let channels = info["channels"].as_array().map_or(0, Vec::len);
        assert_eq!(channels, usize::from(is_smooth), "{name}: {info}");
    }
}
