//! Square EXR images: one geometry image as a file, and what those of numbers have in common with it.

use std::path::Path;

use exr::prelude::{
    Blocks, Compression, Encoding, Image, LineOrder, ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels,
    Vec2, WritableImage, read,
};

use super::AtlasError;

/// A square geometry image, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GeometryImage {
    /// Pixels along a side less one, a power of two.
    pub last: usize,
    pub samples: Vec<[f32; 3]>,
}

impl GeometryImage {
    pub fn at(&self, (column, row): (usize, usize)) -> [f32; 3] {
        self.samples[row * (self.last + 1) + column]
    }

    /// Writes losslessly compressed 32-bit channels.
    pub fn write(&self, path: &Path) -> Result<(), AtlasError> {
        self.check_finite(path)?;
        let side = self.last + 1;
        let pixel = |Vec2(column, row)| {
            let [x, y, z] = self.at((column, row));
            (x, y, z)
        };
        Image::from_encoded_channels((side, side), ENCODING, SpecificChannels::rgb(pixel))
            .write()
            .non_parallel()
            .to_file(path)
            .map_err(|error| AtlasError::of_writing(path, error))
    }

    /// Reads an image whose size must be that of `resolution`.
    pub fn read(path: &Path, resolution: u32) -> Result<Self, AtlasError> {
        let create = |size: Vec2<usize>, _: &_| Square::new(size, resolution, [0.0f32; 3]);
        let set = |square: &mut Square<[f32; 3]>, place: Vec2<usize>, (x, y, z): (f32, f32, f32)| {
            square.set(place, [x, y, z]);
        };
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .specific_channels()
            .required("R")
            .required("G")
            .required("B")
            .collect_pixels(create, set)
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_file(path)
            .map_err(|error| match error {
                exr::error::Error::Io(source) => AtlasError::Io { path: path.into(), source },
                source => AtlasError::Image { path: path.into(), source },
            })?;
        let samples = image.layer_data.channel_data.pixels.checked(path)?;
        let image = Self { last: 1 << resolution, samples };
        image.check_finite(path)?;
        Ok(image)
    }

    fn check_finite(&self, path: &Path) -> Result<(), AtlasError> {
        match self.samples.iter().position(|sample| !sample.iter().all(|x| x.is_finite())) {
            None => Ok(()),
            Some(place) => {
                let side = self.last + 1;
                Err(AtlasError::NotFinite { path: path.into(), column: place % side, row: place / side })
            }
        }
    }
}

/// Every EXR reader knows Zip.
pub(super) const ENCODING: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

/// The samples of an image while it is read, row by row. One of the wrong size has none: it is refused before anything
/// is allocated for it.
pub(super) struct Square<T> {
    size: Vec2<usize>,
    resolution: u32,
    samples: Vec<T>,
}

impl<T: Copy> Square<T> {
    /// Those of an image of a size, which should be that of a resolution.
    pub fn new(size: Vec2<usize>, resolution: u32, blank: T) -> Self {
        let side = side_of(resolution);
        let is_right = size == Vec2(side, side);
        Self { size, resolution, samples: vec![blank; if is_right { side * side } else { 0 }] }
    }

    pub fn set(&mut self, Vec2(column, row): Vec2<usize>, value: T) {
        if let Some(sample) = self.samples.get_mut(row * self.size.0 + column) {
            *sample = value;
        }
    }

    /// The samples, if the image has the right size.
    pub fn checked(self, path: &Path) -> Result<Vec<T>, AtlasError> {
        let Self { size: Vec2(width, height), resolution, samples } = self;
        check_size(path, [width, height], resolution).map(|()| samples)
    }
}

/// Samples along the side of an image.
fn side_of(resolution: u32) -> usize {
    (1 << resolution) + 1
}

/// Refuses an image whose size is not that of a resolution.
pub(super) fn check_size(path: &Path, [width, height]: [usize; 2], resolution: u32) -> Result<(), AtlasError> {
    let expected = side_of(resolution);
    if [width, height] == [expected; 2] {
        return Ok(());
    }
    Err(AtlasError::ImageSize { path: path.into(), width, height, resolution, expected })
}
