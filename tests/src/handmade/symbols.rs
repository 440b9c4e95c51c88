//! Tables and streams (SPEC.md, chapter 7), with a table in which all tokens have frequency 16.

const FREQUENCY: u64 = 16;

/// The number of contexts that have the flat table: all that version 4.0 uses.
pub const CONTEXT_COUNT: u64 = 249;

/// Numbers, each with its count of bits, as a bit string; the lowest bit of each byte first.
pub fn pack_bits(numbers: &[(u64, u32)]) -> Vec<u8> {
    let bits: Vec<bool> = numbers.iter().flat_map(|&(x, count)| (0..count).map(move |k| x >> k & 1 == 1)).collect();
    bits.chunks(8).map(|byte| byte.iter().enumerate().fold(0, |sum, (k, &bit)| sum | u8::from(bit) << k)).collect()
}

/// Elias' gamma code: zeros, a one, and the bits below the leading one.
fn gamma(g: u64) -> [(u64, u32); 2] {
    let k = g.ilog2();
    [(1 << k, k + 1), (g - (1 << k), k)]
}

/// The numbers of section TABLES: one table, 16 for each token, used by the given number of contexts from 0 on.
pub(super) fn flat_table_numbers(context_count: u64) -> Vec<(u64, u32)> {
    let mut numbers = gamma(2).to_vec();
    for _ in 0..255 {
        // 2^(5 - 1) + 0
        numbers.extend([(5, 4), (0, 3)]);
    }
    numbers.extend([(13, 4), (14, 4)]);
    numbers.extend(contexts(context_count));
    numbers
}

/// The number of contexts, then each one's distance; there is nothing to say about which table it uses.
pub(super) fn contexts(count: u64) -> Vec<(u64, u32)> {
    let mut numbers = gamma(count + 1).to_vec();
    numbers.extend((0..count).map(|_| (1, 1)));
    numbers
}

/// Section TABLES with one flat table for the given number of contexts.
pub fn flat_tables(context_count: u64) -> Vec<u8> {
    pack_bits(&flat_table_numbers(context_count))
}

/// A stream of symbols with the flat table.
pub fn encode(symbols: &[u64]) -> Vec<u8> {
    let mut state = 65536_u64;
    let mut words = vec![];
    let mut emit_from = |state: &mut u64, limit: u64| {
        if *state >= limit {
            words.push(*state as u16);
            *state >>= 16;
        }
    };
    for &value in symbols.iter().rev() {
        let (token, extra, extra_bits) = if value < 16 {
            (value, 0, 0)
        } else {
            let k = value.ilog2();
            let token = 16 + 4 * (u64::from(k) - 4) + (value >> (k - 2)) % 4;
            (token, value % (1 << (k - 2)), k - 2)
        };
        let pieces: Vec<u32> = (0..extra_bits).step_by(16).collect();
        for &done in pieces.iter().rev() {
            let count = (extra_bits - done).min(16);
            emit_from(&mut state, 1 << (32 - count));
            state = (state << count) + (extra >> done) % (1 << count);
        }
        emit_from(&mut state, FREQUENCY << 20);
        state = ((state / FREQUENCY) << 12) + state % FREQUENCY + FREQUENCY * token;
    }
    if state == 65536 && words.is_empty() {
        return vec![];
    }
    let mut bytes = (state as u32).to_le_bytes().to_vec();
    bytes.extend(words.iter().rev().flat_map(|word| word.to_le_bytes()));
    bytes
}
