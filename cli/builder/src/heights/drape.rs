//! The image over heights: its tiles at all levels, each level averaged from the finer one.

use std::fs::File;
use std::path::Path;

use lodpack::decode::texels::Image;
use lodpack::heights::{CELLS, Drape, DrapeWriter};
use lodpack::write::{ImageStreams, encode_image};
use lodpack_import::raster::{HeightDrape, Pixels};
use lodpack_runtime::progress::Progress;
use rayon::prelude::*;

use super::{HeightsError, nameless};
use crate::pipeline::ColourQuality;

/// The sides of tiles, as logarithms: below the least, directories count, and above the most, pictures read far more
/// than they show.
const SIDES_LOG2: [u32; 2] = [7, 9];
/// Pixels along a side of the blocks that are coded together.
const BLOCK: usize = 8;
/// Pixels of a level that become one of the next.
const SHRUNK: usize = 8;

/// Pixels along a side of the squares that stand for an image, and how many there are at most.
const SQUARE: u32 = 128;
const SQUARES: u64 = 48;
/// The mean square of what is lost of a number, of 255, in an image that is good: that of 38 decibels.
const MOST_LOST: f64 = 10.3;
/// The finest step that is taken for that.
const LEAST_STEP: u8 = 3;

/// What was made of an image over heights.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct DrapeSummary {
    /// Texels in a row, and rows.
    pub size: [u64; 2],
    /// 3, or 4 with opacity.
    pub components: u8,
    /// By how much its numbers are quantised, of 255.
    pub step: u8,
    /// Bytes of the file that it takes.
    pub bytes: u64,
}

/// Codes an image, and returns the step with which it was quantised, too. What is coded waits in a file of `folder`.
pub(super) fn code(
    source: &HeightDrape,
    quality: ColourQuality,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(DrapeWriter<File>, u8), HeightsError> {
    if quality == ColourQuality::Lossless {
        return Err(HeightsError::Lossless);
    }
    let mut pixels = source.pixels()?;
    let step = match (quality, source.coded_step()) {
        (ColourQuality::Auto, None) => good_step(&pixels, quality.step_of_coded(None)),
        (_, coded) => quality.step_of_coded(coded),
    };
    let size = pixels.size.map(u64::from);
    progress.begin("image", size[0] * size[1]);
    let of_tile = CELLS as f64 / source.spacing[0].max(source.spacing[1]);
    let side_log2 = libm::log2(of_tile.clamp(1.0, 4096.0)).round() as u32;
    let side_log2 = side_log2.clamp(SIDES_LOG2[0], SIDES_LOG2[1]) as u8;
    let drape = Drape { size, first: source.first, spacing: source.spacing, components: pixels.components, side_log2 };
    let mut writer = DrapeWriter::new(drape, nameless(folder)?)?;
    let side = 1 << side_log2;
    // Whether a tile shows anything, by rows of a level.
    let mut shown = shown_tiles(&pixels, side);
    for level in 0..drape.level_count() {
        if level > 0 {
            pixels = averaged(&pixels);
            shown = above(&shown);
        }
        let [columns, rows] = writer.groups(level);
        for group in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
            let tiles = writer.tiles(level, group);
            let coded = tiles.par_iter().map(|&([left, top], size)| {
                let is_shown = shown.get((left / side) as usize, (top / side) as usize);
                if level == 0 {
                    progress.advance(u64::from(size[0]) * u64::from(size[1]));
                }
                if is_shown {
                    streams_of(&pixels, [left as usize, top as usize], size, step)
                } else {
                    ImageStreams::default()
                }
            });
            let coded: Vec<ImageStreams> = coded.collect();
            writer.put(level, group, &coded)?;
        }
    }
    Ok((writer, step))
}

