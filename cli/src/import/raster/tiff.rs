//! TIFF, GeoTIFF and cloud-optimised GeoTIFF, in strips or tiles, through the crate `tiff`. The first image counts; the others are
//! overviews and masks.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use ::tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};

use super::crs::{Crs, unit_named};
use super::geokeys::{GEO_DOUBLES, GEO_TEXTS, GeoTags};
use super::header::{Header, HeightRows};
use super::lerc::{Packing, decode_piece};
use super::{ImportError, Parsed, RasterFormat, grid_error};
use crate::import::error::Location;

const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIEPOINT: u16 = 33922;
const MODEL_TRANSFORMATION: u16 = 34264;
const GEO_KEY_DIRECTORY: u16 = 34735;
const GDAL_METADATA: u16 = 42112;
const GDAL_NODATA: u16 = 42113;
const LERC_PARAMETERS: u16 = 50674;
/// The number of LERC among compressions.
const LERC: u16 = 34887;

/// The most bytes of a strip or tile once it is decoded.
const MAX_CHUNK_BYTES: u64 = 256 << 20;
/// The most bytes of a band of strips or tiles that lie beside each other.
const MAX_BAND_BYTES: u64 = 1 << 30;

/// What to do about pieces that cannot be read.
const REMEDY: &str = "convert it first, with `gdal_translate -co COMPRESS=DEFLATE`";

/// The rows of a TIFF, a band of strips or tiles at a time.
struct TiffRows {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    /// Columns and rows of the image.
    size: [u32; 2],
    /// Columns and rows of a strip or tile.
    chunk: [u32; 2],
    /// How many bytes each chunk has in the file: none where everything is without data.
    stored: Vec<u64>,
    /// The rows of the band, as numbers; a band is read when its first row is asked for.
    band: Vec<f64>,
    /// Number of the band.
    current: Option<u32>,
    /// What stands where nothing is stored.
    empty: f64,
    lerc: Option<Lerc>,
}

/// Of strips or tiles in LERC, which the crate does not decode.
struct Lerc {
    /// Where each is in the file.
    offsets: Vec<u64>,
    packing: Packing,
    /// Columns and rows of each. The last strip has fewer rows; tiles are whole.
    size: [u32; 2],
    are_tiles: bool,
}

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let fault = |error| damaged(path, Location::Byte(0), error);
    let limits = {
        let mut limits = Limits::default();
        limits.decoding_buffer_size = MAX_CHUNK_BYTES as usize;
        limits.intermediate_buffer_size = MAX_CHUNK_BYTES as usize;
        // The tables of strips and tiles: 8 bytes for each.
        limits.ifd_value_size = 64 << 20;
        limits
    };
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(fault)?.with_limits(limits);
    let (columns, rows) = decoder.dimensions().map_err(fault)?;
    match decoder.colortype().map_err(fault)? {
        ColorType::Gray(8 | 16 | 32 | 64) => {}
        ColorType::Gray(bits) => {
            return Err(grid_error(
                path,
                &format!("has samples of {bits} bits; only 8, 16, 32 and 64 can be read: convert it first"),
            ));
        }
        other => {
            let problem = format!(
                "has no single band of heights but {other:?}; take out the band with heights first, with `gdal_translate -b`, or pass it as --drape"
            );
            return Err(grid_error(path, &problem));
        }
    }
    let mut header = Header::new([columns, rows]);
    let tags = tags_of(&mut decoder);
    header.place = tags.place(path)?;
    header.crs = tags.crs(path)?;
    let text = |decoder: &mut Decoder<_>, tag| decoder.get_tag_ascii_string(Tag::Unknown(tag)).unwrap_or_default();
    header.nodata = text(&mut decoder, GDAL_NODATA).trim_matches(['\0', ' ']).parse().ok();
    let metadata = text(&mut decoder, GDAL_METADATA);
    header.scale = scale_of(&metadata);
    match unit_named(item(&metadata, "unittype").unwrap_or_default()) {
        Ok(metres) => header.vertical = metres,
        Err(remark) => header.crs.remarks.push(remark),
    }
    let bits = decoder.get_tag_u16_vec(Tag::BitsPerSample).unwrap_or_default();
    let is_float = decoder.get_tag_u16_vec(Tag::SampleFormat).is_ok_and(|format| format.first() == Some(&3));
    header.is_f32 = is_float && bits.first() == Some(&32);
    header.is_integer = !is_float;

    let (chunk_columns, chunk_rows) = decoder.chunk_dimensions();
    let chunk = [chunk_columns, chunk_rows.min(rows)];
    // A chunk is decoded as a whole, and a band of them is kept.
    let sample = u64::from(bits.first().copied().unwrap_or(8).div_ceil(8));
    let one = u64::from(chunk[0]).saturating_mul(u64::from(chunk[1])).saturating_mul(sample);
    let band = u64::from(columns).saturating_mul(u64::from(chunk[1])).saturating_mul(8);
    if one > MAX_CHUNK_BYTES || band > MAX_BAND_BYTES {
        let problem = format!(
            "is stored in pieces of {} x {} samples, which have to be held as a whole; store it in smaller tiles, with \
             `gdal_translate -co TILED=YES`",
            chunk[0], chunk[1]
        );
        return Err(grid_error(path, &problem));
    }
    let counts = match decoder.get_chunk_type() {
        ChunkType::Strip => Tag::StripByteCounts,
        ChunkType::Tile => Tag::TileByteCounts,
    };
    let stored = decoder.get_tag_u64_vec(counts).map_err(fault)?;
    let lerc = lerc_of(path, &mut decoder)?;
    let rows = TiffRows {
        path: path.to_owned(),
        decoder,
        size: header.size,
        chunk,
        stored,
        band: vec![],
        current: None,
        empty: header.nodata.unwrap_or(f64::NAN),
        lerc,
    };
    Ok((header, Box::new(rows)))
}

