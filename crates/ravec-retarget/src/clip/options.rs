//! Options of a clip, its input and its output.

use crate::deformation::Deformation;
use crate::params::{Borders, RetargetError, RetargetParams, check_range};
use glam::{DMat3, DVec2, DVec3, dvec2};
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Mask, Size, with_image};

/// Options of the retargeting of a clip.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ClipOptions {
    /// Cells along the longer side, 2 to 400 (default 32). More follow smaller objects; the cost of a key time grows with the
    /// square.
    pub grid_cells: usize,
    /// Weight of closed regions that stand out from a frame's border, 0 to 1 (default 1). With 0 only contrast and motion
    /// count, and what is painted.
    pub saliency: f64,
    /// Weight of what moves against the camera's motion, 0 to 1 (default 0.6). More keeps moving objects in shape that do not
    /// stand out otherwise; also leaves and water.
    pub motion: f64,
    /// Weight of straight lines, 0 to 10 (default 1). 0 lets them bend.
    pub line_strength: f64,
    /// The size that important content gets, 0.25 to 4 (default 1: its own), within what the new format allows. Less keeps
    /// shapes better at strong reductions, with smaller objects.
    pub object_scale: f64,
    /// Lowers the size of important content where the paths of moving objects do not fit at `object_scale` (default yes).
    /// Without, objects that move far are squeezed.
    pub fit_paths: bool,
    /// Freedom of the vertices on the border (default along it).
    pub borders: Borders,
    /// Frames before and after each whose content a key deformation considers, 1 to 600 (default 25); key deformations are then
    /// averaged over four fifths as many on each side. One second is a good choice, see [`at_rate`](Self::at_rate). More moves
    /// fixed content less while objects pass, and holds more frames in memory: about twice as many.
    pub look_ahead: usize,
    /// Frames from one measurement of importance to the next, 1 to 8 (default 2). Fewer follow small fast objects, at a cost
    /// in proportion.
    pub sample_frames: usize,
    /// Depth of a two-color voxel in frames, 2 to 64 (default 16), of which there is a measurement every
    /// `sample_frames`, at most 16 in all. Lines are looked for once in that time. More costs less and sees less of what is
    /// short.
    pub voxel_frames: usize,
}

impl Default for ClipOptions {
    fn default() -> Self {
        Self {
            grid_cells: 32,
            saliency: 1.0,
            motion: 0.6,
            line_strength: 1.0,
            object_scale: 1.0,
            fit_paths: true,
            borders: Borders::default(),
            look_ahead: 25,
            sample_frames: 2,
            voxel_frames: 16,
        }
    }
}

impl ClipOptions {
    /// The default with a look-ahead of one second, for a clip of `frames_per_second`.
    pub fn at_rate(frames_per_second: f64) -> Self {
        let frames = if frames_per_second.is_finite() {
            frames_per_second.round().clamp(1.0, 600.0) as usize
        } else {
            Self::default().look_ahead
        };
        Self {
            look_ahead: frames,
            ..Self::default()
        }
    }

    /// The parameters of a still picture that is retargeted as the frames are.
    pub fn still_params(&self) -> RetargetParams {
        RetargetParams {
            grid_cells: Some(self.grid_cells),
            adaptive: false,
            saliency: self.saliency,
            line_strength: self.line_strength,
            object_scale: self.object_scale,
            borders: self.borders,
            max_crop: 0.0,
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// [`RetargetError::Parameter`] with the first value out of range.
    pub fn check(&self) -> Result<(), RetargetError> {
        self.still_params().check()?;
        let count = |frames: usize| frames as f64;
        let ranges = [
            ("motion", self.motion, 0.0, 1.0, "0 to 1"),
            ("look_ahead", count(self.look_ahead), 1.0, 600.0, "1 to 600"),
            (
                "sample_frames",
                count(self.sample_frames),
                1.0,
                8.0,
                "1 to 8",
            ),
            (
                "voxel_frames",
                count(self.voxel_frames),
                2.0,
                64.0,
                "2 to 64",
            ),
        ];
        ranges.into_iter().try_for_each(check_range)
    }

    /// Samples in a voxel.
    pub(super) fn voxel_samples(&self) -> usize {
        (self.voxel_frames / self.sample_frames).clamp(1, 16)
    }
}

/// Motion of the camera from the frame before, and whether a cut lies in between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMotion {
    /// The homography that maps points of the background in the previous frame to this one, in pixels. The first frame of a
    /// clip, and one after a cut, may have any.
    pub frame_from_previous: DMat3,
    /// `true` if the frame begins a new shot.
    pub cut: bool,
}

impl FrameMotion {
    /// The camera stands still.
    pub const STILL: Self = Self {
        frame_from_previous: DMat3::IDENTITY,
        cut: false,
    };

