//! Colours and numbers of the input come through builds of every kind, and out again.

use crate::commands::lodpack;
use crate::levels::document;
use crate::open;
use glam::DVec3;
use lodpack::Query;
use lodpack::decode::{ChannelImage, TexturedMesh};
use lodpack::index::{ChannelKind, Scale};
use lodpack_cli::mesh::Mesh;
use lodpack_tests::generate::{bumpy_sphere, save_ply, torus};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A smooth colour for each place. The tests in JavaScript know it, too.
/// The colour of the vertices that [`save_coloured`] writes.
pub(crate) fn smooth_colour(p: DVec3) -> [f64; 3] {
    [p.x * 2.0 + p.y, p.y * 3.0, p.z * 4.0].map(|x| 127.5 + 100.0 * x.sin())
}

fn height(p: DVec3) -> f64 {
    p.z * 10.0
}

/// Writes a mesh with a colour and a number per vertex.
pub(crate) fn save_coloured(mesh: &Mesh, path: &Path) {
    let mut out = std::io::BufWriter::new(fs::File::create(path).expect("writable"));
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float height\nelement face {}\n\
         property list uchar uint vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .expect("writable");
    for &p in &mesh.positions {
        p.to_array().iter().for_each(|x| out.write_all(&x.to_le_bytes()).expect("writable"));
        out.write_all(&smooth_colour(p).map(|x| (x + 0.5) as u8)).expect("writable");
        out.write_all(&(height(p) as f32).to_le_bytes()).expect("writable");
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3]).expect("writable");
        triangle.iter().for_each(|v| out.write_all(&v.to_le_bytes()).expect("writable"));
    }
    out.flush().expect("writable");
}

/// A file of a sphere of some 40,000 triangles with a colour and a number per vertex.
pub fn painted_file() -> Vec<u8> {
    let folder = Folder::new();
    folder.run("report coloured.ply --trial --chart-triangles 2048 --tolerance 0.1edge -o painted.lodpack");
    folder.read("painted.lodpack")
}

/// A file of a torus around z, of radius 1, with the normals of its vertices. Where y is above 0 it is of metal and
/// yellow, elsewhere it is matt, blue, and shines green.
pub fn lit_file() -> Vec<u8> {
    let folder = Folder::empty();
    save_lit(&folder, 120);
    folder.run("build lit.obj -o lit.lodpack --channels all --color-quality 95");
    folder.read("lit.lodpack")
}

/// Writes that torus as OBJ, with the given number of vertices around.
pub(crate) fn save_lit(folder: &Folder, count: u32) {
    let torus = torus(count);
    let mut text = String::from("mtllib lit.mtl\n");
    for &p in &torus.positions {
        let outwards = p - DVec3::new(p.x, p.y, 0.0).normalize();
        text += &format!("v {} {} {}\nvn {} {} {}\n", p.x, p.y, p.z, outwards.x, outwards.y, outwards.z);
    }
    for (material, is_above) in [("metal", true), ("matt", false)] {
        text += &format!("usemtl {material}\n");
        for triangle in &torus.triangles {
            if (triangle.iter().map(|&v| torus.positions[v as usize].y).sum::<f64>() > 0.0) == is_above {
                let [a, b, c] = triangle.map(|v| v + 1);
                text += &format!("f {a}//{a} {b}//{b} {c}//{c}\n");
            }
        }
    }
    fs::write(folder.path("lit.obj"), text).expect("writable");
    let materials =
        "newmtl metal\nKd 0.9 0.6 0.2\nPm 1\nPr 0.2\n\nnewmtl matt\nKd 0.2 0.4 0.9\nKe 0 0.3 0\nPm 0\nPr 0.9\n";
    fs::write(folder.path("lit.mtl"), materials).expect("writable");
}

pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn empty() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    /// A folder with a sphere of some 40,000 triangles, with and without channels.
    fn new() -> Self {
        let this = Self::empty();
        let sphere = bumpy_sphere(100);
        save_coloured(&sphere, &this.path("coloured.ply"));
        save_ply(&sphere, &this.path("bare.ply")).expect("writable");
        this
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs the program in the folder; words are separated by spaces.
    pub(crate) fn run(&self, words: &str) {
        lodpack().current_dir(self.0.path()).args(words.split_whitespace()).assert().success();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("written")
    }
}

/// Root mean square differences of what is shown in the middle of each triangle from what belongs there: of colours,
/// and of the number.
pub(crate) fn errors(shown: &TexturedMesh, [low, step]: [f64; 2]) -> [f64; 2] {
    let (mut sums, mut area_in_all) = ([0.0; 2], 0.0);
    for (number, (corners, places)) in shown.mesh.triangles.iter().zip(&shown.places).enumerate() {
        let points = corners.map(|v| DVec3::from(shown.mesh.positions[v as usize]));
        let middle = (points[0] + points[1] + points[2]) / 3.0;
        // The place of the middle is the mean of the corners' places, since a piece is a projection.
        let place = [0, 1].map(|k| places.iter().map(|place| f64::from(place[k])).sum::<f64>() / 3.0);
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let [Some(ChannelImage::Colours(colours)), Some(ChannelImage::Values(values))] = &texture.images[..] else {
            panic!("a node has no texels")
        };
        let area = (points[1] - points[0]).cross(points[2] - points[0]).length();
        let wanted = smooth_colour(middle);
        let got = colours.interpolated(place);
        sums[0] += area * (0..3).map(|k| (got[k] - wanted[k]).powi(2)).sum::<f64>() / 3.0;
        let value = f64::from(values.texel(place[0] as u32, place[1] as u32)[0]);
        sums[1] += area * (low + step * value - height(middle)).powi(2);
        area_in_all += area;
    }
    sums.map(|sum| (sum / area_in_all).sqrt())
}

