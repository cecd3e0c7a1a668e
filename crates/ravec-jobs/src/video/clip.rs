//! Clips for all operations: opened, recorded in the report, and written.

use super::Encoding;
use crate::context::{Context, Intermediate, StoredClip};
use crate::error::JobError;
use crate::files::is_stream;
use crate::report::{FileReport, Report};
use ravec::raster::Size;
use ravec_files::check_writable;
use ravec_video::{
    Clip, ClipInfo, ClipWriter, Container, CopiedTracks, CreateOptions, EncodeOptions, Frame,
    FrameSource as _, FrameTime, OpenOptions, Pattern, PixelKind, Rational, ScratchWriter,
    SinkFormat, TrackKind, VideoError, VideoLimits, container_for, is_clip_name,
};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// True if an operation on pictures is to take this input as a clip.
pub(crate) fn is_clip(path: &Path, context: &Context) -> bool {
    if context.is_intermediate(path) {
        return context.is_stored_clip(path);
    }
    !is_stream(path) && is_clip_name(path)
}

/// An error of reading a clip.
pub(crate) fn read_error(path: &Path) -> impl Fn(VideoError) -> JobError {
    move |cause| match cause {
        VideoError::Cancelled(_) => JobError::Cancelled,
        cause => JobError::ReadClip {
            path: path.to_path_buf(),
            cause,
        },
    }
}

fn write_error(path: &Path) -> impl Fn(VideoError) -> JobError {
    move |cause| match cause {
        VideoError::Cancelled(_) => JobError::Cancelled,
        cause => JobError::WriteClip {
            path: path.to_path_buf(),
            cause,
        },
    }
}

/// The format of a clip, as a report names it.
fn format_name(container: Container, codec: &str) -> String {
    let container = match container {
        Container::Mp4 => "MP4",
        Container::Y4m => return "Y4M".to_owned(),
        Container::Pictures => "pictures",
        Container::Gif => return "GIF".to_owned(),
        Container::Apng => return "APNG".to_owned(),
        Container::Ffmpeg => return codec.to_owned(),
    };
    format!("{container} ({codec})")
}

/// Format of intermediate results in reports.
const IN_BETWEEN: &str = "intermediate result";

/// A clip as a report lists it.
fn described(path: &Path, format: String, info: &ClipInfo) -> FileReport {
    FileReport {
        path: path.display().to_string(),
        format,
        width: Some(info.size.width()),
        height: Some(info.size.height()),
        frames: info.frames,
        ..FileReport::default()
    }
}

/// Opens a clip for an operation: records it and its warnings in the report, and protects its files from the outputs of the run.
///
/// # Errors
/// [`JobError::ReadClip`], [`JobError::NoIntermediate`].
pub(crate) fn open_clip(
    path: &Path,
    rate: Option<Rational>,
    report: &mut Report,
    context: &Context,
) -> Result<Clip, JobError> {
    context.progress.check()?;
    if context.is_intermediate(path) {
        let stored = context.stored_clip(path)?;
        let clip = Clip::from_scratch(&stored.clip, stored.first_number);
        let file = described(path, IN_BETWEEN.to_owned(), clip.info());
        report.inputs.push(file);
        return Ok(clip);
    }
    tracing::info!("reading {}", path.display());
    let options = OpenOptions {
        rate,
        limits: VideoLimits {
            pictures: context.limits.clone(),
            max_frames: context.max_frames,
        },
    };
    let clip = Clip::open(path, &options).map_err(read_error(path))?;
    for warning in clip.warnings() {
        report.record_dropped(format!("{}: {warning}", path.display()));
    }
    let info = clip.info();
    let format = format_name(info.container, &info.codec);
    report.inputs.push(described(path, format, info));
    report.protect(path);
    for file in clip.files() {
        report.protect(file);
    }
    // the pictures of a folder are known only now
    for path in &context.side_outputs {
        report.check_output(path)?;
    }
    Ok(clip)
}

