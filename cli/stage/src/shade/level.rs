//! One level of a texture: numbers of texels, and what lies between them.

use glam::Vec3A;

use super::texels::{Bytes, Place};
use lodpack_mesh::appearance::Wrap;
use lodpack_mesh::images::texels_of;
use lodpack_mesh::srgb::LINEAR_OF_BYTE;
use lodpack_runtime::storage::WorkError;

/// Texels of one size.
pub(super) struct Level {
    pub size: [u32; 2],
    pub texels: Texels,
}

/// Red, green, blue and straight alpha. What has no alpha is opaque.
pub(super) enum Texels {
    /// Encoded as sRGB, as most images are: three bytes a texel, as they were decoded, because the largest images take
    /// most memory here.
    Opaque(Bytes),
    /// As [`Texels::Root`].
    OpaqueRoot(Bytes),
    /// Encoded as sRGB.
    Encoded(Bytes),
    /// As shares of 255.
    Shares(Bytes),
    /// The square root of linear light, and alpha, as shares of 65535: as fine as 12 bits of sRGB everywhere, and
    /// decoded exactly by a multiplication. Numbers of 16 bits are little-endian.
    Root(Bytes),
}

/// Bits of a fraction of a texel.
const FRACTION: u32 = 32;

/// Places in a row that lie between texels of an image, none of them near to its border.
pub(super) struct Row {
    /// Texels in a row of the image.
    width: usize,
    /// The first place, in 2^-32 of a texel from the middle of the first one, and what is added from each place to the
    /// next.
    at: [i64; 2],
    step: [i64; 2],
}

impl Row {
    /// Linear light at each of them, between four texels.
    pub fn sample(&self, texels: &[[u8; 3]], colours: &mut [[f32; 3]]) {
        let light = |texel: [u8; 3]| Vec3A::from_array(texel.map(|value| LINEAR_OF_BYTE[usize::from(value)]));
        let mut at = self.at;
        for colour in colours {
            let [column, row] = at.map(|x| (x >> FRACTION) as usize);
            // As exact as single precision.
            let [right, below] = at.map(|x| (x as u32 >> 8) as f32 * (1.0 / (1 << 24) as f32));
            let first = row * self.width + column;
            let [&[a, b], &[c, d]] = [first, first + self.width].map(|first| first_pair(&texels[first..]));
            let [a, b, c, d] = [a, b, c, d].map(light);
            let (upper, lower) = (a + (b - a) * right, c + (d - c) * right);
            *colour = (upper + (lower - upper) * below).to_array();
            at = [at[0] + self.step[0], at[1] + self.step[1]];
        }
    }
}

/// The first two texels of several.
#[inline(always)]
fn first_pair(texels: &[[u8; 3]]) -> &[[u8; 3]; 2] {
    texels.first_chunk().unwrap_or(&[[0; 3]; 2])
}

impl Texels {
    /// Whether no texel is transparent.
    pub fn are_opaque(&self) -> bool {
        let are_opaque = match self {
            Self::Opaque(_) | Self::OpaqueRoot(_) => true,
            Self::Encoded(all) | Self::Shares(all) => all.as_chunks::<4>().0.iter().all(|texel| texel[3] == u8::MAX),
            Self::Root(all) => all.as_chunks::<8>().0.iter().all(|texel| texel[6..] == [u8::MAX; 2]),
        };
        self.bytes().drop_pages();
        are_opaque
    }

    pub fn bytes(&self) -> &Bytes {
        let (Self::Opaque(all) | Self::OpaqueRoot(all) | Self::Encoded(all) | Self::Shares(all) | Self::Root(all)) =
            self;
        all
    }
}

impl Level {
    /// Bytes of a texel of its averages.
    pub fn averaged_bytes(&self) -> u64 {
        if self.is_opaque() { 6 } else { 8 }
    }

