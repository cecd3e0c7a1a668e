//! Clips in all formats that FFmpeg knows, through its programs as child processes.
//!
//! Idea: [`FfmpegSource`] asks `ffprobe` for the properties of a clip, and lets `ffmpeg` decode it into a pipe, in the layout
//! that its frames have anyway. [`FfmpegSink`] sends frames through a pipe to an `ffmpeg` that encodes them into a part, and
//! [`assemble`] joins parts to the output, with the sound and the subtitles of the clip that the frames come from. NUT, the
//! container in the pipes, gives each frame an exact time stamp in the clock of the clip.
//!
//! | file | role |
//! | --- | --- |
//! | `process.rs` | the programs: found, started, listened to, ended |
//! | `nut.rs` | the container in the pipes: a bounded reader and a writer |
//! | `layout.rs` | layouts of raw frames by FFmpeg's names |
//! | `probe.rs` | properties of a clip |
//! | `stamps.rs` | time stamps of all frames, for random access |
//! | `source.rs` | decoding |
//! | `encoders.rs` | codecs, encoders and quality |
//! | `sink.rs` | encoding of parts |
//! | `assemble.rs` | parts and copied tracks to an output |
//!
//! The programs are those that `RAVEC_FFMPEG` and `RAVEC_FFPROBE` name, else the first ones in `PATH`. FFmpeg 4.4 or later is
//! needed.
//!
//! Guarantees:
//! - Samples are those of the codec: nothing is scaled, and planes are not converted. The exceptions are layouts that
//!   [`YuvFormat`](crate::YuvFormat) does not have: packed and semi-planar ones are rearranged without loss, palettes and
//!   odd depths of red, green and blue become 8 or 16 bits, and 4:1:0 becomes 4:2:0.
//! - Time stamps are exact, and a variable rate is kept, as far as the container of the output has ticks for it (Matroska and
//!   `WebM` have milliseconds). Frames are turned for display, once, here.
//! - A damaged clip gives whole frames only, also behind the damage, and the reason in FFmpeg's words. Frames that may refer
//!   to damaged ones are left out and counted. `seek` gives the frame that reading from the
//!   start gives: it starts at a key frame if the packets of the file say for sure which frames there are, checks the time
//!   stamp of what comes, and decodes from the beginning otherwise.
//! - Memory is bounded: some frames, what FFmpeg itself takes, and 16 bytes a frame once `seek` has listed them.
//! - The child reads only the named file: its formats are those that hold their frames themselves, and its protocols files
//!   and pipes. It ends with the source or sink. Its messages are read as they come.
//! - The same frames and options make the same bytes, with the same version of FFmpeg on the same kind of processor.
//!
//! Does not guarantee:
//! - A few whole frames around damage, which are left out with the damaged ones. A clip without a key frame behind damage at
//!   its beginning is decoded from its first frame, and damage later on in it may be painted over.
//! - `seek` behind damage in a clip that has not been read up to there.
//! - Uneven times in AVI, which has one rate; equal frames in Theora, which leaves them out.
//! - The duration of the last frame of an output, for which encoders take that of the frame before.
//! - That two frames at the same moment stay so: the second one comes a tick later.

mod assemble;
mod encoders;
mod layout;
mod nut;
mod probe;
mod process;
mod salvage;
mod sink;
mod source;
mod stamps;

pub use assemble::{TrackExcerpt, assemble};
pub use sink::FfmpegSink;
pub use source::FfmpegSource;
