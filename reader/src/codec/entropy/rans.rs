//! rANS streams: a state of 32 bits with words of 16 bits, written backwards and read forwards (SPEC.md, "Streams").
//!
//! A stream consists of the decoder's initial state (4 bytes, little-endian), followed by 16-bit words (little-endian).
//! Once all words are read, the state must be 65536. A stream that would consist of this state alone is stored as no
//! bytes.
//!
//! To read a symbol: with s = state mod 4096, find the token whose range start..start+frequency holds s; then
//! state = frequency (state / 4096) + s - start; while state < 65536 (at most once): state = 65536 state + next word.
//! Its extra bits follow, at most 16 at a time, lowest first: bits = state mod 2^k, state = state / 2^k, renormalised
//! in the same way.

use super::{
    Codes, SymbolSource, Symbols,
    tables::{FREQUENCY_BITS, Tables},
    token,
};
use crate::{
    codec::entropy::context::Context,
    error::{Error, Result, Violation},
};

/// States are in `LOWEST..1 << 32` between symbols.
const LOWEST: u32 = 1 << 16;
/// Raw bits are coded in pieces of at most this many.
const RAW_BITS: u32 = 16;

/// Encodes several runs of symbols as one stream.
///
/// # Errors
/// [`Error::Model`] if the tables have no code for a symbol, because they were made from other symbols.
pub(crate) fn encode<'a, I>(codes: &Codes, runs: I) -> Result<Vec<u8>>
where
    I: IntoIterator<Item = Symbols<'a>, IntoIter: DoubleEndedIterator>,
{
    let mut words = Words { words: Vec::new(), count: 0 };
    let mut state = LOWEST;
    for mut symbols in runs.into_iter().rev() {
        let [_, extra_bytes] = symbols.bytes();
        words.reserve(symbols.tokens().len() + extra_bytes.len());
        while let Some((context, token, extra)) = symbols.pop() {
            let bits = token::extra_bits(token);
            for done in (0..bits).step_by(RAW_BITS as usize).rev() {
                let piece = (bits - done).min(RAW_BITS);
                state = words.put(state, u64::from(state) >= 1 << (32 - piece));
                state = (state << piece) | ((extra >> done) as u32 & ((1 << piece) - 1));
            }
            let code = codes.of(context, token);
            if code.frequency() == 0 {
                return Err(Error::model(format!("context {context} has no code for token {token}")));
            }
            state = words.put(state, u64::from(state) >= u64::from(code.frequency()) << (32 - FREQUENCY_BITS));
            state = code.put(state);
        }
    }
    let words = &words.words[..words.count];
    if words.is_empty() && state == LOWEST {
        return Ok(Vec::new());
    }
    let mut bytes = Vec::with_capacity(4 + 2 * words.len());
    bytes.extend(state.to_le_bytes());
    words.iter().rev().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    Ok(bytes)
}

/// The words of a stream that is being written, last first.
struct Words {
    /// Those behind the last one have no meaning.
    words: Vec<u16>,
    count: usize,
}

impl Words {
    /// Makes room for `count` more.
    fn reserve(&mut self, count: usize) {
        self.words.resize(self.count + count, 0);
    }

    /// Puts the lower half of a state if that is too large, and returns what is left of it. Whether it is so is as good
    /// as random, so the word is written in any case: a branch would often be mispredicted.
    #[inline(always)]
    fn put(&mut self, state: u32, is_large: bool) -> u32 {
        if let Some(word) = self.words.get_mut(self.count) {
            *word = state as u16;
        }
        self.count += usize::from(is_large);
        if is_large { state >> 16 } else { state }
    }
}

/// How far a [`Decoder`] has read its stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Position {
    state: u32,
    next: usize,
}

/// Decodes one stream.
#[derive(Clone, Debug)]
pub(crate) struct Decoder<'a> {
    tables: &'a Tables,
    bytes: &'a [u8],
    at: Position,
}

