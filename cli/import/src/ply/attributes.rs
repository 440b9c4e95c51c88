//! What PLY properties mean beside the shape: colours, texture coordinates, and numbers of any name.

use super::header::{Element, Kind, Scalar};
use super::skip_property;
use super::values::Values;
use crate::attributes::AttributeSink;
use crate::colour_numbers::{ARE_BYTES, ColourNumbers, ColourRange};
use crate::error::Parsed;
use crate::source::Source;
use lodpack_mesh::appearance::{COLOUR, NORMAL};
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::srgb::{LINEAR_OF_BYTE, linear_from_srgb};

/// How many textures of a file can be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// None, or there are none.
    None,
    /// Some: the rest of the surface shows the colours of its vertices.
    Some,
    /// All: they hide the colours of vertices.
    All,
}

/// Names of red, green, blue and alpha; alpha may be missing.
const COLOUR_NAMES: [[&str; 4]; 3] = [
    ["red", "green", "blue", "alpha"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
    ["r", "g", "b", "a"],
];
/// Names of texture coordinates.
pub(super) const UV_NAMES: [[&str; 2]; 4] =
    [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
const NORMAL_NAMES: [&str; 3] = ["nx", "ny", "nz"];
/// Names that are never scalars of their own.
const SHAPE_NAMES: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// What becomes of a property.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Target {
    /// Nothing.
    Skip,
    /// A coordinate.
    Axis(usize),
    /// A number of the record, as it is.
    Number(usize),
    /// A number of the record that the lower border of an image counts from.
    FromBelow(usize),
    /// Red, green or blue, encoded as on screens, in the record.
    Encoded(usize),
    /// Alpha in the record.
    Alpha(usize),
}

/// What becomes of all properties of an element, and the record that they make.
#[derive(Default)]
pub(super) struct Columns {
    pub(super) targets: Vec<Target>,
    pub(super) layout: AttributeLayout,
    record: Vec<f32>,
    /// Colours that were outside of 0 to 1.
    clamped: u64,
    /// Whether colours of 16 bits are numbers of 8 bits.
    has_small_words: bool,
    /// The range of colours that are floats.
    of_floats: ColourRange,
}

impl Columns {
    /// The columns of vertices, whose colours give way to textures.
    pub(super) fn of_vertices(element: &Element, textures: Shown, source: &Source, sink: &mut AttributeSink) -> Self {
        let mut columns = Self { targets: vec![Target::Skip; element.properties.len()], ..Self::default() };
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            columns.set(element, name, Target::Axis(axis));
        }
        let uv = find(element, &UV_NAMES).filter(|_| textures != Shown::None);
        if uv.is_none() || textures == Shown::Some {
            columns.add_colour(element, "vertex colours", source, sink);
        }
        if let Some([u, v]) = uv {
            columns.layout.add_uv(1);
            let place = columns.layout.uv[0];
            columns.set(element, u, Target::Number(place));
            columns.set(element, v, Target::FromBelow(place + 1));
        }
        if sink.wants_normals(false) && find(element, &[NORMAL_NAMES]).is_some() && sink.finds(NORMAL, "PLY properties")
        {
            columns.layout.add_normal();
            let place = columns.layout.normal.unwrap_or_default();
            for (axis, name) in NORMAL_NAMES.iter().enumerate() {
                columns.set(element, name, Target::Number(place + axis));
            }
        }
        columns.add_scalars(element, source, sink);
        columns.record = columns.layout.blank();
        columns
    }

    /// Adds numbers of all names that mean nothing else.
    fn add_scalars(&mut self, element: &Element, source: &Source, sink: &mut AttributeSink) {
        let known = COLOUR_NAMES.iter().flatten().chain(UV_NAMES.iter().flatten()).chain(&SHAPE_NAMES);
        let known: Vec<&str> = known.copied().collect();
        let mut taken = vec![];
        for property in element.properties.iter().filter(|property| matches!(property.kind, Kind::Scalar(_))) {
            let name = property.name.as_str();
            if !self.is_free(element, name) {
                continue;
            }
            if is_stray_colour(element, name) {
                taken.push(name);
            } else if !known.contains(&name) && sink.finds(name, "PLY property") {
                self.layout.add_scalar(name);
                self.set(element, name, Target::Number(self.layout.stride - 1));
            }
        }
        if !taken.is_empty() && sink.wants_channels() {
            let names = taken.join(", ");
            source
                .note(&format!("numbers of vertices are left out whose names stand for colours: {names}; rename them"));
        }
    }

    /// The columns of faces, which all their corners get.
    pub(super) fn of_faces(element: &Element, with_colour: bool, source: &Source, sink: &mut AttributeSink) -> Self {
        let mut columns = Self { targets: vec![Target::Skip; element.properties.len()], ..Self::default() };
        if with_colour {
            columns.add_colour(element, "face colours", source, sink);
        }
        columns.record = columns.layout.blank();
        columns
    }

    /// Whether an element has colours.
    pub(super) fn has_colour(element: &Element) -> bool {
        find(element, &COLOUR_NAMES.map(|[red, green, blue, _]| [red, green, blue])).is_some()
    }

    /// The numbers of an element that are neither its shape nor its colours.
    pub(super) fn other_numbers(element: &Element) -> Vec<&str> {
        let numbers = element.properties.iter().filter(|property| matches!(property.kind, Kind::Scalar(_)));
        let known = |name: &str| COLOUR_NAMES.iter().flatten().chain(&SHAPE_NAMES).any(|known| *known == name);
        numbers.map(|property| property.name.as_str()).filter(|name| !known(name)).collect()
    }

    fn add_colour(&mut self, element: &Element, what: &'static str, source: &Source, sink: &mut AttributeSink) {
        let is_list = |property: &super::header::Property| matches!(property.kind, Kind::List { .. });
        let lists =
            element.properties.iter().filter(|p| COLOUR_NAMES[..2].iter().flatten().any(|name| *name == p.name));
        let lists = lists.filter(|property| is_list(property)).count() as u64;
        source.note_skipped(
            if sink.wants_colour() { lists } else { 0 },
            "colour properties are lists, not numbers: ignored",
        );
        let three = COLOUR_NAMES.map(|[red, green, blue, _]| [red, green, blue]);
        let Some([red, green, blue]) = find(element, &three).filter(|_| sink.finds(COLOUR, what)) else { return };
        self.layout.add_colour();
        let place = self.layout.colour.unwrap_or_default();
        for (channel, name) in [red, green, blue].into_iter().enumerate() {
            self.set(element, name, Target::Encoded(place + channel));
        }
        let alpha = COLOUR_NAMES.iter().find(|names| names[0] == red).map_or("", |names| names[3]);
        self.set(element, alpha, Target::Alpha(place + 3));
    }

    /// Sets what becomes of the first property of a name, if it is a number.
    fn set(&mut self, element: &Element, name: &str, target: Target) {
        if let Some(at) = element.properties.iter().position(|p| p.name == name)
            && matches!(element.properties[at].kind, Kind::Scalar(_))
        {
            self.targets[at] = target;
        }
    }

    /// Whether a name is one property only, and nothing becomes of it so far.
    fn is_free(&self, element: &Element, name: &str) -> bool {
        let mut named = (0..element.properties.len()).filter(|&at| element.properties[at].name == name);
        named.next().is_some_and(|at| self.targets[at] == Target::Skip) && named.next().is_none()
    }

    /// Reads a number that belongs to the record.
    #[inline]
    pub(super) fn read<V: Values>(&mut self, target: Target, scalar: Scalar, values: &mut V) -> Parsed<()> {
        let value = values.float(scalar)?;
        match target {
            Target::Number(at) => self.record[at] = if value.is_finite() { value as f32 } else { f32::NAN },
            Target::FromBelow(at) => self.record[at] = if value.is_finite() { (1.0 - value) as f32 } else { f32::NAN },
            Target::Encoded(at) => {
                self.record[at] = match scalar {
                    Scalar::U8 => LINEAR_OF_BYTE[value.clamp(0.0, 255.0) as usize],
                    _ => linear_from_srgb(self.share(value, scalar)),
                };
            }
            Target::Alpha(at) => {
                self.record[at] = match scalar {
                    Scalar::F32 | Scalar::F64 => self.within(value / self.of_floats.alpha),
                    _ => self.share(value, scalar),
                };
            }
            Target::Skip | Target::Axis(_) => {}
        }
        Ok(())
    }

    /// A colour as a number from 0 to 1. Whole numbers go up to the largest of their type, but not beyond 255 in those
    /// of 32 bits.
    fn share(&mut self, value: f64, scalar: Scalar) -> f32 {
        let largest = match scalar {
            Scalar::F32 | Scalar::F64 => self.of_floats.colour,
            Scalar::U16 if !self.has_small_words => 65535.0,
            _ => 255.0,
        };
        self.within(value / largest)
    }

    fn within(&mut self, share: f64) -> f32 {
        let within = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
        self.clamped += u64::from(share != within);
        within as f32
    }

    /// The record, as far as it was read.
    #[inline]
    pub(super) fn record(&self) -> &[f32] {
        &self.record
    }

    /// Looks through an element whose colours have 16 bits or are floats: some programs write numbers of 8 bits there,
    /// which would all be black, or white.
    pub(super) fn look_at_colours<V: Values>(
        &mut self,
        element: &Element,
        source: &Source,
        mut values: V,
    ) -> Parsed<()> {
        let colours: Vec<(usize, usize)> = (0..element.properties.len())
            .filter(|&at| matches!(element.properties[at].kind, Kind::Scalar(Scalar::U16 | Scalar::F32 | Scalar::F64)))
            .filter_map(|at| match (self.targets[at], self.layout.colour?) {
                (Target::Encoded(place) | Target::Alpha(place), first) => Some((at, place - first)),
                _ => None,
            })
            .collect();
        let Some(&(first, _)) = colours.first() else { return Ok(()) };
        // Where types differ, nothing is guessed.
        let kind = element.properties[first].kind;
        if colours.iter().any(|(at, _)| element.properties[*at].kind != kind) {
            return Ok(());
        }
        let (mut numbers, are_words) = (ColourNumbers::default(), kind == Kind::Scalar(Scalar::U16));
        for _ in 0..element.count {
            source.passed(values.offset());
            let mut colour = [0.0; 4];
            for (at, property) in element.properties.iter().enumerate() {
                match (property.kind, colours.iter().find(|(colour, _)| *colour == at)) {
                    (Kind::Scalar(scalar), Some((_, place))) => colour[*place] = values.float(scalar)?,
                    (kind, _) => skip_property(kind, &mut values)?,
                }
            }
            values.end_item()?;
            numbers.add(&colour);
            if numbers.are_shares() {
                return Ok(());
            }
        }
        if are_words {
            self.has_small_words = numbers.largest() > 0.0;
        } else {
            self.of_floats = numbers.range();
        }
        if self.has_small_words {
            source.note("colours have 16 bits, but no number is above 255: they are read as numbers of 8 bits");
        } else if self.of_floats.are_bytes() {
            source.note(ARE_BYTES);
        }
        Ok(())
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(
            self.clamped,
            "values of colours are outside of 0 to 1 (floats) or of their type's range: they were clamped; divide floats by 255 if \
             that is the largest",
        );
    }
}

/// Whether a name stands for a colour, or for a part of one whose other parts are not there.
fn is_stray_colour(element: &Element, name: &str) -> bool {
    let mut sets = COLOUR_NAMES.iter().filter(|names| names.contains(&name)).peekable();
    let is_part = sets.peek().is_some();
    let is_whole = sets.any(|&[red, green, blue, _]| find(element, &[[red, green, blue]]).is_some());
    [COLOUR, "color"].contains(&name) || is_part && !is_whole
}

/// The first set of names that are all numbers of the element.
pub(super) fn find<const N: usize>(element: &Element, sets: &[[&'static str; N]]) -> Option<[&'static str; N]> {
    let has = |name: &&str| element.properties.iter().any(|p| p.name == **name && matches!(p.kind, Kind::Scalar(_)));
    sets.iter().find(|names| names.iter().all(has)).copied()
}
