//! Meshes whose files store no normals are written with computed ones: smooth up to creases, and the same on both sides
//! of arcs.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::time::Duration;

use glam::DVec3;
use lodpack::stream::{Mode, Options, Simulation, direction};
use lodpack::{File, Limits, Node};
use lodpack_tests::generate::{save_ply, torus};
use lodpack_tests::parts::boxes;
use serde_json::Value;

use crate::channels::{Folder, save_coloured};
use crate::commands::lodpack;
use crate::levels::{document, validate};

/// What a primitive of a GLB has for each vertex, relative to the middle of the mesh: three numbers.
fn triples(folder: &Folder, name: &str, attribute: &str) -> Vec<[f32; 3]> {
    let (json, bytes) = (document(&folder.path(name)), folder.read(name));
    let number = |value: &Value| value.as_u64().expect("a number") as usize;
    let accessor = &json["accessors"][number(&json["meshes"][0]["primitives"][0]["attributes"][attribute])];
    let view = &json["bufferViews"][number(&accessor["bufferView"])];
    let binary = bytes.len() - number(&json["buffers"][0]["byteLength"]);
    let floats = bytes[binary + number(&view["byteOffset"])..][..number(&view["byteLength"])].as_chunks::<4>().0;
    floats.as_chunks::<3>().0.iter().map(|words| words.map(f32::from_le_bytes)).collect()
}

/// The normals at each position. All of them have length 1.
fn normals_at(folder: &Folder, name: &str) -> BTreeMap<[u32; 3], BTreeSet<[u32; 3]>> {
    let (positions, normals) = (triples(folder, name, "POSITION"), triples(folder, name, "NORMAL"));
    assert!(positions.len() == normals.len() && !normals.is_empty(), "{name}");
    let mut all: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
    for (position, normal) in positions.iter().zip(&normals) {
        let length = DVec3::from(normal.map(f64::from)).length();
        assert!((length - 1.0).abs() < 1e-6, "{name}: {normal:?}");
        all.entry(position.map(f32::to_bits)).or_default().insert(normal.map(f32::to_bits));
    }
    all
}

/// The largest angle between the normals of a torus and those of a file of it, degrees.
fn off(folder: &Folder, name: &str) -> f64 {
    let angle = |(position, normals): (&[u32; 3], &BTreeSet<[u32; 3]>)| {
        let place = DVec3::from(position.map(|bits| f64::from(f32::from_bits(bits))));
        let wanted = place - DVec3::new(place.x, place.y, 0.0).normalize();
        let of =
            |normal: &[u32; 3]| DVec3::from(normal.map(|bits| f64::from(f32::from_bits(bits)))).angle_between(wanted);
        normals.iter().map(of).fold(0.0, f64::max)
    };
    normals_at(folder, name).iter().map(angle).fold(0.0, f64::max).to_degrees()
}

fn attributes(folder: &Folder, name: &str) -> Value {
    document(&folder.path(name))["meshes"][0]["primitives"][0]["attributes"].clone()
}

#[test]
fn both_sides_of_arcs_and_of_seams_of_images_have_the_same_normals() {
    let folder = Folder::empty();
    let torus = torus(160);
    save_ply(&torus, &folder.path("bare.ply")).expect("writable");
    save_coloured(&torus, &folder.path("coloured.ply"));
    for name in ["bare", "coloured"] {
        folder.run(&format!("build {name}.ply -o {name}.lodpack --tolerance 0.05edge"));
        // The finest level, and a mixture of two levels whose borders are stitched.
        for (glb, options) in [("fine", ""), ("mixed", "--nodes 3")] {
            let glb = format!("{name}-{glb}.glb");
            folder.run(&format!("extract {name}.lodpack {options} -o {glb}"));
            validate(&folder.path(&glb));
            let (positions, at) = (triples(&folder, &glb, "POSITION"), normals_at(&folder, &glb));
            assert!(at.values().all(|normals| normals.len() == 1), "{glb}");
            // Of the images, vertices along seams are there several times.
            assert_eq!(positions.len() > at.len(), name == "coloured", "{glb}");
            let off = off(&folder, &glb);
            assert!(off < 15.0, "{glb}: {off} degrees");
        }
    }
}

/// The normals at each position of a cut that a session draws, after others. Levels of roots that are not a multiple of
/// `step` are one coarser.
fn streamed(bytes: Vec<u8>, steps: &[u32]) -> BTreeMap<[u64; 3], BTreeSet<[i16; 2]>> {
    let file = File::open(bytes, Limits::default()).expect("a sound file opens");
    let options = Options { mode: Mode::Synchronous, light: true, ..Options::default() };
    let mut session = file.session(options).expect("a sound file streams");
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let finest = file.uniform_cut(file.level_count() as u8 - 1).expect("a sound file").nodes;
    for step in steps {
        let level = |node: &Node| node.level - u8::from(!node.root.is_multiple_of(*step) && node.level > 0);
        let nodes: Vec<Node> = finest.iter().map(|node| Node { level: level(node), ..*node }).collect();
        simulation.frame(&mut session, &nodes, &[]).expect("a sound file streams");
    }
    let mut all: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
    for drawn in session.picture().roots() {
        let lit = drawn.lit().expect("light");
        for (position, normal) in lit.positions.iter().zip(lit.normals) {
            all.entry(position.map(f64::to_bits)).or_default().insert(normal);
        }
    }
    all
}

