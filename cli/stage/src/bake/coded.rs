//! The images of a map, as they are stored: from what texels show to bytes.

use std::ops::RangeInclusive;

use lodpack::decode::texels::{Image, Map};
use lodpack::write::{
    Seen, encode_exact_image, encode_exact_normals, encode_image, encode_normals, encode_seen_image, encode_values,
    lost_squares,
};

use super::storage::{Storage, Stored};
use lodpack_mesh::srgb::{share_byte, srgb_byte};

impl Storage {
    /// The streams of each channel's image, of texels that have these values, as [`super::values::Sums`] has them.
    /// Texels that are not used may have any value afterwards. `memory` serves one image after another.
    pub(super) fn encode(
        &self,
        map: &Map,
        values: &[f32],
        is_used: &[bool],
        seen: &Seen<'_>,
        steps: Steps,
        memory: &mut Vec<u8>,
    ) -> Vec<Vec<u8>> {
        let mut first = 0;
        let mut streams = vec![];
        for &channel in self.channels() {
            let texels = values.chunks_exact(self.stride()).map(|texel| &texel[first..first + channel.values()]);
            streams.extend(match channel {
                Stored::Colour { step, .. } if self.is_plain() => {
                    let image = plain_colours(values, map.size, std::mem::take(memory));
                    let bytes = coded(&image, is_used, Some(seen), steps.of_opaque_colours(step, &image, is_used));
                    *memory = image.data;
                    bytes
                }
                Stored::Colour { components: 3, step } => {
                    let image = colours(texels, map.size, 3);
                    coded(&image, is_used, Some(seen), steps.of_opaque_colours(step, &image, is_used))
                }
                Stored::Colour { components, step } => {
                    coded(&colours(texels, map.size, components), is_used, None, steps.of_others(step))
                }
                Stored::Normal { step } => {
                    let directions: Vec<[f32; 3]> = texels.map(|texel| [texel[0], texel[1], texel[2]]).collect();
                    match steps.of_others(step) {
                        0 => vec![encode_exact_normals(map, &directions, is_used)],
                        step => encode_normals(map, &directions, is_used, step).into(),
                    }
                }
                Stored::Factor { step } => {
                    let data = texels.map(|texel| share_byte(texel[0])).collect();
                    let image = Image { size: map.size, components: 1, data };
                    coded(&image, is_used, None, steps.of_others(step))
                }
                Stored::Scalar { low, step } => {
                    let data = texels.map(|texel| number_of(texel[0], low, step)).collect();
                    vec![encode_values(&Image { size: map.size, components: 1, data }, is_used)]
                }
                Stored::Label { low } => {
                    let data = texels.map(|texel| number_of(texel[0], low, 1.0)).collect();
                    vec![encode_values(&Image { size: map.size, components: 1, data }, is_used)]
                }
            });
            first += channel.values();
        }
        streams
    }

    /// Replaces `bytes` by what is stored of a texel if nothing is lost, but for directions.
    pub(super) fn write_texel(&self, values: &[f32], texel: usize, bytes: &mut Vec<u8>) {
        bytes.clear();
        let mut rest = &values[texel * self.stride()..][..self.count()];
        for &channel in self.channels() {
            let (own, others) = rest.split_at(channel.values());
            match channel {
                Stored::Colour { components, .. } => {
                    bytes.extend(own.iter().take(3).map(|&value| srgb_byte(value)));
                    bytes.extend((components == 4).then(|| share_byte(own[3])));
                }
                Stored::Normal { .. } => {}
                Stored::Factor { .. } => bytes.push(share_byte(own[0])),
                Stored::Scalar { low, step } => bytes.extend(number_of(own[0], low, step).to_le_bytes()),
                Stored::Label { low } => bytes.extend(number_of(own[0], low, 1.0).to_le_bytes()),
            }
            rest = others;
        }
    }
}

/// Codes an image with a step, or exactly if there is none. What is seen of it beside its pieces only counts where
/// something is lost.
fn coded(image: &Image<u8>, is_used: &[bool], seen: Option<&Seen<'_>>, step: u8) -> Vec<Vec<u8>> {
    match (step, seen) {
        (0, _) => vec![encode_exact_image(image, is_used)],
        (_, Some(seen)) => encode_seen_image(image, is_used, seen, step).into(),
        (_, None) => encode_image(image, is_used, step).into(),
    }
}

/// What quantisation loses of images with much grain, in squares of the step. A twelfth of the brightness is lost where
/// all frequencies have more than the step; .07 of a photograph, and at most .04 of drawings and letters on what is
/// even. Where colours are noise, .26 is lost, and finer steps are not worth their bytes: a city's tile would have .09
/// dB more for 5.8 % more of them.
const GRAIN: RangeInclusive<f32> = 0.062..=0.15;
/// How large steps are there. A photograph with much grain has 38.2 dB in place of 37.9, for 4.4 % more bytes.
const FINER_IN_GRAIN: f64 = 8.0 / 9.0;

/// By what the steps of quantisation of some images are larger than usual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    /// Those of colours without opacity.
    pub opaque_colours: f64,
    /// Whether those of colours without opacity are finer where there is much [`GRAIN`].
    pub are_finer_in_grain: bool,
    /// All others.
    pub others: f64,
}

