//! A buffered stream of bytes, lines and words that knows where it is.
//!
//! All readers stand on it, so that limits, cancellation and truncation are handled once. Memory is one buffer of
//! 256 KiB, more only for a longer line; it is reserved of the budget.

use std::io::{self, Read};

use ravec_memory::Reservation;
use ravec_progress::{Phase, Progress};

use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::read::{MeshLimits, ReadOptions};
use ravec_memory::ReservedVec;

/// Large enough that the cost of a system call vanishes, small enough to stay in the second-level cache.
const BUFFER: usize = 1 << 18;

/// The longest line or word: a polygon with some millions of corners. Longer ones are refused, lest a file without
/// line breaks is taken into memory whole.
const MAX_LINE: usize = 1 << 26;

/// Bytes from a reader, with a place.
pub(super) struct Source<'a> {
    reader: &'a mut dyn Read,
    buffer: Vec<u8>,
    /// The memory of the buffer.
    memory: Reservation,
    start: usize,
    end: usize,
    /// Bytes that left the buffer.
    passed: u64,
    ended: bool,
    /// The line that `start` is on, from 1.
    line: u64,
    /// `true` if the last line ended in a carriage return alone.
    lone_return: bool,
    /// The format to name in errors.
    pub(super) format: MeshFormat,
    pub(super) limits: MeshLimits,
    options: ReadOptions,
    pub(super) progress: &'a Progress,
    phase: Option<Phase>,
}

impl<'a> Source<'a> {
    pub(super) fn new(
        reader: &'a mut dyn Read,
        options: &ReadOptions,
        progress: &'a Progress,
    ) -> Result<Self, ReadMeshError> {
        let phase = options.size.map(|size| progress.phase("read", size));
        let memory = options.limits.memory.reserve(BUFFER as u64)?;
        Ok(Self {
            reader,
            buffer: vec![0; BUFFER],
            memory,
            start: 0,
            end: 0,
            passed: 0,
            ended: false,
            line: 1,
            lone_return: false,
            format: MeshFormat::StlBinary,
            limits: options.limits.clone(),
            options: options.clone(),
            progress,
            phase,
        })
    }

    /// The options it was made with.
    pub(super) fn options(&self) -> &ReadOptions {
        &self.options
    }

    /// Number of the next byte.
    pub(super) fn offset(&self) -> u64 {
        self.passed + self.start as u64
    }

    /// The place of the next byte, as text formats count.
    pub(super) fn at_line(&self) -> Place {
        Place::Line(self.line)
    }

    /// The place of the next byte, as binary formats count.
    pub(super) fn at_byte(&self) -> Place {
        Place::Byte(self.offset())
    }

    /// An error of syntax.
    pub(super) fn syntax(&self, place: Place, what: impl Into<String>) -> ReadMeshError {
        ReadMeshError::syntax(self.format, place, what)
    }

    /// An error of a file that ends here, inside of something.
    pub(super) fn truncated(&self, inside: impl Into<String>) -> ReadMeshError {
        ReadMeshError::Truncated {
            format: self.format,
            place: Place::Byte(self.passed + self.end as u64),
            inside: inside.into(),
        }
    }

    /// Reads more behind what is there. Tells whether more came.
    fn fill(&mut self) -> Result<bool, ReadMeshError> {
        if self.ended {
            return Ok(false);
        }
        self.progress.check()?;
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.passed += self.start as u64;
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            let longer = self.buffer.len() * 2;
            self.memory.grow(longer as u64)?;
            self.buffer.reserve_exact(longer - self.end);
            self.buffer.resize(longer, 0);
            self.memory.shrink_to(longer as u64);
        }
        let got = loop {
            match self.reader.read(&mut self.buffer[self.end..]) {
                Ok(got) => break got,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        };
        self.end += got;
        self.ended = got == 0;
        if let Some(phase) = &self.phase {
            phase.advance(got as u64);
        }
        Ok(!self.ended)
    }

    /// The buffered bytes, at least `least` of them unless the file ends before.
    pub(super) fn peek(&mut self, least: usize) -> Result<&[u8], ReadMeshError> {
        while self.end - self.start < least && self.fill()? {}
        Ok(&self.buffer[self.start..self.end])
    }

    /// Passes over `count` bytes that [`Self::peek`] has shown.
    pub(super) fn consume(&mut self, count: usize) {
        self.start = (self.start + count).min(self.end);
    }

    /// The next `count` bytes; nothing if the file has fewer.
    pub(super) fn exact(&mut self, count: usize) -> Result<Option<&[u8]>, ReadMeshError> {
        if self.end - self.start < count {
            self.peek(count)?;
            if self.end - self.start < count {
                return Ok(None);
            }
        }
        let from = self.start;
        self.start += count;
        Ok(Some(&self.buffer[from..from + count]))
    }

