//! A root's image on the GPU: one texture, and a table of pieces from which the shader finds the place of any point.
//!
//! There are no texture coordinates: a place is the product of a point with two vectors of its piece ([`Piece`]), also for the points that
//! finer neighbours insert into the border. Points are taken from an origin of the root's own, so that single precision suffices.

use std::sync::Arc;

use lodpack::{
    Lattice,
    decode::{ChannelImage, texels::Piece},
    index::ChannelKind,
    stream::{DrawnRoot, DrawnTexture},
};
use wgpu::{BufferUsages, TextureFormat, TextureUsages};

use crate::{
    camera::pair,
    gpu::{Gpu, Resource},
};

/// How the shader makes colours of texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// Colours, interpolated in linear light.
    Colours = 1,
    /// Numbers of 16 bits, interpolated, and then given a colour of the ramp.
    Ramp = 2,
    /// Colours of numbers between which nothing lies.
    Classes = 3,
    /// Directions: a picture of their own without light, and clay that is lit by them otherwise.
    Normals = 4,
}

impl Look {
    pub fn of(kind: ChannelKind) -> Self {
        match kind {
            ChannelKind::Colour | ChannelKind::Factor => Self::Colours,
            ChannelKind::Normal => Self::Normals,
            ChannelKind::Label => Self::Classes,
            _ => Self::Ramp,
        }
    }
}

/// Four bytes of a texel: red, green, blue; or a number, the higher byte first. The last one says that it is there.
type Texel = [u8; 4];

/// The colour of a class.
fn class_colour(number: u16) -> Texel {
    let h = (f64::from(number) * 0.618_034).fract() * 6.0;
    let part = |shift: f64| {
        let x = (((h + shift) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
        (255.0 * (0.35 + 0.6 * x)) as u8
    };
    [part(0.0), part(4.0), part(2.0), 255]
}

/// What the channel that is shown is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meaning {
    pub kind: ChannelKind,
    /// A number stands for low + number * step.
    pub low: f64,
    pub step: f64,
}

impl Meaning {
    /// A texel of the values of a channel, which are bytes or numbers.
    fn texel(&self, values: &[f64], is_colour: bool) -> Texel {
        let first = values.first().copied().unwrap_or(0.0);
        match self.kind {
            // Colours of fewer components are grey.
            _ if is_colour => {
                let byte = |k: usize| values.get(k).copied().unwrap_or(first).round() as u8;
                [byte(0), byte(1), byte(2), 255]
            }
            ChannelKind::Label => class_colour(first as u16),
            _ => {
                let [high, low] = (first.round() as u16).to_be_bytes();
                [high, low, 0, 255]
            }
        }
    }

    fn texels(&self, image: &ChannelImage) -> ([u32; 2], Vec<Texel>) {
        fn all<T: Copy + Into<f64>>(data: &[T], components: u8, texel: impl Fn(&[f64]) -> Texel) -> Vec<Texel> {
            let mut values = Vec::with_capacity(4);
            let texels = data.chunks_exact(usize::from(components.max(1)));
            let texel = |numbers: &[T]| {
                values.clear();
                values.extend(numbers.iter().map(|&number| number.into()));
                texel(&values)
            };
            texels.map(texel).collect()
        }
        match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                (image.size, all(&image.data, image.components, |values| self.texel(values, true)))
            }
            ChannelImage::Values(image) => {
                (image.size, all(&image.data, image.components, |values| self.texel(values, false)))
            }
        }
    }

    /// The mean of a root as a texel; all 0 if there is none.
    pub fn mean(&self, drawn: &DrawnRoot) -> u32 {
        let mean = drawn.mean(0).filter(|_| self.kind != ChannelKind::Label);
        let are_bytes = matches!(self.kind, ChannelKind::Colour | ChannelKind::Normal | ChannelKind::Factor);
        let texel = mean.map(|mean| self.texel(&mean, are_bytes));
        u32::from_le_bytes(texel.unwrap_or([0; 4]))
    }
}

/// A root's image, with its table of pieces.
pub(crate) struct Texels {
    /// Whose image it is.
    pub of: Arc<DrawnTexture>,
    pub group: wgpu::BindGroup,
}

impl Texels {
    /// Uploads the first image of a root; none if it has none. With the labels of pulled triangles.
    ///
    /// # Errors
    /// If the device cannot have a texture of this size.
    pub fn upload(
        gpu: &Gpu,
        (drawn, lattice): (&DrawnRoot, &Lattice),
        meaning: &Meaning,
    ) -> Result<Option<Self>, String> {
        let Some(texture) = drawn.texture() else { return Ok(None) };
        let (Some(map), Some(Some(image))) = (&texture.texture.map, texture.texture.images.first()) else {
            return Ok(None);
        };
        let (size, texels) = meaning.texels(image);
        let most = gpu.device.limits().max_texture_dimension_2d;
        let root = drawn.surface.root;
        if size.iter().any(|&length| length > most) {
            let [width, height] = size;
            return Err(format!(
                "root {root} has an image of {width}x{height} texels; this device draws {most}x{most}"
            ));
        }
        let format = match Look::of(meaning.kind) {
            Look::Ramp => TextureFormat::Rgba8Unorm,
            Look::Colours | Look::Classes | Look::Normals => TextureFormat::Rgba8UnormSrgb,
        };
        let image = uploaded(gpu, size, format, &texels);
        let normals = texture.texture.images.iter().flatten().find_map(|image| match image {
            ChannelImage::Normals(image) => Some(image),
            _ => None,
        });
        let normals = normals.map_or(([1; 2], vec![[0; 4]]), |image| {
            (image.size, image.data.chunks_exact(3).map(|texel| [texel[0], texel[1], texel[2], 255]).collect())
        });
        let normals = uploaded(gpu, normals.0, TextureFormat::Rgba8Unorm, &normals.1);

        let origin = drawn.surface.positions.first().copied().unwrap_or_default();
        let [x, y, z, low_x, low_y, low_z] = pair(origin);
        let inner_count = f32::from_bits(drawn.surface.triangles.len() as u32);
        let mut pieces = vec![[x, y, z, 0.0], [low_x, low_y, low_z, inner_count]];
        // What the shader takes as the origin.
        let origin = [0, 1, 2].map(|k| f64::from([x, y, z][k]) + f64::from([low_x, low_y, low_z][k]));
        pieces.extend(map.pieces.iter().flat_map(|piece| piece_rows(piece, lattice, origin)));
        let labels: Vec<u32> = labels(texture, &drawn.surface.origins);
        let pieces = gpu.buffer(&pieces, BufferUsages::STORAGE);
        let labels = gpu.buffer(&labels, BufferUsages::STORAGE);
        let [view, normals] = [image, normals].map(|image| image.create_view(&Default::default()));
        let resources = [
            Resource::Buffer(&pieces),
            Resource::Texture(&view),
            Resource::Sampler,
            Resource::Buffer(&labels),
            Resource::Texture(&normals),
        ];
        let group = gpu.bind_all(&gpu.pipelines.texels_layout, &resources);
        Ok(Some(Self { of: Arc::clone(texture), group }))
    }
}

