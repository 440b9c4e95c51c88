//! HTTP range requests (RFC 9110, chapter 14). Every range has both ends, because some servers get suffixes wrong.

mod redirect;

use std::{
    io::{self, Read},
    ops::Range,
    sync::{Mutex, OnceLock, PoisonError},
    time::Duration,
};

use ureq::http::{Response, StatusCode, header};

use super::{ReadAt, Request, SourceError, start::Start};

/// Timeouts, attempts and connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HttpOptions {
    /// Longest silence: until a connection stands, until an answer begins, and between two of its bytes.
    pub timeout: Duration,
    /// Attempts in a row that may fail for a reason that may pass: no connection, a timeout, a short answer, or a
    /// status like 503. What has arrived is kept, and the next one asks for the rest; one that brings 16 KiB is no
    /// failure.
    pub attempts: u32,
    /// Pause before the second attempt; it doubles before each further one. There is none behind one that is no
    /// failure.
    pub pause: Duration,
    /// Most requests at once.
    pub connections: usize,
    /// Whether the server may redirect to other hosts. By default it may not: where a file is asked for is the
    /// caller's choice.
    pub other_hosts: bool,
}

/// An attempt that brings as many bytes is no failure.
const PROGRESS: usize = 1 << 14;

/// Most redirects of one request.
const REDIRECTS: u32 = 5;

impl Default for HttpOptions {
    fn default() -> Self {
        // Browsers send six at once.
        let (timeout, pause) = (Duration::from_secs(30), Duration::from_millis(200));
        Self { timeout, attempts: 4, pause, connections: 6, other_hosts: false }
    }
}

/// What must stay the same from request to request.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Identity {
    size: u64,
    tag: Option<String>,
    modified: Option<String>,
}

/// A file on a web server.
#[derive(Debug)]
pub struct Http {
    agent: ureq::Agent,
    url: String,
    options: HttpOptions,
    /// That of the first answer.
    identity: OnceLock<Identity>,
    start: Start,
}

impl Http {
    /// A file at an `http://` or `https://` address. Sends no request yet.
    pub fn new(url: impl Into<String>, options: HttpOptions) -> Self {
        let config = ureq::Agent::config_builder()
            .timeout_resolve(Some(options.timeout))
            .timeout_connect(Some(options.timeout))
            .timeout_send_request(Some(options.timeout))
            .timeout_recv_response(Some(options.timeout))
            .timeout_per_read(Some(options.timeout))
            .http_status_as_error(false)
            .max_redirects(0)
            .max_idle_connections_per_host(options.connections)
            .user_agent(concat!("lodpack/", env!("CARGO_PKG_VERSION")))
            // Ranges count the bytes of the file, not of a compressed form.
            .accept_encoding("identity")
            .build();
        Self { agent: config.new_agent(), url: url.into(), options, identity: OnceLock::new(), start: Start::default() }
    }

