//! The program as people run it.

use crate::scan;
use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

fn lodpack() -> Command {
    // The binary belongs to another package of the workspace: `cargo test --workspace` builds it beside the tests.
    let mut path = std::env::current_exe().expect("a test binary has a path");
    path.pop();
    if path.ends_with("deps") {
        path.pop();
    }
    Command::new(path.join("lodpack"))
}

fn json(output: &[u8]) -> Value {
    serde_json::from_slice(output).expect("--json prints JSON")
}

fn arg(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

#[test]
fn a_scan_goes_in_and_meshes_come_out() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let file = dir.path().join("scan.lodpack");
    let out = lodpack().args(["build", arg(&scan()), "-o", arg(&file), "--json"]).output().expect("runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let summary = json(&out.stdout);
    for name in ["certified_error", "cpu_seconds", "peak_memory_bytes", "bytes", "bits_per_input_vertex", "stages"] {
        assert!(!summary[name].is_null(), "{name} is missing");
    }
    assert_eq!(summary["bytes"].as_u64(), Some(file.metadata().expect("written").len()));

    // It does not overwrite without being told to.
    lodpack().args(["build", arg(&scan()), "-o", arg(&file)]).assert().code(2);

    let info = json(&lodpack().args(["info", arg(&file), "--json"]).output().expect("runs").stdout);
    assert_eq!(info["bytes"], summary["bytes"]);
    assert_eq!(info["levels"].as_array().map(Vec::len), summary["levels"].as_array().map(Vec::len));
    let sections: u64 = info["sections"].as_array().expect("sections").iter().filter_map(|s| s["bytes"].as_u64()).sum();
    assert_eq!(Some(sections), info["bytes"].as_u64(), "every byte belongs to a section");

    lodpack().args(["verify", arg(&file), "--cuts", "20"]).assert().code(0);

    for (name, extra) in [
        ("a.ply", vec![]),
        ("b.obj", vec!["--triangles", "5000"]),
        ("c.stl", vec!["--tolerance", "1%"]),
        ("d.glb", vec!["--triangles", "2000"]),
    ] {
        let mesh = dir.path().join(name);
        let out =
            lodpack().args(["extract", arg(&file), "-o", arg(&mesh), "--json"]).args(&extra).output().expect("runs");
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let extracted = json(&out.stdout);
        if extra.first() == Some(&"--triangles") {
            assert!(extracted["triangles"].as_u64() <= extra[1].parse().ok());
        }
        assert!(extracted["bytes_read"].as_u64() <= summary["bytes"].as_u64());
        let read = lodpack_cli::import::import_meshes(&[mesh], &lodpack_cli::progress::Silent).expect("readable");
        assert_eq!(Some(read.triangles.len() as u64), extracted["triangles"].as_u64(), "{name}");
    }
}

#[test]
fn damage_makes_verify_exit_with_1_and_absence_with_2() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let file = dir.path().join("scan.lodpack");
    lodpack().args(["build", arg(&scan()), "-o", arg(&file), "--tolerance", "1%"]).assert().code(0);
    let mut bytes = std::fs::read(&file).expect("written");
    let middle = bytes.len() * 2 / 3;
    bytes[middle] ^= 0x10;
    std::fs::write(&file, bytes).expect("writable");
    lodpack().args(["verify", arg(&file)]).assert().code(1);
    lodpack().args(["verify", arg(&dir.path().join("nothing.lodpack"))]).assert().code(2);
    lodpack().args(["info", arg(&scan())]).assert().code(2);
}

#[test]
fn a_failed_build_leaves_nothing_behind() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mesh = dir.path().join("bad.ply");
    std::fs::write(&mesh, "ply\nformat ascii 1.0\nelement vertex 3\n").expect("writable");
    let out = lodpack().args(["build", arg(&mesh), "-o", arg(&dir.path().join("x.lodpack"))]).output().expect("runs");
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stderr).contains("bad.ply"), "the message names the file");
    let left: Vec<_> = std::fs::read_dir(dir.path()).expect("readable").filter_map(Result::ok).collect();
    assert_eq!(left.len(), 1, "only the input is left");
}

#[test]
fn a_metric_tolerance_needs_a_unit() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let file = dir.path().join("x.lodpack");
    let build = |extra: &[&str]| {
        lodpack()
            .args(["build", arg(&scan()), "-o", arg(&file), "--tolerance", "10mm"])
            .args(extra)
            .output()
            .expect("runs")
    };
    let refused = build(&[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--unit"));
    assert!(build(&["--unit", "m"]).status.success());
}

#[test]
fn every_command_explains_itself() {
    for command in ["build", "info", "verify", "extract", "atlas"] {
        let out = lodpack().args([command, "--help"]).output().expect("runs");
        assert!(String::from_utf8_lossy(&out.stdout).contains("Examples:"), "{command}");
    }
}
