//! Files as 3D Tiles: valid, rendered, and without cracks between tiles of any levels.
//!
//! Validators and the renderer come with `npm ci` in `tests/tiles`. Where they are not there their tests say so and
//! pass, unless `LODPACK_REQUIRE_TILES=1` is set.

use crate::channels::save_coloured;
use crate::commands::lodpack;
use lodpack::index::Ray;
use lodpack_cli::job::{BuildOptions, build_mesh};
use lodpack_cli::measure::selftest::shapes::Random;
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::ModelOptions;
use lodpack_cli::progress::Silent;
use lodpack_tests::generate::{rough_sphere, save_ply, torus};
use lodpack_tests::scene::{Sharing, plant, write_glb};
use lodpack_tests::terrain::{Fractal, Grid};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A file and a folder to export to.
struct Desk {
    dir: tempfile::TempDir,
    file: PathBuf,
    bytes: Vec<u8>,
}

impl Desk {
    fn new(mesh: &Mesh, tolerance: &str) -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        // Small charts, so that there are many tiles.
        let model = ModelOptions {
            tolerance: tolerance.parse().expect("a tolerance"),
            chart_triangles: Some(400),
            ..ModelOptions::default()
        };
        let options = BuildOptions { model, ..BuildOptions::default() };
        let mut bytes = vec![];
        build_mesh(mesh.clone(), &options, &mut bytes, &Silent).expect("a sound mesh builds");
        let file = dir.path().join("model.lodpack");
        fs::write(&file, &bytes).expect("writable");
        Self { dir, file, bytes }
    }

    /// A sphere with colours, numbers and normals.
    fn coloured() -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let (mesh, file) = (dir.path().join("coloured.ply"), dir.path().join("model.lodpack"));
        save_coloured(&rough_sphere(60), &mesh);
        lodpack().arg("build").arg(mesh).arg("-o").arg(&file).args(["--channels", "all"]).assert().success();
        let bytes = fs::read(&file).expect("written");
        Self { dir, file, bytes }
    }

    /// Fractal heights on a plane or on the globe.
    fn terrain(is_globe: bool) -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let (raster, file) = (dir.path().join("dem.tif"), dir.path().join("model.lodpack"));
        let size = if is_globe { [400, 200] } else { [300, 250] };
        let grid = if is_globe { Grid::globe(size) } else { Grid::utm(size) };
        let fractal = Fractal::of_samples(5, size[0]);
        let mut out = fs::File::create(&raster).expect("writable");
        let fill = |row: u32, heights: &mut [f32]| match is_globe {
            true => fractal.globe_row(size, row, 0, heights),
            false => fractal.flat_row(size, row, 0, heights),
        };
        grid.write(&mut out, fill).expect("writable");
        let surface = if is_globe { "wgs84" } else { "plane" };
        let words = ["--heights", "--tolerance", "2", "--surface", surface];
        lodpack().arg("build").arg(raster).arg("-o").arg(&file).args(words).assert().success();
        let bytes = fs::read(&file).expect("written");
        Self { dir, file, bytes }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn export(&self, name: &str, more: &[&str]) -> Value {
        let mut command = lodpack();
        command.arg("export").arg(&self.file).args(["--as", "3dtiles", "--json", "-o"]).arg(self.path(name)).args(more);
        let out = command.assert().success();
        serde_json::from_slice(&out.get_output().stdout).expect("JSON")
    }

    fn refused(&self, name: &str, more: &[&str]) -> String {
        let mut command = lodpack();
        command.arg("export").arg(&self.file).args(["--as", "3dtiles", "-o"]).arg(self.path(name)).args(more);
        String::from_utf8_lossy(&command.assert().code(2).get_output().stderr).into_owned()
    }
}

/// A tile as a viewer finds it, with what replaces it.
#[derive(Default)]
struct Tile {
    error: f64,
    /// Triangles with the coordinates that are stored, in glTF's axes.
    triangles: Vec<[[i64; 3]; 3]>,
    children: Vec<Tile>,
}

/// The root of a tileset, with the tilesets that it leads to.
fn read(path: &Path) -> Tile {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let document: Value = serde_json::from_str(&text).expect("JSON");
    tile(&document["root"], path.parent().expect("it is in a folder"))
}

fn tile(value: &Value, folder: &Path) -> Tile {
    let error = value["geometricError"].as_f64().expect("a number");
    let mut found = Tile { error, ..Tile::default() };
    if let Some(uri) = value["content"]["uri"].as_str() {
        match uri.ends_with(".json") {
            true => return read(&folder.join(uri)),
            false => found.triangles = triangles(&fs::read(folder.join(uri)).expect("the tile is there")),
        }
    }
    found.children = value["children"].as_array().into_iter().flatten().map(|child| tile(child, folder)).collect();
    found
}