    /// Passes over `count` bytes. Tells whether there were as many.
    pub(super) fn skip(&mut self, mut count: u64) -> Result<bool, ReadMeshError> {
        while count > 0 {
            let there = self.peek(1)?.len() as u64;
            if there == 0 {
                return Ok(false);
            }
            let step = there.min(count);
            self.consume(step as usize);
            count -= step;
        }
        Ok(true)
    }

    /// Passes over the mark of UTF-8, which some programs put in front of text.
    pub(super) fn skip_mark(&mut self) -> Result<(), ReadMeshError> {
        const MARK: &[u8] = b"\xef\xbb\xbf";
        if self.peek(MARK.len())?.starts_with(MARK) {
            self.consume(MARK.len());
        }
        Ok(())
    }

    /// The next line without its end, and its place; nothing at the end of the file.
    pub(super) fn line(&mut self) -> Result<Option<(&[u8], Place)>, ReadMeshError> {
        let found = self.find_line()?;
        Ok(found.map(|(from, to, place)| (&self.buffer[from..to], place)))
    }

    /// The next line that holds more than blanks and a comment, which begins at `comment` and is cut off.
    pub(super) fn content_line(
        &mut self,
        comment: Option<u8>,
    ) -> Result<Option<(&[u8], Place)>, ReadMeshError> {
        while let Some((from, to, place)) = self.find_line()? {
            let line = &self.buffer[from..to];
            let length = comment
                .and_then(|comment| line.iter().position(|&byte| byte == comment))
                .unwrap_or(line.len());
            if !line[..length].iter().all(u8::is_ascii_whitespace) {
                return Ok(Some((&self.buffer[from..from + length], place)));
            }
        }
        Ok(None)
    }

    /// Range in the buffer of the next line; it is passed over. A line ends in a line feed, in a carriage return, or in both.
    fn find_line(&mut self) -> Result<Option<(usize, usize, Place)>, ReadMeshError> {
        let length = self.length_to(|byte| matches!(byte, b'\n' | b'\r'), "line")?;
        if length.is_none() && self.start == self.end {
            return Ok(None);
        }
        let place = self.at_line();
        let (mut gap, mut length) = (0, length);
        if let Some(length) = length {
            gap = 1;
            if self.buffer[self.start + length] == b'\r' {
                gap += usize::from(self.has_line_feed_at(length + 1)?);
                self.lone_return = gap == 1;
            } else {
                self.lone_return = false;
            }
        }
        let length = *length.get_or_insert(self.end - self.start);
        let from = self.start;
        self.start = from + length + gap;
        self.line += u64::from(gap > 0);
        Ok(Some((from, from + length, place)))
    }

    /// True if a line feed is the byte that comes after `ahead` others.
    ///
    /// Behind the header of a binary file whose lines end in carriage returns alone comes data, which may begin with the
    /// same byte: there the lines before decide.
    fn has_line_feed_at(&mut self, ahead: usize) -> Result<bool, ReadMeshError> {
        const END: &[u8] = b"end_header";
        let line = &self.buffer[self.start..self.start + ahead - 1];
        if self.lone_return && line.trim_ascii() == END {
            return Ok(false);
        }
        Ok(self.peek(ahead + 1)?.get(ahead) == Some(&b'\n'))
    }

    /// The number of bytes up to the first one that `ends` a line or a word; nothing if the file has none.
    fn length_to(
        &mut self,
        ends: impl Fn(u8) -> bool,
        what: &str,
    ) -> Result<Option<usize>, ReadMeshError> {
        let mut seen = 0;
        loop {
            let there = &self.buffer[self.start..self.end];
            if let Some(at) = there[seen..].iter().position(|&byte| ends(byte)) {
                return Ok(Some(seen + at));
            }
            seen = there.len();
            if seen > MAX_LINE {
                return Err(self.syntax(self.at_line(), format!("the {what} is too long")));
            }
            if !self.fill()? {
                return Ok(None);
            }
        }
    }

    /// The next word and its place; nothing at the end of the file.
    pub(super) fn word(&mut self) -> Result<Option<(&[u8], Place)>, ReadMeshError> {
        let mut after_return = false;
        loop {
            let there = &self.buffer[self.start..self.end];
            let gap = there.iter().position(|byte| !byte.is_ascii_whitespace());
            let blank = &there[..gap.unwrap_or(there.len())];
            // Mostly a single byte.
            for &byte in blank {
                let is_second = byte == b'\n' && after_return;
                self.line += u64::from(matches!(byte, b'\n' | b'\r') && !is_second);
                after_return = byte == b'\r';
            }
            self.start += blank.len();
            if gap.is_some() {
                break;
            }
            if !self.fill()? {
                return Ok(None);
            }
        }
        let length = self.length_to(|byte| byte.is_ascii_whitespace(), "word")?;
        let length = length.unwrap_or(self.end - self.start);
        let from = self.start;
        self.start += length;
        Ok(Some((&self.buffer[from..from + length], self.at_line())))
    }

