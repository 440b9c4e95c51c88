//! The samples of one image of a TIFF, a band of strips or tiles at a time.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use ::tiff::TiffError;
use ::tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;

use super::{Location, Parsed, damaged};
use crate::error::ImportError;
use crate::raster::grid_error;
use crate::raster::header::HeightRows;
use crate::raster::lerc::{Packing, decode_piece};
use lodpack_mesh::images::tiff_directory::{
    BITS_PER_SAMPLE, COMPRESSION, Directory, FILL_ORDER, IMAGE_LENGTH, IMAGE_WIDTH, Layout, PHOTOMETRIC,
    PLANAR_CONFIGURATION, PREDICTOR, SAMPLE_FORMAT, SAMPLES_PER_PIXEL, TILE_LENGTH, TILE_OFFSETS, TILE_WIDTH, View,
};

const LERC_PARAMETERS: u16 = 50674;
/// Numbers of compressions: that of LERC, which the crate does not decode, and that of JPEG.
const LERC: u64 = 34887;
const JPEG: u64 = 7;

/// The most bytes of a strip or tile once it is decoded.
const MAX_CHUNK_BYTES: u64 = 256 << 20;
/// The most bytes of a band of strips or tiles that lie beside each other.
const MAX_BAND_BYTES: u64 = 1 << 30;

/// What to do about pieces that cannot be read.
pub(super) const REMEDY: &str = "convert it first, with `gdal_translate -co COMPRESS=DEFLATE`";

/// What decodes an image.
pub(super) type ViewDecoder = Decoder<BufReader<View<File>>>;

/// The rows of an image.
pub(super) struct TiffRows {
    path: PathBuf,
    pub decoder: ViewDecoder,
    /// Columns and rows of the image.
    pub size: [u32; 2],
    /// Columns and rows of a strip or tile.
    chunk: [u32; 2],
    samples: Samples,
    /// How many bytes each chunk has in the file: none where everything is without data.
    stored: Vec<u64>,
    /// The rows of the band, as numbers; a band is read when its first row is asked for.
    band: Vec<f64>,
    /// Number of the band.
    current: Option<u32>,
    /// What stands where nothing is stored.
    pub empty: f64,
    lerc: Option<Lerc>,
}

/// Which samples of a chunk are read.
#[derive(Clone, Copy)]
struct Samples {
    /// How many a pixel has in a chunk, and which of them is wanted.
    each: usize,
    wanted: usize,
    /// Columns of a chunk, also beyond the image.
    stride: usize,
    /// The number of the first chunk with wanted samples.
    first_chunk: usize,
    /// Bits of a sample where these fill no whole numbers: the crate gives the bytes of each row.
    packed: Option<Bits>,
}

/// Samples that share bytes.
#[derive(Clone, Copy)]
struct Bits {
    count: usize,
    layout: Layout,
}

/// Of strips or tiles in LERC.
struct Lerc {
    /// Where each is in the file.
    offsets: Vec<u64>,
    packing: Packing,
    /// Columns and rows of each. The last strip has fewer rows; tiles are whole.
    size: [u32; 2],
    are_tiles: bool,
}

