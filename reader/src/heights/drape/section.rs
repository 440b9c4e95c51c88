//! The head of section DRAPE, and directories of image tiles (SPEC.md, "Section DRAPE").

use crate::{
    codec::{
        bytes::{Cursor, has_checksum},
        texels::SCALES,
    },
    error::{Error, Result},
    format::sections::Part,
    limits::{Limits, within},
};

/// Bytes of the head.
pub const HEAD_BYTES: usize = 68;
/// No image has more texels along a side.
const MOST_TEXELS: u64 = 1 << 30;
/// The sides of tiles, as logarithms.
const SIDES_LOG2: std::ops::RangeInclusive<u8> = 3..=11;
/// Tiles along a side of those that lie below one.
const BELOW: u64 = 8;

/// An image over a grid: its size, and where its texels are.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Drape {
    /// Texels in a row, and rows; from 1 to 2^30 each.
    pub size: [u64; 2],
    /// Where the centre of its first texel is, in columns and rows of samples.
    pub first: [f64; 2],
    /// Columns from a texel to the next one, and rows from a row of texels to the next one; above 0.
    pub spacing: [f64; 2],
    /// 3, or 4 with opacity.
    pub components: u8,
    /// Logarithm of the texels along a side of its tiles, from 3 to 11.
    pub side_log2: u8,
}

impl Drape {
    /// Why a file cannot say this, if it cannot.
    pub fn fault(&self) -> Option<&'static str> {
        let is_place = |x: &f64| x.abs() < 1e15;
        if self.size.iter().any(|size| !(1..=MOST_TEXELS).contains(size)) {
            Some("the image over the heights has no texels, or too many")
        } else if !self.first.iter().chain(&self.spacing).all(is_place) || self.spacing.iter().any(|&x| x < 1e-15) {
            Some("the place of the image over the heights is out of range")
        } else if !matches!(self.components, 3 | 4) || !SIDES_LOG2.contains(&self.side_log2) {
            Some("the image over the heights has other components or tiles than there are")
        } else {
            None
        }
    }

    /// Texels along a side of its tiles.
    pub(super) fn side(&self) -> u64 {
        1 << self.side_log2
    }

    /// Its size halved some times, rounded up.
    pub fn size_at(&self, halvings: u8) -> [u64; 2] {
        self.size.map(|size| size.div_ceil(1 << halvings.min(62)))
    }

    /// How many levels it has: the coarsest one is one tile.
    pub fn level_count(&self) -> u8 {
        let is_one = |level: &u8| self.size_at(3 * level).iter().all(|&size| size <= self.side());
        (0..16).find(is_one).unwrap_or(15) + 1
    }

    /// The most times that its size can be halved.
    pub fn most_halvings(&self) -> u8 {
        3 * self.level_count()
    }

    /// Columns and rows of tiles at a level.
    pub(super) fn tiles(&self, level: u8) -> [u64; 2] {
        self.size_at(3 * level).map(|size| size.div_ceil(self.side()))
    }

    /// The size of the image of a tile.
    pub(super) fn tile_size(&self, id: ImageId) -> [u32; 2] {
        let (size, side) = (self.size_at(3 * id.level), self.side());
        let of = |axis: usize, at: u64| size[axis].saturating_sub(at * side).min(side) as u32;
        [of(0, id.column), of(1, id.row)]
    }

    /// The tiles of a group, in their order.
    pub(super) fn tiles_of(&self, group: GroupId) -> impl Iterator<Item = ImageId> + use<> {
        let level = group.level;
        let [columns, rows] = self.tiles(level);
        let range = |at: u64, count: u64| (at * BELOW).min(count)..(at * BELOW + BELOW).min(count);
        let (columns, rows) = (range(group.column, columns), range(group.row, rows));
        rows.flat_map(move |row| columns.clone().map(move |column| ImageId { level, column, row }))
    }

    /// The group of the coarsest tile.
    pub(super) fn top(&self) -> GroupId {
        GroupId { level: self.level_count() - 1, column: 0, row: 0 }
    }
}

/// A tile of the image: its level (0 is the finest), and its column and row among the tiles of this level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ImageId {
    pub level: u8,
    pub column: u64,
    pub row: u64,
}