/// Decodes the content of a tile.
fn triangles(glb: &[u8]) -> Vec<[[i64; 3]; 3]> {
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!((&glb[..4], word(8)), (&b"glTF"[..], glb.len()));
    let json: Value = serde_json::from_slice(&glb[20..20 + word(12)]).expect("JSON");
    let bytes = &glb[28 + word(12)..];
    let stream = |view: usize| {
        let coded = &json["bufferViews"][view]["extensions"]["EXT_meshopt_compression"];
        let number = |key: &str| coded[key].as_u64().expect("a number") as usize;
        (&bytes[number("byteOffset")..][..number("byteLength")], number("count"))
    };
    let (coded, count) = stream(0);
    assert_eq!(json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["filter"], "EXPONENTIAL");
    let mut words: Vec<[u32; 3]> = meshopt::decode_vertex_buffer(coded, count).expect("vertices");
    meshopt::decode_filter_exp(&mut words);
    // Steps of 2^-40, exactly.
    let step = |word: u32| {
        let steps = f64::from(f32::from_bits(word)) * 2_f64.powi(40);
        assert!(steps.fract() == 0.0 && steps.abs() < 2_f64.powi(62), "{steps}");
        steps as i64
    };
    let points: Vec<[i64; 3]> = words.iter().map(|word| word.map(step)).collect();
    let extremes = |key: &str| -> Vec<f64> {
        json["accessors"][0][key].as_array().expect("three").iter().flat_map(Value::as_f64).collect()
    };
    for (k, (low, high)) in extremes("min").into_iter().zip(extremes("max")).enumerate() {
        let found =
            |pick: fn(i64, i64) -> i64| points.iter().map(|p| p[k]).reduce(pick).map(|x| x as f64 / 2_f64.powi(40));
        assert_eq!((found(i64::min), found(i64::max)), (Some(low), Some(high)));
    }
    assert_eq!(meshopt::decode_vertex_version(coded), Some(0), "EXT_meshopt_compression knows version 0 alone");
    let (coded, count) = stream(1);
    let indices: Vec<u32> = meshopt::decode_index_buffer(coded, count).expect("indices");
    let point = |&index: &u32| points[index as usize];
    indices.chunks_exact(3).map(|t| [point(&t[0]), point(&t[1]), point(&t[2])]).collect()
}

/// Where the vertices of a tile of terrain are, in the tileset's axes.
pub(crate) fn places(glb: &[u8]) -> Vec<[f64; 3]> {
    let (json, all) = triples(glb, "POSITION");
    let moved = [0, 2, 1].map(|k| json["nodes"][0]["translation"][k].as_f64().unwrap_or(0.0));
    all.into_iter().map(|[x, y, z]| [x + moved[0], y - moved[1], z + moved[2]]).collect()
}

/// The JSON of a tile, and three numbers that each of its vertices has, in the tileset's axes.
fn triples(glb: &[u8], attribute: &str) -> (Value, Vec<[f64; 3]>) {
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes")) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + word(12)]).expect("JSON");
    let number = |value: &Value| value.as_u64().expect("a number") as usize;
    let accessor = &json["accessors"][number(&json["meshes"][0]["primitives"][0]["attributes"][attribute])];
    let coded = &json["bufferViews"][number(&accessor["bufferView"])]["extensions"]["EXT_meshopt_compression"];
    let bytes = &glb[28 + word(12)..][number(&coded["byteOffset"])..][..number(&coded["byteLength"])];
    let count = number(&coded["count"]);
    // glTF has y up.
    let turned = |[x, y, z]: [f64; 3]| [x, -z, y];
    let all = if coded["filter"] == "OCTAHEDRAL" {
        assert_eq!((&accessor["componentType"], &accessor["normalized"]), (&5120.into(), &true.into()));
        let mut words: Vec<[i8; 4]> = meshopt::decode_vertex_buffer(bytes, count).expect("vertices");
        meshopt::decode_filter_oct(&mut words);
        words.iter().map(|&[x, y, z, _]| turned([x, y, z].map(|x| (f64::from(x) / 127.0).max(-1.0)))).collect()
    } else {
        let mut words: Vec<[u32; 3]> = meshopt::decode_vertex_buffer(bytes, count).expect("vertices");
        meshopt::decode_filter_exp(&mut words);
        words.iter().map(|word| turned(word.map(|word| f64::from(f32::from_bits(word))))).collect()
    };
    (json, all)
}

/// Collects the triangles of a random cut, as a viewer may draw it: every tile, or all that replaces it.
fn cut(tile: &Tile, random: &mut Random, share: f64, triangles: &mut Vec<[[i64; 3]; 3]>) {
    if tile.children.is_empty() || (!tile.triangles.is_empty() && random.unit() > share) {
        triangles.extend(&tile.triangles);
    } else {
        tile.children.iter().for_each(|child| cut(child, random, share, triangles));
    }
}

/// Edges that have another number of triangles on one side than on the other.
fn open_edges(triangles: &[[[i64; 3]; 3]]) -> usize {
    let mut edges: HashMap<[[i64; 3]; 2], i32> = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|&&balance| balance != 0).count()
}

