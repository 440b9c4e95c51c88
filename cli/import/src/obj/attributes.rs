//! What OBJ files say beside the shape: colours behind the positions, texture coordinates, and materials.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;

use super::libraries::{libraries, libraries_from, read_library};
use super::mtl::{LibraryMaterial, LibraryReader};
use super::tiles::{Tile, tile_of};
use crate::beside::Beside;
use crate::beside::without_remark;
use crate::colour_numbers::{ARE_BYTES, ColourNumbers, ColourRange};
use crate::error::Parsed;
use crate::polygon::Triangulator;
use crate::scan::Scanner;
use crate::sink::MeshSink;
use crate::source::Source;
use crate::usable_image::NamedImages;
use lodpack_mesh::NONE;
use lodpack_mesh::appearance::{COLOUR, Material, NORMAL};
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::srgb::linear_from_srgb;

/// The attributes of a file, as far as it was read.
#[derive(Default)]
pub(super) struct ObjAttributes {
    /// Whether materials and colours are wanted.
    is_on: bool,
    /// Whether normals are.
    with_normals: bool,
    /// The materials of all libraries that were read.
    materials: Vec<KnownMaterial>,
    /// Their places by name, and by name without a comment behind it.
    by_name: HashMap<Vec<u8>, usize>,
    by_bare_name: HashMap<Vec<u8>, usize>,
    libraries: HashSet<PathBuf>,
    images: NamedImages,
    /// How much decoding one of them may take.
    memory: u64,
    /// Whether the libraries of the rest of the file have been read already.
    has_read_ahead: bool,
    /// The place of the current material, if it has textures.
    textured: Option<usize>,
    /// Texture coordinates, with rows from above.
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    has_colours: bool,
    range: ColourRange,
    records: Vec<f32>,
    uvs_of_face: Vec<[f32; 2]>,
    clamped_count: u64,
    unknown_materials: u64,
    missing_uvs: u64,
    untextured_faces: u64,
    faces_without_tile: u64,
    wide_faces: u64,
}

/// A material among those of the input.
struct KnownMaterial {
    number: usize,
    /// What faces have by their tile, if its images are in tiles.
    on_tiles: BTreeMap<Tile, usize>,
    /// What faces without texture coordinates have in its place, if it has textures.
    plain: Option<Plain>,
}

/// A material without its textures, which is made when a face needs it.
enum Plain {
    Unused(Box<Material>),
    Number(usize),
}

impl ObjAttributes {
    pub(super) fn new(sink: &MeshSink) -> Self {
        let with_normals = sink.attributes.wants_normals(false);
        Self { is_on: sink.attributes.wants_materials(), with_normals, memory: sink.room().memory, ..Self::default() }
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
        self.materials.iter().any(|material| material.plain.is_some())
    }

    /// Adds the materials of libraries: `mtllib`.
    pub(super) fn read_libraries(&mut self, names: &[u8], source: &Source, sink: &mut MeshSink) -> Parsed<()> {
        if !self.is_on || self.has_read_ahead {
            return Ok(());
        }
        libraries(names, source).into_iter().try_for_each(|path| self.add_library(path, source, sink))
    }

    /// Adds the materials of a library, once however often it is named.
    fn add_library(&mut self, path: PathBuf, source: &Source, sink: &mut MeshSink) -> Parsed<()> {
        if !self.libraries.insert(path.clone()) {
            return Ok(());
        }
        let text = match read_library(&path) {
            Ok(text) => text,
            Err(error) => {
                source.note(&format!("the materials {} cannot be read: {error}; faces have none", path.display()));
                return Ok(());
            }
        };
        let beside = Beside::library(source, &path);
        let (images, memory) = (&mut self.images, self.memory);
        let mut reader = LibraryReader { source, images, sink: &mut sink.attributes, beside, memory };
        let materials = reader.read(&text);
        if materials.is_empty() {
            source.note(&format!("the library {} has no materials: check that it is an MTL file", path.display()));
        }
        self.add_materials(materials, sink)
    }

    fn add_materials(&mut self, materials: Vec<LibraryMaterial>, sink: &mut MeshSink) -> Parsed<()> {
        let has_normals = materials.iter().any(|material| material.has(|of| of.normal_texture.is_some()));
        self.with_normals |= sink.attributes.wants_normals(has_normals);
        let first = sink.attributes.material_count();
        let (mut added, mut number) = (vec![], first);
        for material in materials {
            let plain = material.has_textures().then(|| Plain::Unused(material.plain.into()));
            // The first of a name counts.
            let place = self.materials.len();
            self.by_bare_name.entry(without_remark(&material.name).to_owned()).or_insert(place);
            self.by_name.entry(material.name).or_insert(place);
            let on_tiles = (number + 1..).zip(&material.tiles).map(|(number, (tile, _))| (*tile, number)).collect();
            let known = KnownMaterial { number, plain, on_tiles };
            added.push(material.textured);
            added.extend(material.tiles.into_iter().map(|(_, material)| material));
            number = first + added.len();
            self.materials.push(known);
        }
        sink.attributes.add_materials(added)?;
        Ok(())
    }

