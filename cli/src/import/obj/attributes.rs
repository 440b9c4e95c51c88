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
use crate::mesh::appearance::{COLOUR, Channels, Material, NORMAL};
use crate::mesh::attributes::AttributeLayout;
use crate::mesh::srgb::linear_from_srgb;

/// The largest library of materials that is read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// The attributes of a file, as far as it was read.
#[derive(Default)]
pub(super) struct ObjAttributes {
    /// Whether materials and colours are wanted.
    is_on: bool,
    /// Whether normals are.
    with_normals: bool,
    /// Number of each material, and whether it has a texture.
    materials: HashMap<Vec<u8>, (usize, bool)>,
    /// Texture coordinates, with rows from above.
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
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
        let with_normals = sink.attributes.wants_normals(false);
        Self { is_on: sink.attributes.wants_materials(), with_normals, ..Self::default() }
    }

    /// The numbers of vertices, texture coordinates and normals so far.
    pub(super) fn counts(&self, vertex_count: u64) -> [u64; 3] {
        [vertex_count, self.uvs.len() as u64, self.normals.len() as u64]
    }

    /// Whether normals are read.
    pub(super) fn reads_normals(&self) -> bool {
        self.with_normals
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
            let is_textured = |material: &Material| {
                let images = [&material.base_texture, &material.opacity_texture, &material.emissive_texture];
                images.iter().any(|image| image.is_some()) || material.normal_texture.is_some()
            };
            self.with_normals |=
                sink.attributes.wants_normals(materials.iter().any(|material| material.normal_texture.is_some()));
            let named: Vec<_> = materials.iter().map(|m| (m.name.clone().into_bytes(), is_textured(m))).collect();
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
        if is_textured {
            self.open_corners(sink);
        }
    }

    /// Gives corners their records, as soon as something goes into them.
    fn open_corners(&self, sink: &mut MeshSink) {
        if sink.attributes.corner_stride() == 0 {
            let mut layout = AttributeLayout::default();
            layout.add_uv(1);
            if self.with_normals {
                layout.add_normal();
            }
            sink.set_corner_layout(layout);
        }
    }

    /// Adds a normal: `vn`.
    pub(super) fn push_normal(&mut self, words: &mut Scanner, sink: &mut MeshSink) {
        if !self.with_normals {
            return;
        }
        if self.normals.is_empty() {
            sink.attributes.finds(NORMAL, "normals");
            self.open_corners(sink);
        }
        let normal = [(); 3].map(|()| words.float().map_or(f32::NAN, |value| value as f32));
        self.normals.push(normal);
        if self.normals.len().is_multiple_of(1 << 16) {
            sink.hold_beside(self.held());
        }
    }

    /// Bytes of what faces name.
    fn held(&self) -> u64 {
        8 * self.uvs.capacity() as u64 + 12 * self.normals.capacity() as u64
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
            sink.hold_beside(self.held());
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

    /// Adds a face with the numbers of its corners' texture coordinates and normals, or [`NONE`].
    pub(super) fn push_face(
        &mut self,
        polygon: &[u32],
        beside: &[[u32; 2]],
        sink: &mut MeshSink,
        faces: &mut Triangulator,
    ) -> Parsed<()> {
        self.records.clear();
        if sink.attributes.corner_stride() > 0 {
            let has_normals = sink.attributes.corner_stride() > 2;
            for &[uv, normal] in beside {
                let found = self.uvs.get(uv as usize).copied();
                self.missing_uvs += u64::from(found.is_none() && uv != NONE && self.has_textures());
                self.records.extend(found.unwrap_or([f32::NAN; 2]));
                if has_normals {
                    self.records.extend(self.normals.get(normal as usize).copied().unwrap_or([f32::NAN; 3]));
                }
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
