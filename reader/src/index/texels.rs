//! Texels: the values of channels, found by table and directory (SPEC.md, "Section TEXELS").
//!
//! Chunks of the table and directories are read when they are first needed, and stay.

use std::{
    ops::Range,
    sync::{Arc, Mutex, PoisonError},
};

use super::{Index, absolute, checked_part, checked_parts, lists::together};
use crate::{
    error::{Error, Result},
    format::{
        channels::{ChannelInfo, Channels, StreamOrder},
        clusters::Cluster,
        header::Section,
        sections::{Extent, Part},
        texels::{TexelDirectory, TexelEntry, chunk_extent, chunk_of, first_of_chunk, parse_chunk, table_bytes},
    },
    sorted::SortedMap,
    source::{Fetched, requests::Before},
};

/// The texels of a root at a level, as they stand in the file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TexelBytes {
    /// The level of the block: the finest that the root has and that is not finer than what was asked for.
    pub level: u8,
    /// Which part of images in scales is there.
    pub scale: Scale,
    /// The map; empty for a block without texels.
    pub map: Vec<u8>,
    /// The streams of the image of each channel that was asked for: one, or those of scales up to the one that was
    /// asked for. All are empty where the block has no texels of the channel.
    pub images: Vec<Vec<Vec<u8>>>,
}

/// Which part of the texels along each side of an image that is divided into scales.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scale {
    /// An eighth, rounded up: 1/64 of the texels.
    Eighth,
    /// A quarter.
    Quarter,
    /// A half.
    Half,
    /// All.
    #[default]
    Full,
}

impl Scale {
    /// How often images of this scale have been halved along each side.
    pub fn halvings(self) -> u8 {
        Self::Full as u8 - self as u8
    }

    /// The coarsest that has all texels of images which have been halved so often.
    pub(crate) fn of_halvings(halvings: u8) -> Self {
        [Self::Full, Self::Half, Self::Quarter].get(usize::from(halvings)).copied().unwrap_or(Self::Eighth)
    }

    fn stream_count(self) -> usize {
        1 + self as usize
    }
}

/// What is known of the sections CHANNELS and TEXELS.
#[derive(Debug)]
pub(super) struct Texels {
    channels: Channels,
    order: StreamOrder,
    /// TEXELS.
    section: Section,
    /// By chunk of the table.
    chunks: Mutex<SortedMap<u32, Vec<TexelEntry>>>,
    /// By cluster.
    directories: Mutex<SortedMap<u32, Arc<TexelDirectory>>>,
}

impl Texels {
    /// Nothing is known of TEXELS yet.
    ///
    /// # Errors
    /// [`Error::Format`] if it is smaller than what is in it.
    pub fn new(channels: Channels, section: Section, cluster_count: u32) -> Result<Self> {
        let sizes = channels.stream_bytes.iter();
        let least = sizes.fold(table_bytes(cluster_count), |sum, &bytes| sum.saturating_add(bytes));
        if least > section.length {
            return Err(Error::format("the section has less room than its table and its streams take"));
        }
        let order = StreamOrder::new(&channels.channels);
        Ok(Self { channels, order, section, chunks: Mutex::default(), directories: Mutex::default() })
    }
}

/// A texel stream: cluster, level, root and number in the block.
pub(crate) type StreamKey = (u32, u8, u32, usize);

impl Index {
    /// What the surface carries besides positions. Channels of unknown kinds are among them.
    pub fn channels(&self) -> &[ChannelInfo] {
        self.texels.as_ref().map_or(&[], |texels| &texels.channels.channels)
    }

    /// Bytes of all maps, then of all images of each channel; empty for a file without channels.
    pub fn texel_bytes(&self) -> &[u64] {
        self.texels.as_ref().map_or(&[], |texels| &texels.channels.stream_bytes)
    }