impl<'a> Decoder<'a> {
    /// Starts a stream.
    ///
    /// # Errors
    /// [`Error::Format`] if the bytes cannot be a stream.
    pub(crate) fn new(tables: &'a Tables, bytes: &'a [u8]) -> Result<Self> {
        let at = match bytes.first_chunk::<4>() {
            Some(state) => Position { state: u32::from_le_bytes(*state), next: 4 },
            None => Position { state: LOWEST, next: 0 },
        };
        let whole = bytes.len().is_multiple_of(2) && bytes.len() != 2 && at.state >= LOWEST;
        if !whole || (at.state == LOWEST && bytes.len() == 4) {
            return Err(Error::format("a stream is not well formed"));
        }
        Ok(Self { tables, bytes, at })
    }

    /// Continues from where another decoder of the same stream has read to.
    pub(crate) fn resume(tables: &'a Tables, bytes: &'a [u8], at: Position) -> Self {
        Self { tables, bytes, at }
    }

    /// How far the decoder has read, for [`Decoder::resume`].
    pub(crate) fn position(&self) -> Position {
        self.at
    }

    /// Checks that the stream has been read to its end, and that the encoder began with this state.
    ///
    /// # Errors
    /// [`Error::Format`] otherwise.
    pub(crate) fn finish(self) -> Result<()> {
        if self.at.state == LOWEST && self.at.next == self.bytes.len() {
            Ok(())
        } else {
            Err(Error::format("a stream does not end with its last symbol"))
        }
    }

    /// Brings a state that has become too small back into its range. Whether that is so is as good as random, so the
    /// word is loaded in any case: a branch would often be mispredicted.
    #[inline]
    fn renormalise(&mut self, state: u32) -> Result<(), Violation> {
        let word = match self.bytes.get(self.at.next..).and_then(|rest| rest.first_chunk::<2>()) {
            Some(&word) => u32::from(u16::from_le_bytes(word)),
            None if state < LOWEST => return Err(Violation(&"a stream ends early")),
            None => 0,
        };
        let is_small = state < LOWEST;
        self.at.state = if is_small { (state << 16) | word } else { state };
        self.at.next += 2 * usize::from(is_small);
        Ok(())
    }

    /// The next `bits` raw bits.
    #[inline]
    fn raw(&mut self, bits: u32) -> Result<u64, Violation> {
        if bits > RAW_BITS {
            return self.raw_pieces(bits);
        }
        let value = self.at.state & ((1 << bits) - 1);
        self.renormalise(self.at.state >> bits)?;
        Ok(u64::from(value))
    }

    /// The next `bits` raw bits, in several pieces.
    #[cold]
    fn raw_pieces(&mut self, bits: u32) -> Result<u64, Violation> {
        let mut value = 0;
        for done in (0..bits).step_by(RAW_BITS as usize) {
            let piece = (bits - done).min(RAW_BITS);
            value |= u64::from(self.at.state & ((1 << piece) - 1)) << done;
            self.renormalise(self.at.state >> piece)?;
        }
        Ok(value)
    }
}

