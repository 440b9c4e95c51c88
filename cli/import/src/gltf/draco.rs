//! Primitives that are compressed by Draco (`KHR_draco_mesh_compression`), decoded by the crate `draco-core`.
//!
//! The crate bounds what a stream can claim by its bytes, and takes limits beside. Whatever it does, a stream that it
//! cannot decode is an error of the file: a panic within it is caught.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use draco_core::{DecodeLimits, DecoderBuffer, ErrorKind, MeshDecoder, PointAttribute, PointIndex};

use super::accessor::{DataType, Decoded};
use super::buffers::Buffers;
use super::document::{Accessor, Document, Draco, Primitive, Semantic};
use crate::MAX_TRIANGLES;
use crate::error::{Location, Parsed};
use crate::source::Source;

/// What a primitive has once it is decoded.
pub(super) struct DecodedPrimitive {
    /// By the number of their accessor.
    values: Vec<(usize, Decoded)>,
    /// Three for each triangle, whatever the primitive's mode is.
    pub(super) indices: Vec<u32>,
}

impl DecodedPrimitive {
    pub(super) fn values(&self, accessor: usize) -> Option<&Decoded> {
        self.values.iter().find(|(number, _)| *number == accessor).map(|(_, values)| values)
    }

    fn bytes(&self) -> usize {
        self.values.iter().map(|(_, values)| values.bytes.len()).sum::<usize>() + size_of_val(&self.indices[..])
    }
}

/// Decoded primitives are kept as long as they take no more bytes together, because many nodes may name one.
const KEPT_BYTES: usize = 64 << 20;
/// Bytes that decoding may use in any case.
const LEAST_MEMORY: u64 = 16 << 20;
/// What is wrong with a primitive that would take more.
const TOO_LARGE: &str = "it is too large for the memory that is allowed; allow more, or convert it to PLY";
/// Bytes that decoding takes for each triangle, with the table of its neighbours.
const TRIANGLE_BYTES: u64 = 128;

/// Decodes primitives, and remembers some.
pub(super) struct DracoDecoder {
    memory: u64,
    kept: RefCell<HashMap<(usize, usize), Rc<DecodedPrimitive>>>,
    kept_bytes: Cell<usize>,
}

impl DracoDecoder {
    /// A decoder beside a build that may use the given number of bytes. A small primitive is never too large.
    pub(super) fn new(memory: u64) -> Self {
        Self { memory: (memory / 4).max(LEAST_MEMORY), kept: RefCell::default(), kept_bytes: Cell::new(0) }
    }

    /// How many bytes are kept.
    pub(super) fn bytes(&self) -> u64 {
        self.kept_bytes.get() as u64
    }

    /// A primitive of a mesh, if it is compressed and its values are nowhere else.
    pub(super) fn decode(
        &self,
        source: &Source,
        document: &Document,
        buffers: &Buffers,
        [mesh, number]: [usize; 2],
        primitive: &Primitive,
    ) -> Parsed<Option<Rc<DecodedPrimitive>>> {
        let draco = primitive.extensions.as_ref().and_then(|extensions| extensions.draco.as_ref());
        let Some(draco) = draco.filter(|_| lacks_values(document, primitive)) else { return Ok(None) };
        if let Some(known) = self.kept.borrow().get(&(mesh, number)) {
            return Ok(Some(Rc::clone(known)));
        }
        let location = Location::Item("mesh", mesh as u64);
        let view = usize::from(draco.buffer_view);
        let Some((bytes, _)) = buffers.view(view)? else {
            return Err(source.truncated(Location::Item("buffer view", view as u64), "it reaches beyond its buffer"));
        };
        let decoded = self.decode_bytes(bytes, draco, primitive).map_err(|problem| {
            source.syntax(location, format!("primitive {number} cannot be decoded by Draco: {problem}"))
        })?;
        let (decoded, mut kept) = (Rc::new(decoded), self.kept.borrow_mut());
        if self.kept_bytes.get() + decoded.bytes() > KEPT_BYTES {
            kept.clear();
            self.kept_bytes.set(0);
        }
        // One that is larger is kept alone, for the nodes that follow.
        self.kept_bytes.set(self.kept_bytes.get() + decoded.bytes());
        kept.insert((mesh, number), Rc::clone(&decoded));
        Ok(Some(decoded))
    }

