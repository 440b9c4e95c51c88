//! How surfaces are drawn: alpha modes, double-sided and unlit materials come through builds of every kind, and out
//! again.

use crate::channels::Folder;
use crate::levels::{document, validate};
use crate::open;
use crate::tileset::{has_tools, node};
use lodpack::decode::{AlphaMode, ChannelImage, Drawing, TexturedMesh};
use lodpack::index::ChannelKind;
use lodpack_tests::strips::{holes, materials, strips};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Writes strips of these materials, and their image beside them.
fn save(folder: &Folder, name: &str, materials: impl Iterator<Item = Value>) {
    fs::write(folder.path("holes.png"), holes()).expect("writable");
    fs::write(folder.path(name), strips(materials)).expect("writable");
}

/// A file of all strips.
pub fn drawn_file() -> Vec<u8> {
    let folder = Folder::empty();
    save(&folder, "strips.gltf", materials().into_iter().map(|(material, _)| material));
    folder.run("build strips.gltf -o strips.lodpack");
    folder.read("strips.lodpack")
}

/// The share of the area whose triangles are not drawn like the strip in which their middle lies.
fn share_drawn_otherwise(shown: &TexturedMesh, wanted: &[Drawing]) -> f64 {
    let (mut wrong, mut all) = (0.0, 0.0);
    for (corners, drawing) in shown.mesh.triangles.iter().zip(shown.drawings(1)) {
        let [a, b, c] = corners.map(|v| glam::DVec3::from(shown.mesh.positions[v as usize]));
        let area = (b - a).cross(c - a).length();
        let strip = ((a.x + b.x + c.x) / 3.0) as usize;
        all += area;
        wrong += if drawing == wanted[strip.min(wanted.len() - 1)] { 0.0 } else { area };
    }
    wrong / all
}

#[test]
fn every_level_is_drawn_like_the_input_and_every_way_of_building_gives_the_same_bytes() {
    let folder = Folder::empty();
    let (documents, wanted): (Vec<Value>, Vec<Drawing>) = materials().into_iter().unzip();
    save(&folder, "strips.gltf", documents.into_iter());
    let options = "--region-triangles 2000";
    folder.run(&format!("build strips.gltf -o one.lodpack --threads 1 {options}"));
    folder.run(&format!("build strips.gltf -o seven.lodpack --threads 7 {options}"));
    folder.run(&format!("plan strips.gltf -o job --parts 3 {options}"));
    (0..3).for_each(|part| folder.run(&format!("build --job job --part {part}")));
    folder.run("merge job -o merged.lodpack");
    let bytes = folder.read("one.lodpack");
    assert!(bytes == folder.read("seven.lodpack") && bytes == folder.read("merged.lodpack"));
    let file = open(&bytes);
    let kinds: Vec<ChannelKind> = file.channels().iter().map(|channel| channel.kind).collect();
    assert_eq!(kinds, [ChannelKind::Colour, ChannelKind::Drawing]);
    file.verify().expect("sound");
    for level in 0..file.level_count() as u8 {
        let shown = file.extract_textured(&file.uniform_cut(level).expect("a cut"), &[0, 1]).expect("sound");
        let share = share_drawn_otherwise(&shown, &wanted);
        // Where regions meet, a line may end beside a sample of the seam.
        assert!(share < 0.02, "{share} of level {level} is drawn otherwise");
    }
    // Alpha that means nothing is opaque, and alpha that means something is that of the input, which is compared only
    // when it is drawn.
    let shown = file.extract_textured(&file.uniform_cut(file.level_count() as u8 - 1).expect("a cut"), &[0, 1]);
    let shown = shown.expect("sound");
    let mut opacities = BTreeSet::new();
    for (number, (places, drawing)) in shown.places.iter().zip(shown.drawings(1)).enumerate() {
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(colours)) = &texture.images[0] else { panic!("a node has no texels") };
        let middle = [0, 1].map(|axis| places.iter().map(|place| f64::from(place[axis])).sum::<f64>() / 3.0);
        let alpha = colours.interpolated(middle)[3];
        match drawing.alpha {
            AlphaMode::Opaque => assert!(alpha > 250.0, "{alpha}"),
            _ => drop(opacities.insert((alpha / 25.5).round() as i32)),
        }
    }
    assert!([2, 4, 6, 8].iter().all(|tenths| opacities.contains(tenths)), "{opacities:?}");
}

