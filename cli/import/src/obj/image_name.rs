//! How a library names an image: options, each with its values, and behind them the name, which may contain spaces.

use crate::scan::{Scanner, parse_float};
use lodpack_mesh::appearance::Wrap;

/// An image as a library names it.
pub(super) struct NamedImage<'a> {
    pub name: &'a [u8],
    pub offset: [f32; 2],
    pub scale: [f32; 2],
    pub wrap: Wrap,
    /// What slopes are multiplied by: `-bm`.
    pub multiplier: f32,
    /// Options that are not known.
    pub unknown: Vec<&'a [u8]>,
}

/// The most values of an option that is not known.
const MOST_VALUES: usize = 4;

impl<'a> NamedImage<'a> {
    /// Reads what stands behind a keyword. `is_there` says whether there is a file of a name.
    pub fn new(text: &'a [u8], is_there: &dyn Fn(&[u8]) -> bool) -> Self {
        let mut image =
            Self { name: &[], offset: [0.0; 2], scale: [1.0; 2], wrap: Wrap::Repeat, multiplier: 1.0, unknown: vec![] };
        let mut words = Scanner::new(text, 0);
        loop {
            words.skip_space();
            image.name = text[words.at..].trim_ascii();
            if !image.name.starts_with(b"-") || !image.read_option(&mut words, is_there) {
                return image;
            }
        }
    }

    /// Reads an option with its values; false where a file of such a name begins.
    fn read_option(&mut self, words: &mut Scanner<'a>, is_there: &dyn Fn(&[u8]) -> bool) -> bool {
        let number = |word: &[u8]| parse_float(word).map(|value| value as f32).filter(|value| value.is_finite());
        let option = words.word();
        match option {
            // One to three numbers.
            b"-o" | b"-s" | b"-t" => {
                let mut values = vec![];
                while values.len() < 3 {
                    let mut ahead = words.clone();
                    let Some(value) = number(ahead.word()) else { break };
                    values.push(value);
                    *words = ahead;
                }
                let target = if option == b"-o" { &mut self.offset } else { &mut self.scale };
                if option != b"-t" {
                    target.iter_mut().zip(values).for_each(|(target, value)| *target = value);
                }
            }
            b"-mm" => {
                words.word();
                words.word();
            }
            b"-clamp" => self.wrap = if words.word() == b"on" { Wrap::Clamp } else { Wrap::Repeat },
            b"-bm" => self.multiplier = number(words.word()).unwrap_or(1.0),
            b"-blendu" | b"-blendv" | b"-boost" | b"-cc" | b"-imfchan" | b"-texres" | b"-type" => {
                words.word();
            }
            // A file whose name begins with a hyphen.
            _ if is_there(self.name) => return false,
            _ => {
                let Some(values) = count_values(words.clone(), is_there) else { return false };
                self.unknown.push(option);
                for _ in 0..values {
                    words.word();
                }
            }
        }
        true
    }
}

/// How many values an option has that is not known: as many as stand before the name of a file that is there, or before
/// the next option. None if nothing follows that could be a name.
fn count_values(words: Scanner, is_there: &dyn Fn(&[u8]) -> bool) -> Option<usize> {
    let behind = |count: usize| {
        let mut words = words.clone();
        for _ in 0..count {
            words.word();
        }
        words.bytes[words.at..].trim_ascii()
    };
    if behind(0).is_empty() {
        return None;
    }
    let is_end = |rest: &[u8]| {
        let begins_option = matches!(rest, [b'-', letter, ..] if letter.is_ascii_alphabetic());
        !rest.is_empty() && (begins_option || is_there(rest))
    };
    let known = (0..=MOST_VALUES).find(|&count| is_end(behind(count)));
    // One is the most likely number of them.
    Some(known.unwrap_or(usize::from(!behind(1).is_empty())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_that_are_not_known_are_skipped_with_their_values() {
        for (text, name, unknown) in [
            ("-colorspace sRGB -s 1 1 1 q.png", "q.png", 1),
            ("-colorspace sRGB q.png", "q.png", 1),
            ("-srgb q.png", "q.png", 1),
            ("-uvset 1 2 3 my wood.png", "my wood.png", 1),
            ("-a -b 2 -clamp on q.png", "q.png", 2),
            // What is not there is the rest behind one value.
            ("-colorspace raw none 1.png", "none 1.png", 1),
            ("-srgb none.png", "none.png", 1),
            // Names of files.
            ("-q.png", "-q.png", 0),
            ("-none.png", "-none.png", 0),
            ("- q.png", "- q.png", 0),
        ] {
            let is_there = |name: &[u8]| [&b"q.png"[..], b"my wood.png", b"-q.png", b"- q.png"].contains(&name);
            let image = NamedImage::new(text.as_bytes(), &is_there);
            let found = std::str::from_utf8(image.name).unwrap();
            assert_eq!((found, image.unknown.len()), (name, unknown), "{text}");
        }
    }

    #[test]
    fn known_options_count_behind_unknown_ones() {
        let image = NamedImage::new(b"-x 7 -o 0.5 -s 2 3 -bm 4 -clamp on a b.png", &|_| false);
        assert_eq!((image.offset, image.scale, image.multiplier), ([0.5, 0.0], [2.0, 3.0], 4.0));
        assert_eq!((image.wrap, image.name), (Wrap::Clamp, &b"a b.png"[..]));
    }
}
