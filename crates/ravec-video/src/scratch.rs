//! Clips between two operations: frames on the disk as they are, without a codec.

use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::ClipInfo;
use crate::source::{Damage, FrameSource};
use crate::time::FrameTime;
use ravec_raster::{AnyImage, Image, Pixel, Size, with_image};
use std::fs::File;
use std::io::{BufWriter, Read as _, Seek as _, SeekFrom, Write as _};
use std::sync::{Arc, Mutex, PoisonError};

/// Type of the pixels of a frame in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pixels {
    Srgb8,
    Srgba8,
    Srgb16,
    Srgba16,
    Linear,
    LinearAlpha,
}

impl Pixels {
    fn of(image: &AnyImage) -> Self {
        match image {
            AnyImage::Srgb8(_) => Self::Srgb8,
            AnyImage::Srgba8(_) => Self::Srgba8,
            AnyImage::Srgb16(_) => Self::Srgb16,
            AnyImage::Srgba16(_) => Self::Srgba16,
            AnyImage::Linear(_) => Self::Linear,
            AnyImage::LinearAlpha(_) => Self::LinearAlpha,
        }
    }
}

/// Place of a frame in the file.
#[derive(Debug, Clone, Copy)]
struct Entry {
    offset: u64,
    pixels: Pixels,
    size: Size,
    time: FrameTime,
}

/// Writes a [`ScratchClip`].
pub struct ScratchWriter {
    file: BufWriter<File>,
    length: u64,
    entries: Vec<Entry>,
    info: ClipInfo,
}

impl ScratchWriter {
    /// An empty clip with these properties, whose number of frames and duration follow from what is written. The file is made in
    /// the system's folder for temporary files, without a name, so that nothing is left behind whatever happens.
    ///
    /// # Errors
    /// [`VideoError::Io`].
    pub fn new(info: ClipInfo) -> Result<Self, VideoError> {
        Ok(Self {
            file: BufWriter::new(ravec_files::nameless_file()?),
            length: 0,
            entries: Vec::new(),
            info,
        })
    }

    /// Appends a frame. Planes of a codec become colors.
    ///
    /// # Errors
    /// [`VideoError::Io`], such as for a disk that is full.
    pub fn write(&mut self, frame: Frame) -> Result<(), VideoError> {
        let image = frame.picture.into_image();
        let bytes: &[u8] = with_image!(&image, image => bytemuck::cast_slice(image.pixels()));
        self.file.write_all(bytes)?;
        self.entries.push(Entry {
            offset: self.length,
            pixels: Pixels::of(&image),
            size: image.size(),
            time: frame.time,
        });
        self.length += bytes.len() as u64;
        Ok(())
    }

    /// Number of frames so far.
    pub fn frames(&self) -> u64 {
        self.entries.len() as u64
    }

    /// Completes the clip.
    ///
    /// # Errors
    /// [`VideoError::Io`].
    pub fn finish(self) -> Result<ScratchClip, VideoError> {
        let Self {
            file,
            entries,
            mut info,
            ..
        } = self;
        let file = file
            .into_inner()
            .map_err(std::io::IntoInnerError::into_error)?;
        info.frames = Some(entries.len() as u64);
        info.duration = match (entries.first(), entries.last()) {
            (Some(first), Some(last)) => {
                let start = last.time.start.saturating_sub(first.time.start);
                u64::try_from(start.saturating_add_unsigned(last.time.duration)).ok()
            }
            _ => Some(0),
        };
        Ok(ScratchClip {
            file: Arc::new(Mutex::new(file)),
            entries: entries.into(),
            info,
        })
    }
}

/// A clip in a file without a name, which is gone with its last user. Clones share the file.
///
/// Guarantees: frames have the samples and time stamps that were written. Takes the bytes of all frames on the disk.
#[derive(Debug, Clone)]
pub struct ScratchClip {
    file: Arc<Mutex<File>>,
    entries: Arc<[Entry]>,
    info: ClipInfo,
}

impl ScratchClip {
    /// Properties of the clip.
    pub fn info(&self) -> &ClipInfo {
        &self.info
    }

