//! The text of a glTF file, on its way to the parser.
//!
//! Data that stand in the text as base64 are taken out and decoded here, so that neither the text nor the base64 is ever in
//! memory: the parser gets their number instead. For all else that the parser will allocate, memory is reserved before it
//! sees the text.

use std::io::{self, Read};

use base64::Engine as _;
use base64::engine::general_purpose::{STANDARD, STANDARD_NO_PAD};
use ravec_memory::Reservation;

use crate::error::ReadMeshError;
use crate::source::Source;
use ravec_memory::ReservedVec;

/// In front of the number of data that were taken out: no address of a file begins so.
const MARK: char = '\0';

/// The most bytes that a `{`, a `[` and a `,` cost. The largest things that a brace begins are nodes (at most 96 bytes), those that a comma
/// separates numbers (8 bytes) and a bracket lists of one (32 bytes): three times as much while a list grows, and a list begins
/// with room for four.
const BRACE: u64 = 288;
const BRACKET: u64 = 64;
const COMMA: u64 = 24;

/// Text that is examined in one piece.
const BLOCK: usize = 1 << 14;

/// The most characters in front of the base64.
const MAX_KIND: usize = 256;

/// Base64 that is examined in one piece.
const DECODED: usize = 1 << 14;

/// Data that stood in the text.
pub(super) enum Data {
    Bytes(ReservedVec<u8>),
    /// Not base64, or a picture, whose bytes nobody needs.
    Unreadable,
}

/// The text, as a stream for the parser.
pub(super) struct Json<'s, 'a> {
    source: &'s mut Source<'a>,
    /// The bytes that may come.
    left: u64,
    out: Vec<u8>,
    at: usize,
    /// In a string, and behind a backslash there.
    in_string: bool,
    escaped: bool,
    string_length: u64,
    longest_string: u64,
    memory: Reservation,
    data: ReservedVec<Data>,
    failure: Option<ReadMeshError>,
}

/// The number of data that were taken out, if `address` is one.
pub(super) fn number_of_data(address: &str) -> Option<usize> {
    address.strip_prefix(MARK)?.parse().ok()
}

impl<'s, 'a> Json<'s, 'a> {
    /// The next `left` bytes of `source`.
    pub(super) fn new(source: &'s mut Source<'a>, left: u64) -> Self {
        let budget = source.limits.memory.clone();
        Self {
            source,
            left,
            out: Vec::new(),
            at: 0,
            in_string: false,
            escaped: false,
            string_length: 0,
            longest_string: 0,
            memory: budget.reserve_nothing(),
            data: ReservedVec::new(&budget),
            failure: None,
        }
    }

    /// Why reading failed, if not because of the text.
    pub(super) fn take_failure(&mut self) -> Option<ReadMeshError> {
        self.failure.take()
    }

    /// The number of bytes of the text that were not read, the data that were taken out, and the memory of the parsed text.
    pub(super) fn finish(self) -> (u64, ReservedVec<Data>, Reservation) {
        (self.left, self.data, self.memory)
    }

    /// The next bytes, at least `least` of them unless the text ends before.
    fn peek(&mut self, least: usize) -> Result<&[u8], ReadMeshError> {
        let there = self.source.peek(least)?;
        let end = self.left.min(there.len() as u64) as usize;
        Ok(&there[..end])
    }

    fn consume(&mut self, count: usize) {
        self.source.consume(count);
        self.left -= count as u64;
    }