impl Steps {
    fn of_opaque_colours(self, step: u8, image: &Image<u8>, is_used: &[bool]) -> u8 {
        let usual = larger(step, self.opaque_colours);
        let finer = larger(usual, FINER_IN_GRAIN);
        let is_finer = self.are_finer_in_grain && finer < usual && GRAIN.contains(&lost_squares(image, is_used, usual));
        if is_finer { finer } else { usual }
    }

    fn of_others(self, step: u8) -> u8 {
        larger(step, self.others)
    }
}

/// A step that is `factor` times as large, or the smallest or largest there is. Without a step there still is none.
fn larger(step: u8, factor: f64) -> u8 {
    (f64::from(step) * factor).round().clamp(f64::from(step.min(1)), 255.0) as u8
}

/// The number that stands for a value; 0 for none.
fn number_of(value: f32, low: f64, step: f64) -> u16 {
    // The conversion saturates, and NaN becomes 0.
    ((f64::from(value) - low) / step + 0.5) as u16
}

/// Colours as they are stored, from linear light.
fn colours<'a>(texels: impl Iterator<Item = &'a [f32]>, size: [u32; 2], components: u8) -> Image<u8> {
    let count = usize::from(components);
    let mut data = vec![0; size[0] as usize * size[1] as usize * count];
    for (to, texel) in data.chunks_exact_mut(count).zip(texels) {
        to.iter_mut().zip(texel).take(3).for_each(|(to, &value)| *to = srgb_byte(value));
        if let Some(opacity) = to.get_mut(3) {
            *opacity = share_byte(texel[3]);
        }
    }
    Image { size, components, data }
}

/// As [`colours`], where there is nothing else.
fn plain_colours(values: &[f32], size: [u32; 2], mut data: Vec<u8>) -> Image<u8> {
    let texels = values.as_chunks().0;
    data.resize(3 * texels.len(), 0);
    for (colour, &[red, green, blue, _]) in data.as_chunks_mut().0.iter_mut().zip(texels) {
        *colour = [red, green, blue].map(srgb_byte);
    }
    Image { size, components: 3, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack::decode::ChannelImage;
    use lodpack::write::{PieceShape, encode_map};

    /// A map of one piece with many texels.
    fn map() -> Map {
        let positions = [[0, 0, 0], [3000, 0, 0], [0, 2000, 0]];
        let shapes = [PieceShape { axis: [0, 0, 1], ..PieceShape::default() }];
        encode_map(&positions, &[[0, 1, 2]], 12, &shapes, &[0], 1 << 20).unwrap().0
    }

    #[test]
    fn without_a_step_texels_come_back_as_they_are_however_large_steps_would_be() {
        let map = map();
        let count = (map.size[0] * map.size[1]) as usize;
        for channels in [
            vec![Stored::Colour { components: 3, step: 0 }],
            vec![Stored::Factor { step: 0 }, Stored::Colour { components: 4, step: 0 }, Stored::Normal { step: 0 }],
            vec![Stored::Normal { step: 0 }, Stored::Colour { components: 3, step: 0 }],
        ] {
            let storage = Storage::new(channels);
            let value = |k: usize| (k * 7919 % 1009) as f32 / 1008.0;
            let values: Vec<f32> = (0..count * storage.stride()).map(value).collect();
            let used: Vec<bool> = (0..count).map(|k| k % 5 != 2).collect();
            let seen = Seen::new(&used, map.size, []);
            let steps = Steps { opaque_colours: 3.0, are_finer_in_grain: true, others: 2.0 };
            let streams = storage.encode(&map, &values, &used, &seen, steps, &mut vec![]);
            let mut first = 0;
            for (&channel, stream) in storage.channels().iter().zip(&streams) {
                let texels = values.chunks_exact(storage.stride()).map(|texel| &texel[first..first + channel.values()]);
                let wanted: Vec<Vec<u8>> = match channel {
                    Stored::Colour { components, .. } => {
                        let image = colours(texels, map.size, components);
                        image.data.chunks(components.into()).map(<[u8]>::to_vec).collect()
                    }
                    Stored::Factor { .. } => texels.map(|texel| vec![share_byte(texel[0])]).collect(),
                    // As without a loss of more than the two bytes of a direction.
                    _ => {
                        let directions: Vec<[f32; 3]> = texels.map(|texel| [texel[0], texel[1], texel[2]]).collect();
                        let all = vec![true; count];
                        let exact = encode_exact_normals(&map, &directions, &all);
                        let image = Image::decode_exact_normals(&exact, &map).unwrap();
                        image.data.chunks(3).map(<[u8]>::to_vec).collect()
                    }
                };
                let image = match channel.decode(std::slice::from_ref(stream), &map).unwrap() {
                    ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => image,
                    ChannelImage::Values(_) => panic!("values are of other kinds"),
                };
                let found = image.data.chunks(image.components.into());
                for (texel, (found, wanted)) in found.zip(&wanted).enumerate().filter(|(texel, _)| used[*texel]) {
                    assert_eq!(found, wanted, "{channel:?}, texel {texel}");
                }
                first += channel.values();
            }
        }
    }
}