impl TiffRows {
    /// The samples of an image with a number, of those that each pixel has.
    pub fn open(path: &Path, image: &Directory, sample: usize) -> Parsed<Self> {
        let refuse = |problem: String| Err(grid_error(path, &problem));
        let get = |tag, default| image.get(tag).unwrap_or(default);
        let [columns, rows] = image.size();
        let (bits, format) = (get(BITS_PER_SAMPLE, 1), get(SAMPLE_FORMAT, 1));
        let samples = get(SAMPLES_PER_PIXEL, 1).max(1) as usize;
        if get(FILL_ORDER, 1) == 2 {
            return refuse(format!("stores the bits of each byte in reverse order (FillOrder 2); {REMEDY}"));
        }
        let mut changes = vec![(PHOTOMETRIC, 1)];
        if format == 4 {
            // Samples of a kind that the writer did not know are integers to everybody.
            changes.push((SAMPLE_FORMAT, 1));
        }
        let is_packed = samples == 1 && !matches!(bits, 8 | 16 | 32 | 64);
        // Without an entry for the crate to read, samples have one bit, and it gives their bytes as they are.
        let is_patched = is_packed && image.get(BITS_PER_SAMPLE).is_some();
        if is_packed {
            let tile = get(TILE_WIDTH, 0);
            let is_plain = get(PREDICTOR, 1) == 1 && !matches!(get(COMPRESSION, 1), LERC | JPEG);
            if !matches!(format, 1 | 4) || bits > 31 || tile.saturating_mul(bits) % 8 != 0 || !is_plain {
                let problem = format!(
                    "has samples of {bits} bits, which can be read as integers without a sign, of one band, that are packed by no \
                     predictor; write it with `gdal_translate -co NBITS=16` or 32"
                );
                return refuse(problem);
            }
            changes.push((BITS_PER_SAMPLE, 8));
        }
        let is_tiled = image.has(TILE_OFFSETS);
        let short = |count: u64| u32::try_from(count).unwrap_or(u32::MAX);
        let bytes = |count: u64| if is_patched { count.saturating_mul(bits).div_ceil(8) } else { count };
        // Tiles are read as a whole, with what they have beyond the image: the crate stumbles over parts of rows in
        // LZW.
        let whole = [(IMAGE_WIDTH, TILE_WIDTH, columns), (IMAGE_LENGTH, TILE_LENGTH, rows)];
        for (image_tag, tile_tag, count) in whole {
            let is_width = image_tag == IMAGE_WIDTH;
            let stored = |count| short(if is_width { bytes(count) } else { count });
            match image.get(tile_tag).filter(|tile| is_tiled && *tile > 0) {
                Some(tile) => {
                    changes.push((image_tag, stored(count.div_ceil(tile).saturating_mul(tile))));
                    changes.push((tile_tag, stored(tile)));
                }
                None => changes.push((image_tag, stored(count))),
            }
        }
        let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
        let fault = |error| damaged(path, Location::Byte(0), error);
        let mut limits = Limits::default();
        limits.decoding_buffer_size = MAX_CHUNK_BYTES as usize;
        limits.intermediate_buffer_size = MAX_CHUNK_BYTES as usize;
        // The tables of strips and tiles: 8 bytes for each.
        limits.ifd_value_size = 64 << 20;
        let view = BufReader::new(image.view(file, &changes));
        let mut decoder = Decoder::new(view).map_err(fault)?.with_limits(limits);
        let size = [columns, rows].map(short);
        let (chunk_columns, chunk_rows) = decoder.chunk_dimensions();
        let tile_columns = image.get(TILE_WIDTH).map_or(chunk_columns, short);
        let chunk_columns = if is_tiled { tile_columns } else { size[0] };
        let chunk = [chunk_columns, if is_tiled { chunk_rows } else { chunk_rows.min(size[1]) }];
        let is_planar = get(PLANAR_CONFIGURATION, 1) == 2;
        let each = if is_planar { 1 } else { samples };
        // A chunk is decoded as a whole, and a band of them is kept.
        let of_sample = bits.div_ceil(8).saturating_mul(each as u64);
        let one = u64::from(chunk[0]).saturating_mul(u64::from(chunk[1])).saturating_mul(of_sample);
        let band = u64::from(size[0]).saturating_mul(u64::from(chunk[1])).saturating_mul(8);
        if one > MAX_CHUNK_BYTES || band > MAX_BAND_BYTES {
            return refuse(format!(
                "is stored in pieces of {} x {} samples, which have to be held as a whole; store it in smaller tiles, with \
                 `gdal_translate -co TILED=YES`",
                chunk[0], chunk[1]
            ));
        }
        let counts = match decoder.get_chunk_type() {
            ChunkType::Strip => Tag::StripByteCounts,
            ChunkType::Tile => Tag::TileByteCounts,
        };
        let stored = decoder.get_tag_u64_vec(counts).map_err(fault)?;
        let lerc = lerc_of(path, image, &mut decoder)?;
        let samples = Samples {
            each,
            wanted: if is_planar { 0 } else { sample },
            first_chunk: if is_planar { sample * (stored.len() / samples) } else { 0 },
            packed: is_packed.then_some(Bits { count: bits as usize, layout: image.layout }),
            stride: if is_tiled { chunk[0] as usize } else { size[0] as usize },
        };
        let path = path.to_owned();
        Ok(Self { path, decoder, size, chunk, samples, stored, band: vec![], current: None, empty: f64::NAN, lerc })
    }

