//! Fit and refinement of a picture whose pixels are uploaded once.
//!
//! ```text
//! for each band of block rows, several in flight:
//!     fit it, and keep its pixels on the device
//!     refine its lines from the pixels that lie there
//! ```

use crate::device::Gpu;
use crate::error::Stopped;
use crate::fit::{FITTED_SIDES, Fitter, completed, fit, is_exact};
use crate::refine::{Refiner, refine_lines, refine_rest};
use crate::upload::GpuPixel;
use crate::work::{Pending, bands};
use ravec_progress::Progress;
use ravec_raster::Image;
use ravec_twocolor::{FitError, FitParams, TwoColorField, TwoColorPixel};
use std::ops::Range;

/// The field of `image` with refined lines: what [`fit`] and then [`refine_lines`] give, with one upload of the picture where
/// blocks are fitted exactly. If the device is lost or its memory exhausted, the CPU does the rest.
///
/// # Errors
/// As [`TwoColorField::fit`].
pub fn fit_refined<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
    progress: &Progress,
) -> Result<TwoColorField, FitError> {
    let side = params.block_px;
    if !FITTED_SIDES.contains(&side) || !is_exact(params) || gpu.is_lost() {
        let mut field = fit(gpu, image, params, progress)?;
        refine_lines(gpu, &mut field, image, progress)?;
        return Ok(field);
    }
    let mut blocks = Vec::with_capacity(image.size().cells(side).pixels());
    let result = fit_refined_bands(gpu, image, params, progress, &mut blocks);
    let first = blocks.len();
    let on_cpu = |rows| {
        let rest = TwoColorField::fit_some_rows(image, params, rows, progress)?;
        Ok(refine_rest(image, side, &rest, first, progress)?)
    };
    completed(gpu, image.size(), side, (result, blocks), on_cpu)
}

/// A band with its fitted blocks, whose refinement is in flight.
struct Refining {
    rows: Range<usize>,
    fitted: Vec<TwoColorPixel>,
    pending: Pending,
}

/// Fits and refines band after band and appends whole bands to `blocks`.
fn fit_refined_bands<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
    progress: &Progress,
    blocks: &mut Vec<TwoColorPixel>,
) -> Result<(), Stopped> {
    let fitter = Fitter::new(gpu, image, params)?;
    let refiner = Refiner::new(gpu, image, params.block_px)?;
    let rows_of_blocks = image.size().cells(params.block_px).height();
    let phase = progress.phase("fit", rows_of_blocks as u64);
    let mut finish = |band: Refining| -> Result<(), Stopped> {
        let refined = gpu.receive(&band.pending, progress, |bytes| {
            refiner.refined(&band.rows, &band.fitted, bytes)
        })?;
        phase.advance(band.rows.len() as u64);
        blocks.extend(refined);
        Ok(())
    };
    // a band is received after the next one is submitted, so that the device has work meanwhile
    let mut last: Option<Refining> = None;
    gpu.pipelined(
        bands(rows_of_blocks, fitter.block_rows_in_a_band()),
        progress,
        |rows| fitter.submit_opaque(rows),
        |rows, band, bytes| {
            let fitted = fitter.finish(&band, &rows, bytes, progress)?;
            let pending = refiner.submit(&rows, &fitted, band.source)?;
            let before = last.replace(Refining {
                rows,
                fitted,
                pending,
            });
            before.map_or(Ok(()), &mut finish)
        },
    )?;
    last.map_or(Ok(()), finish)
}