#[test]
fn every_level_shows_the_colours_and_numbers_of_the_input() {
    let folder = Folder::new();
    // Several regions, with groups above them.
    folder.run("build coloured.ply -o out.lodpack --region-triangles 8000");
    let bytes = folder.read("out.lodpack");
    let file = open(&bytes);
    file.verify().expect("sound");
    let names: Vec<&str> = file.channels().iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["colour", "height"]);
    let numbers = [file.channels()[1].low, file.channels()[1].step];
    let finest = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let cuts = [(finest, 4.0, 0.3)].into_iter().chain([(4000, 6.0, 0.5), (1, 40.0, 2.5)].map(|(triangles, a, b)| {
        let nodes = (triangles == 1).then_some(1);
        let max_triangles = (triangles > 1).then_some(triangles);
        let query = Query { tolerance: Some(0.0), max_triangles, max_nodes: nodes, ..Query::default() };
        (file.select(&query).expect("a cut"), a, b)
    }));
    for (cut, most, most_of_number) in cuts {
        let shown = file.extract_textured(&cut, &[0, 1]).expect("sound");
        assert_eq!(shown.mesh, file.extract(&cut).expect("sound"));
        let [of_colour, of_number] = errors(&shown, numbers);
        let triangles = shown.mesh.triangles.len();
        assert!(of_colour <= most && of_number <= most_of_number, "{triangles} triangles: {of_colour} {of_number}");
    }
}

/// The class of a place, far from that of its neighbours as a number.
fn class(p: DVec3) -> i32 {
    [7, 40_000, 12][((p.x > 0.1) as usize) + ((p.z > 0.3) as usize)]
}

#[test]
fn labels_stay_those_of_the_input() {
    let folder = Folder::new();
    let sphere = bumpy_sphere(60);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty int label\n\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        sphere.positions.len(),
        sphere.triangles.len()
    );
    for &p in &sphere.positions {
        text += &format!("{} {} {} {}\n", p.x, p.y, p.z, class(p));
    }
    sphere.triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    fs::write(folder.path("classes.ply"), text).expect("writable");
    folder.run("build classes.ply -o classes.lodpack --region-triangles 4000");
    let bytes = folder.read("classes.lodpack");
    let file = open(&bytes);
    let [channel] = file.channels() else { panic!("one channel") };
    assert_eq!((channel.kind, channel.low, channel.step, channel.bound), (ChannelKind::Label, 7.0, 1.0, 0.0));
    for (level, most) in [(u8::MAX, 0.02), (1, 0.06), (0, 0.25)] {
        let cut = file.uniform_cut(level.min(file.level_count() as u8 - 1)).expect("a cut");
        let shown = file.extract_textured(&cut, &[0]).expect("sound");
        let (mut wrong, mut count) = (0.0, 0.0);
        for (values, &position) in shown.vertex_values(0, ChannelKind::Label).iter().zip(&shown.mesh.positions) {
            let label = values.expect("every node has texels")[0] as i32 + 7;
            assert!([7, 40_000, 12].contains(&label), "{label}");
            wrong += f64::from(u8::from(label != class(DVec3::from(position))));
            count += 1.0;
        }
        assert!(wrong / count <= most, "level {level}: {wrong} of {count}");
    }
    // Out, as it is and simplified as a whole, and in again.
    for budget in ["", "--triangles 900"] {
        folder.run(&format!("extract classes.lodpack {budget} -o out.ply --force"));
        let out = folder.read("out.ply");
        let end = out.windows(11).position(|bytes| bytes == b"end_header\n").expect("a header") + 11;
        let header = String::from_utf8_lossy(&out[..end]).into_owned();
        assert!(header.contains("property double z\nproperty int label\nelement face"), "{header}");
        let count = header.lines().find_map(|line| line.strip_prefix("element vertex ")).expect("vertices");
        for vertex in out[end..].chunks_exact(28).take(count.parse().expect("a number")) {
            let label = i32::from_le_bytes(vertex[24..].try_into().expect("4 bytes"));
            assert!([7, 40_000, 12].contains(&label), "{label}");
        }
        folder.run("build out.ply -o again.lodpack --force");
        assert_eq!(open(&folder.read("again.lodpack")).channels()[0].kind, ChannelKind::Label);
    }
}

#[test]
fn channels_that_nobody_wants_leave_no_byte() {
    let folder = Folder::new();
    folder.run("build coloured.ply -o none.lodpack --channels none");
    folder.run("build bare.ply -o bare.lodpack");
    assert!(folder.read("none.lodpack") == folder.read("bare.lodpack"));
    folder.run("build coloured.ply -o colour.lodpack --channels colour");
    assert_eq!(open(&folder.read("colour.lodpack")).channels().len(), 1);
}

