//! Images as inputs have them: encoded, in files or within them.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};

/// Where the bytes of an encoded image are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
            Self::File { path, range: None } => path.display().to_string(),
            Self::File { path, range: Some(range) } => {
                format!("{} (bytes {} to {})", path.display(), range.start, range.end)
            }
            Self::Inline { name, .. } | Self::Kept { name, .. } => name.clone(),
        }
    }
}

/// The most texels of an image.
pub const MAX_IMAGE_TEXELS: u64 = 1 << 28;

impl ImageSource {
    /// The encoded bytes as they are wanted, so that those of a large image are not in memory all at once. `folder` is the work
    /// directory, where it keeps images.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn open(&self, folder: Option<&Path>) -> io::Result<Box<dyn EncodedImage + '_>> {
        let (file, range) = match self {
            Self::Inline { bytes, .. } => return Ok(Box::new(Cursor::new(bytes))),
            Self::File { path, range } => (File::open(path)?, range.clone()),
            Self::Kept { file, .. } => (File::open(folder.unwrap_or(Path::new("")).join(file))?, None),
        };
        let length = file.metadata()?.len();
        let range = range.unwrap_or(0..length);
        let end = range.end.min(length);
        Ok(Box::new(BufReader::with_capacity(1 << 16, Section { file, at: 0, range: range.start.min(end)..end })))
    }
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

/// Columns and rows that an encoded image declares.
///
/// # Errors
/// What is wrong with it.
pub fn image_size(encoded: impl EncodedImage) -> Result<[u32; 2], String> {
    let reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| error.to_string())?;
    let (width, height) = reader.into_dimensions().map_err(|error| error.to_string())?;
    if width == 0 || height == 0 {
        return Err("it has no texels".into());
    }
    Ok([width, height])
}

/// How many texels an image of a size has.
pub fn texels_of(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1])
}

/// Decodes an image of at most [`MAX_IMAGE_TEXELS`]; its content says which format it has.
///
/// # Errors
/// What is wrong with it.
pub fn decode_image(mut encoded: impl EncodedImage) -> Result<DynamicImage, String> {
    let [width, height] = image_size(&mut encoded)?;
    if texels_of([width, height]) > MAX_IMAGE_TEXELS {
        return Err(format!("it has {width} x {height} texels, more than {MAX_IMAGE_TEXELS}"));
    }
    encoded.rewind().map_err(|error| error.to_string())?;
    let mut reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| error.to_string())?;
    let mut limits = image::Limits::default();
    // The largest texel has four numbers of 32 bits.
    limits.max_alloc = Some(texels_of([width, height]) * 16 + (16 << 20));
    reader.limits(limits);
    reader.decode().map_err(|error| error.to_string())
}

/// The rows of a PNG. None of what has to be decoded as a whole: interlaced ones, and other formats.
///
/// # Errors
/// What is wrong with it.
pub fn rows_of_png<R: EncodedImage>(mut encoded: R) -> Result<Option<png::Reader<R>>, String> {
    const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
    let start = encoded.fill_buf().map_err(|error| error.to_string())?;
    if !start.starts_with(SIGNATURE) {
        return Ok(None);
    }
    let mut decoder = png::Decoder::new(encoded);
    decoder.set_transformations(png::Transformations::EXPAND);
    let reader = decoder.read_info().map_err(|error| error.to_string())?;
    Ok((!reader.info().interlaced).then_some(reader))
}

