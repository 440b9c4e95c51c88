//! Section CHANNELS: what the surface carries besides positions (SPEC.md, "Section CHANNELS").
//!
//! The bytes are: the number of channels and the bytes of all maps (varints); then for each channel the length of its
//! name (varint), the name, kind and components (u8 each), low, step and bound (f64 each), and the bytes of all its
//! images (varint).
//!
//! Section SCALES has a byte for each channel: into how many streams each of its images is divided (SPEC.md, "Section
//! SCALES").

use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        texels::SCALES,
    },
    error::{Error, Result},
};

/// The most channels of a file.
pub(crate) const MAX_CHANNELS: usize = 64;
const MAX_NAME_BYTES: usize = 255;

/// What the values of a channel mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum ChannelKind {
    /// sRGB colours: three components, or four with straight alpha.
    Colour,
    /// Measured numbers.
    Scalar,
    /// Directions of the surface's normal: two components, relative to the piece of the map in which a texel lies.
    Normal,
    /// Numbers of classes, between which nothing lies.
    Label,
    /// Numbers from 0 to 1, such as the roughness of a material.
    Factor,
    /// How the surface is drawn: numbers of [`crate::decode::Drawing`], between which nothing lies.
    Drawing,
    /// A kind that this version of the crate does not know, by its code. Files cannot be written with it.
    Unknown(u8),
}

impl ChannelKind {
    /// The name that programs show.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Scalar => "scalar",
            Self::Normal => "normal",
            Self::Label => "label",
            Self::Factor => "factor",
            Self::Drawing => "drawing",
            Self::Unknown(_) => "unknown",
        }
    }

    /// Whether the values are numbers of something, so that nothing may be interpolated between them.
    pub fn is_of_numbers(self) -> bool {
        matches!(self, Self::Label | Self::Drawing)
    }

    /// Whether decoded texels are bytes, of which something may be lost.
    fn is_of_bytes(self) -> bool {
        matches!(self, Self::Colour | Self::Normal | Self::Factor)
    }

    /// The code of a channel of this kind that is exact, or not.
    fn code(self, is_exact: bool) -> u8 {
        match (self, is_exact) {
            (Self::Colour, false) => 1,
            (Self::Scalar, _) => 2,
            (Self::Normal, false) => 3,
            (Self::Label, _) => 4,
            (Self::Factor, false) => 5,
            (Self::Drawing, _) => 6,
            (Self::Colour, true) => 7,
            (Self::Normal, true) => 8,
            (Self::Factor, true) => 9,
            (Self::Unknown(code), _) => code,
        }
    }

    /// The kind of a code, and whether channels with it are exact. Readers that do not know exact ones skip them, as
    /// all of unknown kinds.
    fn of_code(code: u8) -> (Self, bool) {
        match code {
            1 => (Self::Colour, false),
            2 => (Self::Scalar, false),
            3 => (Self::Normal, false),
            4 => (Self::Label, false),
            5 => (Self::Factor, false),
            6 => (Self::Drawing, false),
            7 => (Self::Colour, true),
            8 => (Self::Normal, true),
            9 => (Self::Factor, true),
            other => (Self::Unknown(other), false),
        }
    }
}

/// A channel: something that the surface carries besides positions, and how its stored integers become values.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChannelInfo {
    /// Unlike those of the file's other channels: 1 to 255 bytes of UTF-8 without control characters.
    pub name: String,
    /// What the values mean.
    pub kind: ChannelKind,
    /// Whether texels of a colour, a normal or a factor are coded without loss. False for all other kinds, which always
    /// are.
    pub is_exact: bool,
    /// Whether its images are divided into an eighth of the size and what each doubling of that adds. False for what is
    /// coded without loss.
    pub is_scaled: bool,
    /// Numbers of a value, 1 to 4.
    pub components: u8,
    /// The value that the integer 0 stands for.
    pub low: f64,
    /// What an integer adds for each 1; above 0. So a value is `low + integer * step`.
    pub step: f64,
    /// Stated bound on the error of a texel, in units of the value; 0 where none is stated.
    pub bound: f64,
}