/// Refuses an output that cannot be a clip or cannot be written, before any work is done for it.
///
/// # Errors
/// [`JobError::WriteClip`].
pub(crate) fn check_clip_target(path: &Path, context: &Context) -> Result<(), JobError> {
    if context.is_intermediate(path) {
        return Ok(());
    }
    container_for(path).map_err(write_error(path))?;
    let first = Pattern::parse(path).map(|pattern| pattern.path(0));
    let file = first.as_deref().unwrap_or(path);
    if is_stream(file) {
        return Ok(());
    }
    check_writable(file).map_err(|cause| write_error(path)(cause.into()))
}

/// The output of an operation that fills a folder, or writes a clip, in its list of files.
pub(crate) fn clip_outputs(output: &Path) -> Vec<&Path> {
    if output.is_dir() {
        Vec::new()
    } else {
        vec![output]
    }
}

/// The output of an operation that fills a folder, or writes a clip, in its list of folders.
pub(crate) fn clip_folders(output: &Path) -> Vec<&Path> {
    if output.is_dir() {
        vec![output]
    } else {
        Vec::new()
    }
}

/// The clip that is written: a folder that is there becomes a pattern in it.
///
/// # Errors
/// [`JobError::OverwritesInput`] for the folder of one of the `inputs`; [`JobError::WriteClip`].
pub(crate) fn folder_or_clip(
    output: &Path,
    inputs: &[&Path],
    context: &Context,
) -> Result<PathBuf, JobError> {
    let mut clip = output.to_path_buf();
    if !context.is_intermediate(output) && output.is_dir() {
        let place = |path: &Path| path.canonicalize().ok();
        if inputs.iter().any(|input| place(input) == place(output)) {
            return Err(JobError::OverwritesInput { path: clip });
        }
        clip = clip.join("frame_%04d.png");
    }
    check_clip_target(&clip, context)?;
    Ok(clip)
}

/// Destination of the frames of an output.
enum Target {
    File(ClipWriter),
    Between(Between),
}

/// A clip that is being written for a later operation.
struct Between {
    writer: ScratchWriter,
    context: Context,
    tracks: Option<CopiedTracks>,
    first_number: u64,
    identity: String,
}

impl Target {
    fn resumed_frames(&self) -> u64 {
        match self {
            Self::File(writer) => writer.resumed_frames(),
            Self::Between(_) => 0,
        }
    }

    fn write(&mut self, frame: Frame) -> Result<(), VideoError> {
        match self {
            Self::File(writer) => writer.write(&frame),
            Self::Between(between) => between.writer.write(frame),
        }
    }
}

/// A clip that is being written by an operation.
pub(crate) struct ClipOutput {
    target: Target,
    path: PathBuf,
    format: SinkFormat,
    /// Stamp of the first frame.
    origin: Option<i64>,
    /// End of the last frame, in ticks from the first.
    end: i64,
    /// True if frames are not evenly spaced.
    uneven: bool,
    frames: u64,
}

/// Properties of the frames of an output that differ from those of its source.
pub(crate) struct OutputShape {
    /// Their size.
    pub size: Size,
    /// A constant rate, in whose ticks the frames are stamped.
    pub rate: Option<Rational>,
    /// The first frame of the source that is used, in seconds from its start.
    pub start_secs: f64,
    /// The end of the last one, unless it is the end of the clip.
    pub end_secs: Option<f64>,
    /// Kind of the pixels, unless it is that of the source.
    pub pixels: Option<PixelKind>,
}

impl OutputShape {
    /// All frames of a clip, in this size.
    pub fn all(size: Size) -> Self {
        Self {
            size,
            rate: None,
            start_secs: 0.0,
            end_secs: None,
            pixels: None,
        }
    }
}

