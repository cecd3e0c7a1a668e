//! A file that grows: samples first, then the index.

use super::atom::FourCc;
use super::copy::CopiedTracks;
use super::matrix::UPRIGHT;
use super::write::{TableBuilder, atom, full_atom, words};
use crate::color::ColorInfo;
use crate::error::VideoError;
use crate::h264::AvcConfig;
use crate::time::Rational;
use ravec_raster::Size;
use std::io::{BufWriter, Seek, SeekFrom, Write};

/// The first atom, of constant content.
const FILE_TYPE: &[u8; 32] = b"\0\0\0\x20ftypisom\0\0\x02\0isomiso2avc1mp41";

/// Bytes of video after which a chunk ends, if a second is not over before.
const MAX_CHUNK_BYTES: usize = 4 << 20;

/// Language code "undetermined".
const UNDETERMINED: u16 = 0x55c4;

/// Properties of the video track that its index states.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VideoHeader {
    /// Content of `stsd`.
    pub(super) descriptions: Vec<u8>,
    /// Last 52 bytes of `tkhd`.
    pub(super) presentation: Vec<u8>,
}

impl VideoHeader {
    /// The header of a track of frames of a size.
    pub(super) fn new(
        config: &AvcConfig,
        size: Size,
        color: ColorInfo,
        pixel_aspect: Rational,
    ) -> Self {
        // the coded frame is cropped to even sides by its parameter set, and by `clap` to odd ones
        let even = [size.width(), size.height()].map(|side| side.next_multiple_of(2));
        let mut descriptions = Vec::new();
        words(&mut descriptions, &[0, 1]);
        atom(&mut descriptions, *b"avc1", |out| {
            out.extend([0, 0, 0, 0, 0, 0, 0, 1]);
            out.extend([0; 16]);
            for side in even {
                out.extend((side as u16).to_be_bytes());
            }
            // 72 pixels an inch, one frame a sample
            words(out, &[0x0048_0000, 0x0048_0000, 0]);
            out.extend([0, 1]);
            // no name of a compressor
            out.extend([0; 32]);
            out.extend([0, 24, 0xff, 0xff]);
            atom(out, *b"avcC", |out| out.extend(config.to_record()));
            if color.tagged {
                atom(out, *b"colr", |out| {
                    out.extend(b"nclx");
                    for code in [color.primaries, color.transfer, color.matrix_code()] {
                        out.extend([0, code]);
                    }
                    out.push(u8::from(color.range == crate::color::Range::Full) << 7);
                });
            }
            if pixel_aspect.num() != pixel_aspect.den() {
                atom(out, *b"pasp", |out| {
                    words(out, &[pixel_aspect.num(), pixel_aspect.den()]);
                });
            }
            if even != [size.width(), size.height()] {
                atom(out, *b"clap", |out| {
                    let (width, height) = (size.width() as u32, size.height() as u32);
                    let offset = |side: u32, even: usize| side.wrapping_sub(even as u32);
                    words(out, &[width, 1, height, 1]);
                    words(
                        out,
                        &[offset(width, even[0]), 2, offset(height, even[1]), 2],
                    );
                });
            }
        });
        let mut presentation = vec![0; 8];
        words(&mut presentation, &UPRIGHT.map(|entry| entry as u32));
        let width = size.width() as f64 * pixel_aspect.to_f64() * 65536.0;
        words(
            &mut presentation,
            &[width.round() as u32, (size.height() as u32) << 16],
        );
        Self {
            descriptions,
            presentation,
        }
    }
}

/// A sample whose duration is known when the next one comes.
struct Last {
    size: u32,
    start: i64,
    sync: bool,
}

/// Writes samples of video and copied tracks, and at the end their index.
pub(super) struct Muxer<W: Write + Seek> {
    output: BufWriter<W>,
    position: u64,
    /// Ticks a second of the video and of the movie.
    timescale: u32,
    tables: TableBuilder,
    first_start: i64,
    last: Option<Last>,
    chunk: Vec<u8>,
    /// Samples of the chunk: sizes are in the tables when durations are known.
    chunk_start: i64,
    copied: Option<CopiedTracks>,
}

