//! Reports of error against run time, as people make them.

use crate::commands::lodpack;
use lodpack_tests::generate::{fan_part, rough_sphere, save_ply};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("the report wrote it")
}

/// Checks that tags are closed in order, values are quoted and letters escaped. Returns the names of all elements.
fn elements(text: &str) -> Vec<String> {
    let (mut open, mut all, mut rest) = (vec![], vec![], text);
    while let Some(start) = rest.find('<') {
        assert!(!rest[..start].contains('>'), "a bare > in {}", &rest[..start]);
        let mut entities = rest[..start].split('&').skip(1);
        assert!(entities.all(|e| ["amp;", "lt;", "gt;", "quot;"].iter().any(|name| e.starts_with(name))), "a bare &");
        let end = start + rest[start..].find('>').expect("a tag ends");
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "closed in order");
        } else if !tag.starts_with('!') {
            assert!(tag.matches('"').count().is_multiple_of(2), "{tag}");
            let name: String = tag.chars().take_while(|c| c.is_ascii_alphanumeric()).collect();
            for attribute in tag[name.len()..].trim_end_matches('/').split("\" ").filter(|a| !a.trim().is_empty()) {
                assert!(attribute.contains("=\""), "{attribute} in <{tag}>");
            }
            assert!(!name.is_empty(), "<{tag}>");
            if !tag.ends_with('/') {
                open.push(name.clone());
            }
            all.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?} are not closed");
    all
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

#[test]
fn reports_on_a_mesh_and_on_its_file_agree_with_its_builds() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mesh, file, out) = (dir.path().join("part.ply"), dir.path().join("part.lodpack"), dir.path().join("report"));
    save_ply(&fan_part(16), &mesh).expect("writable");
    let peers = dir.path().join("peers.csv");
    std::fs::write(
        &peers,
        "name,mesh,cpu_seconds,bytes,triangles,rms,max\nother <&>,part,1,900,300,0.01,0.05\nno,x,1,1,1,1,1\n",
    )
    .expect("writable");

    let build = lodpack().args(["build"]).arg(&mesh).arg("-o").arg(&file).arg("--json").output().expect("runs");
    let build: Value = serde_json::from_slice(&build.stdout).expect("--json prints JSON");
    let report = || {
        let mut command = lodpack();
        command.arg("report").arg(&mesh).arg("-o").arg(&out).args(["--quick", "--samples", "5000", "--json"]);
        command.arg("--peers").arg(&peers);
        command
    };
    let printed = report().output().expect("runs");
    assert!(printed.status.success(), "{}", String::from_utf8_lossy(&printed.stderr));
    let report_json: Value = serde_json::from_str(&read(&out.join("report.json"))).expect("JSON");
    assert_eq!(serde_json::from_slice::<Value>(&printed.stdout).expect("--json prints JSON"), report_json);
    // Nothing of the builds remains, and a report is not overwritten without --force.
    assert_eq!(std::fs::read_dir(&out).expect("readable").count(), 3);
    report().assert().code(2);

    let builds = report_json["builds"].as_array().expect("builds");
    let default = &builds[0];
    assert_eq!(default["name"], "default");
    for name in ["bytes", "tolerance"] {
        assert_eq!(default[name], build[name], "{name}");
    }
    assert_eq!(default["certified"], build["certified_error"]);
    let levels = build["levels"].as_array().expect("levels");
    assert_eq!(default["triangles"], levels.last().expect("a level")["triangles"]);
    for row in builds {
        let (rms, max) = (&row["measured"]["rms"], &row["measured"]["max"]);
        for way in 0..2 {
            assert!(number(&rms[way]) <= number(&max[way]));
            assert!(number(&max[way]) <= number(&row["certified"]) * (1.0 + 1e-9), "{row}");
        }
        assert!(number(&row["certified"]) <= number(&row["tolerance"]));
        assert!(number(&row["cpu_seconds"]) > 0.0 && number(&row["peak_memory_bytes"]) > 1e6);
    }
    let row = |name: &str| builds.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no row {name}"));
    assert_eq!(number(&row("tolerance x 2")["tolerance"]), number(&default["tolerance"]) * 2.0);
    assert_eq!(row("1 thread")["is_default_file"], true);
    assert!(row("tolerance x 0.5")["triangles"].as_u64() > row("tolerance x 2")["triangles"].as_u64());
    assert!(report_json["default_check"]["on_front"].is_boolean());
    assert_eq!(report_json["verification"]["problems"], 0);
    assert_eq!(report_json["peers"].as_array().map(Vec::len), Some(1));

    let html = read(&out.join("report.html"));
    let names = elements(&html);
    assert!(names.iter().filter(|name| *name == "svg").count() >= 10);
    assert!(!names.contains(&"script".into()) && !html.contains("NaN") && !html.contains("Infinity"));
    assert!(html.contains("other &lt;&amp;&gt;") && html.contains("prefers-color-scheme"));
    let table = read(&out.join("report.csv"));
    let columns = table.lines().next().expect("a head").split(',').count();
    let quick = table.lines().filter(|line| !line.contains('"'));
    assert!(quick.clone().all(|line| line.split(',').count() == columns));
    assert!(quick.filter(|line| line.starts_with("build,")).count() >= 5);

    // The same queries of the built file give the same results.
    let of_file = dir.path().join("file");
    let mut command = lodpack();
    command.arg("report").arg(&file).arg("--against").arg(&mesh).arg("-o").arg(&of_file);
    command.args(["--quick", "--samples", "5000"]).assert().code(0);
    let of_file_json: Value = serde_json::from_str(&read(&of_file.join("report.json"))).expect("JSON");
    elements(&read(&of_file.join("report.html")));
    let [one, other] = [&report_json, &of_file_json].map(|r| r["cuts"].as_array().expect("cuts"));
    assert!(one.len() == other.len() && one.len() >= 4);
    for (one, other) in one.iter().zip(other) {
        for name in ["asked", "value", "triangles", "nodes", "bytes_read", "requests", "certified", "measured"] {
            assert_eq!(one[name], other[name], "{name}");
        }
        if let Some(measured) = other["measured"].as_object() {
            assert!(number(&measured["max"][0]) <= number(&other["certified"]) * (1.0 + 1e-9));
        }
    }
    assert_eq!(of_file_json["builds"].as_array().map(Vec::len), Some(0));
}

