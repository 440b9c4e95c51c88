//! The reader as WebAssembly says what the native reader says: runs the tests of `reader/wasm` in Node, and those of
//! the viewer page in Chromium, with the native reader's answers to compare.
//!
//! Needs Node, what `reader/wasm/build` makes, and for the page also what `npm ci` installs and Chromium. Where these
//! are not there the tests say so and pass, unless `LODPACK_REQUIRE_BROWSER=1` is set. `LODPACK_REFERENCE_FILES` names
//! more files to compare, separated by colons.

use crate::{build_file, scan};
use lodpack::heights::{Heights, HeightsQuery};
use lodpack::{Cut, Error, File, Limits, Mesh, Node, Opened, Result};
use lodpack_tests::corpus::{corpus, vectors, write_corpus};
use lodpack_tests::nginx::{Answer, Nginx};
use lodpack_tests::server::serve;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The package lodpack for npm.
fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reader/wasm")
}

/// The limits of `js/core.js`.
fn limits() -> Limits {
    Limits { part_bytes: 1 << 28, ..Limits::default() }
}

/// As `js/errors.js` names kinds, and the message.
fn describe(error: &Error) -> String {
    let kind = match error {
        Error::Format { .. } => "format",
        Error::Unsupported { .. } => "unsupported",
        Error::Query { .. } => "query",
        Error::Limit { .. } => "limit",
        _ => "internal",
    };
    format!("{kind}: {error}")
}

/// What a mesh consists of, as JavaScript has it.
fn bytes_of(mesh: &Mesh) -> Vec<u8> {
    let positions = mesh.positions.iter().flatten().flat_map(|x| x.to_le_bytes());
    positions.chain(mesh.triangles.iter().flatten().flat_map(|vertex| vertex.to_le_bytes())).collect()
}

/// Writes the answers about a file: whether it opens, its overview, and every level.
fn write_answers(bytes: &[u8], folder: &Path, name: &str) -> std::io::Result<()> {
    fs::write(folder.join(format!("{name}.lodpack")), bytes)?;
    let write = |part: &str, answer: Result<Vec<u8>>| match answer {
        Ok(bytes) => fs::write(folder.join(format!("{name}.{part}.bin")), bytes),
        Err(error) => fs::write(folder.join(format!("{name}.{part}.error")), describe(&error)),
    };
    let file = match File::open(bytes, limits()) {
        Ok(file) => file,
        // JavaScript opens files of either kind. `write_heights` is for heights that are sound so far.
        Err(Error::Query { .. }) => match Opened::open(bytes, limits()) {
            Ok(_) => return fs::remove_file(folder.join(format!("{name}.lodpack"))),
            Err(error) => return write("open", Err(error)),
        },
        Err(error) => return write("open", Err(error)),
    };
    let overview = file.overview().map(|overview| overview.map(|overview| bytes_of(&overview.mesh(&file.lattice()))));
    if let Some(overview) = overview.transpose() {
        write("overview", overview)?;
    }
    for level in 0..file.level_count() as u8 {
        let mesh = file.uniform_cut(level).and_then(|cut| file.extract(&cut));
        write(&format!("level{level}"), mesh.map(|mesh| bytes_of(&mesh)))?;
    }
    // Mixed levels, so that borders are stitched.
    let mixed = file.uniform_cut(file.level_count() as u8 - 1).and_then(|cut| {
        let coarser = |node: &Node| Node {
            level: if node.root.is_multiple_of(3) { node.level.saturating_sub(1) } else { node.level },
            ..*node
        };
        file.extract(&Cut { nodes: cut.nodes.iter().map(coarser).collect(), ..cut })
    });
    write("mixed", mixed.map(|mesh| bytes_of(&mesh)))
}

/// Writes a file of heights, and its meshes at the tolerances of `heights.test.js`.
fn write_heights(bytes: &[u8], folder: &Path, name: &str) -> std::io::Result<()> {
    fs::write(folder.join(format!("{name}.lodpack")), bytes)?;
    let heights = Heights::open(bytes, limits()).expect("it was just built");
    for tolerance in [100.0, 10.0] {
        let query = HeightsQuery { tolerance: Some(tolerance), ..HeightsQuery::default() };
        let mesh = heights.cut(&query).and_then(|cut| heights.mesh(&cut)).expect("it is sound");
        let mesh = Mesh { positions: mesh.positions, triangles: mesh.triangles, ..Mesh::default() };
        fs::write(folder.join(format!("{name}.{tolerance}.bin")), bytes_of(&mesh))?;
    }
    Ok(())
}

