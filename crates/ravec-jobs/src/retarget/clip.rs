//! Clips in other formats: frames are read once and written in every size.

use super::stream::{self, ClipStream};
use super::{PLACEHOLDER, Retarget, named, with_grid};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation as _;
use crate::report::Report;
use crate::video::{ClipOutput, OutputShape, check_clip_target, key_of, open_clip, read_error};
use ravec::raster::{AnyImage, LinearRgba, Size};
use ravec::retarget::clip::{ClipReport, Settled};
use ravec_video::{Clip, Frame, FramePicture, FrameSource as _, FrameTime, Rational};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Retargets a clip.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::SizesDiffer`] for masks,
/// [`JobError::Retarget`], [`JobError::Cancelled`].
pub(super) fn run(operation: &Retarget, context: &Context) -> Result<Report, JobError> {
    let Retarget { input, params, .. } = operation;
    stream::check(operation)?;
    check_names(operation)?;
    context.check_files(&operation.inputs(), &[])?;
    let mut report = Report::of(operation, params);
    let mut clip = open_clip(input, None, &mut report, context)?;
    let size = clip.info().size;
    let sizes = stream::sizes(operation, size, context)?;
    for (_, path) in targets(operation) {
        for &size in &sizes {
            check_clip_target(&named(path, size), context)?;
        }
    }
    let rate = clip.info().rate.map(Rational::to_f64);
    let mut stream = ClipStream::open(operation, size, rate, &mut report, context)?;
    let start = Instant::now();
    let mut outputs = Outputs::create(operation, &clip, &sizes, &report, context)?;
    let phase = context
        .progress
        .phase("frames", clip.info().frames.unwrap_or(1));
    let mut inner = context.clone();
    inner.progress = context.progress.silent();
    // times of the frames that are in the retargeter
    let mut times = VecDeque::new();
    while let Some(frame) = clip.next_frame().map_err(read_error(input))? {
        context.progress.check()?;
        times.push_back(frame.time);
        for frame in stream.push(frame.picture.into_image(), &inner.progress)? {
            outputs.write(&frame, times.pop_front(), &report, &inner)?;
            phase.advance(1);
        }
    }
    for frame in stream.finish(&inner.progress)? {
        outputs.write(&frame, times.pop_front(), &report, &inner)?;
        phase.advance(1);
    }
    if let Some(damage) = clip.damage() {
        report.record_dropped(format!("{}: {damage}", input.display()));
    }
    outputs.finish(&mut report)?;
    context.device.report_warnings(&mut report);
    report.add_time("frames", start);
    record(stream.report(), &mut report);
    Ok(report)
}

/// Refuses names that do not distinguish sizes.
fn check_names(operation: &Retarget) -> Result<(), JobError> {
    let params = &operation.params;
    let several = params.sizes.len() > 1;
    for (field, path) in targets(operation) {
        if several && !path.to_string_lossy().contains(PLACEHOLDER) {
            let range = "a name with {size} in it, where there are several sizes";
            return Err(JobError::Parameter {
                field,
                value: path.display().to_string(),
                range,
            });
        }
    }
    Ok(())
}

fn targets(operation: &Retarget) -> impl Iterator<Item = (&'static str, &PathBuf)> {
    let grid = operation.show_grid.iter().map(|path| ("show_grid", path));
    std::iter::once(("output", &operation.output)).chain(grid)
}

/// The clips that are written: one for each size, and one with its grid.
struct Outputs {
    clips: Vec<ClipOutput>,
    grids: Vec<ClipOutput>,
}

impl Outputs {
    fn create(
        operation: &Retarget,
        clip: &Clip,
        sizes: &[Size],
        report: &Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let key = key_of(operation);
        let create = |path: &Path| -> Result<Vec<ClipOutput>, JobError> {
            let outputs = sizes.iter().map(|&size| {
                let path = named(path, size);
                report.check_output(&path)?;
                let input = (operation.input.as_path(), clip);
                let shape = OutputShape::all(size);
                ClipOutput::create(
                    &path,
                    input,
                    &shape,
                    &operation.params.encoding,
                    &key,
                    context,
                )
            });
            outputs.collect()
        };
        let grids = operation.show_grid.as_deref().map(create).transpose()?;
        Ok(Self {
            clips: create(&operation.output)?,
            grids: grids.unwrap_or_default(),
        })
    }

    /// Warps a frame to every size, unless an earlier run has written it.
    fn write(
        &mut self,
        settled: &Settled,
        time: Option<FrameTime>,
        report: &Report,
        context: &Context,
    ) -> Result<(), JobError> {
        context.progress.check()?;
        let time = time.unwrap_or(FrameTime {
            start: settled.frame as i64,
            duration: 1,
        });
        for (target, clip) in self.clips.iter_mut().enumerate() {
            let mut grid = self.grids.get_mut(target);
            if clip.is_done() && grid.as_ref().is_none_or(|grid| grid.is_done()) {
                clip.pass(time);
                if let Some(grid) = &mut grid {
                    grid.pass(time);
                }
                continue;
            }
            let deformation = &settled.deformations[target];
            let image = context
                .device
                .warp(deformation, &settled.image, &context.progress)
                .map_err(|cause| JobError::from_retargeting(Path::new(""), cause))?;
            if let Some(grid) = &mut grid {
                let drawn = image.like(&with_grid(deformation, image.convert::<LinearRgba>()));
                grid.write(framed(drawn, time), report)?;
            }
            clip.write(framed(image, time), report)?;
        }
        Ok(())
    }

    fn finish(self, report: &mut Report) -> Result<(), JobError> {
        for output in self.clips.into_iter().chain(self.grids) {
            output.finish(report)?;
        }
        Ok(())
    }
}

fn framed(image: AnyImage, time: FrameTime) -> Frame {
    Frame {
        picture: FramePicture::Image(image),
        time,
    }
}

fn record(found: &ClipReport, report: &mut Report) {
    for (name, figure) in [
        ("frames", found.frames as f64),
        ("cuts", found.cuts.len() as f64),
        ("look_ahead_frames", found.look_ahead as f64),
        ("frames_held", found.max_frames_held as f64),
        ("keys_solved", found.keys_solved as f64),
        ("second_difference_px", found.max_second_difference_px),
        ("least_area", found.least_area),
        ("object_scale", found.min_object_scale),
    ] {
        report.figures.insert(name, figure);
    }
    report.embed(found);
}
