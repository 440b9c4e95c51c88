//! How messages write numbers, paths, and what files say.

use std::borrow::Cow;
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

/// A text without characters that a terminal takes as commands, or that turn the direction of what follows: each
/// becomes `\u` and four digits, as in JSON, where such a text means the same. Line ends and tabs stay.
pub fn plain(text: &str) -> Cow<'_, str> {
    match text.chars().any(is_command) {
        false => Cow::Borrowed(text),
        true => Cow::Owned(text.chars().fold(String::with_capacity(text.len()), |mut plain, c| {
            match is_command(c) {
                true => plain += &format!("\\u{:04x}", u32::from(c)),
                false => plain.push(c),
            }
            plain
        })),
    }
}

/// [`plain`] in one line of at most so many characters; what is left out is counted.
pub fn line(text: &str, most: usize) -> String {
    let text = text.replace(['\n', '\r', '\t'], " ");
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}... ({} more characters)", plain(&text[..end]), text[end..].chars().count()),
        None => plain(&text).into_owned(),
    }
}

/// A name that a file says, in quotes and no longer than a name needs to be.
pub fn name(text: &str) -> String {
    format!("\"{}\"", line(text, 80).replace('"', "'"))
}

fn is_command(c: char) -> bool {
    let turns = ['\u{61c}', '\u{200e}', '\u{200f}', '\u{2028}', '\u{2029}', '\u{feff}'];
    c.is_control() && c != '\n' && c != '\t'
        || ('\u{202a}'..='\u{202e}').contains(&c)
        || ('\u{2066}'..='\u{2069}').contains(&c)
        || turns.contains(&c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_file_says_commands_a_terminal() {
        assert_eq!(plain("a b\n\tc"), "a b\n\tc");
        assert_eq!(
            plain("\u{1b}[31mred\u{9b}2J\r\u{202e}gpj.exe\u{7}"),
            "\\u001b[31mred\\u009b2J\\u000d\\u202egpj.exe\\u0007"
        );
        assert_eq!(line("a\nerror: b", 80), "a error: b");
        assert_eq!(line("äöü".repeat(10).as_str(), 3), "äöü... (27 more characters)");
        assert_eq!(name("my \"wood\"\u{1b}"), "\"my 'wood'\\u001b\"");
        assert!(name(&"x".repeat(100_000)).len() < 120);
    }

    #[test]
    fn paths_can_be_pasted_into_a_shell() {
        let of = |text: &str| shell(Path::new(text));
        assert_eq!(of("a/b-1.ply"), "a/b-1.ply");
        assert_eq!(of("my job"), "'my job'");
        assert_eq!(of("it's"), "'it'\\''s'");
    }
}
