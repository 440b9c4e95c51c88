mod add;
mod attributes;
mod objects;
mod regions;
mod stages;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tempfile::TempDir;

use super::*;
use crate::pipeline::ModelOptions;
use lodpack_mesh::Mesh;
use lodpack_mesh::export::{MeshFormat, write_mesh};
use lodpack_runtime::progress::{Progress, Silent};
use regions::torus;

/// A bumpy torus as PLY, of 2 n m triangles.
fn write_torus(path: &Path, n: u32, m: u32) {
    write_ply(path, &torus(n, m));
}

fn write_ply(path: &Path, mesh: &Mesh) {
    let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    write_mesh(fs::File::create(path).unwrap(), MeshFormat::Ply, &positions, &mesh.triangles).unwrap();
}

/// A folder with a mesh of some regions.
struct Scene {
    folder: TempDir,
    options: BuildOptions,
}

impl Scene {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("torus.ply");
        write_torus(&mesh, 96, 40);
        let options = BuildOptions {
            inputs: vec![mesh],
            model: ModelOptions { region_triangles: 1000, chart_triangles: Some(300), ..ModelOptions::default() },
            work: folder.path().join("work"),
            ..BuildOptions::default()
        };
        Self { folder, options }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What a build in memory gives.
    fn expected(&self) -> Vec<u8> {
        let mut bytes = vec![];
        build(&self.options, &mut bytes, &Silent).unwrap();
        bytes
    }

    fn plan(&self, name: &str, parts: Option<u32>) -> PathBuf {
        let job = self.path(name);
        Job::plan(&job, of_count(parts), &self.options, &Silent).unwrap();
        job
    }

    fn build_all(&self, job: &Path) {
        let job = PlannedJob::open(job).unwrap();
        // Any order will do.
        for part in (0..job.parts()).rev() {
            assert!(job.build(part, u64::MAX, None, &Silent).unwrap().report.is_some());
        }
    }

    fn built(&self, name: &str, parts: u32) -> PathBuf {
        let job = self.plan(name, Some(parts));
        self.build_all(&job);
        job
    }
}

fn of_count(count: Option<u32>) -> PartOptions {
    PartOptions { count, ..PartOptions::default() }
}

fn merged(path: &Path) -> Result<Vec<u8>, BuildError> {
    let parts = Parts::check(&[path.to_owned()], &Silent)?;
    let mut bytes = vec![];
    merge(&parts, &std::env::temp_dir(), &mut bytes, &Silent)?;
    Ok(bytes)
}

/// The message of a merge that must not succeed.
fn refusal(path: &Path) -> String {
    merged(path).map(|bytes| bytes.len()).expect_err("it must be refused").to_string()
}

