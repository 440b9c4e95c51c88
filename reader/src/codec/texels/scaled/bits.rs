//! Bits in both directions, so that what is written and what is read are one code; and chances that know how often they
//! were asked.

use super::super::binary::BitDecoder;
#[cfg(feature = "write")]
use super::super::binary::BitEncoder;
use super::super::binary::Estimate;
use crate::error::Result;

/// The probability of a zero: a mean over what came so far, which turns into one over what came last, and a faster
/// estimate.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Counted {
    slow: u16,
    fast: u16,
    /// How many bits the slow estimate counts as made of.
    count: u8,
}

/// As how many bits the known chance counts at first, and the most.
const KNOWN: u8 = 4;
const MOST: u8 = 200;
/// 65536 / (count + 1.5), rounded down.
static SHARES: [u16; MOST as usize + 1] = {
    let (mut shares, mut count) = ([0; MOST as usize + 1], 0);
    while count <= MOST as usize {
        shares[count] = ((65536 * 2) / (2 * count + 3)) as u16;
        count += 1;
    }
    shares
};

impl Counted {
    /// From the probability of a zero in 1/256, 1 to 255.
    pub const fn new(known: u8) -> Self {
        let estimate = (known as u16) << 8;
        Self { slow: estimate, fast: estimate, count: KNOWN }
    }
}

impl Estimate for Counted {
    #[inline(always)]
    fn of_zero(&self) -> u32 {
        ((u32::from(self.slow) + u32::from(self.fast)) >> 5).clamp(4, 4091)
    }

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let flip = u16::from(bit).wrapping_sub(1);
        let share = u32::from(SHARES[usize::from(self.count)]);
        let rest = self.slow ^ flip;
        self.slow = (rest - ((u32::from(rest) * share) >> 16) as u16) ^ flip;
        let rest = self.fast ^ flip;
        self.fast = (rest - (rest >> 4)) ^ flip;
        self.count = if self.count < MOST { self.count + 1 } else { MOST };
    }
}

/// Where bits come from, or where they go.
pub(in super::super) trait Bits {
    /// A bit: the given one where bits are written.
    fn bit(&mut self, chance: &mut Counted, bit: bool) -> bool;
    /// A bit of which both values are as probable.
    fn even(&mut self, bit: bool) -> bool;
    /// Refuses a string that ended long before its bits did.
    fn check(&self) -> Result<()>;
}

impl Bits for BitDecoder<'_> {
    #[inline(always)]
    fn bit(&mut self, chance: &mut Counted, _: bool) -> bool {
        BitDecoder::bit(self, chance)
    }

    #[inline(always)]
    fn even(&mut self, _: bool) -> bool {
        self.raw(1) == 1
    }

    fn check(&self) -> Result<()> {
        BitDecoder::check(self)
    }
}

#[cfg(feature = "write")]
impl Bits for BitEncoder {
    #[inline(always)]
    fn bit(&mut self, chance: &mut Counted, bit: bool) -> bool {
        self.interval.bit(&mut self.bytes, chance, bit);
        bit
    }

    #[inline(always)]
    fn even(&mut self, bit: bool) -> bool {
        self.interval.even(&mut self.bytes, bit);
        bit
    }

    fn check(&self) -> Result<()> {
        Ok(())
    }
}
