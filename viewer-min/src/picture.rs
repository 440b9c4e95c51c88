//! A picture in memory: what was drawn, from which roots, how far away.

use std::path::Path;

use anyhow::{Context, Result};

/// Pixels, row after row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// What is seen.
    pub colours: Vec<[u8; 3]>,
    /// Which root; none for the background.
    pub roots: Vec<Option<u32>>,
    /// Depth along the camera's axis, world units; nothing sensible for the background.
    pub depths: Vec<f32>,
}

/// What the background looks like.
pub const BACKGROUND: [u8; 3] = [233, 237, 243];

impl Picture {
    /// A picture without anything in it.
    pub fn empty(size: [u32; 2]) -> Self {
        let count = size[0] as usize * size[1] as usize;
        Self { size, colours: vec![BACKGROUND; count], roots: vec![None; count], depths: vec![0.0; count] }
    }

    /// Writes a PNG.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.colours);
        image::save_buffer(path, bytes, self.size[0], self.size[1], image::ColorType::Rgb8)
            .with_context(|| format!("{} cannot be written", path.display()))
    }

    /// Reads the colours of a PNG.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn load(path: &Path) -> Result<Self> {
        let image = image::open(path).with_context(|| format!("{} cannot be read", path.display()))?.to_rgb8();
        let colours = image.pixels().map(|pixel| pixel.0).collect();
        Ok(Self { colours, ..Self::empty([image.width(), image.height()]) })
    }

    /// Puts the colours of a smaller picture in, its upper left corner at `[x, y]`. It has to fit.
    pub(crate) fn insert(&mut self, part: &Self, [x, y]: [u32; 2]) {
        for (row, colours) in (y..).zip(part.colours.chunks(part.size[0] as usize)) {
            let start = (row * self.size[0] + x) as usize;
            self.colours[start..start + colours.len()].copy_from_slice(colours);
        }
    }

    /// Pixels where depth, beyond what single precision holds, or what is covered differ. Where two triangles lie equally near
    /// the one that is drawn first stays, and their depths may differ in the last digit.
    pub(crate) fn different_depths(&self, other: &Self) -> Vec<usize> {
        let same = |i: &usize| match (self.roots[*i], other.roots[*i]) {
            (None, None) => true,
            (Some(_), Some(_)) => (self.depths[*i] - other.depths[*i]).abs() <= 1e-6 * self.depths[*i],
            _ => false,
        };
        (0..self.colours.len()).filter(|i| !same(i)).collect()
    }

    /// Pixels whose colour differs by more than so many of 255 levels.
    pub fn different_colours(&self, other: &Self, levels: u8) -> Vec<usize> {
        let is_other = |i: &usize| (0..3).any(|k| self.colours[*i][k].abs_diff(other.colours[*i][k]) > levels);
        (0..self.colours.len()).filter(is_other).collect()
    }

    /// The picture, pale, with some pixels in red and their surroundings in pink, so that single ones are seen.
    pub(crate) fn marked(&self, pixels: &[usize]) -> Self {
        let mut marked = self.clone();
        marked.colours.iter_mut().for_each(|c| *c = c.map(|x| 128 + x / 2));
        let (width, height) = (self.size[0] as usize, self.size[1] as usize);
        for (x, y) in pixels.iter().map(|pixel| (pixel % width, pixel / width)) {
            let (left, right) = (x.saturating_sub(3), (x + 4).min(width));
            marked.colours[y * width + left..y * width + right].fill([255, 150, 170]);
            (y.saturating_sub(3)..(y + 4).min(height)).for_each(|y| marked.colours[y * width + x] = [255, 150, 170]);
        }
        pixels.iter().for_each(|&pixel| marked.colours[pixel] = [220, 0, 0]);
        marked
    }
}
