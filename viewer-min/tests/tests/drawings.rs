//! Files that say how they are drawn: masks are cut out, blended surfaces scattered over pixels, and unlit ones take no
//! light.

use std::fs;

use lodpack_cli::{
    job::{BuildOptions, build},
    progress::Silent,
};
use lodpack_tests::strips::{materials, strips};
use lodpack_view::picture::load;
use serde_json::{Value, json};

use crate::{folder, has_gpu, program};

const SIZE: [u32; 2] = [900, 200];
/// From above the middle of the strips, with this distance and the tangent of half the angle of view.
const DISTANCE: f64 = 6.0;
const TANGENT: f64 = 0.132;

/// Draws six strips with these materials. Of each strip its pixels, those that show it, and those among them that have
/// the file's red.
fn counts(name: &str, materials: impl Iterator<Item = Value>) -> [[u32; 3]; 6] {
    let folder = folder(name);
    let [input, file, out] = ["strips.gltf", "strips.lodpack", "strips.png"].map(|name| folder.join(name));
    fs::write(&input, strips(materials)).unwrap();
    let options = BuildOptions { inputs: vec![input], ..BuildOptions::default() };
    build(&options, &mut fs::File::create(&file).unwrap(), &Silent).unwrap();
    let angle = 2.0 * TANGENT.atan().to_degrees();
    let camera = format!("3,0.5,{DISTANCE}:3,0.5,0:0,1,0:{angle}");
    let size = SIZE.map(|length| length.to_string()).join("x");
    let [path, out_path] = [&file, &out].map(|path| path.to_str().unwrap());
    let output = program(&[path, "--screenshot", out_path, "--size", &size, "--camera", &camera]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = load(&out).unwrap();
    let background = *picture.get_pixel(0, 0);
    let per_pixel = 2.0 * TANGENT * DISTANCE / f64::from(SIZE[1]);
    let mut counts = [[0_u32; 3]; 6];
    for (x, y, pixel) in picture.enumerate_pixels() {
        let from_middle = [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| f64::from(at) + 0.5 - f64::from(side) / 2.0);
        let [across, down] = from_middle.map(|pixels| pixels * per_pixel);
        let strip = 3.0 + across;
        // Not near the border of two, which the surface's height moves.
        if !(0.0..6.0).contains(&strip) || (strip.fract() - 0.5).abs() > 0.4 || down.abs() > 0.4 {
            continue;
        }
        let [all, shown, plain] = &mut counts[strip as usize];
        *all += 1;
        if *pixel != background {
            *shown += 1;
            *plain += u32::from(pixel[0].abs_diff(200) < 12);
        }
    }
    assert!(counts.iter().all(|[all, ..]| *all > 5000), "{counts:?}");
    counts
}

#[test]
fn strips_show_as_much_of_themselves_as_their_opacity_says() {
    if !has_gpu() {
        return;
    }
    let counts = counts("drawings", materials().into_iter().map(|(material, _)| material));
    for (strip, (&[all, shown, plain], wanted)) in counts.iter().zip([1.0, 0.75, 0.5, 1.0, 1.0, 0.5]).enumerate() {
        let share = f64::from(shown) / f64::from(all);
        assert!((share - wanted).abs() < 0.06, "strip {strip} shows {share}: {counts:?}");
        let is_plain = f64::from(plain) > 0.95 * f64::from(shown);
        assert_eq!(is_plain, strip == 4, "light of strip {strip}: {counts:?}");
    }
}

#[test]
fn nothing_is_shown_of_what_stops_no_light() {
    if !has_gpu() {
        return;
    }
    let blended =
        |opacity: f64| json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, opacity]}});
    let mut unlit = blended(0.0);
    unlit["extensions"] = json!({"KHR_materials_unlit": {}});
    let opaque = || json!({"alphaMode": "OPAQUE"});
    let materials = [blended(0.0), opaque(), unlit, opaque(), blended(0.5), blended(1.0)];
    let counts = counts("clear", materials.into_iter());
    let shares = counts.map(|[all, shown, _]| f64::from(shown) / f64::from(all));
    assert_eq!([shares[0], shares[1], shares[2], shares[3]], [0.0, 1.0, 0.0, 1.0], "{counts:?}");
    assert!((shares[4] - 0.25).abs() < 0.04 && (shares[5] - 0.5).abs() < 0.04, "{counts:?}");
}
