//! Symbols and their entropy coding with static tables shared by the whole file (SPEC.md, "Entropy coding").
//!
//! An encoder puts unsigned values, each with a context, into a [`SymbolBuffer`]. Once all values of a file are known,
//! [`Tables`] are made from their statistics, and the values become rANS streams (J. Duda, "Asymmetric numeral
//! systems", 2013). A decoder pulls the values in the same order from a [`SymbolSource`], usually a [`Decoder`].
//!
//! - [`context`]: who owns which contexts,
//! - [`buffer`]: symbols that wait for their tables,
//! - [`token`]: values as tokens, which are entropy coded, and raw extra bits,
//! - [`tables`]: the frequencies of tokens in each context, and how they are stored,
//! - [`sharing`]: which contexts should share a table (encoder only),
//! - [`tally`]: how often each symbol occurs (encoder only),
//! - [`estimate`]: what symbols will cost before there are tables (encoder only),
//! - [`code`]: tables in the form that an encoder uses (encoder only),
//! - [`rans`]: the streams.

mod bits;
mod buffer;
mod code;
pub(crate) mod context;
mod estimate;
mod rans;
mod sharing;
#[cfg(feature = "serde")]
mod stored;
mod tables;
mod tally;
mod token;

pub use buffer::SymbolBuffer;
pub(crate) use buffer::{Mark, Symbols};
pub(crate) use code::Codes;
pub use estimate::SymbolStatistics;
pub(crate) use rans::{Decoder, Position, encode};
pub(crate) use tables::Tables;
pub(crate) use tally::Tally;

use crate::{codec::entropy::context::Context, error::Violation};

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
pub(crate) fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

/// The inverse of [`zigzag`].
pub(crate) fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

/// A source of values for a decoder.
pub(crate) trait SymbolSource {
    /// The next unsigned value. The encoder put it with the same context.
    ///
    /// # Errors
    /// If the stream ends early or breaks a rule.
    fn get(&mut self, context: Context) -> Result<u64, Violation>;

    /// The next signed value.
    #[inline(always)]
    fn get_signed(&mut self, context: Context) -> Result<i64, Violation> {
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
    fn get(&mut self, context: Context) -> Result<u64, Violation> {
        match self.symbols.next() {
            Some((found, value)) if found == context => Ok(value),
            _ => Err(Violation(&"symbols do not match their contexts")),
        }
    }
}