impl ChannelInfo {
    /// Numbers of a texel once it is decoded: three for normals, as many as components otherwise.
    pub fn value_count(&self) -> usize {
        if self.kind == ChannelKind::Normal { 3 } else { self.components.into() }
    }

    /// Into how many streams an image is divided.
    pub(crate) fn scale_count(&self) -> usize {
        if self.is_scaled { SCALES } else { 1 }
    }

    /// Whether decoded texels are bytes: colours, normals and factors. The others are numbers of 16 bits.
    pub fn is_of_bytes(&self) -> bool {
        self.kind.is_of_bytes()
    }

    /// The rule that it breaks, if it breaks one.
    fn broken_rule(&self) -> Option<&'static str> {
        if self.name.is_empty() || self.name.len() > MAX_NAME_BYTES {
            Some("a channel's name has no bytes, or more than 255")
        } else if self.name.chars().any(char::is_control) {
            Some("a channel's name has control characters")
        } else if !(1..=4).contains(&self.components) {
            Some("a channel does not have one to four components")
        } else if self.kind == ChannelKind::Colour && self.components < 3 {
            Some("a colour does not have three or four components")
        } else if self.kind == ChannelKind::Normal && self.components != 2 {
            Some("a normal does not have two components")
        } else if self.kind == ChannelKind::Drawing && self.components != 1 {
            Some("a drawing does not have one component")
        } else if self.kind == ChannelKind::Drawing && [self.low, self.step] != [0.0, 1.0] {
            Some("drawings do not count from 0 in steps of 1")
        } else if self.is_exact && !self.is_of_bytes() {
            Some("a channel is exact that is no colour, normal or factor")
        } else if self.is_scaled && (self.is_exact || !self.is_of_bytes()) {
            Some("a channel is in scales that is no colour, normal or factor, or that is exact")
        } else if !(self.low.is_finite() && self.step > 0.0 && self.step.is_finite()) {
            Some("a channel's step is not above 0, or a value is not finite")
        } else if !(self.bound >= 0.0 && self.bound.is_finite()) {
            Some("a channel's bound is negative or not finite")
        } else {
            None
        }
    }
}

/// The rule that these channels break, if they break one.
pub(crate) fn broken_rule(channels: &[ChannelInfo]) -> Option<&'static str> {
    if channels.len() > MAX_CHANNELS {
        return Some("a file has more than 64 channels");
    }
    let is_repeated = |(number, channel): (usize, &ChannelInfo)| {
        channels.iter().take(number).any(|before| before.name == channel.name)
    };
    if channels.iter().enumerate().any(is_repeated) {
        return Some("two channels have the same name");
    }
    if channels.iter().filter(|channel| channel.kind == ChannelKind::Drawing).count() > 1 {
        return Some("two channels say how the surface is drawn");
    }
    channels.iter().find_map(ChannelInfo::broken_rule)
}

/// How many texel streams a block has: its map, and those of each channel's image. None without channels.
pub(crate) fn stream_count(channels: &[ChannelInfo]) -> usize {
    StreamOrder::new(channels).count()
}

/// The texel streams of a block, by number: its map, then those of each channel's image, the coarsest first; and the
/// order in which files have them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct StreamOrder {
    /// The number of each channel's first stream, and that of all streams.
    firsts: Vec<usize>,
    /// Whether streams of a level with the same number are adjacent, so that a scale of many images is read at once:
    /// where images are in scales. Otherwise those of a block are.
    is_by_number: bool,
}

impl StreamOrder {
    pub fn new(channels: &[ChannelInfo]) -> Self {
        let mut firsts = if channels.is_empty() { vec![] } else { vec![1] };
        for channel in channels {
            firsts.push(firsts.last().map_or(0, |last| last + channel.scale_count()));
        }
        Self { firsts, is_by_number: channels.iter().any(|channel| channel.is_scaled) }
    }

    /// The number of streams of a block.
    pub fn count(&self) -> usize {
        self.firsts.last().copied().unwrap_or(0)
    }