    fn refill(&mut self) -> Result<(), ReadMeshError> {
        const DATA: &[u8] = b"\"data:";
        self.out.clear();
        self.at = 0;
        if !self.in_string && self.peek(DATA.len())?.starts_with(DATA) {
            self.consume(DATA.len());
            return self.take_data();
        }
        let mut cost = 0;
        let mut longest = self.longest_string;
        let mut state = (self.in_string, self.escaped, self.string_length);
        let there = self.source.peek(DATA.len())?;
        let end = self.left.min(BLOCK as u64) as usize;
        let block = &there[..there.len().min(end)];
        let mut length = block.len();
        for (i, &byte) in block.iter().enumerate() {
            let (in_string, escaped, string_length) = &mut state;
            if *in_string {
                *string_length += 1;
                cost += 1;
                longest = longest.max(*string_length);
                if *escaped {
                    *escaped = false;
                } else if byte == b'\\' {
                    *escaped = true;
                } else if byte == b'"' {
                    *in_string = false;
                }
                continue;
            }
            match byte {
                b'{' => cost += BRACE,
                b'[' => cost += BRACKET,
                b',' => cost += COMMA,
                b'"' => {
                    // at the end of the block it cannot be seen whether data begin
                    let rest = &block[i..];
                    if i > 0 && (rest.len() < DATA.len() || rest.starts_with(DATA)) {
                        length = i;
                        break;
                    }
                    (*in_string, *string_length) = (true, 0);
                }
                _ => {}
            }
        }
        // the parser has one place for the string that it reads, which grows, and copies what it keeps
        cost += 3 * (longest - self.longest_string);
        let block = &block[..length];
        self.out.extend_from_slice(block);
        (self.in_string, self.escaped, self.string_length) = state;
        self.longest_string = longest;
        self.consume(length);
        self.memory.grow(cost)?;
        Ok(())
    }

    /// Decodes what follows on `data:` up to the end of the string.
    fn take_data(&mut self) -> Result<(), ReadMeshError> {
        let mut bytes = ReservedVec::new(&self.source.limits.memory);
        bytes.expect(self.left.min(self.source.options().size.unwrap_or(0)) / 4 * 3);
        // text that was not decoded yet
        let mut text: Vec<u8> = Vec::with_capacity(2 * DECODED);
        let mut is_behind_kind = false;
        let mut readable = true;
        let mut ended = false;
        while !ended {
            let there = self.peek(1)?;
            if there.is_empty() {
                // the parser will say so
                return Ok(());
            }
            let there = &there[..there.len().min(DECODED)];
            let end = there.iter().position(|&byte| byte == b'"');
            let length = end.unwrap_or(there.len());
            ended = end.is_some();
            if readable {
                // slashes may be written so
                text.extend(there[..length].iter().filter(|&&byte| byte != b'\\'));
            }
            self.consume(length + usize::from(ended));
            if readable && !is_behind_kind {
                let comma = text.iter().position(|&byte| byte == b',');
                if let Some(comma) = comma {
                    let kind = &text[..comma];
                    readable = kind.ends_with(b";base64") && !kind.starts_with(b"image/");
                    text.drain(..=comma);
                    is_behind_kind = true;
                } else if ended || text.len() > MAX_KIND {
                    readable = false;
                }
            }
            if readable && is_behind_kind {
                readable = decode(&mut text, ended, &mut bytes)?;
            }
        }
        let data = if readable {
            Data::Bytes(bytes)
        } else {
            Data::Unreadable
        };
        self.out
            .extend_from_slice(format!("\"\\u0000{}\"", self.data.len()).as_bytes());
        self.data.push(data)?;
        Ok(())
    }
}

/// Base64 that is decoded at once, whole groups of four letters.
const PIECE: usize = 1 << 12;

/// Decodes `text` as far as it is certain that no padding follows, or all of it. Says whether it is base64.
fn decode(
    text: &mut Vec<u8>,
    ended: bool,
    bytes: &mut ReservedVec<u8>,
) -> Result<bool, ReadMeshError> {
    let (length, engine) = if ended {
        let plain = text.iter().rposition(|&byte| byte != b'=');
        let is_padded = plain.map_or(0, |last| last + 1) < text.len();
        let engine = if is_padded { STANDARD } else { STANDARD_NO_PAD };
        (text.len(), engine)
    } else {
        (text.len().saturating_sub(4) / 4 * 4, STANDARD_NO_PAD)
    };
    let mut decoded = [0; PIECE];
    for piece in text[..length].chunks(PIECE) {
        let Ok(count) = engine.decode_slice(piece, &mut decoded) else {
            return Ok(false);
        };
        bytes.extend_from_slice(&decoded[..count])?;
    }
    text.drain(..length);
    Ok(true)
}

