//! Inputs whose vertices and triangles lie at known places, so that several processes can each read a range of them:
//! binary STL, binary PLY of triangles alone, and texts of which tasks have already read ranges ([`super::text`]).
//!
//! What is read is what [`super::import_large_meshes`] reads, in the same order. All other inputs have to be read from
//! their beginning.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::attributes::AttributeSink;
use super::error::{ImportError, Parsed};
use super::objects::{ObjectSink, Objects};
use super::ply::PlyPlaces;
use super::source::{FileBytes, Source};
use super::text_files::{TextFiles, TextPlaces};
use super::{Format, check_size, detect_format, raster, stl};
use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::Channels;
use lodpack_mesh::attributes::Attributes;
use lodpack_runtime::progress::Silent;
use lodpack_runtime::storage::Windows;

/// Input files of which any vertex and any triangle can be read.
pub struct RangedMesh {
    files: Vec<RangedFile>,
}

struct RangedFile {
    path: PathBuf,
    bytes: FileBytes,
    content: Content,
    /// Numbers of the first vertex and triangle among those of all files.
    first_vertex: u64,
    first_triangle: u64,
    windows: Windows,
}

enum Content {
    /// Where the file has it.
    InPlace(Places),
    /// In files of tasks that have read the text.
    Read(TextPlaces),
}

/// Where vertices and triangles lie in a file.
pub(super) enum Places {
    Ply(PlyPlaces),
    /// The number of triangles.
    Stl(u64),
}

/// Whether inputs are files of meshes that may be read in ranges: named channels have to be there, and normals are made
/// for all.
pub(super) fn files_of(paths: &[PathBuf], channels: &Channels) -> bool {
    let is_plain = matches!(channels, Channels::Auto | Channels::None);
    is_plain && !paths.iter().any(|path| path.is_dir() || raster::format_of(path).is_some())
}

impl std::fmt::Debug for RangedMesh {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_list().entries(self.files.iter().map(|file| &file.path)).finish()
    }
}

impl RangedMesh {
    /// Opens inputs; none where one of them has to be read from its beginning, or has channels that are wanted. `texts`
    /// are what tasks have read of those that are text.
    ///
    /// # Errors
    /// If a file cannot be read, or there are too many vertices.
    pub fn open(paths: &[PathBuf], channels: &Channels, texts: Option<TextFiles>) -> Result<Option<Self>, ImportError> {
        Ok(Self::find(paths, channels, texts)?)
    }

    fn find(paths: &[PathBuf], channels: &Channels, texts: Option<TextFiles>) -> Parsed<Option<Self>> {
        if !files_of(paths, channels) {
            return Ok(None);
        }
        let (mut files, mut first_vertex, mut first_triangle) = (vec![], 0, 0);
        for (number, path) in (0..).zip(paths) {
            let bytes = FileBytes::open(path)?;
            let content = match (Places::of(&Source::of_file(path, &bytes, &Silent), channels)?, texts) {
                (Some(places), _) => Content::InPlace(places),
                (None, Some(texts)) => Content::Read(TextPlaces::open(texts, number).map_err(ImportError::from)?),
                (None, None) => return Ok(None),
            };
            let [vertices, triangles] = content.counts();
            if triangles == 0 {
                return Err(ImportError::NoTriangles { path: path.clone(), vertex_count: vertices }.into());
            }
            let windows = Windows::new(bytes.len());
            files.push(RangedFile { path: path.clone(), bytes, content, first_vertex, first_triangle, windows });
            (first_vertex, first_triangle) = (first_vertex + vertices, first_triangle + triangles);
            check_size(path, first_vertex, first_triangle)?;
        }
        Ok(Some(Self { files }))
    }

    /// The number of vertices.
    pub fn vertex_count(&self) -> u64 {
        self.files.last().map_or(0, |file| file.first_vertex + file.content.counts()[0])
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> u64 {
        self.files.last().map_or(0, |file| file.first_triangle + file.content.counts()[1])
    }

    /// What the inputs name: puts the objects of all triangles into their attributes.
    pub fn find_objects(&self, choice: Objects, attributes: &mut Attributes) {
        let mut sink = ObjectSink::new(choice);
        for file in &self.files {
            if let Content::Read(places) = &file.content {
                places.add_objects(file.first_triangle, &mut sink);
            }
            let [_, triangles] = file.content.counts();
            sink.end_file(&file.path, file.first_triangle..file.first_triangle + triangles);
        }
        sink.finish(attributes);
    }

    /// The position of a vertex; [`DVec3::NAN`] where there is none.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        let vertex = u64::from(vertex);
        let file = match &self.files[..] {
            [only] => Some(only),
            files => files
                .partition_point(|file| file.first_vertex <= vertex)
                .checked_sub(1)
                .and_then(|file| files.get(file)),
        };
        let Some(file) = file else { return DVec3::NAN };
        let own = vertex - file.first_vertex;
        match &file.content {
            Content::InPlace(places) if own < places.counts()[0] => {
                file.windows.touch(places.offset_of_vertex(own), || file.bytes.drop_pages());
                places.position(&file.source(), own).unwrap_or(DVec3::NAN)
            }
            Content::InPlace(_) => DVec3::NAN,
            Content::Read(places) => places.position(own).unwrap_or(DVec3::NAN),
        }
    }

