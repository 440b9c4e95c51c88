//! A root's image on the GPU: one texture, and a table of pieces from which the shader finds the place of any point.
//!
//! There are no texture coordinates: a place is the product of a point with two vectors of its piece ([`Piece`]), also
//! for the points that finer neighbours insert into the border. Points are taken from an origin of the root's own, so
//! that single precision suffices.

use lodpack::{
    Lattice,
    decode::{Appearance, ChannelImage, Look, coverages, texels::Piece},
    heights::{CELLS, SIDE},
    stream::{DrawnRoot, TileImages},
};
use wgpu::{BufferUsages, TextureFormat, TextureUsages};

use crate::{
    camera::pair,
    gpu::{Gpu, Resource},
};

/// Four bytes of a texel: red, green, blue; or a number, the higher byte first. The last one is its coverage
/// (`Drawing::coverage`): all of it, where no channel says how the surface is drawn.
type Texel = [u8; 4];

/// A texel of the values of a channel.
fn texel(shown: &Appearance, values: &[f64]) -> Texel {
    match shown.look() {
        Look::Ramp => {
            let [high, low] = (values.first().copied().unwrap_or(0.0).round() as u16).to_be_bytes();
            [high, low, 0, 255]
        }
        Look::Colours | Look::Directions | Look::Classes => shown.colour(values),
    }
}

fn texels(shown: &Appearance, image: &ChannelImage) -> ([u32; 2], Vec<Texel>) {
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
            (image.size, all(&image.data, image.components, |values| texel(shown, values)))
        }
        ChannelImage::Values(image) => (image.size, all(&image.data, image.components, |values| texel(shown, values))),
    }
}

/// The mean of a root as a texel; all 0 if there is none.
pub(crate) fn mean(shown: &Appearance, drawn: &DrawnRoot) -> u32 {
    let mean = drawn.mean(0).filter(|_| shown.look() != Look::Classes);
    u32::from_le_bytes(mean.map_or([0; 4], |mean| texel(shown, &mean)))
}

/// The number of a look in the shader.
pub(crate) fn look_number(look: Look) -> f32 {
    match look {
        Look::Colours => 1.0,
        Look::Ramp => 2.0,
        Look::Classes => 3.0,
        Look::Directions => 4.0,
    }
}

