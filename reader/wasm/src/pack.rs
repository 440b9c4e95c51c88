//! What a frame changes, packed for the GPU: `js/frame.js` reads it.

use std::{collections::BTreeMap, sync::Arc};

use lodpack::{
    Lattice,
    decode::{Appearance, ChannelImage, Look, coverages, texels::Piece},
    stream::{ByPiece, Changes, DrawnRoot, DrawnTexture, Lit, Picture, TileImages},
};

use crate::{
    answer::{Put, put_all, put_normals, put_triangles},
    dress::{Dresser, put_images, put_places, side_of},
};

/// The image of a root that the page has.
#[derive(Debug)]
enum Sent {
    Image(Arc<DrawnTexture>),
    /// A single texel, which stands for an image that is not there.
    Mean([u8; 4]),
}

/// Nobody has a painter in a module without channels, and the compiler leaves out what would use it.
#[derive(Debug)]
enum HasChannels {
    #[cfg(feature = "channels")]
    Yes,
}

/// The channels that come with the one that is shown: where they are among those of the session.
#[derive(Clone, Debug, Default)]
pub struct Beside {
    pub normals: Option<usize>,
    /// Occlusion, roughness and metalness, if there is any of them.
    pub material: Option<[Option<usize>; 3]>,
    pub emissive: Option<usize>,
    /// How the surface is drawn.
    pub drawing: Option<usize>,
}

/// The channel that is shown, what comes with it, and the images that the page has.
#[derive(Debug)]
pub struct Painter {
    _has: HasChannels,
    appearance: Appearance,
    beside: Beside,
    sent: BTreeMap<u32, Sent>,
}

/// An image to upload, and others of its size: four bytes a texel in all of them.
struct Painted {
    size: [u32; 2],
    texels: Vec<u8>,
    /// Components from 0 to 255 for -1 to 1, and 255.
    normals: Option<Vec<u8>>,
    /// Occlusion, roughness and metalness, and 255.
    material: Option<Vec<u8>>,
    /// Red, green, blue and 255.
    emissive: Option<Vec<u8>>,
}

impl Painted {
    fn of_texel(texel: [u8; 4]) -> Self {
        Self { size: [1; 2], texels: texel.to_vec(), normals: None, material: None, emissive: None }
    }
}

impl Beside {
    /// The image of normals, if the block has one.
    fn normals(&self, images: &[Option<ChannelImage>]) -> Option<Vec<u8>> {
        let Some(ChannelImage::Normals(image)) = images.get(self.normals?)? else { return None };
        let component = |byte: u8| ((f32::from(byte) - 128.0) * (127.5 / 127.0) + 127.5).round() as u8;
        Some(
            image
                .data
                .as_chunks()
                .0
                .iter()
                .flat_map(|&[x, y, z]| [component(x), component(y), component(z), 255])
                .collect(),
        )
    }

    /// What a material has of occlusion, roughness and metalness; as a block without images is, where it lacks one.
    fn material(&self, images: &[Option<ChannelImage>], texel_count: usize) -> Option<Vec<u8>> {
        let mut texels = [255, 255, 0, 255].repeat(texel_count);
        for (k, number) in self.material?.into_iter().enumerate() {
            let image = number.and_then(|number| images.get(number)?.as_ref());
            if let Some(ChannelImage::Factors(image)) = image {
                let values = image.data.iter().step_by(usize::from(image.components.max(1)));
                texels.as_chunks_mut::<4>().0.iter_mut().zip(values).for_each(|(texel, &value)| texel[k] = value);
            }
        }
        Some(texels)
    }

    /// Replaces the opacity of texels by how much of them is there.
    fn cover(&self, colours: &ChannelImage, images: &[Option<ChannelImage>], texels: &mut [u8]) {
        let drawings = self.drawing.and_then(|number| images.get(number)?.as_ref());
        if let Some(covered) = drawings.and_then(|drawings| coverages(colours, drawings)) {
            texels.as_chunks_mut::<4>().0.iter_mut().zip(covered).for_each(|(texel, coverage)| texel[3] = coverage);
        }
    }

    /// Emitted light.
    fn emissive(&self, images: &[Option<ChannelImage>], texel_count: usize) -> Option<Vec<u8>> {
        match images.get(self.emissive?)? {
            Some(ChannelImage::Colours(image)) => {
                let texels = image.data.chunks_exact(usize::from(image.components.max(3)));
                Some(texels.flat_map(|texel| [texel[0], texel[1], texel[2], 255]).collect())
            }
            _ => Some([0, 0, 0, 255].repeat(texel_count)),
        }
    }
}

