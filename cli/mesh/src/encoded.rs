//! Images as PNG, JPEG and WebP.

use std::borrow::Cow;
use std::io::{self, Cursor};

use image::codecs::{jpeg::JpegEncoder, png::PngEncoder, webp::WebPEncoder};
use image::{ExtendedColorType, ImageEncoder};
use lodpack::decode::texels::Image;
use serde::Serialize;

use super::layers::{Layer, Look};

/// The quality of JPEG, of 100: what a file stores is coded once more.
const QUALITY: u8 = 90;

/// An encoded image, and its media type.
pub type Encoded = (Vec<u8>, &'static str);

/// In which formats images may be; PNG always is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Formats {
    /// The layers that are JPEG if they are opaque, by [`Layer`]'s number.
    lossy: [bool; Layer::COUNT],
    /// Whether what takes no fewer bytes so is PNG all the same.
    is_smallest: bool,
    /// Whether what is smaller so is WebP without loss.
    has_webp: bool,
}

impl Formats {
    /// Everything is PNG.
    pub const PNG: Self = Self { lossy: [false; Layer::COUNT], is_smallest: true, has_webp: false };
    /// What is opaque is JPEG.
    pub const JPEG: Self = Self { lossy: [true; Layer::COUNT], is_smallest: false, has_webp: false };
    /// Everything is WebP, or PNG where that is smaller.
    pub const WEBP: Self = Self { has_webp: true, ..Self::PNG };

    /// What is opaque is JPEG where that takes fewer bytes, but for layers that a file holds without loss. Images of
    /// normals and factors are, too, as they are in most models that are published: at quality 90 and with whole
    /// chroma, normals full of grain were 1.5 to 2.1 degrees off (root mean square) and factors 1 to 2.7 of 255, for .4
    /// and .2 of the bytes of PNG.
    pub fn of(look: &Look) -> Self {
        let lossy = Layer::ALL.map(|layer| !look.is_exact(layer));
        Self { lossy, is_smallest: true, has_webp: false }
    }
}

/// Images that were written.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Written {
    /// Texels of all images.
    pub texels: u64,
    /// Bytes of all images.
    pub bytes: u64,
    /// How many of them are PNG.
    pub png: u32,
    /// How many are JPEG.
    pub jpeg: u32,
    /// How many are WebP.
    pub webp: u32,
}

impl Written {
    /// How many there are.
    pub fn count(&self) -> u32 {
        self.png + self.jpeg + self.webp
    }

    /// Adds an image.
    pub fn add(&mut self, image: &Image<u8>, (bytes, media_type): &Encoded) {
        self.bytes += bytes.len() as u64;
        self.texels += if even_texel(image).is_some() { 1 } else { image.size.iter().map(|&x| u64::from(x)).product() };
        match *media_type {
            WEBP => self.webp += 1,
            JPEG => self.jpeg += 1,
            _ => self.png += 1,
        }
    }

    /// Adds those of another mesh.
    pub fn add_all(&mut self, other: &Self) {
        self.texels += other.texels;
        self.bytes += other.bytes;
        (self.png, self.jpeg, self.webp) = (self.png + other.png, self.jpeg + other.jpeg, self.webp + other.webp);
    }
}

/// The media type of PNG.
const PNG: &str = "image/png";
/// The media type of JPEG.
const JPEG: &str = "image/jpeg";
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
    let exact = || png(&image).map(|bytes| (bytes, PNG));
    if image.components == 3 && formats.lossy[layer as usize] && is_within(u16::MAX.into()) {
        let lossy = (jpeg(&image)?, JPEG);
        // What has few colours is smaller without loss.
        let exact = formats.is_smallest.then(exact).transpose()?;
        return Ok(exact.filter(|exact| exact.0.len() <= lossy.0.len()).unwrap_or(lossy));
    }
    let exact = exact()?;
    let webp = (formats.has_webp && is_within(WEBP_SIDE)).then(|| webp(&image)).transpose()?;
    Ok(webp.filter(|webp| webp.len() < exact.0.len()).map_or(exact, |webp| (webp, WEBP)))
}

