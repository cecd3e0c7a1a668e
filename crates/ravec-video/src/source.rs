//! Reading frames one after the other.

use crate::error::VideoError;
use crate::frame::Frame;
use crate::info::ClipInfo;

/// Damage of a clip: frames up to it were given, and those behind it that are whole, if there are any.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Damage {
    /// Number of good frames before the damage.
    pub frames: u64,
    /// Reason, in one sentence.
    pub reason: String,
    /// Number of frames that are lost, if reading went on behind the damage; `None` if it ended the clip.
    pub lost: Option<u64>,
}

impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            frames,
            reason,
            lost,
        } = self;
        match lost {
            None => write!(f, "damaged behind {frames} frames: {reason}"),
            Some(lost) => write!(
                f,
                "damaged behind {frames} frames: {reason}; {lost} frames were lost, and the whole ones behind them are used"
            ),
        }
    }
}

/// Frames of a clip in the order in which they are shown.
///
/// Implementations hold a bounded number of frames, whatever the length of the clip. Time stamps never decrease.
pub trait FrameSource: Send {
    /// Properties of the clip.
    fn info(&self) -> &ClipInfo;

    /// The next frame, or `None` at the end. After `None`, [`damage`](Self::damage) is the reason if the end came early.
    ///
    /// # Errors
    /// [`VideoError`] for a file that cannot be read, or a frame that exceeds the limits.
    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError>;

    /// Makes the frame `index` (from 0, in the order in which frames are shown) the next one. An index beyond the end makes the
    /// next frame `None`. Exact to the frame: the frames that follow are those that reading from the start gives.
    ///
    /// # Errors
    /// As [`next_frame`](Self::next_frame).
    fn seek(&mut self, index: u64) -> Result<(), VideoError>;

    /// The damage that was met so far. Behind it come whole frames or none.
    fn damage(&self) -> Option<&Damage>;
}

impl<S: FrameSource + ?Sized> FrameSource for Box<S> {
    fn info(&self) -> &ClipInfo {
        (**self).info()
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        (**self).next_frame()
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        (**self).seek(index)
    }

    fn damage(&self) -> Option<&Damage> {
        (**self).damage()
    }
}
