//! Messages on stderr: lines of text or, with `--progress json`, one JSON object per line, so that a program can read
//! all of them.

use lodpack_cli::text;
use std::ffi::OsString;
use std::fmt;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

static JSON: AtomicBool = AtomicBool::new(false);

/// Looks for `--progress json` among the words that were typed, before they are parsed: a parser's error is JSON then,
/// too.
pub fn choose_style(words: &[OsString]) {
    let is_json = words.iter().any(|word| word == "--progress=json")
        || words.windows(2).any(|pair| pair[0] == "--progress" && pair[1] == "json");
    JSON.store(is_json, Ordering::Relaxed);
}

/// Whether messages are JSON objects.
pub fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// Writes a line, without what a terminal would take as commands. A closed stderr is not an error: there is no one to
/// tell.
pub fn line(text: fmt::Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{}", text::plain(&text.to_string()));
}

/// The most characters of a note.
const NOTE_LENGTH: usize = 2000;

/// Writes a message of a kind: "note", "error" or "stopped".
pub fn tell(kind: &str, text: &str) {
    // Names in notes are those that files have. Errors may have several lines.
    let note = (kind == "note").then(|| text::line(text, NOTE_LENGTH));
    let text = note.as_deref().unwrap_or(text);
    match is_json() {
        true => line(format_args!("{}", serde_json::json!({ kind: text }))),
        false => line(format_args!("{kind}: {text}")),
    }
}

/// The text of an error and of its sources, each once: some errors repeat the text of their source.
pub fn with_reasons(error: &anyhow::Error) -> String {
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
    fn every_reason_is_named_once() {
        let read = || lodpack::Error::Io { offset: 0, length: 8192, source: std::io::ErrorKind::NotFound.into() };
        let error = anyhow::Error::new(read()).context("x.lodpack");
        assert_eq!(with_reasons(&error), "x.lodpack: cannot read 8192 bytes at offset 0: entity not found");
        let plain: anyhow::Result<()> =
            Err(std::io::Error::from(std::io::ErrorKind::NotFound)).context("cannot open y");
        assert_eq!(with_reasons(&plain.unwrap_err()), "cannot open y: entity not found");
    }
}
