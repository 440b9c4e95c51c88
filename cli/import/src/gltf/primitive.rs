//! One primitive of a mesh, drawn once or many times: its vertices, moved in f64, and its triangles.

use glam::DMat4;

use super::accessor::{read_indices, read_positions};
use super::arrays::Arrays;
use super::attributes::{SceneAttributes, Turn};
use super::buffers::Buffers;
use super::document::{Document, Mode, Primitive, Semantic};
use super::draco::DracoDecoder;
use super::skin::Skinning;
use crate::check_size;
use crate::error::{ImportError, Location, Parsed};
use crate::sink::MeshSink;
use crate::source::Source;

/// Reads the primitives of meshes, wherever the scene draws them.
pub(super) struct PrimitiveReader<'a> {
    pub(super) source: &'a Source<'a>,
    pub(super) document: &'a Document,
    pub(super) buffers: &'a Buffers<'a>,
    pub(super) attributes: SceneAttributes,
    pub(super) decoder: DracoDecoder,
    pub(super) sink: &'a mut MeshSink,
    /// Bytes that the document takes, with what is decompressed for it.
    pub(super) held: u64,
    pub(super) skipped_primitive_count: u64,
    pub(super) placeless_primitive_count: u64,
}

/// Where a primitive is drawn: the same wherever it is, or as joints have it.
#[derive(Clone, Copy)]
struct Pose<'a> {
    world: DMat4,
    joints: Option<&'a [DMat4]>,
}

