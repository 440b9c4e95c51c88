//! Few triangles with many texels: a photograph on a wall.

use crate::channels::Folder;
use crate::commands::lodpack;
use crate::open;
use lodpack::Query;
use lodpack::decode::ChannelImage;
use serde_json::Value;
use std::fs;

/// Columns and rows of a photograph: more than a map shows of it.
const SIZE: [u32; 2] = [4096, 2560];

/// What a photograph shows at a texel: waves of six texels.
fn texel(x: u32, y: u32) -> [f64; 3] {
    let [x, y] = [x, y].map(|at| f64::from(at) + 0.5);
    [x / 6.0, y / 6.0, (x + y) / 9.0].map(|phase| (127.5 + 90.0 * (phase * std::f64::consts::TAU).sin()).round())
}

/// What it shows anywhere, between texels, too.
fn photographed(place: [f64; 2]) -> [f64; 3] {
    let first = [0, 1].map(|axis| (place[axis] - 0.5).clamp(0.0, f64::from(SIZE[axis] - 2)) as u32);
    let [right, down] = [0, 1].map(|axis| (place[axis] - 0.5 - f64::from(first[axis])).clamp(0.0, 1.0));
    let mut sum = [0.0; 3];
    for (x, share) in [(0, 1.0 - right), (1, right)] {
        for (y, share) in [(0, share * (1.0 - down)), (1, share * down)] {
            let shown = texel(first[0] + x, first[1] + y);
            (0..3).for_each(|k| sum[k] += share * shown[k]);
        }
    }
    sum
}

/// Writes a wall of two triangles with a photograph of a size, `more` of OBJ behind them.
fn save_wall(folder: &Folder, [width, height]: [u32; 2], more: &str) {
    let wall = "mtllib wall.mtl\nusemtl wall\nv 0 0 0\nv 4 0 0\nv 4 0 2.5\nv 0 0 2.5\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    fs::write(folder.path("wall.obj"), format!("{wall}{more}")).expect("writable");
    fs::write(folder.path("wall.mtl"), "newmtl wall\nmap_Kd wall.png\n").expect("writable");
    let bytes = |x, y| image::Rgb(texel(x, y).map(|number| number as u8));
    image::RgbImage::from_fn(width, height, bytes).save(folder.path("wall.png")).expect("writable");
}

fn built(folder: &Folder, words: &str) -> Value {
    let output = lodpack().current_dir(folder.path(".")).args(words.split_whitespace()).output().expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn a_photograph_on_two_triangles_keeps_its_texels_however_it_is_built() {
    let folder = Folder::empty();
    save_wall(&folder, SIZE, "");
    let summary = built(&folder, "build wall.obj -o one.lodpack --threads 1 --json");
    assert_eq!((summary["input_triangles"].as_u64(), summary["triangles"].as_u64()), (Some(2), Some(2)));
    assert_eq!(summary["fallbacks"]["coarser_images"].as_u64(), Some(0));
    // Levels that only texels need are hardly less exact.
    let errors = summary["levels"].as_array().expect("levels").iter().map(|level| level["certified_error"].as_f64());
    assert!(errors.flatten().all(|error| error < 0.01), "{summary}");

    let bytes = folder.read("one.lodpack");
    let file = open(&bytes);
    let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let shown = file.extract_textured(&cut, &[0]).expect("sound");
    assert!(shown.textures.len() >= 2, "{} charts", shown.textures.len());
    let (mut square, mut area_in_all, mut texels) = (0.0, 0.0, 0.0);
    for texture in &shown.textures {
        let Some(ChannelImage::Colours(image)) = &texture.images[0] else { panic!("a node has no texels") };
        texels += f64::from(image.size[0]) * f64::from(image.size[1]);
    }
    for (number, (corners, places)) in shown.mesh.triangles.iter().zip(&shown.places).enumerate() {
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(image)) = &texture.images[0] else { panic!("a node has no texels") };
        let points = corners.map(|v| shown.mesh.positions[v as usize]);
        let side = |k: usize| [points[k][0] - points[0][0], points[k][2] - points[0][2]];
        let area = (side(1)[0] * side(2)[1] - side(1)[1] * side(2)[0]).abs();
        for (i, j) in (1..30).flat_map(|i| (1..30 - i).map(move |j| (i, j))) {
            let weights = [30 - i - j, i, j].map(|share| f64::from(share) / 30.0);
            let mean = |of: &dyn Fn(usize) -> f64| (0..3).map(|k| weights[k] * of(k)).sum::<f64>();
            let got = image.interpolated([0, 1].map(|axis| mean(&|k| f64::from(places[k][axis]))));
            let [x, z] = [0, 2].map(|axis| mean(&|k| points[k][axis]));
            let wanted = photographed([x / 4.0 * f64::from(SIZE[0]), (1.0 - z / 2.5) * f64::from(SIZE[1])]);
            square += area * (0..3).map(|k| (got[k] - wanted[k]).powi(2)).sum::<f64>() / 3.0;
            area_in_all += area;
        }
    }
    let rms = (square / area_in_all).sqrt();
    // In one map it would have half as many texels, and be off by 8.6.
    assert!(rms < 6.0 && texels > 1.5 * f64::from(SIZE[0] * SIZE[1]), "{rms} of 255, {texels} texels");

    folder.run("build wall.obj -o seven.lodpack --threads 7");
    folder.run("build wall.obj -o small.lodpack --memory 256MiB");
    folder.run("plan wall.obj -o job --parts 2");
    (0..2).for_each(|part| folder.run(&format!("build --job job --part {part}")));
    folder.run("merge job -o merged.lodpack");
    for other in ["seven.lodpack", "small.lodpack", "merged.lodpack"] {
        assert!(bytes == folder.read(other), "{other} differs");
    }
}

#[test]
fn images_that_repeat_absurdly_are_bounded_and_others_stay() {
    let folder = Folder::empty();
    save_wall(&folder, [2048, 1024], "v 0 1 0\nv 4 1 0\nv 4 1 2\nvt 1e9 0\nvt 0 1e9\nf 5/1 6/5 7/6\nf 5/1 7/5 6/6\n");
    let summary = built(&folder, "build wall.obj -o out.lodpack --json");
    assert!(summary["charts"].as_u64().is_some_and(|charts| charts < 100), "{summary}");
    folder.run("verify out.lodpack");
}
