//! Opening a file from bytes that somebody else reads: the opener says which bytes it needs, takes them, and ends with
//! an [`Index`].

use std::{ops::Range, sync::Mutex};

use crate::{
    codec::{bytes::has_checksum, entropy::Tables},
    error::{Error, Result},
    format::{
        channels::Channels,
        cluster_lists::parse_clusters,
        error_code::ErrorCode,
        header::{HEADER_BYTES, Header, MAGIC, Section, kind},
        levels::Levels,
        overview::OverviewSection,
        placement::Placement,
        sections::parse_source,
    },
    index::{Index, lists::List, texels::Texels},
    lattice::Lattice,
    limits::{Limits, within},
    objects::OpenObjects,
    sorted::SortedMap,
    source::{Fetched, requests::plan},
};

/// The size of the first read. It covers the whole index of a small file, and header, levels and tables of a large one,
/// and costs no more than a hundredth of a megabyte.
pub(crate) const FIRST_READ_BYTES: u64 = 8 << 10;

/// Opens a file from bytes that the caller reads.
///
/// ```
/// # fn read(bytes: &[u8], range: std::ops::Range<u64>) -> Vec<u8> {
/// #     bytes[range.start as usize..(range.end as usize).min(bytes.len())].to_vec()
/// # }
/// # fn open(file: &[u8]) -> lodpack::Result<lodpack::Index> {
/// let mut opener = lodpack::Opener::new(lodpack::Limits::default());
/// opener.start(read(file, lodpack::Opener::FIRST_READ), file.len() as u64);
/// let index = loop {
///     match opener.finish() {
///         Err(lodpack::Error::Missing { ranges }) => {
///             for range in ranges {
///                 opener.insert(range.start, read(file, range));
///             }
///         }
///         done => break done?,
///     }
/// };
/// # Ok(index)
/// # }
/// # assert!(open(&[]).is_err());
/// ```
#[derive(Clone, Debug)]
pub struct Opener {
    limits: Limits,
    accepts_prefix: bool,
    size: u64,
    fetched: Fetched,
}

impl Opener {
    /// The first bytes of every lodpack file.
    pub const MAGIC: [u8; 8] = MAGIC;

    /// The bytes to read first. A file may be shorter.
    pub const FIRST_READ: Range<u64> = 0..FIRST_READ_BYTES;

    /// An opener without any bytes yet.
    pub fn new(limits: Limits) -> Self {
        Self { limits, accepts_prefix: false, size: 0, fetched: Fetched::default() }
    }

    /// Also accepts the beginning of a file, which may end anywhere after the pages of level 0. It is a complete,
    /// coarser model.
    #[must_use]
    pub fn accept_prefix(self) -> Self {
        Self { accepts_prefix: true, ..self }
    }

    /// Takes the bytes of [`Opener::FIRST_READ`], fewer if the file is shorter, and the size of the file.
    pub fn start(&mut self, bytes: Vec<u8>, size: u64) {
        self.size = size;
        self.fetched.insert(0, bytes);
    }

    /// Takes bytes that were missing.
    pub fn insert(&mut self, offset: u64, bytes: Vec<u8>) {
        self.fetched.insert(offset, bytes);
    }

