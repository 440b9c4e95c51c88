//! Images of the input: larger than memory, on full disks, and of kinds that are decoded as a whole; of opacity alone,
//! and of one colour.

use crate::channels::Folder;
use crate::commands::lodpack;
use crate::open;
use image::{DynamicImage, ImageBuffer, Luma, Rgb, Rgba};
use lodpack::decode::ChannelImage;
use lodpack_tests::generate::bumpy_sphere;
use std::fs;
use std::process::Command;

/// As [`save_sphere_as`], as ball.obj.
fn save_sphere(folder: &Folder, detail: u32, material: &str) {
    save_sphere_as(folder, "ball", (detail, 0.3), material);
}

/// Writes a bumpy sphere as OBJ, on which an image of any kind lies as seen from above; `material` follows the name of
/// its only material. `share` is that of the image which a unit takes.
pub(crate) fn save_sphere_as(folder: &Folder, name: &str, (detail, share): (u32, f64), material: &str) {
    let sphere = bumpy_sphere(detail);
    let mut text = format!("mtllib {name}.mtl\nusemtl {name}\n");
    for p in &sphere.positions {
        text += &format!("v {} {} {}\nvt {} {}\n", p.x, p.y, p.z, 0.5 + share * p.x, 0.5 + share * p.y);
    }
    for triangle in &sphere.triangles {
        let [a, b, c] = triangle.map(|v| v + 1);
        text += &format!("f {a}/{a} {b}/{b} {c}/{c}\n");
    }
    fs::write(folder.path(&format!("{name}.obj")), text).expect("writable");
    fs::write(folder.path(&format!("{name}.mtl")), format!("newmtl {name}\n{material}\n")).expect("writable");
}

