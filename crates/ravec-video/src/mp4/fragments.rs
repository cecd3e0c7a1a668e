//! Fragments: atoms `moof`, each with the samples of a short time.

use super::ReadSeek;
use super::atom::{self, Fields, child, children, damaged};
use super::movie::Movie;
use super::samples::Sample;
use crate::error::VideoError;
use ravec_memory::MemoryBudget;
use std::ops::Range;

/// Least bytes of a sample in fragments that state no sizes one by one; bounds the samples that a file of some length can
/// claim.
const MIN_SAMPLE_BYTES: u64 = 4;

/// Defaults of a track for all fragments (`trex`), or for one (`tfhd`).
#[derive(Debug, Clone, Copy, Default)]
struct Defaults {
    track: u32,
    entry: u32,
    duration: u32,
    size: u32,
    flags: u32,
}

/// Appends the samples of all fragments to their tracks.
pub(super) fn read(
    input: &mut dyn ReadSeek,
    movie: &mut Movie,
    moofs: &[(u64, u64, u64)],
    memory: &MemoryBudget,
) -> Result<(), VideoError> {
    let defaults: Vec<Defaults> = child(&movie.bytes, 0..movie.bytes.len(), *b"mvex")
        .map(|body| {
            children(&movie.bytes, body)
                .filter(|(kind, _)| kind == b"trex")
                .filter_map(|(_, body)| read_trex(&movie.bytes[body]))
                .collect()
        })
        .unwrap_or_default();
    if defaults.is_empty() {
        return Ok(());
    }
    for &(moof, at, length) in moofs {
        let _reserved = memory.reserve(length)?;
        let bytes = atom::read_body(input, at, length)?;
        let mut next_data = moof;
        for (kind, body) in children(&bytes, 0..bytes.len()) {
            if &kind == b"traf" {
                next_data = read_track(&bytes, body, (moof, next_data), &defaults, movie)?;
            }
        }
    }
    Ok(())
}

fn read_trex(body: &[u8]) -> Option<Defaults> {
    let mut fields = Fields(body);
    fields.version()?;
    Some(Defaults {
        track: fields.u32()?,
        entry: fields.u32()?,
        duration: fields.u32()?,
        size: fields.u32()?,
        flags: fields.u32()?,
    })
}

/// Reads a `traf`; returns where the data of the next one begin if it does not say.
fn read_track(
    bytes: &[u8],
    body: Range<usize>,
    (moof, next_data): (u64, u64),
    defaults: &[Defaults],
    movie: &mut Movie,
) -> Result<u64, VideoError> {
    let header = child(bytes, body.clone(), *b"tfhd")
        .and_then(|header| read_tfhd(&bytes[header], defaults, (moof, next_data)));
    let Some((defaults, base)) = header else {
        return Ok(next_data);
    };
    let file_length = movie.file_length;
    let Some(track) = movie
        .tracks
        .iter_mut()
        .find(|track| track.id == defaults.track)
    else {
        return Ok(next_data);
    };
    let start = child(bytes, body.clone(), *b"tfdt").and_then(|body| {
        let mut fields = Fields(&bytes[body]);
        let (version, _) = fields.version()?;
        i64::try_from(fields.by_version(version)?).ok()
    });
    let mut run = Run {
        decoded: start.unwrap_or_else(|| {
            let last = track.fragments.last();
            last.map_or(0, |last| {
                last.decoded.saturating_add(i64::from(last.duration))
            })
        }),
        offset: base,
        base,
    };
    for (kind, body) in children(bytes, body) {
        if &kind == b"trun" {
            run.read(&bytes[body], &defaults, |sample, stated| {
                let room = if stated {
                    u64::MAX
                } else {
                    file_length / MIN_SAMPLE_BYTES
                };
                if track.fragments.len() as u64 >= room {
                    return Err(damaged(
                        "a fragment has more samples than the file has room for",
                    ));
                }
                Ok(track.fragments.push(sample)?)
            })?;
        }
    }
    Ok(run.offset)
}

fn read_tfhd(
    body: &[u8],
    defaults: &[Defaults],
    (moof, next_data): (u64, u64),
) -> Option<(Defaults, u64)> {
    let mut fields = Fields(body);
    let (_, flags) = fields.version()?;
    let track = fields.u32()?;
    let mut own = *defaults.iter().find(|defaults| defaults.track == track)?;
    let base = if flags & 1 != 0 {
        fields.u64()?
    } else if flags & 0x2_0000 != 0 {
        moof
    } else {
        next_data
    };
    for (flag, field) in [
        (2, &mut own.entry),
        (8, &mut own.duration),
        (0x10, &mut own.size),
        (0x20, &mut own.flags),
    ] {
        if flags & flag != 0 {
            *field = fields.u32()?;
        }
    }
    Some((own, base))
}

/// Position at which the samples of a fragment go on.
struct Run {
    decoded: i64,
    offset: u64,
    base: u64,
}

impl Run {
    /// Reads a `trun`. `push` gets each sample, and true if the atom has bytes of its own for it.
    fn read(
        &mut self,
        body: &[u8],
        defaults: &Defaults,
        mut push: impl FnMut(Sample, bool) -> Result<(), VideoError>,
    ) -> Result<(), VideoError> {
        let mut fields = Fields(body);
        let (Some((_, flags)), Some(count)) = (fields.version(), fields.u32()) else {
            return Ok(());
        };
        if flags & 1 != 0 {
            let Some(offset) = fields.i32() else {
                return Ok(());
            };
            self.offset = self.base.saturating_add_signed(i64::from(offset));
        }
        let first_flags = if flags & 4 != 0 { fields.u32() } else { None };
        let stated = flags & 0xf00 != 0;
        for number in 0..count {
            let mut field = |flag: u32, default: u32| {
                if flags & flag == 0 {
                    Some(default)
                } else {
                    fields.u32()
                }
            };
            let (Some(duration), Some(size), Some(sample_flags), Some(display_offset)) = (
                field(0x100, defaults.duration),
                field(0x200, defaults.size),
                field(0x400, defaults.flags),
                field(0x800, 0),
            ) else {
                return Ok(());
            };
            let sample_flags = first_flags.filter(|_| number == 0).unwrap_or(sample_flags);
            let sync = sample_flags & 0x1_0000 == 0;
            let sample = Sample::new(self.offset, size, defaults.entry, sync).at(
                self.decoded,
                display_offset as i32,
                duration,
            );
            push(sample, stated)?;
            self.offset = sample.end();
            self.decoded = self.decoded.saturating_add(i64::from(duration));
        }
        Ok(())
    }
}
