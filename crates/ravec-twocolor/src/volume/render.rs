//! Looking at a volume: slices at any time, with exact coverage along the edges.

use super::fit::TwoColorVolume;
use crate::pixel::TwoColorPixel;
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Average as _, Color as _, Image, LinearRgba, PremulLinearRgba};
use rayon::prelude::*;

impl TwoColorVolume {
    /// The volume's picture of a frame: [`render_at`](Self::render_at) its middle.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn render_frame(
        &self,
        frame: usize,
        progress: &Progress,
    ) -> Result<Image<PremulLinearRgba>, Cancelled> {
        self.render_at(frame as f64 + 0.5, progress)
    }

    /// The slice at a time, in frames from the begin of the video; frame 0 lasts from 0 to 1, and times outside the video
    /// show its begin or end.
    ///
    /// A pixel that an edge crosses mixes the two colors, in linear light, by the exact area on each side of the edge at
    /// that moment; edges do not blur while they move.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn render_at(
        &self,
        time_frames: f64,
        progress: &Progress,
    ) -> Result<Image<PremulLinearRgba>, Cancelled> {
        // NaN becomes the begin
        let time = if time_frames > 0.0 {
            time_frames.min(self.frames as f64)
        } else {
            0.0
        };
        let slab = (time as usize / self.block_frames).min(self.slabs() - 1);
        let in_block = time - (slab as f64 + 0.5) * self.block_frames as f64;
        let (grid, side) = (self.grid_size(), self.block_px);
        let first = slab * grid.pixels();
        let mut image = Image::new(self.frame_size, PremulLinearRgba::ZERO);
        let width = image.width();
        let phase = progress.phase("render", grid.height() as u64);
        image
            .par_strips_mut(side)
            .enumerate()
            .try_for_each(|(row, strip)| {
                progress.check()?;
                let voxels = &self.blocks[first + row * grid.width()..][..grid.width()];
                for (col, voxel) in voxels.iter().enumerate() {
                    let columns = col * side..((col + 1) * side).min(width);
                    let lines = strip
                        .chunks_exact_mut(width)
                        .map(|line| &mut line[columns.clone()]);
                    draw(&voxel.pixel_at(in_block), side, lines);
                }
                phase.advance(1);
                Ok::<(), Cancelled>(())
            })?;
        Ok(image)
    }
}

/// Draws a block into the lines of an image, which may be clipped.
fn draw<'a>(
    block: &TwoColorPixel,
    side: usize,
    lines: impl Iterator<Item = &'a mut [PremulLinearRgba]>,
) {
    let premultiplied = |index: usize| {
        let color = block.colors[index].to_linear().rgb();
        PremulLinearRgba::from_linear(LinearRgba::from_rgb_alpha(color, block.alphas[index]))
    };
    let sides = [premultiplied(0), premultiplied(1)];
    let half = 0.5 * (side as f64 - 1.0);
    for (y, line) in lines.enumerate() {
        for (x, pixel) in line.iter_mut().enumerate() {
            let center = DVec2::new(x as f64 - half, y as f64 - half);
            let share = block.line.map_or(1.0, |edge| edge.coverage(center)) as f32;
            *pixel = PremulLinearRgba::ZERO
                .plus(share, sides[0])
                .plus(1.0 - share, sides[1]);
        }
    }
}
