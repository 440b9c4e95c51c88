//! Images as inputs have them: encoded, in files or within them.

mod compression;
mod jpeg;
mod opacity;
mod png_rows;
mod problem;
pub mod tiff_directory;
mod ycbcr;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};

use compression::unread_tiff_compression;
pub use compression::{tiff_compression_name, unread_exr_compression};
pub use opacity::{Opacity, shows_nothing};
pub use png_rows::{RowsOfPng, rows_of_png};
use problem::{damaged, undecodable};
pub use problem::{shown_name, unreadable};
use tiff_directory::Directory;

/// Where the bytes of an encoded image are.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ImageSource {
    /// In a file, or in a range of one.
    File {
        /// The file.
        path: PathBuf,
        /// The bytes of the image; all where there is none.
        range: Option<Range<u64>>,
    },
    /// Here: they were written in the text of the input.
    Inline {
        /// The image's name for messages.
        name: String,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// In a file of the work directory, so that the parts of a job need no other files.
    Kept {
        /// The name of the file.
        file: String,
        /// The image's name for messages.
        name: String,
        /// Its size.
        bytes: u64,
        /// XXH3 hash of its content.
        xxh3: u64,
    },
}

impl ImageSource {
    /// The image's name for messages.
    pub fn name(&self) -> String {
        match self {
            Self::File { path, range: None } => shown_name(&path.display().to_string()),
            Self::File { path, range: Some(range) } => {
                format!("{} (bytes {} to {})", shown_name(&path.display().to_string()), range.start, range.end)
            }
            Self::Inline { name, .. } | Self::Kept { name, .. } => shown_name(name),
        }
    }
}

/// The most texels of an image.
pub const MAX_IMAGE_TEXELS: u64 = 1 << 28;

impl ImageSource {
    /// The encoded bytes as they are wanted, so that those of a large image are not in memory all at once. `folder` is
    /// the work directory, where it keeps images.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn open(&self, folder: Option<&Path>) -> io::Result<Box<dyn EncodedImage + '_>> {
        let (file, range) = match self {
            Self::Inline { bytes, .. } => return Ok(Box::new(Cursor::new(bytes))),
            Self::File { path, range } => (open_file(path)?, range.clone()),
            Self::Kept { file, .. } => (open_file(&folder.unwrap_or(Path::new("")).join(file))?, None),
        };
        let length = file.metadata()?.len();
        let range = range.unwrap_or(0..length);
        let end = range.end.min(length);
        Ok(Box::new(BufReader::with_capacity(1 << 16, Section { file, at: 0, range: range.start.min(end)..end })))
    }
}

/// Opens a file that is no folder, device or pipe: opening a pipe could block forever.
fn open_file(path: &Path) -> io::Result<File> {
    if std::fs::metadata(path)?.is_file() {
        return File::open(path);
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a folder, device or pipe, not a file: put an image there"))
}

/// A range of a file as a file of its own.
struct Section {
    file: File,
    /// What is read next, from the beginning of the range.
    at: u64,
    range: Range<u64>,
}

impl Read for Section {
    fn read(&mut self, piece: &mut [u8]) -> io::Result<usize> {
        let start = self.range.start.saturating_add(self.at);
        let most = self.range.end.saturating_sub(start).min(piece.len() as u64) as usize;
        self.file.seek(SeekFrom::Start(start))?;
        let read = self.file.read(&mut piece[..most])?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Section {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => (self.range.end - self.range.start).checked_add_signed(by),
        };
        self.at = at.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a place before the image"))?;
        Ok(self.at)
    }
}

/// An encoded image that is read from its beginning.
pub trait EncodedImage: BufRead + Seek {}

impl<R: BufRead + Seek> EncodedImage for R {}

/// What decodes an image, and its format.
fn decoder_of<'a>(
    mut encoded: impl EncodedImage + 'a,
) -> Result<(Option<ImageFormat>, Box<dyn ImageDecoder + 'a>), String> {
    let is_ycbcr = ycbcr::is_ycbcr(&mut encoded).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    if is_ycbcr {
        let decoder = ycbcr::YcbcrDecoder::new(encoded).map_err(|error| undecodable(&error))?;
        return Ok((Some(ImageFormat::Tiff), Box::new(decoder)));
    }
    let of_exr = unread_exr_compression(&mut encoded).ok().flatten();
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let compression = of_exr.or_else(|| unread_tiff_compression(&mut encoded));
    encoded.rewind().map_err(|error| unreadable(&error))?;
    if let Some(compression) = compression {
        return Err(format!("its compression {compression} is not read: save it with ZIP or Deflate compression"));
    }
    let reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| unreadable(&error))?;
    let format = reader.format();
    Ok((format, Box::new(reader.into_decoder().map_err(|error| undecodable(&error))?)))
}

