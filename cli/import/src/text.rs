//! Text in ranges of its bytes: OBJ, and ASCII PLY. Each task reads the lines that begin in its range, and leaves
//! positions and triangles in files of its own ([`super::text_files`]), from which any of them can be looked up.
//!
//! What is read is what [`super::import_large_meshes`] reads, in the same order. Polygons are kept as they are, since
//! their triangles depend on positions that other tasks read; how many triangles they have does not.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::attributes::AttributeSink;
use super::error::{ImportError, Parsed};
use super::ply::PlyLines;
use super::polygon::{THIN, distinct_corners};
use super::ranged::{Places, files_of};
use super::source::{FileBytes, Source};
use super::text_files::{TextName, TextPiece, file_names};
use super::{Format, Objects, detect_format, obj};
use lodpack_mesh::appearance::Channels;
use lodpack_mesh::{Mesh, NONE};
use lodpack_runtime::progress::Silent;
use lodpack_runtime::storage::{RecordWriter, WorkDirectory, WorkError};

/// How much of an OBJ file is looked through for colours of vertices before a job begins.
const LOOKED_THROUGH: usize = 1 << 20;

/// How inputs can be read by several processes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ways {
    /// Any vertex and any triangle can be read where it is ([`super::RangedMesh`]).
    #[default]
    Places,
    /// Some of them are text, which is read in ranges first.
    Lines,
    /// One process reads everything.
    Whole,
}

impl Ways {
    /// How inputs can be read, as far as their beginnings tell.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn of(paths: &[PathBuf], channels: &Channels) -> Result<Self, ImportError> {
        if !files_of(paths, channels) {
            return Ok(Self::Whole);
        }
        let mut all = Self::Places;
        for path in paths {
            let file = TextFile::open(path, channels)?;
            match file.kind {
                Kind::Places(_) => {}
                Kind::Obj if file.looks_coloured() => return Ok(Self::Whole),
                Kind::Obj | Kind::Ply(_) => all = Self::Lines,
                Kind::Other => return Ok(Self::Whole),
            }
        }
        Ok(all)
    }
}

/// What lies in a range of a text, or in all of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextCounts {
    /// Lines; those of PLY are counted from the end of the header on, and without blank ones.
    pub lines: u64,
    /// Vertices, where lines say that they are some.
    pub vertices: u64,
}

impl std::ops::AddAssign for TextCounts {
    fn add_assign(&mut self, other: Self) {
        self.lines += other.lines;
        self.vertices += other.vertices;
    }
}

/// An input of a job some of whose inputs are text.
pub struct TextFile {
    path: PathBuf,
    bytes: FileBytes,
    kind: Kind,
    with_colours: bool,
}

enum Kind {
    Places(Places),
    Obj,
    Ply(Box<PlyLines>),
    Other,
}

