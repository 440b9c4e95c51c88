//! What a surface carries has images in an atlas, and comes back from them.

use crate::channels::{Folder, errors, save_coloured};
use crate::commands::lodpack;
use crate::open;
use lodpack::Query;
use lodpack_cli::geometry_images::{AtlasOptions, WriteOptions, build_atlas, write_atlas};
use lodpack_cli::import::{ImportOptions, Imported, Room, import_large_meshes};
use lodpack_cli::mesh::appearance::Channels;
use lodpack_cli::progress::Silent;
use lodpack_tests::generate::bumpy_sphere;
use serde_json::Value;
use std::fs;

/// Root mean square errors of the colours and of the heights that a file shows at its finest level.
fn finest_errors(bytes: &[u8]) -> [f64; 2] {
    let file = open(bytes);
    file.verify().expect("sound");
    let names: Vec<&str> = file.channels().iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["colour", "height"]);
    let numbers = [file.channels()[1].low, file.channels()[1].step];
    let finest = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    errors(&file.extract_textured(&finest, &[0, 1]).expect("sound"), numbers)
}

fn manifest(folder: &Folder, name: &str) -> Value {
    serde_json::from_slice(&folder.read(&format!("{name}/atlas.json"))).expect("JSON")
}

/// Asserts that images have the same bytes on both sides of each edge that `atlas.json` declares common; returns how
/// many edges.
fn check_borders(folder: &Folder, name: &str, channel: usize) -> usize {
    let manifest = manifest(folder, name);
    let roots = manifest["roots"].as_array().expect("a list");
    let read = |root: &Value| {
        let file = root["images"][channel].as_str().expect("a name");
        image::open(folder.path(name).join(file)).expect("an image").to_rgb8()
    };
    let images: Vec<image::RgbImage> = roots.iter().map(read).collect();
    let pixels = |root: usize, edge: &str| -> Vec<[u8; 3]> {
        let last = images[root].width() - 1;
        let place = |k: u32| match edge {
            "left" => (0, k),
            "top" => (k, 0),
            "right" => (last, k),
            _ => (k, last),
        };
        (0..=last).map(place).map(|(x, y)| images[root].get_pixel(x, y).0).collect()
    };
    let mut count = 0;
    for (number, root) in roots.iter().enumerate() {
        for (edge, neighbour) in root["neighbours"].as_object().expect("an object") {
            let Some(other) = neighbour["root"].as_u64() else { continue };
            let other_edge = neighbour["edge"].as_str().expect("an edge");
            assert_eq!(neighbour["reversed"], false);
            assert_eq!(pixels(number, edge), pixels(other as usize, other_edge), "root {number}, {edge}");
            count += 1;
        }
    }
    count
}

#[test]
fn colours_and_numbers_come_through_an_atlas_of_any_resolution() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(60), &folder.path("coloured.ply"));
    folder.run("atlas coloured.ply -o atlas --mips");
    let root = manifest(&folder, "atlas")["roots"][0].clone();
    assert_eq!(root["images"], serde_json::json!(["root_00000_0_colour.png", "root_00000_0_number0.exr"]));
    // Each mip is an atlas of its own, down to images of 2 x 2 samples.
    let mips = root["resolution"].as_u64().expect("a number") as usize;
    assert!(mips > 2);
    let coarsest = format!("atlas/mip_{mips:02}");
    assert_eq!(manifest(&folder, &coarsest)["roots"][0]["resolution"], 0);
    for name in ["atlas", "atlas/mip_01", &coarsest] {
        assert!(check_borders(&folder, name, 0) > 20, "{name}");
    }
    for (input, most, most_of_number) in [("coloured.ply", 4.0, 0.3), ("atlas", 4.5, 0.3), ("atlas/mip_01", 7.0, 0.5)] {
        folder.run(&format!("build {input} -o out.lodpack --force"));
        let [colours, heights] = finest_errors(&folder.read("out.lodpack"));
        assert!(colours < most && heights < most_of_number, "{input}: {colours}, {heights}");
    }
    folder.run("build atlas -o bare.lodpack --channels none");
    assert_eq!(open(&folder.read("bare.lodpack")).channels().len(), 0);
    // What an older atlas has left is removed, and only that.
    fs::write(folder.path("atlas/mip_02/mine.txt"), "mine").expect("writable");
    folder.run("atlas coloured.ply -o atlas --force --channels none");
    assert_eq!(manifest(&folder, "atlas").get("channels"), None);
    let left = |name: &str| fs::read_dir(folder.path(name)).map_or(0, |entries| entries.count());
    assert_eq!((left("atlas/mip_01"), left("atlas/mip_02")), (0, 1));
    assert!(!folder.path("atlas/root_00000_0_colour.png").exists());
}

#[test]
fn patches_among_images_have_colours_and_numbers_too() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(60), &folder.path("coloured.ply"));
    let options = ImportOptions { channels: Channels::Auto, ..ImportOptions::default() };
    let inputs = [folder.path("coloured.ply")];
    let imported = import_large_meshes(&inputs, &Room::memory_alone(), &options, &Silent).expect("readable");
    let Imported::Memory(surface) = imported else { panic!("unlimited memory") };
    // Many charts that are called too uneven.
    let mut options = AtlasOptions { chart_triangles: 300, retries: 0, ..AtlasOptions::default() };
    options.embed.stretch_limit = 1.15;
    let built = build_atlas(surface, &options, &Silent);
    let (charts, patches) = (built.product.charts.len(), built.product.patches.len());
    assert!(charts > 5 && patches > 0, "{charts} charts, {patches} patches");
    write_atlas(&folder.path("atlas"), &built.product, &WriteOptions::default(), &Silent).expect("writable");
    folder.run("build atlas -o out.lodpack");
    let [colours, heights] = finest_errors(&folder.read("out.lodpack"));
    assert!(colours < 5.0 && heights < 0.4, "{colours}, {heights}");
}

