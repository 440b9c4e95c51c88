<<<<<<< HEAD
//! Objects through the program: what an input named is listed, taken out by name, and comes back when that is built
//! again.

use crate::commands::lodpack;
use glam::DVec3;
use lodpack::{File, Limits, index::Ray};
use lodpack_tests::scene::{Scene, Sharing, plant, write_glb};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A folder with `plant.glb`, and `plant.lodpack` of it within two millimetres.
struct Folder(tempfile::TempDir, Scene);

impl Folder {
    fn new(count: u32) -> Self {
        let folder = Self(tempfile::tempdir().expect("a temporary directory"), plant(count));
        write_glb(&folder.1, Sharing::Meshes, &folder.path("plant.glb")).expect("writable");
        folder.run("build plant.glb -o plant.lodpack --tolerance 0.002");
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, words: &str) -> String {
        let ran = lodpack().current_dir(self.0.path()).args(words.split_whitespace()).assert().success();
        String::from_utf8(ran.get_output().stdout.clone()).expect("UTF-8")
    }

    fn json(&self, words: &str) -> Value {
        serde_json::from_str(&self.run(&format!("{words} --json"))).expect("--json prints JSON")
    }

    fn list(&self, name: &str) -> Vec<Value> {
        let info = self.json(&format!("info {name} --objects"));
        info["objects"]["list"].as_array().expect("a file with objects lists them").clone()
    }
}

/// Name, id and the names of all above, and how many objects have these.
type Counts = BTreeMap<(Option<String>, Option<String>, String), usize>;

fn listed(list: &[Value]) -> Counts {
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let mut counts = Counts::new();
    for node in list.iter().filter(|node| node["leaves"].is_number()) {
        // Files of glTF begin with a node that turns all others.
        let path = node["path"].as_str().unwrap_or_default().trim_start_matches('/').to_owned();
        let key = (text(&node["name"]), text(&node["id"]), path);
        *counts.entry(key).or_default() += 1;
    }
    counts
}

fn of_scene(scene: &Scene) -> Counts {
    let mut counts = Counts::new();
    for node in scene.nodes.iter().filter(|node| node.shape.is_some()) {
        let (mut path, mut above) = (vec![], node.parent);
        while let Some(number) = above {
            let node = &scene.nodes[number as usize];
            path.push(node.name.clone().unwrap_or_default());
            above = node.parent;
        }
        path.reverse();
        *counts.entry((node.name.clone(), node.id.clone(), path.join("/"))).or_default() += 1;
    }
    counts
}

#[test]
fn what_a_plant_names_is_listed_and_comes_back_through_extracted_glb() {
    let folder = Folder::new(300);
    folder.run("verify plant.lodpack");
    let list = folder.list("plant.lodpack");
    assert_eq!(listed(&list), of_scene(&folder.1));
    let triangles: u64 = list.iter().filter_map(|node| node["triangles"].as_u64()).sum();
    let finest = folder.json("info plant.lodpack")["levels"].as_array().and_then(|all| all.last().cloned());
    assert_eq!(finest.expect("levels")["triangles"].as_u64(), Some(triangles));
    let tops: Vec<String> = list
        .iter()
        .filter(|node| node["parent"].is_null())
        .map(|node| format!("--object #{}", node["number"]))
        .collect();
    let all = folder.json(&format!("extract plant.lodpack -o all.glb {}", tops.join(" ")));
    assert_eq!(all["triangles"].as_u64(), Some(triangles));
    assert!(all["certified_error"].as_f64().expect("a number") <= 0.00201);
    folder.run("build all.glb -o again.lodpack --tolerance 0.002");
    assert_eq!(listed(&folder.list("again.lodpack")), of_scene(&folder.1));
}

