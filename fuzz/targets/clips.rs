//! Readers of clips.

use super::{Outcome, limits};
use ravec_video::mp4::{CopiedTracks, Mp4Source};
use ravec_video::{FramePicture, FrameSource as _, VideoError, VideoLimits, Y4mSource};
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

/// Reads frames of a stream, and their colors.
pub fn read_y4m(input: &[u8]) -> Outcome {
    let opened = Y4mSource::stream(Cursor::new(input.to_vec()), &options());
    let outcome = Outcome::of(&opened);
    if let Ok(mut source) = opened {
        let size = source.info().size;
        let mut frames = 0;
        while frames < MAX_READ
            && let Ok(Some(frame)) = source.next_frame()
        {
            let FramePicture::Yuv(planes) = &frame.picture else {
                panic!("frames are planes");
            };
            assert_eq!(planes.size(), size, "the size changes");
            assert_eq!(frame.picture.to_image().size(), size);
            frames += 1;
        }
        if let Some(damage) = source.damage() {
            assert_eq!(damage.frames, frames as u64);
        }
    }
    outcome
}