    /// Fetches a range, in as many attempts as the options allow, each of which asks for what is not there yet. The
    /// answer is shorter only where the file ends.
    fn fetch(&self, range: &Range<u64>) -> io::Result<(Vec<u8>, u64)> {
        let mut bytes = Vec::new();
        let mut failures = 0;
        loop {
            let before = bytes.len();
            match self.try_fetch(range, &mut bytes) {
                Ok(size) => return Ok((bytes, size)),
                Err(error) if error.is_transient() => {
                    if bytes.len() >= before + PROGRESS {
                        // What breaks while it works is continued at once.
                        failures = 1;
                        continue;
                    }
                    failures += 1;
                    if failures >= self.options.attempts {
                        return Err(error.into());
                    }
                    std::thread::sleep(self.options.pause.saturating_mul(1 << (failures - 1).min(8)));
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// The answer to a request for a range, behind redirects.
    fn ask(&self, range: &Range<u64>) -> Result<Response<ureq::Body>, SourceError> {
        let asked = format!("bytes={}-{}", range.start, range.end - 1);
        let mut url = self.url.clone();
        for _ in 0..REDIRECTS {
            let response = self.agent.get(&url).header(header::RANGE, &asked).call().map_err(source_error)?;
            let to = response.headers().get(header::LOCATION).and_then(|to| to.to_str().ok());
            let (true, Some(to)) = (matches!(response.status().as_u16(), 301 | 302 | 303 | 307 | 308), to) else {
                return Ok(response);
            };
            let to = redirect::resolved(&url, to);
            if !self.options.other_hosts && !redirect::is_same_host(&url, &to) {
                return Err(SourceError::Redirected { to });
            }
            url = to;
        }
        Err(SourceError::Closed { what: format!("it redirects more than {REDIRECTS} times") })
    }

    /// Adds what `bytes` lack of a range. Returns the size of the file.
    fn try_fetch(&self, whole: &Range<u64>, bytes: &mut Vec<u8>) -> Result<u64, SourceError> {
        let range = &(whole.start + bytes.len() as u64..whole.end);
        let response = self.ask(range)?;
        let text = |name| response.headers().get(name).and_then(|value| value.to_str().ok()).map(str::to_owned);
        let announced = text(header::CONTENT_LENGTH).and_then(|length| length.parse::<u64>().ok());
        let content_range = text(header::CONTENT_RANGE);
        let content_type = text(header::CONTENT_TYPE);
        let (tag, modified) = (text(header::ETAG), text(header::LAST_MODIFIED));
        let identity = |size| Identity { size, tag, modified };
        let (length, size) = match response.status() {
            StatusCode::PARTIAL_CONTENT => {
                let said = content_range.unwrap_or_else(|| "nothing".into());
                let wrong = || SourceError::WrongRange { what: format!("content range {said}") };
                let (found, size) = parse_content_range(&said).ok_or_else(wrong)?;
                self.check(identity(size))?;
                if found.start != range.start || found.end != range.end.min(size) {
                    return Err(wrong());
                }
                (found.end - found.start, size)
            }
            // The whole file answers the request if it is no larger than the range.
            StatusCode::OK => match announced {
                Some(size) if range.start == 0 && size <= range.end => {
                    self.check(identity(size))?;
                    (size, size)
                }
                _ => {
                    let page = content_type.filter(|kind| kind.starts_with("text/html"));
                    return Err(page.map_or(SourceError::RangesIgnored, |what| SourceError::WebPage { what }));
                }
            },
            StatusCode::RANGE_NOT_SATISFIABLE => {
                let size = content_range.as_deref().and_then(|said| said.strip_prefix("bytes */")?.parse().ok());
                let size = size.ok_or(SourceError::Status { status: 416 })?;
                self.check(identity(size))?;
                return Ok(size);
            }
            status => return Err(SourceError::Status { status: status.as_u16() }),
        };
        if announced.is_some_and(|announced| announced != length) {
            return Err(SourceError::WrongRange { what: format!("{announced:?} bytes instead of {length}") });
        }
        let is_whole = response.status() == StatusCode::OK;
        let expected = bytes.len() as u64 + length;
        let read = read_body(response, length, bytes);
        let found = bytes.len() as u64;
        if is_whole && read.is_err() {
            // The next answer begins at the beginning again.
            bytes.clear();
        }
        match read {
            Ok(()) if found == expected => Ok(size),
            Err(error) if found == 0 || is_timeout(&error) => Err(source_error(ureq::Error::from(error))),
            _ => Err(SourceError::Short { expected, found }),
        }
    }

    /// Compares an answer with the first one.
    fn check(&self, found: Identity) -> Result<(), SourceError> {
        let first = self.identity.get_or_init(|| found.clone());
        // A server may leave out headers now and then.
        let differs = |a: &Option<String>, b: &Option<String>| a.is_some() && b.is_some() && a != b;
        let what = if first.size != found.size {
            format!("size {} instead of {}", found.size, first.size)
        } else if differs(&first.tag, &found.tag) {
            "ETag".to_owned()
        } else if differs(&first.modified, &found.modified) {
            "date of its last modification".to_owned()
        } else {
            return Ok(());
        };
        Err(SourceError::Changed { what })
    }
}

/// `bytes FIRST-LAST/SIZE`.
fn parse_content_range(said: &str) -> Option<(Range<u64>, u64)> {
    let (range, size) = said.strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = range.split_once('-')?;
    let (first, last, size) = (first.parse().ok()?, last.parse::<u64>().ok()?, size.parse().ok()?);
    (first <= last && last < size).then(|| (first..last + 1, size))
}

/// Adds an answer's bytes, also where it breaks off.
fn read_body(response: Response<ureq::Body>, length: u64, bytes: &mut Vec<u8>) -> io::Result<()> {
    response.into_body().into_reader().take(length).read_to_end(bytes).map(|_| ())
}

fn is_timeout(error: &io::Error) -> bool {
    let inner = error.get_ref().and_then(|inner| inner.downcast_ref());
    error.kind() == io::ErrorKind::TimedOut || matches!(inner, Some(ureq::Error::Timeout(_)))
}

fn source_error(error: ureq::Error) -> SourceError {
    match error {
        ureq::Error::Timeout(_) | ureq::Error::BodyStalled => SourceError::TimedOut,
        ureq::Error::Io(error) if is_timeout(&error) => SourceError::TimedOut,
        other => SourceError::Closed { what: other.to_string() },
    }
}

impl ReadAt for Http {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if buf.is_empty() || self.start.fill(offset, buf) {
            return Ok(());
        }
        let (bytes, _) = self.fetch(&(offset..offset.saturating_add(buf.len() as u64)))?;
        // The file itself ends there; what the server says of its size is checked elsewhere.
        let whole = bytes.len() == buf.len();
        if !whole {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        buf.copy_from_slice(&bytes);
        Ok(())
    }

    fn size(&self) -> io::Result<u64> {
        match self.identity.get() {
            Some(identity) => Ok(identity.size),
            None => Ok(self.fetch(&(0..1))?.1),
        }
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let (bytes, size) = self.fetch(&(0..length.max(1) as u64))?;
        self.start.keep(&bytes);
        Ok((bytes, size))
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        let count = requests.len().min(self.options.connections.max(1));
        let queue = Mutex::new(requests.iter_mut());
        let work = || {
            loop {
                // The lock is given back before the request is made.
                let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some(request) = next else { return Ok(()) };
                self.read_at(request.offset, request.buf)?;
            }
        };
        if count <= 1 {
            return work();
        }
        std::thread::scope(|scope| {
            let others: Vec<_> = (1..count).map(|_| scope.spawn(work)).collect();
            let closed = || SourceError::Closed { what: "a thread that read from it failed".into() };
            let join = |thread: std::thread::ScopedJoinHandle<'_, io::Result<()>>| {
                thread.join().unwrap_or_else(|_| Err(closed().into()))
            };
            others.into_iter().map(join).fold(work(), |first, next| first.and(next))
        })
    }
}

#[cfg(test)]
mod tests;