    /// Checks the vertices that begin in some bytes of a file, and returns the smallest and largest coordinates.
    ///
    /// # Errors
    /// If a coordinate is not finite.
    pub fn check_vertices(&self, file: usize, bytes: Range<u64>) -> Result<[DVec3; 2], ImportError> {
        let Some(file) = self.files.get(file) else { return Ok(Mesh::default().bounds()) };
        // Those of texts were checked when they were read.
        let Content::InPlace(places) = &file.content else { return Ok(Mesh::default().bounds()) };
        let bounds = places.check_vertices(&file.source(), bytes)?;
        file.bytes.drop_pages();
        Ok(bounds)
    }

    /// Visits a range of triangles, each by the numbers of its vertices.
    ///
    /// # Errors
    /// If a triangle names a vertex that is not there, or has more corners.
    pub fn for_each_triangle(&self, range: Range<u64>, visit: impl FnMut([u32; 3])) -> Result<(), ImportError> {
        Ok(self.visit(range, visit)?)
    }

    fn visit(&self, range: Range<u64>, mut visit: impl FnMut([u32; 3])) -> Parsed<()> {
        for file in &self.files {
            let own = within(&range, file.first_triangle, file.content.counts()[1]);
            let mut visit = |corners: [u32; 3]| visit(corners.map(|vertex| vertex + file.first_vertex as u32));
            match &file.content {
                Content::InPlace(places) => {
                    let source = file.source();
                    for triangle in own {
                        file.windows.touch(places.offset_of_triangle(triangle), || file.bytes.drop_pages());
                        visit(places.triangle(&source, triangle)?);
                    }
                }
                Content::Read(places) => places.for_each_triangle(own, visit).map_err(ImportError::from)?,
            }
            file.bytes.drop_pages();
        }
        Ok(())
    }
}

/// The part of a range that lies in a file, as numbers within the file.
fn within(range: &Range<u64>, first: u64, count: u64) -> Range<u64> {
    let own = |at: u64| at.clamp(first, first + count) - first;
    own(range.start)..own(range.end)
}

impl RangedFile {
    fn source(&self) -> Source<'_> {
        Source::of_file(Path::new(&self.path), &self.bytes, &Silent)
    }
}

impl Content {
    /// The number of vertices and that of triangles.
    fn counts(&self) -> [u64; 2] {
        match self {
            Self::InPlace(places) => places.counts(),
            Self::Read(places) => places.counts(),
        }
    }
}

impl Places {
    /// The places of what a file has. None for texts, and where they do not follow from its beginning.
    pub(super) fn of(source: &Source, channels: &Channels) -> Parsed<Option<Self>> {
        Ok(match detect_format(source)? {
            Format::Ply => PlyPlaces::of(source, &mut AttributeSink::new(channels)).map(Self::Ply),
            // Others may be cut short, or end with something else.
            Format::BinaryStl if stl::is_exact_binary_stl(source.bytes) => {
                Some(Self::Stl(((source.bytes.len() - stl::HEADER_BYTES) / stl::RECORD_BYTES) as u64))
            }
            _ => None,
        })
    }

    /// Checks the vertices that begin in some bytes, and returns the smallest and largest coordinates.
    pub(super) fn check_vertices(&self, source: &Source, bytes: Range<u64>) -> Parsed<[DVec3; 2]> {
        let mut bounds = Mesh::default().bounds();
        let [start, end] = [bytes.start, bytes.end].map(|at| self.first_vertex_from(at));
        for vertex in start..end {
            let at = self.offset_of_vertex(vertex);
            source.passed(at);
            let position = self.position(source, vertex)?;
            if !position.is_finite() {
                return Err(source.coordinate(super::Location::Byte(at as u64), vertex, position));
            }
            bounds = [bounds[0].min(position), bounds[1].max(position)];
        }
        Ok(bounds)
    }

    /// The number of vertices and that of triangles.
    fn counts(&self) -> [u64; 2] {
        match self {
            Self::Ply(places) => places.counts(),
            Self::Stl(triangles) => [3 * triangles, *triangles],
        }
    }

    fn offset_of_vertex(&self, vertex: u64) -> usize {
        match self {
            Self::Ply(places) => places.offset_of_vertex(vertex),
            Self::Stl(_) => self.offset_of_triangle(vertex / 3) + stl::CORNER_BYTES * (1 + vertex as usize % 3),
        }
    }

    /// The first vertex that lies at an offset of the file or after it.
    fn first_vertex_from(&self, offset: u64) -> u64 {
        let [mut low, mut high] = [0, self.counts()[0]];
        while low < high {
            let middle = low + (high - low) / 2;
            match (self.offset_of_vertex(middle) as u64) < offset {
                true => low = middle + 1,
                false => high = middle,
            }
        }
        low
    }

    fn offset_of_triangle(&self, triangle: u64) -> usize {
        match self {
            Self::Ply(places) => places.offset_of_triangle(triangle),
            Self::Stl(_) => stl::HEADER_BYTES + triangle as usize * stl::RECORD_BYTES,
        }
    }

    #[inline]
    fn position(&self, source: &Source, vertex: u64) -> Parsed<DVec3> {
        match self {
            Self::Ply(places) => places.position(source, vertex),
            Self::Stl(_) => Ok(stl::position(source.bytes, self.offset_of_vertex(vertex))),
        }
    }

    #[inline]
    fn triangle(&self, source: &Source, triangle: u64) -> Parsed<[u32; 3]> {
        match self {
            Self::Ply(places) => places.triangle(source, triangle),
            Self::Stl(_) => Ok([0, 1, 2].map(|corner| 3 * triangle as u32 + corner)),
        }
    }
}
