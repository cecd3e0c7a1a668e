//! Fitting a video frame by frame, in the memory of one slab.

use super::fit::{TwoColorVolume, VolumeError, VolumeParams, check_size, fit_slabs};
use super::voxel::TwoColorVoxel;
use ravec_progress::Progress;
use ravec_raster::{Color, Image};

/// Fits a video whose frames come one at a time. Holds at most `block_frames` of them.
///
/// ```
/// use ravec_progress::Progress;
/// use ravec_raster::{Image, LinearRgb, Size};
/// use ravec_twocolor::volume::{VolumeBuilder, VolumeParams};
///
/// let mut builder = VolumeBuilder::new(&VolumeParams::default())?;
/// for _ in 0..20 {
///     let frame = Image::new(Size::new(30, 20).unwrap(), LinearRgb([0.5; 3]));
///     builder.push(frame, &Progress::none())?;
/// }
/// let volume = builder.finish(&Progress::none())?;
/// assert_eq!((volume.frames(), volume.slabs()), (20, 3));
/// # Ok::<(), ravec_twocolor::volume::VolumeError>(())
/// ```
#[derive(Debug)]
pub struct VolumeBuilder<P> {
    params: VolumeParams,
    pending: Vec<Image<P>>,
    /// The volume fitted so far; `None` before the first frame.
    volume: Option<TwoColorVolume>,
}

impl<P: Color> VolumeBuilder<P> {
    /// A builder that has seen no frame.
    ///
    /// # Errors
    /// [`VolumeError::BlockSize`], [`VolumeError::BlockFrames`] and [`VolumeError::Starts`] if a parameter is out of
    /// its range.
    pub fn new(params: &VolumeParams) -> Result<Self, VolumeError> {
        params.check()?;
        Ok(Self {
            params: params.clone(),
            pending: Vec::with_capacity(params.block_frames),
            volume: None,
        })
    }

    /// Takes the next frame. If it completes a slab, fits the slab and returns its blocks, row by row.
    ///
    /// After an error the builder is as it was before the call, without the frame.
    ///
    /// # Errors
    /// [`VolumeError::FrameSize`] if the frame differs in size from the first; [`VolumeError::Cancelled`] soon after
    /// `progress` is.
    pub fn push(
        &mut self,
        frame: Image<P>,
        progress: &Progress,
    ) -> Result<Option<&[TwoColorVoxel]>, VolumeError> {
        let number = self.pending.len() + self.volume.as_ref().map_or(0, |volume| volume.frames);
        if number == 0 {
            // a first frame that failed leaves no size behind
            self.volume = None;
        }
        let volume = self.volume.get_or_insert_with(|| TwoColorVolume {
            frame_size: frame.size(),
            frames: 0,
            block_px: self.params.block_px,
            block_frames: self.params.block_frames,
            blocks: Vec::new(),
        });
        check_size(number, frame.size(), volume.frame_size)?;
        self.pending.push(frame);
        if self.pending.len() < self.params.block_frames {
            return Ok(None);
        }
        let before = volume.blocks.len();
        if let Err(error) = append(volume, &self.pending, &self.params, progress) {
            self.pending.pop();
            return Err(error);
        }
        self.pending.clear();
        Ok(Some(&volume.blocks[before..]))
    }

    /// Fits the frames of the last slab, if it is incomplete, and returns the volume.
    ///
    /// # Errors
    /// [`VolumeError::NoFrames`] if there were none; [`VolumeError::Cancelled`] soon after `progress` is.
    pub fn finish(self, progress: &Progress) -> Result<TwoColorVolume, VolumeError> {
        let mut volume = self.volume.ok_or(VolumeError::NoFrames)?;
        if volume.frames + self.pending.len() == 0 {
            return Err(VolumeError::NoFrames);
        }
        if !self.pending.is_empty() {
            append(&mut volume, &self.pending, &self.params, progress)?;
        }
        Ok(volume)
    }
}

/// Fits the frames of one slab and puts its blocks behind the others.
fn append<P: Color>(
    volume: &mut TwoColorVolume,
    frames: &[Image<P>],
    params: &VolumeParams,
    progress: &Progress,
) -> Result<(), VolumeError> {
    let phase = progress.phase("fit", volume.grid_size().height() as u64);
    let blocks = fit_slabs(frames, params, progress, &phase)?;
    volume.blocks.extend(blocks);
    volume.frames += frames.len();
    Ok(())
}