fn depth(tile: &Tile) -> usize {
    1 + tile.children.iter().map(depth).max().unwrap_or(0)
}

fn visit(tile: &Tile, look: &mut dyn FnMut(&Tile)) {
    look(tile);
    tile.children.iter().for_each(|child| visit(child, look));
}

#[test]
fn tiles_of_any_levels_meet_without_cracks() {
    let desk = Desk::new(&rough_sphere(90), "0.1edge");
    let summary = desk.export("tiles", &[]);
    let root = read(&desk.path("tiles/tileset.json"));
    assert!(depth(&root) >= 4, "only {} levels of tiles: {summary}", depth(&root));
    let (mut random, mut sizes) = (Random(3), BTreeMap::new());
    for round in 0..60 {
        let mut triangles = vec![];
        cut(&root, &mut random, f64::from(round) / 50.0, &mut triangles);
        assert_eq!(open_edges(&triangles), 0, "round {round}: {} triangles", triangles.len());
        *sizes.entry(triangles.len()).or_insert(0) += 1;
    }
    assert!(sizes.len() > 20, "hardly any two cuts differ: {sizes:?}");
    // Without the borders there would be cracks: the test can fail.
    let mut some = vec![];
    root.children.iter().take(1).for_each(|child| some.extend(&child.triangles));
    assert!(root.children.len() < 2 || open_edges(&some) > 0);
}

#[test]
fn tiles_of_any_levels_have_the_same_light_along_borders() {
    let desk = Desk::new(&torus(60), "0.0005edge");
    desk.export("tiles", &[]);
    let (mut names, mut found, mut inside) = (vec![], HashMap::<[u64; 3], Vec<[u64; 3]>>::new(), 0);
    files_below(&desk.path("tiles"), &mut names);
    for name in names.iter().filter(|name| name.extension().is_some_and(|extension| extension == "glb")) {
        let glb = fs::read(name).expect("written");
        let (own, normals) = (places(&glb), triples(&glb, "NORMAL").1);
        // Vertices of edges that one triangle of the tile has.
        let mut edges = HashMap::<[[i64; 3]; 2], Vec<[i64; 3]>>::new();
        let all = triangles(&glb);
        for t in &all {
            (0..3).for_each(|k| {
                edges.entry([t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])]).or_default().push(t[k])
            });
        }
        let border: HashSet<[i64; 3]> =
            edges.iter().filter(|(_, of)| of.len() == 1).flat_map(|(edge, _)| *edge).collect();
        for (place, normal) in own.into_iter().zip(normals) {
            let [x, y, z] = place.map(|x| (x * 2_f64.powi(40)) as i64);
            match border.contains(&[x, z, -y]) {
                // Folds have it inwards.
                true => found.entry(place.map(f64::to_bits)).or_default().push(normal.map(|x| x.abs().to_bits())),
                false => inside += 1,
            }
        }
    }
    let differ = found.values().filter(|normals| normals.iter().any(|normal| *normal != normals[0])).count();
    let shared = found.values().filter(|normals| normals.len() > 1).count();
    assert!(shared > 200 && inside > 1000 && differ * 200 < shared, "{differ} of {shared} differ, {inside} inside");
    // Without, tiles have no normals.
    desk.export("flat", &["--normals", "none"]);
    let glb = fs::read(desk.path("flat").join(names[0].strip_prefix(desk.path("tiles")).expect("inside")));
    let glb = String::from_utf8_lossy(&glb.expect("the same names")).into_owned();
    assert!(!glb.contains("NORMAL"), "{}", names[0].display());
}

