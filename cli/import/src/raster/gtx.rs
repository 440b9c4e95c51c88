//! `.gtx`, in which grids of geoids are handed around: a header of 40 bytes, and big-endian 32-bit heights in metres,
//! rows from the south.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::crs::Crs;
use super::flat::{FlatRows, Number};
use super::header::{Georeference, Header, HeightRows};
use super::{ImportError, Parsed};
use crate::error::Location;

/// The value of samples without data.
const VOID: f64 = -88.8888;
const HEADER_BYTES: u64 = 40;

/// Rows the other way around.
struct FromSouth {
    rows: FlatRows,
    count: u32,
}

impl HeightRows for FromSouth {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        self.rows.read(self.count - 1 - row, heights)
    }
}

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let short =
        |missing: String| ImportError::Truncated { path: path.to_owned(), location: Location::Byte(length), missing };
    let mut bytes = [0; HEADER_BYTES as usize];
    file.read_exact(&mut bytes).map_err(|_| short(format!("its header takes {HEADER_BYTES} bytes")))?;
    let [south, west, down, across] =
        [0, 8, 16, 24].map(|at| f64::from_be_bytes(std::array::from_fn(|k| bytes[at + k])));
    let [rows, columns] = [32, 36].map(|at| u32::from_be_bytes(std::array::from_fn(|k| bytes[at + k])));
    let needed = u128::from(HEADER_BYTES) + 4 * u128::from(rows) * u128::from(columns);
    if u128::from(length) < needed {
        let missing =
            format!("its header announces {columns} x {rows} samples, which take {needed} bytes, and it has {length}");
        return Err(short(missing).into());
    }
    let mut header = Header::new([columns, rows]);
    let north = south + f64::from(rows.max(1) - 1) * down;
    header.place = Some(Georeference { first: [west, north], spacing: [across, down] });
    (header.nodata, header.crs, header.vertical, header.is_f32) = (Some(VOID), Crs::wgs84(), Some(1.0), true);
    let flat = FlatRows::new(path, file, header.size, Number::BIG_FLOAT).after(HEADER_BYTES);
    Ok((header, Box::new(FromSouth { rows: flat, count: rows })))
}