/// The most memory that decoding an image takes, until its texels are where they stay; 0 for what is decoded row by row.
///
/// # Errors
/// What is wrong with it.
pub fn decoding_bytes(mut encoded: impl EncodedImage) -> Result<u64, String> {
    let problem = |error: &dyn std::error::Error| error.to_string();
    if rows_of_png(&mut encoded)?.is_some() {
        return Ok(0);
    }
    let encoded_bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| problem(&error))?;
    encoded.rewind().map_err(|error| problem(&error))?;
    let is_progressive = is_progressive_jpeg(&mut encoded).map_err(|error| problem(&error))?;
    encoded.rewind().map_err(|error| problem(&error))?;
    let reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| problem(&error))?;
    let format = reader.format();
    let decoder = reader.into_decoder().map_err(|error| problem(&error))?;
    let (width, height) = decoder.dimensions();
    let (colours, texels) = (decoder.color_type(), texels_of([width, height]));
    let decoded = u64::from(colours.bytes_per_pixel());
    let each = match (colours, format) {
        // All coefficients of a progressive image are there before the first row is: three of two bytes.
        (ColorType::Rgb8, Some(ImageFormat::Jpeg)) if is_progressive => decoded + 6,
        (ColorType::L8, Some(ImageFormat::Jpeg)) if is_progressive => decoded + 3,
        // Chroma is a quarter of luma.
        (ColorType::Rgb8, Some(ImageFormat::WebP)) => 2 * decoded,
        (ColorType::Rgb8, _) => decoded,
        (ColorType::L8 | ColorType::La8 | ColorType::Rgba8, _) => decoded + 4,
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

/// An image of which less than one texel in so many counts is looked at, however many bytes it has.
const SMALL_PART: u64 = 64;

/// Red, green, blue and alpha that all texels within some columns and rows have, of 65535. None where texels differ, where the image has
/// so many bytes that they certainly do, and where decoding takes more than `memory`.
///
/// # Errors
/// What is wrong with it.
pub fn only_colour(
    mut encoded: impl EncodedImage,
    [columns, rows]: [Range<u32>; 2],
    memory: u64,
) -> Result<Option<[u16; 4]>, String> {
    let texels = texels_of(image_size(&mut encoded)?);
    let bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| error.to_string())?;
    encoded.rewind().map_err(|error| error.to_string())?;
    let part = texels_of([&columns, &rows].map(|range| range.len() as u32));
    let is_worth_it = bytes <= most_bytes_of_one_colour(texels) || part.saturating_mul(SMALL_PART) < texels;
    if !is_worth_it || texels > MAX_IMAGE_TEXELS || part == 0 {
        return Ok(None);
    }
    if let Some(reader) = rows_of_png(&mut encoded)? {
        return only_colour_of_rows(reader, [columns, rows]);
    }
    encoded.rewind().map_err(|error| error.to_string())?;
    if decoding_bytes(&mut encoded)? > memory {
        return Ok(None);
    }
    encoded.rewind().map_err(|error| error.to_string())?;
    let image = decode_image(encoded)?.crop_imm(columns.start, rows.start, columns.len() as u32, rows.len() as u32);
    let length = usize::from(image.color().bytes_per_pixel());
    let all = image.as_bytes();
    let is_one = all.chunks(length).all(|texel| Some(texel) == all.get(..length));
    Ok(is_one.then(|| image.crop_imm(0, 0, 1, 1).into_rgba16()).and_then(|image| Some(image.pixels().next()?.0)))
}