#[test]
fn every_way_of_building_gives_the_same_texels() {
    let folder = Folder::new();
    let options = "--region-triangles 8000";
    folder.run(&format!("build coloured.ply -o one.lodpack --threads 1 {options}"));
    folder.run(&format!("build coloured.ply -o seven.lodpack --threads 7 {options}"));
    folder.run(&format!("build coloured.ply -o small.lodpack --memory 64MiB {options}"));
    folder.run(&format!("plan coloured.ply -o job --parts 3 {options}"));
    (0..3).for_each(|part| folder.run(&format!("build --job job --part {part}")));
    folder.run("merge job -o merged.lodpack");
    let one = folder.read("one.lodpack");
    for other in ["seven.lodpack", "small.lodpack", "merged.lodpack"] {
        assert!(one == folder.read(other), "{other} differs");
    }
}

#[test]
fn cuts_of_a_stated_size_show_each_colour_on_its_side_of_a_line_with_any_number_of_threads() {
    let folder = Folder::empty();
    save_two_coloured(&folder);
    folder.run("build two.obj -o out.lodpack --color-quality 95");
    for (threads, name) in [("1", "one"), ("7", "seven")] {
        let words = format!("extract out.lodpack -o {name}.obj --triangles 1500 --images png");
        let words = words.split(' ');
        lodpack().current_dir(folder.path(".")).env("RAYON_NUM_THREADS", threads).args(words).assert().success();
    }
    assert!(folder.read("one-0.png") == folder.read("seven-0.png"), "threads change what is shown");
    let shape = ObjShape::read(&folder, "one.obj");
    let image = image::open(folder.path("one-0.png")).expect("an image").to_rgb8();
    let (mut wrong, mut in_all) = (0, 0);
    for face in &shape.faces {
        for weights in [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [0.34, 0.33, 0.33]] {
            let (position, [u, v]) = shape.at(face, weights);
            let beyond = position[2] - 0.2 * (position[0] * 3.0).sin();
            let [x, y] = [u * f64::from(image.width()), (1.0 - v) * f64::from(image.height())].map(|x| x as u32);
            let [red, _, blue] = image.get_pixel(x.min(image.width() - 1), y.min(image.height() - 1)).0;
            // The line between the colours is a zigzag along edges of the input.
            if beyond.abs() > 0.08 {
                wrong += u32::from((blue > red) != (beyond > 0.0));
                in_all += 1;
            }
        }
    }
    assert!(in_all > 4000 && wrong * 200 < in_all, "{wrong} of {in_all} points");
}

/// The triangles of an OBJ file with texture coordinates.
pub(crate) struct ObjShape {
    positions: Vec<Vec<f64>>,
    places: Vec<Vec<f64>>,
    /// Of each corner the numbers of its position and of its place, from 0.
    pub faces: Vec<[[usize; 2]; 3]>,
}

impl ObjShape {
    pub(crate) fn read(folder: &Folder, name: &str) -> Self {
        let text = String::from_utf8(folder.read(name)).expect("a text");
        let rows = |kind: &str| -> Vec<Vec<f64>> {
            let of_kind = text.lines().filter_map(|line| line.strip_prefix(kind));
            of_kind.map(|row| row.split_whitespace().map(|x| x.parse().expect("a number")).collect()).collect()
        };
        let corner = |corner: &str| {
            let mut numbers = corner.split('/').map(|x| x.parse::<usize>().expect("a number") - 1);
            [numbers.next().expect("a vertex"), numbers.next().expect("a place")]
        };
        let faces = text.lines().filter_map(|line| line.strip_prefix("f "));
        let faces = faces.map(|face| face.split_whitespace().map(corner).collect::<Vec<_>>());
        let faces = faces.map(|corners| corners.try_into().expect("a triangle")).collect();
        Self { positions: rows("v "), places: rows("vt "), faces }
    }

    /// The position and the place of a point of a triangle.
    pub(crate) fn at(&self, corners: &[[usize; 2]; 3], weights: [f64; 3]) -> ([f64; 3], [f64; 2]) {
        let mean = |of: &[Vec<f64>], which: usize, k: usize| -> f64 {
            (0..3).map(|i| of[corners[i][which]][k] * weights[i]).sum()
        };
        ([0, 1, 2].map(|k| mean(&self.positions, 0, k)), [0, 1].map(|k| mean(&self.places, 1, k)))
    }
}

/// Writes a bumpy sphere as OBJ, whose texture has one colour for each of two charts, which meet in two zigzags.
pub(crate) fn save_two_coloured(folder: &Folder) {
    let sphere = bumpy_sphere(40);
    let mut text = String::from("mtllib two.mtl\nusemtl two\n");
    for p in &sphere.positions {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
        // Half of the texture for each; some texels beside them are not used.
        for middle in [0.25, 0.75] {
            text += &format!("vt {} {}\n", middle + 0.2 * p.x.clamp(-1.0, 1.0), 0.5 + 0.4 * p.y.clamp(-1.0, 1.0));
        }
    }
    for triangle in &sphere.triangles {
        let middle = triangle.iter().map(|&v| sphere.positions[v as usize]).sum::<DVec3>() / 3.0;
        let chart = usize::from(middle.z > 0.2 * (middle.x * 3.0).sin());
        let [a, b, c] = triangle.map(|v| format!("{}/{}", v + 1, 2 * v as usize + 1 + chart));
        text += &format!("f {a} {b} {c}\n");
    }
    fs::write(folder.path("two.obj"), text).expect("writable");
    fs::write(folder.path("two.mtl"), "newmtl two\nmap_Kd two.png\n").expect("writable");
    let texel = |x: u32, _: u32| image::Rgb(if x < 128 { [200, 40, 30] } else { [20, 60, 180] });
    image::RgbImage::from_fn(256, 256, texel).save(folder.path("two.png")).expect("writable");
}