impl SymbolSource for Decoder<'_> {
    #[inline(always)]
    fn get(&mut self, context: Context) -> Result<u64, Violation> {
        let state = self.at.state;
        let Some(slot) = self.tables.slot(context, state) else {
            return Err(Violation(&"a symbol of a stream has a context without a table"));
        };
        let token = slot.token;
        // At most 4096 (2^20 - 1) + 4095, below 2^32.
        self.renormalise(slot.frequency * (state >> FREQUENCY_BITS) + slot.bias)?;
        if token < token::DIRECT {
            return Ok(u64::from(token));
        }
        let extra = self.raw(token::extra_bits(token))?;
        Ok(token::value_of(token, extra))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::entropy::SymbolBuffer;

    /// A small generator of test values (xorshift).
    fn values(seed: u64) -> impl FnMut() -> u64 {
        let mut x = seed | 1;
        move || {
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            x
        }
    }

    fn buffer_of(count: usize, seed: u64) -> SymbolBuffer {
        let mut next = values(seed);
        let mut buffer = SymbolBuffer::default();
        for _ in 0..count {
            let r = next();
            let context = (r >> 40) % 23;
            buffer.put(context as Context * 11, next() >> (64 - (r % (2 + context * context)).clamp(1, 64)));
        }
        buffer
    }

    fn decode_all(tables: &Tables, bytes: &[u8], buffers: &[&SymbolBuffer]) {
        let mut decoder = Decoder::new(tables, bytes).unwrap();
        for (context, value) in buffers.iter().flat_map(|buffer| buffer.iter()) {
            assert_eq!(decoder.get(context).unwrap(), value);
        }
        decoder.finish().unwrap();
    }

    #[test]
    fn streams_round_trip_with_tables_that_were_stored() {
        let mut extremes = SymbolBuffer::default();
        for value in [u64::MAX, 0, 1 << 63, u64::from(u32::MAX), 15, 16, 17, 1 << 16] {
            extremes.put(crate::codec::entropy::context::COUNT as Context - 1, value);
            extremes.put_signed(3, value as i64);
        }
        let buffers = [buffer_of(20_000, 5), extremes, buffer_of(3, 9), SymbolBuffer::default()];
        let tables = Tables::from_buffers(&buffers);
        let stored = Tables::parse(&tables.write()).unwrap();
        for group in [&buffers[..], &buffers[1..], &buffers[1..2], &buffers[2..], &buffers[3..]] {
            let group: Vec<_> = group.iter().collect();
            decode_all(&stored, &encode(&tables.codes(), group.iter().map(|buffer| buffer.iter())).unwrap(), &group);
        }
        assert!(encode(&tables.codes(), []).unwrap().is_empty());
    }

    #[test]
    fn certain_symbols_cost_nothing() {
        let mut buffer = SymbolBuffer::default();
        (0..1000).for_each(|_| buffer.put(7, 4));
        let tables = Tables::from_buffers([&buffer]);
        assert!(encode(&tables.codes(), [buffer.iter()]).unwrap().is_empty());
        assert!(tables.write().len() <= 5);
        decode_all(&tables, &[], &[&buffer]);
    }

    #[test]
    fn few_symbols_pay_tens_of_bytes_for_tables() {
        let mut next = values(3);
        let mut buffer = SymbolBuffer::default();
        (0..300).for_each(|_| {
            let r = next();
            buffer.put((r % 20) as Context, (next() % 40) >> (r >> 60).min(5));
        });
        let tables = Tables::from_buffers([&buffer]).write();
        assert!(tables.len() < 60, "{}", tables.len());
    }

    #[test]
    fn size_is_close_to_entropy() {
        let mut next = values(11);
        let mut buffer = SymbolBuffer::default();
        let count = 100_000;
        // Geometric with p = 1/2: two bits each.
        (0..count).for_each(|_| buffer.put(0, u64::from(next().trailing_zeros())));
        let tables = Tables::from_buffers([&buffer]);
        let bytes = encode(&tables.codes(), [buffer.iter()]).unwrap().len();
        assert!((bytes as f64) < 1.002 * f64::from(count) / 4.0, "{bytes}");
    }

    #[test]
    fn damaged_streams_end_in_errors_not_panics() {
        let buffer = buffer_of(400, 77);
        let tables = Tables::from_buffers([&buffer]);
        let bytes = encode(&tables.codes(), [buffer.iter()]).unwrap();
        let replay = |bytes: &[u8]| -> Result<()> {
            let mut decoder = Decoder::new(&tables, bytes)?;
            let mut same = true;
            for (context, value) in buffer.iter() {
                same &= decoder.get(context)? == value;
            }
            decoder.finish()?;
            if same { Ok(()) } else { Err(Error::format("other values")) }
        };
        replay(&bytes).unwrap();
        assert!((0..bytes.len()).all(|end| replay(&bytes[..end]).is_err()));
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(replay(&changed).is_err());
        }
    }
}
