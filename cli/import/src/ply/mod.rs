//! PLY (Turk 1994; <http://paulbourke.net/dataformats/ply/>): ASCII, and binary in both byte orders, with any scalar
//! types and any order of properties and elements. It reads `vertex` (x, y, z), `face` (`vertex_indices` or
//! `vertex_index`) and `tristrips`; colours, texture coordinates and other numbers of vertices and faces where channels
//! are wanted ([`attributes`]); and skips everything else.

mod attributes;
mod face;
mod header;
mod lines;
mod places;
mod textures;
mod values;

use std::path::PathBuf;

use glam::DVec3;

use self::attributes::{Columns, Shown, Target};
use self::face::FaceCorners;
use self::header::{Element, Encoding, Header, Kind};
pub(super) use self::lines::PlyLines;
pub(super) use self::places::PlyPlaces;
use self::textures::Textures;
use self::values::{AsciiValues, BinaryValues, Values};
use super::beside::Beside;
use super::error::{ImportError, Location, Parsed};
use super::polygon::Triangulator;
use super::sink::MeshSink;
use super::source::Source;

pub(super) fn read_ply(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let header = header::parse_header(source)?;
    match header.encoding {
        Encoding::Ascii => read_body(source, &header, AsciiValues::new(*source, header.body), sink),
        Encoding::LittleEndian => read_body(source, &header, BinaryValues::<false>::new(*source, header.body), sink),
        Encoding::BigEndian => read_body(source, &header, BinaryValues::<true>::new(*source, header.body), sink),
    }
}

/// The images that a file names.
pub(super) fn files_beside(source: &Source) -> Vec<PathBuf> {
    let textures = header::parse_header(source).map_or_else(|_| vec![], |header| header.textures);
    let named = textures.iter().filter(|name| !name.is_empty());
    named.filter_map(|name| Beside::new(source).find("image", name)).collect()
}

fn read_body<V: Values>(source: &Source, header: &Header, mut values: V, sink: &mut MeshSink) -> Parsed<()> {
    let textures = Textures::add(header, source, &mut sink.attributes)?;
    let mut faces = Triangulator::default();
    let (mut vertices_read, mut others) = (false, vec![]);
    // Faces that precede the vertices are read after them, because polygons need positions.
    let mut postponed: Vec<(&Element, V)> = Vec::new();
    for element in &header.elements {
        values.check_room(element)?;
        match element.name.as_str() {
            "vertex" => {
                read_vertices(source, element, textures.shown, &mut values, sink)?;
                vertices_read = true;
            }
            "face" | "tristrips" if vertices_read => {
                read_faces(source, element, &textures, &mut values, sink, &mut faces)?
            }
            "face" | "tristrips" => {
                postponed.push((element, values.clone()));
                skip_element(source, element, &mut values)?;
            }
            _ => {
                if element.count > 0 {
                    others.push(element.name.as_str());
                }
                skip_element(source, element, &mut values)?;
            }
        }
    }
    if !others.is_empty() {
        source.note(&format!("elements that are no surface are left out: {}", others.join(", ")));
    }
    for (element, mut values) in postponed {
        read_faces(source, element, &textures, &mut values, sink, &mut faces)?;
    }
    values.finish();
    faces.note(source);
    Ok(())
}

fn skip_element<V: Values>(source: &Source, element: &Element, values: &mut V) -> Parsed<()> {
    // An element without properties has no bytes, whatever its count.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        source.passed(values.offset());
        for property in &element.properties {
            skip_property(property.kind, values)?;
        }
        values.end_item()?;
    }
    Ok(())
}

fn skip_property<V: Values>(kind: Kind, values: &mut V) -> Parsed<()> {
    match kind {
        Kind::Scalar(scalar) => values.skip(scalar, 1),
        Kind::List { count, item } => {
            let count = values.list_length(count)?;
            values.skip(item, count)
        }
    }
}

