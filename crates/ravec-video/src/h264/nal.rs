//! NAL units and the configuration record of MP4 files.

/// Kinds of NAL units that matter here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NalKind {
    /// A slice of a picture that refers to others.
    Slice,
    /// A slice of a picture from which decoding can start.
    IdrSlice,
    /// A sequence parameter set.
    Sps,
    /// A picture parameter set.
    Pps,
    /// Data partitions, which no decoder of today reads.
    Partition,
    /// Anything that pictures do without: messages, delimiters, layers of other profiles.
    Other,
}

impl NalKind {
    /// The kind of a NAL unit, by its first byte.
    pub(crate) fn of(nal: &[u8]) -> Self {
        match nal.first().map_or(0, |first| first & 0x1f) {
            1 => Self::Slice,
            2..=4 => Self::Partition,
            5 => Self::IdrSlice,
            7 => Self::Sps,
            8 => Self::Pps,
            _ => Self::Other,
        }
    }
}

/// NAL units of a sample: each is a length of `length_size` bytes, and its bytes. `Err(())` where the lengths do not fit.
pub(crate) fn nal_units(
    sample: &[u8],
    length_size: usize,
) -> impl Iterator<Item = Result<&[u8], ()>> {
    let mut rest = sample;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let split = rest.split_at_checked(length_size).and_then(|(head, tail)| {
            let length = head
                .iter()
                .fold(0usize, |length, &byte| length << 8 | usize::from(byte));
            tail.split_at_checked(length)
        });
        let Some((nal, tail)) = split else {
            rest = &[];
            return Some(Err(()));
        };
        rest = tail;
        Some(Ok(nal))
    })
}

/// NAL units between start codes.
pub(super) fn annex_b_units(stream: &[u8]) -> Vec<&[u8]> {
    let mut starts = Vec::new();
    let mut at = 0;
    while at + 3 <= stream.len() {
        if stream[at..at + 3] == [0, 0, 1] {
            starts.push(at);
            at += 3;
        } else {
            at += 1;
        }
    }
    let mut units = Vec::with_capacity(starts.len());
    for (number, &start) in starts.iter().enumerate() {
        let end = starts.get(number + 1).copied().unwrap_or(stream.len());
        let unit = &stream[start + 3..end];
        // zeros before the next start code belong to it, and a unit ends with a bit that is set
        let length = unit
            .iter()
            .rposition(|&byte| byte != 0)
            .map_or(0, |last| last + 1);
        units.push(&unit[..length]);
    }
    units
}

/// The `avcC` record: parameter sets, and the size of the lengths before NAL units.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AvcConfig {
    /// Bytes of a length, 1 to 4.
    pub(crate) length_size: usize,
    /// Sequence parameter sets.
    pub(crate) sps: Vec<Vec<u8>>,
    /// Picture parameter sets.
    pub(crate) pps: Vec<Vec<u8>>,
}

impl AvcConfig {
    /// Reads a record; `None` if it is cut or of another version.
    pub(crate) fn parse(record: &[u8]) -> Option<Self> {
        let (&version, _) = record.split_first()?;
        if version != 1 {
            return None;
        }
        let length_size = usize::from(record.get(4)? & 3) + 1;
        let mut rest = record.get(5..)?;
        let mut sets = |mask: u8| {
            let (&count, tail) = rest.split_first()?;
            rest = tail;
            let mut sets = Vec::new();
            for _ in 0..count & mask {
                let (head, tail) = rest.split_at_checked(2)?;
                let length = usize::from(u16::from_be_bytes([head[0], head[1]]));
                let (set, tail) = tail.split_at_checked(length)?;
                rest = tail;
                sets.push(set.to_vec());
            }
            Some(sets)
        };
        Some(Self {
            length_size,
            sps: sets(31)?,
            pps: sets(255)?,
        })
    }

    /// The record of one set of each kind, for a profile without extensions of the record.
    pub(crate) fn to_record(&self) -> Vec<u8> {
        let profile = |at: usize| self.sps.first().and_then(|sps| sps.get(at)).copied();
        let mut record = vec![1];
        record.extend((1..4).map(|at| profile(at).unwrap_or(0)));
        record.push(0xfc | (self.length_size as u8 - 1));
        for (sets, reserved) in [(&self.sps, 0xe0), (&self.pps, 0)] {
            record.push(reserved | sets.len() as u8);
            for set in sets {
                record.extend((set.len() as u16).to_be_bytes());
                record.extend(set);
            }
        }
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written() {
        let config = AvcConfig {
            length_size: 4,
            sps: vec![vec![0x67, 66, 0xc0, 30, 9]],
            pps: vec![vec![0x68, 1, 2]],
        };
        let record = config.to_record();
        assert_eq!(record[..6], [1, 66, 0xc0, 30, 0xff, 0xe1]);
        assert_eq!(AvcConfig::parse(&record), Some(config));
        for end in 0..record.len() {
            assert_eq!(AvcConfig::parse(&record[..end]), None, "{end}");
        }
    }

    #[test]
    fn start_codes_of_both_lengths_separate_units() {
        let stream = [
            0, 0, 0, 1, 0x67, 5, 0, 0, 1, 0x68, 6, 0, 0, 0, 1, 0x65, 0, 7,
        ];
        assert_eq!(
            annex_b_units(&stream),
            [&[0x67, 5][..], &[0x68, 6], &[0x65, 0, 7]]
        );
    }

    #[test]
    fn lengths_beyond_the_sample_are_an_error() {
        let units: Vec<_> = nal_units(&[0, 2, 0x65, 1, 0, 3, 1], 2).collect();
        assert_eq!(units, [Ok(&[0x65, 1][..]), Err(())]);
        assert_eq!(NalKind::of(&[0x65]), NalKind::IdrSlice);
        assert_eq!(NalKind::of(&[]), NalKind::Other);
    }
}
