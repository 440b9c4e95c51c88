//! Symbols and their entropy coding with static tables shared by the whole file (SPEC.md, "Entropy coding").
//!
//! A codec writes unsigned values with a context to a [`SymbolBuffer`]; when all are known, tables are made from their
//! statistics and every page becomes one rANS stream. Decoding pulls the values in the same order from a [`SymbolSource`].

use crate::{context::Context, error::Result};

/// Values in coding order, each with its context; what an encoder produces before the tables are known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SymbolBuffer {
    /// Context and value of each symbol.
    pub(crate) symbols: Vec<(Context, u64)>,
}

impl SymbolBuffer {
    /// Appends an unsigned value; small values are cheap.
    pub(crate) fn put(&mut self, context: Context, value: u64) {
        self.symbols.push((context, value));
    }

    /// Appends a signed value, zigzag mapped (0, -1, 1, -2, ... become 0, 1, 2, 3, ...).
    pub(crate) fn put_signed(&mut self, context: Context, value: i64) {
        self.put(context, ((value << 1) ^ (value >> 63)) as u64);
    }
}

/// Where a decoder's values come from.
pub(crate) trait SymbolSource {
    /// The next unsigned value, which was put with the same context.
    ///
    /// # Errors
    /// [`crate::Error::Format`] where the stream ends early or breaks a rule.
    fn get(&mut self, context: Context) -> Result<u64>;

    /// The next signed value.
    fn get_signed(&mut self, context: Context) -> Result<i64> {
        let value = self.get(context)?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }
}

/// Replays a buffer without entropy coding: the decoder's twin in tests and in the encoder's own checks.
#[derive(Clone, Debug)]
pub(crate) struct Replay<'a> {
    symbols: std::slice::Iter<'a, (Context, u64)>,
}

impl<'a> Replay<'a> {
    /// Starts at the buffer's first symbol.
    pub(crate) fn new(buffer: &'a SymbolBuffer) -> Self {
        Self { symbols: buffer.symbols.iter() }
    }
}

impl SymbolSource for Replay<'_> {
    fn get(&mut self, context: Context) -> Result<u64> {
        match self.symbols.next() {
            Some(&(found, value)) if found == context => Ok(value),
            _ => Err(crate::error::Error::format("symbols do not match their contexts")),
        }
    }
}
