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
        let path = node["path"].as_str().unwrap_or_default().to_owned();
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
        // `plant.glb` has a node without a name that turns all others.
        path.push(String::new());
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
    // Without patterns all objects are nodes, too, and the file itself is an input that has them.
    let texels = |name: &str| {
        let info = folder.json(&format!("info {name}"));
        let sections = info["sections"].as_array().expect("a list").iter();
        sections
            .filter(|section| section["name"] == "texels")
            .filter_map(|section| section["bytes"].as_u64())
            .sum::<u64>()
    };
    folder.run("extract plant.lodpack -o whole.glb");
    for input in ["whole.glb", "plant.lodpack"] {
        folder.run(&format!("build {input} -o again.lodpack --tolerance 0.002 --force"));
        assert_eq!(listed(&folder.list("again.lodpack")), of_scene(&folder.1), "{input}");
        let [again, before] = ["again.lodpack", "plant.lodpack"].map(texels);
        assert!(again < 2 * before, "{input}: {again} bytes of texels, {before} before");
    }
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
}
