//! The exact fit, one block a thread.
//!
//! ```text
//! for each band of block rows, several in flight:
//!     upload its pixels as they are in memory
//!     fit the blocks that are opaque and whole, one a thread
//!     fit those with transparency, or beyond the border, in a second run
//!     lines and colors follow on the CPU, from the sums of the best split
//! ```
//!
//! Guarantee: the field is that of [`TwoColorField::fit`], bit for bit, on every device that [`Gpu::open`] accepts, whether
//! the device lasts or not. Cost: the sweep takes 10 operations a split, and 36 bytes of private memory; the pixels of the
//! picture are read once.

use crate::coarse_to_fine::{self, COARSE_TO_FINE_SIDES};
use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::plane::{MAX_PLANE_PIXELS, Plane, PlaneColor, Planes};
use crate::upload::GpuPixel;
use crate::work::{Pending, Run, Words, bands};
use ravec_progress::Progress;
use ravec_raster::{Image, Size};
use ravec_twocolor::{
    FitError, FitMethod, FitParams, MIN_FITTED_WEIGHT, SplitSums, SweepTable, TwoColorField,
    TwoColorPixel,
};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Sides of blocks that are fitted on the device: in blocks of these sides the fits with and without weights agree to the bit,
/// since the inverse of their number of pixels is exact.
pub const FITTED_SIDES: [usize; 4] = [2, 4, 8, 16];

/// Words that the kernels store for a block: see `fit_results.wgsl`.
pub(crate) const WORDS: usize = 9;
const WEIGHTED_WORDS: usize = 13;
const NOT_FITTED: u32 = u32::MAX;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    zero: u32,
    width: u32,
    rows: u32,
    columns_of_blocks: u32,
    blocks: u32,
    count: u32,
    side: u32,
    pixels: u32,
    events: u32,
}

/// Buffers of the tables of a sweep, in the order of their bindings.
pub(crate) struct SweepBuffers {
    pub order: Arc<wgpu::Buffer>,
    pub events: Arc<wgpu::Buffer>,
    pub gain_weights: Arc<wgpu::Buffer>,
    pub lines: Arc<wgpu::Buffer>,
}

impl SweepBuffers {
    pub fn new(gpu: &Gpu, side: usize) -> Result<Self, Failure> {
        let table = SweepTable::new(side);
        let packed = |[prefix, pixel]: [u16; 2]| u32::from(prefix) | u32::from(pixel) << 16;
        Ok(Self {
            order: gpu.table(&format!("order {side}"), || {
                table
                    .initial_order()
                    .iter()
                    .map(|&pixel| u32::from(pixel))
                    .collect()
            })?,
            events: gpu.table(&format!("events {side}"), || {
                table.events().map(packed).collect()
            })?,
            gain_weights: gpu
                .table(&format!("weights {side}"), || table.gain_weights().to_vec())?,
            lines: gpu.table(&format!("lines {side}"), || table.lines().collect())?,
        })
    }

    /// The bindings of the sweep over opaque blocks.
    pub fn opaque_bindings(&self) -> [(u32, &wgpu::Buffer); 4] {
        [
            (3, &self.order),
            (4, &self.events),
            (5, &self.gain_weights),
            (6, &self.lines),
        ]
    }

    /// The bindings of the sweep over blocks with weights, whose gains have no table.
    pub fn weighted_bindings(&self) -> [(u32, &wgpu::Buffer); 3] {
        [(3, &self.order), (4, &self.events), (6, &self.lines)]
    }
}

/// The constants of a shader with a sweep.
pub(crate) fn sweep_constants(side: usize) -> String {
    format!("const SIDE: u32 = {side}u;\nconst MIN_WEIGHT: f32 = {MIN_FITTED_WEIGHT:e};")
}

/// The shader of the fit.
const PARTS: [&str; 6] = [
    include_str!("shaders/exact.wgsl"),
    include_str!("shaders/weights.wgsl"),
    include_str!("shaders/sweep.wgsl"),
    include_str!("shaders/weighted_sweep.wgsl"),
    include_str!("shaders/fit_results.wgsl"),
    include_str!("shaders/fit.wgsl"),
];