fn only_colour_of_rows<R: EncodedImage>(
    mut reader: png::Reader<R>,
    [columns, rows]: [Range<u32>; 2],
) -> Result<Option<[u16; 4]>, String> {
    let (colours, depth) = reader.output_color_type();
    let is_fine = depth == png::BitDepth::Sixteen;
    let length = colours.samples() * if is_fine { 2 } else { 1 };
    let mut first: Vec<u8> = vec![];
    // Nearly all images end within their first row.
    for number in 0..rows.end {
        let Some(row) = reader.next_row().map_err(|error| error.to_string())? else { break };
        if number < rows.start {
            continue;
        }
        let mut texels = row.data().chunks(length).take(columns.end as usize).skip(columns.start as usize);
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

/// Whether the first frame of a JPEG is progressive.
fn is_progressive_jpeg(encoded: &mut impl EncodedImage) -> io::Result<bool> {
    /// The markers of frames are 0xC0 to 0xCF, but for three of tables.
    const OTHERS: [u8; 3] = [0xC4, 0xC8, 0xCC];
    let mut two = [0; 2];
    encoded.read_exact(&mut two)?;
    if two != [0xFF, 0xD8] {
        return Ok(false);
    }
    loop {
        encoded.read_exact(&mut two)?;
        let [0xFF, marker] = two else { return Ok(false) };
        if (0xC0..=0xCF).contains(&marker) && !OTHERS.contains(&marker) {
            return Ok(marker & 3 == 2);
        }
        encoded.read_exact(&mut two)?;
        encoded.seek_relative(i64::from(u16::from_be_bytes(two)).max(2) - 2)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_format(image: &DynamicImage, format: ImageFormat) -> u64 {
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).unwrap();
        bytes.rewind().unwrap();
        let encoded = bytes.get_ref().len() as u64;
        decoding_bytes(bytes).unwrap().saturating_sub(encoded)
    }

    #[test]
    fn what_is_decoded_as_a_whole_is_counted_by_format() {
        let image = DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(40, 30, image::Rgb([1, 2, 3])));
        assert_eq!(of_format(&image, ImageFormat::Png), 0);
        assert_eq!(of_format(&image.to_rgba16().into(), ImageFormat::Png), 0);
        assert_eq!(of_format(&image, ImageFormat::Jpeg), 3 * 1200);
        assert_eq!(of_format(&image.to_rgba8().into(), ImageFormat::Tiff), 8 * 1200);
        assert_eq!(of_format(&image.to_rgb16().into(), ImageFormat::Tiff), 16 * 1200);
    }

    #[test]
    fn images_of_one_colour_are_found_in_every_format() {
        let only = |image: &DynamicImage, format: ImageFormat| {
            let mut bytes = Cursor::new(vec![]);
            image.write_to(&mut bytes, format).unwrap();
            bytes.rewind().unwrap();
            only_colour(bytes, [0..image.width(), 0..image.height()], u64::MAX).unwrap()
        };
        let mut image = image::RgbaImage::from_pixel(90, 70, image::Rgba([40, 80, 120, 160]));
        let fine = [40, 80, 120, 160].map(|value| 257 * value);
        let opaque = [fine[0], fine[1], fine[2], u16::MAX];
        let one = DynamicImage::from(image.clone());
        assert_eq!(only(&one, ImageFormat::Png), Some(fine));
        assert_eq!(only(&one.to_rgba16().into(), ImageFormat::Png), Some(fine));
        assert_eq!(only(&one.to_rgb8().into(), ImageFormat::Png), Some(opaque));
        assert_eq!(only(&one.to_rgb8().into(), ImageFormat::WebP), Some(opaque));
        let grey = DynamicImage::ImageLuma8(image::GrayImage::from_pixel(300, 200, image::Luma([77])));
        assert_eq!(only(&grey, ImageFormat::Png), Some([77 * 257, 77 * 257, 77 * 257, u16::MAX]));
        assert_eq!(only(&grey, ImageFormat::Jpeg), Some([77 * 257, 77 * 257, 77 * 257, u16::MAX]));
        image[(89, 69)].0[3] = 161;
        let other = DynamicImage::from(image);
        for format in [ImageFormat::Png, ImageFormat::WebP] {
            assert_eq!(only(&other, format), None);
            // The rest of it is all alike.
            let mut bytes = Cursor::new(vec![]);
            other.write_to(&mut bytes, format).unwrap();
            bytes.rewind().unwrap();
            assert_eq!(only_colour(bytes, [0..90, 5..69], u64::MAX), Ok(Some(fine)));
        }
    }

    #[test]
    fn progressive_images_are_told_by_their_frame() {
        let is_progressive = |bytes: &[u8]| is_progressive_jpeg(&mut Cursor::new(bytes)).ok();
        // A comment of two letters, a table, and a frame.
        let with = |frame: u8| [&b"\xFF\xD8\xFF\xFE\0\x04ab\xFF\xC4\0\x02\xFF"[..], &[frame]].concat();
        assert_eq!(
            [0xC0, 0xC1, 0xC2].map(|frame| is_progressive(&with(frame))),
            [Some(false), Some(false), Some(true)]
        );
        assert_eq!(is_progressive(b"RIFF"), Some(false));
        assert_eq!(is_progressive(b"\xFF\xD8\xFF"), None);
    }
}