/// A step with which an image is as good as it should be: the usual one, or a finer one where there is much noise of
/// colour, of which more is lost. Some squares stand for all of it.
fn good_step(pixels: &Pixels, usual: u8) -> u8 {
    let [columns, rows] = pixels.size.map(|size| size.div_ceil(SQUARE));
    let count = u64::from(columns) * u64::from(rows);
    let squares: Vec<u64> = (0..count.min(SQUARES)).map(|k| k * count / count.min(SQUARES)).collect();
    let lost = |step: u8| -> f64 {
        let of_square = squares.par_iter().map(|square| {
            let at = [square % u64::from(columns), square / u64::from(columns)].map(|at| at as u32 * SQUARE);
            let size = [0, 1].map(|axis| (pixels.size[axis] - at[axis]).min(SQUARE));
            let place = at.map(|at| at as usize);
            let streams = streams_of(pixels, place, size, step);
            let Ok(found) = Image::decode_scaled(&streams, size, pixels.components) else { return [0; 2] };
            let mut sums = [0; 2];
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let at = (place[1] + y as usize) * pixels.size[0] as usize + place[0] + x as usize;
                    let own = &pixels.data[at * usize::from(pixels.components)..][..usize::from(pixels.components)];
                    if own.get(3).is_none_or(|&opacity| opacity == 255) {
                        let off = |k: usize| u64::from(own[k].abs_diff(found.texel(x, y)[k])).pow(2);
                        sums = [sums[0] + off(0) + off(1) + off(2), sums[1] + 3];
                    }
                }
            }
            sums
        });
        let [squares, count] = of_square.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        squares as f64 / count.max(1) as f64
    };
    (LEAST_STEP..=usual).rev().find(|&step| lost(step) <= MOST_LOST).unwrap_or(LEAST_STEP)
}

/// Flags in rows.
struct Flags {
    columns: usize,
    all: Vec<bool>,
}

impl Flags {
    fn get(&self, column: usize, row: usize) -> bool {
        self.all.get(row * self.columns + column).copied().unwrap_or(false)
    }
}

/// Which tiles of a side have a pixel that is not transparent.
fn shown_tiles(pixels: &Pixels, side: u64) -> Flags {
    let [columns, rows] = pixels.size.map(|size| u64::from(size).div_ceil(side) as usize);
    let mut flags = Flags { columns, all: vec![pixels.components == 3; columns * rows] };
    if pixels.components == 4 {
        let width = pixels.size[0] as usize;
        for (row, run) in pixels.data.as_chunks::<4>().0.chunks_exact(width).enumerate() {
            for (column, run) in run.chunks(side as usize).enumerate() {
                flags.all[row / side as usize * columns + column] |= run.iter().any(|pixel| pixel[3] > 0);
            }
        }
    }
    flags
}

/// Which tiles of the next level have one below that shows anything.
fn above(below: &Flags) -> Flags {
    let rows = below.all.len() / below.columns;
    let columns = below.columns.div_ceil(SHRUNK);
    let mut flags = Flags { columns, all: vec![false; columns * rows.div_ceil(SHRUNK)] };
    for (at, _) in below.all.iter().enumerate().filter(|(_, shown)| **shown) {
        flags.all[at / below.columns / SHRUNK * columns + at % below.columns / SHRUNK] = true;
    }
    flags
}

