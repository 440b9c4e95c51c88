//! Exact colours, normals and factors: bytes predicted from their neighbours, as other values are.
//!
//! Where components have to do with one another, as those of colours have, what red and blue have beyond green is what
//! is predicted. That takes half of the bytes of three components that are coded one by one.

#[cfg(feature = "write")]
use super::binary::BitEncoder;
use super::{
    binary::{BitDecoder, NumberChances},
    image::{Image, check},
};
use crate::error::{Error, Result};

/// The first byte of an image of one colour.
const EVEN: u8 = 0;
/// And of all others. Steps of quantisation are smaller.
const CODED: u8 = 255;
/// Classes of how much the neighbours of a texel differ: three differences of at most 510 are below 2^11.
const CLASSES: usize = 12;
/// The class where too few are there.
const UNKNOWN: usize = CLASSES - 1;
/// Values between checks that the bytes have not ended.
const CHECKED: usize = 256;

/// The components in the order in which they are coded: green first, if there are colours.
fn order(components: usize) -> &'static [usize] {
    match components {
        1 => &[0],
        2 => &[0, 1],
        3 => &[1, 0, 2],
        _ => &[1, 0, 2, 3],
    }
}

/// Whether what a component has beyond green is predicted.
fn is_difference(component: usize, components: usize) -> bool {
    components >= 3 && (component == 0 || component == 2)
}

/// A row of texels, and by how much each of its components differs from what was expected.
#[derive(Default)]
struct Row {
    values: Vec<u8>,
    deltas: Vec<i16>,
}

/// The row that is coded and the one above it, with what is known from them.
struct Rows {
    components: usize,
    /// Empty above the first row.
    above: Row,
    /// As long as a row; texels to the right are not known yet.
    this: Row,
    /// By component, class, and whether neighbours were as expected.
    chances: Vec<NumberChances>,
}

impl Rows {
    fn new(size: [u32; 2], components: u8) -> Self {
        let components = usize::from(components);
        let length = size[0] as usize * components;
        let this = Row { values: vec![0; length], deltas: vec![0; length] };
        let chances = vec![NumberChances::default(); components * CLASSES * 2];
        Self { components, above: Row::default(), this, chances }
    }

    /// What is expected of a component of a texel, and its chances.
    fn expect(&mut self, texel: usize, component: usize) -> (i32, &mut NumberChances) {
        let Self { components, above, this, chances } = self;
        let of_green = is_difference(component, *components);
        // A value, or what it has beyond green.
        let value = |row: &Row, texel: usize| {
            let at = texel * *components;
            let green = if of_green { i32::from(row.values[at + 1]) } else { 0 };
            i32::from(row.values[at + component]) - green
        };
        let is_as_expected = |row: &Row, texel: usize| row.deltas[texel * *components + component] == 0;
        let has_above = !above.values.is_empty();
        let (predicted, class) = match (texel.checked_sub(1), has_above) {
            (Some(before), true) => {
                let [left, up, corner] = [value(this, before), value(above, texel), value(above, before)];
                let has_right = (texel + 1) * *components < above.values.len();
                let right = if has_right { value(above, texel + 1) } else { up };
                let spread = left.abs_diff(corner) + up.abs_diff(corner) + right.abs_diff(up);
                let plane = (left + up - corner).clamp(left.min(up), left.max(up));
                (plane, (u32::BITS - spread.leading_zeros()) as usize)
            }
            (Some(before), false) => (value(this, before), UNKNOWN),
            (None, true) => (value(above, texel), UNKNOWN),
            (None, false) => (0, UNKNOWN),
        };
        let is_quiet = texel.checked_sub(1).is_none_or(|before| is_as_expected(this, before))
            && (!has_above || is_as_expected(above, texel));
        let green = if of_green { i32::from(this.values[texel * *components + 1]) } else { 0 };
        let number = (component * CLASSES + class) * 2 + usize::from(is_quiet);
        ((green + predicted).clamp(0, 255), &mut chances[number])
    }

    fn set(&mut self, texel: usize, component: usize, value: u8, expected: i32) {
        let at = texel * self.components + component;
        self.this.values[at] = value;
        self.this.deltas[at] = (i32::from(value) - expected) as i16;
    }

