//! Clips as numbered pictures: `frame_%05d.png`, or a folder of pictures.
//!
//! A pattern has one place for the number, `%d` or `%05d` as in C. A folder is read in the order of the numbers in the names
//! (`frame2` before `frame10`). Pictures keep their bits, alpha and orientation; numbers that are missing are left out and
//! reported. The rate is not stored in pictures: 25 frames a second are taken unless the caller says another one.
//!
//! Guarantees: each picture is whole or absent; a picture that cannot be read ends the clip as damage. Does not guarantee: time
//! stamps of a variable rate.

use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::{ClipInfo, Container, PixelKind, Rotation};
use crate::limits::VideoLimits;
use crate::sink::FrameSink;
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational};
use ravec_media::{Format, Picture, SampleKind, WriteOptions};
use ravec_raster::{AnyImage, Size};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A path with a place for the number of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

/// Longest number in a name, in digits.
const MAX_DIGITS: usize = 9;

impl Pattern {
    /// Reads `%d` or `%05d` in the name of a file; `None` if there is none, or more than one.
    pub fn parse(path: &Path) -> Option<Self> {
        let text = path.to_str()?;
        let name = text
            .rfind(['/', std::path::MAIN_SEPARATOR])
            .map_or(0, |at| at + 1);
        let percent = name + text[name..].find('%')?;
        let rest = &text[percent + 1..];
        let end = rest.find('d')?;
        let digits: usize = if end == 0 {
            0
        } else {
            rest[..end].parse().ok()?
        };
        if digits > MAX_DIGITS || rest[end + 1..].contains('%') || rest.starts_with('+') {
            return None;
        }
        Some(Self {
            before: text[..percent].to_owned(),
            digits,
            after: rest[end + 1..].to_owned(),
        })
    }

    /// The path of a frame.
    pub fn path(&self, number: u64) -> PathBuf {
        let mut text = self.before.clone();
        // writing to a string does not fail
        let _ = write!(text, "{number:0width$}", width = self.digits);
        text.push_str(&self.after);
        PathBuf::from(text)
    }

    /// The number in the name of a file of the folder.
    fn number(&self, name: &str) -> Option<u64> {
        let start = self
            .before
            .rfind(['/', std::path::MAIN_SEPARATOR])
            .map_or(0, |at| at + 1);
        let digits = name
            .strip_prefix(&self.before[start..])?
            .strip_suffix(self.after.as_str())?;
        let plain = digits.bytes().all(|byte| byte.is_ascii_digit()) && digits.len() <= MAX_DIGITS;
        let number = plain.then(|| digits.parse().ok())??;
        // 007 is no name of %d
        (format!("{number:0width$}", width = self.digits) == digits).then_some(number)
    }

    fn folder(&self) -> PathBuf {
        let end = self
            .before
            .rfind(['/', std::path::MAIN_SEPARATOR])
            .map_or(0, |at| at + 1);
        if end == 0 {
            PathBuf::from(".")
        } else {
            PathBuf::from(&self.before[..end])
        }
    }
}

/// Texts and the numbers behind them: the order in which people count.
fn natural_key(name: &str) -> Vec<(String, u64)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest
            .find(|c: char| c.is_ascii_digit())
            .unwrap_or(rest.len());
        let (before, digits) = rest.split_at(text);
        let end = digits
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(digits.len());
        key.push((before.to_owned(), digits[..end].parse().unwrap_or(u64::MAX)));
        rest = &digits[end..];
    }
    key
}

/// Frames of numbered pictures.
pub struct PictureSource {
    paths: Vec<PathBuf>,
    info: ClipInfo,
    limits: VideoLimits,
    first_number: u64,
    next: usize,
    warning: Option<String>,
    damage: Option<Damage>,
}

/// Rate of pictures for which none is given.
const DEFAULT_RATE: u32 = 25;

impl PictureSource {
    /// Opens all pictures of a pattern, in the order of their numbers.
    ///
    /// # Errors
    /// [`VideoError`] if there is no picture or the first one cannot be read.
    pub fn pattern(
        pattern: &Pattern,
        rate: Option<Rational>,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let mut numbers = Vec::new();
        for entry in std::fs::read_dir(pattern.folder())? {
            let name = entry?.file_name();
            if let Some(number) = name.to_str().and_then(|name| pattern.number(name)) {
                limits.check_frame(numbers.len() as u64)?;
                numbers.push(number);
            }
        }
        numbers.sort_unstable();
        let first = numbers.first().copied().unwrap_or(0);
        let gap = numbers.windows(2).find(|pair| pair[1] != pair[0] + 1);
        let warning = gap.map(|pair| {
            format!(
                "the numbers {} to {} are missing: the frames around them follow one another",
                pair[0] + 1,
                pair[1] - 1
            )
        });
        let paths = numbers.iter().map(|number| pattern.path(*number));
        let mut source = Self::of(paths.collect(), rate, limits)?;
        source.first_number = first;
        source.warning = warning;
        Ok(source)
    }

