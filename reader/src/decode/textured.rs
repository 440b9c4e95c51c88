//! Cuts with what the surface carries: images, and where each triangle lies in them.

use std::cell::LazyCell;

use super::{Covered, Drawing, Mesh, cut::joined};
use crate::{
    codec::{
        patch::{LatticePoint, Patch},
        texels::{Image, Map, SCALES},
    },
    error::{Error, Result},
    index::{ChannelInfo, ChannelKind, Index, Scale, TexelBytes, lists::together},
    select::{Cut, Node},
    source::Fetched,
};

/// The image of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ChannelImage {
    /// Colours, as screens show them (sRGB), with straight opacity where there are four components.
    Colours(Image<u8>),
    /// Directions of length 1: each of three components is 128 + 127 times a coordinate.
    Normals(Image<u8>),
    /// Numbers from 0 to 1: 255 times the value.
    Factors(Image<u8>),
    /// Numbers: a value is `low + number * step` of the channel.
    Values(Image<u16>),
}

/// The images of a root at a level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texture {
    /// The level of the block.
    pub level: u8,
    /// Where the triangles of the block's patch lie in images of the size that these have; None for a block without
    /// texels.
    pub map: Option<Map>,
    /// The image of each channel that was asked for; None where the block has no texels of it.
    pub images: Vec<Option<ChannelImage>>,
}

/// A mesh with images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexturedMesh {
    /// The same mesh as without.
    pub mesh: Mesh,
    /// For each triangle the places of its corners in the images of its node, in texels: the first texel lies between 0
    /// and 1. NaN where the node has none.
    pub places: Vec<[[f32; 2]; 3]>,
    /// For each node of the cut its images.
    pub textures: Vec<Texture>,
}

impl Texture {
    /// Decodes the texels of a block whose patch has these vertices, at the scale of the bytes. Images that are not in
    /// scales are halved, but for palettes ([`Map::is_palette`]).
    ///
    /// # Errors
    /// [`Error::Format`] and [`Error::Limit`].
    pub fn decode(
        bytes: &TexelBytes,
        channels: &[&ChannelInfo],
        positions: &[LatticePoint],
        patch: &Patch,
        texel_limit: u64,
    ) -> Result<Self> {
        let level = bytes.level;
        if bytes.map.is_empty() {
            return Ok(Self { level, map: None, images: vec![None; channels.len()] });
        }
        let full = Map::decode(&bytes.map, positions, &patch.triangles, texel_limit)?;
        let is_whole = full.is_palette() && !channels.iter().any(|channel| channel.is_scaled);
        let halvings = if is_whole { 0 } else { bytes.scale.halvings() };
        let covered = LazyCell::new(|| Covered::new(&full, positions, &patch.triangles, false));
        let image = |(streams, channel): (&Vec<Vec<u8>>, &&ChannelInfo)| {
            if streams.first().is_none_or(Vec::is_empty) {
                return Ok(None);
            }
            if channel.is_scaled {
                if streams.len() + usize::from(halvings) != SCALES {
                    return Err(Error::format("an image does not have the streams of its scale"));
                }
                return scaled_image(streams, channel, &full).map(Some);
            }
            let Some(mut image) = whole_image(&streams[0], channel, &full)? else { return Ok(None) };
            if halvings > 0 {
                covered.fill_image(&mut image);
                image = covered.halved_image(&image, halvings, !channel.kind.is_of_numbers());
            }
            Ok(Some(image))
        };
        let images = bytes.images.iter().zip(channels).map(image).collect::<Result<Vec<_>>>()?;
        let map = if halvings > 0 { full.halved(halvings) } else { full };
        Ok(Self { level, map: Some(map), images })
    }
}

