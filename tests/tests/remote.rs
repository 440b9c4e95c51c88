//! The program reads files from web servers and reports what it requested.

use crate::build_mesh;
use crate::commands::lodpack;
use lodpack_tests::generate::bumpy_sphere;
use lodpack_tests::server::{serve, serve_answer, serve_counted};
use serde_json::Value;
use std::sync::atomic::Ordering;
use std::time::Duration;

#[test]
fn a_file_on_a_web_server_is_shown_and_extracted_like_one_on_disk() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (bytes, _) = build_mesh(&bumpy_sphere(24), "0.1edge");
    let local = dir.path().join("model.lodpack");
    std::fs::write(&local, &bytes).expect("writable");
    let url = format!("{}/some/model.lodpack", serve(bytes.clone()).expect("a free port"));

    let info = |file: &str| -> Value {
        let out = lodpack().args(["info", "--json", file]).assert().success();
        serde_json::from_slice(&out.get_output().stdout).expect("JSON")
    };
    let (here, there) = (info(local.to_str().expect("UTF-8")), info(&url));
    assert_eq!(here, there);
    assert!(there["requests"].as_u64().is_some_and(|requests| (1..=3).contains(&requests)), "{there}");
    assert!(there["bytes_read"].as_u64().is_some_and(|read| read <= bytes.len() as u64));

    for (name, file) in [("here.ply", local.to_str().expect("UTF-8")), ("there.ply", &url)] {
        let output = dir.path().join(name);
        let out = lodpack().args(["extract", file, "--json", "-o"]).arg(&output).assert().success();
        let summary: Value = serde_json::from_slice(&out.get_output().stdout).expect("JSON");
        assert!(summary["requests"].as_u64().is_some_and(|requests| requests >= 1));
    }
    let read = |name: &str| std::fs::read(dir.path().join(name)).expect("written");
    assert_eq!(read("here.ply"), read("there.ply"));
}

#[test]
fn verify_asks_for_each_byte_of_an_address_once() {
    let (bytes, _) = build_mesh(&bumpy_sphere(150), "0.05edge");
    assert!(bytes.len() > 70_000, "more than the first request: {}", bytes.len());
    let (url, sent) = serve_counted(bytes.clone()).expect("a free port");
    lodpack().args(["verify", &format!("{url}/model.lodpack")]).assert().success();
    assert_eq!(sent.load(Ordering::Relaxed), bytes.len() as u64);
}

#[test]
fn addresses_that_lead_nowhere_give_one_clear_error() {
    for (address, word) in [
        ("http://127.0.0.1:1/model.lodpack", "cannot connect"),
        ("ftp://example.org/model.lodpack", "ftp"),
        #[cfg(not(feature = "object-store"))]
        ("s3://bucket/model.lodpack", "object-store"),
    ] {
        let out = lodpack().args(["info", address]).assert().code(2);
        let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
        assert!(said.contains(word), "{said}");
        assert!(word != "cannot connect" || said.matches("refused").count() == 1, "told twice: {said}");
    }
}

#[test]
fn a_server_that_sends_something_other_than_a_file_is_explained() {
    const PAGE: &str = "<!DOCTYPE html><html><body>Please log in</body></html>";
    for (status, word) in [
        ("200 OK", "is a web page"),
        ("401 Unauthorized", "requires a login"),
        ("403 Forbidden", "signed address"),
        ("404 Not Found", "check the address"),
    ] {
        let url = format!("{}/model.lodpack", serve_answer(status, PAGE, Duration::ZERO).expect("a free port"));
        let out = lodpack().args(["info", &url]).assert().code(2);
        let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
        assert!(said.contains(word) && said.contains(&url), "{said}");
    }
}

#[test]
fn a_slow_server_is_named_while_waiting() {
    let url = serve_answer("404 Not Found", "", Duration::from_secs(5)).expect("a free port");
    // Schemes are case-insensitive.
    let out = lodpack().args(["info", &url.replace("http", "HTTP")]).assert().code(2);
    let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
    assert!(said.contains(&format!("note: {url}: no answer for ")) && said.contains("404"), "{said}");
}