#[test]
fn budgets_are_kept_and_more_resolutions_a_node_allow_less_error_with_few_nodes() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mesh, file, out) = (dir.path().join("scan.ply"), dir.path().join("scan.lodpack"), dir.path().join("report"));
    save_ply(&rough_sphere(80), &mesh).expect("writable");
    let built = ["--tolerance", "0.1edge", "--progress", "none", "-o"];
    lodpack().arg("build").arg(&mesh).args(built).arg(&file).assert().code(0);
    lodpack().arg("report").arg(&file).arg("-o").arg(&out).arg("--quick").assert().code(0);
    let report: Value = serde_json::from_str(&read(&out.join("report.json"))).expect("JSON");
    let rows = report["budgets"].as_array().expect("budgets");
    let mut least = BTreeMap::new();
    for row in rows {
        assert!(number(&row["nodes"]) <= number(&row["max_nodes"]), "{row}");
        if let Some(most) = row["max_triangles"].as_f64() {
            assert!(number(&row["triangles"]) <= most, "{row}");
        }
        if row["varied"] == "triangles" {
            let error = least.entry(row["resolutions"].as_u64()).or_insert(f64::INFINITY);
            *error = number(&row["pixel_error"]).min(*error);
        }
    }
    // A part of the nodes, and as many triangles as the file has.
    assert!(least[&Some(3)] < least[&Some(1)] * 0.7 && least[&Some(2)] < least[&Some(1)], "{least:?}");
}

#[test]
fn a_failed_report_leaves_nothing_and_says_why() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (bad, out) = (dir.path().join("bad.ply"), dir.path().join("report"));
    std::fs::write(&bad, "ply\nformat ascii 1.0\nelement vertex 3\n").expect("writable");
    let refused = |path: &Path, word: &str| {
        let output = lodpack().arg("report").arg(path).arg("-o").arg(&out).arg("--quick").output().expect("runs");
        assert_eq!(output.status.code(), Some(2));
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(message.contains(word), "{message}");
    };
    refused(&bad, "bad.ply");
    refused(&dir.path().join("nothing.ply"), "nothing.ply");
    refused(dir.path(), "is a directory");
    assert!(!out.exists() || std::fs::read_dir(&out).expect("readable").count() == 0);
}
