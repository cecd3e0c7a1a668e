//! Operations on pictures, applied to the frames of a clip.

use super::Encoding;
use super::clip::{ClipOutput, OutputShape, check_clip_target, open_clip, read_error};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::Report;
use ravec::raster::{AnyImage, Size};
use ravec_video::{Frame, FramePicture, FrameSource as _};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// Files and encoding of a clip whose frames are changed one by one.
pub(crate) struct ClipFiles<'a> {
    /// The clip that is read.
    pub input: &'a Path,
    /// The clip that is written.
    pub output: &'a Path,
    /// Its encoding.
    pub encoding: &'a Encoding,
}

/// Refuses flags of clips where there is none.
///
/// # Errors
/// [`JobError::Parameter`].
pub(crate) fn check_no_encoding(encoding: &Encoding) -> Result<(), JobError> {
    let wrong = |field, value: String| {
        Err(JobError::Parameter {
            field,
            value,
            range: "left out for pictures",
        })
    };
    if let Some(codec) = &encoding.codec {
        return wrong("codec", codec.clone());
    }
    if let Some(quality) = encoding.video_quality {
        return wrong("video_quality", quality.to_string());
    }
    for (field, given) in [
        ("lossless", encoding.lossless),
        ("no_audio", encoding.no_audio),
        ("resume", encoding.resume),
    ] {
        if given {
            return wrong(field, "given".to_owned());
        }
    }
    Ok(())
}

/// Text that is equal for runs which make the same clip: the operation, with `resume` as it is without.
pub(crate) fn key_of<O: Operation>(operation: &O) -> String {
    let Ok(mut fields) = crate::step::tagged(operation) else {
        return String::new();
    };
    if let Some(encoding) = fields.pointer_mut("/params/encoding/resume") {
        *encoding = false.into();
    }
    fields.to_string()
}

/// Writes a clip whose frames are those of another one, changed by `change`, which gets the report for its figures; these
/// become their means over all frames. `size` gives the size of the output from that of the input.
///
/// # Errors
/// [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::Cancelled`], and those of `change`.
pub(crate) fn map_clip<O: Operation>(
    operation: &O,
    files: &ClipFiles<'_>,
    report: &mut Report,
    context: &Context,
    size: impl FnOnce(Size) -> Result<Size, JobError>,
    mut change: impl FnMut(&AnyImage, &mut Report, &Context) -> Result<AnyImage, JobError> + Send,
) -> Result<(), JobError> {
    let ClipFiles {
        input,
        output,
        encoding,
    } = files;
    check_clip_target(output, context)?;
    let mut clip = open_clip(input, None, report, context)?;
    report.check_output(output)?;
    let start = Instant::now();
    let size = size(clip.info().size)?;
    let total = clip.info().frames.unwrap_or(1);
    let shape = OutputShape::all(size);
    let key = key_of(operation);
    let mut written = ClipOutput::create(output, (input, &clip), &shape, encoding, &key, context)?;
    let phase = context.progress.phase("frames", total);
    if written.resumed_frames() > 0 {
        let first = clip.next_frame().map_err(read_error(input))?;
        let origin = first.map_or(0, |frame| frame.time.start);
        clip.seek(written.resumed_frames())
            .map_err(read_error(input))?;
        written.skip_to(written.resumed_frames(), origin);
        phase.advance(written.resumed_frames());
    }
    let mut inner = context.clone();
    inner.progress = context.progress.silent();
    let mut sums: BTreeMap<&'static str, (f64, u64)> = BTreeMap::new();
    // while a frame is changed, the one before is encoded and the next one decoded
    let mut next = clip.next_frame().map_err(read_error(input))?;
    let mut changed_before = None;
    while let Some(frame) = next {
        context.progress.check()?;
        let mut own = Report::new(O::NAME, &());
        let (changed, read_and_written) = rayon::join(
            || change(&frame.picture.to_image(), &mut own, &inner),
            || {
                if let Some(frame) = changed_before.take() {
                    written.write(frame, report)?;
                }
                clip.next_frame().map_err(read_error(input))
            },
        );
        let image = changed?;
        next = read_and_written?;
        report.adopt_remarks(&own);
        for (name, figure) in own.figures {
            let sum = sums.entry(name).or_default();
            *sum = (sum.0 + figure, sum.1 + 1);
        }
        let picture = FramePicture::Image(image);
        let time = frame.time;
        changed_before = Some(Frame { picture, time });
        phase.advance(1);
    }
    if let Some(frame) = changed_before {
        written.write(frame, report)?;
    }
    if let Some(damage) = clip.damage() {
        report.record_dropped(format!("{}: {damage}", input.display()));
    }
    for (name, (sum, count)) in sums {
        report.figures.insert(name, sum / count as f64);
    }
    report.figures.insert("frames", written.frames() as f64);
    written.finish(report)?;
    report.add_time("frames", start);
    Ok(())
}
