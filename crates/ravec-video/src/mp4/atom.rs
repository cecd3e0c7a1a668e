//! Atoms (boxes): lengths, kinds and fields.

use super::ReadSeek;
use crate::error::VideoError;
use std::io::{Read as _, SeekFrom};
use std::ops::Range;

/// Kind of an atom.
pub(super) type FourCc = [u8; 4];

/// Bound on the atoms of the outermost level: a fragment a millisecond for a quarter of an hour.
const MAX_OUTER_ATOMS: usize = 1_000_000;

/// The text of a kind, for messages.
pub(super) fn text_of(kind: FourCc) -> String {
    kind.iter()
        .map(|&byte| {
            if byte.is_ascii_graphic() || byte == b' ' {
                char::from(byte)
            } else {
                '?'
            }
        })
        .collect()
}

/// Positions of atoms of one kind and of their content in `bytes`.
pub(super) fn children(
    bytes: &[u8],
    within: Range<usize>,
) -> impl Iterator<Item = (FourCc, Range<usize>)> {
    let mut at = within.start;
    std::iter::from_fn(move || {
        let rest = bytes.get(at..within.end)?;
        let short = u32::from_be_bytes(*rest.first_chunk()?);
        let kind = *rest.get(4..)?.first_chunk()?;
        let (head, length) = match short {
            0 => (8, rest.len()),
            1 => (
                16,
                usize::try_from(u64::from_be_bytes(*rest.get(8..)?.first_chunk()?)).ok()?,
            ),
            length => (8, length as usize),
        };
        // an atom that does not fit ends the list: what comes after it has no place
        if length < head || length > rest.len() {
            return None;
        }
        let body = at + head..at + length;
        at += length;
        Some((kind, body))
    })
}

/// The first child of a kind.
pub(super) fn child(bytes: &[u8], within: Range<usize>, kind: FourCc) -> Option<Range<usize>> {
    children(bytes, within)
        .find(|(found, _)| *found == kind)
        .map(|(_, body)| body)
}

/// The content of the atom at the end of a path.
pub(super) fn descendant(
    bytes: &[u8],
    within: Range<usize>,
    path: &[FourCc],
) -> Option<Range<usize>> {
    path.iter()
        .try_fold(within, |within, &kind| child(bytes, within, kind))
}

/// Big-endian fields, one after the other.
#[derive(Clone)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk()?;
        self.0 = tail;
        Some(*head)
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_be_bytes)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_be_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_be_bytes)
    }

    pub(super) fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_be_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_be_bytes)
    }

    /// A number of 32 bits, or of 64 bits from version 1 on.
    pub(super) fn by_version(&mut self, version: u8) -> Option<u64> {
        if version == 0 {
            self.u32().map(u64::from)
        } else {
            self.u64()
        }
    }

    /// Version and flags.
    pub(super) fn version(&mut self) -> Option<(u8, u32)> {
        let word = self.u32()?;
        Some(((word >> 24) as u8, word & 0x00ff_ffff))
    }
}

/// The atoms of the outermost level that matter.
#[derive(Debug, Default)]
pub(super) struct Outer {
    /// Place and length of the content of `moov`.
    pub(super) moov: Option<(u64, u64)>,
    /// Place of each `moof`, and place and length of its content.
    pub(super) moofs: Vec<(u64, u64, u64)>,
    /// True if the last atom is longer than the file.
    pub(super) cut: bool,
    /// True if any atom is one that only such files begin with.
    pub(super) familiar: bool,
}

/// Walks the outermost level.
pub(super) fn scan(input: &mut dyn ReadSeek, file_length: u64) -> Result<Outer, VideoError> {
    let mut outer = Outer::default();
    let mut at = 0u64;
    for _ in 0..MAX_OUTER_ATOMS {
        if at + 8 > file_length {
            return Ok(outer);
        }
        input.seek(SeekFrom::Start(at))?;
        let mut head = [0; 16];
        let available = (file_length - at).min(16) as usize;
        input.read_exact(&mut head[..available])?;
        let mut fields = Fields(&head[..available]);
        let (Some(short), Some(kind)) = (fields.u32(), fields.array()) else {
            return Ok(outer);
        };
        let (head_length, length) = match short {
            0 => (8, file_length - at),
            1 => match fields.u64() {
                Some(length) => (16, length),
                None => return Ok(outer),
            },
            length => (8, u64::from(length)),
        };
        if length < head_length {
            outer.cut = true;
            return Ok(outer);
        }
        outer.cut = length > file_length - at;
        let body = at + head_length;
        let body_length = length.min(file_length - at) - head_length;
        match &kind {
            b"moov" if outer.moov.is_none() => outer.moov = Some((body, body_length)),
            b"moof" => outer.moofs.push((at, body, body_length)),
            _ => {}
        }
        outer.familiar |= matches!(
            &kind,
            b"ftyp"
                | b"moov"
                | b"mdat"
                | b"moof"
                | b"free"
                | b"skip"
                | b"wide"
                | b"styp"
                | b"sidx"
                | b"pnot"
                | b"uuid"
        );
        if outer.cut || !outer.familiar {
            return Ok(outer);
        }
        at += length;
    }
    Err(damaged("it has too many atoms"))
}

/// The content of an outer atom. `length` was checked against the length of the file.
pub(super) fn read_body(
    input: &mut dyn ReadSeek,
    at: u64,
    length: u64,
) -> Result<Vec<u8>, VideoError> {
    input.seek(SeekFrom::Start(at))?;
    let mut bytes =
        Vec::with_capacity(usize::try_from(length).map_err(|_| damaged("an atom is too large"))?);
    input.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A file that is damaged before its first frame.
pub(super) fn damaged(reason: impl Into<String>) -> VideoError {
    VideoError::Damaged {
        reason: reason.into(),
    }
}