/// An opaque image as JPEG.
fn jpeg(image: &Image<u8>) -> io::Result<Vec<u8>> {
    let mut bytes = vec![];
    let [width, height] = image.size;
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode(&image.data, width, height, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    Ok(bytes)
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
    use lodpack::index::{ChannelInfo, ChannelKind};

    /// An image whose texels differ as those of photographs do.
    fn grainy(components: u8) -> Image<u8> {
        let mut state = 7_u32;
        let mut value = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let data = (0..40 * 30 * usize::from(components)).map(&mut value).collect();
        Image { size: [40, 30], components, data }
    }

    fn decoded((bytes, _): &Encoded) -> image::DynamicImage {
        image::load_from_memory(bytes).expect("an image")
    }

    /// What a file without loss looks like, and one with.
    fn looks() -> [Look; 2] {
        [true, false].map(|is_exact| {
            let channel = ChannelInfo {
                name: "colour".into(),
                kind: ChannelKind::Colour,
                is_exact,
                is_scaled: !is_exact,
                components: 3,
                low: 0.0,
                step: 1.0,
                bound: 0.0,
            };
            Look::of(&[channel], true).0
        })
    }

    #[test]
    fn only_what_is_opaque_is_lossy_and_even_images_have_one_texel() {
        let even = Image::<u8>::filled([40, 30], &[10, 20, 30]);
        let written = encoded(Layer::Normal, &even, Formats::JPEG).unwrap();
        assert_eq!(decoded(&written).into_rgb8().dimensions(), (1, 1));
        let written = encoded(Layer::Normal, &even, Formats::of(&Look::default())).unwrap();
        assert_eq!((decoded(&written).into_rgb8().into_raw(), written.1), (vec![10, 20, 30], PNG));
        let image = grainy(3);
        let kind = |layer, image: &Image<u8>| encoded(layer, image, Formats::JPEG).unwrap().1;
        assert_eq!(Layer::ALL.map(|layer| kind(layer, &image)), [JPEG; Layer::COUNT]);
        assert_eq!(Layer::ALL.map(|layer| kind(layer, &grainy(4))), [PNG; Layer::COUNT]);
        let exact = encoded(Layer::Colour, &image, Formats::PNG).unwrap();
        assert_eq!((decoded(&exact).into_rgb8().into_raw(), exact.1), (image.data.clone(), PNG));
    }

    #[test]
    fn what_is_exact_or_smaller_so_is_png() {
        let [exact, lossy] = looks().map(|look| Formats::of(&look));
        let kind = |image: &Image<u8>, formats| encoded(Layer::Colour, image, formats).unwrap().1;
        assert_eq!([exact, lossy].map(|formats| kind(&grainy(3), formats)), [PNG, JPEG]);
        assert_eq!(kind(&grainy(4), lossy), PNG);
        // Two colours with a sharp line between them.
        let mut halves = Image::<u8>::filled([40, 30], &[10, 20, 30]);
        halves.data[1800..].fill(200);
        let written = encoded(Layer::Colour, &halves, lossy).unwrap();
        assert_eq!((decoded(&written).into_rgb8().into_raw(), written.1), (halves.data, PNG));
    }

    #[test]
    fn what_was_written_is_counted() {
        let (mut written, mut bytes) = (Written::default(), 0);
        for (image, formats) in [(grainy(3), Formats::PNG), (grainy(3), Formats::JPEG), (grainy(4), Formats::JPEG)] {
            let encoded = encoded(Layer::Colour, &image, formats).unwrap();
            bytes += encoded.0.len() as u64;
            written.add(&image, &encoded);
        }
        assert_eq!(written, Written { texels: 3600, bytes, png: 2, jpeg: 1, webp: 0 });
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
