//! Clips in other formats: frames are read once and written in every size.

use super::{PLACEHOLDER, Retarget, named, with_grid};
use crate::context::Context;
use crate::error::JobError;
use crate::mask::{mask_of, read_mask};
use crate::operation::Operation as _;
use crate::report::Report;
use crate::video::{
    ClipOutput, OutputShape, check_clip_target, is_clip, key_of, open_clip, read_error,
};
use ravec::planar::camera::{CameraMotion, CameraMotionParams};
use ravec::raster::{AnyImage, LinearRgba, Mask, Size, Srgb};
use ravec::retarget::clip::{
    ClipFrame, ClipOptions, ClipReport, ClipRetargeter, FrameMotion, Settled,
};
use ravec_video::{Clip, Frame, FramePicture, FrameSource as _, FrameTime, Rational};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Rate that is taken for clips that state none.
const DEFAULT_RATE: f64 = 25.0;

/// Most frames of look-ahead: what is held in memory.
const MAX_LOOK_AHEAD: f64 = 600.0;

/// Retargets a clip.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::SizesDiffer`] for masks,
/// [`JobError::Retarget`], [`JobError::Cancelled`].
pub(super) fn run(operation: &Retarget, context: &Context) -> Result<Report, JobError> {
    let Retarget { input, params, .. } = operation;
    check(operation)?;
    context.check_files(&operation.inputs(), &[])?;
    let mut report = Report::of(operation, params);
    let mut clip = open_clip(input, None, &mut report, context)?;
    let size = clip.info().size;
    let sizes = sizes(operation, size, context)?;
    let rate = clip.info().rate.map_or(DEFAULT_RATE, Rational::to_f64);
    let options = options(operation, rate);
    let failed = |cause| JobError::from_retargeting(input, cause);
    let retargeter = ClipRetargeter::new(size, &sizes, &options).map_err(failed)?;
    let mut masks = [
        Masks::open(
            operation.protect.as_ref(),
            operation,
            size,
            &mut report,
            context,
        )?,
        Masks::open(
            operation.give_way.as_ref(),
            operation,
            size,
            &mut report,
            context,
        )?,
    ];
    let fixed = params.with_polygons(None, None, size)?;
    params.warn_of_polygons_outside(size, &mut report);
    let start = Instant::now();
    let mut run = Streaming {
        retargeter,
        camera: camera(operation, size),
        outputs: Outputs::create(operation, &clip, &sizes, &report, context)?,
        times: VecDeque::new(),
    };
    let phase = context
        .progress
        .phase("frames", clip.info().frames.unwrap_or(1));
    let mut inner = context.clone();
    inner.progress = context.progress.silent();
    while let Some(frame) = clip.next_frame().map_err(read_error(input))? {
        context.progress.check()?;
        let [protect, give_way] = &mut masks;
        let (protect, give_way) = (
            united(protect.next(operation, size)?, fixed.0.as_ref()),
            united(give_way.next(operation, size)?, fixed.1.as_ref()),
        );
        let settled = run
            .push(frame, (protect.as_deref(), give_way.as_deref()), &inner)
            .map_err(failed)?;
        for frame in settled {
            run.outputs
                .write(&frame, run.times.pop_front(), &report, &inner)?;
            phase.advance(1);
        }
    }
    for frame in run.retargeter.finish(&inner.progress).map_err(failed)? {
        run.outputs
            .write(&frame, run.times.pop_front(), &report, &inner)?;
        phase.advance(1);
    }
    if let Some(damage) = clip.damage() {
        let text = format!("damaged behind {} frames: {}", damage.frames, damage.reason);
        report.warn(format!("{}: {text}", input.display()));
    }
    run.outputs.finish(&mut report)?;
    context.device.report_warnings(&mut report);
    report.add_time("frames", start);
    record(run.retargeter.report(), &mut report);
    Ok(report)
}

/// The union of two masks of the same size.
fn united<'a>(mask: Option<&'a Mask>, fixed: Option<&'a Mask>) -> Option<Cow<'a, Mask>> {
    match (mask, fixed) {
        (Some(a), Some(b)) => Some(Cow::Owned(a.union(b).expect("both are of the clip's size"))),
        (mask, fixed) => mask.or(fixed).map(Cow::Borrowed),
    }
}

/// Refuses what a clip does not have, and names that do not distinguish sizes.
fn check(operation: &Retarget) -> Result<(), JobError> {
    let params = &operation.params;
    let wrong = |field, value: String, range| {
        Err(JobError::Parameter {
            field,
            value,
            range,
        })
    };
    if params.adaptive {
        return wrong("adaptive", "given".to_owned(), "left out for clips");
    }
    if params.crop > 0.0 {
        return wrong("crop", params.crop.to_string(), "0 for clips");
    }
    if !(params.look_ahead > 0.0 && params.look_ahead <= 10.0) {
        return wrong(
            "look_ahead",
            params.look_ahead.to_string(),
            "above 0, up to 10",
        );
    }
    let several = params.sizes.len() > 1;
    for (field, path) in targets(operation) {
        if several && !path.to_string_lossy().contains(PLACEHOLDER) {
            let range = "a name with {size} in it, where there are several sizes";
            return wrong(field, path.display().to_string(), range);
        }
    }
    Ok(())
}

