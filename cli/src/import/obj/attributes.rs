//! What OBJ files say beside the shape: colours behind the positions, texture coordinates, and materials.

use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::mtl::read_materials;
use crate::import::attributes::AttributeSink;
use crate::import::error::Parsed;
use crate::import::polygon::Triangulator;
use crate::import::scan::Scanner;
use crate::import::sink::MeshSink;
use crate::import::source::Source;
use crate::import::textures::file_beside;
use crate::mesh::NONE;
use crate::mesh::appearance::{COLOUR, Channels};
use crate::mesh::attributes::AttributeLayout;
use crate::mesh::srgb::linear_from_srgb;

/// The largest library of materials that is read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// The attributes of a file, as far as it was read.
#[derive(Default)]
pub(super) struct ObjAttributes {
    /// Whether colours are wanted.
    is_on: bool,
    /// Number of each material, and whether it has a texture.
    materials: HashMap<Vec<u8>, (usize, bool)>,
    /// Texture coordinates, with rows from above.
    uvs: Vec<[f32; 2]>,
    has_colours: bool,
    records: Vec<f32>,
    clamped_count: u64,
    unknown_materials: u64,
    missing_uvs: u64,
}

/// The libraries that a statement names: one name with spaces, or several names.
fn libraries(names: &[u8], source: &Source) -> Vec<PathBuf> {
    let names = std::str::from_utf8(names.trim_ascii()).unwrap_or_default();
    let is_file = |name: &str| source.path.parent().is_some_and(|folder| folder.join(name).is_file());
    let names: Vec<&str> = if is_file(names) { vec![names] } else { names.split_ascii_whitespace().collect() };
    names.into_iter().filter_map(|name| file_beside(source, name)).collect()
}

fn read_library(path: &Path) -> io::Result<Vec<u8>> {
    match fs::metadata(path)?.len() {
        bytes if bytes > MAX_LIBRARY_BYTES => {
            Err(io::Error::other(format!("it has {bytes} bytes, more than {MAX_LIBRARY_BYTES}")))
        }
        _ => fs::read(path),
    }
}

/// The libraries of materials that a file names, and their images.
pub(in crate::import) fn files_beside(source: &Source) -> Vec<PathBuf> {
    let mut files = vec![];
    let mut at = 0;
    for line in source.bytes.split(|&byte| byte == b'\n' || byte == b'\r') {
        at += line.len() + 1;
        source.passed(at);
        let Some(names) = line.trim_ascii_start().strip_prefix(b"mtllib") else { continue };
        for library in libraries(names, source) {
            let mut sink = AttributeSink::new(&Channels::Auto);
            read_materials(&read_library(&library).unwrap_or_default(), source, &mut sink);
            files.push(library);
            files.extend(sink.image_files());
        }
    }
    files
}

impl ObjAttributes {
    pub(super) fn new(sink: &MeshSink) -> Self {
        Self { is_on: sink.attributes.wants_colour(), ..Self::default() }
    }

    /// The number of texture coordinates so far.
    pub(super) fn uv_count(&self) -> u64 {
        self.uvs.len() as u64
    }

    /// Whether colours and textures are read.
    pub(super) fn reads_colours(&self) -> bool {
        self.is_on
    }

    /// Whether some material has a texture.
    pub(super) fn has_textures(&self) -> bool {
        self.materials.values().any(|(_, is_textured)| *is_textured)
    }

    /// Adds the materials of libraries: `mtllib`.
    pub(super) fn read_libraries(&mut self, names: &[u8], source: &Source, sink: &mut MeshSink) -> Parsed<()> {
        if !self.is_on {
            return Ok(());
        }
        for path in libraries(names, source) {
            let text = match read_library(&path) {
                Ok(text) => text,
                Err(error) => {
                    source.note(&format!("the materials {} cannot be read: {error}; faces have none", path.display()));
                    continue;
                }
            };
            let materials = read_materials(&text, source, &mut sink.attributes);
            let named: Vec<_> =
                materials.iter().map(|m| (m.name.clone().into_bytes(), m.base_texture.is_some())).collect();
            let first = sink.attributes.add_materials(materials)?;
            for (number, (name, is_textured)) in (first..).zip(named) {
                self.materials.entry(name).or_insert((number, is_textured));
            }
        }
        Ok(())
    }

    /// Sets the material of the faces that follow: `usemtl`.
    pub(super) fn use_material(&mut self, name: &[u8], sink: &mut MeshSink) {
        if !self.is_on {
            return;
        }
        let known = self.materials.get(name.trim_ascii()).copied();
        self.unknown_materials += u64::from(known.is_none() && !self.materials.is_empty());
        let (number, is_textured) = known.unwrap_or((0, false));
        if known.is_some() {
            sink.attributes.finds(COLOUR, if is_textured { "textures" } else { "materials" });
        }
        sink.set_material(number);
        if is_textured && sink.attributes.corner_stride() == 0 {
            let mut layout = AttributeLayout::default();
            layout.add_uv(1);
            sink.set_corner_layout(layout);
        }
    }

    /// Adds texture coordinates: `vt`.
    pub(super) fn push_uv(&mut self, words: &mut Scanner, sink: &mut MeshSink) {
        if !self.is_on {
            return;
        }
        let mut number = || words.float().ok().filter(|value| value.is_finite()).map(|value| value as f32);
        let uv = number().zip(number()).map_or([f32::NAN; 2], |(u, v)| [u, 1.0 - v]);
        self.uvs.push(uv);
        if self.uvs.len().is_multiple_of(1 << 16) {
            sink.hold_beside(self.uvs.capacity() as u64 * 8);
        }
    }

    /// Adds the record of a vertex, given what follows its position: three numbers or more are a colour.
    pub(super) fn push_colour(&mut self, rest: &[f64], sink: &mut MeshSink) {
        let is_colour = self.is_on && rest.len() >= 3;
        if is_colour && !self.has_colours {
            self.has_colours = true;
            sink.attributes.finds(COLOUR, "vertex colours");
            let mut layout = AttributeLayout::default();
            layout.add_colour();
            sink.set_vertex_layout(layout);
        }
        if !self.has_colours {
            return;
        }
        let mut colour = [1.0f32; 4];
        if is_colour {
            let mut clamped = false;
            for (value, &written) in colour.iter_mut().zip(rest) {
                let within = if written.is_nan() { 0.0 } else { written.clamp(0.0, 1.0) };
                clamped |= within != written;
                *value = within as f32;
            }
            self.clamped_count += u64::from(clamped);
            colour[..3].iter_mut().for_each(|value| *value = linear_from_srgb(*value));
        }
        sink.attributes.push_vertex(&colour);
    }

    /// Adds a face with the numbers of its corners' texture coordinates, or [`NONE`].
    pub(super) fn push_face(
        &mut self,
        polygon: &[u32],
        uvs: &[u32],
        sink: &mut MeshSink,
        faces: &mut Triangulator,
    ) -> Parsed<()> {
        self.records.clear();
        if sink.attributes.corner_stride() > 0 {
            for &number in uvs {
                let uv = self.uvs.get(number as usize).copied();
                self.missing_uvs += u64::from(uv.is_none() && number != NONE);
                self.records.extend(uv.unwrap_or([f32::NAN; 2]));
            }
        }
        sink.push_polygon_with(polygon, &self.records, faces)
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(self.clamped_count, "vertices have colours outside of 0 to 1: they were clamped");
        source
            .note_skipped(self.unknown_materials, "usemtl statements name materials that no library has: no material");
        source.note_skipped(self.missing_uvs, "corners name texture coordinates that do not exist: no texture there");
    }
}
