//! The texels of a file for a loader: streams of blocks, and the images of a root at a level and a size, which are
//! decoded together.
//!
//! An image lies over the triangles of one block, so it can be decoded only for a surface that is there. Geometry never
//! waits for it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{drawn_surface::DrawnSurface, job::Content, queue::ByteSpan};
use crate::{
    codec::{
        patch::Patch,
        texels::{Map, halved},
    },
    decode::{ChannelImage, Covered, Texture},
    error::{Error, Result},
    index::{ChannelInfo, Index, Scale, TexelBytes, texels::StreamKey},
    lattice::LatticePoint,
    sorted::SortedMap,
    source::Fetched,
};

/// The size of an image that has all of its texels; one of each size below has half as many along each side.
pub(crate) const FULL: u8 = 7;
/// An eighth along each side.
pub(crate) const EIGHTH: u8 = FULL - 3;

/// A root at a level, with images of a size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TexelUnit {
    pub level: u8,
    pub root: u32,
    /// At most [`FULL`].
    pub size: u8,
}

impl TexelUnit {
    /// How often its images are halved along each side.
    fn halvings(self) -> u8 {
        FULL.saturating_sub(self.size)
    }

    /// What is read of images in scales for it.
    fn scale(self) -> Scale {
        Scale::of_halvings(self.halvings())
    }
}

/// The images of a root at a level, ready to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnTexture {
    /// The root's number.
    pub root: u32,
    /// The map and the images of the channels that the session shows. Texels beside the pieces have the values of the
    /// nearest ones of their piece, so that means may be taken of several.
    pub texture: Texture,
    /// For each of these channels the mean over the root, in the numbers of the image.
    pub means: Vec<Option<[f64; 4]>>,
    /// How often map and images have been halved along each side from those of the file, because fewer texels are
    /// seen, or because more would not fit.
    pub halvings: u8,
    pub(crate) extent: Extent,
}

/// What is known of a block's images, whatever their size is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Extent {
    /// Columns and rows of the images in the file; 0 without images.
    full: [u32; 2],
    /// Bytes of a texel in memory, of all channels together.
    texel_bytes: u64,
    /// Bytes of everything else.
    other_bytes: u64,
    /// The side of a texel in the file, lattice units: the root of the mean area, by pieces of the map.
    pub texel: f64,
}

impl Extent {
    /// From a map and images that have been halved so often.
    fn new(map: Option<&Map>, images: &[Option<ChannelImage>], halvings: u8) -> Self {
        let Some(map) = map else { return Self { other_bytes: size_of::<DrawnTexture>() as u64, ..Self::default() } };
        let texel_bytes = images.iter().flatten().map(|image| match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                u64::from(image.components)
            }
            ChannelImage::Values(image) => 2 * u64::from(image.components),
        });
        let (mut area, mut count) = (0.0, 0.0);
        for piece in &map.pieces {
            let [low, high] = piece.range();
            let texels = (high[0] - low[0]).max(1.0) * (high[1] - low[1]).max(1.0);
            let side = piece.texel_size();
            (area, count) = (area + texels * side * side, count + texels);
        }
        let other_bytes = size_of::<DrawnTexture>() + 2 * map.labels.len() + size_of_val(&map.pieces[..]);
        let times = 1 << halvings.min(31);
        Self {
            // At most by a row and a column of the smaller image too large.
            full: map.size.map(|length| length * times),
            texel_bytes: texel_bytes.sum(),
            other_bytes: other_bytes as u64,
            texel: (area / f64::max(count, 1.0)).sqrt() / f64::from(times),
        }
    }

    /// Bytes in memory at a size.
    pub fn bytes(&self, size: u8) -> u64 {
        let texels: u64 =
            halved(self.full, FULL.saturating_sub(size)).iter().map(|&length| u64::from(length)).product();
        self.other_bytes + texels * self.texel_bytes
    }
}

/// Some channels of a file, as far as it is known where their texels are.
#[derive(Debug)]
pub(crate) struct TexelContent {
    index: Arc<Index>,
    channels: Vec<u8>,
    /// What was read last of tables and directories, with what came with opening. The index keeps what it has parsed.
    fetched: Mutex<Fetched>,
    /// The surfaces whose images are wanted or being decoded.
    surfaces: Mutex<SortedMap<TexelUnit, Arc<DrawnSurface>>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl TexelContent {
    /// # Errors
    /// [`Error::Query`] if a channel does not exist or occurs twice.
    pub fn new(index: Arc<Index>, channels: &[u8]) -> Result<Self> {
        let count = index.channels().len();
        for (number, channel) in channels.iter().enumerate() {
            if usize::from(*channel) >= count {
                return Err(Error::Query { what: format!("there is no channel {channel}: the file has {count}") });
            }
            if channels[..number].contains(channel) {
                return Err(Error::Query { what: format!("channel {channel} is wanted twice") });
            }
        }
        let fetched = Mutex::new(index.fetched());
        Ok(Self { index, channels: channels.to_vec(), fetched, surfaces: Mutex::default() })
    }

    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Notes the surface of a unit that is wanted, whose maps are of all objects.
    pub fn add_surface(&self, unit: TexelUnit, surface: &Arc<DrawnSurface>) {
        locked(&self.surfaces).insert(unit, Arc::clone(surface.whole()));
    }

    /// Forgets surfaces that are not wanted any more.
    pub fn keep_surfaces(&self, is_wanted: impl Fn(TexelUnit) -> bool) {
        locked(&self.surfaces).retain(|&unit, _| is_wanted(unit));
    }
}

impl Content for TexelContent {
    type Page = StreamKey;
    type Unit = TexelUnit;
    type Data = DrawnTexture;

