//! An open file: its header and resident index; index blocks are read when they are first needed.

use std::sync::OnceLock;

use crate::{
    entropy::Tables,
    error::{Error, Result},
    error_code::ErrorCode,
    fetch::{Piece, read_pieces},
    header::{HEADER_BYTES, Header, kind},
    index::ClusterIndex,
    limits::{Limits, within},
    model::{Lattice, SourceInfo},
    sections::{Cluster, LevelRecord, Levels, parse_clusters, parse_source},
    source::ReadAt,
};

/// How much is read at once on opening; a small file's index is all in there.
const HEAD_BYTES: u64 = 16 << 10;

/// An open lodpack file.
#[derive(Debug)]
pub struct File<S> {
    source: Headed<S>,
    limits: Limits,
    header: Header,
    levels: Levels,
    /// Levels whose pages are all there; all of them unless opened as a prefix.
    whole_level_count: u8,
    tables: Tables,
    info: Option<SourceInfo>,
    tolerances: Vec<ErrorCode>,
    clusters: Vec<Cluster>,
    indices: Vec<OnceLock<ClusterIndex>>,
    /// Offsets of the sections INDEX and PAGES.
    index_offset: u64,
    pages_offset: u64,
}

impl<S: ReadAt> File<S> {
    /// Opens a file: one read of 16 KiB for a small one, one more for each larger section.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] where it is damaged or not whole, [`Error::Unsupported`] where it needs a newer
    /// reader, [`Error::Limit`].
    pub fn open(source: S, limits: Limits) -> Result<Self> {
        let file = Self::open_prefix(source, limits)?;
        if usize::from(file.whole_level_count) < file.levels.levels.len() {
            return Err(Error::format("the file is truncated").at(|| "end of the file".to_string()));
        }
        Ok(file)
    }

    /// Opens the beginning of a file, which may end anywhere after the pages of level 0: a complete coarser model.
    ///
    /// # Errors
    /// As [`File::open`].
    pub fn open_prefix(source: S, limits: Limits) -> Result<Self> {
        let size = source.size().map_err(|error| Error::Io { offset: 0, length: 0, source: error })?;
        let head = read(&source, 0, HEAD_BYTES.min(size))?;
        let source = Headed { source, head };
        let head = &source.head;
        let place = Header::parse(head)?;
        let directory_end = HEADER_BYTES + place.byte_count();
        if directory_end as u64 > size {
            return Err(Error::format("the file is truncated").at(|| "section directory".to_string()));
        }
        let header = match head.get(HEADER_BYTES..directory_end) {
            Some(directory) => Header::parse_directory(&place, directory)?,
            None => {
                let directory = read(&source, HEADER_BYTES as u64, place.byte_count() as u64)?;
                Header::parse_directory(&place, &directory)?
            }
        };
        let sections = Sections { source: &source, size, header: &header, limits: &limits };
        let (index, pages) = (header.required_section(kind::INDEX)?, header.required_section(kind::PAGES)?);
        let levels = sections.parse(kind::LEVELS, "levels", |bytes| Levels::parse(bytes, pages.length))?;
        let tables = sections.parse(kind::TABLES, "tables", Tables::parse)?;
        let clusters = sections
            .parse(kind::CLUSTERS, "clusters", |bytes| parse_clusters(bytes, &levels, index.length, &limits))?;
        let info = match header.section(kind::SOURCE) {
            Some(_) => Some(sections.parse(kind::SOURCE, "source", parse_source)?),
            None => None,
        };
        let pages_end = pages.offset.saturating_add(pages.length);
        if size > pages_end {
            return Err(Error::format("there are bytes after the last section").at(|| "end of the file".to_string()));
        }
        let level_ends = levels.levels.iter().map(|level| pages.offset + level.page_offset + level.page_bytes);
        let whole_level_count = level_ends.take_while(|&end| end <= size).count() as u8;
        if whole_level_count == 0 {
            return Err(Error::format("the file is truncated").at(|| "pages of level 0".to_string()));
        }
        let tolerances = tolerance_codes(&levels, &header.lattice)?;
        let indices = clusters.iter().map(|_| OnceLock::new()).collect();
        let (index_offset, pages_offset) = (index.offset, pages.offset);
        Ok(Self {
            source,
            limits,
            header,
            levels,
            whole_level_count,
            tables,
            info,
            tolerances,
            clusters,
            indices,
            index_offset,
            pages_offset,
        })
    }

