//! Symbol buffers in files of a builder's own: two strings of bytes, the tokens and the extra bits.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use super::{SymbolBuffer, buffer::SYMBOL_BYTES, token::extra_bytes};

impl Serialize for SymbolBuffer {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (Bytes(&self.tokens), Bytes(&self.extra)).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for SymbolBuffer {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (Owned(tokens), Owned(extra)) = Deserialize::deserialize(deserializer)?;
        if fit(&tokens, &extra) { Ok(Self { tokens, extra }) } else { Err(de::Error::custom("symbols are cut off")) }
    }
}

/// Whether each token has its extra bits, and nothing else is there.
fn fit(tokens: &[u8], extra: &[u8]) -> bool {
    let (symbols, rest) = tokens.as_chunks::<SYMBOL_BYTES>();
    rest.is_empty() && symbols.iter().map(|&[token, ..]| extra_bytes(token)).sum::<usize>() == extra.len()
}

struct Bytes<'a>(&'a [u8]);

impl Serialize for Bytes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self.0)
    }
}

struct Owned(Vec<u8>);

impl<'de> Deserialize<'de> for Owned {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_byte_buf(ToOwned)
    }
}

struct ToOwned;

impl de::Visitor<'_> for ToOwned {
    type Value = Owned;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("bytes of symbols")
    }

    fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<Owned, E> {
        Ok(Owned(bytes.to_vec()))
    }

    fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<Owned, E> {
        Ok(Owned(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_symbols_fit() {
        let symbols: SymbolBuffer = [(0, 0), (200, 127), (3, 128), (4, u64::MAX)].into_iter().collect();
        let SymbolBuffer { tokens, extra } = &symbols;
        assert!(fit(tokens, extra));
        assert!(!fit(&tokens[..11], extra) && !fit(&tokens[..9], extra) && !fit(tokens, &extra[1..]));
        assert!(fit(&tokens[..3], &[]) && fit(&[], &[]));
    }
}
