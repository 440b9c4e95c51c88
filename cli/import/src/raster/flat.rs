//! Rows of binary numbers that follow each other in a file.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::header::HeightRows;
use super::sidecar::with_extension_in_any_case;
use super::{ImportError, Parsed};
use crate::error::Location;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Number {
    pub bytes: usize,
    pub is_float: bool,
    pub is_signed: bool,
    pub is_big_endian: bool,
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
    /// Where the first row begins.
    pub first_byte: u64,
    /// From the beginning of a row to that of the next.
    pub row_bytes: u64,
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
