//! Writing of clips by the names of their outputs.

use crate::animation::{ApngSink, GifSink};
use crate::error::VideoError;
use crate::ffmpeg::{self, FfmpegSink, TrackExcerpt};
use crate::frame::{Frame, FramePicture};
use crate::info::{Container, TrackKind};
use crate::limits::VideoLimits;
#[cfg(feature = "h264")]
use crate::mp4::{self, Mp4Writer};
use crate::open::VIDEO_EXTENSIONS;
use crate::parts::{CHUNK_FRAMES, Parts};
use crate::pictures::{Pattern, PictureSink};
use crate::sink::{EncodeOptions, FrameSink, SinkFormat};
use crate::y4m::{Y4mSink, append_frames};
use ravec_files::{AtomicFile, is_stream};
use ravec_media::WriteOptions;
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, LinearRgba, with_image};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// Quality of encoders for which none is chosen.
pub const DEFAULT_QUALITY: u8 = 75;

/// Properties of a clip that is written, beside its frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CreateOptions {
    /// Codec and quality.
    pub encode: EncodeOptions,
    /// Number in the name of the first of numbered pictures (default 0).
    pub first_number: u64,
    /// True to go on from what an interrupted run of the same `key` has left.
    pub resume: bool,
    /// Text that is equal for runs which make the same clip: their inputs and parameters.
    pub key: String,
    /// Sound and subtitles to copy.
    pub tracks: Option<CopiedTracks>,
}

/// The clip whose sound and subtitles are copied.
#[derive(Debug, Clone, PartialEq)]
pub struct CopiedTracks {
    /// Its file.
    pub path: PathBuf,
    /// Seconds from its start to the first frame that is written.
    pub start_secs: f64,
    /// Seconds from its start to the end of the last frame; `None` for all.
    pub end_secs: Option<f64>,
}

/// The format that the name of an output selects.
///
/// # Errors
/// [`VideoError::UnknownExtension`].
pub fn container_for(path: &Path) -> Result<Container, VideoError> {
    if is_stream(path) {
        return Ok(Container::Y4m);
    }
    if Pattern::parse(path).is_some() {
        return Ok(Container::Pictures);
    }
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase();
    match extension.as_str() {
        "mp4" | "m4v" | "mov" => Ok(Container::Mp4),
        "y4m" => Ok(Container::Y4m),
        "gif" => Ok(Container::Gif),
        "png" | "apng" => Ok(Container::Apng),
        _ if VIDEO_EXTENSIONS.contains(&extension.as_str()) => Ok(Container::Ffmpeg),
        _ => Err(VideoError::UnknownExtension { extension }),
    }
}

/// True for the extension of QuickTime.
fn is_quicktime(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("mov"))
}

/// Writes a clip to a file, numbered pictures, or standard output: whole or not at all, except that whole chunks of an
/// interrupted run are kept for the next one.
pub struct ClipWriter {
    path: PathBuf,
    format: SinkFormat,
    options: CreateOptions,
    kind: Container,
    state: State,
    /// Frames that are in the output, those of earlier runs included.
    frames: u64,
    /// Frames of earlier runs.
    resumed: u64,
    warnings: Vec<String>,
}

enum State {
    /// One sink for all frames, with its file unless it has none.
    Single(Box<dyn FrameSink>, Option<AtomicFile>),
    /// A sink for each chunk.
    Chunked(Parts, Option<Box<dyn FrameSink>>),
    /// Pictures, of which the number is recorded now and then.
    Pictures(Parts, PictureSink),
}

