//! Results as numbers and bytes.

use lodpack::{Error, Mesh};

/// Why a call failed. The output holds the ranges to read, pairs of f64 (begin and end), or else a message in UTF-8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Bytes must be read first.
    Missing = -1,
    /// The file is damaged, or not a lodpack file.
    Format = -2,
    /// The file needs a newer reader.
    Unsupported = -3,
    /// The caller asked for something impossible.
    Query = -4,
    /// The file asks for more than the limits allow.
    Limit = -5,
    /// Anything else; JavaScript does not expect it.
    Other = -6,
}

/// The result of a call: a number, with everything else in the output.
pub type Answer = Result<u32, Error>;

/// A wrong argument.
pub fn wrong(what: &str) -> Error {
    Error::Query { what: what.into() }
}

/// Puts an error into the output. Returns its status.
pub fn refuse(output: &mut Vec<u8>, error: &Error) -> Status {
    output.clear();
    if let Error::Missing { ranges } = error {
        output.put_floats(ranges.iter().flat_map(|range| [range.start as f64, range.end as f64]));
        return Status::Missing;
    }
    output.extend(error.to_string().into_bytes());
    match error {
        Error::Format { .. } => Status::Format,
        Error::Unsupported { .. } => Status::Unsupported,
        Error::Query { .. } => Status::Query,
        Error::Limit { .. } => Status::Limit,
        _ => Status::Other,
    }
}

/// Writes numbers as JavaScript's typed arrays have them.
pub trait Put {
    /// As a Float64Array.
    fn put_floats(&mut self, values: impl IntoIterator<Item = f64>);
    /// As a Uint32Array.
    fn put_words(&mut self, values: impl IntoIterator<Item = u32>);
}

impl Put for Vec<u8> {
    fn put_floats(&mut self, values: impl IntoIterator<Item = f64>) {
        values.into_iter().for_each(|value| self.extend_from_slice(&value.to_le_bytes()));
    }

    fn put_words(&mut self, values: impl IntoIterator<Item = u32>) {
        values.into_iter().for_each(|value| self.extend_from_slice(&value.to_le_bytes()));
    }
}

/// Packs a mesh: its numbers of vertices and triangles (f64), positions (f64), triangles, and the node of each
/// triangle.
pub fn put_mesh(output: &mut Vec<u8>, mesh: &Mesh) {
    output.put_floats([mesh.positions.len() as f64, mesh.triangles.len() as f64]);
    put_all(output, &mesh.positions, |place: &mut [u8; 24], position| {
        let (coordinates, _) = place.as_chunks_mut::<8>();
        coordinates.iter_mut().zip(position).for_each(|(place, x)| *place = x.to_le_bytes());
    });
    put_triangles(output, &mesh.triangles);
    put_all(output, &mesh.triangle_nodes, |place: &mut [u8; 4], node| *place = node.to_le_bytes());
}

/// Packs triangles.
pub fn put_triangles(output: &mut Vec<u8>, triangles: &[[u32; 3]]) {
    put_all(output, triangles, |place: &mut [u8; 12], triangle| {
        let (corners, _) = place.as_chunks_mut::<4>();
        corners.iter_mut().zip(triangle).for_each(|(place, vertex)| *place = vertex.to_le_bytes());
    });
}

/// Packs normals.
pub fn put_normals(output: &mut Vec<u8>, normals: &[[i16; 2]]) {
    put_all(output, normals, |place: &mut [u8; 4], normal| {
        let (numbers, _) = place.as_chunks_mut::<2>();
        numbers.iter_mut().zip(normal).for_each(|(place, x)| *place = x.to_le_bytes());
    });
}

/// Packs many things of N bytes: several times faster than one after another.
pub fn put_all<T, const N: usize>(output: &mut Vec<u8>, things: &[T], put: impl Fn(&mut [u8; N], &T)) {
    let start = output.len();
    output.resize(start + N * things.len(), 0);
    let (places, _) = output.get_mut(start..).unwrap_or_default().as_chunks_mut::<N>();
    places.iter_mut().zip(things).for_each(|(place, thing)| put(place, thing));
}

/// Reads numbers that JavaScript wrote as a Float64Array.
pub fn floats(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    bytes.chunks_exact(8).filter_map(|bytes| Some(f64::from_le_bytes(bytes.try_into().ok()?)))
}

/// Reads numbers that JavaScript wrote as a Uint32Array.
pub fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
    bytes.chunks_exact(4).filter_map(|bytes| Some(u32::from_le_bytes(bytes.try_into().ok()?)))
}