/// Runs the program, and returns its exit code and what it says.
fn said(folder: &Folder, words: &str) -> (Option<i32>, String) {
    let out = lodpack().current_dir(folder.path("")).args(words.split_whitespace()).output().expect("it starts");
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

/// Large enough for files where little memory is allowed, and smooth, so that its PNG is small.
fn large_image() -> DynamicImage {
    ImageBuffer::from_fn(1400, 1400, |x, y| Rgb([x / 100 * 16, y / 100 * 16, 90].map(|value| value as u8))).into()
}

#[test]
fn a_large_image_gives_the_same_bytes_in_files_and_a_full_disk_is_an_error() {
    let folder = Folder::empty();
    save_sphere(&folder, 12, "map_Kd large.png");
    large_image().save(folder.path("large.png")).expect("writable");
    folder.run("build ball.obj -o memory.lodpack --memory 1GiB");
    folder.run("build ball.obj -o files.lodpack --memory 40MiB --temp .");
    assert!(folder.read("memory.lodpack") == folder.read("files.lodpack"));
    // A limit on file sizes stands for the disk. Its signal is ignored, so writing fails as on a full disk.
    let built = lodpack();
    let mut shell = Command::new("sh");
    shell.current_dir(folder.path("")).args(["-c", "trap '' XFSZ; ulimit -f 4000; exec \"$@\"", "sh"]);
    shell.arg(built.get_program()).args("build ball.obj -o full.lodpack --memory 40MiB".split(' '));
    let out = shell.output().expect("the shell starts");
    let message = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{message}");
    assert!(message.contains("texels of an image) cannot be written") && message.contains("too large"), "{message}");
    assert!(!message.contains("has no texture") && !folder.path("full.lodpack").exists(), "{message}");
    // What it has done is kept, and another attempt ends with the same file.
    folder.run("build ball.obj -o full.lodpack --memory 40MiB --resume");
    assert!(folder.read("memory.lodpack") == folder.read("full.lodpack"));
}

#[test]
fn an_image_that_is_decoded_as_a_whole_takes_no_more_than_is_allowed() {
    let folder = Folder::empty();
    save_sphere(&folder, 12, "map_Kd large.tif");
    let image: DynamicImage = large_image().to_rgb16().into();
    image.save(folder.path("large.tif")).expect("writable");
    let (code, message) = said(&folder, "build ball.obj -o out.lodpack --memory 40MiB");
    assert_eq!(code, Some(2), "{message}");
    assert!(
        message.contains("large.tif") && message.contains("--memory 83MiB") && message.contains("PNG"),
        "{message}"
    );
    folder.run("build ball.obj -o out.lodpack --memory 83MiB");
    image.save(folder.path("large.png")).expect("writable");
    fs::write(folder.path("ball.mtl"), "newmtl ball\nmap_Kd large.png\n").expect("writable");
    folder.run("build ball.obj -o rows.lodpack --memory 40MiB");
    assert!(folder.read("out.lodpack") == folder.read("rows.lodpack"));
}

#[test]
fn normals_behind_map_bump_are_as_those_of_norm_and_heights_are_noted() {
    let folder = Folder::empty();
    let texel = |x: u32, y: u32| Rgb([100 + (x % 64) as u8, 100 + (y % 64) as u8, 245]);
    ImageBuffer::from_fn(128, 128, texel).save(folder.path("waves.png")).expect("writable");
    ImageBuffer::from_fn(128, 128, |x, y| Luma([(x * y) as u8])).save(folder.path("heights.png")).expect("writable");
    let built = |material: &str| {
        save_sphere(&folder, 12, material);
        let (code, message) = said(&folder, "build ball.obj -o out.lodpack --force");
        assert_eq!(code, Some(0), "{message}");
        (folder.read("out.lodpack"), message)
    };
    let (norm, _) = built("Kd 1 0 0\nnorm waves.png");
    assert!(open(&norm).channels().iter().any(|channel| channel.name == "normal"));
    assert!(built("Kd 1 0 0\nmap_Bump -bm 1 waves.png").0 == norm);
    assert!(built("Kd 1 0 0\nbump heights.png\nnorm waves.png").0 == norm);
    assert!(built("Kd 1 0 0\nmap_Bump -bm 0.2 waves.png").0 != norm);
    let (bare, _) = built("Kd 1 0 0");
    let (left_out, message) = built("Kd 1 0 0\nmap_Bump -bm 0.1 heights.png");
    assert!(left_out == bare && message.contains("heights.png of map_Bump holds heights"), "{message}");
}

/// The share of the surface whose opacity is not what it should be, by where a triangle's corners lie in the images.
fn share_of_wrong_opacity(bytes: &[u8], wanted: impl Fn(f64) -> Option<f64>) -> f64 {
    let file = open(bytes);
    let finest = file.level_count() as u8 - 1;
    let shown = file.extract_textured(&file.uniform_cut(finest).expect("a cut"), &[0]).expect("sound");
    let (mut wrong, mut all) = (0, 0);
    for (number, places) in shown.places.iter().enumerate() {
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(colours)) = &texture.images[0] else { panic!("a node has no texels") };
        let corners = shown.mesh.triangles[number].map(|v| shown.mesh.positions[v as usize]);
        let middle = corners.iter().map(|p| p[0]).sum::<f64>() / 3.0;
        if let Some(wanted) = wanted(0.5 + 0.3 * middle) {
            let place = [0, 1].map(|k| places.iter().map(|place| f64::from(place[k])).sum::<f64>() / 3.0);
            let [.., alpha] = colours.interpolated(place);
            wrong += u32::from((alpha - wanted).abs() > 25.0);
            all += 1;
        }
    }
    f64::from(wrong) / f64::from(all)
}