    /// Finds the texels of some roots, each at a level or at the next coarser one that it has, in this order: the maps,
    /// and the images of some channels, by number from 0.
    ///
    /// Of images in scales ([`ChannelInfo::is_scaled`]) only what a scale takes is read; all of the others.
    ///
    /// They take up to three rounds of reading after the index blocks: a chunk of the table, the directories of
    /// clusters, and the streams. The first two stay.
    ///
    /// # Errors
    /// [`Error::Missing`] until everything needed has been read; [`Error::Query`] if a root, level or channel does not
    /// exist;
    /// [`Error::Format`], [`Error::Limit`].
    pub fn texels(
        &self,
        wanted: &[(u32, u8)],
        channels: &[u8],
        scale: Scale,
        fetched: &Fetched,
    ) -> Result<Vec<TexelBytes>> {
        let channel_count = self.channels().len();
        if let Some(channel) = channels.iter().find(|&&channel| usize::from(channel) >= channel_count) {
            return Err(Error::Query { what: format!("there is no channel {channel}: the file has {channel_count}") });
        }
        for &(root, level) in wanted {
            self.check_root(root)?;
            if usize::from(level) >= self.level_count() {
                let what = format!("there is no level {level}: the file has {}", self.level_count());
                return Err(Error::Query { what });
            }
        }
        let owners = self.owners(wanted.iter().map(|&(root, _)| root), Cluster::roots)?;
        // Both are asked for at once.
        let chunks = owners.iter().map(|&cluster| self.texel_entry(cluster, fetched).map(drop));
        together::<_, ()>([self.load_indices(owners.iter().copied()), together(chunks)])?;
        let directory = |&cluster: &u32| Ok((cluster, self.texel_directory(cluster, fetched)?));
        let directories: SortedMap<_, _> = together(owners.iter().map(directory))?;

        let images: Vec<Range<usize>> = channels.iter().map(|&channel| self.image_streams(channel, scale)).collect();
        let (mut blocks, mut parts) = (Vec::with_capacity(wanted.len()), Vec::new());
        for &(root, level) in wanted {
            let owner = self.owner(root, |cluster| cluster.first_root)?;
            let entry = self.root_entry(root)?;
            let level = entry.blocks[entry.block_at(level)].level;
            let local = root - self.cluster(owner)?.first_root;
            for stream in [0].into_iter().chain(images.iter().cloned().flatten()) {
                let directory = directories.get(&owner).and_then(|directory| directory.as_ref());
                let part = directory.map_or(Ok(Part::default()), |directory| directory.part(level, local, stream))?;
                parts.push(((owner, level, local, stream), part));
            }
            blocks.push((owner, level, local));
        }
        let found = self.texel_streams(parts, fetched)?;
        let texels = blocks.into_iter().map(|(owner, level, local)| {
            let bytes = |stream| found.get(&(owner, level, local, stream)).map_or(vec![], |bytes| bytes.to_vec());
            let image = |streams: &Range<usize>| streams.clone().map(bytes).collect();
            TexelBytes { level, scale, map: bytes(0), images: images.iter().map(image).collect() }
        });
        Ok(texels.collect())
    }

    /// Where the texels of a cluster are; nowhere in a file without channels.
    pub(crate) fn texel_entry(&self, cluster: u32, fetched: &Fetched) -> Result<TexelEntry> {
        let Some(texels) = &self.texels else { return Ok(TexelEntry::default()) };
        let chunk = chunk_of(cluster);
        let mut chunks = texels.chunks.lock().unwrap_or_else(PoisonError::into_inner);
        if !chunks.contains_key(&chunk) {
            let Extent { offset, length } = chunk_extent(chunk, self.cluster_count());
            let range = absolute(texels.section.offset, Part { offset, length, checksum: 0 });
            let Some(bytes) = fetched.get(range.clone()) else {
                return Err(Error::Missing { ranges: vec![fetched.rest_of(range)] });
            };
            let entries = parse_chunk(bytes, self.cluster_count(), texels.section.length, self.limits());
            chunks.insert(chunk, entries.map_err(|error| error.at(|| format!("chunk {chunk} of the texel table")))?);
        }
        let entries = chunks.get(&chunk).map_or(&[][..], Vec::as_slice);
        let entry = entries.get((cluster - first_of_chunk(chunk)) as usize).copied();
        entry.ok_or_else(|| Error::format("a cluster does not exist"))
    }

