//! Images over maps, and the way in which each is coded.

use super::{colours, map::LONGEST, values};
#[cfg(feature = "write")]
use super::{scaled, seen::Seen};
use crate::error::{Error, Result};

/// Values of texels, row after row, the components of a texel together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image<T> {
    /// Texels in a row, and rows.
    pub size: [u32; 2],
    /// Values of a texel, 1 to 4.
    pub components: u8,
    /// `size[0] * size[1] * components` values.
    pub data: Vec<T>,
}

impl<T: Copy + Default> Image<T> {
    /// An image of one value.
    pub fn filled(size: [u32; 2], texel: &[T]) -> Self {
        let count = size[0] as usize * size[1] as usize;
        Self { size, components: texel.len() as u8, data: texel.repeat(count) }
    }

    /// The values of a texel.
    ///
    /// # Panics
    /// Outside of the image.
    pub fn texel(&self, x: u32, y: u32) -> &[T] {
        let components = usize::from(self.components);
        let first = (y as usize * self.size[0] as usize + x as usize) * components;
        &self.data[first..first + components]
    }
}

impl Image<u8> {
    /// Decodes colours, or factors.
    ///
    /// # Errors
    /// If the bytes break a rule of the format.
    pub fn decode_colours(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Self> {
        check(size, components)?;
        let (&step, rest) = bytes.split_first().ok_or_else(|| Error::format("an image has no bytes"))?;
        if step > 0 {
            return colours::decode(rest, size, components, step);
        }
        Self::decode_even(rest, size, components)
    }

    /// An image of one colour, of which the bytes are given.
    pub(super) fn decode_even(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Self> {
        if bytes.len() != usize::from(components) {
            return Err(Error::format("an image of one colour does not have the bytes of one"));
        }
        Ok(Self::filled(size, bytes))
    }

    /// The colour of all texels that are used, if they have the same; black if none is.
    #[cfg(feature = "write")]
    pub(super) fn even_texel(&self, is_used: &[bool]) -> Option<&[u8]> {
        let components = usize::from(self.components);
        let mut used = self.data.chunks_exact(components).zip(is_used).filter(|&(_, &used)| used);
        let first = used.next().map_or(&[0; 4][..components], |(texel, _)| texel);
        used.all(|(texel, _)| texel == first).then_some(first)
    }
}

impl<T: Copy + Default + Into<f64>> Image<T> {
    /// The value at a place in texels, interpolated between the four nearest ones. Texel (x, y) has its centre at (x +
    /// 0.5, y + 0.5).
    pub fn interpolated(&self, place: [f64; 2]) -> [f64; 4] {
        let at = |axis: usize| {
            let most = f64::from(self.size[axis]) - 1.0;
            let x = (place[axis] - 0.5).clamp(0.0, most);
            let low = x.floor().min((most - 1.0).max(0.0));
            (low as u32, x - low)
        };
        let ((x, right), (y, down)) = (at(0), at(1));
        let [x1, y1] = [(x + 1).min(self.size[0] - 1), (y + 1).min(self.size[1] - 1)];
        let mut result = [0.0; 4];
        for (x, y, weight) in [
            (x, y, (1.0 - right) * (1.0 - down)),
            (x1, y, right * (1.0 - down)),
            (x, y1, (1.0 - right) * down),
            (x1, y1, right * down),
        ] {
            let texel = self.texel(x, y);
            result.iter_mut().zip(texel).for_each(|(sum, &value)| *sum += weight * value.into());
        }
        result
    }
}

impl Image<u16> {
    /// Decodes values that are no colours.
    ///
    /// # Errors
    /// If the bytes break a rule of the format.
    pub fn decode_values(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Self> {
        check(size, components)?;
        values::decode(bytes, size, components)
    }
}

pub(super) fn check(size: [u32; 2], components: u8) -> Result<()> {
    if size.contains(&0) || size.iter().any(|&length| length > LONGEST) || !(1..=4).contains(&components) {
        return Err(Error::format("an image has no texels or too many, or not one to four components"));
    }
    Ok(())
}

/// Codes colours of three or four components with a step of quantisation, or with a finer one where most of an image is
/// even; the fourth component is not transformed. Returns the streams of all scales. Texels that are not used may have
/// any value afterwards.
#[cfg(feature = "write")]
pub fn encode_image(image: &Image<u8>, is_used: &[bool], step: u8) -> ImageStreams {
    encode(image, is_used, None, step)
}

/// As [`encode_image`], of an image of which borders are known. Texels that are used, but not covered by a piece, are
/// right where borders are seen.
#[cfg(feature = "write")]
pub fn encode_seen_image(image: &Image<u8>, is_used: &[bool], seen: &Seen<'_>, step: u8) -> ImageStreams {
    encode(image, is_used, Some(seen), step)
}

/// The streams of an image in scales, the coarsest first.
#[cfg(feature = "write")]
pub type ImageStreams = [Vec<u8>; scaled::SCALES];

#[cfg(feature = "write")]
fn encode(image: &Image<u8>, is_used: &[bool], seen: Option<&Seen<'_>>, step: u8) -> ImageStreams {
    match image.even_texel(is_used) {
        Some(even) => [[&[0], even].concat(), vec![], vec![], vec![]],
        None => scaled::encode(image, is_used, seen, step.max(1)),
    }
}
