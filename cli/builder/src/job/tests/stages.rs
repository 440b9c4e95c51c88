//! Jobs whose planning is divided into tasks: the same bytes in any order, and what goes wrong.

use super::super::planned::chain;
use super::regions::messy;
use super::*;
use lodpack_import::Ways;
use lodpack_mesh::appearance::Channels;
use lodpack_mesh::tolerance::Tolerance;

/// Begins a job with the given number of parts and bytes of a range.
pub(super) fn begin(scene: &Scene, name: &str, parts: u32, range_bytes: u64) -> PathBuf {
    let job = scene.path(name);
    let parts = PartOptions { count: Some(parts), memory: None, range_bytes: Some(range_bytes) };
    StagedJob::begin(&job, parts, &scene.options, &Silent).unwrap();
    job
}

fn run(job: &Path, stage: Stage, task: u32) -> Result<Outcome, BuildError> {
    StagedJob::open(job)?.run(stage, task, u64::MAX, &Silent)
}

/// Does all tasks of some stages, the last one first, and each twice.
fn run_backwards(job: &Path, stages: impl Iterator<Item = Stage>) {
    for stage in stages {
        let staged = StagedJob::open(job).unwrap();
        for task in (0..staged.tasks(stage)).rev() {
            assert!(matches!(run(job, stage, task).unwrap(), Outcome::Done(_)), "{stage} {task}");
            assert_eq!(run(job, stage, task).unwrap(), Outcome::WasDone, "{stage} {task}");
        }
    }
}

pub(super) fn work_all(job: &Path) -> Result<(), BuildError> {
    work(job, Share::default(), u64::MAX, &Silent, &mut |_, _, _| {})
}

/// Files by name.
type Inputs<'a> = [(&'a str, MeshFormat, &'a Mesh)];

/// A scene with other inputs.
fn scene_of(inputs: &Inputs) -> Scene {
    let mut scene = Scene::new();
    scene.options.inputs.clear();
    for (name, format, mesh) in inputs {
        let path = scene.path(name);
        let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
        write_mesh(fs::File::create(&path).unwrap(), *format, &positions, &mesh.triangles).unwrap();
        scene.options.inputs.push(path);
    }
    scene
}

#[test]
fn tasks_in_any_order_give_the_bytes_of_one_build() {
    let scene = Scene::new();
    let expected = scene.expected();
    for (parts, range_bytes) in [(1, u64::MAX), (5, 10_000), (64, 1000)] {
        let job = begin(&scene, &format!("job-{parts}"), parts, range_bytes);
        let stages = StagedJob::open(&job).unwrap().stages();
        assert!(stages.ways == Ways::Places && stages.ranges == parts.min(stages.ranges), "{stages:?}");
        run_backwards(&job, Stage::ALL.into_iter());
        assert!(merged(&job).unwrap() == expected, "{parts}");
        // What later stages do not need is gone.
        let left = |folder: &Path, ending: &str| {
            let names = fs::read_dir(folder).unwrap().flatten().map(|entry| entry.file_name());
            names.filter(|name| name.to_str().unwrap().ends_with(ending)).count()
        };
        assert_eq!(left(&job.join(STAGES_NAME), ".runs") + left(&job, "pairs"), 0);
        let status = JobStatus::of(&job).unwrap();
        assert!(status.stages.iter().all(|stage| stage.done == stage.tasks && stage.failed.is_empty()));
        assert_eq!(status.remaining_seconds, Some(0.0));
    }
}

#[test]
fn all_formats_and_several_inputs_are_divided_alike() {
    let (mesh, other) = (torus(60, 30), messy());
    let moved = Mesh { positions: mesh.positions.iter().map(|p| p * 0.5 + 9.0).collect(), ..torus(60, 30) };
    let cases: [(&Inputs, Ways); 6] = [
        (&[("a.ply", MeshFormat::Ply, &mesh), ("b.ply", MeshFormat::Ply, &moved)], Ways::Places),
        (&[("a.stl", MeshFormat::Stl, &mesh), ("b.ply", MeshFormat::Ply, &moved)], Ways::Places),
        (&[("messy.ply", MeshFormat::Ply, &other)], Ways::Places),
        (&[("messy.obj", MeshFormat::Obj, &other)], Ways::Lines),
        (&[("a.ply", MeshFormat::Ply, &mesh), ("b.obj", MeshFormat::Obj, &moved)], Ways::Lines),
        (&[("a.ply", MeshFormat::Ply, &mesh), ("b.glb", MeshFormat::Glb, &moved)], Ways::Whole),
    ];
    for (inputs, ways) in cases {
        let scene = scene_of(inputs);
        let job = begin(&scene, "job", 3, 5000);
        assert_eq!(StagedJob::open(&job).unwrap().stages().ways, ways, "{:?}", scene.options.inputs);
        work_all(&job).unwrap();
        assert!(merged(&job).unwrap() == scene.expected(), "{:?}", scene.options.inputs);
    }
}

