//! Images of meshes that `extract` simplifies: fewer triangles have fewer texels and fewer bytes, what must be exact is
//! PNG, and nothing of the texels between charts is seen.

use crate::channels::{Folder, ObjShape, save_coloured, smooth_colour};
use crate::commands::lodpack;
use crate::images::save_sphere_as;
use glam::DVec3;
use lodpack_tests::generate::bumpy_sphere;
use serde_json::Value;
use std::fs;

/// Writes a bumpy sphere of 58,800 triangles as OBJ, whose image is as grainy as a photograph; with opacity, too, if
/// that is wanted.
fn save_grainy(folder: &Folder, has_opacity: bool) {
    let opacity = if has_opacity { "\nmap_d grainy.png" } else { "" };
    save_sphere_as(folder, "grainy", (70, 0.35), &format!("map_Kd grainy.png{opacity}"));
    let mut state = 1_u32;
    let image = image::RgbaImage::from_fn(512, 512, |x, y| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let grain = f64::from(state >> 28) - 8.0;
        let wave = |k: f64| (f64::from(x) * 0.05 * k + (f64::from(y) * 0.07).sin()).sin();
        let [red, green, blue] = [1.0, 1.7, 0.4].map(|k| (128.0 + 80.0 * wave(k) + grain) as u8);
        image::Rgba([red, green, blue, if has_opacity { (x / 2) as u8 } else { 255 }])
    });
    image.save(folder.path("grainy.png")).expect("writable");
}

/// Runs the program; returns the summary that it prints, and what it says.
fn extracted(folder: &Folder, words: &str) -> (Value, String) {
    let out = lodpack().current_dir(folder.path("")).args(words.split_whitespace()).arg("--json").output();
    let out = out.expect("it starts");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{words}: {said}");
    (serde_json::from_slice(&out.stdout).expect("JSON"), said)
}

fn number(value: &Value) -> u64 {
    value.as_u64().expect("a number")
}

#[test]
fn fewer_triangles_have_fewer_texels_and_bytes() {
    let folder = Folder::empty();
    save_grainy(&folder, false);
    folder.run("build grainy.obj -o grainy.lodpack");
    let whole = number(&extracted(&folder, "extract grainy.lodpack -o whole.glb").0["triangles"]);
    let full = folder.read("whole.glb").len() as f64;
    let mut before = [f64::INFINITY; 3];
    for share in [2, 4, 10, 40, 150] {
        let most = whole / share;
        let (summary, said) =
            extracted(&folder, &format!("extract grainy.lodpack -o few.glb --triangles {most} --force"));
        let images = &summary["images"];
        assert!(images["jpeg"] == 1 && images["png"] == 0 && images["coarser"].as_f64() > Some(1.0), "{summary}");
        assert!(said.contains("1 as JPEG") && said.contains("--texels all") && said.contains("--images png"), "{said}");
        let now =
            [folder.read("few.glb").len() as f64, number(&images["texels"]) as f64, number(&images["bytes"]) as f64];
        assert!((0..3).all(|k| now[k] < before[k]), "{most} triangles: {now:?} after {before:?}");
        assert!(share < 10 || now[0] <= 0.6 * full, "{most} triangles: {now:?} of {full}");
        before = now;
        folder.run(&format!("extract grainy.lodpack -o few.obj --triangles {most} --force"));
        assert_eq!(fs::metadata(folder.path("few-0.jpg")).expect("an image").len(), number(&images["bytes"]));
    }
    let few = whole / 10;
    let (all, said) = extracted(&folder, &format!("extract grainy.lodpack -o all.glb --triangles {few} --texels all"));
    assert!(number(&all["images"]["bytes"]) as f64 > 1.3 * before[2] && !said.contains("--texels"), "{said}");
    for most in [100_000, 20_000] {
        for cut in [format!("--triangles {few}"), String::new()] {
            let words = format!("extract grainy.lodpack -o most.glb --texels {most} {cut} --force");
            let (summary, said) = extracted(&folder, &words);
            let texels = number(&summary["images"]["texels"]);
            assert!(texels <= most && texels * 6 > most, "{words}: {texels}; {said}");
        }
    }
}