/// Columns and rows that an encoded image declares.
///
/// # Errors
/// What is wrong with it.
pub fn image_size(mut encoded: impl EncodedImage) -> Result<[u32; 2], String> {
    let (format, decoder) = decoder_of(&mut encoded)?;
    let (width, height) = decoder.dimensions();
    drop(decoder);
    if width == 0 || height == 0 {
        return Err("it has no texels: export it again".into());
    }
    // A header that was written over must not cost the time and memory of what it declares. Every block of a JPEG takes
    // a bit; the other formats can have any number of texels in few bytes, or fail at their first missing row.
    let bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    if format == Some(ImageFormat::Jpeg) && bytes.saturating_mul(8 * JPEG_BLOCK) < texels_of([width, height]) {
        return Err(damaged(&format!("its {bytes} bytes cannot hold {width} x {height} texels")));
    }
    Ok([width, height])
}

/// Whether the numbers of an image have more than 8 bits.
///
/// # Errors
/// What is wrong with it.
pub fn is_finer_than_bytes(encoded: impl EncodedImage) -> Result<bool, String> {
    let colours = decoder_of(encoded)?.1.color_type();
    Ok(colours.bytes_per_pixel() > colours.channel_count())
}

/// By which step a lossy image was quantised when it was coded, of 255: what is lost is not worth coding again. None
/// of images of which nothing, or nobody knows what, was lost.
///
/// # Errors
/// What is wrong with it.
pub fn coded_step(mut encoded: impl EncodedImage) -> Result<Option<f64>, String> {
    jpeg::brightness_step(&mut encoded).map_err(|error| unreadable(&error))
}

/// Whether an image says how opaque each texel is.
///
/// # Errors
/// What is wrong with it.
pub fn has_opacity(encoded: impl EncodedImage) -> Result<bool, String> {
    Ok(decoder_of(encoded)?.1.color_type().has_alpha())
}

/// Texels of a block of a JPEG.
const JPEG_BLOCK: u64 = 64;

/// How many texels an image of a size has.
pub fn texels_of(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1])
}

/// The size of an image of at most [`MAX_IMAGE_TEXELS`].
///
/// # Errors
/// What is wrong with it.
pub fn allowed_size(encoded: impl EncodedImage) -> Result<[u32; 2], String> {
    let [width, height] = image_size(encoded)?;
    if texels_of([width, height]) > MAX_IMAGE_TEXELS {
        return Err(format!("it has {width} x {height} texels, more than {MAX_IMAGE_TEXELS}: make it smaller"));
    }
    Ok([width, height])
}

/// Decodes an image of at most [`MAX_IMAGE_TEXELS`]; its content says which format it has.
///
/// # Errors
/// What is wrong with it.
pub fn decode_image(mut encoded: impl EncodedImage) -> Result<DynamicImage, String> {
    let size = allowed_size(&mut encoded)?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    refuse_cut_jpeg(&mut encoded)?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    ycbcr::refuse_lying_pieces(&mut encoded)?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let whole = whole_tiles(&mut encoded);
    encoded.rewind().map_err(|error| unreadable(&error))?;
    if let Some((directory, changes)) = whole {
        let whole = decode(BufReader::new(directory.view(encoded, &changes)))?;
        return Ok(whole.crop_imm(0, 0, size[0], size[1]));
    }
    decode(encoded)
}