    /// Gives the frames from the first one on.
    pub fn source(&self) -> impl FrameSource + 'static {
        ScratchSource {
            clip: self.clone(),
            next: 0,
        }
    }

    fn read<P: Pixel>(&self, entry: &Entry) -> Result<Image<P>, VideoError> {
        let mut pixels = vec![P::zeroed(); entry.size.pixels()];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut pixels);
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(entry.offset))?;
        file.read_exact(bytes)?;
        let image = Image::from_vec(entry.size.width(), pixels);
        Ok(image.expect("as many pixels as the size has"))
    }

    fn image(&self, entry: &Entry) -> Result<AnyImage, VideoError> {
        Ok(match entry.pixels {
            Pixels::Srgb8 => AnyImage::Srgb8(self.read(entry)?),
            Pixels::Srgba8 => AnyImage::Srgba8(self.read(entry)?),
            Pixels::Srgb16 => AnyImage::Srgb16(self.read(entry)?),
            Pixels::Srgba16 => AnyImage::Srgba16(self.read(entry)?),
            Pixels::Linear => AnyImage::Linear(self.read(entry)?),
            Pixels::LinearAlpha => AnyImage::LinearAlpha(self.read(entry)?),
        })
    }
}

struct ScratchSource {
    clip: ScratchClip,
    next: usize,
}

impl FrameSource for ScratchSource {
    fn info(&self) -> &ClipInfo {
        &self.clip.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let Some(entry) = self.clip.entries.get(self.next) else {
            return Ok(None);
        };
        let image = self.clip.image(entry)?;
        self.next += 1;
        Ok(Some(Frame {
            picture: FramePicture::Image(image),
            time: entry.time,
        }))
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        self.next = usize::try_from(index).unwrap_or(usize::MAX);
        Ok(())
    }

    fn damage(&self) -> Option<&Damage> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::info::{Container, PixelKind, Rotation};
    use crate::time::Rational;
    use ravec_raster::{LinearRgba, Srgb, Srgba};

    fn info() -> ClipInfo {
        ClipInfo {
            container: Container::Y4m,
            codec: "rawvideo".to_owned(),
            size: Size::new(5, 3).unwrap(),
            rotation: Rotation::None,
            pixels: PixelKind::Rgb {
                depth: 8,
                alpha: false,
            },
            pixel_aspect: Rational::ONE,
            time_base: Rational::new(1, 1000).unwrap(),
            rate: None,
            variable_rate: None,
            frames: None,
            duration: None,
            other_tracks: Vec::new(),
        }
    }

    #[test]
    fn frames_of_all_types_come_back_from_any_place() {
        let (small, large) = (Size::new(5, 3).unwrap(), Size::new(7, 4).unwrap());
        let images: Vec<AnyImage> = vec![
            Image::from_fn(small, |x, y| Srgb([x as u8, y as u8, 7])).into(),
            Image::from_fn(small, |x, y| Srgba([x as u8, y as u8, 7, 9])).into(),
            Image::from_fn(large, |x, y| Srgb([1000 * x as u16, y as u16, 65535])).into(),
            Image::from_fn(small, |x, y| Srgba([x as u16, 4000 * y as u16, 1, 2])).into(),
            Image::from_fn(large, |x, y| LinearRgba([x as f32, -0.5, 1e-9, y as f32])).into(),
        ];
        let frames: Vec<Frame> = (images.into_iter().zip(0..))
            .map(|(image, k)| Frame {
                picture: FramePicture::Image(image),
                time: FrameTime {
                    start: 40 * k + 3,
                    duration: 40,
                },
            })
            .collect();
        let mut writer = ScratchWriter::new(info()).unwrap();
        for frame in &frames {
            writer.write(frame.clone()).unwrap();
        }
        let clip = writer.finish().unwrap();
        assert_eq!(clip.info().frames, Some(5));
        assert_eq!(clip.info().duration, Some(200));
        let (mut source, mut other) = (clip.source(), clip.source());
        for frame in &frames {
            assert_eq!(source.next_frame().unwrap().as_ref(), Some(frame));
        }
        assert_eq!(source.next_frame().unwrap(), None);
        other.seek(3).unwrap();
        assert_eq!(other.next_frame().unwrap().as_ref(), Some(&frames[3]));
        source.seek(u64::MAX).unwrap();
        assert_eq!(source.next_frame().unwrap(), None);
        source.seek(0).unwrap();
        assert_eq!(source.next_frame().unwrap().as_ref(), Some(&frames[0]));
    }
}
