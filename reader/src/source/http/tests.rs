//! Against a small server of our own that behaves well or badly.

use std::{
    io::{BufRead, BufReader, Write},
    net::{TcpListener, TcpStream},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU32, Ordering},
    },
};

use super::*;
use crate::{
    Error, File, Limits, Query,
    tests::{Options, cube, file_of},
};

/// What a server does to the answer with this number, the first one being 0.
type Behaviour = fn(u32) -> Act;

/// How one request is answered.
#[derive(Clone, Copy, PartialEq)]
enum Act {
    /// As it should be.
    Well,
    /// With the whole file.
    Whole,
    /// With half of the whole file.
    HalfOfAll,
    /// With a page that says that something is wrong.
    Page,
    /// With another ETag.
    OtherTag,
    /// With another date, and no ETag.
    OtherDate,
    /// With a file that is one byte longer.
    OtherSize,
    /// With half of the bytes that it announces.
    Half,
    /// With fewer bytes than asked for, announced as such.
    Shorter,
    /// With bytes from elsewhere.
    Shifted,
    /// Not at all: the connection is closed.
    Close,
    /// Too late.
    Stall,
    /// With pauses, each shorter than the limit, and longer than it together.
    Drip,
    /// With the address of another file on this server.
    Moved,
    /// With the address of a file on another one.
    Elsewhere,
    /// With a status.
    Status(u16),
}

struct Server {
    url: String,
    requests: Arc<Mutex<Vec<Range<u64>>>>,
}

fn serve(bytes: Vec<u8>, behaviour: Behaviour) -> Server {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/a/model.lodpack?x=1", listener.local_addr().unwrap());
    let requests = Arc::new(Mutex::new(Vec::new()));
    let (log, bytes, count) = (requests.clone(), Arc::new(bytes), Arc::new(AtomicU32::new(0)));
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let (log, bytes, count) = (log.clone(), bytes.clone(), count.clone());
            std::thread::spawn(move || answer_all(stream.unwrap(), &bytes, behaviour, &log, &count));
        }
    });
    Server { url, requests }
}

fn answer_all(
    mut stream: TcpStream,
    bytes: &[u8],
    behaviour: Behaviour,
    log: &Mutex<Vec<Range<u64>>>,
    count: &AtomicU32,
) -> Option<()> {
    let mut lines = BufReader::new(stream.try_clone().ok()?);
    loop {
        let mut range = None;
        loop {
            let mut line = String::new();
            if lines.read_line(&mut line).ok()? == 0 {
                return None;
            }
            let line = line.trim().to_ascii_lowercase();
            if let Some(asked) = line.strip_prefix("range: bytes=") {
                let (first, last) = asked.split_once('-')?;
                range = Some(first.parse::<u64>().ok()?..last.parse::<u64>().ok()? + 1);
            }
            if line.is_empty() {
                break;
            }
        }
        let range = range?;
        log.lock().unwrap().push(range.clone());
        let act = behaviour(count.fetch_add(1, Ordering::Relaxed));
        let size = bytes.len() as u64 + u64::from(act == Act::OtherSize);
        let (start, end) = (range.start, range.end.min(bytes.len() as u64));
        let tag = match act {
            Act::OtherTag => "ETag: \"two\"\r\n",
            Act::Page => "Content-Type: text/html; charset=utf-8\r\n",
            Act::OtherDate => "Last-Modified: Tue, 02 Jan 2024 00:00:00 GMT\r\n",
            _ => "ETag: \"one\"\r\nLast-Modified: Mon, 01 Jan 2024 00:00:00 GMT\r\n",
        };
        let (status, start, end) = match act {
            Act::Close => return None,
            Act::Stall => {
                std::thread::sleep(Duration::from_millis(4000));
                return None;
            }
            Act::Status(status) => (status, 0, 0),
            Act::Moved | Act::Elsewhere => (302, 0, 0),
            Act::Whole | Act::HalfOfAll | Act::Page => (200, 0, bytes.len() as u64),
            Act::Shifted => (206, start + 1, end + 1),
            Act::Shorter => (206, start, end - 1),
            _ if start >= end => (416, 0, 0),
            _ => (206, start, end),
        };
        let content_range = match status {
            206 => format!("Content-Range: bytes {start}-{}/{size}\r\n", end - 1),
            416 => format!("Content-Range: bytes */{size}\r\n"),
            302 if act == Act::Moved => "Location: ../b.lodpack\r\n".into(),
            302 => format!("Location: http://localhost:{}/b.lodpack\r\n", stream.local_addr().ok()?.port()),
            _ => String::new(),
        };
        let head = format!("HTTP/1.1 {status} X\r\n{tag}{content_range}Content-Length: {}\r\n\r\n", end - start);
        stream.write_all(head.as_bytes()).ok()?;
        let body = &bytes[start as usize..(end as usize).min(bytes.len())];
        let sent = if matches!(act, Act::Half | Act::HalfOfAll) { body.len() / 2 } else { body.len() };
        if act == Act::Drip {
            for part in body[..sent].chunks(sent.div_ceil(6)) {
                stream.write_all(part).ok()?;
                std::thread::sleep(Duration::from_millis(600));
            }
            continue;
        }
        stream.write_all(&body[..sent]).ok()?;
        if matches!(act, Act::Half | Act::HalfOfAll) {
            return None;
        }
    }
}

