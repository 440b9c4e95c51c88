//! Objects through the program: what an input named is listed, taken out by name, and comes back when that is built
//! again.

use crate::commands::lodpack;
use glam::DVec3;
use lodpack::{File, Limits, index::Ray};
use lodpack_tests::scene::{Scene, Sharing, plant, write_glb};
use serde_json::Value;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

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

/// How many different materials a GLB has, and how many of all are used.
fn materials(path: &Path) -> (usize, usize) {
    let bytes = std::fs::read(path).expect("written");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    let list = |value: &Value| value.as_array().expect("a list").clone();
    let different: HashSet<String> = list(&document["materials"]).iter().map(Value::to_string).collect();
    let primitives = list(&document["meshes"]).into_iter().flat_map(|mesh| list(&mesh["primitives"]));
    let used: HashSet<u64> = primitives.map(|primitive| primitive["material"].as_u64().expect("a number")).collect();
    (different.len(), used.len())
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
    let (looks, used) = materials(&folder.path("whole.glb"));
    assert!((2..20).contains(&looks) && used == looks, "{looks} materials, {used} of them are used");
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

/// Two spheres of many triangles as one OBJ of two objects, each in an assembly-less list.
fn spheres(side: u32) -> String {
    let mut text = String::new();
    let mut first = 1;
    for (name, x) in [("a", 0.0), ("b", 1.5)] {
        text += &format!("o {name}\n");
        let (rows, columns) = (side, 2 * side);
        let point = |row: u32, column: u32| {
            let [theta, phi] = [f64::from(row) / f64::from(rows), 2.0 * f64::from(column) / f64::from(columns)]
                .map(|x| x * std::f64::consts::PI);
            let bump = 1.0 + 0.05 * (9.0 * theta).sin() * (7.0 * phi).cos() * theta.sin();
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|x| x * bump)
        };
        let mut count = 0;
        let mut vertex = |text: &mut String, [px, y, z]: [f64; 3]| {
            *text += &format!("v {} {y} {z}\n", px + x);
            count += 1;
            first + count - 1
        };
        let top = vertex(&mut text, point(0, 0));
        let inner: Vec<Vec<u32>> =
            (1..rows).map(|row| (0..columns).map(|column| vertex(&mut text, point(row, column))).collect()).collect();
        let bottom = vertex(&mut text, point(rows, 0));
        for column in 0..columns as usize {
            let next = (column + 1) % columns as usize;
            text += &format!("f {top} {} {}\n", inner[0][column], inner[0][next]);
            for pair in inner.windows(2) {
                let [a, b, c, d] = [pair[0][column], pair[1][column], pair[1][next], pair[0][next]];
                text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
            }
            let last = &inner[inner.len() - 1];
            text += &format!("f {} {bottom} {}\n", last[column], last[next]);
        }
        first += count;
    }
    text
}

/// Edges that have not as many triangles on one side as on the other.
fn open_edges(mesh: &lodpack::Mesh) -> usize {
    let mut edges: BTreeMap<[u32; 2], i64> = BTreeMap::new();
    for triangle in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|&&count| count != 0).count()
}

