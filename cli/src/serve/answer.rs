//! Answers: what the server sends for a request.

use super::Rules;
use super::body::Content;
use super::range::{Part, part};
use super::shelf::{Item, Shelf};
use hyper::body::Bytes;
use hyper::header::{self, HeaderName, HeaderValue};
use hyper::http::request::Parts;
use hyper::{Method, Response, StatusCode};
use lodpack_import::decode_percent;
use std::io;
use std::net::IpAddr;
use std::ops::Range;

/// Not among hyper's names, since browsers alone ask for it: a page on a public host wants to read from this machine.
const ASKS_PRIVATE_NETWORK: HeaderName = HeaderName::from_static("access-control-request-private-network");
const ALLOWS_PRIVATE_NETWORK: HeaderName = HeaderName::from_static("access-control-allow-private-network");
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// An answer that is being put together.
struct Answer(Response<Content>);

impl Answer {
    fn new(status: StatusCode) -> Self {
        let mut response = Response::new(Content::Bytes(Bytes::new()));
        *response.status_mut() = status;
        Self(response)
    }

    /// A sentence for people, instead of what they asked for.
    fn text(status: StatusCode, text: &str) -> Self {
        let text = Content::Bytes(format!("{text}\n").into());
        Self::new(status).field(header::CONTENT_TYPE, "text/plain; charset=utf-8").body(text)
    }

    fn moved(address: &str) -> Self {
        Self::new(StatusCode::FOUND).field(header::LOCATION, address).field(header::CACHE_CONTROL, "no-store")
    }

    /// Values come from this program, escaped where they come from names.
    fn field(mut self, name: HeaderName, value: &str) -> Self {
        if let Ok(value) = HeaderValue::from_str(value) {
            self.0.headers_mut().insert(name, value);
        }
        self
    }

    fn body(self, body: Content) -> Self {
        Self(self.0.map(|_| body))
    }
}

