//! One geometry image as an EXR file.

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
        // Every EXR reader knows Zip.
        let encoding =
            Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        Image::from_encoded_channels((side, side), encoding, SpecificChannels::rgb(pixel))
            .write()
            .non_parallel()
            .to_file(path)
            .map_err(|error| AtlasError::of_writing(path, error))
    }

    /// Reads an image whose size must be that of `resolution`.
    pub fn read(path: &Path, resolution: u32) -> Result<Self, AtlasError> {
        let expected = (1usize << resolution) + 1;
        // An image of the wrong size is refused before anything is allocated for it.
        let create = move |size: Vec2<usize>, _: &_| {
            let right = size == Vec2(expected, expected);
            (size, vec![[0.0f32; 3]; if right { expected * expected } else { 0 }])
        };
        let set =
            move |(_, samples): &mut (Vec2<usize>, Vec<[f32; 3]>), Vec2(column, row), (x, y, z): (f32, f32, f32)| {
                if let Some(sample) = samples.get_mut(row * expected + column) {
                    *sample = [x, y, z];
                }
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
        let (Vec2(width, height), samples) = image.layer_data.channel_data.pixels;
        if samples.is_empty() {
            return Err(AtlasError::ImageSize { path: path.into(), width, height, resolution, expected });
        }
        let image = Self { last: expected - 1, samples };
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
