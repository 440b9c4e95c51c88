//! Jobs whose planning is divided, too, as people run them: workers, kills in every stage, what `status` says, and
//! recipes.

use crate::jobs::{Folder, killed, kills_until_built, later};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Begins a job of several tasks in each stage; the word `SCAN` brings its options.
const BEGIN: &str = "plan SCAN -o job --stages --parts 6 --range-bytes 300kB";

const STAGES: [&str; 11] =
    ["scan", "count", "cut", "divide", "repair", "match", "segment", "seams", "build", "arrange", "encode"];

#[test]
fn a_job_in_stages_goes_from_plan_to_file() {
    let folder = Folder::new();
    let text = folder.ok(BEGIN);
    assert!(text.contains("lodpack work job") && text.contains("lodpack merge job"), "{text}");
    assert!(!text.contains("import"), "it can be read in ranges: {text}");
    assert_eq!(folder.run("status job").status.code(), Some(1));
    let message = folder.refused("work job --stage repair --task 2");
    assert!(message.contains("task 0 of the stage divide is not done"), "{message}");
    folder.ok("work job --stage scan --task 1");
    let text = folder.ok_or_unfinished("status job");
    assert!(text.contains("scan") && text.contains("next       lodpack work job"), "{text}");
    let out = folder.ok("work job --json");
    let did: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    let did = did.as_array().expect("tasks");
    assert!(!did.iter().any(|task| task["stage"] == "scan" && task["task"] == 1), "done before");
    assert!(STAGES.iter().all(|stage| did.iter().any(|task| task["stage"] == *stage)), "{did:?}");
    assert_eq!(folder.ok("work job"), "", "nothing is left to do");
    let status: serde_json::Value = serde_json::from_str(&folder.ok("status job --json")).expect("JSON");
    assert_eq!(status["remaining_seconds"], 0.0);
    assert!(
        status["stages"].as_array().expect("stages").iter().all(|stage| stage["done"] == stage["tasks"]),
        "{status}"
    );
    assert!(folder.ok("status job").contains("lodpack merge job"));
    folder.ok("merge job -o out.lodpack");
    assert!(folder.built("out.lodpack"));
    // What the words do not fit is refused.
    assert!(folder.refused("work job --task 3").contains("--stage"));
    assert!(folder.refused("work job --stage scan --task 0-99").contains("no task 99"));
    assert!(folder.refused("work nowhere").contains("holds no job"));
    assert!(folder.refused("add job other.ply -o more --stages").contains("omit --stages"));
    assert!(folder.refused("plan SCAN -o job --resume").contains("lodpack work"));
    folder.ok("plan SCAN -o job --parts 2 --force");
    // Any job has its parts done by workers.
    folder.ok("work job");
    folder.ok("merge job -o again.lodpack");
    assert!(folder.built("again.lodpack"));
}

#[test]
fn workers_of_one_machine_give_the_bytes_of_one_build() {
    let folder = Folder::new();
    for workers in [1, 3] {
        let out = folder.ok(&format!("build SCAN --workers {workers} -o out.lodpack --force --json"));
        assert!(folder.built("out.lodpack"), "{workers}");
        let summary: serde_json::Value = serde_json::from_str(&out).expect("JSON");
        assert!(
            summary["temporary_bytes"].as_u64() > Some(0) && summary["cpu_seconds"].as_f64() > Some(0.1),
            "{summary}"
        );
        assert_eq!(fs::read_dir(folder.path("")).expect("readable").count(), 1, "something was left behind");
    }
    let message = folder.refused("build SCAN --workers 2 --memory 2MiB -o small.lodpack");
    assert!(message.contains("--memory") && message.contains("--resume"), "{message}");
    folder.ok("build SCAN --workers 2 -o small.lodpack --resume");
    assert!(folder.built("small.lodpack"));
}

#[test]
fn twenty_kills_over_all_stages_change_nothing() {
    let folder = Folder::new();
    let mut kills = 0;
    // Each pass gives every stage a kill at another moment.
    for pass in 0..3 {
        folder.ok(&format!("{BEGIN} --force"));
        for stage in STAGES {
            for round in 0..4 {
                let command = folder.command(&format!("work job --stage {stage} --threads 1 --progress none"));
                let after = later(round) + Duration::from_micros(700 * pass);
                let (was_running, message) = killed(command, after, "-KILL");
                assert!(message.is_empty(), "{stage}: {message}");
                kills += u32::from(was_running);
            }
            folder.ok(&format!("work job --stage {stage}"));
        }
        folder.ok("merge job -o out.lodpack --force");
        assert!(folder.built("out.lodpack"), "pass {pass}");
    }
    assert!(kills >= 20, "only {kills} kills met a worker");
}