impl ClipWriter {
    /// Begins a clip. The name selects the format: an extension, a pattern such as `out_%04d.png`, or `-` for Y4M to standard
    /// output.
    ///
    /// # Errors
    /// [`VideoError`] for options that the format does not have, and errors of the file system.
    pub fn create(
        path: &Path,
        format: &SinkFormat,
        options: &CreateOptions,
    ) -> Result<Self, VideoError> {
        let mut kind = container_for(path)?;
        // other codecs and lossless frames in MP4 need FFmpeg, and so does alpha in QuickTime, which gets ProRes 4444
        let other_codec = options
            .encode
            .codec
            .as_deref()
            .is_some_and(|codec| codec != "h264");
        if kind == Container::Mp4
            && (other_codec
                || options.encode.lossless
                || (format.pixels.has_alpha()
                    && options.encode.codec.is_none()
                    && is_quicktime(path))
                || !cfg!(feature = "h264"))
        {
            kind = Container::Ffmpeg;
        }
        let mut writer = Self {
            path: path.to_path_buf(),
            format: format.clone(),
            options: options.clone(),
            kind,
            // replaced below
            state: State::Single(Box::new(Nothing), None),
            frames: 0,
            resumed: 0,
            warnings: Vec::new(),
        };
        writer.check_options()?;
        writer.state = writer.start()?;
        writer.frames = writer.resumed;
        Ok(writer)
    }

    fn check_options(&self) -> Result<(), VideoError> {
        let encode = &self.options.encode;
        let native = match self.kind {
            Container::Y4m => "rawvideo",
            Container::Gif => "gif",
            Container::Apng | Container::Pictures => "png",
            Container::Mp4 | Container::Ffmpeg => return Ok(()),
        };
        match &encode.codec {
            Some(codec) if codec != native => Err(VideoError::Options(format!(
                "the extension of {} decides on its codec: leave `codec` out",
                self.path.display()
            ))),
            _ if encode.lossless && self.kind == Container::Gif => Err(VideoError::Options(
                "GIF has 256 colors a frame and is not lossless: write APNG, Y4M or numbered pictures".to_owned(),
            )),
            _ => Ok(()),
        }
    }

    fn quality(&self) -> u8 {
        self.options.encode.quality.unwrap_or(DEFAULT_QUALITY)
    }

    /// Text that is equal for runs which write the same bytes.
    fn key(&self) -> String {
        format!(
            "{}\n{:?}\n{:?}\n{}\n{}",
            env!("CARGO_PKG_VERSION"),
            self.format,
            self.options.encode,
            self.options.first_number,
            self.options.key
        )
    }

    fn start(&mut self) -> Result<State, VideoError> {
        let lossless = self.options.encode.lossless;
        if is_stream(&self.path) {
            let output = BufWriter::new(std::io::stdout());
            let sink = Y4mSink::new(output, &self.format, lossless)?;
            return Ok(State::Single(Box::new(sink), None));
        }
        match self.kind {
            Container::Gif => {
                let file = AtomicFile::create(&self.path)?;
                let output = BufWriter::new(file.file().try_clone()?);
                let sink = GifSink::new(output, &self.format, self.quality())?;
                Ok(State::Single(Box::new(sink), Some(file)))
            }
            Container::Apng => {
                let file = AtomicFile::create(&self.path)?;
                let sink = ApngSink::new(file.file(), &self.format)?;
                Ok(State::Single(Box::new(sink), Some(file)))
            }
            Container::Pictures => self.start_pictures(lossless),
            Container::Y4m | Container::Mp4 | Container::Ffmpeg => {
                let extension = self.path.extension().unwrap_or_default().to_string_lossy();
                let parts = Parts::open(&self.path, &extension, &self.key(), self.options.resume)?;
                self.resumed = parts.finished() * CHUNK_FRAMES;
                // options that the format does not have are refused now, not at the first frame
                let first = match self.resumed {
                    0 => Some(chunk_sink(
                        self.kind,
                        &parts.next_path(),
                        &self.format,
                        &self.options.encode,
                    )?),
                    _ => None,
                };
                Ok(State::Chunked(parts, first))
            }
        }
    }

    fn start_pictures(&mut self, lossless: bool) -> Result<State, VideoError> {
        let pattern = Pattern::parse(&self.path).ok_or(VideoError::UnknownFormat)?;
        let parts = Parts::open(&self.path, "", &self.key(), self.options.resume)?;
        self.resumed = parts.picture_count();
        let first = self.options.first_number + self.resumed;
        let options = WriteOptions {
            quality: self.options.encode.quality.map_or_else(
                || WriteOptions::default().quality,
                |quality| quality.clamp(1, 100),
            ),
            ..WriteOptions::default()
        };
        let sink = PictureSink::new(pattern, first, self.format.size, options, lossless)?;
        Ok(State::Pictures(parts, sink))
    }

