//! Accessors: typed arrays inside buffers, strided, quantised or sparse (glTF 2.0, section 3.6).

use ::gltf::Accessor;
use ::gltf::accessor::sparse::IndexType;
use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::buffer::View;
use glam::DVec3;

use super::super::error::{Parsed, Place};
use super::super::source::Source;
use super::Buffers;

/// Most items of a sparse accessor without a base for each value that it has.
const MAX_ZEROS_PER_VALUE: usize = 1024;

/// Reads a `POSITION` accessor: floats, or integers as `KHR_mesh_quantization` allows them.
pub(super) fn read_positions(source: &Source, buffers: &Buffers, accessor: &Accessor) -> Parsed<Vec<DVec3>> {
    let place = Place::Item("accessor", accessor.index() as u64);
    if accessor.dimensions() != Dimensions::Vec3 {
        return Err(source.syntax(place, "positions must have three components; export it again"));
    }
    let (data_type, normalized) = (accessor.data_type(), accessor.normalized());
    let position = |bytes: &[u8]| {
        let size = data_type.size();
        let mut p = DVec3::ZERO;
        for axis in 0..3 {
            p[axis] = component(&bytes[axis * size..], data_type, normalized);
        }
        p
    };
    let positions = read_items(source, buffers, accessor, DVec3::ZERO, position)?;
    match positions.iter().position(|p| !p.is_finite()) {
        Some(vertex) => Err(source.coordinate(place, vertex as u64, positions[vertex])),
        None => Ok(positions),
    }
}

/// Reads an index accessor.
pub(super) fn read_indices(source: &Source, buffers: &Buffers, accessor: &Accessor) -> Parsed<Vec<u32>> {
    let data_type = accessor.data_type();
    let unsigned = matches!(data_type, DataType::U8 | DataType::U16 | DataType::U32);
    if accessor.dimensions() != Dimensions::Scalar || !unsigned {
        let place = Place::Item("accessor", accessor.index() as u64);
        return Err(source.syntax(place, "indices must be single unsigned numbers; export it again"));
    }
    read_items(source, buffers, accessor, 0, |bytes| component(bytes, data_type, false) as u32)
}

/// One component as f64. `bytes` must hold it: the callers have checked the length of the item.
fn component(bytes: &[u8], data_type: DataType, normalized: bool) -> f64 {
    let (value, largest) = match data_type {
        DataType::F32 => return f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::U32 => return f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::U16 => (f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        DataType::I16 => (f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        DataType::U8 => (f64::from(bytes[0]), 255.0),
        DataType::I8 => (f64::from(bytes[0] as i8), 127.0),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

/// The items of an accessor, the sparse ones put in place; zeros where there is no view.
fn read_items<T: Copy>(
    source: &Source,
    buffers: &Buffers,
    accessor: &Accessor,
    zero: T,
    item: impl Fn(&[u8]) -> T,
) -> Parsed<Vec<T>> {
    let place = Place::Item("accessor", accessor.index() as u64);
    let outside = || source.truncated(place, "it reaches beyond its buffer");
    let (count, size) = (accessor.count(), accessor.size());
    let mut items = match accessor.view() {
        Some(view) => {
            let slices = slices(buffers, &view, accessor.offset(), size, count).ok_or_else(outside)?;
            slices.map(&item).collect()
        }
        None => {
            // Zeros but for the sparse values. Vertices that all lie at the origin make no surface, so that many more
            // of them than sparse values are no mesh but a count that must not allocate.
            let Some(sparse) = accessor.sparse() else {
                return Err(source.syntax(place, "it has no data; export it without compression extensions"));
            };
            if count > sparse.count().saturating_mul(MAX_ZEROS_PER_VALUE) {
                let problem = format!("it has {count} items but only {} values; export it again", sparse.count());
                return Err(source.syntax(place, problem));
            }
            // The number of values is no more to be trusted before they are found.
            if slices(buffers, &sparse.values().view(), sparse.values().offset(), size, sparse.count()).is_none() {
                return Err(outside());
            }
            vec![zero; count]
        }
    };
    if let Some(sparse) = accessor.sparse() {
        let (index_view, value_view) = (sparse.indices().view(), sparse.values().view());
        let index_type = match sparse.indices().index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let indices = slices(buffers, &index_view, sparse.indices().offset(), index_type.size(), sparse.count());
        let values = slices(buffers, &value_view, sparse.values().offset(), size, sparse.count());
        for (index, value) in indices.ok_or_else(outside)?.zip(values.ok_or_else(outside)?) {
            let index = component(index, index_type, false) as usize;
            let Some(slot) = items.get_mut(index) else {
                let problem = format!("it replaces item {index} of {count}; export it again");
                return Err(source.syntax(place, problem));
            };
            *slot = item(value);
        }
    }
    Ok(items)
}

/// `count` byte slices of `size` bytes, as far apart as the view's stride says; `None` if the last ends outside the
/// view.
fn slices<'b>(
    buffers: &'b Buffers,
    view: &View,
    offset: usize,
    size: usize,
    count: usize,
) -> Option<impl Iterator<Item = &'b [u8]>> {
    let stride = view.stride().unwrap_or(size).max(1);
    let bytes = buffers.view(view, offset)?;
    let end = match count.checked_sub(1) {
        Some(last) => last.checked_mul(stride)?.checked_add(size)?,
        None => 0,
    };
    // A last item that is shorter than the stride still counts; items may overlap if the stride is short.
    (end <= bytes.len()).then(|| (0..count).map(move |i| &bytes[i * stride..i * stride + size]))
}