/// Valid and invalid vectors, a scan, and more files if the environment names some.
fn write_reference(folder: &Path) {
    let vectors = package().join("../../format-spec/vectors");
    let mut count = 0;
    for (kind, folder_of) in [("valid", vectors.clone()), ("invalid", vectors.join("invalid"))] {
        for entry in fs::read_dir(folder_of).expect("the vectors are there") {
            let path = entry.expect("a readable folder").path();
            if path.extension().is_some_and(|ending| ending == "lodpack") {
                let stem = path.file_stem().expect("a name").to_string_lossy();
                let bytes = fs::read(&path).expect("a readable vector");
                write_answers(&bytes, folder, &format!("{kind}-{stem}")).expect("a writable folder");
                count += 1;
            }
        }
    }
    assert!(count > 100, "only {count} vectors");
    // Larger than the first request, as all files but the smallest are.
    write_answers(&build_file(&scan(), "0.1edge").0, folder, "valid-scan").expect("a writable folder");
    write_answers(&crate::channels::painted_file(), folder, "valid-painted").expect("a writable folder");
    write_answers(&crate::channels::lit_file(), folder, "valid-lit").expect("a writable folder");
    write_answers(&crate::drawings::drawn_file(), folder, "valid-drawn").expect("a writable folder");
    write_answers(&crate::ground::turned_town(), folder, "valid-town").expect("a writable folder");
    for (name, bytes) in crate::heights::files() {
        write_heights(&bytes, folder, name).expect("a writable folder");
    }
    for (number, path) in std::env::var("LODPACK_REFERENCE_FILES").unwrap_or_default().split(':').enumerate() {
        if !path.is_empty() {
            let bytes = fs::read(path).expect("LODPACK_REFERENCE_FILES names files that can be read");
            write_answers(&bytes, folder, &format!("valid-more{number}")).expect("a writable folder");
        }
    }
}

/// Whether a test can run; fails if it has to.
fn has(what: &str, is_there: bool) -> bool {
    if !is_there {
        assert!(std::env::var_os("LODPACK_REQUIRE_BROWSER").is_none_or(|value| value != "1"), "this test needs {what}");
        eprintln!("skipped: this test needs {what}");
    }
    is_there
}

fn runs(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|out| out.status.success())
}

/// Runs a test with the address of a scan on nginx, of which only ranges may be asked, and with the path of the scan.
/// Where nginx is not installed, another server takes its place unless `LODPACK_REQUIRE_NGINX` is set.
pub fn with_served_scan(test: impl FnOnce(&str, &Path)) {
    let (folder, work) = [(); 2].map(|()| tempfile::tempdir().expect("a temporary directory")).into();
    let path = folder.path().join("scan.lodpack");
    // As the program and both packages build it.
    fs::write(&path, build_file(&scan(), "auto").0).expect("a writable folder");
    let Some(nginx) = Nginx::start(folder.path(), work.path()) else {
        assert!(std::env::var_os("LODPACK_REQUIRE_NGINX").is_none(), "nginx is not installed");
        let url = serve(fs::read(&path).expect("a readable file")).expect("a free port");
        return test(&format!("{url}/scan.lodpack"), &path);
    };
    test(&format!("{}/scan.lodpack", nginx.url), &path);
    let answers = nginx.answers();
    assert!(answers.iter().any(|answer| answer.status == 206), "{answers:?}");
    let is_range = |answer: &Answer| answer.status == 206 && answer.path == "/scan.lodpack";
    assert!(answers.iter().all(is_range), "{answers:?}");
}

/// Runs tests of `reader/wasm` with these variables.
pub fn run_node(tests: &[&str], variables: &[(&str, &str)]) {
    let mut command = Command::new("node");
    command.arg("--test").args(tests).current_dir(package()).envs(variables.iter().copied());
    let out = command.output().expect("node runs");
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success(), "{said}\n{}", String::from_utf8_lossy(&out.stderr));
    assert!(said.contains("# fail 0") || said.contains("ℹ fail 0"), "{said}");
    assert!(said.contains("# skipped 0") || said.contains("ℹ skipped 0"), "something was skipped: {said}");
}

/// Answers for [`write_reference`]'s files, as the tests in JavaScript find them.
fn with_reference(tests: &[&str]) {
    let folder = tempfile::tempdir().expect("a temporary directory");
    write_reference(folder.path());
    run_node(tests, &[("LODPACK_REFERENCE", folder.path().to_str().expect("test paths are UTF-8"))]);
}

/// Whether pages can be tried.
pub fn has_browser() -> bool {
    let modules = package().join("node_modules/playwright-core").is_dir();
    has_wasm() && has("what `npm ci` in reader/wasm installs", modules) && has("Chromium", runs("chromium"))
}

fn has_wasm() -> bool {
    has("Node 20 or later", runs("node"))
        && ["lodpack.wasm", "lodpack-geometry.wasm"]
            .iter()
            .all(|name| has("what reader/wasm/build makes", package().join(name).is_file()))
}

#[test]
fn webassembly_reads_every_vector_as_the_native_reader_does() {
    if has_wasm() {
        with_reference(&[
            "test/reference.test.js",
            "test/source.test.js",
            "test/file.test.js",
            "test/channels.test.js",
            "test/heights.test.js",
            "test/ground.test.js",
            "test/light.test.js",
        ]);
    }
}

#[test]
fn the_viewer_page_and_three_js_draw_in_chromium() {
    if has_browser() {
        with_reference(&["test/page.test.js", "test/three.test.js"]);
    }
}

#[test]
fn the_package_installs_into_an_empty_folder_and_reads_from_nginx() {
    if has_browser() {
        with_served_scan(|url, _| run_node(&["test/package.test.js"], &[("LODPACK_SCAN_URL", url)]));
    }
}

#[test]
fn hostile_files_stop_neither_webassembly_nor_the_worker_of_a_page() {
    if has_browser() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        // More, for a longer run.
        let count = std::env::var("LODPACK_CHANGES").map_or(48, |count| count.parse().expect("a number"));
        write_corpus(folder.path(), &corpus(&vectors(), count)).expect("a writable folder");
        run_node(
            &["test/hostile.test.js"],
            &[("LODPACK_CORPUS", folder.path().to_str().expect("test paths are UTF-8"))],
        );
    }
}
