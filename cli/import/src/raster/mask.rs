//! Masks: which samples of a raster have data.

use std::path::{Path, PathBuf};

use super::header::HeightRows;
use super::sidecar::with_suffix;
use super::{Parsed, tiff};

/// Rows whose samples have no data where a mask is 0.
pub(super) struct Masked {
    rows: Box<dyn HeightRows>,
    mask: Box<dyn HeightRows>,
    shown: Vec<f64>,
}

impl Masked {
    pub fn over(rows: Box<dyn HeightRows>, mask: Box<dyn HeightRows>) -> Box<dyn HeightRows> {
        Box::new(Self { rows, mask, shown: vec![] })
    }
}

impl HeightRows for Masked {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        self.rows.read(row, heights)?;
        self.shown.resize(heights.len(), 0.0);
        self.mask.read(row, &mut self.shown)?;
        for (height, _) in heights.iter_mut().zip(&self.shown).filter(|(_, shown)| **shown == 0.0) {
            *height = f64::NAN;
        }
        Ok(())
    }
}

/// The file that GDAL writes beside a raster for its mask.
pub(super) fn beside(path: &Path) -> Option<PathBuf> {
    with_suffix(path, "msk")
}

/// Rows of a raster under the mask beside it, if there is one.
pub(super) fn masked(path: &Path, size: [u32; 2], rows: Box<dyn HeightRows>) -> Parsed<Box<dyn HeightRows>> {
    match beside(path) {
        Some(mask) => Ok(Masked::over(rows, tiff::open_mask(&mask, size)?)),
        None => Ok(rows),
    }
}
