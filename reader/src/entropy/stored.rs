//! Symbol buffers in files of a builder's own.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use super::{SymbolBuffer, Symbols};

impl Serialize for SymbolBuffer {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.bytes)
    }
}

impl<'de> Deserialize<'de> for SymbolBuffer {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_byte_buf(Packed)
    }
}

struct Packed;

impl de::Visitor<'_> for Packed {
    type Value = SymbolBuffer;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("packed symbols")
    }

    fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<SymbolBuffer, E> {
        self.visit_byte_buf(bytes.to_vec())
    }

    fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<SymbolBuffer, E> {
        match count(&bytes) {
            Some(len) => Ok(SymbolBuffer { bytes, len }),
            None => Err(E::custom("symbols are cut off, or larger than 64 bits")),
        }
    }
}

/// How many symbols there are, if [`Symbols`] can go through all of them.
fn count(bytes: &[u8]) -> Option<usize> {
    const MAX_VALUE_BYTES: usize = 10;
    let (mut rest, mut len) = (bytes, 0);
    while let Some((_context, value)) = rest.split_first() {
        let last = value.iter().take(MAX_VALUE_BYTES).position(|&byte| byte < 0x80)?;
        if last + 1 == MAX_VALUE_BYTES && value[last] > 1 {
            return None;
        }
        rest = &value[last + 1..];
        len += 1;
    }
    debug_assert_eq!(len, Symbols { bytes: bytes.iter() }.count());
    Some(len)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_symbols_are_counted() {
        let symbols: SymbolBuffer = [(0, 0), (255, 127), (3, 128), (4, u64::MAX)].into_iter().collect();
        assert_eq!(count(&symbols.bytes), Some(4));
        assert!((1..symbols.bytes.len()).filter(|&end| count(&symbols.bytes[..end]).is_some()).count() == 3);
        assert_eq!(count(&[0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2]), None);
    }
}
