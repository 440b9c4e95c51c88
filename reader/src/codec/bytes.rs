//! Little-endian numbers and base-128 varints in byte strings (SPEC.md, "Conventions").

use crate::error::{Error, Result};

/// Appends an unsigned number in base 128: seven bits per byte, lowest first, with the top bit set on all bytes but the
/// last.
pub(crate) fn put_varint(bytes: &mut Vec<u8>, value: u64) {
    let mut rest = value;
    while rest >= 0x80 {
        bytes.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    bytes.push(rest as u8);
}

/// Reads a byte string from front to back.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    /// Starts at the first byte.
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// The number of bytes left.
    pub(crate) fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next `length` bytes.
    pub(crate) fn bytes(&mut self, length: usize) -> Result<&'a [u8]> {
        let (bytes, rest) = self.rest.split_at_checked(length).ok_or_else(ends_early)?;
        self.rest = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let (bytes, rest) = self.rest.split_first_chunk::<N>().ok_or_else(ends_early)?;
        self.rest = rest;
        Ok(*bytes)
    }

    pub(crate) fn u8(&mut self) -> Result<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    pub(crate) fn u16(&mut self) -> Result<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Result<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&mut self) -> Result<i32> {
        self.array().map(i32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Result<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A finite floating point number.
    pub(crate) fn f64(&mut self) -> Result<f64> {
        let value = self.array().map(f64::from_le_bytes)?;
        if value.is_finite() { Ok(value) } else { Err(Error::format("a number is not finite")) }
    }

    /// Bytes that must be zero.
    pub(crate) fn reserved(&mut self, length: usize) -> Result<()> {
        if self.bytes(length)?.iter().all(|&byte| byte == 0) {
            Ok(())
        } else {
            Err(Error::format("a reserved field is not zero"))
        }
    }

    /// A varint in its shortest form.
    pub(crate) fn varint(&mut self) -> Result<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            let bits = u64::from(byte & 0x7f);
            if bits << shift >> shift != bits || (byte == 0 && shift > 0) {
                return Err(Error::format("a varint is not in its shortest form, or exceeds 64 bits"));
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Error::format("a varint exceeds 64 bits"))
    }

    /// A varint that must not exceed `limit` by a rule of the format, which `what` names.
    pub(crate) fn varint_up_to(&mut self, limit: u64, what: &'static str) -> Result<u64> {
        let value = self.varint()?;
        if value <= limit { Ok(value) } else { Err(Error::format(what)) }
    }

    /// Checks that all bytes have been read.
    pub(crate) fn finish(self) -> Result<()> {
        if self.rest.is_empty() { Ok(()) } else { Err(Error::format("bytes are left over")) }
    }
}

fn ends_early() -> Error {
    Error::format("the bytes end early")
}

/// Whether bytes have a checksum (SPEC.md, "Numbers in bytes"). A fuzzer takes every checksum for right, since no
/// mutation would get past this check.
pub(crate) fn has_checksum(bytes: &[u8], checksum: u32) -> bool {
    #[cfg(test)]
    if ANY_CHECKSUM.get() {
        return true;
    }
    cfg!(fuzzing) || crc32fast::hash(bytes) == checksum
}

#[cfg(test)]
thread_local! {
    /// Whether every checksum is taken for right in this thread, as a fuzzer does.
    pub(crate) static ANY_CHECKSUM: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_survive_and_long_forms_are_refused() {
        for value in (0..64).flat_map(|bit| [(1_u64 << bit) - 1, 1 << bit]).chain([u64::MAX]) {
            let mut bytes = Vec::new();
            put_varint(&mut bytes, value);
            let mut cursor = Cursor::new(&bytes);
            assert_eq!(cursor.varint().unwrap(), value);
            cursor.finish().unwrap();
            assert!(Cursor::new(&bytes[..bytes.len() - 1]).varint().is_err());
        }
        assert!(Cursor::new(&[0x80, 0]).varint().is_err());
        assert!(Cursor::new(&[0xff; 10]).varint().is_err());
        assert!(Cursor::new(&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 2]).varint().is_err());
    }
}
