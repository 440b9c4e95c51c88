//! Accessors: typed arrays inside buffers, strided, quantised or sparse (glTF 2.0, section 3.6).

use ::gltf::Accessor;
use ::gltf::accessor::sparse::{IndexType, Sparse};
use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::buffer::View;
use glam::DVec3;

use super::super::error::{Location, Parsed};
use super::super::source::Source;
use super::Buffers;

/// The most items, for each sparse value, of a sparse accessor without a base.
const MAX_ZEROS_PER_VALUE: usize = 1024;

/// The positions of a `POSITION` accessor: floats, or integers as `KHR_mesh_quantization` allows. They may not be
/// finite.
pub(super) fn read_positions<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = DVec3>> {
    if accessor.dimensions() != Dimensions::Vec3 {
        let problem = "positions must have three components; export the file again";
        return Err(source.syntax(location_of(accessor), problem));
    }
    let (data_type, normalized) = (accessor.data_type(), accessor.normalized());
    let position = move |bytes: &[u8]| {
        let size = data_type.size();
        let mut p = DVec3::ZERO;
        for axis in 0..3 {
            p[axis] = component(&bytes[axis * size..], data_type, normalized);
        }
        p
    };
    read_items(source, buffers, accessor, DVec3::ZERO, position)
}

/// The colours of a `COLOR_n` accessor: red, green, blue and alpha, which is 1 where there is none.
pub(super) fn read_colours<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 4]> + use<'b>> {
    let count = match accessor.dimensions() {
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        _ => return Err(source.syntax(location_of(accessor), "colours must have three or four components")),
    };
    let data_type = accessor.data_type();
    let colour = move |bytes: &[u8]| {
        let mut colour = [1.0; 4];
        for (i, value) in colour.iter_mut().enumerate().take(count) {
            // Whole numbers are shares of the largest one, whether the accessor says so or not.
            *value = component(&bytes[i * data_type.size()..], data_type, true) as f32;
        }
        colour
    };
    read_items(source, buffers, accessor, [0.0; 4], colour)
}

/// The directions of a `NORMAL` accessor.
pub(super) fn read_normals<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 3]> + use<'b>> {
    read_shares(source, buffers, accessor, (Dimensions::Vec3, "normals must have three components"))
}

/// The directions of a `TANGENT` accessor, each with its side.
pub(super) fn read_tangents<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 4]> + use<'b>> {
    read_shares(source, buffers, accessor, (Dimensions::Vec4, "tangents must have four components"))
}

/// Vectors of which whole numbers are shares of the largest one, whether the accessor says so or not; what is wrong if it has other dimensions.
fn read_shares<'b, const N: usize>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
    (dimensions, problem): (Dimensions, &str),
) -> Parsed<impl ExactSizeIterator<Item = [f32; N]> + use<'b, N>> {
    if accessor.dimensions() != dimensions {
        return Err(source.syntax(location_of(accessor), problem));
    }
    let data_type = accessor.data_type();
    let vector =
        move |bytes: &[u8]| std::array::from_fn(|k| component(&bytes[k * data_type.size()..], data_type, true) as f32);
    read_items(source, buffers, accessor, [0.0; N], vector)
}

/// The coordinates of a `TEXCOORD_n` accessor.
pub(super) fn read_uvs<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 2]> + use<'b>> {
    if accessor.dimensions() != Dimensions::Vec2 {
        return Err(source.syntax(location_of(accessor), "texture coordinates must have two components"));
    }
    let (data_type, normalized) = (accessor.data_type(), accessor.normalized());
    let uv =
        move |bytes: &[u8]| [0, 1].map(|i| component(&bytes[i * data_type.size()..], data_type, normalized) as f32);
    read_items(source, buffers, accessor, [0.0; 2], uv)
}

/// The numbers of an index accessor.
pub(super) fn read_indices<'b>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
) -> Parsed<impl ExactSizeIterator<Item = u32>> {
    let data_type = accessor.data_type();
    let unsigned = matches!(data_type, DataType::U8 | DataType::U16 | DataType::U32);
    if accessor.dimensions() != Dimensions::Scalar || !unsigned {
        return Err(
            source.syntax(location_of(accessor), "indices must be single unsigned numbers; export the file again")
        );
    }
    read_items(source, buffers, accessor, 0, move |bytes| component(bytes, data_type, false) as u32)
}

/// The name of an accessor in messages.
pub(super) fn location_of(accessor: &Accessor) -> Location {
    Location::Item("accessor", accessor.index() as u64)
}

/// One component as f64. `bytes` must hold it: callers have checked the length of the item.
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