    /// Linear light times alpha, and alpha.
    #[inline]
    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        let at = y as usize * self.size[0] as usize + x as usize;
        match &self.texels {
            Texels::Opaque(texels) => of_opaque(texels.as_chunks().0[at]),
            Texels::OpaqueRoot(texels) => of_opaque_root(texels.as_chunks().0[at]),
            Texels::Encoded(texels) => of_encoded(texels.as_chunks().0[at]),
            Texels::Shares(texels) => of_shares(texels.as_chunks().0[at]),
            Texels::Root(texels) => of_root(texels.as_chunks().0[at]),
        }
    }

    /// Places in a row, if they lie within.
    #[inline]
    pub fn row(&self, at: [f64; 2], step: [f64; 2], wrap: [Wrap; 2], count: usize) -> Option<Row> {
        /// More than is lost where fractions are rounded, in texels.
        const MARGIN: f64 = 1.0 / 1024.0;
        let unit = (1_u64 << FRACTION) as f64;
        let mut row = Row { width: self.size[0] as usize, at: [0; 2], step: [0; 2] };
        for axis in 0..2 {
            let length = f64::from(self.size[axis]);
            let whole = if wrap[axis] == Wrap::Repeat { floor(at[axis]) } else { 0.0 };
            // From the middle of the first texel.
            let (first, step) = ((at[axis] - whole) * length - 0.5, step[axis] * length);
            let last = first + step * count.saturating_sub(1) as f64;
            // Comparisons with NaN are false.
            if !(first.min(last) >= MARGIN && first.max(last) <= length - 1.0 - MARGIN) {
                return None;
            }
            (row.at[axis], row.step[axis]) = ((first * unit) as i64, (step * unit) as i64);
        }
        Some(row)
    }

    /// Linear light times alpha, and alpha, between four texels.
    #[inline]
    pub fn sample(&self, at: [f64; 2], wrap: [Wrap; 2]) -> [f32; 4] {
        let columns = neighbours(at[0], self.size[0], wrap[0]);
        let rows = neighbours(at[1], self.size[1], wrap[1]);
        match &self.texels {
            Texels::Opaque(texels) => blended(texels.as_chunks().0, self.size[0], columns, rows, of_opaque),
            Texels::OpaqueRoot(texels) => blended(texels.as_chunks().0, self.size[0], columns, rows, of_opaque_root),
            Texels::Encoded(texels) => blended(texels.as_chunks().0, self.size[0], columns, rows, of_encoded),
            Texels::Shares(texels) => blended(texels.as_chunks().0, self.size[0], columns, rows, of_shares),
            Texels::Root(texels) => blended(texels.as_chunks().0, self.size[0], columns, rows, of_root),
        }
    }

    fn is_opaque(&self) -> bool {
        matches!(self.texels, Texels::Opaque(_) | Texels::OpaqueRoot(_))
    }

    /// The level of half its size, in memory.
    pub fn coarser(&self) -> Self {
        let size = coarser_size(self.size).unwrap_or(self.size);
        let mut all = Vec::with_capacity((texels_of(size) * self.averaged_bytes()) as usize);
        self.average(size, &mut |texel| all.extend_from_slice(texel));
        self.averages(size, Bytes::Memory(all))
    }

    /// The same, in a file.
    pub fn coarser_at(&self, place: &Place) -> Result<Self, WorkError> {
        let size = coarser_size(self.size).unwrap_or(self.size);
        let all = place.keep(texels_of(size) * self.averaged_bytes(), |push| {
            self.average(size, push);
            Ok::<(), WorkError>(())
        })?;
        Ok(self.averages(size, all))
    }

    fn averages(&self, size: [u32; 2], all: Bytes) -> Self {
        Self { size, texels: if self.is_opaque() { Texels::OpaqueRoot(all) } else { Texels::Root(all) } }
    }

    /// Hands on the texels of a level of another size.
    fn average(&self, size: [u32; 2], push: &mut dyn FnMut(&[u8])) {
        /// Rows after which pages of files are dropped.
        const ROWS: usize = 64;
        let (columns, rows) = (shares(self.size[0], size[0]), shares(self.size[1], size[1]));
        let of_texel = self.averaged_bytes() as usize;
        for (number, row) in rows.iter().enumerate() {
            for column in &columns {
                let mut sum = [0.0; 4];
                for &(y, of_row) in row.iter().filter(|(_, share)| *share > 0.0) {
                    for &(x, of_column) in column.iter().filter(|(_, share)| *share > 0.0) {
                        let texel = self.texel(x, y);
                        (0..4).for_each(|i| sum[i] += of_row * of_column * texel[i]);
                    }
                }
                push(&little_endian(root(straight(sum)))[..of_texel]);
            }
            if number % ROWS == ROWS - 1 {
                self.texels.bytes().drop_pages();
            }
        }
    }
}

/// The bytes of four numbers.
pub(super) fn little_endian(texel: [u16; 4]) -> [u8; 8] {
    let [[a, b], [c, d], [e, f], [g, h]] = texel.map(u16::to_le_bytes);
    [a, b, c, d, e, f, g, h]
}

/// Half of a size; none of one texel.
pub(super) fn coarser_size(size: [u32; 2]) -> Option<[u32; 2]> {
    (size != [1, 1]).then(|| size.map(|length| (length / 2).max(1)))
}

#[inline(always)]
fn of_opaque(texel: [u8; 3]) -> [f32; 4] {
    let [red, green, blue] = texel;
    [LINEAR_OF_BYTE[usize::from(red)], LINEAR_OF_BYTE[usize::from(green)], LINEAR_OF_BYTE[usize::from(blue)], 1.0]
}

#[inline(always)]
fn of_opaque_root([a, b, c, d, e, f]: [u8; 6]) -> [f32; 4] {
    let [red, green, blue] = [[a, b], [c, d], [e, f]].map(|pair| f32::from(u16::from_le_bytes(pair)) / 65535.0);
    [red * red, green * green, blue * blue, 1.0]
}

#[inline(always)]
fn of_encoded([red, green, blue, alpha]: [u8; 4]) -> [f32; 4] {
    let linear = |value: u8| LINEAR_OF_BYTE[usize::from(value)];
    times_alpha([linear(red), linear(green), linear(blue), f32::from(alpha) / 255.0])
}

#[inline(always)]
fn of_shares(texel: [u8; 4]) -> [f32; 4] {
    times_alpha(texel.map(|value| f32::from(value) / 255.0))
}