    /// The directory of a cluster's texels; none in a file without channels.
    pub(crate) fn texel_directory(&self, cluster: u32, fetched: &Fetched) -> Result<Option<Arc<TexelDirectory>>> {
        let Some(texels) = &self.texels else { return Ok(None) };
        let known = || texels.directories.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(directory) = known().get(&cluster) {
            return Ok(Some(Arc::clone(directory)));
        }
        let entry = self.texel_entry(cluster, fetched)?;
        let index = self.cluster_index(cluster)?;
        let location = || format!("texel directory of cluster {cluster}");
        let bytes = checked_part(fetched, texels.section.offset, entry.directory);
        let Some(bytes) = bytes.map_err(|error| error.at(location))? else {
            let range = absolute(texels.section.offset, entry.directory);
            return Err(Error::Missing { ranges: vec![fetched.rest_of(range)] });
        };
        let directory = TexelDirectory::parse(bytes, &entry, index, &texels.order, self.limits());
        let directory = Arc::new(directory.map_err(|error| error.at(location))?);
        known().insert(cluster, Arc::clone(&directory));
        Ok(Some(directory))
    }

    /// Finds texel streams among the bytes that have been read, and checks them.
    pub(crate) fn texel_streams<'b>(
        &self,
        parts: impl IntoIterator<Item = (StreamKey, Part)>,
        fetched: &'b Fetched,
    ) -> Result<SortedMap<StreamKey, &'b [u8]>> {
        checked_parts(self.texels_offset(), parts, fetched, |key| self.texel_location(key), || Ok(Before::default()))
    }

    /// The numbers of the streams that a channel's image has up to a scale.
    pub(crate) fn image_streams(&self, channel: u8, scale: Scale) -> Range<usize> {
        let all = self.texels.as_ref().map_or(0..0, |texels| texels.order.of_channel(channel.into()));
        // An image that is not in scales has one.
        all.start..all.end.min(all.start + scale.stream_count())
    }

    /// Which of [`Index::texel_bytes`] counts a stream.
    pub(crate) fn size_of_stream(&self, stream: usize) -> usize {
        self.texels.as_ref().map_or(0, |texels| texels.order.size_number(stream))
    }

    /// The streams of a block that are not empty: its map, and the images of some channels. None where it has no map.
    ///
    /// # Errors
    /// [`Error::Missing`] until its cluster's directory has been read; [`Error::Query`], [`Error::Format`],
    /// [`Error::Limit`].
    pub(crate) fn texel_parts(
        &self,
        (root, level): (u32, u8),
        channels: &[u8],
        scale: Scale,
        fetched: &Fetched,
    ) -> Result<Vec<StreamKey>> {
        let cluster = self.owner(root, |cluster| cluster.first_root)?;
        let local = root - self.cluster(cluster)?.first_root;
        let Some(directory) = self.texel_directory(cluster, fetched)? else { return Ok(vec![]) };
        if directory.part(level, local, 0)?.length == 0 {
            return Ok(vec![]);
        }
        let streams = [0].into_iter().chain(channels.iter().flat_map(|&channel| self.image_streams(channel, scale)));
        let mut keys: Vec<StreamKey> = streams.map(|stream| (cluster, level, local, stream)).collect();
        keys.retain(|key| self.texel_part(*key).length > 0);
        Ok(keys)
    }

    /// Where a stream is; nowhere if the directory of its cluster has not been read.
    pub(crate) fn texel_part(&self, (cluster, level, local, stream): StreamKey) -> Part {
        let directory = self.texel_directory(cluster, &Fetched::default()).ok().flatten();
        directory.and_then(|directory| directory.part(level, local, stream).ok()).unwrap_or_default()
    }

    /// Where section TEXELS begins in the file.
    pub(crate) fn texels_offset(&self) -> u64 {
        self.texels.as_ref().map_or(0, |texels| texels.section.offset)
    }

    /// The name of a stream in messages.
    pub(crate) fn texel_location(&self, (cluster, level, local, stream): StreamKey) -> String {
        let root = self.cluster(cluster).map_or(local, |cluster| cluster.first_root + local);
        match self.size_of_stream(stream).checked_sub(1) {
            None => format!("map of root {root}, level {level}"),
            Some(channel) => format!("image of channel {channel}, root {root}, level {level}"),
        }
    }
}