#[test]
fn objects_taken_out_by_id_are_where_the_input_has_them() {
    let folder = Folder::new(200);
    let in_world = folder.1.in_world();
    let objects = folder.1.nodes.iter().zip(&in_world).filter(|(node, _)| node.shape.is_some() && node.id.is_some());
    for (node, matrix) in objects.step_by(23) {
        let id = node.id.as_ref().expect("filtered");
        folder.run(&format!("extract plant.lodpack -o one.obj --force --object {id}"));
        let text = std::fs::read_to_string(folder.path("one.obj")).expect("written");
        let name = node.name.as_ref().unwrap_or(id);
        assert_eq!(text.lines().filter(|line| line.starts_with("o ")).collect::<Vec<_>>(), [format!("o {name}")]);
        let numbers = |line: &str| line.split(' ').skip(1).map(|x| x.parse().expect("a number")).collect::<Vec<f64>>();
        let points = text.lines().filter(|line| line.starts_with("v ")).map(numbers);
        let bounds = |points: &mut dyn Iterator<Item = DVec3>| {
            let first = points.next().expect("a vertex");
            points.fold([first; 2], |[low, high], point| [low.min(point), high.max(point)])
        };
        let found = bounds(&mut points.map(|point| DVec3::from_slice(&point)));
        let shape = &folder.1.shapes[node.shape.expect("filtered") as usize];
        // GLB has y up.
        let upright = |point: DVec3| DVec3::new(point.x, point.z, -point.y);
        let wanted = bounds(&mut shape.positions.iter().map(|&point| upright(matrix.transform_point3(point))));
        for (found, wanted) in found.iter().zip(&wanted) {
            assert!(found.distance(*wanted) < 0.01, "{id}: {found} {wanted}");
        }
    }
    let mut unknown = lodpack();
    unknown.current_dir(folder.0.path()).args("extract plant.lodpack -o x.obj --object NOTHING*".split(' '));
    let said = String::from_utf8_lossy(&unknown.assert().code(2).get_output().stderr).into_owned();
    assert!(said.contains("no object is named NOTHING*"), "{said}");
}

#[test]
fn a_pick_among_many_objects_reads_little() {
    let folder = Folder::new(2000);
    let bytes = std::fs::read(folder.path("plant.lodpack")).expect("built");
    let file = File::open(bytes.as_slice(), Limits::default()).expect("sound");
    let [low, high] = file.bounds().expect("not empty");
    let (mut picked, mut requests, mut read) = (0, vec![], vec![]);
    for number in 0..60 {
        let share = |k: u32| f64::from(number * (7 + 6 * k) % 60) / 59.0;
        let origin =
            [0, 1, 2].map(|k| if k == 1 { high[1] + 10.0 } else { low[k] + (high[k] - low[k]) * share(k as u32) });
        let source = lodpack::source::Counting::new(bytes.as_slice());
        let file = File::open(source, Limits::default()).expect("sound");
        let opened = [file.source().read_count(), file.source().byte_count()];
        if file.pick(Ray { origin, direction: [0.0, -1.0, 0.0] }).expect("sound").is_some() {
            picked += 1;
            requests.push(file.source().read_count() - opened[0]);
            read.push(file.source().byte_count() - opened[1]);
        }
    }
    requests.sort_unstable();
    read.sort_unstable();
    assert!(picked > 20, "{picked}");
    println!("requests {requests:?}, bytes {read:?}");
    assert!(requests[requests.len() / 2] <= 6 && read[read.len() / 2] <= 200_000, "{requests:?} {read:?}");
=======
//! Objects: what a plant names comes back out of its file, with its parts where they were.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use lodpack::source::Fetched;
use lodpack::write::ObjectNode;
use lodpack::{File, islands};
use lodpack_tests::scene::{Scene, Sharing, plant, write_glb, write_obj};

use super::{build_file, open};

const TOLERANCE: f64 = 0.001;

/// The triangles, the area and the box of an object.
#[derive(Clone, Copy, Debug)]
struct Extent {
    triangles: u64,
    area: f64,
    bounds: [DVec3; 2],
}

impl Extent {
    const NOTHING: Self = Self { triangles: 0, area: 0.0, bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY] };

    fn add(&mut self, corners: [DVec3; 3]) {
        self.triangles += 1;
        self.area += 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        let [low, high] = self.bounds;
        self.bounds = corners.iter().fold([low, high], |[low, high], &p| [low.min(p), high.max(p)]);
    }
}

/// Objects by their path of names, "-" where there is none, and their id.
type ByPath = BTreeMap<String, Vec<Extent>>;

fn sorted(mut objects: ByPath) -> ByPath {
    let key = |extent: &Extent| (extent.bounds[0] + extent.bounds[1]).to_array().map(|x| (x * 100.0).round() as i64);
    objects.values_mut().for_each(|of_path| of_path.sort_by_key(key));
    objects
}

/// What a scene has, with y up where `is_glb`; an OBJ joins those of one path.
fn named(scene: &Scene, is_glb: bool) -> ByPath {
    let (mut paths, mut objects): (Vec<String>, ByPath) = (vec![], BTreeMap::new());
    for (node, to) in scene.nodes.iter().zip(scene.in_world()) {
        let own = node.name.clone().unwrap_or_default();
        let above = node.parent.map_or("", |parent| &paths[parent as usize]);
        paths.push(match is_glb {
            true => format!("{above}/{}={}", if own.is_empty() { "-" } else { &own }, node.id.as_deref().unwrap_or("")),
            false if own.is_empty() => String::new(),
            false if above.is_empty() => own,
            false => format!("{above}/{own}"),
        });
        let Some(shape) = node.shape.map(|shape| &scene.shapes[shape as usize]) else { continue };
        let mut extent = Extent::NOTHING;
        for corners in &shape.triangles {
            extent.add(corners.map(|v| {
                let p = to.transform_point3(shape.positions[v as usize]);
                if is_glb { DVec3::new(p.x, p.z, -p.y) } else { p }
            }));
        }
        let path = paths.last().cloned().unwrap_or_default();
        let of_path = objects.entry(path.clone()).or_default();
        match of_path.first_mut().filter(|_| !is_glb && !path.is_empty()) {
            Some(same) => {
                (same.triangles, same.area) = (same.triangles + extent.triangles, same.area + extent.area);
                let [low, high] = same.bounds;
                same.bounds = [low.min(extent.bounds[0]), high.max(extent.bounds[1])];
            }
            None => of_path.push(extent),
        }
    }
    sorted(objects)
}