impl TextFile {
    /// Opens an input.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn open(path: &Path, channels: &Channels) -> Result<Self, ImportError> {
        Ok(Self::find(path, channels)?)
    }

    fn find(path: &Path, channels: &Channels) -> Parsed<Self> {
        let bytes = FileBytes::open(path)?;
        let source = Source::of_file(path, &bytes, &Silent);
        let with_colours = AttributeSink::new(channels).wants_materials();
        let kind = match (Places::of(&source, channels)?, detect_format(&source)?) {
            (Some(places), _) => Kind::Places(places),
            (None, Format::Ply) => match PlyLines::of(&source, &mut AttributeSink::new(channels)) {
                Some(lines) => Kind::Ply(Box::new(lines)),
                None => Kind::Other,
            },
            (None, Format::Obj) => Kind::Obj,
            _ => Kind::Other,
        };
        Ok(Self { path: path.to_owned(), bytes, kind, with_colours })
    }

    /// Whether this is text that can be read in ranges.
    pub fn is_text(&self) -> bool {
        matches!(self.kind, Kind::Obj | Kind::Ply(_))
    }

    /// Checks the vertices that begin in some bytes of a file that is no text, and returns the smallest and largest
    /// coordinates.
    ///
    /// # Errors
    /// If a coordinate is not finite.
    pub fn check_vertices(&self, bytes: Range<u64>) -> Result<[DVec3; 2], ImportError> {
        let Kind::Places(places) = &self.kind else { return Ok(Mesh::default().bounds()) };
        let bounds = places.check_vertices(&self.source(), bytes)?;
        self.bytes.drop_pages();
        Ok(bounds)
    }

    /// Whether an OBJ file has colours that are wanted. This looks for libraries in all of it, so a job asks once,
    /// before it begins.
    fn looks_coloured(&self) -> bool {
        let source = self.source();
        let has_colours = || obj::count_in_range(&source, 0..LOOKED_THROUGH, true).is_err();
        // A library that is there makes faces look like something.
        self.with_colours && (has_colours() || !obj::files_beside(&source).is_empty())
    }

    fn source(&self) -> Source<'_> {
        Source::of_file(&self.path, &self.bytes, &Silent)
    }

    /// Counts what begins in some bytes; nothing where the file is no text.
    ///
    /// # Errors
    /// If there is something that only an import of the whole reads.
    pub fn count(&self, bytes: Range<u64>) -> Result<TextCounts, ImportError> {
        let (source, bytes) = (self.source(), as_usize(&bytes));
        let counts = match &self.kind {
            Kind::Obj => obj::count_in_range(&source, bytes, self.with_colours)?,
            Kind::Ply(lines) => lines.count_in_range(&source, bytes),
            Kind::Places(_) | Kind::Other => TextCounts::default(),
        };
        self.bytes.drop_pages();
        Ok(counts)
    }

    /// Reads what begins in some bytes. `before` counts what precedes them, and `all` what the file has.
    ///
    /// # Errors
    /// If the file is damaged, or a disk is full.
    pub fn read(
        &self,
        bytes: Range<u64>,
        before: TextCounts,
        all: TextCounts,
        sink: &mut TextSink,
    ) -> Result<(), ImportError> {
        let (source, bytes) = (self.source(), as_usize(&bytes));
        match &self.kind {
            Kind::Obj => obj::read_range(&source, bytes, before, all, sink)?,
            Kind::Ply(lines) => lines.read_range(&source, bytes, before, all, sink)?,
            Kind::Places(_) | Kind::Other => {}
        }
        self.bytes.drop_pages();
        Ok(())
    }
}

fn as_usize(bytes: &Range<u64>) -> Range<usize> {
    let at = |at: u64| usize::try_from(at).unwrap_or(usize::MAX);
    at(bytes.start)..at(bytes.end)
}

/// Takes what a task reads of texts.
pub struct TextSink {
    vertices: RecordWriter<DVec3>,
    triangles: RecordWriter<[u32; 3]>,
    polygons: RecordWriter<u32>,
    /// Numbers in the file of polygons.
    polygon_words: u64,
    /// Corners of polygons that precede a vertex of theirs, each list behind its length.
    late: Vec<u32>,
    /// Their triangles.
    late_triangles: u64,
    objects: Objects,
    piece: TextPiece,
    pieces: Vec<TextPiece>,
    polygon: Vec<u32>,
    corners: Vec<u32>,
}

impl TextSink {
    /// Begins the files of a task. `objects` says what becomes of the objects that texts name.
    ///
    /// # Errors
    /// If they cannot be made.
    pub fn create(directory: &WorkDirectory, task: u32, objects: Objects) -> Result<Self, WorkError> {
        let [vertices, triangles, polygons] = file_names(task);
        Ok(Self {
            vertices: RecordWriter::create(directory, &vertices)?,
            triangles: RecordWriter::create(directory, &triangles)?,
            polygons: RecordWriter::create(directory, &polygons)?,
            polygon_words: 0,
            late: vec![],
            late_triangles: 0,
            objects,
            piece: TextPiece::of(0),
            pieces: vec![],
            polygon: vec![],
            corners: vec![],
        })
    }

    /// Begins what belongs to a file.
    pub fn begin(&mut self, file: u32) {
        self.piece = TextPiece::of(file);
    }

