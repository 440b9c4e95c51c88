//! The stage **import**: mesh files become one [`Mesh`] with f64 positions.
//!
//! The format is told by content first and by the file name second. Every count, index and coordinate is checked
//! before it is used; what is not surface (points, lines, materials, images) is left out, with a note where a user
//! might miss it. Files are memory-mapped, so that the peak is about the mesh itself.

mod error;
mod gltf;
mod obj;
mod ply;
mod polygon;
mod scan;
mod source;
mod stl;

use std::path::{Path, PathBuf};

use crate::mesh::Mesh;
use crate::progress::Progress;

use error::Parsed;
pub use error::{ImportError, Place};
use source::{FileBytes, Source};

/// Half-edges are numbered with 32 bits and the largest number means "none".
const MAX_TRIANGLES: u64 = (u32::MAX as u64 - 1) / 3;
/// How files of our own begin.
const LODPACK_MAGIC: &[u8] = b"\x8fLOD\r\n\x1a\n";
/// The largest vertex number means "none".
const MAX_VERTICES: u64 = u32::MAX as u64 - 1;

/// Reads mesh files (OBJ, PLY, STL, glTF, GLB) into one mesh, in the order given.
///
/// Polygons are triangulated, glTF instances expanded and transformed. Nothing is welded or dropped here except faces
/// with fewer than three distinct corners, which are counted in a note: [`crate::repair`] does the rest.
/// The files are mapped into memory: shortening one while it is read ends the process.
///
/// # Errors
/// Any input that is missing, damaged, not understood, or without triangles: see [`ImportError`].
pub fn import_meshes(paths: &[PathBuf], progress: &dyn Progress) -> Result<Mesh, ImportError> {
    if paths.is_empty() {
        return Err(ImportError::NoInput);
    }
    let sizes: Vec<u64> = paths.iter().map(|p| std::fs::metadata(p).map_or(0, |m| m.len())).collect();
    progress.begin("import", sizes.iter().fold(0, |sum: u64, &size| sum.saturating_add(size)));
    let mut whole = Mesh::default();
    for (path, size) in paths.iter().zip(sizes) {
        let mesh = import_file(path, progress)?;
        append(&mut whole, mesh, path)?;
        progress.advance(size);
    }
    Ok(whole)
}

fn import_file(path: &Path, progress: &dyn Progress) -> Parsed<Mesh> {
    let bytes = FileBytes::open(path)?;
    read_mesh(&Source::new(path, &bytes, progress))
}

fn read_mesh(source: &Source) -> Parsed<Mesh> {
    let mesh = match detect_format(source)? {
        Format::Ply => ply::read_ply(source)?,
        Format::BinaryStl => stl::read_binary_stl(source)?,
        Format::AsciiStl => stl::read_ascii_stl(source)?,
        Format::Glb => gltf::read_glb(source)?,
        Format::Gltf => gltf::read_gltf(source)?,
        Format::Obj => obj::read_obj(source)?,
    };
    if mesh.triangles.is_empty() {
        let vertex_count = mesh.positions.len() as u64;
        return Err(ImportError::NoTriangles { path: source.path.to_owned(), vertex_count }.into());
    }
    check_size(source.path, mesh.positions.len() as u64, mesh.triangles.len() as u64)?;
    Ok(mesh)
}

/// Refuses what 32-bit indices cannot name.
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

fn append(whole: &mut Mesh, mesh: Mesh, path: &Path) -> Parsed<()> {
    if whole.triangles.is_empty() {
        *whole = mesh;
        return Ok(());
    }
    let offset = whole.positions.len() as u64;
    check_size(path, offset + mesh.positions.len() as u64, (whole.triangles.len() + mesh.triangles.len()) as u64)?;
    whole.positions.extend_from_slice(&mesh.positions);
    whole.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + offset as u32)));
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
}

/// Tells the format by content; the name decides only where the content leaves it open.
fn detect_format(source: &Source) -> Parsed<Format> {
    let bytes = source.bytes;
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    let extension = source.path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let has_word = |word: &[u8]| text.starts_with(word) && text.get(word.len()).is_none_or(u8::is_ascii_whitespace);
    let format = if bytes.starts_with(b"ply") && has_word(b"ply") {
        Format::Ply
    } else if bytes.starts_with(LODPACK_MAGIC) {
        return Err(ImportError::Lodpack { path: source.path.to_owned() }.into());
    } else if bytes.starts_with(b"glTF") {
        Format::Glb
    } else if stl::is_exact_binary_stl(bytes) {
        // Before the text formats: a binary STL may start with any words, "solid" included.
        Format::BinaryStl
    } else if text.starts_with(b"{") {
        Format::Gltf
    } else if stl::is_ascii_stl(text) {
        Format::AsciiStl
    } else {
        match extension.as_str() {
            "stl" => Format::BinaryStl,
            "obj" => Format::Obj,
            "ply" => return Err(source.wrong_magic("a PLY file must start with the line \"ply\"")),
            "glb" => return Err(source.wrong_magic("a GLB file must start with the letters glTF")),
            "gltf" => return Err(source.wrong_magic("a glTF file must be a JSON object")),
            _ if obj::looks_like_obj(text) => Format::Obj,
            _ => {
                let start = source.start_of_file();
                return Err(ImportError::UnknownFormat { path: source.path.to_owned(), start }.into());
            }
        }
    };
    Ok(format)
}

#[cfg(test)]
mod tests;
