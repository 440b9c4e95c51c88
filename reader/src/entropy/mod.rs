//! Symbols and their entropy coding with static tables shared by the whole file (SPEC.md, "Entropy coding").
//!
//! A codec writes unsigned values with a context to a [`SymbolBuffer`]; when all are known, [`Tables`] are made from their
//! statistics and every page part becomes one or more rANS streams (J. Duda, "Asymmetric numeral systems", 2013). Decoding
//! pulls the values in the same order from a [`SymbolSource`], usually a [`Decoder`].
//!
//! - [`token`]: a value is a token (entropy coded) and raw extra bits,
//! - [`tables`]: frequencies of tokens, which contexts share them, and how they are stored,
//! - [`cluster`]: which contexts should share a table (encoder only),
//! - [`estimate`]: what symbols will cost (encoder only),
//! - [`rans`]: the streams.

mod bits;
mod cluster;
mod estimate;
mod rans;
#[cfg(feature = "serde")]
mod stored;
mod tables;
mod token;

pub use estimate::SymbolStatistics;
pub(crate) use rans::{Decoder, Position, encode};
pub(crate) use tables::Tables;

use crate::{
    context::{self, Context},
    error::Result,
};

/// Values in coding order, each with its context; what an encoder produces before the tables are known.
///
/// Kept packed (one byte of context, then the value in base 128), since a build holds the symbols of whole levels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SymbolBuffer {
    bytes: Vec<u8>,
    len: usize,
}

impl SymbolBuffer {
    /// Appends an unsigned value; small values are cheap.
    pub(crate) fn put(&mut self, context: Context, value: u64) {
        debug_assert!(context < context::COUNT);
        self.bytes.push(context as u8);
        let mut rest = value;
        while rest >= 0x80 {
            self.bytes.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        self.bytes.push(rest as u8);
        self.len += 1;
    }

    /// Appends a signed value, zigzag mapped (0, -1, 1, -2, ... become 0, 1, 2, 3, ...).
    pub(crate) fn put_signed(&mut self, context: Context, value: i64) {
        self.put(context, zigzag(value));
    }

    /// How many symbols there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no symbol.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Where the next symbol will go, for [`SymbolBuffer::truncate`].
    pub(crate) fn mark(&self) -> Mark {
        Mark { bytes: self.bytes.len(), len: self.len }
    }

    /// Removes everything that was put since `mark` was taken.
    pub(crate) fn truncate(&mut self, mark: Mark) {
        self.bytes.truncate(mark.bytes);
        self.len = mark.len;
    }

    /// Context and value of each symbol, in order.
    pub(crate) fn iter(&self) -> Symbols<'_> {
        Symbols { bytes: self.bytes.iter() }
    }
}

impl FromIterator<(Context, u64)> for SymbolBuffer {
    fn from_iter<T: IntoIterator<Item = (Context, u64)>>(symbols: T) -> Self {
        let mut buffer = Self::default();
        symbols.into_iter().for_each(|(context, value)| buffer.put(context, value));
        buffer
    }
}

/// A place in a [`SymbolBuffer`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    bytes: usize,
    len: usize,
}

/// The symbols of a [`SymbolBuffer`] in order.
#[derive(Clone, Debug)]
pub(crate) struct Symbols<'a> {
    bytes: std::slice::Iter<'a, u8>,
}

impl Iterator for Symbols<'_> {
    type Item = (Context, u64);

    fn next(&mut self) -> Option<(Context, u64)> {
        let context = Context::from(*self.bytes.next()?);
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = *self.bytes.next()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some((context, value));
            }
            shift += 7;
        }
    }
}

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
pub(crate) fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

/// The inverse of [`zigzag`].
pub(crate) fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

/// Where a decoder's values come from.
pub(crate) trait SymbolSource {
    /// The next unsigned value, which was put with the same context.
    ///
    /// # Errors
    /// [`crate::Error::Format`] where the stream ends early or breaks a rule.
    fn get(&mut self, context: Context) -> Result<u64>;

    /// The next signed value.
    #[inline(always)]
    fn get_signed(&mut self, context: Context) -> Result<i64> {
        Ok(unzigzag(self.get(context)?))
    }
}

/// Replays a buffer without entropy coding: the decoder's twin in tests.
#[cfg(test)]
#[derive(Clone, Debug)]
pub(crate) struct Replay<'a> {
    symbols: Symbols<'a>,
}

#[cfg(test)]
impl<'a> Replay<'a> {
    /// Starts at the buffer's first symbol.
    pub(crate) fn new(buffer: &'a SymbolBuffer) -> Self {
        Self { symbols: buffer.iter() }
    }

    /// Whether all symbols have been read.
    pub(crate) fn is_at_end(&self) -> bool {
        self.symbols.clone().next().is_none()
    }
}

#[cfg(test)]
impl SymbolSource for Replay<'_> {
    fn get(&mut self, context: Context) -> Result<u64> {
        match self.symbols.next() {
            Some((found, value)) if found == context => Ok(value),
            _ => Err(crate::Error::format("symbols do not match their contexts")),
        }
    }
}
