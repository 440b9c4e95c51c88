//! What a primitive consists of, wherever its values are.

use std::rc::Rc;

use super::accessor::{Array, read_indices};
use super::buffers::Buffers;
use super::document::{Document, Primitive, Semantic};
use super::draco::DecodedPrimitive;
use crate::error::Parsed;
use crate::source::Source;

/// The arrays of a primitive: those of its accessors, or what was decoded for them.
pub(super) struct Arrays<'b> {
    document: &'b Document,
    buffers: &'b Buffers<'b>,
    pub(super) primitive: &'b Primitive,
    decoded: Option<Rc<DecodedPrimitive>>,
}

impl<'b> Arrays<'b> {
    pub(super) fn new(
        document: &'b Document,
        buffers: &'b Buffers<'b>,
        primitive: &'b Primitive,
        decoded: Option<Rc<DecodedPrimitive>>,
    ) -> Self {
        Self { document, buffers, primitive, decoded }
    }

    /// None if the primitive has no such attribute.
    pub(super) fn get(&self, semantic: Semantic) -> Option<Array<'_>> {
        let number = self.primitive.attributes.get(semantic)?;
        let decoded = self.decoded.as_ref().and_then(|decoded| decoded.values(number));
        Some(Array::find(self.document, self.buffers, number)?.with(decoded))
    }

    /// The numbers of vertices that were decoded, three for each triangle.
    pub(super) fn decoded_indices(&self) -> Option<&[u32]> {
        self.decoded.as_ref().map(|decoded| &decoded.indices[..])
    }

    /// The accessor of indices.
    pub(super) fn indices(&self) -> Option<Array<'_>> {
        Array::find(self.document, self.buffers, self.primitive.indices?.into())
    }

    /// The indices of a primitive with `vertex_count` vertices, in memory; none if it has more than `most`.
    pub(super) fn all_indices(&self, source: &Source, vertex_count: usize, most: usize) -> Parsed<Option<Vec<u32>>> {
        let indices = match (self.decoded_indices(), self.indices()) {
            (Some(indices), _) if indices.len() <= most => indices.to_vec(),
            (None, Some(array)) if array.count() <= most => read_indices(source, &array)?.collect(),
            (None, None) if vertex_count <= most => (0..vertex_count as u32).collect(),
            _ => return Ok(None),
        };
        Ok(Some(indices))
    }
}