    /// Looks for a material before it is used. Some files name its library after its use, so all that follow offset
    /// `at` are read then.
    pub(super) fn find_material(&mut self, name: &[u8], at: usize, source: &Source, sink: &mut MeshSink) -> Parsed<()> {
        if !self.is_on || without_remark(name).is_empty() || self.place_of(name).is_some() {
            return Ok(());
        }
        if !self.has_read_ahead {
            self.has_read_ahead = true;
            libraries_from(source, at).into_iter().try_for_each(|path| self.add_library(path, source, sink))?;
        }
        self.unknown_materials += u64::from(self.place_of(name).is_none());
        Ok(())
    }

    /// The place of the material of a name, which may have a comment behind it.
    fn place_of(&self, name: &[u8]) -> Option<usize> {
        let name = name.trim_ascii();
        let bare = || self.by_bare_name.get(without_remark(name)).filter(|_| !without_remark(name).is_empty());
        self.by_name.get(name).or_else(bare).copied()
    }

    /// Sets the material of the faces that follow: `usemtl`.
    pub(super) fn use_material(&mut self, name: &[u8], sink: &mut MeshSink) {
        if !self.is_on {
            return;
        }
        let place = self.place_of(name);
        let known = place.map(|place| &self.materials[place]);
        let is_textured = known.is_some_and(|material| material.plain.is_some());
        if known.is_some() {
            sink.attributes.finds(COLOUR, if is_textured { "textures" } else { "materials" });
        }
        sink.set_material(known.map_or(0, |material| material.number));
        self.textured = place.filter(|_| is_textured);
        if is_textured {
            self.open_corners(sink);
        }
    }

    /// Sets the material of a face, with its textures or without them, given the texture coordinates of its corners if
    /// it has some.
    fn choose_textured(&mut self, uvs: Option<&[[f32; 2]]>, sink: &mut MeshSink) -> Parsed<()> {
        let Some(material) = self.textured.map(|place| &mut self.materials[place]) else { return Ok(()) };
        self.untextured_faces += u64::from(uvs.is_none());
        let mut is_textured = uvs.is_some();
        if let Some(uvs) = uvs.filter(|_| !material.on_tiles.is_empty()) {
            let found = tile_of(uvs.iter().copied());
            self.wide_faces += u64::from(found.is_some_and(|(_, is_wide)| is_wide));
            if let Some(number) = found.and_then(|(tile, _)| material.on_tiles.get(&tile)) {
                sink.set_material(*number);
                return Ok(());
            }
            self.faces_without_tile += 1;
            is_textured = false;
        }
        let number = match material.plain.take() {
            Some(Plain::Unused(plain)) if !is_textured => {
                let number = sink.attributes.add_materials(vec![*plain])?;
                material.plain = Some(Plain::Number(number));
                number
            }
            plain => {
                let number = match &plain {
                    Some(Plain::Number(number)) if !is_textured => *number,
                    _ => material.number,
                };
                material.plain = plain;
                number
            }
        };
        sink.set_material(number);
        Ok(())
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

    /// Adds the record of a vertex, given what follows its position: three numbers or more are a colour. `all` looks at
    /// this one and those that follow.
    pub(super) fn push_colour(
        &mut self,
        rest: &[f64],
        all: impl FnOnce() -> ColourNumbers,
        source: &Source,
        sink: &mut MeshSink,
    ) {
        let is_colour = self.is_on && rest.len() >= 3;
        if is_colour && !self.has_colours {
            self.has_colours = true;
            self.range = all().range();
            if self.range.are_bytes() {
                source.note(ARE_BYTES);
            }
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
            let ColourRange { colour: full, alpha } = self.range;
            for ((value, &written), full) in colour.iter_mut().zip(rest).zip([full, full, full, alpha]) {
                let written = written / full;
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
        self.uvs_of_face.clear();
        if sink.attributes.corner_stride() > 0 {
            let has_normals = sink.attributes.corner_stride() > 2;
            let mut has_uvs = true;
            for &[uv, normal] in beside {
                let found = self.uvs.get(uv as usize).copied();
                self.missing_uvs += u64::from(found.is_none() && uv != NONE && self.has_textures());
                let uv = found.unwrap_or([f32::NAN; 2]);
                has_uvs &= uv[0].is_finite() && uv[1].is_finite();
                self.records.extend(uv);
                self.uvs_of_face.push(uv);
                if has_normals {
                    self.records.extend(self.normals.get(normal as usize).copied().unwrap_or([f32::NAN; 3]));
                }
            }
            let uvs = std::mem::take(&mut self.uvs_of_face);
            self.choose_textured(has_uvs.then_some(&uvs), sink)?;
            self.uvs_of_face = uvs;
        }
        sink.push_polygon_with(polygon, &self.records, faces)
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(
            self.clamped_count,
            "vertices have colours outside of 0 to 1: they were clamped; divide them by 255 if that is the largest",
        );
        source
            .note_skipped(self.unknown_materials, "usemtl statements name materials that no library has: no material");
        source.note_skipped(
            self.untextured_faces,
            "faces of materials with textures have no texture coordinates: they have the colour of their material alone",
        );
        source.note_skipped(
            self.faces_without_tile,
            "faces lie on tiles (UDIM) of which there is no image: they have the colour of their material alone",
        );
        source.note_skipped(
            self.wide_faces,
            "faces reach over several tiles (UDIM), and show that of their middle: divide them along the borders of tiles",
        );
        source.note_skipped(self.missing_uvs, "corners name texture coordinates that do not exist: no texture there");
    }
}
