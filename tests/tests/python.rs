//! The package for Python, as people get it: a wheel in an empty folder, that reads from nginx.

use crate::browser::with_served_scan;
use std::path::Path;
use std::process::Command;

fn package() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reader/python")
}

#[test]
fn the_wheel_passes_its_tests_and_the_examples_of_its_documents() {
    // It installs what it needs from PyPI, which nobody expects of a test.
    if std::env::var_os("LODPACK_REQUIRE_PYTHON").is_none() {
        println!("skipped: the package for Python (LODPACK_REQUIRE_PYTHON=1 tests it, in target/python)");
        return;
    }
    with_served_scan(|url, path| {
        let out =
            Command::new(package().join("run")).arg(path).env("LODPACK_SCAN_URL", url).output().expect("bash runs");
        let said = String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned();
        assert!(out.status.success(), "{said}");
        println!("{said}");
    });
}