#[test]
fn colours_that_jump_stay_sharp_and_every_way_of_building_gives_the_same_bytes() {
    let folder = Folder::empty();
    save_two_coloured(&folder);
    let options = "--region-triangles 2500 --color-quality 95";
    folder.run(&format!("build two.obj -o one.lodpack --threads 1 {options}"));
    folder.run(&format!("build two.obj -o seven.lodpack --threads 7 {options}"));
    folder.run(&format!("build two.obj -o small.lodpack --memory 64MiB {options}"));
    folder.run(&format!("plan two.obj -o job --parts 3 {options}"));
    (0..3).for_each(|part| folder.run(&format!("build --job job --part {part}")));
    folder.run("merge job -o merged.lodpack");
    let one = folder.read("one.lodpack");
    for other in ["seven.lodpack", "small.lodpack", "merged.lodpack"] {
        assert!(one == folder.read(other), "{other} differs");
    }
    let file = open(&one);
    // Coarse groups know no lines, so that triangles lie across them.
    for (max_triangles, one_of) in [(None, 200), (Some(2000), 40)] {
        let query = Query { tolerance: Some(0.0), max_triangles, ..Query::default() };
        let cut = file.select(&query).expect("a cut");
        let shown = file.extract_textured(&cut, &[0]).expect("sound");
        let (mut blurred, mut in_all) = (0, 0);
        for (number, places) in shown.places.iter().enumerate() {
            let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
            let Some(ChannelImage::Colours(colours)) = &texture.images[0] else { panic!("a node has no texels") };
            for weights in [[0.96, 0.02, 0.02], [0.02, 0.96, 0.02], [0.02, 0.02, 0.96], [0.34, 0.33, 0.33]] {
                let place = [0, 1].map(|k| (0..3).map(|i| f64::from(places[i][k]) * weights[i]).sum());
                let [red, green, blue, _] = colours.interpolated(place);
                let is_near = |colour: [f64; 3]| {
                    [red, green, blue].iter().zip(colour).all(|(shown, wanted)| (shown - wanted).abs() < 25.0)
                };
                blurred += u32::from(!is_near([200.0, 40.0, 30.0]) && !is_near([20.0, 60.0, 180.0]));
                in_all += 1;
            }
        }
        // Where regions meet, a line may end beside a sample of the seam.
        assert!(blurred * one_of < in_all, "{blurred} of {in_all} points of {} triangles", cut.triangle_count);
    }
}

#[test]
fn pages_are_no_larger_than_somebody_asks_for() {
    let folder = Folder::empty();
    save_two_coloured(&folder);
    folder.run("build two.obj -o two.lodpack --region-triangles 2500");
    let pages = |name: &str| {
        let page = |number: u32| image::image_dimensions(folder.path(&format!("{name}-{number}.png"))).ok();
        (0..).map_while(page).collect::<Vec<_>>()
    };
    folder.run("extract two.lodpack -o one.obj");
    folder.run("extract two.lodpack -o some.obj --page-size 192");
    let (one, some) = (pages("one"), pages("some"));
    assert!(one.len() == 1 && some.len() > 1, "{one:?} {some:?}");
    // Nothing that belongs together is larger.
    assert!(some.iter().all(|&(width, height)| width <= 192 && height <= 192), "{some:?}");
}

#[test]
fn cuts_of_small_parts_that_lie_far_apart_have_no_more_texels_than_these() {
    let folder = Folder::empty();
    let mut mesh = Mesh::default();
    for part in 0..200 {
        // On a sphere of radius 100, of which they cover some millionths.
        let (turn, height) = (f64::from(part) * 2.4, (f64::from(part) + 0.5) / 100.0 - 1.0);
        let across = (1.0 - height * height).sqrt();
        let middle = 100.0 * DVec3::new(across * turn.cos(), across * turn.sin(), height);
        let corner = |k: u32| middle + 0.05 * DVec3::AXES[k as usize];
        mesh.positions.extend([0, 1, 2].map(corner));
        mesh.triangles.push([0, 1, 2].map(|k| 3 * part + k));
    }
    save_coloured(&mesh, &folder.path("parts.ply"));
    folder.run("build parts.ply -o parts.lodpack");
    folder.run("extract parts.lodpack -o few.glb --triangles 20");
    let few = document(&folder.path("few.glb"));
    assert!(few["accessors"][0]["count"].as_u64().is_some_and(|count| count > 3) && !few["images"].is_null(), "{few}");
    let bytes = folder.read("few.glb").len();
    assert!(bytes < 20_000, "{bytes}");
}

