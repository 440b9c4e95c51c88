//! Files on the program's own web server, and what it says of other servers.

use crate::browser::{has_browser, run_node};
use crate::build_mesh;
use crate::commands::lodpack;
use lodpack_tests::generate::bumpy_sphere;
use lodpack_tests::server::serve;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The program, serving.
struct Serving {
    child: Child,
    /// The first line that it printed.
    line: String,
}

impl Serving {
    fn start(args: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodpack"));
        let mut child = command
            .args(["serve", "--port", "0"])
            .args(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut line).expect("it prints an address");
        Self { child, line: line.trim().to_owned() }
    }

    /// Host and port.
    fn host(&self) -> &str {
        let rest = self.line.strip_prefix("http://").unwrap_or_else(|| panic!("no address: {:?}", self.line));
        rest.split('/').next().expect("there is one part")
    }

    /// Sends a request with these fields: the answer's head, in lower case, and its body.
    fn ask(&self, line: &str, fields: &str) -> (String, Vec<u8>) {
        let request = format!("{line} HTTP/1.1\r\nHost: {}\r\n{fields}Connection: close\r\n\r\n", self.host());
        self.send(request.as_bytes())
    }

    fn send(&self, request: &[u8]) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(self.host()).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout can be set");
        stream.write_all(request).expect("it reads");
        let mut answer = vec![];
        stream.read_to_end(&mut answer).expect("it answers and closes");
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("a head") + 4;
        let body = answer.split_off(end);
        (String::from_utf8_lossy(&answer).to_lowercase(), body)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A file to serve, whose name has to be escaped.
struct Desk {
    dir: tempfile::TempDir,
    bytes: Vec<u8>,
}

impl Desk {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let (bytes, _) = build_mesh(&bumpy_sphere(24), "0.1edge");
        std::fs::write(dir.path().join("a b.lodpack"), &bytes).expect("writable");
        Self { dir, bytes }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn file(&self) -> String {
        text(&self.path("a b.lodpack"))
    }
}

fn text(path: &Path) -> String {
    path.to_str().expect("test paths are UTF-8").to_owned()
}

fn field<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "))
}

#[test]
fn ranges_are_the_bytes_that_are_asked_for() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file()]);
    let size = desk.bytes.len();
    let (head, body) = serving.ask("GET /a%20b.lodpack", "");
    assert!(head.starts_with("http/1.1 200 ") && body == desk.bytes, "{head}");
    let tag = field(&head, "etag").expect("an ETag").to_owned();
    for (range, expected) in [("10-19", 10..20), ("-7", size - 7..size), ("5-", 5..size), ("0-99999999", 0..size)] {
        let (head, body) = serving.ask("GET /a%20b.lodpack", &format!("Range: bytes={range}\r\nIf-Range: {tag}\r\n"));
        assert!(head.starts_with("http/1.1 206 ") && body == desk.bytes[expected.clone()], "{range}: {head}");
        let said = format!("bytes {}-{}/{size}", expected.start, expected.end - 1);
        assert_eq!(field(&head, "content-range"), Some(said.as_str()));
        assert_eq!(field(&head, "content-length"), Some(expected.len().to_string().as_str()));
        assert_eq!(field(&head, "access-control-allow-origin"), None);
    }
    let (head, body) = serving.ask("HEAD /a%20b.lodpack", "");
    assert!(head.starts_with("http/1.1 200 ") && body.is_empty(), "{head}");
    assert_eq!(field(&head, "content-length"), Some(size.to_string().as_str()));
    assert_eq!(field(&head, "accept-ranges"), Some("bytes"));
    let (head, body) = serving.ask("GET /a%20b.lodpack", &format!("Range: bytes={size}-\r\n"));
    assert!(head.starts_with("http/1.1 416 ") && body.is_empty(), "{head}");
    assert_eq!(field(&head, "content-range"), Some(format!("bytes */{size}").as_str()));
    // A part of another file is no use.
    let (head, body) = serving.ask("GET /a%20b.lodpack", "Range: bytes=0-9\r\nIf-Range: \"other\"\r\n");
    assert!(head.starts_with("http/1.1 200 ") && body == desk.bytes, "{head}");
    assert!(serving.ask("GET /a%20b.lodpack", &format!("If-None-Match: {tag}\r\n")).0.starts_with("http/1.1 304 "));
    assert!(serving.ask("GET /a%20b.lodpack", "If-Match: \"other\"\r\n").0.starts_with("http/1.1 412 "));
    // Several requests on one connection.
    let three = "GET /a%20b.lodpack HTTP/1.1\r\nRange: bytes=0-3\r\n\r\n".repeat(2);
    let (_, rest) = serving.send(format!("{three}GET /none HTTP/1.0\r\n\r\n").as_bytes());
    let rest = String::from_utf8_lossy(&rest).into_owned();
    assert_eq!((rest.matches("206 Partial").count(), rest.matches("404 Not").count()), (1, 1), "{rest}");
}