#[test]
fn workers_end_with_a_killed_build_which_can_be_resumed() {
    let folder = Folder::new();
    let kills = kills_until_built(&folder, "build SCAN --workers 2 -o out.lodpack --resume", 2);
    assert!(kills > 0 && folder.built("out.lodpack"));
    assert_eq!(fs::read_dir(folder.path("")).expect("readable").count(), 1, "something was left behind");
}

#[test]
fn what_is_left_of_a_state_that_was_being_removed_is_begun_anew() {
    let folder = Folder::new();
    let state = folder.path("out.lodpack.building");
    // What is gone beside the manifest: a folder, or files whose names end so, of which others say that they are there.
    for (options, removed) in [
        ("", "stages"),
        ("", "parts"),
        ("--tolerance 1", "nothing"),
        ("", ".repaired"),
        ("", ".charted"),
        ("", ".stats"),
    ] {
        folder.ok(&format!("plan SCAN -o out.lodpack.building --stages --parts 8 {options}"));
        folder.ok("work out.lodpack.building");
        // What vouches for other files goes first, and a signal may come at any moment after that.
        for name in ["job.json", "plan", "divided"] {
            let _ = fs::remove_file(state.join(name));
        }
        for entry in fs::read_dir(&state).expect("readable").map(|entry| entry.expect("readable").path()) {
            let name = entry.file_name().and_then(|name| name.to_str()).expect("a name");
            if name == removed {
                fs::remove_dir_all(&entry).expect("a folder");
            } else if removed.starts_with('.') && name.ends_with(removed) {
                fs::remove_file(&entry).expect("a file");
            }
        }
        folder.ok("build SCAN --workers 2 -o out.lodpack --resume");
        assert!(folder.built("out.lodpack"), "{options} without {removed}");
        fs::remove_file(folder.path("out.lodpack")).expect("it was built");
    }
}

#[test]
fn two_workers_may_be_told_the_same() {
    let folder = Folder::new();
    folder.ok(BEGIN);
    for stage in STAGES {
        let both = [0, 1].map(|_| {
            folder.command(&format!("work job --stage {stage} --task 0 --progress none")).spawn().expect("it starts")
        });
        for mut worker in both {
            assert!(worker.wait().expect("it ends").success(), "{stage}");
        }
        folder.ok(&format!("work job --stage {stage}"));
    }
    folder.ok("merge job -o out.lodpack");
    assert!(folder.built("out.lodpack"));
}

#[test]
fn a_failed_task_is_named_with_its_note() {
    let folder = Folder::new();
    folder.ok(BEGIN);
    let message = folder.refused("work job --memory 24.2MiB");
    assert!(message.contains("--memory 24MiB is too little"), "{message}");
    let text = folder.ok_or_unfinished("status job");
    assert!(text.contains("failed: ") && text.contains("job/stages/repair-") && text.contains(".failed"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&folder.ok_or_unfinished("status job --json")).expect("JSON");
    let failed =
        json["stages"].as_array().expect("stages").iter().flat_map(|stage| stage["failed"].as_array().expect("failed"));
    let notes: Vec<&str> = failed.map(|task| task["note"].as_str().expect("a path")).collect();
    assert!(!notes.is_empty() && notes.iter().all(|note| folder.path(note).exists()), "{notes:?}");
    folder.ok("work job");
    folder.ok("merge job -o out.lodpack");
    assert!(folder.built("out.lodpack"));
}

#[test]
fn a_dry_run_of_a_job_in_stages_shows_all_of_them() {
    let folder = Folder::new();
    folder.ok(BEGIN);
    folder.ok("work job --stage scan");
    folder.ok("work job --stage count --task 0");
    let text = folder.ok("submit job --dry-run");
    assert!(!text.contains('@') && !text.contains("--stage scan"), "a placeholder, or a stage that is done: {text}");
    for stage in STAGES.iter().filter(|stage| !["scan", "build"].contains(stage)) {
        assert!(
            text.contains(&format!("--stage {stage} ")) && text.contains(&format!("job/slurm/{stage}.sh")),
            "{stage}: {text}"
        );
    }
    assert!(text.contains("#SBATCH --array=1-") && text.contains("#SBATCH --array=0-5\n"), "{text}");
    assert_eq!(text.matches("--dependency=afterok:").count(), 10, "{text}");
}

#[test]
fn the_simulator_of_clusters_passes_its_own_checks() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/bench/cluster.py");
    let out = std::process::Command::new("python3").arg(script).arg("check").output().expect("python3 is installed");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}
