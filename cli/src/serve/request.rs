//! Requests: what a client sends, parsed with limits.

use std::io::{self, Read};

/// Longest head of a request. Browsers stay below 8 KiB.
const HEAD_BYTES: usize = 16 << 10;
/// Most header fields.
const FIELDS: usize = 100;

/// What the server looks at.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    pub method: String,
    /// The path, with percent signs decoded.
    pub path: String,
    /// What follows the question mark.
    pub query: String,
    pub range: Option<String>,
    pub if_range: Option<String>,
    pub if_match: Option<String>,
    pub if_none_match: Option<String>,
    /// Somebody has typed the address or followed a link, in a browser.
    pub is_navigation: bool,
    /// A page on a public host asks whether it may read from this machine.
    pub asks_private_network: bool,
    /// The connection ends after the answer.
    pub is_last: bool,
}

/// The bytes of a connection that no request has taken yet.
#[derive(Debug, Default)]
pub struct Head(Vec<u8>);

impl Head {
    /// The next request: nothing when the client has closed the connection, and none inside for one that cannot be
    /// understood.
    pub fn next(&mut self, mut stream: impl Read) -> io::Result<Option<Option<Request>>> {
        loop {
            match parse(&self.0) {
                Parsed::Request(request, length) => {
                    self.0.drain(..length);
                    return Ok(Some(Some(*request)));
                }
                Parsed::Nonsense => return Ok(Some(None)),
                Parsed::Partial if self.0.len() >= HEAD_BYTES => return Ok(Some(None)),
                Parsed::Partial => {}
            }
            let mut more = [0; 4096];
            match stream.read(&mut more)? {
                0 => return Ok(None),
                count => self.0.extend_from_slice(&more[..count]),
            }
        }
    }
}

enum Parsed {
    /// And how many bytes it took.
    Request(Box<Request>, usize),
    Partial,
    Nonsense,
}

fn parse(bytes: &[u8]) -> Parsed {
    let mut fields = [httparse::EMPTY_HEADER; FIELDS];
    let mut parsed = httparse::Request::new(&mut fields);
    let length = match parsed.parse(bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) => return Parsed::Partial,
        Err(_) => return Parsed::Nonsense,
    };
    let (Some(method), Some(target)) = (parsed.method, parsed.path) else { return Parsed::Nonsense };
    // A proxy is asked with the whole address.
    let target = target.split_once("://").map_or(target, |(_, rest)| rest.find('/').map_or("/", |at| &rest[at..]));
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let mut request = Request {
        method: method.to_owned(),
        path: unescape(path),
        query: query.to_owned(),
        is_last: parsed.version == Some(0),
        ..Request::default()
    };
    for field in parsed.headers.iter() {
        let Ok(value) = std::str::from_utf8(field.value).map(str::trim) else { continue };
        match field.name.to_ascii_lowercase().as_str() {
            "range" => request.range = Some(value.to_owned()),
            "if-range" => request.if_range = Some(value.to_owned()),
            "if-match" => request.if_match = Some(value.to_owned()),
            "if-none-match" => request.if_none_match = Some(value.to_owned()),
            "sec-fetch-mode" => request.is_navigation = value == "navigate",
            "access-control-request-private-network" => request.asks_private_network = value == "true",
            "connection" if value.eq_ignore_ascii_case("close") => request.is_last = true,
            // A body is not read, so nothing may be taken for the next request.
            "transfer-encoding" => return Parsed::Nonsense,
            "content-length" if value != "0" => return Parsed::Nonsense,
            _ => {}
        }
    }
    Parsed::Request(Box::new(request), length)
}

/// Decodes percent signs; what is no UTF-8 then names nothing.
fn unescape(path: &str) -> String {
    let mut bytes = Vec::with_capacity(path.len());
    let mut rest = path.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digit = |at: usize| after.get(at).and_then(|&digit| char::from(digit).to_digit(16));
        if let (b'%', Some(high), Some(low)) = (byte, digit(0), digit(1)) {
            bytes.push((high * 16 + low) as u8);
            rest = &after[2..];
        } else {
            bytes.push(byte);
            rest = after;
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str) -> Option<Option<Request>> {
        Head::default().next(text.as_bytes()).expect("bytes can be read")
    }

    #[test]
    fn requests_are_read_however_they_are_split_and_one_after_the_other() {
        let text = "GET /a%20b?x=1 HTTP/1.1\r\nHost: h\r\nRange: bytes=0-7\r\n\r\nHEAD http://h/c HTTP/1.0\r\n\r\n";
        for size in [1, 7, 1000] {
            let mut head = Head::default();
            let mut pieces = text.as_bytes().chunks(size);
            let mut read = || {
                struct Piece<'a>(&'a mut std::slice::Chunks<'static, u8>);
                impl Read for Piece<'_> {
                    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
                        let piece = self.0.next().unwrap_or_default();
                        buffer[..piece.len()].copy_from_slice(piece);
                        Ok(piece.len())
                    }
                }
                head.next(Piece(&mut pieces)).expect("bytes can be read")
            };
            let first = read().flatten().expect("a request");
            assert_eq!((first.path.as_str(), first.query.as_str()), ("/a b", "x=1"));
            assert_eq!((first.range.as_deref(), first.is_last), (Some("bytes=0-7"), false));
            let second = read().flatten().expect("a request");
            assert_eq!((second.method.as_str(), second.path.as_str(), second.is_last), ("HEAD", "/c", true));
            assert_eq!(read(), None);
        }
    }

    #[test]
    fn nonsense_bodies_and_endless_heads_are_refused() {
        assert_eq!(one("what is this\r\n\r\n"), Some(None));
        assert_eq!(one("POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhello"), Some(None));
        assert_eq!(one("POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"), Some(None));
        assert_eq!(one(&format!("GET / HTTP/1.1\r\nX: {}", "x".repeat(HEAD_BYTES))), Some(None));
        assert_eq!(one(&format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(FIELDS + 1))), Some(None));
        assert_eq!(one("GET / HTT"), None);
    }

    #[test]
    fn percent_signs_are_decoded_once() {
        assert_eq!(unescape("/a%2fb%2"), "/a/b%2");
        assert_eq!(unescape("/%2541%"), "/%41%");
        assert_eq!(unescape("/%c3%a9"), "/\u{e9}");
    }
}