#[test]
fn images_have_the_format_that_somebody_asks_for_and_are_factors_where_all_texels_are_the_same() {
    let folder = Folder::empty();
    save_two_coloured(&folder);
    folder.run("build two.obj -o two.lodpack --region-triangles 2500");
    folder.run("extract two.lodpack -o exact.glb --images png");
    folder.run("extract two.lodpack -o lossy.glb --images jpeg");
    let kinds = |name: &str| {
        let document = document(&folder.path(name));
        let images = document["images"].as_array().cloned().unwrap_or_default();
        images.iter().map(|image| image["mimeType"].as_str().unwrap_or_default().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!([kinds("exact.glb"), kinds("lossy.glb")], [["image/png"], ["image/jpeg"]]);
    folder.run("extract two.lodpack -o small.glb --images webp");
    assert_eq!(kinds("small.glb"), ["image/webp"]);
    let small = document(&folder.path("small.glb"));
    assert_eq!(small["textures"][0]["extensions"]["EXT_texture_webp"]["source"], 0);
    assert!(small["extensionsUsed"] == small["extensionsRequired"] && small["textures"][0]["source"].is_null());
    // It is read back as what it was.
    let [exact, back] = ["exact", "small"].map(|name| {
        folder.run(&format!("build {name}.glb -o {name}.again.lodpack"));
        folder.read(&format!("{name}.again.lodpack"))
    });
    assert!(exact == back && folder.read("small.glb").len() < folder.read("exact.glb").len());
    folder.run("extract two.lodpack -o lossy.obj --images jpeg");
    let library = String::from_utf8(folder.read("lossy.mtl")).expect("text");
    assert!(library.contains("map_Kd lossy-0.jpg") && folder.path("lossy-0.jpg").is_file(), "{library}");
    assert!(!folder.path("lossy-0.png").exists());

    image::RgbImage::from_pixel(4, 4, image::Rgb([188, 0, 255])).save(folder.path("two.png")).expect("writable");
    folder.run("build two.obj -o one.lodpack --region-triangles 2500 --color-quality lossless");
    folder.run("extract one.lodpack -o one.glb");
    let one = document(&folder.path("one.glb"));
    let colour = &one["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"];
    assert!((colour[0].as_f64().expect("a number") - 0.502_886).abs() < 1e-5, "{one}");
    assert_eq!((colour[1].as_f64(), colour[2].as_f64(), colour[3].as_f64()), (Some(0.0), Some(1.0), Some(1.0)));
    assert!(one["images"].is_null() && one["textures"].is_null() && one["samplers"].is_null(), "{one}");
    assert!(one["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].is_null(), "{one}");
    // Programs do not agree about what light the factors of OBJ are in.
    folder.run("extract one.lodpack -o one.obj");
    assert_eq!(image::image_dimensions(folder.path("one-0.png")).ok(), Some((1, 1)));
}

/// Writes a flat square as OBJ whose triangles each have one place of an image of five stripes: that of the stripe that
/// they lie in.
fn save_palette(folder: &Folder, side: u32) {
    let mut text = String::from("mtllib flat.mtl\nusemtl flat\n");
    for stripe in 0..STRIPES {
        text += &format!("vt {} 0.5\n", (f64::from(stripe) + 0.5) / f64::from(STRIPES));
    }
    for v in 0..(side + 1) * (side + 1) {
        let [x, y] = [v % (side + 1), v / (side + 1)].map(|x| f64::from(x) / f64::from(side));
        text += &format!("v {x} {y} 0\n");
    }
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        let (corner, stripe) = (y * (side + 1) + x + 1, x * STRIPES / side + 1);
        let [a, b, c, d] = [0, 1, side + 2, side + 1].map(|more| format!("{}/{stripe}", corner + more));
        text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    fs::write(folder.path("flat.obj"), text).expect("writable");
    fs::write(folder.path("flat.mtl"), "newmtl flat\nmap_Kd flat.png\n").expect("writable");
    let texel = |x: u32, _: u32| image::Rgb(stripe_colour(x));
    image::RgbImage::from_fn(STRIPES, 1, texel).save(folder.path("flat.png")).expect("writable");
}

const STRIPES: u32 = 5;

fn stripe_colour(stripe: u32) -> [u8; 3] {
    [[230, 20, 20], [20, 200, 40], [30, 40, 220], [240, 240, 60], [40, 40, 40]][stripe as usize]
}

#[test]
fn a_flat_sheet_of_a_palette_has_each_colour_up_to_its_line() {
    let folder = Folder::empty();
    save_palette(&folder, 20);
    folder.run("build flat.obj -o flat.lodpack");
    let bytes = folder.read("flat.lodpack");
    let file = open(&bytes);
    let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let shown = file.extract_textured(&cut, &[0]).expect("sound");
    // A few triangles are enough for a flat sheet, but the lines have to be among their edges.
    assert!(cut.triangle_count < 100, "{} triangles", cut.triangle_count);
    for (number, places) in shown.places.iter().enumerate() {
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(colours)) = &texture.images[0] else { panic!("a node has no texels") };
        for (i, j) in (1..20).flat_map(|i| (1..20 - i).map(move |j| (i, j))) {
            let weights = [20 - i - j, i, j].map(|share| f64::from(share) / 20.0);
            let corners = shown.mesh.triangles[number].map(|v| shown.mesh.positions[v as usize]);
            let x: f64 = (0..3).map(|k| weights[k] * corners[k][0]).sum::<f64>() * f64::from(STRIPES);
            if (x - x.round()).abs() < 0.05 {
                continue;
            }
            let place = [0, 1].map(|k| (0..3).map(|i| f64::from(places[i][k]) * weights[i]).sum());
            let (got, wanted) = (colours.interpolated(place), stripe_colour(x as u32));
            assert!((0..3).all(|k| (got[k] - f64::from(wanted[k])).abs() < 12.0), "{got:?} for {wanted:?} at {x}");
        }
    }
}

#[test]
fn colours_of_materials_without_textures_are_kept() {
    let folder = Folder::empty();
    let sphere = bumpy_sphere(30);
    fs::write(folder.path("m.mtl"), "newmtl c0\nKd 1 0 0\nnewmtl c1\nKd 0 1 0\nnewmtl c2\nKd 0 0 1\n")
        .expect("writable");
    for count in [1, 3] {
        let mut text = String::from("mtllib m.mtl\n");
        for number in 0..count {
            text += &format!("usemtl c{number}\n");
            for p in &sphere.positions {
                text += &format!("v {} {} {}\n", p.x + 4.0 * number as f64, p.y, p.z);
            }
            let first = number * sphere.positions.len() + 1;
            for triangle in &sphere.triangles {
                let [a, b, c] = triangle.map(|v| v as usize + first);
                text += &format!("f {a} {b} {c}\n");
            }
        }
        fs::write(folder.path("m.obj"), text).expect("writable");
        folder.run("build m.obj -o m.lodpack --force");
        let bytes = folder.read("m.lodpack");
        let file = open(&bytes);
        for level in 0..file.level_count() as u8 {
            let cut = file.uniform_cut(level).expect("a cut");
            let shown = file.extract_textured(&cut, &[0]).expect("sound");
            let right = (0..shown.mesh.triangles.len()).filter(|&number| {
                let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
                let Some(ChannelImage::Colours(colours)) = &texture.images[0] else { panic!("a node has no texels") };
                let place = [0, 1].map(|k| (0..3).map(|i| f64::from(shown.places[number][i][k]) / 3.0).sum());
                let middle: f64 =
                    shown.mesh.triangles[number].iter().map(|&v| shown.mesh.positions[v as usize][0]).sum();
                let wanted = (middle / 12.0).round() as usize;
                let got = colours.interpolated(place);
                (0..3).all(|k| (got[k] - if k == wanted { 255.0 } else { 0.0 }).abs() < 8.0)
            });
            let (right, all) = (right.count(), shown.mesh.triangles.len());
            // The coarsest level has eight triangles a sphere, and hardly more texels.
            let least = if level == 0 { 0.6 } else { 0.9 };
            assert!(right as f64 >= least * all as f64, "{count} spheres, level {level}: {right} of {all} triangles");
        }
    }
}

#[test]
fn parts_on_a_large_ground_have_the_colour_of_their_material_alone() {
    parts_on_a_large_ground(ColoursOf::Materials);
}

#[test]
fn parts_on_a_large_ground_have_their_colour_of_a_palette_alone() {
    parts_on_a_large_ground(ColoursOf::Palette);
}

#[test]
fn parts_on_a_large_ground_have_the_colour_of_their_vertices_alone() {
    parts_on_a_large_ground(ColoursOf::Vertices);
}

/// Where parts have their colours from.
#[derive(Clone, Copy, PartialEq)]
enum ColoursOf {
    Materials,
    Palette,
    Vertices,
}

fn parts_on_a_large_ground(from: ColoursOf) {
    let are_in_palette = from == ColoursOf::Palette;
    let folder = Folder::empty();
    // Numbers that lie between two bytes.
    let colours = [[0.5, 0.7, 0.3], [0.9, 0.1, 0.1], [0.1, 0.3, 0.9], [0.9, 0.9, 0.7]];
    let (mut text, mut materials) = (String::from("mtllib yard.mtl\nusemtl c0\n"), String::new());
    for (number, [red, green, blue]) in colours.iter().enumerate() {
        materials += &format!("newmtl c{number}\nKd {red} {green} {blue}\n");
    }
    if from == ColoursOf::Vertices {
        materials = "newmtl c0\n".to_owned();
    }
    if are_in_palette {
        materials = "newmtl c0\nmap_Kd palette.png\n".to_owned();
        let texel = |x: u32, _: u32| image::Rgb(colours[x as usize / 8].map(|share| (share * 255.0_f64).round() as u8));
        image::RgbImage::from_fn(32, 8, texel).save(folder.path("palette.png")).expect("writable");
        (0..4).for_each(|number| text += &format!("vt {} 0.5\n", (f64::from(number) + 0.5) / 4.0));
    }
    fs::write(folder.path("yard.mtl"), materials).expect("writable");
    let corner = |vertex: usize, material: usize| {
        if are_in_palette { format!("{vertex}/{}", material + 1) } else { vertex.to_string() }
    };
    let place = |[x, y, z]: [f64; 3], material: usize| match (from, colours[material]) {
        (ColoursOf::Vertices, [red, green, blue]) => format!("v {x} {y} {z} {red} {green} {blue}\n"),
        _ => format!("v {x} {y} {z}\n"),
    };
    let side = |corners: [usize; 4], material: usize| {
        let [a, b, c, d] = corners.map(|vertex| corner(vertex, material));
        format!("f {a} {b} {c}\nf {a} {c} {d}\n")
    };
    for [x, y] in [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]] {
        text += &place([x, y, 0.0], 0);
    }
    text += &side([1, 2, 3, 4], 0);
    // Boxes in a row, so near to the ground and to one another that a texel of the ground would lie across all of them.
    for (number, material) in [1, 2, 3, 1, 2].into_iter().enumerate() {
        let low = [3.0 * number as f64 - 7.0, -1.0, 0.25];
        text += &format!("usemtl c{}\n", if from == ColoursOf::Materials { material } else { 0 });
        for corner in 0..8 {
            let [x, y, z] = [0, 1, 2].map(|axis| low[axis] + 2.0 * f64::from(corner >> axis & 1));
            text += &place([x, y, z], material);
        }
        let first = 5 + 8 * number;
        for corners in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            text += &side(corners.map(|corner| first + corner), material);
        }
    }
    fs::write(folder.path("yard.obj"), text).expect("writable");
    folder.run("build yard.obj -o yard.lodpack");
    let bytes = folder.read("yard.lodpack");
    let file = open(&bytes);
    // Materials without images are stored without loss, palettes and colours of vertices are not.
    let is_exact = from == ColoursOf::Materials;
    assert_eq!(file.channels()[0].is_exact, is_exact);
    let most = if is_exact { 0.51 } else { 6.0 };
    let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let shown = file.extract_textured(&cut, &[0]).expect("sound");
    for (number, places) in shown.places.iter().enumerate() {
        let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
        let Some(ChannelImage::Colours(image)) = &texture.images[0] else { panic!("a node has no texels") };
        let middle = shown.mesh.triangles[number].map(|v| shown.mesh.positions[v as usize]);
        let middle = [0, 2].map(|axis| middle.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0);
        let material = if middle[1] < 0.1 { 0 } else { [1, 2, 3, 1, 2][((middle[0] + 7.0) / 3.0) as usize] };
        let wanted = colours[material].map(|share| share * 255.0);
        for weights in [[0.98, 0.01, 0.01], [0.01, 0.98, 0.01], [0.01, 0.01, 0.98], [0.34, 0.33, 0.33]] {
            let place = [0, 1].map(|k| (0..3).map(|i| weights[i] * f64::from(places[i][k])).sum());
            let got = image.interpolated(place);
            assert!((0..3).all(|k| (got[k] - wanted[k]).abs() <= most), "{got:?} for {wanted:?} at {middle:?}");
        }
    }
}

/// What `decode.py --texels` prints of a file, and what the reader makes of it.
pub(crate) fn texels_of_both_decoders(path: &Path) -> [String; 2] {
    let decoder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/decode.py");
    let out = Command::new("python3").arg(decoder).arg("--texels").arg(path).output();
    let out = out.expect("python3 is installed");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let bytes = fs::read(path).expect("readable");
    let file = open(&bytes);
    let mut expected = String::new();
    for root in 0..file.root_count() {
        for block in file.root_contents(root).expect("sound").blocks {
            let patch = file.decode_root(root, block.level).expect("sound");
            let positions = patch.loops.iter().flatten().map(|vertex| vertex.position);
            let positions: Vec<_> = positions.chain(patch.patch.interior.iter().copied()).collect();
            let channels: Vec<_> = file.channels().iter().collect();
            let numbers: Vec<u8> = (0..channels.len() as u8).collect();
            let texels = &file.texels(&[(root, block.level)], &numbers, Scale::Full).expect("sound")[0];
            let texture = lodpack::decode::Texture::decode(texels, &channels, &positions, &patch.patch, 1 << 24);
            let texture = texture.expect("sound");
            let size = texture.map.expect("every block has texels").size;
            let sum = |image: &Option<ChannelImage>| match image {
                Some(ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image)) => {
                    crc32fast::hash(&image.data).to_string()
                }
                Some(ChannelImage::Values(image)) => {
                    let bytes: Vec<u8> = image.data.iter().flat_map(|x| x.to_le_bytes()).collect();
                    crc32fast::hash(&bytes).to_string()
                }
                None => "null".to_owned(),
            };
            let scales = [Scale::Eighth, Scale::Quarter, Scale::Half, Scale::Full];
            let of_scales = scales.map(|scale| {
                let texels = &file.texels(&[(root, block.level)], &numbers, scale).expect("sound")[0];
                lodpack::decode::Texture::decode(texels, &channels, &positions, &patch.patch, 1 << 24).expect("sound")
            });
            let sum_of = |(number, image): (usize, &Option<ChannelImage>)| match image {
                Some(_) if channels[number].is_scaled => {
                    let all = of_scales.iter().map(|texture| sum(&texture.images[number]));
                    format!("[{}]", all.collect::<Vec<_>>().join(", "))
                }
                image => sum(image),
            };
            let sums: Vec<String> = texture.images.iter().enumerate().map(sum_of).collect();
            expected += &format!("{root} {} {} {} [{}]\n", block.level, size[0], size[1], sums.join(", "));
        }
    }
    assert!(expected.lines().count() > 1);
    [String::from_utf8_lossy(&out.stdout).into_owned(), expected]
}

