//! The levels of an image's blocks, scale by scale: one code for those who write and those who read.

use super::super::{
    planes::{is_difference, too_large},
    transform::MOST,
};
use super::bits::{Bits, Counted};
use super::contexts::{BandChances, Chances, UNARY, bin_of, class_of};
use crate::error::Result;

/// Blocks between checks that the bytes have not ended.
const CHECKED: usize = 64;
/// A block that is left out.
const NONE: u32 = u32::MAX;
/// Where nothing is.
static NOTHING: [i16; 64] = [0; 64];

/// Quantised coefficients of blocks.
#[derive(Debug)]
pub(super) struct Levels {
    pub columns: usize,
    pub rows: usize,
    pub components: usize,
    /// Coefficients along each side of a block: 1, 2, 4 or 8.
    pub side: usize,
    /// For each block its number among those that are not left out.
    pub numbers: Vec<u32>,
    /// For each of these and each component the coefficients of lowest frequency, row after row.
    pub values: Vec<i16>,
}

impl Levels {
    pub fn new(size: [u32; 2], components: usize, side: usize) -> Self {
        let [columns, rows] = size.map(|length| (length as usize).div_ceil(8));
        Self { columns, rows, components, side, numbers: vec![], values: vec![] }
    }

    /// Where the coefficients of a block begin.
    pub fn place(&self, block: usize) -> Option<usize> {
        let number = *self.numbers.get(block).filter(|&&number| number != NONE)?;
        Some(number as usize * self.components * self.side * self.side)
    }

    /// Adds a block behind the others.
    pub fn push(&mut self, is_there: bool) {
        let length = self.components * self.side * self.side;
        let number = (self.values.len() / length) as u32;
        self.numbers.push(if is_there { number } else { NONE });
        if is_there {
            self.values.resize(self.values.len() + length, 0);
        }
    }

    /// The blocks to the left, above, and beside that one.
    fn around(&self, block: usize) -> [Option<usize>; 4] {
        let (column, row) = (block % self.columns, block / self.columns);
        let left = if column > 0 { self.place(block - 1) } else { None };
        let above = if row > 0 { self.place(block - self.columns) } else { None };
        let corner = if row > 0 && column > 0 { self.place(block - self.columns - 1) } else { None };
        let right = if row > 0 && column + 1 < self.columns { self.place(block - self.columns + 1) } else { None };
        [left, above, corner, right]
    }

    /// Of each scale whether it adds anything, of blocks of 8 x 8.
    #[cfg(feature = "write")]
    pub fn bands(&self) -> [bool; 4] {
        let mut all = [0_u16; 64];
        for block in self.values.as_chunks::<64>().0 {
            all.iter_mut().zip(block).for_each(|(all, &level)| *all |= level as u16);
        }
        let has = |band: std::ops::Range<usize>| {
            all.iter().enumerate().any(|(at, &bits)| bits != 0 && band.contains(&(at % 8).max(at / 8)))
        };
        [true, has(1..2), has(2..4), has(4..8)]
    }

    /// Codes which blocks are there, and their means. Blocks are added where they are read.
    pub fn code_means<B: Bits>(&mut self, bits: &mut B, is_read: bool) -> Result<()> {
        let mut chances = Chances::of(0);
        let area = self.side * self.side;
        for block in 0..self.columns * self.rows {
            if block % CHECKED == 0 {
                bits.check()?;
            }
            let around = self.around(block);
            let known = usize::from(around[0].is_some()) + usize::from(around[1].is_some());
            let is_there = bits.bit(chances.skip(known), !is_read && self.place(block).is_some());
            if is_read {
                self.push(is_there);
            }
            let Some(place) = self.place(block) else { continue };
            let mut before = 0;
            for component in 0..self.components {
                let at = |place: Option<usize>| place.map(|place| i32::from(self.values[place + component * area]));
                let (expected, spread) = expected(around.map(at));
                let is_difference = is_difference(component, self.components);
                let bin = bin_of(spread + if is_difference { before } else { 0 });
                let value = i32::from(self.values[place + component * area]) - expected;
                let value = code_mean(bits, chances.constant(is_difference, bin), value)?;
                let level = value.checked_add(expected).filter(|level| level.abs() <= MOST);
                self.values[place + component * area] = level.ok_or_else(too_large)? as i16;
                before = value.unsigned_abs().min(8);
            }
        }
        Ok(())
    }

