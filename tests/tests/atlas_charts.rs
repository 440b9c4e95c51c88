//! `lodpack build` keeps the charts of an atlas.

use crate::jobs::Folder;
use crate::{open, scan};
use lodpack_tests::generate::{bumpy_sphere, save_ply};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;

/// The roots of a file that no others stand below.
fn leaves(folder: &Folder, name: &str) -> usize {
    let bytes = fs::read(folder.path(name)).expect("written");
    let file = open(&bytes);
    file.verify().expect("sound");
    (0..file.root_count()).filter(|&root| file.children(root).expect("in the index").is_empty()).count()
}

fn manifest(folder: &Folder) -> Value {
    serde_json::from_slice(&fs::read(folder.path("atlas/atlas.json")).expect("written")).expect("JSON")
}

/// Charts with a map, and patches.
fn charts(manifest: &Value) -> [usize; 2] {
    let roots = manifest["roots"].as_array().expect("a list");
    let charts: BTreeSet<u64> = roots.iter().filter_map(|root| root["chart"].as_u64()).collect();
    [charts.len(), manifest["patches"].as_array().map_or(0, Vec::len)]
}

#[test]
fn each_chart_of_an_atlas_becomes_a_root() {
    let folder = Folder::new();
    save_ply(&bumpy_sphere(100), &folder.path("sphere.ply")).expect("writable");
    fs::copy(scan(), folder.path("scan.ply")).expect("writable");
    let mut patch_count = 0;
    for (name, resolution) in [("sphere.ply", 4), ("scan.ply", 3)] {
        folder.ok(&format!("atlas {name} -o atlas --force --resolution {resolution}"));
        let [charts, patches] = charts(&manifest(&folder));
        patch_count += patches;
        folder.ok("build atlas -o out.lodpack --force");
        assert!(charts > 5);
        assert_eq!(leaves(&folder, "out.lodpack"), charts + patches, "{name}, resolution {resolution}");
    }
    assert!(patch_count > 0, "the scan has holes");
    let kept = leaves(&folder, "out.lodpack");
    folder.ok("build atlas -o out.lodpack --force --new-charts");
    assert!(leaves(&folder, "out.lodpack") < kept / 2);
}

#[test]
fn images_without_charts_become_roots_and_what_is_apart_is_divided() {
    let folder = Folder::new();
    save_ply(&bumpy_sphere(60), &folder.path("sphere.ply")).expect("writable");
    folder.ok("atlas sphere.ply -o atlas --resolution 3");
    let mut manifest = manifest(&folder);
    let roots = manifest["roots"].as_array_mut().expect("a list");
    let images = roots.len();
    for root in roots.iter_mut() {
        root.as_object_mut().expect("an object").remove("chart");
    }
    let write = |manifest: &Value| fs::write(folder.path("atlas/atlas.json"), manifest.to_string()).expect("writable");
    write(&manifest);
    folder.ok("build atlas -o out.lodpack");
    assert_eq!(leaves(&folder, "out.lodpack"), images);
    // Two images that do not touch are two charts, whatever the atlas says.
    let roots = manifest["roots"].as_array_mut().expect("a list");
    let beside: BTreeSet<u64> =
        roots[0]["neighbours"].as_object().expect("an object").values().filter_map(|n| n["root"].as_u64()).collect();
    let far = (1..images as u64).rfind(|root| !beside.contains(root)).expect("an image elsewhere");
    roots[0]["chart"] = 7.into();
    roots[far as usize]["chart"] = 7.into();
    write(&manifest);
    folder.ok("build atlas -o again.lodpack");
    assert_eq!(leaves(&folder, "again.lodpack"), images);
}

#[test]
fn jobs_and_threads_keep_the_same_charts() {
    let folder = Folder::new();
    save_ply(&bumpy_sphere(100), &folder.path("sphere.ply")).expect("writable");
    folder.ok("atlas sphere.ply -o atlas --resolution 4");
    let built = |name: &str| fs::read(folder.path(name)).expect("written");
    for options in ["--region-triangles 8000", ""] {
        folder.ok(&format!("build atlas -o out.lodpack --force {options}"));
        folder.ok(&format!("build atlas -o one.lodpack --threads 1 --force {options}"));
        folder.ok(&format!("plan atlas -o job --parts 3 --force {options}"));
        folder.ok("build --job job --part 0-2");
        folder.ok("merge job -o merged.lodpack --force");
        for name in ["one.lodpack", "merged.lodpack"] {
            assert!(built(name) == built("out.lodpack"), "{name} {options}");
        }
    }
}
