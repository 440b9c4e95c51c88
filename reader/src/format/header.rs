//! The first bytes of a file: header and section directory (SPEC.md, "Header" and "Section directory").
//!
//! ```text
//! header, 64 bytes                          directory, 32 bytes per section
//!  0  magic            8                     0  kind          u32
//!  8  major version    u16                   4  flags         u32
//! 10  minor version    u16                   8  offset        u64
//! 12  flags            u32, zero            16  length        u64
//! 16  lattice origin   3 f64                24  checksum      u32
//! 40  lattice step     i32, log2            28  reserved      u32, zero
//! 44  section count    u32
//! 48  directory offset u64, 64
//! 56  directory CRC-32 u32
//! 60  header CRC-32    u32, of bytes 0..60
//! ```
//! The directory follows the header, and the sections follow the directory and each other without gaps, so a checksum
//! covers every byte of a file. PAGES is the last section. A file has both CHANNELS and TEXELS or neither, and both
//! OBJECTS and OBJECT_PAGES or neither.

use crate::{
    codec::bytes::{Cursor, has_checksum},
    error::{Error, Result},
    lattice::Lattice,
};

/// The first byte is not ASCII, so 7-bit channels damage it; CR LF and LF reveal text conversion; a DOS end-of-file
/// lies between them.
pub(crate) const MAGIC: [u8; 8] = *b"\x8fLOD\r\n\x1a\n";
/// Another major version cannot be read. A larger minor version only adds optional sections.
pub(crate) const VERSION: (u16, u16) = (4, 0);
/// The version of files with channels. All others keep the smaller minor version, so that channels change no byte of
/// them.
pub(crate) const VERSION_WITH_CHANNELS: (u16, u16) = (4, 1);
/// The version of files of heights.
pub(crate) const VERSION_WITH_HEIGHTS: (u16, u16) = (4, 2);
/// The version of files of a mesh that stands on a ground of heights.
pub(crate) const VERSION_WITH_GROUND: (u16, u16) = (4, 3);
/// The version of files with images in scales.
pub(crate) const VERSION_WITH_SCALES: (u16, u16) = (4, 4);
/// The version of files of heights with an image over them.
pub(crate) const VERSION_WITH_DRAPE: (u16, u16) = (4, 5);
/// The version of files with objects.
pub(crate) const VERSION_WITH_OBJECTS: (u16, u16) = (4, 6);
/// Size of the header.
pub(crate) const HEADER_BYTES: usize = 64;
/// Size of a directory entry.
pub(crate) const ENTRY_BYTES: usize = 32;
/// More sections are refused.
const MAX_SECTIONS: u32 = 256;

/// A reader that does not know the section's kind must refuse the file.
const FLAG_REQUIRED: u32 = 1;
/// The parts of the section carry checksums; the one in the directory is zero.
const FLAG_CHECKED_BY_PARTS: u32 = 2;

/// The known kinds of sections.
pub(crate) mod kind {
    /// What the file was made from (optional).
    pub(crate) const SOURCE: u32 = 1;
    /// Levels of detail.
    pub(crate) const LEVELS: u32 = 2;
    /// Entropy tables.
    pub(crate) const TABLES: u32 = 3;
    /// The topmost list of clusters: the resident top of the index.
    pub(crate) const CLUSTERS: u32 = 4;
    /// Index blocks, one per cluster, and all other lists of clusters.
    pub(crate) const INDEX: u32 = 5;
    /// Pages.
    pub(crate) const PAGES: u32 = 6;
    /// One small mesh of everything (optional).
    pub(crate) const OVERVIEW: u32 = 7;
    /// What the surface carries besides positions (optional, with TEXELS).
    pub(crate) const CHANNELS: u32 = 8;
    /// The values of channels (optional, with CHANNELS).
    pub(crate) const TEXELS: u32 = 9;
    /// Where the surface is in the world (optional).
    pub(crate) const PLACEMENT: u32 = 10;
    /// A grid of heights, instead of levels (with HEIGHT_INDEX).
    pub(crate) const HEIGHTS: u32 = 11;
    /// What a file says about the tiles of a grid of heights.
    pub(crate) const HEIGHT_INDEX: u32 = 12;
    /// Colours by height (optional, with HEIGHTS).
    pub(crate) const RAMP: u32 = 13;
    /// The heights that a mesh stands on: a whole file of them (optional, not with HEIGHTS).
    pub(crate) const GROUND: u32 = 14;
    /// Which images are divided into scales (with CHANNELS).
    pub(crate) const SCALES: u32 = 15;
    /// An image over a grid of heights (optional, with HEIGHTS).
    pub(crate) const DRAPE: u32 = 16;
    /// How many objects there are, and where lists of them are (optional, with OBJECT_PAGES).
    pub(crate) const OBJECTS: u32 = 17;
    /// Lists of objects (with OBJECTS).
    pub(crate) const OBJECT_PAGES: u32 = 18;

