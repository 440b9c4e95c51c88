//! ASCII PLY in ranges of its bytes, where each item has a line of its own, as nearly all programs write them.

use std::ops::Range;

use glam::DVec3;

use super::attributes::{Columns, Shown};
use super::header::{Element, Encoding, Header, Kind, parse_header};
use super::values::{AsciiValues, Values};
use super::{left_out, skip_property};
use crate::attributes::AttributeSink;
use crate::error::{ImportError, Parsed};
use crate::lines::lines_within;
use crate::source::Source;
use crate::text::{TextCounts, TextSink};

/// A file whose lines are its items.
#[derive(Debug)]
pub struct PlyLines {
    header: Header,
    /// Places of the elements among those of the header.
    vertex: usize,
    face: usize,
    /// The places of x, y and z among the properties of a vertex, and that of the corners among those of a face.
    axes: [usize; 3],
    corners: usize,
}

impl PlyLines {
    /// None for other files, and where they carry something that `sink` wants.
    pub fn of(source: &Source, sink: &mut AttributeSink) -> Option<Self> {
        let header = parse_header(source).ok()?;
        let find = |name: &str| header.elements.iter().position(|element| element.name == name);
        if header.encoding != Encoding::Ascii || !header.textures.is_empty() || find("tristrips").is_some() {
            return None;
        }
        let (vertex, face) = (find("vertex")?, find("face")?);
        let [vertices, faces] = [vertex, face].map(|element| &header.elements[element]);
        let has_channels = Columns::of_vertices(vertices, Shown::None, source, sink).layout.stride > 0
            || Columns::of_faces(faces, true, source, sink).layout.stride > 0;
        let corners =
            faces.properties.iter().position(|p| ["vertex_indices", "vertex_index"].contains(&p.name.as_str()));
        let corners = corners.filter(|&at| matches!(faces.properties[at].kind, Kind::List { .. }))?;
        let axes = [axis(vertices, "x")?, axis(vertices, "y")?, axis(vertices, "z")?];
        (!has_channels).then_some(Self { vertex, face, axes, corners, header })
    }

    /// Counts the lines of the body that begin in a range.
    pub fn count_in_range(&self, source: &Source, range: Range<usize>) -> TextCounts {
        let lines = lines_within(source.bytes, self.within_body(range));
        TextCounts { lines: lines.inspect(|(at, _)| source.passed(*at)).count() as u64, vertices: 0 }
    }

    /// Reads what begins in a range. `before` counts what precedes it, and `all` what the file has.
    pub fn read_range(
        &self,
        source: &Source,
        range: Range<usize>,
        before: TextCounts,
        all: TextCounts,
        sink: &mut TextSink,
    ) -> Parsed<()> {
        let announced = self.elements().fold(0, |sum: u64, (_, element)| sum.saturating_add(element.count));
        if announced > all.lines {
            let missing = format!(
                "the header announces {announced} items, but {} lines follow; if several items share a line, plan it without --stages",
                all.lines
            );
            return Err(source.truncated(source.line(self.header.body), missing));
        }
        let lines = lines_within(source.bytes, self.within_body(range));
        for (number, (at, line)) in (before.lines..announced).zip(lines) {
            source.passed(at);
            let (place, item) = self.element_of(number);
            let element = &self.header.elements[place];
            let mut values = AsciiValues::new(source.until(at + line.len()), at);
            let read = match place {
                _ if place == self.vertex => self.read_vertex(source, element, item, &mut values, sink),
                _ if place == self.face => self.read_face(source, element, item, &mut values, sink),
                _ => element.properties.iter().try_for_each(|property| skip_property(property.kind, &mut values)),
            };
            read.and_then(|()| values.end_item()).map_err(|error| match *error {
                ImportError::Truncated { location, .. } => source.syntax(
                    location,
                    "this line has fewer numbers than the header announces; if items span lines, plan it without --stages",
                ),
                _ => error,
            })?;
        }
        if before.lines < self.header.elements[self.vertex].count {
            left_out(&self.header.elements[self.vertex], |_| false, |what| sink.leave_out(what));
        }
        Ok(())
    }

    fn read_vertex(
        &self,
        source: &Source,
        element: &Element,
        vertex: u64,
        values: &mut AsciiValues,
        sink: &mut TextSink,
    ) -> Parsed<()> {
        let (start, mut position) = (values.offset(), DVec3::ZERO);
        for (at, property) in element.properties.iter().enumerate() {
            match (property.kind, self.axes.iter().position(|&axis| axis == at)) {
                (Kind::Scalar(scalar), Some(axis)) => position[axis] = values.float(scalar)?,
                (kind, _) => skip_property(kind, values)?,
            }
        }
        if !position.is_finite() {
            return Err(source.coordinate(values.location(start), vertex, position));
        }
        sink.push_vertex(position)
    }

    fn read_face(
        &self,
        source: &Source,
        element: &Element,
        face: u64,
        values: &mut AsciiValues,
        sink: &mut TextSink,
    ) -> Parsed<()> {
        let start = values.offset();
        let vertex_count = self.header.elements[self.vertex].count;
        let mut polygon = sink.take_polygon();
        for (at, property) in element.properties.iter().enumerate() {
            let Kind::List { count, item } = property.kind else {
                skip_property(property.kind, values)?;
                continue;
            };
            let length = values.list_length(count)?;
            if at != self.corners {
                values.skip(item, length)?;
                continue;
            }
            for _ in 0..length {
                let index = values.integer(item)?;
                if index < 0 || index as u64 >= vertex_count {
                    let (path, location) = (source.path.to_owned(), values.location(start));
                    return Err(
                        ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into()
                    );
                }
                polygon.push(index as u32);
            }
        }
        let pushed = sink.push_face(&polygon, false);
        sink.put_back(polygon);
        pushed
    }

    /// The elements that have lines, with their places.
    fn elements(&self) -> impl Iterator<Item = (usize, &Element)> {
        self.header.elements.iter().enumerate().filter(|(_, element)| !element.properties.is_empty())
    }

    /// The place of the element to which a line belongs, and its number there.
    fn element_of(&self, line: u64) -> (usize, u64) {
        let mut first = 0;
        for (place, element) in self.elements() {
            if line - first < element.count {
                return (place, line - first);
            }
            first += element.count;
        }
        // Lines beyond what the header announces are not asked for.
        (self.face, 0)
    }

    fn within_body(&self, range: Range<usize>) -> Range<usize> {
        range.start.max(self.header.body)..range.end.max(self.header.body)
    }
}

/// The place of a coordinate among the properties of a vertex.
fn axis(element: &Element, name: &str) -> Option<usize> {
    let mut places = (0..element.properties.len()).filter(|&at| element.properties[at].name == name);
    let place = places.next().filter(|&at| matches!(element.properties[at].kind, Kind::Scalar(_)));
    place.filter(|_| places.next().is_none())
}