/// A grid of quads with some triangles, and statements that are hard to divide: negative numbers, lines that go on,
/// polygons before their vertices, faces without surface, ends of lines of every kind.
fn odd_obj() -> Vec<u8> {
    let (columns, rows) = (40, 30);
    let height = |x: i32, y: i32| f64::from((x * 7 + y * 13) % 5) * 0.1;
    let mut text = String::from("# a comment that goes on \\\nf 1 1 1\n\no grid\nf 1 2 42 41\n");
    for y in 0..rows {
        for x in 0..columns {
            let end = ["\n", "\r\n", "\r", " \\\n1\n"][((x + y) % 4) as usize];
            text += &format!("v {x}.25 {y} {:.3}{end}", height(x, y));
        }
        if y == 0 {
            continue;
        }
        for x in 0..columns - 1 {
            let [a, b] = [1 + (y - 1) * columns + x, 1 + y * columns + x];
            text += &match x % 5 {
                0 => format!("f {a} {} {}\nf {a} {}/7 {b}//3\n", a + 1, b + 1, b + 1),
                1 => format!(
                    "f {} {} {} {}\n",
                    a - y * columns - columns - 1,
                    a - y * columns - columns,
                    x + 1 - columns,
                    x - columns
                ),
                2 => format!("f {a} {} \\\n{} \\\r\n{b}\n", a + 1, b + 1),
                _ => format!("f {a} {a} {} {} {b} {b}\nf {a} {b}\nf {a} {a} {b} {b}\n", a + 1, b + 1),
            };
        }
    }
    text.into_bytes()
}

#[test]
fn texts_are_read_in_ranges_as_they_are_at_once() {
    let scene = Scene::new();
    let quads = "ply\r\nformat ascii 1.0\r\nelement vertex 9\r\nproperty float nx\r\nproperty double x\r\nproperty double y\r\n\
                 property double z\r\nelement camera 1\r\nproperty int focus\r\nelement face 4\r\nproperty list uchar int vertex_index\r\n\
                 property uchar flags\r\nend_header\r\n\r\n1 0 0 0\r\n1 1 0 0\r\n1 2 0 0\r\n1 0 1 0\r\n1 1 1 .4\r\n1 2 1 0\r\n\
                 \r\n1 0 2 0\r\n1 1 2 0\r\n1 2 2 0\r\n17\r\n4 0 1 4 3 7\r\n4 1 2 5 4 7\r\n4 3 4 7 6 7\r\n5 4 5 8 8 7 7";
    let inputs: [(&str, &[u8]); 2] = [("odd.obj", &odd_obj()), ("quads.ply", quads.as_bytes())];
    for (name, content) in inputs {
        let path = scene.path(name);
        fs::write(&path, content).unwrap();
        let mut scene = Scene::new();
        scene.options.inputs = vec![path];
        let expected = scene.expected();
        for (parts, range_bytes) in [(1, u64::MAX), (5, 1000), (97, 64), (300, 1)] {
            let job = begin(&scene, &format!("job-{parts}"), parts, range_bytes);
            assert_eq!(StagedJob::open(&job).unwrap().stages().ways, Ways::Lines);
            run_backwards(&job, Stage::Cut.earlier());
            work_all(&job).unwrap();
            assert!(merged(&job).unwrap() == expected, "{name} {parts}");
            let names = fs::read_dir(&job).unwrap().flatten().map(|entry| entry.file_name());
            assert!(!names.into_iter().any(|name| name.to_str().unwrap().starts_with("text-")));
        }
    }
}