/// What materials of a document say, sorted, as text.
fn drawn(document: &Value) -> BTreeSet<String> {
    let of = |material: &Value| {
        let known = ["alphaMode", "alphaCutoff", "doubleSided", "extensions"].map(|name| material[name].clone());
        Value::from(known.to_vec()).to_string()
    };
    document["materials"].as_array().into_iter().flatten().map(of).collect()
}

fn wanted() -> BTreeSet<String> {
    drawn(&json!({"materials": [
        {}, {"doubleSided": true}, {"extensions": {"KHR_materials_unlit": {}}}, {"alphaMode": "BLEND"},
        {"alphaMode": "MASK", "alphaCutoff": 0.3}, {"alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": true},
    ]}))
}

#[test]
fn exports_have_a_material_for_each_drawing_and_builds_of_them_have_the_same_ones() {
    let folder = Folder::empty();
    save(&folder, "strips.gltf", materials().into_iter().map(|(material, _)| material));
    folder.run("build strips.gltf -o strips.lodpack");
    folder.run("extract strips.lodpack -o strips.glb");
    folder.run("export strips.lodpack -o levels.glb --as glb-lod");
    folder.run("export strips.lodpack -o tiles --as 3dtiles");
    for name in ["strips.glb", "levels.glb"] {
        let document = document(&folder.path(name));
        assert_eq!(drawn(&document), wanted(), "{name}");
        let used = document["extensionsUsed"].as_array().expect("extensions").contains(&"KHR_materials_unlit".into());
        assert!(used, "{document}");
        // Light needs normals, and what has no light needs none.
        for primitive in
            document["meshes"].as_array().into_iter().flatten().flat_map(|mesh| mesh["primitives"].as_array()).flatten()
        {
            let material = &document["materials"][primitive["material"].as_u64().expect("a material") as usize];
            let is_lit = material["extensions"].is_null();
            assert_eq!(primitive["attributes"]["NORMAL"].is_number(), is_lit, "{primitive}");
        }
        validate(&folder.path(name));
    }
    let mut of_tiles = BTreeSet::new();
    for entry in fs::read_dir(folder.path("tiles/0")).expect("a folder of tiles") {
        of_tiles.extend(drawn(&document(&entry.expect("readable").path())));
    }
    assert_eq!(of_tiles, wanted());
    if has_tools("") {
        let found = node("check.js", &[folder.path("tiles").to_str().expect("test paths are UTF-8")]);
        assert_eq!((&found["errors"], &found["warnings"]), (&0.into(), &0.into()), "{found}");
    }
    for again in ["strips.glb", "strips.lodpack"] {
        folder.run(&format!("build {again} -o again.lodpack --force"));
        folder.run("extract again.lodpack -o again.glb --force");
        assert_eq!(drawn(&document(&folder.path("again.glb"))), wanted(), "{again}");
    }
    // A cut that is made coarser is drawn like the one that it was made from.
    folder.run("extract strips.lodpack -o fewer.glb --triangles 300");
    assert_eq!(drawn(&document(&folder.path("fewer.glb"))), wanted());
}

#[test]
fn what_is_drawn_in_the_usual_way_has_no_byte_of_it() {
    let folder = Folder::empty();
    save(&folder, "usual.gltf", (0..2).map(|_| json!({})));
    folder.run("build usual.gltf -o usual.lodpack");
    folder.run("build usual.gltf -o colour.lodpack --channels colour");
    assert!(folder.read("usual.lodpack") == folder.read("colour.lodpack"));
    // A material that no triangle has does not count.
    let mut document: Value = serde_json::from_slice(&folder.read("usual.gltf")).expect("a document");
    document["materials"].as_array_mut().expect("materials").push(json!({"doubleSided": true}));
    fs::write(folder.path("more.gltf"), document.to_string()).expect("writable");
    folder.run("build more.gltf -o more.lodpack");
    assert_eq!(open(&folder.read("more.lodpack")).channels().len(), 1);
    // What nobody wants is left out, and masks are cut as they are baked.
    save(&folder, "masked.gltf", std::iter::once(json!({"alphaMode": "MASK"})));
    folder.run("build masked.gltf -o masked.lodpack --channels colour");
    assert_eq!(open(&folder.read("masked.lodpack")).channels().len(), 1);
}