/// The items of an accessor, with sparse values substituted; zeros if there is no view. Everything is checked before
/// the first item is decoded; then they are decoded one by one.
fn read_items<'b, T: Copy, F: Fn(&[u8]) -> T>(
    source: &Source,
    buffers: &'b Buffers<'b>,
    accessor: &Accessor,
    zero: T,
    item: F,
) -> Parsed<impl ExactSizeIterator<Item = T> + use<'b, T, F>> {
    let location = location_of(accessor);
    let outside = || source.truncated(location, "it reaches beyond its buffer");
    let (count, size) = (accessor.count(), accessor.size());
    let base = match accessor.view() {
        Some(view) => Some(Slices::find(buffers, &view, accessor.offset(), size, count).ok_or_else(outside)?),
        None => None,
    };
    let mut replaced = match accessor.sparse() {
        Some(sparse) => Some(Replaced::find(buffers, &sparse, size).ok_or_else(outside)?),
        None => None,
    };
    if let Some(replaced) = &replaced {
        let mut least = 0;
        for index in (0..replaced.indices.count).map(|number| replaced.index(number)) {
            if index >= count || index < least {
                let after = if index < least { format!(" after item {}", least - 1) } else { format!(" of {count}") };
                return Err(source.syntax(location, format!("it replaces item {index}{after}; export the file again")));
            }
            least = index + 1;
        }
    }
    if base.is_none() {
        // Zeros except for the sparse values. Vertices that all lie at the origin make no surface, so a count far above
        // the number of sparse values is not a mesh but an invented number.
        let Some(values) = replaced.as_ref().map(|replaced| replaced.values.count) else {
            return Err(source.syntax(location, "it has no data; export it without compression extensions"));
        };
        if count > values.saturating_mul(MAX_ZEROS_PER_VALUE) {
            let problem = format!("it has {count} items but only {values} values; export the file again");
            return Err(source.syntax(location, problem));
        }
    }
    Ok((0..count).map(move |i| match (replaced.as_mut().and_then(|replaced| replaced.take(i)), &base) {
        (Some(value), _) => item(value),
        (None, Some(base)) => item(base.get(i)),
        (None, None) => zero,
    }))
}

/// The items of a sparse accessor that differ from its base.
struct Replaced<'b> {
    /// Their indices, which must rise (glTF 2.0, section 3.6.2.3).
    indices: Slices<'b>,
    index_type: DataType,
    values: Slices<'b>,
    /// The first replacement not yet taken, and the item that it replaces.
    next: usize,
    next_index: usize,
}

impl<'b> Replaced<'b> {
    /// `None` if its views are too short.
    fn find(buffers: &'b Buffers<'b>, sparse: &Sparse, size: usize) -> Option<Self> {
        let index_type = match sparse.indices().index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let (index_view, value_view) = (sparse.indices().view(), sparse.values().view());
        let index_offset = sparse.indices().offset();
        let indices = Slices::find(buffers, &index_view, index_offset, index_type.size(), sparse.count())?;
        let values = Slices::find(buffers, &value_view, sparse.values().offset(), size, sparse.count())?;
        let first = Self { indices, index_type, values, next: 0, next_index: 0 };
        Some(Self { next_index: first.index(0), ..first })
    }

    /// The index of the item that a replacement replaces; none after the last.
    fn index(&self, number: usize) -> usize {
        if number >= self.indices.count {
            return usize::MAX;
        }
        component(self.indices.get(number), self.index_type, false) as usize
    }

    /// The bytes of item `i`, if they are replaced. Callers must ask for the items in order.
    #[inline]
    fn take(&mut self, i: usize) -> Option<&'b [u8]> {
        if i != self.next_index {
            return None;
        }
        let value = self.values.get(self.next);
        self.next += 1;
        self.next_index = self.index(self.next);
        Some(value)
    }
}

/// Slices of a view at equal distances.
struct Slices<'b> {
    buffers: &'b Buffers<'b>,
    bytes: &'b [u8],
    size: usize,
    stride: usize,
    count: usize,
}

impl<'b> Slices<'b> {
    /// `count` slices of `size` bytes, spaced by the view's stride; `None` if the last one ends outside the view.
    fn find(buffers: &'b Buffers<'b>, view: &View, offset: usize, size: usize, count: usize) -> Option<Self> {
        let stride = view.stride().unwrap_or(size).max(1);
        let bytes = buffers.view(view, offset)?;
        let end = match count.checked_sub(1) {
            Some(last) => last.checked_mul(stride)?.checked_add(size)?,
            None => 0,
        };
        // A last item shorter than the stride still counts; items may overlap if the stride is short.
        (end <= bytes.len()).then_some(Self { buffers, bytes, size, stride, count })
    }

    #[inline]
    fn get(&self, i: usize) -> &'b [u8] {
        self.buffers.touch(self.stride);
        &self.bytes[i * self.stride..i * self.stride + self.size]
    }
}