impl Painter {
    #[cfg(feature = "channels")]
    pub fn new(appearance: Appearance, beside: Beside) -> Self {
        Self { _has: HasChannels::Yes, appearance, beside, sent: BTreeMap::new() }
    }

    /// Forgets which images the page has.
    pub fn lose(&mut self) {
        self.sent.clear();
    }

    /// The image of a root, if the page has another one.
    fn image(&mut self, drawn: &DrawnRoot) -> Option<Painted> {
        let root = drawn.surface.root;
        let image = drawn.texture().and_then(|texture| Some((texture, texture.texture.images.first()?.as_ref()?)));
        if let Some((texture, image)) = image {
            if matches!(self.sent.get(&root), Some(Sent::Image(sent)) if Arc::ptr_eq(sent, texture)) {
                return None;
            }
            let mut texels = Vec::new();
            self.appearance.paint(image, &mut texels);
            self.beside.cover(image, &texture.texture.images, &mut texels);
            self.sent.insert(root, Sent::Image(Arc::clone(texture)));
            let (images, count) = (&texture.texture.images[..], texels.len() / 4);
            return Some(Painted {
                size: texture.texture.map.as_ref().map_or([0; 2], |map| map.size),
                texels,
                normals: self.beside.normals(images),
                material: self.beside.material(images, count),
                emissive: self.beside.emissive(images, count),
            });
        }
        // Classes have no mean. White without opacity says that nothing is known.
        let mean = drawn.mean(0).filter(|_| self.appearance.look() != Look::Classes);
        let texel = mean.map_or([255, 255, 255, 0], |mean| self.appearance.colour(&mean));
        if matches!(self.sent.get(&root), Some(Sent::Mean(sent)) if *sent == texel) {
            return None;
        }
        self.sent.insert(root, Sent::Mean(texel));
        Some(Painted::of_texel(texel))
    }
}

/// A root as it is uploaded.
struct Packed<'p> {
    drawn: &'p DrawnRoot,
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// The normal of each vertex; none in a stream without light.
    normals: Vec<[i16; 2]>,
    /// The piece of each vertex; none without an image of more than a texel.
    pieces: Option<Vec<u32>>,
    image: Option<Painted>,
    tile_images: Option<&'p Arc<TileImages>>,
}

impl Packed<'_> {
    /// Whether it has a channel, places, normals of a tile, and colours beside these; then normals, a material and
    /// emitted light of its new image, and normals of vertices; and the size of the image, if it has one.
    fn flags(&self, shows_channel: bool, shows_colours: bool) -> [u32; 3] {
        let is_tile = self.drawn.images().is_some();
        let bits = [
            shows_channel || is_tile,
            self.pieces.is_some() || is_tile,
            self.tile_images.is_some(),
            shows_colours && self.tile_images.is_some_and(|images| images.colours.is_some()),
            self.image.as_ref().is_some_and(|image| image.normals.is_some()),
            self.image.as_ref().is_some_and(|image| image.material.is_some()),
            self.image.as_ref().is_some_and(|image| image.emissive.is_some()),
            !self.normals.is_empty(),
        ];
        let flags = bits.iter().zip(0..).map(|(&bit, k)| u32::from(bit) << k).sum();
        let size = self.image.as_ref().map_or([0; 2], |image| image.size);
        let [width, height] = self.tile_images.map_or(size, |images| [side_of(images, shows_colours) as u32; 2]);
        [flags, width, height]
    }
}