fn options() -> HttpOptions {
    let (timeout, pause) = (Duration::from_millis(2500), Duration::from_millis(5));
    HttpOptions { timeout, attempts: 2, pause, connections: 3, other_hosts: false }
}

fn model() -> Vec<u8> {
    file_of(&cube(12), Options { levels: 4, seed: 4, grids_of_four: 1, heights: 0 })
}

/// The error of reading 1000 bytes, then 1000 others.
fn second_read(behaviour: Behaviour) -> Option<SourceError> {
    let server = serve((0..4000_u32).map(|i| (i / 7) as u8).collect(), behaviour);
    let source = Http::new(server.url, options());
    let (bytes, size) = source.read_start(1000).unwrap();
    assert_eq!((bytes.len(), size), (1000, 4000));
    let mut buf = [0; 1000];
    let read = source.read_at(2000, &mut buf);
    assert!(read.is_err() || (0..1000).all(|i| buf[i] == ((2000 + i) / 7) as u8));
    read.err().map(|error| SourceError::of(&error).unwrap_or_else(|| panic!("{error}")).clone())
}

#[test]
fn a_file_reads_over_http_as_from_memory_and_asks_for_each_range_once() {
    let bytes = model();
    let server = serve(bytes.clone(), |_| Act::Well);
    let (here, there) = (crate::source::Recording::new(bytes), Http::new(server.url, options()));
    let here = File::open(here, Limits::default()).unwrap();
    let there = File::open(there, Limits::default()).unwrap();
    let query = Query { volume: Some([[0.0; 3], [4.0; 3]].into()), ..Query::default() };
    let cut = there.select(&query).unwrap();
    assert_eq!(cut, here.select(&query).unwrap());
    assert_eq!(there.extract(&cut).unwrap(), here.extract(&cut).unwrap());
    let (mut local, mut asked) = (here.source().take(), server.requests.lock().unwrap().clone());
    // What came with opening is not asked for again.
    let opened = local[0].end;
    local.retain(|range| range.start == 0 || range.end > opened);
    // Several at once may come in any order.
    local.sort_by_key(|range| range.start);
    asked.sort_by_key(|range| range.start);
    assert!(asked.len() >= 3, "{asked:?}");
    assert_eq!(local, asked);
}

