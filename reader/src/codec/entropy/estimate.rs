//! Estimates of what symbols will cost before the tables of the file are known (encoder only). Builders use them to
//! choose between codings.
//!
//! All arithmetic is in integers, so that every machine makes the same choice.

use super::{
    SymbolBuffer,
    sharing::{Histogram, log2_fixed},
    token::{extra_bits, token_of},
};
use crate::codec::entropy::context;

/// Statistics of symbols by context, and estimates of what other symbols cost with tables made from them.
#[derive(Clone, Debug)]
pub struct SymbolStatistics {
    histograms: Vec<Histogram>,
}

impl Default for SymbolStatistics {
    fn default() -> Self {
        Self { histograms: vec![Histogram::default(); context::COUNT] }
    }
}

impl SymbolStatistics {
    /// Counts the symbols of a buffer.
    pub fn add(&mut self, symbols: &SymbolBuffer) {
        for (context, value) in symbols.iter() {
            if let Some(histogram) = self.histograms.get_mut(usize::from(context)) {
                histogram.add(token_of(value), 1);
            }
        }
    }

    /// The bits that a buffer's symbols take, without tables; the error is below 1 in 10,000. Symbols that were never
    /// counted are expensive, but not impossible.
    pub fn bits(&self, symbols: &SymbolBuffer) -> f64 {
        let mut information = 0_u64;
        for (context, value) in symbols.iter() {
            let token = token_of(value);
            let Some(histogram) = self.histograms.get(usize::from(context)) else { continue };
            let count = histogram.counts().get(usize::from(token)).copied().unwrap_or(0);
            // Doubled, plus one: a token that was never seen counts as half a sighting.
            let cost = log2_fixed(2 * histogram.total() + 16) - log2_fixed(2 * count + 1);
            information = information.saturating_add(cost + (u64::from(extra_bits(token)) << 16));
        }
        information as f64 / 65536.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn buffer(values: impl Iterator<Item = u64>) -> SymbolBuffer {
        let mut symbols = SymbolBuffer::default();
        values.for_each(|value| symbols.put(3, value));
        symbols
    }

    #[test]
    fn symbols_cost_their_information() {
        let coins = buffer((0..10_000).map(|i| i % 2));
        let mut statistics = SymbolStatistics::default();
        statistics.add(&coins);
        assert!((statistics.bits(&coins) - 10_000.0).abs() < 20.0);
    }

    #[test]
    fn what_was_never_seen_is_dear() {
        let mut statistics = SymbolStatistics::default();
        statistics.add(&buffer((0..1000).map(|_| 1)));
        assert!(statistics.bits(&buffer([7].into_iter())) > 8.0);
        assert!(statistics.bits(&buffer([1].into_iter())) < 0.1);
    }
}