impl Read for Json<'_, '_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.out.len()
            && let Err(error) = self.refill()
        {
            self.failure = Some(error);
            return Err(io::Error::other("see the failure of the text"));
        }
        let count = buffer.len().min(self.out.len() - self.at);
        buffer[..count].copy_from_slice(&self.out[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::ReadOptions;
    use ravec_memory::MemoryBudget;
    use ravec_progress::Progress;

    /// The text that the parser gets, and the data that were taken out.
    fn read(text: &str) -> (String, Vec<Option<Vec<u8>>>) {
        let (options, progress) = (ReadOptions::default(), Progress::none());
        let mut bytes = text.as_bytes();
        let mut source = Source::new(&mut bytes, &options, &progress).unwrap();
        let mut json = Json::new(&mut source, u64::MAX);
        let mut seen = String::new();
        json.read_to_string(&mut seen).unwrap();
        let (_, data, _) = json.finish();
        let data = data.iter().map(|data| match data {
            Data::Bytes(bytes) => Some(bytes.to_vec()),
            Data::Unreadable => None,
        });
        (seen, data.collect())
    }

    #[test]
    fn data_are_taken_out_with_and_without_padding() {
        for (address, expected) in [
            ("application/octet-stream;base64,aGV5", Some("hey")),
            (";base64,aGU=", Some("he")),
            (";base64,aGU", Some("he")),
            (";base64,", Some("")),
            ("text/plain,hey", None),
            (";base64,a*", None),
            (";base64,aGU==", None),
            ("image/png;base64,aGU=", None),
            ("no comma", None),
        ] {
            let text = format!("{{\"uri\":\"data:{address}\", \"a\": 1}}");
            let (seen, data) = read(&text);
            assert_eq!(seen, "{\"uri\":\"\\u00000\", \"a\": 1}", "{address}");
            assert_eq!(data, [expected.map(|text| text.as_bytes().to_vec())]);
        }
        assert_eq!(number_of_data("\x0012"), Some(12));
        assert_eq!(number_of_data("12"), None);
    }

    #[test]
    fn long_data_are_the_same_wherever_blocks_end() {
        for length in (DECODED - 8..DECODED + 8).chain(3 * DECODED..3 * DECODED + 5) {
            let data: Vec<u8> = (0..length).map(|i| (i * 7 % 251) as u8).collect();
            let blanks = " ".repeat(BLOCK + length % 16 - 12);
            let encoded = STANDARD.encode(&data).replace('/', "\\/");
            let (seen, found) = read(&format!("{{{blanks}\"data:;base64,{encoded}\"}}"));
            assert_eq!(seen, format!("{{{blanks}\"\\u00000\"}}"));
            assert_eq!(found, [Some(data)]);
        }
    }

    #[test]
    fn strings_that_only_contain_data_stay() {
        for text in [
            r#"{"a":"\"data:;base64,aGV5","b":"x\\"}"#,
            r#"{"adata:":"b\\\"data:"}"#,
            "\"data",
            "",
        ] {
            assert_eq!(read(text), (text.to_owned(), vec![]));
        }
    }

    #[test]
    fn memory_is_reserved_for_all_that_is_parsed_before_it_is_parsed() {
        let text = "[{},{},[1,2]]";
        let budget = MemoryBudget::new(1 << 20);
        let mut options = ReadOptions::default();
        options.limits.memory = budget.clone();
        let progress = Progress::none();
        let mut bytes = text.as_bytes();
        let mut source = Source::new(&mut bytes, &options, &progress).unwrap();
        let before = budget.used();
        let mut json = Json::new(&mut source, u64::MAX);
        json.read_exact(&mut [0]).unwrap();
        assert_eq!(budget.used() - before, 2 * BRACE + 2 * BRACKET + 3 * COMMA);
    }
}
