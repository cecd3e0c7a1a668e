//! Times of the exact fit on a picture that lies on the device, for measurements.
//!
//! Work is repeated within one submission; the difference to doing it once leaves out what a submission costs. Times include
//! gaps between kernels, and the pauses of the thread that waits, which are at most a sixteenth of a submission.

use crate::device::Gpu;
use crate::error::{Failure, GpuError, Stopped};
use crate::fit::{FITTED_SIDES, FirstRun, Fitter, WORDS, sweep_constants};
use crate::upload::{GpuPixel, source_constants};
use crate::work::{Run, Words, bands};
use ravec_progress::Progress;
use ravec_raster::Image;
use ravec_twocolor::FitParams;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Repetitions of the work in a submission.
const REPETITIONS: usize = 20;

/// Work that is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitKernel {
    /// The kernels of [`fit()`](crate::fit()): pixels are sorted into a plane first, so that neighboring threads read neighboring
    /// numbers.
    Plane,
    /// A straightforward port of the loop of the CPU: each thread reads its block from the picture and keeps a copy.
    Straightforward,
}

/// A timed fit.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidentFit {
    /// Time of one fit of the picture, without transfers.
    pub time: Duration,
    /// The number of the best split of each block, row by row; `u32::MAX` for blocks with transparency or beyond the border,
    /// which a run of their own fits.
    pub splits: Vec<u32>,
}

/// Times the exact fit of the opaque blocks of `image`, which is uploaded before.
///
/// # Errors
/// [`GpuError::Stopped`] if the device is lost, or cannot hold the picture with 17 bytes for each pixel beside it.
///
/// # Panics
/// If blocks of this side are not [fitted exactly](FITTED_SIDES) on the device.
pub fn time_resident_fit<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    block_px: usize,
    kernel: FitKernel,
) -> Result<ResidentFit, GpuError> {
    resident_fit(gpu, image, block_px, kernel).map_err(|stopped| of_stopped(gpu, stopped))
}

/// Times the transfers of a fit: the upload of `image`, and the download of as many bytes as [`fit()`](crate::fit()) reads.
///
/// # Errors
/// [`GpuError::Stopped`] if the device is lost or its memory exhausted.
///
/// # Panics
/// If blocks of this side are not [fitted exactly](FITTED_SIDES) on the device.
pub fn time_transfers<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    block_px: usize,
) -> Result<Duration, GpuError> {
    transfers(gpu, image, block_px).map_err(|stopped| of_stopped(gpu, stopped))
}

fn of_stopped(gpu: &Gpu, stopped: Stopped) -> GpuError {
    GpuError::Stopped {
        adapter: gpu.adapter().name.clone(),
        cause: match stopped {
            Stopped::Failed(failure) => failure.to_string(),
            Stopped::Cancelled(cancelled) => cancelled.to_string(),
        },
    }
}

fn fitter<'a, P: GpuPixel>(
    gpu: &'a Gpu,
    image: &'a Image<P>,
    block_px: usize,
) -> Result<Fitter<'a, P>, Failure> {
    assert!(
        FITTED_SIDES.contains(&block_px),
        "no exact fit of this side"
    );
    let params = FitParams {
        block_px,
        ..FitParams::default()
    };
    Fitter::new(gpu, image, &params)
}

fn resident_fit<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    block_px: usize,
    kernel: FitKernel,
) -> Result<ResidentFit, Stopped> {
    let fitter = fitter(gpu, image, block_px)?;
    let straightforward = match kernel {
        FitKernel::Plane => None,
        FitKernel::Straightforward => Some(Straightforward::new::<P>(gpu, block_px)?),
    };
    let rows_of_blocks = image.size().cells(block_px).height();
    let resident: Vec<FirstRun> = bands(rows_of_blocks, fitter.block_rows_in_a_band())
        .map(|rows| fitter.first_run(&rows))
        .collect::<Result<_, _>>()?;
    let runs = |repetitions: usize| -> Vec<Run<'_>> {
        let once = || {
            resident.iter().flat_map(|band| match &straightforward {
                None => Vec::from(band.runs(&fitter)),
                Some(kernel) => vec![kernel.run(band, &fitter)],
            })
        };
        std::iter::repeat_with(once)
            .take(repetitions)
            .flatten()
            .collect()
    };
    let Some(last) = resident.last() else {
        return Ok(ResidentFit {
            time: Duration::ZERO,
            splits: Vec::new(),
        });
    };
    let timed = |repetitions: usize| -> Result<Duration, Stopped> {
        let pending = gpu.submit(&runs(repetitions), &last.output, last.bytes())?;
        gpu.receive(&pending, &Progress::none(), |_| pending.submitted.elapsed())
    };
    // the first submission compiles and touches memory
    timed(1)?;
    let once = timed(1)?;
    let often = timed(1 + REPETITIONS)?;
    let mut splits = Vec::new();
    for band in &resident {
        let pending = gpu.submit(&[], &band.output, band.bytes())?;
        gpu.receive(&pending, &Progress::none(), |bytes| {
            let words = Words::new(bytes);
            splits.extend((0..band.blocks).map(|block| words.word(WORDS * block)));
        })?;
    }
    Ok(ResidentFit {
        time: often.saturating_sub(once) / REPETITIONS as u32,
        splits,
    })
}

fn transfers<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    block_px: usize,
) -> Result<Duration, Stopped> {
    let fitter = fitter(gpu, image, block_px)?;
    let grid = image.size().cells(block_px);
    let start = Instant::now();
    gpu.pipelined(
        bands(grid.height(), fitter.block_rows_in_a_band()),
        &Progress::none(),
        |rows| {
            let source = gpu.upload_rows(image, fitter.pixel_rows(&rows))?;
            let bytes = 4 * WORDS * grid.width() * rows.len();
            let pending = gpu.submit(&[], &gpu.output(bytes)?, bytes)?;
            Ok((source, pending))
        },
        |_, _, _| Ok(()),
    )?;
    Ok(start.elapsed())
}

/// The kernel of [`FitKernel::Straightforward`].
struct Straightforward {
    kernel: Arc<wgpu::ComputePipeline>,
    light: Arc<wgpu::Buffer>,
}

impl Straightforward {
    fn new<P: GpuPixel>(gpu: &Gpu, block_px: usize) -> Result<Self, Failure> {
        let constants = format!("{}\n{}", source_constants::<P>(), sweep_constants(block_px));
        let parts = [
            include_str!("shaders/exact.wgsl"),
            include_str!("shaders/color.wgsl"),
            include_str!("shaders/source.wgsl"),
            include_str!("shaders/weighted_oklab.wgsl"),
            include_str!("shaders/weights.wgsl"),
            include_str!("shaders/sweep.wgsl"),
            include_str!("shaders/fit_results.wgsl"),
            include_str!("shaders/fit_straightforward.wgsl"),
        ];
        Ok(Self {
            kernel: gpu.kernel("fit_straightforward", &constants, &parts)?,
            light: gpu.light::<P>()?,
        })
    }

    fn run<'a, P>(&'a self, band: &'a FirstRun, fitter: &'a Fitter<'_, P>) -> Run<'a> {
        let mut bindings = vec![
            (0, &band.params),
            (1, &band.plane.source),
            (2, &*self.light),
            (7, &band.output),
        ];
        bindings.extend(fitter.sweep.opaque_bindings());
        Run {
            kernel: &self.kernel,
            bindings,
            threads: band.blocks,
        }
    }
}