#[test]
fn a_file_that_changes_gets_another_tag() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file()]);
    let tag = || field(&serving.ask("HEAD /a%20b.lodpack", "").0, "etag").expect("an ETag").to_owned();
    let before = tag();
    assert_eq!(before, tag());
    std::fs::write(desk.path("a b.lodpack"), &desk.bytes[..desk.bytes.len() - 1]).expect("writable");
    assert_ne!(before, tag());
    std::fs::remove_file(desk.path("a b.lodpack")).expect("removable");
    assert!(serving.ask("GET /a%20b.lodpack", "").0.starts_with("http/1.1 404 "));
}

#[test]
fn nothing_but_the_files_is_served_and_nothing_but_reading_is_allowed() {
    let desk = Desk::new();
    std::fs::write(desk.path("secret"), "secret").expect("writable");
    let serving = Serving::start(&[&desk.file()]);
    for path in
        ["/secret", "/../secret", "/%2e%2e/secret", "//secret", "/a%20b.lodpack/../secret", "/etc/passwd", "*", "/%00"]
    {
        let (head, _) = serving.ask(&format!("GET {path}"), "");
        assert!(head.starts_with("http/1.1 404 ") || head.starts_with("http/1.1 400 "), "{path}: {head}");
    }
    for line in ["POST /a%20b.lodpack", "PUT /x", "DELETE /a%20b.lodpack"] {
        assert!(serving.ask(line, "").0.starts_with("http/1.1 405 "), "{line}");
    }
    let preflight = "Access-Control-Request-Headers: range\r\nAccess-Control-Request-Private-Network: true\r\n";
    let (head, _) = serving.ask("OPTIONS /a%20b.lodpack", preflight);
    assert!(head.starts_with("http/1.1 204 ") && !head.contains("access-control"), "{head}");
    // Pages of other hosts may read it only if somebody wants that.
    let serving = Serving::start(&[&desk.file(), "--cors"]);
    let (head, _) = serving.ask("OPTIONS /a%20b.lodpack", preflight);
    assert!(head.starts_with("http/1.1 204 ") && field(&head, "access-control-allow-headers").is_some(), "{head}");
    assert_eq!(field(&head, "access-control-allow-private-network"), Some("true"));
    assert_eq!(field(&serving.ask("GET /a%20b.lodpack", "").0, "access-control-allow-origin"), Some("*"));
}

#[test]
fn requests_that_make_no_sense_get_one_answer_and_no_file() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file()]);
    let file = "GET /a%20b.lodpack HTTP/1.1\r\nConnection: close\r\n\r\n";
    let long = format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "x".repeat(40_000));
    let many = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(5000));
    for request in [
        "\x16\x03\x01 is it TLS?\r\n\r\n",
        "GET\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "GET / HTTP/1.1\r\n no name\r\n\r\n",
        "GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        "GET / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
        "GET /a%20b.lodpack HTTP/1.1\r\nHost: example.org\r\nConnection: close\r\n\r\n",
        "GET http://example.org/a%20b.lodpack HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
        &long,
        &many,
    ] {
        let (head, body) = serving.send(request.as_bytes());
        let start: String = request.chars().take(60).collect();
        assert!(head.starts_with("http/1.1 4"), "{start}: {head}");
        assert!(!body.starts_with(&desk.bytes[..8]), "{start}");
    }
    // What follows is the body of the first one, no request.
    let body = format!("POST / HTTP/1.1\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{file}", file.len());
    let (head, body) = serving.send(body.as_bytes());
    assert!(head.starts_with("http/1.1 405 ") && !String::from_utf8_lossy(&body).contains("HTTP/1.1"), "{head}");
    assert_eq!(serving.send(file.as_bytes()).1, desk.bytes);
}

#[test]
fn slow_clients_do_not_lock_others_out() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file()]);
    let slow: Vec<TcpStream> = (0..300)
        .map(|number| {
            let mut stream = TcpStream::connect(serving.host()).expect("it listens");
            let start = ["", "GET / HTTP/1.1\r\nX: "][number % 2];
            stream.write_all(start.as_bytes()).expect("it reads");
            stream
        })
        .collect();
    for _ in 0..20 {
        assert_eq!(serving.ask("GET /a%20b.lodpack", "").1, desk.bytes);
    }
    // The oldest had to go.
    let mut rest = vec![];
    slow[0].set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout can be set");
    let gone = (&slow[0]).read_to_end(&mut rest);
    assert!(gone.is_err_and(|error| error.kind() == std::io::ErrorKind::ConnectionReset) || rest.is_empty());
}

