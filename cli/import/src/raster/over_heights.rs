//! An image over heights that stay a grid: where its pixels are among the samples, and how opaque they are.

use std::path::{Path, PathBuf};

use super::drape::place_of;
use super::mosaic::Mosaic;
use super::pam::Pam;
use super::{Parsed, grid_error, mask, tiff};
use lodpack_mesh::images::{ImageSource, coded_step, decode_image, unreadable};
use lodpack_runtime::progress::Progress;

/// An image over heights.
#[derive(Clone, Debug)]
pub struct HeightDrape {
    path: PathBuf,
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// Where the centre of the first pixel is, in columns and rows of samples.
    pub first: [f64; 2],
    /// Columns from a pixel to the next one, and rows from a row of pixels to the next one.
    pub spacing: [f64; 2],
    /// Whether pixels run from the east to the west, and from the south to the north.
    is_turned: [bool; 2],
}

/// The pixels of an image.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// 3, or 4 with opacity.
    pub components: u8,
    /// Row by row from the north, as screens show them.
    pub data: Vec<u8>,
}

impl HeightDrape {
    /// Finds out where an image is. The grid has `rows_before` rows to the north of those of the rasters.
    pub(super) fn open(mosaic: &Mosaic, path: &Path, rows_before: u64, progress: &dyn Progress) -> Parsed<Self> {
        let image = ImageSource::File { path: path.to_owned(), range: None };
        let placed = place_of(mosaic, path, &image)?;
        if placed.is_part {
            let what = "covers only a part of the grid; the rest is drawn without it";
            progress.note(&format!("{}: {what}", path.display()));
        }
        let [mut scale, mut offset] = placed.map;
        let is_turned = scale.map(|scale| scale < 0.0);
        for axis in [0, 1].into_iter().filter(|&axis| is_turned[axis]) {
            (scale[axis], offset[axis]) = (-scale[axis], 1.0 - offset[axis]);
        }
        let size = placed.size;
        let spacing = [0, 1].map(|axis| 1.0 / (f64::from(size[axis]) * scale[axis]));
        let first = [0, 1].map(|axis| snapped(0.5 * spacing[axis] - offset[axis] / scale[axis]));
        let first = [first[0], first[1] + rows_before as f64];
        Ok(Self { path: path.to_owned(), size, first, spacing: spacing.map(snapped), is_turned })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// By which step it was quantised when it was coded, of 255, if it is a JPEG.
    pub fn coded_step(&self) -> Option<f64> {
        let image = ImageSource::File { path: self.path.clone(), range: None };
        coded_step(image.open(None).ok()?).ok().flatten()
    }

    /// Decodes it.
    ///
    /// # Errors
    /// If it or its mask cannot be read.
    pub fn pixels(&self) -> Result<Pixels, crate::ImportError> {
        self.read().map_err(|error| *error)
    }

    fn read(&self) -> Parsed<Pixels> {
        let refuse = |problem: String| grid_error(&self.path, &format!("cannot be shown: {problem}"));
        let image = ImageSource::File { path: self.path.clone(), range: None };
        let encoded = image.open(None).map_err(|error| refuse(unreadable(&error)))?;
        let decoded = decode_image(encoded).map_err(refuse)?;
        let has_alpha = decoded.color().has_alpha();
        let size = [decoded.width(), decoded.height()];
        let (mask, nodata) = self.opacity(size)?;
        let [width, height] = size.map(|size| size as usize);
        let opaque = mask.is_none() && nodata.is_none() && !has_alpha;
        let mut pixels = match opaque {
            true => Pixels { size, components: 3, data: decoded.into_rgb8().into_raw() },
            false => Pixels { size, components: 4, data: decoded.into_rgba8().into_raw() },
        };
        if let Some(mut mask) = mask {
            let mut shown = vec![0.0; width];
            for (row, pixels) in (0..).zip(pixels.data.chunks_exact_mut(4 * width)) {
                mask.read(row, &mut shown)?;
                let hidden = pixels.as_chunks_mut::<4>().0.iter_mut().zip(&shown).filter(|(_, shown)| **shown == 0.0);
                hidden.for_each(|(pixel, _)| pixel[3] = 0);
            }
        }
        if let Some(nodata) = nodata {
            for pixel in pixels.data.as_chunks_mut::<4>().0 {
                if pixel[..3] == [nodata; 3] {
                    pixel[3] = 0;
                }
            }
        }
        if pixels.components == 4 && pixels.data.as_chunks::<4>().0.iter().all(|pixel| pixel[3] == 255) {
            pixels.data = pixels.data.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
            pixels.components = 3;
        }
        let stride = width * usize::from(pixels.components);
        if self.is_turned[1] {
            for row in 0..height / 2 {
                let (above, below) = pixels.data.split_at_mut((height - 1 - row) * stride);
                above[row * stride..][..stride].swap_with_slice(&mut below[..stride]);
            }
        }
        if self.is_turned[0] {
            let count = usize::from(pixels.components);
            for row in pixels.data.chunks_exact_mut(stride) {
                row.reverse();
                row.chunks_exact_mut(count).for_each(<[u8]>::reverse);
            }
        }
        Ok(pixels)
    }

    /// The mask of the image, and the number that all components of a pixel without data have.
    #[expect(clippy::type_complexity, reason = "a pair that is used once")]
    fn opacity(&self, size: [u32; 2]) -> Parsed<(Option<Box<dyn super::header::HeightRows>>, Option<u8>)> {
        let (own, nodata) = tiff::opacity_of_image(&self.path, size)?;
        let mask = match mask::beside(&self.path) {
            Some(mask) => Some(tiff::open_mask(&mask, size)?),
            None => own,
        };
        let nodata = nodata.or(Pam::beside(&self.path)?.nodata);
        Ok((mask, nodata.filter(|x| x.fract() == 0.0 && (0.0..=255.0).contains(x)).map(|x| x as u8)))
    }
}

/// Without what rounding left: places of pixels are mostly simple shares of samples.
fn snapped(x: f64) -> f64 {
    const SHARES: f64 = 5040.0;
    let near = (x * SHARES).round() / SHARES;
    if (near - x).abs() <= 1e-9 * x.abs().max(1e-3) { near } else { x }
}
