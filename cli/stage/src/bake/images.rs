//! Images of a file that are read again, for the images of another patch.

use std::borrow::Borrow;

use lodpack::decode::ChannelImage;
use lodpack::decode::texels::{Image, Map, SCALES};

use super::{Storage, Stored};
use lodpack_mesh::srgb::LINEAR_OF_BYTE;

/// The most samples along each side of a texel.
const MOST_SAMPLES: f64 = 8.0;

impl Stored {
    /// Decodes the image of a channel from its streams. None if they break a rule of the format.
    pub fn decode(self, streams: &[Vec<u8>], map: &Map) -> Option<ChannelImage> {
        let first = streams.first()?;
        let bytes = |components: u8| match self.is_exact() {
            true => Image::decode_exact(first, map.size, components),
            false => Image::decode_scaled(streams, map.size, components),
        };
        let normals = || match self.is_exact() {
            true => Image::decode_exact_normals(first, map),
            false => Image::decode_scaled_normals(streams, map),
        };
        Some(match self {
            Self::Colour { components, .. } => ChannelImage::Colours(bytes(components).ok()?),
            Self::Normal { .. } => ChannelImage::Normals(normals().ok()?),
            Self::Factor { .. } => ChannelImage::Factors(bytes(1).ok()?),
            Self::Scalar { .. } | Self::Label { .. } => {
                ChannelImage::Values(Image::decode_values(first, map.size, 1).ok()?)
            }
        })
    }

    /// How many streams the image of a channel has.
    pub fn stream_count(self) -> usize {
        let is_scaled = !self.is_exact() && !matches!(self, Self::Scalar { .. } | Self::Label { .. });
        if is_scaled { SCALES } else { 1 }
    }
}

impl Storage {
    /// Each channel with the streams of its image, of those of a block behind its map.
    pub fn by_channel<'s>(&self, mut streams: &'s [Vec<u8>]) -> impl Iterator<Item = (Stored, &'s [Vec<u8>])> {
        self.channels().iter().map(move |&channel| {
            let (own, rest) = streams.split_at(channel.stream_count().min(streams.len()));
            streams = rest;
            (channel, own)
        })
    }
}

/// The images of all channels of a block.
#[derive(Clone, Debug)]
pub struct Images<Owned = ChannelImage> {
    all: Vec<(Stored, Owned)>,
    count: usize,
}

impl<Owned: Borrow<ChannelImage>> Images<Owned> {
    /// Images of all channels, in their order, or references to them.
    pub fn new(storage: &Storage, images: Vec<Owned>) -> Self {
        Self { all: storage.channels().iter().copied().zip(images).collect(), count: storage.count() }
    }

    /// Appends the values at a place in texels: means over a width in texels, of places within a range; the label
    /// there.
    pub fn sample(&self, place: [f64; 2], range: [[f64; 2]; 2], width: f64, values: &mut Vec<f32>) {
        // Most images are of opaque colours alone.
        if let [(Stored::Colour { components: 3, .. }, image)] = self.all.as_slice()
            && let ChannelImage::Colours(image) = image.borrow()
        {
            let mut sums = [0.0; 3];
            let add_texel = |[x, y]: [u32; 2], share: f32| {
                let texel = image.texel(x, y);
                (0..3).for_each(|k| sums[k] += LINEAR_OF_BYTE[usize::from(texel[k])] * share);
            };
            for_each_texel(place, range, width, add_texel);
            values.extend(sums);
            return;
        }
        let first = values.len();
        values.resize(first + self.count, 0.0);
        let add_texel = |texel: [u32; 2], share: f32| {
            let mut sums = &mut values[first..];
            for (stored, image) in &self.all {
                let (own, rest) = sums.split_at_mut(stored.values());
                add(*stored, image.borrow(), texel, share, own);
                sums = rest;
            }
        };
        for_each_texel(place, range, width, add_texel);
        let mut sums = &mut values[first..];
        for (stored, image) in &self.all {
            let (own, rest) = sums.split_at_mut(stored.values());
            if let (Stored::Label { low }, ChannelImage::Values(image)) = (stored, image.borrow()) {
                let [x, y] = [0, 1].map(|axis| place[axis].clamp(range[0][axis], range[1][axis]) as u32);
                own[0] = (low + f64::from(image.texel(x, y)[0])) as f32;
            }
            // Colours count by their opacity.
            if let (Stored::Colour { .. }, [red, green, blue, opacity]) = (stored, &mut *own)
                && *opacity > 0.0
            {
                [red, green, blue].into_iter().for_each(|sum| *sum /= *opacity);
            }
            sums = rest;
        }
    }
}

