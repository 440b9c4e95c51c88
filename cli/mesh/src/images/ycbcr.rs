//! TIFF whose colours are luma and chroma, which the crate `image` does not decode: most orthophotos are such, packed
//! as JPEG.

use std::io::{self, BufReader, SeekFrom};

use image::error::{DecodingError, ImageFormatHint, LimitError, LimitErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType as TiffColours, TiffError};

use super::problem::{damaged, unreadable};
use super::{EncodedImage, JPEG_BLOCK, jpeg, texels_of, tiff_directory};

/// The number of JPEG among compressions.
const JPEG: u16 = 7;
/// Columns and rows that a JPEG may have beyond those of its tile: whole blocks of four luma and two chroma.
const PADDING: u32 = 32;

/// Whether an image is a TIFF of luma and chroma.
///
/// # Errors
/// If it cannot be read.
pub(super) fn is_ycbcr(mut encoded: impl EncodedImage) -> io::Result<bool> {
    let is_tiff = tiff_directory::is_tiff(encoded.fill_buf()?);
    let colours = |encoded| Decoder::new(encoded).and_then(|mut decoder| decoder.colortype());
    Ok(is_tiff && matches!(colours(encoded), Ok(TiffColours::YCbCr(8))))
}

/// Refuses pieces of JPEG in a TIFF that are not there, or that have more texels than their place or their bytes: their
/// decoder fills what is missing with grey, and allocates what each declares. Nothing is wrong with other images.
///
/// # Errors
/// That it is damaged.
pub(super) fn refuse_lying_pieces(encoded: &mut impl EncodedImage) -> Result<(), String> {
    let Ok(mut decoder) = Decoder::new(&mut *encoded) else { return Ok(()) };
    if decoder.get_tag_unsigned::<u16>(Tag::Compression).ok() != Some(JPEG) {
        return Ok(());
    }
    let tags = match decoder.get_chunk_type() {
        ChunkType::Strip => [Tag::StripOffsets, Tag::StripByteCounts],
        ChunkType::Tile => [Tag::TileOffsets, Tag::TileByteCounts],
    };
    let tables = tags.map(|tag| decoder.get_tag_u64_vec(tag));
    let [Ok(offsets), Ok(counts)] = tables else { return Err(damaged("it does not say where its pieces are")) };
    let chunk = decoder.chunk_dimensions();
    let length = encoded.seek(SeekFrom::End(0)).map_err(|error| unreadable(&error))?;
    let mut pieces: Vec<(u64, u64)> = offsets.into_iter().zip(counts).filter(|(_, bytes)| *bytes > 0).collect();
    // In the order of the file, which is read faster.
    pieces.sort_unstable();
    for (offset, bytes) in pieces {
        if offset.checked_add(bytes).is_none_or(|end| end > length) {
            return Err(damaged("its data end too early"));
        }
        encoded.seek(SeekFrom::Start(offset)).map_err(|error| unreadable(&error))?;
        let Some([columns, rows]) = jpeg::frame_size(encoded).ok().flatten() else {
            return Err(damaged("a piece of it is no JPEG"));
        };
        let is_larger = columns > chunk.0.saturating_add(PADDING) || rows > chunk.1.saturating_add(PADDING);
        if is_larger || bytes.saturating_mul(8 * JPEG_BLOCK) < texels_of([columns, rows]) {
            let problem = format!("a piece of it declares {columns} x {rows} texels, more than it can hold");
            return Err(damaged(&problem));
        }
    }
    Ok(())
}

/// Decodes a TIFF of luma and chroma to red, green and blue.
pub(super) struct YcbcrDecoder<R: EncodedImage> {
    decoder: Decoder<BufReader<R>>,
    size: (u32, u32),
}

impl<R: EncodedImage> YcbcrDecoder<R> {
    pub fn new(encoded: R) -> ImageResult<Self> {
        let mut decoder = Decoder::new(BufReader::new(encoded)).map_err(problem)?;
        let size = decoder.dimensions().map_err(problem)?;
        Ok(Self { decoder, size })
    }
}

impl<R: EncodedImage> ImageDecoder for YcbcrDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.size
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgb8
    }

    fn read_image(self, texels: &mut [u8]) -> ImageResult<()> {
        let mut limits = Limits::default();
        limits.decoding_buffer_size = texels.len();
        limits.intermediate_buffer_size = texels.len() + (16 << 20);
        limits.ifd_value_size = 64 << 20;
        let mut decoder = self.decoder.with_limits(limits);
        let DecodingResult::U8(stored) = decoder.read_image().map_err(problem)? else {
            return Err(problem(TiffError::LimitsExceeded));
        };
        if stored.len() != texels.len() {
            return Err(ImageError::Limits(LimitError::from_kind(LimitErrorKind::DimensionError)));
        }
        for (to, from) in texels.as_chunks_mut::<3>().0.iter_mut().zip(stored.as_chunks::<3>().0) {
            *to = rgb(*from);
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, texels: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(texels)
    }
}

/// Red, green and blue of luma and chroma (ITU-T T.871).
fn rgb([luma, blue, red]: [u8; 3]) -> [u8; 3] {
    let [luma, blue, red] = [f32::from(luma), f32::from(blue) - 128.0, f32::from(red) - 128.0];
    let all = [luma + 1.402 * red, luma - 0.344_136 * blue - 0.714_136 * red, luma + 1.772 * blue];
    all.map(|value| value.round().clamp(0.0, 255.0) as u8)
}

fn problem(error: TiffError) -> ImageError {
    match error {
        TiffError::IoError(error) => ImageError::IoError(error),
        TiffError::LimitsExceeded => ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory)),
        other => ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::Tiff), other)),
    }
}
