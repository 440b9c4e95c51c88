//! Bits with adaptive probabilities: a range coder as that of LZMA, with probabilities that are means of a fast and a
//! slow estimate.

#[cfg(feature = "write")]
use crate::codec::entropy::zigzag;
use crate::error::{Error, Result};

/// Missing bytes at the end are zero. No decoder needs more of them than this many.
const MOST_MISSING: u32 = 5;
/// Unary parts of numbers that are longer than this are refused: no 32-bit number has them.
const LONGEST: u32 = 32;

/// The probability of a zero, as it is estimated from what came before.
pub(crate) trait Estimate {
    /// In 1/4096, from 4 to 4091.
    fn of_zero(&self) -> u32;
    /// Takes what has come.
    fn learn(&mut self, bit: bool);
}

/// The estimated probability of a zero, learned quickly and slowly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chance([u16; 2]);

impl Default for Chance {
    fn default() -> Self {
        Self([1 << 15; 2])
    }
}

impl Estimate for Chance {
    fn of_zero(&self) -> u32 {
        (u32::from(self.0[0]) + u32::from(self.0[1])) >> 5
    }

    #[inline]
    fn learn(&mut self, bit: bool) {
        // After a zero, what is left to 1 becomes smaller; after a one, the estimate itself. Processors do not foresee
        // which it is.
        let flip = u16::from(bit).wrapping_sub(1);
        for (estimate, rate) in self.0.iter_mut().zip([4, 7]) {
            let rest = *estimate ^ flip;
            *estimate = (rest - (rest >> rate)) ^ flip;
        }
    }
}

/// The chances of a number: see [`BitDecoder::number`].
#[derive(Clone, Debug, Default)]
pub(crate) struct NumberChances {
    unary: [Chance; 16],
    length: [Chance; LONGEST as usize],
}

/// Reads bits.
pub(crate) struct BitDecoder<'a> {
    bytes: std::slice::Iter<'a, u8>,
    missing: u32,
    range: u32,
    code: u32,
}

impl<'a> BitDecoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut this = Self { bytes: bytes.iter(), missing: 0, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            this.code = this.code << 8 | this.next();
        }
        this
    }

    fn next(&mut self) -> u32 {
        match self.bytes.next() {
            Some(&byte) => u32::from(byte),
            None => {
                self.missing = self.missing.saturating_add(1);
                0
            }
        }
    }

    #[inline]
    fn below(&mut self, bound: u32) -> bool {
        let is_below = self.code < bound;
        if is_below {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.code = self.code << 8 | self.next();
        }
        is_below
    }

    /// A bit with an adaptive probability.
    #[inline]
    pub(crate) fn bit(&mut self, chance: &mut impl Estimate) -> bool {
        let bit = !self.below((self.range >> 12) * chance.of_zero());
        chance.learn(bit);
        bit
    }

    /// Bits of equal probabilities, the highest first; at most 32.
    pub(crate) fn raw(&mut self, count: u32) -> u32 {
        (0..count).fold(0, |value, _| value << 1 | u32::from(!self.below(self.range >> 1)))
    }

    /// An unsigned number. Up to 15 it is unary; what is left of larger ones is coded as in Elias' gamma code.
    #[inline]
    pub(crate) fn number(&mut self, chances: &mut NumberChances) -> Result<u32> {
        for (value, chance) in (0..).zip(&mut chances.unary) {
            if !self.bit(chance) {
                return Ok(value);
            }
        }
        let mut length = 0;
        while self.bit(chances.length.get_mut(length as usize).ok_or_else(too_large)?) {
            length += 1;
        }
        let rest = (1_u64 << length) + u64::from(self.raw(length)) - 1;
        u32::try_from(rest + 16).map_err(|_| too_large())
    }

    /// A signed number, zigzag mapped.
    #[inline]
    pub(crate) fn signed(&mut self, chances: &mut NumberChances) -> Result<i32> {
        let value = self.number(chances)?;
        Ok((value >> 1) as i32 ^ -((value & 1) as i32))
    }

    /// Refuses a string that ended long before its bits did. Long images check now and then, so that a short string
    /// cannot make work.
    pub(crate) fn check(&self) -> Result<()> {
        if self.missing <= MOST_MISSING { Ok(()) } else { Err(Error::format("a string of bits ends early")) }
    }

    /// Checks that all bytes have been read.
    pub(crate) fn finish(self) -> Result<()> {
        self.check()?;
        if self.bytes.as_slice().is_empty() {
            Ok(())
        } else {
            Err(Error::format("a string of bits has bytes left over"))
        }
    }
}

