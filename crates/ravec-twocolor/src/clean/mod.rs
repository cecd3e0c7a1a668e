//! Cleaning: noise and compression damage taken off, edges left where they are.
//!
//! Every window of the image is split by its best line; each side is modeled as a shrunken plane plus a shrunken
//! residual (a Wiener filter whose support ends at the edge); and each pixel takes the weighted mean of what all windows
//! over it estimate. The steps, under their names in [`window`]:
//!
//! 1. orthonormal opponent transform of the *encoded* values, which keeps the noise equal and uncorrelated per channel,
//! 2. exact split of each N × N window at a stride; two sides if the gain exceeds what noise alone would give,
//! 3. per side and channel: mean, slope, and how much of the slope stands out of the noise,
//! 4. per side and channel: how much of the residual stands out of the noise,
//! 5. estimate, weighted by the inverse of its expected variance.
//!
//! If the picture was compressed in blocks, the strength follows from the quantization steps, which its file says or which
//! it still shows, and the result keeps to what they allow (see [`compression`]).
//!
//! Source: dissertation, chapter 3 (averaging overlapping windows, weighted by fit). We differ in the model of a side:
//! two constants alone lose texture and gradients (31.3 dB against 32.8 on photos with noise of 15 steps).
//!
//! Guarantees: the same bits for any region, number of threads and instruction set; alpha is untouched, and so are the
//! colors of fully transparent pixels. Does not guarantee: that texture below the noise survives.
//!
//! Cost: O(pixels / stride²) exact fits. Memory: the result, and for each thread 10 MB, or 62 rows of the region if they take more.

mod compression;
mod dct;
mod drawn;
mod noise;
mod strip;
mod window;

pub use compression::BlockQuantization;
pub use noise::{NoiseLevel, estimate_noise, estimate_noise_of_compressed};
pub use strip::CleanStrip;
pub use window::WindowShrinkage;

use crate::filter_error::FilterError;
use crate::split_table::split_table;
use fearless_simd::{Level, dispatch};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, LinearRgba, LinearRows, Rect, Size};
use rayon::prelude::*;
use strip::{Strip, StripMemory};

/// Parameters of cleaning.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CleanParams {
    /// Standard deviation of the noise, in steps of 8-bit encoded values, 0 to 255; estimated from the image when not
    /// given (default); then the damage of block compression is detected, too. More removes more, texture included; an estimate 10 % off costs 0.4 dB.
    pub noise_sigma: Option<f32>,
    /// Side of a window in pixels, 4 to 16 (default 8). Larger windows average more and adapt less; cost grows with the
    /// fourth power.
    pub window_px: usize,
    /// Distance of neighboring windows in pixels, 1 to `window_px` (default 2). Twice the stride costs a quarter, loses
    /// 0.3 dB, and beyond half a window begins to show the grid.
    pub stride_px: usize,
}

impl Default for CleanParams {
    fn default() -> Self {
        Self {
            noise_sigma: None,
            window_px: 8,
            stride_px: 2,
        }
    }
}

/// The cleaned pixels of `region` (clipped to the image).
///
/// # Errors
/// [`FilterError::Window`] if the window is below 4 or above 16, [`FilterError::Stride`] if the stride is 0 or larger than
/// the window, [`FilterError::Noise`] if the noise is negative or not finite, [`FilterError::EmptyRegion`] if the region has no
/// pixel of the image, [`FilterError::Cancelled`] soon after `progress` is.
pub fn clean<P: Color>(
    image: &Image<P>,
    region: Rect,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    match params.noise_sigma {
        Some(sigma) if !(0.0..=255.0).contains(&sigma) => Err(FilterError::Noise { got: sigma }),
        Some(sigma) => clean_with(image, region, &NoiseLevel::uniform(sigma), params, progress),
        None => clean_with(
            image,
            region,
            &estimate_noise(image, progress)?,
            params,
            progress,
        ),
    }
}

/// [`clean`] with a noise level that was estimated before, of which `params.noise_sigma` says nothing.
///
/// # Errors
/// As [`clean`].
pub fn clean_with<P: Color>(
    image: &Image<P>,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    clean_by(image, region, noise, params, progress, |region| {
        clean_region(image, region, noise, params, progress)
    })
}

/// [`clean_with`] with steps 1 to 5 computed by `clean_region`, which returns the cleaned pixels of a part of the image.
///
/// # Errors
/// As [`clean`], and those of `clean_region`.
pub fn clean_by(
    image: &dyn LinearRows,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
    clean_region: impl FnOnce(Rect) -> Result<Image<LinearRgba>, FilterError>,
) -> Result<Image<LinearRgba>, FilterError> {
    let (side, stride) = (params.window_px, params.stride_px);
    if !(4..=16).contains(&side) {
        return Err(FilterError::Window {
            got: side,
            expected: "4 to 16",
        });
    }
    if !(1..=side).contains(&stride) {
        return Err(FilterError::Stride { got: stride, side });
    }
    let region = region.intersection(Rect::of(image.size()));
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    if noise.is_none() {
        return Ok(part_of(image, region, size));
    }
    let Some(compression) = &noise.compression else {
        return clean_region(region);
    };
    // a block's coefficients need the whole block
    let whole = compression.whole_blocks(region, image.size());
    let mut cleaned = clean_region(whole)?;
    compression.bound(image, whole, &mut cleaned, progress)?;
    if whole == region {
        return Ok(cleaned);
    }
    cleaned
        .crop(region.col - whole.col, region.row - whole.row, size)
        .map_err(|_| FilterError::EmptyRegion)
}

