//! Images of numbers as EXR files with one channel.

use std::path::Path;

use exr::prelude::{
    Blocks, Compression, Encoding, Image, LineOrder, ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels,
    Vec2, WritableImage, read,
};

use super::AtlasError;

/// Writes a square image of 32-bit numbers, row by row, losslessly compressed.
pub(super) fn write_numbers(path: &Path, side: usize, numbers: &[f32]) -> Result<(), AtlasError> {
    let pixel = |Vec2(column, row): Vec2<usize>| (numbers[row * side + column],);
    // Every EXR reader knows Zip.
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(pixel);
    Image::from_encoded_channels((side, side), encoding, channels)
        .write()
        .non_parallel()
        .to_file(path)
        .map_err(|error| AtlasError::of_writing(path, error))
}

/// Reads a square image of numbers, whose size must be that of `resolution`.
pub(super) fn read_numbers(path: &Path, resolution: u32) -> Result<Vec<f32>, AtlasError> {
    let expected = (1usize << resolution) + 1;
    // An image of the wrong size is refused before anything is allocated for it.
    let create = move |size: Vec2<usize>, _: &_| {
        let is_right = size == Vec2(expected, expected);
        (size, vec![f32::NAN; if is_right { expected * expected } else { 0 }])
    };
    let set = move |(_, numbers): &mut (Vec2<usize>, Vec<f32>), Vec2(column, row): Vec2<usize>, (y,): (f32,)| {
        if let Some(number) = numbers.get_mut(row * expected + column) {
            *number = y;
        }
    };
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
    let (Vec2(width, height), numbers) = image.layer_data.channel_data.pixels;
    if numbers.is_empty() {
        return Err(AtlasError::ImageSize { path: path.into(), width, height, resolution, expected });
    }
    Ok(numbers)
}
