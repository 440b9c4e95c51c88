//! The rows of a PNG, one after the other.

use std::io;

use super::EncodedImage;
use super::problem::{png_problem, unreadable};

/// The rows of a PNG. None of what has to be decoded as a whole: interlaced ones, and other formats.
///
/// # Errors
/// What is wrong with it.
pub fn rows_of_png<R: EncodedImage>(mut encoded: R) -> Result<Option<RowsOfPng<R>>, String> {
    const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
    let start = encoded.fill_buf().map_err(|error| unreadable(&error))?;
    if !start.starts_with(SIGNATURE) {
        return Ok(None);
    }
    let mut decoder = png::Decoder::new(encoded);
    decoder.set_transformations(png::Transformations::EXPAND);
    // The checksum of the compressed rows counts, too.
    decoder.ignore_checksums(false);
    let reader = decoder.read_info().map_err(|error| png_problem(&error))?;
    let left = reader.info().height;
    Ok((!reader.info().interlaced).then_some(RowsOfPng { reader, left }))
}

/// The rows of a PNG that is not interlaced.
pub struct RowsOfPng<R: EncodedImage> {
    reader: png::Reader<R>,
    /// Rows that are not yet read.
    left: u32,
}

impl<R: EncodedImage> RowsOfPng<R> {
    /// What the samples of texels are, and their bits.
    pub fn output_color_type(&self) -> (png::ColorType, png::BitDepth) {
        self.reader.output_color_type()
    }

    /// The samples of the next row into `row`; false after the last one.
    ///
    /// # Errors
    /// What is wrong with the image. The last row is an error if checksums say that one before it is wrong.
    pub fn next_row(&mut self, row: &mut Vec<u8>) -> Result<bool, String> {
        if self.left == 0 {
            return Ok(false);
        }
        self.left -= 1;
        let length = self.reader.output_line_size(self.reader.info().width).ok_or("its rows are too long")?;
        row.resize(length, 0);
        self.reader.read_row(row).map_err(|error| png_problem(&error))?;
        if self.left == 0 {
            self.check_end()?;
        }
        Ok(true)
    }

    /// Reads what is behind the last row: its checksums. All texels of a file that ends there are known.
    fn check_end(&mut self) -> Result<(), String> {
        match self.reader.next_row() {
            Err(png::DecodingError::IoError(error)) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(()),
            Err(error) => Err(png_problem(&error)),
            Ok(_) => Ok(()),
        }
    }
}