#[test]
fn what_is_wrong_with_a_text_is_said_with_its_line() {
    let cases = [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 4\n", "line 5", "vertex 4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 -4\n", "line 5", "vertex -4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n\n\nf 1 2 x\n", "line 6", "a face needs vertex numbers"),
        ("v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "line 2", "NaN"),
        ("v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n", "line 3", "three numbers"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\n", "text.obj", "no triangles"),
    ];
    for (text, place, problem) in cases {
        let mut scene = Scene::new();
        let path = scene.path("text.obj");
        fs::write(&path, text).unwrap();
        scene.options.inputs = vec![path];
        let job = begin(&scene, "job", 4, 8);
        let message = chain(&work_all(&job).unwrap_err());
        assert!(message.contains(place) && message.contains(problem), "{text}: {message}");
    }
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let cases = [
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "line 13", "vertex 7"),
        ("0 0 0\n1 0\n0 0 1 0\n3 0 1 2\n", "line 11", "without --stages"),
        ("0 0 0 1 0 0\n0 1 0\n3 0 1 2\n", "4 items", "without --stages"),
        ("0 0 0\n1 0 0\n0 1 0\n3 0 x 2\n", "line 13", "\"x\" is not"),
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 9\n", "line 13", "more numbers"),
    ];
    for (body, place, problem) in cases {
        let mut scene = Scene::new();
        let path = scene.path("text.ply");
        fs::write(&path, format!("{header}{body}")).unwrap();
        scene.options.inputs = vec![path];
        let job = begin(&scene, "job", 7, 8);
        let message = chain(&work_all(&job).unwrap_err());
        assert!(message.contains(place) && message.contains(problem), "{body}: {message}");
    }
}

#[test]
fn texts_with_colours_are_read_whole() {
    let mut scene = Scene::new();
    let path = scene.path("text.obj");
    let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(&path, plain.replace("0 0 0", "0 0 0 1 0 0")).unwrap();
    scene.options.inputs = vec![path.clone()];
    assert_eq!(StagedJob::open(&begin(&scene, "coloured", 3, 8)).unwrap().stages().ways, Ways::Whole);
    // A colour that begins only after what is looked through.
    let mut late = plain.to_owned() + &"# nothing\n".repeat(200_000);
    late += "v 0 0 2 1 0 0\n";
    fs::write(&path, &late).unwrap();
    let job = begin(&scene, "late", 3, 1 << 19);
    let message = chain(&work_all(&job).unwrap_err());
    assert!(message.contains("line 200009") && message.contains("--channels none"), "{message}");
    scene.options.model.channels = Channels::None;
    let job = begin(&scene, "none", 3, 1 << 19);
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn damaged_files_of_texts_are_named() {
    let mut scene = Scene::new();
    let path = scene.path("odd.obj");
    fs::write(&path, odd_obj()).unwrap();
    scene.options.inputs = vec![path];
    let job = begin(&scene, "job", 3, 4000);
    run_backwards(&job, Stage::Count.earlier());
    for name in ["text-1.vertices", "text-1.triangles", "text-1.polygons"] {
        let path = job.join(name);
        let sound = fs::read(&path).unwrap();
        fs::write(&path, &sound[..sound.len() - 5]).unwrap();
        let failures: Vec<String> =
            (0..3).filter_map(|task| run(&job, Stage::Count, task).err()).map(|error| chain(&error)).collect();
        assert!(
            !failures.is_empty() && failures.iter().all(|failure| failure.contains("text-1.")),
            "{name}: {failures:?}"
        );
        fs::write(&path, sound).unwrap();
    }
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn a_mesh_of_one_region_and_an_extensible_job_are_divided_alike() {
    let mut scene = Scene::new();
    scene.options.model.region_triangles = 1 << 20;
    let job = begin(&scene, "one", 4, 20_000);
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());

    let mut scene = Scene::new();
    (scene.options.model.extensible, scene.options.model.tolerance) = (true, Tolerance::InputUnits(0.01));
    let job = begin(&scene, "job", 4, 20_000);
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
    // More can be added to it.
    let other = scene.path("other.ply");
    let moved = Mesh { positions: torus(30, 20).positions.iter().map(|p| p + 20.0).collect(), ..torus(30, 20) };
    write_ply(&other, &moved);
    let options = BuildOptions { inputs: vec![other.clone()], ..scene.options.clone() };
    let added = Job::add(&job, &scene.path("more"), of_count(Some(2)), &options, &Silent).unwrap();
    assert!(added.taken_over > 0 && added.taken_over < added.regions, "{} of {}", added.taken_over, added.regions);
}

#[test]
fn one_place_with_nearly_all_triangles_is_divided_too() {
    // Nine tenths of all triangles lie in one cell of the first grid.
    let (large, small) = (torus(30, 20), torus(150, 70));
    let first = large.positions.len() as u32;
    let crowd = small.positions.iter().map(|p| p * 1e-4 + 0.5);
    let mesh = Mesh {
        positions: large.positions.iter().copied().chain(crowd).collect(),
        triangles: large
            .triangles
            .iter()
            .copied()
            .chain(small.triangles.iter().map(|t| t.map(|v| v + first)))
            .collect(),
    };
    let scene = scene_of(&[("crowd.ply", MeshFormat::Ply, &mesh)]);
    let job = begin(&scene, "job", 6, 10_000);
    work_all(&job).unwrap();
    let parts = Manifest::read(&job).unwrap().parts;
    assert!(
        parts.iter().all(|part| part.triangles > 0 && part.triangles < mesh.triangles.len() as u64 / 2),
        "{parts:?}"
    );
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn more_tasks_than_bytes_are_possible() {
    let tetrahedron = Mesh {
        positions: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|p| glam::IVec3::from(p).as_dvec3()).to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    };
    let scene = scene_of(&[("small.ply", MeshFormat::Ply, &tetrahedron)]);
    let bytes = fs::metadata(&scene.options.inputs[0]).unwrap().len();
    let job = begin(&scene, "job", bytes as u32 + 100, 1);
    assert_eq!(u64::from(StagedJob::open(&job).unwrap().stages().ranges), bytes);
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn a_stage_waits_for_the_one_before_it() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 3, 20_000);
    run_backwards(&job, Stage::Repair.earlier());
    run(&job, Stage::Repair, 1).unwrap();
    let message = run(&job, Stage::Match, 0).unwrap_err().to_string();
    assert!(
        message.contains("task 0 of the stage repair is not done") && message.contains("lodpack work"),
        "{message}"
    );
    let message = run(&job, Stage::Build, 0).unwrap_err().to_string();
    assert!(message.contains("task 0 of the stage seams"), "{message}");
    let message = run(&job, Stage::Repair, 3).unwrap_err().to_string();
    assert!(message.contains("no task 3; it has 3"), "{message}");
    assert!(matches!(run(&job, Stage::Import, 0), Err(BuildError::Job(JobError::NoTask { tasks: 0, .. }))));
    assert!(PlannedJob::open(&job).unwrap_err().to_string().contains("has not finished"));
}

#[test]
fn an_input_that_changes_between_scan_and_divide_is_named() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 3, 20_000);
    run_backwards(&job, Stage::Divide.earlier());
    let input = &scene.options.inputs[0];
    let sound = fs::read(input).unwrap();
    let mut changed = sound.clone();
    let last = changed.len() - 1;
    changed[last] ^= 1;
    // The same content with another time stamp is no change; a shorter file is.
    fs::write(input, &sound).unwrap();
    run(&job, Stage::Divide, 0).unwrap();
    for content in [&changed[..], &sound[..last]] {
        fs::write(input, content).unwrap();
        let message = run(&job, Stage::Divide, 1).unwrap_err().to_string();
        assert!(message.contains("torus.ply has changed since") && message.contains("--force"), "{message}");
        let status = JobStatus::of(&job).unwrap();
        let divide = status.stages.iter().find(|stage| stage.stage == Stage::Divide).unwrap();
        assert_eq!((divide.done, divide.failed.len(), divide.failed[0].task), (1, 1, 1));
        assert!(divide.failed[0].note.exists() && divide.failed[0].reason.contains("has changed"));
    }
    fs::write(input, &sound).unwrap();
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn a_change_between_samples_is_found_by_hashes_of_ranges() {
    let scene = scene_of(&[("large.ply", MeshFormat::Ply, &torus(500, 400))]);
    let job = begin(&scene, "job", 8, 1 << 20);
    let input = &scene.options.inputs[0];
    let sound = fs::read(input).unwrap();
    // Samples of 64 KiB begin at multiples of this.
    let step = (sound.len() - (64 << 10)) / 63;
    assert!(step > 100 << 10, "the whole file is sampled");
    let mut changed = sound.clone();
    changed[40 * step + (80 << 10)] ^= 1;
    let again = || {
        let parts = PartOptions { count: Some(8), memory: None, range_bytes: Some(1 << 20) };
        StagedJob::begin(&job, parts, &BuildOptions { resume: true, ..scene.options.clone() }, &Silent).map(drop)
    };
    // Nobody has read the byte yet.
    fs::write(input, &changed).unwrap();
    again().unwrap();
    fs::write(input, &sound).unwrap();
    run_backwards(&job, [Stage::Scan].into_iter());
    again().unwrap();
    run(&job, Stage::Count, 0).unwrap();
    fs::write(input, &changed).unwrap();
    for error in [again().unwrap_err(), run(&job, Stage::Count, 1).unwrap_err()] {
        assert!(error.to_string().contains("large.ply has changed since"), "{error}");
    }
    assert_eq!(JobStatus::of(&job).unwrap().changed_inputs.len(), 1);
    fs::write(input, &sound).unwrap();
    run(&job, Stage::Count, 1).unwrap();
}