/// The tiles of a level that lie below one of the next coarser level, of which this is the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GroupId {
    pub level: u8,
    pub column: u64,
    pub row: u64,
}

impl ImageId {
    /// The group that it is in.
    pub fn group(self) -> GroupId {
        GroupId { level: self.level, column: self.column / BELOW, row: self.row / BELOW }
    }

    /// The group of the tiles below it, unless it is at the finest level.
    pub fn below(self) -> Option<GroupId> {
        Some(GroupId { level: self.level.checked_sub(1)?, column: self.column, row: self.row })
    }

    /// Its name in messages.
    pub fn name(self) -> String {
        format!("{}/{}/{}", self.level, self.column, self.row)
    }
}

impl GroupId {
    /// The tile that its tiles lie below.
    pub fn above(self) -> ImageId {
        ImageId { level: self.level + 1, column: self.column, row: self.row }
    }
}

/// The section's head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    pub drape: Drape,
    /// The directory of the top group, right behind the head.
    pub top: Part,
}

impl Head {
    #[cfg(feature = "write")]
    pub fn write(&self) -> Vec<u8> {
        let Drape { size, first, spacing, components, side_log2 } = self.drape;
        let mut bytes = Vec::with_capacity(HEAD_BYTES);
        size.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        first.iter().chain(&spacing).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([components, side_log2, 0, 0, 0, 0, 0, 0]);
        bytes.extend((self.top.length as u32).to_le_bytes());
        bytes.extend(self.top.checksum.to_le_bytes());
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }

    pub fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let covered = cursor.bytes(HEAD_BYTES - 4)?;
        if !has_checksum(covered, cursor.u32()?) {
            return Err(Error::format("the checksum does not match"));
        }
        cursor.finish()?;
        let mut cursor = Cursor::new(covered);
        let size = [cursor.u64()?, cursor.u64()?];
        let (first, spacing) = ([cursor.f64()?, cursor.f64()?], [cursor.f64()?, cursor.f64()?]);
        let (components, side_log2) = (cursor.u8()?, cursor.u8()?);
        cursor.reserved(6)?;
        let drape = Drape { size, first, spacing, components, side_log2 };
        if let Some(fault) = drape.fault() {
            return Err(Error::format(fault));
        }
        let side = drape.side();
        within(limits.texel_count, side * side, "number of texels of a tile of the image over the heights")?;
        let (length, checksum) = (cursor.u32()?.into(), cursor.u32()?);
        within(limits.part_bytes, length, "size of a directory of images")?;
        if length == 0 && (checksum != 0 || components == 3) {
            return Err(Error::format("an image without opacity has a gap, or what has no bytes a checksum"));
        }
        Ok(Self { drape, top: Part { offset: HEAD_BYTES as u64, length, checksum } })
    }
}

/// Where the streams of a group's images are, and the directories below it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Directory {
    /// Of each tile, by number within the group, one a scale.
    pub images: Vec<[Part; SCALES]>,
    /// Of each tile the directory of the group below it; none at the finest level.
    pub below: Vec<Part>,
}

impl Directory {
    /// Its bytes; offsets are those of the first part of each kind.
    #[cfg(feature = "write")]
    pub fn write(&self, first_stream: u64, first_below: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(first_stream.to_le_bytes());
        bytes.extend(first_below.to_le_bytes());
        for scale in 0..SCALES {
            self.images.iter().for_each(|parts| parts[scale].write(&mut bytes));
        }
        self.below.iter().for_each(|part| part.write(&mut bytes));
        bytes
    }

