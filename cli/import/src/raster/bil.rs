//! Rows of binary numbers beside a text header: ESRI `.bil` and `.flt`, GTOPO30 `.dem`, and raw files with an `.hdr`.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::header::{Header, HeightRows};
use super::lines::{Lines, place_of};
use super::sidecar::with_extension_in_any_case;
use super::{ImportError, Parsed, envi, grid_error};
use crate::error::Location;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Number {
    bytes: usize,
    is_float: bool,
    is_signed: bool,
    is_big_endian: bool,
}

impl Number {
    /// That of SRTM.
    pub const HEIGHT: Self = Self { bytes: 2, is_float: false, is_signed: true, is_big_endian: true };

    /// That of `.gtx`.
    pub const BIG_FLOAT: Self = Self { bytes: 4, is_float: true, is_signed: true, is_big_endian: true };

    /// Of `bytes` bytes, at most 8.
    pub fn new(bytes: usize, is_float: bool, is_signed: bool, is_big_endian: bool) -> Self {
        Self { bytes, is_float, is_signed, is_big_endian }
    }

    /// Whether it is a float of 32 bits, and whether it is an integer.
    pub fn kind(self) -> (bool, bool) {
        (self.is_float && self.bytes == 4, !self.is_float)
    }

    fn read(self, stored: &[u8]) -> f64 {
        let mut bytes = [0; 8];
        bytes[..self.bytes].copy_from_slice(stored);
        if self.is_big_endian {
            bytes[..self.bytes].reverse();
        }
        let bits = u64::from_le_bytes(bytes);
        match (self.is_float, self.bytes) {
            (true, 4) => f64::from(f32::from_bits(bits as u32)),
            (true, _) => f64::from_bits(bits),
            (false, size) if self.is_signed => {
                let unused = 64 - 8 * size as u32;
                (((bits << unused) as i64) >> unused) as f64
            }
            (false, _) => bits as f64,
        }
    }
}

/// Rows that follow each other in a file.
pub(super) struct FlatRows {
    path: PathBuf,
    file: BufReader<File>,
    number: Number,
    first_byte: u64,
    row_bytes: u64,
    at: u64,
    buffer: Vec<u8>,
    columns: usize,
}

impl FlatRows {
    pub fn new(path: &Path, file: File, [columns, _]: [u32; 2], number: Number) -> Self {
        let columns = columns as usize;
        Self {
            path: path.to_owned(),
            file: BufReader::with_capacity(1 << 18, file),
            number,
            first_byte: 0,
            row_bytes: (columns * number.bytes) as u64,
            at: 0,
            buffer: vec![],
            columns,
        }
    }

    /// The same, behind a header.
    pub fn after(self, first_byte: u64) -> Self {
        Self { first_byte, at: u64::MAX, ..self }
    }

    /// Refuses a file that is too short for a size.
    pub fn check_length(&self, [columns, rows]: [u32; 2]) -> Parsed<()> {
        let path = || self.path.clone();
        let length = self.file.get_ref().metadata().map_err(|source| ImportError::Io { path: path(), source })?.len();
        let needed = u128::from(self.first_byte)
            + u128::from(self.row_bytes) * u128::from(rows.saturating_sub(1))
            + self.columns as u128 * self.number.bytes as u128;
        if u128::from(length) >= needed {
            return Ok(());
        }
        let missing =
            format!("its header announces {columns} x {rows} samples, which take {needed} bytes, and it has {length}");
        Err(ImportError::Truncated { path: path(), location: Location::Byte(length), missing }.into())
    }
}

impl HeightRows for FlatRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let start = self.first_byte + u64::from(row) * self.row_bytes;
        let bytes = self.columns * self.number.bytes;
        self.buffer.resize(bytes, 0);
        let moved = if start == self.at { Ok(()) } else { self.file.seek(SeekFrom::Start(start)).map(|_| ()) };
        moved.and_then(|()| self.file.read_exact(&mut self.buffer)).map_err(|source| {
            let path = self.path.clone();
            match source.kind() {
                ErrorKind::UnexpectedEof => {
                    let missing = format!("a row of {} samples takes {bytes} bytes from byte {start} on", self.columns);
                    ImportError::Truncated { path, location: Location::Item("row", row.into()), missing }
                }
                _ => ImportError::Io { path, source },
            }
        })?;
        self.at = start + bytes as u64;
        let number = self.number;
        for (height, stored) in heights.iter_mut().zip(self.buffer.chunks_exact(number.bytes)) {
            *height = number.read(stored);
        }
        Ok(())
    }
}

