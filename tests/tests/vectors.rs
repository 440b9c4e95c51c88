//! The independent decoder of format-spec agrees with the reader, on every vector and on a fresh build.

use crate::{build_mesh, open};
use lodpack::{File, Limits, Query};
use lodpack_tests::generate::{fan_part, punched_sheet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn spec() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec")
}

/// What `decode.py FILE` prints: see format-spec/vectors/README.md.
fn decode_independently(path: &Path) -> Option<String> {
    let out = Command::new("python3").arg(spec().join("decode.py")).arg(path).output().expect("python3 is installed");
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
            assert_eq!(lodpack_tests::dump::dump(&open(&bytes)).expect("sound"), expected, "{}", path.display());
            assert_eq!(decode_independently(&path).as_deref(), Some(expected.as_str()), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= 4, "only {count} vectors");
}

#[test]
fn every_invalid_file_is_refused_by_both_decoders() {
    let mut count = 0;
    for entry in std::fs::read_dir(spec().join("vectors/invalid")).expect("invalid files are there") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|e| e == "lodpack") {
            let bytes = std::fs::read(&path).expect("readable");
            let read = File::open(bytes.as_slice(), Limits::default()).and_then(|file| {
                file.verify_checksums()?;
                file.extract(&file.select(&Query::default())?)
            });
            assert!(read.is_err(), "{} was accepted", path.display());
            assert_eq!(decode_independently(&path), None, "{} was accepted by decode.py", path.display());
            count += 1;
        }
    }
    assert!(count >= 8, "only {count} invalid files");
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
