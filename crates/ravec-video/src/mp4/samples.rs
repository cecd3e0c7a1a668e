//! Tables of samples, read as they are stored.
//!
//! A table of the file is a list of runs (`stts`, `ctts`, `stsc`), of numbers (`stsz`, `stco`, `stss`), or one number for all.
//! [`Samples`] walks all of them at once, so that a track of any length takes no memory beyond the atom.

use super::atom::{Fields, child};
use std::ops::Range;

/// A sample of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// Place in the file.
    pub(super) offset: u64,
    /// Time of decoding in ticks.
    pub(super) decoded: i64,
    /// Bytes.
    pub(super) size: u32,
    /// Ticks from the time of decoding to that of display.
    pub(super) display_offset: i32,
    /// Ticks up to the next sample.
    pub(super) duration: u32,
    /// Number of the sample entry, from 1, in the low bits; the highest bit is set if decoding can start here.
    entry_and_sync: u32,
}

const SYNC: u32 = 1 << 31;

impl Sample {
    pub(super) fn new(offset: u64, size: u32, entry: u32, sync: bool) -> Self {
        Self {
            offset,
            decoded: 0,
            size,
            display_offset: 0,
            duration: 0,
            entry_and_sync: entry & !SYNC | if sync { SYNC } else { 0 },
        }
    }

    /// The sample with its times.
    pub(super) fn at(self, decoded: i64, display_offset: i32, duration: u32) -> Self {
        Self {
            decoded,
            display_offset,
            duration,
            ..self
        }
    }

    /// Number of the sample entry, from 1.
    pub(super) fn entry(&self) -> u32 {
        self.entry_and_sync & !SYNC
    }

    /// True if the file says that decoding can start here.
    pub(super) fn sync(&self) -> bool {
        self.entry_and_sync & SYNC != 0
    }

    /// Time of display in ticks.
    pub(super) fn shown(&self) -> i64 {
        self.decoded.saturating_add(i64::from(self.display_offset))
    }

    /// First byte after the sample.
    pub(super) fn end(&self) -> u64 {
        self.offset.saturating_add(u64::from(self.size))
    }
}

/// Positions of the tables of a track.
#[derive(Debug, Clone, Default)]
pub(super) struct SampleTables {
    durations: Range<usize>,
    display_offsets: Range<usize>,
    chunk_runs: Range<usize>,
    chunks: Range<usize>,
    wide_chunks: bool,
    sizes: Range<usize>,
    /// The size of all samples, or zero if each has its own.
    pub(super) common_size: u32,
    /// Samples of a common size end here, because nothing but their count in the file says how many there are.
    file_length: u64,
    /// Bits of a size.
    size_bits: usize,
    count: u32,
    /// `None` if all samples are places to start at.
    syncs: Option<Range<usize>>,
}

impl SampleTables {
    /// Finds the tables in `stbl`. A missing or cut table has no entries.
    pub(super) fn find(bytes: &[u8], within: Range<usize>, file_length: u64) -> Self {
        // entries of a table of `size` bytes each, after the version, flags and count
        let table = |kind, size: usize| {
            let body = child(bytes, within.clone(), kind)?;
            let mut fields = Fields(&bytes[body.clone()]);
            fields.version()?;
            let count = fields.u32()? as usize;
            let start = body.end - fields.0.len();
            let length = count.checked_mul(size)?.min(fields.0.len() / size * size);
            Some(start..start + length)
        };
        let mut tables = Self {
            durations: table(*b"stts", 8).unwrap_or_default(),
            display_offsets: table(*b"ctts", 8).unwrap_or_default(),
            chunk_runs: table(*b"stsc", 12).unwrap_or_default(),
            syncs: table(*b"stss", 4),
            file_length,
            ..Self::default()
        };
        if let Some(chunks) = table(*b"stco", 4) {
            tables.chunks = chunks;
        } else if let Some(chunks) = table(*b"co64", 8) {
            (tables.chunks, tables.wide_chunks) = (chunks, true);
        }
        tables.find_sizes(bytes, within);
        tables
    }

    fn find_sizes(&mut self, bytes: &[u8], within: Range<usize>) -> Option<()> {
        let (body, compact) = match child(bytes, within.clone(), *b"stsz") {
            Some(body) => (body, false),
            None => (child(bytes, within, *b"stz2")?, true),
        };
        let mut fields = Fields(&bytes[body.clone()]);
        fields.version()?;
        let word = fields.u32()?;
        let count = fields.u32()?;
        (self.common_size, self.size_bits) = if compact {
            (0, (word & 0xff) as usize)
        } else {
            (word, 32)
        };
        if !matches!(self.size_bits, 4 | 8 | 16 | 32) {
            return None;
        }
        self.sizes = body.end - fields.0.len()..body.end;
        self.count = if self.common_size > 0 {
            count
        } else {
            let room = self.sizes.len() * 8 / self.size_bits;
            count.min(u32::try_from(room).unwrap_or(u32::MAX))
        };
        Some(())
    }

