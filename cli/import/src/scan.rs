//! Reads numbers and words from byte text, fast and correctly rounded.

/// Powers of ten that f64 represents exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// A cursor over text. Words are runs of bytes greater than the space; every other byte separates them.
#[derive(Clone)]
pub(super) struct Scanner<'a> {
    pub(super) bytes: &'a [u8],
    /// Byte offset of the cursor.
    pub(super) at: usize,
}

impl<'a> Scanner<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    /// Moves to the next word, across line ends.
    #[inline]
    pub(super) fn skip_space(&mut self) {
        while self.bytes.get(self.at).is_some_and(|&b| b <= b' ') {
            self.at += 1;
        }
    }

    /// The next word; empty at the end of the text.
    #[inline]
    pub(super) fn word(&mut self) -> &'a [u8] {
        self.skip_space();
        let start = self.at;
        while self.bytes.get(self.at).is_some_and(|&b| b > b' ') {
            self.at += 1;
        }
        &self.bytes[start..self.at]
    }

    /// The next word as a number. `Err` holds a word that is not one (empty at the end of the text).
    #[inline]
    pub(super) fn float(&mut self) -> Result<f64, &'a [u8]> {
        self.skip_space();
        if let Some((value, length)) = scan_simple_float(&self.bytes[self.at..]) {
            self.at += length;
            return Ok(value);
        }
        let word = self.word();
        parse_float(word).ok_or(word)
    }

    /// The next word as an integer. `Err` holds a word that is not one (empty at the end of the text).
    #[inline]
    pub(super) fn integer(&mut self) -> Result<i64, &'a [u8]> {
        self.skip_space();
        let (mut value, mut at) = (0i64, self.at);
        while let Some(digit) = self.bytes.get(at).map(|b| b.wrapping_sub(b'0')).filter(|&d| d < 10) {
            value = value * 10 + i64::from(digit);
            at += 1;
            if at - self.at == 18 {
                break;
            }
        }
        if at > self.at && self.bytes.get(at).is_none_or(|&b| b <= b' ') {
            self.at = at;
            return Ok(value);
        }
        // Signs, and integers that some writers print as "3.0".
        let word = self.word();
        match parse_float(word) {
            Some(value) if value.fract() == 0.0 && value.abs() < 9e15 => Ok(value as i64),
            _ => Err(word),
        }
    }

    /// If only blanks remain on this line, moves to the next line and returns true.
    #[inline]
    pub(super) fn end_of_line(&mut self) -> bool {
        while let Some(&b) = self.bytes.get(self.at) {
            match b {
                b'\n' => {
                    self.at += 1;
                    return true;
                }
                b'\r' => {
                    self.at += 1 + usize::from(self.bytes.get(self.at + 1) == Some(&b'\n'));
                    return true;
                }
                b if b <= b' ' => self.at += 1,
                _ => return false,
            }
        }
        true
    }
}

/// What is said about a number whose fraction begins with a comma.
pub(super) const COMMA: &str =
    "numbers need a point, not a comma, before their fraction; export the file again with points";

/// Whether a word would be a number if its comma were a point.
pub(super) fn has_decimal_comma(word: &[u8]) -> bool {
    let is_comma = |byte: &u8| *byte == b',';
    let pointed: Vec<u8> = word.iter().map(|byte| if is_comma(byte) { b'.' } else { *byte }).collect();
    word.iter().filter(|byte| is_comma(byte)).count() == 1 && parse_float(&pointed).is_some()
}

/// Any decimal number that Rust parses, "nan" and "inf" included.
pub(super) fn parse_float(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// A number of at most 19 digits whose value is exactly (integer below 2^53) times or divided by a power of ten up to
/// 10^22: a single rounding gives the nearest f64 (Clinger, "How to Read Floating Point Numbers Accurately", 1990, fast
/// path). `None` for any other number, and for one that does not end at a separator.
#[inline]
fn scan_simple_float(bytes: &[u8]) -> Option<(f64, usize)> {
    let mut at = 0;
    let negative = match bytes.first()? {
        b'-' => {
            at = 1;
            true
        }
        b'+' => {
            at = 1;
            false
        }
        _ => false,
    };
    let digit = |at: usize| bytes.get(at).map(|b| b.wrapping_sub(b'0')).filter(|&d| d < 10);
    let (first, mut mantissa, mut exponent) = (at, 0u64, 0i32);
    while let Some(d) = digit(at) {
        mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(d));
        at += 1;
    }
    let mut digit_count = at - first;
    if bytes.get(at) == Some(&b'.') {
        let fraction = at + 1;
        at = fraction;
        while let Some(d) = digit(at) {
            mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(d));
            at += 1;
        }
        digit_count += at - fraction;
        exponent = -((at - fraction).min(100) as i32);
    }
    if digit_count == 0 || digit_count > 19 || mantissa > 1 << 53 {
        return None;
    }
    if matches!(bytes.get(at), Some(b'e' | b'E')) {
        let minus = bytes.get(at + 1) == Some(&b'-');
        at += 1 + usize::from(matches!(bytes.get(at + 1), Some(b'-' | b'+')));
        let start = at;
        let mut power = 0i32;
        while let Some(d) = digit(at) {
            power = power * 10 + i32::from(d);
            at += 1;
            if at - start > 4 {
                return None;
            }
        }
        if at == start {
            return None;
        }
        exponent += if minus { -power } else { power };
    }
    if bytes.get(at).is_some_and(|&b| b > b' ') || exponent.unsigned_abs() > 22 {
        return None;
    }
    let power = POWERS[exponent.unsigned_abs() as usize];
    let value = if exponent < 0 { mantissa as f64 / power } else { mantissa as f64 * power };
    Some((if negative { -value } else { value }, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_agree_with_the_standard_library_bit_for_bit() {
        let mut state = 0x9E37_79B9_7F4A_7C15u64;
        for i in 0..20_000 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let value = f64::from_bits(state);
            let small = (state >> 11) as f64 / 1e9 - 4e6;
            for text in
                [format!("{value:e}"), format!("{small:.3}"), format!("{}", small as f32), format!("{i}E-{}", i % 30)]
            {
                let expected: f64 = text.parse().unwrap();
                let got = Scanner::new(text.as_bytes(), 0).float();
                assert!(got.is_ok_and(|g| g.to_bits() == expected.to_bits() || expected.is_nan()), "{text}");
            }
        }
        for text in
            ["-0", "+1.", ".5", "1e", "-", ".", "1e+", "1_0", "0x1", "--1", "nan", "-inf", "00000000000000000000001.5"]
        {
            let got = Scanner::new(text.as_bytes(), 0).float().ok().map(f64::to_bits);
            assert_eq!(got, text.parse::<f64>().ok().map(f64::to_bits), "{text}");
        }
    }

    #[test]
    fn integers_may_have_signs_or_be_whole_floats() {
        let scan = |text: &'static str| Scanner::new(text.as_bytes(), 0).integer().ok();
        assert_eq!(scan(" 17 "), Some(17));
        assert_eq!(scan("-3"), Some(-3));
        assert_eq!(scan("3.0"), Some(3));
        assert_eq!(scan("1000000000000000000"), None);
        assert_eq!(scan("99999999999999999999999999"), None);
        assert_eq!(scan("3.5"), None);
        assert_eq!(scan("x"), None);
        assert_eq!(scan(""), None);
    }
}
