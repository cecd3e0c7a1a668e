//! Opening of clips by their content.

use crate::animation::{ApngSource, GifSource, is_animated};
use crate::error::VideoError;
use crate::ffmpeg::FfmpegSource;
use crate::frame::Frame;
use crate::info::{ClipInfo, Container};
use crate::limits::VideoLimits;
#[cfg(feature = "h264")]
use crate::mp4::Mp4Source;
use crate::pictures::{Pattern, PictureSource};
use crate::scratch::ScratchClip;
use crate::source::{Damage, FrameSource};
use crate::time::Rational;
use crate::y4m::Y4mSource;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

/// A clip that was opened, whatever its format.
pub struct Clip {
    source: Box<dyn FrameSource>,
    first_number: u64,
    files: Vec<PathBuf>,
    warnings: Vec<String>,
}

/// Choices of opening.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Frames a second of numbered pictures; replaces the rate of Y4M. Other formats have time stamps.
    pub rate: Option<Rational>,
    /// Limits.
    pub limits: VideoLimits,
}

/// True if `path` can only be a clip by its name: a folder, a pattern with `%d`, or an extension of video files. Pictures that
/// may be animated (GIF, PNG) are not among them.
pub fn is_clip_name(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    let extension = extension.unwrap_or_default().to_ascii_lowercase();
    Pattern::parse(path).is_some()
        || path.is_dir()
        || VIDEO_EXTENSIONS.contains(&extension.as_str())
}

/// Extensions of files that hold video.
pub(crate) const VIDEO_EXTENSIONS: &[&str] = &[
    "mp4", "m4v", "mov", "y4m", "mkv", "webm", "avi", "mpg", "mpeg", "ts", "m2ts", "mts", "wmv",
    "flv", "ogv", "3gp", "mxf", "nut", "gif", "apng",
];

impl Clip {
    /// Opens a clip: a file, a folder of pictures, a pattern such as `frame_%04d.png`, or `-` for Y4M from standard input.
    ///
    /// # Errors
    /// [`VideoError`] if it is no clip, is damaged before the first frame, or breaks the limits.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self, VideoError> {
        let limits = &options.limits;
        if ravec_files::is_stream(path) {
            return Ok(Self::of(Y4mSource::stream(std::io::stdin(), limits)?));
        }
        if path.is_dir() {
            let source = PictureSource::folder(path, options.rate, limits)?;
            return Ok(Self::of_pictures(source));
        }
        if let Some(pattern) = Pattern::parse(path).filter(|_| !path.exists()) {
            let source = PictureSource::pattern(&pattern, options.rate, limits)?;
            return Ok(Self::of_pictures(source));
        }
        let mut file = File::open(path)?;
        let mut start = [0; 16];
        let filled = read_start(&mut file, &mut start)?;
        file.seek(SeekFrom::Start(0))?;
        match format_of(&start[..filled]) {
            None if filled == 0 => Err(VideoError::Empty),
            Some(Container::Y4m) => Ok(Self::of(Y4mSource::open(file, limits)?)),
            Some(Container::Gif) => Ok(Self::of(GifSource::open(file, limits)?)),
            Some(Container::Apng) if is_animated(&file)? => {
                Ok(Self::of(ApngSource::open(file, limits)?))
            }
            #[cfg(feature = "h264")]
            Some(Container::Mp4) => Self::open_mp4(path, file, limits),
            // a picture that does not move
            Some(Container::Apng) => Err(VideoError::UnknownFormat),
            Some(_) | None => Self::open_by_ffmpeg(path, &start[..filled], limits),
        }
    }

    /// Opens an MP4 file natively, or by FFmpeg what is not known here.
    #[cfg(feature = "h264")]
    fn open_mp4(path: &Path, file: File, limits: &VideoLimits) -> Result<Self, VideoError> {
        match Mp4Source::open(std::io::BufReader::new(file), limits) {
            Ok(source) => Ok(Self::of(source)),
            Err(VideoError::Unsupported { feature, .. }) => {
                let source = FfmpegSource::open(path, &feature, limits)?;
                Ok(Self::of(source))
            }
            Err(error) => Err(error),
        }
    }

    /// Opens a file of another format by FFmpeg. A file that no video format begins like is refused without asking it.
    fn open_by_ffmpeg(path: &Path, start: &[u8], limits: &VideoLimits) -> Result<Self, VideoError> {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let extension = extension.to_ascii_lowercase();
        // of these, all that there are begin with their marks
        let native = ["y4m", "gif", "apng"].contains(&extension.as_str());
        let known = !native && VIDEO_EXTENSIONS.contains(&extension.as_str());
        if !known && !starts_like_video(start) {
            return Err(VideoError::UnknownFormat);
        }
        let needed_for = format!("reading .{extension}");
        FfmpegSource::open(path, &needed_for, limits).map(Self::of)
    }

    fn of(source: impl FrameSource + 'static) -> Self {
        Self {
            source: Box::new(source),
            first_number: 0,
            files: Vec::new(),
            warnings: Vec::new(),
        }
    }

    fn of_pictures(source: PictureSource) -> Self {
        let warnings = source.warning().map(str::to_owned).into_iter().collect();
        let first_number = source.first_number();
        Self {
            files: source.paths().to_vec(),
            first_number,
            warnings,
            ..Self::of(source)
        }
    }

    /// A clip that lies between two operations. Its pictures have numbers from `first_number`.
    pub fn from_scratch(clip: &ScratchClip, first_number: u64) -> Self {
        Self {
            first_number,
            ..Self::of(clip.source())
        }
    }

    /// Number of the first picture of a pattern; 0 for all else.
    pub fn first_number(&self) -> u64 {
        self.first_number
    }

    /// The files of numbered pictures, in the order of the frames; empty for all else.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Remarks on the clip, a sentence each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl FrameSource for Clip {
    fn info(&self) -> &ClipInfo {
        self.source.info()
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        self.source.next_frame()
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        self.source.seek(index)
    }

    fn damage(&self) -> Option<&Damage> {
        self.source.damage()
    }
}

fn read_start(file: &mut File, start: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while filled < start.len() {
        match file.read(&mut start[filled..])? {
            0 => break,
            read => filled += read,
        }
    }
    Ok(filled)
}

/// True for the first bytes of Matroska and `WebM`, AVI, Ogg, ASF, FLV and MPEG streams.
fn starts_like_video(start: &[u8]) -> bool {
    let starts = |magic: &[u8]| start.starts_with(magic);
    starts(b"\x1a\x45\xdf\xa3")
        || (starts(b"RIFF") && start.get(8..11) == Some(b"AVI"))
        || starts(b"OggS")
        || starts(b"\x30\x26\xb2\x75")
        || starts(b"FLV")
        || starts(b"\0\0\x01\xba")
        || starts(b"\0\0\x01\xb3")
        || starts(b"\x47")
        || starts(b"nut/multimedia")
}

/// The format by the first bytes; PNG files may or may not be animated.
fn format_of(start: &[u8]) -> Option<Container> {
    let starts = |magic: &[u8]| start.starts_with(magic);
    if starts(b"YUV4MPEG2") {
        return Some(Container::Y4m);
    }
    if starts(b"GIF8") {
        return Some(Container::Gif);
    }
    if starts(b"\x89PNG\r\n\x1a\n") {
        return Some(Container::Apng);
    }
    let atom = start.get(4..8)?;
    let mp4 = [
        b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"moof", b"styp",
    ];
    mp4.iter()
        .any(|name| atom == *name)
        .then_some(Container::Mp4)
}