fn build_part(
    job: &Path,
    part: u32,
    memory: u64,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<BuiltPart, BuildError> {
    PlannedJob::open(job)?.build(part, memory, output, progress)
}

fn part(job: &Path, number: u32) -> PathBuf {
    job.join(PARTS_NAME).join(part_name(number))
}

#[test]
fn any_number_of_parts_gives_the_bytes_of_one_build() {
    let scene = Scene::new();
    let expected = scene.expected();
    for parts in [1, 7, 64] {
        let job = scene.plan(&format!("job-{parts}"), Some(parts));
        let manifest = Manifest::read(&job).unwrap();
        assert_eq!(manifest.parts.len() as u32, parts);
        assert_eq!(manifest.parts.iter().map(|part| part.triangles).sum::<u64>(), 2 * 96 * 40);
        assert_eq!(manifest.parts.iter().any(|part| part.regions == 0), parts == 64, "regions: {:?}", manifest.parts);
        scene.build_all(&job);
        assert!(merged(&job).unwrap() == expected, "{parts}");
        // Parts anywhere, without the job.
        let elsewhere = scene.path("elsewhere");
        fs::rename(job.join(PARTS_NAME), &elsewhere).unwrap();
        fs::remove_dir_all(&job).unwrap();
        assert!(merged(&elsewhere).unwrap() == expected);
        fs::remove_dir_all(&elsewhere).unwrap();
    }
}

#[test]
fn parts_without_regions_are_not_missing() {
    let scene = Scene::new();
    let expected = scene.expected();
    let job = scene.plan("job", Some(64));
    let manifest = Manifest::read(&job).unwrap();
    let (empty, full): (Vec<u32>, Vec<u32>) = (0..64).partition(|&part| manifest.parts[part as usize].regions == 0);
    for &part in &full[1..] {
        build_part(&job, part, u64::MAX, None, &Silent).unwrap();
    }
    // Only what has to be built is named.
    assert_eq!(refusal(&job).matches("is missing").count(), 1);
    assert_eq!(JobStatus::of(&job).unwrap().done(), 63);
    build_part(&job, full[0], u64::MAX, None, &Silent).unwrap();
    let status = JobStatus::of(&job).unwrap();
    assert!(status.done() == 64 && empty.iter().all(|&part| status.parts[part as usize].state == PartState::Empty));
    assert!(merged(&job).unwrap() == expected);
    // Elsewhere, without the job, parts know how many regions there are.
    let elsewhere = scene.path("elsewhere");
    fs::rename(job.join(PARTS_NAME), &elsewhere).unwrap();
    assert!(merged(&elsewhere).unwrap() == expected);
    fs::remove_file(elsewhere.join(part_name(full[1]))).unwrap();
    assert!(refusal(&elsewhere).contains(&format!("part {} is missing", full[1])));
}

#[test]
fn every_name_in_a_jobs_directory_is_known() {
    use lodpack_runtime::storage::{DIVIDED_NAME, PLAN_NAME, is_of_job};
    for name in [PARTS_NAME, STAGES_NAME, SLURM_NAME, GROUND_NAME, MANIFEST_NAME, PLAN_NAME, DIVIDED_NAME, "image-7"] {
        assert!(is_of_job(name), "{name}");
    }
    assert!(!is_of_job("holiday.png") && !is_of_job("images"));
}

#[test]
fn a_build_that_is_to_be_resumed_begins_on_the_disk() {
    let scene = Scene::new();
    let mesh = scene.path("large.ply");
    write_torus(&mesh, 400, 250);
    let model = ModelOptions { region_triangles: 100_000, ..scene.options.model.clone() };
    let options = BuildOptions { inputs: vec![mesh], model, resume: true, ..scene.options.clone() };
    let (mut plain, mut bytes) = (vec![], vec![]);
    build(&BuildOptions { resume: false, ..options.clone() }, &mut plain, &Silent).unwrap();
    assert!(!options.work.exists());
    let progress = Stopping { work: options.work.clone(), seen: Mutex::new(false) };
    build(&options, &mut bytes, &progress).unwrap();
    assert!(*progress.seen.lock().unwrap() && bytes == plain && !options.work.exists());
}

/// Looks whether there is something to resume from.
struct Stopping {
    work: PathBuf,
    seen: Mutex<bool>,
}

impl Progress for Stopping {
    fn begin(&self, _stage: &'static str, _total: u64) {
        *self.seen.lock().unwrap() |= self.work.join(MANIFEST_NAME).exists();
    }

    fn advance(&self, _amount: u64) {}

    fn note(&self, _message: &str) {}
}

#[test]
fn parts_are_the_same_whenever_they_are_built_and_not_built_twice() {
    let scene = Scene::new();
    let job = scene.built("job", 3);
    let before = fs::read(part(&job, 1)).unwrap();
    assert_eq!(build_part(&job, 1, u64::MAX, None, &Silent).unwrap().report, None);
    let other = scene.path("other.lodpart");
    build_part(&job, 1, u64::MAX, Some(&other), &Silent).unwrap();
    assert!(fs::read(&other).unwrap() == before);
    fs::remove_file(part(&job, 1)).unwrap();
    assert!(refusal(&job).contains("part 1 is missing; `lodpack build --job"));
    build_part(&job, 1, u64::MAX, None, &Silent).unwrap();
    assert!(fs::read(part(&job, 1)).unwrap() == before);
}

#[test]
fn damaged_truncated_and_foreign_parts_are_named_with_what_to_do() {
    let scene = Scene::new();
    let job = scene.built("job", 4);
    let expected = merged(&job).unwrap();
    let path = part(&job, 2);
    let sound = fs::read(&path).unwrap();
    for at in [0, 9, 13, 40, 200, sound.len() / 2, sound.len() - 1] {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        fs::write(&path, &bytes).unwrap();
        let message = refusal(&job);
        assert!(message.contains("part-2.lodpart") && message.contains("--part 2"), "{at}: {message}");
        fs::write(&path, &sound[..at]).unwrap();
        let message = refusal(&job);
        assert!(message.contains("part-2.lodpart") && message.contains("1 of 4 parts"), "{at}: {message}");
    }
    // It is built again although there is a file.
    assert!(matches!(JobStatus::of(&job).unwrap().parts[2].state, PartState::Broken { .. }));
    assert!(build_part(&job, 2, u64::MAX, None, &Silent).unwrap().report.is_some());
    assert!(merged(&job).unwrap() == expected);
}

#[test]
fn a_part_of_another_version_is_named() {
    let scene = Scene::new();
    let job = scene.built("job", 2);
    let mut bytes = fs::read(part(&job, 0)).unwrap();
    // Behind the magic number.
    bytes[8] = 99;
    fs::write(part(&job, 0), bytes).unwrap();
    let message = refusal(&job);
    assert!(message.contains("another version of lodpack") && message.contains("--part 0"), "{message}");

    let text = fs::read_to_string(job.join(MANIFEST_NAME)).unwrap();
    fs::write(job.join(MANIFEST_NAME), text.replace(env!("CARGO_PKG_VERSION"), "0.0.7")).unwrap();
    let message = build_part(&job, 1, u64::MAX, None, &Silent).unwrap_err().to_string();
    assert!(message.contains("planned by lodpack 0.0.7"), "{message}");
}

#[test]
fn parts_of_two_jobs_or_two_plans_do_not_mix() {
    let scene = Scene::new();
    let job = scene.built("job", 3);
    let mut other = Scene { folder: tempfile::tempdir().unwrap(), options: scene.options.clone() };
    other.options.model.chart_triangles = Some(200);
    let foreign = other.built("job", 3);
    fs::copy(part(&foreign, 1), part(&job, 1)).unwrap();
    let message = refusal(&job);
    assert!(message.contains("part-1.lodpart belongs to another job"), "{message}");
    // Without a job the first part decides.
    let folder = scene.path("mixed");
    fs::rename(job.join(PARTS_NAME), &folder).unwrap();
    assert!(refusal(&folder).contains("part-1.lodpart belongs to another job"));

    let job = scene.built("job-4", 4);
    let fewer = scene.built("job-2", 2);
    fs::copy(part(&fewer, 1), part(&job, 1)).unwrap();
    let message = refusal(&job);
    assert!(message.contains("is part 1 of 2 of the same job, but the job has 4 parts"), "{message}");
}

#[test]
fn duplicate_parts_do_no_harm_unless_they_differ() {
    let scene = Scene::new();
    let job = scene.built("job", 3);
    let expected = merged(&job).unwrap();
    fs::copy(part(&job, 1), job.join(PARTS_NAME).join("copy of 1.lodpart")).unwrap();
    assert!(merged(&job).unwrap() == expected);
    fs::copy(part(&job, 1), part(&job, 2)).unwrap();
    let message = refusal(&job);
    assert!(message.contains("part 2 is missing"), "{message}");
}

#[test]
fn ten_thousand_parts_are_told_apart() {
    let scene = Scene::new();
    let job = scene.plan("job", Some(10_000));
    let parts = Manifest::read(&job).unwrap().parts;
    let used: Vec<u32> = (0..).zip(&parts).filter(|(_, part)| part.regions > 0).map(|(number, _)| number).collect();
    let planned = PlannedJob::open(&job).unwrap();
    let message = refusal(&job);
    let missing = format!("{} of 10000 parts", used.len());
    assert!(message.contains(&missing) && message.lines().count() < 30, "{message}");
    for &number in &used {
        planned.build(number, u64::MAX, None, &Silent).unwrap();
    }
    assert!(merged(&job).unwrap() == scene.expected());
    // An empty part is as good as any other.
    for number in (0..10_000).step_by(97).filter(|number| !used.contains(number)) {
        planned.build(number, u64::MAX, None, &Silent).unwrap();
    }
    assert!(merged(&job).unwrap() == scene.expected());
}

#[test]
fn an_input_that_changed_since_the_plan_is_noticed() {
    let scene = Scene::new();
    let job = scene.built("job", 2);
    let expected = merged(&job).unwrap();
    write_torus(&scene.options.inputs[0], 80, 40);
    // The parts know all that they need, and the file shows what was planned.
    let parts = Parts::check(std::slice::from_ref(&job), &Silent).unwrap();
    assert_eq!(parts.changed_inputs, scene.options.inputs);
    assert_eq!(JobStatus::of(&job).unwrap().changed_inputs.len(), 1);
    assert!(merged(&job).unwrap() == expected);
    let options = BuildOptions { resume: true, ..scene.options.clone() };
    let message = Job::plan(&job, PartOptions::default(), &options, &Silent).unwrap_err().to_string();
    assert!(message.contains("torus.ply has changed"), "{message}");
}

#[test]
fn what_is_no_part_of_the_job_is_refused() {
    let scene = Scene::new();
    let job = scene.plan("job", Some(2));
    let message = build_part(&job, 2, u64::MAX, None, &Silent).unwrap_err().to_string();
    assert!(message.contains("no part 2; its 2 parts"), "{message}");
    let message = build_part(&scene.path("nowhere"), 0, u64::MAX, None, &Silent).unwrap_err().to_string();
    assert!(message.contains("holds no job"), "{message}");
    let message = build_part(&job, 0, 1 << 20, None, &Silent).unwrap_err().to_string();
    assert!(message.contains("needs --memory"), "{message}");
    assert!(matches!(&JobStatus::of(&job).unwrap().parts[0].state, PartState::Failed { reason } if *reason == message));
    let message = Job::plan(
        &scene.path("small"),
        PartOptions { memory: Some(1 << 20), ..PartOptions::default() },
        &scene.options,
        &Silent,
    )
    .unwrap_err()
    .to_string();
    assert!(message.contains("needs --part-memory"), "{message}");
    fs::create_dir(scene.path("empty")).unwrap();
    assert!(refusal(&scene.path("empty")).contains("holds no part"));
    assert!(refusal(&job).contains("2 of 2 parts"));
    fs::write(job.join(MANIFEST_NAME), "{}").unwrap();
    assert!(build_part(&job, 0, u64::MAX, None, &Silent).unwrap_err().to_string().contains("job.json"));
}

#[test]
fn a_part_in_work_is_seen_and_not_built_twice() {
    let scene = Scene::new();
    let job = scene.plan("job", Some(2));
    fs::create_dir_all(job.join(PARTS_NAME)).unwrap();
    let lock = lodpack_runtime::storage::Lock::try_take(&job.join(PARTS_NAME).join("part-1.lock")).unwrap();
    assert!(matches!(JobStatus::of(&job).unwrap().parts[1].state, PartState::Running { .. }));
    let error = build_part(&job, 1, u64::MAX, None, &Silent).unwrap_err();
    assert!(error.to_string().contains("cannot be locked"), "{error}");
    drop(lock);
    assert!(matches!(JobStatus::of(&job).unwrap().parts[1].state, PartState::Missing | PartState::Failed { .. }));
    build_part(&job, 1, u64::MAX, None, &Silent).unwrap();
    assert!(matches!(JobStatus::of(&job).unwrap().parts[1].state, PartState::Done { report: Some(_), .. }));
}

#[test]
fn clocks_that_run_backwards_change_nothing() {
    let scene = Scene::new();
    let job = scene.built("job", 2);
    let expected = merged(&job).unwrap();
    let then = std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1000);
    for (folder, back) in [(job.clone(), true), (job.join(PARTS_NAME), false)] {
        for entry in fs::read_dir(folder).unwrap().flatten().filter(|entry| entry.path().is_file()) {
            let time = if back { std::time::SystemTime::now() + std::time::Duration::from_secs(1 << 30) } else { then };
            fs::File::options().write(true).open(entry.path()).unwrap().set_modified(time).unwrap();
        }
    }
    assert_eq!(build_part(&job, 0, u64::MAX, None, &Silent).unwrap().report, None);
    assert_eq!(JobStatus::of(&job).unwrap().done(), 2);
    assert!(merged(&job).unwrap() == expected);
}

