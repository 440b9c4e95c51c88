//! The program as people run it.

use crate::scan;
use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};

pub fn lodpack() -> Command {
    Command::new(env!("CARGO_BIN_EXE_lodpack"))
}

fn json(output: &[u8]) -> Value {
    serde_json::from_slice(output).expect("--json prints JSON")
}

fn arg(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

#[cfg(unix)]
#[test]
fn what_is_no_file_is_not_opened() {
    for (path, problem) in [("/dev/zero", "device or pipe"), ("/", "directory")] {
        let out = lodpack().args(["info", path]).output().expect("runs");
        let said = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(2) && said.contains(problem), "{path}: {said}");
    }
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
fn neither_the_format_nor_the_memory_decides_the_bytes() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mesh = lodpack_cli::import::import_meshes(&[scan()], &lodpack_cli::progress::Silent).expect("readable");
    let save = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        path
    };
    let vertices = mesh.positions.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    let obj = save("scan.obj", vertices.chain(faces).collect::<String>().as_bytes());
    let mut binary: Vec<u8> =
        mesh.positions.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
    let index_offset = binary.len();
    binary.extend(mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    save("scan.bin", &binary);
    let document = serde_json::json!({
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": binary.len(), "uri": "scan.bin"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": index_offset},
            {"buffer": 0, "byteOffset": index_offset, "byteLength": binary.len() - index_offset}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": mesh.positions.len(), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR"}
        ]
    });
    let gltf = save("scan.gltf", document.to_string().as_bytes());
    let vertices = mesh.positions.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}\n"));
    let counts = format!("OFF\n{} {} 0\n", mesh.positions.len(), mesh.triangles.len());
    let off = save("scan.off", std::iter::once(counts).chain(vertices).chain(faces).collect::<String>().as_bytes());
    let mut expected = None;
    for input in [&scan(), &obj, &gltf, &off] {
        for memory in ["1GiB", "30MiB"] {
            let file = dir.path().join("out.lodpack");
            let fixed = ["build", arg(input), "-o", arg(&file), "--tolerance", "0.5%", "--force"];
            // What glTF says of itself.
            let place = ["--up", "y", "--unit", "m"];
            lodpack()
                .args(fixed)
                .args(place)
                .args(["--region-triangles", "20000", "--memory", memory])
                .assert()
                .code(0);
            let bytes = std::fs::read(&file).expect("written");
            assert!(*expected.get_or_insert_with(|| bytes.clone()) == bytes, "{} {memory}", input.display());
        }
    }
}

#[test]
fn memory_decides_nothing_but_where_the_work_is_done() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let temp = tempfile::tempdir().expect("a temporary directory");
    let scan = scan();
    for triangles in ["5000", "20000"] {
        let [in_memory, on_disk] = ["memory", "disk"].map(|name| dir.path().join(format!("{name}{triangles}.lodpack")));
        let build = |file: &Path, memory: &[&str]| {
            let fixed = ["build", arg(&scan), "-o", arg(file), "--tolerance", "0.5%", "--json"];
            let out =
                lodpack().args(fixed).args(["--region-triangles", triangles]).args(memory).output().expect("runs");
            assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
            json(&out.stdout)["temporary_bytes"].as_u64().expect("a number")
        };
        assert_eq!(build(&in_memory, &[]), 0);
        let disk_bytes = build(&on_disk, &["--memory", "30MiB", "--temp", arg(temp.path())]);
        assert!(disk_bytes > 2_000_000, "{disk_bytes}");
        assert!(std::fs::read(in_memory).expect("written") == std::fs::read(on_disk).expect("written"));
    }
    // Without --temp the files are beside the output.
    let file = dir.path().join("beside.lodpack");
    let fixed = ["build", arg(&scan), "-o", arg(&file)];
    lodpack().args(fixed).args(["--region-triangles", "20000", "--memory", "30MiB"]).assert().code(0);
    // Neither success nor failure leaves any.
    let refused = lodpack().args(fixed).args(["--force", "--memory", "30MiB"]).assert().code(2).get_output().clone();
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(message.contains("needs --memory"), "{message}");
    lodpack().args(fixed).args(["--force", "--memory", "30MiB", "--temp", "/nowhere"]).assert().code(2);
    lodpack().args(fixed).args(["--force", "--memory", "much"]).assert().code(2);
    assert_eq!(std::fs::read_dir(temp.path()).expect("readable").count(), 0);
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 5);
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
    for command in [
        "build",
        "view",
        "info",
        "extract",
        "verify",
        "plan",
        "add",
        "status",
        "merge",
        "submit",
        "atlas",
        "report",
        "selftest",
        "completions",
        "man",
    ] {
        let out = lodpack().args([command, "--help"]).output().expect("runs");
        assert!(String::from_utf8_lossy(&out.stdout).contains("Examples:"), "{command}");
    }
}

