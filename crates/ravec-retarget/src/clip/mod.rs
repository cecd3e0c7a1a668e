//! Retargeting of clips: frames go in, and come back with deformations that change smoothly.
//!
//! ```
//! use ravec_progress::Progress;
//! use ravec_raster::{AnyImage, Image, Size, Srgb};
//! use ravec_retarget::clip::{ClipFrame, ClipOptions, ClipRetargeter, FrameMotion};
//!
//! // a disc that moves to the right by three pixels a frame
//! let size = Size::new(96, 64)?;
//! let frame = |t: usize| -> AnyImage {
//!     Image::from_fn(size, |col, row| {
//!         let r = (col as f64 - 20.0 - 3.0 * t as f64).hypot(row as f64 - 31.5);
//!         if r < 12.0 { Srgb([40u8, 40, 60]) } else { Srgb([230, 220, 200]) }
//!     })
//!     .into()
//! };
//! let none = Progress::none();
//! let target = Size::new(64, 64)?;
//! let mut clip = ClipRetargeter::new(size, &[target], &ClipOptions::at_rate(10.0))?;
//! let mut settled = Vec::new();
//! for t in 0..12 {
//!     settled.extend(clip.push(ClipFrame::new(frame(t), FrameMotion::STILL), &none)?);
//! }
//! settled.extend(clip.finish(&none)?);
//! assert_eq!(settled.len(), 12);
//! assert_eq!(settled[5].warp(0, &none)?.size(), target);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How
//!
//! 1. Every second frame is reduced to some 200 pixels; closed regions that stand out are measured on it.
//! 2. The frames of a slab of time, carried along the motion of the camera, are divided into two-color voxels. Those that
//!    stand are as deep as the slab; the others are planes in space and time, whose slopes are speeds. One frame of a slab is
//!    analyzed as a still picture is: it gives straight runs and contrast.
//! 3. At key times a deformation is solved for as for a still picture. Its importance is the mean over all frames within
//!    the look-ahead, carried to the key time along the motion of the camera, and the largest where something passes: the
//!    whole path of an object keeps its shape, and what stands has one importance in all frames. Where paths do not fit, the scale of important content is lowered.
//! 4. The deformations of key times are averaged over four fifths of the look-ahead on each side, each shape at its place in
//!    the scene; frames in between have means of them. Where the camera moves, content is followed through the keys around,
//!    so that it does not jitter.
//!
//! # Guarantees
//!
//! - No cell folds in any frame.
//! - A clip of equal frames has the deformation of the still picture in every frame: see [`ClipOptions::still_params`].
//! - Nothing of a shot depends on frames beyond a cut.
//! - Memory does not depend on the length of the clip. At most twice the look-ahead, one
//!   [`voxel_frames`](ClipOptions::voxel_frames) (or [`sample_frames`](ClipOptions::sample_frames), if that is more) and 25
//!   frames are held, in the pixel type in which they came; the rest is some megabytes.
//! - The same deformations on any number of threads.
//!
//! # Not guaranteed
//!
//! - That static content stands still in the result: where objects come and go, the rest makes room for them, slowly.
//! - That objects which cross a frame within the look-ahead keep their size: where their path does not fit they become
//!   smaller.
//! - Shapes of what the camera's motion does not explain, such as parallax in strong motion.
//!
//! # Words
//!
//! *Sample*: a frame that is measured. *Slab*: the frames of one voxel. *Key time*: a frame for which a deformation is solved for.
//! *Settled*: no further frame changes it. *Carried*: moved along the camera's motion.

mod content;
mod follow;
mod options;
mod path;
mod sample;
mod shot;
mod smooth;
mod solve;
mod voxels;
mod world;

#[cfg(test)]
mod tests;

pub use options::{ClipFrame, ClipOptions, ClipReport, FrameMotion, Settled};

use crate::analysis::units_for;
use crate::grid::Grid;
use crate::params::RetargetError;
use crate::retargeter::{Painted, check_factor, check_masks};
use ravec_progress::Progress;
use ravec_raster::Size;
use shot::{Shot, Stage};
use std::sync::Arc;