    /// The name of a kind of section.
    pub(crate) fn name(kind: u32) -> &'static str {
        match kind {
            SOURCE => "source",
            LEVELS => "levels",
            TABLES => "tables",
            CLUSTERS => "clusters",
            INDEX => "index",
            PAGES => "pages",
            OVERVIEW => "overview",
            CHANNELS => "channels",
            TEXELS => "texels",
            PLACEMENT => "placement",
            HEIGHTS => "heights",
            HEIGHT_INDEX => "height index",
            RAMP => "ramp",
            GROUND => "ground",
            SCALES => "scales",
            DRAPE => "drape",
            OBJECTS => "objects",
            OBJECT_PAGES => "object pages",
            _ => "unknown",
        }
    }

    /// The flags that a known kind of section must have.
    pub(crate) fn flags(kind: u32) -> Option<u32> {
        use super::{FLAG_CHECKED_BY_PARTS, FLAG_REQUIRED};
        match kind {
            SOURCE | OVERVIEW | CHANNELS | PLACEMENT | RAMP | OBJECTS => Some(0),
            LEVELS | TABLES | CLUSTERS | HEIGHTS | SCALES => Some(FLAG_REQUIRED),
            INDEX | PAGES | HEIGHT_INDEX => Some(FLAG_REQUIRED | FLAG_CHECKED_BY_PARTS),
            TEXELS | GROUND | DRAPE | OBJECT_PAGES => Some(FLAG_CHECKED_BY_PARTS),
            _ => None,
        }
    }
}

/// A directory entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Section {
    pub kind: u32,
    pub required: bool,
    /// CRC-32 of the section, or none if its parts carry their own.
    pub checksum: Option<u32>,
    pub offset: u64,
    pub length: u64,
}

/// Tells files apart, wherever they lie: the checksums of header and directory, on which those of all parts depend. Two
/// files of the same bytes have the same one. It is no protection against files that are made to have another one's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FileId([u32; 2]);

impl FileId {
    /// Numbers for programs in other languages.
    pub fn numbers(self) -> [u32; 2] {
        self.0
    }

    /// Checks that a cut that was selected in a file, if anybody says so, was selected in this one.
    ///
    /// # Errors
    /// [`Error::Query`].
    pub(crate) fn check_cut(self, file: Option<FileId>) -> Result<()> {
        match file {
            Some(file) if file != self => {
                Err(Error::Query { what: "this cut is one of another file; select it in this one".into() })
            }
            _ => Ok(()),
        }
    }

    /// Refuses a filter of objects that was made for another file.
    ///
    /// # Errors
    /// [`Error::Query`].
    pub(crate) fn check_filter(self, file: FileId) -> Result<()> {
        match file == self {
            true => Ok(()),
            false => Err(Error::Query { what: "this filter of objects is one of another file".into() }),
        }
    }
}

/// Header and directory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub id: FileId,
    pub version: (u16, u16),
    pub lattice: Lattice,
    pub sections: Vec<Section>,
}

/// What the header says about the directory that follows it.
pub(crate) struct DirectorySpan {
    section_count: u32,
    checksum: u32,
    version: (u16, u16),
    lattice: Lattice,
    header_checksum: u32,
}

impl DirectorySpan {
    /// Size of the directory.
    pub(crate) fn byte_count(&self) -> usize {
        self.section_count as usize * ENTRY_BYTES
    }
}

impl Header {
    /// What a file of these sections begins with, once it is written.
    pub(crate) fn new(version: (u16, u16), lattice: Lattice, sections: Vec<Section>) -> Self {
        Self { id: FileId([0; 2]), version, lattice, sections }
    }

