//! Frames of a clip on their way through the retargeter: masks, the motion of the camera, and deformations that settle.

use super::Retarget;
use crate::context::Context;
use crate::error::JobError;
use crate::mask::{mask_of, read_mask};
use crate::report::Report;
use crate::video::{is_clip, open_clip, read_error};
use ravec::planar::camera::{CameraMotion, CameraMotionParams};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Mask, Size, Srgb};
use ravec::retarget::RetargetError;
use ravec::retarget::clip::{
    ClipFrame, ClipOptions, ClipReport, ClipRetargeter, FrameMotion, Settled,
};
use ravec_video::{Clip, FrameSource as _};
use std::borrow::Cow;
use std::path::PathBuf;

/// Rate that is taken for clips that state none.
const DEFAULT_RATE: f64 = 25.0;

/// Most frames of look-ahead: what is held in memory.
const MAX_LOOK_AHEAD: f64 = 600.0;

/// The frames of a clip on their way through the operation [`Retarget`], without its files.
///
/// Guarantee: the deformations are those with which the operation writes the same frames.
pub struct ClipStream {
    operation: Retarget,
    size: Size,
    retargeter: ClipRetargeter,
    camera: Option<CameraMotion>,
    /// Masks of protected areas, and of areas that give way.
    masks: [Masks; 2],
    polygons: [Option<Mask>; 2],
}

impl ClipStream {
    /// For frames of this `size`, `rate` a second; opens the masks.
    ///
    /// # Errors
    /// [`JobError::Parameter`], also for what clips do not have; [`JobError::Read`], [`JobError::ReadClip`] and
    /// [`JobError::SizesDiffer`] for masks; [`JobError::Retarget`].
    pub fn open(
        operation: &Retarget,
        size: Size,
        rate: Option<f64>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        operation.params.check()?;
        check(operation)?;
        let sizes = sizes(operation, size, context)?;
        let options = options(operation, rate.unwrap_or(DEFAULT_RATE));
        let retargeter = ClipRetargeter::new(size, &sizes, &options);
        let mut masks = |path| Masks::open(path, operation, size, report, context);
        let masks = [
            masks(operation.protect.as_ref())?,
            masks(operation.give_way.as_ref())?,
        ];
        let (protect, give_way) = operation.params.with_polygons(None, None, size)?;
        operation.params.warn_of_polygons_outside(size, report);
        Ok(Self {
            retargeter: retargeter.map_err(failed(operation))?,
            camera: camera(operation, size),
            operation: operation.clone(),
            size,
            masks,
            polygons: [protect, give_way],
        })
    }

    /// Takes the next frame and returns those whose deformations are settled, in order; often none, and at a cut many.
    ///
    /// # Errors
    /// [`JobError::SizesDiffer`] for masks, [`JobError::ReadClip`], [`JobError::Retarget`], [`JobError::Cancelled`].
    pub fn push(&mut self, image: AnyImage, progress: &Progress) -> Result<Vec<Settled>, JobError> {
        let motion = self.motion(&image);
        let (operation, size) = (&self.operation, self.size);
        let [protect, give_way] = &mut self.masks;
        let protect = united(protect.next(operation, size)?, self.polygons[0].as_ref());
        let give_way = united(give_way.next(operation, size)?, self.polygons[1].as_ref());
        let frame = ClipFrame {
            image,
            motion,
            protect: protect.as_deref(),
            give_way: give_way.as_deref(),
        };
        let settled = self.retargeter.push(frame, progress);
        settled.map_err(failed(operation))
    }

    /// Returns all frames that are left.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn finish(&mut self, progress: &Progress) -> Result<Vec<Settled>, JobError> {
        let settled = self.retargeter.finish(progress);
        settled.map_err(failed(&self.operation))
    }

    /// Figures of the clip so far.
    pub fn report(&self) -> &ClipReport {
        self.retargeter.report()
    }

    fn motion(&mut self, image: &AnyImage) -> FrameMotion {
        let motion = self.camera.as_mut().map(|camera| match image {
            AnyImage::Srgb8(image) => camera.push(image),
            AnyImage::Srgb16(image) => camera.push(image),
            AnyImage::Linear(image) => camera.push(image),
            other => camera.push(&other.convert::<Srgb<u8>>()),
        });
        motion.map_or(FrameMotion::STILL, |motion| {
            // a guess would make the background swim
            let matrix = motion.reliable.then(|| motion.frame_from_previous.matrix());
            FrameMotion {
                frame_from_previous: matrix.unwrap_or(FrameMotion::STILL.frame_from_previous),
                cut: motion.cut,
            }
        })
    }
}

fn failed(operation: &Retarget) -> impl Fn(RetargetError) -> JobError + '_ {
    |cause| JobError::from_retargeting(&operation.input, cause)
}

/// The sizes in pixels, each once.
pub(super) fn sizes(
    operation: &Retarget,
    size: Size,
    context: &Context,
) -> Result<Vec<Size>, JobError> {
    let params = &operation.params;
    let mut sizes = Vec::new();
    for spec in &params.sizes {
        let new = spec.of(size, params.keep_aspect, context.limits.max_pixels)?;
        if !sizes.contains(&new) {
            sizes.push(new);
        }
    }
    Ok(sizes)
}

/// Refuses what a clip does not have.
pub(super) fn check(operation: &Retarget) -> Result<(), JobError> {
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
    Ok(())
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

/// The union of two masks of the same size.
fn united<'a>(mask: Option<&'a Mask>, fixed: Option<&'a Mask>) -> Option<Cow<'a, Mask>> {
    match (mask, fixed) {
        (Some(a), Some(b)) => Some(Cow::Owned(a.union(b).expect("both are of the clip's size"))),
        (mask, fixed) => mask.or(fixed).map(Cow::Borrowed),
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
