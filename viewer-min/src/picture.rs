//! A picture in memory: colours, roots and depths, and the differences between two pictures.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use image::{DynamicImage, Pixel, Rgba, RgbaImage};

/// A drawn picture, with pixels row after row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// The colours.
    pub colours: RgbaImage,
    /// The root at each pixel; none for the background.
    pub roots: Vec<Option<u32>>,
    /// Depth along the camera's axis, in world units; undefined for the background.
    pub depths: Vec<f32>,
}

/// The colour of the background.
pub const BACKGROUND: Rgba<u8> = Rgba([233, 237, 243, 255]);

impl Picture {
    /// Pixels that differ in depth, beyond single precision, or in whether they are covered. If two triangles are
    /// equally near, the one drawn first stays, and their depths may differ in the last digit.
    pub(crate) fn different_depths(&self, other: &Self) -> Vec<usize> {
        let same = |i: &usize| match (self.roots[*i], other.roots[*i]) {
            (None, None) => true,
            (Some(_), Some(_)) => (self.depths[*i] - other.depths[*i]).abs() <= 1e-6 * self.depths[*i],
            _ => false,
        };
        (0..self.roots.len()).filter(|i| !same(i)).collect()
    }
}

/// Whether each frame has a picture of its own at a path.
pub(crate) fn is_numbered(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.contains("{n}"))
}

/// The path of the picture of a frame: `{n}` in it becomes the number of the frame.
pub(crate) fn numbered(path: &Path, number: u64) -> Cow<'_, Path> {
    match path.to_str().filter(|_| is_numbered(path)) {
        Some(text) => PathBuf::from(text.replace("{n}", &format!("{number:05}"))).into(),
        None => path.into(),
    }
}

/// Pixels whose colours differ by more than `levels` of 255 levels.
pub fn different_colours(one: &RgbaImage, other: &RgbaImage, levels: u8) -> Vec<usize> {
    let differs = |(a, b): (&Rgba<u8>, &Rgba<u8>)| (0..3).any(|k| a[k].abs_diff(b[k]) > levels);
    let pixels = one.pixels().zip(other.pixels()).enumerate();
    pixels.filter(|&(_, pair)| differs(pair)).map(|(i, _)| i).collect()
}

/// The picture in pale colours, with some pixels in red and their surroundings in pink, so that single ones are
/// visible.
pub(crate) fn marked(image: &RgbaImage, pixels: &[usize]) -> RgbaImage {
    let mut marked = image.clone();
    marked.pixels_mut().for_each(|pixel| pixel.apply_without_alpha(|x| 128 + x / 2));
    let positions = || pixels.iter().map(|&pixel| (pixel as u32 % image.width(), pixel as u32 / image.width()));
    let crosses = positions().flat_map(|(x, y)| (0..7).flat_map(move |d| [(x + d, y + 3), (x + 3, y + d)]));
    for (x, y) in crosses {
        if let Some(pixel) = marked.get_pixel_mut_checked(x.wrapping_sub(3), y.wrapping_sub(3)) {
            *pixel = Rgba([255, 150, 170, 255]);
        }
    }
    positions().for_each(|(x, y)| marked.put_pixel(x, y, Rgba([220, 0, 0, 255])));
    marked
}

/// Writes a PNG without opacity.
pub fn save(image: RgbaImage, path: &Path) -> Result<()> {
    let image = DynamicImage::from(image).to_rgb8();
    image.save(path).with_context(|| format!("{} cannot be written", path.display()))
}

/// Reads a PNG.
pub fn load(path: &Path) -> Result<RgbaImage> {
    Ok(image::open(path).with_context(|| format!("{} cannot be read", path.display()))?.to_rgba8())
}