#[test]
fn tiles_of_coloured_files_have_their_own_images_and_meet_like_bare_ones() {
    let desk = Desk::coloured();
    desk.export("tiles", &[]);
    desk.export("bare", &["--channels", "none"]);
    let [tiles, bare] = ["tiles", "bare"].map(|name| read(&desk.path(name).join("tileset.json")));
    let mut random = Random(5);
    for share in [0.1, 0.5, 0.9] {
        let mut triangles = vec![];
        cut(&tiles, &mut random, share, &mut triangles);
        assert_eq!(open_edges(&triangles), 0);
    }
    let sorted = |tile: &Tile| {
        let mut all = vec![];
        visit(tile, &mut |tile| all.extend(tile.triangles.iter().map(|t| in_order(*t))));
        all.sort_unstable();
        all
    };
    assert_eq!(sorted(&tiles), sorted(&bare));
    let glb = |folder: &str| {
        let inside = fs::read_dir(desk.path(folder).join("0")).expect("a folder of tiles").flatten();
        let mut files: Vec<_> = inside.map(|entry| entry.path()).collect();
        files.sort();
        let bytes = fs::read(&files[0]).expect("a tile");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
        serde_json::from_slice::<Value>(&bytes[20..20 + length]).expect("JSON")
    };
    let (coloured, grey) = (glb("tiles"), glb("bare"));
    assert_eq!((coloured["images"].as_array().map(Vec::len), grey.get("images")), (Some(2), None));
    let material = &coloured["materials"][0];
    assert_eq!(material["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0);
    assert_eq!(material["normalTexture"]["index"], 1);
    let attributes = coloured["meshes"][0]["primitives"][0]["attributes"].as_object().expect("attributes");
    assert!(["POSITION", "TEXCOORD_0", "NORMAL", "TANGENT"].iter().all(|name| attributes.contains_key(*name)));
}

/// The corners from the smallest one on.
fn in_order(corners: [[i64; 3]; 3]) -> [[i64; 3]; 3] {
    let first = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
    [0, 1, 2].map(|k| corners[(first + k) % 3])
}

#[test]
fn geometric_errors_are_the_certified_ones_and_the_finest_tiles_are_the_finest_level() {
    let desk = Desk::new(&rough_sphere(60), "0.1edge");
    let summary = desk.export("tiles", &[]);
    let file = crate::open(&desk.bytes);
    let finest = file.level(file.level_count() - 1).expect("a level");
    let root = read(&desk.path("tiles/tileset.json"));
    let (mut leaves, mut triangles, mut tiles) = (0.0_f64, 0, 0);
    visit(&root, &mut |tile| {
        tiles += 1;
        assert!(tile.children.iter().all(|child| child.error <= tile.error));
        if tile.children.is_empty() {
            leaves = leaves.max(tile.error);
            triangles += tile.triangles.len() as u64;
        }
    });
    assert_eq!(leaves, finest.max_error);
    assert_eq!(Some(leaves), summary["certified_error"].as_f64());
    assert_eq!((triangles, Some(tiles)), (finest.triangle_count, summary["tiles"].as_u64()));
    assert_eq!(summary["finest_triangles"].as_u64(), Some(triangles));
    // Coarse tiles say at least what their roots say.
    let coarsest = file.level(0).expect("a level").max_error;
    assert!(root.error >= coarsest, "{} < {coarsest}", root.error);
}

#[test]
fn a_tolerance_leaves_out_what_is_finer_and_is_kept() {
    let desk = Desk::new(&rough_sphere(60), "0.1edge");
    let all = desk.export("all", &[]);
    let some = desk.export("some", &["--tolerance", "2%"]);
    assert!(some["tiles"].as_u64() < all["tiles"].as_u64() && some["bytes"].as_u64() < all["bytes"].as_u64());
    let file = crate::open(&desk.bytes);
    let [low, high] = file.bounds().expect("a box");
    let diagonal = (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt();
    assert!(some["certified_error"].as_f64().is_some_and(|error| error <= 0.02 * diagonal), "{some}");
    let mut triangles = vec![];
    cut(&read(&desk.path("some/tileset.json")), &mut Random(1), 1.0, &mut triangles);
    assert_eq!(open_edges(&triangles), 0);
    assert_eq!(Some(triangles.len() as u64), some["finest_triangles"].as_u64());
}

#[test]
fn coordinates_that_need_many_bits_are_exact_too() {
    let desk = Desk::new(&torus(60), "0.0005edge");
    desk.export("tiles", &[]);
    let root = read(&desk.path("tiles/tileset.json"));
    let (file, mut extent) = (crate::open(&desk.bytes), 0);
    visit(&root, &mut |tile| extent = tile.triangles.iter().flatten().flatten().fold(extent, |most, &c| most.max(c)));
    let steps = extent as f64 / 2_f64.powi(40) / file.lattice().step();
    assert!(steps > 65_536.0, "{steps} fit into 16 bits");
    for share in [0.0, 0.5, 1.0] {
        let mut triangles = vec![];
        cut(&root, &mut Random(5), share, &mut triangles);
        assert_eq!(open_edges(&triangles), 0);
    }
}

#[test]
fn an_export_is_the_same_on_any_number_of_threads_and_replaces_only_an_export() {
    let desk = Desk::new(&rough_sphere(60), "0.1edge");
    desk.export("one", &["--threads", "1"]);
    desk.export("four", &["--threads", "4"]);
    let files = |name: &str| {
        let mut files = BTreeMap::new();
        for folder in fs::read_dir(desk.path(name)).expect("readable").flatten().map(|entry| entry.path()) {
            let inside = if folder.is_dir() { folder.clone() } else { desk.path(name) };
            for path in fs::read_dir(inside).expect("readable").flatten().map(|entry| entry.path()) {
                if path.is_file() {
                    let name = path.strip_prefix(desk.path(name)).expect("inside").to_owned();
                    files.insert(name, fs::read(&path).expect("readable"));
                }
            }
        }
        files
    };
    assert!(files("one").len() > 5 && files("one") == files("four"));
    assert!(desk.refused("one", &[]).contains("is not empty; pass --force"));
    desk.export("one", &["--force", "--tolerance", "10%"]);
    assert!(files("one").len() < files("four").len());
    fs::write(desk.path("one/notes.txt"), "mine").expect("writable");
    assert!(desk.refused("one", &["--force"]).contains("holds notes.txt"));
    assert!(desk.refused("model.lodpack", &["--force"]).contains("is a file"));
    assert!(desk.refused("none/tiles", &[]).contains("create it first"));
    fs::create_dir(desk.path("empty")).expect("writable");
    // What an export has left that was killed goes with the next one of that name.
    fs::create_dir_all(desk.path("empty.1.tmp/tiles")).expect("writable");
    fs::write(desk.path("empty.1.tmp/tiles/0.glb"), "half").expect("writable");
    desk.export("empty", &[]);
    let left: Vec<_> =
        fs::read_dir(desk.dir.path()).expect("readable").flatten().map(|entry| entry.file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".tmp")), "{left:?}");
}

/// What `npm ci` in `tests/tiles` installs; fails if it has to be there.
pub(crate) fn has_tools(more: &str) -> bool {
    let there = tools().join("node_modules/gltf-validator").is_dir();
    let runs = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|out| out.status.success());
    let has = there && runs("node") && (more.is_empty() || runs(more));
    if !has {
        let needed = format!("this test needs Node, what `npm ci` in tests/tiles installs, {more}");
        assert!(std::env::var_os("LODPACK_REQUIRE_TILES").is_none_or(|value| value != "1"), "{needed}");
        eprintln!("skipped: {needed}");
    }
    has
}

