//! The bits of a scan, and the Huffman codes in them (ITU T.81, annexes C and F.2.2).

/// What is wrong where bits are missing.
pub(super) const SHORT: &str = "its data end too early";
/// What is wrong where other bytes stand in place of its own.
pub(super) const BROKEN: &str = "some of its data are overwritten";

/// Codes of so many bits are found at once. Nearly all codes are that short.
const FAST_BITS: u32 = 9;

/// The codes of a table, which are numbered by length.
pub(super) struct Table {
    /// By the bits that come next: the length of the code, and its symbol. The length of longer codes is 0.
    fast: Vec<[u8; 2]>,
    /// By length: the first code that is too large for it, with zeros behind it up to 16 bits.
    ends: [u32; 17],
    /// By length: what is added to a code for the place of its symbol.
    places: [i32; 17],
    symbols: Vec<u8>,
}

impl Table {
    /// `None` if there are more codes than fit.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut this =
            Self { fast: vec![[0; 2]; 1 << FAST_BITS], ends: [0; 17], places: [0; 17], symbols: symbols.to_vec() };
        let (mut code, mut place) = (0u32, 0);
        for length in 1..=16u32 {
            let at = length as usize;
            this.places[at] = place as i32 - code as i32;
            for _ in 0..counts[at - 1] {
                if length <= FAST_BITS {
                    let free = FAST_BITS - length;
                    let range = (code << free) as usize..((code + 1) << free) as usize;
                    this.fast.get_mut(range)?.fill([length as u8, *symbols.get(place)?]);
                }
                (code, place) = (code + 1, place + 1);
            }
            if code > 1 << length {
                return None;
            }
            this.ends[at] = code << (16 - length);
            code <<= 1;
        }
        Some(this)
    }
}

/// The bits from a place on, up to the next marker.
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    /// What is read next; the marker once there are no more bits.
    at: usize,
    /// Bits that are read but not used, from the highest one on, with zeros behind them.
    word: u64,
    count: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at, word: 0, count: 0 }
    }

    /// Where it is, without the bits that are read but not used.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// The next byte; none at a marker.
    #[inline]
    fn next_byte(&mut self) -> Option<u8> {
        let byte = *self.bytes.get(self.at)?;
        if byte == 0xFF {
            // A byte that looks like the beginning of a marker has a zero behind it.
            if self.bytes.get(self.at + 1) != Some(&0) {
                return None;
            }
            self.at += 1;
        }
        self.at += 1;
        Some(byte)
    }

    #[inline]
    fn fill(&mut self) {
        while self.count <= 56 {
            let Some(byte) = self.next_byte() else { break };
            self.word |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// Uses bits up, at most 32.
    #[inline]
    pub(super) fn skip(&mut self, count: u32) -> Result<(), &'static str> {
        if self.count < count {
            self.fill();
            if self.count < count {
                return Err(SHORT);
            }
        }
        self.word <<= count;
        self.count -= count;
        Ok(())
    }

    /// The number that bits say, at most 16 of them.
    pub(super) fn take(&mut self, count: u32) -> Result<u32, &'static str> {
        self.fill();
        let number = (self.word >> 32 >> (32 - count)) as u32;
        self.skip(count)?;
        Ok(number)
    }

    /// The symbol of the next code.
    #[inline]
    pub(super) fn symbol(&mut self, table: &Table) -> Result<u8, &'static str> {
        if self.count < 16 {
            self.fill();
        }
        let [length, symbol] = table.fast[(self.word >> (64 - FAST_BITS)) as usize];
        if length > 0 {
            self.skip(u32::from(length))?;
            return Ok(symbol);
        }
        let next = (self.word >> 48) as u32;
        let Some(length) = (FAST_BITS as usize + 1..=16).find(|&length| next < table.ends[length]) else {
            return Err(if self.count < 16 { SHORT } else { BROKEN });
        };
        self.skip(length as u32)?;
        let place = (next >> (16 - length)) as i32 + table.places[length];
        table.symbols.get(place as usize).copied().ok_or(BROKEN)
    }

    /// Goes to the next marker, and says how many bytes were left.
    pub(super) fn leave_interval(&mut self) -> usize {
        let mut left = (self.count / 8) as usize;
        (self.word, self.count) = (0, 0);
        while self.next_byte().is_some() {
            left += 1;
        }
        left
    }

    /// The same, and returns the place of the marker.
    pub(super) fn leave_interval_at(mut self) -> usize {
        self.leave_interval();
        self.at
    }

    /// Passes a restart marker, before which any number of bytes 0xFF may be.
    pub(super) fn pass_restart(&mut self) -> Result<(), &'static str> {
        while self.bytes.get(self.at..self.at + 2) == Some(&[0xFF; 2]) {
            self.at += 1;
        }
        match self.bytes.get(self.at + 1) {
            Some(0xD0..=0xD7) => {
                self.at += 2;
                Ok(())
            }
            Some(0xD9) | None => Err(SHORT),
            Some(_) => Err(BROKEN),
        }
    }
}
