//! The program answers the table of queries (`tests/data/queries.txt`) as every language does.
//! `reader/src/tests/queries.rs` says what its lines mean.

use crate::commands::lodpack;
use serde_json::Value;
use std::path::Path;

/// Positions and triangles of a binary PLY as `extract` writes it, and their hash as in the table.
fn counts_and_hash(ply: &[u8]) -> (usize, usize, u64) {
    let end = ply.windows(11).position(|bytes| bytes == b"end_header\n").expect("a header") + 11;
    let header = String::from_utf8_lossy(&ply[..end]).into_owned();
    let count = |name: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
        line.and_then(|count| count.parse().ok()).expect("a count")
    };
    let (vertices, faces) = (count("vertex"), count("face"));
    let mut bytes = ply[end..].to_vec();
    let triangles = bytes.split_off(24 * vertices);
    // Each begins with its number of corners.
    bytes.extend(triangles.chunks(13).flat_map(|face| &face[1..]));
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    (faces, vertices, bytes.iter().fold(0xcbf2_9ce4_8422_2325, step))
}

#[test]
fn queries_are_answered_as_in_every_other_language() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let table = std::fs::read_to_string(root.join("tests/data/queries.txt")).expect("the table is there");
    let folder = tempfile::tempdir().expect("a temporary directory");
    let output = folder.path().join("mesh.ply");
    let mut answered = 0;
    for line in table.lines() {
        let (asked, expected) = line.split_once(" = ").expect("a question and an answer");
        let mut words = asked.split(' ');
        let name = words.next().expect("a file");
        let is_of_heights = name.starts_with("heights/");
        // The program has no budget of bytes, keeps no cuts, takes channels by no name, refuses tolerances that are no
        // numbers as it reads its arguments, and counts all triangles of heights where the readers leave out those of
        // stitches.
        if asked.contains("bytes=")
            || asked.contains("tolerance=inf")
            || asked.contains("drawn-by=")
            || asked.contains("channel=")
            || is_of_heights && asked.contains("triangles=")
        {
            continue;
        }
        let file = root.join(format!("format-spec/vectors/{name}.lodpack")).display().to_string();
        let mut arguments =
            ["extract", &file, "-o", &output.display().to_string(), "--force", "--json"].map(String::from).to_vec();
        arguments.extend(["--channels", "none"].map(String::from));
        for word in words {
            let (name, value) = word.split_once('=').unwrap_or((word, ""));
            match name {
                "box" => arguments.push(format!("--bbox={value}")),
                "context" => arguments.push("--context".into()),
                "triangles" => arguments.extend([format!("--triangles={value}"), "--raw".into()]),
                _ => arguments.push(format!("--{name}={value}")),
            }
        }
        let out = lodpack().args(&arguments).output().expect("the program runs");
        let wanted: Vec<&str> = expected.split(' ').collect();
        let [nodes, triangles, vertices, error, everywhere, limiter, hash] = wanted[..] else {
            assert_eq!(out.status.code(), Some(2), "{asked}");
            continue;
        };
        if nodes == "0" {
            // Nothing is no file.
            assert_eq!(out.status.code(), Some(2), "{asked}");
            continue;
        }
        let said = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{asked}: {said}");
        let summary: Value = serde_json::from_slice(&out.stdout).expect("JSON");
        let number = |text: &str| text.parse::<f64>().expect("a number");
        let in_box = summary["certified_error_in_box"].as_f64().or(summary["certified_error"].as_f64());
        assert_eq!(summary["nodes"].as_f64(), Some(number(nodes)), "{asked}");
        assert_eq!(in_box, Some(number(error)), "{asked}");
        assert_eq!(summary["certified_error"].as_f64(), Some(number(everywhere)), "{asked}");
        assert_eq!(summary["limited_by"], limiter, "{asked}");
        if is_of_heights {
            // They are written with normals.
            assert_eq!(summary["triangles"].as_f64(), Some(number(triangles)), "{asked}");
        } else {
            let (faces, points, found) = counts_and_hash(&std::fs::read(&output).expect("it was written"));
            assert_eq!((faces.to_string(), points.to_string()), (triangles.into(), vertices.into()), "{asked}");
            assert_eq!(format!("{found:016x}"), hash, "{asked}");
        }
        answered += 1;
    }
    assert!(answered >= 25, "{answered}");
}