#[test]
fn streamed_surfaces_have_one_normal_on_both_sides_of_every_border_and_boxes_keep_their_edges() {
    let folder = Folder::empty();
    let torus = torus(160);
    save_ply(&torus, &folder.path("bare.ply")).expect("writable");
    save_coloured(&torus, &folder.path("coloured.ply"));
    save_ply(&boxes(3), &folder.path("boxes.ply")).expect("writable");
    for name in ["bare", "coloured"] {
        folder.run(&format!("build {name}.ply -o {name}.lodpack --tolerance 0.05edge"));
        let bytes = folder.read(&format!("{name}.lodpack"));
        let fine = streamed(bytes.clone(), &[1]);
        for steps in [&[1][..], &[2, 3], &[3, 1], &[1, 2]] {
            let at = streamed(bytes.clone(), steps);
            assert!(at.values().all(|normals| normals.len() == 1), "{name}, {steps:?}");
            let off = |(position, normals): (&[u64; 3], &BTreeSet<[i16; 2]>)| {
                let place = DVec3::from(position.map(f64::from_bits));
                let wanted = place - DVec3::new(place.x, place.y, 0.0).normalize();
                normals
                    .iter()
                    .map(|&n| DVec3::from(direction(n)).angle_between(wanted).to_degrees())
                    .fold(0.0, f64::max)
            };
            let off = at.iter().map(off).fold(0.0, f64::max);
            assert!(off < 15.0, "{name}, {steps:?}: {off} degrees");
            // What was drawn before does not matter.
            assert!(steps[steps.len() - 1] != 1 || at == fine, "{name}, {steps:?}");
        }
    }
    folder.run("build boxes.ply");
    let at = streamed(folder.read("boxes.lodpack"), &[1]);
    assert!(at.len() == 24 && at.values().all(|normals| normals.len() == 3), "{at:?}");
}

#[test]
fn edges_of_boxes_stay_and_formats_have_what_they_have_room_for() {
    let folder = Folder::empty();
    save_ply(&boxes(3), &folder.path("boxes.ply")).expect("writable");
    folder.run("build boxes.ply");
    folder.run("extract boxes.lodpack -o boxes.glb");
    validate(&folder.path("boxes.glb"));
    let at = normals_at(&folder, "boxes.glb");
    assert!(at.len() == 24 && at.values().all(|normals| normals.len() == 3), "{at:?}");
    folder.run("extract boxes.lodpack -o none.glb --normals none");
    assert_eq!(attributes(&folder, "none.glb"), serde_json::json!({"POSITION": 0}));
    assert_eq!(triples(&folder, "none.glb", "POSITION").len(), 24);

    let obj = |options: &str| {
        folder.run(&format!("extract boxes.lodpack -o boxes.obj --force {options}"));
        let text = String::from_utf8(folder.read("boxes.obj")).expect("text");
        ["v ", "vn ", "f "].map(|start| text.lines().filter(|line| line.starts_with(start)).count())
    };
    assert_eq!((obj(""), obj("--normals smooth")), ([24, 0, 36], [24, 72, 36]));
    let ply = |options: &str| {
        folder.run(&format!("extract boxes.lodpack -o boxes-out.ply --force {options}"));
        let bytes = folder.read("boxes-out.ply");
        let header = String::from_utf8_lossy(&bytes[..bytes.len().min(400)]).into_owned();
        (header.contains("element vertex 24\n"), header.contains("property float nz\n"))
    };
    assert_eq!((ply(""), ply("--normals smooth")), ((true, false), (true, true)));
    let mut refused = lodpack();
    refused.current_dir(folder.path("")).args("extract boxes.lodpack --normals smooth -o boxes.stl".split(' '));
    let said = refused.assert().code(2);
    assert!(String::from_utf8_lossy(&said.get_output().stderr).contains("omit --normals"));
}

#[test]
fn a_build_of_what_was_extracted_stores_no_computed_normals() {
    let folder = Folder::empty();
    save_ply(&torus(60), &folder.path("torus.ply")).expect("writable");
    folder.run("build torus.ply");
    folder.run("extract torus.lodpack --triangles 300 -o few.glb");
    assert!(attributes(&folder, "few.glb")["NORMAL"].is_number());
    let out = lodpack().current_dir(folder.path("")).args(["build", "few.glb"]).output().expect("it runs");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success() && !said.contains("normals"), "{said}");
    let bytes = fs::read(folder.path("few.lodpack")).expect("written");
    assert!(crate::open(&bytes).channels().is_empty());
    // Who asks for normals gets these.
    folder.run("build few.glb -o all.lodpack --channels all");
    assert_eq!(crate::open(&folder.read("all.lodpack")).channels().len(), 1);
}

#[test]
fn levels_have_normals_and_stored_ones_count_more() {
    let folder = Folder::empty();
    save_ply(&torus(120), &folder.path("torus.ply")).expect("writable");
    folder.run("build torus.ply -o bare.lodpack");
    folder.run("build torus.ply -o stored.lodpack --channels all");
    for (file, has_tangents) in [("bare", false), ("stored", true)] {
        folder.run(&format!("extract {file}.lodpack -o {file}.glb"));
        folder.run(&format!("export {file}.lodpack --as glb-lod -o {file}-levels.glb"));
        for name in [format!("{file}.glb"), format!("{file}-levels.glb")] {
            let document = document(&folder.path(&name));
            for mesh in document["meshes"].as_array().expect("meshes") {
                let attributes = &mesh["primitives"][0]["attributes"];
                let has = |name: &str| attributes[name].is_number();
                assert_eq!((has("NORMAL"), has("TANGENT")), (true, has_tangents), "{name}: {attributes}");
            }
            validate(&folder.path(&name));
        }
    }
    // Without its channels the file has none.
    folder.run("extract stored.lodpack -o plain.glb --channels none");
    assert!(off(&folder, "plain.glb") < 30.0);
}