#[test]
fn one_file_that_is_wrong_does_not_stop_the_others() {
    let desk = Desk::new();
    std::fs::write(desk.path("bad.lodpack"), &desk.bytes[..40]).expect("writable");
    let heights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors/heights/draped.lodpack");
    let serving = Serving::start(&[&text(&desk.path("bad.lodpack")), &desk.file(), &text(&heights)]);
    let (_, list) = serving.ask("GET /", "");
    assert_eq!(String::from_utf8_lossy(&list).matches("<li>").count(), 2);
    assert!(serving.ask("GET /bad.lodpack", "").0.starts_with("http/1.1 404 "));
    assert_eq!(serving.ask("GET /draped.lodpack", "").1, std::fs::read(&heights).expect("readable"));
    let bad = text(&desk.path("bad.lodpack"));
    let out = lodpack().args(["serve", &bad, &bad]).timeout(Duration::from_secs(30)).assert().code(2);
    assert!(String::from_utf8_lossy(&out.get_output().stderr).contains("none of the files"));
}

#[test]
fn the_program_has_a_page_of_its_own_made_of_the_sources_beside_it() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file()]);
    assert!(serving.line.ends_with("/?url=/a%20b.lodpack"), "{}", serving.line);
    for (path, kind) in
        [("index.html", "text/html"), ("viewer.js", "text/javascript"), ("lodpack/js/file.js", "text/javascript")]
    {
        let (head, _) = serving.ask(&format!("GET /{path}"), "");
        assert!(head.starts_with("http/1.1 200 ") && head.contains(kind), "{path}: {head}");
    }
    let (head, wasm) = serving.ask("GET /lodpack/lodpack.wasm", "");
    assert!(wasm.starts_with(b"\0asm") && head.contains("application/wasm"), "{head}");
    let build = Path::new(env!("CARGO_MANIFEST_DIR")).join("../reader/wasm/build");
    let out = Command::new(build).arg("--check").output().expect("bash runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
fn a_page_in_a_folder_shows_files_of_the_same_name() {
    let desk = Desk::new();
    for folder in ["page", "page/lodpack", "more"] {
        std::fs::create_dir(desk.path(folder)).expect("writable");
    }
    std::fs::write(desk.path("page/index.html"), "the page").expect("writable");
    std::fs::write(desk.path("page/lodpack/x.js"), "script").expect("writable");
    std::fs::write(desk.path("more/a b.lodpack"), &desk.bytes).expect("writable");
    let page = text(&desk.path("page"));
    let serving = Serving::start(&[&desk.file(), "--page", &page]);
    assert!(serving.line.ends_with("/?url=/a%20b.lodpack"), "{}", serving.line);
    // People are shown the file; programs get it.
    for (path, mode) in [("/", ""), ("/a%20b.lodpack", "Sec-Fetch-Mode: navigate\r\n")] {
        let (head, _) = serving.ask(&format!("GET {path}"), mode);
        assert!(
            head.starts_with("http/1.1 302 ") && field(&head, "location") == Some("/?url=/a%20b.lodpack"),
            "{head}"
        );
    }
    assert_eq!(serving.ask("GET /?url=/a%20b.lodpack", "").1, b"the page");
    let (head, body) = serving.ask("GET /lodpack/x.js", "");
    assert!(body == b"script" && head.contains("content-type: text/javascript"), "{head}");
    drop(serving);
    let serving = Serving::start(&[&desk.file(), &text(&desk.path("more/a b.lodpack")), "--page", &page]);
    assert_eq!(serving.ask("GET /a%20b-2.lodpack", "").1, desk.bytes);
    let (_, list) = serving.ask("GET /", "");
    assert_eq!(String::from_utf8_lossy(&list).matches("<li>").count(), 2);
}

#[test]
fn what_cannot_be_served_is_said_at_once() {
    let desk = Desk::new();
    std::fs::write(desk.path("mesh.ply"), "ply\nformat ascii 1.0\n").expect("writable");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("it has one").port().to_string();
    let (file, mesh, folder) = (desk.file(), text(&desk.path("mesh.ply")), text(desk.dir.path()));
    for (args, word) in [
        (vec![mesh.as_str()], "lodpack build"),
        (vec!["nowhere.lodpack"], "cannot open nowhere.lodpack"),
        (vec!["https://example.org/x.lodpack"], "only files of this machine"),
        (vec![&file, "--port", &port], "is in use"),
        (vec![&file, "--bind", "192.0.2.1"], "no address of this machine"),
        (vec![&file, "--page", &folder], "no index.html"),
        (vec!["--check", "scan.lodpack"], "needs the address"),
        (vec!["--check", "http://127.0.0.1:1/x"], "cannot reach"),
        (vec![], "required"),
    ] {
        let out = lodpack().arg("serve").args(&args).timeout(Duration::from_secs(30)).assert().code(2);
        let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
        assert!(said.contains(word), "{args:?}: {said}");
    }
}

/// What `--check` says about a server: exit status, and the text of each verdict.
fn check(url: &str) -> (Option<i32>, Vec<(String, String, String)>) {
    let out = lodpack().args(["serve", "--json", "--check", url]).output().expect("it runs");
    let said: Vec<Value> = serde_json::from_slice(&out.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&out.stderr)));
    let text = |finding: &Value, key: &str| finding[key].as_str().expect("a text").to_owned();
    let findings = said.iter().map(|f| (text(f, "about"), text(f, "verdict"), text(f, "text")));
    (out.status.code(), findings.collect())
}

