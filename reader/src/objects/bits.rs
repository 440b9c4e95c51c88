//! Bits in both directions: what describes a page is written once, and reads or writes it.

#[cfg(feature = "write")]
use crate::codec::texels::binary::BitEncoder;
use crate::{
    codec::texels::binary::{BitDecoder, Chance, Estimate, NumberChances},
    error::Result,
};

/// Takes what is to be written, and returns what has been written or read; what a reader is given does not count.
pub(super) trait Bits {
    /// A bit with an adaptive probability.
    fn bit(&mut self, chance: &mut impl Estimate, bit: bool) -> bool;
    /// Bits of equal probabilities.
    fn raw(&mut self, count: u32, value: u32) -> u32;
    /// A number, small ones in few bits.
    fn number(&mut self, chances: &mut NumberChances, value: u32) -> Result<u32>;
    /// A signed number.
    fn signed(&mut self, chances: &mut NumberChances, value: i32) -> Result<i32>;
    /// Refuses what ended long ago.
    fn check(&self) -> Result<()>;
}

impl Bits for BitDecoder<'_> {
    fn bit(&mut self, chance: &mut impl Estimate, _: bool) -> bool {
        BitDecoder::bit(self, chance)
    }

    fn raw(&mut self, count: u32, _: u32) -> u32 {
        BitDecoder::raw(self, count)
    }

    fn number(&mut self, chances: &mut NumberChances, _: u32) -> Result<u32> {
        BitDecoder::number(self, chances)
    }

    fn signed(&mut self, chances: &mut NumberChances, _: i32) -> Result<i32> {
        BitDecoder::signed(self, chances)
    }

    fn check(&self) -> Result<()> {
        BitDecoder::check(self)
    }
}

#[cfg(feature = "write")]
impl Bits for BitEncoder {
    fn bit(&mut self, chance: &mut impl Estimate, bit: bool) -> bool {
        BitEncoder::bit(self, chance, bit);
        bit
    }

    fn raw(&mut self, count: u32, value: u32) -> u32 {
        BitEncoder::raw(self, count, value);
        value
    }

    fn number(&mut self, chances: &mut NumberChances, value: u32) -> Result<u32> {
        BitEncoder::number(self, chances, value);
        Ok(value)
    }

    fn signed(&mut self, chances: &mut NumberChances, value: i32) -> Result<i32> {
        BitEncoder::signed(self, chances, value);
        Ok(value)
    }

    fn check(&self) -> Result<()> {
        Ok(())
    }
}

/// Yes or no, by what was so before.
#[derive(Default)]
pub(super) struct Flag {
    chances: [Chance; 2],
    before: bool,
}

impl Flag {
    /// Codes the next one.
    pub(super) fn code(&mut self, bits: &mut impl Bits, flag: bool) -> bool {
        self.before = bits.bit(&mut self.chances[usize::from(self.before)], flag);
        self.before
    }
}
