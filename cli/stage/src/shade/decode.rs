//! Images on their way to texels: row by row where their format allows it.

use image::DynamicImage;

use super::level::{Texels, little_endian, root};
use super::meaning::{Meaning, TextureError};
use super::texels::Place;
use lodpack_mesh::images::{EncodedImage, MAX_IMAGE_TEXELS, RowsOfPng, decode_image, rows_of_png, texels_of};
use lodpack_mesh::srgb::linear_from_srgb;
use lodpack_runtime::storage::WorkError;

/// Decodes an image of a size.
pub(super) fn decode(
    mut encoded: impl EncodedImage,
    size: [u32; 2],
    meaning: Meaning,
    place: &Place,
) -> Result<Texels, TextureError> {
    let rows = if texels_of(size) <= MAX_IMAGE_TEXELS { rows_of_png(&mut encoded)? } else { None };
    if let Some(rows) = rows {
        return from_rows(rows, size, meaning, place);
    }
    encoded.rewind().map_err(|error| error.to_string())?;
    let _one = place.is_file(3 * texels_of(size)).then(|| place.alone());
    Ok(from_whole(decode_image(encoded)?, meaning, place)?)
}

/// The texels of a decoded image.
fn from_whole(image: DynamicImage, meaning: Meaning, place: &Place) -> Result<Texels, WorkError> {
    let is_opaque = !meaning.has_alpha();
    let is_fine = !matches!(
        image,
        DynamicImage::ImageLuma8(_)
            | DynamicImage::ImageLumaA8(_)
            | DynamicImage::ImageRgb8(_)
            | DynamicImage::ImageRgba8(_)
    );
    let keep = |bytes: Vec<u8>| place.move_here(bytes);
    let is_light = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    Ok(if is_light {
        let image = image.into_rgba32f();
        let texels: Vec<[u8; 8]> = image.pixels().map(|texel| light_texel(texel.0, meaning)).collect();
        Texels::Root(keep(texels.into_flattened())?)
    } else if is_fine {
        let texels: Vec<[u8; 8]> = image.into_rgba16().pixels().map(|texel| fine_texel(texel.0, meaning)).collect();
        Texels::Root(keep(texels.into_flattened())?)
    } else if !meaning.is_linear() && (is_opaque || !image.color().has_alpha()) {
        Texels::Opaque(keep(image.into_rgb8().into_raw())?)
    } else {
        let mut texels = image.into_rgba8().into_raw();
        if is_opaque {
            texels.as_chunks_mut().0.iter_mut().for_each(|[_, _, _, alpha]| *alpha = 255);
        }
        let texels = keep(texels)?;
        if meaning.is_linear() { Texels::Shares(texels) } else { Texels::Encoded(texels) }
    })
}

/// The texels of a PNG, which is decoded row by row.
fn from_rows<R: EncodedImage>(
    mut rows: RowsOfPng<R>,
    size: [u32; 2],
    meaning: Meaning,
    place: &Place,
) -> Result<Texels, TextureError> {
    let (colours, depth) = rows.output_color_type();
    let has_alpha = matches!(colours, png::ColorType::GrayscaleAlpha | png::ColorType::Rgba);
    let (is_opaque, is_fine) = (!meaning.has_alpha(), depth == png::BitDepth::Sixteen);
    let is_plain = !is_fine && !meaning.is_linear() && (is_opaque || !has_alpha);
    let of_texel = match (is_fine, is_plain) {
        (true, _) => 8,
        (false, true) => 3,
        (false, false) => 4,
    };
    let texels = place.keep(texels_of(size) * of_texel as u64, |push| -> Result<(), TextureError> {
        let (mut line, mut data) = (vec![], vec![]);
        while rows.next_row(&mut data)? {
            if is_plain && colours == png::ColorType::Rgb {
                push(&data);
                continue;
            }
            line.clear();
            if is_fine {
                let number = |pair: &[u8; 2]| u16::from_be_bytes(*pair);
                for texel in data.as_chunks().0.chunks_exact(colours.samples()) {
                    line.extend(fine_texel(of_samples(texel, number, u16::MAX), meaning));
                }
            } else {
                for texel in data.chunks_exact(colours.samples()) {
                    let [red, green, blue, alpha] = of_samples(texel, |value| *value, 255);
                    line.extend_from_slice(&[red, green, blue, if is_opaque { 255 } else { alpha }][..of_texel]);
                }
            }
            push(&line);
        }
        Ok(())
    })?;
    Ok(match meaning.is_linear() {
        _ if is_fine => Texels::Root(texels),
        _ if is_plain => Texels::Opaque(texels),
        true => Texels::Shares(texels),
        false => Texels::Encoded(texels),
    })
}

/// Red, green, blue and alpha of the samples of a texel: grey or colours, with or without alpha.
#[inline(always)]
fn of_samples<S, T: Copy>(samples: &[S], number: impl Fn(&S) -> T, opaque: T) -> [T; 4] {
    match samples {
        [grey] => [number(grey), number(grey), number(grey), opaque],
        [grey, alpha] => [number(grey), number(grey), number(grey), number(alpha)],
        [red, green, blue] => [number(red), number(green), number(blue), opaque],
        [red, green, blue, alpha, ..] => [red, green, blue, alpha].map(number),
        [] => [opaque; 4],
    }
}

/// A texel of floats, which are in linear light, as [`Texels::Root`] has it. What is brighter than white is white.
fn light_texel(texel: [f32; 4], meaning: Meaning) -> [u8; 8] {
    let share = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
    let [red, green, blue, alpha] = texel.map(share);
    little_endian(root([red, green, blue, if meaning.has_alpha() { alpha } else { 1.0 }]))
}

/// A texel of 16 bits as [`Texels::Root`] has it.
fn fine_texel(texel: [u16; 4], meaning: Meaning) -> [u8; 8] {
    let [red, green, blue, alpha] = texel.map(|value| f32::from(value) / 65535.0);
    let light = |x: f32| if meaning.is_linear() { x } else { linear_from_srgb(x) };
    let alpha = if meaning.has_alpha() { alpha } else { 1.0 };
    little_endian(root([light(red), light(green), light(blue), alpha]))
}
