//! Readers of clips.

use super::{Outcome, limits};
use ravec_video::mp4::{CopiedTracks, Mp4Source};
use ravec_video::{FrameSource as _, VideoError, VideoLimits};
use std::io::Cursor;

/// Frames that are read of a clip.
const MAX_READ: usize = 64;

fn options() -> VideoLimits {
    VideoLimits {
        pictures: limits::clips(),
        max_frames: 1 << 12,
    }
}

/// Reads frames from the start, one of them again after a jump, and opens the sound.
pub fn read_mp4(input: &[u8]) -> Outcome {
    let limits = options();
    let opened = Mp4Source::open(Cursor::new(input.to_vec()), &limits);
    let outcome = Outcome::of(&opened);
    if let Err(VideoError::Io(error)) = &opened {
        panic!("bytes in memory cannot fail to be read: {error}");
    }
    if let Ok(mut source) = opened {
        let info = source.info().clone();
        let mut frames = Vec::new();
        while frames.len() < MAX_READ
            && let Ok(Some(frame)) = source.next_frame()
        {
            assert_eq!(frame.picture.size(), info.size, "the size changes");
            frames.push(frame);
        }
        let ordered = frames.is_sorted_by_key(|frame| frame.time.start);
        assert!(ordered, "time stamps decrease");
        if let Some(damage) = source.damage() {
            assert_eq!(damage.frames, frames.len() as u64);
        }
        let middle = frames.len() / 2;
        if let Some(wanted) = frames.get(middle)
            && source.seek(middle as u64).is_ok()
        {
            let found = source.next_frame().ok().flatten();
            assert_eq!(found.as_ref(), Some(wanted), "seeking gives another frame");
        }
    }
    let _ = CopiedTracks::open(Cursor::new(input.to_vec()), &limits, 0.1, Some(0.5));
    outcome
}
