//! The static tables: token frequencies, and which context uses which table (SPEC.md, "Section TABLES").

use super::{
    Codes,
    bits::{BitReader, BitWriter},
    sharing::share_tables,
    tally::Tally,
    token,
};
use crate::{
    codec::entropy::context::{self, Context},
    error::{Error, Result},
};

/// Frequencies of a table sum to `1 << FREQUENCY_BITS`.
pub(super) const FREQUENCY_BITS: u32 = 12;
const FREQUENCY_SUM: u32 = 1 << FREQUENCY_BITS;
/// The most tables of a file: their numbers fit a byte, and [`NO_TABLE`] is left.
const MAX_TABLES: usize = 255;
/// The most tables that an encoder makes: more gain nothing measurable and crowd the decoder's cache.
const MAX_MADE_TABLES: usize = 48;
/// Bits kept below the leading one of a stored frequency: 0.03 % more bytes than exact ones, for half the table size.
const MANTISSA_BITS: u32 = 3;
/// Marks a context without a table.
const NO_TABLE: u8 = u8::MAX;

/// Codes of four bits before each stored frequency: 1..=12 are its bit length.
const CODE_ABSENT: u32 = 0;
const CODE_REST: u32 = 13;
const CODE_END: u32 = 14;

/// The frequency of every token, normalised to a sum of 4096; absent tokens have 0 and cannot be coded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frequencies(pub(super) [u16; token::COUNT]);

impl Frequencies {
    /// Frequencies for these counts, at least one of which is not zero, in a form that can be stored: all are rounded
    /// to four significant bits, except that of the most frequent token.
    pub(super) fn normalised(counts: &[u64]) -> Self {
        let total: u64 = counts.iter().sum();
        let largest = (0..counts.len()).rev().max_by_key(|&token| counts[token]).unwrap_or(0);
        let scaled = |count: u64, sum: u32| (u128::from(count) * u128::from(sum) * 2 / u128::from(total.max(1))) as u32;
        let assign = |frequency_of: &dyn Fn(u64) -> u32| {
            let mut result = [0; token::COUNT];
            let mut rest = FREQUENCY_SUM as i64;
            for (token, &count) in counts.iter().enumerate().filter(|&(token, &count)| count > 0 && token != largest) {
                let frequency = frequency_of(count);
                result[token] = frequency as u16;
                rest -= i64::from(frequency);
            }
            (result, rest)
        };
        let (mut result, mut rest) =
            assign(&|count| round_significant(scaled(count, FREQUENCY_SUM).div_ceil(2)).max(1));
        if rest * 4 < i64::from(scaled(counts[largest], FREQUENCY_SUM)) {
            // Rounding has taken half of what the most frequent token should get. That happens with many tokens: round
            // down instead, from a sum that leaves room for one more each.
            let sum = FREQUENCY_SUM - token::COUNT as u32;
            (result, rest) = assign(&|count| floor_significant(1 + scaled(count, sum) / 2));
        }
        result[largest] = rest as u16;
        Self(result)
    }

    /// Per token a code of four bits. 1..=12 is the bit length of its frequency; up to three bits below the leading one
    /// follow, and lower ones are zero. 13 marks the token that takes the rest of 4096. 0 begins a run of absent
    /// tokens, whose length follows in gamma code. 14 is the end.
    fn write(&self, bits: &mut BitWriter) {
        let frequencies = &self.0;
        let largest = (0..token::COUNT).rev().max_by_key(|&token| frequencies[token]).unwrap_or(0);
        // The token that takes the rest need not be the largest one. But if one frequency is not rounded, it must be
        // that token's.
        let rest = (0..token::COUNT)
            .find(|&token| floor_significant(u32::from(frequencies[token])) != u32::from(frequencies[token]))
            .unwrap_or(largest);
        let end = (0..token::COUNT).rev().find(|&token| frequencies[token] > 0).map_or(0, |token| token + 1);
        let mut token = 0;
        while token < end {
            let frequency = u32::from(frequencies[token]);
            if frequency == 0 {
                let run = frequencies[token..end].iter().take_while(|&&f| f == 0).count();
                bits.put(CODE_ABSENT, 4);
                bits.put_gamma(run as u32);
                token += run;
                continue;
            }
            if token == rest {
                bits.put(CODE_REST, 4);
            } else {
                let below = frequency.ilog2();
                bits.put(below + 1, 4);
                let kept = below.min(MANTISSA_BITS);
                bits.put((frequency - (1 << below)) >> (below - kept), kept);
            }
            token += 1;
        }
        bits.put(CODE_END, 4);
    }

