//! The directories of a TIFF, and the file as it would be if some of their entries said something else.
//!
//! The crate `tiff` decodes every compression, but as pictures: it turns shades over where white is zero, and refuses
//! masks and samples of unusual widths. Entries that call such numbers shades of grey in bytes give them as they are
//! stored.

use std::collections::BTreeSet;
use std::io::{self, Read, Seek, SeekFrom};

// Numbers of tags.
/// The kind of an image: a smaller version of another one, or its mask.
const NEW_SUBFILE_TYPE: u16 = 254;
/// Columns of the image.
pub const IMAGE_WIDTH: u16 = 256;
/// Rows of the image.
pub const IMAGE_LENGTH: u16 = 257;
/// Bits of each sample.
pub const BITS_PER_SAMPLE: u16 = 258;
/// The number of the compression.
pub const COMPRESSION: u16 = 259;
/// What samples mean as colours.
pub const PHOTOMETRIC: u16 = 262;
/// The order of bits in a byte.
pub const FILL_ORDER: u16 = 266;
/// Samples of each pixel.
pub const SAMPLES_PER_PIXEL: u16 = 277;
/// Whether each sample has a plane of its own.
pub const PLANAR_CONFIGURATION: u16 = 284;
/// How samples were predicted before they were compressed.
pub const PREDICTOR: u16 = 317;
/// Columns of a tile.
pub const TILE_WIDTH: u16 = 322;
/// Rows of a tile.
pub const TILE_LENGTH: u16 = 323;
/// Where the tiles are in the file.
pub const TILE_OFFSETS: u16 = 324;
/// What samples beside the colours mean.
pub const EXTRA_SAMPLES: u16 = 338;
/// Whether samples are integers or floats.
pub const SAMPLE_FORMAT: u16 = 339;

/// Bits of the kind of an image: a smaller version of another one, and a mask of another one.
const IS_REDUCED: u64 = 1;
const IS_MASK: u64 = 4;
/// The most images of a file.
const MAX_DIRECTORIES: usize = 1 << 16;

/// How numbers are stored, and how wide offsets are.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Whether the low byte comes first.
    pub is_little: bool,
    is_big: bool,
}

impl Layout {
    fn number(self, bytes: &[u8]) -> u64 {
        let join = |all: u64, byte: &u8| all << 8 | u64::from(*byte);
        if self.is_little { bytes.iter().rev().fold(0, join) } else { bytes.iter().fold(0, join) }
    }

    fn short(self, value: u16) -> [u8; 2] {
        if self.is_little { value.to_le_bytes() } else { value.to_be_bytes() }
    }

    fn long(self, value: u32) -> [u8; 4] {
        if self.is_little { value.to_le_bytes() } else { value.to_be_bytes() }
    }

    /// Bytes of an entry, and of the values that it holds itself.
    fn entry_bytes(self) -> [usize; 2] {
        if self.is_big { [20, 8] } else { [12, 4] }
    }
}

/// What describes one image of a file.
pub struct Directory {
    /// How the numbers of its file are stored.
    pub layout: Layout,
    /// Where it is in the file.
    at: u64,
    /// Where its entries are, and what they say.
    first_entry: u64,
    entries: Vec<u8>,
}

/// Whether a file that begins so is a TIFF.
pub fn is_tiff(start: &[u8]) -> bool {
    matches!(start, [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..])
}