#[test]
fn what_came_with_the_first_read_is_handed_out_once() {
    let bytes: Vec<u8> = (0..4000_u32).map(|i| (i / 7) as u8).collect();
    let server = serve(bytes.clone(), |_| Act::Well);
    let source = Http::new(server.url, options());
    source.read_start(1000).unwrap();
    for (first, requests) in [(100, 1), (500, 1), (900, 2), (500, 3)] {
        let mut buf = [0; 200];
        source.read_at(first, &mut buf).unwrap();
        assert_eq!(buf[..], bytes[first as usize..][..200]);
        assert_eq!(server.requests.lock().unwrap().len(), requests);
    }
}

#[test]
fn servers_that_lie_or_change_are_told_apart() {
    use SourceError::{Changed, RangesIgnored, Status, WrongRange};
    assert_eq!(second_read(|_| Act::Well), None);
    assert_eq!(second_read(|n| [Act::Well, Act::Whole][n as usize]), Some(RangesIgnored));
    let changed = |what: &str| Some(Changed { what: what.into() });
    assert_eq!(second_read(|n| [Act::Well, Act::OtherTag][n as usize]), changed("ETag"));
    let date = changed("date of its last modification");
    assert_eq!(second_read(|n| [Act::Well, Act::OtherDate][n as usize]), date);
    assert_eq!(second_read(|n| [Act::Well, Act::OtherSize][n as usize]), changed("size 4001 instead of 4000"));
    for act in [|n| [Act::Well, Act::Shorter][n as usize], |n| [Act::Well, Act::Shifted][n as usize]] as [Behaviour; 2]
    {
        assert!(matches!(second_read(act), Some(WrongRange { .. })));
    }
    assert_eq!(second_read(|n| [Act::Well, Act::Status(404)][n as usize]), Some(Status { status: 404 }));
}

#[test]
fn what_may_pass_is_tried_again_and_then_told() {
    use SourceError::{Closed, Short, Status, TimedOut};
    // Once is forgiven.
    for act in [
        |n| [Act::Well, Act::Half, Act::Well][n as usize],
        |n| [Act::Well, Act::Close, Act::Well][n as usize],
        |n| [Act::Well, Act::Stall, Act::Well][n as usize],
        |n| [Act::Well, Act::Status(503), Act::Well][n as usize],
        |n| [Act::Well, Act::Drip][n as usize],
    ] as [Behaviour; 5]
    {
        assert_eq!(second_read(act), None);
    }
    // Twice is not, with two attempts.
    let half = second_read(|n| if n == 0 { Act::Well } else { Act::Half });
    assert_eq!(half, Some(Short { expected: 1000, found: 750 }));
    let closed = second_read(|n| if n == 0 { Act::Well } else { Act::Close });
    assert!(matches!(closed, Some(Closed { .. })), "{closed:?}");
    assert_eq!(second_read(|n| if n == 0 { Act::Well } else { Act::Stall }), Some(TimedOut));
    assert_eq!(second_read(|n| if n == 0 { Act::Well } else { Act::Status(503) }), Some(Status { status: 503 }));
}

#[test]
fn what_has_arrived_is_kept() {
    let bytes: Vec<u8> = (0..300_000_u32).map(|i| (i.wrapping_mul(i) >> 5) as u8).collect();
    let server = serve(bytes.clone(), |_| Act::Half);
    let mut buf = vec![0; 1 << 17];
    let error = Http::new(server.url, options()).read_at(1000, &mut buf).unwrap_err();
    // Half of the rest each, until an attempt brought too little to count.
    let found = (1 << 17) - (1 << 13);
    assert_eq!(SourceError::of(&error), Some(&SourceError::Short { expected: 1 << 17, found }));
    let starts: Vec<u64> = server.requests.lock().unwrap().iter().map(|range| range.start - 1000).collect();
    assert_eq!(starts, [0, 1 << 16, 3 << 15, 7 << 14]);
    assert!(server.requests.lock().unwrap().iter().all(|range| range.end == 1000 + (1 << 17)));

    // Without a pause, since it works.
    let server = serve(bytes.clone(), |n| if n % 2 == 0 { Act::Half } else { Act::Well });
    let at_once = HttpOptions { pause: Duration::from_secs(3600), ..options() };
    Http::new(server.url, at_once).read_at(1000, &mut buf).unwrap();
    assert!(buf == bytes[1000..][..buf.len()]);
    // Not if the rest is of another file.
    let server = serve(bytes.clone(), |n| [Act::Half, Act::OtherTag][n as usize]);
    let error = Http::new(server.url, options()).read_at(1000, &mut buf).unwrap_err();
    assert_eq!(SourceError::of(&error), Some(&SourceError::Changed { what: "ETag".into() }));
    // A whole file begins at its beginning again.
    let server = serve(vec![7; 2000], |n| if n == 0 { Act::HalfOfAll } else { Act::Whole });
    assert_eq!(Http::new(server.url, options()).read_start(8192).unwrap(), (vec![7; 2000], 2000));
}

