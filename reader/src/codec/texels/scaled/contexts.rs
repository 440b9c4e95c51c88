//! Which chance a bit has: by what its neighbours are, and by what is known of coarser scales.

use super::bits::Counted;
use super::known::KNOWN;

/// Classes of sums of levels nearby.
pub(super) const BINS: usize = 8;
/// Unary bits of a number with chances of their own; further ones share the last.
pub(super) const UNARY: usize = 14;
/// Bins of two share the chances of magnitudes.
const HALF: usize = BINS / 2;
/// The places of a quarter of a band, by frequency.
const CLASSES: [usize; 4] = [0, 2, 7, 16];

/// The chances of one kind of plane in one scale: brightness and opacity, or differences of colour.
///
/// ```text
/// scale 0: [Bins: is it zero, its sign, unary bits]
/// others:  [kind of quarter][bins: is anything there]  [class][bins: is it zero]  [half bins][unary]  [4: sign]
/// ```
const fn plane_length(scale: usize) -> usize {
    match scale {
        0 => BINS * (2 + UNARY),
        _ => 2 * BINS + CLASSES[scale] * BINS + HALF * UNARY + 4,
    }
}

/// Chances of whether a block is left out, in scale 0.
const SKIPS: usize = 3;

/// Where the chances of a scale begin among those of all.
const fn first_of(scale: usize) -> usize {
    let (mut first, mut before) = (0, 0);
    while before < scale {
        first += 2 * plane_length(before) + if before == 0 { SKIPS } else { 0 };
        before += 1;
    }
    first
}

const _: () = assert!(first_of(4) == KNOWN.len(), "there is a known number for each chance");

/// The chances of a scale.
pub(super) struct Chances {
    all: Vec<Counted>,
    scale: usize,
}

impl Chances {
    pub fn of(scale: usize) -> Self {
        let all = KNOWN[first_of(scale)..first_of(scale + 1)].iter().map(|&known| Counted::new(known)).collect();
        Self { all, scale }
    }

    /// By how many of the blocks to the left and above are there.
    pub fn skip(&mut self, known: usize) -> &mut Counted {
        &mut self.all[known]
    }

    fn plane(&mut self, is_difference: bool) -> &mut [Counted] {
        let skips = if self.scale == 0 { SKIPS } else { 0 };
        let length = plane_length(self.scale);
        let first = skips + if is_difference { length } else { 0 };
        &mut self.all[first..first + length]
    }

    /// Of the mean of a block, by how much its neighbours differ: whether it is as expected, its sign, and its size.
    pub fn constant(&mut self, is_difference: bool, bin: usize) -> &mut [Counted; 2 + UNARY] {
        let first = bin * (2 + UNARY);
        self.plane(is_difference)[first..].first_chunk_mut().expect("of that length")
    }

    /// Of all coefficients but the mean.
    pub fn band(&mut self, is_difference: bool) -> BandChances<'_> {
        let classes = CLASSES[self.scale];
        let (quarters, rest) = self.plane(is_difference).split_at_mut(2 * BINS);
        let (zeros, rest) = rest.split_at_mut(classes * BINS);
        let (sizes, signs) = rest.split_at_mut(HALF * UNARY);
        BandChances { quarters, zeros, sizes, signs }
    }
}

pub(super) struct BandChances<'c> {
    quarters: &'c mut [Counted],
    zeros: &'c mut [Counted],
    sizes: &'c mut [Counted],
    signs: &'c mut [Counted],
}

impl BandChances<'_> {
    /// Whether a quarter of a band has anything.
    pub fn quarter(&mut self, is_diagonal: bool, bin: usize) -> &mut Counted {
        &mut self.quarters[usize::from(is_diagonal) * BINS + bin]
    }

    pub fn zero(&mut self, class: usize, bin: usize) -> &mut Counted {
        &mut self.zeros[class * BINS + bin]
    }

    pub fn size(&mut self, bin: usize) -> &mut [Counted; UNARY] {
        self.sizes[bin / 2 * UNARY..].first_chunk_mut().expect("of that length")
    }

    /// Whether a sign is the expected one, by how much speaks for it.
    pub fn sign(&mut self, strength: usize) -> &mut Counted {
        &mut self.signs[strength.min(3)]
    }
}

/// The class of a sum of levels.
#[inline(always)]
pub(super) fn bin_of(sum: u32) -> usize {
    const LAST: usize = 31;
    static BIN_OF: [u8; LAST + 1] =
        [0, 1, 1, 2, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 7, 7, 7, 7, 7, 7, 7];
    usize::from(BIN_OF[(sum as usize).min(LAST)])
}

/// The class of a place in the band of a scale: by its larger and its smaller coordinate.
#[inline(always)]
pub(super) fn class_of(scale: usize, u: usize, v: usize) -> usize {
    let (large, small) = (u.max(v), u.min(v));
    match scale {
        1 => small,
        2 => {
            if large == 2 {
                small
            } else {
                3 + small
            }
        }
        _ => {
            4 * (large - 4)
                + match small {
                    0 => 0,
                    1..=2 => 1,
                    3..=4 => 2,
                    _ => 3,
                }
        }
    }
}
