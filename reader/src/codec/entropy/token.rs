//! Values as tokens (SPEC.md, "Symbols and tokens"). A value below 16 is its own token. The token of a larger value
//! gives its magnitude and the two bits below its leading one; the remaining bits are stored raw.
//!
//! With v >= 16 and n = floor(log2 v): token = 16 + 4 (n - 4) + the two bits of v below the leading one; n - 2 extra
//! bits.

/// Number of tokens: a `u64` needs classes up to n = 63, whose last token is 255.
pub(super) const COUNT: usize = 256;

/// Values below this are their own tokens.
pub(super) const DIRECT: u8 = 16;

/// The token of a value.
pub(super) fn token_of(value: u64) -> u8 {
    if value < u64::from(DIRECT) {
        return value as u8;
    }
    let magnitude = value.ilog2();
    (16 + 4 * (magnitude - 4) + ((value >> (magnitude - 2)) & 3) as u32) as u8
}

/// The number of raw bits that follow a token.
pub(super) fn extra_bits(token: u8) -> u32 {
    if token < DIRECT { 0 } else { (u32::from(token) - 16) / 4 + 2 }
}

/// The number of whole bytes that hold the raw bits of a token.
#[inline]
pub(super) fn extra_bytes(token: u8) -> usize {
    extra_bits(token).div_ceil(8) as usize
}

/// The value of a token and its raw bits (`extra` is below `1 << extra_bits(token)`).
pub(super) fn value_of(token: u8, extra: u64) -> u64 {
    if token < DIRECT {
        return u64::from(token);
    }
    let bits = extra_bits(token);
    ((4 | u64::from(token & 3)) << bits) | extra
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_survive_as_token_and_extra_bits() {
        let edges = (0..64).flat_map(|bit| {
            let power = 1_u64 << bit;
            [power.wrapping_sub(1), power, power + 1, power | (power >> 1), power | (power >> 2)]
        });
        for value in (0..5000).chain(edges).chain([u64::MAX, u64::MAX - 1]) {
            let token = token_of(value);
            let extra = value & ((1_u64 << extra_bits(token)) - 1);
            assert_eq!(value_of(token, extra), value);
        }
        assert_eq!(usize::from(token_of(u64::MAX)), COUNT - 1);
    }

    #[test]
    fn tokens_grow_with_values() {
        assert!((1..100_000).all(|value| token_of(value) >= token_of(value - 1)));
    }
}