    /// Frames that an earlier run has written: the first frame to write has this number.
    pub fn resumed_frames(&self) -> u64 {
        self.resumed
    }

    /// The format of the output.
    pub fn container(&self) -> Container {
        self.kind
    }

    /// Name of the codec of the output.
    pub fn codec(&self) -> String {
        let usual = match self.kind {
            Container::Y4m => "rawvideo",
            Container::Gif => "gif",
            Container::Mp4 => "h264",
            Container::Apng | Container::Pictures | Container::Ffmpeg => "",
        };
        let extension = || {
            self.path
                .extension()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        };
        let chosen = self.options.encode.codec.clone();
        chosen.unwrap_or_else(|| {
            if usual.is_empty() {
                extension()
            } else {
                usual.to_owned()
            }
        })
    }

    /// Number in the name of the next picture.
    pub fn next_number(&self) -> u64 {
        self.options.first_number + self.frames
    }

    /// Frames that are in the output.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// As [`FrameSink::write`].
    pub fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        let flat = self.flattened(frame);
        let frame = flat.as_ref().unwrap_or(frame);
        match &mut self.state {
            State::Single(sink, _) => sink.write(frame)?,
            State::Pictures(parts, sink) => {
                sink.write(frame)?;
                if (self.frames + 1).is_multiple_of(CHUNK_FRAMES) {
                    parts.set_picture_count(self.frames + 1)?;
                }
            }
            State::Chunked(parts, current) => {
                if current.is_none() {
                    let sink = chunk_sink(
                        self.kind,
                        &parts.next_path(),
                        &self.format,
                        &self.options.encode,
                    )?;
                    *current = Some(sink);
                }
                if let Some(sink) = current {
                    sink.write(frame)?;
                }
                if (self.frames + 1).is_multiple_of(CHUNK_FRAMES)
                    && let Some(sink) = current.take()
                {
                    sink.finish()?;
                    parts.finish_chunk()?;
                }
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// The frame over black, if it has transparent pixels and the format has no alpha.
    fn flattened(&mut self, frame: &Frame) -> Option<Frame> {
        let keeps = match self.kind {
            Container::Gif | Container::Apng | Container::Pictures => true,
            Container::Mp4 => false,
            Container::Y4m | Container::Ffmpeg => self.format.pixels.has_alpha(),
        };
        let FramePicture::Image(image) = &frame.picture else {
            return None;
        };
        if keeps || !image.has_alpha() || with_image!(image, image => image.is_opaque()) {
            return None;
        }
        let warning = "transparent pixels were put on black: the format has no alpha";
        if !self.warnings.iter().any(|known| known == warning) {
            self.warnings.push(warning.to_owned());
        }
        let image: Image<LinearRgba> = image.convert();
        let image = image.map(|pixel| {
            let alpha = pixel.alpha();
            LinearRgba::from_rgb_alpha(pixel.rgb().map(|value| value * alpha), 1.0)
        });
        Some(Frame {
            picture: FramePicture::Image(AnyImage::from(image)),
            time: frame.time,
        })
    }

    /// Completes the clip and puts it in place. Returns remarks, a sentence each.
    ///
    /// # Errors
    /// [`VideoError::NoFrames`] for a clip without frames, [`VideoError`] for an encoder or a file system that fails.
    pub fn finish(self) -> Result<Vec<String>, VideoError> {
        if self.frames == 0 {
            return Err(VideoError::NoFrames);
        }
        let mut warnings = self.warnings;
        match self.state {
            State::Single(sink, file) => {
                sink.finish()?;
                if let Some(file) = file {
                    file.persist()?;
                }
            }
            State::Pictures(mut parts, sink) => {
                Box::new(sink).finish()?;
                parts.remove()?;
            }
            State::Chunked(mut parts, current) => {
                if let Some(sink) = current {
                    sink.finish()?;
                    parts.finish_chunk()?;
                }
                let remarks = assemble(self.kind, &parts, &self.path, &self.options)?;
                warnings.extend(remarks);
                parts.remove()?;
            }
        }
        Ok(warnings)
    }
}

/// A sink before the right one is known.
struct Nothing;

impl FrameSink for Nothing {
    fn write(&mut self, _: &Frame) -> Result<(), VideoError> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        Ok(())
    }
}

/// A sink for one chunk.
fn chunk_sink(
    kind: Container,
    path: &Path,
    format: &SinkFormat,
    encode: &EncodeOptions,
) -> Result<Box<dyn FrameSink>, VideoError> {
    match kind {
        Container::Y4m => {
            let output = BufWriter::with_capacity(1 << 20, new_part(path)?);
            Ok(Box::new(Y4mSink::new(output, format, encode.lossless)?))
        }
        #[cfg(feature = "h264")]
        Container::Mp4 => {
            let output = BufWriter::with_capacity(1 << 18, new_part(path)?);
            Ok(Box::new(Mp4Writer::new(output, format, encode)?))
        }
        Container::Ffmpeg => {
            let extension = path.extension().unwrap_or_default().to_string_lossy();
            Ok(Box::new(FfmpegSink::create(
                path, &extension, format, encode,
            )?))
        }
        _ => Err(VideoError::UnknownFormat),
    }
}

/// An empty file for a chunk, which is renamed when it is whole.
#[expect(
    clippy::disallowed_methods,
    reason = "the file is in a folder of our own"
)]
fn new_part(path: &Path) -> std::io::Result<File> {
    File::create(path)
}

