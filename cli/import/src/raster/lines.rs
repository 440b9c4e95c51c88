//! Text headers of words and values, as ESRI's formats have them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::header::Georeference;
use super::{ImportError, Parsed, grid_error};
use crate::error::Location;
use crate::source::size_of_file;

/// The largest header that is read.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// The lines of a header: a word in capitals, and its value.
pub(super) struct Lines {
    /// The file that they are from.
    pub path: PathBuf,
    values: BTreeMap<String, String>,
}

impl Lines {
    /// The lines of a file.
    pub fn read(path: &Path) -> Parsed<Self> {
        let io = |source| ImportError::Io { path: path.to_owned(), source };
        let mut text = vec![];
        size_of_file(path).map_err(io)?;
        File::open(path).map_err(io)?.take(MAX_HEADER_BYTES).read_to_end(&mut text).map_err(io)?;
        let mut lines = Self::new(path);
        String::from_utf8_lossy(&text).lines().for_each(|line| lines.add(line));
        Ok(lines)
    }

    /// None yet.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), values: BTreeMap::new() }
    }

    /// Adds a line, unless it is no word with a value.
    pub fn add(&mut self, line: &str) {
        let mut words = line.split(['=', ' ', '\t', '\r']).filter(|word| !word.is_empty());
        if let (Some(key), Some(value)) = (words.next(), words.next()) {
            self.values.insert(key.to_ascii_uppercase(), value.to_owned());
        }
    }

    /// The value of a word.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(String::as_str)
    }

    /// A number, if there is one of the name.
    pub fn number<T: std::str::FromStr>(&self, key: &str) -> Parsed<Option<T>> {
        let parsed = self.text(key).map(|text| text.parse::<T>().map_err(|_| text));
        parsed.transpose().map_err(|text| {
            let problem =
                format!("{key} is \"{}\", which is no possible number; correct the header", text.escape_default());
            ImportError::Syntax { path: self.path.clone(), location: Location::Item("header", 0), problem }.into()
        })
    }

    /// A whole number without which there is no grid.
    pub fn needed(&self, key: &str) -> Parsed<u32> {
        match self.number(key)? {
            Some(number) => Ok(number),
            None => Err(grid_error(&self.path, &format!("does not say {key}; add a line with it"))),
        }
    }
}

/// Where the samples are: either the middle of the north-western pixel is given, or a corner of the
/// south-western one.
pub(super) fn place_of(lines: &Lines, [_, rows]: [u32; 2]) -> Parsed<Option<Georeference>> {
    let number = |key: &str| lines.number::<f64>(key);
    let cell = number("CELLSIZE")?;
    let (dx, dy) = (number("XDIM")?.or(number("DX")?).or(cell), number("YDIM")?.or(number("DY")?).or(cell));
    let (Some(dx), Some(dy)) = (dx, dy) else { return Ok(None) };
    if let (Some(x), Some(y)) = (number("ULXMAP")?, number("ULYMAP")?) {
        return Ok(Some(Georeference { first: [x, y], spacing: [dx, dy] }));
    }
    let x = match (number("XLLCENTER")?, number("XLLCORNER")?) {
        (Some(x), _) => Some(x),
        (None, corner) => corner.map(|x| x + 0.5 * dx),
    };
    let y = match (number("YLLCENTER")?, number("YLLCORNER")?) {
        (Some(y), _) => Some(y),
        (None, corner) => corner.map(|y| y + 0.5 * dy),
    };
    let north = |y: f64| y + f64::from(rows.saturating_sub(1)) * dy;
    Ok(x.zip(y).map(|(x, y)| Georeference { first: [x, north(y)], spacing: [dx, dy] }))
}
