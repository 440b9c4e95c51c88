//! All levels in one GLB: `export --as glb-lod`.

use crate::commands::lodpack;
use crate::{build_file, channels, scan};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The document of a GLB.
pub(crate) fn document(path: &Path) -> Value {
    let bytes = std::fs::read(path).expect("a readable file");
    let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).expect("a document")
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

/// Exports a file; returns the summary.
fn export(file: &Path, output: &Path, options: &str) -> Value {
    let args = ["--as", "glb-lod", "--json"];
    let out =
        lodpack().arg("export").arg(file).arg("-o").arg(output).args(args).args(options.split_whitespace()).output();
    let out = out.expect("it runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).expect("a summary")
}

/// Khronos' validator finds nothing, where it is installed.
pub(crate) fn validate(path: &Path) {
    let tools = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tiles");
    if !tools.join("node_modules/gltf-validator").is_dir() {
        assert!(
            std::env::var_os("LODPACK_REQUIRE_TILES").is_none_or(|value| value != "1"),
            "npm ci --prefix tests/tiles"
        );
        eprintln!("skipped: gltf-validator is not installed");
        return;
    }
    let out = Command::new("node").arg(tools.join("glb.js")).arg(path).output().expect("node runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stdout));
}

#[test]
fn levels_are_nodes_with_certified_errors_and_the_finest_is_the_input_of_others() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let [file, output, again] = ["scan.lodpack", "scan.glb", "again.lodpack"].map(|name| folder.path().join(name));
    std::fs::write(&file, build_file(&scan(), "auto").0).expect("writable");
    let summary = export(&file, &output, "");
    let levels = summary["levels"].as_array().expect("levels");
    assert!(levels.len() >= 3);
    let of = |key: &str| -> Vec<f64> { levels.iter().filter_map(|level| level[key].as_f64()).collect() };
    let (triangles, errors, coverages) = (of("triangles"), of("certified_error"), of("screen_coverage"));
    assert!(triangles.windows(2).all(|pair| pair[0] >= 1.25 * pair[1]), "{triangles:?}");
    assert!(errors.windows(2).all(|pair| pair[0] < pair[1]) && errors[0] > 0.0, "{errors:?}");
    assert!(coverages.windows(2).all(|pair| pair[0] >= pair[1]) && coverages.last() == Some(&0.0), "{coverages:?}");

    let document = document(&output);
    let nodes = document["nodes"].as_array().expect("nodes");
    assert_eq!(document["scenes"][0]["nodes"], serde_json::json!([0]));
    assert_eq!(document["extensionsUsed"], serde_json::json!(["MSFT_lod"]));
    let others: Vec<u64> = (1..nodes.len() as u64).collect();
    assert_eq!(nodes[0]["extensions"]["MSFT_lod"]["ids"], serde_json::json!(others));
    assert_eq!(floats(&nodes[0]["extras"]["MSFT_screencoverage"]), coverages);
    for (number, node) in nodes.iter().enumerate() {
        assert_eq!(node["name"], format!("lodpack_LOD{number}"));
        assert_eq!(node["extras"]["certified_error"].as_f64(), Some(errors[number]));
        assert_eq!(node["translation"], nodes[0]["translation"]);
    }
    validate(&output);

    // Programs that do not know the extension see one mesh, which is the finest level.
    lodpack().arg("build").arg(&output).arg("-o").arg(&again).assert().success();
    let built =
        lodpack::File::open(std::fs::read(&again).expect("readable"), lodpack::Limits::default()).expect("sound");
    let source = built.source_info().expect("a new file says what it is of").triangle_count as f64;
    // Single precision makes a few triangles degenerate.
    assert!(source <= triangles[0] && source > 0.99 * triangles[0], "{source} of {triangles:?}");
}

#[test]
fn axes_units_tolerances_and_images_are_those_of_the_file() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let [file, output] = ["painted.lodpack", "painted.glb"].map(|name| folder.path().join(name));
    std::fs::write(&file, channels::painted_file()).expect("writable");
    let all = export(&file, &output, "--up z");
    let painted = document(&output);
    assert!(painted["images"].as_array().is_some_and(|images| images.len() >= 2), "each level has images of its own");
    let [x, y, z, w] = floats(&painted["nodes"][0]["rotation"])[..] else { unreachable!("four numbers") };
    // A quarter turn around x takes z up to y.
    assert!((x + 0.5_f64.sqrt()).abs() < 1e-12 && y == 0.0 && z == 0.0 && (w - 0.5_f64.sqrt()).abs() < 1e-12);
    validate(&output);
    let errors: Vec<f64> =
        all["levels"].as_array().into_iter().flatten().filter_map(|level| level["certified_error"].as_f64()).collect();
    let coarser = export(&file, &output, &format!("--force --channels none --tolerance {}", errors[1]));
    assert_eq!(coarser["levels"].as_array().map(Vec::len), Some(errors.len() - 1));
    assert!(document(&output).get("images").is_none() && document(&output)["nodes"][0].get("rotation").is_none());
    validate(&output);
}

#[test]
fn what_cannot_be_one_file_of_levels_is_said() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let file = folder.path().join("terrain.lodpack");
    std::fs::write(&file, &crate::heights::files()[0].1).expect("writable");
    let message_of = |output: &str| {
        let mut out = lodpack();
        out.current_dir(folder.path()).args(["export", "terrain.lodpack", "--as", "glb-lod", "-o", output]);
        let out = out.output().expect("it runs");
        assert_eq!(out.status.code(), Some(2));
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    assert!(message_of("levels").contains("must end in .glb"));
    assert!(message_of("levels.glb").contains("3dtiles"));
    assert!(!folder.path().join("levels.glb").exists());
}
