//! The sections CHANNELS, SCALES and TEXELS (SPEC.md, chapter 20) of a file with one cluster or none, as the numbers
//! that are in them.

use super::{CHANNELS, CLUSTERS, Container, PAGES, SCALES, Section, TEXELS, put_part, put_varint};

/// A channel.
#[derive(Clone, Debug)]
pub struct HandmadeChannel {
    /// Its bytes, which need not be UTF-8.
    pub name: Vec<u8>,
    /// What the values mean.
    pub kind: u8,
    /// Numbers of a value.
    pub components: u8,
    /// Low, step and bound.
    pub numbers: [f64; 3],
}

/// Channels, and the texels of one cluster.
#[derive(Clone, Debug)]
pub struct HandmadeTexels {
    /// The channels.
    pub channels: Vec<HandmadeChannel>,
    /// The number of channels that CHANNELS says beyond those.
    pub channel_excess: u64,
    /// Bytes of images that CHANNELS says beyond those of the last channel.
    pub size_excess: u64,
    /// The streams of each block, all levels together; none for a file without clusters.
    pub streams: Vec<Vec<u8>>,
    /// What SCALES says; empty for a file without it.
    pub scales: Vec<u8>,
    /// Whether there is a cluster.
    pub has_cluster: bool,
    /// Whether a cluster without texels has a directory, too.
    pub always_has_directory: bool,
    /// Bytes after the last part of the directory.
    pub directory_excess: Vec<u8>,
    /// Bytes between the table and the directory, and after the streams: those of the cluster, and those of no cluster.
    pub gaps: [usize; 3],
    /// What is changed in the directory's checksum, in that of the first stream, and in that of the table.
    pub checksums: [u32; 3],
    /// What the table has less than it should have.
    pub table_missing: usize,
}

impl HandmadeTexels {
    /// A colour and a scalar on both blocks of the worked example; one has no image of the scalar.
    pub fn example() -> Self {
        let channel = |name: &str, kind, components| HandmadeChannel {
            name: name.as_bytes().to_vec(),
            kind,
            components,
            numbers: [-1.0, 0.0078125, 0.25],
        };
        Self {
            channels: vec![channel("colour", 1, 3), channel("depth", 2, 1)],
            channel_excess: 0,
            size_excess: 0,
            streams: [&b"map 0"[..], b"red", b"7", b"map 1", b"green and blue", b""].map(<[u8]>::to_vec).to_vec(),
            scales: vec![],
            has_cluster: true,
            always_has_directory: false,
            directory_excess: vec![],
            gaps: [0; 3],
            checksums: [0; 3],
            table_missing: 0,
        }
    }

    /// A channel of a kind that no version has, without a texel.
    pub fn unknown() -> Self {
        let mut texels = Self::example();
        texels.channels.truncate(1);
        texels.channels[0].name = "später".as_bytes().to_vec();
        texels.channels[0].kind = 200;
        texels.streams = vec![vec![]; 4];
        texels
    }

    /// The example whose second channel says how the surface is drawn.
    pub fn drawn() -> Self {
        let mut texels = Self::example();
        texels.channels[1] =
            HandmadeChannel { name: b"drawing".to_vec(), kind: 6, components: 1, numbers: [0.0, 1.0, 0.0] };
        texels
    }

    /// The example whose colours are in scales.
    pub fn scaled() -> Self {
        let blocks: [[&[u8]; 6]; 2] =
            [[b"map 0", b"r", b"", b"e", b"d", b"7"], [b"map 1", b"gr", b"een", b" and", b" blue", b""]];
        let streams = blocks.as_flattened().iter().map(|stream| stream.to_vec()).collect();
        Self { streams, scales: vec![4, 1], ..Self::example() }
    }

    /// Channels of a file without clusters.
    pub fn nothing() -> Self {
        Self { streams: vec![], has_cluster: false, ..Self::example() }
    }

    /// Puts both sections into a file.
    pub fn put_into(&self, mut file: Container) -> Container {
        file.version[1] = 1;
        let at = |file: &Container, kind| file.sections.iter().position(|section| section.kind == kind);
        for (before, kind, flags, content) in
            [(CLUSTERS, CHANNELS, 0, self.channels()), (PAGES, TEXELS, 2, self.texels())]
        {
            let place = at(&file, before).expect("every file has these");
            file.sections.insert(place, Section { kind, flags, content, reserved: 0 });
        }
        if !self.scales.is_empty() {
            file.version[1] = 4;
            let place = at(&file, CLUSTERS).expect("every file has these");
            file.sections.insert(place, Section { kind: SCALES, flags: 1, content: self.scales.clone(), reserved: 0 });
        }
        file
    }

    fn channels(&self) -> Vec<u8> {
        let counts: Vec<usize> = match self.scales.as_slice() {
            [] => vec![1; self.channels.len()],
            scales => scales.iter().map(|&count| count.into()).collect(),
        };
        let stream_count = 1 + counts.iter().sum::<usize>();
        // Of all maps, or of the images of a channel.
        let bytes_of = |number: usize| {
            let first = counts.iter().take(number.saturating_sub(1)).sum::<usize>() + usize::from(number > 0);
            let count = if number == 0 { 1 } else { counts[number - 1] };
            let is_own = |stream: usize| (first..first + count).contains(&(stream % stream_count));
            let streams = self.streams.iter().enumerate().filter(|(stream, _)| is_own(*stream));
            streams.map(|(_, stream)| stream.len() as u64).sum::<u64>()
        };
        let mut bytes = vec![];
        put_varint(&mut bytes, self.channels.len() as u64 + self.channel_excess);
        put_varint(&mut bytes, bytes_of(0));
        for (number, channel) in (1..).zip(&self.channels) {
            put_varint(&mut bytes, channel.name.len() as u64);
            bytes.extend(&channel.name);
            bytes.extend([channel.kind, channel.components]);
            channel.numbers.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
            let excess = if number == self.channels.len() { self.size_excess } else { 0 };
            put_varint(&mut bytes, bytes_of(number) + excess);
        }
        bytes
    }

    fn texels(&self) -> Vec<u8> {
        if !self.has_cluster {
            return vec![];
        }
        let mut directory = vec![];
        for (number, stream) in self.streams.iter().enumerate() {
            put_part(&mut directory, stream);
            if number == 0 && !stream.is_empty() {
                directory[1] ^= self.checksums[1] as u8;
            }
        }
        directory.extend(&self.directory_excess);
        let streams = self.streams.concat();
        if streams.is_empty() && !self.always_has_directory {
            directory.clear();
        }
        let checksum = if directory.is_empty() { 0 } else { crc32fast::hash(&directory) };
        let offset = 28 + self.gaps[0];
        let end = offset + directory.len() + streams.len() + self.gaps[1];
        let mut table = (offset as u64).to_le_bytes().to_vec();
        table.extend((directory.len() as u32).to_le_bytes());
        table.extend((checksum ^ self.checksums[0]).to_le_bytes());
        table.extend((end as u64).to_le_bytes());
        table.extend((crc32fast::hash(&table) ^ self.checksums[2]).to_le_bytes());
        table.truncate(28 - self.table_missing);
        table.resize(table.len() + self.gaps[0], 0);
        let mut bytes = [table, directory, streams].concat();
        bytes.resize(bytes.len() + self.gaps[1] + self.gaps[2], 0);
        bytes
    }
}
