//! ENVI: rows of binary numbers beside an `.hdr` of its own kind, which begins with the word ENVI.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::crs::{Crs, CrsKind};
use super::flat::{FlatRows, Number, header_of};
use super::header::{Georeference, Header, HeightRows};
use super::{ImportError, Parsed, grid_error};
use crate::source::size_of_file;

/// The largest header that is read.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Whether the header of a file is one of ENVI.
pub(super) fn is_beside(path: &Path) -> bool {
    header_of(path).is_some_and(|header| is_header(&header))
}

/// Whether a header is one of ENVI.
pub(super) fn is_header(header: &Path) -> bool {
    let mut start = [0; 4];
    let is_file = size_of_file(header).is_ok();
    is_file && File::open(header).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *b"ENVI"
}

/// The fields of a header by their names in small letters.
struct Fields<'a> {
    path: &'a Path,
    values: BTreeMap<String, String>,
}

impl<'a> Fields<'a> {
    fn read(path: &'a Path) -> Parsed<Self> {
        let io = |source| ImportError::Io { path: path.to_owned(), source };
        let mut text = vec![];
        File::open(path).map_err(io)?.take(MAX_HEADER_BYTES).read_to_end(&mut text).map_err(io)?;
        let text = String::from_utf8_lossy(&text);
        let (mut values, mut lines) = (BTreeMap::new(), text.lines());
        while let Some(line) = lines.next() {
            let Some((name, value)) = line.split_once('=') else { continue };
            let mut value = value.trim().to_owned();
            // A list goes on until it is closed.
            let mut is_open = value.starts_with('{') && !value.contains('}');
            while is_open {
                let Some(line) = lines.next() else { break };
                is_open = !line.contains('}');
                value.push_str(line);
            }
            let value = value.trim_matches(['{', '}', ' ', '\t']).to_owned();
            values.insert(name.trim().to_ascii_lowercase(), value);
        }
        Ok(Self { path, values })
    }

    fn text(&self, name: &str) -> Option<&str> {
        self.values.get(name).map(String::as_str)
    }

    fn number<T: std::str::FromStr>(&self, name: &str) -> Parsed<Option<T>> {
        let parsed = self.text(name).map(|text| text.parse().map_err(|_| text));
        parsed.transpose().map_err(|text| {
            let problem =
                format!("{name} is \"{}\", which is no possible number; correct the header", text.escape_default());
            grid_error(self.path, &problem)
        })
    }

    fn needed(&self, name: &str) -> Parsed<u32> {
        let missing = || grid_error(self.path, &format!("does not say {name}; add a line with it"));
        self.number(name)?.ok_or_else(missing)
    }

    /// How samples are stored.
    fn kind(&self) -> Parsed<Number> {
        let is_big_endian = self.number::<u32>("byte order")?.unwrap_or(0) == 1;
        let [bytes, is_float, is_signed] = match self.needed("data type")? {
            1 => [1, 0, 0],
            2 => [2, 0, 1],
            3 => [4, 0, 1],
            4 => [4, 1, 1],
            5 => [8, 1, 1],
            12 => [2, 0, 0],
            13 => [4, 0, 0],
            14 => [8, 0, 1],
            15 => [8, 0, 0],
            other => {
                let problem = format!(
                    "says data type {other}, and complex numbers are no heights; convert it first, with `gdal_translate`"
                );
                return Err(grid_error(self.path, &problem));
            }
        };
        Ok(Number::new(bytes, is_float == 1, is_signed == 1, is_big_endian))
    }

    /// Where the samples are. Pixels count from 1 at their corner.
    fn place(&self) -> Parsed<Option<Georeference>> {
        let Some(info) = self.text("map info") else { return Ok(None) };
        let fields: Vec<&str> = info.split(',').map(str::trim).collect();
        let turned = fields.iter().find_map(|field| field.strip_prefix("rotation=")?.trim().parse::<f64>().ok());
        if turned.is_some_and(|degrees| degrees != 0.0) {
            return Err(grid_error(
                self.path,
                "is rotated: its rows do not run to the east; rectify it first, with `gdalwarp`",
            ));
        }
        let numbers: Vec<f64> = fields.iter().skip(1).take(6).map_while(|field| field.parse().ok()).collect();
        let [column, row, x, y, dx, dy] = numbers[..] else {
            let problem =
                "says no place in map info: it has a name and six numbers; correct the header or remove the line";
            return Err(grid_error(self.path, problem));
        };
        Ok(Some(Georeference { first: [x + (1.5 - column) * dx, y - (1.5 - row) * dy], spacing: [dx, dy] }))
    }

    fn crs(&self) -> Parsed<Crs> {
        match self.text("coordinate system string") {
            Some(wkt) if !wkt.is_empty() => Crs::of_wkt(wkt).map_err(|error| grid_error(self.path, &error)),
            _ if self.text("map info").is_some_and(|info| info.starts_with("Geographic")) => {
                Ok(Crs { kind: CrsKind::Geographic, ..Crs::default() })
            }
            _ => Ok(Crs::default()),
        }
    }
}

/// Opens a file whose header is one of ENVI.
pub(super) fn open(path: &Path, header: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let fields = Fields::read(header)?;
    if fields.number::<u32>("bands")?.is_some_and(|bands| bands != 1) {
        return Err(grid_error(
            path,
            "has several bands; take out the one with heights first, with `gdal_translate -b`",
        ));
    }
    if fields.number::<u32>("file compression")?.unwrap_or(0) != 0 {
        return Err(grid_error(path, "is compressed; convert it first, with `gdal_translate -of GTiff`"));
    }
    let number = fields.kind()?;
    let mut grid = Header::new([fields.needed("samples")?, fields.needed("lines")?]);
    (grid.is_f32, grid.is_integer) = number.kind();
    grid.nodata = fields.number("data ignore value")?;
    grid.place = fields.place()?;
    grid.crs = fields.crs()?;
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let rows = FlatRows::new(path, file, grid.size, number).after(fields.number("header offset")?.unwrap_or(0));
    rows.check_length(grid.size)?;
    Ok((grid, Box::new(rows)))
}
