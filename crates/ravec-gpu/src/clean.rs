//! Cleaning: the model of a window a thread, then the mean of all windows over a pixel, a pixel a thread.
//!
//! ```text
//! estimate the noise                                     on the CPU
//! for each strip of rows, several in flight:
//!     encoded opponent colors under its windows          on the CPU
//!     line, planes and weights of each window            on the device
//!     weighted mean of the windows over each pixel       on the device
//!     linear light                                       on the CPU
//! ```
//!
//! Guarantee: the bits of [`clean_with`] but for numbers below 1e-38, whether the device lasts or not.
//!
//! Cost: the exact fit of all windows, and 156 bytes of models a window, which the pixels under it read.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::fit::{SweepBuffers, sweep_constants};
use crate::upload::GpuPixel;
use crate::work::{Pending, Run, rest_of};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect};
use ravec_twocolor::{
    CleanParams, CleanStrip, FilterError, NoiseLevel, SweepTable, WindowShrinkage, clean_by,
    clean_with,
};
use rayon::prelude::*;
use std::sync::Arc;

/// Sides of windows that are cleaned on the device: powers of two, whose inverse numbers of pixels are exact.
const CLEANED_SIDES: [usize; 3] = [4, 8, 16];

/// Windows of a strip: 39 MiB of models, of which three are in flight.
const MAX_WINDOWS: usize = 1 << 18;

/// Words of a model in `clean_windows.wgsl`.
const MODEL_WORDS: usize = 39;

/// Words of a cleaned pixel.
const PIXEL_WORDS: usize = 3;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    zero: u32,
    width: u32,
    windows_x: u32,
    windows: u32,
    stride: u32,
    side: u32,
    pixels: u32,
    events: u32,
    target_width: u32,
    lead_x: u32,
    lead_y: u32,
    count: u32,
    windows_y: u32,
    classes: u32,
}

const PARTS: [&str; 5] = [
    include_str!("shaders/exact.wgsl"),
    include_str!("shaders/clean_windows.wgsl"),
    include_str!("shaders/weights.wgsl"),
    include_str!("shaders/sweep.wgsl"),
    include_str!("shaders/clean_gather.wgsl"),
];

/// The cleaned pixels of `region`: what [`clean_with`] gives.
///
/// Windows of 4, 8 and 16 pixels a side are computed on the device; others, thin pictures, and what a lost device leaves, on
/// the CPU.
///
/// # Errors
/// As [`clean_with`].
pub fn clean<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let is_thin = image.width().min(image.height()) < CleanStrip::MIN_SIDE;
    if !CLEANED_SIDES.contains(&params.window_px) || is_thin || gpu.is_lost() {
        return clean_with(image, region, noise, params, progress);
    }
    clean_by(image, region, noise, params, progress, |region| {
        clean_region(gpu, image, region, noise, params, progress)
    })
}

fn clean_region<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    let mut pixels = Vec::with_capacity(size.pixels());
    match clean_strips(gpu, image, region, noise, params, progress, &mut pixels) {
        Ok(()) => {}
        Err(Stopped::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("cleaning", &failure);
            let rest = rest_of(region, pixels.len() / region.width);
            let noise = noise.uncompressed();
            pixels.extend_from_slice(clean_with(image, rest, &noise, params, progress)?.pixels());
        }
    }
    Image::from_vec(size.width(), pixels).map_err(|_| FilterError::EmptyRegion)
}

/// Cleans strip after strip and appends whole strips to `pixels`.
fn clean_strips<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
    pixels: &mut Vec<LinearRgba>,
) -> Result<(), Stopped> {
    let cleaner = Cleaner::new(gpu, image, noise, params.window_px)?;
    let phase = progress.phase("clean", region.height as u64);
    let stride = params.stride_px;
    let windows_in_a_row = region.width.div_ceil(stride) + params.window_px.div_ceil(stride);
    let rows = (MAX_WINDOWS / windows_in_a_row * stride).max(params.window_px);
    let strips = (region.row..region.bottom()).step_by(rows).map(|row| {
        let height = rows.min(region.bottom() - row);
        let target = Rect::new(region.col, row, region.width, height);
        CleanStrip::new(target, params.window_px, stride)
    });
    gpu.pipelined(
        strips,
        progress,
        |strip| Ok(((), cleaner.submit(&strip)?)),
        |strip, (), bytes| {
            let target = strip.target;
            let colors: &[[f32; 3]] =
                bytemuck::cast_slice(&bytes[..4 * PIXEL_WORDS * target.pixels()]);
            let first = pixels.len();
            pixels.resize(first + target.pixels(), LinearRgba::default());
            let rows = pixels[first..].par_chunks_mut(target.width);
            rows.zip(colors.par_chunks(target.width))
                .enumerate()
                .for_each(|(row, (out, colors))| {
                    let row = Rect::new(target.col, target.row + row, target.width, 1);
                    let strip = CleanStrip {
                        target: row,
                        ..strip
                    };
                    strip.write(image, out, |x, _| colors[x - strip.lead[0]]);
                });
            phase.advance(target.height as u64);
            Ok(())
        },
    )
}

