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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mp4::Mp4Writer;
    use crate::{
        ColorInfo, EncodeOptions, Frame, FramePicture, FrameSink as _, FrameTime, PixelKind,
        Rational, SamplePlane, SinkFormat, YuvFormat, YuvImage,
    };
    use ravec_memory::MemoryBudget;
    use ravec_raster::Size;
    use std::io::{Cursor, Seek as _};

    fn fixture(name: &str) -> Vec<u8> {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
        std::fs::read(folder.join(name)).unwrap()
    }

    /// A gray clip of some seconds with the tracks of a file.
    fn written(tracks: CopiedTracks, seconds: i64) -> Vec<u8> {
        let size = Size::new(16, 16).unwrap();
        let color = ColorInfo::guess(16);
        let format = SinkFormat {
            size,
            pixels: PixelKind::Yuv {
                format: YuvFormat::YUV420P8,
                color,
            },
            time_base: Rational::new(1, 1000).unwrap(),
            rate: None,
            pixel_aspect: Rational::ONE,
        };
        let planes = YuvFormat::YUV420P8
            .plane_sizes(size)
            .into_iter()
            .map(|size| SamplePlane::new(size, 8, 128))
            .collect();
        let picture = YuvImage::new(YuvFormat::YUV420P8, color, planes).unwrap();
        let output = Cursor::new(Vec::new());
        let mut writer = Mp4Writer::new(output, &format, &EncodeOptions::default()).unwrap();
        writer.copy_tracks(tracks);
        for number in 0..4 * seconds {
            let time = FrameTime {
                start: number * 250,
                duration: 250,
            };
            let picture = FramePicture::Yuv(picture.clone());
            writer.write(&Frame { picture, time }).unwrap();
        }
        writer.complete().unwrap().into_inner()
    }

    /// Time of display in seconds, bytes, and time of decoding in ticks of each sample of the sound of a file.
    struct Sound {
        samples: Vec<(f64, Vec<u8>, i64)>,
        descriptions: Vec<u8>,
        timescale: u32,
        language: u16,
    }

    fn sound_of(bytes: &[u8]) -> Sound {
        let mut input = Cursor::new(bytes.to_vec());
        let movie = Movie::read(&mut input, &MemoryBudget::unlimited()).unwrap();
        let track = movie
            .tracks
            .iter()
            .find(|track| track.handler == SOUND)
            .unwrap();
        let (delay, media_start, _) = shown_part(&movie, track).unwrap();
        let delay = delay as f64 / f64::from(movie.timescale);
        let samples = movie
            .samples(track)
            .map(|sample| {
                input.seek(SeekFrom::Start(sample.offset)).unwrap();
                let mut data = vec![0; sample.size as usize];
                input.read_exact(&mut data).unwrap();
                let ticks = (sample.shown() - media_start) as f64;
                let shown = ticks / f64::from(track.timescale) + delay;
                (shown, data, sample.decoded)
            })
            .collect();
        Sound {
            samples,
            descriptions: movie.bytes[track.descriptions.clone()].to_vec(),
            timescale: track.timescale,
            language: track.language,
        }
    }

    fn open(bytes: Vec<u8>, start: f64, end: Option<f64>) -> CopiedTracks {
        let limits = VideoLimits::default();
        CopiedTracks::open(Cursor::new(bytes), &limits, start, end).unwrap()
    }

    #[test]
    fn a_whole_track_is_copied_byte_for_byte() {
        for name in ["vfr.mp4", "fragments.mp4", "sound.m4a"] {
            let source = fixture(name);
            let tracks = open(source.clone(), 0.0, None);
            assert_eq!((tracks.count(), tracks.left_out().len()), (1, 0), "{name}");
            let wanted = sound_of(&source);
            let found = sound_of(&written(tracks, 2));
            assert_eq!(found.descriptions, wanted.descriptions, "{name}");
            assert_eq!(found.timescale, wanted.timescale, "{name}");
            assert_eq!(found.language, wanted.language, "{name}");
            assert_eq!(found.samples.len(), wanted.samples.len(), "{name}");
            for (found, wanted) in found.samples.iter().zip(&wanted.samples) {
                assert_eq!(found.1, wanted.1, "{name}");
                assert!(
                    (found.0 - wanted.0).abs() < 1e-3,
                    "{name} {} {}",
                    found.0,
                    wanted.0
                );
            }
        }
    }

    #[test]
    fn a_part_of_a_track_stays_in_time_with_the_frames() {
        let source = fixture("vfr.mp4");
        let wanted = sound_of(&source);
        for (start, end) in [
            (0.0, Some(0.5)),
            (0.3, Some(0.7)),
            (0.55, None),
            (0.131, Some(0.132)),
        ] {
            let found = sound_of(&written(open(source.clone(), start, end), 1));
            let first = found.samples.first().unwrap();
            let at = wanted
                .samples
                .iter()
                .position(|sample| sample.1 == first.1)
                .unwrap();
            for (found, wanted) in found.samples.iter().zip(&wanted.samples[at..]) {
                assert_eq!(found.1, wanted.1);
                assert!(
                    (found.0 - (wanted.0 - start)).abs() < 1e-3,
                    "{start}: {} {}",
                    found.0,
                    wanted.0
                );
            }
            // all of the part is there: up to its end, and one sample before its start for the decoder
            let covered = found.samples.last().unwrap();
            let all = wanted.samples.last().unwrap().0;
            let last = end.unwrap_or(f64::MAX).min(all) - start;
            assert!(
                covered.0 >= last - 1024.0 / f64::from(found.timescale),
                "{start}"
            );
            assert!(
                first.0 <= 0.0 && (at == 0 || first.0 <= -1000.0 / f64::from(found.timescale)),
                "{start}"
            );
        }
    }

    #[test]
    fn a_part_after_the_end_of_a_track_has_no_samples() {
        let found = sound_of(&written(open(fixture("vfr.mp4"), 50.0, None), 1));
        assert!(found.samples.is_empty());
    }

    #[test]
    fn a_cut_file_gives_the_samples_that_it_has() {
        let source = fixture("fragments.mp4");
        let wanted = sound_of(&source);
        let cut = source[..source.len() / 2].to_vec();
        let found = sound_of(&written(open(cut, 0.0, None), 1));
        assert!(found.samples.len() < wanted.samples.len());
        for (found, wanted) in found.samples.iter().zip(&wanted.samples) {
            assert_eq!(found.1, wanted.1);
        }
    }
}
