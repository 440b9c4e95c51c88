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

    /// Puts a smaller picture in, its upper left corner at `origin`; what does not fit is left out.
    pub fn insert(&mut self, part: &Self, origin: [u32; 2]) {
        for (from, (y, x)) in (0..part.size[1]).flat_map(|y| (0..part.size[0]).map(move |x| (y, x))).enumerate() {
            let (x, y) = (origin[0] + x, origin[1] + y);
            if x < self.size[0] && y < self.size[1] {
                self.colours[(y * self.size[0] + x) as usize] = part.colours[from];
            }
        }
    }

    /// Pixels where depth, beyond what single precision holds, or what is covered differ. Where two triangles lie equally near
    /// the one that is drawn first stays, and their depths may differ in the last digit.
    pub fn different_depths(&self, other: &Self) -> Vec<usize> {
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
    pub fn marked(&self, pixels: &[usize]) -> Self {
        let mut marked = self.clone();
        marked.colours.iter_mut().for_each(|c| *c = c.map(|x| 128 + x / 2));
        let (width, height) = (self.size[0] as i64, self.size[1] as i64);
        for &pixel in pixels {
            let (x, y) = (pixel as i64 % width, pixel as i64 / width);
            for (dx, dy) in (-3..=3).flat_map(|dy| (-3..=3).map(move |dx| (dx, dy))) {
                let (x, y) = (x + dx, y + dy);
                if (0..width).contains(&x) && (0..height).contains(&y) && (dx == 0 || dy == 0) {
                    marked.colours[(y * width + x) as usize] = [255, 150, 170];
                }
            }
        }
        pixels.iter().for_each(|&pixel| marked.colours[pixel] = [220, 0, 0]);
        marked
    }
}