/// Panics when a stage has come so far, as a kill would end it: files stay as they are.
struct Killer {
    left: Mutex<u64>,
}

impl Progress for Killer {
    fn begin(&self, _stage: &'static str, _total: u64) {
        self.advance(1);
    }

    fn advance(&self, _amount: u64) {
        let Ok(mut left) = self.left.lock() else { return };
        assert!(*left > 0, "killed");
        *left -= 1;
    }

    fn note(&self, _message: &str) {}
}

#[test]
fn a_build_goes_on_wherever_it_was_killed() {
    let scene = Scene::new();
    let expected = scene.expected();
    let memory =
        lodpack_runtime::storage::memory::least_bytes(lodpack_runtime::storage::memory::region_bytes(1000, 1000));
    let options = BuildOptions { memory, resume: true, ..scene.options.clone() };
    std::panic::set_hook(Box::new(|_| {}));
    for steps in [1, 2, 4, 9, 12, 17, 25, 40, 60] {
        let killer = Killer { left: Mutex::new(steps) };
        let killed =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| build(&options, &mut vec![], &killer).is_ok()));
        if let Ok(finished) = killed {
            assert!(finished && steps > 20, "{steps}");
            continue;
        }
        let mut bytes = vec![];
        build(&options, &mut bytes, &Silent).unwrap();
        assert!(bytes == expected, "{steps}");
        assert!(!options.work.exists(), "{steps}");
    }
    let _ = std::panic::take_hook();
}