#[test]
fn a_merge_reads_encoded_clusters_or_else_the_parts() {
    let scene = Scene::new();
    let expected = scene.expected();
    let job = begin(&scene, "job", 9, 20_000);
    run_backwards(&job, Stage::Arrange.earlier());
    assert!(merged(&job).unwrap() == expected, "of parts alone");
    run_backwards(&job, [Stage::Arrange, Stage::Encode].into_iter());
    assert_eq!(StagedJob::open(&job).unwrap().tasks(Stage::Encode), 3);
    let encoded = job.join(STAGES_NAME).join("encode-1.done");
    let sound = fs::read(&encoded).unwrap();
    let mut damaged = sound.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x10;
    for content in [&damaged[..], &sound[..middle], &[]] {
        fs::write(&encoded, content).unwrap();
        assert!(merged(&job).unwrap() == expected, "its clusters are taken from the parts");
    }
    fs::write(&encoded, &sound).unwrap();
    // Nothing else is needed any more.
    let part = job.join(PARTS_NAME).join(part_name(2));
    let content = fs::read(&part).unwrap();
    fs::remove_file(&part).unwrap();
    assert!(merged(&job).unwrap() == expected, "no part is read");
    // The stages before name the part, and what makes it again.
    let mut broken = content.clone();
    let middle = broken.len() / 2;
    broken[middle] ^= 0x10;
    fs::write(&part, &broken).unwrap();
    let mut failures = vec![];
    for task in 0..3 {
        fs::remove_file(job.join(STAGES_NAME).join(format!("encode-{task}.done"))).unwrap();
        failures.extend(run(&job, Stage::Encode, task).err().map(|error| chain(&error)));
    }
    let is_named = |failure: &String| failure.contains("part-2.lodpart") && failure.contains("--part 2` makes it");
    assert!(!failures.is_empty() && failures.iter().all(is_named), "{failures:?}");
    PlannedJob::open(&job).unwrap().build(2, u64::MAX, None, &Silent).unwrap();
    assert!(fs::read(&part).unwrap() == content);
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == expected);
}

