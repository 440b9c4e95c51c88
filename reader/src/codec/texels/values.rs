//! Values that are no colours: predicted from their neighbours, exactly.

#[cfg(feature = "write")]
use super::binary::BitEncoder;
use super::{
    binary::{BitDecoder, NumberChances},
    image::Image,
};
use crate::error::{Error, Result};

/// Classes of how much the neighbours of a texel differ.
const CLASSES: usize = 17;

/// What is expected of a value by those to its left, above it, and above to the left: the median of both and of their
/// plane; and how much these differ.
fn expected(row: &[i32], above: &[i32], at: usize, components: usize) -> (i32, usize) {
    let left = at.checked_sub(components).map(|before| row[before]);
    let corner = at.checked_sub(components).and_then(|before| above.get(before).copied());
    match (left, above.get(at).copied(), corner) {
        (Some(left), Some(up), Some(corner)) => {
            let plane = (left + up - corner).clamp(left.min(up), left.max(up));
            let spread = (left - corner).unsigned_abs() + (up - corner).unsigned_abs();
            (plane, (u32::BITS - spread.leading_zeros()) as usize)
        }
        (Some(only), ..) | (None, Some(only), _) => (only, 3),
        _ => (0, CLASSES - 1),
    }
}

pub(super) fn decode(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Image<u16>> {
    let (count, row_length) = (usize::from(components), size[0] as usize * usize::from(components));
    let mut bits = BitDecoder::new(bytes);
    let mut chances: Vec<NumberChances> = vec![NumberChances::default(); count * CLASSES];
    let (mut above, mut row) = (vec![], vec![]);
    let mut data = Vec::new();
    for _ in 0..size[1] {
        row.clear();
        for at in 0..row_length {
            if at % 256 == 0 {
                bits.check()?;
            }
            let (expected, class) = expected(&row, &above, at, count);
            let delta = bits.signed(&mut chances[at % count * CLASSES + class.min(CLASSES - 1)])?;
            let value = expected.checked_add(delta).and_then(|value| u16::try_from(value).ok());
            row.push(i32::from(value.ok_or_else(|| Error::format("a texel's value exceeds 16 bits"))?));
        }
        data.extend(row.iter().map(|&value| value as u16));
        std::mem::swap(&mut above, &mut row);
    }
    bits.finish()?;
    Ok(Image { size, components, data })
}

/// Codes values. Texels that are not used get those that cost least.
#[cfg(feature = "write")]
pub fn encode_values(image: &Image<u16>, is_used: &[bool]) -> Vec<u8> {
    let count = usize::from(image.components);
    let row_length = image.size[0] as usize * count;
    let mut bits = BitEncoder::new();
    let mut chances: Vec<NumberChances> = vec![NumberChances::default(); count * CLASSES];
    let (mut above, mut row): (Vec<i32>, Vec<i32>) = (vec![], vec![]);
    for (values, used) in image.data.chunks_exact(row_length).zip(is_used.chunks_exact(image.size[0] as usize)) {
        row.clear();
        for at in 0..row_length {
            let (expected, class) = expected(&row, &above, at, count);
            let value = if used[at / count] { i32::from(values[at]) } else { expected };
            bits.signed(&mut chances[at % count * CLASSES + class.min(CLASSES - 1)], value - expected);
            row.push(value);
        }
        std::mem::swap(&mut above, &mut row);
    }
    bits.finish()
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_exactly_where_they_are_used() {
        for (size, components) in [([1, 1], 1), ([50, 40], 1), ([33, 7], 2), ([5, 90], 4)] {
            let count = size[0] * size[1] * u32::from(components);
            let data = (0..count).map(|k| ((k * k / 7) % 3000 + k * 20) as u16).collect();
            let image = Image { size, components, data };
            let used: Vec<bool> = (0..size[0] * size[1]).map(|k| k % 11 != 3).collect();
            let back = Image::decode_values(&encode_values(&image, &used), size, components).unwrap();
            for (number, &is_used) in used.iter().enumerate() {
                let place = |image: &Image<u16>| {
                    let [x, y] = [number as u32 % size[0], number as u32 / size[0]];
                    image.texel(x, y).to_vec()
                };
                assert!(!is_used || place(&back) == place(&image));
            }
        }
        assert!(Image::decode_values(&[], [100, 1000], 1).is_err());
    }
}
