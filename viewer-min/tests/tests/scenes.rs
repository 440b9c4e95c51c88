//! Several files in one picture.

use std::{path::Path, sync::Arc};

use lodpack::{
    File, Limits, View,
    heights::Heights,
    index::{Placement, UpAxis},
    join_ground,
    stream::Mode,
};
use lodpack_tests::generate::torus;
use lodpack_view::{
    args::Args,
    picture::{BACKGROUND, different_colours, load},
    scene::Scene,
    surface::Looks,
};

use crate::{
    folder, has_gpu,
    heights::{flat, placed},
    program,
};

/// A ring that stands on heights, in kilometres with y up, and a second ring beside it, in metres with z up.
fn town() -> [Vec<u8>; 2] {
    let heights = Heights::open(std::fs::read(flat()).unwrap(), Limits::default()).unwrap();
    let surface = heights.surface();
    let [x, y] = [0, 1].map(|k| surface.first[k] + surface.spacing[k] * [150.0, 86.0][k]);
    let height = heights.window(150..151, 86..87).unwrap()[0];
    let place = |up, unit, x| Placement { up, unit: Some(unit), origin: [x, y, height], crs: String::new() };
    let ring = File::open(placed(&torus(24), place(UpAxis::Y, 1000.0, x)), Limits::default()).unwrap();
    let mut standing = vec![];
    join_ground(&ring, &heights, &mut standing).unwrap();
    [standing, placed(&torus(40), place(UpAxis::Z, 1.0, x + 3000.0))]
}

#[test]
fn a_mesh_its_ground_and_another_mesh_keep_one_budget_of_triangles() {
    let [standing, other] = town().map(Arc::new);
    let looks = Looks { mode: Mode::Synchronous, ..Looks::default() };
    let mut scene = Scene::open_with(standing, looks).unwrap();
    let alone = scene.bounds;
    scene.add(other, looks).unwrap();
    assert_eq!(scene.bounds, alone, "the ground is larger than both");
    let whole = View { viewport: [640, 480], ..View::around([[-4.0; 3], [4.0; 3]], [0.0, 1.0, 0.0], 0.5, 0.25) };
    let at =
        |share: f64, pixel_tolerance| View { position: whole.position.map(|x| x * share), pixel_tolerance, ..whole };
    let coarsest = scene.follow_to_the_end(&at(1.0, 1e6)).unwrap().triangles;
    let finest = scene.follow_to_the_end(&at(1.0, 1e-3)).unwrap().triangles;
    assert!(finest > 8 * coarsest, "{coarsest} {finest}");
    let budget = finest / 2;
    scene.limit(&Args { max_triangles: Some(budget), ..Args::default() });
    for frame in 0..90 {
        let share = if frame < 60 { 1.0 - f64::from(frame) / 90.0 } else { 1.0 / 3.0 };
        let report = scene.follow(&at(share, 1e-3)).unwrap();
        assert!(report.triangles <= budget, "frame {frame}: {} of {budget}", report.triangles);
        assert!(frame < 85 || report.triangles > budget / 2, "frame {frame}: {} of {budget}", report.triangles);
    }
}

#[test]
fn files_stand_in_one_picture_where_they_say() {
    if !has_gpu() {
        return;
    }
    let folder = folder("files-in-one-picture");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let draw = |files: &[&String], name: &str| {
        let out = path(name);
        let files = files.iter().map(|file| file.as_str());
        let rest =
            ["--screenshot", &out, "--size", "320x256", "--camera", "1.5,2,9:1.5,0,0:0,1,0", "--channel", "none"];
        let output = program(&files.chain(rest).collect::<Vec<_>>());
        assert!(output.status.success(), "{output:?}");
        load(Path::new(&out)).unwrap()
    };
    let place = |up, unit, origin| Placement { up, unit: Some(unit), origin, crs: String::new() };
    let files = [
        ("first", placed(&torus(24), place(UpAxis::Y, 1000.0, [0.0; 3]))),
        // Turned, so that its ring lies as the first one's stands, and moved by 3 km.
        ("beside", placed(&torus(24), place(UpAxis::Z, 1000.0, [3000.0, 0.0, 0.0]))),
        ("same", placed(&torus(24), place(UpAxis::Y, 1.0, [0.0; 3]))),
    ]
    .map(|(name, bytes)| {
        std::fs::write(path(name), bytes).unwrap();
        path(name)
    });
    let [first, beside, same] = &files;
    let [alone, both] = [draw(&[first], "alone.png"), draw(&[first, beside], "both.png")];
    let covered = |picture: &image::RgbaImage| picture.pixels().filter(|&&pixel| pixel != BACKGROUND).count();
    assert!(covered(&both) > 3 * covered(&alone) / 2, "{} {}", covered(&alone), covered(&both));
    // A thousandth of it is nothing at all in the hole of the first.
    assert!(different_colours(&alone, &draw(&[first, same], "same.png"), 2).len() < 20);
    // Others come in the coordinates of the first.
    let output = program(&[first, "missing.lodpack", "--screenshot", &path("no.png")]);
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("missing.lodpack"));
}