fn too_large() -> Error {
    Error::format("a number among bits exceeds 32 bits")
}

/// Writes bits.
#[cfg(feature = "write")]
pub(crate) struct BitEncoder {
    pub(crate) interval: Interval,
    pub(crate) bytes: Vec<u8>,
}

/// The interval of a [`BitEncoder`], apart from the bytes before it: code for many bits keeps it in registers.
#[cfg(feature = "write")]
#[derive(Clone, Copy)]
pub(crate) struct Interval {
    /// Its lower end: 32 bits, before them those that wait, and a carry.
    low: u64,
    range: u32,
    /// How many bits wait to become bytes: whole bytes, so that two are written at a time, and processors seldom have
    /// to foresee when. Bytes and those that wait are as many as a decoder takes beyond its first four.
    waiting: u32,
}

#[cfg(feature = "write")]
impl Interval {
    /// Writes the first two bytes of those that wait.
    #[inline(always)]
    fn write(&mut self, bytes: &mut Vec<u8>) {
        self.carry(bytes);
        let rest = u32::BITS + self.waiting - u16::BITS;
        bytes.extend_from_slice(&((self.low >> rest) as u16).to_be_bytes());
        self.low &= (1 << rest) - 1;
        self.waiting -= u16::BITS;
    }

    /// Hands a carry to the bytes, which may change.
    #[inline(always)]
    fn carry(&mut self, bytes: &mut [u8]) {
        let end = u32::BITS + self.waiting;
        if self.low >> end > 0 {
            self.low &= (1 << end) - 1;
            add_carry(bytes);
        }
    }

    #[inline(always)]
    fn narrow(&mut self, bytes: &mut Vec<u8>, bound: u32, is_below: bool) {
        self.low += if is_below { 0 } else { u64::from(bound) };
        self.range = if is_below { bound } else { self.range - bound };
        // At least 24 bits of the range are kept: no chance makes it smaller by more than two bytes.
        let shift = 8 * (u32::from(self.range < 1 << 24) + u32::from(self.range < 1 << 16));
        (self.range, self.low) = (self.range << shift, self.low << shift);
        self.waiting += shift;
        if self.waiting >= u16::BITS {
            self.write(bytes);
        }
    }

    #[inline(always)]
    pub(crate) fn bit(&mut self, bytes: &mut Vec<u8>, chance: &mut impl Estimate, bit: bool) {
        self.narrow(bytes, (self.range >> 12) * chance.of_zero(), !bit);
        chance.learn(bit);
    }

    /// A bit of which both values are as probable.
    #[inline(always)]
    pub(crate) fn even(&mut self, bytes: &mut Vec<u8>, bit: bool) {
        self.narrow(bytes, self.range >> 1, !bit);
    }

    #[inline(always)]
    pub(crate) fn number(&mut self, bytes: &mut Vec<u8>, chances: &mut NumberChances, value: u32) {
        for (unary, chance) in (0..).zip(&mut chances.unary) {
            self.bit(bytes, chance, value > unary);
            if value == unary {
                return;
            }
        }
        *self = self.long(bytes, chances, value);
    }

    /// What is left of a number whose unary part is as long as it may be.
    #[cold]
    fn long(mut self, bytes: &mut Vec<u8>, chances: &mut NumberChances, value: u32) -> Self {
        let rest = u64::from(value) - 16 + 1;
        let length = rest.ilog2();
        (0..length).for_each(|k| self.bit(bytes, &mut chances.length[k as usize], true));
        self.bit(bytes, &mut chances.length[length as usize], false);
        (0..length).rev().for_each(|k| self.even(bytes, rest >> k & 1 == 1));
        self
    }
}

#[cfg(feature = "write")]
#[cold]
fn add_carry(bytes: &mut [u8]) {
    for byte in bytes.iter_mut().rev() {
        *byte = byte.wrapping_add(1);
        if *byte > 0 {
            break;
        }
    }
}

#[cfg(feature = "write")]
impl BitEncoder {
    pub(crate) fn new() -> Self {
        Self { interval: Interval { low: 0, range: u32::MAX, waiting: 0 }, bytes: vec![] }
    }