/// How strips or tiles in LERC are stored, if they are.
fn lerc_of(path: &Path, decoder: &mut Decoder<BufReader<File>>) -> Parsed<Option<Lerc>> {
    if decoder.get_tag_unsigned::<u16>(Tag::Compression).ok() != Some(LERC) {
        return Ok(None);
    }
    let are_tiles = matches!(decoder.get_chunk_type(), ChunkType::Tile);
    let tag = if are_tiles { Tag::TileOffsets } else { Tag::StripOffsets };
    let (columns, rows) = decoder.chunk_dimensions();
    let offsets = decoder.get_tag_u64_vec(tag).map_err(|error| damaged(path, Location::Byte(0), error))?;
    let parameters = decoder.get_tag_u32_vec(Tag::Unknown(LERC_PARAMETERS)).unwrap_or_default();
    let unknown = || {
        let feature = format!("LERC packed by method {:?}", parameters.get(1));
        ImportError::Unsupported { path: path.to_owned(), feature, remedy: REMEDY }
    };
    let packing = Packing::from_tag(&parameters).ok_or_else(unknown)?;
    Ok(Some(Lerc { offsets, packing, size: [columns, rows], are_tiles }))
}

/// Where the pixels of an image are, if it is a GeoTIFF. Its kind of pixels does not matter.
pub(super) fn place_of_image(path: &Path) -> Parsed<Option<(Header, Crs)>> {
    let mut file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let mut start = [0; 4];
    let read = file.read(&mut start).and_then(|_| file.rewind());
    read.map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    if super::detect(Path::new(""), &start) != Some(RasterFormat::Tiff) {
        return Ok(None);
    }
    let fault = |error| damaged(path, Location::Byte(0), error);
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(fault)?;
    let (columns, rows) = decoder.dimensions().map_err(fault)?;
    let tags = tags_of(&mut decoder);
    let header = Header { place: tags.place(path)?, ..Header::new([columns, rows]) };
    Ok(Some((header, tags.crs(path)?)))
}

fn tags_of(decoder: &mut Decoder<BufReader<File>>) -> GeoTags {
    GeoTags {
        pixel_scale: numbers(decoder, MODEL_PIXEL_SCALE),
        tiepoints: numbers(decoder, MODEL_TIEPOINT),
        transformation: numbers(decoder, MODEL_TRANSFORMATION),
        keys: decoder.get_tag_u16_vec(Tag::Unknown(GEO_KEY_DIRECTORY)).unwrap_or_default(),
        doubles: numbers(decoder, GEO_DOUBLES),
        texts: decoder.get_tag_ascii_string(Tag::Unknown(GEO_TEXTS)).unwrap_or_default(),
    }
}

/// Numbers of a tag; none where there is no such tag or it is damaged.
fn numbers(decoder: &mut Decoder<BufReader<File>>, tag: u16) -> Vec<f64> {
    decoder.get_tag_f64_vec(Tag::Unknown(tag)).unwrap_or_default()
}

/// Scale and offset in the metadata of GDAL, which has them as `<Item name="SCALE" sample="0" role="scale">0.1</Item>`.
fn scale_of(metadata: &str) -> [f64; 2] {
    let number = |role: &str| item(metadata, role)?.parse::<f64>().ok().filter(|value| value.is_finite());
    [number("scale").unwrap_or(1.0), number("offset").unwrap_or(0.0)]
}

/// What the metadata of GDAL say about a role of the first band.
fn item<'a>(metadata: &'a str, role: &str) -> Option<&'a str> {
    let (_, rest) = metadata.split_once(&format!("role=\"{role}\">"))?;
    Some(rest.split('<').next()?.trim())
}

impl HeightRows for TiffRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let band = row / self.chunk[1];
        if self.current != Some(band) {
            self.read_band(band)?;
        }
        let columns = self.size[0] as usize;
        let first = (row % self.chunk[1]) as usize * columns;
        heights.copy_from_slice(&self.band[first..first + columns]);
        Ok(())
    }
}

