//! What an image of relief holds: MTL has one keyword for both heights and normals.
//!
//! Exporters such as Blender's write normals there, others heights, and the text does not say which. The image does:
//! relative to a surface, normals have length 1 and point outwards, so few colours of all are theirs, and heights are
//! grey.

use glam::DVec3;

use lodpack_mesh::images::{
    EncodedImage, ImageSource, RowsOfPng, allowed_size, decode_image, decoding_bytes, rows_of_png, unreadable,
};
use lodpack_runtime::storage::memory::least_for_decoding;

/// What an image of relief holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Relief {
    /// Directions relative to the surface.
    Normals,
    /// Grey.
    Heights,
    /// Colours that are no directions.
    Colours,
}

/// At most this many rows are looked at, evenly spread.
const MOST_ROWS: u32 = 64;
/// By how much the length of a normal may be off 1. Averages are shorter, and codecs move colours: of 40 images of
/// normals in models of controllers, at least 99.7 % of the texels of each are within this, and of no image of colours
/// or factors beside them more than 9.1 %.
const OFF_LENGTH: f64 = 0.15;
/// Red, green and blue of grey differ by at most this many of 255: JPEG changes them.
const GREY: u8 = 8;
/// The share of texels that has to agree.
const NEARLY_ALL: f64 = 0.95;
/// How far normals lean to one side on average, of what they point outwards: less than .04 in all of those images. A
/// blue sky has their length, but leans.
const MOST_LEAN: f64 = 0.3;

/// Looks at some rows of an image.
///
/// Where decoding takes more than `memory` allows, it is said to hold normals: then the import refuses it as it refuses
/// other images, so that a file never depends on memory.
///
/// # Errors
/// What is wrong with the image.
pub(super) fn relief_of(image: &ImageSource, memory: u64) -> Result<Relief, String> {
    let open = || image.open(None).map_err(|error| unreadable(&error));
    let [width, height] = allowed_size(open()?)?;
    let (mut seen, step) = (Seen::default(), height.div_ceil(MOST_ROWS).max(1) as usize);
    if let Some(rows) = rows_of_png(open()?)? {
        seen.add_rows(rows, step)?;
    } else if least_for_decoding(decoding_bytes(open()?)?) > memory {
        return Ok(Relief::Normals);
    } else {
        let image = decode_image(open()?)?;
        for row in (0..height).step_by(step) {
            let row = image.crop_imm(0, row, width, 1).into_rgb8();
            row.pixels().for_each(|texel| seen.add(texel.0));
        }
    }
    Ok(seen.relief())
}

/// What texels were seen.
#[derive(Default)]
struct Seen {
    /// All but those that are black: nothing need be there.
    texels: u64,
    grey: u64,
    /// As long as normals, and outwards.
    normals: u64,
    /// Their sum.
    sum: DVec3,
}

impl Seen {
    /// Every `step`th row of a PNG.
    fn add_rows<R: EncodedImage>(&mut self, mut rows: RowsOfPng<R>, step: usize) -> Result<(), String> {
        let (colours, depth) = rows.output_color_type();
        let (count, bytes) = (colours.samples(), if depth == png::BitDepth::Sixteen { 2 } else { 1 });
        let (mut row, mut number) = (vec![], 0);
        while rows.next_row(&mut row)? {
            if number % step == 0 {
                for texel in row.chunks_exact(count * bytes) {
                    // The first byte of a sample counts most.
                    let sample = |k: usize| texel.get(k * bytes).copied().unwrap_or(u8::MAX);
                    let colour = |k: usize| sample(if count < 3 { 0 } else { k });
                    self.add([0, 1, 2].map(colour));
                }
            }
            number += 1;
        }
        Ok(())
    }

    fn add(&mut self, [red, green, blue]: [u8; 3]) {
        let (least, most) = (red.min(green).min(blue), red.max(green).max(blue));
        if most == 0 {
            return;
        }
        self.texels += 1;
        if most - least <= GREY {
            self.grey += 1;
            return;
        }
        let direction = DVec3::from([red, green, blue].map(|value| f64::from(value) / 127.5 - 1.0));
        if direction.z >= 0.0 && (direction.length() - 1.0).abs() <= OFF_LENGTH {
            self.normals += 1;
            self.sum += direction;
        }
    }

    fn relief(&self) -> Relief {
        let are_nearly_all = |count: u64| count as f64 >= NEARLY_ALL * self.texels as f64;
        if are_nearly_all(self.grey) {
            Relief::Heights
        } else if are_nearly_all(self.normals) && self.sum.truncate().length() <= MOST_LEAN * self.sum.z {
            Relief::Normals
        } else {
            Relief::Colours
        }
    }
}
