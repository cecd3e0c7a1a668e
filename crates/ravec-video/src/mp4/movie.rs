//! The atom `moov`: tracks and what they are made of.

use super::ReadSeek;
use super::atom::{self, Fields, FourCc, child, children, damaged, descendant, text_of};
use super::fragments;
use super::samples::{Sample, SampleTables, Samples};
use crate::error::VideoError;
use crate::info::{OtherTrack, TrackKind};
use ravec_memory::{MemoryBudget, Reservation, ReservedVec};
use std::io::SeekFrom;
use std::ops::Range;

/// Bound on tracks: more than any camera or editor writes.
const MAX_TRACKS: usize = 256;

/// Handler of video tracks.
pub(super) const VIDEO: FourCc = *b"vide";
/// Handler of sound.
pub(super) const SOUND: FourCc = *b"soun";
/// Handlers of subtitles and captions.
const SUBTITLES: [FourCc; 4] = [*b"sbtl", *b"subt", *b"text", *b"clcp"];

/// The index of a file.
pub(super) struct Movie {
    /// Content of `moov`.
    pub(super) bytes: Vec<u8>,
    /// Ticks a second of edit lists.
    pub(super) timescale: u32,
    pub(super) tracks: Vec<Track>,
    /// Length of the file.
    pub(super) file_length: u64,
    _memory: Reservation,
}

/// One track.
pub(super) struct Track {
    pub(super) id: u32,
    pub(super) handler: FourCc,
    /// Ticks a second.
    pub(super) timescale: u32,
    /// Packed code of ISO 639.
    pub(super) language: u16,
    pub(super) matrix: [i32; 9],
    /// Last 52 bytes of `tkhd`: layer, group, volume, matrix and size.
    pub(super) presentation: Range<usize>,
    pub(super) edits: Vec<Edit>,
    /// Content of `hdlr`.
    pub(super) handler_body: Range<usize>,
    /// Kind and content of the header of the media, such as `smhd`.
    pub(super) media_header: Option<(FourCc, Range<usize>)>,
    /// Content of `stsd`.
    pub(super) descriptions: Range<usize>,
    /// Sample entries.
    pub(super) entries: Vec<(FourCc, Range<usize>)>,
    /// True if all samples are in this file.
    pub(super) self_contained: bool,
    pub(super) tables: SampleTables,
    /// Samples of fragments, after those of the tables.
    pub(super) fragments: ReservedVec<Sample>,
}

/// A part of the presentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Edit {
    /// Length in ticks of the movie; zero for the rest of the track.
    pub(super) duration: u64,
    /// Start in ticks of the track; negative for a gap.
    pub(super) media_time: i64,
    /// True for the normal speed.
    pub(super) normal_speed: bool,
}

impl Movie {
    /// Reads the index.
    ///
    /// # Errors
    /// [`VideoError::Empty`], [`VideoError::UnknownFormat`] for another format, [`VideoError::Damaged`] without an index,
    /// [`VideoError::OverBudget`].
    pub(super) fn read(
        input: &mut dyn ReadSeek,
        memory: &MemoryBudget,
    ) -> Result<Self, VideoError> {
        let file_length = input.seek(SeekFrom::End(0))?;
        if file_length == 0 {
            return Err(VideoError::Empty);
        }
        let outer = atom::scan(input, file_length)?;
        if !outer.familiar {
            return Err(VideoError::UnknownFormat);
        }
        let Some((at, length)) = outer.moov else {
            return Err(damaged(
                "it has no index (atom `moov`): it was cut, or the recording was not finished",
            ));
        };
        let reservation = memory.reserve(length)?;
        let bytes = atom::read_body(input, at, length)?;
        let all = 0..bytes.len();
        let timescale = child(&bytes, all.clone(), *b"mvhd")
            .and_then(|body| read_timescale(&bytes[body]))
            .ok_or_else(|| damaged("the header of its index (atom `mvhd`) is missing or cut"))?;
        let tracks: Vec<Track> = children(&bytes, all)
            .filter(|(kind, _)| kind == b"trak")
            .take(MAX_TRACKS)
            .filter_map(|(_, body)| Track::parse(&bytes, body, file_length, memory))
            .collect();
        let mut movie = Self {
            bytes,
            timescale,
            tracks,
            file_length,
            _memory: reservation,
        };
        fragments::read(input, &mut movie, &outer.moofs, memory)?;
        Ok(movie)
    }