#[test]
fn the_independent_decoder_agrees_about_texels() {
    let folder = Folder::new();
    save_coloured(&bumpy_sphere(16), &folder.path("small.ply"));
    folder.run("build small.ply -o small.lodpack --tolerance 0.5% --channels all");
    let [printed, expected] = texels_of_both_decoders(&folder.path("small.lodpack"));
    assert_eq!(printed, expected);
}

#[test]
fn meshes_with_colours_are_read_back() {
    let folder = Folder::new();
    folder.run("build coloured.ply -o out.lodpack --channels colour");
    let finest = ["out.ply", "out.obj", "out.glb"].map(|name| (name, ""));
    // Simplified as a whole, with images of its own.
    let few = ["few.glb", "few.obj"].map(|name| (name, "--triangles 2500"));
    for (name, budget) in finest.into_iter().chain(few) {
        folder.run(&format!("extract out.lodpack {budget} -o {name}"));
        folder.run(&format!("build {name} -o again.lodpack --channels colour --force"));
        let bytes = folder.read("again.lodpack");
        let file = open(&bytes);
        assert_eq!(file.channels().len(), 1, "{name}");
        let cut = file.select(&Query::default()).expect("a cut");
        let shown = file.extract_textured(&cut, &[0]).expect("sound");
        let (mut worst, mut count) = (0.0_f64, 0);
        for (number, (corners, places)) in shown.mesh.triangles.iter().zip(&shown.places).enumerate().step_by(7) {
            let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
            let Some(ChannelImage::Colours(image)) = &texture.images[0] else { panic!("a node has no texels") };
            let wanted = smooth_colour(DVec3::from(shown.mesh.positions[corners[0] as usize]));
            let got = image.interpolated(places[0].map(f64::from));
            worst += (0..3).map(|k| (got[k] - wanted[k]).powi(2)).sum::<f64>() / 3.0;
            count += 1;
        }
        let error = (worst / f64::from(count)).sqrt();
        assert!(error < 8.0, "{name}: {error}");
    }
    assert!(folder.path("out.mtl").exists() && folder.path("out-0.jpg").exists());
}