    fn read_band(&mut self, band: u32) -> Parsed<()> {
        let [columns, rows] = self.size.map(|size| size as usize);
        let [across, down] = self.chunk.map(|size| size as usize);
        let band_rows = down.min(rows - band as usize * down);
        self.current = None;
        self.band.clear();
        self.band.resize(columns * band_rows, self.empty);
        let count = columns.div_ceil(across);
        for number in 0..count {
            let chunk = self.samples.first_chunk + band as usize * count + number;
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
            let samples = self.samples;
            let mut place = Band { band: &mut self.band, columns, first: number * across, width, samples };
            let is_whole = match decoded {
                DecodingResult::U8(bytes) if samples.packed.is_some() => place.unpack(&bytes),
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

/// How strips or tiles in LERC are stored, if they are.
fn lerc_of(path: &Path, image: &Directory, decoder: &mut ViewDecoder) -> Parsed<Option<Lerc>> {
    if image.get(COMPRESSION) != Some(LERC) {
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

impl Lerc {
    /// The heights of a strip or tile of a number of bytes, in a band of a number of rows.
    fn read(
        &self,
        file: &mut BufReader<View<File>>,
        number: usize,
        bytes: u64,
        rows: usize,
    ) -> Result<Vec<f64>, TiffError> {
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

/// Where a chunk goes in its band.
struct Band<'a> {
    band: &'a mut [f64],
    columns: usize,
    first: usize,
    width: usize,
    samples: Samples,
}

impl Band<'_> {
    /// Copies a chunk's samples; false if there are too few.
    fn put<T: Copy>(&mut self, values: &[T], number: impl Fn(T) -> f64) -> bool {
        let Samples { each, wanted, stride, .. } = self.samples;
        let rows = self.band.chunks_exact_mut(self.columns);
        let count = rows.len();
        for (row, values) in rows.zip(values.chunks_exact(stride * each)) {
            let values = values.iter().skip(wanted).step_by(each);
            for (height, &value) in row[self.first..self.first + self.width].iter_mut().zip(values) {
                *height = number(value);
            }
        }
        values.len() >= count * stride * each
    }

    /// The same of samples that share bytes: they follow each other bit by bit. Those of 24 bits are turned around in
    /// files whose numbers begin with their highest byte, as GDAL has it.
    fn unpack(&mut self, bytes: &[u8]) -> bool {
        let Some(Bits { count: bits, layout }) = self.samples.packed else { return false };
        let row_bytes = (self.samples.stride * bits).div_ceil(8);
        let rows = self.band.chunks_exact_mut(self.columns);
        let count = rows.len();
        for (row, bytes) in rows.zip(bytes.chunks_exact(row_bytes)) {
            for (column, height) in row[self.first..self.first + self.width].iter_mut().enumerate() {
                let [from, to] = [column * bits, (column + 1) * bits];
                let own = &bytes[from / 8..to.div_ceil(8)];
                let joined = own.iter().fold(0u64, |all, byte| all << 8 | u64::from(*byte));
                *height = match bits {
                    24 if !layout.is_little => {
                        own.iter().rev().fold(0u64, |all, byte| all << 8 | u64::from(*byte)) as f64
                    }
                    _ => (joined >> (to.div_ceil(8) * 8 - to) & ((1 << bits) - 1)) as f64,
                };
            }
        }
        bytes.len() >= count * row_bytes
    }
}