/// A root's image, with its table of pieces.
pub(crate) struct Texels {
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
        shown: &Appearance,
    ) -> Result<Option<Self>, String> {
        let Some(texture) = drawn.texture() else { return Ok(None) };
        let (Some(map), Some(Some(image))) = (&texture.texture.map, texture.texture.images.first()) else {
            return Ok(None);
        };
        let (size, mut texels) = texels(shown, image);
        let others = texture.texture.images.iter().skip(1).flatten();
        if let Some(covered) = others.filter_map(|drawings| coverages(image, drawings)).next() {
            texels.iter_mut().zip(covered).for_each(|(texel, coverage)| texel[3] = coverage);
        }
        let most = gpu.device.limits().max_texture_dimension_2d;
        let root = drawn.surface.root;
        if size.iter().any(|&length| length > most) {
            let [width, height] = size;
            return Err(format!(
                "root {root} has an image of {width}x{height} texels; this device draws {most}x{most}"
            ));
        }
        let format = match shown.look() {
            Look::Ramp => TextureFormat::Rgba8Unorm,
            Look::Colours | Look::Directions | Look::Classes => TextureFormat::Rgba8UnormSrgb,
        };
        let image = uploaded(gpu, size, format, texels.as_flattened());
        let normals = texture.texture.images.iter().flatten().find_map(|image| match image {
            ChannelImage::Normals(image) => Some(image),
            _ => None,
        });
        let normals = normals.map_or(([1; 2], vec![[0; 4]]), |image| {
            (image.size, image.data.chunks_exact(3).map(|texel| [texel[0], texel[1], texel[2], 255]).collect())
        });
        let normals = uploaded(gpu, normals.0, TextureFormat::Rgba8Unorm, normals.1.as_flattened());

        let origin = drawn.surface.positions.first().copied().unwrap_or_default();
        let [x, y, z, low_x, low_y, low_z] = pair(origin);
        let inner_count = f32::from_bits(drawn.surface.triangles.len() as u32);
        let mut pieces = vec![[x, y, z, 0.0], [low_x, low_y, low_z, inner_count]];
        // What the shader takes as the origin.
        let origin = [0, 1, 2].map(|k| f64::from([x, y, z][k]) + f64::from([low_x, low_y, low_z][k]));
        pieces.extend(map.pieces.iter().flat_map(|piece| piece_rows(piece, lattice, origin)));
        let labels: Vec<u32> = texture.labels(&drawn.surface.origins).collect();
        Ok(Some(Self::of(gpu, &pieces, &labels, [image, normals])))
    }

    /// Texels for each sample of a tile of heights that is shown with an appearance.
    pub fn per_sample(images: &TileImages, shown: &Appearance) -> u32 {
        match (&images.colours, shown.look()) {
            (Some(_), Look::Colours) => images.per_sample,
            _ => 1,
        }
    }

    /// Uploads the images of a tile of heights: its normals, and colours or directions, whichever is shown.
    pub fn of_tile(gpu: &Gpu, images: &TileImages, shown: &Appearance) -> Self {
        let size = [SIDE as u32; 2];
        let per_sample = Self::per_sample(images, shown);
        let texels: Vec<Texel> = match (&images.colours, shown.look()) {
            (Some(colours), Look::Colours) => colours.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
            _ => images.normals.iter().map(|normal| direction(*normal)).collect(),
        };
        let texels =
            uploaded(gpu, [CELLS as u32 * per_sample + 1; 2], TextureFormat::Rgba8UnormSrgb, texels.as_flattened());
        // As bytes would be, with more digits.
        let normals = images.half_floats([1.0 / 255.0, 1.0]);
        let normals = uploaded(gpu, size, TextureFormat::Rgba16Float, bytemuck::cast_slice(&normals));
        let (least, most) = (0.5, (CELLS as u32 * per_sample) as f32 + 0.5);
        let mut pieces = [[0.0; 4]; 5];
        pieces[0][3] = per_sample as f32;
        pieces[4] = [least, least, most, most];
        Self::of(gpu, &pieces, &[0], [texels, normals])
    }

    fn of(gpu: &Gpu, pieces: &[[f32; 4]], labels: &[u32], [image, normals]: [wgpu::Texture; 2]) -> Self {
        let pieces = gpu.buffer(pieces, BufferUsages::STORAGE);
        let labels = gpu.buffer(labels, BufferUsages::STORAGE);
        let [view, normals] = [image, normals].map(|image| image.create_view(&Default::default()));
        let resources = [
            Resource::Buffer(&pieces),
            Resource::Texture(&view),
            Resource::Sampler,
            Resource::Buffer(&labels),
            Resource::Texture(&normals),
        ];
        Self { group: gpu.bind_all(&gpu.pipelines.texels_layout, &resources) }
    }
}

/// A normal as a colour.
fn direction(normal: [i16; 3]) -> Texel {
    let [x, y, z] = normal.map(|x| (128.0 + 127.0 * f64::from(x) / 32767.0).round() as u8);
    [x, y, z, 255]
}

/// A texture of these texels.
fn uploaded(gpu: &Gpu, size: [u32; 2], format: TextureFormat, texels: &[u8]) -> wgpu::Texture {
    let image = gpu.texture(size, format, TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST);
    gpu.write_texels(&image, texels);
    image
}

/// A piece in the shader: for each coordinate of a place what a point from the origin is multiplied with, and what is
/// added; then its range.
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

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack::index::{ChannelInfo, ChannelKind};

    #[test]
    fn numbers_survive_as_two_bytes() {
        let (name, kind) = ("x".into(), ChannelKind::Scalar);
        let shown = Appearance::new(&ChannelInfo {
            name,
            kind,
            is_exact: false,
            is_scaled: false,
            components: 1,
            low: 0.0,
            step: 1.0,
            bound: 0.0,
        });
        for number in [0_u16, 1, 255, 256, 4711, 65535] {
            let [high, low, _, there] = texel(&shown, &[number.into()]);
            assert_eq!((u16::from_be_bytes([high, low]), there), (number, 255));
        }
    }
}