impl Directory {
    /// All directories of a file in order; there is at least one. Those before an error are in `all`.
    ///
    /// # Errors
    /// If it cannot be read, or names directories behind its end.
    pub fn read_all(file: &mut (impl Read + Seek), all: &mut Vec<Self>) -> io::Result<()> {
        let length = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        let mut start = [0; 16];
        file.read_exact(&mut start[..8])?;
        let is_little = start[0] == b'I';
        let is_big = start[2..4] == [43, 0] || start[2..4] == [0, 43];
        let layout = Layout { is_little, is_big };
        if is_big {
            file.read_exact(&mut start[8..])?;
        }
        let mut at = layout.number(if is_big { &start[8..16] } else { &start[4..8] });
        let mut seen = BTreeSet::from([at]);
        // Directories do not overlap, so that all of them have no more bytes than the file.
        let mut left = length;
        // A list that leads back to where it has been ends there.
        while all.is_empty() || at != 0 && all.len() < MAX_DIRECTORIES && seen.insert(at) {
            file.seek(SeekFrom::Start(at))?;
            let mut count = [0; 8];
            let count = &mut count[..if is_big { 8 } else { 2 }];
            file.read_exact(count)?;
            let first_entry = at + count.len() as u64;
            let bytes = layout.number(count).saturating_mul(layout.entry_bytes()[0] as u64);
            if bytes > left.min(length.saturating_sub(first_entry)) {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            left -= bytes;
            let mut entries = vec![0; bytes as usize];
            file.read_exact(&mut entries)?;
            let mut next = [0; 8];
            let next = &mut next[..if is_big { 8 } else { 4 }];
            file.read_exact(next)?;
            all.push(Self { layout, at, first_entry, entries });
            at = layout.number(next);
        }
        Ok(())
    }

    /// The place of an entry among the entries.
    fn find(&self, tag: u16) -> Option<usize> {
        let [bytes, _] = self.layout.entry_bytes();
        self.entries.chunks_exact(bytes).position(|entry| self.layout.number(&entry[..2]) == u64::from(tag))
    }

    /// Whether it has an entry.
    pub fn has(&self, tag: u16) -> bool {
        self.find(tag).is_some()
    }

    /// The first number of an entry that holds its numbers itself.
    pub fn get(&self, tag: u16) -> Option<u64> {
        let [bytes, inline] = self.layout.entry_bytes();
        let entry = self.entries.chunks_exact(bytes).nth(self.find(tag)?)?;
        let (kind, count) = (self.layout.number(&entry[2..4]), self.layout.number(&entry[4..bytes - inline]));
        let width = match kind {
            1 => 1,
            3 => 2,
            4 => 4,
            16 => 8,
            _ => return None,
        };
        let is_inline = count > 0 && count.saturating_mul(width as u64) <= inline as u64;
        is_inline.then(|| self.layout.number(&entry[bytes - inline..][..width]))
    }

    /// Columns and rows.
    pub fn size(&self) -> [u64; 2] {
        [IMAGE_WIDTH, IMAGE_LENGTH].map(|tag| self.get(tag).unwrap_or(0))
    }

    /// Whether it says which samples of the first image count.
    pub fn is_mask(&self) -> bool {
        let kind = self.get(NEW_SUBFILE_TYPE).unwrap_or(0);
        kind & IS_MASK != 0 && kind & IS_REDUCED == 0
    }

    /// The file with this image as its first one, whose entries of some tags say other numbers.
    pub fn view<R>(&self, file: R, changes: &[(u16, u32)]) -> View<R> {
        let layout = self.layout;
        let [bytes, inline] = layout.entry_bytes();
        let mut patches = vec![match layout.is_big {
            true => {
                let at = self.at;
                (8, if layout.is_little { at.to_le_bytes() } else { at.to_be_bytes() }.to_vec())
            }
            false => (4, layout.long(self.at as u32).to_vec()),
        }];
        for &(tag, value) in changes {
            let Some(place) = self.find(tag) else { continue };
            // Kind 4: one number of 32 bits.
            let mut entry = [layout.short(tag), layout.short(4)].concat();
            let mut number = layout.long(1).to_vec();
            number.resize(bytes - inline - 4, 0);
            if layout.is_big && !layout.is_little {
                number.rotate_right(4);
            }
            entry.extend(number);
            entry.extend(layout.long(value));
            entry.resize(bytes, 0);
            patches.push((self.first_entry + (place * bytes) as u64, entry));
        }
        View { file, at: 0, patches }
    }
}

/// A file of which some bytes are others.
pub struct View<R> {
    file: R,
    at: u64,
    /// Places, and what stands there.
    patches: Vec<(u64, Vec<u8>)>,
}

impl<R: Read> Read for View<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(into)?;
        let end = self.at + read as u64;
        for (place, bytes) in &self.patches {
            let (from, to) = (self.at.max(*place), end.min(place + bytes.len() as u64));
            if from < to {
                let length = (to - from) as usize;
                let (into, bytes) = (&mut into[(from - self.at) as usize..], &bytes[(from - place) as usize..]);
                into[..length].copy_from_slice(&bytes[..length]);
            }
        }
        self.at = end;
        Ok(read)
    }
}

