//! Vertex colours and texture coordinates of primitives.

use glam::{DMat3, DMat4, DVec3};

use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Document, Primitive, Semantic};

use super::accessor::{read_colours, read_normals, read_tangents, read_uvs};
use super::buffers::Buffers;
use super::materials::Materials;
use super::smooth::are_smooth;
use crate::import::error::Parsed;
use crate::import::sink::MeshSink;
use crate::import::source::Source;
use crate::import::textures::Causes;
use crate::mesh::appearance::{COLOUR, NORMAL};
use crate::mesh::attributes::AttributeLayout;
use crate::mesh::smooth::COMPUTED;

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
        sink: &mut MeshSink,
    ) -> Parsed<Self> {
        let materials = Materials::read(source, document, buffers, &mut sink.attributes)?;
        note_missing_coordinates(source, document, &materials);
        let primitives = || {
            let all = document.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>());
            all.filter(is_surface)
        };
        let mut layout = AttributeLayout::default();
        let has_colours = primitives().any(|primitive| primitive.get(&Semantic::Colors(0)).is_some());
        if has_colours && sink.attributes.finds(COLOUR, "vertex colours") {
            layout.add_colour();
        }
        let is_plain = |primitive: &Primitive| primitive.material().index().is_none();
        if primitives().any(|primitive| !is_plain(&primitive)) {
            let what = if materials.uv_sets.is_empty() { "materials" } else { "textures" };
            sink.attributes.finds(COLOUR, what);
        }
        let normals = || primitives().filter_map(|primitive| primitive.get(&Semantic::Normals));
        let has_normals = normals().next().is_some();
        // What was computed from triangles can be again, and says nothing that is worth a note.
        let are_given = normals().any(|accessor| accessor.name() != Some(COMPUTED));
        let is_smooth = are_given && sink.attributes.wants_normals(true) && are_smooth(source, buffers, primitives());
        // A map of normals is relative to those of vertices.
        if has_normals && sink.attributes.wants_normals(materials.has_normals() || is_smooth) {
            if is_smooth {
                sink.attributes.keep_smooth_normals();
            }
            sink.attributes.finds(NORMAL, "normals");
            layout.add_normal();
            // They belong to normals, and count only there (glTF 2.0, section 3.7.2.1).
            let uses_tangents = |primitive: &Primitive| tangents_of(primitive, &materials).is_some();
            if primitives().any(|primitive| uses_tangents(&primitive)) {
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
        self.materials.number_of(&primitive.material())
    }

    /// The records of a primitive's vertices; none if the document has no records. Attributes that cannot be read are left out with a
    /// note, because the surface is there without them.
    pub(super) fn of_primitive<'b>(
        &self,
        source: &Source,
        buffers: &'b Buffers<'b>,
        primitive: &Primitive,
        transform: DMat4,
    ) -> Option<PrimitiveRecords<'b>> {
        if self.layout.stride == 0 {
            return None;
        }
        let (blank, count) =
            (self.layout.blank(), primitive.get(&Semantic::Positions).map_or(0, |accessor| accessor.count()));
        let fits = |accessor: &Accessor| {
            if accessor.count() != count {
                source.note(&format!(
                    "accessor {} has {} values for {count} vertices: it was left out",
                    accessor.index(),
                    accessor.count()
                ));
            }
            accessor.count() == count
        };
        let colours = self.layout.colour.and_then(|place| {
            let accessor = primitive.get(&Semantic::Colors(0)).filter(fits)?;
            let colours = sound(source, read_colours(source, buffers, &accessor))?;
            Some((place, Box::new(colours) as Colours<'b>))
        });
        let normals = self.layout.normal.and_then(|place| {
            let accessor = primitive.get(&Semantic::Normals).filter(fits)?;
            let normals = sound(source, read_normals(source, buffers, &accessor))?;
            Some((place, Box::new(normals) as Directions<'b>))
        });
        let tangents = self.layout.tangent.and_then(|place| {
            let accessor = tangents_of(primitive, &self.materials).filter(fits)?;
            let tangents = sound(source, read_tangents(source, buffers, &accessor))?;
            Some((place, Box::new(tangents) as Tangents<'b>))
        });
        let sets = self.materials.uv_sets.iter().zip(&self.layout.uv).filter_map(|(&set, &place)| {
            let accessor = primitive.get(&Semantic::TexCoords(set)).filter(fits)?;
            let uvs = sound(source, read_uvs(source, buffers, &accessor))?;
            Some((place, Box::new(uvs) as Coordinates<'b>))
        });
        // Normals turn with the cofactors of the matrix, and stay on their side where it mirrors.
        let [x, y, z] = [transform.x_axis, transform.y_axis, transform.z_axis].map(|axis| axis.truncate());
        let side = x.cross(y).dot(z).signum();
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * side;
        let turn = Turn { cofactors, matrix: DMat3::from_cols(x, y, z), side };
        let sets = sets.collect();
        Some(PrimitiveRecords { sets, colours, normals, tangents, turn, record: blank, clamped_count: 0 })
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(self.clamped_count, "vertices have colours outside of 0 to 1: they were clamped");
    }
}

/// The tangents of a primitive whose material has an image of normals, which are relative to them.
fn tangents_of<'a>(primitive: &Primitive<'a>, materials: &Materials) -> Option<Accessor<'a>> {
    primitive.get(&Semantic::Normals)?;
    primitive.get(&Semantic::Tangents).filter(|_| materials.has_normals_of(&primitive.material()))
}

/// Whether a primitive has triangles.
pub(super) fn is_surface(primitive: &Primitive) -> bool {
    matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
}

/// Notes primitives that do not say where the textures of their materials are.
fn note_missing_coordinates(source: &Source, document: &Document, materials: &Materials) {
    let mut causes = Causes::default();
    for mesh in document.meshes() {
        for primitive in mesh.primitives().filter(is_surface) {
            let is_missing = |set: &u32| primitive.get(&Semantic::TexCoords(*set)).is_none();
            for set in materials.sets_needed_by(&primitive.material()).filter(is_missing) {
                let name = format!("primitive {} of mesh {}", primitive.index(), mesh.index());
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
struct Turn {
    /// Of normals.
    cofactors: DMat3,
    /// Of tangents.
    matrix: DMat3,
    /// -1 where it mirrors: then what was on the left of a tangent is on its right.
    side: f64,
}

/// The records of a primitive's vertices, one after the other.
pub(super) struct PrimitiveRecords<'b> {
    colours: Option<(usize, Colours<'b>)>,
    normals: Option<(usize, Directions<'b>)>,
    tangents: Option<(usize, Tangents<'b>)>,
    turn: Turn,
    sets: Vec<(usize, Coordinates<'b>)>,
    record: Vec<f32>,
    pub(super) clamped_count: u64,
}

impl PrimitiveRecords<'_> {
    /// The record of the next vertex.
    #[inline]
    pub(super) fn next(&mut self) -> &[f32] {
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
            let normal = (self.turn.cofactors * DVec3::from(normal.map(f64::from))).normalize_or(DVec3::NAN);
            self.record[*place..*place + 3].copy_from_slice(&normal.as_vec3().to_array());
        }
        if let Some((place, tangents)) = &mut self.tangents
            && let Some([x, y, z, side]) = tangents.next()
        {
            let tangent = self.turn.matrix * DVec3::from([x, y, z].map(f64::from));
            let [x, y, z] = tangent.normalize_or(DVec3::NAN).as_vec3().to_array();
            self.record[*place..*place + 4].copy_from_slice(&[x, y, z, side * self.turn.side as f32]);
        }
        for (place, uvs) in &mut self.sets {
            let uv = uvs.next().filter(|uv| uv.iter().all(|value| value.is_finite()));
            self.record[*place..*place + 2].copy_from_slice(&uv.unwrap_or([f32::NAN; 2]));
        }
        &self.record
    }
}