    /// The next `count` bytes, fewer where the file ends before. Memory grows with the bytes that come; `expected` of them
    /// are expected.
    pub(super) fn bytes(
        &mut self,
        count: u64,
        expected: u64,
    ) -> Result<ReservedVec<u8>, ReadMeshError> {
        let mut bytes = ReservedVec::new(&self.limits.memory);
        bytes.expect(expected.min(count));
        let mut left = count;
        while left > 0 {
            let there = self.peek(1)?;
            if there.is_empty() {
                break;
            }
            let step = left.min(there.len() as u64) as usize;
            bytes.extend_from_slice(&there[..step])?;
            self.consume(step);
            left -= step as u64;
        }
        Ok(bytes)
    }

    /// All bytes from here on.
    pub(super) fn rest(&mut self) -> Result<ReservedVec<u8>, ReadMeshError> {
        let expected = self.options.size.unwrap_or(0);
        self.bytes(u64::MAX, expected.saturating_sub(self.offset()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives one byte at a time: every border between two reads.
    struct Drip<'a>(&'a [u8]);

    impl Read for Drip<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.0.len().min(1).min(buffer.len());
            buffer[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn lines_and_words_are_counted_whatever_the_reads_bring() {
        let text = b"one two\r\n\n three\nlast";
        let progress = Progress::none();
        let options = ReadOptions::default();
        let mut drip = Drip(text);
        let mut source = Source::new(&mut drip, &options, &progress).unwrap();
        let mut lines = Vec::new();
        while let Some((line, place)) = source.line().unwrap() {
            lines.push((String::from_utf8(line.to_vec()).unwrap(), place));
        }
        let expected = [("one two", 1), ("", 2), (" three", 3), ("last", 4)];
        let expected = expected.map(|(line, at)| (line.to_owned(), Place::Line(at)));
        assert_eq!(lines, expected);

        let mut drip = Drip(text);
        let mut source = Source::new(&mut drip, &options, &progress).unwrap();
        let mut words = Vec::new();
        while let Some((word, place)) = source.word().unwrap() {
            words.push((String::from_utf8(word.to_vec()).unwrap(), place));
        }
        let expected = [("one", 1), ("two", 1), ("three", 3), ("last", 4)];
        let expected = expected.map(|(word, at)| (word.to_owned(), Place::Line(at)));
        assert_eq!(words, expected);
    }

    #[test]
    fn carriage_returns_alone_and_mixed_with_others_end_lines() {
        let progress = Progress::none();
        let options = ReadOptions::default();
        for text in [
            "a\rb\r\rc\n d\r",
            "a\r\nb\n\rc\r d\r\n",
            "a\nb\r\n\rc\r\n d",
        ] {
            let expected = [("a", 1), ("b", 2), ("", 3), ("c", 4), (" d", 5)];
            let mut drip = Drip(text.as_bytes());
            let mut source = Source::new(&mut drip, &options, &progress).unwrap();
            for (line, at) in expected {
                let found = source.line().unwrap();
                assert_eq!(found, Some((line.as_bytes(), Place::Line(at))), "{text:?}");
            }
            assert_eq!(source.line().unwrap(), None);
            let mut drip = Drip(text.as_bytes());
            let mut source = Source::new(&mut drip, &options, &progress).unwrap();
            for (word, at) in [("a", 1), ("b", 2), ("c", 4), ("d", 5)] {
                let found = source.word().unwrap();
                assert_eq!(found, Some((word.as_bytes(), Place::Line(at))), "{text:?}");
            }
            assert_eq!(source.word().unwrap(), None);
        }
    }

    #[test]
    fn data_behind_a_header_of_carriage_returns_may_begin_with_a_line_feed() {
        let (progress, options) = (Progress::none(), ReadOptions::default());
        for (text, data) in [
            (&b"ply\rend_header\r\nx"[..], &b"\nx"[..]),
            (b"ply\r\nend_header\r\nx", b"x"),
            (b"ply\nend_header\n\nx", b"\nx"),
        ] {
            let mut drip = Drip(text);
            let mut source = Source::new(&mut drip, &options, &progress).unwrap();
            source.line().unwrap();
            source.line().unwrap();
            assert_eq!(source.peek(9).unwrap(), data);
        }
    }
}
