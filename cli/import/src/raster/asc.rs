//! ESRI ASCII grids: a header of words and values, then a number for each sample, rows from the north.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::header::{Header, HeightRows};
use super::lines::{Lines, place_of};
use super::{ImportError, Parsed};
use crate::error::Location;
use crate::scan::Scanner;

/// What is read at once.
const BUFFER_BYTES: usize = 1 << 20;
/// The longest header.
const MAX_HEADER_LINES: usize = 32;
/// What stands where the header says nothing of samples without data.
const NODATA: f64 = -9999.0;

/// Whether a file begins like a grid.
pub(super) fn looks_like_asc(bytes: &[u8]) -> bool {
    let mut text = Scanner::new(&bytes[..bytes.len().min(256)], 0);
    let first = text.word();
    (first.eq_ignore_ascii_case(b"ncols") || first.eq_ignore_ascii_case(b"nrows")) && text.integer().is_ok()
}

/// The numbers of a text file, a buffer at a time.
struct AscRows {
    path: PathBuf,
    file: File,
    buffer: Vec<u8>,
    /// The next byte of the buffer, and the end of its last whole word.
    at: usize,
    end: usize,
    is_over: bool,
}

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let mut rows = AscRows { path: path.to_owned(), file, buffer: vec![], at: 0, end: 0, is_over: false };
    rows.refill()?;
    let mut lines = Lines::new(path);
    for _ in 0..MAX_HEADER_LINES {
        let rest = &rows.buffer[rows.at..rows.end];
        let blank = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let rest = &rest[blank..];
        if !rest.first().is_some_and(u8::is_ascii_alphabetic) || is_number(rest) {
            break;
        }
        let length = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r').unwrap_or(rest.len());
        lines.add(&String::from_utf8_lossy(&rest[..length]));
        rows.at += blank + length;
    }
    let mut header = Header::new([lines.needed("NCOLS")?, lines.needed("NROWS")?]);
    header.nodata = Some(lines.number("NODATA_VALUE")?.unwrap_or(NODATA));
    header.place = place_of(&lines, header.size)?;
    Ok((header, Box::new(rows)))
}

/// Whether a text begins with "nan" or "inf", which some writers have among their heights.
fn is_number(text: &[u8]) -> bool {
    let word = text.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    crate::scan::parse_float(word).is_some()
}

impl AscRows {
    /// Reads more, and keeps what has not been used.
    fn refill(&mut self) -> Parsed<()> {
        self.buffer.drain(..self.at);
        self.at = 0;
        loop {
            let before = self.buffer.len();
            let read = self.file.by_ref().take(BUFFER_BYTES as u64).read_to_end(&mut self.buffer);
            read.map_err(|source| ImportError::Io { path: self.path.clone(), source })?;
            self.is_over = self.buffer.len() == before;
            let last = self.buffer.iter().rposition(u8::is_ascii_whitespace);
            self.end = if self.is_over { self.buffer.len() } else { last.map_or(0, |last| last + 1) };
            // No word is as long as a buffer, but a damaged file may look like it.
            if self.end > 0 || self.is_over || self.buffer.len() > 4 * BUFFER_BYTES {
                return Ok(());
            }
        }
    }
}

impl HeightRows for AscRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let location = Location::Item("row", row.into());
        for (column, height) in heights.iter_mut().enumerate() {
            loop {
                let mut text = Scanner::new(&self.buffer[..self.end], self.at);
                let value = text.float();
                self.at = text.at;
                let problem = match value {
                    Ok(value) => {
                        *height = value;
                        break;
                    }
                    Err([]) if !self.is_over => {
                        self.refill()?;
                        continue;
                    }
                    Err([]) => {
                        let missing = format!("the header announces more rows, and this one has {column} numbers");
                        return Err(ImportError::Truncated { path: self.path.clone(), location, missing }.into());
                    }
                    Err(word) => format!(
                        "\"{}\" stands where the height of column {column} should be; write numbers with a point",
                        word[..word.len().min(40)].escape_ascii()
                    ),
                };
                return Err(ImportError::Syntax { path: self.path.clone(), location, problem }.into());
            }
        }
        Ok(())
    }
}
