//! Files of heights in parts: the same bytes as one build, whatever is killed, and nothing that was changed is trusted.

use crate::heights::Folder as Rasters;
use crate::jobs::{Folder, killed, later};
use lodpack_tests::terrain::Grid;
use std::fs;
use std::path::Path;

/// A raster in a folder, and what is typed about it.
struct Case {
    folder: Folder,
    options: &'static str,
}

impl Case {
    fn new(grid: &Grid, is_globe: bool, options: &'static str, without: impl Fn(u32, u32) -> bool) -> Self {
        let (folder, rasters) = (Folder::new(), Rasters::new());
        let raster = rasters.fractal("dem.tif", grid, is_globe, without);
        fs::copy(raster, folder.path("dem.tif")).expect("a writable folder");
        folder.ok(&format!("build dem.tif --heights {options} -o whole.lodpack"));
        Self { folder, options }
    }

    /// A plane of a few units, with a coast.
    fn coast() -> Self {
        let without = |column, row| column > 900 && row > 1200 && (column * row) % 7 == 0 || column > 1900 && row < 300;
        Self::new(&Grid::utm([2300, 1500]), false, "--tolerance 2 --ramp earth", without)
    }

    fn plan(&self, parts: u32) -> String {
        format!("plan dem.tif --heights {} -o job --parts {parts}", self.options)
    }

    fn is_whole(&self, name: &str) -> bool {
        let read = |name: &str| fs::read(self.folder.path(name)).expect("written");
        read(name) == read("whole.lodpack")
    }
}

#[test]
fn parts_on_planes_and_globes_have_the_bytes_of_one_build() {
    let globe = Grid::globe([4096, 2049]);
    for case in [Case::coast(), Case::new(&globe, true, "--surface wgs84 --tolerance 5m", |_, _| false)] {
        let folder = &case.folder;
        for (number, (parts, threads)) in [(1, 1), (3, 2), (16, 1)].into_iter().enumerate() {
            let plan = folder.ok(&format!("{} --threads {threads} --force", case.plan(parts)));
            assert!(plan.contains("lodpack build --job job --part") && plan.contains("cells"), "{plan}");
            // From the last one to the first.
            for part in (0..parts).rev() {
                folder.ok(&format!("build --job job --part {part} --threads {threads} --memory 512MiB"));
            }
            let status: serde_json::Value = serde_json::from_str(&folder.ok("status job --json")).expect("JSON");
            assert!(status["parts"].as_array().expect("parts").iter().all(|part| part["state"] == "done"), "{status}");
            folder.ok(&format!("merge job -o {number}.lodpack"));
            assert!(case.is_whole(&format!("{number}.lodpack")), "{parts} parts");
        }
        // Parts know all that a merge needs.
        fs::rename(folder.path("job/parts"), folder.path("elsewhere")).expect("movable");
        folder.ok("merge elsewhere -o moved.lodpack");
        assert!(case.is_whole("moved.lodpack"));
    }
}

#[test]
fn plans_parts_and_merges_of_heights_can_be_killed() {
    let case = Case::coast();
    let folder = &case.folder;
    for (words, product) in [
        (format!("{} --resume", case.plan(2)), "job/job.json"),
        ("build --job job --part 0".into(), "job/parts/part-0.lodpart"),
        ("build --job job --part 1".into(), "job/parts/part-1.lodpart"),
        ("merge job -o out.lodpack --force".into(), "out.lodpack"),
    ] {
        for round in 0.. {
            let (was_running, _) = killed(folder.command(&words), later(round), "-KILL");
            // What has its final name is finished, but a job begins with its manifest.
            if !was_running || product != "job/job.json" && folder.path(product).exists() {
                break;
            }
        }
    }
    assert!(case.is_whole("out.lodpack"));
}

/// Changes the byte in the middle of a file.
fn change(path: &Path) {
    let mut bytes = fs::read(path).expect("readable");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    fs::write(path, bytes).expect("writable");
}

#[test]
fn what_was_changed_since_the_plan_is_named_and_not_used() {
    let case = Case::coast();
    let folder = &case.folder;
    let plan = case.plan(3);
    folder.ok(&plan);
    assert!(folder.refused(&plan).contains("--resume"));
    folder.ok("build --job job --part 0-2");
    // A part.
    change(&folder.path("job/parts/part-1.lodpart"));
    let message = folder.refused("merge job -o out.lodpack");
    assert!(message.contains("1 of 3 parts") && message.contains("`lodpack build --job job --part 1`"), "{message}");
    folder.ok("build --job job --part 1");
    folder.ok("merge job -o out.lodpack");
    assert!(case.is_whole("out.lodpack"));
    // Samples.
    fs::remove_file(folder.path("job/parts/part-1.lodpart")).expect("it is there");
    change(&folder.path("job/samples"));
    let message = folder.refused("build --job job --part 1");
    assert!(message.contains("samples is not as it was when the job was planned"), "{message}");
    assert!(!folder.path("job/parts/part-1.lodpart").exists());
    assert!(folder.ok_or_unfinished("status job").contains("failed"));
    // The plan: made again where it is resumed.
    change(&folder.path("job/plan"));
    assert!(folder.refused("build --job job --part 1").contains("damaged"));
    folder.ok(&format!("{plan} --resume"));
    folder.ok("build --job job --part 0-2");
    folder.ok("merge job -o out.lodpack --force");
    assert!(case.is_whole("out.lodpack"));
    // Parts of another job.
    folder.ok(&case.plan(3).replace("--tolerance 2", "--tolerance 3").replace("-o job", "-o other"));
    folder.ok("build --job other --part 0-2");
    fs::copy(folder.path("other/parts/part-2.lodpart"), folder.path("job/parts/part-2.lodpart")).expect("writable");
    assert!(folder.refused("merge job -o out.lodpack --force").contains("another job"));
    // A mesh of the same raster is no continuation.
    assert!(
        folder.refused("plan dem.tif --as mesh --tolerance 2 --ramp earth -o job --resume").contains("other options")
    );
}

#[test]
fn a_job_of_heights_says_what_it_needs() {
    let case = Case::coast();
    let folder = &case.folder;
    let message = folder.refused(&format!("{} --part-memory 30MiB", case.plan(3)));
    assert!(message.contains("--part-memory 30MiB is too little") && message.contains("--resume"), "{message}");
    folder.ok(&format!("{} --part-memory 1GiB --resume", case.plan(3)));
    assert!(folder.refused("build --job job --part 0 --memory 30MiB").contains("--memory 30MiB is too little"));
    let out = folder.run(&format!("{} --force", case.plan(64)));
    assert!(String::from_utf8_lossy(&out.stderr).contains("of 64 parts have nothing to do"), "{out:?}");
    let scripts = folder.ok("submit job --dry-run --program lodpack");
    assert!(scripts.contains("build --job") && scripts.contains("--part") && scripts.contains("merge"), "{scripts}");
    assert!(folder.refused("plan SCAN --heights -o other").contains("rasters"));
    assert!(!folder.path("other").exists());
}
