//! Import: reads mesh files into one [`Mesh`] with f64 positions.
//!
//! The content decides the format first, the file name second. Every count, index and coordinate is checked before it
//! is used. Whatever is not surface (points, lines, materials, images) is left out, with a note where a user might miss
//! it. Files are memory-mapped, and a mesh that is too large for memory goes to temporary files while it is read.
//!
//! After import, indices are in range, positions are finite, and vertices and half-edges can be numbered with 32 bits.
//! The stage `repair` does the rest.
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

mod attributes;
mod beside;
mod colour_numbers;
mod error;
mod foreign;
mod gltf;
mod inputs;
mod lines;
mod lodpack_file;
mod named;
mod obj;
mod objects;
mod off;
mod one_colour;
mod place;
mod ply;
mod polygon;
mod ranged;
pub mod raster;
mod relief;
mod scan;
mod sink;
mod source;
mod stl;
mod text;
mod text_files;
mod textures;
mod unseen;
mod usable_image;
mod used_part;
mod walk;

use std::path::{Path, PathBuf};

use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::{COLOUR, Channels};
use lodpack_mesh::attributes::Surface;
use lodpack_runtime::progress::{FewNotes, Progress, Silent};

pub use attributes::MAX_MATERIALS;
use error::Parsed;
pub use error::{ImportError, Location};
pub use gltf::decode_percent;
pub use inputs::find_inputs;
pub use objects::Objects;
pub use place::survey_meshes;
pub use ranged::RangedMesh;
use raster::RasterOptions;
pub use sink::{Imported, Overflow, Room, SpilledMesh};
pub use sink::{MeshSink, TRIANGLES_NAME, VALUE_NAMES, VERTICES_NAME};
pub use source::size_of_file;
use source::{FileBytes, Source};
pub use text::{TextCounts, TextFile, TextSink, Ways};
pub use text_files::{TextFiles, TextPiece, remove_text_files};

/// Half-edges are numbered with 32 bits, and the largest number means "none".
const MAX_TRIANGLES: u64 = (u32::MAX as u64 - 1) / 3;
/// The largest vertex number means "none".
const MAX_VERTICES: u64 = u32::MAX as u64 - 1;

/// How inputs are read.
#[derive(Clone, Debug, Default)]
pub struct ImportOptions {
    /// Channels to keep.
    pub channels: Channels,
    /// How rasters become surfaces.
    pub raster: RasterOptions,
    /// Whether the charts of an input that has some, an atlas, are forgotten.
    pub new_charts: bool,
    /// What becomes of the objects that inputs name. Whether they meet, which matters to [`Objects::Auto`], is not
    /// looked at here.
    pub objects: Objects,
}

impl ImportOptions {
    /// The shape alone.
    pub(crate) fn shape() -> Self {
        Self { channels: Channels::None, objects: Objects::Join, ..Self::default() }
    }
}

/// Reads mesh files (OBJ, OFF, PLY, STL, glTF, GLB, lodpack) into one mesh, in the given order.
///
/// Polygons are triangulated; glTF instances are expanded and transformed. Nothing is welded or dropped, except faces
/// with fewer than three distinct corners, which a note counts. The files are mapped into memory: shortening one while
/// it is read ends the process.
///
/// # Errors
///
/// If any input is missing, damaged, of an unknown format, or without triangles: see [`ImportError`].
pub fn import_meshes(paths: &[PathBuf], progress: &dyn Progress) -> Result<Mesh, ImportError> {
    import_shape(paths, &RasterOptions::default(), progress)
}

/// Like [`import_meshes`], where the inputs may be rasters that something is known about.
///
/// # Errors
///
/// Those of [`import_meshes`].
pub fn import_shape(paths: &[PathBuf], raster: &RasterOptions, progress: &dyn Progress) -> Result<Mesh, ImportError> {
    let options = ImportOptions { raster: raster.clone(), ..ImportOptions::shape() };
    match import_large_meshes(paths, &Room::memory_alone(), &options, progress)? {
        Imported::Memory(surface) => Ok(surface.mesh),
        // Unlimited memory never spills.
        Imported::Spilled(_) => Ok(Mesh::default()),
    }
}

/// Like [`import_shape`], with the objects that the inputs name, and nothing else that they carry.
///
/// # Errors
///
/// Those of [`import_meshes`].
pub fn import_named(
    paths: &[PathBuf],
    raster: &RasterOptions,
    progress: &dyn Progress,
) -> Result<Surface, ImportError> {
    let options = ImportOptions { raster: raster.clone(), objects: Objects::Keep, ..ImportOptions::shape() };
    match import_large_meshes(paths, &Room::memory_alone(), &options, progress)? {
        Imported::Memory(surface) => Ok(surface),
        // Unlimited memory never spills.
        Imported::Spilled(_) => Ok(Surface::default()),
    }
}

