//! Atoms that are written, and the tables of a track that grows.

use super::atom::FourCc;

/// Appends an atom whose content `fill` appends.
pub(super) fn atom(out: &mut Vec<u8>, kind: FourCc, fill: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend([0; 4]);
    out.extend(kind);
    fill(out);
    // indices of clips stay far below 4 GiB: a billion frames have tables of 12 GiB and are refused by the limits of readers
    let length = (out.len() - start) as u32;
    out[start..start + 4].copy_from_slice(&length.to_be_bytes());
}

/// Appends an atom with version and flags.
pub(super) fn full_atom(
    out: &mut Vec<u8>,
    kind: FourCc,
    (version, flags): (u8, u32),
    fill: impl FnOnce(&mut Vec<u8>),
) {
    atom(out, kind, |out| {
        out.extend((u32::from(version) << 24 | flags).to_be_bytes());
        fill(out);
    });
}

/// Appends numbers of 32 bits.
pub(super) fn words(out: &mut Vec<u8>, numbers: &[u32]) {
    for number in numbers {
        out.extend(number.to_be_bytes());
    }
}

/// Runs of equal values.
#[derive(Debug, Default)]
struct Runs(Vec<(u32, u32)>);

impl Runs {
    fn push(&mut self, value: u32) {
        match self.0.last_mut() {
            Some((count, last)) if *last == value && *count < u32::MAX => *count += 1,
            _ => self.0.push((1, value)),
        }
    }

    fn write(&self, out: &mut Vec<u8>, kind: FourCc, version: u8) {
        full_atom(out, kind, (version, 0), |out| {
            words(out, &[self.0.len() as u32]);
            for &(count, value) in &self.0 {
                words(out, &[count, value]);
            }
        });
    }
}

/// Samples that lie in the file one after the other.
#[derive(Debug)]
struct Chunk {
    offset: u64,
    samples: u32,
    entry: u32,
}

/// The tables of a track that grows.
#[derive(Debug, Default)]
pub(super) struct TableBuilder {
    durations: Runs,
    display_offsets: Runs,
    /// The size of all samples, as long as it is one.
    common_size: u32,
    sizes: Vec<u32>,
    count: u32,
    syncs: Vec<u32>,
    chunks: Vec<Chunk>,
    /// Ticks of all samples.
    pub(super) duration: u64,
}

impl TableBuilder {
    /// Appends a sample to the current chunk.
    pub(super) fn push(&mut self, size: u32, duration: u32, display_offset: i32, sync: bool) {
        if self.count == 0 {
            self.common_size = size;
        } else if size != self.common_size && self.sizes.is_empty() {
            self.sizes = vec![self.common_size; self.count as usize];
            self.sizes.push(size);
        } else if !self.sizes.is_empty() {
            self.sizes.push(size);
        }
        self.count += 1;
        if sync {
            self.syncs.push(self.count);
        }
        self.durations.push(duration);
        self.display_offsets.push(display_offset as u32);
        self.duration += u64::from(duration);
        if let Some(chunk) = self.chunks.last_mut() {
            chunk.samples += 1;
        }
    }

    /// Begins a chunk at a place of the file.
    pub(super) fn open_chunk(&mut self, offset: u64, entry: u32) {
        self.chunks.push(Chunk {
            offset,
            samples: 0,
            entry,
        });
    }

    /// Appends `stbl` with the content of `stsd`.
    pub(super) fn write(&self, out: &mut Vec<u8>, descriptions: &[u8]) {
        atom(out, *b"stbl", |out| {
            atom(out, *b"stsd", |out| out.extend(descriptions));
            self.durations.write(out, *b"stts", 0);
            if self
                .display_offsets
                .0
                .iter()
                .any(|&(_, offset)| offset != 0)
            {
                let negative = self
                    .display_offsets
                    .0
                    .iter()
                    .any(|&(_, offset)| (offset as i32) < 0);
                self.display_offsets
                    .write(out, *b"ctts", u8::from(negative));
            }
            if self.syncs.len() != self.count as usize {
                full_atom(out, *b"stss", (0, 0), |out| {
                    words(out, &[self.syncs.len() as u32]);
                    words(out, &self.syncs);
                });
            }
            self.write_chunks(out);
            full_atom(out, *b"stsz", (0, 0), |out| {
                let common = if self.sizes.is_empty() {
                    self.common_size
                } else {
                    0
                };
                words(out, &[common, self.count]);
                words(out, &self.sizes);
            });
        });
    }

    fn write_chunks(&self, out: &mut Vec<u8>) {
        let chunks: Vec<&Chunk> = self
            .chunks
            .iter()
            .filter(|chunk| chunk.samples > 0)
            .collect();
        let mut runs: Vec<[u32; 3]> = Vec::new();
        for (number, chunk) in chunks.iter().enumerate() {
            if runs
                .last()
                .is_none_or(|last| last[1..] != [chunk.samples, chunk.entry])
            {
                runs.push([number as u32 + 1, chunk.samples, chunk.entry]);
            }
        }
        full_atom(out, *b"stsc", (0, 0), |out| {
            words(out, &[runs.len() as u32]);
            for run in &runs {
                words(out, run);
            }
        });
        let wide = chunks
            .iter()
            .any(|chunk| chunk.offset > u64::from(u32::MAX));
        full_atom(out, if wide { *b"co64" } else { *b"stco" }, (0, 0), |out| {
            words(out, &[chunks.len() as u32]);
            for chunk in &chunks {
                if wide {
                    out.extend(chunk.offset.to_be_bytes());
                } else {
                    words(out, &[chunk.offset as u32]);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mp4::atom::child;
    use crate::mp4::samples::{SampleTables, Samples};
    use proptest::prelude::*;

    proptest! {
        /// The reader of tables is the judge of their writer, and the list of samples that of both.
        #[test]
        fn tables_are_read_as_they_were_pushed(
            samples in prop::collection::vec((1..4u32, 0..3u32, -2..3i32, any::<bool>(), 0..4u32, 1..3u32), 0..40),
            base in prop_oneof![Just(48u64), Just((1 << 33) + 7)],
        ) {
            let mut tables = TableBuilder::default();
            let (mut at, mut decoded) = (base, 0i64);
            let mut expected = Vec::new();
            let mut entry = 1;
            for (number, &(size, duration, display_offset, sync, gap, next_entry)) in samples.iter().enumerate() {
                if gap == 0 || number == 0 {
                    at += 5;
                    entry = next_entry;
                    tables.open_chunk(at, entry);
                }
                tables.push(size, duration, display_offset, sync);
                expected.push((at, size, decoded, decoded + i64::from(display_offset), duration, entry, sync));
                at += u64::from(size);
                decoded += i64::from(duration);
            }
            let mut bytes = Vec::new();
            tables.write(&mut bytes, &[0; 8]);
            let body = child(&bytes, 0..bytes.len(), *b"stbl").unwrap();
            let read = SampleTables::find(&bytes, body, u64::MAX);
            let mut walk = Samples::new();
            let found: Vec<_> = std::iter::from_fn(|| walk.next(&bytes, &read))
                .map(|sample| (
                    sample.offset, sample.size, sample.decoded, sample.shown(), sample.duration, sample.entry(), sample.sync(),
                ))
                .collect();
            prop_assert_eq!(found, expected);
        }
    }
}
