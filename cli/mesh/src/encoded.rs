//! Images as PNG, JPEG and WebP.

use std::borrow::Cow;
use std::io::{self, Cursor};

use image::codecs::{jpeg::JpegEncoder, png::PngEncoder, webp::WebPEncoder};
use image::{ExtendedColorType, ImageEncoder};
use lodpack::decode::texels::Image;

use super::layers::Layer;

/// The quality of JPEG, of 100: what a file stores is coded once more.
const QUALITY: u8 = 90;

/// An encoded image, and its media type.
pub type Encoded = (Vec<u8>, &'static str);

/// In which formats images may be; PNG always is one.
#[derive(Clone, Copy, Debug)]
pub struct Formats {
    /// The layers that are JPEG if they are opaque.
    pub lossy: &'static [Layer],
    /// Whether what is smaller so is WebP without loss.
    pub has_webp: bool,
}

impl Formats {
    /// Everything is PNG.
    pub const PNG: Self = Self { lossy: &[], has_webp: false };
    /// Colours and emitted light may be JPEG. It blurs factors into each other, and rounds normals.
    pub const JPEG: Self = Self { lossy: &[Layer::Colour, Layer::Emissive], has_webp: false };
    /// Everything is WebP, or PNG where that is smaller.
    pub const WEBP: Self = Self { lossy: &[], has_webp: true };
}

/// The media type of WebP, for which glTF needs an extension.
pub const WEBP: &str = "image/webp";
/// The most texels along each side of a WebP.
const WEBP_SIDE: u32 = 1 << 14;

/// The texel that all of an image are.
pub fn even_texel(image: &Image<u8>) -> Option<&[u8]> {
    let mut texels = image.data.chunks_exact(usize::from(image.components.max(1)));
    let first = texels.next()?;
    texels.all(|texel| texel == first).then_some(first)
}

/// An image of a layer in one of these formats. Where all texels are the same, it has one.
///
/// # Errors
/// If it is too large for its format.
pub fn encoded(layer: Layer, image: &Image<u8>, formats: Formats) -> io::Result<Encoded> {
    let image = match even_texel(image) {
        Some(texel) => Cow::Owned(Image { size: [1, 1], data: texel.to_vec(), ..*image }),
        None => Cow::Borrowed(image),
    };
    let is_within = |longest: u32| image.size.iter().all(|&length| length <= longest);
    if image.components != 3 || !formats.lossy.contains(&layer) || !is_within(u16::MAX.into()) {
        let exact = (png(&image)?, "image/png");
        let webp = (formats.has_webp && is_within(WEBP_SIDE)).then(|| webp(&image)).transpose()?;
        return Ok(webp.filter(|webp| webp.len() < exact.0.len()).map_or(exact, |webp| (webp, WEBP)));
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
    let mut bytes = Cursor::new(vec![]);
    let [width, height] = image.size;
    PngEncoder::new(&mut bytes).write_image(&image.data, width, height, kind_of(image)).map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}

/// An image as WebP without loss.
fn webp(image: &Image<u8>) -> io::Result<Vec<u8>> {
    let mut bytes = vec![];
    let ([width, height], kind) = (image.size, kind_of(image));
    WebPEncoder::new_lossless(&mut bytes).write_image(&image.data, width, height, kind).map_err(io::Error::other)?;
    Ok(bytes)
}

fn kind_of(image: &Image<u8>) -> ExtendedColorType {
    if image.components == 4 { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_opaque_light_is_lossy_and_even_images_have_one_texel() {
        let mut image = Image::<u8>::filled([40, 30], &[10, 20, 30]);
        let decoded = |(bytes, _): &Encoded| image::load_from_memory(bytes).expect("an image");
        let even = encoded(Layer::Normal, &image, Formats::JPEG).unwrap();
        assert_eq!((decoded(&even).into_rgb8().into_raw(), even.1), (vec![10, 20, 30], "image/png"));
        image.data[0] = 200;
        let kind = |layer, image: &Image<u8>| encoded(layer, image, Formats::JPEG).unwrap().1;
        assert_eq!([Layer::Colour, Layer::Emissive].map(|layer| kind(layer, &image)), ["image/jpeg"; 2]);
        assert_eq!([Layer::Normal, Layer::Factors].map(|layer| kind(layer, &image)), ["image/png"; 2]);
        let exact = encoded(Layer::Colour, &image, Formats::PNG).unwrap();
        assert_eq!((decoded(&exact).into_rgb8().into_raw(), exact.1), (image.data.clone(), "image/png"));
        let mut clear = Image::<u8>::filled([40, 30], &[10, 20, 30, 40]);
        clear.data[3] = 0;
        assert_eq!(kind(Layer::Colour, &clear), "image/png");
    }

    #[test]
    fn webp_is_exact_and_there_where_it_is_smaller() {
        let smooth = |components: u8| {
            let value = |k: usize| (k / usize::from(components) / 7 % 200 + k % usize::from(components) * 13) as u8;
            let data = (0..64 * 48 * usize::from(components)).map(value).collect();
            Image { size: [64, 48], components, data }
        };
        for image in [smooth(3), smooth(4)] {
            let (bytes, kind) = encoded(Layer::Normal, &image, Formats::WEBP).unwrap();
            assert!(kind == WEBP && bytes.len() < png(&image).unwrap().len());
            let back = image::load_from_memory(&bytes).unwrap();
            let back = if image.components == 4 { back.into_rgba8().into_raw() } else { back.into_rgb8().into_raw() };
            assert_eq!(back, image.data);
        }
        // Too long for WebP.
        let mut long = Image::<u8>::filled([WEBP_SIDE + 1, 1], &[0; 3]);
        long.data[5] = 1;
        assert_eq!(encoded(Layer::Colour, &long, Formats::WEBP).unwrap().1, "image/png");
    }
}
