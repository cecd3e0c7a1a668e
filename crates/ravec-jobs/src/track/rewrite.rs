//! A clip written frame by frame from those of another one: decoding, work and encoding of neighboring frames overlap.

use super::follow::{Reader, Shot};
use crate::context::Context;
use crate::error::JobError;
use crate::report::Report;
use crate::video::{ClipOutput, Encoding, OutputShape};
use ravec::raster::{AnyImage, Size};
use ravec_video::{Frame, FramePicture, FrameSource as _, FrameTime, PixelKind};
use rayon::prelude::*;
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

/// Frames that are changed at a time at most, where they do not depend on each other.
const MAX_AT_ONCE: usize = 4;
/// Pixels of the frames that are changed at a time at most: two frames of 1920 × 1080.
const MAX_PIXELS_AT_ONCE: usize = 2 * 1920 * 1088;

/// Writes the frames that `reader` gives, whose warnings are left to the caller, each changed by `change`. It gets each frame, and
/// `true` for those that an earlier run has written: for these it may give none.
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
    rewrite_batches(target, reader, report, context, 1, |shots, done| {
        let changed = shots.iter().map(|shot| change(shot, done));
        changed.collect()
    })
}

/// [`rewrite`] for frames that do not depend on each other: some are changed at a time, on all threads. `read` reads what belongs to a
/// frame elsewhere, and `record` gets what `change` finds beside the picture, both in the order of the frames. Frames that an earlier
/// run has written are left out.
///
/// # Errors
/// Those of [`rewrite`].
pub(crate) fn rewrite_each<S: Send, T: Send>(
    target: &Target<'_>,
    reader: &mut Reader<'_>,
    report: &Report,
    context: &Context,
    mut read: impl FnMut(&Shot) -> Result<S, JobError> + Send,
    change: impl Fn(&Shot, S) -> Result<(AnyImage, T), JobError> + Sync,
    mut record: impl FnMut(T) + Send,
) -> Result<Rewritten, JobError> {
    let pixels = reader.clip().info().size.pixels();
    let pixels = pixels.max(target.size.map_or(0, Size::pixels));
    let at_once = (MAX_PIXELS_AT_ONCE / pixels)
        .min(rayon::current_num_threads())
        .clamp(1, MAX_AT_ONCE);
    rewrite_batches(target, reader, report, context, at_once, |shots, done| {
        if done {
            return Ok(shots.iter().map(|_| None).collect());
        }
        let sides: Vec<Result<S, _>> = shots.iter().map(&mut read).collect();
        let pairs = shots.par_iter().zip(sides);
        let changed: Vec<Result<_, _>> = pairs.map(|(shot, side)| change(shot, side?)).collect();
        // the error of the first frame that has one, on any number of threads
        let images = changed.into_iter().map(|changed| {
            let (image, found) = changed?;
            record(found);
            Ok(Some(image))
        });
        images.collect()
    })
}

/// Writes the frames that `reader` gives, `at_once` of them changed at a time; frames that an earlier run has written come alone.
fn rewrite_batches(
    target: &Target<'_>,
    reader: &mut Reader<'_>,
    report: &Report,
    context: &Context,
    at_once: usize,
    mut change: impl FnMut(&[Shot], bool) -> Result<Vec<Option<AnyImage>>, JobError> + Send,
) -> Result<Rewritten, JobError> {
    report.check_output(target.output)?;
    let first = reader.next()?;
    let base = reader.clip().info().time_base.to_f64();
    let shape = OutputShape {
        start_secs: first.as_ref().map_or(0.0, |shot| shot.time.start as f64) * base,
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
    let mut current: Vec<Shot> = first.into_iter().collect();
    let mut finished: Vec<(FrameTime, Option<AnyImage>)> = Vec::new();
    loop {
        context.progress.check()?;
        let last = std::mem::take(&mut finished);
        let done = count < resumed;
        let length = if count + 1 < resumed { 1 } else { at_once };
        let (put, (next, changed)) = rayon::join(
            || {
                let mut last = last.into_iter();
                last.try_for_each(|frame| put(&mut written, frame, report))
            },
            || {
                if current.is_empty() {
                    return (Ok(Vec::new()), Ok(Vec::new()));
                }
                rayon::join(|| next_frames(reader, length), || change(&current, done))
            },
        );
        put?;
        if current.is_empty() {
            break;
        }
        count += current.len() as u64;
        phase.advance(current.len() as u64);
        let times = current.iter().map(|shot| shot.time);
        finished = times.zip(changed?).collect();
        current = next?;
    }
    Ok(Rewritten { written, count })
}

/// The next `length` frames, or those that are left.
fn next_frames(reader: &mut Reader<'_>, length: usize) -> Result<Vec<Shot>, JobError> {
    let mut frames = Vec::with_capacity(length);
    while frames.len() < length
        && let Some(frame) = reader.next()?
    {
        frames.push(frame);
    }
    Ok(frames)
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