/// The field of `image`: what [`TwoColorField::fit`] gives.
///
/// Blocks of [`FITTED_SIDES`] are fitted exactly on the device, those of [`COARSE_TO_FINE_SIDES`] coarse to fine if a
/// row of blocks has at most 2 million pixels; others on the CPU. If the device is lost or
/// its memory exhausted, the CPU fits the rest, and [`Gpu::take_warnings`] says so.
///
/// # Errors
/// As [`TwoColorField::fit`].
pub fn fit<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
    progress: &Progress,
) -> Result<TwoColorField, FitError> {
    let side = params.block_px;
    let is_exact = is_exact(params);
    let sides = if is_exact {
        &FITTED_SIDES
    } else {
        &COARSE_TO_FINE_SIDES
    };
    let fits = is_exact || coarse_to_fine::fits(image.width(), side);
    if !sides.contains(&side) || !fits || gpu.is_lost() {
        return TwoColorField::fit(image, params, progress);
    }
    let grid = image.size().cells(side);
    let mut blocks = Vec::with_capacity(grid.pixels());
    let result = if is_exact {
        fit_bands(gpu, image, params, progress, &mut blocks)
    } else {
        coarse_to_fine::fit_bands(gpu, image, params, progress, &mut blocks)
    };
    let on_cpu = |rows| TwoColorField::fit_some_rows(image, params, rows, progress);
    completed(gpu, image.size(), side, (result, blocks), on_cpu)
}

/// The field of the blocks that the device has fitted. `on_cpu` fits the rows that it has left.
pub(crate) fn completed(
    gpu: &Gpu,
    size: Size,
    side: usize,
    (result, mut blocks): (Result<(), Stopped>, Vec<TwoColorPixel>),
    on_cpu: impl FnOnce(Range<usize>) -> Result<Vec<TwoColorPixel>, FitError>,
) -> Result<TwoColorField, FitError> {
    match result {
        Ok(()) => {}
        Err(Stopped::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the fit", &failure);
            let grid = size.cells(side);
            blocks.extend(on_cpu(blocks.len() / grid.width()..grid.height())?);
        }
    }
    Ok(TwoColorField::from_blocks(size, side, blocks))
}

/// True if the method of the CPU for these parameters examines all splits of a block.
pub(crate) fn is_exact(params: &FitParams) -> bool {
    match params.method {
        // the CPU fits larger blocks coarse to fine
        FitMethod::Auto => FITTED_SIDES.contains(&params.block_px),
        FitMethod::Exact => true,
        FitMethod::CoarseToFine => false,
    }
}

/// Fits band after band and appends whole bands to `blocks`.
fn fit_bands<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
    progress: &Progress,
    blocks: &mut Vec<TwoColorPixel>,
) -> Result<(), Stopped> {
    let fitter = Fitter::new(gpu, image, params)?;
    let grid = image.size().cells(params.block_px);
    let phase = progress.phase("fit", grid.height() as u64);
    let rows = fitter.block_rows_in_a_band();
    gpu.pipelined(
        bands(grid.height(), rows),
        progress,
        |rows| fitter.submit_opaque(rows),
        |rows, band, bytes| {
            phase.advance(rows.len() as u64);
            blocks.extend(fitter.finish(&band, &rows, bytes, progress)?);
            Ok(())
        },
    )
}

/// A band on the device.
pub(crate) struct Band {
    /// Its rows in the pixel type of the picture.
    pub source: wgpu::Buffer,
    /// Its plane, for the blocks of a second run.
    plane: wgpu::Buffer,
}

/// The first run on a band, which fits its opaque blocks.
pub(crate) struct FirstRun {
    pub plane: Plane,
    pub params: wgpu::Buffer,
    pub output: wgpu::Buffer,
    pub blocks: usize,
}

impl FirstRun {
    /// Bytes of the results.
    pub fn bytes(&self) -> usize {
        4 * WORDS * self.blocks
    }

    /// Fills the plane, and fits its blocks.
    pub fn runs<'a, P>(&'a self, fitter: &'a Fitter<'_, P>) -> [Run<'a>; 2] {
        let mut bindings = vec![
            (0, &self.params),
            (1, &self.plane.buffer),
            (7, &self.output),
        ];
        bindings.extend(fitter.sweep.opaque_bindings());
        let fit = Run {
            kernel: &fitter.opaque,
            bindings,
            threads: self.blocks,
        };
        [self.plane.run(&fitter.planes), fit]
    }
}

/// State shared by the bands of a picture.
pub(crate) struct Fitter<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    side: usize,
    flat_contrast: f32,
    columns: usize,
    planes: Planes,
    pub sweep: SweepBuffers,
    opaque: Arc<wgpu::ComputePipeline>,
}

impl<'a, P: GpuPixel> Fitter<'a, P> {
    pub fn new(gpu: &'a Gpu, image: &'a Image<P>, params: &FitParams) -> Result<Self, Failure> {
        let side = params.block_px;
        Ok(Self {
            gpu,
            image,
            side,
            flat_contrast: params.flat_contrast,
            columns: image.size().cells(side).width(),
            planes: Planes::new::<P>(gpu, PlaneColor::Oklab)?,
            sweep: SweepBuffers::new(gpu, side)?,
            opaque: gpu.kernel("fit_opaque", &sweep_constants(side), &PARTS)?,
        })
    }