fn targets(operation: &Retarget) -> impl Iterator<Item = (&'static str, &PathBuf)> {
    let grid = operation.show_grid.iter().map(|path| ("show_grid", path));
    std::iter::once(("output", &operation.output)).chain(grid)
}

/// The sizes in pixels, each once. Outputs of these sizes are checked.
fn sizes(operation: &Retarget, size: Size, context: &Context) -> Result<Vec<Size>, JobError> {
    let params = &operation.params;
    let mut sizes = Vec::new();
    for spec in &params.sizes {
        let new = spec.of(size, params.keep_aspect, context.limits.max_pixels)?;
        if !sizes.contains(&new) {
            sizes.push(new);
        }
    }
    for (_, path) in targets(operation) {
        for &size in &sizes {
            check_clip_target(&named(path, size), context)?;
        }
    }
    Ok(sizes)
}

fn options(operation: &Retarget, rate: f64) -> ClipOptions {
    let params = &operation.params;
    let default = ClipOptions::default();
    ClipOptions {
        grid_cells: params.grid.unwrap_or(default.grid_cells),
        saliency: params.saliency,
        line_strength: params.lines,
        object_scale: params.object_scale,
        borders: params.borders,
        look_ahead: (params.look_ahead * rate)
            .round()
            .clamp(1.0, MAX_LOOK_AHEAD) as usize,
        ..default
    }
}

/// The estimate of the camera's motion, unless the camera stands still.
fn camera(operation: &Retarget, size: Size) -> Option<CameraMotion> {
    if operation.params.still_camera {
        return None;
    }
    // frames that are too small for an estimate have none
    CameraMotion::new(size, &CameraMotionParams::default()).ok()
}

/// Frames on their way through the retargeter.
struct Streaming {
    retargeter: ClipRetargeter,
    camera: Option<CameraMotion>,
    outputs: Outputs,
    /// Times of the frames that are in the retargeter.
    times: VecDeque<FrameTime>,
}

impl Streaming {
    fn push(
        &mut self,
        frame: Frame,
        (protect, give_way): (Option<&Mask>, Option<&Mask>),
        context: &Context,
    ) -> Result<Vec<Settled>, ravec::retarget::RetargetError> {
        self.times.push_back(frame.time);
        let image = frame.picture.into_image();
        let motion = self.camera.as_mut().map(|camera| match &image {
            AnyImage::Srgb8(image) => camera.push(image),
            AnyImage::Srgb16(image) => camera.push(image),
            AnyImage::Linear(image) => camera.push(image),
            other => camera.push(&other.convert::<Srgb<u8>>()),
        });
        let motion = motion.map_or(FrameMotion::STILL, |motion| {
            // a guess would make the background swim
            let matrix = motion.reliable.then(|| motion.frame_from_previous.matrix());
            FrameMotion {
                frame_from_previous: matrix.unwrap_or(FrameMotion::STILL.frame_from_previous),
                cut: motion.cut,
            }
        });
        let frame = ClipFrame {
            image,
            motion,
            protect,
            give_way,
        };
        self.retargeter.push(frame, &context.progress)
    }
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

/// A mask for all frames, or a clip of masks.
enum Masks {
    None,
    Still(Mask),
    Moving {
        clip: Box<Clip>,
        path: PathBuf,
        latest: Option<Mask>,
    },
}

impl Masks {
    fn open(
        path: Option<&PathBuf>,
        operation: &Retarget,
        size: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let Some(path) = path else {
            return Ok(Self::None);
        };
        if !is_clip(path, context) {
            return read_mask(path, &operation.input, size, report, context).map(Self::Still);
        }
        Ok(Self::Moving {
            clip: Box::new(open_clip(path, None, report, context)?),
            path: path.clone(),
            latest: None,
        })
    }

    /// The mask of the next frame. The last mask of a shorter clip stays.
    fn next(&mut self, operation: &Retarget, size: Size) -> Result<Option<&Mask>, JobError> {
        match self {
            Self::None => Ok(None),
            Self::Still(mask) => Ok(Some(mask)),
            Self::Moving { clip, path, latest } => {
                if let Some(frame) = clip.next_frame().map_err(read_error(path))? {
                    if frame.picture.size() != size {
                        return Err(JobError::SizesDiffer {
                            a: operation.input.clone(),
                            a_size: size,
                            b: path.clone(),
                            b_size: frame.picture.size(),
                        });
                    }
                    *latest = Some(mask_of(&frame.picture.to_image()));
                }
                Ok(latest.as_ref())
            }
        }
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