    /// The bytes of header and directory. Derives the sections' offsets from their order and lengths, and the file's
    /// id.
    pub(crate) fn write(&mut self) -> Vec<u8> {
        let mut offset = (HEADER_BYTES + self.sections.len() * ENTRY_BYTES) as u64;
        let mut directory = Vec::new();
        for section in &mut self.sections {
            section.offset = offset;
            offset += section.length;
            let by_parts = if section.checksum.is_none() { FLAG_CHECKED_BY_PARTS } else { 0 };
            directory.extend(section.kind.to_le_bytes());
            directory.extend(((u32::from(section.required) * FLAG_REQUIRED) | by_parts).to_le_bytes());
            directory.extend(section.offset.to_le_bytes());
            directory.extend(section.length.to_le_bytes());
            directory.extend(section.checksum.unwrap_or(0).to_le_bytes());
            directory.extend([0; 4]);
        }
        let mut bytes = Vec::from(MAGIC);
        bytes.extend(self.version.0.to_le_bytes());
        bytes.extend(self.version.1.to_le_bytes());
        bytes.extend([0; 4]);
        self.lattice.origin.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(self.lattice.step_log2.to_le_bytes());
        bytes.extend((self.sections.len() as u32).to_le_bytes());
        bytes.extend((HEADER_BYTES as u64).to_le_bytes());
        self.id.0[0] = crc32fast::hash(&directory);
        bytes.extend(self.id.0[0].to_le_bytes());
        self.id.0[1] = crc32fast::hash(&bytes);
        bytes.extend(self.id.0[1].to_le_bytes());
        bytes.extend(directory);
        bytes
    }

    /// Reads the header proper.
    ///
    /// # Errors
    /// [`Error::Format`] if it is damaged or no lodpack file, [`Error::Unsupported`] for another major version.
    pub(crate) fn parse(bytes: &[u8]) -> Result<DirectorySpan> {
        let location = || "header".to_string();
        let Some(header) = bytes.first_chunk::<HEADER_BYTES>() else {
            return Err(Error::format("the file is shorter than a header").at(location));
        };
        parse_header(header).map_err(|error| error.at(location))
    }

    /// Reads the directory.
    ///
    /// # Errors
    /// [`Error::Format`] if it is damaged, [`Error::Unsupported`] if a required section is unknown.
    pub(crate) fn parse_directory(span: &DirectorySpan, bytes: &[u8]) -> Result<Self> {
        parse_directory(span, bytes).map_err(|error| error.at(|| "section directory".to_string()))
    }

    /// The section of a kind, if the file has it.
    pub(crate) fn section(&self, kind: u32) -> Option<&Section> {
        self.sections.iter().find(|section| section.kind == kind)
    }

    /// The section of a kind that every file has.
    pub(crate) fn required_section(&self, kind: u32) -> Result<&Section> {
        self.section(kind).ok_or_else(|| Error::format("a section is missing").at(|| format!("section kind {kind}")))
    }
}

fn parse_header(bytes: &[u8; HEADER_BYTES]) -> Result<DirectorySpan> {
    let mut cursor = Cursor::new(bytes);
    if cursor.bytes(MAGIC.len())? != MAGIC {
        return Err(Error::format("this is not a lodpack file, or it was converted as text"));
    }
    let (checked, checksum) =
        bytes.split_last_chunk().map_or((&bytes[..], 0), |(b, sum)| (b, u32::from_le_bytes(*sum)));
    if !has_checksum(checked, checksum) {
        return Err(Error::format("the checksum does not match"));
    }
    let version = (cursor.u16()?, cursor.u16()?);
    if version.0 != VERSION.0 {
        return Err(Error::Unsupported { what: format!("format version {}.{}", version.0, version.1) });
    }
    cursor.reserved(4)?;
    let lattice = Lattice { origin: [cursor.f64()?, cursor.f64()?, cursor.f64()?], step_log2: cursor.i32()? };
    lattice.check()?;
    let section_count = cursor.u32()?;
    if section_count > MAX_SECTIONS {
        return Err(Error::format("there are more than 256 sections"));
    }
    if cursor.u64()? != HEADER_BYTES as u64 {
        return Err(Error::format("the directory does not follow the header"));
    }
    Ok(DirectorySpan { section_count, checksum: cursor.u32()?, version, lattice, header_checksum: checksum })
}

