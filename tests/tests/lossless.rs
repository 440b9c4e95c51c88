//! Texels that come back as they were made, and what else holds of files with them.

use crate::channels::{Folder, save_coloured, save_lit, save_two_coloured, seams, texels_of_both_decoders};
use crate::commands::lodpack;
use crate::open;
use glam::DVec3;
use lodpack::Query;
use lodpack::decode::{ChannelImage, TexturedMesh};
use lodpack::index::ChannelKind;
use lodpack_tests::generate::bumpy_sphere;
use std::path::Path;

/// The colours of the texture that [`save_two_coloured`] writes.
const COLOURS: [[f64; 3]; 2] = [[200.0, 40.0, 30.0], [20.0, 60.0, 180.0]];

fn finest(bytes: &[u8]) -> TexturedMesh {
    let file = open(bytes);
    let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    file.extract_textured(&cut, &[0]).expect("sound")
}

/// What is shown in the middle of each triangle.
fn middles(shown: &TexturedMesh) -> Vec<[f64; 3]> {
    let middle = |(number, places): (usize, &[[f32; 2]; 3])| {
        let place = [0, 1].map(|k| places.iter().map(|place| f64::from(place[k])).sum::<f64>() / 3.0);
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(image)) = &texture.images[0] else { panic!("a node has no texels") };
        let [red, green, blue, _] = image.interpolated(place);
        [red, green, blue]
    };
    shown.places.iter().enumerate().map(middle).collect()
}

#[test]
fn the_colours_of_a_palette_are_shown_exactly_and_every_way_of_building_gives_the_same_bytes() {
    let folder = Folder::empty();
    save_two_coloured(&folder);
    let options = "--region-triangles 2500 --color-quality lossless";
    folder.run(&format!("build two.obj -o one.lodpack --threads 1 {options}"));
    folder.run(&format!("build two.obj -o four.lodpack --threads 4 {options}"));
    folder.run(&format!("plan two.obj -o job --parts 3 {options}"));
    (0..3).for_each(|part| folder.run(&format!("build --job job --part {part}")));
    folder.run("merge job -o merged.lodpack");
    folder.run("build two.obj -o lossy.lodpack --region-triangles 2500 --color-quality 100");
    let one = folder.read("one.lodpack");
    assert!(one == folder.read("four.lodpack") && one == folder.read("merged.lodpack"));
    // Interpolation between equal texels rounds.
    let is_exact = |shown: &[f64; 3]| {
        COLOURS.iter().any(|wanted| shown.iter().zip(wanted).all(|(one, other)| (one - other).abs() < 1e-6))
    };
    // But near the line between them, where texels lie across it.
    let are_exact = |bytes: &[u8]| {
        let shown = finest(bytes);
        let middle = |corners: &[u32; 3]| {
            corners.iter().map(|&v| DVec3::from(shown.mesh.positions[v as usize])).sum::<DVec3>() / 3.0
        };
        let is_far = |p: DVec3| (p.z - 0.2 * (p.x * 3.0).sin()).abs() > 0.15;
        let all = middles(&shown).into_iter().zip(&shown.mesh.triangles).filter(|(_, corners)| is_far(middle(corners)));
        let (exact, others): (Vec<_>, Vec<_>) = all.partition(|(colour, _)| is_exact(colour));
        exact.len() as f64 / (exact.len() + others.len()) as f64
    };
    let [exact, lossy] = [one.as_slice(), &folder.read("lossy.lodpack")].map(are_exact);
    assert!(exact > 0.97 && lossy < exact, "{exact} {lossy}");
    // Groups above regions, cuts of a stated size and other programs read them, too.
    folder.run("verify one.lodpack");
    folder.run("extract one.lodpack -o few.glb --triangles 500");
    folder.run("build one.lodpack -o again.lodpack --color-quality lossless");
    let again = are_exact(&folder.read("again.lodpack"));
    assert!(again > 0.9, "{again}");
}

#[test]
fn texels_are_those_of_the_best_quality_but_for_what_that_loses_and_both_sides_of_borders_agree_as_well() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(60), &folder.path("coloured.ply"));
    for quality in ["100", "lossless"] {
        let name = format!("{quality}.lodpack");
        folder.run(&format!("build coloured.ply -o {name} --region-triangles 4000 --color-quality {quality}"));
    }
    let [lossy, lossless] = ["100.lodpack", "lossless.lodpack"].map(|name| folder.read(name));
    let channels = open(&lossless).channels().to_vec();
    // Numbers never lose anything.
    let kinds: Vec<_> = channels.iter().map(|channel| (channel.kind, channel.is_exact, channel.bound > 0.0)).collect();
    assert_eq!(kinds, [(ChannelKind::Colour, true, true), (ChannelKind::Scalar, false, true)]);
    assert_eq!(channels[0].bound, 0.5);
    let of_lossy = open(&lossy).channels()[0].clone();
    assert_eq!((of_lossy.kind, of_lossy.is_exact, of_lossy.bound), (ChannelKind::Colour, false, 0.0));
    let [shown, exact] = [&lossy, &lossless].map(|bytes| finest(bytes));
    assert_eq!(shown.mesh, exact.mesh);
    let (shown_middles, exact_middles) = (middles(&shown), middles(&exact));
    let pairs = shown_middles.as_flattened().iter().zip(exact_middles.as_flattened());
    let most = pairs.map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
    assert!(most > 0.0 && most < 3.0, "{most}");
    let [of_lossy, of_lossless] = [shown, exact].map(|shown| seams(&shown));
    assert!(of_lossless[0] <= of_lossy[0] && of_lossless[1] <= of_lossy[1] + 1.0, "{of_lossless:?} {of_lossy:?}");
}

#[test]
fn normals_and_factors_lose_nothing_either_and_both_decoders_agree() {
    let folder = Folder::empty();
    save_lit(&folder, 24);
    folder.run("build lit.obj -o lit.lodpack --channels all --color-quality lossless --tolerance 1%");
    let bytes = folder.read("lit.lodpack");
    let kinds: Vec<ChannelKind> = open(&bytes).channels().iter().map(|channel| channel.kind).collect();
    assert!([ChannelKind::Normal, ChannelKind::Factor].iter().all(|kind| kinds.contains(kind)), "{kinds:?}");
    assert!(open(&bytes).channels().iter().all(|channel| channel.is_exact == channel.is_of_bytes()));
    let vector = Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors/exact_colours.lodpack");
    for path in [folder.path("lit.lodpack"), vector] {
        let [printed, expected] = texels_of_both_decoders(&path);
        assert_eq!(printed, expected, "{}", path.display());
    }
    let out = lodpack().current_dir(folder.path(".")).args(["info", "lit.lodpack"]).assert().success();
    let said = String::from_utf8_lossy(&out.get_output().stdout).into_owned();
    assert!(said.contains("lossless colour") && said.contains("lossless normal"), "{said}");
}

#[test]
fn qualities_that_do_not_exist_are_refused_and_the_usual_one_is_85() {
    let folder = Folder::empty();
    save_coloured(&bumpy_sphere(12), &folder.path("coloured.ply"));
    for quality in ["0", "101", "best"] {
        let words = ["build", "coloured.ply", "-o", "out.lodpack", "--color-quality", quality];
        let out = lodpack().current_dir(folder.path(".")).args(words).assert().failure();
        let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
        assert!(said.contains("1 to 100") && said.contains("lossless"), "{said}");
    }
    folder.run("build coloured.ply -o usual.lodpack");
    folder.run("build coloured.ply -o same.lodpack --color-quality 85");
    assert!(folder.read("usual.lodpack") == folder.read("same.lodpack"));
}
