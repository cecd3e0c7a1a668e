//! Text from files and file names, made safe to be shown.
//!
//! File names, headers and messages of decoders may contain anything: escape sequences that reprogram a terminal, or marks
//! that reverse the reading direction and so disguise a name. They are kept as they are in data, and escaped where they are
//! shown.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Escapes control characters and marks of the reading direction, line breaks included: `\u{1b}` for ESC.
///
/// ```
/// assert_eq!(ravec_jobs::escape_controls("a\u{1b}[2J\nb"), r"a\u{1b}[2J\u{a}b");
/// ```
pub fn escape_controls(text: &str) -> Cow<'_, str> {
    escape_except(text, &[])
}

/// Escapes like [`escape_controls`], but keeps the characters `kept`, such as line breaks.
pub fn escape_except<'a>(text: &'a str, kept: &[char]) -> Cow<'a, str> {
    let chosen = |c: char| is_unsafe(c) && !kept.contains(&c);
    escape_where(text, chosen, |out, c| write!(out, "{}", c.escape_unicode()))
}

/// Escapes the same characters in JSON, where they can stand in strings only: the data stay the same.
pub(crate) fn escape_json(json: &str) -> Cow<'_, str> {
    // line breaks stand between values; those in strings are escaped already
    let unsafe_in_string = |c: char| c != '\n' && is_unsafe(c);
    escape_where(json, unsafe_in_string, |out, c| {
        let mut units = [0; 2];
        c.encode_utf16(&mut units)
            .iter()
            .try_for_each(|unit| write!(out, "\\u{unit:04x}"))
    })
}

fn escape_where(
    text: &str,
    chosen: impl Fn(char) -> bool,
    escape: impl Fn(&mut String, char) -> std::fmt::Result,
) -> Cow<'_, str> {
    if !text.contains(&chosen) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if chosen(c) {
            escape(&mut out, c).expect("a string takes every write");
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

fn is_unsafe(c: char) -> bool {
    c.is_control()
        || matches!(c,
            // marks, embeddings, overrides and isolates of the reading direction
            '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
            // separators of lines and paragraphs, the byte order mark
            | '\u{2028}' | '\u{2029}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmless_text_stays_and_controls_become_visible() {
        for text in ["", "photo.jpg", "Übung 写真 🙂", "a\\b"] {
            assert!(matches!(escape_controls(text), Cow::Borrowed(same) if same == text));
        }
        assert_eq!(
            escape_controls("\u{1b}]0;owned\u{7}\u{9b}1m\r\n\u{7f}\u{202e}gpj"),
            r"\u{1b}]0;owned\u{7}\u{9b}1m\u{d}\u{a}\u{7f}\u{202e}gpj"
        );
        assert_eq!(escape_except("a\nb\tc", &['\n']), "a\nb\\u{9}c");
    }

    #[test]
    fn json_says_the_same_without_controls() {
        let names = ["\u{1b}[31m", "\u{9b}", "\u{7f}\u{202e}", "a\nb", "写真 🙂"];
        let json = serde_json::to_string_pretty(&names).unwrap();
        let safe = escape_json(&json);
        assert!(safe.chars().all(|c| c == '\n' || !is_unsafe(c)), "{safe}");
        assert!(safe.contains("写真 🙂"));
        let again: Vec<String> = serde_json::from_str(&safe).unwrap();
        assert_eq!(again, names);
    }
}