#[test]
fn normals_are_those_of_the_input_wherever_few_triangles_are_flat() {
    let folder = Folder::new();
    save_ply(&torus(120), &folder.path("torus.ply")).expect("writable");
    folder.run("build torus.ply -o torus.lodpack --channels all --color-quality 95");
    folder.run("extract torus.lodpack --triangles 600 -o few.glb");
    folder.run("build few.glb -o few.lodpack --channels normal --tolerance 0.01edge --color-quality 95");
    for (name, level, most) in
        [("torus.lodpack", u8::MAX, 2.0), ("torus.lodpack", 2, 10.0), ("few.lodpack", u8::MAX, 10.0)]
    {
        let bytes = folder.read(name);
        let file = open(&bytes);
        assert_eq!(file.channels().iter().map(|channel| channel.name.as_str()).collect::<Vec<_>>(), ["normal"]);
        let cut = file.uniform_cut(level.min(file.level_count() as u8 - 1)).expect("a cut");
        let shown = file.extract_textured(&cut, &[0]).expect("sound");
        let (mut sums, mut flat, mut area_in_all) = (0.0, 0.0, 0.0);
        for (number, (corners, places)) in shown.mesh.triangles.iter().zip(&shown.places).enumerate() {
            let points = corners.map(|v| DVec3::from(shown.mesh.positions[v as usize]));
            let Some(ChannelImage::Normals(image)) =
                &shown.textures[shown.mesh.triangle_nodes[number] as usize].images[0]
            else {
                panic!("a node has no normals")
            };
            let cross = (points[1] - points[0]).cross(points[2] - points[0]);
            let texel = image.interpolated(places[0].map(f64::from));
            let got = DVec3::new(texel[0], texel[1], texel[2]) - 128.0;
            // Away from the circle in the middle of the ring. At a corner triangles are worst, and so are texels, which
            // lie along an axis.
            let outwards = |p: DVec3| p - DVec3::new(p.x, p.y, 0.0).normalize();
            let wanted = outwards(points[0]);
            sums += cross.length() * got.angle_between(wanted).powi(2);
            flat += cross.length() * cross.angle_between(wanted).powi(2);
            area_in_all += cross.length();
        }
        let [error, flat] = [sums, flat].map(|sum: f64| (sum / area_in_all).sqrt().to_degrees());
        assert!(
            error < most && (level > 0 || flat > 3.0 * error),
            "{name}, level {level}: {error}, {flat} of triangles"
        );
    }
}

