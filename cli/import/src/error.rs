//! Errors of reading mesh files, by culprit.

use std::fmt;
use std::path::PathBuf;

use lodpack_runtime::storage::WorkError;

/// A location in a file, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Location {
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte offset from the start of the file.
    Byte(u64),
    /// A numbered item of a structured file: its kind and its index, counted from 0.
    Item(&'static str, u64),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Location::Line(line) => write!(f, "line {line}"),
            Location::Byte(offset) => write!(f, "byte {offset}"),
            Location::Item(kind, index) => write!(f, "{kind} {index}"),
        }
    }
}

/// Why the inputs did not yield a mesh.
///
/// Vertices and faces are numbered as in their format: from 1 in OBJ, from 0 elsewhere.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The list of inputs was empty.
    #[error(
        "no input given; name at least one OBJ, OFF, PLY, STL, glTF or GLB file, or a raster of heights (GeoTIFF, HGT, ASC, BIL, PNG, EXR, LERC)"
    )]
    NoInput,

    /// The operating system refused access to the file.
    #[error("{}: cannot be read; check the name and the permissions", path.display())]
    Io {
        /// The file, or the buffer that a glTF file names.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },

    /// A glTF file names a buffer that cannot be read.
    #[error("{}: its buffer {} cannot be read; put the file there, or export the model as GLB", path.display(), buffer.display())]
    Buffer {
        /// The glTF file.
        path: PathBuf,
        /// The file with its data.
        buffer: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },

    /// The input is a directory or a device.
    #[error("{}: is {kind}, not a file; name the mesh files themselves", path.display())]
    NotAFile {
        /// The input.
        path: PathBuf,
        /// "a directory" or similar.
        kind: &'static str,
    },

    /// A folder has nothing that can be built.
    #[error("{}: the folder has no meshes (OBJ, OFF, PLY, STL, glTF, GLB), no rasters of heights and no lodpack files", path.display())]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },

    /// A folder has images of an atlas, but not the list of them.
    #[error("{}: this is an image of an atlas, but {manifest}, which says how its images meet, is not beside it; copy the whole atlas, or write it again", path.display())]
    AtlasWithoutManifest {
        /// The image.
        path: PathBuf,
        /// The name of the list.
        manifest: String,
    },

    /// A pattern stands for no files.
    #[error("{}: {problem}; name files or folders, or change the pattern", pattern.display())]
    Pattern {
        /// The pattern.
        pattern: PathBuf,
        /// What is wrong.
        problem: String,
    },

    /// The file has no bytes.
    #[error("{}: the file is empty; export or copy it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },

    /// The input is a lodpack file that cannot be read, or has no mesh.
    #[error("{}: {source}{}", path.display(), match source {
        lodpack::Error::Query { .. } => "; a grid of heights is no input: extract a mesh of it with `lodpack extract`",
        lodpack::Error::Format { .. } => "; copy, download or build it again",
        _ => "",
    })]
    Lodpack {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: lodpack::Error,
    },

    /// The file has a known format that is not read.
    #[error("{}: this is {format}, which is not read here; {remedy}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The format, with its article.
        format: &'static str,
        /// What to do.
        remedy: &'static str,
    },

    /// Neither content nor name identify a known format.
    #[error("{}: unknown mesh format: the file starts with {start}; convert it to OBJ, OFF, PLY, STL, glTF or GLB, or heights to GeoTIFF", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its first bytes, printable.
        start: String,
    },

    /// The file breaks the rules of its format.
    #[error("{}: {location}: {problem}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where the rule is broken.
        location: Location,
        /// The broken rule and the remedy.
        problem: String,
    },

    /// The file ends before everything that it announces.
    #[error("{}: {location}: the file ends too early: {missing}; copy or export it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the missing data should have begun.
        location: Location,
        /// What was announced, and what was found.
        missing: String,
    },

    /// A face names a vertex that does not exist.
    #[error("{}: {location}: face {face} uses vertex {index}, but the file has {vertex_count} vertices{}; export the file again",
        path.display(), if *first_vertex == 1 { " numbered from 1" } else { " numbered from 0" })]
    Index {
        /// The file.
        path: PathBuf,
        /// Where the face begins.
        location: Location,
        /// The face.
        face: u64,
        /// The vertex, as written.
        index: i64,
        /// Number of vertices that the face may use.
        vertex_count: u64,
        /// Number of the first vertex in this format: 0 or 1.
        first_vertex: u64,
    },

    /// A coordinate is not a finite number.
    #[error("{}: {location}: vertex {vertex} has the coordinate {value}; coordinates must be finite: remove the vertex or fix the exporter", path.display())]
    Coordinate {
        /// The file.
        path: PathBuf,
        /// Where the vertex begins.
        location: Location,
        /// The vertex.
        vertex: u64,
        /// The value: NaN or infinite.
        value: f64,
    },

    /// The file is well-formed but uses a feature that this program does not read.
    #[error("{}: uses {feature}, which is not supported; {remedy}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature.
        feature: String,
        /// How to avoid the feature.
        remedy: &'static str,
    },

    /// A raster is no grid of heights, does not say where it is, or does not fit to others.
    #[error("{}: {problem}", path.display())]
    Grid {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the remedy.
        problem: String,
    },

    /// The mesh has more vertices or triangles than 32-bit indices can number.
    #[error("{}: with this file the mesh has {count} {what}, but one build takes at most {limit}; split the input", path.display())]
    TooLarge {
        /// The file that exceeded the limit.
        path: PathBuf,
        /// "vertices" or "triangles".
        what: &'static str,
        /// Their number so far.
        count: u64,
        /// The limit.
        limit: u64,
    },

    /// The JSON of a glTF or GLB file, or the surface of a lodpack file, must be read as a whole, and is too large.
    #[error("{}: {what} is read as a whole, which needs about --memory {}MiB, but only {} MiB are allowed; {remedy}, or allow more",
        path.display(), least.div_ceil(1 << 20), memory >> 20)]
    Memory {
        /// What is read as a whole.
        what: &'static str,
        /// What else to do.
        remedy: &'static str,
        /// The file.
        path: PathBuf,
        /// How many bytes would be enough.
        least: u64,
        /// Bytes that reading may use.
        memory: u64,
    },

    /// A channel was asked for that the input does not have.
    #[error("the input has no channel \"{name}\"; {}", if found.is_empty() { "it has none: pass --channels none, or omit it".to_owned() } else { format!("it has {found}") })]
    Channel {
        /// The name that was asked for.
        name: String,
        /// The names of those that there are.
        found: String,
    },

    /// The input has more channels than a file holds.
    #[error("the input has {count} channels, of which a file keeps {most}: choose some with --channels NAME,...")]
    ManyChannels {
        /// How many there are.
        count: usize,
        /// How many there may be.
        most: usize,
    },

    /// An image says that it is too large to be decoded.
    #[error(
        "the image {name} has {width} x {height} texels, but one image may have at most {limit}; make it smaller, or pass --channels none"
    )]
    Image {
        /// The image.
        name: String,
        /// Its columns, as it says.
        width: u32,
        /// Its rows, as it says.
        height: u32,
        /// The limit.
        limit: u64,
    },

    /// The inputs have more materials than triangles can name.
    #[error(
        "the inputs have {count} materials, but one build takes at most {limit}; join materials that are the same, or pass --channels none"
    )]
    Materials {
        /// Their number so far.
        count: usize,
        /// The limit.
        limit: usize,
    },

    /// The mesh fits neither in memory nor on disk.
    #[error(transparent)]
    Work(#[from] WorkError),

    /// The file is readable but has no surface.
    #[error("{}: no triangles: the file has {vertex_count} vertices but no faces; point clouds and lines cannot be built", path.display())]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// Number of its vertices.
        vertex_count: u64,
    },
}

/// Parsers pass errors boxed: the small result type keeps their inner loops fast.
pub(super) type Parsed<T> = Result<T, Box<ImportError>>;

impl From<Box<ImportError>> for ImportError {
    fn from(error: Box<ImportError>) -> Self {
        *error
    }
}
