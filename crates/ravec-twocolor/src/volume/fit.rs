//! The volume, and how a whole video in memory is fitted.

use super::slab::fit_row;
use super::voxel::TwoColorVoxel;
use ravec_progress::{Cancelled, Phase, Progress};
use ravec_raster::{Color, Image, Oklab, Size};
use rayon::prelude::*;

/// Parameters of the division of a video into fitted blocks.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumeParams {
    /// Side N of a block in pixels, 2 to 16 (default 8). Larger blocks store less and abstract more.
    pub block_px: usize,
    /// Frames M of a block, 1 to 16 (default 8). More frames store less and measure slow motions better; fewer follow
    /// motions that change.
    pub block_frames: usize,
    /// Oklab contrast below which a block is flat, 0 to 1 (default 0.01), as for two-color pixels. 0 gives every block
    /// a plane that is not constant, at the full cost of the search; more gives fewer planes and takes less time.
    pub flat_contrast: f32,
    /// Largest number of starts that are improved, 1 to 16 (default 4). More come nearer to the optimum on textures and
    /// noise and cost time in proportion; on plain edges one is enough.
    pub starts: usize,
}

impl Default for VolumeParams {
    fn default() -> Self {
        Self {
            block_px: 8,
            block_frames: 8,
            flat_contrast: 0.01,
            starts: 4,
        }
    }
}

impl VolumeParams {
    pub(super) fn check(&self) -> Result<(), VolumeError> {
        let Self {
            block_px,
            block_frames,
            flat_contrast: _,
            starts,
        } = *self;
        if !(2..=16).contains(&block_px) {
            return Err(VolumeError::BlockSize { got: block_px });
        }
        if !(1..=16).contains(&block_frames) {
            return Err(VolumeError::BlockFrames { got: block_frames });
        }
        if !(1..=16).contains(&starts) {
            return Err(VolumeError::Starts { got: starts });
        }
        Ok(())
    }
}

/// Why a video could not be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VolumeError {
    /// There is nothing to fit.
    #[error("the video has no frames")]
    NoFrames,
    /// Frames differ in size.
    #[error("frame {frame} has {got} pixels, but the first has {expected}")]
    FrameSize {
        /// The number of the first frame that differs, from 0.
        frame: usize,
        /// Its size.
        got: Size,
        /// The size of the first frame.
        expected: Size,
    },
    /// The block's side is out of range.
    #[error("the block size is {got} pixels a side: choose 2 to 16")]
    BlockSize {
        /// The requested side.
        got: usize,
    },
    /// The block's number of frames is out of range.
    #[error("the block length is {got} frames: choose 1 to 16")]
    BlockFrames {
        /// The requested number of frames.
        got: usize,
    },
    /// The number of starts is out of range.
    #[error("the number of starts is {got}: choose 1 to 16")]
    Starts {
        /// The requested number of starts.
        got: usize,
    },
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A regular grid of two-color voxels over a video. Blocks are numbered `(col, row, slab)`; those of the last column, row
/// and slab may reach beyond the video.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoColorVolume {
    pub(super) frame_size: Size,
    pub(super) frames: usize,
    pub(super) block_px: usize,
    pub(super) block_frames: usize,
    pub(super) blocks: Vec<TwoColorVoxel>,
}

impl TwoColorVolume {
    /// Fits every block of a video. For videos that do not fit into memory see [`VolumeBuilder`](super::VolumeBuilder).
    ///
    /// # Errors
    /// [`VolumeError::NoFrames`] without frames; [`VolumeError::FrameSize`] if they differ in size;
    /// [`VolumeError::BlockSize`], [`VolumeError::BlockFrames`] and [`VolumeError::Starts`] if a parameter is out of
    /// its range; [`VolumeError::Cancelled`] soon after `progress` is.
    pub fn fit<P: Color>(
        frames: &[Image<P>],
        params: &VolumeParams,
        progress: &Progress,
    ) -> Result<Self, VolumeError> {
        params.check()?;
        let frame_size = frames.first().ok_or(VolumeError::NoFrames)?.size();
        for (frame, image) in frames.iter().enumerate() {
            check_size(frame, image.size(), frame_size)?;
        }
        let rows = frame_size.cells(params.block_px).height();
        let slabs = frames.len().div_ceil(params.block_frames);
        let phase = progress.phase("fit", (rows * slabs) as u64);
        Ok(Self {
            frame_size,
            frames: frames.len(),
            block_px: params.block_px,
            block_frames: params.block_frames,
            blocks: fit_slabs(frames, params, progress, &phase)?,
        })
    }

    /// The size of each frame.
    pub fn frame_size(&self) -> Size {
        self.frame_size
    }

    /// The number of frames, at least 1.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The side of a block in pixels.
    pub fn block_px(&self) -> usize {
        self.block_px
    }

    /// The frames of a block.
    pub fn block_frames(&self) -> usize {
        self.block_frames
    }

    /// Columns and rows of blocks.
    pub fn grid_size(&self) -> Size {
        self.frame_size.cells(self.block_px)
    }

    /// The number of slabs: layers of blocks one after the other in time.
    pub fn slabs(&self) -> usize {
        self.frames.div_ceil(self.block_frames)
    }

    /// The block at `(col, row)` of the grid in a slab.
    ///
    /// # Panics
    /// Outside the grid.
    pub fn block(&self, col: usize, row: usize, slab: usize) -> &TwoColorVoxel {
        let grid = self.grid_size();
        assert!(col < grid.width(), "column {col} of {}", grid.width());
        assert!(row < grid.height(), "row {row} of {}", grid.height());
        &self.blocks[(slab * grid.height() + row) * grid.width() + col]
    }

    /// All blocks, row by row, slab by slab.
    pub fn blocks(&self) -> &[TwoColorVoxel] {
        &self.blocks
    }
}

pub(super) fn check_size(frame: usize, got: Size, expected: Size) -> Result<(), VolumeError> {
    if got == expected {
        Ok(())
    } else {
        Err(VolumeError::FrameSize {
            frame,
            got,
            expected,
        })
    }
}

/// Fits frames of one size, at least one, advancing `phase` by one for each row of blocks.
pub(super) fn fit_slabs<P: Color>(
    frames: &[Image<P>],
    params: &VolumeParams,
    progress: &Progress,
    phase: &Phase,
) -> Result<Vec<TwoColorVoxel>, Cancelled> {
    let grid = frames[0].size().cells(params.block_px);
    let slabs = frames.len().div_ceil(params.block_frames);
    let empty = TwoColorVoxel::flat(Oklab::default(), 0.0, 0.0);
    let mut blocks = vec![empty; grid.pixels() * slabs];
    blocks
        .par_chunks_mut(grid.width())
        .enumerate()
        .try_for_each(|(index, out)| {
            let first = index / grid.height() * params.block_frames;
            let last = (first + params.block_frames).min(frames.len());
            fit_row(
                &frames[first..last],
                index % grid.height(),
                params,
                progress,
                out,
            )?;
            phase.advance(1);
            Ok::<(), Cancelled>(())
        })?;
    Ok(blocks)
}