impl ClipOutput {
    /// Begins an output from `clip`, which was opened from `input`. `key` is equal for runs that make the same output.
    ///
    /// # Errors
    /// [`JobError::WriteClip`].
    pub fn create(
        path: &Path,
        (input, clip): (&Path, &Clip),
        shape: &OutputShape,
        encoding: &Encoding,
        key: &str,
        context: &Context,
    ) -> Result<Self, JobError> {
        let info = clip.info();
        let format = SinkFormat {
            size: shape.size,
            pixels: shape.pixels.unwrap_or(info.pixels),
            time_base: shape.rate.map_or(info.time_base, Rational::recip),
            rate: shape.rate.or(info.rate),
            pixel_aspect: info.pixel_aspect,
        };
        let has_tracks = info
            .other_tracks
            .iter()
            .any(|track| track.kind != TrackKind::Data);
        let stored = context.is_intermediate(input);
        let stored = stored.then(|| context.stored_clip(input)).transpose()?;
        let tracks = match &stored {
            None => has_tracks.then(|| CopiedTracks {
                path: input.to_path_buf(),
                start_secs: shape.start_secs,
                end_secs: shape.end_secs,
            }),
            Some(stored) => stored.tracks.as_ref().map(|tracks| excerpt(tracks, shape)),
        };
        let tracks = tracks.filter(|_| !encoding.no_audio);
        let made_from = match stored {
            None => identity(input, clip),
            Some(stored) => stored.identity,
        };
        let key = format!("{key}\n{made_from}");
        let create = |target, format| Self {
            target,
            path: path.to_path_buf(),
            format,
            origin: None,
            end: 0,
            uneven: false,
            frames: 0,
        };
        if context.is_intermediate(path) {
            let info = ClipInfo {
                size: shape.size,
                time_base: format.time_base,
                rate: format.rate,
                ..info.clone()
            };
            let writer = ScratchWriter::new(info).map_err(write_error(path))?;
            let between = Between {
                writer,
                context: context.clone(),
                tracks,
                first_number: clip.first_number(),
                identity: key,
            };
            return Ok(create(Target::Between(between), format));
        }
        let options = CreateOptions {
            encode: EncodeOptions {
                codec: encoding.codec.clone(),
                quality: encoding.video_quality,
                lossless: encoding.lossless,
            },
            first_number: clip.first_number(),
            resume: encoding.resume,
            key,
            tracks,
        };
        tracing::info!("writing {}", path.display());
        let writer = ClipWriter::create(path, &format, &options).map_err(write_error(path))?;
        if writer.resumed_frames() > 0 {
            tracing::info!("going on behind frame {}", writer.resumed_frames());
        }
        Ok(create(Target::File(writer), format))
    }

    /// Frames that an earlier run has written: calls of [`write`](Self::write) for them do nothing.
    pub fn resumed_frames(&self) -> u64 {
        self.target.resumed_frames()
    }

    /// Declares the first `count` frames to be behind, whose stamps are known: for sources that seek over them.
    pub fn skip_to(&mut self, count: u64, origin: i64) {
        self.frames = count;
        self.origin = Some(origin);
    }

    /// True if the frame that is written next is there already.
    pub fn is_done(&self) -> bool {
        self.frames < self.target.resumed_frames()
    }

    /// Passes over a frame that an earlier run has written.
    pub fn pass(&mut self, time: FrameTime) {
        self.place(time);
        self.frames += 1;
    }

    /// The stamp of a frame, counted from the first one.
    fn place(&mut self, time: FrameTime) -> FrameTime {
        let origin = *self.origin.get_or_insert(time.start);
        let start = time.start.saturating_sub(origin);
        if self.format.rate.is_some() && start != self.end && self.frames > 0 {
            self.uneven = true;
        }
        self.end = start.saturating_add_unsigned(time.duration);
        FrameTime {
            start,
            duration: time.duration,
        }
    }