/// A directory with a mesh of one triangle and what was built from it.
fn with_triangle() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mesh, file) = (dir.path().join("one.obj"), dir.path().join("one.lodpack"));
    std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("writable");
    lodpack().args(["build", arg(&mesh), "-o", arg(&file)]).assert().code(0);
    (dir, mesh, file)
}

/// The exit code and what was said on stderr.
fn outcome(args: &[&str]) -> (Option<i32>, String) {
    let out = lodpack().args(args).output().expect("runs");
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
#[cfg(target_os = "linux")]
fn a_device_is_written_and_never_replaced() {
    use std::os::unix::fs::FileTypeExt;
    // A link, so that nothing can happen to the device itself even if this fails.
    let (dir, mesh, file) = with_triangle();
    for (name, command, input) in [("full.lodpack", "build", &mesh), ("full.ply", "extract", &file)] {
        let link = dir.path().join(name);
        std::os::unix::fs::symlink("/dev/full", &link).expect("links are possible");
        let (code, said) = outcome(&[command, arg(input), "-o", arg(&link), "--force"]);
        assert_eq!(code, Some(2), "a full disk is an error");
        assert!(said.contains(name) && said.contains("No space"), "{said}");
        let is_device = std::fs::metadata(&link).expect("still there").file_type().is_char_device();
        assert!(is_device && link.is_symlink());
    }
}

#[test]
#[cfg(unix)]
fn what_a_link_leads_to_is_overwritten_not_the_link() {
    let (dir, mesh, file) = with_triangle();
    let link = dir.path().join("link.lodpack");
    std::os::unix::fs::symlink(&file, &link).expect("links are possible");
    assert_eq!(outcome(&["build", arg(&mesh), "-o", arg(&link)]).0, Some(2));
    assert_eq!(outcome(&["build", arg(&mesh), "-o", arg(&link), "--force", "--tolerance", "10%"]).0, Some(0));
    assert!(link.is_symlink() && file.is_file());
}

#[test]
fn an_input_is_never_overwritten() {
    let (_dir, mesh, file) = with_triangle();
    for (input, why) in [(&file, "is an input"), (&mesh, "this command writes .lodpack files")] {
        let before = std::fs::read(input).expect("readable");
        let (code, said) = outcome(&["build", arg(input), "-o", arg(input), "--force"]);
        assert_eq!(code, Some(2));
        assert!(said.contains(why), "{said}");
        assert_eq!(std::fs::read(input).expect("readable"), before);
    }
}

#[test]
fn boxes_are_six_numbers_in_order_and_may_be_negative() {
    let (dir, _, file) = with_triangle();
    let mesh = dir.path().join("box.ply");
    let extract = |text: &str| outcome(&["extract", arg(&file), "-o", arg(&mesh), "--force", "--bbox", text]);
    assert_eq!(extract("-1,-1,-1,2,2,2").0, Some(0));
    assert_eq!(extract("-inf,-inf,-inf,inf,inf,inf").0, Some(0));
    for (bad, word) in
        [("0,0,nan,1,1,1", "smaller corner"), ("0,0,0,1,1", "six numbers"), ("1,0,0,0,1,1", "smaller corner")]
    {
        let (code, said) = extract(bad);
        assert!(code == Some(2) && said.contains(word), "{bad}: {said}");
    }
    let (code, said) = extract("5,5,5,6,6,6");
    assert!(code == Some(2) && said.contains("nothing touches the box"), "{said}");
}

#[test]
fn budgets_that_cannot_be_met_say_what_can() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (file, mesh) = (dir.path().join("scan.lodpack"), dir.path().join("small.ply"));
    lodpack().args(["build", arg(&scan()), "-o", arg(&file), "--tolerance", "1%"]).assert().code(0);
    for (budget, hint) in [["--triangles", "1"], ["--nodes", "0"]].into_iter().zip(["ask for more", "at least"]) {
        let (code, said) = outcome(&["extract", arg(&file), "-o", arg(&mesh), budget[0], budget[1]]);
        assert!(code == Some(2) && said.contains(hint), "{said}");
    }
    assert!(!mesh.exists());
    // One node stands for everything.
    lodpack().args(["extract", arg(&file), "-o", arg(&mesh), "--nodes", "1"]).assert().code(0);
}