/// A texture of these texels.
fn uploaded(gpu: &Gpu, size: [u32; 2], format: TextureFormat, texels: &[Texel]) -> wgpu::Texture {
    let image = gpu.texture(size, format, TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size[0]), rows_per_image: None };
    gpu.queue.write_texture(image.as_image_copy(), texels.as_flattened(), layout, image.size());
    image
}

/// A piece in the shader: for each coordinate of a place what a point from the origin is multiplied with, and what is added; then its range.
fn piece_rows(piece: &Piece, lattice: &Lattice, origin: [f64; 3]) -> [[f32; 4]; 3] {
    let start = piece.unbounded(lattice.units(origin));
    let step = lattice.step();
    let row = |k: usize| {
        let [x, y, z] = piece.across()[k].map(|x| (x / step) as f32);
        [x, y, z, start[k] as f32]
    };
    let [[left, top], [right, bottom]] = piece.range().map(|place| place.map(|x| x as f32));
    [row(0), row(1), [left, top, right, bottom]]
}

/// The pieces of triangles of which this is said where in the patch they lie.
pub(crate) fn labels(texture: &DrawnTexture, origins: &[u32]) -> Vec<u32> {
    let labels = texture.texture.map.as_ref().map_or(&[][..], |map| &map.labels);
    origins.iter().map(|&origin| labels.get(origin as usize).copied().unwrap_or(0).into()).collect()
}

/// The pieces of a root's triangles as [`DrawnRoot::joined`] lists them.
pub(crate) fn joined_labels(texture: &DrawnTexture, drawn: &DrawnRoot) -> Vec<u32> {
    let inner = &drawn.surface.origins[..drawn.surface.triangles.len().min(drawn.surface.origins.len())];
    let strips = drawn.strips.iter().flat_map(|strip| &strip.origins);
    labels(texture, &inner.iter().chain(strips).copied().collect::<Vec<_>>())
}

/// Gives each vertex one piece: those on lines between pieces are doubled. Returns the piece of each vertex.
pub(crate) fn split(positions: &mut Vec<[f64; 3]>, triangles: &mut [[u32; 3]], labels: &[u32]) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let mut pieces = vec![NONE; positions.len()];
    let mut doubled = std::collections::HashMap::new();
    for (corners, &label) in triangles.iter_mut().zip(labels) {
        for corner in corners {
            let piece = &mut pieces[*corner as usize];
            if *piece == NONE {
                *piece = label;
            }
            if *piece != label {
                *corner = *doubled.entry((*corner, label)).or_insert_with(|| {
                    positions.push(positions[*corner as usize]);
                    pieces.push(label);
                    positions.len() as u32 - 1
                });
            }
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn split_triangles_keep_their_points_and_have_one_piece_each() {
        let before: Vec<[f64; 3]> = (0..4).map(|k| [f64::from(k), 0.0, 0.0]).collect();
        let fan = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        for labels in [[0, 0, 0, 0], [0, 1, 0, 1], [3, 2, 1, 0]] {
            let (mut positions, mut triangles) = (before.clone(), fan);
            let pieces = split(&mut positions, &mut triangles, &labels);
            assert_eq!(pieces.len(), positions.len());
            for ((corners, old), label) in triangles.iter().zip(fan).zip(labels) {
                assert_eq!(corners.map(|k| positions[k as usize]), old.map(|k| before[k as usize]));
                assert!(corners.iter().all(|&k| pieces[k as usize] == label));
            }
            let different = labels.iter().collect::<std::collections::BTreeSet<_>>().len();
            assert!(positions.len() <= 4 * different);
        }
    }

    #[test]
    fn numbers_survive_as_two_bytes() {
        let meaning = Meaning { kind: ChannelKind::Scalar, low: 0.0, step: 1.0 };
        for number in [0_u16, 1, 255, 256, 4711, 65535] {
            let [high, low, _, there] = meaning.texel(&[number.into()], false);
            assert_eq!((u16::from_be_bytes([high, low]), there), (number, 255));
        }
        assert_eq!(Meaning { kind: ChannelKind::Colour, ..meaning }.texel(&[10.0], true), [10, 10, 10, 255]);
        assert_ne!(class_colour(1), class_colour(2));
    }
}
