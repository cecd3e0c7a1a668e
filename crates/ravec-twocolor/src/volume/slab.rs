//! The fit of one row of blocks through the frames of one slab.

use super::block::Block;
use super::fit::VolumeParams;
use super::search::{Scored, Searcher, centered};
use super::starts::{Starts, Trace};
use super::voxel::{TwoColorVoxel, VoxelPlane};
use crate::fit::{FlatThreshold, Search, fit_block_row};
use crate::line::Line;
use crate::pixel::TwoColorPixel;
use crate::pixel::countable;
use fearless_simd::Level;
use glam::{DVec2, DVec3};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::oklab_from_linear;
use ravec_raster::{Average as _, Color, Image, Oklab, PremulLinearRgba, Size};

/// Fits the blocks of block row `row`, from left to right. There are at most `params.block_frames` frames; `out` holds one
/// entry a block.
pub(super) fn fit_row<P: Color>(
    frames: &[Image<P>],
    row: usize,
    params: &VolumeParams,
    progress: &Progress,
    out: &mut [TwoColorVoxel],
) -> Result<(), Cancelled> {
    progress.check()?;
    let side = params.block_px;
    if let [frame] = frames {
        let flat = FlatThreshold(params.flat_contrast);
        let pixels = fit_pixels(frame, side, row, flat, out.len());
        for (voxel, pixel) in out.iter_mut().zip(&pixels) {
            *voxel = TwoColorVoxel::from_pixel(pixel);
        }
        return Ok(());
    }
    // every block that is not constant has a line
    let any = FlatThreshold(0.0);
    let mut in_frames = Vec::with_capacity(frames.len());
    for frame in frames {
        in_frames.push(fit_pixels(frame, side, row, any, out.len()));
        progress.check()?;
    }
    let mean = mean_strip(frames, row * side, side);
    let still = fit_pixels(&mean, side, 0, any, out.len());

    let mut fitter = BlockFitter::new(params);
    for (col, voxel) in out.iter_mut().enumerate() {
        progress.check()?;
        let in_frames = in_frames.iter().map(|pixels| &pixels[col]);
        *voxel = fitter.fit(frames, col, row, in_frames, &still[col]);
    }
    Ok(())
}

/// The two-color pixels of one row of blocks.
fn fit_pixels<P: Color>(
    image: &Image<P>,
    side: usize,
    row: usize,
    flat: FlatThreshold,
    blocks: usize,
) -> Vec<TwoColorPixel> {
    let empty = TwoColorPixel::flat(Oklab::default(), 0.0, 0.0);
    let mut pixels = vec![empty; blocks];
    fit_block_row(
        Level::new(),
        image,
        side,
        Search::Exact,
        row,
        flat,
        &mut pixels,
    );
    pixels
}

/// The mean of the frames' rows from `top`, up to `rows` of them.
fn mean_strip<P: Color>(frames: &[Image<P>], top: usize, rows: usize) -> Image<PremulLinearRgba> {
    let first = &frames[0];
    let height = rows.min(first.height() - top);
    let size = Size::new(first.width(), height).expect("a part of a frame that has pixels");
    let share = 1.0 / frames.len() as f32;
    let mut mean = Image::new(size, PremulLinearRgba::ZERO);
    for frame in frames {
        for row in 0..height {
            for (sum, &pixel) in mean.row_mut(row).iter_mut().zip(frame.row(top + row)) {
                *sum = sum.plus(
                    share,
                    PremulLinearRgba::from_linear(countable(pixel.to_linear())),
                );
            }
        }
    }
    mean
}

/// Fits blocks of several frames, one after the other.
struct BlockFitter<'a> {
    params: &'a VolumeParams,
    block: Block,
    starts: Starts,
    searcher: Searcher,
    traces: Vec<Trace>,
}

impl<'a> BlockFitter<'a> {
    fn new(params: &'a VolumeParams) -> Self {
        Self {
            params,
            block: Block::default(),
            starts: Starts::default(),
            searcher: Searcher::default(),
            traces: Vec::new(),
        }
    }

    fn fit<'p, P: Color>(
        &mut self,
        frames: &[Image<P>],
        col: usize,
        row: usize,
        in_frames: impl Iterator<Item = &'p TwoColorPixel>,
        still: &TwoColorPixel,
    ) -> TwoColorVoxel {
        let side = self.params.block_px;
        self.load(frames, col * side, row * side);
        let block = &mut self.block;
        let count = block.count() as f64;
        let contrast = f64::from(self.params.flat_contrast);
        // the same threshold as for two-color pixels; no split gains more than there is
        let min_gain = 0.25 * contrast * contrast * count;
        let (color, alpha) = block.one_color();
        let flat = TwoColorVoxel::flat(color, alpha, (block.energy / count) as f32);
        // a block with a voxel that is not finite is flat
        if !block.energy.is_finite() || block.energy <= min_gain {
            return flat;
        }
        block.prepare();

        // lines are given from the center of the whole block; here positions are indices of voxels
        let center = 0.5 * (side as f64 - 1.0);
        let in_indices = |line: Line| line.relative_to(DVec2::splat(-center));
        self.traces.clear();
        self.traces
            .extend(in_frames.enumerate().filter_map(|(frame, pixel)| {
                Some(Trace {
                    line: in_indices(pixel.line?),
                    frame: frame as f64,
                    weight: f64::from(pixel.contrast()).powi(2).max(1e-12),
                })
            }));
        let still = still.line.map(in_indices);
        let most = self.params.starts;
        let starts = self.starts.collect(block, &self.traces, still, most);
        let unseen = (block.energy - min_gain).min(block.energy - block.rounding());
        let mut best: Option<Scored> = None;
        for start in starts {
            let found = self.searcher.improve(block, &start.plane);
            if best.is_none_or(|best| found.gain > best.gain) {
                best = Some(found);
            }
            // what is left could not be seen
            if f64::from(found.gain) >= unseen {
                break;
            }
        }
        let Some(best) = best else {
            return flat;
        };

        let plane = centered(block, &best.plane);
        let (normal, offset) = plane.plane(block.middle());
        let normal = DVec3::from_array(normal);
        let half_frames = 0.5 * (self.params.block_frames as f64 - 1.0);
        let origin = DVec3::new(center, center, half_frames);
        let plane = VoxelPlane {
            normal,
            offset_px: offset - normal.dot(origin),
        };
        let sides = block.sides(|index| {
            let position = DVec3::from_array(index.map(|i| i as f64)) - origin;
            plane.signed_distance(position) < 0.0
        });
        if sides.gain <= min_gain {
            return flat;
        }
        let voxel = TwoColorVoxel {
            plane: Some(plane),
            colors: sides.colors,
            alphas: sides.alphas,
            error: ((block.energy - sides.gain).max(0.0) / count) as f32,
        };
        voxel.oriented()
    }

    fn load<P: Color>(&mut self, frames: &[Image<P>], left: usize, top: usize) {
        let side = self.params.block_px;
        let right = (left + side).min(frames[0].width());
        let bottom = (top + side).min(frames[0].height());
        let voxels = frames.iter().flat_map(|frame| {
            (top..bottom).flat_map(move |row| {
                frame.row(row)[left..right].iter().map(|pixel| {
                    let color = countable(pixel.to_linear());
                    let alpha = color.alpha().clamp(0.0, 1.0);
                    (oklab_from_linear(color.rgb()), alpha)
                })
            })
        });
        let extents = [right - left, bottom - top, frames.len()];
        self.block.load(extents, voxels);
    }
}
