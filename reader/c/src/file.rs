//! Opening, closing, and what a file says of itself.
#![expect(unsafe_code, reason = "the names are C's")]

use crate::{
    channels::Names,
    pointer::{borrow, give, release, slice, text, write},
    source::Source,
    status::{Failure, Status, guard},
};
use lodpack::{Limits, Opened, ReadAt, heights::Heights};
use std::{ffi::c_char, sync::Arc};

pub type AnySource = Arc<dyn ReadAt + Send + Sync>;

/// An open file of either kind.
pub struct File {
    opened: Opened<AnySource>,
    name: String,
    pub(crate) names: Names,
}

/// What a file holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A mesh.
    Mesh = 0,
    /// A grid of heights: terrain.
    Heights = 1,
}

impl File {
    /// An open file of this name.
    pub fn new(opened: Opened<AnySource>, name: String) -> Self {
        Self { names: Names::new(&opened), opened, name }
    }

    /// Path, address, or what it is instead.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its mesh.
    pub fn mesh(&self) -> Result<&lodpack::File<AnySource>, Failure> {
        match &self.opened {
            Opened::Mesh(file) => Ok(file),
            Opened::Heights(_) => {
                Err(self.other_kind("heights", "lodpack_select_heights() and lodpack_read_heights()"))
            }
        }
    }

    /// Its heights.
    pub fn heights(&self) -> Result<&Heights<AnySource>, Failure> {
        match &self.opened {
            Opened::Heights(file) => Ok(file),
            Opened::Mesh(_) => Err(self.other_kind("a mesh", "lodpack_select()")),
        }
    }

    /// What it holds.
    pub fn opened(&self) -> &Opened<AnySource> {
        &self.opened
    }

    fn other_kind(&self, holds: &str, functions: &str) -> Failure {
        Failure::argument(format!("the file holds {holds}: use {functions}")).of(&self.name)
    }

    /// Adds the file's name to an error.
    pub fn blame(&self, error: lodpack::Error) -> Failure {
        Failure::from(error).of(&self.name)
    }
}

/// The header promises that threads may share a file.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<File>();
};

/// What is known about a file as soon as it is open. Lengths are in the units of the file's coordinates.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Info {
    /// A lodpack_kind: what the file holds.
    pub kind: i32,
    /// Version of the format.
    pub format_major: u32,
    /// A newer minor version adds what a reader may skip.
    pub format_minor: u32,
    /// Number of levels; 0 is the coarsest. Heights have none.
    pub level_count: u32,
    /// Number of roots; 0 for an empty file, whose bounds are all zero, and for heights.
    pub root_count: u32,
    /// Number of channels: what the surface carries besides positions.
    pub channel_count: u32,
    /// Smallest coordinates.
    pub bounds_low: [f64; 3],
    /// Largest coordinates.
    pub bounds_high: [f64; 3],
    /// Coordinates are multiples of it, from the file's origin on; 0 for heights.
    pub lattice_step: f64,
    /// Mean edge length of the input; 0 if the file does not say.
    pub mean_edge_length: f64,
    /// Triangles of the input after repair; 0 if the file does not say.
    pub source_triangle_count: u64,
    /// Vertices of the input after repair; 0 if the file does not say.
    pub source_vertex_count: u64,
    /// Triangles of the overview; 0 if there is none.
    pub overview_triangle_count: u64,
    /// Bound of the overview's two-sided distance to the input.
    pub overview_error: f64,
    /// Bytes of the heights that the mesh stands on (lodpack_open_ground()); 0 without any.
    pub ground_bytes: u64,
}

/// What a file says about one level.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Level {
    /// Bound of the two-sided distance to the input with everything drawn at this level.
    pub error: f64,
    /// The error that the level was built for.
    pub tolerance: f64,
    /// Triangles with everything drawn at this level.
    pub triangle_count: u64,
    /// Bytes that this level adds to the coarser ones.
    pub page_bytes: u64,
}