/// What has to be changed in a TIFF so that it has its last tiles as a whole, if these are in LZW: the decoder stumbles
/// over parts of their rows.
fn whole_tiles(encoded: &mut impl EncodedImage) -> Option<(Directory, [(u16, u32); 2])> {
    const LZW: u64 = 5;
    if !tiff_directory::is_tiff(encoded.fill_buf().ok()?) {
        return None;
    }
    let mut all = vec![];
    let _ = Directory::read_all(encoded, &mut all);
    let first = all.into_iter().next()?;
    let [columns, rows] = first.size();
    let tile = [tiff_directory::TILE_WIDTH, tiff_directory::TILE_LENGTH].map(|tag| first.get(tag));
    let [Some(width @ 1..), Some(length @ 1..)] = tile else { return None };
    let is_even = columns % width == 0 && rows % length == 0;
    if first.get(tiff_directory::COMPRESSION) != Some(LZW) || is_even {
        return None;
    }
    let padded = |count: u64, tile: u64| u32::try_from(count.div_ceil(tile).checked_mul(tile)?).ok();
    let size = [padded(columns, width)?, padded(rows, length)?];
    let is_small = texels_of(size) <= MAX_IMAGE_TEXELS;
    let changes = [(tiff_directory::IMAGE_WIDTH, size[0]), (tiff_directory::IMAGE_LENGTH, size[1])];
    is_small.then_some((first, changes))
}

/// Decodes an image whose size has been looked at.
fn decode(encoded: impl EncodedImage) -> Result<DynamicImage, String> {
    let (_, mut decoder) = decoder_of(encoded)?;
    let (columns, rows) = decoder.dimensions();
    let mut limits = image::Limits::default();
    // The largest texel has four numbers of 32 bits.
    limits.max_alloc = Some(texels_of([columns, rows]) * 16 + (16 << 20));
    limits.reserve(decoder.total_bytes()).map_err(|error| undecodable(&error))?;
    decoder.set_limits(limits).map_err(|error| undecodable(&error))?;
    DynamicImage::from_decoder(decoder).map_err(|error| undecodable(&error))
}

/// Refuses a JPEG that has no end: its decoder fills what is missing with grey, and says nothing.
///
/// # Errors
/// That it is damaged.
pub fn refuse_cut_jpeg(encoded: &mut impl EncodedImage) -> Result<(), String> {
    let is_jpeg = encoded.fill_buf().map_err(|error| unreadable(&error))?.starts_with(b"\xFF\xD8");
    if is_jpeg && jpeg::is_cut(encoded).map_err(|error| unreadable(&error))? {
        return Err(damaged("its data end too early"));
    }
    Ok(())
}

/// The most memory that decoding an image takes, until its texels are where they stay; 0 for what is decoded row by
/// row.
///
/// # Errors
/// What is wrong with it.
pub fn decoding_bytes(mut encoded: impl EncodedImage) -> Result<u64, String> {
    if rows_of_png(&mut encoded)?.is_some() {
        return Ok(0);
    }
    let encoded_bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let is_progressive = jpeg::is_progressive(&mut encoded).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let is_ycbcr = ycbcr::is_ycbcr(&mut encoded).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let (format, decoder) = decoder_of(encoded)?;
    let (width, height) = decoder.dimensions();
    let (colours, texels) = (decoder.color_type(), texels_of([width, height]));
    let decoded = u64::from(colours.bytes_per_pixel());
    let each = match (colours, format) {
        // All coefficients of a progressive image are there before the first row is: three of two bytes.
        (ColorType::Rgb8, Some(ImageFormat::Jpeg)) if is_progressive => decoded + 6,
        (ColorType::L8, Some(ImageFormat::Jpeg)) if is_progressive => decoded + 3,
        // As luma and chroma, too.
        (ColorType::Rgb8, _) if is_ycbcr => 2 * decoded,
        // Chroma is a quarter of luma.
        (ColorType::Rgb8, Some(ImageFormat::WebP)) => 2 * decoded,
        (ColorType::Rgb8, _) => decoded,
        (ColorType::L8 | ColorType::La8 | ColorType::Rgba8, _) => decoded + 4,
        // As four floats, too, and with what the decoder of EXR collects.
        (ColorType::Rgb32F | ColorType::Rgba32F, _) => decoded + 32,
        // Once as four numbers of 16 bits, beside what they come from, and what they become.
        _ => decoded.max(8) + 8,
    };
    // The decoder of JPEG keeps what it reads.
    Ok(encoded_bytes.saturating_add(each.saturating_mul(texels)))
}

