//! A clip written frame by frame from those of another one: decoding, work and encoding of neighboring frames overlap.

use super::follow::{Reader, Shot};
use crate::context::Context;
use crate::error::JobError;
use crate::report::Report;
use crate::video::{ClipOutput, Encoding, OutputShape};
use ravec::raster::{AnyImage, Size};
use ravec_video::{Frame, FramePicture, FrameSource as _, FrameTime, PixelKind};
use std::path::Path;

/// The output of [`rewrite`].
pub(crate) struct Target<'a> {
    /// The clip that is read.
    pub input: &'a Path,
    /// The clip that is written.
    pub output: &'a Path,
    /// Size of its frames, unless it is that of the source.
    pub size: Option<Size>,
    pub encoding: &'a Encoding,
    /// Text that is equal for runs which make the same clip.
    pub key: &'a str,
    /// Kind of the pixels, unless it is that of the source.
    pub pixels: Option<PixelKind>,
    /// Name of the phase, and its frames if they are known.
    pub phase: (&'static str, Option<u64>),
}

/// Writes the frames that `reader` gives, whose warnings are left to the caller, each changed by `change`. It gets each frame, and `true` for those that an earlier run
/// has written: for these it may give none.
///
/// # Errors
/// [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::Cancelled`], those of `change`.
pub(crate) fn rewrite(
    target: &Target<'_>,
    reader: &mut Reader<'_>,
    report: &Report,
    context: &Context,
    mut change: impl FnMut(&Shot, bool) -> Result<Option<AnyImage>, JobError> + Send,
) -> Result<Rewritten, JobError> {
    report.check_output(target.output)?;
    let mut current = reader.next()?;
    let base = reader.clip().info().time_base.to_f64();
    let shape = OutputShape {
        start_secs: current.as_ref().map_or(0.0, |shot| shot.time.start as f64) * base,
        end_secs: reader.end_secs(),
        pixels: target.pixels,
        ..OutputShape::all(target.size.unwrap_or(reader.clip().info().size))
    };
    let source = (target.input, reader.clip());
    let mut written = ClipOutput::create(
        target.output,
        source,
        &shape,
        target.encoding,
        target.key,
        context,
    )?;
    let (name, frames) = target.phase;
    let phase = context.progress.phase(name, frames.unwrap_or(1));
    let resumed = written.resumed_frames();
    let mut count = 0;
    let mut finished: Option<(FrameTime, Option<AnyImage>)> = None;
    loop {
        context.progress.check()?;
        let last = finished.take();
        let done = count < resumed;
        let (put, (next, changed)) = rayon::join(
            || last.map_or(Ok(()), |last| put(&mut written, last, report)),
            || {
                let Some(shot) = &current else {
                    return (Ok(None), Ok(None));
                };
                rayon::join(|| reader.next(), || change(shot, done))
            },
        );
        put?;
        let Some(shot) = current else { break };
        count += 1;
        finished = Some((shot.time, changed?));
        current = next?;
        phase.advance(1);
    }
    Ok(Rewritten { written, count })
}

/// A clip whose frames are all written. Unless it is finished, there is none.
pub(crate) struct Rewritten {
    written: ClipOutput,
    /// Its frames.
    pub count: u64,
}

impl Rewritten {
    /// Completes the clip and records it.
    ///
    /// # Errors
    /// [`JobError::WriteClip`], [`JobError::OverwritesInput`].
    pub fn finish(self, report: &mut Report) -> Result<(), JobError> {
        self.written.finish(report)
    }
}

/// Writes a frame, or passes over one that is there.
fn put(
    written: &mut ClipOutput,
    (time, image): (FrameTime, Option<AnyImage>),
    report: &Report,
) -> Result<(), JobError> {
    let Some(image) = image else {
        written.pass(time);
        return Ok(());
    };
    let picture = FramePicture::Image(image);
    written.write(Frame { picture, time }, report)
}