    /// Opens all pictures of a folder.
    ///
    /// # Errors
    /// As [`pattern`](Self::pattern).
    pub fn folder(
        folder: &Path,
        rate: Option<Rational>,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let mut names: Vec<OsString> = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let name = entry?.file_name();
            let hidden = name.to_str().is_some_and(|name| name.starts_with('.'));
            if !hidden && Format::from_extension(Path::new(&name)).is_some() {
                limits.check_frame(names.len() as u64)?;
                names.push(name);
            }
        }
        names.sort_by_cached_key(|name| (natural_key(&name.to_string_lossy()), name.clone()));
        Self::of(
            names.iter().map(|name| folder.join(name)).collect(),
            rate,
            limits,
        )
    }

    fn of(
        paths: Vec<PathBuf>,
        rate: Option<Rational>,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let first = paths.first().ok_or_else(|| {
            let text = "no picture has such a name";
            VideoError::Io(std::io::Error::new(std::io::ErrorKind::NotFound, text))
        })?;
        let picture = ravec_media::read(first, &limits.pictures)?;
        let rate = rate
            .or(Rational::new(DEFAULT_RATE, 1))
            .unwrap_or(Rational::ONE);
        let depth = match picture.origin.sample {
            SampleKind::U8 => 8,
            SampleKind::U16 => 16,
            SampleKind::F32 => 32,
        };
        let info = ClipInfo {
            container: Container::Pictures,
            codec: picture
                .origin
                .format
                .map_or("none", |format| format.name())
                .to_lowercase(),
            size: picture.image.size(),
            rotation: Rotation::None,
            pixels: PixelKind::Rgb {
                depth,
                alpha: picture.image.has_alpha(),
            },
            pixel_aspect: Rational::ONE,
            time_base: rate.recip(),
            rate: Some(rate),
            variable_rate: Some(false),
            frames: Some(paths.len() as u64),
            duration: Some(paths.len() as u64),
            other_tracks: Vec::new(),
        };
        Ok(Self {
            paths,
            info,
            limits: limits.clone(),
            first_number: 0,
            next: 0,
            warning: None,
            damage: None,
        })
    }

    /// Number of the first picture of a pattern; 0 for a folder.
    pub fn first_number(&self) -> u64 {
        self.first_number
    }

    /// A remark on the numbers.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// The files, in the order of the frames.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }
}

impl FrameSource for PictureSource {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let Some(path) = self.paths.get(self.next) else {
            return Ok(None);
        };
        let picture = match ravec_media::read(path, &self.limits.pictures) {
            Ok(picture) => picture,
            Err(error) if self.next == 0 => return Err(error.into()),
            Err(error) => {
                self.damage = Some(Damage {
                    frames: self.next as u64,
                    reason: error.to_string(),
                    lost: None,
                });
                self.next = self.paths.len();
                return Ok(None);
            }
        };
        let found = picture.image.size();
        if found != self.info.size {
            return Err(VideoError::SizeChanged {
                frame: self.next as u64,
                found,
                expected: self.info.size,
            });
        }
        let time = FrameTime {
            start: self.next as i64,
            duration: 1,
        };
        self.next += 1;
        Ok(Some(Frame {
            picture: FramePicture::Image(picture.image),
            time,
        }))
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        self.damage = None;
        self.next = usize::try_from(index)
            .unwrap_or(usize::MAX)
            .min(self.paths.len());
        Ok(())
    }

    fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }
}

/// Writes numbered pictures.
pub struct PictureSink {
    pattern: Pattern,
    options: WriteOptions,
    size: Size,
    /// Number in the name of the next picture.
    number: u64,
    frames: u64,
}

impl PictureSink {
    /// Writes pictures from the number `first` on. The extension of the pattern is the format.
    ///
    /// # Errors
    /// [`VideoError::UnknownExtension`] for a pattern that names no format, [`VideoError::Options`] for a lossless JPEG.
    pub fn new(
        pattern: Pattern,
        first: u64,
        size: Size,
        options: WriteOptions,
        lossless: bool,
    ) -> Result<Self, VideoError> {
        let path = pattern.path(first);
        let Some(format) = Format::from_extension(&path) else {
            let extension = path.extension().unwrap_or_default();
            return Err(VideoError::UnknownExtension {
                extension: extension.to_string_lossy().into_owned(),
            });
        };
        if lossless && format == Format::Jpeg {
            let text = "JPEG is never lossless: write PNG or TIFF pictures";
            return Err(VideoError::Options(text.to_owned()));
        }
        Ok(Self {
            pattern,
            options,
            size,
            number: first,
            frames: 0,
        })
    }
}

impl FrameSink for PictureSink {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found: frame.picture.size(),
                expected: self.size,
            });
        }
        let image: AnyImage = frame.picture.to_image().into_owned();
        let picture = Picture::from_image(image);
        ravec_media::write(self.pattern.path(self.number), &picture, &self.options)?;
        self.number += 1;
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_name_files_and_find_their_numbers() {
        let pattern = Pattern::parse(Path::new("a/f_%04d.png")).unwrap();
        assert_eq!(pattern.path(7), Path::new("a/f_0007.png"));
        assert_eq!(pattern.path(123_456), Path::new("a/f_123456.png"));
        assert_eq!(pattern.number("f_0007.png"), Some(7));
        assert_eq!(pattern.number("f_123456.png"), Some(123_456));
        for wrong in [
            "f_7.png",
            "f_00007.png",
            "f_0007.jpg",
            "g_0007.png",
            "f_-007.png",
            "f_.png",
        ] {
            assert_eq!(pattern.number(wrong), None, "{wrong}");
        }
        assert_eq!(
            Pattern::parse(Path::new("%d.png")).unwrap().path(12),
            Path::new("12.png")
        );
        for none in [
            "f.png",
            "f_%s.png",
            "f_%99d.png",
            "%d_%d.png",
            "100%/f.png",
            "f_%+4d.png",
        ] {
            assert_eq!(Pattern::parse(Path::new(none)), None, "{none}");
        }
    }

    #[test]
    fn names_are_ordered_as_people_count() {
        let mut names = ["f10.png", "f9.png", "f1.png", "e3.png", "f1a.png"];
        names.sort_by_key(|name| natural_key(name));
        assert_eq!(names, ["e3.png", "f1.png", "f1a.png", "f9.png", "f10.png"]);
    }
}