/// The pixels of `region`, whose size is `size`, as they are.
fn part_of(image: &dyn LinearRows, region: Rect, size: Size) -> Image<LinearRgba> {
    let mut part = Image::new(size, LinearRgba::default());
    part.for_each_row(|row, out| image.read_linear(region.row + row, region.col, out));
    part
}

/// Steps 1 to 5 over a region that lies within the image. A thin column is cleaned as a row, because the lanes of vectors run
/// along rows.
fn clean_region(
    image: &dyn LinearRows,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let size = image.size();
    if size.width() >= CleanStrip::MIN_SIDE || size.width() >= size.height() {
        return clean_rows(image, region, noise, params, progress);
    }
    let whole = part_of(image, Rect::of(size), size);
    let row = Image::from_fn(size.transposed(), |col, row| whole[(row, col)]);
    drop(whole);
    let lying = Rect::new(region.row, region.col, region.height, region.width);
    let cleaned = clean_rows(&row, lying, noise, params, progress)?;
    Ok(Image::from_fn(cleaned.size().transposed(), |col, row| {
        cleaned[(row, col)]
    }))
}

/// [`clean_region`] by strips of rows.
fn clean_rows(
    image: &dyn LinearRows,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let (side, stride) = (params.window_px, params.stride_px);
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    let table = split_table(side);
    let level = Level::new();
    let mut result = Image::new(size, LinearRgba::default());
    let phase = progress.phase("clean", size.height() as u64);
    let strip_rows = strip_rows(size);
    let clean_part = |target: Rect, memory: &mut StripMemory, out: &mut [LinearRgba]| {
        progress.check()?;
        *memory = dispatch!(level, simd => {
            let grid = CleanStrip::new(target, side, stride).without_repeats(image.size().height());
            let mut strip = Strip::read(simd, image, grid, std::mem::take(memory));
            window::clean_windows(simd, &mut strip, table, noise, progress)?;
            strip.write(image, out);
            Ok(strip.into_memory())
        })?;
        Ok::<(), Cancelled>(())
    };
    let strips = result.par_strips_mut(strip_rows).enumerate();
    strips.try_for_each_init(StripMemory::default, |memory, (strip, out)| {
        let rows = out.len() / region.width;
        let top = region.row + strip * strip_rows;
        if region.width <= MAX_STRIP_COLUMNS {
            let target = Rect::new(region.col, top, region.width, rows);
            clean_part(target, memory, out)?;
        } else {
            let parts: Vec<Rect> = (0..region.width)
                .step_by(STRIP_COLUMNS)
                .map(|col| {
                    let width = STRIP_COLUMNS.min(region.width - col);
                    Rect::new(region.col + col, top, width, rows)
                })
                .collect();
            let cleaned: Vec<Vec<LinearRgba>> = parts
                .par_iter()
                .map_init(StripMemory::default, |memory, &target| {
                    let mut part = vec![LinearRgba::default(); target.pixels()];
                    clean_part(target, memory, &mut part)?;
                    Ok(part)
                })
                .collect::<Result<_, Cancelled>>()?;
            for (target, part) in parts.iter().zip(cleaned) {
                let left = target.col - region.col;
                let rows = out.chunks_exact_mut(region.width);
                for (row, part) in rows.zip(part.chunks_exact(target.width)) {
                    row[left..][..target.width].copy_from_slice(part);
                }
            }
        }
        phase.advance(rows as u64);
        Ok::<(), Cancelled>(())
    })?;
    Ok(result)
}

/// Columns above which a strip is cleaned in parts of [`STRIP_COLUMNS`], so that its windows do not take much more memory than
/// its pixels. Parts cost what windows over their borders cost twice.
const MAX_STRIP_COLUMNS: usize = 1 << 15;
const STRIP_COLUMNS: usize = 1 << 13;

/// Rows cleaned by one task, at least and at most. Windows that reach over its border are fitted by both neighbors, so fewer rows cost
/// more: an eighth at 48 rows and windows of 8.
const STRIP_ROWS: std::ops::RangeInclusive<usize> = 48..=192;

/// Pixels of a strip: 36 bytes each.
const STRIP_PIXELS: usize = 1 << 18;

/// The rows of a task for a region of this size: two tasks a thread, if they are high enough. The result does not depend on it.
fn strip_rows(size: Size) -> usize {
    let shared = size.height().div_ceil(2 * rayon::current_num_threads());
    let rows = shared.min(STRIP_PIXELS / size.width());
    rows.clamp(*STRIP_ROWS.start(), *STRIP_ROWS.end())
}