/// An image of one stream.
fn whole_image(bytes: &[u8], channel: &ChannelInfo, map: &Map) -> Result<Option<ChannelImage>> {
    let &ChannelInfo { kind, is_exact, components, .. } = channel;
    let decode_bytes = if is_exact { Image::decode_exact } else { Image::decode_colours };
    let decode_normals = if is_exact { Image::decode_exact_normals } else { Image::decode_normals };
    Ok(Some(match kind {
        ChannelKind::Colour => ChannelImage::Colours(decode_bytes(bytes, map.size, components)?),
        ChannelKind::Normal => ChannelImage::Normals(decode_normals(bytes, map)?),
        ChannelKind::Factor => ChannelImage::Factors(decode_bytes(bytes, map.size, components)?),
        ChannelKind::Unknown(_) => return Ok(None),
        _ => ChannelImage::Values(Image::decode_values(bytes, map.size, components)?),
    }))
}

/// An image in scales, of which the map in full is given.
fn scaled_image(streams: &[Vec<u8>], channel: &ChannelInfo, map: &Map) -> Result<ChannelImage> {
    let &ChannelInfo { kind, components, .. } = channel;
    Ok(match kind {
        ChannelKind::Colour => ChannelImage::Colours(Image::decode_scaled(streams, map.size, components)?),
        ChannelKind::Normal => ChannelImage::Normals(Image::decode_scaled_normals(streams, map)?),
        _ => ChannelImage::Factors(Image::decode_scaled(streams, map.size, components)?),
    })
}

impl TexturedMesh {
    /// What the surface carries at each vertex, in the numbers of the images: of a channel that was asked for as number
    /// `channel`, and is of this kind. It is the mean of what the triangles around the vertex show there, or of labels
    /// what the first one shows. None where nothing is known; NaN for components that the channel does not have.
    pub fn vertex_values(&self, channel: usize, kind: ChannelKind) -> Vec<Option<[f64; 4]>> {
        let mut sums = vec![([0.0; 4], 0.0); self.mesh.positions.len()];
        for ((corners, places), &node) in self.mesh.triangles.iter().zip(&self.places).zip(&self.mesh.triangle_nodes) {
            let image = self.textures.get(node as usize).and_then(|texture| texture.images.get(channel)?.as_ref());
            let Some(image) = image else { continue };
            for (&corner, place) in corners.iter().zip(places) {
                let Some((sum, count)) = sums.get_mut(corner as usize) else { continue };
                if kind.is_of_numbers() && *count > 0.0 {
                    continue;
                }
                let values = image.at(place.map(f64::from), kind);
                (0..4).for_each(|k| sum[k] += values[k]);
                *count += 1.0;
            }
        }
        sums.into_iter().map(|(sum, count)| (count > 0.0).then(|| sum.map(|x| x / count))).collect()
    }

    /// How each triangle is drawn: what its middle shows of a channel of kind [`ChannelKind::Drawing`] that was asked
    /// for as number `channel`. The usual way where nothing is known.
    pub fn drawings(&self, channel: usize) -> Vec<Drawing> {
        let of = |(places, &node): (&[[f32; 2]; 3], &u32)| {
            let image = self.textures.get(node as usize).and_then(|texture| texture.images.get(channel)?.as_ref());
            image.map_or(Drawing::default(), |image| {
                let middle = [0, 1].map(|axis| places.iter().map(|place| f64::from(place[axis])).sum::<f64>() / 3.0);
                Drawing::of_number(image.at(middle, ChannelKind::Drawing)[0] as u16)
            })
        };
        self.places.iter().zip(&self.mesh.triangle_nodes).map(of).collect()
    }
}

impl ChannelImage {
    /// The values at a place in texels: interpolated, or of the texel there if nothing lies between them. NaN beyond
    /// its components.
    fn at(&self, place: [f64; 2], kind: ChannelKind) -> [f64; 4] {
        let place = if kind.is_of_numbers() { place.map(|x| x.floor() + 0.5) } else { place };
        let (mut values, components) = match self {
            Self::Colours(image) | Self::Normals(image) | Self::Factors(image) => {
                (image.interpolated(place), image.components)
            }
            Self::Values(image) => (image.interpolated(place), image.components),
        };
        values.iter_mut().skip(components.into()).for_each(|value| *value = f64::NAN);
        values
    }
}

