//! Symbols that wait for their tables (encoder only).

use std::ops::Range;

use super::{
    token::{extra_bits, extra_bytes, token_of, value_of},
    zigzag,
};
use crate::codec::entropy::context::{self, Context};

/// How many bytes hold a symbol's token and context.
pub(super) const SYMBOL_BYTES: usize = 3;

/// Values in coding order, each with its context: what an encoder produces before the tables are known.
///
/// Tokens and contexts, `SYMBOL_BYTES` a symbol, are kept apart from the extra bits, which take whole bytes: a build
/// holds the symbols of whole levels and walks through them forwards and backwards.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SymbolBuffer {
    /// Token and context (low byte first) of each symbol.
    pub(super) tokens: Vec<u8>,
    /// Per symbol [`extra_bytes`], low bits first.
    pub(super) extra: Vec<u8>,
}

impl SymbolBuffer {
    /// Appends an unsigned value. Small values cost few bits.
    #[inline]
    pub(crate) fn put(&mut self, context: Context, value: u64) {
        debug_assert!(usize::from(context) < context::COUNT);
        let token = token_of(value);
        let [low, high] = context.to_le_bytes();
        self.tokens.extend_from_slice(&[token, low, high]);
        let bits = extra_bits(token);
        if bits > 0 {
            let extra = value & ((1 << bits) - 1);
            self.extra.extend(&extra.to_le_bytes()[..extra_bytes(token)]);
        }
    }

    /// Appends a signed value, zigzag mapped (0, -1, 1, -2, ... become 0, 1, 2, 3, ...).
    pub(crate) fn put_signed(&mut self, context: Context, value: i64) {
        self.put(context, zigzag(value));
    }

    /// The number of symbols.
    pub fn len(&self) -> usize {
        self.tokens.len() / SYMBOL_BYTES
    }

    /// Whether there is no symbol.
    pub fn is_empty(&self) -> bool {
        self.tokens.is_empty()
    }

    /// The place of the next symbol.
    pub(crate) fn mark(&self) -> Mark {
        Mark { tokens: self.tokens.len() as u32, extra: self.extra.len() as u32 }
    }

    /// As [`SymbolBuffer::mark`], or none if the buffer is too large for a mark.
    pub(crate) fn checked_mark(&self) -> Option<Mark> {
        Some(Mark { tokens: self.tokens.len().try_into().ok()?, extra: self.extra.len().try_into().ok()? })
    }

    /// Removes everything that was put after `mark` was taken.
    pub(crate) fn truncate(&mut self, mark: Mark) {
        self.tokens.truncate(mark.tokens as usize);
        self.extra.truncate(mark.extra as usize);
    }

    /// Makes room for `count` more symbols.
    pub(crate) fn reserve(&mut self, count: usize) {
        self.tokens.reserve(SYMBOL_BYTES * count);
    }

    /// Appends all symbols of another buffer.
    pub(crate) fn append(&mut self, other: &Self) {
        self.tokens.extend(&other.tokens);
        self.extra.extend(&other.extra);
    }

    /// The symbols, in order.
    pub(crate) fn iter(&self) -> Symbols<'_> {
        Symbols { tokens: self.tokens.as_chunks().0, extra: &self.extra }
    }

    /// The symbols between two marks; none if these belong to another buffer.
    pub(crate) fn within(&self, Range { start, end }: Range<Mark>) -> Symbols<'_> {
        let tokens = self.tokens.get(start.tokens as usize..end.tokens as usize);
        let extra = self.extra.get(start.extra as usize..end.extra as usize);
        let (tokens, extra) = tokens.zip(extra).unwrap_or_default();
        Symbols { tokens: tokens.as_chunks().0, extra }
    }
}

impl FromIterator<(Context, u64)> for SymbolBuffer {
    fn from_iter<T: IntoIterator<Item = (Context, u64)>>(symbols: T) -> Self {
        let mut buffer = Self::default();
        symbols.into_iter().for_each(|(context, value)| buffer.put(context, value));
        buffer
    }
}

/// A place between two symbols of a [`SymbolBuffer`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Mark {
    tokens: u32,
    extra: u32,
}

/// Symbols of a [`SymbolBuffer`]: context and value of each, in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Symbols<'a> {
    tokens: &'a [[u8; SYMBOL_BYTES]],
    extra: &'a [u8],
}

impl<'a> Symbols<'a> {
    /// The symbols of these tokens and extra bits.
    pub(crate) fn of([tokens, extra]: [&'a [u8]; 2]) -> Self {
        Self { tokens: tokens.as_chunks().0, extra }
    }

    /// Tokens and extra bits.
    pub(crate) fn bytes(&self) -> [&'a [u8]; 2] {
        [self.tokens.as_flattened(), self.extra]
    }

    /// Token and context of each symbol that is left.
    pub(super) fn tokens(&self) -> &'a [[u8; SYMBOL_BYTES]] {
        self.tokens
    }

    /// Takes the last symbol, as context, token and extra bits.
    #[inline]
    pub(super) fn pop(&mut self) -> Option<(Context, u8, u64)> {
        let (&[token, low, high], tokens) = self.tokens.split_last()?;
        let count = extra_bytes(token);
        let (extra, bytes) = self.extra.split_at_checked(self.extra.len().wrapping_sub(count))?;
        (self.tokens, self.extra) = (tokens, extra);
        Some((Context::from_le_bytes([low, high]), token, number(bytes)))
    }
}

impl Iterator for Symbols<'_> {
    type Item = (Context, u64);

    #[inline]
    fn next(&mut self) -> Option<(Context, u64)> {
        let (&[token, low, high], tokens) = self.tokens.split_first()?;
        let (bytes, extra) = self.extra.split_at_checked(extra_bytes(token))?;
        (self.tokens, self.extra) = (tokens, extra);
        Some((Context::from_le_bytes([low, high]), value_of(token, number(bytes))))
    }
}

/// Up to eight bytes as a number, the lowest first.
#[inline]
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| (number << 8) | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_come_back_from_both_ends_and_between_marks() {
        let last = context::COUNT as Context - 1;
        let values = [(0, 0), (last, 15), (3, 16), (4, u64::MAX), (9, 1 << 40), (7, 3), (8, 12345)];
        let mut symbols = SymbolBuffer::default();
        let mut marks = vec![symbols.mark()];
        for (context, value) in values {
            symbols.put(context, value);
            marks.push(symbols.mark());
        }
        assert_eq!((symbols.len(), symbols.iter().collect::<Vec<_>>()), (values.len(), values.to_vec()));
        for start in 0..marks.len() {
            for end in start..marks.len() {
                let mut some = symbols.within(marks[start]..marks[end]);
                assert!(some.eq(values[start..end].iter().copied()));
                for &(context, value) in values[start..end].iter().rev() {
                    let (c, token, extra) = some.pop().unwrap();
                    assert_eq!((c, value_of(token, extra)), (context, value));
                }
                assert_eq!(some.pop(), None);
            }
            let mut cut = symbols.clone();
            cut.truncate(marks[start]);
            assert!(cut.iter().eq(values[..start].iter().copied()));
        }
        assert_eq!(SymbolBuffer::default().within(marks[0]..marks[3]).count(), 0);
    }
}