impl Lerc {
    /// The heights of a strip or tile of a number of bytes, in a band of a number of rows.
    fn read(&self, file: &mut BufReader<File>, number: usize, bytes: u64, rows: usize) -> Result<Vec<f64>, TiffError> {
        let offset = self.offsets.get(number).copied().unwrap_or(u64::MAX);
        let length = file.seek(SeekFrom::End(0))?;
        if bytes > length.saturating_sub(offset).min(MAX_CHUNK_BYTES) {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        file.seek(SeekFrom::Start(offset))?;
        let mut blob = vec![0; bytes as usize];
        file.read_exact(&mut blob)?;
        let size = if self.are_tiles { self.size } else { [self.size[0], rows as u32] };
        let mut heights = vec![f64::NAN; size[0] as usize * size[1] as usize];
        decode_piece(blob, self.packing, size, &mut heights)
            .map_err(|problem| io::Error::new(io::ErrorKind::InvalidData, problem))?;
        Ok(heights)
    }
}

impl TiffRows {
    fn read_band(&mut self, band: u32) -> Parsed<()> {
        let [columns, rows] = self.size.map(|size| size as usize);
        let [across, down] = self.chunk.map(|size| size as usize);
        let band_rows = down.min(rows - band as usize * down);
        self.current = None;
        self.band.clear();
        self.band.resize(columns * band_rows, self.empty);
        let count = columns.div_ceil(across);
        for number in 0..count {
            let chunk = band as usize * count + number;
            if self.stored.get(chunk) == Some(&0) {
                continue;
            }
            let location = Location::Item("piece", chunk as u64);
            let width = across.min(columns - number * across);
            if let Some(lerc) = &self.lerc {
                let file = self.decoder.inner();
                let bytes = self.stored.get(chunk).copied().unwrap_or(u64::MAX);
                let heights = lerc.read(file, chunk, bytes, band_rows);
                let heights = heights.map_err(|error| damaged(&self.path, location, error))?;
                let rows = self.band.chunks_exact_mut(columns).zip(heights.chunks_exact(across));
                rows.for_each(|(row, own)| row[number * across..][..width].copy_from_slice(&own[..width]));
                continue;
            }
            let decoded =
                self.decoder.read_chunk(chunk as u32).map_err(|error| damaged(&self.path, location, error))?;
            let mut place = Band { band: &mut self.band, columns, first: number * across, width };
            let is_whole = match decoded {
                DecodingResult::U8(values) => place.put(&values, f64::from),
                DecodingResult::U16(values) => place.put(&values, f64::from),
                DecodingResult::U32(values) => place.put(&values, f64::from),
                DecodingResult::U64(values) => place.put(&values, |value| value as f64),
                DecodingResult::I8(values) => place.put(&values, f64::from),
                DecodingResult::I16(values) => place.put(&values, f64::from),
                DecodingResult::I32(values) => place.put(&values, f64::from),
                DecodingResult::I64(values) => place.put(&values, |value| value as f64),
                DecodingResult::F16(values) => place.put(&values, |value| f64::from(value.to_f32())),
                DecodingResult::F32(values) => place.put(&values, f64::from),
                DecodingResult::F64(values) => place.put(&values, |value| value),
            };
            if !is_whole {
                let missing = "a piece holds fewer samples than it should".to_owned();
                return Err(ImportError::Truncated { path: self.path.clone(), location, missing }.into());
            }
        }
        self.current = Some(band);
        Ok(())
    }
}

/// Where a chunk goes in its band.
struct Band<'a> {
    band: &'a mut [f64],
    columns: usize,
    first: usize,
    width: usize,
}

impl Band<'_> {
    /// Copies a chunk's samples; false if there are too few.
    fn put<T: Copy>(&mut self, values: &[T], number: impl Fn(T) -> f64) -> bool {
        let rows = self.band.chunks_exact_mut(self.columns);
        let count = rows.len();
        for (row, values) in rows.zip(values.chunks_exact(self.width)) {
            for (height, &value) in row[self.first..self.first + self.width].iter_mut().zip(values) {
                *height = number(value);
            }
        }
        values.len() >= count * self.width
    }
}

#[cold]
fn damaged(path: &Path, location: Location, error: TiffError) -> Box<ImportError> {
    let path = path.to_owned();
    match error {
        TiffError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            ImportError::Truncated { path, location, missing: "the TIFF names bytes behind the end of the file".into() }
        }
        TiffError::IoError(source) if source.raw_os_error().is_some() => ImportError::Io { path, source },
        TiffError::UnsupportedError(what) => {
            ImportError::Unsupported { path, feature: what.to_string(), remedy: REMEDY }
        }
        other => {
            let problem = format!("{other}; the TIFF is damaged: copy or export it again");
            ImportError::Syntax { path, location, problem }
        }
    }
    .into()
}