    pub(crate) fn bit(&mut self, chance: &mut impl Estimate, bit: bool) {
        self.interval.bit(&mut self.bytes, chance, bit);
    }

    pub(crate) fn raw(&mut self, count: u32, value: u32) {
        (0..count).rev().for_each(|k| self.interval.even(&mut self.bytes, value >> k & 1 == 1));
    }

    pub(crate) fn number(&mut self, chances: &mut NumberChances, value: u32) {
        self.interval.number(&mut self.bytes, chances, value);
    }

    pub(crate) fn signed(&mut self, chances: &mut NumberChances, value: i32) {
        self.number(chances, zigzag(i64::from(value)) as u32);
    }

    /// The bytes. A decoder takes missing ones for zero, so zeros at the end are left out, as many as it allows.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        let Self { interval, bytes } = &mut self;
        // Any number from `low` to `low + range` will do: take the one with the most zero bits at its end.
        let end = interval.low + u64::from(interval.range) - 1;
        for bits in (0..32).rev() {
            let rounded = end >> bits << bits;
            if rounded >= interval.low {
                interval.low = rounded;
                break;
            }
        }
        interval.carry(bytes);
        let taken = bytes.len() + (interval.waiting / u8::BITS) as usize;
        let rest = u32::BITS + interval.waiting;
        bytes.extend((0..rest / u8::BITS).rev().map(|k| (interval.low >> (k * u8::BITS)) as u8));
        let length = self.bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
        // It begins with four bytes.
        let least = (taken + 4).saturating_sub(MOST_MISSING as usize);
        self.bytes.truncate(length.max(least));
        self.bytes
    }
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;

    #[test]
    fn bits_and_numbers_come_back() {
        let mut random = 1_u32;
        let mut next = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            random >> 8
        };
        for round in 0..200 {
            let count = round * round / 10;
            let values: Vec<u32> =
                (0..count).map(|k| if k % 50 == 3 { next() * 201 } else { next() >> (round % 24) }).collect();
            let mut encoder = BitEncoder::new();
            let (mut chance, mut chances) = (Chance::default(), NumberChances::default());
            for &value in &values {
                encoder.bit(&mut chance, value % 5 == 0);
                encoder.number(&mut chances, value);
                encoder.signed(&mut chances, value as i32 / 2 * if value % 2 == 0 { 1 } else { -1 } / 2);
                encoder.raw(7, value & 127);
            }
            let bytes = encoder.finish();
            let mut decoder = BitDecoder::new(&bytes);
            let (mut chance, mut chances) = (Chance::default(), NumberChances::default());
            for &value in &values {
                assert_eq!(decoder.bit(&mut chance), value % 5 == 0);
                assert_eq!(decoder.number(&mut chances).unwrap(), value);
                let signed = value as i32 / 2 * if value % 2 == 0 { 1 } else { -1 } / 2;
                assert_eq!(decoder.signed(&mut chances).unwrap(), signed);
                assert_eq!(decoder.raw(7), value & 127);
            }
            decoder.finish().unwrap();
        }
    }

    #[test]
    fn long_runs_of_zeros_at_the_end_are_not_left_out() {
        for count in 0..60 {
            let mut encoder = BitEncoder::new();
            encoder.raw(8, 1);
            (0..count).for_each(|_| encoder.raw(8, 0));
            let bytes = encoder.finish();
            let mut decoder = BitDecoder::new(&bytes);
            assert_eq!(decoder.raw(8), 1);
            assert!((0..count).all(|_| decoder.raw(8) == 0));
            decoder.finish().unwrap();
        }
    }

    #[test]
    fn rare_bits_cost_little_and_missing_bytes_are_noticed() {
        let mut encoder = BitEncoder::new();
        let mut chance = Chance::default();
        (0..100_000).for_each(|k| encoder.bit(&mut chance, k % 1000 == 0));
        let bytes = encoder.finish();
        assert!(bytes.len() < 300, "{}", bytes.len());
        let mut decoder = BitDecoder::new(&bytes[..bytes.len() / 2]);
        let mut chance = Chance::default();
        // Whatever the bits are then.
        let ones = (0..100_000).filter(|_| decoder.bit(&mut chance)).count();
        assert!(ones < 100_000);
        let mut other = BitDecoder::new(&[]);
        other.raw(32);
        other.raw(32);
        other.raw(32);
        assert!(other.check().is_err());
    }
}
