//! Objects: kept apart in every kind of build, and joined where they are tiles.

use std::collections::BTreeMap;

use super::stages::{begin, work_all};
use super::*;
use crate::pipeline::summary::BuildSummary;
use lodpack_import::{Objects, Ways};

/// Bent boxes side by side and on one another, which share the vertices where they touch; each is an object of its own
/// in the assembly of its layer. Boxes of the second layer have polygons that precede their vertices.
fn boxes() -> String {
    let (mut numbers, mut vertices, mut faces) = (BTreeMap::new(), vec![], String::new());
    const CUTS: i32 = 4;
    for (number, [x, y, z]) in (0..72).map(|i| [i % 6, i / 6 % 6, i / 36]).enumerate() {
        faces += &match z {
            0 => format!("o ground\ng box {number}\n"),
            _ => format!("o upper {number}\n"),
        };
        let mut vertex = |at: [i32; 3]| {
            *numbers.entry(at).or_insert_with(|| {
                vertices.push(at.map(|x| f64::from(x) * 0.25));
                vertices.len() as i32
            })
        };
        let corner = [x, y, z].map(|x| x * CUTS);
        for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, CUTS)]) {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (i, j) in (0..CUTS).flat_map(|i| (0..CUTS).map(move |j| (i, j))) {
                let mut at = |a: i32, b: i32| {
                    let mut at = corner;
                    (at[axis], at[u], at[v]) = (at[axis] + side, at[u] + i + a, at[v] + j + b);
                    vertex(at)
                };
                let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                let [b, d] = if side == 0 { [d, b] } else { [b, d] };
                faces += &match z {
                    0 => format!("f {a} {b} {c}\nf {a} {c} {d}\n"),
                    _ => format!("f {a} {b} {c} {d}\n"),
                };
            }
        }
    }
    let line = |[x, y, z]: &[f64; 3]| format!("v {} {} {}\n", x + 0.02 * y * y, y + 0.01 * z * z, z - 0.03 * x * x);
    let (early, late) = vertices.split_at(vertices.len() / 2);
    let lines = |some: &[[f64; 3]]| some.iter().map(line).collect::<String>();
    format!("{}{faces}{}", lines(early), lines(late))
}

fn scene(text: &str, objects: Objects) -> Scene {
    let mut scene = Scene::new();
    let path = scene.path("boxes.obj");
    fs::write(&path, text).unwrap();
    scene.options.inputs = vec![path];
    scene.options.model.objects = objects;
    scene
}

fn built(options: &BuildOptions) -> (Vec<u8>, BuildSummary) {
    let mut bytes = vec![];
    let summary = build(options, &mut bytes, &Silent).unwrap();
    (bytes, summary)
}

#[test]
fn objects_that_touch_stay_whole_in_builds_of_every_kind() {
    let scene = scene(&boxes(), Objects::Auto);
    let (expected, summary) = built(&scene.options);
    assert_eq!((summary.objects, summary.assemblies), (72, 1));
    assert_eq!((summary.repairs.duplicate_faces, summary.repairs.components), (0, 72));
    assert_eq!((summary.repairs.boundary_edges, summary.triangles), (0, 72 * 6 * 32));
    let joined = BuildOptions {
        model: ModelOptions { objects: Objects::Join, ..scene.options.model.clone() },
        ..scene.options.clone()
    };
    let (other, joined) = built(&joined);
    assert!(joined.repairs.duplicate_faces > 1000 && joined.objects == 0 && other != expected);

    // With its state on the disk.
    let least = lodpack_runtime::storage::memory::least_bytes(0) + 130 * 4500 + 24 * 7000;
    let (bytes, summary) = built(&BuildOptions { memory: least, ..scene.options.clone() });
    assert!(bytes == expected && summary.temporary_bytes > 0 && summary.objects == 72);
    // In parts, merged without the job.
    for parts in [1, 5, 64] {
        let job = scene.plan(&format!("job-{parts}"), Some(parts));
        scene.build_all(&job);
        let elsewhere = scene.path(&format!("elsewhere-{parts}"));
        fs::rename(job.join(PARTS_NAME), &elsewhere).unwrap();
        assert!(merged(&elsewhere).unwrap() == expected, "{parts}");
    }
    // In stages, whose tasks read ranges of the text.
    for (name, range_bytes) in [("one", u64::MAX), ("many", 20_000)] {
        let job = begin(&scene, name, 7, range_bytes);
        assert_eq!(StagedJob::open(&job).unwrap().stages().ways, Ways::Lines);
        work_all(&job).unwrap();
        assert!(merged(&job).unwrap() == expected, "{name}");
    }
}

#[test]
fn tiles_are_one_surface_unless_they_are_to_be_kept() {
    // Three tiles of one sheet.
    let tile = |x: u32| {
        let mut text = format!("o tile {x}\n");
        for (i, j) in (0..20).flat_map(|i| (0..20).map(move |j| (i, j))) {
            let [a, b] = [1 + (20 * x + i) * 21 + j, 1 + (20 * x + i + 1) * 21 + j];
            text += &format!("f {a} {b} {} {}\n", b + 1, a + 1);
        }
        text
    };
    let vertices: String = (0..61 * 21).map(|i| format!("v {} {} {}\n", i / 21, i % 21, i % 3)).collect();
    let text = vertices + &(0..3).map(tile).collect::<String>();
    let [auto, keep, join] = [Objects::Auto, Objects::Keep, Objects::Join].map(|objects| {
        let scene = scene(&text, objects);
        let (bytes, summary) = built(&scene.options);
        let job = begin(&scene, "job", 3, 10_000);
        work_all(&job).unwrap();
        assert!(merged(&job).unwrap() == bytes, "{objects}");
        let least = lodpack_runtime::storage::memory::least_bytes(0) + 130 * 4500 + 24 * 7000;
        assert!(built(&BuildOptions { memory: least, ..scene.options.clone() }).0 == bytes, "{objects}");
        (bytes, summary.objects, summary.repairs.components)
    });
    assert_eq!((auto.1, auto.2), (0, 1));
    assert_eq!((keep.1, keep.2), (3, 3));
    assert!(auto == join);
}

#[test]
fn what_may_grow_has_no_objects() {
    let mut scene = scene(&boxes(), Objects::Auto);
    (scene.options.model.extensible, scene.options.model.tolerance) = (true, "0.05".parse().unwrap());
    assert_eq!(built(&scene.options).1.objects, 0);
    scene.options.model.objects = Objects::Keep;
    let error = build(&scene.options, &mut vec![], &Silent).unwrap_err().to_string();
    assert!(error.contains("omit --objects keep"), "{error}");
}