/// Calls a function for the texels that a place within a range shows, each with its share: those in a square whose
/// width in texels is given.
fn for_each_texel(place: [f64; 2], range: [[f64; 2]; 2], width: f64, mut visit: impl FnMut([u32; 2], f32)) {
    let count = width.ceil().clamp(1.0, MOST_SAMPLES) as u32;
    let offset = |k: u32| ((f64::from(k) + 0.5) / f64::from(count) - 0.5) * width;
    let clamped = |axis: usize, k: u32| (place[axis] + offset(k)).clamp(range[0][axis], range[1][axis]);
    if count == 1 {
        // What readers show there.
        let ([x, y], [right, down]) = between(place, range);
        for [beside, below] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            let share = |is_far: u32, far: f32| if is_far == 1 { far } else { 1.0 - far };
            let share = share(beside, right) * share(below, down);
            if share > 0.0 {
                visit([x + beside, y + below], share);
            }
        }
    } else {
        let share = 1.0 / (count * count) as f32;
        for [x, y] in (0..count).flat_map(|row| (0..count).map(move |column| [column, row])) {
            // The conversion saturates.
            visit([clamped(0, x) as u32, clamped(1, y) as u32], share);
        }
    }
}

/// The first of the four texels between which a place within a range lies, and how far along both directions.
fn between(place: [f64; 2], [low, high]: [[f64; 2]; 2]) -> ([u32; 2], [f32; 2]) {
    let of = |axis: usize| {
        let at = place[axis].clamp(low[axis], high[axis]) - 0.5;
        // The conversion saturates.
        (at as u32, (at - f64::from(at as u32)).clamp(0.0, 1.0) as f32)
    };
    let ((x, right), (y, down)) = (of(0), of(1));
    ([x, y], [right, down])
}

/// Adds a share of the values of a texel; colours with their opacity as the weight.
fn add(stored: Stored, image: &ChannelImage, [x, y]: [u32; 2], share: f32, sums: &mut [f32]) {
    match (stored, image) {
        (Stored::Colour { .. }, ChannelImage::Colours(image)) => {
            let texel = image.texel(x, y);
            // Colours without opacity have three values.
            let opacity = texel.get(3).map_or(1.0, |&opacity| f32::from(opacity) / 255.0) * share;
            (0..3).for_each(|k| sums[k] += LINEAR_OF_BYTE[usize::from(texel[k])] * opacity);
            if let Some(sum) = sums.get_mut(3) {
                *sum += opacity;
            }
        }
        (Stored::Normal { .. }, ChannelImage::Normals(image)) => {
            let texel = image.texel(x, y);
            (0..3).for_each(|k| sums[k] += (f32::from(texel[k]) - 128.0) * share);
        }
        (Stored::Factor { .. }, ChannelImage::Factors(image)) => {
            sums[0] += f32::from(image.texel(x, y)[0]) / 255.0 * share;
        }
        (Stored::Scalar { low, step }, ChannelImage::Values(image)) => {
            sums[0] += (low + step * f64::from(image.texel(x, y)[0])) as f32 * share;
        }
        // An image of another kind has nothing to say here.
        _ => {}
    }
}