#[inline(always)]
fn of_root([a, b, c, d, e, f, g, h]: [u8; 8]) -> [f32; 4] {
    let pairs = [[a, b], [c, d], [e, f], [g, h]];
    let [red, green, blue, alpha] = pairs.map(|pair| f32::from(u16::from_le_bytes(pair)) / 65535.0);
    times_alpha([red * red, green * green, blue * blue, alpha])
}

#[inline(always)]
fn times_alpha([red, green, blue, alpha]: [f32; 4]) -> [f32; 4] {
    [red * alpha, green * alpha, blue * alpha, alpha]
}

/// The sum of the four texels in two columns and two rows, each with its shares.
#[inline(always)]
fn blended<T: Copy>(
    texels: &[T],
    width: u32,
    columns: [(u32, f32); 2],
    rows: [(u32, f32); 2],
    value: impl Fn(T) -> [f32; 4],
) -> [f32; 4] {
    let mut sum = [0.0; 4];
    for (y, of_row) in rows {
        let row = &texels[y as usize * width as usize..][..width as usize];
        for (x, of_column) in columns {
            let (texel, share) = (value(row[x as usize]), of_row * of_column);
            (0..4).for_each(|i| sum[i] += share * texel[i]);
        }
    }
    sum
}

/// For each of fewer texels in a row those that it covers, at most three, and their shares.
fn shares(from: u32, to: u32) -> Vec<[(u32, f32); 3]> {
    let covered = |texel: u32| {
        // All ends are multiples of 1 / to, so the arithmetic is of whole numbers.
        let (start, end) = (u64::from(texel) * u64::from(from), (u64::from(texel) + 1) * u64::from(from));
        let first = start / u64::from(to);
        std::array::from_fn(|i| {
            let at = first + i as u64;
            let (low, high) = (start.max(at * u64::from(to)), end.min((at + 1) * u64::from(to)));
            ((at as u32).min(from - 1), high.saturating_sub(low) as f32 / from as f32)
        })
    };
    (0..to).map(covered).collect()
}

/// The two texels around a place, and their shares.
#[inline]
fn neighbours(at: f64, count: u32, wrap: Wrap) -> [(u32, f32); 2] {
    let length = f64::from(count);
    let within = match wrap {
        Wrap::Repeat => at - floor(at),
        Wrap::Mirror => 1.0 - (at - 2.0 * floor(at / 2.0) - 1.0).abs(),
        Wrap::Clamp => at.clamp(0.0, 1.0),
    };
    // At least -0.5, so that the conversion rounds down. Far from 0 nothing is left of a fraction, and `within` may be
    // anything.
    let place = within.clamp(0.0, 1.0) * length + 0.5;
    let high = place as u32;
    let share = (place - f64::from(high)) as f32;
    let (first, last) = if wrap == Wrap::Repeat { (0, count - 1) } else { (count - 1, 0) };
    let low = if high > 0 { high - 1 } else { last };
    [(low, 1.0 - share), (if high < count { high } else { first }, share)]
}

/// The largest whole number that is not greater. Numbers that are too large to have a fraction are whole.
#[inline]
fn floor(x: f64) -> f64 {
    if x.abs() >= (1_u64 << 52) as f64 {
        return x;
    }
    let whole = x as i64 as f64;
    if whole > x { whole - 1.0 } else { whole }
}

/// Colours without the alpha by which they are multiplied.
#[inline]
pub(super) fn straight([red, green, blue, alpha]: [f32; 4]) -> [f32; 4] {
    if alpha == 1.0 {
        return [red, green, blue, alpha];
    }
    if alpha > 0.0 { [red / alpha, green / alpha, blue / alpha, alpha] } else { [0.0; 4] }
}

pub(super) fn root([red, green, blue, alpha]: [f32; 4]) -> [u16; 4] {
    let share = |value: f32| (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16;
    [share(red.sqrt()), share(green.sqrt()), share(blue.sqrt()), share(alpha)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarser_texels_cover_finer_ones_without_gaps() {
        for from in 2..40 {
            let shares = shares(from, from / 2);
            let mut all = vec![0.0; from as usize];
            for covered in &shares {
                assert!((covered.iter().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-6);
                covered.iter().for_each(|&(at, share)| all[at as usize] += share);
            }
            assert!(all.iter().all(|sum| (sum - all[0]).abs() < 1e-6), "{from}: {all:?}");
        }
    }

    #[test]
    fn places_far_outside_are_wrapped() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for at in [0.0, 1.0, -1.0, 0.999_999_999, 1e9, -1e9, 1e300, -0.25, f64::MIN_POSITIVE] {
                for count in [1, 2, 3, 1000] {
                    let [(a, share), (b, other)] = neighbours(at, count, wrap);
                    assert!(
                        a < count && b < count && (share + other - 1.0).abs() < 1e-6 && share >= 0.0,
                        "{at} {count}"
                    );
                }
            }
        }
        assert_eq!(neighbours(1.25, 2, Wrap::Repeat)[0], (0, 1.0));
        assert_eq!(neighbours(1.25, 2, Wrap::Mirror)[0].0, 1);
    }
}