    /// Appends a frame; stamps are counted from the first one. A frame that an earlier run has written is passed over.
    ///
    /// # Errors
    /// [`JobError::WriteClip`].
    pub fn write(&mut self, frame: Frame, report: &Report) -> Result<(), JobError> {
        let time = self.place(frame.time);
        let done = self.is_done();
        self.frames += 1;
        if done {
            return Ok(());
        }
        if let Target::File(writer) = &self.target
            && let Some(pattern) = Pattern::parse(&self.path)
        {
            report.check_output(&pattern.path(writer.next_number()))?;
        }
        self.target
            .write(Frame { time, ..frame })
            .map_err(write_error(&self.path))
    }

    /// Frames of the output so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Seconds from the first frame to the end of the last one.
    pub fn duration_secs(&self) -> f64 {
        self.end as f64 * self.format.time_base.to_f64()
    }

    /// Completes the output and records it.
    ///
    /// # Errors
    /// [`JobError::WriteClip`], [`JobError::OverwritesInput`].
    pub fn finish(self, report: &mut Report) -> Result<(), JobError> {
        let Self {
            target,
            path,
            format,
            uneven,
            frames,
            ..
        } = self;
        let writer = match target {
            Target::File(writer) => writer,
            Target::Between(between) => return between.finish(&path, report),
        };
        report.check_output(&path)?;
        let (container, codec) = (writer.container(), writer.codec());
        let warnings = writer.finish().map_err(write_error(&path))?;
        for warning in warnings {
            report.record_dropped(format!("{}: {warning}", path.display()));
        }
        if uneven && matches!(container, Container::Y4m | Container::Pictures) {
            report.record_dropped(format!(
                "{}: the frames are not evenly spaced, and the format has no time stamps: give a rate, or write another format",
                path.display()
            ));
        }
        report.outputs.push(FileReport {
            path: path.display().to_string(),
            format: format_name(container, &codec),
            width: Some(format.size.width()),
            height: Some(format.size.height()),
            frames: Some(frames),
            ..FileReport::default()
        });
        Ok(())
    }
}

impl Between {
    /// Completes the clip and keeps it for later operations.
    fn finish(self, path: &Path, report: &mut Report) -> Result<(), JobError> {
        let clip = self.writer.finish().map_err(write_error(path))?;
        let file = described(path, IN_BETWEEN.to_owned(), clip.info());
        report.outputs.push(file);
        let stored = StoredClip {
            clip,
            tracks: self.tracks,
            first_number: self.first_number,
            identity: self.identity,
        };
        self.context.store(path, Intermediate::Clip(stored));
        Ok(())
    }
}

/// The part of sound and subtitles that belongs to a part of a clip.
fn excerpt(tracks: &CopiedTracks, shape: &OutputShape) -> CopiedTracks {
    let end = shape.end_secs.map(|end| tracks.start_secs + end);
    CopiedTracks {
        path: tracks.path.clone(),
        start_secs: tracks.start_secs + shape.start_secs,
        end_secs: match (end, tracks.end_secs) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        },
    }
}

/// Text that changes with the content of a clip: sizes and times of its files.
fn identity(path: &Path, clip: &Clip) -> String {
    let mut text = String::new();
    let own = [path.to_path_buf()];
    let files = if clip.files().is_empty() {
        &own[..]
    } else {
        clip.files()
    };
    for file in files {
        let Ok(data) = file.metadata() else { continue };
        let modified = data.modified().ok();
        let since = modified.and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
        // writing to a string does not fail
        let _ = writeln!(text, "{} {} {since:?}", file.display(), data.len());
    }
    text
}

/// Bits and alpha of frames, in words.
pub(super) fn pixels_in_words(info: &ClipInfo) -> String {
    match info.pixels {
        PixelKind::Yuv { format, .. } => {
            let alpha = if format.alpha { " with alpha" } else { "" };
            let chroma = match serde_json::to_value(format.subsampling) {
                Ok(serde_json::Value::String(name)) => name,
                _ => String::new(),
            };
            format!("{} bit {chroma}{alpha}", format.depth)
        }
        PixelKind::Rgb { depth, alpha } => {
            let alpha = if alpha { " with alpha" } else { "" };
            format!("{depth} bit colors{alpha}")
        }
    }
}
