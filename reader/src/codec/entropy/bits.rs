//! Bit strings, with the lowest bit of each byte first: the form in which tables are stored (SPEC.md, "Section
//! TABLES").

use crate::error::{Error, Result};

/// Numbers in gamma code are below `1 << MAX_GAMMA_BITS`.
const MAX_GAMMA_BITS: u32 = 24;

/// Writes numbers of few bits.
#[derive(Debug, Default)]
pub(super) struct BitWriter {
    bytes: Vec<u8>,
    pending: u64,
    pending_bits: u32,
}

impl BitWriter {
    /// Appends the `bits` (at most 32) lowest bits of `value`, lowest first.
    pub(super) fn put(&mut self, value: u32, bits: u32) {
        debug_assert!(bits <= 32 && u64::from(value) < 1 << bits);
        self.pending |= u64::from(value) << self.pending_bits;
        self.pending_bits += bits;
        while self.pending_bits >= 8 {
            self.bytes.push(self.pending as u8);
            self.pending >>= 8;
            self.pending_bits -= 8;
        }
    }

    /// Appends a number from 1 on in Elias' gamma code: k zeros, a one, then the k bits below the leading one.
    pub(super) fn put_gamma(&mut self, value: u32) {
        let below = value.ilog2();
        debug_assert!(below < MAX_GAMMA_BITS);
        self.put(1 << below, below + 1);
        self.put(value - (1 << below), below);
    }

    /// The bytes; unused bits of the last one are zero.
    pub(super) fn finish(mut self) -> Vec<u8> {
        if self.pending_bits > 0 {
            self.bytes.push(self.pending as u8);
        }
        self.bytes
    }
}

/// Reads what [`BitWriter`] wrote.
#[derive(Debug)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    pending: u64,
    pending_bits: u32,
}

impl<'a> BitReader<'a> {
    /// Starts at the first bit.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, pending: 0, pending_bits: 0 }
    }

    /// The next `bits` (at most 32) bits.
    pub(super) fn take(&mut self, bits: u32) -> Result<u32> {
        while self.pending_bits < bits {
            let (&byte, rest) = self.bytes.split_first().ok_or_else(|| Error::format("the section ends early"))?;
            self.bytes = rest;
            self.pending |= u64::from(byte) << self.pending_bits;
            self.pending_bits += 8;
        }
        let value = self.pending & ((1 << bits) - 1);
        self.pending >>= bits;
        self.pending_bits -= bits;
        Ok(value as u32)
    }

    /// The next number in Elias' gamma code.
    pub(super) fn take_gamma(&mut self) -> Result<u32> {
        let mut below = 0;
        while self.take(1)? == 0 {
            below += 1;
            if below >= MAX_GAMMA_BITS {
                return Err(Error::format("a number is too large"));
            }
        }
        Ok(1 << below | self.take(below)?)
    }

    /// Checks that nothing is left but zero bits of the last byte.
    pub(super) fn finish(self) -> Result<()> {
        if self.bytes.is_empty() && self.pending == 0 && self.pending_bits < 8 {
            Ok(())
        } else {
            Err(Error::format("bytes are left over"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_gamma_codes_survive() {
        let mut writer = BitWriter::default();
        for value in 1..300_u32 {
            writer.put_gamma(value);
            writer.put(value & 7, 3);
        }
        writer.put(u32::MAX, 32);
        let bytes = writer.finish();
        let mut reader = BitReader::new(&bytes);
        for value in 1..300 {
            assert_eq!(reader.take_gamma().unwrap(), value);
            assert_eq!(reader.take(3).unwrap(), value & 7);
        }
        assert_eq!(reader.take(32).unwrap(), u32::MAX);
        reader.finish().unwrap();
        assert!(BitReader::new(&[0, 0, 0, 0, 0]).take_gamma().is_err());
        assert!(BitReader::new(&[1, 0]).finish().is_err());
    }
}