    /// Codes the band that a scale, 1 to 3, adds.
    pub fn code_band<B: Bits>(&mut self, bits: &mut B, scale: usize) -> Result<()> {
        // Loops whose lengths are known when this is compiled take less time.
        match (self.side, scale) {
            (2, 1) => self.code_band_of::<B, 2, 1>(bits),
            (4, 1) => self.code_band_of::<B, 4, 1>(bits),
            (8, 1) => self.code_band_of::<B, 8, 1>(bits),
            (4, 2) => self.code_band_of::<B, 4, 2>(bits),
            (8, 2) => self.code_band_of::<B, 8, 2>(bits),
            _ => self.code_band_of::<B, 8, 3>(bits),
        }
    }

    fn code_band_of<B: Bits, const SIDE: usize, const SCALE: usize>(&mut self, bits: &mut B) -> Result<()> {
        let mut chances = Chances::of(SCALE);
        let area = SIDE * SIDE;
        for block in 0..self.numbers.len() {
            if block % CHECKED == 0 {
                bits.check()?;
            }
            let Some(place) = self.place(block) else { continue };
            let around = self.around(block);
            for component in 0..self.components {
                let slopes = if SCALE == 1 { self.slopes(block, component) } else { [0; 3] };
                let (before, rest) = self.values.split_at_mut(place + component * area);
                let near = |place: Option<usize>| {
                    place
                        .and_then(|place| before.get(place + component * area..))
                        .map_or(&NOTHING[..area], |of| &of[..area])
                };
                let is_difference = is_difference(component, self.components);
                let same = |back: usize| &before[before.len() - back * area..][..area];
                let block = BlockCode::<'_, SIDE, SCALE> {
                    left: near(around[0]),
                    above: near(around[1]),
                    brightness: if is_difference { same(component) } else { &NOTHING[..area] },
                    difference: if is_difference && component == 2 { same(1) } else { &NOTHING[..area] },
                    slopes,
                };
                block.code(bits, &mut chances.band(is_difference), &mut rest[..area])?;
            }
        }
        Ok(())
    }

    /// What the means around a block say about its lowest frequencies: those of a plane through them, in levels.
    fn slopes(&self, block: usize, component: usize) -> [i32; 3] {
        let (column, row) = (block % self.columns, block / self.columns);
        let mean = |is_inside: bool, at: usize| {
            let place = if is_inside { self.place(at) } else { None };
            place.map(|place| i32::from(self.values[place + component * self.side * self.side]))
        };
        let own = mean(true, block);
        let slope = |low: Option<i32>, high: Option<i32>| match (low, high, own) {
            (Some(low), Some(high), _) => low - high,
            (None, Some(high), Some(own)) => 2 * (own - high),
            (Some(low), None, Some(own)) => 2 * (low - own),
            _ => 0,
        };
        let left = mean(column > 0, block.wrapping_sub(1));
        let right = mean(column + 1 < self.columns, block + 1);
        let above = mean(row > 0, block.wrapping_sub(self.columns));
        let below = mean(row + 1 < self.rows, block + self.columns);
        [slope(left, right), slope(above, below), 0]
    }
}

/// The mean that is expected of a block, from those to the left, above and beside that one; and how much these differ.
fn expected([left, above, corner, right]: [Option<i32>; 4]) -> (i32, u32) {
    match (left, above) {
        (Some(left), Some(above)) => {
            let corner = corner.unwrap_or((left + above) >> 1);
            let right = right.unwrap_or(above);
            // A plane, but not beyond both.
            let plane = left.max(above).min((left + above - corner).max(left.min(above)));
            let spread = left.abs_diff(corner) + above.abs_diff(corner) + above.abs_diff(right);
            (plane, spread)
        }
        (Some(one), None) | (None, Some(one)) => (one, 12),
        (None, None) => (0, u32::MAX >> 1),
    }
}

/// What is known where a block's coefficients of a scale are coded, of which `SIDE` stand along each side.
struct BlockCode<'l, const SIDE: usize, const SCALE: usize> {
    left: &'l [i16],
    above: &'l [i16],
    /// The same block's brightness, and its first difference.
    brightness: &'l [i16],
    difference: &'l [i16],
    /// Expected coefficients at (1, 0), (0, 1) and (1, 1), times seven.
    slopes: [i32; 3],
}