impl<W: Write + Seek> Muxer<W> {
    /// Begins a file.
    pub(super) fn new(output: W, timescale: u32) -> Result<Self, VideoError> {
        let mut output = BufWriter::new(output);
        output.write_all(FILE_TYPE)?;
        // the length of the samples is written at the end
        output.write_all(b"\0\0\0\x01mdat\0\0\0\0\0\0\0\0")?;
        Ok(Self {
            output,
            position: FILE_TYPE.len() as u64 + 16,
            timescale,
            tables: TableBuilder::default(),
            first_start: 0,
            last: None,
            chunk: Vec::new(),
            chunk_start: 0,
            copied: None,
        })
    }

    /// Brings tracks along.
    pub(super) fn copy_tracks(&mut self, tracks: CopiedTracks) {
        self.copied = Some(tracks);
    }

    /// Appends a sample of video that is shown from `start` on.
    ///
    /// # Errors
    /// [`VideoError::Options`] for a start before that of the last sample, or longer after it than the format can say.
    pub(super) fn push(&mut self, sample: &[u8], start: i64, sync: bool) -> Result<(), VideoError> {
        match self.last.take() {
            None => {
                (self.first_start, self.chunk_start) = (start, start);
                self.tables.open_chunk(self.position, 1);
            }
            Some(last) => {
                let duration = start.checked_sub(last.start).map(u32::try_from);
                let Some(Ok(duration)) = duration else {
                    return Err(VideoError::Options(format!(
                        "a frame at {start} ticks cannot follow one at {} ticks in an MP4 file",
                        last.start
                    )));
                };
                self.tables.push(last.size, duration, 0, last.sync);
                let over = start.saturating_sub(self.chunk_start) >= i64::from(self.timescale);
                if over || self.chunk.len() >= MAX_CHUNK_BYTES {
                    self.flush(start)?;
                }
            }
        }
        let size = u32::try_from(sample.len())
            .map_err(|_| VideoError::Options("a frame needs more than 4 GiB".to_owned()))?;
        self.chunk.extend_from_slice(sample);
        self.last = Some(Last { size, start, sync });
        Ok(())
    }

    /// Writes the chunk, and what belongs beside it of copied tracks, before a frame at `next` ticks.
    fn flush(&mut self, next: i64) -> Result<(), VideoError> {
        self.write_chunk()?;
        let until = (next.saturating_sub(self.origin())) as f64 / f64::from(self.timescale);
        if let Some(copied) = &mut self.copied {
            copied.write_until(until, &mut self.output, &mut self.position)?;
        }
        self.chunk_start = next;
        self.tables.open_chunk(self.position, 1);
        Ok(())
    }

    fn write_chunk(&mut self) -> Result<(), VideoError> {
        self.output.write_all(&self.chunk)?;
        self.position += self.chunk.len() as u64;
        self.chunk.clear();
        Ok(())
    }

    /// The ticks that are the start of the presentation: frames before zero move it.
    fn origin(&self) -> i64 {
        self.first_start.min(0)
    }

    /// Completes the file; the last sample is shown for `last_duration` ticks. Without samples there is no index.
    pub(super) fn finish(
        mut self,
        header: &VideoHeader,
        last_duration: u64,
    ) -> Result<W, VideoError> {
        if let Some(last) = self.last.take() {
            let duration = u32::try_from(last_duration).unwrap_or(u32::MAX);
            self.tables.push(last.size, duration, 0, last.sync);
        }
        self.write_chunk()?;
        if let Some(copied) = &mut self.copied {
            copied.write_until(f64::INFINITY, &mut self.output, &mut self.position)?;
        }
        let index = self.index(header);
        self.output.write_all(&index)?;
        let samples = self.position - FILE_TYPE.len() as u64;
        self.output
            .seek(SeekFrom::Start(FILE_TYPE.len() as u64 + 8))?;
        self.output.write_all(&samples.to_be_bytes())?;
        self.output.seek(SeekFrom::End(0))?;
        self.output
            .into_inner()
            .map_err(|error| VideoError::Io(error.into_error()))
    }

