//! Adding to a job.

use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;
use lodpack::{File, Limits};

use super::regions::torus;
use super::{Scene, merged, of_count, part, write_ply, write_torus};
use crate::job::{BuildOptions, Job, Manifest, PartOptions, build};
use crate::pipeline::ModelOptions;
use lodpack_mesh::Mesh;
use lodpack_mesh::tolerance::Tolerance;
use lodpack_runtime::progress::Silent;

/// A job of some inputs to which more can be added.
fn extensible(scene: &Scene, inputs: &[PathBuf]) -> BuildOptions {
    let tolerance = Tolerance::InputUnits(0.02);
    let model = ModelOptions { tolerance, extensible: true, ..scene.options.model.clone() };
    BuildOptions { inputs: inputs.to_vec(), model, ..scene.options.clone() }
}

#[test]
fn what_is_added_to_changes_only_where_it_is_touched() {
    let mut scene = Scene::new();
    // Few enough that not all regions of a half meet the other one.
    scene.options.model.region_triangles = 200;
    // A torus in two halves, which meet, and one far from both.
    let all = torus(96, 40);
    let half = |first: bool, name: &str| {
        let is_first = |t: &[u32; 3]| t.iter().map(|&v| all.positions[v as usize].x).sum::<f64>() < 3.0;
        let mut mesh = all.clone();
        mesh.triangles.retain(|t| is_first(t) == first);
        let path = scene.path(name);
        write_ply(&path, &mesh);
        path
    };
    let far = scene.path("far.ply");
    let positions = all.positions.iter().map(|&p| p + DVec3::new(100.0, -7.0, 3.0)).collect();
    write_ply(&far, &Mesh { positions, triangles: all.triangles.clone() });
    let [left, right] = [half(true, "left.ply"), half(false, "right.ply")];

    for (number, added) in [vec![right.clone()], vec![far.clone()], vec![far, right]].into_iter().enumerate() {
        let [earlier, later, fresh] = ["earlier", "later", "fresh"].map(|name| scene.path(&format!("{name}-{number}")));
        let first = extensible(&scene, std::slice::from_ref(&left));
        Job::plan(&earlier, of_count(Some(3)), &first, &Silent).unwrap();
        scene.build_all(&earlier);
        let parts_before = fs::read(part(&earlier, 1)).unwrap();
        let (levels_before, _) = tree_of(&merged(&earlier).unwrap());
        let regions_before: u32 = Manifest::read(&earlier).unwrap().parts.iter().map(|part| part.regions).sum();

        let more = BuildOptions { inputs: added.clone(), ..BuildOptions::default() };
        let result = Job::add(&earlier, &later, of_count(Some(4)), &more, &Silent).unwrap();
        let [taken_over, regions] = [result.taken_over, result.regions];
        assert!(4 <= taken_over && taken_over < regions, "{taken_over} of {regions}");
        // What is far away leaves all regions as they are, though the file gets more levels.
        assert!(number != 1 || taken_over == regions_before, "{taken_over} of {regions_before}");
        // Nothing of the earlier job is needed any more, and it is as it was.
        assert!(fs::read(part(&earlier, 1)).unwrap() == parts_before);
        fs::remove_dir_all(&earlier).unwrap();
        scene.build_all(&later);

        let inputs: Vec<PathBuf> = std::iter::once(left.clone()).chain(added).collect();
        let all = extensible(&scene, &inputs);
        Job::plan(&fresh, of_count(Some(4)), &all, &Silent).unwrap();
        scene.build_all(&fresh);
        for number in 0..4 {
            assert!(fs::read(part(&fresh, number)).unwrap() == fs::read(part(&later, number)).unwrap(), "{number}");
        }
        let bytes = merged(&later).unwrap();
        assert!(bytes == merged(&fresh).unwrap());
        let mut in_memory = vec![];
        build(&all, &mut in_memory, &Silent).unwrap();
        assert!(bytes == in_memory);
        let (levels, triangles) = tree_of(&bytes);
        assert!(number == 0 || levels > levels_before, "{levels} and {levels_before} levels");
        // Open surfaces go on to levels of half as many.
        assert!((50..=500).contains(&triangles), "{triangles} triangles at the top");
    }
}

/// The number of levels of a file, and the triangles of its only top.
fn tree_of(bytes: &[u8]) -> (usize, usize) {
    let file = File::open(bytes, Limits::default()).unwrap();
    assert_eq!(file.top_count(), 1);
    let top = file.uniform_cut(0).unwrap();
    (file.level_count(), file.extract(&top).unwrap().triangles.len())
}

#[test]
fn what_cannot_be_taken_over_is_built() {
    let scene = Scene::new();
    let far = scene.path("far.ply");
    let mesh = torus(96, 40);
    let positions = mesh.positions.iter().map(|&p| p + DVec3::new(0.0, 90.0, 0.0)).collect();
    write_ply(&far, &Mesh { positions, ..mesh });
    let (earlier, more) = (scene.path("earlier"), BuildOptions { inputs: vec![far], ..BuildOptions::default() });
    let add = |name: &str| Job::add(&earlier, &scene.path(name), of_count(Some(4)), &more, &Silent);
    Job::plan(&earlier, of_count(Some(3)), &extensible(&scene, &scene.options.inputs), &Silent).unwrap();
    // No part is built: only charts are taken over.
    assert_eq!(add("first").unwrap().taken_over, 0);
    scene.build_all(&earlier);
    let all = add("second").unwrap().taken_over;
    // One part is damaged, another one is not there.
    let mut bytes = fs::read(part(&earlier, 0)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(part(&earlier, 0), bytes).unwrap();
    let without_one = add("third").unwrap().taken_over;
    fs::remove_file(part(&earlier, 1)).unwrap();
    let without_two = add("fourth").unwrap().taken_over;
    assert!(0 < without_two && without_two < without_one && without_one < all, "{without_two} {without_one} {all}");
    let outputs = ["first", "second", "third", "fourth"].map(|name| {
        scene.build_all(&scene.path(name));
        merged(&scene.path(name)).unwrap()
    });
    assert!(outputs.iter().all(|bytes| bytes == &outputs[0]));
}

#[test]
fn a_job_that_nothing_can_be_added_to_says_so() {
    let scene = Scene::new();
    let refused = |earlier: &Path| {
        let more = BuildOptions { inputs: scene.options.inputs.clone(), ..BuildOptions::default() };
        Job::add(earlier, &scene.path("later"), PartOptions::default(), &more, &Silent)
            .expect_err("refused")
            .to_string()
    };
    assert!(refused(&scene.path("nowhere")).contains("no job"));
    assert!(refused(&scene.plan("rigid", None)).contains("--extensible"));
    let options = extensible(&scene, &scene.options.inputs);
    let model = ModelOptions { tolerance: Tolerance::Auto, ..options.model.clone() };
    let automatic = BuildOptions { model, ..options.clone() };
    let message =
        Job::plan(&scene.path("auto"), PartOptions::default(), &automatic, &Silent).expect_err("refused").to_string();
    assert!(message.contains("--tolerance as a length"), "{message}");
    let job = scene.path("job");
    Job::plan(&job, PartOptions::default(), &options, &Silent).unwrap();
    write_torus(&scene.options.inputs[0], 95, 40);
    let message = refused(&job);
    assert!(message.contains("torus.ply") && message.contains("changed"), "{message}");
    fs::remove_file(&scene.options.inputs[0]).unwrap();
    assert!(refused(&job).contains("no longer there"));
    assert!(!scene.path("later").exists());
}