#[test]
fn other_hosts_are_asked_only_if_the_caller_wants_it() {
    let bytes: Vec<u8> = (0..4000_u32).map(|i| (i / 7) as u8).collect();
    let read = |behaviour: Behaviour, other_hosts| {
        let server = serve(bytes.clone(), behaviour);
        Http::new(server.url, HttpOptions { other_hosts, ..options() }).read_start(1000).map(|(found, _)| found)
    };
    assert_eq!(read(|n| [Act::Moved, Act::Well][n as usize], false).unwrap(), bytes[..1000]);
    let refused = read(|n| [Act::Elsewhere, Act::Well][n as usize], false).unwrap_err();
    assert!(matches!(SourceError::of(&refused), Some(SourceError::Redirected { to }) if to.ends_with("/b.lodpack")));
    assert_eq!(read(|n| [Act::Elsewhere, Act::Well][n as usize], true).unwrap(), bytes[..1000]);
    assert!(read(|_| Act::Moved, true).unwrap_err().to_string().contains("redirects more than"));
}

#[test]
fn servers_that_know_no_ranges_are_refused_unless_the_file_is_small() {
    let server = serve(vec![7; 20_000], |_| Act::Whole);
    let error = Http::new(server.url, options()).read_start(8192).unwrap_err();
    assert_eq!(SourceError::of(&error), Some(&SourceError::RangesIgnored));
    let server = serve(vec![7; 20_000], |_| Act::Page);
    let error = Http::new(server.url, options()).read_start(8192).unwrap_err();
    assert!(matches!(SourceError::of(&error), Some(SourceError::WebPage { .. })), "{error}");
    let server = serve(vec![7; 2000], |_| Act::Whole);
    assert_eq!(Http::new(server.url, options()).read_start(8192).unwrap(), (vec![7; 2000], 2000));
    let server = serve(vec![], |_| Act::Well);
    assert_eq!(Http::new(server.url, options()).read_start(8192).unwrap(), (vec![], 0));
}

#[test]
fn a_server_that_fails_leaves_the_rest_of_the_model_drawable() {
    let server = serve(model(), |n| if n == 4 { Act::Status(500) } else { Act::Well });
    let file = File::open(Http::new(server.url, HttpOptions { attempts: 1, ..options() }), Limits::default()).unwrap();
    let cut = file.select(&Query::default()).unwrap();
    let mut failures = 0;
    for _ in 0..2 {
        match file.extract(&cut) {
            Ok(mesh) => assert_eq!(mesh.triangles.len() as u64, cut.triangle_count),
            Err(Error::Io { source, .. }) => {
                assert_eq!(SourceError::of(&source), Some(&SourceError::Status { status: 500 }));
                failures += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(failures <= 1);
    let nobody = Http::new("http://127.0.0.1:1/x", HttpOptions { attempts: 1, ..options() });
    assert!(matches!(SourceError::of(&nobody.size().unwrap_err()), Some(SourceError::Closed { .. })));
}
