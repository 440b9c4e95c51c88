//! What can go wrong while a mesh file is read, by culprit.

use std::fmt;
use std::path::PathBuf;

use crate::storage::WorkError;

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte offset from the start of the file.
    Byte(u64),
    /// A numbered item of a structured file: its kind and its index, counted from 0.
    Item(&'static str, u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(offset) => write!(f, "byte {offset}"),
            Place::Item(kind, index) => write!(f, "{kind} {index}"),
        }
    }
}

/// Why no mesh came out of the inputs.
///
/// Vertices and faces are numbered as their format numbers them: from 1 in OBJ, from 0 elsewhere.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The list of inputs was empty.
    #[error("no input was given; name at least one OBJ, OFF, PLY, STL, glTF or GLB file")]
    NoInput,

    /// The operating system refused the file.
    #[error("{}: cannot be read; check the name and the permissions", path.display())]
    Io {
        /// The file, or the buffer that a glTF file names.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },

    /// A glTF file names a buffer that cannot be read.
    #[error("{}: its buffer {} cannot be read; put it there, or export the model as GLB", path.display(), buffer.display())]
    Buffer {
        /// The glTF file.
        path: PathBuf,
        /// The file with its data.
        buffer: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },

    /// The input is a directory or a device.
    #[error("{}: is {kind}, not a file; name the mesh files themselves", path.display())]
    NotAFile {
        /// The input.
        path: PathBuf,
        /// "a directory" and the like.
        kind: &'static str,
    },

    /// The file has no bytes.
    #[error("{}: the file is empty; export or copy it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },

    /// The input has been built already.
    #[error("{}: is a lodpack file already; build from its source, or `lodpack extract` a mesh first", path.display())]
    Lodpack {
        /// The file.
        path: PathBuf,
    },

    /// Neither content nor name tell a format that is understood.
    #[error("{}: not a mesh format that is understood: the file starts with {start}; convert it to OBJ, OFF, PLY, STL, glTF or GLB", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its first bytes, printable.
        start: String,
    },

    /// The file breaks the rules of its format.
    #[error("{}: {place}: {problem}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },

    /// The file ends before everything that it announces.
    #[error("{}: {place}: the file ends too early: {missing}; copy or export it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the missing data would have begun.
        place: Place,
        /// What was announced and what is there.
        missing: String,
    },

    /// A face names a vertex that does not exist.
    #[error("{}: {place}: face {face} uses vertex {index}, but the file has {vertex_count} vertices{}; export the file again",
        path.display(), if *first_vertex == 1 { " numbered from 1" } else { " numbered from 0" })]
    Index {
        /// The file.
        path: PathBuf,
        /// Where the face begins.
        place: Place,
        /// The face.
        face: u64,
        /// The vertex as written.
        index: i64,
        /// Number of vertices that the face could use.
        vertex_count: u64,
        /// Number of the first vertex in this format: 0 or 1.
        first_vertex: u64,
    },

    /// A coordinate is not a finite number.
    #[error("{}: {place}: vertex {vertex} has the coordinate {value}; coordinates must be finite: remove the vertex or mend the exporter", path.display())]
    Coordinate {
        /// The file.
        path: PathBuf,
        /// Where the vertex begins.
        place: Place,
        /// The vertex.
        vertex: u64,
        /// The value: NaN or infinite.
        value: f64,
    },

    /// The file is well-formed but uses something that this program does not read.
    #[error("{}: uses {feature}, which is not supported; {remedy}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature.
        feature: String,
        /// The way around it.
        remedy: &'static str,
    },

    /// More than 32-bit indices can name.
    #[error("{}: with this file the mesh has {count} {what}, more than the {limit} that one build takes; split the input", path.display())]
    TooLarge {
        /// The file that made it too many.
        path: PathBuf,
        /// "vertices" or "triangles".
        what: &'static str,
        /// How many.
        count: u64,
        /// How many are possible.
        limit: u64,
    },

    /// A text that is not read piece by piece, and too large for that: the JSON of glTF and GLB.
    #[error("{}: its JSON text, with what is embedded in it, is read as a whole, which takes about --memory {}MiB, more than the {} MiB allowed; export it as GLB or with a .bin file, convert it to PLY, or allow more",
        path.display(), least.div_ceil(1 << 20), memory >> 20)]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that would do.
        least: u64,
        /// Bytes that reading may take.
        memory: u64,
    },

    /// The mesh does not fit in memory, nor on disk.
    #[error(transparent)]
    Work(#[from] WorkError),

    /// The file is readable but holds no surface.
    #[error("{}: no triangles: the file has {vertex_count} vertices but no faces; point clouds and lines cannot be built", path.display())]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// Vertices that it has.
        vertex_count: u64,
    },
}

/// Parsers pass errors boxed: a small result type is what keeps their inner loops fast.
pub(super) type Parsed<T> = Result<T, Box<ImportError>>;

impl From<Box<ImportError>> for ImportError {
    fn from(error: Box<ImportError>) -> Self {
        *error
    }
}