    /// Where the lattice of coordinates lies.
    pub fn lattice(&self) -> Lattice {
        self.header.lattice
    }

    /// Major and minor version of the format that the file was written in.
    pub fn version(&self) -> (u16, u16) {
        self.header.version
    }

    /// How many levels can be drawn: all, or those that a prefix holds.
    pub fn level_count(&self) -> usize {
        usize::from(self.whole_level_count)
    }

    /// What is known about a level, coarse to fine.
    pub fn level(&self, level: usize) -> Option<LevelSummary> {
        let LevelRecord { tolerance, max_error, triangle_count, page_bytes, .. } = *self.levels.levels.get(level)?;
        Some(LevelSummary { tolerance, max_error, triangle_count, page_bytes })
    }

    /// What the file was made from, if it says so.
    pub fn source_info(&self) -> Option<&SourceInfo> {
        self.info.as_ref()
    }

    /// Number of roots.
    pub fn root_count(&self) -> u32 {
        self.clusters.last().map_or(0, |cluster| cluster.first_root + cluster.root_count)
    }

    /// Number of arcs.
    pub fn arc_count(&self) -> u32 {
        self.clusters.last().map_or(0, |cluster| cluster.first_arc + cluster.arc_count)
    }

    /// Number of corners.
    pub fn corner_count(&self) -> u32 {
        self.clusters.last().map_or(0, |cluster| cluster.first_corner + cluster.corner_count)
    }

    /// Number of clusters of roots.
    pub fn cluster_count(&self) -> u32 {
        self.clusters.len() as u32
    }

    /// Kind, offset and length of each section.
    pub fn sections(&self) -> Vec<(u32, u64, u64)> {
        self.header.sections.iter().map(|section| (section.kind, section.offset, section.length)).collect()
    }

    /// World box around everything; none for a file without roots.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let boxes = self.clusters.iter().map(|cluster| cluster.bounds.map(|point| self.lattice().world(point)));
        boxes.reduce(|[low, high], [other_low, other_high]| {
            let each = |a: [f64; 3], b: [f64; 3], pick: fn(f64, f64) -> f64| [0, 1, 2].map(|k| pick(a[k], b[k]));
            [each(low, other_low, f64::min), each(high, other_high, f64::max)]
        })
    }

    /// Where the bytes are.
    pub fn source(&self) -> &S {
        &self.source.source
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    pub(crate) fn levels(&self) -> &Levels {
        &self.levels
    }

    pub(crate) fn tables(&self) -> &Tables {
        &self.tables
    }

    pub(crate) fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// A cluster by its number, which comes from this file.
    pub(crate) fn cluster(&self, cluster: u32) -> Result<&Cluster> {
        self.clusters.get(cluster as usize).ok_or_else(|| Error::format("a cluster does not exist"))
    }

    /// The cluster that a root, arc or corner belongs to; `first` picks the cluster's first one.
    pub(crate) fn owner(&self, id: u32, first: fn(&Cluster) -> u32) -> Result<u32> {
        // Clusters without arcs share their first one with the next cluster: the last of these has it.
        let after = self.clusters.partition_point(|cluster| first(cluster) <= id);
        after.checked_sub(1).map(|cluster| cluster as u32).ok_or_else(|| Error::format("a reference leaves the file"))
    }

    /// Reads the index blocks of these clusters, as far as they are not there yet.
    pub(crate) fn load_indices(&self, clusters: impl IntoIterator<Item = u32>) -> Result<()> {
        let mut pieces = Vec::new();
        for number in clusters {
            if self.indices.get(number as usize).is_some_and(|index| index.get().is_none()) {
                pieces.push(Piece { key: number, part: self.cluster(number)?.index });
            }
        }
        let place = |cluster: u32| format!("index block of cluster {cluster}");
        for (number, bytes) in read_pieces(&self.source, self.index_offset, pieces, &place)? {
            let cluster = self.cluster(number)?;
            let index = ClusterIndex::parse(&bytes, &self.tables, cluster, &self.tolerances, &self.limits)
                .map_err(|error| error.at(|| place(number)))?;
            if let Some(slot) = self.indices.get(number as usize) {
                // Another thread may have been first; what it read is the same.
                let _ = slot.set(index);
            }
        }
        Ok(())
    }

    /// The index block of a cluster.
    pub(crate) fn index(&self, cluster: u32) -> Result<&ClusterIndex> {
        let slot = || self.indices.get(cluster as usize).and_then(OnceLock::get);
        if slot().is_none() {
            self.load_indices([cluster])?;
        }
        slot().ok_or_else(|| Error::format("a cluster does not exist"))
    }

    /// Reads page parts.
    pub(crate) fn read_pages<K: Copy + Ord>(
        &self,
        pieces: Vec<Piece<K>>,
        place: &dyn Fn(K) -> String,
    ) -> Result<Vec<(K, Vec<u8>)>> {
        read_pieces(&self.source, self.pages_offset, pieces, place)
    }

    /// Reads a piece of the file.
    pub(crate) fn read(&self, offset: u64, length: u64) -> Result<Vec<u8>> {
        read(&self.source, offset, length)
    }
}