/// Packs what has changed: the error of each changed root (f64), lost roots, removed roots, seven words for each
/// changed root, and then for each its positions (f32), triangles and, with light, normals (i16, two a vertex); where
/// it has an image, the place (f32) and the rectangle (u16) of each vertex in it; and the image, if it is new, with
/// what comes with it: of a tile of heights colours, if these are shown, and normals.
pub fn put_changes(
    output: &mut Vec<u8>,
    (picture, lattice, origin): (&Picture, &Lattice, [f64; 3]),
    (changes, lost_roots): (&Changes, &[u32]),
    (painter, dresser, is_all): (Option<&mut Painter>, &mut Dresser, bool),
) {
    let changed = changed_roots(picture, changes, is_all);
    let shows_channel = painter.is_some();
    let mut painter = painter;
    changes.removed.iter().for_each(|&root| dresser.drop_root(root));
    if let Some(painter) = &mut painter {
        changes.removed.iter().for_each(|root| drop(painter.sent.remove(root)));
    }
    output.put_floats(changed.iter().map(|drawn| drawn.error()));
    output.put_words(lost_roots.iter().chain(&changes.removed).copied());
    let packed: Vec<Packed<'_>> = changed
        .into_iter()
        .map(|drawn| Packed { tile_images: dresser.images(drawn), ..pack(drawn, painter.as_deref_mut()) })
        .collect();
    output.put_words(packed.iter().flat_map(|packed| {
        let [flags, width, height] = packed.flags(shows_channel, dresser.shows_colours);
        let (root, level) = (packed.drawn.surface.root, u32::from(packed.drawn.surface.level));
        [root, level, packed.positions.len() as u32, packed.triangles.len() as u32, flags, width, height]
    }));
    // Both roots at a border have the same world positions there, so they also have the same ones here: no crack can
    // open.
    let place = |position: [f64; 3]| [0, 1, 2].map(|k| (position[k] - origin[k]) as f32);
    for Packed { drawn, positions, triangles, normals, pieces, image, tile_images } in packed {
        put_all(output, &positions, |bytes: &mut [u8; 12], &position| put_array(bytes, place(position)));
        put_triangles(output, &triangles);
        put_normals(output, &normals);
        if drawn.images().is_some() {
            put_places(output, drawn, dresser.shows_colours);
        }
        let map = drawn.texture().and_then(|texture| texture.texture.map.as_ref());
        if let (Some(pieces), Some(map)) = (pieces, map) {
            let none = Piece::default();
            let vertices: Vec<(&Piece, [f64; 3])> =
                pieces.iter().map(|&piece| map.pieces.get(piece as usize).unwrap_or(&none)).zip(positions).collect();
            put_all(output, &vertices, |bytes: &mut [u8; 8], (piece, position)| {
                let units = lattice.units(*position).map(|x| x.round() as i64);
                put_array(bytes, piece.place(units).map(|x| x as f32));
            });
            put_all(output, &vertices, |bytes: &mut [u8; 8], (piece, _)| {
                // The range lies half a texel within the rectangle.
                let [[left, top], [right, bottom]] = piece.range();
                let sides = [left - 0.5, top - 0.5, right + 0.5, bottom + 0.5];
                bytes.as_chunks_mut::<2>().0.iter_mut().zip(sides).for_each(|(to, x)| *to = (x as u16).to_le_bytes());
            });
        }
        if let Some(image) = image {
            output.extend(image.texels);
            [image.normals, image.material, image.emissive].into_iter().flatten().for_each(|more| output.extend(more));
        }
        if let Some(images) = tile_images {
            put_images(output, images, dresser.shows_colours);
        }
    }
}

fn put_array<const N: usize>(bytes: &mut [u8], numbers: [f32; N]) {
    bytes.as_chunks_mut::<4>().0.iter_mut().zip(numbers).for_each(|(bytes, x)| *bytes = x.to_le_bytes());
}

fn pack<'p>(drawn: &'p DrawnRoot, painter: Option<&mut Painter>) -> Packed<'p> {
    let shows_channel = painter.is_some();
    let image = painter.and_then(|painter| painter.image(drawn));
    let has_image = drawn.texture().is_some_and(|texture| texture.texture.images.first().is_some_and(Option::is_some));
    let by_piece = if shows_channel && has_image { drawn.by_piece() } else { None };
    let tile_images = None;
    if let Some(ByPiece { positions, triangles, pieces, normals }) = by_piece {
        return Packed { drawn, positions, triangles, normals, pieces: Some(pieces), image, tile_images };
    }
    let Lit { positions, triangles, normals } = drawn.lit().unwrap_or_else(|| {
        let (positions, triangles) = drawn.joined();
        Lit { positions, triangles, normals: Vec::new() }
    });
    Packed { drawn, positions, triangles, normals, pieces: None, image, tile_images }
}

/// How many roots [`put_changes`] uploads.
pub fn change_count(picture: &Picture, changes: &Changes, is_all: bool) -> usize {
    changed_roots(picture, changes, is_all).len()
}

fn changed_roots<'p>(picture: &'p Picture, changes: &Changes, is_all: bool) -> Vec<&'p DrawnRoot> {
    if is_all {
        return picture.roots().collect();
    }
    let strips = changes.strips.iter().map(|(root, _)| root);
    let mut changed: Vec<u32> =
        changes.surfaces.iter().chain(strips).chain(&changes.textures).chain(&changes.lights).copied().collect();
    changed.sort_unstable();
    changed.dedup();
    changed.into_iter().filter_map(|root| picture.root(root)).collect()
}