    fn parse(bits: &mut BitReader<'_>) -> Result<Self> {
        let bad = || Error::format("a table's frequencies do not sum to 4096");
        let mut frequencies = [0; token::COUNT];
        let mut rest = FREQUENCY_SUM;
        let mut rest_token = None;
        let mut token = 0;
        loop {
            let code = bits.take(4)?;
            if code == CODE_END {
                break;
            }
            if code == CODE_ABSENT {
                token += bits.take_gamma()? as usize;
                if token > token::COUNT {
                    return Err(Error::format("a table has frequencies for more than 256 tokens"));
                }
                continue;
            }
            let slot = frequencies.get_mut(token).ok_or_else(|| Error::format("a table has more than 256 tokens"))?;
            if code == CODE_REST {
                if rest_token.replace(token).is_some() {
                    return Err(bad());
                }
            } else if code <= FREQUENCY_BITS {
                let below = code - 1;
                let kept = below.min(MANTISSA_BITS);
                let frequency = (1 << below) | (bits.take(kept)? << (below - kept));
                rest = rest.checked_sub(frequency).ok_or_else(bad)?;
                *slot = frequency as u16;
            } else {
                return Err(Error::format("a table has an unknown code"));
            }
            token += 1;
        }
        match rest_token {
            Some(token) if rest > 0 => frequencies[token] = rest as u16,
            _ => return Err(bad()),
        }
        Ok(Self(frequencies))
    }
}

/// Clears all but the leading one and [`MANTISSA_BITS`] more.
fn floor_significant(value: u32) -> u32 {
    let drop = value.checked_ilog2().unwrap_or(0).saturating_sub(MANTISSA_BITS);
    value >> drop << drop
}

/// The nearest number of the form that [`floor_significant`] leaves, at most 4095.
fn round_significant(value: u32) -> u32 {
    let drop = value.checked_ilog2().unwrap_or(0).saturating_sub(MANTISSA_BITS);
    floor_significant((value + ((1 << drop) >> 1)).min(FREQUENCY_SUM - 1))
}

/// The tables of a file, ready to encode and decode.
#[derive(Clone, Debug)]
pub(crate) struct Tables {
    /// The table of each context, or [`NO_TABLE`].
    table_of: [u8; context::COUNT],
    frequencies: Vec<Frequencies>,
    /// For decoding, the tokens that occur, table after table: bits 0..8 hold the token, 8..20 its frequency minus 1,
    /// and 20..32 its start.
    ranges: Vec<u32>,
    /// Where the ranges of each table begin.
    first_range: Vec<u32>,
    /// Per table, the range that every 16th state falls in. With an entry for each of 4096 states no search would be
    /// needed, but tables of 16 KiB each do not fit in the processor's nearest cache: decoding took twice the time.
    buckets: Vec<u32>,
    /// The number of that range, counted from the table's first.
    bucket_ranges: Vec<u8>,
}

/// The number of low bits of a state that a bucket leaves to a search. About nine searches in ten end with the first
/// range.
const BUCKET_BITS: u32 = 4;
const BUCKET_COUNT: usize = 1 << (FREQUENCY_BITS - BUCKET_BITS);

/// The token that a decoder's state falls on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub token: u8,
    pub frequency: u32,
    /// How far the state's low bits lie above the token's start.
    pub bias: u32,
}

