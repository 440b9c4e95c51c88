//! How often symbols occur: the statistics that tables are made from (encoder only).

use super::{
    Symbols, Tables,
    sharing::{Histogram, log2_fixed},
    token::{COUNT, extra_bits},
};
use crate::codec::entropy::context::{self, Context};

/// How often each token occurs in each context. The keys are 256 times the context plus the token, ascending; tokens
/// that do not occur have none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Tally(Vec<(u32, u64)>);

impl Tally {
    /// Counts runs of symbols.
    pub(crate) fn of<'a>(runs: impl IntoIterator<Item = Symbols<'a>>) -> Self {
        let mut counts = vec![0_u64; context::COUNT * COUNT];
        for &[token, low, high] in runs.into_iter().flat_map(|symbols| symbols.tokens()) {
            // Symbols of a stored piece may name any context; one that does not exist fails where it is encoded.
            if let Some(count) = counts.get_mut(u32::from_le_bytes([token, low, high, 0]) as usize) {
                *count += 1;
            }
        }
        let counts = (0..).zip(counts);
        Self(counts.filter(|&(_, count)| count > 0).collect())
    }

    /// Whether a context occurs.
    pub(crate) fn has(&self, context: Context) -> bool {
        let at = self.0.partition_point(|&(key, _)| split(key).0 < context);
        self.0.get(at).is_some_and(|&(key, _)| split(key).0 == context)
    }

    /// Adds the counts of another tally.
    pub(crate) fn add(&mut self, other: &Self) {
        let mut sum = Vec::with_capacity(self.0.len().max(other.0.len()));
        let (mut a, mut b) = (self.0.iter().copied().peekable(), other.0.iter().copied().peekable());
        loop {
            let first = match (a.peek(), b.peek()) {
                (None, None) => break,
                (Some(&(key, _)), None) | (None, Some(&(key, _))) => key,
                (Some(&(p, _)), Some(&(q, _))) => p.min(q),
            };
            let counts = [a.next_if(|next| next.0 == first), b.next_if(|next| next.0 == first)];
            sum.push((first, counts.into_iter().flatten().fold(0, |sum: u64, (_, count)| sum.saturating_add(count))));
        }
        self.0 = sum;
    }

    /// The size of all counted symbols in bytes, rounded up. A symbol that the tables have no code for counts as a few
    /// bytes.
    pub(crate) fn bytes(&self, tables: &Tables) -> u64 {
        let cost = self.0.iter().fold(0_u64, |cost, &(key, count)| {
            let (context, token) = split(key);
            let frequency = tables.frequency(context, token);
            let each = (12 << 16) - log2_fixed(frequency.into()) + (u64::from(extra_bits(token)) << 16);
            cost.saturating_add(count.saturating_mul(each))
        });
        cost.div_ceil(8 << 16)
    }

    /// The histogram of each context.
    pub(super) fn histograms(&self) -> Vec<Histogram> {
        let mut histograms = vec![Histogram::default(); context::COUNT];
        for &(key, count) in &self.0 {
            let (context, token) = split(key);
            if let Some(histogram) = histograms.get_mut(usize::from(context)) {
                histogram.add(token, count);
            }
        }
        histograms
    }
}

/// Context and token of a key.
fn split(key: u32) -> (Context, u8) {
    ((key >> 8) as Context, key as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::entropy::{SymbolBuffer, encode};

    #[test]
    fn a_tally_predicts_the_size_of_its_symbols() {
        let symbols: SymbolBuffer =
            (0..20_000).map(|i| (i % 7 * 30, u64::from(i) * 2654435761 % (1 << (i % 23)))).collect();
        let tally = Tally::of([symbols.iter()]);
        let tables = Tables::of(&tally);
        let bytes = encode(&tables.codes(), [symbols.iter()]).unwrap().len() as u64;
        assert!(tally.bytes(&tables).abs_diff(bytes) <= 8, "{bytes}");

        let mut twice = Tally::of([SymbolBuffer::from_iter([(3, 5)]).iter()]);
        twice.add(&tally);
        twice.add(&tally);
        assert!(twice.bytes(&tables).abs_diff(2 * bytes) <= 24);
        assert!(twice.0.is_sorted_by(|a, b| a.0 < b.0));
    }
}
