//! The reduction of a picture on which it is analysed.
//!
//! It is aligned to the grid: a whole number of its pixels makes a unit, so that two-color pixels and units have common
//! borders. About 800 pixels on the longer side are enough: lines are found to a fraction of a pixel there, and the
//! deformation varies only over whole units.

use crate::params::RetargetError;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgb, LinearRgba, Resample, ResizeFilter, Size, resize};
use ravec_twocolor::{FitError, FitParams, TwoColorField};

/// The longer side that is aimed at. More finds finer lines in pictures that have them, and costs in proportion to the square.
const LONGER_SIDE: usize = 800;

pub(crate) struct Analysis {
    /// Columns and rows of units.
    pub(crate) units: [usize; 2],
    /// Pixels of the reduction a unit.
    pub(crate) unit_px: usize,
    pub(crate) image: Image<LinearRgb>,
    pub(crate) field: TwoColorField,
}

/// Columns and rows of units for a picture, `cells` along its longer side.
pub(crate) fn units_for(size: Size, cells: usize) -> [usize; 2] {
    let longer = size.width().max(size.height());
    // a unit has at least two pixels a side
    let cells = cells.min(longer.div_ceil(2));
    [size.width(), size.height()].map(|side| {
        let units = (cells as f64 * side as f64 / longer as f64).round() as usize;
        units.clamp(1, side)
    })
}

impl Analysis {
    pub(crate) fn new<P: Color + Resample>(
        image: &Image<P>,
        units: [usize; 2],
        progress: &Progress,
    ) -> Result<Self, RetargetError> {
        let unit_px = pixels_a_unit(units[0].max(units[1]));
        let too_large = |_| RetargetError::Singular;
        let size = Size::new(units[0] * unit_px, units[1] * unit_px).map_err(too_large)?;
        progress.check()?;
        // boxes have steps where a picture grows, or shrinks by little
        let filter = if image.width() >= 2 * size.width() {
            ResizeFilter::Box
        } else {
            ResizeFilter::Mitchell
        };
        let reduced = resize(image, size, filter);
        progress.check()?;
        // what is transparent shows what a viewer would put behind it, which is most often white
        let image = reduced.map(|pixel| {
            let LinearRgba([r, g, b, alpha]) = pixel.to_linear();
            LinearRgb([r, g, b].map(|v| {
                let over = v * alpha + 1.0 - alpha;
                if over.is_finite() {
                    over.clamp(0.0, 1e4)
                } else {
                    0.0
                }
            }))
        });
        let mut field =
            TwoColorField::fit(&image, &FitParams::default(), progress).map_err(cancelled)?;
        field.refine_lines(&image, progress)?;
        Ok(Self {
            units,
            unit_px,
            image,
            field,
        })
    }
}

/// Pixels of the reduction a unit: whole two-color pixels, or a whole part of one.
fn pixels_a_unit(units: usize) -> usize {
    let block = FitParams::default().block_px;
    match LONGER_SIDE / units {
        0..=2 => 2,
        3..=5 => block / 2,
        wanted => (wanted + block / 2) / block * block,
    }
    .min(MAX_UNIT_PX)
}

/// Grids of very few cells are analysed on a smaller reduction.
const MAX_UNIT_PX: usize = 128;

/// Blocks of 8 pixels can always be fitted, so that only a cancellation is left.
pub(crate) fn cancelled(_: FitError) -> RetargetError {
    RetargetError::Cancelled(ravec_progress::Cancelled)
}