fn read_vertices<V: Values>(
    source: &Source,
    element: &Element,
    textures: Shown,
    values: &mut V,
    sink: &mut MeshSink,
) -> Parsed<()> {
    let line = Location::Line(element.line);
    for axis in ["x", "y", "z"] {
        match element.properties.iter().filter(|p| p.name == axis).map(|p| p.kind).collect::<Vec<_>>()[..] {
            [Kind::Scalar(_)] => {}
            [] => {
                return Err(
                    source.syntax(line, format!("vertices have no property \"{axis}\"; export positions as x, y, z"))
                );
            }
            _ => return Err(source.syntax(line, format!("vertices need exactly one number as property \"{axis}\""))),
        }
    }
    let mut columns = Columns::of_vertices(element, textures, source, &mut sink.attributes);
    let is_kept = |name: &str| {
        element.properties.iter().zip(&columns.targets).any(|(p, target)| p.name == name && *target != Target::Skip)
    };
    left_out(element, is_kept, |what| sink.leave_out(what));
    columns.look_at_colours(element, source, values.clone())?;
    let has_record = columns.layout.stride > 0;
    if has_record {
        sink.set_vertex_layout(columns.layout.clone());
    }
    // `check_room` has compared the count with the bytes left.
    sink.reserve(element.count as usize, 0)?;
    for vertex in 0..element.count {
        let start = values.offset();
        source.passed(start);
        let mut position = [0.0; 3];
        for (at, property) in element.properties.iter().enumerate() {
            match (property.kind, columns.targets[at]) {
                (Kind::Scalar(scalar), Target::Axis(axis)) => position[axis] = values.float(scalar)?,
                (kind, Target::Skip) => skip_property(kind, values)?,
                (Kind::Scalar(scalar), target) => columns.read(target, scalar, values)?,
                (kind, _) => skip_property(kind, values)?,
            }
        }
        values.end_item()?;
        let position = DVec3::from_array(position);
        if !position.is_finite() {
            return Err(source.coordinate(values.location(start), vertex, position));
        }
        if has_record {
            sink.attributes.push_vertex(columns.record());
        }
        sink.push_vertex(position)?;
    }
    columns.note(source);
    Ok(())
}

/// What vertices have beside their positions and is not kept.
fn left_out(element: &Element, is_kept: impl Fn(&str) -> bool, mut leave_out: impl FnMut(&'static str)) {
    for property in &element.properties {
        match property.name.as_str() {
            name if is_kept(name) => {}
            "nx" | "ny" | "nz" => leave_out("normals"),
            "s" | "t" | "u" | "v" | "texture_u" | "texture_v" => leave_out("texture coordinates"),
            "red" | "green" | "blue" | "diffuse_red" | "diffuse_green" | "diffuse_blue" => leave_out("colours"),
            _ => {}
        }
    }
}

fn read_faces<V: Values>(
    source: &Source,
    element: &Element,
    textures: &Textures,
    values: &mut V,
    sink: &mut MeshSink,
    faces: &mut Triangulator,
) -> Parsed<()> {
    if element.count == 0 {
        return Ok(());
    }
    let strips = element.name == "tristrips";
    let indices = element.properties.iter().position(|p| p.name == "vertex_indices" || p.name == "vertex_index");
    let Some(indices) = indices.filter(|&i| matches!(element.properties[i].kind, Kind::List { .. })) else {
        let problem = format!("\"{}\" has no list \"vertex_indices\"; export faces as such lists", element.name);
        return Err(source.syntax(Location::Line(element.line), problem));
    };
    let vertex_count = sink.vertex_count();
    let mut corners = FaceCorners::new(source, element, textures, strips, sink)?;
    if let Some(corners) = &mut corners {
        corners.look_ahead(element, source, values.clone())?;
    }
    sink.reserve(0, values.likely_triangle_count(element))?;
    let (mut polygon, mut strip) = (vec![], vec![]);
    for face in 0..element.count {
        let start = values.offset();
        source.passed(start);
        for (i, property) in element.properties.iter().enumerate() {
            let (Kind::List { count, item }, true) = (property.kind, i == indices) else {
                match corners.as_mut() {
                    Some(corners) => corners.read(i, property.kind, values)?,
                    None => skip_property(property.kind, values)?,
                }
                continue;
            };
            polygon.clear();
            for _ in 0..values.list_length(count)? {
                let index = values.integer(item)?;
                if index >= 0 && (index as u64) < vertex_count {
                    polygon.push(index as u32);
                } else if index == -1 && strips {
                    push_strip(&polygon, &mut strip);
                    polygon.clear();
                } else {
                    let path = source.path.to_owned();
                    let location = values.location(start);
                    return Err(
                        ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into()
                    );
                }
            }
            if strips {
                push_strip(&polygon, &mut strip);
                strip.drain(..).try_for_each(|triangle| sink.push_triangle(triangle))?;
            }
        }
        values.end_item()?;
        match corners.as_mut() {
            _ if strips => {}
            Some(corners) => corners.push(&polygon, sink, faces)?,
            None => sink.push_polygon(&polygon, faces)?,
        }
    }
    corners.into_iter().for_each(|corners| corners.note(source));
    Ok(())
}

/// Adds the triangles of a strip. Repeated vertices only join strips and have no surface.
fn push_strip(strip: &[u32], triangles: &mut Vec<[u32; 3]>) {
    for (i, t) in strip.windows(3).enumerate() {
        if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
            triangles.push(if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] });
        }
    }
}

#[cfg(test)]
mod tests;
