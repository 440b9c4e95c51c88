//! Where the vertices and triangles of a binary PLY file lie, so that any of them can be read without those before it.

use glam::DVec3;

use super::attributes::Columns;
use super::attributes::Shown;
use super::header::{Element, Encoding, Kind, Scalar, parse_header};
use super::values::{BinaryValues, Values};
use crate::attributes::AttributeSink;
use crate::error::{ImportError, Location, Parsed};
use crate::source::Source;

/// Records of one size behind each other.
#[derive(Clone, Copy, Debug, Default)]
struct Table {
    /// Offset of the first.
    first: usize,
    /// Bytes of each.
    stride: usize,
    count: u64,
}

/// The places of the vertices and triangles of a file.
#[derive(Clone, Copy, Debug)]
pub struct PlyPlaces {
    is_big_endian: bool,
    vertices: Table,
    /// For each axis the offset within the record of a vertex, and the type.
    axes: [(usize, Scalar); 3],
    triangles: Table,
    /// The types of the length of a list and of what is in it.
    corners: [Scalar; 2],
    /// Whether coordinates are single, little-endian and behind each other, as most programs write them.
    has_usual_axes: bool,
    /// Whether corners are little-endian numbers of 32 bits after a length of one byte, as most programs write them.
    has_usual_corners: bool,
}

impl PlyPlaces {
    /// None where the places do not follow from the header: for text, for faces that say more than their corners, and
    /// where the length of the file does not fit triangles. None as well where vertices carry something that `sink`
    /// wants, for that is not read here.
    pub fn of(source: &Source, sink: &mut AttributeSink) -> Option<Self> {
        let header = parse_header(source).ok()?;
        if header.encoding == Encoding::Ascii || !header.textures.is_empty() {
            return None;
        }
        let (mut vertices, mut triangles, mut at) = (None, None, header.body);
        for element in &header.elements {
            let is_faces = element.name == "face";
            let stride = if is_faces { stride_of_triangle(element) } else { stride_of(element) }?;
            let table = Table { first: at, stride, count: element.count };
            at = at.checked_add(usize::try_from(element.count).ok()?.checked_mul(stride)?)?;
            match element.name.as_str() {
                "vertex" => vertices = Some((table, element)),
                "face" => triangles = Some((table, element)),
                "tristrips" => return None,
                _ => {}
            }
        }
        let ((vertices, vertex), (triangles, face)) = (vertices?, triangles?);
        // Any face that is no triangle would make the file longer or shorter.
        if at != source.bytes.len() || Columns::of_vertices(vertex, Shown::None, source, sink).layout.stride > 0 {
            return None;
        }
        let Kind::List { count, item } = face.properties.first()?.kind else { return None };
        let axes = [axis(vertex, "x")?, axis(vertex, "y")?, axis(vertex, "z")?];
        let is_big_endian = header.encoding == Encoding::BigEndian;
        let first = axes[0].0;
        let has_usual_axes = !is_big_endian && axes == [0, 4, 8].map(|offset| (first + offset, Scalar::F32));
        let has_usual_corners = !is_big_endian && count == Scalar::U8 && matches!(item, Scalar::I32 | Scalar::U32);
        let corners = [count, item];
        Some(Self { is_big_endian, vertices, axes, triangles, corners, has_usual_axes, has_usual_corners })
    }

    /// The number of vertices and that of triangles.
    pub fn counts(&self) -> [u64; 2] {
        [self.vertices.count, self.triangles.count]
    }

    /// The offset of a vertex. There has to be one of that number.
    pub fn offset_of_vertex(&self, vertex: u64) -> usize {
        self.vertices.first + vertex as usize * self.vertices.stride
    }

    /// The offset of a triangle. There has to be one of that number.
    pub fn offset_of_triangle(&self, triangle: u64) -> usize {
        self.triangles.first + triangle as usize * self.triangles.stride
    }

    /// A vertex.
    #[inline]
    pub fn position(&self, source: &Source, vertex: u64) -> Parsed<DVec3> {
        let at = self.offset_of_vertex(vertex);
        if self.has_usual_axes
            && let Some(bytes) = source.bytes.get(at + self.axes[0].0..).and_then(|rest| rest.first_chunk::<12>())
        {
            return Ok(words(bytes).map(f32::from_bits).map(f64::from).into());
        }
        let mut position = DVec3::ZERO;
        for (axis, (offset, scalar)) in self.axes.into_iter().enumerate() {
            position[axis] = match self.is_big_endian {
                true => BinaryValues::<true>::new(*source, at + offset).float(scalar)?,
                false => BinaryValues::<false>::new(*source, at + offset).float(scalar)?,
            };
        }
        Ok(position)
    }

    /// The vertices of a triangle.
    #[inline]
    pub fn triangle(&self, source: &Source, triangle: u64) -> Parsed<[u32; 3]> {
        let at = self.offset_of_triangle(triangle);
        if self.has_usual_corners
            && let Some([3, rest @ ..]) = source.bytes.get(at..).and_then(|rest| rest.first_chunk::<13>())
        {
            let corners = words(rest);
            // Negative numbers are large here, so the general way below tells what is wrong with them, too.
            if corners.iter().all(|&corner| u64::from(corner) < self.vertices.count.min(1 << 31)) {
                return Ok(corners);
            }
        }
        match self.is_big_endian {
            true => self.corners(source, triangle, at, BinaryValues::<true>::new(*source, at)),
            false => self.corners(source, triangle, at, BinaryValues::<false>::new(*source, at)),
        }
    }

    #[inline]
    fn corners<V: Values>(&self, source: &Source, face: u64, at: usize, mut values: V) -> Parsed<[u32; 3]> {
        let [length, item] = self.corners;
        let corners = values.integer(length)?;
        if corners != 3 {
            let problem = format!(
                "face {face} has {corners} corners, although the file is as long as if all had three; plan it without --stages"
            );
            return Err(source.syntax(Location::Byte(at as u64), problem));
        }
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            let index = values.integer(item)?;
            if index < 0 || index as u64 >= self.vertices.count {
                let (path, location) = (source.path.to_owned(), Location::Byte(at as u64));
                let vertex_count = self.vertices.count;
                return Err(ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into());
            }
            *corner = index as u32;
        }
        Ok(triangle)
    }
}

/// Three little-endian numbers.
#[inline]
fn words(bytes: &[u8; 12]) -> [u32; 3] {
    [0, 4, 8].map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
}

/// Bytes of an item of numbers alone.
fn stride_of(element: &Element) -> Option<usize> {
    let bytes = |property: &super::header::Property| match property.kind {
        Kind::Scalar(scalar) => Some(scalar.byte_count() as usize),
        Kind::List { .. } => None,
    };
    element.properties.iter().map(bytes).sum()
}

/// Bytes of a triangle that has its corners and nothing else.
fn stride_of_triangle(element: &Element) -> Option<usize> {
    let [corners] = &element.properties[..] else { return None };
    let is_corners = ["vertex_indices", "vertex_index"].contains(&corners.name.as_str());
    match corners.kind {
        Kind::List { count, item } if is_corners => Some((count.byte_count() + 3 * item.byte_count()) as usize),
        _ => None,
    }
}

/// Where a coordinate is within a vertex.
fn axis(element: &Element, name: &str) -> Option<(usize, Scalar)> {
    let (mut at, mut found) = (0, None);
    for property in &element.properties {
        let Kind::Scalar(scalar) = property.kind else { return None };
        if property.name == name && found.replace((at, scalar)).is_some() {
            return None;
        }
        at += scalar.byte_count() as usize;
    }
    found
}