#[test]
fn materials_come_through_an_atlas_and_charts_end_where_drawing_changes() {
    let folder = Folder::empty();
    let sphere = bumpy_sphere(40);
    let mut text = String::from("mtllib m.mtl\n");
    for p in &sphere.positions {
        let n = p.normalize();
        text += &format!("v {} {} {}\nvn {} {} {}\n", p.x, p.y, p.z, n.x, n.y, n.z);
    }
    for (material, is_above) in [("glass", true), ("lamp", false)] {
        text += &format!("usemtl {material}\n");
        for triangle in &sphere.triangles {
            if (triangle.iter().map(|&v| sphere.positions[v as usize].z).sum::<f64>() > 0.3) == is_above {
                let [a, b, c] = triangle.map(|v| v + 1);
                text += &format!("f {a}//{a} {b}//{b} {c}//{c}\n");
            }
        }
    }
    fs::write(folder.path("m.obj"), text).expect("writable");
    let materials = "newmtl glass\nKd 0.9 0.6 0.2\nd 0.4\nPr 0.2\n\nnewmtl lamp\nKd 0.2 0.4 0.9\nKe 0 0.3 0\nPr 0.9\n";
    fs::write(folder.path("m.mtl"), materials).expect("writable");
    folder.run("build m.obj -o straight.lodpack --channels all");
    folder.run("atlas m.obj -o atlas --channels all");
    let drawings: Vec<u64> = manifest(&folder, "atlas")["roots"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|root| root.get("drawing").and_then(Value::as_u64).unwrap_or(0))
        .collect();
    assert!(drawings.contains(&8) && drawings.contains(&0), "{drawings:?}");
    folder.run("build atlas -o through.lodpack --channels all");
    let names = |name: &str| -> Vec<String> {
        open(&folder.read(name)).channels().iter().map(|channel| channel.name.clone()).collect()
    };
    assert_eq!(names("through.lodpack"), names("straight.lodpack"));
    // Normals keep their directions, and each triangle is drawn as before: glass is above.
    let bytes = folder.read("through.lodpack");
    let file = open(&bytes);
    let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let drawing = file.channels().iter().position(|channel| channel.name == "drawing").expect("drawings") as u8;
    let shown = file.extract_textured(&cut, &[drawing]).expect("sound");
    let mut wrong = 0;
    for (triangle, drawing) in shown.mesh.triangles.iter().zip(shown.drawings(0)) {
        let z: f64 = triangle.iter().map(|&v| shown.mesh.positions[v as usize][2]).sum();
        wrong += usize::from((z > 0.3) != (drawing.number() == 8));
    }
    assert!(wrong * 50 < shown.mesh.triangles.len(), "{wrong} of {}", shown.mesh.triangles.len());
}

#[test]
fn damaged_images_of_channels_are_refused_by_name() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(20), &folder.path("coloured.ply"));
    folder.run("atlas coloured.ply -o atlas --resolution 2 --texels 3");
    let whole = folder.read("atlas/atlas.json");
    let refused = |words: [&str; 2]| {
        let out = lodpack()
            .current_dir(folder.path("."))
            .args(["build", "atlas", "-o", "out.lodpack", "--force"])
            .output()
            .expect("runs");
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.code() == Some(2) && words.iter().all(|word| text.contains(word)), "{text}");
    };
    let colour = "atlas/root_00000_0_colour.png";
    let image = folder.read(colour);
    image::RgbImage::new(8, 8).save(folder.path(colour)).expect("writable");
    refused(["root_00000_0_colour.png", "9 x 9"]);
    fs::write(folder.path(colour), &image[..20]).expect("writable");
    refused(["root_00000_0_colour.png", "cannot be used"]);
    fs::remove_file(folder.path(colour)).expect("removable");
    refused(["root_00000_0_colour.png", "cannot be read"]);
    fs::write(folder.path(colour), &image).expect("writable");
    let number = "atlas/root_00000_0_number0.exr";
    let numbers = folder.read(number);
    fs::copy(folder.path("atlas/root_00000_0.exr"), folder.path(number)).expect("writable");
    refused(["root_00000_0_number0.exr", "channel Y"]);
    fs::write(folder.path(number), numbers).expect("writable");
    let edit = |from: &str, to: &str| {
        let text = String::from_utf8(whole.clone()).expect("a text");
        assert!(text.contains(from));
        fs::write(folder.path("atlas/atlas.json"), text.replacen(from, to, 1)).expect("writable");
    };
    edit("\"root_00000_0_colour.png\",", "");
    refused(["root_00000_0.exr", "1 images for 2 channels"]);
    edit("root_00000_0_colour.png", "../colour.png");
    refused(["../colour.png", "plain file name"]);
    edit("\"resolution\": 3", "\"resolution\": 13");
    refused(["colour", "above 12"]);
    edit("\"name\": \"height\"", "\"name\": \"colour\"");
    refused(["colour", "must be different"]);
    edit("\"kind\": \"scalar\"", "\"kind\": \"label\"");
    refused(["height", "classes have a name like"]);
    edit("\"kind\": \"scalar\"", "\"kind\": \"colour\"");
    refused(["height", "another one of its kind"]);
    edit("\"corner\": 0", "\"drawing\": 65535, \"corner\": 0");
    refused(["root_00000_0.exr", "drawn as 65535"]);
}
