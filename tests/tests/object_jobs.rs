//! Files of objects have the same bytes however they are built: on any number of threads, in parts, in stages, on disk,
//! after kills.

use std::fs;

use lodpack_tests::scene::{Sharing, plant, write_glb};

use crate::jobs::{Folder, killed, later};

/// A few thousand triangles for each region, so that parts and the disk have something to do.
const OPTIONS: &str = "--region-triangles 6000 --tolerance 0.002";

/// A folder with `plant.glb`, and the bytes of a build of it in memory.
fn folder() -> (Folder, Vec<u8>) {
    let folder = Folder::new();
    write_glb(&plant(120), Sharing::Meshes, &folder.path("plant.glb")).expect("writable");
    folder.ok(&format!("build plant.glb {OPTIONS} -o expected.lodpack --threads 1"));
    let expected = fs::read(folder.path("expected.lodpack")).expect("written");
    let info: serde_json::Value = serde_json::from_str(&folder.ok("info expected.lodpack --json")).expect("JSON");
    assert!(info["channels"].as_array().is_some_and(|channels| !channels.is_empty()), "colours as palettes: {info}");
    (folder, expected)
}

#[test]
fn files_of_objects_have_the_same_bytes_on_any_number_of_threads_on_disk_in_parts_and_in_stages() {
    let (folder, expected) = folder();
    let is_expected = |how: &str| assert!(fs::read(folder.path("out.lodpack")).expect("written") == expected, "{how}");
    for how in ["--threads 2", "--threads 7", "--threads 2 --memory 26MiB", "--workers 2"] {
        folder.ok(&format!("build plant.glb {OPTIONS} -o out.lodpack --force {how}"));
        is_expected(how);
    }
    folder.ok(&format!("plan plant.glb {OPTIONS} -o job --parts 3"));
    for part in ["2", "0-1"] {
        folder.ok(&format!("build --job job --part {part}"));
    }
    folder.ok("merge job -o out.lodpack --force");
    is_expected("parts");
    folder.ok(&format!("plan plant.glb {OPTIONS} -o job --stages --parts 3 --range-bytes 100kB --force"));
    folder.ok("work job");
    folder.ok("merge job -o out.lodpack --force");
    is_expected("stages");
}

#[test]
fn files_of_objects_have_the_same_bytes_after_kills() {
    let (folder, expected) = folder();
    let mut kills = 0;
    for words in [
        format!("build plant.glb {OPTIONS} --memory 26MiB -o out.lodpack --resume"),
        format!("plan plant.glb {OPTIONS} -o job --parts 2 --resume"),
        "build --job job --part 0".into(),
        "build --job job --part 1".into(),
        "merge job -o merged.lodpack --force".into(),
    ] {
        for round in 1..5 {
            kills += u32::from(killed(folder.command(&words), later(round), "-KILL").0);
        }
        folder.ok(&words);
    }
    assert!(kills > 2, "only {kills} kills met a build");
    for name in ["out.lodpack", "merged.lodpack"] {
        assert!(fs::read(folder.path(name)).expect("written") == expected, "{name}");
    }
}