#[test]
fn opacity_and_what_the_file_has_kept_without_loss_stay_png() {
    let folder = Folder::empty();
    save_grainy(&folder, true);
    folder.run("build grainy.obj -o clear.lodpack");
    let kinds = |words: &str| {
        let images = extracted(&folder, &format!("extract {words} -o out.glb --triangles 900 --force")).0;
        ["png", "jpeg", "webp"].map(|kind| images["images"][kind].as_u64())
    };
    assert_eq!(kinds("clear.lodpack"), [Some(1), Some(0), Some(0)]);
    assert_eq!(kinds("clear.lodpack --images jpeg"), [Some(1), Some(0), Some(0)]);
    save_grainy(&folder, false);
    folder.run("build grainy.obj -o exact.lodpack --color-quality lossless");
    assert_eq!(kinds("exact.lodpack"), [Some(1), Some(0), Some(0)]);
    assert_eq!(kinds("exact.lodpack --images jpeg"), [Some(0), Some(1), Some(0)]);
    assert_eq!(kinds("exact.lodpack --images webp"), [Some(0), Some(0), Some(1)]);
    // Without images nothing is said of them.
    assert!(extracted(&folder, "extract exact.lodpack -o out.stl").0["images"].is_null());
}

/// How far the colours that an OBJ shows are from those that belong there: root mean square and largest, at points of
/// all triangles and of their edges.
fn differences(folder: &Folder, name: &str) -> [f64; 2] {
    let shape = ObjShape::read(folder, &format!("{name}.obj"));
    let file = ["png", "jpg"].map(|end| folder.path(&format!("{name}-0.{end}"))).into_iter().find(|file| file.exists());
    let image = image::open(file.expect("an image")).expect("an image").to_rgb8();
    let shown = |[u, v]: [f64; 2]| {
        let at = |x: f64, count: u32| (x * f64::from(count) - 0.5).clamp(0.0, f64::from(count - 1));
        let [x, y] = [at(u, image.width()), at(1.0 - v, image.height())];
        let mut sum = [0.0; 3];
        for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (column, row) = (x as u32 + right, y as u32 + down);
            let share = |x: f64, next: u32| if next == 1 { x.fract() } else { 1.0 - x.fract() };
            let texel = image.get_pixel(column.min(image.width() - 1), row.min(image.height() - 1)).0;
            (0..3).for_each(|k| sum[k] += share(x, right) * share(y, down) * f64::from(texel[k]));
        }
        sum
    };
    let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0.0);
    for face in &shape.faces {
        let mixtures = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.3, 0.3, 0.4]];
        for weights in mixtures {
            let (position, place) = shape.at(face, weights);
            let wanted = smooth_colour(DVec3::from(position));
            let found = shown(place);
            for k in 0..3 {
                let difference = (found[k] - wanted[k]).abs();
                (sum, largest, count) = (sum + difference * difference, largest.max(difference), count + 1.0);
            }
        }
    }
    assert!(count > 5000.0, "{count}");
    [(sum / count).sqrt(), largest]
}

#[test]
fn no_texel_beside_a_chart_is_seen_however_few_there_are() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(70), &folder.path("coloured.ply"));
    folder.run("build coloured.ply -o out.lodpack --channels colour --color-quality 95");
    folder.run("extract out.lodpack -o all.obj --triangles 1500 --texels all --images png");
    folder.run("extract out.lodpack -o auto.obj --triangles 1500");
    folder.run("extract out.lodpack -o few.obj --triangles 1500 --texels 20000");
    let [all, auto, few] = ["all", "auto", "few"].map(|name| differences(&folder, name));
    // Where triangles are off their surface, so are colours: that holds with any number of texels.
    assert!(auto[0] < all[0] + 2.0 && auto[1] < all[1] + 25.0, "{auto:?} beside {all:?}");
    assert!(few[0] < all[0] + 5.0 && few[1] < all[1] + 50.0, "{few:?} beside {all:?}");
}
