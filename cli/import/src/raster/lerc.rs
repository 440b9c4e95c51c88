//! LERC, which bounds how far each height was moved: files of one band, and the strips and tiles of a TIFF, through the
//! crate `lerc-reader`. A file's place comes from `--spacing` or `--bounds`.
//!
//! A file is one blob, which is decoded as a whole.

use std::io::Read;
use std::path::{Path, PathBuf};

use lerc_core::{DataType, PixelData};
use lerc_reader::{InspectOptions, decode_first, inspect_first_with_options};

use super::header::{Header, HeightRows};
use super::{Parsed, grid_error};
use crate::error::{ImportError, Location};
use crate::source::FileBytes;

/// How files begin: those of version 2 and later, and those of version 1.
pub(super) const MAGICS: [&[u8]; 2] = [b"Lerc2 ", b"CntZImage "];
/// A file has at most this many samples: half a gigabyte of them, which is the most that the crate decodes.
const MAX_SAMPLES: u64 = 1 << 27;

/// What a blob decodes to, sample by sample.
struct Samples {
    pixels: PixelData,
    /// 0 where there is no height.
    mask: Option<Vec<u8>>,
}

impl Samples {
    /// The samples from a number on, NaN where there is no height. What is not there stays as it is.
    fn read(&self, first: usize, heights: &mut [f64]) {
        fn put<T: Copy>(values: &[T], heights: &mut [f64], number: impl Fn(T) -> f64) {
            heights.iter_mut().zip(values).for_each(|(height, &value)| *height = number(value));
        }
        macro_rules! put {
            ($($kind:ident)*) => {
                match &self.pixels {
                    $(PixelData::$kind(values) => put(values.get(first..).unwrap_or_default(), heights, f64::from),)*
                }
            };
        }
        put!(I8 U8 I16 U16 I32 U32 F32 F64);
        let valid = self.mask.iter().flat_map(|mask| mask.get(first..).unwrap_or_default());
        for (height, _) in heights.iter_mut().zip(valid).filter(|(_, valid)| **valid == 0) {
            *height = f64::NAN;
        }
    }
}

/// The rows of a file.
struct LercRows {
    path: PathBuf,
    columns: usize,
    samples: Option<Samples>,
}

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let bytes = FileBytes::open(path)?;
    let info = inspect_first_with_options(&bytes, InspectOptions::new().with_compute_value_range(false));
    let info = info.map_err(|error| damaged(path, &error))?;
    if info.depth != 1 || bytes.len() > info.blob_size {
        let problem = "holds several bands, or several values a sample; take out the one with heights first, with `gdal_translate -b`";
        return Err(grid_error(path, problem));
    }
    let [columns, rows] = [info.width, info.height];
    if u64::from(columns) * u64::from(rows) > MAX_SAMPLES {
        let problem = format!("has {columns} x {rows} samples, but at most {MAX_SAMPLES} are read; cut it into tiles");
        return Err(grid_error(path, &problem));
    }
    let mut header = Header::new([columns, rows]);
    header.nodata = info.no_data_value;
    header.is_f32 = info.data_type == DataType::F32;
    header.is_integer = !matches!(info.data_type, DataType::F32 | DataType::F64);
    Ok((header, Box::new(LercRows { path: path.to_owned(), columns: columns as usize, samples: None })))
}

impl HeightRows for LercRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let samples = match &mut self.samples {
            Some(samples) => samples,
            none => {
                let decoded = decode_first(&FileBytes::open(&self.path)?);
                let decoded = decoded.map_err(|error| damaged(&self.path, &error))?;
                none.insert(Samples { pixels: decoded.pixels, mask: decoded.mask })
            }
        };
        samples.read(row as usize * self.columns, heights);
        Ok(())
    }
}

/// How the strips and tiles of a TIFF are packed, beyond LERC: tag 50674.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    None,
    Deflate,
    Zstandard,
}

impl Packing {
    /// By the numbers of the tag: the version of LERC, and the packing.
    pub fn from_tag(numbers: &[u32]) -> Option<Self> {
        match numbers {
            [] | [_] | [_, 0, ..] => Some(Self::None),
            [_, 1, ..] => Some(Self::Deflate),
            [_, 2, ..] => Some(Self::Zstandard),
            _ => None,
        }
    }

    fn unpack(self, bytes: Vec<u8>, most: u64) -> std::io::Result<Vec<u8>> {
        let mut blob = Vec::new();
        match self {
            Self::None => return Ok(bytes),
            Self::Deflate => flate2::read::ZlibDecoder::new(&*bytes).take(most).read_to_end(&mut blob)?,
            Self::Zstandard => zstd::stream::read::Decoder::with_buffer(&*bytes)?.take(most).read_to_end(&mut blob)?,
        };
        Ok(blob)
    }
}

/// The heights of a strip or tile, which holds as many as `heights`; an error if it does not.
pub(super) fn decode_piece(
    bytes: Vec<u8>,
    packing: Packing,
    size: [u32; 2],
    heights: &mut [f64],
) -> Result<(), String> {
    // A blob that LERC makes is hardly larger than its samples are, with eight bytes each.
    let most = 16 * heights.len() as u64 + (1 << 16);
    let blob = packing.unpack(bytes, most).map_err(|error| error.to_string())?;
    let info = inspect_first_with_options(&blob, InspectOptions::new().with_compute_value_range(false));
    let info = info.map_err(|error| error.to_string())?;
    if [info.width, info.height, info.depth] != [size[0], size[1], 1] {
        return Err(format!("it holds {} x {} samples instead of {} x {}", info.width, info.height, size[0], size[1]));
    }
    let decoded = decode_first(&blob).map_err(|error| error.to_string())?;
    Samples { pixels: decoded.pixels, mask: decoded.mask }.read(0, heights);
    Ok(())
}

#[cold]
fn damaged(path: &Path, error: &lerc_core::Error) -> Box<ImportError> {
    use lerc_core::Error::{UnsupportedFeature, UnsupportedVersion};
    if let UnsupportedFeature(_) | UnsupportedVersion(_) = error {
        // Version 6 packs floats without loss in a way of its own.
        let remedy =
            "write it with an error above 0, or convert it with `gdal_translate -of GTiff -co COMPRESS=DEFLATE`";
        let feature = match error {
            UnsupportedFeature(feature) => (*feature).to_owned(),
            other => other.to_string(),
        };
        return ImportError::Unsupported { path: path.to_owned(), feature, remedy }.into();
    }
    let problem = format!("{error}; the LERC is damaged: copy or export it again");
    ImportError::Syntax { path: path.to_owned(), location: Location::Byte(0), problem }.into()
}