#[test]
fn unsuitable_places_are_named() {
    let (dir, mesh, file) = with_triangle();
    let place = dir.path();
    let missing = place.join("no").join("x.lodpack");
    for (args, word) in [
        (["build", arg(&mesh), "-o", arg(place)], "is a directory"),
        (["build", arg(&mesh), "-o", arg(&missing)], "there is no directory"),
        (["build", arg(&mesh), "-o", arg(&file)], "--force"),
        (["extract", arg(place), "-o", "x.ply"], "is a directory"),
        (["extract", arg(&file), "-o", "x.xyz"], ".ply"),
    ] {
        let (code, said) = outcome(&args);
        assert!(code == Some(2) && said.contains(word), "{args:?}: {said}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_closed_or_full_stdout_is_no_panic() {
    let (_dir, _, file) = with_triangle();
    let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let out = std::process::Command::new(lodpack().get_program())
        .args(["info", arg(&file)])
        .stdout(full)
        .output()
        .expect("runs");
    assert_eq!(out.status.code(), Some(2));

    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let out = std::process::Command::new(lodpack().get_program())
        .args(["info", arg(&file)])
        .stdout(writer)
        .output()
        .expect("runs");
    assert_eq!((out.status.code(), String::from_utf8_lossy(&out.stderr).as_ref()), (Some(0), ""));
}

#[test]
fn lost_precision_is_said() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mesh, file) = (dir.path().join("far.obj"), dir.path().join("far.lodpack"));
    std::fs::write(&mesh, "v 1e9 0 0\nv 1000000001 0 0\nv 1e9 1 0\nf 1 2 3\n").expect("writable");
    lodpack().args(["build", arg(&mesh), "-o", arg(&file)]).assert().code(0);
    let said = |name: &str| outcome(&["extract", arg(&file), "-o", arg(&dir.path().join(name)), "--force"]).1;
    assert!(said("far.stl").contains("single precision"));
    for name in ["far.ply", "out.obj", "far.glb"] {
        assert_eq!(said(name), "", "{name}");
    }
}

#[test]
fn nonsense_is_refused_with_a_word() {
    let (dir, mesh, _) = with_triangle();
    let file = dir.path().join("x.lodpack");
    for (option, value, word) in [
        ("--tolerance", "-1", "less than 0"),
        ("--tolerance", "1e-30", "too fine"),
        ("--tolerance", "5 parsec", "unknown unit"),
        ("--unit", "parsec", "unknown unit"),
        ("--threads", "100000", "at most"),
    ] {
        let (code, said) = outcome(&["build", arg(&mesh), "-o", arg(&file), option, value]);
        assert!(code == Some(2) && said.contains(word), "{option} {value}: {said}");
    }
}

/// The scan, built once at its automatic tolerance: the file, and the build's summary.
fn built_scan() -> (PathBuf, &'static Value) {
    static BUILT: std::sync::LazyLock<(tempfile::TempDir, Value)> = std::sync::LazyLock::new(|| {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let out =
            lodpack().arg("build").arg(scan()).arg("--json").arg("-o").arg(dir.path().join("scan.lodpack")).output();
        (dir, json(&out.expect("runs").stdout))
    });
    (BUILT.0.path().join("scan.lodpack"), &BUILT.1)
}

#[test]
fn a_build_and_its_file_say_the_same_error_and_it_keeps_the_tolerance() {
    let (file, summary) = built_scan();
    let info = json(&lodpack().args(["info", arg(&file), "--json"]).output().expect("runs").stdout);
    let levels = |value: &Value| -> Vec<f64> {
        value["levels"].as_array().expect("levels").iter().filter_map(|l| l["certified_error"].as_f64()).collect()
    };
    assert_eq!(levels(&info), levels(summary));
    assert_eq!(summary["certified_error"].as_f64(), levels(&info).last().copied());
    assert!(summary["certified_error"].as_f64() <= summary["tolerance"].as_f64(), "{summary}");
    // What was asked for can be asked for again.
    let out = file.with_extension("stl");
    let tolerance = summary["tolerance"].to_string();
    let (code, said) = outcome(&["extract", arg(&file), "-o", arg(&out), "--force", "--tolerance", &tolerance]);
    assert!(code == Some(0) && !said.contains("not reached"), "{said}");
}

