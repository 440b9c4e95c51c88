//! Images as PNG and JPEG.

use std::borrow::Cow;
use std::io::{self, Cursor};

use image::codecs::{jpeg::JpegEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use lodpack::decode::texels::Image;

use super::layers::Layer;

/// The quality of JPEG, of 100: what a file stores is coded once more.
const QUALITY: u8 = 90;

/// An encoded image, and its media type.
pub type Encoded = (Vec<u8>, &'static str);

/// The layers of an image format that loses something; all others are PNG.
pub type Lossy = &'static [Layer];

/// Everything is PNG.
pub const EXACT: Lossy = &[];
/// Colours and emitted light may be JPEG. It blurs factors into each other, and rounds normals.
pub const LIGHT: Lossy = &[Layer::Colour, Layer::Emissive];

/// The texel that all of an image are.
pub(crate) fn even_texel(image: &Image<u8>) -> Option<&[u8]> {
    let mut texels = image.data.chunks_exact(usize::from(image.components.max(1)));
    let first = texels.next()?;
    texels.all(|texel| texel == first).then_some(first)
}

/// An image of a layer: JPEG if the layer is among these, and opaque, else PNG. Where all texels are the same, it has one.
///
/// # Errors
/// If it is too large for its format.
pub fn encoded(layer: Layer, image: &Image<u8>, lossy: Lossy) -> io::Result<Encoded> {
    let image = match even_texel(image) {
        Some(texel) => Cow::Owned(Image { size: [1, 1], data: texel.to_vec(), ..*image }),
        None => Cow::Borrowed(image),
    };
    let longest = u32::from(u16::MAX);
    if image.components != 3 || !lossy.contains(&layer) || image.size.iter().any(|&length| length > longest) {
        return Ok((png(&image)?, "image/png"));
    }
    let mut bytes = vec![];
    let [width, height] = image.size;
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode(&image.data, width, height, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    Ok((bytes, "image/jpeg"))
}

/// An image as PNG.
///
/// # Errors
/// If it is too large for the format.
pub fn png(image: &Image<u8>) -> io::Result<Vec<u8>> {
    let kind = if image.components == 4 { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    let mut bytes = Cursor::new(vec![]);
    PngEncoder::new(&mut bytes)
        .write_image(&image.data, image.size[0], image.size[1], kind)
        .map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_opaque_light_is_lossy_and_even_images_have_one_texel() {
        let mut image = Image::<u8>::filled([40, 30], &[10, 20, 30]);
        let decoded = |(bytes, _): &Encoded| image::load_from_memory(bytes).expect("an image");
        let even = encoded(Layer::Normal, &image, LIGHT).unwrap();
        assert_eq!((decoded(&even).into_rgb8().into_raw(), even.1), (vec![10, 20, 30], "image/png"));
        image.data[0] = 200;
        let kind = |layer, image: &Image<u8>, lossy| encoded(layer, image, lossy).unwrap().1;
        assert_eq!([Layer::Colour, Layer::Emissive].map(|layer| kind(layer, &image, LIGHT)), ["image/jpeg"; 2]);
        assert_eq!([Layer::Normal, Layer::Factors].map(|layer| kind(layer, &image, LIGHT)), ["image/png"; 2]);
        let exact = encoded(Layer::Colour, &image, EXACT).unwrap();
        assert_eq!((decoded(&exact).into_rgb8().into_raw(), exact.1), (image.data.clone(), "image/png"));
        let mut clear = Image::<u8>::filled([40, 30], &[10, 20, 30, 40]);
        clear.data[3] = 0;
        assert_eq!(kind(Layer::Colour, &clear, LIGHT), "image/png");
    }
}
