//! What is said on stderr: as lines of text or, with `--progress json`, as one JSON object a line, so that a program can read it all.

use std::ffi::OsString;
use std::fmt;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

static JSON: AtomicBool = AtomicBool::new(false);

/// Learns from what was typed which of both it is: errors in the rest of it are told in the same way.
pub fn choose(words: &[OsString]) {
    let is_asked_for = words.iter().any(|word| word == "--progress=json")
        || words.windows(2).any(|pair| pair[0] == "--progress" && pair[1] == "json");
    JSON.store(is_asked_for, Ordering::Relaxed);
}

/// Whether every line is a JSON object.
pub fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// A line on stderr as it is. Where nobody listens any more there is nobody to tell.
pub fn line(text: fmt::Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// A line of some kind: "note", "error" or "stopped".
pub fn tell(kind: &str, text: &str) {
    match is_json() {
        true => line(format_args!("{}", serde_json::json!({ kind: text }))),
        false => line(format_args!("{kind}: {text}")),
    }
}

/// An error with all its reasons, each told once: some say themselves what is behind them.
pub fn told(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |text, reason| {
        let reason = reason.to_string();
        match text.is_empty() {
            true => reason,
            false if text.contains(&reason) => text,
            false => format!("{text}: {reason}"),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn every_reason_is_told_once() {
        let read = || lodpack::Error::Io { offset: 0, length: 8192, source: std::io::ErrorKind::NotFound.into() };
        let error = anyhow::Error::new(read()).context("x.lodpack");
        assert_eq!(told(&error), "x.lodpack: cannot read 8192 bytes at offset 0: entity not found");
        let plain: anyhow::Result<()> =
            Err(std::io::Error::from(std::io::ErrorKind::NotFound)).context("cannot open y");
        assert_eq!(told(&plain.unwrap_err()), "cannot open y: entity not found");
    }
}
