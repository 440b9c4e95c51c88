//! Answers: what the server sends for a request.

use super::range::{Part, part};
use super::request::Request;
use super::shelf::{Item, Shelf};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;

/// Fields of every answer. Pages on any host may read the file, and see the fields that they need.
const ALWAYS: &str = "Access-Control-Allow-Origin: *\r\n\
                      Access-Control-Expose-Headers: Accept-Ranges, Content-Length, Content-Range, ETag\r\n\
                      Cross-Origin-Resource-Policy: cross-origin\r\n\
                      X-Content-Type-Options: nosniff\r\n";

/// An answer that is ready to be sent.
pub struct Answer {
    status: &'static str,
    fields: String,
    body: Body,
    /// HEAD: the fields alone.
    without_body: bool,
}

enum Body {
    None,
    Bytes(Vec<u8>),
    File(File, Range<u64>),
}

impl Body {
    fn length(&self) -> u64 {
        match self {
            Self::None => 0,
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::File(_, range) => range.end - range.start,
        }
    }
}

impl Answer {
    fn new(status: &'static str) -> Self {
        Self { status, fields: String::new(), body: Body::None, without_body: false }
    }

    /// A sentence for people, instead of what they asked for.
    fn text(status: &'static str, text: &str) -> Self {
        Self::new(status)
            .field("Content-Type", "text/plain; charset=utf-8")
            .body(Body::Bytes(format!("{text}\n").into()))
    }

    fn moved(address: &str) -> Self {
        Self::new("302 Found").field("Location", address).field("Cache-Control", "no-store")
    }

    fn field(mut self, name: &str, value: &str) -> Self {
        self.fields += &format!("{name}: {value}\r\n");
        self
    }

    fn body(mut self, body: Body) -> Self {
        self.body = body;
        self
    }

    /// Sends it. An error means that the connection cannot be used any more.
    pub fn send(self, mut stream: impl Write, is_last: bool) -> io::Result<()> {
        let Self { status, fields, body, without_body } = self;
        let connection = if is_last { "Connection: close\r\n" } else { "" };
        let length =
            if status.starts_with("304") { String::new() } else { format!("Content-Length: {}\r\n", body.length()) };
        write!(stream, "HTTP/1.1 {status}\r\n{length}{fields}{ALWAYS}{connection}\r\n")?;
        match body {
            _ if without_body => {}
            Body::None => {}
            Body::Bytes(bytes) => stream.write_all(&bytes)?,
            Body::File(mut file, range) => {
                file.seek(SeekFrom::Start(range.start))?;
                let length = range.end - range.start;
                if io::copy(&mut file.take(length), &mut stream)? < length {
                    // The file has become shorter: the client has to notice.
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
        stream.flush()
    }
}

/// The answer to a request; none was understood if there is no request.
pub fn answer(request: Option<&Request>, shelf: &Shelf) -> io::Result<Answer> {
    let Some(request) = request else {
        return Ok(Answer::text(
            "400 Bad Request",
            "This is no request that can be answered: only GET, HEAD and OPTIONS, without a body.",
        ));
    };
    match request.method.as_str() {
        "GET" => Ok(found(request, shelf)),
        "HEAD" => Ok(Answer { without_body: true, ..found(request, shelf) }),
        "OPTIONS" => Ok(allowed(request)),
        _ => Ok(Answer::text("405 Method Not Allowed", "Files can only be read here: GET, HEAD and OPTIONS.")
            .field("Allow", "GET, HEAD, OPTIONS")),
    }
}

/// What a page of another host may ask for.
fn allowed(request: &Request) -> Answer {
    let answer = Answer::new("204 No Content")
        .field("Allow", "GET, HEAD, OPTIONS")
        .field("Access-Control-Allow-Methods", "GET, HEAD, OPTIONS")
        .field("Access-Control-Allow-Headers", "Range, If-Match, If-None-Match, If-Range")
        .field("Access-Control-Max-Age", "86400");
    if request.asks_private_network { answer.field("Access-Control-Allow-Private-Network", "true") } else { answer }
}

fn found(request: &Request, shelf: &Shelf) -> Answer {
    if request.is_navigation
        && let Some(address) = shelf.shown_at.get(&request.path)
    {
        return Answer::moved(address);
    }
    let path = match request.path.as_str() {
        "/" if request.query.is_empty() => match &shelf.front {
            Some(html) => {
                let html = html.clone().into_bytes();
                return Answer::new("200 OK").field("Content-Type", "text/html; charset=utf-8").body(Body::Bytes(html));
            }
            None => match shelf.shown_at.values().next() {
                Some(address) => return Answer::moved(address),
                None => "/index.html",
            },
        },
        "/" => "/index.html",
        path => path,
    };
    match shelf.item(path) {
        None => Answer::text("404 Not Found", "There is no such file here; / lists what there is."),
        Some(Item::Bytes(bytes)) => {
            let tag = format!("\"{:016x}\"", xxhash_rust::xxh3::xxh3_64(bytes));
            let slice = |range: Range<u64>| Body::Bytes(bytes[range.start as usize..range.end as usize].to_vec());
            part_of(request, path, bytes.len() as u64, &tag, slice)
        }
        Some(Item::File(file)) => match shelf.open(file) {
            Ok((open, size, tag)) => part_of(request, path, size, &tag, |range| Body::File(open, range)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Answer::text("404 Not Found", "This file was here, and is gone now.")
            }
            Err(error) => Answer::text("500 Internal Server Error", &format!("The file cannot be read: {error}.")),
        },
    }
}

/// The part of something that a request asks for.
fn part_of(request: &Request, path: &str, size: u64, tag: &str, body: impl FnOnce(Range<u64>) -> Body) -> Answer {
    // Browsers may keep it, and ask whether it is still the same.
    let answer = |status| {
        Answer::new(status).field("ETag", tag).field("Accept-Ranges", "bytes").field("Cache-Control", "no-cache")
    };
    let names_tag = |tags: &String| tags.split(',').any(|other| other.trim() == tag || other.trim() == "*");
    if request.if_match.as_ref().is_some_and(|tags| !names_tag(tags)) {
        return answer("412 Precondition Failed");
    }
    if request.if_none_match.as_ref().is_some_and(names_tag) {
        return answer("304 Not Modified");
    }
    // The client has a part of another file: it needs all of this one.
    let is_other = request.if_range.as_ref().is_some_and(|other| other != tag);
    let kind = content_type(path);
    match part(request.range.as_deref().filter(|_| !is_other), size) {
        Part::Whole => answer("200 OK").field("Content-Type", kind).body(body(0..size)),
        Part::Range(range) => answer("206 Partial Content")
            .field("Content-Type", kind)
            .field("Content-Range", &format!("bytes {}-{}/{size}", range.start, range.end - 1))
            .body(body(range)),
        Part::Beyond => answer("416 Range Not Satisfiable").field("Content-Range", &format!("bytes */{size}")),
    }
}

/// The type of a file by its ending.
fn content_type(path: &str) -> &'static str {
    match path.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "wasm" => "application/wasm",
        "png" => "image/png",
        "svg" => "image/svg+xml",
        "glb" => "model/gltf-binary",
        _ => "application/octet-stream",
    }
}