/// What a file says about a level of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSummary {
    /// The error that the level was built for, world units.
    pub tolerance: f64,
    /// Bound of the error where everything is drawn at this level, world units.
    pub max_error: f64,
    /// Triangles where everything is drawn at this level.
    pub triangle_count: u64,
    /// Bytes that this level adds to the coarser ones.
    pub page_bytes: u64,
}

/// A source whose first bytes are kept, so that nothing on them is read twice.
#[derive(Debug)]
struct Headed<S> {
    source: S,
    head: Vec<u8>,
}

impl<S: ReadAt> ReadAt for Headed<S> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> std::io::Result<()> {
        let known = usize::try_from(offset).ok().and_then(|start| self.head.get(start..)).unwrap_or(&[]);
        let (from_head, rest) = buf.split_at_mut(known.len().min(buf.len()));
        from_head.copy_from_slice(&known[..from_head.len()]);
        if rest.is_empty() { Ok(()) } else { self.source.read_at(offset + from_head.len() as u64, rest) }
    }

    fn size(&self) -> std::io::Result<u64> {
        self.source.size()
    }
}

/// Reads a piece of a source. The length is at most what a checked record or a limit says.
fn read(source: &impl ReadAt, offset: u64, length: u64) -> Result<Vec<u8>> {
    let io = |source| Error::Io { offset, length, source };
    let count = usize::try_from(length).map_err(|_| io(std::io::ErrorKind::OutOfMemory.into()))?;
    let mut bytes = vec![0; count];
    source.read_at(offset, &mut bytes).map_err(io)?;
    Ok(bytes)
}

fn tolerance_codes(levels: &Levels, lattice: &Lattice) -> Result<Vec<ErrorCode>> {
    let codes = levels.levels.iter().map(|level| ErrorCode::at_least(level.tolerance, lattice));
    codes.collect::<Result<_>>().map_err(|_| Error::format("a tolerance is too large").at(|| "levels".to_string()))
}

/// The small sections on opening.
struct Sections<'a, S> {
    source: &'a Headed<S>,
    size: u64,
    header: &'a Header,
    limits: &'a Limits,
}

impl<S: ReadAt> Sections<'_, S> {
    fn parse<T>(&self, kind: u32, name: &'static str, parse: impl FnOnce(&[u8]) -> Result<T>) -> Result<T> {
        self.checked(kind, parse).map_err(|error| error.at(|| format!("section {name}")))
    }

    fn checked<T>(&self, kind: u32, parse: impl FnOnce(&[u8]) -> Result<T>) -> Result<T> {
        let section = self.header.required_section(kind)?;
        let end = section.offset.checked_add(section.length).filter(|&end| end <= self.size);
        end.ok_or_else(|| Error::format("the file is truncated"))?;
        within(self.limits.part_bytes, section.length, "size of a section")?;
        let bytes = read(self.source, section.offset, section.length)?;
        if section.checksum != Some(crc32fast::hash(&bytes)) {
            return Err(Error::format("the checksum does not match"));
        }
        parse(&bytes)
    }
}