#[test]
fn an_extracted_mesh_says_its_error_everywhere_and_what_keeps_it_from_being_finer() {
    let (file, _) = built_scan();
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mesh = dir.path().join("x.ply");
    let info = json(&lodpack().args(["info", arg(&file), "--json"]).output().expect("runs").stdout);
    let [low, high] = [0, 1].map(|end| [0, 1, 2].map(|k| info["bounds"][end][k].as_f64().expect("a number")));
    let corner = [0, 1, 2].map(|k| low[k] + 0.3 * (high[k] - low[k]));
    let bbox = low.iter().chain(&corner).map(f64::to_string).collect::<Vec<_>>().join(",");
    let extract = |more: &[&str]| {
        let out = lodpack().args(["extract", arg(&file), "-o", arg(&mesh), "--force", "--json"]).args(more).output();
        let out = out.expect("runs");
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        (json(&out.stdout), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let (focus, said) = extract(&["--bbox", &bbox, "--context"]);
    assert!(focus["certified_error"].as_f64() > focus["certified_error_in_box"].as_f64(), "{focus}");
    assert_eq!((said.as_str(), &focus["limited_by"]), ("", &"finest".into()));
    let text =
        lodpack().args(["extract", arg(&file), "-o", arg(&mesh), "--force", "--bbox", &bbox, "--context"]).output();
    let text = String::from_utf8_lossy(&text.expect("runs").stdout).into_owned();
    assert!(text.contains(" in the box, ") && text.contains(" everywhere"), "{text}");

    let (alone, _) = extract(&["--bbox", &bbox]);
    assert_eq!(alone["certified_error"], alone["certified_error_in_box"]);
    for (more, limited_by, word) in [
        (&["--tolerance", "1e-9"][..], "finest", "the finest level has"),
        (&["--tolerance", "0.01%", "--triangles", "3000"], "triangles", "the budget of 3,000 triangles allows only"),
        (&["--tolerance", "1%"], "tolerance", ""),
        (&["--triangles", "3000"], "triangles", ""),
    ] {
        let (summary, said) = extract(more);
        assert_eq!(summary["limited_by"], limited_by, "{more:?}");
        assert!(said.contains(word) && said.is_empty() == word.is_empty(), "{more:?}: {said}");
    }
}

#[test]
fn a_mesh_goes_to_stdout_in_the_format_that_is_named() {
    let (_dir, _, file) = with_triangle();
    let out = lodpack().args(["extract", arg(&file), "-o", "-", "--format", "obj"]).output().expect("runs");
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success() && text.starts_with("v ") && text.trim_end().ends_with(char::is_numeric), "{text}");
    for (more, word) in [(&[][..], "--format"), (&["--format", "ply", "--json"], "stdout")] {
        let args = [&["extract", arg(&file), "-o", "-"], more].concat();
        let (code, said) = outcome(&args);
        assert!(code == Some(2) && said.contains(word), "{said}");
    }
}

#[test]
fn gltf_is_in_metres_unless_somebody_says_otherwise() {
    let (dir, obj, file) = with_triangle();
    let glb = dir.path().join("one.glb");
    lodpack().args(["extract", arg(&file), "-o", arg(&glb)]).assert().code(0);
    let build = |inputs: &[&Path], more: &[&str]| {
        let out = dir.path().join("out.lodpack");
        let args = [&["build", "-o", arg(&out), "--force", "--json"], more].concat();
        let done = lodpack().args(args).args(inputs).output().expect("runs");
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        if done.status.success() { Ok(json(&done.stdout)["tolerance"].as_f64()) } else { Err(said) }
    };
    assert_eq!(build(&[&glb], &["--tolerance", "20mm"]), Ok(Some(0.02)));
    assert_eq!(build(&[&glb, &glb], &["--tolerance", "20mm"]), Ok(Some(0.02)));
    assert_eq!(build(&[&glb], &["--tolerance", "2mm", "--unit", "cm"]), Ok(Some(0.2)));
    assert_eq!(build(&[&glb, &obj], &["--tolerance", "2mm", "--unit", "cm"]), Ok(Some(0.2)));
    let refused = build(&[&glb, &obj], &["--tolerance", "20mm"]).expect_err("nobody knows the unit of one");
    assert!(refused.contains("one.obj") && refused.contains("--unit m"), "{refused}");
    // A unit that nothing depends on changes no byte.
    let bytes =
        |more: &[&str]| build(&[&obj], more).map(|_| std::fs::read(dir.path().join("out.lodpack")).expect("written"));
    assert_eq!(bytes(&["--unit", "mm"]), bytes(&[]));
}

#[test]
fn a_file_is_compared_with_the_mesh_that_it_is_of_and_no_other() {
    let (dir, mesh, file) = with_triangle();
    // In either order.
    assert_eq!(outcome(&["verify", "--against", arg(&mesh), arg(&file)]).0, Some(0));
    assert_eq!(outcome(&["verify", arg(&file), "--against", arg(&mesh)]).0, Some(0));
    let (code, said) = outcome(&["verify", "--against", arg(&mesh)]);
    assert!(code == Some(2) && said.contains("lodpack verify FILE --against MESH"), "{said}");
    for (name, text) in [
        ("two.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"),
        ("large.obj", "v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n"),
        ("far.obj", "v 5 0 0\nv 6 0 0\nv 5 1 0\nf 1 2 3\n"),
    ] {
        let other = dir.path().join(name);
        std::fs::write(&other, text).expect("writable");
        let out = lodpack().args(["verify", arg(&file), "--against", arg(&other), "--json"]).output().expect("runs");
        let report = json(&out.stdout);
        let problems = report["problems"].as_array().expect("problems");
        assert!(out.status.code() == Some(1) && problems.len() == 1, "{name}: {report}");
        assert!(problems[0]["what"].as_str().is_some_and(|what| what.contains("another mesh")), "{report}");
    }
}

#[test]
fn a_damaged_file_is_named_with_what_to_do_and_counts_nothing_that_was_not_drawn() {
    let (dir, _, file) = with_triangle();
    let damaged = dir.path().join("damaged.lodpack");
    let mut bytes = std::fs::read(&file).expect("readable");
    let last = bytes.len() - 1;
    bytes[last] ^= 0x10;
    std::fs::write(&damaged, &bytes).expect("writable");
    let (code, said) = outcome(&["extract", arg(&damaged), "-o", arg(&dir.path().join("x.ply"))]);
    assert!(
        code == Some(2) && said.contains("damaged.lodpack: damaged file") && said.contains("lodpack verify"),
        "{said}"
    );
    let out = lodpack().args(["verify", arg(&damaged), "--cuts", "0"]).output().expect("runs");
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.code() == Some(1) && !text.contains("boundary edges"), "{text}");
    let (code, said) = outcome(&["info", arg(&scan())]);
    assert!(code == Some(2) && said.contains("not a lodpack file") && said.contains("looks like a mesh"), "{said}");
    let (code, said) = outcome(&["info", "file:///x/y.lodpack"]);
    assert!(code == Some(2) && said.contains("as /x/y.lodpack"), "{said}");
}