#[test]
fn surfaces_without_images_are_drawn_like_the_input_too() {
    let folder = Folder::empty();
    save(&folder, "bare.gltf", [json!({"doubleSided": true}), json!({})].into_iter());
    let mut document: Value = serde_json::from_slice(&folder.read("bare.gltf")).expect("a document");
    for material in document["materials"].as_array_mut().expect("materials") {
        material["pbrMetallicRoughness"] = json!({"metallicFactor": 0.0});
    }
    fs::write(folder.path("bare.gltf"), document.to_string()).expect("writable");
    folder.run("build bare.gltf -o bare.lodpack");
    let kinds: Vec<ChannelKind> =
        open(&folder.read("bare.lodpack")).channels().iter().map(|channel| channel.kind).collect();
    assert_eq!(kinds, [ChannelKind::Drawing]);
    folder.run("extract bare.lodpack -o bare.glb");
    folder.run("export bare.lodpack -o tiles --as 3dtiles");
    let both = drawn(&json!({"materials": [{}, {"doubleSided": true}]}));
    assert_eq!(drawn(&crate::levels::document(&folder.path("bare.glb"))), both);
    validate(&folder.path("bare.glb"));
    if has_tools("") {
        let found = node("check.js", &[folder.path("tiles").to_str().expect("test paths are UTF-8")]);
        assert_eq!((&found["errors"], &found["warnings"]), (&0.into(), &0.into()), "{found}");
    }
}

/// The drawings of a file, each once.
fn drawings_of(path: &Path) -> Vec<Drawing> {
    let bytes = fs::read(path).expect("written");
    let file = open(&bytes);
    let Some(channel) = file.channels().iter().position(|channel| channel.kind == ChannelKind::Drawing) else {
        return vec![];
    };
    let cut = file.uniform_cut(file.level_count() as u8 - 1).expect("a cut");
    let mut all = file.extract_textured(&cut, &[channel as u8]).expect("sound").drawings(0);
    all.sort_by_key(|drawing| drawing.number());
    all.dedup();
    all
}

#[test]
fn material_libraries_blend_what_they_say_is_not_opaque() {
    let folder = Folder::empty();
    save(&folder, "unused.gltf", std::iter::once(json!({})));
    let squares: String = (0..9).map(|k| format!("v {} {} 0\nvt {} {}\n", k % 3, k / 3, k % 3, k / 3)).collect();
    let face = |a: u32| format!("f {a}/{a} {b}/{b} {c}/{c} {d}/{d}\n", b = a + 1, c = a + 4, d = a + 3);
    let text = format!("mtllib m.mtl\n{squares}usemtl one\n{}{}usemtl two\n{}{}", face(1), face(2), face(4), face(5));
    fs::write(folder.path("m.obj"), text).expect("writable");
    let blend = Drawing { alpha: AlphaMode::Blend, ..Drawing::default() };
    for (library, wanted) in [
        ("newmtl one\nmap_Kd holes.png\nnewmtl two\nmap_Kd holes.png\nd 1\n", vec![]),
        ("newmtl one\nmap_Kd holes.png\nnewmtl two\nmap_Kd holes.png\nd 0.5\n", vec![Drawing::default(), blend]),
        (
            "newmtl one\nmap_Kd holes.png\nnewmtl two\nmap_Kd holes.png\nmap_d holes.png\n",
            vec![Drawing::default(), blend],
        ),
        ("newmtl one\nmap_d holes.png\nmap_Kd holes.png\nnewmtl two\nTr 0.25\nmap_Kd holes.png\n", vec![blend]),
    ] {
        fs::write(folder.path("m.mtl"), library).expect("writable");
        folder.run("build m.obj -o m.lodpack --force");
        assert_eq!(drawings_of(&folder.path("m.lodpack")), wanted, "{library}");
    }
}