/// How much the colours on the two sides of edges between nodes differ: root mean square and largest, over points along
/// all of them.
pub(crate) fn seams(shown: &TexturedMesh) -> [f64; 2] {
    let mut sides: std::collections::BTreeMap<[u32; 2], Vec<(usize, usize)>> = Default::default();
    for (number, corners) in shown.mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            sides.entry([a.min(b), a.max(b)]).or_default().push((number, k));
        }
    }
    let node = |number: usize| shown.mesh.triangle_nodes[number];
    let at = |(number, k): (usize, usize), t: f64| {
        let [from, to] = [shown.places[number][k], shown.places[number][(k + 1) % 3]];
        let place = [0, 1].map(|axis| f64::from(from[axis]) * (1.0 - t) + f64::from(to[axis]) * t);
        let Some(ChannelImage::Colours(image)) = &shown.textures[node(number) as usize].images[0] else {
            panic!("a node has no texels")
        };
        image.interpolated(place)
    };
    let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0);
    for pair in sides.values() {
        let &[a, b] = pair.as_slice() else { continue };
        if node(a.0) == node(b.0) {
            continue;
        }
        for t in [0.0, 0.25, 0.5, 0.75] {
            let (one, other) = (at(a, t), at(b, 1.0 - t));
            for k in 0..3 {
                let difference = (one[k] - other[k]).abs();
                sum += difference * difference;
                largest = largest.max(difference);
                count += 1;
            }
        }
    }
    assert!(count > 1000, "{count} points");
    [(sum / f64::from(count)).sqrt(), largest]
}

#[test]
fn both_sides_of_a_border_show_nearly_the_same_colours() {
    let folder = Folder::new();
    // Quantisation moves colours by more than seams do.
    folder.run("build coloured.ply -o out.lodpack --channels colour --color-quality 100 --region-triangles 8000");
    let bytes = folder.read("out.lodpack");
    let file = open(&bytes);
    let finest = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("a cut");
    let found = seams(&file.extract_textured(&finest, &[0]).expect("sound"));
    assert!(found[0] <= 2.5 && found[1] <= 30.0, "{} triangles: {found:?}", finest.triangle_count);
}