impl<R: Seek> Seek for View<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// The directories that are found, by their places and the bytes of their entries, and how it ended.
    fn found(bytes: &[u8]) -> (Vec<(u64, usize)>, Option<io::ErrorKind>) {
        let mut all = vec![];
        let error = Directory::read_all(&mut Cursor::new(bytes), &mut all).err().map(|error| error.kind());
        (all.iter().map(|directory| (directory.at, directory.entries.len())).collect(), error)
    }

    /// A file of so many bytes whose first directory is at 8, where 16-bit and 32-bit numbers stand at places.
    fn file(length: usize, shorts: &[(usize, u16)], longs: &[(usize, u32)]) -> Vec<u8> {
        let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
        bytes.resize(length, 0);
        shorts.iter().for_each(|&(at, value)| bytes[at..at + 2].copy_from_slice(&value.to_le_bytes()));
        longs.iter().for_each(|&(at, value)| bytes[at..at + 4].copy_from_slice(&value.to_le_bytes()));
        bytes
    }

    #[test]
    fn directories_that_lead_to_each_other_are_read_once() {
        // One entry each: count, entry, and where the next one is.
        let two = file(44, &[(8, 1), (26, 1)], &[(22, 26), (40, 8)]);
        assert_eq!(found(&two), (vec![(8, 12), (26, 12)], None));
        let itself = file(26, &[(8, 1)], &[(22, 8)]);
        assert_eq!(found(&itself), (vec![(8, 12)], None));
        let empty = file(14, &[(8, 0)], &[(10, 8)]);
        assert_eq!(found(&empty), (vec![(8, 0)], None));
    }

    #[test]
    fn directories_that_overlap_have_no_more_bytes_than_their_file() {
        // A thousand of them, four bytes apart, each of a thousand entries: 12 MB in a file of 20 kB.
        let (each, count) = (1000u16, 1000usize);
        let entries = 12 * usize::from(each);
        let at = |number: usize| 8 + 4 * number;
        let shorts: Vec<_> = (0..count).map(|number| (at(number), each)).collect();
        let longs: Vec<_> = (0..count).map(|number| (at(number) + 2 + entries, at(number + 1) as u32)).collect();
        let bytes = file(at(count) + entries + 8, &shorts, &longs);
        let (all, error) = found(&bytes);
        assert!(all.iter().map(|(_, bytes)| bytes).sum::<usize>() <= bytes.len(), "{all:?}");
        assert_eq!((all.len(), error), (1, Some(io::ErrorKind::UnexpectedEof)));
        // Those of no entries end with their number.
        let count = MAX_DIRECTORIES + 100;
        let longs: Vec<_> = (0..count).map(|number| (8 + 6 * number + 2, 8 + 6 * (number as u32 + 1))).collect();
        let (all, error) = found(&file(8 + 6 * count + 8, &[], &longs));
        assert_eq!((all.len(), error), (MAX_DIRECTORIES, None));
    }

    #[test]
    fn counts_that_lie_are_the_end_of_the_file() {
        for count in [3, 1000, u16::MAX] {
            assert_eq!(found(&file(40, &[(8, count)], &[])), (vec![], Some(io::ErrorKind::UnexpectedEof)), "{count}");
        }
        let mut big = b"II\x2b\0\x08\0\0\0\x10\0\0\0\0\0\0\0".to_vec();
        for count in [3u64, 1 << 40, u64::MAX / 20, u64::MAX] {
            big.truncate(16);
            big.extend(count.to_le_bytes());
            big.extend([0; 40]);
            assert_eq!(found(&big), (vec![], Some(io::ErrorKind::UnexpectedEof)), "{count}");
        }
        for end in 0..26 {
            assert!(found(&file(26, &[(8, 1)], &[])[..end]).1.is_some(), "{end}");
        }
    }
}