/// Like [`import_meshes`], with the attributes that channels are made from; and spills into temporary files if a build
/// in memory would need more than is allowed.
///
/// # Errors
///
/// Those of [`import_meshes`], and full disks.
pub fn import_large_meshes(
    paths: &[PathBuf],
    room: &Room,
    options: &ImportOptions,
    progress: &dyn Progress,
) -> Result<Imported, ImportError> {
    if paths.is_empty() {
        return Err(ImportError::NoInput);
    }
    let sizes: Vec<u64> = paths.iter().map(|p| std::fs::metadata(p).map_or(0, |m| m.len())).collect();
    progress.begin("import", sizes.iter().fold(0, |sum: u64, &size| sum.saturating_add(size)));
    let progress = &FewNotes::new(progress);
    if raster::are_rasters(paths)? {
        // They are one ground.
        let mut sink = MeshSink::new(room.clone(), &ImportOptions { objects: Objects::Join, ..options.clone() });
        raster::read_rasters(paths, &options.raster, &mut sink, progress)?;
        progress.advance(sizes.iter().fold(0, |sum: u64, &size| sum.saturating_add(size)));
        return finish(sink, progress);
    }
    let mut sink = MeshSink::new(room.clone(), options);
    for (path, size) in paths.iter().zip(sizes) {
        let bytes = FileBytes::open(path)?;
        read_mesh(&Source::of_file(path, &bytes, progress), &mut sink)?;
        progress.advance(size);
    }
    finish(sink, progress)
}

/// Reads the shape of a mesh whose bytes are in memory; `path` is where they come from, for messages and for the files
/// that they name.
///
/// # Errors
///
/// Those of [`import_meshes`].
pub fn import_bytes(path: &Path, bytes: &[u8], progress: &dyn Progress) -> Result<Mesh, ImportError> {
    let mut sink = MeshSink::new(Room::memory_alone(), &ImportOptions::shape());
    read_mesh(&Source::new(path, bytes, progress), &mut sink)?;
    match sink.finish()? {
        Imported::Memory(surface) => Ok(surface.mesh),
        // Unlimited memory never spills.
        Imported::Spilled(_) => Ok(Mesh::default()),
    }
}

/// Imports what a caller has from elsewhere: `push` hands over its vertices, triangles and attributes. `path` is where
/// they come from, for messages.
///
/// # Errors
///
/// Those of [`import_large_meshes`], and of `push`.
pub fn import_with(
    path: &Path,
    room: &Room,
    options: &ImportOptions,
    progress: &dyn Progress,
    push: impl FnOnce(&mut MeshSink) -> Parsed<()>,
) -> Result<Imported, ImportError> {
    let mut sink = MeshSink::new(room.clone(), options);
    push(&mut sink)?;
    sink.end_file(path)?;
    finish(sink, progress)
}

/// Ends the inputs, says what they carry, and looks at their images.
fn finish(mut sink: MeshSink, progress: &dyn Progress) -> Result<Imported, ImportError> {
    let notes = [sink.channels(), sink.left_out()].into_iter().flatten();
    let of_files = std::mem::take(&mut sink.notes);
    let of_values = sink.attributes.about_numbers().into_iter().chain(sink.about_objects());
    for note in of_files.into_iter().chain(notes).chain(of_values) {
        progress.note(&note);
    }
    let room = sink.room();
    // Whoever has less memory is told so below, so that files never depend on it.
    sink.attributes.fold_images(room.memory / 2);
    let mut imported = sink.finish()?;
    if let Imported::Memory(surface) = &mut imported {
        textures::check_images(&mut surface.appearance, room.memory, progress)?;
        // The mesh may fit where its texels do not.
        imported = Imported::new(std::mem::take(surface), &room)?;
    } else if let Imported::Spilled(mesh) = &mut imported {
        textures::check_images(&mut mesh.appearance, room.memory, progress)?;
    }
    if let Imported::Spilled(mesh) = &mut imported {
        textures::keep_images(&mut mesh.appearance, &mesh.directory)?;
    }
    Ok(imported)
}

fn read_mesh(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    match detect_format(source)? {
        Format::Ply => ply::read_ply(source, sink)?,
        Format::BinaryStl => stl::read_binary_stl(source, sink)?,
        Format::AsciiStl => stl::read_ascii_stl(source, sink)?,
        Format::Glb => gltf::read_glb(source, sink)?,
        Format::Gltf => gltf::read_gltf(source, sink)?,
        Format::Obj => obj::read_obj(source, sink)?,
        Format::Off => off::read_off(source, sink)?,
        Format::Lodpack => lodpack_file::read_lodpack(source, sink)?,
    };
    if sink.triangle_count() == 0 {
        let vertex_count = sink.vertex_count();
        return Err(ImportError::NoTriangles { path: source.path.to_owned(), vertex_count }.into());
    }
    sink.end_file(source.path)
}

