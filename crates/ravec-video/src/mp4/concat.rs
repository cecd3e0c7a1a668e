//! Files of the writer, one after the other in one file.

use super::ReadSeek;
use super::atom::damaged;
use super::copy::CopiedTracks;
use super::movie::{Movie, Track};
use super::mux::{Muxer, VideoHeader};
use crate::error::VideoError;
use crate::limits::VideoLimits;
use ravec_progress::Progress;
use std::fs::File;
use std::io::{Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Joins clips of [`Mp4Writer`](super::Mp4Writer) without encoding anew: frames, stamps and parameter sets stay as they are.
///
/// All chunks have the same size, quality and time base, and their stamps go on from one to the next, as those of one clip
/// that was written in parts. The bytes of the output depend only on the chunks and the copied tracks; one chunk alone gives
/// itself.
///
/// # Errors
/// [`VideoError::Options`] without chunks or if they do not fit together, [`VideoError::Damaged`] for a chunk that is cut,
/// each with its path; [`VideoError::Cancelled`]; [`VideoError::Io`].
pub fn concatenate<W: Write + Seek>(
    chunks: &[PathBuf],
    output: W,
    copied: Option<CopiedTracks>,
    limits: &VideoLimits,
    progress: &Progress,
) -> Result<W, VideoError> {
    let mut joined: Option<Joined<W>> = None;
    let mut output = Some(output);
    let mut copied = copied;
    let phase = progress.phase("join", chunks.len() as u64);
    for path in chunks {
        let mut chunk = Chunk::open(path, limits)?;
        let joined = match (&mut joined, output.take()) {
            (Some(joined), _) => joined,
            (empty, Some(output)) => {
                let mut muxer = Muxer::new(output, chunk.track().timescale)?;
                if let Some(copied) = copied.take() {
                    muxer.copy_tracks(copied);
                }
                empty.insert(Joined {
                    muxer,
                    header: chunk.header(),
                    timescale: chunk.track().timescale,
                    last: 0,
                })
            }
            (None, None) => unreachable!("the first chunk takes the output"),
        };
        joined.append(&mut chunk, path, progress)?;
        phase.advance(1);
    }
    let Some(joined) = joined else {
        return Err(VideoError::Options(
            "there are no chunks to join".to_owned(),
        ));
    };
    joined.muxer.finish(&joined.header, joined.last)
}

/// The clip so far.
struct Joined<W: Write + Seek> {
    muxer: Muxer<W>,
    header: VideoHeader,
    timescale: u32,
    /// Duration of the last frame.
    last: u64,
}

impl<W: Write + Seek> Joined<W> {
    fn append(
        &mut self,
        chunk: &mut Chunk,
        path: &Path,
        progress: &Progress,
    ) -> Result<(), VideoError> {
        if chunk.header() != self.header || chunk.track().timescale != self.timescale {
            return Err(VideoError::Options(format!(
                "the chunk {} was written with other settings than the first one",
                path.display()
            )));
        }
        let mut sample_bytes = Vec::new();
        let start = chunk.start();
        let track = &chunk.movie.tracks[chunk.number];
        for (number, sample) in chunk.movie.samples(track).enumerate() {
            if number % 64 == 0 {
                progress.check()?;
            }
            if sample.end() > chunk.movie.file_length || number == 0 && !sample.sync() {
                return Err(cut(path));
            }
            chunk.input.seek(SeekFrom::Start(sample.offset))?;
            sample_bytes.clear();
            (&mut chunk.input)
                .take(u64::from(sample.size))
                .read_to_end(&mut sample_bytes)?;
            self.muxer.push(
                &sample_bytes,
                start.saturating_add(sample.decoded),
                sample.sync(),
            )?;
            self.last = u64::from(sample.duration);
        }
        Ok(())
    }
}

/// A file of the writer.
struct Chunk {
    input: Box<dyn ReadSeek>,
    movie: Movie,
    number: usize,
}

impl Chunk {
    fn open(path: &Path, limits: &VideoLimits) -> Result<Self, VideoError> {
        let mut input: Box<dyn ReadSeek> = Box::new(File::open(path)?);
        let movie =
            Movie::read(&mut *input, &limits.pictures.memory).map_err(|error| match error {
                VideoError::Damaged { .. } | VideoError::Empty | VideoError::UnknownFormat => {
                    cut(path)
                }
                other => other,
            })?;
        let number = movie.video_track().ok_or_else(|| cut(path))?;
        Ok(Self {
            input,
            movie,
            number,
        })
    }

    fn track(&self) -> &Track {
        &self.movie.tracks[self.number]
    }

    fn header(&self) -> VideoHeader {
        let track = self.track();
        VideoHeader {
            descriptions: self.movie.bytes[track.descriptions.clone()].to_vec(),
            presentation: self.movie.bytes[track.presentation.clone()].to_vec(),
        }
    }

    /// Ticks before the first frame: the writer uses one clock for the movie and the track.
    fn start(&self) -> i64 {
        let gaps = self.track().edits.iter().filter(|edit| edit.media_time < 0);
        gaps.fold(0, |sum, edit| sum.saturating_add_unsigned(edit.duration))
    }
}

fn cut(path: &Path) -> VideoError {
    damaged(format!(
        "the chunk {} is no whole clip of this program",
        path.display()
    ))
}
