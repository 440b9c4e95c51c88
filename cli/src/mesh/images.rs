//! Images as inputs have them: encoded, in files or within them.

mod jpeg;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use image::error::{ImageFormatHint, UnsupportedErrorKind};
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};

use jpeg::check_jpeg;

/// Where the bytes of an encoded image are.
#[derive(Clone, Debug, Eq, Serialize, Deserialize)]
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

/// Models can name tens of thousands of images, each of which is looked for among the others. So paths are compared as bytes, after what
/// differs more often: component by component, as paths compare themselves, takes ten times as long.
impl PartialEq for ImageSource {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::File { path, range }, Self::File { path: other, range: others }) => {
                range == others && path.as_os_str() == other.as_os_str()
            }
            (Self::Inline { name, bytes }, Self::Inline { name: other, bytes: others }) => {
                bytes == others && name == other
            }
            (
                Self::Kept { file, name, bytes, xxh3 },
                Self::Kept { file: other_file, name: other_name, bytes: other_bytes, xxh3: other_xxh3 },
            ) => (file, name, bytes, xxh3) == (other_file, other_name, other_bytes, other_xxh3),
            _ => false,
        }
    }
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

/// A name of a file as messages show it: in one line, and without its middle where it is very long.
pub(crate) fn shown_name(name: &str) -> String {
    const MOST: usize = 200;
    let count = name.chars().count();
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    if count <= MOST {
        return name.chars().map(plain).collect();
    }
    let [start, end] = [0, count - MOST / 2].map(|skipped| name.chars().skip(skipped).take(MOST / 2).map(plain));
    start.chain("...".chars()).chain(end).collect()
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

/// What is wrong with an image that cannot be opened or read, and what to do.
pub(crate) fn unreadable(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file: put it there".into(),
        io::ErrorKind::UnexpectedEof => damaged("unexpected end of file"),
        _ => in_one_line(&error.to_string()),
    }
}

/// What is wrong with an image whose bytes are damaged, and what to do.
fn damaged(problem: &str) -> String {
    format!("it is damaged ({}): copy or export it again", in_one_line(problem))
}

/// What is wrong with an image that cannot be decoded, and what to do.
fn undecodable(error: &ImageError) -> String {
    match error {
        ImageError::Unsupported(problem) => match problem.kind() {
            UnsupportedErrorKind::Format(ImageFormatHint::Exact(format)) => unread_format(&format!("{format:?}")),
            UnsupportedErrorKind::Format(_) => unread_format("unknown"),
            _ => in_one_line(&error.to_string()),
        },
        ImageError::IoError(error) => unreadable(error),
        ImageError::Decoding(problem) => damaged(&problem.to_string()),
        other => in_one_line(&other.to_string()),
    }
}

fn unread_format(format: &str) -> String {
    format!("its format ({format}) is not read: convert it to PNG, JPEG, WebP or TIFF")
}

fn png_problem(error: &png::DecodingError) -> String {
    match error {
        png::DecodingError::IoError(error) => unreadable(error),
        png::DecodingError::Format(_) => damaged(&error.to_string()),
        other => in_one_line(&other.to_string()),
    }
}

/// Notes have one line each.
fn in_one_line(problem: &str) -> String {
    let words: Vec<&str> = problem.split_whitespace().collect();
    words.join(" ").trim_end_matches('.').to_owned()
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
pub fn image_size(mut encoded: impl EncodedImage) -> Result<[u32; 2], String> {
    let reader = ImageReader::new(&mut encoded).with_guessed_format().map_err(|error| unreadable(&error))?;
    let format = reader.format();
    let (width, height) = reader.into_dimensions().map_err(|error| undecodable(&error))?;
    if width == 0 || height == 0 {
        return Err("it has no texels: export it again".into());
    }
    // A header that was written over must not cost the time and memory of what it declares. Every block of a JPEG takes a bit; the other
    // formats can have any number of texels in few bytes, or fail at their first missing row.
    let bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    if format == Some(ImageFormat::Jpeg) && bytes.saturating_mul(8 * JPEG_BLOCK) < texels_of([width, height]) {
        return Err(damaged(&format!("its {bytes} bytes cannot hold {width} x {height} texels")));
    }
    Ok([width, height])
}

/// Texels of a block of a JPEG.
const JPEG_BLOCK: u64 = 64;

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
        return Err(format!("it has {width} x {height} texels, more than {MAX_IMAGE_TEXELS}: make it smaller"));
    }
    encoded.rewind().map_err(|error| unreadable(&error))?;
    refuse_damaged_jpeg(&mut encoded)?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let mut reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| unreadable(&error))?;
    let mut limits = image::Limits::default();
    // The largest texel has four numbers of 32 bits.
    limits.max_alloc = Some(texels_of([width, height]) * 16 + (16 << 20));
    reader.limits(limits);
    reader.decode().map_err(|error| undecodable(&error))
}

/// The decoder of JPEG says nothing of data that are missing.
fn refuse_damaged_jpeg(encoded: &mut impl EncodedImage) -> Result<(), String> {
    let start = encoded.fill_buf().map_err(|error| unreadable(&error))?;
    if !start.starts_with(b"\xFF\xD8") {
        return Ok(());
    }
    let mut bytes = vec![];
    encoded.read_to_end(&mut bytes).map_err(|error| unreadable(&error))?;
    check_jpeg(&bytes).map_err(damaged)
}

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

