//! Colours, normals and factors at four scales: blocks of 8 x 8 texels, transformed and quantised, of which the first
//! string has the means, and each further one the coefficients that double the number of texels along each side
//! (SPEC.md, "Images in scales").

mod bits;
mod code;
mod contexts;
#[cfg(feature = "write")]
mod encode;
mod known;
#[cfg(all(test, feature = "write"))]
mod tests;

use super::{
    binary::BitDecoder,
    image::{Image, check},
    map::halved,
    planes::{scaled, step_of, store},
    transform::inverse_of,
};
use crate::error::{Error, Result};
use code::Levels;
#[cfg(feature = "write")]
pub(super) use encode::encode;

/// Into how many strings an image is divided.
pub const SCALES: usize = 4;

impl Image<u8> {
    /// Decodes colours, or factors, from the first strings of an image whose size in full is given: one for an eighth
    /// of it along each side, up to four for all of it.
    ///
    /// # Errors
    /// If the strings break a rule of the format.
    pub fn decode_scaled<S: AsRef<[u8]>>(strings: &[S], size: [u32; 2], components: u8) -> Result<Self> {
        check(size, components)?;
        let [first, finer @ ..] = strings else { return Err(Error::format("an image has no bytes")) };
        if finer.len() >= SCALES {
            return Err(Error::format("an image has more than four scales"));
        }
        let shown = halved(size, (SCALES - strings.len()) as u8);
        let (&step, means) = first.as_ref().split_first().ok_or_else(|| Error::format("an image has no bytes"))?;
        if step == 0 {
            if finer.iter().any(|string| !string.as_ref().is_empty()) {
                return Err(Error::format("an image of one colour has finer scales"));
            }
            return Self::decode_even(means, shown, components);
        }
        let mut levels = Levels::new(size, components.into(), 1 << finer.len());
        let mut bits = BitDecoder::new(means);
        levels.code_means(&mut bits, true)?;
        bits.finish()?;
        for (scale, string) in (1..).zip(finer) {
            // Nothing is added.
            if string.as_ref().is_empty() {
                continue;
            }
            let mut bits = BitDecoder::new(string.as_ref());
            levels.code_band(&mut bits, scale)?;
            bits.finish()?;
        }
        shown_by(&levels, shown, step)
    }
}

/// The image that levels show.
fn shown_by(levels: &Levels, size: [u32; 2], step: u8) -> Result<Image<u8>> {
    let (count, side) = (levels.components, levels.side);
    let area = side * side;
    let mut image = Image { size, components: count as u8, data: vec![0; size[0] as usize * size[1] as usize * count] };
    let width = size[0] as usize;
    for block in 0..levels.columns * levels.rows {
        let Some(place) = levels.place(block) else { continue };
        let [left, top] = [block % levels.columns * side, block / levels.columns * side];
        let mut planes = [[0; 64]; 4];
        for (component, plane) in planes.iter_mut().enumerate().take(count) {
            let step = step_of(component, count, step);
            let own = &levels.values[place + component * area..][..area];
            for (coefficient, &level) in plane.iter_mut().zip(own) {
                *coefficient = scaled(level.into(), step)?;
            }
            inverse_of(&mut plane[..area], side);
        }
        let columns = side.min(width - left);
        for y in 0..side.min(size[1] as usize - top) {
            let start = ((top + y) * width + left) * count;
            let texels = image.data[start..start + columns * count].chunks_exact_mut(count);
            for (x, texel) in texels.enumerate() {
                store(texel, |component| planes[component][y * side + x]);
            }
        }
    }
    Ok(image)
}