    /// The tracks other than the one at `video`, for people.
    pub(super) fn other_tracks(&self, video: Option<usize>) -> Vec<OtherTrack> {
        self.tracks
            .iter()
            .enumerate()
            .filter(|&(number, _)| Some(number) != video)
            .map(|(_, track)| track.describe())
            .collect()
    }

    /// The first video track that is no still picture of a cover.
    pub(super) fn video_track(&self) -> Option<usize> {
        self.tracks.iter().position(|track| track.handler == VIDEO)
    }

    /// The samples of a track in their order.
    pub(super) fn samples<'a>(&'a self, track: &'a Track) -> impl Iterator<Item = Sample> + 'a {
        let mut tables = Samples::new();
        std::iter::from_fn(move || tables.next(&self.bytes, &track.tables))
            .chain(track.fragments.iter().copied())
    }
}

/// Ticks a second in `mvhd` and `mdhd`.
fn read_timescale(body: &[u8]) -> Option<u32> {
    let mut fields = Fields(body);
    let (version, _) = fields.version()?;
    fields.take(if version == 0 { 8 } else { 16 })?;
    fields.u32().filter(|&timescale| timescale > 0)
}

impl Track {
    /// Reads a track; `None` without the parts that every track has.
    fn parse(
        bytes: &[u8],
        body: Range<usize>,
        file_length: u64,
        memory: &MemoryBudget,
    ) -> Option<Self> {
        let media = child(bytes, body.clone(), *b"mdia")?;
        let header = child(bytes, body.clone(), *b"tkhd")?;
        let media_clock = child(bytes, media.clone(), *b"mdhd")?;
        let handler_body = child(bytes, media.clone(), *b"hdlr")?;
        let information = child(bytes, media, *b"minf")?;
        let tables = child(bytes, information.clone(), *b"stbl")?;
        let descriptions = child(bytes, tables.clone(), *b"stsd")?;
        let (id, presentation) = read_header(bytes, header)?;
        let mut fields = Fields(bytes.get(presentation.clone())?);
        fields.take(8)?;
        let mut matrix = [0; 9];
        for entry in &mut matrix {
            *entry = fields.i32()?;
        }
        let edits = descendant(bytes, body, &[*b"edts", *b"elst"])
            .map_or_else(Vec::new, |list| read_edits(&bytes[list]));
        let (timescale, language) = read_media_clock(&bytes[media_clock])?;
        Some(Self {
            id,
            handler: *bytes.get(handler_body.clone())?.get(8..)?.first_chunk()?,
            timescale,
            language,
            matrix,
            presentation,
            edits,
            handler_body,
            media_header: children(bytes, information.clone())
                .find(|(kind, _)| matches!(kind, b"vmhd" | b"smhd" | b"nmhd" | b"sthd" | b"gmhd")),
            entries: children(
                bytes,
                (descriptions.start + 8).min(descriptions.end)..descriptions.end,
            )
            .collect(),
            descriptions,
            self_contained: descendant(bytes, information, &[*b"dinf", *b"dref"])
                .is_none_or(|list| is_self_contained(bytes, list)),
            tables: SampleTables::find(bytes, tables, file_length),
            fragments: ReservedVec::new(memory),
        })
    }

