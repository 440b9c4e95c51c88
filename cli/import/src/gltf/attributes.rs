//! Vertex colours and texture coordinates of primitives.

use glam::{DMat3, DMat4, DVec3};

use super::accessor::{Array, read_colours, read_normals, read_tangents, read_uvs};
use super::arrays::Arrays;
use super::buffers::Buffers;
use super::document::{Document, Mode, Primitive, Semantic};
use super::draco::DracoDecoder;
use super::materials::Materials;
use super::smooth::are_smooth;
use crate::error::Parsed;
use crate::sink::MeshSink;
use crate::source::Source;
use crate::textures::Causes;
use lodpack_mesh::appearance::{COLOUR, NORMAL};
use lodpack_mesh::attributes::AttributeLayout;

/// What the vertices of a document carry, in one layout for all of its primitives.
#[derive(Default)]
pub(super) struct SceneAttributes {
    layout: AttributeLayout,
    materials: Materials,
    /// Colours of vertices that were outside of 0 to 1.
    pub(super) clamped_count: u64,
}

impl SceneAttributes {
    /// Finds out what is there, before the first vertex is read.
    pub(super) fn of_document(
        source: &Source,
        document: &Document,
        buffers: &Buffers,
        decoder: &DracoDecoder,
        sink: &mut MeshSink,
    ) -> Parsed<Self> {
        let materials = Materials::read(source, document, buffers, &mut sink.attributes)?;
        note_missing_coordinates(source, document, &materials);
        let primitives = || document.meshes.iter().flat_map(|mesh| &mesh.primitives).filter(|of| of.mode().is_some());
        let mut layout = AttributeLayout::default();
        let has_colours = primitives().any(|primitive| primitive.attributes.get(Semantic::Colour(0)).is_some());
        if has_colours && sink.attributes.finds(COLOUR, "vertex colours") {
            layout.add_colour();
        }
        if primitives().any(|primitive| primitive.material.is_some()) {
            let what = if materials.uv_sets.is_empty() { "materials" } else { "textures" };
            sink.attributes.finds(COLOUR, what);
        }
        let array = |accessor: usize| Array::find(document, buffers, accessor);
        let normals = || primitives().filter_map(|primitive| array(primitive.attributes.get(Semantic::Normal)?));
        let has_normals = normals().next().is_some();
        // What was computed from triangles can be again, and says nothing that is worth a note.
        let are_given = normals().any(|array| !array.is_computed());
        let is_smooth = are_given && sink.attributes.wants_normals(true) && {
            let numbered = document.meshes.iter().enumerate().flat_map(|(mesh, of)| {
                of.primitives.iter().enumerate().map(move |(number, primitive)| ([mesh, number], primitive))
            });
            let lit = numbered
                .filter(|(_, primitive)| primitive.mode() == Some(Mode::Triangles) && !is_unlit(document, primitive));
            let counted = lit.filter_map(|(numbers, primitive)| {
                let stated = array(primitive.attributes.get(Semantic::Position)?)?.count();
                let read = move || {
                    let decoded = decoder.decode(source, document, buffers, numbers, primitive).ok()?;
                    Some(Arrays::new(document, buffers, primitive, decoded))
                };
                Some((stated, read))
            });
            are_smooth(source, counted)
        };
        // A map of normals is relative to those of vertices.
        if has_normals && sink.attributes.wants_normals(materials.has_normals() || is_smooth) {
            if is_smooth {
                sink.attributes.keep_smooth_normals();
            }
            sink.attributes.finds(NORMAL, "normals");
            layout.add_normal();
            // They belong to normals, and count only there (glTF 2.0, section 3.7.2.1).
            if primitives().any(|primitive| has_tangents(primitive, &materials)) {
                layout.add_tangent();
            }
        } else if are_given {
            sink.leave_out("normals");
        }
        layout.add_uv(materials.uv_sets.len());
        if layout.stride > 0 {
            sink.set_vertex_layout(layout.clone());
        }
        Ok(Self { layout, materials, clamped_count: 0 })
    }

    /// Whether colours of vertices are read.
    pub(super) fn reads_colour(&self) -> bool {
        self.layout.colour.is_some()
    }

    /// Whether a set of texture coordinates is read.
    pub(super) fn reads_uv(&self, set: u32) -> bool {
        self.materials.uv_sets.contains(&set)
    }

    /// The number of a primitive's material.
    pub(super) fn material_of(&self, primitive: &Primitive) -> usize {
        self.materials.number_of(primitive.material)
    }

