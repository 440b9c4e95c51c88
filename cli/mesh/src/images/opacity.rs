//! Whether an image shows anything.

use super::{EncodedImage, decode_image, decoding_bytes, rows_of_png, unreadable};

/// What of an image says how opaque it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Opacity {
    /// Its alpha: what is below this is not there.
    Alpha(f32),
    /// Its alpha, or its brightness where all of it is opaque.
    Mask,
}

/// Whether no texel of an image is seen. What takes more than `memory` is not looked at, and counts as seen.
///
/// # Errors
/// What is wrong with the image.
pub fn shows_nothing(mut encoded: impl EncodedImage, opacity: Opacity, memory: u64) -> Result<bool, String> {
    let mut seen = Texels { opacity, is_clear: true, is_black: true };
    if let Some(mut rows) = rows_of_png(&mut encoded)? {
        let (colours, depth) = rows.output_color_type();
        let (count, bytes) = (colours.samples(), if depth == png::BitDepth::Sixteen { 2 } else { 1 });
        let has_alpha = matches!(colours, png::ColorType::GrayscaleAlpha | png::ColorType::Rgba);
        let (colours, mut row) = (if has_alpha { count - 1 } else { count }, vec![]);
        // Nearly all images end within their first rows.
        while seen.are_nothing() && rows.next_row(&mut row)? {
            for texel in row.chunks_exact(count * bytes) {
                // The first byte of a sample is enough to tell what is nearly nothing, or nearly all.
                let sample = |k: usize| texel.get(k * bytes).map_or(1.0, |&value| f32::from(value) / 255.0);
                let alpha = if has_alpha { sample(colours) } else { 1.0 };
                seen.add((0..colours).all(|k| sample(k) == 0.0), alpha);
            }
        }
        return Ok(seen.are_nothing());
    }
    encoded.rewind().map_err(|error| unreadable(&error))?;
    if decoding_bytes(&mut encoded)? > memory {
        return Ok(false);
    }
    encoded.rewind().map_err(|error| unreadable(&error))?;
    let image = decode_image(encoded)?;
    if matches!(opacity, Opacity::Alpha(_)) && !image.color().has_alpha() {
        return Ok(false);
    }
    for row in 0..image.height() {
        let row = image.crop_imm(0, row, image.width(), 1).into_rgba32f();
        row.pixels().for_each(|texel| seen.add(texel.0[..3] == [0.0; 3], texel.0[3]));
        if !seen.are_nothing() {
            break;
        }
    }
    Ok(seen.are_nothing())
}

/// What the texels so far have in common.
struct Texels {
    opacity: Opacity,
    /// None is seen by its alpha.
    is_clear: bool,
    /// All are opaque and black.
    is_black: bool,
}

impl Texels {
    fn add(&mut self, is_black: bool, alpha: f32) {
        let least = if let Opacity::Alpha(least) = self.opacity { least } else { 0.0 };
        self.is_clear &= alpha <= 0.0 || alpha < least;
        self.is_black &= is_black && alpha >= 1.0;
    }

    fn are_nothing(&self) -> bool {
        self.is_clear || self.opacity == Opacity::Mask && self.is_black
    }
}