#[test]
fn its_own_check_finds_nothing_wrong() {
    let desk = Desk::new();
    let serving = Serving::start(&[&desk.file(), "--cors"]);
    let (code, findings) = check(&format!("http://{}/a%20b.lodpack", serving.host()));
    assert_eq!((code, findings.len()), (Some(0), 5), "{findings:?}");
    assert!(findings.iter().all(|(_, verdict, _)| verdict == "ok"), "{findings:?}");
}

/// A server that answers every request in the same way.
fn answer(head: &'static str, body: &'static [u8]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let url = format!("http://{}", listener.local_addr().expect("it has one"));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let lines = BufReader::new(&stream).lines().map_while(Result::ok);
            let _asked: Vec<_> = lines.take_while(|line| !line.is_empty()).collect();
            let head = format!("HTTP/1.1 {head}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", body.len());
            let _ = (&stream).write_all(&[head.as_bytes(), body].concat());
        }
    });
    url
}

#[test]
fn what_other_servers_do_wrong_is_told_in_a_sentence_each() {
    let bytes = Desk::new().bytes;
    let file = b"\x8fLOD\r\n\x1a\n and so on";
    for (url, about, word) in [
        // Ranges, and nothing for pages.
        (serve(bytes).expect("a free port"), "cors", "pages on other hosts cannot read"),
        (answer("200 OK", file), "ranges", "ignores ranges"),
        (answer("206 Partial Content\r\nContent-Range: bytes 5-9/900", file), "ranges", "other bytes"),
        (answer("200 OK\r\nContent-Encoding: gzip", b"x"), "compression", "turn compression off"),
        (answer("200 OK\r\nAccess-Control-Allow-Origin: *", file), "cors", "cannot see the file's size"),
        (
            answer("200 OK\r\nAccess-Control-Allow-Origin: https://only.example", file),
            "cors",
            "pages on other hosts cannot",
        ),
        (answer("200 OK", file), "identity", "send an ETag"),
        (answer("200 OK\r\nETag: \"1\"", b"no lodpack"), "file", "not a lodpack file"),
        (answer("404 Not Found", b""), "answer", "check the address"),
        (answer("200 OK\r\nContent-Type: text/html", b"<html>Please log in</html>"), "answer", "web page"),
    ] {
        let (code, findings) = check(&format!("{url}/x.lodpack"));
        let found = findings.iter().find(|(found, verdict, _)| found == about && verdict == "problem");
        assert!(code == Some(1) && found.is_some_and(|(_, _, text)| text.contains(word)), "{word}: {findings:?}");
        assert!(findings.iter().all(|(_, _, text)| !text.contains('\n')), "{findings:?}");
    }
}

#[test]
fn a_file_that_changes_between_requests_is_noticed() {
    // Every answer has a tag of its own.
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let url = format!("http://{}/x.lodpack", listener.local_addr().expect("it has one"));
    std::thread::spawn(move || {
        for (number, stream) in listener.incoming().flatten().enumerate() {
            let lines = BufReader::new(&stream).lines().map_while(Result::ok);
            let _head: Vec<_> = lines.take_while(|line| !line.is_empty()).collect();
            let head =
                format!("HTTP/1.1 200 OK\r\nETag: \"{number}\"\r\nContent-Length: 1\r\nConnection: close\r\n\r\nx");
            let _ = (&stream).write_all(head.as_bytes());
        }
    });
    let (code, findings) = check(&url);
    let found = findings.iter().find(|(about, _, _)| about == "identity").expect("it says something");
    assert!(code == Some(1) && found.2.contains("ETag does"), "{findings:?}");
}

#[test]
fn the_page_shows_a_served_file_in_chromium() {
    if has_browser() {
        let desk = Desk::new();
        let serving = Serving::start(&[&desk.file(), "--cors"]);
        run_node(&["test/served.test.js"], &[("LODPACK_SERVED", serving.host())]);
    }
}