    fn pages(&self, unit: TexelUnit) -> Result<Vec<StreamKey>> {
        let mut fetched = locked(&self.fetched);
        let parts = self.index.texel_parts((unit.root, unit.level), &self.channels, unit.scale(), &fetched);
        if !matches!(parts, Ok(_) | Err(Error::Missing { .. })) {
            // What is not sound is read again when it is asked for again.
            *fetched = self.index.fetched();
        }
        parts
    }

    fn supply(&self, offset: u64, bytes: Vec<u8>) {
        // Units that wait for these ask for them at once, and the index keeps what they say. So what came before is not
        // kept.
        let mut fetched = self.index.fetched();
        fetched.insert(offset, bytes);
        *locked(&self.fetched) = fetched;
    }

    fn span(&self, page: StreamKey) -> ByteSpan {
        let part = self.index.texel_part(page);
        ByteSpan { offset: self.index.texels_offset().saturating_add(part.offset), length: part.length }
    }

    fn is_sound(&self, page: StreamKey, bytes: &[u8]) -> bool {
        crc32fast::hash(bytes) == self.index.texel_part(page).checksum
    }

    fn is_pinned(&self, _: TexelUnit) -> bool {
        false
    }

    fn decode(
        &self,
        unit: TexelUnit,
        pages: &[(StreamKey, Arc<[u8]>)],
        _: Option<&DrawnTexture>,
    ) -> Result<DrawnTexture> {
        let surface = locked(&self.surfaces).get(&unit).cloned();
        let surface = surface.ok_or_else(|| Error::format("a surface with texels is gone"))?;
        let lattice = self.index.lattice();
        let point = |&world: &[f64; 3]| lattice.units(world).map(|x| x.round() as i64);
        let positions: Vec<LatticePoint> = surface.positions.iter().map(point).collect();
        let patch = Patch { triangles: surface.patch_triangles(), ..Patch::default() };
        let stream = |number: usize| {
            let page = pages.iter().find(|((.., stream), _)| *stream == number);
            page.map_or(vec![], |(_, bytes)| bytes.to_vec())
        };
        let (halvings, scale) = (unit.halvings(), unit.scale());
        let streams = |&channel: &u8| self.index.image_streams(channel, scale).map(stream).collect();
        let images = self.channels.iter().map(streams).collect();
        let bytes = TexelBytes { level: unit.level, scale, map: stream(0), images };
        let infos = self.channels.iter().filter_map(|&channel| self.index.channels().get(usize::from(channel)));
        let infos: Vec<&ChannelInfo> = infos.collect();
        let mut texture = Texture::decode(&bytes, &infos, &positions, &patch, self.index.limits().texel_count)?;
        let extent = Extent::new(texture.map.as_ref(), &texture.images, scale.halvings());
        let mut means = vec![None; texture.images.len()];
        if let Some(map) = &texture.map {
            let covered = Covered::new(map, &positions, &patch.triangles, scale.halvings() > 0);
            let rest = halvings - scale.halvings();
            for ((image, mean), info) in texture.images.iter_mut().zip(&mut means).zip(&infos) {
                let Some(image) = image else { continue };
                *mean = Some(covered.fill_image(image));
                if rest > 0 {
                    *image = covered.halved_image(image, rest, !info.kind.is_of_numbers());
                }
            }
            if rest > 0 {
                texture.map = Some(map.halved(rest));
            }
        }
        Ok(DrawnTexture { root: unit.root, texture, means, halvings, extent })
    }

    fn byte_count(&self, data: &DrawnTexture) -> u64 {
        data.extent.bytes(FULL - data.halvings.min(FULL))
    }

    fn page_name(&self, page: StreamKey) -> String {
        self.index.texel_location(page)
    }

    fn unit_name(&self, TexelUnit { root, level, .. }: TexelUnit) -> String {
        format!("texels of root {root}, level {level}")
    }
}