    /// Returns the file's index, or [`Error::Missing`] with the ranges to read first.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Format`] if the file is damaged or not whole, [`Error::Unsupported`] if it needs a
    /// newer reader, [`Error::Limit`].
    pub fn finish(&self) -> Result<Index> {
        let truncated = || Error::format("the file is truncated");
        let header = self.header()?;
        if header.section(kind::HEIGHTS).is_some() {
            let what = "this file holds a grid of heights, not a mesh; open it with lodpack::heights::Heights".into();
            return Err(Error::Query { what });
        }
        let (index, pages) = (*header.required_section(kind::INDEX)?, *header.required_section(kind::PAGES)?);
        let resident = [
            kind::SOURCE,
            kind::PLACEMENT,
            kind::LEVELS,
            kind::TABLES,
            kind::OVERVIEW,
            kind::CHANNELS,
            kind::SCALES,
            kind::OBJECTS,
            kind::CLUSTERS,
        ];
        self.need(resident.into_iter().filter_map(|kind| header.section(kind)))?;

        let levels = self.parse(&header, kind::LEVELS, |bytes| Levels::parse(bytes, pages.length))?;
        let tables = self.parse(&header, kind::TABLES, Tables::parse)?;
        let clusters =
            self.parse(&header, kind::CLUSTERS, |bytes| parse_clusters(bytes, &levels, index.length, &self.limits))?;
        let info = match header.section(kind::SOURCE) {
            Some(_) => Some(self.parse(&header, kind::SOURCE, parse_source)?),
            None => None,
        };
        let overview = match header.section(kind::OVERVIEW) {
            Some(_) => Some(self.parse(&header, kind::OVERVIEW, |bytes| OverviewSection::parse(bytes, &self.limits))?),
            None => None,
        };
        let top = List::new(clusters);
        let texels = match (header.section(kind::CHANNELS), header.section(kind::TEXELS)) {
            (Some(_), Some(&section)) => {
                let mut channels = self.parse(&header, kind::CHANNELS, Channels::parse)?;
                if header.section(kind::SCALES).is_some() {
                    channels = self.parse(&header, kind::SCALES, |bytes| channels.clone().with_scales(bytes))?;
                }
                let location = || format!("section {}", kind::name(kind::TEXELS));
                Some(Texels::new(channels, section, top.cluster_count()).map_err(|error| error.at(location))?)
            }
            _ => None,
        };
        let objects = match (header.section(kind::OBJECTS), header.section(kind::OBJECT_PAGES)) {
            (Some(_), Some(&pages)) => {
                let clusters = top.cluster_count();
                let parse = |bytes: &[u8]| OpenObjects::parse(bytes, pages, clusters, &self.limits);
                Some(self.parse(&header, kind::OBJECTS, parse)?)
            }
            _ => None,
        };
        let placement = match header.section(kind::PLACEMENT) {
            Some(_) => Some(self.parse(&header, kind::PLACEMENT, Placement::parse)?),
            None => None,
        };
        let end = || "end of the file".to_string();
        if self.size > pages.offset.saturating_add(pages.length) {
            return Err(Error::format("there are bytes after the last section").at(end));
        }
        let level_ends = levels.levels.iter().map(|level| pages.offset + level.page_offset + level.page_bytes);
        let whole_level_count = level_ends.take_while(|&end| end <= self.size).count();
        if whole_level_count == 0 {
            return Err(truncated().at(|| "pages of level 0".to_string()));
        }
        if whole_level_count < levels.levels.len() && !self.accepts_prefix {
            return Err(truncated().at(end));
        }
        Ok(Index {
            limits: self.limits,
            tolerances: tolerance_codes(&levels, &header.lattice)?,
            index_offset: index.offset,
            pages_offset: pages.offset,
            whole_level_count: whole_level_count as u8,
            header,
            levels,
            tables,
            info,
            overview,
            placement,
            damaged: Mutex::new(SortedMap::new()),
            top,
            texels,
            objects,
            head: self.fetched.clone(),
        })
    }

    /// The size of the file.
    pub(crate) fn size(&self) -> u64 {
        self.size
    }

    /// What the file may ask of the machine.
    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The bytes that are there.
    pub(crate) fn fetched(&self) -> &Fetched {
        &self.fetched
    }

    /// Header and directory.
    pub(crate) fn header(&self) -> Result<Header> {
        let head = self.bytes(0..self.size.min(FIRST_READ_BYTES))?;
        let span = Header::parse(head)?;
        let directory = HEADER_BYTES as u64..(HEADER_BYTES + span.byte_count()) as u64;
        if directory.end > self.size {
            return Err(Error::format("the file is truncated").at(|| "section directory".to_string()));
        }
        Header::parse_directory(&span, self.bytes(directory)?)
    }

    fn bytes(&self, range: Range<u64>) -> Result<&[u8]> {
        let missing = || Error::Missing { ranges: vec![self.fetched.rest_of(range.clone())] };
        self.fetched.get(range.clone()).ok_or_else(missing)
    }

    /// Returns [`Error::Missing`] for all of these sections that are not there, at once.
    pub(crate) fn need<'s>(&self, sections: impl Iterator<Item = &'s Section>) -> Result<()> {
        let mut missing = Vec::new();
        for section in sections {
            let location = || format!("section {}", kind::name(section.kind));
            let end = section.offset.checked_add(section.length).filter(|&end| end <= self.size);
            let end = end.ok_or_else(|| Error::format("the file is truncated").at(location))?;
            within(self.limits.part_bytes, section.length, "size of a section")?;
            missing.push(self.fetched.rest_of(section.offset..end));
        }
        let ranges = plan(missing);
        if ranges.is_empty() { Ok(()) } else { Err(Error::Missing { ranges }) }
    }

    /// Reads a section that is there.
    pub(crate) fn parse<T>(&self, header: &Header, kind: u32, parse: impl FnOnce(&[u8]) -> Result<T>) -> Result<T> {
        let section = header.required_section(kind)?;
        let location = || format!("section {}", kind::name(kind));
        let bytes = self.bytes(section.offset..section.offset.saturating_add(section.length))?;
        if !section.checksum.is_some_and(|checksum| has_checksum(bytes, checksum)) {
            return Err(Error::format("the checksum does not match").at(location));
        }
        parse(bytes).map_err(|error| error.at(location))
    }
}

fn tolerance_codes(levels: &Levels, lattice: &Lattice) -> Result<Vec<ErrorCode>> {
    let codes = levels.levels.iter().map(|level| ErrorCode::at_least(level.tolerance, lattice));
    codes.collect::<Result<_>>().map_err(|_| Error::format("a tolerance is too large").at(|| "levels".to_string()))
}