/// The next level: each pixel is the mean of those that it covers, of colours as screens show them and by opacity.
fn averaged(pixels: &Pixels) -> Pixels {
    let count = usize::from(pixels.components);
    let [width, height] = pixels.size.map(|size| size as usize);
    let size = pixels.size.map(|size| size.div_ceil(SHRUNK as u32));
    let row = |row: usize| {
        let rows = row * SHRUNK..((row + 1) * SHRUNK).min(height);
        (0..size[0] as usize).flat_map(move |column| {
            let columns = column * SHRUNK..((column + 1) * SHRUNK).min(width);
            let (mut sums, mut weight, mut most) = ([0_u64; 3], 0, 0);
            for row in rows.clone() {
                for pixel in pixels.data[(row * width + columns.start) * count..(row * width + columns.end) * count]
                    .chunks_exact(count)
                {
                    let opacity = pixel.get(3).map_or(255, |&opacity| u64::from(opacity));
                    sums.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += opacity * u64::from(value));
                    (weight, most) = (weight + opacity, most + 255);
                }
            }
            let mean = |sum: u64, weight: u64| ((sum + weight / 2).checked_div(weight)).unwrap_or(0) as u8;
            let [red, green, blue] = sums.map(|sum| mean(sum, weight));
            [red, green, blue, mean(255 * weight, most)].into_iter().take(count)
        })
    };
    let data = (0..size[1] as usize).into_par_iter().map(|number| row(number).collect::<Vec<u8>>());
    Pixels { size, components: pixels.components, data: data.collect::<Vec<_>>().concat() }
}

/// The streams of a tile.
fn streams_of(pixels: &Pixels, [left, top]: [usize; 2], size: [u32; 2], step: u8) -> ImageStreams {
    let (count, width) = (usize::from(pixels.components), pixels.size[0] as usize);
    let [columns, rows] = size.map(|size| size as usize);
    let run = |row: usize| &pixels.data[((top + row) * width + left) * count..][..columns * count];
    let mut image = Image { size, components: pixels.components, data: (0..rows).flat_map(run).copied().collect() };
    let mut is_used = vec![true; columns * rows];
    if count == 4 {
        for row in (0..rows).step_by(BLOCK) {
            for column in (0..columns).step_by(BLOCK) {
                fill_block(&mut image, &mut is_used, [column, row]);
            }
        }
    }
    encode_image(&image, &is_used, step)
}

/// Gives transparent pixels of a block the mean colour of the others, which makes their edge cheap; a block that is
/// transparent as a whole is not used.
fn fill_block(image: &mut Image<u8>, is_used: &mut [bool], [left, top]: [usize; 2]) {
    let [width, height] = image.size.map(|size| size as usize);
    let places =
        (top..(top + BLOCK).min(height)).flat_map(|y| (left..(left + BLOCK).min(width)).map(move |x| y * width + x));
    let (mut sums, mut weight) = ([0_u32; 3], 0);
    let pixels = image.data.as_chunks_mut::<4>().0;
    for place in places.clone() {
        let opacity = u32::from(pixels[place][3]);
        sums.iter_mut().zip(pixels[place]).for_each(|(sum, value)| *sum += opacity * u32::from(value));
        weight += opacity;
    }
    for place in places {
        is_used[place] = weight > 0;
        if weight > 0 && pixels[place][3] == 0 {
            (0..3).for_each(|k| pixels[place][k] = ((sums[k] + weight / 2) / weight) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_means_of_what_is_opaque() {
        let data = (0..10 * 9).flat_map(|at| if at % 10 < 4 { [9, 9, 9, 0] } else { [200, 100, 40, 255] }).collect();
        let next = averaged(&Pixels { size: [10, 9], components: 4, data });
        assert_eq!((next.size, next.data.len()), ([2, 2], 16));
        assert_eq!(next.data[..8], [200, 100, 40, 128, 200, 100, 40, 255]);
        assert_eq!(averaged(&next).data, [200, 100, 40, 192]);
    }

    #[test]
    fn tiles_that_show_nothing_have_no_streams_and_what_lies_above_something_has_some() {
        let mut pixels = Pixels { size: [40, 40], components: 4, data: vec![0; 40 * 40 * 4] };
        pixels.data[(39 * 40 + 2) * 4 + 3] = 1;
        let shown = shown_tiles(&pixels, 16);
        assert_eq!(shown.all, [false, false, false, false, false, false, true, false, false]);
        assert_eq!(above(&shown).all, [true]);
        let next = averaged(&pixels);
        assert!(!streams_of(&next, [0, 0], next.size, 7)[0].is_empty());
    }
}
