//! The texels of a file for a loader: streams of blocks, and the images of a root at a level, which are decoded
//! together.
//!
//! An image lies over the triangles of one block, so it can be decoded only for a surface that is there. Geometry never
//! waits for it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{drawn_surface::DrawnSurface, job::Content, queue::ByteSpan};
use crate::{
    codec::patch::Patch,
    decode::{ChannelImage, Covered, Texture},
    error::{Error, Result},
    index::{ChannelInfo, Index, TexelBytes, texels::StreamKey},
    lattice::LatticePoint,
    sorted::SortedMap,
    source::Fetched,
};

/// A root at a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TexelUnit {
    pub level: u8,
    pub root: u32,
}

impl TexelUnit {
    pub fn of(surface: &DrawnSurface) -> Self {
        Self { level: surface.level, root: surface.root }
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
}

impl DrawnTexture {
    fn byte_count(&self) -> u64 {
        let images = self.texture.images.iter().flatten().map(|image| match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                image.data.len()
            }
            ChannelImage::Values(image) => 2 * image.data.len(),
        });
        let map = self.texture.map.as_ref().map_or(0, |map| 2 * map.labels.len() + size_of_val(&map.pieces[..]));
        (size_of::<Self>() + map + images.sum::<usize>()) as u64
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

    /// Notes the surface of a unit that is wanted.
    pub fn add_surface(&self, surface: &Arc<DrawnSurface>) {
        locked(&self.surfaces).insert(TexelUnit::of(surface), Arc::clone(surface));
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
        let parts = self.index.texel_parts((unit.root, unit.level), &self.channels, &fetched);
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
        let images = self.channels.iter().map(|&channel| stream(1 + usize::from(channel))).collect();
        let bytes = TexelBytes { level: unit.level, map: stream(0), images };
        let infos = self.channels.iter().filter_map(|&channel| self.index.channels().get(usize::from(channel)));
        let infos: Vec<&ChannelInfo> = infos.collect();
        let mut texture = Texture::decode(&bytes, &infos, &positions, &patch, self.index.limits().texel_count)?;
        let covered = texture.map.as_ref().map(|map| Covered::new(map, &positions, &patch.triangles));
        let mut mean = |image: &mut Option<ChannelImage>| {
            let (image, covered) = (image.as_mut()?, covered.as_ref()?);
            Some(match image {
                ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                    covered.fill(image);
                    covered.mean(image)
                }
                ChannelImage::Values(image) => {
                    covered.fill(image);
                    covered.mean(image)
                }
            })
        };
        let means = texture.images.iter_mut().map(&mut mean).collect();
        Ok(DrawnTexture { root: unit.root, texture, means })
    }

    fn byte_count(&self, data: &DrawnTexture) -> u64 {
        data.byte_count()
    }

    fn page_name(&self, page: StreamKey) -> String {
        self.index.texel_location(page)
    }

    fn unit_name(&self, TexelUnit { root, level }: TexelUnit) -> String {
        format!("texels of root {root}, level {level}")
    }
}