/// Joins the chunks to the output. Returns remarks, a sentence each.
fn assemble(
    kind: Container,
    parts: &Parts,
    path: &Path,
    options: &CreateOptions,
) -> Result<Vec<String>, VideoError> {
    if kind == Container::Ffmpeg {
        return assemble_by_ffmpeg(parts, path, options);
    }
    let file = AtomicFile::create(path)?;
    let mut output = BufWriter::new(file.file());
    let mut warnings = Vec::new();
    match kind {
        Container::Y4m => {
            for (number, chunk) in parts.chunks().iter().enumerate() {
                append_frames(BufReader::new(File::open(chunk)?), number == 0, &mut output)?;
            }
        }
        #[cfg(feature = "h264")]
        Container::Mp4 => {
            let (limits, progress) = (VideoLimits::default(), Progress::none());
            let copied = match &options.tracks {
                Some(tracks) => mp4_tracks(tracks, &limits, &mut warnings)?,
                None => None,
            };
            output = mp4::concatenate(&parts.chunks(), output, copied, &limits, &progress)?;
        }
        _ => return Err(VideoError::UnknownFormat),
    }
    output.flush()?;
    drop(output);
    file.persist()?;
    Ok(warnings)
}

/// Lets FFmpeg join the chunks to a file beside them, which takes the place of the output then.
fn assemble_by_ffmpeg(
    parts: &Parts,
    path: &Path,
    options: &CreateOptions,
) -> Result<Vec<String>, VideoError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let tracks = options.tracks.as_ref().map(|tracks| TrackExcerpt {
        path: &tracks.path,
        start_secs: tracks.start_secs,
        end_secs: tracks.end_secs,
    });
    let joined = parts.path(&format!("joined.{extension}"));
    let warnings = ffmpeg::assemble(&parts.chunks(), tracks, &joined, &extension)?;
    let file = AtomicFile::create(path)?;
    std::io::copy(&mut File::open(&joined)?, &mut file.file())?;
    file.persist()?;
    Ok(warnings)
}

/// Sound and subtitles of an MP4 file; others are left out with a remark.
#[cfg(feature = "h264")]
fn mp4_tracks(
    tracks: &CopiedTracks,
    limits: &VideoLimits,
    warnings: &mut Vec<String>,
) -> Result<Option<mp4::CopiedTracks>, VideoError> {
    let input = BufReader::new(File::open(&tracks.path)?);
    match mp4::CopiedTracks::open(input, limits, tracks.start_secs, tracks.end_secs) {
        Ok(copied) => {
            for track in copied.left_out() {
                if track.kind != TrackKind::Data {
                    warnings.push(format!("a track of {} is left out", track.codec));
                }
            }
            Ok((copied.count() > 0).then_some(copied))
        }
        Err(VideoError::UnknownFormat) => {
            let text = "sound and subtitles are left out: they are copied from MP4 and MOV only";
            warnings.push(text.to_owned());
            Ok(None)
        }
        Err(error) => Err(error),
    }
}