#[test]
fn parts_belong_to_the_content_of_all_inputs() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 2, 20_000);
    work_all(&job).unwrap();
    let manifest = Manifest::read(&job).unwrap();
    let other = Manifest { content: Some("0123456789abcdef".into()), ..manifest.clone() };
    assert!(manifest.content.is_some() && manifest.part_id() != manifest.id());
    assert!(other.id() == manifest.id() && other.part_id() != manifest.part_id());
}

#[test]
fn a_task_in_work_is_seen_and_waited_for() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 3, 20_000);
    let lock = lodpack_runtime::storage::Lock::try_take(&job.join(STAGES_NAME).join("scan-1.lock")).unwrap();
    assert_eq!(run(&job, Stage::Scan, 1).unwrap(), Outcome::Taken);
    let status = JobStatus::of(&job).unwrap();
    assert!(status.stages[0].running[0].by.contains(&std::process::id().to_string()), "{status:?}");
    std::thread::scope(|scope| {
        let worker = scope.spawn(|| work_all(&job));
        std::thread::sleep(std::time::Duration::from_millis(300));
        assert!(!worker.is_finished() && !job.join(STAGES_NAME).join("cut-0.done").exists());
        // The other process has died.
        drop(lock);
        worker.join().unwrap().unwrap();
    });
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn several_workers_share_a_job() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 9, 5000);
    let did = Mutex::new(vec![]);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let mut note = |stage, task, outcome: &Outcome| {
                    if matches!(outcome, Outcome::Done(_)) {
                        did.lock().unwrap().push((stage, task));
                    }
                };
                work(&job, Share::default(), u64::MAX, &Silent, &mut note).unwrap();
            });
        }
    });
    let mut did = did.into_inner().unwrap();
    did.sort_unstable();
    let stages = StagedJob::open(&job).unwrap().stages();
    let all: Vec<(Stage, u32)> =
        Stage::ALL.into_iter().flat_map(|stage| (0..stages.tasks(stage)).map(move |task| (stage, task))).collect();
    assert_eq!(did, all, "each task is done once");
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn damage_between_stages_is_named() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 2, 20_000);
    for (stage, name, next) in [
        (Stage::Scan, "stages/scan-1.done", Stage::Count),
        (Stage::Count, "stages/count-0.done", Stage::Cut),
        (Stage::Cut, "stages/cut-0.done", Stage::Divide),
        (Stage::Divide, "stages/divide-1.runs", Stage::Repair),
        (Stage::Repair, "region-2.stats", Stage::Match),
        (Stage::Match, "stages/match-0.done", Stage::Segment),
        (Stage::Segment, "region-0.known", Stage::Seams),
    ] {
        let share = Share { stage: Some(stage), tasks: None };
        work(&job, share, u64::MAX, &Silent, &mut |_, _, _| {}).unwrap();
        let path = job.join(name);
        let sound = fs::read(&path).unwrap();
        let mut bytes = sound.clone();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(&path, bytes).unwrap();
        let tasks = 0..StagedJob::open(&job).unwrap().tasks(next);
        let failures: Vec<String> =
            tasks.filter_map(|task| run(&job, next, task).err()).map(|error| chain(&error)).collect();
        let named = path.file_name().unwrap().to_str().unwrap();
        assert!(!failures.is_empty() && failures.iter().all(|failure| failure.contains(named)), "{name}: {failures:?}");
        fs::write(&path, sound).unwrap();
    }
    work_all(&job).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn too_little_memory_is_said_by_the_first_task_that_needs_more() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 2, 20_000);
    let little = work(&job, Share::default(), 1 << 20, &Silent, &mut |_, _, _| {}).unwrap_err();
    assert!(little.is_lack_of_memory() && little.to_string().contains("--memory"), "{little}");
    let status = JobStatus::of(&job).unwrap();
    assert!(status.stages.iter().any(|stage| stage.stage == Stage::Repair && !stage.failed.is_empty()));
    // A hint before the start is enough.
    let enough = StagedJob::open(&job).unwrap().stages().memory;
    work(&job, Share::default(), enough, &Silent, &mut |_, _, _| {}).unwrap();
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn the_same_job_is_begun_once() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 3, 20_000);
    run(&job, Stage::Scan, 0).unwrap();
    let again = |parts, model: ModelOptions| {
        let parts = PartOptions { count: Some(parts), memory: None, range_bytes: Some(20_000) };
        StagedJob::begin(&job, parts, &BuildOptions { resume: true, model, ..scene.options.clone() }, &Silent)
    };
    again(3, scene.options.model.clone()).unwrap();
    assert!(run(&job, Stage::Scan, 0).unwrap() == Outcome::WasDone);
    assert!(again(4, scene.options.model.clone()).unwrap_err().to_string().contains("other parts"));
    let other = ModelOptions { region_triangles: 500, ..scene.options.model.clone() };
    assert!(again(3, other).unwrap_err().to_string().contains("other options"));
    let plan = Job::plan(&job, of_count(None), &BuildOptions { resume: true, ..scene.options.clone() }, &Silent);
    assert!(plan.unwrap_err().to_string().contains("lodpack work"));
}

/// Far more tasks than regions, as a script for a large cluster may ask for.
#[test]
fn ten_thousand_workers_share_a_small_job() {
    let scene = Scene::new();
    let job = begin(&scene, "job", 10_000, 1 << 20);
    work_all(&job).unwrap();
    let parts = Manifest::read(&job).unwrap().parts;
    assert_eq!((parts.len(), parts.iter().filter(|part| part.regions > 0).count() < 20), (10_000, true));
    assert_eq!(JobStatus::of(&job).unwrap().done(), 10_000);
    assert!(merged(&job).unwrap() == scene.expected());
}