/// The retargeting of one clip to one or several sizes.
///
/// After an error the clip is lost; begin anew.
#[derive(Debug)]
pub struct ClipRetargeter {
    stage: Stage,
    shot: Option<Shot>,
    report: ClipReport,
}

impl ClipRetargeter {
    /// For a clip with frames of one size.
    ///
    /// # Errors
    /// [`RetargetError::Parameter`] for options out of range, [`RetargetError::NoTarget`] without a target size,
    /// [`RetargetError::Factor`] if a side changes by a factor of more than 20.
    pub fn new(size: Size, targets: &[Size], options: &ClipOptions) -> Result<Self, RetargetError> {
        options.check()?;
        if targets.is_empty() {
            return Err(RetargetError::NoTarget);
        }
        for &target in targets {
            check_factor(size, target)?;
        }
        let units = units_for(size, Some(options.grid_cells));
        Ok(Self {
            stage: Stage {
                options: options.clone(),
                grid: Arc::new(Grid::new(size, units, |_, _| 1)),
                targets: targets.to_vec(),
            },
            shot: None,
            report: ClipReport {
                look_ahead: options.look_ahead,
                least_area: 1.0,
                min_object_scale: f64::INFINITY,
                ..ClipReport::default()
            },
        })
    }

    /// Takes the next frame and returns those whose deformations are settled, in order; often none, and at a cut many.
    ///
    /// # Errors
    /// [`RetargetError::FrameSize`], [`RetargetError::MaskSize`] and [`RetargetError::Motion`] for what does not fit,
    /// [`RetargetError::Cancelled`] soon after `progress` is cancelled.
    pub fn push(
        &mut self,
        frame: ClipFrame<'_>,
        progress: &Progress,
    ) -> Result<Vec<Settled>, RetargetError> {
        let number = self.report.frames;
        let size = self.stage.grid.image_size;
        if frame.image.size() != size {
            return Err(RetargetError::FrameSize {
                frame: number,
                got: frame.image.size(),
                clip: size,
            });
        }
        let painted = Painted {
            protect: frame.protect,
            give_way: frame.give_way,
        };
        check_masks(size, painted)?;
        let begins = self.shot.is_none() || frame.motion.cut;
        if !begins && !is_motion(&frame.motion, size) {
            return Err(RetargetError::Motion { frame: number });
        }
        let mut settled = Vec::new();
        if begins {
            settled = self.end_shot(progress)?;
            if number > 0 {
                self.report.cuts.push(number);
            }
            self.shot = Some(Shot::new(number));
        }
        self.report.frames += 1;
        if let Some(shot) = &mut self.shot {
            shot.push(&self.stage, frame, begins);
            let held = shot.frames_held();
            self.report.max_frames_held = self.report.max_frames_held.max(held);
            settled.extend(shot.advance(&self.stage, &mut self.report, progress)?);
        }
        Ok(settled)
    }

    /// Returns all frames that are left. Frames that are pushed afterwards begin a new shot.
    ///
    /// # Errors
    /// [`RetargetError::Cancelled`] soon after `progress` is cancelled.
    pub fn finish(&mut self, progress: &Progress) -> Result<Vec<Settled>, RetargetError> {
        self.end_shot(progress)
    }

    /// Figures of the clip so far.
    pub fn report(&self) -> &ClipReport {
        &self.report
    }

    fn end_shot(&mut self, progress: &Progress) -> Result<Vec<Settled>, RetargetError> {
        match self.shot.take() {
            Some(shot) => shot.finish(&self.stage, &mut self.report, progress),
            None => Ok(Vec::new()),
        }
    }
}

/// The most by which a corner may move from frame to frame, in sides of the frame. More is no motion that keeps anything in
/// view.
const MAX_MOTION: f64 = 2.0;

fn is_motion(motion: &FrameMotion, size: Size) -> bool {
    let matrix = motion.frame_from_previous;
    let longer = size.width().max(size.height()) as f64;
    matrix.is_finite()
        && matrix.determinant().abs() > 1e-9
        && [matrix, matrix.inverse()]
            .iter()
            .all(|matrix| options::corner_motion(matrix, size) <= MAX_MOTION * longer)
}
