//! How messages write numbers and paths.

use std::path::Path;

/// A count with thousands separators.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A path as it can be typed in a shell.
pub fn shell(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%~".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text,
        false => shell_quoted(&text),
    }
}

/// A text in single quotes, which a shell takes as one word.
pub fn shell_quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_can_be_pasted_into_a_shell() {
        let of = |text: &str| shell(Path::new(text));
        assert_eq!(of("a/b-1.ply"), "a/b-1.ply");
        assert_eq!(of("my job"), "'my job'");
        assert_eq!(of("it's"), "'it'\\''s'");
    }
}