    /// The first frame of a shot.
    pub const CUT: Self = Self {
        frame_from_previous: DMat3::IDENTITY,
        cut: true,
    };
}

impl Default for FrameMotion {
    fn default() -> Self {
        Self::STILL
    }
}

/// A frame on its way into a [`ClipRetargeter`](super::ClipRetargeter).
#[derive(Debug, Clone)]
pub struct ClipFrame<'a> {
    /// The picture; the retargeter keeps it until its deformation is settled.
    pub image: AnyImage,
    /// Motion of the camera since the frame before.
    pub motion: FrameMotion,
    /// Pixels of this frame that keep their shape. What is painted follows the camera's motion and counts for all frames
    /// within the look-ahead.
    pub protect: Option<&'a Mask>,
    /// Pixels that may be squeezed or stretched first. Where both are painted, protection counts.
    pub give_way: Option<&'a Mask>,
}

impl ClipFrame<'_> {
    /// A frame without masks.
    pub fn new(image: AnyImage, motion: FrameMotion) -> Self {
        Self {
            image,
            motion,
            protect: None,
            give_way: None,
        }
    }
}

/// A frame whose deformations are settled.
#[derive(Debug, Clone)]
pub struct Settled {
    /// Number of the frame in the clip, from 0. Frames come in order.
    pub frame: usize,
    /// The frame as it was pushed.
    pub image: AnyImage,
    /// One deformation for each target size, in their order.
    pub deformations: Vec<Deformation>,
}

impl Settled {
    /// The frame in the shape of target number `target`, with the pixel type that it came with.
    ///
    /// # Errors
    /// [`RetargetError::NoTarget`] if there is no such target, [`RetargetError::Cancelled`] soon after `progress` is
    /// cancelled.
    pub fn warp(&self, target: usize, progress: &Progress) -> Result<AnyImage, RetargetError> {
        let deformation = self
            .deformations
            .get(target)
            .ok_or(RetargetError::NoTarget)?;
        with_image!(&self.image, image => Ok(deformation.warp(image, progress)?.into()))
    }
}

/// Figures of a clip so far.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ClipReport {
    /// Frames pushed.
    pub frames: usize,
    /// Numbers of the frames that begin a new shot, without the first.
    pub cuts: Vec<usize>,
    /// Frames before and after each key time whose content counts, as in the options.
    pub look_ahead: usize,
    /// The largest number of frames that were held at a time.
    pub max_frames_held: usize,
    /// Deformations solved for each target; those in between are interpolated.
    pub keys_solved: usize,
    /// Cells that were fitted by two-color voxels because they move, and cells in all.
    pub moving_voxels: usize,
    /// Cells of all slabs.
    pub voxels: usize,
    /// The largest second temporal difference of a vertex, `|p(t−1) − 2 p(t) + p(t+1)|` in pixels of the target, in any target
    /// and within shots.
    pub max_second_difference_px: f64,
    /// The least local area of any cell in any frame against plain scaling; above 0, or something would fold. 1 if there was
    /// no frame.
    pub least_area: f64,
    /// The least scale that important content was to get.
    pub min_object_scale: f64,
}

/// The largest displacement of a corner of a frame, in pixels.
pub(super) fn corner_motion(matrix: &DMat3, size: Size) -> f64 {
    let (width, height) = (size.width() as f64, size.height() as f64);
    [
        dvec2(0.0, 0.0),
        dvec2(width, 0.0),
        dvec2(0.0, height),
        dvec2(width, height),
    ]
    .into_iter()
    .map(|at| mapped(matrix, at).map_or(f64::INFINITY, |to| to.distance(at)))
    .fold(0.0, f64::max)
}

/// A point under a homography; `None` on or behind its horizon.
pub(super) fn mapped(matrix: &DMat3, at: DVec2) -> Option<DVec2> {
    let DVec3 { x, y, z } = *matrix * at.extend(1.0);
    (z > 1e-9).then(|| dvec2(x, y) / z)
}
