//! The independent decoder in format-spec agrees with the reader on every vector and on a fresh build.

use crate::{build_mesh, open};
use lodpack::{File, Limits, heights::Heights};
use lodpack_tests::generate::{fan_part, punched_sheet};
use lodpack_tests::handmade::faults;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn spec() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec")
}

fn run_decoder(path: &Path) -> Output {
    Command::new("python3").arg(spec().join("decode.py")).arg(path).output().expect("python3 is installed")
}

/// The output of `decode.py FILE`; see format-spec/vectors/README.md.
fn decode_independently(path: &Path) -> Option<String> {
    let out = run_decoder(path);
    out.status.success().then(|| String::from_utf8(out.stdout).expect("JSON is UTF-8"))
}

#[test]
fn every_vector_decodes_to_its_expected_json_in_both_decoders() {
    let mut count = 0;
    for entry in std::fs::read_dir(spec().join("vectors")).expect("vectors are there") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|e| e == "lodpack") {
            let expected = std::fs::read_to_string(path.with_extension("json")).expect("every vector has its JSON");
            let bytes = std::fs::read(&path).expect("readable");
            open(&bytes).verify().expect("vectors keep every rule");
            assert_eq!(lodpack_tests::dump::dump(&open(&bytes)).expect("sound"), expected, "{}", path.display());
            assert_eq!(decode_independently(&path).as_deref(), Some(expected.as_str()), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= 14, "only {count} vectors");
}

#[test]
fn every_invalid_file_is_refused_by_both_decoders() {
    let readme = std::fs::read_to_string(spec().join("vectors/README.md")).expect("the vectors are described");
    let mut listed: BTreeMap<String, Vec<u8>> = faults().into_iter().map(|f| (f.name.to_owned(), f.bytes)).collect();
    for entry in std::fs::read_dir(spec().join("vectors/invalid")).expect("invalid files are there") {
        let path = entry.expect("readable").path();
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let bytes = std::fs::read(&path).expect("readable");
        assert!(readme.contains(&format!("| `{name}` |")), "{name} is not listed in vectors/README.md");
        assert_eq!(listed.remove(&name), Some(bytes.clone()), "{name} differs from what its fault makes");
        // As thorough as the independent decoder, which always reads everything.
        let read = File::open(bytes.as_slice(), Limits::default()).and_then(|file| file.verify());
        assert!(read.is_err(), "{name} was accepted");
        let read = Heights::open(bytes.as_slice(), Limits::default()).and_then(|heights| heights.verify());
        assert!(read.is_err(), "{name} was accepted as heights");
        let out = run_decoder(&path);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!((out.status.code(), said.lines().count()), (Some(1), 1), "{name}: {said}");
    }
    assert!(listed.is_empty(), "these are missing: {:?}", listed.keys());
}

#[test]
fn fresh_builds_decode_alike() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    for (name, mesh) in [("part", fan_part(16)), ("sheet", punched_sheet(32))] {
        let (bytes, _) = build_mesh(&mesh, "0.2edge");
        let path = dir.path().join(name);
        std::fs::write(&path, &bytes).expect("writable");
        assert_eq!(decode_independently(&path), lodpack_tests::dump::dump(&open(&bytes)).ok());
    }
}