/// The files that an input is read together with: headers of rasters and, where colours are kept, libraries of
/// materials and images. It need not be sound: what cannot be read names nothing.
pub fn files_beside(path: &Path, channels: &Channels) -> Vec<PathBuf> {
    if let Some(format) = raster::format_of(path) {
        return raster::files_beside(path, format);
    }
    if !channels.wants(COLOUR) {
        return vec![];
    }
    let Ok(bytes) = FileBytes::open(path) else { return vec![] };
    let source = Source::of_file(path, &bytes, &Silent);
    match detect_format(&source) {
        Ok(Format::Ply) => ply::files_beside(&source),
        Ok(Format::Obj) => obj::files_beside(&source),
        Ok(Format::Glb | Format::Gltf) => gltf::files_beside(&source),
        _ => vec![],
    }
}

/// The image over a raster, and the files that say where it is.
pub fn files_of_drape(drape: &Path) -> impl Iterator<Item = PathBuf> {
    std::iter::once(drape.to_owned()).chain(raster::sidecars(drape))
}

/// Whether a file is glTF or GLB, whose unit is the metre.
///
/// # Errors
///
/// Like [`import_meshes`], if the file cannot be read or its format is unknown.
pub fn is_gltf(path: &Path) -> Result<bool, ImportError> {
    let bytes = FileBytes::open(path)?;
    Ok(matches!(detect_format(&Source::of_file(path, &bytes, &Silent))?, Format::Glb | Format::Gltf))
}

/// Refuses meshes that 32-bit indices cannot number.
fn check_size(path: &Path, vertex_count: u64, triangle_count: u64) -> Parsed<()> {
    let too_large = |what, count, limit| ImportError::TooLarge { path: path.to_owned(), what, count, limit };
    if vertex_count > MAX_VERTICES {
        return Err(too_large("vertices", vertex_count, MAX_VERTICES).into());
    }
    if triangle_count > MAX_TRIANGLES {
        return Err(too_large("triangles", triangle_count, MAX_TRIANGLES).into());
    }
    Ok(())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Ply,
    BinaryStl,
    AsciiStl,
    Glb,
    Gltf,
    Obj,
    Off,
    Lodpack,
}

/// Finds the format by content; the name decides only where the content leaves it open.
fn detect_format(source: &Source) -> Parsed<Format> {
    let bytes = source.bytes;
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    let extension = source.path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if let Some((format, remedy)) = foreign::by_content(bytes, &extension) {
        return Err(ImportError::Foreign { path: source.path.to_owned(), format, remedy }.into());
    }
    let has_word = |word: &[u8]| text.starts_with(word) && text.get(word.len()).is_none_or(u8::is_ascii_whitespace);
    let format = if bytes.starts_with(b"ply") && has_word(b"ply") {
        Format::Ply
    } else if bytes.starts_with(&lodpack::Opener::MAGIC) {
        Format::Lodpack
    } else if bytes.starts_with(b"glTF") {
        Format::Glb
    } else if stl::is_exact_binary_stl(bytes) {
        // Before the text formats, because a binary STL may start with any words, even "solid".
        Format::BinaryStl
    } else if text.starts_with(b"{") {
        Format::Gltf
    } else if stl::is_ascii_stl(text) {
        Format::AsciiStl
    } else if off::looks_like_off(text) {
        Format::Off
    } else if extension != "stl" && [b"\xFF\xFE", b"\xFE\xFF"].into_iter().any(|mark| bytes.starts_with(mark)) {
        return Err(source.syntax(Location::Byte(0), "this is text in UTF-16; save it as UTF-8"));
    } else {
        match extension.as_str() {
            "stl" => Format::BinaryStl,
            "obj" => Format::Obj,
            "off" => Format::Off,
            "ply" => return Err(source.wrong_magic("a PLY file must start with the line \"ply\"")),
            "glb" => return Err(source.wrong_magic("a GLB file must start with the letters glTF")),
            "gltf" => return Err(source.wrong_magic("a glTF file must be a JSON object")),
            _ if obj::looks_like_obj(text) => Format::Obj,
            _ => {
                if let Some((format, remedy)) = foreign::by_name(&extension) {
                    return Err(ImportError::Foreign { path: source.path.to_owned(), format, remedy }.into());
                }
                let start = source.start_of_file();
                return Err(ImportError::UnknownFormat { path: source.path.to_owned(), start }.into());
            }
        }
    };
    Ok(format)
}

#[cfg(test)]
mod attribute_tests;
#[cfg(test)]
mod exporter_tests;
#[cfg(test)]
mod fallback_tests;
#[cfg(test)]
mod material_tests;
#[cfg(test)]
mod object_tests;
#[cfg(test)]
mod ranged_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tobj_tests;