/// The answer to a request.
pub(super) fn answer(request: &Parts, shelf: &Shelf, rules: Rules) -> Response<Content> {
    let answer = match request.method {
        _ if rules.is_local && !is_of_this_machine(request) => Answer::text(
            StatusCode::MISDIRECTED_REQUEST,
            "This server is for this machine alone: ask for localhost or 127.0.0.1, or let it --bind another address.",
        ),
        Method::GET | Method::HEAD => found(request, shelf),
        Method::OPTIONS => allowed(request, rules),
        _ => Answer::text(StatusCode::METHOD_NOT_ALLOWED, "Files can only be read here: GET, HEAD and OPTIONS.")
            .field(header::ALLOW, "GET, HEAD, OPTIONS"),
    };
    let answer = answer.field(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    let Answer(answer) = match rules.cors {
        true => answer
            .field(header::ACCESS_CONTROL_ALLOW_ORIGIN, "*")
            .field(header::ACCESS_CONTROL_EXPOSE_HEADERS, "Accept-Ranges, Content-Length, Content-Range, ETag")
            .field(RESOURCE_POLICY, "cross-origin"),
        false => answer,
    };
    answer
}

/// Whether a request names this machine. A name of anywhere else may lead here, too, and a page of that name would then
/// read what this machine has.
fn is_of_this_machine(request: &Parts) -> bool {
    let of_field = || request.headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let authority = match (request.uri.authority(), request.headers.contains_key(header::HOST)) {
        (Some(authority), _) => Some(authority.clone()),
        (None, true) => of_field().and_then(|host| host.trim().parse().ok()),
        // Browsers always say it.
        (None, false) => return true,
    };
    authority.is_some_and(|authority| {
        let host = authority.host().trim_start_matches('[').trim_end_matches(']').trim_end_matches('.');
        let host = host.to_ascii_lowercase();
        host.parse::<IpAddr>().is_ok() || host == "localhost" || host.ends_with(".localhost")
    })
}

/// What a page of another host may ask for.
fn allowed(request: &Parts, rules: Rules) -> Answer {
    let answer = Answer::new(StatusCode::NO_CONTENT).field(header::ALLOW, "GET, HEAD, OPTIONS");
    if !rules.cors {
        return answer;
    }
    let answer = answer
        .field(header::ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD, OPTIONS")
        .field(header::ACCESS_CONTROL_ALLOW_HEADERS, "Range, If-Match, If-None-Match, If-Range")
        .field(header::ACCESS_CONTROL_MAX_AGE, "86400");
    match request.headers.get(ASKS_PRIVATE_NETWORK).is_some_and(|asks| asks == "true") {
        true => answer.field(ALLOWS_PRIVATE_NETWORK, "true"),
        false => answer,
    }
}

fn found(request: &Parts, shelf: &Shelf) -> Answer {
    let asked = unescape(request.uri.path());
    // Somebody has typed the address or followed a link, in a browser.
    let is_navigation = request.headers.get("sec-fetch-mode").is_some_and(|mode| mode == "navigate");
    if is_navigation && let Some(address) = shelf.shown_at.get(&asked) {
        return Answer::moved(address);
    }
    let path = match asked.as_str() {
        "/" if request.uri.query().is_none_or(str::is_empty) => match &shelf.front {
            Some(html) => {
                return Answer::new(StatusCode::OK)
                    .field(header::CONTENT_TYPE, "text/html; charset=utf-8")
                    .body(Content::Bytes(html.clone().into()));
            }
            None => match shelf.shown_at.values().next() {
                Some(address) => return Answer::moved(address),
                None => "/index.html",
            },
        },
        "/" => "/index.html",
        path => path,
    };
    let cannot_read = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => Answer::text(StatusCode::NOT_FOUND, "This file was here, and is gone now."),
        _ => Answer::text(StatusCode::INTERNAL_SERVER_ERROR, &format!("The file cannot be read: {error}.")),
    };
    match shelf.item(path) {
        None => Answer::text(StatusCode::NOT_FOUND, "There is no such file here; / lists what there is."),
        Some(Item::Bytes(bytes)) => {
            let tag = format!("\"{:016x}\"", xxhash_rust::xxh3::xxh3_64(bytes));
            let slice = |range: Range<u64>| {
                let slice = bytes.get(range.start as usize..range.end as usize).unwrap_or_default();
                Ok(Content::Bytes(Bytes::copy_from_slice(slice)))
            };
            part_of(request, path, bytes.len() as u64, &tag, slice).unwrap_or_else(cannot_read)
        }
        Some(Item::File(file)) => {
            let opened = shelf.open(file);
            let sent = opened.and_then(|(open, size, tag)| {
                part_of(request, path, size, &tag, |range| Content::of_file(open, range))
            });
            sent.unwrap_or_else(cannot_read)
        }
    }
}

/// The part of something that a request asks for.
fn part_of(
    request: &Parts,
    path: &str,
    size: u64,
    tag: &str,
    body: impl FnOnce(Range<u64>) -> io::Result<Content>,
) -> io::Result<Answer> {
    // Browsers may keep it, and ask whether it is still the same.
    let answer = |status| {
        Answer::new(status)
            .field(header::ETAG, tag)
            .field(header::ACCEPT_RANGES, "bytes")
            .field(header::CACHE_CONTROL, "no-cache")
    };
    let value = |name: HeaderName| request.headers.get(name).and_then(|value| value.to_str().ok()).map(str::trim);
    let names_tag = |tags: &str| tags.split(',').any(|other| other.trim() == tag || other.trim() == "*");
    if value(header::IF_MATCH).is_some_and(|tags| !names_tag(tags)) {
        return Ok(answer(StatusCode::PRECONDITION_FAILED));
    }
    if value(header::IF_NONE_MATCH).is_some_and(names_tag) {
        return Ok(answer(StatusCode::NOT_MODIFIED));
    }
    // The client has a part of another file: it needs all of this one.
    let is_other = value(header::IF_RANGE).is_some_and(|other| other != tag);
    let of_kind = |status| answer(status).field(header::CONTENT_TYPE, content_type(path));
    Ok(match part(value(header::RANGE).filter(|_| !is_other), size) {
        Part::Whole => of_kind(StatusCode::OK).body(body(0..size)?),
        Part::Range(range) => of_kind(StatusCode::PARTIAL_CONTENT)
            .field(header::CONTENT_RANGE, &format!("bytes {}-{}/{size}", range.start, range.end - 1))
            .body(body(range)?),
        Part::Beyond => {
            answer(StatusCode::RANGE_NOT_SATISFIABLE).field(header::CONTENT_RANGE, &format!("bytes */{size}"))
        }
    })
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

/// Decodes percent signs; what is no UTF-8 then names nothing.
fn unescape(path: &str) -> String {
    decode_percent(path).unwrap_or_default().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_here_from_elsewhere_are_refused() {
        let asks = |host: &str| {
            let request = hyper::Request::builder().uri("/").header(header::HOST, host).body(()).expect("a request");
            is_of_this_machine(&request.into_parts().0)
        };
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1:80", "[::1]:8080", "a.localhost", "192.168.0.7:1"] {
            assert!(asks(host), "{host}");
        }
        for host in ["example.org", "localhost.example.org:80", "127.0.0.1.example.org", "", "a b"] {
            assert!(!asks(host), "{host}");
        }
    }

    #[test]
    fn percent_signs_are_decoded_once() {
        assert_eq!(unescape("/a%2fb%2"), "/a/b%2");
        assert_eq!(unescape("/%2541%"), "/%41%");
        assert_eq!(unescape("/%c3%a9"), "/\u{e9}");
    }
}
