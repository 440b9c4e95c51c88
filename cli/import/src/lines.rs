//! Lines of a text in ranges of its bytes: a line belongs to the range in which it begins.

use std::ops::Range;

/// Offset of the first line that begins at an offset or after it; the length of the text where none does.
pub(super) fn first_line_from(text: &[u8], at: usize) -> usize {
    let begins = |at: usize| match at.checked_sub(1).map(|before| text[before]) {
        None | Some(b'\n') => true,
        Some(b'\r') => text[at] != b'\n',
        Some(_) => false,
    };
    (at..text.len()).find(|&at| begins(at)).unwrap_or(text.len())
}

/// Whether the line before one that begins at an offset ends in a backslash, so that both are one.
pub(super) fn is_continued(text: &[u8], at: usize) -> bool {
    let before = &text[..at];
    let before = before.strip_suffix(b"\n").unwrap_or(before);
    let before = before.strip_suffix(b"\r").unwrap_or(before);
    let last = before.iter().rev().find(|&&byte| !byte.is_ascii_whitespace() || byte == b'\n' || byte == b'\r');
    last == Some(&b'\\')
}

/// The lines that begin in a range, each with its offset and without its end. Those of blanks alone are left out.
pub(super) fn lines_within(text: &[u8], range: Range<usize>) -> impl Iterator<Item = (usize, &[u8])> {
    let mut at = first_line_from(text, range.start);
    std::iter::from_fn(move || {
        while at < range.end.min(text.len()) {
            let (start, rest) = (at, &text[at..]);
            let length = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r').unwrap_or(rest.len());
            at += length + 1;
            if rest[..length].iter().any(|&byte| byte > b' ') {
                return Some((start, &rest[..length]));
            }
        }
        None
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_division_has_every_line_once() {
        for text in [&b"one\ntwo\r\n\r\n  \nthree\rfour\r\r\nfive"[..], b"\n\n", b"", b"a", b"a\r", b"\r\nb\n"] {
            let all: Vec<_> = lines_within(text, 0..text.len()).collect();
            let words = text.split(|&byte| byte == b'\n' || byte == b'\r');
            let words: Vec<&[u8]> = words.filter(|word| !word.trim_ascii().is_empty()).collect();
            assert_eq!(all.iter().map(|(_, line)| *line).collect::<Vec<_>>(), words);
            for first in 0..=text.len() {
                for second in first..=text.len() {
                    let ranges = [0..first, first..second, second..text.len()];
                    let divided: Vec<_> = ranges.into_iter().flat_map(|range| lines_within(text, range)).collect();
                    assert_eq!(divided, all, "{first} {second}");
                }
            }
        }
    }

    #[test]
    fn a_backslash_joins_a_line_with_the_next() {
        for (text, expected) in [("f 1 \\\n2", true), ("f 1 \\ \t\r\n2", true), ("f 1\n2", false), ("\\\n\n2", false)] {
            assert_eq!(is_continued(text.as_bytes(), text.len() - 1), expected, "{text:?}");
        }
        assert!(!is_continued(b"2", 0));
    }
}
