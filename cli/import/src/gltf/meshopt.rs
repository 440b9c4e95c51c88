//! Views that are compressed by meshoptimizer (`EXT_meshopt_compression`, `KHR_meshopt_compression`).

use meshopt::{
    decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence, decode_vertex_buffer,
};

use super::document::Compressed;

/// The most bytes that one byte of encoded vertices can stand for. A block has up to 256 vertices, and of each four of
/// their bytes at least one byte of control, whatever they are.
const MOST_BYTES_PER_BYTE: u64 = 4 * 256;
/// The most bytes that one byte of encoded indices can stand for: each triangle has a code, and each index of a
/// sequence.
const MOST_INDEX_BYTES_PER_BYTE: u64 = 3 * 4;
/// The longest vertex of the codec.
const MOST_STRIDE: u64 = 256;
const DAMAGED: &str = "its compressed bytes are damaged; copy or export the file again";

/// How many bytes a view has once it is decompressed, by what it says.
pub(super) fn decompressed_bytes(compressed: &Compressed) -> u64 {
    compressed.count.0.saturating_mul(compressed.byte_stride.0)
}

/// The bytes of a view; what is wrong if it cannot be decompressed.
pub(super) fn decompress(encoded: &[u8], compressed: &Compressed) -> Result<Vec<u8>, String> {
    let (stride, filter) = (compressed.byte_stride.0, compressed.filter.as_deref().unwrap_or("NONE"));
    let is_index = matches!(compressed.mode.as_str(), "TRIANGLES" | "INDICES");
    let fits = if is_index {
        matches!(stride, 2 | 4)
    } else {
        stride.is_multiple_of(4) && (4..=MOST_STRIDE).contains(&stride)
    };
    if !fits {
        return Err(format!(
            "is compressed with a stride of {stride} bytes, which {} cannot have; export the file again",
            compressed.mode
        ));
    }
    // Nothing is allocated for numbers that so few bytes cannot stand for.
    let most = if is_index { MOST_INDEX_BYTES_PER_BYTE } else { MOST_BYTES_PER_BYTE };
    let bytes = decompressed_bytes(compressed);
    if bytes > most.saturating_mul(encoded.len() as u64) {
        return Err(format!(
            "says that {} compressed bytes have {bytes} bytes, which is impossible; export the file again",
            encoded.len()
        ));
    }
    let count = usize::from(compressed.count);
    if count == 0 {
        return Ok(vec![]);
    }
    let damaged = |_| DAMAGED.to_owned();
    match (compressed.mode.as_str(), stride, filter) {
        ("TRIANGLES", _, "NONE") if !count.is_multiple_of(3) => Err(format!(
            "compresses {count} indices as triangles, which is not a multiple of three; export the file again"
        )),
        ("TRIANGLES", 2, "NONE") => {
            Ok(bytes_of(&decode_index_buffer::<u16>(encoded, count).map_err(damaged)?, u16::to_ne_bytes))
        }
        ("TRIANGLES", _, "NONE") => {
            Ok(bytes_of(&decode_index_buffer::<u32>(encoded, count).map_err(damaged)?, u32::to_ne_bytes))
        }
        ("INDICES", 2, "NONE") => {
            Ok(bytes_of(&decode_index_sequence::<u16>(encoded, count).map_err(damaged)?, u16::to_ne_bytes))
        }
        ("INDICES", _, "NONE") => {
            Ok(bytes_of(&decode_index_sequence::<u32>(encoded, count).map_err(damaged)?, u32::to_ne_bytes))
        }
        ("ATTRIBUTES", 4, "OCTAHEDRAL") => filtered(encoded, count, decode_filter_oct::<i8>, i8::to_ne_bytes),
        ("ATTRIBUTES", 8, "OCTAHEDRAL") => filtered(encoded, count, decode_filter_oct::<i16>, i16::to_ne_bytes),
        ("ATTRIBUTES", 8, "QUATERNION") => filtered(encoded, count, decode_filter_quat, i16::to_ne_bytes),
        ("ATTRIBUTES", 4, "COLOR") => filtered(encoded, count, decode_filter_color::<u8>, u8::to_ne_bytes),
        ("ATTRIBUTES", 8, "COLOR") => filtered(encoded, count, decode_filter_color::<u16>, u16::to_ne_bytes),
        ("ATTRIBUTES", _, "NONE" | "EXPONENTIAL") => {
            let mut words = decode_words(encoded, count, stride).ok_or_else(|| DAMAGED.to_owned())?;
            if filter == "EXPONENTIAL" {
                // Each number has an exponent of its own, so that the length of a vertex does not matter.
                decode_filter_exp(words.as_chunks_mut::<1>().0);
            }
            Ok(bytes_of(&words, u32::to_ne_bytes))
        }
        (mode, ..) => Err(format!(
            "is compressed as {mode} with the filter {filter} and a stride of {stride} bytes, which is not supported; decompress it first"
        )),
    }
}

/// The bytes of vertices of four numbers, decoded and filtered.
fn filtered<T: Clone + Copy + Default, const N: usize>(
    encoded: &[u8],
    count: usize,
    filter: impl Fn(&mut [[T; 4]]),
    bytes: impl Fn(T) -> [u8; N],
) -> Result<Vec<u8>, String> {
    let mut values = decode_vertex_buffer::<[T; 4]>(encoded, count).map_err(|_| DAMAGED.to_owned())?;
    filter(&mut values);
    Ok(bytes_of(values.as_flattened(), bytes))
}

fn bytes_of<T: Copy, const N: usize>(values: &[T], bytes: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|&value| bytes(value)).collect()
}

/// A vertex of `N` words.
#[derive(Clone)]
struct Words<const N: usize>([u32; N]);

impl<const N: usize> Default for Words<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// The words of all vertices. The codec takes their length as that of a type.
fn decode_words(encoded: &[u8], count: usize, stride: u64) -> Option<Vec<u32>> {
    macro_rules! by_length {
        ($($words:literal)*) => {
            match stride / 4 {
                $($words => {
                    let vertices = decode_vertex_buffer::<Words<$words>>(encoded, count).ok()?;
                    Some(vertices.iter().flat_map(|vertex| vertex.0).collect())
                })*
                _ => None,
            }
        };
    }
    by_length!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}