fn tools() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tiles")
}

/// Runs a script of `tests/tiles`, which prints JSON.
pub(crate) fn node(script: &str, args: &[&str]) -> Value {
    let out = Command::new("node").arg(tools().join(script)).args(args).output().expect("node runs");
    let said = String::from_utf8_lossy(&[out.stdout.clone(), out.stderr].concat()).into_owned();
    assert!(out.status.success(), "{said}");
    serde_json::from_slice(&out.stdout).unwrap_or_else(|error| panic!("{error}: {said}"))
}

#[test]
fn validators_find_nothing_wrong() {
    if has_tools("") {
        let bare = [(rough_sphere(60), "0.1edge"), (torus(60), "0.0005edge")];
        let desks = bare.map(|(mesh, tolerance)| Desk::new(&mesh, tolerance));
        for desk in desks.into_iter().chain([Desk::coloured(), Desk::terrain(false), Desk::terrain(true)]) {
            let summary = desk.export("tiles", &[]);
            let found = node("check.js", &[desk.path("tiles").to_str().expect("test paths are UTF-8")]);
            assert_eq!(
                (&found["tiles"], &found["errors"], &found["warnings"]),
                (&summary["tiles"], &0.into(), &0.into()),
                "{found}"
            );
            // It can find something.
            let mut inside =
                fs::read_dir(desk.path("tiles/0")).expect("a folder of tiles").flatten().map(|entry| entry.path());
            let glb = inside.find(|path| path.extension().is_some_and(|ending| ending == "glb")).expect("a tile");
            let mut bytes = fs::read(&glb).expect("the first tile");
            bytes[4] = 1;
            fs::write(&glb, bytes).expect("writable");
            let out =
                Command::new("node").arg(tools().join("check.js")).arg(desk.path("tiles")).output().expect("node runs");
            assert!(!out.status.success());
        }
    }
}

#[test]
fn another_renderer_draws_the_tiles_in_chromium() {
    if has_tools("chromium") {
        let desk = Desk::new(&rough_sphere(60), "0.1edge");
        let summary = desk.export("tiles", &["--up", "z"]);
        let folder = desk.path("tiles");
        let folder = folder.to_str().expect("test paths are UTF-8");
        let (coarse, fine) = (node("draw.js", &[folder, "400"]), node("draw.js", &[folder, "0.01"]));
        // At first the least, later everything that is in sight.
        assert_eq!(coarse["requests"], summary["first_picture_requests"], "{coarse}");
        assert_eq!(coarse["bytes"], summary["first_picture_bytes"], "{coarse}");
        assert!(coarse["triangles"].as_u64() < fine["triangles"].as_u64(), "{coarse} {fine}");
        let covered = |state: &Value| state["covered"].as_f64().expect("a number");
        assert!(
            covered(&coarse) > 20_000.0 && (covered(&fine) / covered(&coarse) - 1.0).abs() < 0.1,
            "{coarse} {fine}"
        );
        // No row of pixels of what is behind shows between tiles; one or two may be where the surface bends away.
        assert!(fine["visible"].as_u64() > Some(10) && fine["pinholes"].as_u64() <= Some(2), "{fine}");
        // It is drawn where it is, around the middle of its box.
        let [low, high] = crate::open(&desk.bytes).bounds().expect("a box");
        for k in 0..3 {
            let drawn = fine["box"][k + 3].as_f64().expect("a number") - fine["box"][k].as_f64().expect("a number");
            assert!((drawn / (high[k] - low[k]) - 1.0).abs() < 0.1, "{fine}, {low:?} to {high:?}");
        }
    }
}