    /// The streams of a channel's image.
    pub fn of_channel(&self, channel: usize) -> std::ops::Range<usize> {
        match self.firsts.get(channel..).unwrap_or_default() {
            [first, end, ..] => *first..*end,
            _ => 0..0,
        }
    }

    /// How many sums of sizes section CHANNELS has: that of maps, and one for each channel.
    pub fn size_count(&self) -> usize {
        self.firsts.len()
    }

    /// Which of these counts a stream.
    pub fn size_number(&self, stream: usize) -> usize {
        self.firsts.partition_point(|&first| first <= stream)
    }

    /// Where a stream lies among those of a file's cluster, given how many blocks its level has, how many come before
    /// these, and its block among all.
    pub fn place(&self, stream: usize, block: usize, [before, of_level]: [usize; 2]) -> usize {
        match self.is_by_number {
            false => block * self.count() + stream,
            true => before * self.count() + stream * of_level + (block - before),
        }
    }
}

/// The section.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Channels {
    /// At least one.
    pub channels: Vec<ChannelInfo>,
    /// Bytes of each texel stream, over all blocks: those of maps, then those of each channel's images.
    pub stream_bytes: Vec<u64>,
}

impl Channels {
    pub(crate) fn write(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        put_varint(&mut bytes, self.channels.len() as u64);
        let mut stream_bytes = self.stream_bytes.iter().copied();
        put_varint(&mut bytes, stream_bytes.next().unwrap_or(0));
        for (channel, image_bytes) in self.channels.iter().zip(stream_bytes) {
            put_varint(&mut bytes, channel.name.len() as u64);
            bytes.extend(channel.name.as_bytes());
            bytes.extend([channel.kind.code(channel.is_exact), channel.components]);
            [channel.low, channel.step, channel.bound].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
            put_varint(&mut bytes, image_bytes);
        }
        bytes
    }

