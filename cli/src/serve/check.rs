//! What a web server does to a file that programs and pages read in ranges.

use crate::text::count;
use lodpack::source::{Http, HttpOptions};
use lodpack::{Limits, Opener};
use serde::Serialize;
use std::io::Read;
use std::ops::Range;
use std::time::Duration;
use ureq::http::Response;
use ureq::{Agent, Body};

/// How a server does in one respect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Good.
    Ok,
    /// It works, but could be better.
    Note,
    /// Something will not work.
    Problem,
}

/// One sentence about a server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// "answer", "ranges", "compression", "cors", "identity" or "file".
    pub about: &'static str,
    /// Good or not.
    pub verdict: Verdict,
    /// What it is, and what to do.
    pub text: String,
}

/// A page that might read the file.
const ORIGIN: &str = "https://viewer.example";
/// Where the sizes of ranges come from.
const RANGE_BYTES: u64 = 1000;
/// Longest time for one answer.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Sends a few small requests to a server, as programs and pages would, and says what it does wrong.
///
/// # Errors
/// If there is no connection to the server.
pub fn check(url: &str) -> Result<Vec<Finding>, ureq::Error> {
    let config = Agent::config_builder().timeout_global(Some(TIMEOUT)).http_status_as_error(false).build();
    let mut checker = Checker { agent: config.new_agent(), url, findings: vec![] };
    checker.run()?;
    Ok(checker.findings)
}

struct Checker<'a> {
    agent: Agent,
    url: &'a str,
    findings: Vec<Finding>,
}

/// What is looked at of an answer.
struct Answer {
    status: u16,
    head: ureq::http::HeaderMap,
    /// No more than was asked for, and one byte.
    body: Vec<u8>,
}

impl Answer {
    fn text(&self, name: &str) -> Option<&str> {
        self.head.get(name)?.to_str().ok()
    }

    /// The file's size, as the server says it.
    fn size(&self) -> Option<u64> {
        match self.status {
            206 => self.text("content-range")?.rsplit_once('/')?.1.parse().ok(),
            _ => self.text("content-length")?.parse().ok(),
        }
    }

    /// How the body is compressed.
    fn encoding(&self) -> Option<&str> {
        self.text("content-encoding").filter(|encoding| !encoding.eq_ignore_ascii_case("identity"))
    }

    /// What tells this file from another one.
    fn identity(&self) -> [Option<String>; 2] {
        ["etag", "last-modified"].map(|name| self.text(name).map(str::to_owned))
    }
}

