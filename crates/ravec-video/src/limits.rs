//! Limits on what reading a clip may cost.

use crate::error::VideoError;
use ravec_media::Limits;
use ravec_raster::Size;

/// Bounds on a clip that is read: every file is taken to be hostile. They are checked before memory is taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideoLimits {
    /// Pixels of a frame, and the memory for frames that are held.
    pub pictures: Limits,
    /// Maximum number of frames (default 10 million, four days at 25 frames a second).
    pub max_frames: u64,
}

impl Default for VideoLimits {
    fn default() -> Self {
        Self {
            pictures: Limits::default(),
            max_frames: 10_000_000,
        }
    }
}

impl VideoLimits {
    /// The size of a frame, or the limit that it breaks.
    ///
    /// # Errors
    /// [`VideoError::TooManyPixels`], or [`VideoError::Damaged`] for a side of zero.
    pub fn check_size(&self, width: u64, height: u64) -> Result<Size, VideoError> {
        let limit = self.pictures.max_pixels;
        if width.saturating_mul(height) > limit {
            return Err(VideoError::TooManyPixels {
                width,
                height,
                limit,
            });
        }
        let sides = usize::try_from(width)
            .ok()
            .zip(usize::try_from(height).ok());
        sides
            .and_then(|(width, height)| Size::new(width, height).ok())
            .ok_or_else(|| VideoError::Damaged {
                reason: format!("frames of {width} x {height} pixels"),
            })
    }

    /// Passes the number of a frame (from 0), or names the limit.
    ///
    /// # Errors
    /// [`VideoError::TooManyFrames`].
    pub fn check_frame(&self, index: u64) -> Result<(), VideoError> {
        if index >= self.max_frames {
            return Err(VideoError::TooManyFrames {
                limit: self.max_frames,
            });
        }
        Ok(())
    }
}