    /// The records of a primitive's vertices; none if the document has no records. Attributes that cannot be read are
    /// left out with a note, because the surface is there without them.
    pub(super) fn of_primitive<'b>(&self, source: &Source, arrays: &'b Arrays) -> Option<PrimitiveRecords<'b>> {
        if self.layout.stride == 0 {
            return None;
        }
        let count = arrays.get(Semantic::Position).map_or(0, |array| array.count());
        let get = |semantic: Semantic| {
            let array = arrays.get(semantic)?;
            if array.count() != count {
                let (number, values) = (array.number, array.count());
                source.note(&format!("accessor {number} has {values} values for {count} vertices: it was left out"));
            }
            (array.count() == count).then_some(array)
        };
        let colours = self.layout.colour.and_then(|place| {
            let colours = sound(source, read_colours(source, &get(Semantic::Colour(0))?))?;
            Some((place, Box::new(colours) as Colours<'b>))
        });
        let normals = self.layout.normal.and_then(|place| {
            let normals = sound(source, read_normals(source, &get(Semantic::Normal)?))?;
            Some((place, Box::new(normals) as Directions<'b>))
        });
        let tangents = self.layout.tangent.and_then(|place| {
            let array = has_tangents(arrays.primitive, &self.materials).then(|| get(Semantic::Tangent))??;
            let tangents = sound(source, read_tangents(source, &array))?;
            Some((place, Box::new(tangents) as Tangents<'b>))
        });
        let sets = self.materials.uv_sets.iter().zip(&self.layout.uv).filter_map(|(&set, &place)| {
            let uvs = sound(source, read_uvs(source, &get(Semantic::TexCoord(set))?))?;
            Some((place, Box::new(uvs) as Coordinates<'b>))
        });
        let sets = sets.collect();
        Some(PrimitiveRecords { sets, colours, normals, tangents, record: self.layout.blank(), clamped_count: 0 })
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(self.clamped_count, "vertices have colours outside of 0 to 1: they were clamped");
    }
}

/// Whether a primitive has tangents, and its material an image of normals, which are relative to them.
fn has_tangents(primitive: &Primitive, materials: &Materials) -> bool {
    let has = |semantic: Semantic| primitive.attributes.get(semantic).is_some();
    has(Semantic::Normal) && has(Semantic::Tangent) && materials.has_normals_of(primitive.material)
}

fn is_unlit(document: &Document, primitive: &Primitive) -> bool {
    let material = primitive.material.and_then(|material| document.materials.get(usize::from(material)));
    material.is_some_and(|material| material.extensions.unlit.is_some())
}

/// Notes primitives that do not say where the textures of their materials are.
fn note_missing_coordinates(source: &Source, document: &Document, materials: &Materials) {
    let mut causes = Causes::default();
    for (mesh_number, mesh) in document.meshes.iter().enumerate() {
        for (number, primitive) in mesh.primitives.iter().enumerate().filter(|(_, of)| of.mode().is_some()) {
            let is_missing = |set: &u32| primitive.attributes.get(Semantic::TexCoord(*set)).is_none();
            for set in materials.sets_needed_by(primitive.material).filter(is_missing) {
                let name = format!("primitive {number} of mesh {mesh_number}");
                causes.add(&set.to_string(), &name, |name| {
                    format!(
                        "{name} has no TEXCOORD_{set}, which a texture of its material needs: the material has its \
                         factor alone there; export it again with texture coordinates"
                    )
                });
            }
        }
    }
    causes.sentences().for_each(|sentence| source.note(&sentence));
}

/// A value, or none and a note.
fn sound<T>(source: &Source, read: Parsed<T>) -> Option<T> {
    read.inspect_err(|error| source.note(&format!("an attribute was left out: {error}"))).ok()
}

type Colours<'b> = Box<dyn Iterator<Item = [f32; 4]> + 'b>;
type Directions<'b> = Box<dyn Iterator<Item = [f32; 3]> + 'b>;
type Tangents<'b> = Box<dyn Iterator<Item = [f32; 4]> + 'b>;
type Coordinates<'b> = Box<dyn Iterator<Item = [f32; 2]> + 'b>;

/// How directions turn with a node.
pub(super) struct Turn {
    /// Of normals.
    cofactors: DMat3,
    /// Of tangents.
    matrix: DMat3,
    /// -1 where it mirrors: then what was on the left of a tangent is on its right.
    side: f64,
}

impl Turn {
    /// Normals turn with the cofactors of the matrix, and stay on their side where it mirrors.
    pub(super) fn of(transform: DMat4) -> Self {
        let [x, y, z] = [transform.x_axis, transform.y_axis, transform.z_axis].map(|axis| axis.truncate());
        let side = x.cross(y).dot(z).signum();
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * side;
        Self { cofactors, matrix: DMat3::from_cols(x, y, z), side }
    }

    pub(super) fn is_mirrored(&self) -> bool {
        self.side < 0.0
    }
}

/// The records of a primitive's vertices, one after the other.
pub(super) struct PrimitiveRecords<'b> {
    colours: Option<(usize, Colours<'b>)>,
    normals: Option<(usize, Directions<'b>)>,
    tangents: Option<(usize, Tangents<'b>)>,
    sets: Vec<(usize, Coordinates<'b>)>,
    record: Vec<f32>,
    pub(super) clamped_count: u64,
}

impl PrimitiveRecords<'_> {
    /// The record of the next vertex.
    #[inline]
    pub(super) fn next(&mut self, turn: &Turn) -> &[f32] {
        if let Some((place, colours)) = &mut self.colours
            && let Some(colour) = colours.next()
        {
            // Colours of vertices are in linear light (glTF 2.0, section 3.9.2).
            let within = colour.map(|value| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) });
            self.clamped_count += u64::from(within != colour);
            self.record[*place..*place + 4].copy_from_slice(&within);
        }
        if let Some((place, normals)) = &mut self.normals
            && let Some(normal) = normals.next()
        {
            let normal = (turn.cofactors * DVec3::from(normal.map(f64::from))).normalize_or(DVec3::NAN);
            self.record[*place..*place + 3].copy_from_slice(&normal.as_vec3().to_array());
        }
        if let Some((place, tangents)) = &mut self.tangents
            && let Some([x, y, z, side]) = tangents.next()
        {
            let tangent = turn.matrix * DVec3::from([x, y, z].map(f64::from));
            let [x, y, z] = tangent.normalize_or(DVec3::NAN).as_vec3().to_array();
            self.record[*place..*place + 4].copy_from_slice(&[x, y, z, side * turn.side as f32]);
        }
        for (place, uvs) in &mut self.sets {
            let uv = uvs.next().filter(|uv| uv.iter().all(|value| value.is_finite()));
            self.record[*place..*place + 2].copy_from_slice(&uv.unwrap_or([f32::NAN; 2]));
        }
        &self.record
    }
}
