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
