//! Sound and subtitles of a file, brought into another one byte for byte.

use super::ReadSeek;
use super::movie::{Movie, SOUND, Track};
use super::mux::TrackIndex;
use super::samples::{Sample, Samples};
use super::write::TableBuilder;
use crate::error::VideoError;
use crate::info::OtherTrack;
use crate::limits::VideoLimits;
use std::io::{Read as _, SeekFrom, Write};

/// Bytes that are read at once.
const BLOCK: u64 = 1 << 16;

/// Sound and subtitles of a part of a file, to be written beside new frames.
///
/// Sample entries, samples, clocks and languages stay as they are. The part is cut at whole samples: an edit list leaves out
/// what lies before its start, so that sound and frames stay together to the tick. Sound gets one more sample before the start,
/// because decoders need it.
///
/// Tracks of other kinds, tracks whose samples are in other files, and tracks whose edit list has several parts are left out;
/// [`left_out`](Self::left_out) names them. Samples that a damaged file lacks are left out at the end.
pub struct CopiedTracks {
    input: Box<dyn ReadSeek>,
    movie: Movie,
    tracks: Vec<CopiedTrack>,
    left_out: Vec<OtherTrack>,
}

struct CopiedTrack {
    /// Number among the tracks of the movie.
    number: usize,
    walk: Walk,
    /// The next sample to be written.
    next: Option<Sample>,
    tables: TableBuilder,
    /// Ticks of the track at which the part begins.
    from: i64,
    /// Ticks of the track at which the part ends.
    to: i64,
    /// Seconds of the part before the track begins.
    delay: f64,
    /// Time of decoding of the first sample that is written.
    first: Option<i64>,
    /// End of display of the last sample that is written.
    end: i64,
}

impl CopiedTracks {
    /// Opens the tracks of an MP4 or QuickTime file for the part from `start` to `end`, in seconds of its presentation; to its
    /// end if `None`. The start becomes second zero of the clip that is written.
    ///
    /// # Errors
    /// As [`Mp4Source::open`](super::Mp4Source::open), except that no video is needed.
    pub fn open(
        input: impl std::io::Read + std::io::Seek + Send + 'static,
        limits: &VideoLimits,
        start: f64,
        end: Option<f64>,
    ) -> Result<Self, VideoError> {
        let mut input: Box<dyn ReadSeek> = Box::new(input);
        let movie = Movie::read(&mut *input, &limits.pictures.memory)?;
        let mut tracks = Vec::new();
        let mut left_out = Vec::new();
        let video = movie.video_track();
        for (number, track) in movie.tracks.iter().enumerate() {
            if Some(number) == video {
                continue;
            }
            match CopiedTrack::new(&movie, number, start.max(0.0), end) {
                Some(track) => tracks.push(track),
                None => left_out.push(track.describe()),
            }
        }
        Ok(Self {
            input,
            movie,
            tracks,
            left_out,
        })
    }

    /// Number of tracks that are copied.
    pub fn count(&self) -> usize {
        self.tracks.len()
    }

    /// Tracks beside the video that are not copied.
    pub fn left_out(&self) -> &[OtherTrack] {
        &self.left_out
    }

    /// Writes all samples that begin before a second of the part, a chunk for each track.
    pub(super) fn write_until(
        &mut self,
        second: f64,
        output: &mut impl Write,
        position: &mut u64,
    ) -> Result<(), VideoError> {
        for track in &mut self.tracks {
            let limit = track.tick_of(&self.movie, second);
            track.write_until(limit, (&self.movie, &mut *self.input), output, position)?;
        }
        Ok(())
    }

    /// The index entries of the tracks, for a movie with a clock.
    pub(super) fn indices(&self, timescale: u32) -> Vec<TrackIndex<'_>> {
        self.tracks
            .iter()
            .enumerate()
            .map(|(at, track)| track.index(&self.movie, at as u32 + 2, timescale))
            .collect()
    }
}

/// A walk over tables and then fragments.
#[derive(Clone)]
struct Walk {
    tables: Samples,
    in_tables: bool,
    fragment: usize,
}

impl Walk {
    fn next(&mut self, movie: &Movie, track: &Track) -> Option<Sample> {
        if self.in_tables {
            if let Some(sample) = self.tables.next(&movie.bytes, &track.tables) {
                return Some(sample);
            }
            self.in_tables = false;
        }
        let sample = track.fragments.get(self.fragment).copied();
        self.fragment += 1;
        sample
    }
}

/// The gap before a track in ticks of the movie, and the part that it shows in ticks of its own.
fn shown_part(movie: &Movie, track: &Track) -> Option<(u64, i64, i64)> {
    let gaps = track
        .edits
        .iter()
        .take_while(|edit| edit.media_time < 0)
        .count();
    let delay = track.edits[..gaps]
        .iter()
        .fold(0u64, |sum, edit| sum.saturating_add(edit.duration));
    match track.edits[gaps..] {
        [] if gaps > 0 => None,
        [] => Some((0, 0, i64::MAX)),
        [edit] if edit.normal_speed => {
            let length = u128::from(edit.duration) * u128::from(track.timescale);
            let length = length.div_ceil(u128::from(movie.timescale));
            let to = match i64::try_from(length) {
                Ok(length) if length > 0 => edit.media_time.saturating_add(length),
                _ => i64::MAX,
            };
            Some((delay, edit.media_time, to))
        }
        _ => None,
    }
}