#[test]
fn another_renderer_knows_the_names_of_objects_that_it_meets() {
    if has_tools("chromium") {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let (input, file) = (folder.path().join("plant.glb"), folder.path().join("plant.lodpack"));
        write_glb(&plant(60), Sharing::Meshes, &input).expect("writable");
        let tiles = folder.path().join("tiles");
        lodpack().arg("build").args([&input, Path::new("-o"), &file]).args(["--tolerance", "0.002"]).assert().success();
        lodpack()
            .arg("export")
            .args([&file, Path::new("-o"), &tiles])
            .args(["--as", "3dtiles", "--up", "z"])
            .assert()
            .success();
        let tiles = tiles.to_str().expect("test paths are UTF-8");
        let checked = node("check.js", &[tiles]);
        assert_eq!((&checked["errors"], &checked["warnings"]), (&0.into(), &0.into()), "{checked}");
        let drawn = node("draw.js", &[tiles, "0.01", "picks"]);
        let bytes = fs::read(&file).expect("built");
        let file = crate::open(&bytes);
        let objects = file.objects().expect("the plant has objects");
        let numbers = |value: &Value| -> [f64; 3] {
            let numbers = value.as_array().expect("three numbers").iter().map(|x| x.as_f64().expect("a number"));
            numbers.collect::<Vec<_>>().try_into().expect("three numbers")
        };
        let (mut same, mut other) = (0, vec![]);
        for pick in drawn["picks"].as_array().expect("a list") {
            let ray = Ray { origin: numbers(&pick["origin"]), direction: numbers(&pick["direction"]) };
            let found = file.pick(ray).expect("sound").and_then(|pick| pick.object);
            let node = found.map(|object| objects.node(object).expect("sound")).unwrap_or_default();
            let text = |key: &str| pick[key].as_str().filter(|text| !text.is_empty()).map(str::to_owned);
            if (text("name"), text("id")) == (node.name.clone(), node.id.clone()) {
                same += 1;
            } else {
                other.push((pick.clone(), node));
            }
        }
        // Single precision may meet another object beside an edge.
        assert!(same > 100 && other.len() * 50 < same, "{same} {other:?}");
    }
}

#[test]
fn a_placement_goes_into_the_file_and_puts_tiles_on_the_globe() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = |name: &str| dir.path().join(name);
    save_ply(&torus(24), &path("a.ply")).expect("writable");
    let run = |args: &[&str], code: i32| {
        let out = lodpack().current_dir(dir.path()).args(args).assert().code(code);
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (said(&out.get_output().stdout), said(&out.get_output().stderr))
    };
    let bytes = |name: &str| fs::read(path(name)).expect("readable");
    let place = ["--crs", "epsg:32632", "--origin", "500000,5200000,400", "--up", "z", "--unit", "cm"];
    run(&[&["build", "a.ply", "--tolerance", "2mm", "-o", "placed.lodpack"], &place[..]].concat(), 0);
    run(&["build", "a.ply", "--tolerance", "0.2", "-o", "plain.lodpack"], 0);
    assert_eq!(bytes("placed.lodpack").len() - bytes("plain.lodpack").len(), 32 + 40 + "EPSG:32632".len());
    let info: Value = serde_json::from_str(&run(&["info", "--json", "placed.lodpack"], 0).0).expect("JSON");
    let found = &info["placement"];
    assert_eq!((&found["crs"], &found["up"], &found["unit"]), (&"EPSG:32632".into(), &"z".into(), &0.01.into()));
    let (said, _) = run(&["info", "placed.lodpack"], 0);
    assert!(
        said.contains("place      EPSG:32632, origin [500000.0, 5200000.0, 400.0], z up, a unit is 0.01 m"),
        "{said}"
    );
    // A job keeps it.
    run(&[&["plan", "a.ply", "--tolerance", "2mm", "-o", "a.job", "--parts", "2"], &place[..]].concat(), 0);
    run(&["build", "--job", "a.job", "--part", "0-1"], 0);
    run(&["merge", "a.job", "-o", "merged.lodpack"], 0);
    assert!(bytes("merged.lodpack") == bytes("placed.lodpack"));
    // So does one to which something is added.
    save_ply(&torus(12), &path("b.ply")).expect("writable");
    run(&[&["plan", "a.ply", "--tolerance", "2mm", "--extensible", "-o", "c.job"], &place[..]].concat(), 0);
    run(&["add", "c.job", "b.ply", "-o", "d.job"], 0);
    run(&["build", "--job", "d.job", "--part", "0"], 0);
    run(&["merge", "d.job", "-o", "added.lodpack"], 0);
    let info: Value = serde_json::from_str(&run(&["info", "--json", "added.lodpack"], 0).0).expect("JSON");
    assert_eq!(&info["placement"], found);
    // Lengths have a unit then.
    run(&["extract", "placed.lodpack", "--tolerance", "5mm", "-o", "some.ply"], 0);
    assert!(
        run(&["extract", "plain.lodpack", "--tolerance", "5mm", "-o", "no.ply"], 2)
            .1
            .contains("does not record the unit")
    );

    run(&["export", "placed.lodpack", "--as", "3dtiles", "-o", "tiles"], 0);
    let document: Value = serde_json::from_slice(&bytes("tiles/tileset.json")).expect("JSON");
    let transform: Vec<f64> =
        document["root"]["transform"].as_array().expect("16").iter().flat_map(Value::as_f64).collect();
    // The torus lies around its origin, so its middle is where PROJ says that the origin is.
    let middle = [4308037.390985, 682326.091068, 4638532.253119];
    assert!((0..3).all(|k| (transform[12 + k] - middle[k]).abs() < 0.02), "{transform:?}");
    // A unit is a centimetre, times the scale of the projection.
    let length = |axis: usize| (0..3).map(|k| transform[4 * axis + k].powi(2)).sum::<f64>().sqrt();
    assert!((length(0) * 0.9996 - 0.01).abs() < 1e-6 && (length(2) - 0.01).abs() < 1e-9, "{transform:?}");
    run(&["export", "placed.lodpack", "--as", "3dtiles", "-o", "local", "--local"], 0);
    run(&["build", "a.ply", "--crs", "EPSG:25832", "-o", "other.lodpack"], 0);
    let (_, said) = run(&["export", "other.lodpack", "--as", "3dtiles", "-o", "none"], 2);
    assert!(said.contains("EPSG:25832, has no formulas") && !path("none").exists(), "{said}");
    assert!(run(&["build", "a.ply", "--crs", "WGS84", "-o", "x.lodpack"], 2).1.contains("EPSG:32632"));
}