/// Opens a file of either kind: a path, or an address that begins with http:// or https://, in UTF-8. Reads 8 kB of a
/// small file. Web servers have to support range requests.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open(path: *const c_char, file: *mut *mut File) -> Status {
    guard(|| {
        write(file, std::ptr::null_mut(), "file")?;
        let path = text(path, "path")?;
        let scheme = path.split_once("://").map_or(String::new(), |(scheme, _)| scheme.to_ascii_lowercase());
        let source: AnySource = match scheme.as_str() {
            "http" | "https" => Arc::new(lodpack::source::Http::new(path, lodpack::source::HttpOptions::default())),
            _ => Arc::new(std::fs::File::open(path).map_err(|error| Failure::from(error).of(path))?),
        };
        open(source, path.to_owned(), file)
    })
}

/// Opens a file in memory. The bytes are copied.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_memory(data: *const u8, length: usize, file: *mut *mut File) -> Status {
    guard(|| {
        write(file, std::ptr::null_mut(), "file")?;
        open(Arc::new(slice(data, length, "bytes")?.to_vec()), format!("{length} bytes in memory"), file)
    })
}

/// Opens a file that the caller reads. The structure itself is copied.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_source(source: *const Source, file: *mut *mut File) -> Status {
    guard(|| {
        write(file, std::ptr::null_mut(), "file")?;
        let source = *borrow(source, "source")?;
        if source.read.is_none() {
            return Err(Failure::null("source->read"));
        }
        open(Arc::new(source), "the program's own file".into(), file)
    })
}

fn open(source: AnySource, name: String, out: *mut *mut File) -> Result<(), Failure> {
    match Opened::open(source, Limits::default()) {
        Ok(opened) => give(out, File::new(opened, name)),
        Err(error) => Err(Failure::from(error).of(&name)),
    }
}

/// Closes a file.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close(file: *mut File) {
    release(file);
}

/// Writes what the file says of itself. Reads nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_info(file: *const File, info: *mut Info) -> Status {
    guard(|| {
        let value = match borrow(file, "file")?.opened() {
            Opened::Mesh(file) => info_of_mesh(file),
            Opened::Heights(file) => info_of_heights(file),
        };
        write(info, value, "info")
    })
}

fn info_of_mesh(file: &lodpack::File<AnySource>) -> Info {
    let (format_major, format_minor) = file.index().version();
    let [bounds_low, bounds_high] = file.bounds().unwrap_or_default();
    let (overview_error, overview_triangle_count) = file.index().overview_summary().unwrap_or_default();
    let source = file.source_info();
    Info {
        kind: Kind::Mesh as i32,
        format_major: format_major.into(),
        format_minor: format_minor.into(),
        level_count: file.level_count() as u32,
        root_count: file.root_count(),
        channel_count: file.channels().len() as u32,
        bounds_low,
        bounds_high,
        lattice_step: file.lattice().step(),
        mean_edge_length: source.map_or(0.0, |source| source.mean_edge_length),
        source_triangle_count: source.map_or(0, |source| source.triangle_count),
        source_vertex_count: source.map_or(0, |source| source.vertex_count),
        overview_triangle_count,
        overview_error,
        ground_bytes: file.index().ground_range().map_or(0, |range| range.end - range.start),
    }
}

fn info_of_heights(file: &Heights<AnySource>) -> Info {
    let (format_major, format_minor) = file.index().version();
    let [bounds_low, bounds_high] = file.index().bounds().unwrap_or_default();
    Info {
        kind: Kind::Heights as i32,
        format_major: format_major.into(),
        format_minor: format_minor.into(),
        channel_count: 1,
        bounds_low,
        bounds_high,
        ..Info::default()
    }
}

/// Writes what the file says about a level. Reads nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_level(file: *const File, number: u32, level: *mut Level) -> Status {
    guard(|| {
        let file = borrow(file, "file")?.mesh()?;
        let found = file.level(number as usize).filter(|_| (number as usize) < file.level_count());
        let found = found.ok_or_else(|| {
            Failure::argument(format!("there is no level {number}; the file has {} levels", file.level_count()))
        })?;
        let value = Level {
            error: found.max_error,
            tolerance: found.tolerance,
            triangle_count: found.triangle_count,
            page_bytes: found.page_bytes,
        };
        write(level, value, "level")
    })
}

/// Reads the complete file, and checks every checksum and every rule of the format.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_verify(file: *const File) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let checked = match file.opened() {
            Opened::Mesh(mesh) => mesh.verify(),
            Opened::Heights(heights) => heights.verify(),
        };
        checked.map_err(|error| file.blame(error))
    })
}
