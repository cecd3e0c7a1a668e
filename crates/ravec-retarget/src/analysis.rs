//! The reduction of a picture on which it is analyzed.
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

/// Cells along the longer side of pictures that have more pixels than the reduction, and of those that do not. Factorization
/// takes two thirds of the work for 100 cells, whatever the size of the picture. At 720 × 480 pixels, cells of 14 keep lines as
/// straight as cells of 7, and discs as round within 3 %.
const CELLS: usize = 100;
const CELLS_OF_SMALL: usize = 50;

/// Columns and rows of units for a picture, `cells` along its longer side if given.
pub(crate) fn units_for(size: Size, cells: Option<usize>) -> [usize; 2] {
    let longer = size.width().max(size.height());
    let cells = cells.unwrap_or(if longer <= LONGER_SIDE {
        CELLS_OF_SMALL
    } else {
        CELLS
    });
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
        let field =
            TwoColorField::fit(&image, &FitParams::default(), progress).map_err(cancelled)?;
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

/// Grids of very few cells are analyzed on a smaller reduction.
const MAX_UNIT_PX: usize = 128;

/// Blocks of 8 pixels can always be fitted, so that only a cancellation is left.
pub(crate) fn cancelled(_: FitError) -> RetargetError {
    RetargetError::Cancelled(ravec_progress::Cancelled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Image, Srgba};

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    #[test]
    fn units_are_as_square_as_whole_numbers_allow() {
        assert_eq!(units_for(size(4256, 2832), Some(100)), [100, 67]);
        assert_eq!(units_for(size(2832, 4256), Some(100)), [67, 100]);
        assert_eq!(units_for(size(50, 50), Some(100)), [25, 25]);
        // one pixel wide, one pixel in all, and so long that a square unit would be less than a pixel high
        assert_eq!(units_for(size(1, 300), Some(100)), [1, 100]);
        assert_eq!(units_for(size(1, 1), Some(100)), [1, 1]);
        assert_eq!(units_for(size(1000, 2), Some(400)), [400, 1]);
        // by default
        assert_eq!(units_for(size(720, 480), None), [50, 33]);
        assert_eq!(units_for(size(534, 801), None), [67, 100]);
    }

    #[test]
    fn units_and_two_color_pixels_have_common_borders() {
        let block = FitParams::default().block_px;
        for cells in 1..=400 {
            let unit = pixels_a_unit(cells);
            assert!(
                unit.is_multiple_of(block) || block.is_multiple_of(unit),
                "{cells} cells: {unit} pixels a unit"
            );
            assert!((2..=MAX_UNIT_PX).contains(&unit), "{cells} cells: {unit}");
        }
        // close to the size that is aimed at, where units of whole blocks allow it
        assert_eq!(100 * pixels_a_unit(100), LONGER_SIDE);
    }

    fn analyzed<P: Color + Resample>(image: &Image<P>, units: [usize; 2]) -> Analysis {
        Analysis::new(image, units, &Progress::none()).unwrap()
    }

    #[test]
    fn an_edge_is_where_it_was_drawn() {
        // dark on the left of column 300 of 960, which is column 300 · 40 · 24 / 960 of the reduction
        let drawn = Image::from_fn(size(960, 480), |col, _| {
            LinearRgb([if col < 300 { 0.02 } else { 0.8 }; 3])
        });
        let found = analyzed(&drawn, [40, 20]);
        assert_eq!(
            [found.image.width(), found.image.height()],
            [40, 20].map(|units| units * found.unit_px)
        );
        let block = found.field.block_px();
        let column = 300 * found.image.width() / 960 / block;
        let blocks = found.field.grid_size();
        for (at, pixel) in found.field.blocks().iter().enumerate() {
            let away = (at % blocks.width()).abs_diff(column);
            if away == 0 {
                assert!(pixel.contrast() > 0.4, "block {at}: {}", pixel.contrast());
            } else if away > 1 {
                assert!(pixel.contrast() < 0.01, "block {at}: {}", pixel.contrast());
            }
        }
    }

    #[test]
    fn what_is_transparent_shows_white_and_what_is_no_number_is_dark() {
        let clear = Image::new(size(64, 48), Srgba([0u8, 0, 0, 0]));
        for pixel in analyzed(&clear, [8, 6]).image.pixels() {
            assert!(pixel.0.iter().all(|v| (v - 1.0).abs() < 1e-6), "{pixel:?}");
        }
        let mut broken = Image::new(size(64, 48), LinearRgb([0.5; 3]));
        broken[(20, 20)] = LinearRgb([f32::NAN, f32::INFINITY, -1.0]);
        let found = analyzed(&broken, [8, 6]);
        assert!(
            found
                .image
                .pixels()
                .iter()
                .all(|pixel| pixel.0.iter().all(|v| (0.0..=1e4).contains(v)))
        );
        assert!(
            found
                .field
                .blocks()
                .iter()
                .all(|p| p.contrast().is_finite())
        );
    }
}
