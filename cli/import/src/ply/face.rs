//! What PLY faces say of their corners: texture coordinates and the number of a texture, as MeshLab writes them, and
//! face colours.

use std::ops::Range;

use super::attributes::{Columns, Target};
use super::header::{Element, Kind, Scalar};
use super::skip_property;
use super::textures::Textures;
use super::values::Values;
use crate::attributes::AttributeSink;
use crate::error::Parsed;
use crate::polygon::Triangulator;
use crate::sink::MeshSink;
use crate::source::Source;

/// The longest list of texture coordinates that is kept; polygons with more corners have none.
const MAX_COORDINATES: u64 = 1 << 16;

/// The records of the corners of the face that is being read.
pub(super) struct FaceCorners {
    columns: Columns,
    /// The property with the coordinates of all corners, and their place in the record.
    coordinates: Option<(usize, usize)>,
    /// The property with the number of the texture.
    number: Option<usize>,
    textures: Range<usize>,
    /// The texture of this face, and its coordinates.
    texture: i64,
    uv: Vec<f32>,
    records: Vec<f32>,
    /// Faces whose coordinates or texture do not fit.
    misfits: u64,
}

impl FaceCorners {
    /// None where faces say nothing of their corners that is wanted. Otherwise corners get records from here on.
    pub(super) fn new(
        source: &Source,
        element: &Element,
        textures: &Textures,
        strips: bool,
        sink: &mut MeshSink,
    ) -> Parsed<Option<Self>> {
        let position = |name: &str| element.properties.iter().position(|property| property.name == name);
        let is_list = |at: &usize| matches!(element.properties[*at].kind, Kind::List { .. });
        let textures = textures.numbers.clone();
        let coordinates = position("texcoord").filter(|at| !textures.is_empty() && is_list(at));
        let number = position("texnumber").filter(|at| !textures.is_empty() && !is_list(at));
        if !textures.is_empty() {
            sink.set_material(textures.start);
        }
        // Colours of vertices say more, and textures most.
        let with_colour = !strips && textures.is_empty() && !sink.attributes.has_vertex_colour();
        note_left_out(source, element, with_colour, &sink.attributes);
        let mut columns = Columns::of_faces(element, with_colour, source, &mut sink.attributes);
        let coordinates = coordinates.filter(|_| !strips).map(|at| {
            columns.layout.add_uv(1);
            (at, columns.layout.uv[0])
        });
        if columns.layout.stride == 0 && number.is_none() {
            return Ok(None);
        }
        if columns.layout.stride > 0 {
            sink.set_corner_layout(columns.layout.clone());
        }
        let (uv, records, texture) = (vec![], vec![], 0);
        Ok(Some(Self { columns, coordinates, number, textures, texture, uv, records, misfits: 0 }))
    }

    /// Looks through the faces for what has to be known of all colours.
    pub(super) fn look_ahead<V: Values>(&mut self, element: &Element, source: &Source, values: V) -> Parsed<()> {
        self.columns.look_at_colours(element, source, values)
    }

    /// Reads a property that is not the list of vertices.
    pub(super) fn read<V: Values>(&mut self, at: usize, kind: Kind, values: &mut V) -> Parsed<()> {
        match (kind, self.coordinates, self.number) {
            (Kind::List { count, item }, Some((coordinates, _)), _) if at == coordinates => {
                let length = values.list_length(count)?;
                self.uv.clear();
                if length > MAX_COORDINATES {
                    return values.skip(item, length);
                }
                for _ in 0..length {
                    self.uv.push(values.float(item)? as f32);
                }
                Ok(())
            }
            (Kind::Scalar(scalar), _, Some(number)) if at == number => {
                self.texture = match scalar {
                    Scalar::F32 | Scalar::F64 => values.float(scalar)? as i64,
                    _ => values.integer(scalar)?,
                };
                Ok(())
            }
            (Kind::Scalar(scalar), ..) if self.columns.targets[at] != Target::Skip => {
                self.columns.read(self.columns.targets[at], scalar, values)
            }
            _ => skip_property(kind, values),
        }
    }

    /// Adds the face, all of whose properties have been read.
    pub(super) fn push(&mut self, polygon: &[u32], sink: &mut MeshSink, faces: &mut Triangulator) -> Parsed<()> {
        let mut has_texture = true;
        if self.number.is_some() {
            // MeshLab writes -1 for a face without a texture.
            let number = usize::try_from(self.texture).ok().map(|number| self.textures.start + number);
            let known = number.filter(|number| self.textures.contains(number));
            self.misfits += u64::from(number.is_some() && known.is_none());
            sink.set_material(known.unwrap_or(0));
            has_texture = known.is_some();
        }
        let mut record = self.columns.record().to_vec();
        record.resize(self.columns.layout.stride, f32::NAN);
        let has_coordinates = self.uv.len() == 2 * polygon.len();
        self.misfits += u64::from(self.coordinates.is_some() && has_texture && !has_coordinates);
        self.records.clear();
        for corner in 0..polygon.len() {
            if let Some((_, place)) = self.coordinates {
                let uv = if has_coordinates { [self.uv[2 * corner], self.uv[2 * corner + 1]] } else { [f32::NAN; 2] };
                let is_finite = uv[0].is_finite() && uv[1].is_finite();
                // Rows of images count from above.
                (record[place], record[place + 1]) =
                    if is_finite { (uv[0], 1.0 - uv[1]) } else { (f32::NAN, f32::NAN) };
            }
            self.records.extend_from_slice(&record);
        }
        self.uv.clear();
        sink.push_polygon_with(polygon, &self.records, faces)
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        self.columns.note(source);
        source.note_skipped(
            self.misfits,
            "faces have texture coordinates or texture numbers that do not fit: no texture",
        );
    }
}

/// Numbers of faces that nobody misses: bits of programs, and what textures use.
const UNSAID: [&str; 2] = ["flags", "texnumber"];

/// Notes what faces have and is not kept.
fn note_left_out(source: &Source, element: &Element, with_colour: bool, sink: &AttributeSink) {
    if sink.wants_colour() && !with_colour && Columns::has_colour(element) {
        source.note("colours of faces are left out: those of vertices or textures are kept in their place");
    }
    let mut numbers = Columns::other_numbers(element);
    numbers.retain(|name| !UNSAID.contains(name));
    if sink.wants_channels() && !numbers.is_empty() {
        let names = numbers.join(", ");
        source.note(&format!("numbers of faces are left out: {names}; write them as numbers of vertices to keep them"));
    }
}