    /// The atom `moov`.
    fn index(&self, header: &VideoHeader) -> Vec<u8> {
        let delay = (self.first_start - self.origin()) as u64;
        let video = TrackIndex {
            id: 1,
            timescale: self.timescale,
            language: UNDETERMINED,
            handler: handler(*b"vide"),
            media_header: (*b"vmhd", vec![0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
            presentation: header.presentation.clone(),
            descriptions: header.descriptions.clone(),
            tables: &self.tables,
            delay,
            media_start: 0,
            shown: self.tables.duration,
        };
        let copied = self
            .copied
            .as_ref()
            .map_or_else(Vec::new, |copied| copied.indices(self.timescale));
        let tracks: Vec<TrackIndex> = std::iter::once(video).chain(copied).collect();
        let duration = tracks.iter().map(TrackIndex::end).max().unwrap_or(0);
        let mut out = Vec::new();
        atom(&mut out, *b"moov", |out| {
            full_atom(out, *b"mvhd", (1, 0), |out| {
                out.extend([0; 16]);
                words(out, &[self.timescale]);
                out.extend(duration.to_be_bytes());
                // normal speed and volume
                words(out, &[0x0001_0000, 0x0100_0000, 0, 0]);
                words(out, &UPRIGHT.map(|entry| entry as u32));
                words(out, &[0; 6]);
                words(out, &[tracks.len() as u32 + 1]);
            });
            for track in &tracks {
                track.write(out);
            }
        });
        out
    }
}

/// The content of `hdlr` for a kind of media.
fn handler(kind: FourCc) -> Vec<u8> {
    let mut body = vec![0; 8];
    body.extend(kind);
    body.extend([0; 13]);
    body
}

/// Statements of the index on a track.
pub(super) struct TrackIndex<'a> {
    pub(super) id: u32,
    pub(super) timescale: u32,
    pub(super) language: u16,
    /// Content of `hdlr`.
    pub(super) handler: Vec<u8>,
    pub(super) media_header: (FourCc, Vec<u8>),
    pub(super) presentation: Vec<u8>,
    pub(super) descriptions: Vec<u8>,
    pub(super) tables: &'a TableBuilder,
    /// Ticks of the movie before the track begins.
    pub(super) delay: u64,
    /// Ticks of the track that are left out at its start.
    pub(super) media_start: u64,
    /// Ticks of the movie for which the track is on.
    pub(super) shown: u64,
}

impl TrackIndex<'_> {
    fn end(&self) -> u64 {
        self.delay + self.shown
    }

    fn write(&self, out: &mut Vec<u8>) {
        atom(out, *b"trak", |out| {
            // enabled, and part of the presentation
            full_atom(out, *b"tkhd", (1, 3), |out| {
                out.extend([0; 16]);
                words(out, &[self.id, 0]);
                out.extend(self.end().to_be_bytes());
                out.extend([0; 8]);
                out.extend(&self.presentation);
            });
            if self.delay > 0 || self.media_start > 0 {
                self.write_edits(out);
            }
            atom(out, *b"mdia", |out| {
                full_atom(out, *b"mdhd", (1, 0), |out| {
                    out.extend([0; 16]);
                    words(out, &[self.timescale]);
                    out.extend(self.tables.duration.to_be_bytes());
                    out.extend(self.language.to_be_bytes());
                    out.extend([0; 2]);
                });
                atom(out, *b"hdlr", |out| out.extend(&self.handler));
                atom(out, *b"minf", |out| {
                    atom(out, self.media_header.0, |out| {
                        out.extend(&self.media_header.1);
                    });
                    atom(out, *b"dinf", |out| {
                        full_atom(out, *b"dref", (0, 0), |out| {
                            words(out, &[1]);
                            // the samples are in this file
                            full_atom(out, *b"url ", (0, 1), |_| {});
                        });
                    });
                    self.tables.write(out, &self.descriptions);
                });
            });
        });
    }

    fn write_edits(&self, out: &mut Vec<u8>) {
        let mut edits = Vec::new();
        if self.delay > 0 {
            edits.push((self.delay, u64::MAX));
        }
        edits.push((self.shown, self.media_start));
        atom(out, *b"edts", |out| {
            full_atom(out, *b"elst", (1, 0), |out| {
                words(out, &[edits.len() as u32]);
                for (duration, media_time) in &edits {
                    out.extend(duration.to_be_bytes());
                    out.extend(media_time.to_be_bytes());
                    words(out, &[0x0001_0000]);
                }
            });
        });
    }
}