    /// Reads what [`Channels::write`] wrote.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let count = cursor.varint_up_to(MAX_CHANNELS as u64, "a file has more than 64 channels")?;
        if count == 0 {
            return Err(Error::format("the list of channels has none"));
        }
        let mut result = Self { channels: Vec::new(), stream_bytes: vec![cursor.varint()?] };
        for _ in 0..count {
            let length = cursor.varint_up_to(MAX_NAME_BYTES as u64, "a channel's name has more than 255 bytes")?;
            let name = String::from_utf8(cursor.bytes(length as usize)?.to_vec());
            let (kind, is_exact) = ChannelKind::of_code(cursor.u8()?);
            result.channels.push(ChannelInfo {
                name: name.map_err(|_| Error::format("a channel's name is not UTF-8"))?,
                kind,
                is_exact,
                is_scaled: false,
                components: cursor.u8()?,
                low: cursor.f64()?,
                step: cursor.f64()?,
                bound: cursor.f64()?,
            });
            result.stream_bytes.push(cursor.varint()?);
        }
        cursor.finish()?;
        broken_rule(&result.channels).map_or(Ok(result), |rule| Err(Error::format(rule)))
    }

    /// Section SCALES: for each channel into how many streams an image is divided; none where all have one.
    pub(crate) fn write_scales(&self) -> Option<Vec<u8>> {
        let has_scales = self.channels.iter().any(|channel| channel.is_scaled);
        has_scales.then(|| self.channels.iter().map(|channel| channel.scale_count() as u8).collect())
    }

    /// Takes over what section SCALES says.
    pub(crate) fn with_scales(mut self, bytes: &[u8]) -> Result<Self> {
        if bytes.len() != self.channels.len() {
            return Err(Error::format("the list of scales does not have a byte for each channel"));
        }
        for (channel, &count) in self.channels.iter_mut().zip(bytes) {
            channel.is_scaled = usize::from(count) == SCALES;
            if !channel.is_scaled && count != 1 {
                return Err(Error::format("an image is divided into other than one or four scales"));
            }
        }
        if !self.channels.iter().any(|channel| channel.is_scaled) {
            return Err(Error::format("a list of scales says that no image has any"));
        }
        broken_rule(&self.channels).map_or(Ok(self), |rule| Err(Error::format(rule)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels() -> Channels {
        let channel = |name: &str, kind, components| ChannelInfo {
            name: name.into(),
            kind,
            is_exact: false,
            is_scaled: false,
            components,
            low: -1.0,
            step: 0.125,
            bound: 0.5,
        };
        let channels = vec![
            channel("colour", ChannelKind::Colour, 4),
            channel("°C", ChannelKind::Scalar, 1),
            channel("later", ChannelKind::Unknown(200), 2),
        ];
        Channels { channels, stream_bytes: vec![1000, 1 << 40, 0, 7] }
    }

    fn drawing(components: u8) -> ChannelInfo {
        let name = "drawing".into();
        ChannelInfo {
            name,
            kind: ChannelKind::Drawing,
            is_exact: false,
            is_scaled: false,
            components,
            low: 0.0,
            step: 1.0,
            bound: 0.0,
        }
    }

    #[test]
    fn channels_survive_and_prefixes_are_refused() {
        let bytes = channels().write();
        assert_eq!(Channels::parse(&bytes).unwrap(), channels());
        assert!((0..bytes.len()).all(|end| Channels::parse(&bytes[..end]).is_err()));
        assert!(Channels::parse(&[bytes, vec![0]].concat()).is_err());
        let drawn = Channels { channels: vec![drawing(1)], stream_bytes: vec![7, 9] };
        assert_eq!(Channels::parse(&drawn.write()).unwrap(), drawn);
        for (kind, components, code) in
            [(ChannelKind::Colour, 3, 7), (ChannelKind::Normal, 2, 8), (ChannelKind::Factor, 1, 9)]
        {
            let exact = ChannelInfo { kind, components, is_exact: true, is_scaled: false, ..drawing(1) };
            let channels = Channels { channels: vec![exact], stream_bytes: vec![7, 9] };
            assert_eq!(Channels::parse(&channels.write()).unwrap(), channels);
            // After two varints, the length of the name and the name.
            assert_eq!(channels.write()[10], code);
        }
    }

    #[test]
    fn channels_that_break_a_rule_are_refused() {
        let changes: [&dyn Fn(&mut Channels); 17] = [
            &|all| all.channels.clear(),
            &|all| all.channels[1].name = "colour".into(),
            &|all| all.channels[1].name.clear(),
            &|all| all.channels[1].name = "x".repeat(256),
            &|all| all.channels[1].name = "a\u{1b}[31m".into(),
            &|all| all.channels[0].components = 2,
            &|all| (all.channels[0].is_exact, all.channels[0].components) = (true, 2),
            &|all| all.channels[2].components = 0,
            &|all| all.channels[2].components = 5,
            &|all| all.channels[1].step = 0.0,
            &|all| all.channels[1].step = f64::NAN,
            &|all| all.channels[1].low = f64::INFINITY,
            &|all| all.channels[1].bound = -0.5,
            &|all| all.channels[1].kind = ChannelKind::Drawing,
            &|all| all.channels[2] = drawing(2),
            &|all| {
                let twice = [drawing(1), ChannelInfo { name: "again".into(), ..drawing(1) }];
                all.channels.splice(1.., twice);
            },
            &|all| {
                all.channels =
                    (0..65).map(|k| ChannelInfo { name: k.to_string(), ..all.channels[1].clone() }).collect();
                all.stream_bytes = vec![0; 66];
            },
        ];
        for (number, change) in changes.iter().enumerate() {
            let mut changed = channels();
            change(&mut changed);
            assert!(Channels::parse(&changed.write()).is_err(), "change {number}");
        }
        let mut bytes = channels().write();
        let name = bytes.windows(6).position(|window| window == b"colour").unwrap();
        bytes[name] = 0xff;
        assert!(Channels::parse(&bytes).unwrap_err().to_string().contains("UTF-8"));
        assert!(Channels::parse(&[0xff, 0xff, 0xff, 0xff, 0x0f, 0]).is_err());
    }
}
