//! Images on their way to texels: those that a place has no memory for row by row, where their format allows it.

use std::io;

use image::DynamicImage;

use super::texels::Place;
use super::texture::{Meaning, Texels, little_endian, root, texels_of};
use crate::mesh::appearance::{EncodedImage, MAX_IMAGE_TEXELS};
use crate::mesh::srgb::linear_from_srgb;

/// The texels of a decoded image.
pub(super) fn from_whole(image: DynamicImage, meaning: Meaning, place: &Place) -> Result<Texels, String> {
    let is_opaque = meaning != Meaning::Transparent;
    let is_fine = !matches!(
        image,
        DynamicImage::ImageLuma8(_)
            | DynamicImage::ImageLumaA8(_)
            | DynamicImage::ImageRgb8(_)
            | DynamicImage::ImageRgba8(_)
    );
    let keep = |bytes: Vec<u8>| place.move_here(bytes).map_err(|error| error.to_string());
    Ok(if is_fine {
        let texel = |texel: &image::Rgba<u16>| {
            let [red, green, blue, alpha] = texel.0.map(|value| f32::from(value) / 65535.0);
            let light = |x: f32| if meaning == Meaning::Shares { x } else { linear_from_srgb(x) };
            little_endian(root([light(red), light(green), light(blue), if is_opaque { 1.0 } else { alpha }]))
        };
        let texels: Vec<[u8; 8]> = image.into_rgba16().pixels().map(texel).collect();
        Texels::Root(keep(texels.into_flattened())?)
    } else if meaning != Meaning::Shares && (is_opaque || !image.color().has_alpha()) {
        Texels::Opaque(keep(image.into_rgb8().into_raw())?)
    } else {
        let mut texels = image.into_rgba8().into_raw();
        if is_opaque {
            texels.as_chunks_mut().0.iter_mut().for_each(|[_, _, _, alpha]| *alpha = 255);
        }
        let texels = keep(texels)?;
        if meaning == Meaning::Shares { Texels::Shares(texels) } else { Texels::Encoded(texels) }
    })
}

/// The rows of a PNG of 8 bits; none of what has to be decoded as a whole.
pub(super) fn rows_of_png<R: EncodedImage>(mut encoded: R, size: [u32; 2]) -> Result<Option<png::Reader<R>>, String> {
    const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
    let start = encoded.fill_buf().map_err(|error| error.to_string())?;
    if !start.starts_with(SIGNATURE) || texels_of(size) > MAX_IMAGE_TEXELS {
        return Ok(None);
    }
    let mut decoder = png::Decoder::new(encoded);
    decoder.set_transformations(png::Transformations::EXPAND);
    let reader = decoder.read_info().map_err(|error| error.to_string())?;
    let is_simple = !reader.info().interlaced && reader.output_color_type().1 == png::BitDepth::Eight;
    Ok(is_simple.then_some(reader))
}

/// The texels of an image that is decoded row by row.
pub(super) fn from_rows<R: EncodedImage>(
    mut rows: png::Reader<R>,
    size: [u32; 2],
    meaning: Meaning,
    place: &Place,
) -> Result<Texels, String> {
    let colours = rows.output_color_type().0;
    let has_alpha = matches!(colours, png::ColorType::GrayscaleAlpha | png::ColorType::Rgba);
    let is_opaque = meaning != Meaning::Transparent;
    let is_plain = meaning != Meaning::Shares && (is_opaque || !has_alpha);
    let components = if is_plain { 3 } else { 4 };
    let texels = place.keep(texels_of(size) * components as u64, |push| -> Result<(), RowError> {
        let mut line = vec![];
        for _ in 0..size[1] {
            let row = rows.next_row().map_err(RowError::Image)?;
            let data = row.as_ref().map_or(&[][..], |row| row.data());
            line.clear();
            for texel in data.chunks_exact(colours.samples()) {
                let [red, green, blue, alpha] = match *texel {
                    [grey] => [grey, grey, grey, 255],
                    [grey, alpha] => [grey, grey, grey, alpha],
                    [red, green, blue] => [red, green, blue, 255],
                    [red, green, blue, alpha, ..] => [red, green, blue, alpha],
                    [] => [0; 4],
                };
                line.extend_from_slice(&[red, green, blue, if is_opaque { 255 } else { alpha }][..components]);
            }
            line.resize(size[0] as usize * components, 0);
            push(&line);
        }
        Ok(())
    });
    let texels = texels.map_err(|error| error.to_string())?;
    Ok(match meaning {
        _ if is_plain => Texels::Opaque(texels),
        Meaning::Shares => Texels::Shares(texels),
        _ => Texels::Encoded(texels),
    })
}

/// What goes wrong while rows are decoded and kept.
#[derive(Debug, thiserror::Error)]
enum RowError {
    #[error("{0}")]
    Image(png::DecodingError),
    #[error("{0}")]
    File(#[from] io::Error),
}
