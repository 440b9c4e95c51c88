//! Generated meshes, from easy to impossible, end in sound files or clear errors; a table lists the result of each.

use crate::commands::lodpack;
use serde_json::Value;

fn run(args: &[&str]) -> (Option<i32>, Value) {
    let out = lodpack().arg("selftest").args(args).output().expect("runs");
    let value = serde_json::from_slice(&out.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&out.stderr)));
    (out.status.code(), value)
}

#[test]
fn the_quick_suite_is_good_and_its_table_complete() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let csv = dir.path().join("table.csv");
    let (code, value) = run(&["--quick", "--json", "--csv", csv.to_str().expect("test paths are UTF-8")]);
    let rows = value["rows"].as_array().expect("rows");
    for row in rows {
        assert_eq!(row["problems"].as_array().map(Vec::len), Some(0), "{row}");
        // A refusal gives a reason. A file has been measured, with no distance above the certified error.
        let file = &row["file"];
        match row["outcome"].as_str() {
            Some("refused") => assert!(row["message"].as_str().is_some_and(|text| text.len() > 20), "{row}"),
            outcome => assert_eq!((outcome, file["cuts"].as_u64()), (Some("file"), Some(20)), "{row}"),
        }
        assert!(file["least_ratio"].as_f64().is_none_or(|ratio| ratio >= 1.0 - 1e-9), "{row}");
    }
    assert_eq!(code, Some(0));
    assert!(rows.len() > 50 && rows.len() as u64 == value["totals"]["rows"].as_u64().expect("a count"));
    let table = std::fs::read_to_string(csv).expect("written");
    assert_eq!(table.lines().count(), rows.len() + 1);
    // The process leaves nothing behind.
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1);
}

#[test]
fn a_row_that_uses_too_much_memory_is_ended_and_named() {
    let (code, value) = run(&["--quick", "--case", "aspect", "--case", "few", "--memory", "1KiB", "--json"]);
    assert_eq!(code, Some(1));
    for row in value["rows"].as_array().expect("rows") {
        assert_eq!(row["outcome"], "memory", "{row}");
    }
    lodpack().args(["selftest", "--case", "no-such-case"]).assert().code(2);
}