    fn decode_bytes(&self, bytes: &[u8], draco: &Draco, primitive: &Primitive) -> Result<DecodedPrimitive, String> {
        let default = DecodeLimits::default();
        let limits = default
            .with_max_decoded_bytes(default.max_decoded_bytes.min(self.memory))
            .with_max_faces(MAX_TRIANGLES.min(self.memory / TRIANGLE_BYTES));
        let decode = || {
            let mut mesh = draco_core::Mesh::new();
            MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh).map(|()| mesh)
        };
        let mesh = match catch_unwind(AssertUnwindSafe(decode)) {
            Ok(Ok(mesh)) => mesh,
            Ok(Err(error)) if error.kind() == ErrorKind::LimitExceeded => return Err(TOO_LARGE.to_owned()),
            Ok(Err(error)) => return Err(format!("{error}; copy or export the file again")),
            Err(_) => return Err("its bytes are damaged; copy or export the file again".to_owned()),
        };
        let count = mesh.num_points();
        // Many names may stand for one attribute of the stream, and many points for one of its values.
        let (mut values, mut left) = (vec![], self.memory);
        let accessors = primitive.attributes.by_semantic();
        for (name, id) in &draco.attributes {
            let accessor = Semantic::of_name(name).and_then(|semantic| accessors.get(&semantic));
            let (Some(&accessor), Some(attribute)) = (accessor, mesh.attribute_by_unique_id(id.0)) else { continue };
            values.push((accessor, values_of(name, attribute, count, &mut left)?));
        }
        let indices = mesh.faces().iter().flatten().map(|point| point.0).collect();
        Ok(DecodedPrimitive { values, indices })
    }
}

/// Whether accessors of a primitive have no values of their own.
fn lacks_values(document: &Document, primitive: &Primitive) -> bool {
    let is_empty = |accessor: &Accessor| accessor.buffer_view.is_none() && accessor.sparse.is_none();
    primitive.accessors().any(|number| document.accessors.get(number).is_some_and(is_empty))
}

/// The values of an attribute at all points; what is wrong if it has none for one of them, or if they take more bytes
/// than are left.
fn values_of(name: &str, attribute: &PointAttribute, count: usize, left: &mut u64) -> Result<Decoded, String> {
    let data_type = match attribute.data_type() {
        draco_core::DataType::Int8 => DataType::I8,
        draco_core::DataType::Uint8 => DataType::U8,
        draco_core::DataType::Int16 => DataType::I16,
        draco_core::DataType::Uint16 => DataType::U16,
        draco_core::DataType::Uint32 => DataType::U32,
        draco_core::DataType::Float32 => DataType::F32,
        other => return Err(format!("{name} has numbers of the type {other:?}, which glTF does not have")),
    };
    let components = usize::from(attribute.num_components());
    let (size, data) = (components * data_type.size(), attribute.buffer().data());
    let stride = usize::try_from(attribute.byte_stride()).unwrap_or(0);
    let wanted = (count as u64).saturating_mul(size as u64);
    *left = left.checked_sub(wanted).ok_or(TOO_LARGE)?;
    let mut bytes = Vec::with_capacity(wanted as usize);
    for point in 0..count {
        let value = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
        let start = value.checked_mul(stride).filter(|_| value < attribute.size());
        let found = start.and_then(|start| data.get(start..start.checked_add(size)?));
        bytes.extend_from_slice(found.ok_or_else(|| format!("{name} has no value for point {point}"))?);
    }
    Ok(Decoded { bytes, data_type, components, count })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::compression_tests::one_stream_of_draco;
    use super::*;

    /// Decodes the stream into so many attributes, all of which stand for its texture coordinates, with so much memory.
    fn decoded(name_count: u32, memory: u64) -> Result<usize, String> {
        let accessors = (0..name_count).map(|set| (format!("TEXCOORD_{set}"), json!(set))).collect();
        let ids = (0..name_count).map(|set| (format!("TEXCOORD_{set}"), json!(2))).collect();
        let [accessors, ids] = [accessors, ids].map(serde_json::Value::Object);
        let primitive = serde_json::from_value(json!({"attributes": accessors})).unwrap();
        let draco = serde_json::from_value(json!({"bufferView": 0, "attributes": ids})).unwrap();
        let decoder = DracoDecoder { memory, ..DracoDecoder::new(0) };
        decoder.decode_bytes(&one_stream_of_draco(), &draco, &primitive).map(|decoded| decoded.bytes())
    }

    #[test]
    fn many_names_for_one_attribute_of_a_stream_take_no_more_than_the_memory() {
        let memory = 1 << 16;
        let [one, two] = [1, 2].map(|count| decoded(count, memory).unwrap());
        let each = two - one;
        // Two numbers of single precision at nine points.
        assert_eq!(each, 72);
        let most = memory as usize / each;
        assert_eq!(decoded(most as u32, memory).map(|bytes| bytes - one), Ok((most - 1) * each));
        for count in [most + 1, 10 * most] {
            assert_eq!(decoded(count as u32, memory), Err(TOO_LARGE.to_owned()), "{count}");
        }
    }

    #[test]
    fn as_many_names_as_a_text_can_hold_are_looked_up_in_a_moment() {
        assert_eq!(decoded(200_000, 1 << 40).map(|bytes| bytes > 200_000 * 72), Ok(true));
    }
}
