//! Accessors: typed arrays inside buffers, strided, quantised or sparse (glTF 2.0, section 3.6).

use glam::DVec3;

use super::buffers::Buffers;
use super::document::{Accessor, Dimensions, Document, Sparse};
use super::fields::Index;
use crate::error::{Location, Parsed};
use crate::source::Source;

/// The most items, for each sparse value, of a sparse accessor without a base.
const MAX_ZEROS_PER_VALUE: usize = 1024;
/// What to do about rules that are broken.
const DAMAGED: &str = "export the file again";

/// The type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DataType {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl DataType {
    /// None of numbers that stand for no type.
    fn of_number(number: usize) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// The values of an accessor that were decoded for one primitive; they stand in place of its view.
pub(super) struct Decoded {
    pub(super) bytes: Vec<u8>,
    pub(super) data_type: DataType,
    pub(super) components: usize,
    pub(super) count: usize,
}

/// An accessor with what it needs to be read.
#[derive(Clone, Copy)]
pub(super) struct Array<'b> {
    pub(super) number: usize,
    accessor: &'b Accessor,
    buffers: &'b Buffers<'b>,
    decoded: Option<&'b Decoded>,
}

impl<'b> Array<'b> {
    /// None if there is no such accessor.
    pub(super) fn find(document: &'b Document, buffers: &'b Buffers<'b>, number: usize) -> Option<Self> {
        Some(Self { number, accessor: document.accessors.get(number)?, buffers, decoded: None })
    }

    /// The same with values that were decoded for it.
    pub(super) fn with(self, decoded: Option<&'b Decoded>) -> Self {
        Self { decoded, ..self }
    }

    pub(super) fn count(&self) -> usize {
        self.decoded.map_or(self.accessor.count.into(), |decoded| decoded.count)
    }

    /// Whether its name says that its values were computed.
    pub(super) fn is_computed(&self) -> bool {
        self.accessor.is_computed.0
    }

    /// The name of the accessor in messages.
    pub(super) fn location(&self) -> Location {
        Location::Item("accessor", self.number as u64)
    }

    fn components(&self) -> usize {
        self.decoded.map_or(components_of(self.accessor.dimensions), |decoded| decoded.components)
    }

    fn data_type(&self, source: &Source) -> Parsed<DataType> {
        let stated = self.decoded.map(|decoded| decoded.data_type);
        stated.or(DataType::of_number(self.accessor.component_type.into())).ok_or_else(|| {
            let number = usize::from(self.accessor.component_type);
            source.syntax(self.location(), format!("has the component type {number}, which is none; {DAMAGED}"))
        })
    }
}

fn components_of(dimensions: Dimensions) -> usize {
    match dimensions {
        Dimensions::Scalar => 1,
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        Dimensions::Mat4 => 16,
        Dimensions::Other => 0,
    }
}

/// The positions of a `POSITION` accessor: floats, or integers as `KHR_mesh_quantization` allows. They may not be
/// finite.
pub(super) fn read_positions<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = DVec3> + use<'b>> {
    if array.components() != 3 {
        let problem = "positions must have three components; export the file again";
        return Err(source.syntax(array.location(), problem));
    }
    let (data_type, normalized) = (array.data_type(source)?, array.accessor.normalized);
    let position = move |bytes: &[u8]| {
        let size = data_type.size();
        let mut p = DVec3::ZERO;
        for axis in 0..3 {
            p[axis] = component(&bytes[axis * size..], data_type, normalized);
        }
        p
    };
    read_items(source, array, data_type, DVec3::ZERO, position)
}

/// The colours of a `COLOR_n` accessor: red, green, blue and alpha, which is 1 where there is none.
pub(super) fn read_colours<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 4]> + use<'b>> {
    let count = array.components();
    if !(3..=4).contains(&count) {
        return Err(source.syntax(array.location(), "colours must have three or four components"));
    }
    let data_type = array.data_type(source)?;
    let colour = move |bytes: &[u8]| {
        let mut colour = [1.0; 4];
        for (i, value) in colour.iter_mut().enumerate().take(count) {
            // Whole numbers are shares of the largest one, whether the accessor says so or not.
            *value = component(&bytes[i * data_type.size()..], data_type, true) as f32;
        }
        colour
    };
    read_items(source, array, data_type, [0.0; 4], colour)
}

/// The directions of a `NORMAL` accessor. Whole numbers are shares of the largest one, whether the accessor says so or
/// not.
pub(super) fn read_normals<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 3]> + use<'b>> {
    read_numbers(source, array, true, "normals must have three components", |x| x as f32)
}

/// The directions of a `TANGENT` accessor, each with its side, as normals are.
pub(super) fn read_tangents<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 4]> + use<'b>> {
    read_numbers(source, array, true, "tangents must have four components", |x| x as f32)
}