    /// Goes on to the next row.
    fn end(&mut self) {
        std::mem::swap(&mut self.above, &mut self.this);
        let length = self.above.values.len();
        self.this.values.resize(length, 0);
        self.this.deltas.resize(length, 0);
    }
}

impl Image<u8> {
    /// Decodes exact colours, or factors.
    ///
    /// # Errors
    /// If the bytes break a rule of the format.
    pub fn decode_exact(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Self> {
        check(size, components)?;
        let (&first, rest) = bytes.split_first().ok_or_else(|| Error::format("an image has no bytes"))?;
        match first {
            EVEN => Self::decode_even(rest, size, components),
            CODED => decode(rest, size, components),
            _ => Err(Error::format("an exact image has a step")),
        }
    }
}

fn decode(bytes: &[u8], size: [u32; 2], components: u8) -> Result<Image<u8>> {
    let mut bits = BitDecoder::new(bytes);
    let mut rows = Rows::new(size, components);
    // Rows are added as they come, so that a short string cannot take much memory.
    let mut data = Vec::new();
    for _ in 0..size[1] {
        for texel in 0..size[0] as usize {
            if texel % CHECKED == 0 {
                bits.check()?;
            }
            for &component in order(components.into()) {
                let (expected, chances) = rows.expect(texel, component);
                let value = expected.checked_add(bits.signed(chances)?).and_then(|value| u8::try_from(value).ok());
                let value = value.ok_or_else(|| Error::format("a component of an exact image exceeds 8 bits"))?;
                rows.set(texel, component, value, expected);
            }
        }
        data.extend_from_slice(&rows.this.values);
        rows.end();
    }
    bits.finish()?;
    Ok(Image { size, components, data })
}

/// Codes an image that comes back exactly where texels are used. The others get those values that cost least.
#[cfg(feature = "write")]
pub fn encode_exact_image(image: &Image<u8>, is_used: &[bool]) -> Vec<u8> {
    if let Some(even) = image.even_texel(is_used) {
        return [&[EVEN], even].concat();
    }
    let mut bits = BitEncoder::new();
    let (count, width) = (usize::from(image.components), image.size[0] as usize);
    let mut rows = Rows::new(image.size, image.components);
    for (values, used) in image.data.chunks_exact(width * count).zip(is_used.chunks_exact(width)) {
        for (texel, (values, &is_used)) in values.chunks_exact(count).zip(used).enumerate() {
            for &component in order(count) {
                let (expected, chances) = rows.expect(texel, component);
                let value = if is_used { values[component] } else { expected as u8 };
                bits.signed(chances, i32::from(value) - expected);
                rows.set(texel, component, value, expected);
            }
        }
        rows.end();
    }
    [&[CODED], bits.finish().as_slice()].concat()
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;

    /// Bytes that look like chance.
    fn noise(count: u32) -> Vec<u8> {
        let mixed = |k: u32| (k ^ k >> 15).wrapping_mul(2_246_822_519);
        (0..count).map(|k| (mixed(mixed(k.wrapping_mul(2_654_435_761))) >> 24) as u8).collect()
    }

    fn assert_exact(image: &Image<u8>, used: &[bool]) -> usize {
        let bytes = encode_exact_image(image, used);
        let back = Image::decode_exact(&bytes, image.size, image.components).unwrap();
        assert_eq!((back.size, back.components, back.data.len()), (image.size, image.components, image.data.len()));
        let count = usize::from(image.components);
        for ((wanted, found), _) in
            image.data.chunks(count).zip(back.data.chunks(count)).zip(used).filter(|(_, used)| **used)
        {
            assert_eq!(wanted, found);
        }
        bytes.len()
    }

    #[test]
    fn texels_come_back_exactly_where_they_are_used() {
        for size in [[1, 1], [7, 3], [8, 8], [1, 90], [90, 1], [300, 5], [33, 40]] {
            for components in 1..=4 {
                let count = size[0] * size[1];
                let smooth = (0..count * u32::from(components)).map(|k| (k / 7 % 256) as u8).collect();
                for data in [noise(count * u32::from(components)), smooth] {
                    let image = Image { size, components, data };
                    assert_exact(&image, &vec![true; count as usize]);
                    let some: Vec<bool> = (0..count).map(|k| k * k % 11 < 5).collect();
                    assert_exact(&image, &some);
                }
            }
        }
    }

    #[test]
    fn the_ends_of_the_range_come_back() {
        // What red has beyond green changes by up to 510.
        let corners = [[0, 0, 0], [255, 0, 255], [0, 255, 0], [255, 255, 255], [255, 0, 0], [0, 255, 255]];
        let data: Vec<u8> = (0..400).flat_map(|k| corners[k * k % 7 % 6]).collect();
        assert_exact(&Image { size: [20, 20], components: 3, data }, &[true; 400]);
    }

    #[test]
    fn images_of_one_colour_have_the_bytes_of_one_and_what_is_not_used_costs_next_to_nothing() {
        for components in 1..=4_u8 {
            let even = Image::filled([50, 30], &[9, 255, 0, 77][..usize::from(components)]);
            assert_eq!(assert_exact(&even, &[true; 1500]), 1 + usize::from(components));
        }
        let image = Image { size: [128, 128], components: 3, data: noise(3 << 14) };
        let half: Vec<bool> = (0..1 << 14).map(|k| k % 128 < 64).collect();
        let [all, half, none] =
            [vec![true; 1 << 14], half, vec![false; 1 << 14]].map(|used| assert_exact(&image, &used));
        assert!((half as f64) < 0.56 * all as f64 && none == 4, "{none} {half} {all}");
    }

    #[test]
    fn colours_take_far_less_than_their_components_apart() {
        let grey = noise(1 << 12);
        let colours = grey.iter().flat_map(|&x| [x, x, x / 2 + 60]).collect();
        let used = [true; 1 << 12];
        let together = assert_exact(&Image { size: [64, 64], components: 3, data: colours }, &used);
        let alone = assert_exact(&Image { size: [64, 64], components: 1, data: grey }, &used);
        assert!(together < 2 * alone, "{together} {alone}");
    }

    #[test]
    fn damaged_images_are_refused_or_decoded_but_never_panic() {
        let size = [60, 40];
        let image = Image { size, components: 4, data: noise(60 * 40 * 4) };
        let bytes = encode_exact_image(&image, &[true; 2400]);
        for at in (0..bytes.len()).step_by(7) {
            for flip in [1, 0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                let _ = Image::decode_exact(&damaged, size, 4);
            }
            // Few bytes are missing where a few texels are.
            assert!(at + 40 > bytes.len() || Image::decode_exact(&bytes[..at], size, 4).is_err(), "{at}");
        }
        assert!(Image::decode_exact(&[bytes.as_slice(), &[0; 6]].concat(), size, 4).is_err());
        let refused = |bytes: &[u8], size: [u32; 2], components| Image::decode_exact(bytes, size, components).is_err();
        assert!(refused(&[], size, 3) && refused(&[0, 1, 2], size, 3) && refused(&[0, 1, 2, 3, 4], size, 3));
        assert!(refused(&[1, 0, 0, 0, 0], size, 3) && refused(&[254], size, 3));
        // Many texels of few bytes take neither memory nor time.
        assert!(refused(&[CODED], [1 << 14; 2], 4) && refused(&[0; 5], [u32::MAX; 2], 4));
    }

    #[test]
    fn components_above_255_are_refused() {
        for (first, second, is_sound) in
            [(255, 0, true), (256, 0, false), (-1, 0, false), (255, 1, false), (3, -4, false)]
        {
            let mut bits = BitEncoder::new();
            let mut rows = Rows::new([2, 1], 1);
            let (_, chances) = rows.expect(0, 0);
            bits.signed(chances, first);
            rows.set(0, 0, first as u8, 0);
            bits.signed(rows.expect(1, 0).1, second);
            let bytes = [&[CODED], bits.finish().as_slice()].concat();
            assert_eq!(Image::decode_exact(&bytes, [2, 1], 1).is_ok(), is_sound, "{first} {second}");
        }
    }
}
