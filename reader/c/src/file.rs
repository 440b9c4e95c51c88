//! Opening, closing, and what a file says of itself.
#![expect(unsafe_code, reason = "the names are C's")]

use crate::{
    pointer::{borrow, bytes, give, release, text, write},
    source::Source,
    status::{Failure, Status, guard},
};
use lodpack::{Limits, ReadAt};
use std::ffi::c_char;

type AnySource = Box<dyn ReadAt + Send + Sync>;

/// An open file.
pub struct File {
    pub(crate) file: lodpack::File<AnySource>,
    pub(crate) name: String,
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
    /// Version of the format.
    pub format_major: u32,
    /// A newer minor version adds what a reader may skip.
    pub format_minor: u32,
    /// Number of levels; 0 is the coarsest.
    pub level_count: u32,
    /// Number of roots; 0 for an empty file, whose bounds are all zero.
    pub root_count: u32,
    /// Smallest coordinates.
    pub bounds_low: [f64; 3],
    /// Largest coordinates.
    pub bounds_high: [f64; 3],
    /// Coordinates are multiples of it, from the file's origin on.
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

/// Opens a file: a path, or an address that begins with http:// or https://, in UTF-8. Reads 8 kB of a small file. Web servers have to
/// support range requests.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open(path: *const c_char, file: *mut *mut File) -> Status {
    guard(|| {
        write(file, std::ptr::null_mut(), "file")?;
        let path = text(path, "path")?;
        let scheme = path.split_once("://").map_or(String::new(), |(scheme, _)| scheme.to_ascii_lowercase());
        let source: AnySource = match scheme.as_str() {
            "http" | "https" => Box::new(lodpack::source::Http::new(path, lodpack::source::HttpOptions::default())),
            _ => Box::new(std::fs::File::open(path).map_err(|error| Failure::from(error).of(path))?),
        };
        open(source, path.to_owned(), file)
    })
}

/// Opens a file in memory. The bytes are copied.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_memory(data: *const u8, length: usize, file: *mut *mut File) -> Status {
    guard(|| {
        write(file, std::ptr::null_mut(), "file")?;
        open(Box::new(bytes(data, length)?.to_vec()), format!("{length} bytes in memory"), file)
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
        open(Box::new(source), "the program's own file".into(), file)
    })
}

fn open(source: AnySource, name: String, out: *mut *mut File) -> Result<(), Failure> {
    match lodpack::File::open(source, Limits::default()) {
        Ok(file) => give(out, File { file, name }),
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
        let file = &borrow(file, "file")?.file;
        let (format_major, format_minor) = file.index().version();
        let [bounds_low, bounds_high] = file.bounds().unwrap_or_default();
        let (overview_error, overview_triangle_count) = file.index().overview_summary().unwrap_or_default();
        let source = file.source_info();
        let value = Info {
            format_major: format_major.into(),
            format_minor: format_minor.into(),
            level_count: file.level_count() as u32,
            root_count: file.root_count(),
            bounds_low,
            bounds_high,
            lattice_step: file.lattice().step(),
            mean_edge_length: source.map_or(0.0, |source| source.mean_edge_length),
            source_triangle_count: source.map_or(0, |source| source.triangle_count),
            source_vertex_count: source.map_or(0, |source| source.vertex_count),
            overview_triangle_count,
            overview_error,
        };
        write(info, value, "info")
    })
}

/// Writes what the file says about a level. Reads nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_level(file: *const File, number: u32, level: *mut Level) -> Status {
    guard(|| {
        let file = &borrow(file, "file")?.file;
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
        let File { file, name } = borrow(file, "file")?;
        file.verify().map_err(|error| Failure::from(error).of(name))
    })
}