/// The coordinates of a `TEXCOORD_n` accessor.
pub(super) fn read_uvs<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = [f32; 2]> + use<'b>> {
    let problem = "texture coordinates must have two components";
    read_numbers(source, array, array.accessor.normalized, problem, |x| x as f32)
}

/// The numbers of an index accessor.
pub(super) fn read_indices<'b>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = u32> + use<'b>> {
    let data_type = array.data_type(source)?;
    if array.components() != 1 || !data_type.is_unsigned() {
        return Err(source.syntax(array.location(), "indices must be single unsigned numbers; export the file again"));
    }
    read_items(source, array, data_type, 0, move |bytes| component(bytes, data_type, false) as u32)
}

/// The vectors of an accessor of instances or skins: floats, or integers that are shares of the largest one where the
/// accessor says so.
pub(super) fn read_vectors<'b, const N: usize>(
    source: &Source,
    array: &Array<'b>,
) -> Parsed<impl ExactSizeIterator<Item = [f64; N]> + use<'b, N>> {
    let problem = format!("has values of {} components in place of {N}; {DAMAGED}", array.components());
    read_numbers(source, array, array.accessor.normalized, &problem, |x| x)
}

/// Vectors of numbers; what is wrong if they have other dimensions.
fn read_numbers<'b, T: Copy + Default, F: Fn(f64) -> T, const N: usize>(
    source: &Source,
    array: &Array<'b>,
    normalized: bool,
    problem: &str,
    number: F,
) -> Parsed<impl ExactSizeIterator<Item = [T; N]> + use<'b, T, F, N>> {
    if array.components() != N {
        return Err(source.syntax(array.location(), problem));
    }
    let data_type = array.data_type(source)?;
    let vector = move |bytes: &[u8]| {
        std::array::from_fn(|k| number(component(&bytes[k * data_type.size()..], data_type, normalized)))
    };
    read_items(source, array, data_type, [T::default(); N], vector)
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
    array: &Array<'b>,
    data_type: DataType,
    zero: T,
    item: F,
) -> Parsed<impl ExactSizeIterator<Item = T> + use<'b, T, F>> {
    let &Array { accessor, buffers, .. } = array;
    let location = array.location();
    let (count, size) = (array.count(), data_type.size() * array.components());
    let beyond = || source.truncated(location, "it reaches beyond its buffer");
    let find = |view: Index, offset: usize, size: usize, count: usize| {
        Slices::find(buffers, view, offset, size, count)?.ok_or_else(beyond)
    };
    let (base, mut replaced) = match array.decoded {
        Some(decoded) => (Some(Slices { buffers, bytes: &decoded.bytes, size, stride: size, count }), None),
        None => {
            let base = accessor.buffer_view.map(|view| find(view, accessor.byte_offset.into(), size, count));
            let replaced = accessor.sparse.as_ref().map(|sparse| Replaced::find(source, location, sparse, size, find));
            (base.transpose()?, replaced.transpose()?)
        }
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
            return Err(source.syntax(location, format!("it has no data; {DAMAGED}")));
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
    fn find(
        source: &Source,
        location: Location,
        sparse: &Sparse,
        size: usize,
        find: impl Fn(Index, usize, usize, usize) -> Parsed<Slices<'b>>,
    ) -> Parsed<Self> {
        let Sparse { count, indices, values } = sparse;
        let Some(index_type) = DataType::of_number(indices.component_type.into()).filter(|of| of.is_unsigned()) else {
            let problem = format!("the numbers of the items that it replaces must be unsigned; {DAMAGED}");
            return Err(source.syntax(location, problem));
        };
        let values = find(values.buffer_view, values.byte_offset.into(), size, (*count).into())?;
        let indices = find(indices.buffer_view, indices.byte_offset.into(), index_type.size(), (*count).into())?;
        let first = Self { indices, index_type, values, next: 0, next_index: 0 };
        Ok(Self { next_index: first.index(0), ..first })
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
    /// Errors are those of the view.
    fn find(buffers: &'b Buffers<'b>, view: Index, offset: usize, size: usize, count: usize) -> Parsed<Option<Self>> {
        let Some((bytes, stride)) = buffers.view(view.into())? else { return Ok(None) };
        let stride = stride.unwrap_or(size).max(1);
        // A last item shorter than the stride still counts; items may overlap if the stride is short.
        let end = match count.checked_sub(1) {
            Some(last) => last.checked_mul(stride).and_then(|end| end.checked_add(size)),
            None => Some(0),
        };
        let bytes = bytes.get(offset..).filter(|bytes| end.is_some_and(|end| end <= bytes.len()));
        Ok(bytes.map(|bytes| Self { buffers, bytes, size, stride, count }))
    }

    #[inline]
    fn get(&self, i: usize) -> &'b [u8] {
        self.buffers.touch(self.stride);
        &self.bytes[i * self.stride..i * self.stride + self.size]
    }
}
