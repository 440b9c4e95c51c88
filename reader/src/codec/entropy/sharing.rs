//! Which contexts share a table (encoder only): as long as it pays, the two whose union saves most are merged.
//!
//! All arithmetic is in integers, so that every machine makes the same choice and writes the same bytes.

use super::{tables::Frequencies, token};

/// How often each token occurs.
#[derive(Clone, Debug)]
pub(super) struct Histogram {
    counts: Box<[u64; token::COUNT]>,
    total: u64,
    /// Tokens from here on do not occur.
    end: usize,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: Box::new([0; token::COUNT]), total: 0, end: 0 }
    }
}

impl Histogram {
    /// Counts a token `times` times.
    pub(super) fn add(&mut self, token: u8, times: u64) {
        let count = &mut self.counts[usize::from(token)];
        *count = count.saturating_add(times);
        self.total = self.total.saturating_add(times);
        self.end = self.end.max(usize::from(token) + 1);
    }

    /// The number of tokens counted.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// The counts up to the last token that occurs.
    pub(super) fn counts(&self) -> &[u64] {
        &self.counts[..self.end]
    }

    /// Adds another histogram's counts.
    fn merge(&mut self, other: &Self) {
        for (count, more) in self.counts.iter_mut().zip(other.counts()) {
            *count += more;
        }
        self.total += other.total;
        self.end = self.end.max(other.end);
    }

    /// The cost of coding everything counted here and in `other` with one table, in 1/65536 bits, including the table.
    fn cost_with(&self, other: Option<&Self>) -> u64 {
        let empty: &[u64] = &[];
        let (a, b) = (&self.counts[..], other.map_or(empty, |other| other.counts()));
        let end = self.end.max(b.len());
        let total = self.total + other.map_or(0, |other| other.total);
        let mut cost = total_information(total);
        let mut table_bits = TABLE_BITS;
        let mut absent = false;
        for token in 0..end {
            let count = a[token] + b.get(token).copied().unwrap_or(0);
            if count > 0 {
                cost = cost.saturating_sub(total_information(count));
                table_bits += TOKEN_BITS;
            } else if !absent {
                table_bits += GAP_BITS;
            }
            absent = count == 0;
        }
        cost + (table_bits << 16)
    }
}

/// Rough size of the parts of a stored table, in bits: see [`Frequencies::write`].
const TABLE_BITS: u64 = 8;
const TOKEN_BITS: u64 = 7;
const GAP_BITS: u64 = 7;

/// `n log2 n` in 1/65536 bits.
fn total_information(n: u64) -> u64 {
    n.saturating_mul(log2_fixed(n))
}

/// Logarithms of 1 + i/256 to base 2, in 1/65536.
static LOG2: [u32; 257] = log2_table();

const fn log2_table() -> [u32; 257] {
    let mut table = [0; 257];
    let mut i = 0;
    while i <= 256 {
        // Bit by bit: squaring a number in [1, 2) doubles its logarithm.
        let mut x = (256 + i as u64) << 23; // 31 fractional bits
        let (mut result, mut bit) = (0_u32, 0);
        if i == 256 {
            result = 1 << 16;
            bit = 16;
        }
        while bit < 16 {
            x = (x * x) >> 31;
            result <<= 1;
            if x >= 1 << 32 {
                x >>= 1;
                result |= 1;
            }
            bit += 1;
        }
        table[i] = result;
        i += 1;
    }
    table
}

/// `log2 n` in 1/65536, 0 for n = 0; the error is below 2 / 65536.
pub(super) fn log2_fixed(n: u64) -> u64 {
    if n == 0 {
        return 0;
    }
    let magnitude = n.ilog2();
    let fraction = ((u128::from(n) << 32 >> magnitude) & 0xffff_ffff) as u64;
    let cell = (fraction >> 24) as usize;
    let (low, high) = (u64::from(LOG2[cell]), u64::from(LOG2[cell + 1]));
    (u64::from(magnitude) << 16) + low + (((high - low) * (fraction & 0xff_ffff)) >> 24)
}

/// Distributes contexts over at most `max_tables` tables. Returns the table of every context, `None` for those without
/// symbols, and the tables in the order of their first contexts.
pub(super) fn share_tables(contexts: &[Histogram], max_tables: usize) -> (Vec<Option<usize>>, Vec<Frequencies>) {
    let mut sets: Vec<(Histogram, Vec<usize>, u64)> = contexts
        .iter()
        .enumerate()
        .filter(|(_, histogram)| histogram.total() > 0)
        .map(|(context, histogram)| (histogram.clone(), vec![context], histogram.cost_with(None)))
        .collect();
    // gain[i][j], j < i: what merging saves (negative: costs).
    let gain_of = |a: &(Histogram, Vec<usize>, u64), b: &(Histogram, Vec<usize>, u64)| {
        (a.2 + b.2) as i64 - a.0.cost_with(Some(&b.0)) as i64
    };
    let mut gain: Vec<Vec<i64>> =
        (0..sets.len()).map(|i| (0..i).map(|j| gain_of(&sets[i], &sets[j])).collect()).collect();
    loop {
        let mut best: Option<(i64, usize, usize)> = None;
        for (i, row) in gain.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                if best.is_none_or(|(most, ..)| value > most) {
                    best = Some((value, i, j));
                }
            }
        }
        let Some((value, i, j)) = best else { break };
        if value <= 0 && sets.len() <= max_tables {
            break;
        }
        let (histogram, members, _) = sets.remove(i);
        gain.remove(i);
        gain.iter_mut().skip(i).for_each(|row| {
            row.remove(i);
        });
        sets[j].0.merge(&histogram);
        sets[j].1.extend(members);
        sets[j].2 = sets[j].0.cost_with(None);
        for k in (0..sets.len()).filter(|&k| k != j) {
            gain[j.max(k)][j.min(k)] = gain_of(&sets[j], &sets[k]);
        }
    }
    let mut table_of = vec![None; contexts.len()];
    let tables = sets
        .iter()
        .enumerate()
        .map(|(index, (histogram, members, _))| {
            members.iter().for_each(|&context| table_of[context] = Some(index));
            Frequencies::normalised(histogram.counts())
        })
        .collect();
    (table_of, tables)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integer_logarithm_is_close() {
        for n in (1..5000_u64).chain((1..40).map(|bit| (1 << bit) + 12345)) {
            let error = log2_fixed(n) as f64 / 65536.0 - (n as f64).log2();
            assert!(error.abs() < 4e-5, "{n}: {error}");
        }
    }

    #[test]
    fn alike_contexts_share_a_table_and_unlike_ones_do_not() {
        let mut contexts = vec![Histogram::default(); 4];
        for i in 0..10_000 {
            contexts[0].add((i % 2) as u8, 1);
            contexts[2].add((i % 2) as u8, 1);
            contexts[3].add(((i % 50) / 49 + 7) as u8, 1);
        }
        let (table_of, tables) = share_tables(&contexts, 48);
        assert_eq!(table_of, [Some(0), None, Some(0), Some(1)]);
        assert_eq!(tables.len(), 2);
        assert_eq!(share_tables(&contexts, 1).1.len(), 1);
    }
}