#[test]
fn an_archive_holds_the_files_of_the_folder() {
    let desk = Desk::new(&torus(40), "0.1edge");
    let folder = desk.export("tiles", &[]);
    let archive = desk.export("tiles.3tz", &[]);
    assert_eq!(archive["tiles"], folder["tiles"]);
    let bytes = fs::read(desk.path("tiles.3tz")).expect("written");
    assert_eq!(archive["bytes"], bytes.len());
    assert!(!desk.path("tiles.3tz.tiles").exists(), "the folder stays");
    // Python's own ZIP reader checks every sum.
    let unpack =
        "import sys, zipfile; z = zipfile.ZipFile(sys.argv[1]); assert z.testzip() is None; z.extractall(sys.argv[2])";
    let unpacked = desk.path("unpacked");
    let run = Command::new("python3").args(["-c", unpack]).args([&desk.path("tiles.3tz"), &unpacked]).status();
    assert!(run.expect("python3 runs").success());
    assert!(unpacked.join("@3dtilesIndex1@").exists());
    fs::remove_file(unpacked.join("@3dtilesIndex1@")).expect("removed");
    let mut names = vec![];
    files_below(&unpacked, &mut names);
    assert!(names.len() > 3);
    for name in &names {
        let other = desk.path("tiles").join(name.strip_prefix(&unpacked).expect("below it"));
        assert!(
            fs::read(name).expect("readable") == fs::read(&other).expect("also in the folder"),
            "{}",
            name.display()
        );
    }
    assert!(desk.refused("tiles.3tz", &[]).contains("--force"));
    desk.export("tiles.3tz", &["--force"]);
    assert!(bytes == fs::read(desk.path("tiles.3tz")).expect("written again"), "the archive has other bytes");
}

fn files_below(folder: &Path, names: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("readable").flatten() {
        match entry.path().is_dir() {
            true => files_below(&entry.path(), names),
            false => names.push(entry.path()),
        }
    }
}

/// Takes a tile: its number of levels below the top, what the tileset says of it, and its vertices.
type TakesTile<'a> = dyn FnMut(usize, &Value, Vec<[f64; 3]>) + 'a;

/// Calls `with` for each tile with content.
fn for_each_content(tile: &Value, folder: &Path, depth: usize, with: &mut TakesTile) {
    if let Some(uri) = tile["content"]["uri"].as_str() {
        if uri.ends_with(".json") {
            let text = fs::read_to_string(folder.join(uri)).expect("it is there");
            let inner: Value = serde_json::from_str(&text).expect("JSON");
            let folder = folder.join(uri);
            return for_each_content(&inner["root"], folder.parent().expect("in a folder"), depth, with);
        }
        with(depth, tile, places(&fs::read(folder.join(uri)).expect("the tile is there")));
    }
    for child in tile["children"].as_array().into_iter().flatten() {
        assert!(child["geometricError"].as_f64() <= tile["geometricError"].as_f64());
        for_each_content(child, folder, depth + 1, with);
    }
}