impl Checker<'_> {
    fn say(&mut self, about: &'static str, verdict: Verdict, text: impl Into<String>) {
        self.findings.push(Finding { about, verdict, text: text.into() });
    }

    /// Asks for a range as a page would; `encoding` is what the client can unpack.
    fn get(&self, range: &Range<u64>, encoding: &str) -> Result<Answer, ureq::Error> {
        let asked = format!("bytes={}-{}", range.start, range.end - 1);
        let request = self.agent.get(self.url).header("Range", asked).header("Origin", ORIGIN);
        read(request.header("Accept-Encoding", encoding).call()?, range.end - range.start + 1)
    }

    fn run(&mut self) -> Result<(), ureq::Error> {
        let first = self.get(&(0..RANGE_BYTES), "identity")?;
        if !matches!(first.status, 200 | 206) {
            self.say("answer", Verdict::Problem, about_status(first.status));
            return Ok(());
        }
        if first.text("content-type").is_some_and(|kind| kind.starts_with("text/html")) && !is_lodpack(&first.body) {
            let text =
                "the server sends a web page instead of a file: check the address, and whether it requires a login";
            self.say("answer", Verdict::Problem, text);
            return Ok(());
        }
        // Behind the first range, and over its end.
        let size = first.size().unwrap_or(RANGE_BYTES);
        let (middle, end) = (size / 2, size.min(size / 2 + RANGE_BYTES));
        let second = self.get(&(middle..end.max(middle + 1)), "identity")?;
        let packed = self.get(&(0..RANGE_BYTES), "gzip, deflate, br")?;
        self.ranges(&first, &second, middle..end);
        self.compression(&[&first, &second, &packed]);
        self.pages(&first)?;
        let last = self.get(&(0..RANGE_BYTES), "identity")?;
        self.identity(&[&first, &second, &last]);
        self.file(&first);
        Ok(())
    }

    fn ranges(&mut self, first: &Answer, second: &Answer, range: Range<u64>) {
        let asked = format!("bytes {}-{}/", range.start, range.end - 1);
        match (second.status, second.text("content-range")) {
            (206, Some(said)) if said.starts_with(&asked) && second.body.len() as u64 == range.end - range.start => {
                self.say("ranges", Verdict::Ok, "the server sends the ranges that are asked for");
            }
            (206, said) => {
                let (said, length) = (said.unwrap_or("nothing").to_owned(), count(second.body.len() as u64));
                let text = format!(
                    "the server sends other bytes than are asked for: {length} bytes and the content range \"{said}\" instead of \"{asked}...\""
                );
                self.say("ranges", Verdict::Problem, text);
            }
            _ if first.status == 206 => {
                let text =
                    format!("the server sends the first range, and answers a later one with status {}", second.status);
                self.say("ranges", Verdict::Problem, text);
            }
            _ => {
                let text = "the server ignores ranges and sends the whole file: allow range requests, or use a server that has them";
                self.say("ranges", Verdict::Problem, text);
            }
        }
    }

    fn compression(&mut self, answers: &[&Answer]) {
        match answers.iter().find_map(|answer| answer.encoding()) {
            None => self.say("compression", Verdict::Ok, "the server sends the bytes as they are"),
            Some(encoding) => {
                let text = format!(
                    "the server compresses the file ({encoding}), so that ranges count other bytes: turn compression off for .lodpack files, \
                     which cannot be compressed any further"
                );
                self.say("compression", Verdict::Problem, text);
            }
        }
    }

    /// What pages of other hosts may do.
    fn pages(&mut self, first: &Answer) -> Result<(), ureq::Error> {
        match first.text("access-control-allow-origin") {
            Some("*" | ORIGIN) => {}
            found => {
                let found = found.map_or("no such header".into(), |origin| format!("\"{origin}\""));
                let text = format!(
                    "pages on other hosts cannot read the file: send Access-Control-Allow-Origin: * (the server sends {found})"
                );
                self.say("cors", Verdict::Problem, text);
                return Ok(());
            }
        }
        let exposed = first.text("access-control-expose-headers").unwrap_or_default().to_ascii_lowercase();
        let shows = |name: &str| exposed.split(',').any(|other| matches!(other.trim(), "*") || other.trim() == name);
        if !shows("content-range") || !shows("etag") {
            let text = "pages on other hosts cannot see the file's size or a change of it: send Access-Control-Expose-Headers: \
                        Content-Range, ETag";
            self.say("cors", Verdict::Problem, text);
            return Ok(());
        }
        let request = ureq::http::Request::options(self.url)
            .header("Origin", ORIGIN)
            .header("Access-Control-Request-Method", "GET")
            .header("Access-Control-Request-Headers", "range");
        let asked = match request.body(()) {
            Ok(request) => Some(read(self.agent.run(request)?, 0)?),
            Err(_) => None,
        };
        let allows = |asked: &Answer| {
            let fields = asked.text("access-control-allow-headers").unwrap_or_default().to_ascii_lowercase();
            (200..300).contains(&asked.status) && fields.split(',').any(|name| matches!(name.trim(), "*" | "range"))
        };
        if asked.as_ref().is_some_and(allows) {
            self.say("cors", Verdict::Ok, "pages on any host can read the file");
        } else {
            let text = "pages on any host can read the file, except in old browsers, which ask first with OPTIONS: answer that with 204 and \
                        Access-Control-Allow-Headers: Range";
            self.say("cors", Verdict::Note, text);
        }
        Ok(())
    }

    fn identity(&mut self, answers: &[&Answer]) {
        let differs = |k: usize| {
            let found: Vec<_> = answers.iter().filter_map(|answer| answer.identity()[k].clone()).collect();
            found.windows(2).any(|pair| pair[0] != pair[1])
        };
        let ends = answers[0].body != answers[answers.len() - 1].body;
        let sizes: Vec<_> = answers.iter().filter_map(|answer| answer.size()).collect();
        let first = answers[0].identity();
        if ends || differs(0) || differs(1) || sizes.windows(2).any(|pair| pair[0] != pair[1]) {
            let what = match (differs(0), differs(1)) {
                (true, _) => "its ETag",
                (false, true) => "its date",
                _ if ends => "its bytes",
                _ => "its size",
            };
            let text = format!(
                "the file changes from request to request ({what} does): see whether it is being written, or whether several servers hold \
                 different ones"
            );
            return self.say("identity", Verdict::Problem, text);
        }
        match first {
            [Some(tag), _] if !tag.starts_with("W/") => {
                self.say("identity", Verdict::Ok, "the file has an ETag, so a change is noticed");
            }
            [None, None] => {
                let text = "nothing tells a changed file from the old one: send an ETag, or readers may mix both and report damage";
                self.say("identity", Verdict::Problem, text);
            }
            [tag, _] => {
                let found = if tag.is_some() { "only a weak ETag" } else { "a date but no ETag" };
                let text = format!("the file has {found}: pages notice a change of its size alone; send a strong ETag");
                self.say("identity", Verdict::Note, text);
            }
        }
    }

    fn file(&mut self, first: &Answer) {
        if !is_lodpack(&first.body) {
            return self.say("file", Verdict::Problem, "the file is not a lodpack file: check the address");
        }
        if self.findings.iter().any(|finding| finding.about == "ranges" && finding.verdict == Verdict::Problem) {
            return;
        }
        match lodpack::File::open(Http::new(self.url, HttpOptions::default()), Limits::default()) {
            Ok(file) => {
                let text = format!("it is a lodpack file of {} roots that opens", count(file.root_count().into()));
                self.say("file", Verdict::Ok, text);
            }
            Err(error) => self.say("file", Verdict::Problem, format!("the file cannot be opened: {error}")),
        }
    }
}

/// Reads at most `most` bytes: a server that ignores ranges may send a file of any size.
fn read(response: Response<Body>, most: u64) -> Result<Answer, ureq::Error> {
    let (parts, body) = response.into_parts();
    let mut bytes = vec![];
    // A body that ends early shows in its length.
    let _ = body.into_reader().take(most).read_to_end(&mut bytes);
    Ok(Answer { status: parts.status.as_u16(), head: parts.headers, body: bytes })
}

fn is_lodpack(bytes: &[u8]) -> bool {
    bytes.starts_with(&Opener::MAGIC[..4])
}

fn about_status(status: u16) -> String {
    let advice = match status {
        401 => "it requires a login: use an address that needs none, such as a signed one",
        403 => "it lets nobody read the file: check its rights, or whether a signed address has expired",
        404 | 410 => "there is no such file: check the address",
        405 | 501 => "it does not allow GET",
        429 => "it is asked too often: try again later",
        500.. => "it fails: look at its log",
        _ => "that is no answer to a request for a file",
    };
    format!("the server answers with status {status}: {advice}")
}
