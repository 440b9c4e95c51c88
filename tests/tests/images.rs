//! Images of the input: larger than memory, on full disks, and of kinds that are decoded as a whole.

use crate::channels::Folder;
use crate::commands::lodpack;
use image::{DynamicImage, ImageBuffer, Rgb};
use lodpack_tests::generate::bumpy_sphere;
use std::fs;
use std::process::Command;

/// Writes a bumpy sphere as OBJ, on which an image of any kind lies as seen from above; `material` follows the name of its only material.
fn save_sphere(folder: &Folder, detail: u32, material: &str) {
    let sphere = bumpy_sphere(detail);
    let mut text = String::from("mtllib ball.mtl\nusemtl ball\n");
    for p in &sphere.positions {
        text += &format!("v {} {} {}\nvt {} {}\n", p.x, p.y, p.z, 0.5 + 0.3 * p.x, 0.5 + 0.3 * p.y);
    }
    for triangle in &sphere.triangles {
        let [a, b, c] = triangle.map(|v| v + 1);
        text += &format!("f {a}/{a} {b}/{b} {c}/{c}\n");
    }
    fs::write(folder.path("ball.obj"), text).expect("writable");
    fs::write(folder.path("ball.mtl"), format!("newmtl ball\n{material}\n")).expect("writable");
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
