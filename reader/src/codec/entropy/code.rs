//! Tables in the form that an encoder uses: the code of each token in each context.

use super::{tables::FREQUENCY_BITS, token};
use crate::codec::entropy::context::{self, Context};

/// What a token does to a state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Code {
    /// 2^44 divided by the frequency, plus one: see [`Code::put`].
    reciprocal: u64,
    frequency: u16,
    start: u16,
}

const RECIPROCAL_BITS: u32 = 32 + FREQUENCY_BITS;

impl Code {
    /// 0 where the token cannot be coded.
    #[inline]
    pub fn frequency(self) -> u32 {
        u32::from(self.frequency)
    }

    /// The state that follows a state below the frequency times 2^20: quotient times 4096, plus remainder, plus start.
    ///
    /// The quotient is exact. The reciprocal exceeds 2^44 / f by at most 1, so state times reciprocal exceeds 2^44
    /// state / f by at most the state, which is below 2^32, and so the quotient by less than 1 / 4096, which is not
    /// more than 1 / f. The product is below 2^64, since state / f is at most 2^20 - 1 / f.
    #[inline]
    pub fn put(self, state: u32) -> u32 {
        let quotient = ((u64::from(state) * self.reciprocal) >> RECIPROCAL_BITS) as u32;
        state + u32::from(self.start) + quotient * ((1 << FREQUENCY_BITS) - u32::from(self.frequency))
    }
}

/// The codes of all tokens in all contexts.
#[derive(Clone, Debug)]
pub(crate) struct Codes {
    /// The place of each context's first code; beyond the last code for contexts without a table.
    first: [u32; context::COUNT],
    /// Table after table.
    codes: Vec<Code>,
}

impl Codes {
    /// `frequencies` has the tables, and `table_of` gives the table of each context.
    pub(super) fn new<'a>(
        table_of: impl Iterator<Item = Option<usize>>,
        frequencies: impl Iterator<Item = &'a [u16; token::COUNT]>,
    ) -> Self {
        let mut codes = Vec::new();
        for table in frequencies {
            let mut start = 0;
            codes.extend(table.iter().map(|&frequency| {
                let code = match frequency {
                    0 => Code::default(),
                    _ => Code { reciprocal: (1 << RECIPROCAL_BITS) / u64::from(frequency) + 1, frequency, start },
                };
                start += frequency;
                code
            }));
        }
        let mut first = [u32::MAX; context::COUNT];
        for (first, table) in first.iter_mut().zip(table_of) {
            *first = table.map_or(u32::MAX, |table| (table * token::COUNT) as u32);
        }
        Self { first, codes }
    }

    /// The code of a token.
    #[inline]
    pub(super) fn of(&self, context: Context, token: u8) -> Code {
        let first = self.first.get(usize::from(context)).copied().unwrap_or(u32::MAX);
        self.codes.get(first as usize + usize::from(token)).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotients_are_exact() {
        for frequency in (1..=4096_u16).rev().step_by(7).chain([1, 2, 3, 4095, 4096]) {
            let mut table = [0; token::COUNT];
            table[9] = frequency;
            let codes = Codes::new([Some(0)].into_iter(), [&table].into_iter());
            let f = u32::from(frequency);
            let last = ((u64::from(f) << 20) - 1).min(u32::MAX.into()) as u32;
            let some = [1 << 16, 65537, 99_991, last / 2, last / f * f - 1, last / f * f, last - 1, last];
            for state in some.into_iter().filter(|&state| state <= last) {
                assert_eq!(codes.of(0, 9).put(state), state / f * 4096 + state % f, "{state} / {f}");
            }
            assert_eq!(codes.of(0, 8).frequency() + codes.of(1, 9).frequency(), 0);
        }
    }
}