    /// Name of the codec.
    pub(super) fn codec(&self) -> String {
        self.entries.first().map_or_else(
            || "unknown".to_owned(),
            |(kind, _)| match kind {
                b"avc1" | b"avc2" | b"avc3" | b"avc4" => "h264".to_owned(),
                b"hvc1" | b"hev1" | b"dvh1" | b"dvhe" => "hevc".to_owned(),
                b"av01" => "av1".to_owned(),
                b"vp08" => "vp8".to_owned(),
                b"vp09" => "vp9".to_owned(),
                b"apch" | b"apcn" | b"apcs" | b"apco" | b"ap4h" | b"ap4x" => "prores".to_owned(),
                b"mp4v" => "mpeg4".to_owned(),
                b"jpeg" | b"mjpa" | b"mjpb" => "mjpeg".to_owned(),
                b"mp4a" => "aac".to_owned(),
                b".mp3" => "mp3".to_owned(),
                b"Opus" => "opus".to_owned(),
                b"fLaC" => "flac".to_owned(),
                b"ac-3" => "ac3".to_owned(),
                b"ec-3" => "eac3".to_owned(),
                b"tx3g" => "mov_text".to_owned(),
                kind => text_of(*kind).trim().to_owned(),
            },
        )
    }

    pub(super) fn describe(&self) -> OtherTrack {
        OtherTrack {
            kind: match self.handler {
                SOUND => TrackKind::Audio,
                handler if SUBTITLES.contains(&handler) => TrackKind::Subtitles,
                _ => TrackKind::Data,
            },
            codec: self.codec(),
            language: language_of(self.language),
        }
    }

    /// True for sound and subtitles, whose samples are in the file.
    pub(super) fn can_be_copied(&self) -> bool {
        let kind = self.describe().kind;
        kind != TrackKind::Data && self.self_contained && !self.entries.is_empty()
    }
}

/// Number, and place of the fields after the times.
fn read_header(bytes: &[u8], header: Range<usize>) -> Option<(u32, Range<usize>)> {
    let mut fields = Fields(&bytes[header.clone()]);
    let (version, _) = fields.version()?;
    fields.by_version(version)?;
    fields.by_version(version)?;
    let id = fields.u32()?;
    fields.u32()?;
    fields.by_version(version)?;
    fields.take(8)?;
    let start = header.end - fields.0.len();
    fields.take(52)?;
    Some((id, start..start + 52))
}

fn read_media_clock(body: &[u8]) -> Option<(u32, u16)> {
    let timescale = read_timescale(body)?;
    let language = if body[0] == 0 { 20 } else { 32 };
    let code = body.get(language..)?.first_chunk()?;
    Some((timescale, u16::from_be_bytes(*code)))
}

/// The three letters of a packed code; `None` for "undetermined" and codes of old QuickTime.
fn language_of(packed: u16) -> Option<String> {
    let letters: String = [10, 5, 0]
        .map(|shift| char::from(0x60 + (packed >> shift & 31) as u8))
        .iter()
        .collect();
    let known = letters.chars().all(|letter| letter.is_ascii_lowercase()) && letters != "und";
    known.then_some(letters)
}

fn read_edits(body: &[u8]) -> Vec<Edit> {
    let mut fields = Fields(body);
    let (Some((version, _)), Some(count)) = (fields.version(), fields.u32()) else {
        return Vec::new();
    };
    (0..count)
        .map_while(|_| {
            let duration = fields.by_version(version)?;
            let media_time = if version == 0 {
                i64::from(fields.i32()?)
            } else {
                fields.u64()? as i64
            };
            Some(Edit {
                duration,
                media_time,
                normal_speed: fields.u32()? == 0x0001_0000,
            })
        })
        .collect()
}

fn is_self_contained(bytes: &[u8], list: Range<usize>) -> bool {
    children(bytes, (list.start + 8).min(list.end)..list.end)
        .all(|(_, entry)| bytes[entry].get(3).is_some_and(|flags| flags & 1 == 1))
}