    pub fn block_rows_in_a_band(&self) -> usize {
        let row = self.columns * self.side * self.side;
        (MAX_PLANE_PIXELS / row).max(1)
    }

    pub fn pixel_rows(&self, block_rows: &Range<usize>) -> Range<usize> {
        block_rows.start * self.side..(block_rows.end * self.side).min(self.image.height())
    }

    fn params(&self, block_rows: &Range<usize>, count: usize) -> Result<wgpu::Buffer, Failure> {
        self.gpu.uniform(&Params {
            zero: 0,
            width: self.image.width() as u32,
            rows: self.pixel_rows(block_rows).len() as u32,
            columns_of_blocks: self.columns as u32,
            blocks: (self.columns * block_rows.len()) as u32,
            count: count as u32,
            side: self.side as u32,
            pixels: (self.side * self.side) as u32,
            events: SweepTable::new(self.side).events().len() as u32,
        })
    }

    /// Uploads a band and starts the first run on it.
    pub fn submit_opaque(&self, block_rows: Range<usize>) -> Result<(Band, Pending), Failure> {
        let first = self.first_run(&block_rows)?;
        let pending = (self.gpu).submit(&first.runs(self), &first.output, first.bytes())?;
        let Plane { source, buffer, .. } = first.plane;
        let plane = buffer;
        Ok((Band { source, plane }, pending))
    }

    /// Uploads a band, for the first run on it.
    pub fn first_run(&self, block_rows: &Range<usize>) -> Result<FirstRun, Failure> {
        let rows = self.pixel_rows(block_rows);
        let blocks = self.columns * block_rows.len();
        Ok(FirstRun {
            plane: Plane::new(self.gpu, self.image, rows, self.side)?,
            params: self.params(block_rows, blocks)?,
            output: self.gpu.output(4 * WORDS * blocks)?,
            blocks,
        })
    }

    /// The pixels of a band, from what the first run found and a second one finds.
    pub fn finish(
        &self,
        band: &Band,
        block_rows: &Range<usize>,
        bytes: &[u8],
        progress: &Progress,
    ) -> Result<Vec<TwoColorPixel>, Stopped> {
        let words = Words::new(bytes);
        let count = self.columns * block_rows.len();
        let rest: Vec<u32> = (0..count as u32)
            .filter(|&block| words.word(WORDS * block as usize) == NOT_FITTED)
            .collect();
        let mut pixels: Vec<TwoColorPixel> = (0..count)
            .into_par_iter()
            .map(|block| {
                let sums = sums(&words, WORDS * block);
                // blocks of the second run have no event yet
                let sums = SplitSums {
                    event: if sums.event == NOT_FITTED {
                        0
                    } else {
                        sums.event
                    },
                    ..sums
                };
                sums.opaque_pixel(self.side, self.flat_contrast)
            })
            .collect();
        if !rest.is_empty() {
            let pending = self.submit_weighted(&band.plane, block_rows, &rest)?;
            self.gpu.receive(&pending, progress, |bytes| {
                let words = Words::new(bytes);
                for (index, &block) in rest.iter().enumerate() {
                    let at = WEIGHTED_WORDS * index;
                    let sums = SplitSums {
                        weights: words.floats(at + WORDS),
                        insides: words.floats(at + WORDS + 2),
                        ..sums(&words, at)
                    };
                    pixels[block as usize] = sums.weighted_pixel(self.side, self.flat_contrast);
                }
            })?;
        }
        Ok(pixels)
    }

    fn submit_weighted(
        &self,
        plane: &wgpu::Buffer,
        block_rows: &Range<usize>,
        rest: &[u32],
    ) -> Result<Pending, Failure> {
        let kernel = self
            .gpu
            .kernel("fit_weighted", &sweep_constants(self.side), &PARTS)?;
        let params = self.params(block_rows, rest.len())?;
        let blocks = self
            .gpu
            .upload(bytemuck::cast_slice(rest), wgpu::BufferUsages::STORAGE)?;
        let bytes = 4 * WEIGHTED_WORDS * rest.len();
        let output = self.gpu.output(bytes)?;
        let mut bindings = vec![(0, &params), (1, plane), (7, &output), (8, &blocks)];
        bindings.extend(self.sweep.weighted_bindings());
        let run = Run {
            kernel: &kernel,
            bindings,
            threads: rest.len(),
        };
        self.gpu.submit(&[run], &output, bytes)
    }
}

fn sums(words: &Words<'_>, at: usize) -> SplitSums {
    let [gain, energy] = words.floats(at + 1);
    SplitSums {
        event: words.word(at),
        gain,
        energy,
        mean: words.floats(at + 3),
        sum_0: words.floats(at + 6),
        ..SplitSums::default()
    }
}