#[test]
fn opacity_comes_from_an_image_of_its_own_of_any_size() {
    let folder = Folder::empty();
    save_sphere(&folder, 20, "map_Kd colours.png\nmap_d mask.png");
    // The alpha of the image of colours does not count beside another one.
    let colour = |x: u32, y: u32| Rgba([x as u8, y as u8, 90, (x % 200) as u8]);
    ImageBuffer::from_fn(256, 256, colour).save(folder.path("colours.png")).expect("writable");
    let opacity = |x: u32| if x < 50 { 40u8 } else { 200 };
    let grey = ImageBuffer::from_fn(100, 30, |x, _| Luma([opacity(x)]));
    grey.save(folder.path("mask.png")).expect("writable");
    folder.run("build ball.obj -o grey.lodpack");
    let grey = folder.read("grey.lodpack");
    let kinds: Vec<(String, u8)> = open(&grey).channels().iter().map(|of| (of.name.clone(), of.components)).collect();
    assert_eq!(kinds, [("colour".to_owned(), 4), ("drawing".to_owned(), 1)]);
    let wanted = |u: f64| ((u - 0.5).abs() > 0.05).then_some(if u < 0.5 { 40.0 } else { 200.0 });
    let wrong = share_of_wrong_opacity(&grey, wanted);
    assert!(wrong < 0.02, "{wrong}");
    // An image with alpha says it by that, whatever its colours are.
    let with_alpha = ImageBuffer::from_fn(100, 30, |x, y| Rgba([y as u8, 0, 7, opacity(x)]));
    with_alpha.save(folder.path("mask.png")).expect("writable");
    folder.run("build ball.obj -o alpha.lodpack");
    assert!(folder.read("alpha.lodpack") == grey);
    // Without an image of colours, it is all there is.
    fs::write(folder.path("ball.mtl"), "newmtl ball\nKd 1 0 0\nmap_d mask.png\n").expect("writable");
    folder.run("build ball.obj -o red.lodpack");
    let wrong = share_of_wrong_opacity(&folder.read("red.lodpack"), wanted);
    assert!(wrong < 0.02, "{wrong}");
}

#[test]
fn an_image_of_one_colour_costs_nothing_beside_a_factor() {
    let folder = Folder::empty();
    let built = |material: &str| {
        save_sphere(&folder, 20, material);
        folder.run("build ball.obj -o out.lodpack --force");
        folder.read("out.lodpack")
    };
    let factor = built(&format!("Kd {} {} {}", 200.0 / 255.0, 120.0 / 255.0, 40.0 / 255.0));
    let image = DynamicImage::from(ImageBuffer::from_pixel(700, 300, Rgb([200u8, 120, 40])));
    for name in ["one.png", "one.webp"] {
        image.save(folder.path(name)).expect("writable");
        assert!(built(&format!("map_Kd {name}")) == factor, "{name}");
    }
    // Half of the opacity, from one image or from two.
    let half = built(&format!("Kd {} {} {}\nd {}", 200.0 / 255.0, 120.0 / 255.0, 40.0 / 255.0, 128.0 / 255.0));
    ImageBuffer::from_pixel(60, 50, Rgba([200u8, 120, 40, 128])).save(folder.path("half.png")).expect("writable");
    ImageBuffer::from_pixel(9, 9, Luma([128u8])).save(folder.path("grey.png")).expect("writable");
    assert!(built("map_Kd half.png\nmap_d half.png") == half);
    assert!(built("map_Kd one.png\nmap_d grey.png") == half);
    // White everywhere is like no material.
    ImageBuffer::from_pixel(600, 500, Rgb([255u8; 3])).save(folder.path("white.png")).expect("writable");
    assert!(built("map_Kd white.png") == built("illum 2"));
}

#[test]
fn an_image_that_is_shown_where_it_has_one_colour_costs_nothing_either() {
    let folder = Folder::empty();
    // Squares of nine colours, of which the ball shows the one in the middle, or three of them.
    let texel = |x: u32, y: u32| Rgb([x / 100 * 90, y / 100 * 90, 60].map(|value| value as u8));
    ImageBuffer::from_fn(300, 300, texel).save(folder.path("palette.png")).expect("writable");
    let built = |material: &str| {
        save_sphere(&folder, 20, material);
        folder.run("build ball.obj -o out.lodpack --force");
        folder.read("out.lodpack")
    };
    let factor = built(&format!("Kd {0} {0} {1}", 90.0 / 255.0, 60.0 / 255.0));
    // The places of the ball's vertices lie in the middle three fifths.
    assert!(built("map_Kd -o 0.4 0.4 -s 0.2 0.2 palette.png") == factor);
    assert!(built("map_Kd -o 0.4 0 -s 0.2 1 palette.png").len() > factor.len() + 100);
}
