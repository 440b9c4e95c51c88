//! PNG: shades of grey as heights, or the colours of Terrarium tiles. Its place comes from `--spacing` or `--bounds`.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use ::png::{BitDepth, ColorType, Decoder, DecodingError, Limits, Reader, Transformations};

use super::header::{Header, HeightRows};
use super::options::HeightCode;
use super::{ImportError, Parsed, grid_error};
use crate::error::Location;

/// The rows of a PNG.
struct PngRows {
    path: PathBuf,
    reader: Reader<BufReader<File>>,
    /// Bytes of a pixel.
    pixel_bytes: usize,
    /// The pixel that stands for no data.
    absent: Option<Vec<u8>>,
    /// Bytes of the opacity at the end of a pixel: what is transparent has no data.
    alpha: usize,
    code: Code,
    next: u32,
}

/// How a pixel says its height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Code {
    Grey8,
    Grey16,
    Terrarium,
}

/// Opens a PNG, without what its own opacity leaves out if that counts.
pub(super) fn open(path: &Path, code: HeightCode, with_masks: bool) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), Limits { bytes: 256 << 20 });
    decoder.set_transformations(Transformations::IDENTITY);
    let reader = decoder.read_info().map_err(|error| damaged(path, 0, error))?;
    let info = reader.info();
    if info.interlaced {
        return Err(grid_error(path, "is interlaced, so it has no rows in order; save it without interlacing"));
    }
    let channels = match info.color_type {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => {
            return Err(grid_error(path, "has a palette, and its colours are no heights; save it as grey"));
        }
    };
    let code = match (code, channels, info.bit_depth) {
        (HeightCode::Terrarium, 3 | 4, BitDepth::Eight) => Code::Terrarium,
        (HeightCode::Terrarium, ..) => {
            return Err(grid_error(path, "has no colours of 8 bits, as Terrarium tiles have; omit --height-code"));
        }
        (HeightCode::Grey, 1 | 2, BitDepth::Eight) => Code::Grey8,
        (HeightCode::Grey, 1 | 2, BitDepth::Sixteen) => Code::Grey16,
        (HeightCode::Grey, 3 | 4, _) => {
            let problem = "is coloured; pass --height-code terrarium if its colours are heights, or --drape if they are a picture";
            return Err(grid_error(path, problem));
        }
        (HeightCode::Grey, ..) => {
            return Err(grid_error(path, "has samples of fewer than 8 bits; save it with 8 or 16"));
        }
    };
    let mut header = Header::new([info.width, info.height]);
    header.is_integer = code != Code::Terrarium;
    if code == Code::Terrarium {
        header.vertical = Some(1.0);
    }
    let pixel_bytes = channels * if info.bit_depth == BitDepth::Sixteen { 2 } else { 1 };
    // Grey or colour that stands for nothing, as pixels have it.
    let absent = info.trns.as_ref().filter(|_| with_masks).map(|pixel| pixel.to_vec());
    let sample_bytes = pixel_bytes / channels;
    let alpha = if with_masks && matches!(channels, 2 | 4) { sample_bytes } else { 0 };
    let rows = PngRows { path: path.to_owned(), reader, pixel_bytes, absent, alpha, code, next: 0 };
    Ok((header, Box::new(rows)))
}

impl HeightRows for PngRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        loop {
            let number = self.next;
            let next = self.reader.next_row().map_err(|error| damaged(&self.path, number, error))?;
            let Some(next) = next else {
                let missing = "the image has fewer rows than it announces".to_owned();
                let location = Location::Item("row", row.into());
                return Err(ImportError::Truncated { path: self.path.clone(), location, missing }.into());
            };
            self.next += 1;
            if number < row {
                continue;
            }
            for (height, pixel) in heights.iter_mut().zip(next.data().chunks_exact(self.pixel_bytes)) {
                let opacity = &pixel[self.pixel_bytes - self.alpha..];
                let is_absent = self.absent.as_deref() == Some(pixel)
                    || !opacity.is_empty() && opacity.iter().all(|byte| *byte == 0);
                *height = match (self.code, pixel) {
                    _ if is_absent => f64::NAN,
                    (Code::Grey16, [high, low, ..]) => f64::from(u16::from_be_bytes([*high, *low])),
                    (Code::Terrarium, [red, green, blue, ..]) => {
                        f64::from(*red) * 256.0 + f64::from(*green) + f64::from(*blue) / 256.0 - 32768.0
                    }
                    (_, [grey, ..]) => f64::from(*grey),
                    _ => f64::NAN,
                };
            }
            return Ok(());
        }
    }
}

#[cold]
fn damaged(path: &Path, row: u32, error: DecodingError) -> Box<ImportError> {
    let (path, location) = (path.to_owned(), Location::Item("row", row.into()));
    match error {
        DecodingError::IoError(source) if source.raw_os_error().is_some() => ImportError::Io { path, source },
        DecodingError::IoError(_) => {
            ImportError::Truncated { path, location, missing: "the image's data does not go on".into() }
        }
        other => ImportError::Syntax { path, location, problem: format!("{other}; the PNG is damaged: copy it again") },
    }
    .into()
}