    fn size(&self, bytes: &[u8], sample: u32) -> Option<u32> {
        if self.common_size > 0 {
            return Some(self.common_size);
        }
        let bit = sample as usize * self.size_bits;
        let at = bytes.get(self.sizes.clone())?.get(bit / 8..)?;
        Some(match self.size_bits {
            4 => u32::from(at.first()? >> (4 - bit % 8) & 15),
            8 => u32::from(*at.first()?),
            16 => u32::from(u16::from_be_bytes(*at.first_chunk()?)),
            _ => u32::from_be_bytes(*at.first_chunk()?),
        })
    }

    /// A number of 32 bits in a table.
    fn word(bytes: &[u8], table: &Range<usize>, at: usize) -> Option<u32> {
        let word = bytes.get(table.clone())?.get(4 * at..)?.first_chunk()?;
        Some(u32::from_be_bytes(*word))
    }

    fn chunk(&self, bytes: &[u8], number: usize) -> Option<u64> {
        if self.wide_chunks {
            let high = Self::word(bytes, &self.chunks, 2 * number)?;
            let low = Self::word(bytes, &self.chunks, 2 * number + 1)?;
            Some(u64::from(high) << 32 | u64::from(low))
        } else {
            Self::word(bytes, &self.chunks, number).map(u64::from)
        }
    }
}

/// A position in a list of runs: entries of two words, the first of which is a count.
#[derive(Debug, Clone, Default)]
struct Runs {
    entry: usize,
    used: u32,
}

impl Runs {
    /// The value for the next sample; `None` after the last run.
    fn next(&mut self, bytes: &[u8], table: &Range<usize>) -> Option<u32> {
        loop {
            let count = SampleTables::word(bytes, table, 2 * self.entry)?;
            if self.used < count {
                self.used += 1;
                return SampleTables::word(bytes, table, 2 * self.entry + 1);
            }
            self.entry += 1;
            self.used = 0;
        }
    }
}

/// A walk over the samples of a track.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    sample: u32,
    decoded: i64,
    durations: Runs,
    display_offsets: Runs,
    /// Number of the chunk after the current one, from 0.
    chunk: usize,
    chunk_run: usize,
    left_in_chunk: u32,
    offset: u64,
    entry: u32,
    sync: usize,
}

impl Samples {
    pub(super) fn new() -> Self {
        Self {
            sample: 0,
            decoded: 0,
            durations: Runs::default(),
            display_offsets: Runs::default(),
            chunk: 0,
            chunk_run: 0,
            left_in_chunk: 0,
            offset: 0,
            entry: 1,
            sync: 0,
        }
    }

    /// The next sample; `None` where any of the tables ends.
    pub(super) fn next(&mut self, bytes: &[u8], tables: &SampleTables) -> Option<Sample> {
        if self.sample >= tables.count {
            return None;
        }
        while self.left_in_chunk == 0 {
            self.open_chunk(bytes, tables)?;
        }
        let size = tables.size(bytes, self.sample)?;
        if tables.common_size > 0
            && self.offset.saturating_add(u64::from(size)) > tables.file_length
        {
            return None;
        }
        let duration = self.durations.next(bytes, &tables.durations)?;
        // old files count from zero on and have no negative offsets; new ones have, and readers take both as signed
        let display_offset = self
            .display_offsets
            .next(bytes, &tables.display_offsets)
            .unwrap_or(0) as i32;
        let sync = self.is_sync(bytes, tables);
        let sample = Sample::new(self.offset, size, self.entry, sync).at(
            self.decoded,
            display_offset,
            duration,
        );
        self.sample += 1;
        self.left_in_chunk -= 1;
        self.offset = sample.end();
        self.decoded = self.decoded.saturating_add(i64::from(duration));
        Some(sample)
    }

    fn open_chunk(&mut self, bytes: &[u8], tables: &SampleTables) -> Option<()> {
        self.offset = tables.chunk(bytes, self.chunk)?;
        self.chunk += 1;
        let run =
            |at: usize, field: usize| SampleTables::word(bytes, &tables.chunk_runs, 3 * at + field);
        while run(self.chunk_run + 1, 0).is_some_and(|first| first as usize <= self.chunk) {
            self.chunk_run += 1;
        }
        self.left_in_chunk = run(self.chunk_run, 1)?;
        self.entry = run(self.chunk_run, 2)?;
        Some(())
    }

    fn is_sync(&mut self, bytes: &[u8], tables: &SampleTables) -> bool {
        let Some(table) = &tables.syncs else {
            return true;
        };
        let number = self.sample + 1;
        while SampleTables::word(bytes, table, self.sync).is_some_and(|sync| sync < number) {
            self.sync += 1;
        }
        SampleTables::word(bytes, table, self.sync) == Some(number)
    }
}