    /// Ends what belongs to a file.
    ///
    /// # Errors
    /// If a disk is full.
    pub fn end(&mut self) -> Result<(), ImportError> {
        let late = std::mem::take(&mut self.late);
        self.late_triangles = 0;
        let mut rest = &late[..];
        while let Some((&length, following)) = rest.split_first() {
            let (corners, next) = following.split_at(length as usize);
            self.piece.triangles[1] += self.push_corners(corners)?;
            rest = next;
        }
        self.pieces.push(self.piece.clone());
        Ok(())
    }

    /// Ends the files. Returns what they have, and their paths.
    ///
    /// # Errors
    /// If a disk is full.
    pub fn finish(self) -> Result<(Vec<TextPiece>, [PathBuf; 3]), WorkError> {
        Ok((self.pieces, [self.vertices.finish()?, self.triangles.finish()?, self.polygons.finish()?]))
    }

    pub(super) fn push_vertex(&mut self, position: DVec3) -> Parsed<()> {
        let [low, high] = self.piece.bounds;
        self.piece.bounds = [low.min(position), high.max(position)];
        self.piece.vertices += 1;
        Ok(self.vertices.push_all(&[position]).map_err(ImportError::from)?)
    }

    /// An empty list for the corners of a polygon.
    pub(super) fn take_polygon(&mut self) -> Vec<u32> {
        let mut polygon = std::mem::take(&mut self.polygon);
        polygon.clear();
        polygon
    }

    pub(super) fn put_back(&mut self, polygon: Vec<u32>) {
        self.polygon = polygon;
    }

    /// Adds a face, or puts it behind all others of the file.
    pub(super) fn push_face(&mut self, polygon: &[u32], is_late: bool) -> Parsed<()> {
        if let &[a, b, c] = polygon {
            self.piece.triangles[0] += 1;
            return Ok(self.triangles.push_all(&[[a, b, c]]).map_err(ImportError::from)?);
        }
        let mut corners = std::mem::take(&mut self.corners);
        distinct_corners(polygon, &mut corners);
        corners.iter_mut().for_each(|corner| *corner = polygon[*corner as usize]);
        if corners.len() < 3 {
            self.skip_thin();
        } else if is_late {
            self.late_triangles += corners.len() as u64 - 2;
            self.late.push(corners.len() as u32);
            self.late.extend_from_slice(&corners);
        } else {
            self.piece.triangles[0] += self.push_corners(&corners)?;
        }
        self.corners = corners;
        Ok(())
    }

    /// Writes a polygon of distinct corners. Returns how many triangles it has.
    fn push_corners(&mut self, corners: &[u32]) -> Parsed<u64> {
        let written = match corners {
            &[a, b, c] => self.triangles.push_all(&[[a, b, c]]),
            _ => {
                let place = self.polygon_words as u32;
                self.polygon_words += 1 + corners.len() as u64;
                let triangles: Vec<[u32; 3]> = (0..corners.len() as u32 - 2).map(|k| [NONE, place, k]).collect();
                let polygon = self.polygons.push_all(&[corners.len() as u32]);
                polygon
                    .and_then(|()| self.polygons.push_all(corners))
                    .and_then(|()| self.triangles.push_all(&triangles))
            }
        };
        written.map_err(ImportError::from)?;
        Ok(corners.len() as u64 - 2)
    }

    /// Remembers an object or a group of an OBJ file that begins.
    pub(super) fn name(&mut self, is_object: bool, rest: &[u8]) {
        if self.objects == Objects::Join {
            return self.leave_out("groups");
        }
        let at = [self.piece.triangles[0], self.late_triangles];
        self.piece.names.push(TextName { is_object, rest: rest.trim_ascii().to_vec(), at });
    }

    /// Counts something that is skipped.
    pub(super) fn skip(&mut self, what: &str, count: u64) {
        match self.piece.skipped.get_mut(what) {
            Some(all) => *all += count,
            None => drop(self.piece.skipped.insert(what.into(), count)),
        }
    }

    /// Counts a face without surface.
    pub(super) fn skip_thin(&mut self) {
        self.skip(THIN, 1);
    }

    /// Remembers that a file has something beside its surface.
    pub(super) fn leave_out(&mut self, what: &str) {
        if !self.piece.left_out.contains(what) {
            self.piece.left_out.insert(what.into());
        }
    }
}