impl Tables {
    /// Tables that fit all these symbols.
    #[cfg(test)]
    pub(crate) fn from_buffers<'a>(buffers: impl IntoIterator<Item = &'a super::SymbolBuffer>) -> Self {
        Self::of(&Tally::of(buffers.into_iter().map(super::SymbolBuffer::iter)))
    }

    /// Tables that fit the statistics of symbols.
    pub(crate) fn of(tally: &Tally) -> Self {
        let (table_of, frequencies) = share_tables(&tally.histograms(), MAX_MADE_TABLES);
        let mut map = [NO_TABLE; context::COUNT];
        for (context, table) in table_of.into_iter().enumerate() {
            map[context] = table.map_or(NO_TABLE, |table| table as u8);
        }
        Self::new(map, frequencies)
    }

    fn new(table_of: [u8; context::COUNT], frequencies: Vec<Frequencies>) -> Self {
        let (mut ranges, mut first_range) = (Vec::new(), Vec::with_capacity(frequencies.len()));
        let mut buckets = Vec::with_capacity(frequencies.len() * BUCKET_COUNT);
        let mut bucket_ranges = Vec::with_capacity(frequencies.len() * BUCKET_COUNT);
        for table in &frequencies {
            let mut start = 0_u32;
            let first = ranges.len();
            first_range.push(first as u32);
            let first_bucket = buckets.len();
            for (token, &frequency) in table.0.iter().enumerate() {
                let frequency = u32::from(frequency);
                if frequency > 0 {
                    let end = (start + frequency).div_ceil(1 << BUCKET_BITS) as usize;
                    let range = token as u32 | ((frequency - 1) << 8) | (start << 20);
                    bucket_ranges.resize(first_bucket + end, (ranges.len() - first) as u8);
                    buckets.resize(first_bucket + end, range);
                    ranges.push(range);
                }
                start += frequency;
            }
        }
        Self { table_of, frequencies, ranges, first_range, buckets, bucket_ranges }
    }

    /// The bytes of section TABLES: the number of tables plus one in gamma code, then each table; the number of
    /// contexts plus one in gamma code; then per context, ascending, its distance from the one before (from -1 at
    /// first) in gamma code, and its table in as many bits as the largest table number has. Zero bits fill the last
    /// byte.
    pub(crate) fn write(&self) -> Vec<u8> {
        let mut bits = BitWriter::default();
        bits.put_gamma(self.frequencies.len() as u32 + 1);
        self.frequencies.iter().for_each(|table| table.write(&mut bits));
        let used = || self.table_of.iter().enumerate().filter(|&(_, &table)| table != NO_TABLE);
        bits.put_gamma(used().count() as u32 + 1);
        let index_bits = index_bits(self.frequencies.len());
        let mut next = 0;
        for (context, &table) in used() {
            bits.put_gamma((context - next) as u32 + 1);
            bits.put(u32::from(table), index_bits);
            next = context + 1;
        }
        bits.finish()
    }

    /// Reads the section.
    ///
    /// # Errors
    /// [`Error::Format`] if a rule of [`Tables::write`] is broken, there are too many tables, or one is unused.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut bits = BitReader::new(bytes);
        let table_count = bits.take_gamma()? as usize - 1;
        if table_count > MAX_TABLES {
            return Err(Error::format("there are more than 255 tables"));
        }
        let frequencies = (0..table_count).map(|_| Frequencies::parse(&mut bits)).collect::<Result<Vec<_>>>()?;
        let context_count = bits.take_gamma()? - 1;
        let index_bits = index_bits(table_count);
        let mut table_of = [NO_TABLE; context::COUNT];
        let mut used = [false; MAX_TABLES];
        let mut next = 0;
        for _ in 0..context_count {
            let context = next + bits.take_gamma()? as usize - 1;
            let table = bits.take(index_bits)? as usize;
            if table >= table_count {
                return Err(Error::format("a context names a table that does not exist"));
            }
            if context >= context::LIMIT {
                return Err(Error::format("a context is above 4095"));
            }
            // What an optional section of a later version uses has a context that is unknown here.
            if let Some(slot) = table_of.get_mut(context) {
                *slot = table as u8;
            }
            used[table] = true;
            next = context + 1;
        }
        if used[..table_count].contains(&false) {
            return Err(Error::format("a table is used by no context"));
        }
        bits.finish()?;
        Ok(Self::new(table_of, frequencies))
    }

    /// The number of tables.
    pub(crate) fn count(&self) -> usize {
        self.frequencies.len()
    }

    /// Whether a context has a table.
    pub(crate) fn has(&self, context: Context) -> bool {
        self.table_of.get(usize::from(context)).is_some_and(|&table| table != NO_TABLE)
    }

    /// The frequency of a token in a context's table; 0 where it cannot be coded.
    pub(super) fn frequency(&self, context: Context, token: u8) -> u32 {
        let table = self.table_of.get(usize::from(context)).and_then(|&table| self.frequencies.get(usize::from(table)));
        table.map_or(0, |table| table.0[usize::from(token)].into())
    }

    /// The codes of all tokens.
    pub(crate) fn codes(&self) -> Codes {
        let table_of = self.table_of.iter().map(|&table| (table != NO_TABLE).then_some(usize::from(table)));
        Codes::new(table_of, self.frequencies.iter().map(|table| &table.0))
    }

    /// The token that the low bits of a state fall on in a context; none if the context has no table.
    #[inline]
    pub(super) fn slot(&self, context: Context, state: u32) -> Option<Slot> {
        let table = usize::from(*self.table_of.get(usize::from(context))?);
        let low = state & (FREQUENCY_SUM - 1);
        let bucket = table * BUCKET_COUNT + (low >> BUCKET_BITS) as usize;
        // NO_TABLE leads to a bucket beyond the last one.
        Slot::of(*self.buckets.get(bucket)?, low).or_else(|| self.search(table, bucket, low))
    }

    /// Finds the range of a state that is not in the first range of its bucket.
    #[inline(never)]
    fn search(&self, table: usize, bucket: usize, low: u32) -> Option<Slot> {
        let first = *self.first_range.get(table)? as usize + usize::from(*self.bucket_ranges.get(bucket)?);
        self.ranges.get(first + 1..)?.iter().find_map(|&range| Slot::of(range, low))
    }
}