/// As [`super::extract`], with the images of some channels, by number.
///
/// # Errors
/// As [`super::extract`] and [`Index::texels`].
pub fn extract_textured(index: &Index, cut: &Cut, channels: &[u8], fetched: &Fetched) -> Result<TexturedMesh> {
    extract(index, cut, (0, Scale::Full), channels, fetched)
}

/// As [`extract_textured`], with images of a part of their texels along each side. Of images in scales no more is asked
/// for than that part takes.
///
/// # Errors
/// As [`extract_textured`].
pub fn extract_textured_scaled(
    index: &Index,
    cut: &Cut,
    channels: &[u8],
    scale: Scale,
    fetched: &Fetched,
) -> Result<TexturedMesh> {
    extract(index, cut, (0, scale), channels, fetched)
}

/// As [`super::extract_with_borders`], with the images of some channels, by number.
///
/// # Errors
/// As [`extract_textured`].
pub fn extract_textured_with_borders(
    index: &Index,
    cut: &Cut,
    border_level: u8,
    channels: &[u8],
    fetched: &Fetched,
) -> Result<TexturedMesh> {
    extract(index, cut, (border_level, Scale::Full), channels, fetched)
}

fn extract(
    index: &Index,
    cut: &Cut,
    (border_level, scale): (u8, Scale),
    channels: &[u8],
    fetched: &Fetched,
) -> Result<TexturedMesh> {
    index.id().check_cut(cut.file)?;
    let wanted: Vec<(u32, u8)> = cut.nodes.iter().map(|node| (node.root, node.level)).collect();
    let known: Vec<&ChannelInfo> =
        channels.iter().filter_map(|&channel| index.channels().get(usize::from(channel))).collect();
    let texels = match index.texels(&wanted, channels, scale, fetched) {
        Ok(texels) => texels,
        // What else is missing is asked for at once.
        Err(missing) => {
            let geometry = joined(index, cut, border_level, fetched, None).map(drop);
            return together::<(), ()>([Err(missing), geometry]).map(|()| TexturedMesh::default());
        }
    };
    let (mut texels, mut textures) = (texels.iter(), Vec::new());
    let mut decode_texture = |node: Node, patch: &Patch, positions: Vec<LatticePoint>| {
        let bytes = texels.next().ok_or_else(|| Error::format("a node has no texels"))?;
        let texture = Texture::decode(bytes, &known, &positions, patch, index.limits().texel_count);
        let mut texture =
            texture.map_err(|error| error.at(|| format!("texels of root {}, level {}", node.root, node.level)))?;
        if let (Some(map), true) = (&texture.map, scale.halvings() > 0) {
            let covered = Covered::new(map, &positions, &patch.triangles, true);
            for image in texture.images.iter_mut().flatten() {
                covered.fill_image(image);
            }
        }
        textures.push(texture);
        Ok(())
    };
    let (mesh, origins) = joined(index, cut, border_level, fetched, Some(&mut decode_texture))?;
    let lattice = index.lattice();
    let place = |(number, corners): (usize, &[u32; 3])| {
        let map = textures.get(mesh.triangle_nodes[number] as usize).and_then(|texture| texture.map.as_ref());
        let Some(map) = map else { return [[f32::NAN; 2]; 3] };
        let piece = map.piece(origins[number] as usize);
        corners.map(|corner| {
            let units = lattice.units(mesh.positions[corner as usize]);
            piece.place(units.map(|x| x.round() as i64)).map(|x| x as f32)
        })
    };
    let places = mesh.triangles.iter().enumerate().map(place).collect();
    Ok(TexturedMesh { mesh, places, textures })
}