#[test]
fn what_is_left_of_objects_that_are_hidden_is_closed_at_every_mix_of_levels() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("two.obj"), spheres(90)).expect("writable");
    let words = "build two.obj -o two.lodpack --objects keep --tolerance 0.00005";
    lodpack().current_dir(folder.path()).args(words.split(' ')).assert().success();
    let bytes = std::fs::read(path("two.lodpack")).expect("built");
    let file = File::open(bytes.as_slice(), Limits::default()).expect("sound");
    assert!(file.root_count() > 2, "{}", file.root_count());
    let objects = file.objects().expect("two objects");
    let [a, b] = ["a", "b"].map(|name| objects.find_name(name).expect("sound")[0]);
    let [low, high] = objects.bounds(&[b]).expect("sound").expect("there");
    assert!(low[0] > 0.3 && high[0] < 2.7 && low[0] < 0.55 && high[0] > 2.45, "{low:?} {high:?}");
    let hierarchy = std::sync::Arc::new(file.hierarchy().expect("sound"));
    let mut session = file.session(lodpack::stream::Options { light: true, ..Default::default() }).expect("sound");
    let mut simulation = lodpack::stream::Simulation::new(file.source(), std::time::Duration::ZERO);
    let mut follower = lodpack::stream::Follower::new(hierarchy, Default::default(), std::time::Duration::ZERO);
    for filter in
        [file.hide(&[a]), file.only(&[a]), file.hide(&[b]), file.hide(&[])].map(|filter| filter.expect("sound"))
    {
        for share in [1.0, 0.3, 0.1, 0.01, 0.0] {
            // Near one end of the model finely, and coarsely elsewhere.
            let view = lodpack::View {
                position: [-1.2, 0.1, 0.2],
                forward: [1.0, 0.0, 0.0],
                up: [0.0, 0.0, 1.0],
                pixel_tolerance: 100.0 * share,
                ..Default::default()
            };
            let query = lodpack::Query {
                view: Some(view),
                outside: lodpack::Outside::Coarsest,
                objects: Some(std::sync::Arc::clone(&filter)),
                ..Default::default()
            };
            let cut = file.select(&query).expect("sound");
            let (mesh, owners) = file
                .extract_objects(&cut)
                .map_or_else(|_| (file.extract(&cut).expect("sound"), vec![]), |(mesh, owners)| (mesh, owners));
            let choice = filter.choice();
            assert!(owners.iter().all(|owner| !choice.hidden.contains(owner)));
            assert!(owners.iter().all(|owner| choice.only.as_ref().is_none_or(|only| only.contains(owner))));
            assert!(!mesh.triangles.is_empty());
            assert_eq!(open_edges(&mesh), 0, "{choice:?} {share}");
            let side = |x: f64| {
                if choice.hidden == [a] {
                    x > 0.3
                } else if choice.hidden == [b] || choice.only.is_some() {
                    x < 1.2
                } else {
                    true
                }
            };
            assert!(mesh.positions.iter().all(|position| side(position[0])));
            let (cut, _) = follower.follow(&query, std::time::Duration::ZERO).expect("sound");
            session.show_objects(Some(std::sync::Arc::clone(&filter))).expect("sound");
            for _ in 0..3 {
                simulation.frame(&mut session, &cut.nodes, &[]).expect("sound");
                simulation.settle(&session);
            }
            assert_eq!(session.picture().nodes(), cut.nodes);
            let drawn = session.picture().mesh();
            assert_eq!((open_edges(&drawn), drawn.triangles.is_empty()), (0, false));
            assert!(drawn.positions.iter().zip(0_u32..).all(|(position, number)| {
                side(position[0]) || !drawn.triangles.iter().flatten().any(|&vertex| vertex == number)
            }));
            for root in session.picture().roots() {
                let lit = root.lit().expect("light");
                assert_eq!(lit.triangles.len(), root.joined().1.len());
                assert!(lit.triangles.iter().flatten().all(|&vertex| (vertex as usize) < lit.positions.len()));
            }
        }
    }
}

#[test]
fn what_is_hidden_and_what_is_taken_out_are_the_whole() {
    let folder = Folder::new(300);
    let all = folder.json("extract plant.lodpack -o all.ply")["triangles"].as_u64().expect("a number");
    for pattern in ["*FLANGE*", "#7", "*VALVE*"] {
        let triangles = |how: &str| {
            folder.json(&format!("extract plant.lodpack -o part.ply --force --{how} {pattern}"))["triangles"].as_u64()
        };
        let [kept, hidden] = ["object", "hide"].map(triangles);
        assert_eq!(kept.zip(hidden).map(|(kept, hidden)| kept + hidden), Some(all), "{pattern}");
        assert!(kept > Some(0) && hidden > Some(0));
    }
    // Coarsely and within a box, too.
    folder.run("extract plant.lodpack -o part.ply --force --hide *FLANGE* --tolerance 0.5");
    let mut everything = lodpack();
    everything.current_dir(folder.0.path()).args("extract plant.lodpack -o x.ply --hide *".split(' '));
    let said = String::from_utf8_lossy(&everything.assert().code(2).get_output().stderr).into_owned();
    assert!(said.contains("nothing is left of it"), "{said}");
}
