//! Numbers and words in text.

/// The number that `word` spells, in the notation of any of the formats. May be infinite or not a number.
#[inline]
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The first three numbers of `words`.
#[inline]
pub(super) fn three<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Option<[f64; 3]> {
    let mut next = || number(words.next()?);
    Some([next()?, next()?, next()?])
}

/// The whole number that `word` spells.
#[inline]
pub(super) fn integer(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] | digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    let mut value = 0;
    for &digit in digits {
        let digit = digit.wrapping_sub(b'0');
        if digit > 9 {
            return None;
        }
        value = value * 10 + i64::from(digit);
    }
    Some(if negative { -value } else { value })
}

/// The words of a line.
#[inline]
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    line.split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
}

/// The most characters of a file that a message quotes.
const MAX_SHOWN: usize = 80;

/// `word` as it can be shown in a message: at most 80 characters, control characters and those that change the direction of
/// text escaped.
pub(super) fn shown(word: &[u8]) -> String {
    // a character has at most four bytes
    let text = String::from_utf8_lossy(&word[..word.len().min(4 * MAX_SHOWN + 4)]);
    let mut short = String::new();
    let mut room = MAX_SHOWN;
    for c in text.chars() {
        let directs = matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        let escaped = (c.is_control() || directs).then(|| c.escape_default());
        let length = escaped.as_ref().map_or(1, ExactSizeIterator::len);
        if length > room {
            short.push('…');
            break;
        }
        room -= length;
        match escaped {
            Some(escaped) => short.extend(escaped),
            None => short.push(c),
        }
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_read_and_others_are_not() {
        assert_eq!(integer(b"-12"), Some(-12));
        assert_eq!(integer(b"+7"), Some(7));
        for bad in [
            &b""[..],
            b"-",
            b"1.0",
            b"1e3",
            b"12345678901234567890",
            b"\xff",
        ] {
            assert_eq!(integer(bad), None);
        }
    }

    #[test]
    fn numbers_are_read_in_scientific_notation_and_without_leading_zeros() {
        assert_eq!(number(b"-1.5E-3"), Some(-0.0015));
        assert_eq!(number(b".5"), Some(0.5));
        assert_eq!(number(b"+2."), Some(2.0));
        assert_eq!(number(b"1e999"), Some(f64::INFINITY));
        assert!(number(b"NaN").is_some_and(f64::is_nan));
        assert_eq!(number(b"1,5"), None);
        assert_eq!(number(b"\xff"), None);
    }

    #[test]
    fn shown_words_are_short_and_printable() {
        assert_eq!(shown(b"a\x07b\xff"), "a\\u{7}b\u{fffd}");
        assert_eq!(
            shown("\u{1b}]0;x\u{9c}\u{202e}".as_bytes()),
            "\\u{1b}]0;x\\u{9c}\\u{202e}"
        );
        assert_eq!(shown(&[b'x'; 500]).chars().count(), MAX_SHOWN + 1);
        assert_eq!(shown(&[b'x'; MAX_SHOWN]).chars().count(), MAX_SHOWN);
        assert!(shown(&[0x1b; 500]).chars().count() <= MAX_SHOWN + 1);
    }
}