/// The most memory that decoding an image takes, until its texels are where they stay; 0 for what is decoded row by row.
///
/// # Errors
/// What is wrong with it.
pub fn decoding_bytes(mut encoded: impl EncodedImage) -> Result<u64, String> {
    if rows_of_png(&mut encoded)?.is_some() {
        return Ok(0);
    }
    let encoded_bytes = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let is_progressive = is_progressive_jpeg(&mut encoded).map_err(|error| unreadable(&error))?;
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let reader = ImageReader::new(encoded).with_guessed_format().map_err(|error| unreadable(&error))?;
    let format = reader.format();
    let decoder = reader.into_decoder().map_err(|error| undecodable(&error))?;
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

    /// Something that has many colours.
    fn encoded(format: ImageFormat) -> Vec<u8> {
        let texel = |x: u32, y: u32| image::Rgb([(x * x * 7 + y * 13) as u8, (x * 9 + y * y) as u8, 9]);
        let image = DynamicImage::ImageRgb8(image::ImageBuffer::from_fn(70, 50, texel));
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    /// Reads all rows of a PNG.
    fn rows(bytes: &[u8]) -> Result<u32, String> {
        let mut rows = rows_of_png(Cursor::new(bytes))?.expect("it is a PNG");
        let (mut row, mut count) = (vec![], 0);
        while rows.next_row(&mut row)? {
            count += 1;
        }
        Ok(count)
    }

    #[test]
    fn checksums_of_pngs_count() {
        let bytes = encoded(ImageFormat::Png);
        assert_eq!(rows(&bytes), Ok(50));
        let data = bytes.windows(4).position(|four| four == b"IDAT").unwrap();
        let length = u32::from_be_bytes(bytes[data - 4..data].try_into().unwrap()) as usize;
        let checksum = data + 4 + length;
        let mut damaged = bytes.clone();
        damaged[checksum] ^= 1;
        let problem = rows(&damaged).unwrap_err();
        assert!(problem.contains("it is damaged (CRC error") && problem.contains("export it again"), "{problem}");
        // The checksum of the rows themselves, under one of the chunk that fits.
        damaged = bytes.clone();
        damaged[checksum - 1] ^= 1;
        let fitting = crc32fast::hash(&damaged[data..checksum]).to_be_bytes();
        damaged[checksum..checksum + 4].copy_from_slice(&fitting);
        assert!(rows(&damaged).unwrap_err().contains("it is damaged"));
        // All rows are there, and nothing says that they are wrong.
        assert_eq!(rows(&bytes[..checksum]), Ok(50));
        assert_eq!(rows(&bytes[..checksum + 4]), Ok(50));
        assert!(rows(&bytes[..bytes.len() / 2]).unwrap_err().contains("it is damaged (unexpected end of file)"));
    }

    #[test]
    fn a_jpeg_that_is_cut_or_cannot_hold_its_texels_is_damaged() {
        let bytes = encoded(ImageFormat::Jpeg);
        assert!(decode_image(Cursor::new(&bytes)).is_ok());
        let problem = decode_image(Cursor::new(&bytes[..bytes.len() / 2])).unwrap_err();
        assert_eq!(problem, "it is damaged (its data end too early): copy or export it again");
        let mut large = bytes;
        let frame = large.windows(2).position(|two| two == [0xFF, 0xC0]).unwrap();
        large[frame + 5..frame + 9].copy_from_slice(&[0x3E, 0x80, 0x3E, 0x80]);
        let problem = image_size(Cursor::new(&large)).unwrap_err();
        assert!(problem.contains("bytes cannot hold 16000 x 16000 texels"), "{problem}");
    }

    #[test]
    fn formats_that_are_not_read_are_named_with_those_that_are() {
        for (start, format) in [(&b"GIF89a\x01\0\x01\0"[..], "Gif"), (b"BM", "Bmp"), (b"noise", "unknown")] {
            let problem = image_size(Cursor::new(start)).unwrap_err();
            assert_eq!(problem, format!("its format ({format}) is not read: convert it to PNG, JPEG, WebP or TIFF"));
        }
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Tiff] {
            let bytes = encoded(format);
            for end in 0..bytes.len().min(700) {
                let problem = image_size(Cursor::new(&bytes[..end])).err().unwrap_or_default();
                assert!(!problem.contains('\n'), "{problem}");
            }
        }
    }

    #[test]
    #[cfg(unix)]
    fn only_files_are_opened() {
        for path in ["/dev/zero", "/"] {
            let image = ImageSource::File { path: path.into(), range: None };
            let problem = image.open(None).err().map(|error| unreadable(&error));
            assert!(problem.is_some_and(|problem| problem.contains("not a file: put an image there")), "{path}");
        }
    }

    #[test]
    fn long_names_are_shown_without_their_middle() {
        assert_eq!(shown_name("a\nb\u{e9}.png"), "a b\u{e9}.png");
        let shown = shown_name(&format!("{}\u{e9}{}.png", "a".repeat(500), "b".repeat(500)));
        assert_eq!(shown, format!("{}...{}.png", "a".repeat(100), "b".repeat(96)));
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