/// The bytes below which an image may have one colour everywhere: no codec makes less of it where it has not.
fn most_bytes_of_one_colour(texels: u64) -> u64 {
    (1 << 14) + texels / 16
}

/// An image is looked at, however many bytes it has, if less than one texel in this many counts.
const SMALL_PART: u64 = 64;

/// Red, green, blue and alpha that all texels within some columns and rows have, of 65535. None where texels differ,
/// where the image has enough bytes that they certainly do, and where decoding takes more than `memory`.
///
/// # Errors
/// What is wrong with it.
pub fn only_colour(
    mut encoded: impl EncodedImage,
    [columns, rows]: [Range<u32>; 2],
    memory: u64,
) -> Result<Option<[u16; 4]>, String> {
    let texels = texels_of(image_size(&mut encoded)?);
    let bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let part = texels_of([&columns, &rows].map(|range| range.len() as u32));
    let is_worth_it = bytes <= most_bytes_of_one_colour(texels) || part.saturating_mul(SMALL_PART) < texels;
    if !is_worth_it || texels > MAX_IMAGE_TEXELS || part == 0 {
        return Ok(None);
    }
    if let Some(reader) = rows_of_png(&mut encoded)? {
        return only_colour_of_rows(reader, [columns, rows]);
    }
    encoded.rewind().map_err(|error| unreadable(&error))?;
    if decoding_bytes(&mut encoded)? > memory {
        return Ok(None);
    }
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let image = decode_image(encoded)?.crop_imm(columns.start, rows.start, columns.len() as u32, rows.len() as u32);
    let length = usize::from(image.color().bytes_per_pixel());
    let all = image.as_bytes();
    if matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_)) {
        // In linear light, other than all others.
        return Ok(None);
    }
    let is_one = all.chunks(length).all(|texel| Some(texel) == all.get(..length));
    Ok(is_one.then(|| image.crop_imm(0, 0, 1, 1).into_rgba16()).and_then(|image| Some(image.pixels().next()?.0)))
}

fn only_colour_of_rows<R: EncodedImage>(
    mut reader: RowsOfPng<R>,
    [columns, rows]: [Range<u32>; 2],
) -> Result<Option<[u16; 4]>, String> {
    let (colours, depth) = reader.output_color_type();
    let is_fine = depth == png::BitDepth::Sixteen;
    let length = colours.samples() * if is_fine { 2 } else { 1 };
    let (mut first, mut row): (Vec<u8>, Vec<u8>) = Default::default();
    // Nearly all images end within their first row.
    for number in 0..rows.end {
        if !reader.next_row(&mut row)? {
            break;
        }
        if number < rows.start {
            continue;
        }
        let mut texels = row.chunks(length).take(columns.end as usize).skip(columns.start as usize);
        if first.is_empty() {
            first.extend(texels.clone().next().unwrap_or_default());
        }
        if texels.any(|texel| texel != first.as_slice()) {
            return Ok(None);
        }
    }
    let samples: Vec<u16> = match is_fine {
        true => first.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect(),
        false => first.iter().map(|&value| 257 * u16::from(value)).collect(),
    };
    Ok(Some(match *samples.as_slice() {
        [grey] => [grey, grey, grey, u16::MAX],
        [grey, alpha] => [grey, grey, grey, alpha],
        [red, green, blue] => [red, green, blue, u16::MAX],
        [red, green, blue, alpha] => [red, green, blue, alpha],
        _ => return Ok(None),
    }))
}

#[cfg(test)]
mod tests;