    /// Reads what [`Directory::write`] wrote, of a group with some tiles.
    pub fn parse(bytes: &[u8], tile_count: usize, has_below: bool, limits: &Limits) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let (first_stream, first_below) = (cursor.u64()?, cursor.u64()?);
        let mut next = first_stream;
        let mut this = Self { images: vec![[Part::default(); SCALES]; tile_count], below: vec![] };
        for scale in 0..SCALES {
            for parts in &mut this.images {
                parts[scale] = Part::parse(&mut cursor, &mut next, limits)?;
            }
        }
        let has_streams = next > first_stream;
        let mut next = first_below;
        if has_below {
            let below = (0..tile_count).map(|_| Part::parse(&mut cursor, &mut next, limits));
            this.below = below.collect::<Result<_>>()?;
        }
        cursor.finish()?;
        let is_without = |parts: &[Part; SCALES]| parts[0].length == 0;
        let is_bare = |(parts, below): (&[Part; SCALES], u64)| {
            is_without(parts) && (below > 0 || parts.iter().any(|part| part.length > 0))
        };
        let below = this.below.iter().map(|part| part.length).chain(std::iter::repeat(0));
        if this.images.iter().zip(below).any(is_bare) {
            return Err(Error::format("an image without its first scale has others, or images below it"));
        }
        if this.images.iter().zip(&this.below).any(|(parts, below)| !is_without(parts) && below.length == 0) {
            return Err(Error::format("an image of a coarse level has none below it"));
        }
        if !has_streams {
            return Err(Error::format("a directory of images has none"));
        }
        if next == first_below && first_below != 0 {
            return Err(Error::format("a directory of images says where something begins that it does not have"));
        }
        Ok(this)
    }
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;

    fn drape(size: [u64; 2], side_log2: u8) -> Drape {
        Drape { size, first: [0.5, -0.25], spacing: [0.25, 0.5], components: 4, side_log2 }
    }

    #[test]
    fn levels_end_with_one_tile_and_tiles_cover_each_level() {
        for (size, side_log2, count) in
            [([1, 1], 3, 1), ([8, 8], 3, 1), ([9, 1], 3, 2), ([65, 700], 3, 4), ([1 << 30, 1 << 30], 3, 10)]
        {
            let drape = drape(size, side_log2);
            assert_eq!(drape.level_count(), count);
            assert_eq!(drape.tiles(count - 1), [1, 1]);
            assert_eq!(drape.tiles_of(drape.top()).count(), 1);
        }
        let drape = drape([65, 700], 3);
        let mut groups = vec![drape.top()];
        let mut texels = vec![0; 4];
        while let Some(group) = groups.pop() {
            for id in drape.tiles_of(group) {
                assert_eq!(id.group(), group);
                let [width, height] = drape.tile_size(id);
                texels[usize::from(id.level)] += width * height;
                groups.extend(id.below());
            }
        }
        assert_eq!(texels, [65 * 700, 9 * 88, 2 * 11, 2]);
    }

    #[test]
    fn heads_and_directories_survive_and_nonsense_is_refused() {
        let limits = Limits::default();
        let top = Part { offset: HEAD_BYTES as u64, length: 90, checksum: 7 };
        let head = Head { drape: drape([65, 700], 3), top };
        let bytes = head.write();
        assert_eq!(Head::parse(&bytes, &limits).unwrap(), head);
        assert!((0..bytes.len()).all(|end| Head::parse(&bytes[..end], &limits).is_err()));
        assert!((0..bytes.len() * 8).all(|bit| {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            Head::parse(&changed, &limits).is_err()
        }));
        let part = |offset: u64, length: u64| Part { offset, length, checksum: if length > 0 { 5 } else { 0 } };
        let images = vec![
            [part(100, 4), part(107, 2), part(109, 0), part(109, 9)],
            [part(104, 0), part(109, 0), part(109, 0), part(118, 0)],
            [part(104, 3), part(109, 0), part(109, 0), part(118, 0)],
        ];
        let below = vec![part(70, 20), part(90, 0), part(90, 10)];
        let directory = Directory { images, below };
        let bytes = directory.write(100, 70);
        assert_eq!(Directory::parse(&bytes, 3, true, &limits).unwrap(), directory);
        assert!((0..bytes.len()).all(|end| Directory::parse(&bytes[..end], 3, true, &limits).is_err()));
        let mut bad = directory.clone();
        bad.below[0] = part(70, 0);
        assert!(Directory::parse(&bad.write(100, 70), 3, true, &limits).is_err());
        let mut bad = directory;
        bad.below[1] = part(90, 1);
        assert!(Directory::parse(&bad.write(100, 70), 3, true, &limits).is_err());
    }
}
