//! Pages of pairs: what is looked for, and where it is (SPEC.md, "Pages of pairs").

use super::PAGE;
use super::bits::Bits;
#[cfg(feature = "write")]
use crate::codec::texels::binary::BitEncoder;
use crate::{
    codec::texels::binary::{BitDecoder, NumberChances},
    error::{Error, Result},
};

/// A key, and the page or cluster where it is.
pub(super) type Pair = (u32, u32);

/// What concerns all pages of a list of pairs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pairs {
    /// How many there are.
    pub count: u32,
    /// No place is as large.
    pub places: u32,
    /// Whether keys are hashes: then places are anywhere.
    pub are_hashes: bool,
}

impl Pairs {
    /// How many pages there are.
    pub fn pages(self) -> u32 {
        self.count.div_ceil(PAGE)
    }

    /// Writes a page.
    #[cfg(feature = "write")]
    pub fn write(self, pairs: &[Pair]) -> Result<Vec<u8>> {
        let mut bits = BitEncoder::new();
        self.code(&mut bits, pairs, pairs.first().map_or(0, |pair| pair.0), pairs.len())?;
        Ok(bits.finish())
    }

    /// Reads a page, whose first key the directory says.
    pub fn parse(self, page: u32, first: u32, bytes: &[u8]) -> Result<Vec<Pair>> {
        let mut bits = BitDecoder::new(bytes);
        let count = self.count.saturating_sub(page.saturating_mul(PAGE)).min(PAGE);
        let pairs = self.code(&mut bits, &[], first, count as usize)?;
        bits.finish()?;
        Ok(pairs)
    }

    fn code(self, bits: &mut impl Bits, given: &[Pair], first: u32, count: usize) -> Result<Vec<Pair>> {
        let outside = || Error::format("a place that an object is looked for in does not exist");
        let [mut steps, mut among, mut places] = <[NumberChances; 3]>::default();
        let width = u32::BITS - self.places.saturating_sub(1).leading_zeros();
        let mut pairs: Vec<Pair> = Vec::new();
        let (mut key, mut place) = (first, 0_u32);
        for number in 0..count {
            let given = given.get(number).copied().unwrap_or_default();
            let mut is_same = false;
            if number > 0 {
                let step = bits.number(&mut steps, given.0.wrapping_sub(key))?;
                is_same = step == 0;
                key = key.checked_add(step).ok_or_else(|| Error::format("a key of objects exceeds 32 bits"))?;
            }
            place = if is_same {
                let more = bits.number(&mut among, given.1.wrapping_sub(place).wrapping_sub(1))?;
                place.checked_add(more).and_then(|place| place.checked_add(1)).ok_or_else(outside)?
            } else if self.are_hashes {
                bits.raw(width, given.1)
            } else {
                let step = bits.signed(&mut places, (i64::from(given.1) - i64::from(place)) as i32)?;
                u32::try_from(i64::from(place) + i64::from(step)).map_err(|_| outside())?
            };
            bits.check()?;
            if place >= self.places {
                return Err(outside());
            }
            pairs.push((key, place));
        }
        Ok(pairs)
    }
}