/// Everything of a file, so that nothing is missing.
fn all_of(bytes: &[u8]) -> Fetched {
    let mut fetched = Fetched::default();
    fetched.insert(0, bytes.to_vec());
    fetched
}

/// What the finest blocks of all leaves own.
fn owned(file: &File<&[u8]>, bytes: &[u8], is_glb: bool) -> ByPath {
    let fetched = all_of(bytes);
    let objects = file.index().objects().expect("the plant has objects");
    let mut extents = vec![Extent::NOTHING; objects.count() as usize];
    let world = |point: &lodpack::LatticePoint| DVec3::from(file.lattice().world(*point));
    for root in 0..file.root_count() {
        if !file.children(root).unwrap().is_empty() {
            continue;
        }
        let decoded = file.decode_root(root, u8::MAX).unwrap();
        let border = decoded.loops.iter().flatten().map(|vertex| &vertex.position);
        let positions: Vec<DVec3> = border.chain(&decoded.patch.interior).map(world).collect();
        let owners = objects.owners(root, decoded.level, &fetched).unwrap();
        let (labels, count) = islands(&decoded.patch.triangles);
        assert_eq!(owners.len(), count as usize);
        for (corners, island) in decoded.patch.triangles.iter().zip(labels) {
            extents[owners[island as usize] as usize].add(corners.map(|v| positions[v as usize]));
        }
    }
    let path_of = |number: u32| {
        let above = objects.above(number, &fetched).unwrap();
        let nodes = above.iter().rev().chain([&number]).map(|&node| objects.node(node, &fetched).unwrap());
        if is_glb {
            // The first node only turns the others.
            let nodes = nodes.skip(1);
            let part =
                |node: ObjectNode| format!("/{}={}", node.name.unwrap_or("-".into()), node.id.unwrap_or_default());
            return nodes.map(part).collect::<String>();
        }
        nodes.map(|node| node.name.unwrap_or_default()).collect::<Vec<_>>().join("|")
    };
    let mut by_path: ByPath = BTreeMap::new();
    for (number, extent) in (0..).zip(extents) {
        by_path.entry(path_of(number)).or_default().push(extent);
    }
    sorted(by_path)
}

#[test]
fn each_object_of_a_plant_owns_what_it_was() {
    let scene = plant(200);
    let folder = tempfile::tempdir().unwrap();
    let write: [(&str, &dyn Fn(&Path) -> std::io::Result<()>); 3] = [
        ("shared.glb", &|path| write_glb(&scene, Sharing::Meshes, path)),
        ("baked.glb", &|path| write_glb(&scene, Sharing::Nothing, path)),
        ("plant.obj", &|path| write_obj(&scene, path)),
    ];
    for (name, write) in write {
        let path = folder.path().join(name);
        write(&path).unwrap();
        let is_glb = name.ends_with("glb");
        let (bytes, summary) = build_file(&path, "0.001");
        let (expected, found) = (named(&scene, is_glb), owned(&open(&bytes), &bytes, is_glb));
        let count = |objects: &ByPath| objects.values().map(Vec::len).sum::<usize>();
        assert_eq!((count(&found), summary.objects as usize), (count(&expected), count(&expected)), "{name}");
        for ((path, expected), (found_path, found)) in expected.iter().zip(&found) {
            assert_eq!((path, expected.len()), (found_path, found.len()), "{name}");
            for (expected, found) in expected.iter().zip(found) {
                let [low, high] = [0, 1].map(|k| (expected.bounds[k] - found.bounds[k]).abs().max_element());
                assert!(low.max(high) < 3.0 * TOLERANCE, "{name} {path} {expected:?} {found:?}");
                assert!((found.area / expected.area - 1.0).abs() < 0.1, "{name} {path} {expected:?} {found:?}");
                assert!(found.triangles <= expected.triangles, "{name} {path} {expected:?} {found:?}");
            }
        }
    }
>>>>>>> 3c4139af92df047ff823e98d4e77c327916270c0
}
