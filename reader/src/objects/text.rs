//! Short texts, letter by letter: six contexts each foresee the next bit, and a mixture of them learns whom to trust,
//! as in the compressors of M. Mahoney.

use super::{MOST_BYTES, bits::Bits};
use crate::{
    codec::texels::binary::Estimate,
    error::{Error, Result},
};

/// Contexts of a bit.
const CONTEXTS: usize = 6;
/// Logarithm of the number of slots.
const SLOTS_LOG2: u32 = 18;
/// A slot learns no slower than after this many bits.
const MOST_SEEN: u16 = 60;
/// Ends a text: no UTF-8 has it.
const END: u8 = 0xff;
/// Letters that match the reference, up to this many, choose the weights.
const MOST_MATCHING: u32 = 7;
/// The probability in 1/4096 at each 128th place of the logistic curve.
const CURVE: [i32; 33] = [
    1, 2, 3, 6, 10, 16, 27, 45, 73, 120, 194, 310, 488, 747, 1101, 1546, 2047, 2549, 2994, 3348, 3607, 3785, 3901,
    3975, 4022, 4050, 4068, 4079, 4085, 4089, 4092, 4093, 4094,
];

/// What has been learned from the texts of a page.
pub(super) struct Texts {
    /// Probability of a one in 1/65536, and bits seen, of each slot.
    slots: Vec<[u16; 2]>,
    weights: Vec<[i64; CONTEXTS]>,
    stretched: Vec<i16>,
}

/// What foresees one bit.
struct Mixed<'t> {
    texts: &'t mut Texts,
    slots: [usize; CONTEXTS],
    inputs: [i64; CONTEXTS],
    set: usize,
    one: i64,
}

/// What lies before the next letter.
struct Before<'r> {
    reference: &'r [u8],
    /// The letter of the reference that is expected.
    at: usize,
    matching: u32,
    has_missed: bool,
    /// The last four letters, the last one lowest.
    letters: u32,
    /// Those since the last separator, hashed.
    word: u32,
    count: u32,
}

impl Default for Texts {
    fn default() -> Self {
        let mut stretched = vec![2047; 4096];
        let mut next = 0;
        for x in -2047..2048_i16 {
            let end = squash(i64::from(x)) as usize + 1;
            (next..end).for_each(|place| stretched[place] = x);
            next = next.max(end);
        }
        Self {
            slots: vec![[1 << 15, 0]; 1 << SLOTS_LOG2],
            weights: vec![[22937; CONTEXTS]; 4 * (MOST_MATCHING as usize + 1)],
            stretched,
        }
    }
}

impl Texts {
    /// Codes a text; `field` tells names from ids, and `reference` is a text that is probably similar.
    pub(super) fn code(&mut self, bits: &mut impl Bits, field: u32, reference: &[u8], text: &[u8]) -> Result<Vec<u8>> {
        let mut before = Before { reference, at: 0, matching: 0, has_missed: false, letters: 0, word: 0, count: 0 };
        let mut coded = Vec::new();
        loop {
            let letter = self.letter(bits, field, &before, text.get(coded.len()).copied().unwrap_or(END));
            bits.check()?;
            if letter == END {
                return Ok(coded);
            }
            coded.push(letter);
            if coded.len() > MOST_BYTES {
                return Err(Error::format("a name or an id has more than 4096 bytes"));
            }
            before.push(letter);
        }
    }

    fn letter(&mut self, bits: &mut impl Bits, field: u32, before: &Before<'_>, letter: u8) -> u8 {
        let expected = before.expected();
        let values = before.values(expected);
        let mut node = 1_u32;
        for shift in (0..8).rev() {
            let is_expected = (u32::from(expected) | 256) >> (shift + 1) == node;
            let set = (2 * field + u32::from(is_expected)) * (MOST_MATCHING + 1) + before.matching;
            let slots = std::array::from_fn(|k| slot(k as u32, field, values[k], node));
            let mut mixed = Mixed::new(self, slots, set as usize);
            let bit = bits.bit(&mut mixed, letter >> shift & 1 == 1);
            node = 2 * node + u32::from(bit);
        }
        node as u8
    }
}

impl<'t> Mixed<'t> {
    fn new(texts: &'t mut Texts, slots: [usize; CONTEXTS], set: usize) -> Self {
        let inputs = slots.map(|slot| i64::from(texts.stretched[usize::from(texts.slots[slot][0] >> 4)]));
        let sum: i64 = inputs.iter().zip(&texts.weights[set]).map(|(input, weight)| input * weight).sum();
        let one = squash(sum >> 16).clamp(4, 4091);
        Self { texts, slots, inputs, set, one }
    }
}

impl Estimate for Mixed<'_> {
    fn of_zero(&self) -> u32 {
        4096 - self.one as u32
    }

    fn learn(&mut self, bit: bool) {
        let error = ((i64::from(bit) << 12) - self.one) * 6;
        for (weight, input) in self.texts.weights[self.set].iter_mut().zip(self.inputs) {
            *weight += (input * error + 512) >> 10;
        }
        for slot in self.slots {
            let [one, seen] = &mut self.texts.slots[slot];
            let goal = if bit { 65535 } else { 0 };
            let step = 655_360 / (10 * i64::from(*seen) + 16);
            *one = (i64::from(*one) + (((goal - i64::from(*one)) * step) >> 16)) as u16;
            *seen = (*seen + 1).min(MOST_SEEN);
        }
    }
}

impl Before<'_> {
    fn expected(&self) -> u8 {
        self.reference.get(self.at).copied().unwrap_or(END)
    }

    /// What each context sees.
    fn values(&self, expected: u8) -> [u32; CONTEXTS] {
        let matched = u32::from(expected) | self.matching << 8 | u32::from(self.has_missed) << 11;
        [self.count.min(31), self.letters & 0xff, self.letters & 0xffff, self.letters, matched, self.word]
    }

    fn push(&mut self, letter: u8) {
        let is_separator = matches!(letter, b'-' | b'/' | b'_' | b'.' | b' ' | b':');
        if letter == self.expected() {
            self.matching = (self.matching + 1).min(MOST_MATCHING);
            self.at += 1;
        } else {
            // At a separator the reference is taken up again behind its next one of that kind.
            let rest = self.reference.get(self.at..).unwrap_or_default();
            let found = rest.iter().position(|&other| is_separator && other == letter);
            self.at += found.unwrap_or(0) + 1;
            (self.matching, self.has_missed) = (0, true);
        }
        self.letters = self.letters << 8 | u32::from(letter);
        self.word = if is_separator { 0 } else { self.word.wrapping_mul(271).wrapping_add(letter.into()) };
        self.count += 1;
    }
}

/// Where a context keeps what it has seen at a node of the tree of letters.
fn slot(context: u32, field: u32, value: u32, node: u32) -> usize {
    let key = value.wrapping_mul(12).wrapping_add(2 * context + field).wrapping_mul(0x9e37_79b1);
    ((key ^ key >> 15).wrapping_add(node).wrapping_mul(0x85eb_ca6b) >> (32 - SLOTS_LOG2)) as usize
}

/// The logistic curve: a probability in 1/4096.
fn squash(x: i64) -> i64 {
    let x = x.clamp(-2047, 2047);
    let (place, rest) = (((x >> 7) + 16) as usize, x & 127);
    let at = |place: usize| i64::from(CURVE[place.min(32)]);
    (at(place) * (128 - rest) + at(place + 1) * rest + 64) >> 7
}