impl CopiedTrack {
    fn new(movie: &Movie, number: usize, start: f64, end: Option<f64>) -> Option<Self> {
        let track = &movie.tracks[number];
        if !track.can_be_copied() {
            return None;
        }
        let (delay, media_start, media_end) = shown_part(movie, track)?;
        let delay = delay as f64 / f64::from(movie.timescale);
        let clock = f64::from(track.timescale);
        let tick = |second: f64| {
            media_start.saturating_add(((second - delay).max(0.0) * clock).round() as i64)
        };
        let mut copied = Self {
            number,
            walk: Walk {
                tables: Samples::new(),
                in_tables: true,
                fragment: 0,
            },
            next: None,
            tables: TableBuilder::default(),
            from: tick(start),
            to: end.map_or(media_end, |end| tick(end).min(media_end)),
            delay: (delay - start).max(0.0),
            first: None,
            end: 0,
        };
        copied.find_start(movie);
        Some(copied)
    }

    /// Steps to the first sample of the part, or the one before for sound.
    fn find_start(&mut self, movie: &Movie) {
        let track = &movie.tracks[self.number];
        let mut before = self.walk.clone();
        let mut at = self.walk.clone();
        loop {
            let here = at.clone();
            let Some(sample) = at.next(movie, track) else {
                break;
            };
            if sample.shown().saturating_add(i64::from(sample.duration)) > self.from {
                self.walk = if track.handler == SOUND { before } else { here };
                self.advance(movie);
                return;
            }
            before = here;
        }
        self.next = None;
    }

    /// Makes the next sample of the part the next one to be written.
    fn advance(&mut self, movie: &Movie) {
        self.next = self
            .walk
            .next(movie, &movie.tracks[self.number])
            .filter(|sample| sample.shown() < self.to && sample.end() <= movie.file_length);
    }

    /// The tick of the track at a second of the part.
    fn tick_of(&self, movie: &Movie, second: f64) -> i64 {
        let clock = f64::from(movie.tracks[self.number].timescale);
        self.from
            .saturating_add(((second - self.delay) * clock).round() as i64)
    }

    fn write_until(
        &mut self,
        limit: i64,
        (movie, input): (&Movie, &mut dyn ReadSeek),
        output: &mut impl Write,
        position: &mut u64,
    ) -> Result<(), VideoError> {
        let mut entry = None;
        while let Some(first) = self.next.filter(|sample| sample.shown() < limit) {
            if entry != Some(first.entry()) {
                self.tables.open_chunk(*position, first.entry());
                entry = Some(first.entry());
            }
            // samples that follow one another in the file are read at once
            let mut end = first.offset;
            while let Some(sample) = self.next.filter(|sample| {
                let follows = sample.offset == end && sample.entry() == first.entry();
                let fits = end == first.offset || sample.end() - first.offset <= BLOCK;
                follows && fits && sample.shown() < limit
            }) {
                self.tables.push(
                    sample.size,
                    sample.duration,
                    sample.display_offset,
                    sample.sync(),
                );
                self.first.get_or_insert(sample.decoded);
                self.end = sample.shown().saturating_add(i64::from(sample.duration));
                end = sample.end();
                self.advance(movie);
            }
            input.seek(SeekFrom::Start(first.offset))?;
            let copied = std::io::copy(&mut (&mut *input).take(end - first.offset), output)?;
            if copied < end - first.offset {
                return Err(VideoError::Io(std::io::ErrorKind::UnexpectedEof.into()));
            }
            *position += copied;
        }
        Ok(())
    }

    fn index<'a>(&'a self, movie: &Movie, id: u32, timescale: u32) -> TrackIndex<'a> {
        let track = &movie.tracks[self.number];
        let first = self.first.unwrap_or(self.from);
        // a part that begins in a gap of the track begins later
        let gap = first.saturating_sub(self.from).max(0);
        let clock = f64::from(track.timescale);
        let movie_ticks = |seconds: f64| (seconds * f64::from(timescale)).round().max(0.0) as u64;
        let shown = self
            .end
            .min(self.to)
            .saturating_sub(self.from.max(first))
            .max(0);
        TrackIndex {
            id,
            timescale: track.timescale,
            language: track.language,
            handler: movie.bytes[track.handler_body.clone()].to_vec(),
            media_header: track.media_header.clone().map_or_else(
                || (*b"nmhd", vec![0; 4]),
                |(kind, body)| (kind, movie.bytes[body].to_vec()),
            ),
            presentation: movie.bytes[track.presentation.clone()].to_vec(),
            descriptions: movie.bytes[track.descriptions.clone()].to_vec(),
            tables: &self.tables,
            delay: movie_ticks(self.delay + gap as f64 / clock),
            media_start: self.from.saturating_sub(first).max(0) as u64,
            shown: movie_ticks(shown as f64 / clock),
        }
    }
}