#[test]
fn an_output_that_cannot_be_is_refused_before_anything_is_read() {
    let (dir, mesh, _) = with_triangle();
    let nothing = dir.path().join("nothing.lodpack");
    let missing = dir.path().join("no").join("x.ply");
    for (output, word) in
        [(mesh.clone(), "--force"), (missing, "there is no directory"), (dir.path().join("x.xyz"), ".ply")]
    {
        let (code, said) = outcome(&["extract", arg(&nothing), "-o", arg(&output)]);
        assert!(code == Some(2) && said.contains(word) && !said.contains("nothing.lodpack"), "{said}");
    }
}

#[test]
fn negative_counts_are_wrong_values_and_no_options() {
    for args in
        [&["verify", "x", "--cuts", "-1"], &["extract", "x", "--triangles", "-5"], &["build", "x", "--threads", "-2"]]
    {
        let (code, said) = outcome(args);
        assert!(code == Some(2) && said.contains("0 or above") && !said.contains("use '--"), "{said}");
    }
    let (code, said) = outcome(&["build", "x", "--part", "0"]);
    assert!(code == Some(2) && said.contains("--job JOB"), "{said}");
    let (code, said) = outcome(&["plan", "x", "-o", "y", "--parts", "-5"]);
    assert!(code == Some(2) && said.contains("not in 1..="), "{said}");
}

#[test]
fn what_is_left_out_of_an_input_is_said_once() {
    let (dir, _, _) = with_triangle();
    let (mesh, file) = (dir.path().join("rich.obj"), dir.path().join("rich.lodpack"));
    let text = "o thing\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nusemtl red\nf 1/1/1 2/1/1 3/1/1\n";
    std::fs::write(&mesh, text).expect("writable");
    let (code, said) = outcome(&["build", arg(&mesh), arg(&mesh), "-o", arg(&file)]);
    let words = ["normals, texture coordinates of the input are left out", "joined to one surface without names"];
    assert!(code == Some(0) && words.iter().all(|word| said.matches(word).count() == 1), "{said}");
}
