//! The header field `Range` (RFC 9110, chapter 14).

use std::ops::Range;

/// What a request wants of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of it: nothing else is asked for, or something that a server may ignore, such as several ranges.
    Whole,
    /// A range that is not empty.
    Range(Range<u64>),
    /// Nothing: the range begins behind the end.
    Beyond,
}

/// The part that a value of `Range` asks for, of a file of `size` bytes.
pub fn part(value: Option<&str>, size: u64) -> Part {
    let Some((unit, ranges)) = value.and_then(|value| value.split_once('=')) else { return Part::Whole };
    let Some((first, last)) = ranges.trim().split_once('-') else { return Part::Whole };
    let is_number = |text: &str| text.is_empty() || text.bytes().all(|digit| digit.is_ascii_digit());
    if !unit.trim().eq_ignore_ascii_case("bytes") || !is_number(first) || !is_number(last) {
        return Part::Whole;
    }
    // A number that is too large is larger than any file.
    let number = |text: &str| text.parse::<u64>().unwrap_or(u64::MAX);
    let range = match (first, last) {
        ("", "") => return Part::Whole,
        ("", length) => size.saturating_sub(number(length))..size,
        (first, "") => number(first)..size,
        (first, last) if number(first) > number(last) => return Part::Whole,
        (first, last) => number(first)..number(last).saturating_add(1).min(size),
    };
    if range.is_empty() { Part::Beyond } else { Part::Range(range) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_cut_at_the_end_and_nonsense_asks_for_everything() {
        for (value, expected) in [
            ("bytes=0-9", Part::Range(0..10)),
            ("Bytes = 0-9", Part::Range(0..10)),
            ("bytes=90-1000", Part::Range(90..100)),
            ("bytes=90-99999999999999999999999", Part::Range(90..100)),
            ("bytes=99-", Part::Range(99..100)),
            ("bytes=-1", Part::Range(99..100)),
            ("bytes=-1000", Part::Range(0..100)),
            ("bytes=100-", Part::Beyond),
            ("bytes=100-200", Part::Beyond),
            ("bytes=-0", Part::Beyond),
            ("bytes=9-0", Part::Whole),
            ("bytes=0-1,4-5", Part::Whole),
            ("bytes=-", Part::Whole),
            ("bytes=+1-2", Part::Whole),
            ("lines=0-9", Part::Whole),
            ("bytes", Part::Whole),
        ] {
            assert_eq!(part(Some(value), 100), expected, "{value}");
        }
        assert_eq!(part(None, 100), Part::Whole);
        assert_eq!(part(Some("bytes=0-0"), 0), Part::Beyond);
    }
}