/// The header of a file, which lies beside it.
pub(super) fn header_of(path: &Path) -> Option<PathBuf> {
    with_extension_in_any_case(path, "hdr")
}

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let Some(hdr) = header_of(path) else {
        let hdr = path.with_extension("hdr");
        let problem =
            format!("needs its header {}, which says how many rows and columns it has; put it there", hdr.display());
        return Err(grid_error(path, &problem));
    };
    if envi::is_header(&hdr) {
        return envi::open(path, &hdr);
    }
    let lines = Lines::read(&hdr)?;
    let mut header = Header::new([lines.needed("NCOLS")?, lines.needed("NROWS")?]);
    let is_flt = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("flt"));
    let number = number_of(&lines, is_flt)?;
    (header.is_f32, header.is_integer) = number.kind();
    header.nodata = lines.number("NODATA")?.or(lines.number("NODATA_VALUE")?);
    header.place = place_of(&lines, header.size)?;
    if lines.number::<u32>("NBANDS")?.is_some_and(|bands| bands != 1) {
        return Err(grid_error(
            path,
            "has several bands; take out the one with heights first, with `gdal_translate -b`",
        ));
    }
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(io)?;
    let mut rows = FlatRows::new(path, file, header.size, number);
    rows.first_byte = lines.number("SKIPBYTES")?.unwrap_or(0);
    let least = rows.row_bytes;
    rows.row_bytes = lines.number("TOTALROWBYTES")?.or(lines.number("BANDROWBYTES")?).unwrap_or(least).max(least);
    rows.check_length(header.size)?;
    Ok((header, Box::new(rows)))
}

/// How the header says that samples are stored: ESRI's PIXELTYPE, or the DATATYPE of others, as `INT2S`, `FLT4S` or `U16`.
fn number_of(lines: &Lines, is_flt: bool) -> Parsed<Number> {
    let said = lines.text("PIXELTYPE").or(lines.text("DATATYPE")).unwrap_or_default().to_ascii_uppercase();
    let digits: String = said.chars().filter(char::is_ascii_digit).collect();
    // R counts bytes, all others bits.
    let bits_of_kind = digits.parse::<u32>().ok().map(|count| if count < 8 { 8 * count } else { count });
    let bits: u32 = lines.number("NBITS")?.or(bits_of_kind).unwrap_or(if is_flt { 32 } else { 16 });
    let kind: &str = said.trim_matches(|c: char| c.is_ascii_digit());
    let is_float = kind.starts_with(['F', 'D', 'R']) || is_flt && kind.is_empty();
    // Headers of 16 bits without a type are those of heights, which have a sign (GTOPO30).
    let is_unsigned = kind.starts_with(['B', 'U']) || kind.ends_with('U') || kind.is_empty() && bits != 16;
    let order = lines.text("BYTEORDER").unwrap_or_default().to_ascii_uppercase();
    let is_big_endian = match order.chars().next() {
        None | Some('I' | 'L' | '0') => false,
        Some('M' | 'B' | '1') => true,
        Some(_) => {
            let problem = format!("says BYTEORDER \"{order}\"; write I for Intel's or M for Motorola's");
            return Err(grid_error(&lines.path, &problem));
        }
    };
    let is_known = if is_float { matches!(bits, 32 | 64) } else { matches!(bits, 8 | 16 | 32) };
    if !is_known {
        let problem = format!(
            "says NBITS {bits} and PIXELTYPE \"{said}\"; integers of 8, 16 and 32 bits and floats of 32 and 64 can be read"
        );
        return Err(grid_error(&lines.path, &problem));
    }
    Ok(Number { bytes: (bits / 8) as usize, is_float, is_signed: !is_unsigned, is_big_endian })
}