#[test]
fn tiles_of_heights_lie_where_the_samples_are() {
    let desk = Desk::terrain(false);
    desk.export("flat", &["--local"]);
    let file = lodpack::heights::Heights::open(desk.bytes.as_slice(), lodpack::Limits::default()).expect("sound");
    let (surface, [columns, rows]) = (*file.surface(), file.grid().samples());
    let samples = file.window(0..columns, 0..rows).expect("in the grid");
    let root: Value =
        serde_json::from_str(&fs::read_to_string(desk.path("flat/tileset.json")).expect("written")).unwrap();
    let root = &root["root"];
    let moved: Vec<f64> = (12..15).map(|k| root["transform"][k].as_f64().expect("a number")).collect();
    let (mut found, mut deepest, mut skirts) = (0, 0, 0);
    for_each_content(root, &desk.path("flat"), 0, &mut |depth, tile, places| {
        let error = tile["geometricError"].as_f64().expect("a number");
        deepest = deepest.max(depth);
        for place in places {
            let [x, y, z] = [0, 1, 2].map(|k| place[k] + moved[k]);
            let [column, row] =
                [(x - surface.first[0]) / surface.spacing[0], (y - surface.first[1]) / surface.spacing[1]];
            assert!((column - column.round()).abs() < 1e-3 && (row - row.round()).abs() < 1e-3, "{column} {row}");
            let height = samples[(row.round() as u64 * columns + column.round() as u64) as usize];
            // Vertices are samples, or hang below them.
            match (z - height).abs() < 0.05 {
                true => found += 1,
                false => {
                    assert!(z < height, "{z} {height} {error}");
                    skirts += 1;
                }
            }
        }
    });
    assert!(deepest >= 2 && found > 10_000 && skirts > 1_000 && skirts < found, "{deepest} {found} {skirts}");
}

#[test]
fn tiles_of_heights_are_lit_as_the_globe_is_round() {
    for (desk, is_globe, options) in [
        (Desk::terrain(true), true, &[][..]),
        (Desk::terrain(false), false, &["--local"]),
        (Desk::terrain(false), true, &[]),
    ] {
        desk.export("lit", options);
        let text = fs::read_to_string(desk.path("lit/tileset.json")).expect("written");
        let tileset: Value = serde_json::from_str(&text).expect("JSON");
        // Tiles lie around an origin of the whole tileset.
        let origin = [12, 13, 14].map(|k| tileset["root"]["transform"][k].as_f64().unwrap_or(0.0));
        let (mut names, mut compared, mut steep) = (vec![], 0, 0.0_f64);
        files_below(&desk.path("lit"), &mut names);
        for name in names.iter().filter(|name| name.extension().is_some_and(|extension| extension == "glb")) {
            let glb = fs::read(name).expect("written");
            let (_, normals) = triples(&glb, "NORMAL");
            for (place, normal) in places(&glb).into_iter().zip(normals) {
                let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!((length(normal) - 1.0).abs() < 0.02, "{normal:?}");
                let place = [0, 1, 2].map(|k| origin[k] + place[k]);
                let up = if is_globe { place.map(|x| x / length(place)) } else { [0.0, 0.0, 1.0] };
                let cosine: f64 = (0..3).map(|k| up[k] * normal[k]).sum();
                // This terrain has slopes of up to 87 degrees, and no overhangs.
                assert!(cosine > 0.04, "{place:?} {normal:?}");
                steep = steep.max(1.0 - cosine);
                compared += 1;
            }
        }
        assert!(compared > 10_000 && steep > 0.002, "{compared} {steep}");
    }
}

#[test]
fn tiles_of_projected_heights_bend_with_the_globe() {
    let desk = Desk::terrain(false);
    let flat = desk.export("local", &["--local"]);
    let round = desk.export("globe", &[]);
    assert_eq!(flat["tiles"], round["tiles"]);
    // 300 samples of 30 m are 9 km, over which a plane leaves the globe by metres.
    let text = fs::read_to_string(desk.path("globe/tileset.json")).expect("written");
    let root: Value = serde_json::from_str(&text).expect("JSON");
    let transform = &root["root"]["transform"];
    let moved: Vec<f64> = (12..15).map(|k| transform[k].as_f64().expect("a number")).collect();
    let mut heights = [f64::INFINITY, f64::NEG_INFINITY];
    for_each_content(&root["root"], &desk.path("globe"), 0, &mut |_, tile, places| {
        if tile["children"].is_null() {
            for place in places {
                let length = (0..3).map(|k| (place[k] + moved[k]).powi(2)).sum::<f64>().sqrt();
                heights = [heights[0].min(length), heights[1].max(length)];
            }
        }
    });
    // All on the ellipsoid, give or take mountains and how it is flattened within 9 km.
    assert!(heights[0] > 6_356_000.0 && heights[1] < 6_390_000.0 && heights[1] - heights[0] < 13_000.0, "{heights:?}");
    let globe = Desk::terrain(true);
    let summary = globe.export("tiles", &[]);
    assert!(summary["tiles"].as_u64() > Some(5), "{summary}");
}