impl PrimitiveReader<'_> {
    /// Reads a mesh once for each place; `joints` are those of its skin.
    pub(super) fn read_mesh(&mut self, number: usize, worlds: &[DMat4], joints: Option<&[DMat4]>) -> Parsed<()> {
        let document = self.document;
        for (primitive_number, primitive) in document.meshes[number].primitives.iter().enumerate() {
            let Some(mode) = primitive.mode() else {
                self.skipped_primitive_count += worlds.len() as u64;
                continue;
            };
            let decoded =
                self.decoder.decode(self.source, document, self.buffers, [number, primitive_number], primitive)?;
            self.sink.hold_beside(self.held + self.decoder.bytes());
            let arrays = Arrays::new(document, self.buffers, primitive, decoded);
            // Triangles that were decoded are no strips any more.
            let mode = if arrays.decoded_indices().is_some() { Mode::Triangles } else { mode };
            let location = Location::Item("mesh", number as u64);
            self.check_references(primitive, location)?;
            let shape = Shape { mode, number: primitive_number, location };
            for &world in worlds {
                self.read_primitive(&arrays, &shape, Pose { world, joints })?;
            }
        }
        Ok(())
    }

    /// How many vertices a mesh has, and triangles if they are no strips, by its accessors: what is more is refused as
    /// it is read.
    pub(super) fn size_of_mesh(&self, number: usize) -> [u64; 2] {
        let primitives = self.document.meshes.get(number).map_or(&[][..], |mesh| &mesh.primitives);
        let count = |accessor: Option<usize>| {
            accessor.and_then(|number| self.document.accessors.get(number)).map_or(0, |accessor| accessor.count.0)
        };
        let sizes = primitives.iter().filter(|primitive| primitive.mode().is_some()).map(|primitive| {
            let vertices = count(primitive.attributes.get(Semantic::Position));
            [vertices, primitive.indices.map_or(vertices, |indices| count(Some(indices.into()))) / 3]
        });
        sizes.fold([0; 2], |sum, size| [sum[0].saturating_add(size[0]), sum[1].saturating_add(size[1])])
    }

    fn check_references(&self, primitive: &Primitive, location: Location) -> Parsed<()> {
        let missing = |what: &str, number: usize, count: usize| {
            let problem = format!("uses {what} {number}, but there are {count}; export the file again");
            Err(self.source.syntax(location, problem))
        };
        let (accessor_count, material_count) = (self.document.accessors.len(), self.document.materials.len());
        if let Some(number) = primitive.accessors().find(|&accessor| accessor >= accessor_count) {
            return missing("accessor", number, accessor_count);
        }
        match primitive.material.map(usize::from).filter(|&material| material >= material_count) {
            Some(number) => missing("material", number, material_count),
            None => Ok(()),
        }
    }

    fn read_primitive(&mut self, arrays: &Arrays, shape: &Shape, pose: Pose) -> Parsed<()> {
        let (source, primitive) = (self.source, arrays.primitive);
        let Some(array) = arrays.get(Semantic::Position) else {
            self.placeless_primitive_count += 1;
            return Ok(());
        };
        self.note_omissions(primitive);
        let positions = read_positions(source, &array)?;
        let vertex_count = positions.len() as u64;
        check_size(source.path, self.sink.vertex_count() + vertex_count, 0)?;
        let first = self.sink.vertex_count() as u32;
        self.sink.reserve(positions.len(), 0)?;
        let mut skinning = match pose.joints {
            Some(matrices) => Skinning::of_primitive(source, arrays, matrices)?,
            None => None,
        };
        let identity = pose.world == DMat4::IDENTITY && skinning.is_none();
        let (mut matrix, mut turn) = (pose.world, Turn::of(pose.world));
        // A mirrored instance turns its triangles inside out; a renderer would turn them back (glTF 2.0, section
        // 3.7.4).
        let mut mirrored = turn.is_mirrored();
        let mut records = self.attributes.of_primitive(source, arrays);
        for (vertex, position) in positions.enumerate() {
            if !position.is_finite() {
                return Err(source.coordinate(array.location(), vertex as u64, position));
            }
            if let Some(skinning) = &mut skinning {
                matrix = pose.world * skinning.next();
                turn = Turn::of(matrix);
                mirrored = if vertex == 0 { turn.is_mirrored() } else { mirrored };
            }
            let moved = if identity { position } else { matrix.transform_point3(position) };
            if !moved.is_finite() {
                return Err(source.coordinate(shape.location, vertex as u64, moved));
            }
            if let Some(records) = &mut records {
                self.sink.attributes.push_vertex(records.next(&turn));
            }
            self.sink.push_vertex(moved)?;
        }
        if let Some(records) = records {
            self.attributes.clamped_count += records.clamped_count;
        }
        self.sink.set_material(self.attributes.material_of(primitive));
        let vertices = Vertices { first, count: vertex_count, mirrored };
        match (arrays.decoded_indices(), arrays.indices()) {
            (Some(indices), _) => self.push_triangles(indices.iter().copied(), &vertices, shape),
            (None, Some(array)) => self.push_triangles(read_indices(source, &array)?, &vertices, shape),
            (None, None) => self.push_triangles((0..vertex_count as usize).map(|i| i as u32), &vertices, shape),
        }
    }

    /// Remembers what a primitive has that is not read.
    fn note_omissions(&mut self, primitive: &Primitive) {
        for semantic in primitive.attributes.semantics() {
            match semantic {
                Semantic::TexCoord(set) if !self.attributes.reads_uv(set) => self.sink.leave_out("texture coordinates"),
                Semantic::Colour(set) if set > 0 || !self.attributes.reads_colour() => self.sink.leave_out("colours"),
                _ => {}
            }
        }
        if primitive.attributes.has_custom {
            self.sink.leave_out("custom attributes");
        }
        if primitive.material.is_some() && !self.sink.attributes.wants_colour() {
            self.sink.leave_out("materials");
        }
    }

    fn push_triangles(
        &mut self,
        indices: impl ExactSizeIterator<Item = u32>,
        vertices: &Vertices,
        shape: &Shape,
    ) -> Parsed<()> {
        let &Shape { mode, number, location } = shape;
        let &Vertices { first, count: vertex_count, mirrored } = vertices;
        let count = indices.len();
        if mode == Mode::Triangles && !count.is_multiple_of(3) {
            let problem = format!(
                "primitive {number} has {count} indices, which is not a multiple of three; export the file again"
            );
            return Err(self.source.syntax(location, problem));
        }
        let more = if mode == Mode::Triangles { count / 3 } else { count.saturating_sub(2) };
        check_size(self.source.path, 0, self.sink.triangle_count() + more as u64)?;
        self.sink.reserve(0, more)?;
        let (mut a, mut b) = (0, 0);
        // Which corner it is: the first or second of a triangle, or its last.
        let mut corner = 0;
        for (at, c) in indices.enumerate() {
            if u64::from(c) >= vertex_count {
                let face = if mode == Mode::Triangles { at / 3 } else { at.saturating_sub(2) } as u64;
                let (path, index) = (self.source.path.to_owned(), i64::from(c));
                return Err(ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into());
            }
            let c = first + c;
            match corner {
                0 => (a, corner) = (c, 1),
                1 => (b, corner) = (c, 2),
                _ => {
                    // Every second triangle of a strip is wound the other way. Repeated vertices only join strips.
                    let strip = mode == Mode::Strip;
                    if !strip || (a != b && b != c && c != a) {
                        let mut triangle = if strip && !at.is_multiple_of(2) { [b, a, c] } else { [a, b, c] };
                        if mirrored {
                            triangle.swap(1, 2);
                        }
                        self.sink.push_triangle(triangle)?;
                    }
                    match mode {
                        Mode::Strip => (a, b) = (b, c),
                        Mode::Fan => b = c,
                        _ => corner = 0,
                    }
                }
            }
        }
        Ok(())
    }
}

/// How the indices of a primitive form triangles, and how messages name it.
struct Shape {
    mode: Mode,
    number: usize,
    location: Location,
}

/// The vertices of a primitive at one of its places.
struct Vertices {
    /// The number of the first one in the file.
    first: u32,
    count: u64,
    /// Whether its triangles are inside out there.
    mirrored: bool,
}