/// State shared by the strips of a picture.
struct Cleaner<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    side: usize,
    classes: usize,
    sigma: wgpu::Buffer,
    sweep: SweepBuffers,
    windows: Arc<wgpu::ComputePipeline>,
    gather: Arc<wgpu::ComputePipeline>,
}

impl<'a, P: GpuPixel> Cleaner<'a, P> {
    fn new(
        gpu: &'a Gpu,
        image: &'a Image<P>,
        noise: &NoiseLevel,
        side: usize,
    ) -> Result<Self, Failure> {
        let [luma, chroma, _] = WindowShrinkage::RESIDUAL_SHRINK;
        let n = side as f32;
        let numbers = [
            ("INVERSE_LUMA_RANGE", 1.0 / WindowShrinkage::LUMA_RANGE),
            ("MIN_GAIN", WindowShrinkage::MIN_GAIN),
            ("THIRD", 1.0 / 3.0),
            ("MIN_VARIANCE", WindowShrinkage::MIN_VARIANCE),
            ("SCATTER_FLOOR", WindowShrinkage::SCATTER_FLOOR),
            ("SLOPE_SHRINK", WindowShrinkage::SLOPE_SHRINK),
            ("LUMA_SHRINK", luma),
            ("CHROMA_SHRINK", chroma),
            // the sum of the squares of x, or of z, over a window
            ("SQUARES", n * n * (n * n - 1.0) / 12.0),
        ];
        let numbers = numbers.map(|(name, value)| format!("const {name}: f32 = {value:e};"));
        let constants = format!("{}\n{}", sweep_constants(side), numbers.join("\n"));
        let sigma: Vec<f32> = noise.sigma().iter().flatten().copied().collect();
        Ok(Self {
            gpu,
            image,
            side,
            classes: noise.sigma()[0].len(),
            sigma: gpu.upload(bytemuck::cast_slice(&sigma), wgpu::BufferUsages::STORAGE)?,
            sweep: SweepBuffers::new(gpu, side)?,
            windows: gpu.kernel("model_windows", &constants, &PARTS)?,
            gather: gpu.kernel("gather", &constants, &PARTS)?,
        })
    }

    fn submit(&self, strip: &CleanStrip) -> Result<Pending, Failure> {
        let [width, height] = strip.padded();
        let windows = strip.windows[0] * strip.windows[1];
        let count = strip.target.pixels();
        let colors = self.gpu.upload(
            bytemuck::cast_slice(&opponent_colors(self.image, strip, [width, height])),
            wgpu::BufferUsages::STORAGE,
        )?;
        let params = self.gpu.uniform(&Params {
            zero: 0,
            width: width as u32,
            windows_x: strip.windows[0] as u32,
            windows: windows as u32,
            stride: strip.stride as u32,
            side: self.side as u32,
            pixels: (self.side * self.side) as u32,
            events: SweepTable::new(self.side).events().len() as u32,
            target_width: strip.target.width as u32,
            lead_x: strip.lead[0] as u32,
            lead_y: strip.lead[1] as u32,
            count: count as u32,
            windows_y: strip.windows[1] as u32,
            classes: self.classes as u32,
        })?;
        let models = self.gpu.output(4 * MODEL_WORDS * windows)?;
        let bytes = 4 * PIXEL_WORDS * count;
        let output = self.gpu.output(bytes)?;
        let mut bindings = vec![(0, &params), (1, &colors), (2, &self.sigma), (7, &models)];
        bindings.extend(self.sweep.opaque_bindings());
        let runs = [
            Run {
                kernel: &self.windows,
                bindings,
                threads: windows,
            },
            Run {
                kernel: &self.gather,
                bindings: vec![(0, &params), (1, &colors), (7, &models), (8, &output)],
                threads: count,
            },
        ];
        self.gpu.submit(&runs, &output, bytes)
    }
}

/// The padded strip, row by row, as four floats a pixel.
fn opponent_colors<P: GpuPixel>(
    image: &Image<P>,
    strip: &CleanStrip,
    [width, height]: [usize; 2],
) -> Vec<[f32; 4]> {
    let mut colors = vec![[0.0; 4]; width * height];
    colors
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, out)| {
            strip.read_row(image, row, |x, [y, u, v]| out[x] = [y, u, v, 0.0]);
        });
    colors
}