fn parse_directory(span: &DirectorySpan, bytes: &[u8]) -> Result<Header> {
    let mut cursor = Cursor::new(bytes);
    let bytes = cursor.bytes(span.byte_count())?;
    if !has_checksum(bytes, span.checksum) {
        return Err(Error::format("the checksum does not match"));
    }
    let mut cursor = Cursor::new(bytes);
    let mut next_offset = (HEADER_BYTES + bytes.len()) as u64;
    let mut sections: Vec<Section> = Vec::with_capacity(span.section_count as usize);
    for _ in 0..span.section_count {
        let (kind, flags) = (cursor.u32()?, cursor.u32()?);
        let (offset, length, checksum) = (cursor.u64()?, cursor.u64()?, cursor.u32()?);
        cursor.reserved(4)?;
        if flags & !(FLAG_REQUIRED | FLAG_CHECKED_BY_PARTS) != 0 {
            return Err(Error::format("a reserved flag is set"));
        }
        let required = flags & FLAG_REQUIRED != 0;
        let by_parts = flags & FLAG_CHECKED_BY_PARTS != 0;
        match kind::flags(kind) {
            None if required => {
                return Err(Error::Unsupported { what: format!("required section of kind {kind}") });
            }
            Some(known) if flags != known => {
                return Err(Error::format("a section does not have the flags of its kind"));
            }
            _ => {}
        }
        if by_parts && checksum != 0 {
            return Err(Error::format("a section that is checked by parts has a checksum"));
        }
        if offset != next_offset {
            return Err(Error::format("a section does not follow the one before it"));
        }
        if sections.iter().any(|section| section.kind == kind) {
            return Err(Error::format("a section occurs twice"));
        }
        next_offset = offset.checked_add(length).ok_or_else(|| Error::format("a section ends beyond 2^64"))?;
        sections.push(Section { kind, required, checksum: (!by_parts).then_some(checksum), offset, length });
    }
    if sections.last().is_none_or(|section| section.kind != kind::PAGES) {
        return Err(Error::format("the pages are not the last section"));
    }
    let has = |kind: u32| sections.iter().any(|section| section.kind == kind);
    let [has_channels, has_texels] = [kind::CHANNELS, kind::TEXELS].map(has);
    if has_channels != has_texels {
        return Err(Error::format("channels come without texels, or texels without channels"));
    }
    if has_channels && span.version < VERSION_WITH_CHANNELS {
        return Err(Error::format("a file of version 4.0 has channels"));
    }
    if has(kind::SCALES) && !has_channels {
        return Err(Error::format("a file has scales of images, and no channels"));
    }
    if has(kind::SCALES) && span.version < VERSION_WITH_SCALES {
        return Err(Error::format("a file of a version before 4.4 has images in scales"));
    }
    let [has_heights, has_height_index] = [kind::HEIGHTS, kind::HEIGHT_INDEX].map(has);
    if has_heights != has_height_index {
        return Err(Error::format("heights come without their index, or their index without heights"));
    }
    if has_heights && span.version < VERSION_WITH_HEIGHTS {
        return Err(Error::format("a file of a version before 4.2 has heights"));
    }
    if has_heights && ([kind::LEVELS, kind::CLUSTERS, kind::INDEX].into_iter().any(has) || has_channels) {
        return Err(Error::format("a file has heights, and sections of a mesh beside them"));
    }
    if has(kind::GROUND) && has_heights {
        return Err(Error::format("a file has heights, and a ground of heights beside them"));
    }
    if has(kind::GROUND) && span.version < VERSION_WITH_GROUND {
        return Err(Error::format("a file of a version before 4.3 has a ground"));
    }
    if has(kind::RAMP) && !has_heights {
        return Err(Error::format("a file of a mesh has a ramp of heights"));
    }
    if has(kind::DRAPE) && !has_heights {
        return Err(Error::format("a file of a mesh has an image over heights"));
    }
    if has(kind::DRAPE) && span.version < VERSION_WITH_DRAPE {
        return Err(Error::format("a file of a version before 4.5 has an image over heights"));
    }
    let [has_objects, has_object_pages] = [kind::OBJECTS, kind::OBJECT_PAGES].map(has);
    if has_objects != has_object_pages {
        return Err(Error::format("objects come without their pages, or pages of objects without these"));
    }
    if has_objects && has_heights {
        return Err(Error::format("a file of heights has objects"));
    }
    if has_objects && span.version < VERSION_WITH_OBJECTS {
        return Err(Error::format("a file of a version before 4.6 has objects"));
    }
    if has_heights && span.lattice != Lattice::default() {
        return Err(Error::format("a file of heights has another lattice than that of origin 0 and step 1"));
    }
    let id = FileId([span.checksum, span.header_checksum]);
    Ok(Header { id, version: span.version, lattice: span.lattice, sections })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(kinds: &[(u32, bool)]) -> Header {
        let sections = kinds.iter().map(|&(kind, required)| Section {
            kind,
            required,
            checksum: (kind != kind::PAGES).then_some(7),
            offset: 0,
            length: 10,
        });
        let lattice = Lattice { origin: [1.0, -2.5, 1e6], step_log2: -11 };
        Header::new(VERSION, lattice, sections.collect())
    }

    fn parse(bytes: &[u8]) -> Result<Header> {
        let span = Header::parse(bytes)?;
        Header::parse_directory(&span, &bytes[HEADER_BYTES..])
    }

    #[test]
    fn headers_round_trip_and_every_bit_is_guarded() {
        let mut header = header(&[(kind::LEVELS, true), (99, false), (kind::PAGES, true)]);
        let bytes = header.write();
        assert_eq!(parse(&bytes).unwrap(), header);
        assert!((0..bytes.len()).all(|end| parse(&bytes[..end]).is_err()));
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(parse(&changed).is_err());
        }
    }

    #[test]
    fn unknown_sections_are_skipped_if_optional_and_refused_if_required() {
        assert!(parse(&header(&[(99, false), (kind::PAGES, true)]).write()).is_ok());
        let refused = parse(&header(&[(99, true), (kind::PAGES, true)]).write());
        assert!(matches!(refused, Err(Error::Unsupported { .. })));
        assert!(parse(&header(&[(kind::PAGES, true), (99, false)]).write()).is_err());
        assert!(parse(&header(&[(99, false), (99, false), (kind::PAGES, true)]).write()).is_err());
    }

    #[test]
    fn a_ground_is_in_files_of_version_4_3_and_not_beside_heights() {
        let mut file = header(&[(kind::GROUND, false), (kind::PAGES, true)]);
        file.sections[0].checksum = None;
        assert!(parse(&file.write()).unwrap_err().to_string().contains("version before 4.3"));
        file.version = VERSION_WITH_GROUND;
        assert!(parse(&file.write()).is_ok());
        let heights = header(&[(kind::HEIGHTS, true), (kind::HEIGHT_INDEX, true)]);
        file.sections.splice(..0, heights.sections);
        file.sections[1].checksum = None;
        file.lattice = Lattice::default();
        assert!(parse(&file.write()).unwrap_err().to_string().contains("beside them"));
    }

    #[test]
    fn channels_and_texels_come_together_and_in_files_of_version_4_1() {
        let mut both = header(&[(kind::CHANNELS, false), (kind::TEXELS, false), (kind::PAGES, true)]);
        both.sections[1].checksum = None;
        assert!(parse(&both.write()).unwrap_err().to_string().contains("version 4.0"));
        both.version = VERSION_WITH_CHANNELS;
        assert!(parse(&both.write()).is_ok());
        for alone in [0, 1] {
            let mut one = both.clone();
            one.sections.remove(alone);
            assert!(parse(&one.write()).unwrap_err().to_string().contains("without"));
        }
    }

    #[test]
    fn newer_major_versions_are_refused_and_minor_ones_read() {
        let mut newer = header(&[(kind::PAGES, true)]);
        newer.version = (VERSION.0, 9);
        assert!(parse(&newer.write()).is_ok());
        newer.version = (VERSION.0 + 1, 0);
        assert!(matches!(parse(&newer.write()), Err(Error::Unsupported { .. })));
    }
}