impl Slot {
    /// The slot of a state, if the range contains it.
    #[inline]
    fn of(range: u32, low: u32) -> Option<Self> {
        let (bias, last) = (low.wrapping_sub(range >> 20), (range >> 8) & (FREQUENCY_SUM - 1));
        (bias <= last).then_some(Self { token: range as u8, frequency: last + 1, bias })
    }
}

/// The number of bits of a table's number.
fn index_bits(table_count: usize) -> u32 {
    table_count.saturating_sub(1).checked_ilog2().map_or(0, |bits| bits + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(counts: &[u64]) {
        let table = Frequencies::normalised(counts);
        assert_eq!(table.0.iter().map(|&f| u32::from(f)).sum::<u32>(), FREQUENCY_SUM);
        for (token, &count) in counts.iter().enumerate() {
            assert_eq!(count > 0, table.0[token] > 0, "{counts:?}");
        }
        let mut bits = BitWriter::default();
        table.write(&mut bits);
        let bytes = bits.finish();
        assert_eq!(Frequencies::parse(&mut BitReader::new(&bytes)).unwrap(), table);
    }

    #[test]
    fn normalised_frequencies_keep_every_token_and_can_be_stored() {
        check(&[1]);
        check(&[0, 0, 7]);
        check(&[1, 1_000_000_000_000]);
        check(&[1; 256]);
        check(&[21; 200]);
        for n in 2..256 {
            check(&vec![5; n]);
            check(&(0..n as u64).map(|i| i * i % 97).collect::<Vec<_>>());
            check(&(0..n as u64).map(|i| 1 << (i % 37)).collect::<Vec<_>>());
        }
        let mut one_large = [1; 256];
        one_large[77] = 10_000_000;
        check(&one_large);
    }

    #[test]
    fn every_state_falls_on_the_token_whose_range_holds_it() {
        for counts in [vec![1], vec![1; 256], vec![0, 3, 0, 1000, 1, 1, 90], (0..200).map(|i| i * i % 13).collect()] {
            let tables = Tables::new([0; context::COUNT], vec![Frequencies::normalised(&counts)]);
            let mut next = 0;
            for token in 0..=255 {
                let (start, frequency) = (next, tables.frequency(0, token));
                for low in start..start + frequency {
                    let slot = tables.slot(0, 7 << FREQUENCY_BITS | low).unwrap();
                    assert_eq!((slot.token, slot.frequency, slot.bias), (token, frequency, low - start));
                    next += 1;
                }
            }
            assert_eq!(next, FREQUENCY_SUM);
        }
    }

    #[test]
    fn tables_of_more_than_256_tokens_are_refused() {
        let parse = |codes: &dyn Fn(&mut BitWriter)| {
            let mut bits = BitWriter::default();
            codes(&mut bits);
            bits.put(CODE_END, 4);
            Frequencies::parse(&mut BitReader::new(&bits.finish()))
        };
        let rest_after = |absent: u32| {
            move |bits: &mut BitWriter| {
                bits.put(CODE_ABSENT, 4);
                bits.put_gamma(absent);
                bits.put(CODE_REST, 4);
            }
        };
        assert_eq!(parse(&rest_after(255)).unwrap().0[255], 4096);
        assert!(parse(&rest_after(256)).is_err());
        assert!(parse(&rest_after(257)).is_err());
        let ones = |count: u32| {
            move |bits: &mut BitWriter| {
                bits.put(CODE_REST, 4);
                (1..count).for_each(|_| bits.put(1, 4));
            }
        };
        assert_eq!(parse(&ones(256)).unwrap().0[0], 4096 - 255);
        assert!(parse(&ones(257)).is_err());
    }

    #[test]
    fn no_byte_string_of_tables_panics() {
        let mut buffer = super::super::SymbolBuffer::default();
        (0..500).for_each(|i| buffer.put((i % 9) as Context * 20, i * i));
        let bytes = Tables::from_buffers([&buffer]).write();
        Tables::parse(&bytes).unwrap();
        for end in 0..bytes.len() {
            assert!(Tables::parse(&bytes[..end]).is_err());
        }
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            let _ = Tables::parse(&changed);
        }
    }
}
