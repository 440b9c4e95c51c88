//! Images of numbers as EXR files with one channel.

use std::path::Path;

use exr::prelude::{Image, ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels, Vec2, WritableImage, read};

use super::AtlasError;
use super::image::{ENCODING, Square};

/// Writes a square image of 32-bit numbers, row by row, losslessly compressed.
pub(super) fn write_numbers(path: &Path, side: usize, numbers: &[f32]) -> Result<(), AtlasError> {
    let pixel = |Vec2(column, row): Vec2<usize>| (numbers[row * side + column],);
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(pixel);
    Image::from_encoded_channels((side, side), ENCODING, channels)
        .write()
        .non_parallel()
        .to_file(path)
        .map_err(|error| AtlasError::of_writing(path, error))
}

/// Reads a square image of numbers, whose size must be that of `resolution`.
pub(super) fn read_numbers(path: &Path, resolution: u32) -> Result<Vec<f32>, AtlasError> {
    let create = |size: Vec2<usize>, _: &_| Square::new(size, resolution, f32::NAN);
    let set = |square: &mut Square<f32>, place: Vec2<usize>, (y,): (f32,)| square.set(place, y);
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("Y")
        .collect_pixels(create, set)
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_file(path)
        .map_err(|error| match error {
            exr::error::Error::Io(source) => AtlasError::Io { path: path.into(), source },
            source => AtlasError::Numbers { path: path.into(), source },
        })?;
    image.layer_data.channel_data.pixels.checked(path)
}
