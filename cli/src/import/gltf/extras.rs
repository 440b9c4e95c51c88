//! `extras`: what programs keep in a document for themselves, of any type (glTF 2.0, section 3.5).
//!
//! The `gltf` crate reads them as objects, or, with its feature `extras`, as raw JSON, which `serde` cannot read within extensions. Nothing
//! here needs them, so they are taken out of the text.

use std::borrow::Cow;

/// The text with an empty object for the value of every key `extras`. Lines stay where they are, and what is no JSON is no JSON then.
pub(super) fn without_extras(json: &[u8]) -> Cow<'_, [u8]> {
    let (mut text, mut copied, mut at) = (vec![], 0, 0);
    while at < json.len() {
        if json[at] != b'"' {
            at += 1;
            continue;
        }
        let end = end_of_string(json, at);
        let is_key = &json[at..end] == b"\"extras\"";
        at = end;
        if let Some(value) = start_of_value(json, end).filter(|_| is_key) {
            at = end_of_value(json, value);
            text.extend_from_slice(&json[copied..value]);
            text.extend_from_slice(b"{}");
            text.extend(json[value..at].iter().filter(|&&byte| byte == b'\n'));
            copied = at;
        }
    }
    if copied == 0 {
        return json.into();
    }
    text.extend_from_slice(&json[copied..]);
    text.into()
}

/// Where the value of a key begins that ends at a place; none if it is no key, or has no value.
fn start_of_value(json: &[u8], end: usize) -> Option<usize> {
    let past_space = |at: usize| Some(at + json.get(at..)?.iter().position(|byte| !byte.is_ascii_whitespace())?);
    let colon = past_space(end).filter(|&at| json[at] == b':')?;
    past_space(colon + 1).filter(|&at| !matches!(json[at], b',' | b'}' | b']'))
}

/// The place behind a string that begins at a place.
fn end_of_string(json: &[u8], start: usize) -> usize {
    let mut at = start + 1;
    while at < json.len() {
        match json[at] {
            b'"' => return at + 1,
            b'\\' => at += 2,
            _ => at += 1,
        }
    }
    json.len()
}

/// The place behind a value that begins at a place. A list of open brackets is not needed, because what they hold is not read.
fn end_of_value(json: &[u8], start: usize) -> usize {
    let (mut at, mut depth) = (start, 0u64);
    while at < json.len() {
        match json[at] {
            b'"' => {
                at = end_of_string(json, at);
                if depth == 0 {
                    return at;
                }
                continue;
            }
            b'{' | b'[' => depth += 1,
            b'}' | b']' if depth == 0 => return at,
            b'}' | b']' if depth == 1 => return at + 1,
            b'}' | b']' => depth -= 1,
            b',' if depth == 0 => return at,
            byte if depth == 0 && byte.is_ascii_whitespace() => return at,
            _ => {}
        }
        at += 1;
    }
    json.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_any_type_become_empty_objects() {
        for value in ["null", "3", "-1.5e3", "true", "\"a\\\"}\"", "{}", "[1, {\"b\": [\"]\"]}]", "{\"extras\": [2]}"] {
            for (start, end) in [("{\"extras\":", ",\"a\":1}"), ("{\"a\":{ \"extras\" : ", " }, \"b\":\"extras\"}")] {
                let text = format!("{start}{value}{end}");
                let expected = format!("{start}{{}}{end}");
                assert_eq!(String::from_utf8_lossy(&without_extras(text.as_bytes())), expected);
            }
        }
    }

    #[test]
    fn lines_stay_and_nothing_else_is_changed() {
        let text = without_extras(b"{\"extras\": [\n1,\n2], \"a\": \"\\\"extras\\\": 1\"\n}");
        assert_eq!(String::from_utf8_lossy(&text), "{\"extras\": {}\n\n, \"a\": \"\\\"extras\\\": 1\"\n}");
        for text in ["", "{", "{\"a\": [\"extras\", 1]}", "{\"extras\"", "{\"extras\":", "{\"extras\":}", "\"\\"] {
            assert!(
                matches!(without_extras(text.as_bytes()), Cow::Borrowed(same) if same == text.as_bytes()),
                "{text}"
            );
        }
        assert_eq!(*without_extras(b"{\"extras\": {\"a\": ["), *b"{\"extras\": {}");
    }
}