impl<const SIDE: usize, const SCALE: usize> BlockCode<'_, SIDE, SCALE> {
    const HALF: usize = 1 << (SCALE - 1);

    #[inline(always)]
    fn code<B: Bits>(&self, bits: &mut B, chances: &mut BandChances<'_>, values: &mut [i16]) -> Result<()> {
        for (number, [right, down]) in [[1, 0], [0, 1], [1, 1]].into_iter().enumerate() {
            let first = [right * Self::HALF, down * Self::HALF];
            if SCALE > 1 && !self.code_quarter(bits, chances, first, values) {
                continue;
            }
            for v in first[1]..first[1] + Self::HALF {
                for u in first[0]..first[0] + Self::HALF {
                    let slope = if SCALE == 1 { self.slopes[number] } else { 0 };
                    self.code_level(bits, chances, [u, v], slope, values)?;
                }
            }
        }
        Ok(())
    }

    /// The sum of absolute levels in a square.
    #[inline(always)]
    fn sum(values: &[i16], [x, y]: [usize; 2], side: usize) -> u32 {
        let row = |v: usize| values[v * SIDE + x..v * SIDE + x + side].iter();
        (y..y + side).flat_map(row).map(|level| u32::from(level.unsigned_abs())).sum()
    }

    /// Codes whether a quarter of a band has anything.
    #[inline(always)]
    fn code_quarter<B: Bits>(
        &self,
        bits: &mut B,
        chances: &mut BandChances<'_>,
        first: [usize; 2],
        values: &[i16],
    ) -> bool {
        let here = |values: &[i16]| Self::sum(values, first, Self::HALF);
        // The same directions one scale coarser.
        let coarser = Self::sum(values, first.map(|x| x / 2), Self::HALF / 2);
        let other = here(self.difference).min(4) * 2 + here(self.brightness).min(8) / 2;
        let bin = bin_of(here(self.left) + here(self.above) + 2 * coarser + other);
        bits.bit(chances.quarter(first[0] == first[1], bin), here(values) > 0)
    }

    #[inline(always)]
    fn code_level<B: Bits>(
        &self,
        bits: &mut B,
        chances: &mut BandChances<'_>,
        [u, v]: [usize; 2],
        slope: i32,
        values: &mut [i16],
    ) -> Result<()> {
        let at = v * SIDE + u;
        let size = |values: &[i16], at: usize| u32::from(values[at].unsigned_abs());
        // The mean says nothing here.
        let own = |u: usize, v: usize| if u + v == 0 { 0 } else { size(values, v * SIDE + u) };
        let mut sum = 2 * (size(self.left, at) + size(self.above, at));
        if u > 0 {
            sum += 2 * own(u - 1, v);
        }
        if v > 0 {
            sum += 2 * own(u, v - 1);
        }
        if u > 0 && v > 0 {
            sum += own(u - 1, v - 1);
        }
        sum += own(u / 2, v / 2) + size(self.brightness, at) + 2 * size(self.difference, at);
        let expected = slope.unsigned_abs() / 7;
        let bin = bin_of(sum + 2 * expected);
        let level = i32::from(values[at]);
        if !bits.bit(chances.zero(class_of(SCALE, u, v), bin), level != 0) {
            values[at] = 0;
            return Ok(());
        }
        let size = 1 + code_number(bits, chances.size(bin), level.unsigned_abs().wrapping_sub(1))?;
        let is_negative = match slope {
            0 => bits.even(level < 0),
            _ => bits.bit(chances.sign(expected as usize), (level < 0) != (slope < 0)) != (slope < 0),
        };
        let size = i32::try_from(size).ok().filter(|&size| size <= MOST).ok_or_else(too_large)?;
        values[at] = if is_negative { -size } else { size } as i16;
        Ok(())
    }
}

/// Codes by how much a mean differs from what is expected.
fn code_mean<B: Bits>(bits: &mut B, chances: &mut [Counted; 2 + UNARY], value: i32) -> Result<i32> {
    let [zero, sign, unary @ ..] = chances;
    if !bits.bit(zero, value != 0) {
        return Ok(0);
    }
    let is_negative = bits.bit(sign, value < 0);
    let size = code_number(bits, unary, value.unsigned_abs().wrapping_sub(1))?;
    let size = i32::try_from(size).ok().filter(|&size| size < 2 * MOST).ok_or_else(too_large)? + 1;
    Ok(if is_negative { -size } else { size })
}

/// Codes a number: in unary up to the number of chances, what is beyond as in Elias' gamma code.
#[inline(always)]
fn code_number<B: Bits>(bits: &mut B, chances: &mut [Counted; UNARY], value: u32) -> Result<u32> {
    for (unary, chance) in (0..).zip(chances) {
        if !bits.bit(chance, value > unary) {
            return Ok(unary);
        }
    }
    let rest = value.wrapping_sub(UNARY as u32 - 1);
    let length = rest.max(1).ilog2();
    let mut count = 0;
    while bits.even(count < length) {
        count += 1;
        if count > 16 {
            return Err(too_large());
        }
    }
    let found = (0..count).rev().fold(1, |found, k| found << 1 | u32::from(bits.even(rest >> k & 1 == 1)));
    Ok(found + UNARY as u32 - 1)
}
