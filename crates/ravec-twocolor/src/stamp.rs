//! Stamps: a picture made of scattered two-color squares, one over another.
//!
//! Squares stand on a jittered grid, closer than they are wide, each with the split and colors of the window under it.
//! Which of two overlapping squares lies on top is drawn from the seed, once for the whole picture, so that any region
//! shows the same squares.

use crate::field::{FitParams, TwoColorField};
use crate::filter_error::FilterError;
use crate::line::Line;
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, LinearRgba, PremulLinearRgba, Rect, Size};
use rayon::prelude::*;

/// Distance of neighboring squares relative to their side: 0.7 covers every pixel whatever the jitter.
const SPACING: f64 = 0.7;

/// Largest displacement of a square from its grid point, relative to the spacing.
const JITTER: f64 = 0.2;

/// Place of a square.
struct Place {
    left: i64,
    top: i64,
    /// The highest lies on top.
    rank: u64,
}

impl Place {
    /// The place of grid point `(i, j)`.
    fn of([i, j]: [i64; 2], side: usize, spacing: f64, seed: u64) -> Self {
        let random = hash(seed, i, j);
        let part = |shift: u32| {
            ((random >> shift & 0xffff) as f64 / 65535.0 - 0.5) * 2.0 * JITTER * spacing
        };
        let corner = |index: i64, jitter: f64| {
            ((index as f64 + 0.5) * spacing + jitter).round() as i64 - side as i64 / 2
        };
        Self {
            left: corner(i, part(0)),
            top: corner(j, part(16)),
            rank: hash(!seed, i, j),
        }
    }

    fn touches(&self, side: usize, region: Rect) -> bool {
        let overlap = |begin: i64, low: usize, high: usize| {
            begin < high as i64 && begin + side as i64 > low as i64
        };
        overlap(self.left, region.col, region.right())
            && overlap(self.top, region.row, region.bottom())
    }
}

/// A square on the picture.
struct Stamp {
    place: Place,
    line: Option<Line>,
    colors: [PremulLinearRgba; 2],
}

/// The pixels of `region`, which must lie in the image, drawn as squares of `side` pixels.
pub(crate) fn stamp<P: Color>(
    image: &Image<P>,
    region: Rect,
    side: usize,
    seed: u64,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    let spacing = SPACING * side as f64;
    let reach = side as f64;
    // the grid points whose squares may reach the region
    let first = |begin: usize| ((begin as f64 - reach) / spacing).floor() as i64;
    let last = |end: usize| ((end as f64 + reach) / spacing).ceil() as i64;
    let columns = first(region.col)..=last(region.right());
    let rows: Vec<i64> = (first(region.row)..=last(region.bottom())).collect();
    let phase = progress.phase("stamp", rows.len() as u64);
    let stamps: Vec<Vec<Stamp>> = rows
        .into_par_iter()
        .map(|j| {
            progress.check()?;
            phase.advance(1);
            let places = columns
                .clone()
                .map(|i| Place::of([i, j], side, spacing, seed))
                .filter(|place| place.touches(side, region));
            fit_row(image, side, places.collect())
        })
        .collect::<Result<_, FilterError>>()?;
    let stamps: Vec<Stamp> = stamps.into_iter().flatten().collect();

    let mut result = Image::new(size, LinearRgba::default());
    result
        .par_strips_mut(STRIP_ROWS)
        .enumerate()
        .try_for_each(|(strip, out)| {
            progress.check()?;
            draw(&stamps, side, region, region.row + strip * STRIP_ROWS, out);
            Ok::<(), Cancelled>(())
        })?;
    Ok(result)
}

/// Rows drawn by one task.
const STRIP_ROWS: usize = 16;

/// The squares of some places, each with the split and colors of the window under it: fitted side by side, as one picture
/// of windows, because fits of several blocks share vectors.
fn fit_row<P: Color>(
    image: &Image<P>,
    side: usize,
    places: Vec<Place>,
) -> Result<Vec<Stamp>, FilterError> {
    if places.is_empty() {
        return Ok(vec![]);
    }
    // where a square hangs over the border, the window is moved inside; a smaller picture goes on with its last pixels
    let inside =
        |position: i64, len: usize| position.clamp(0, (len as i64 - side as i64).max(0)) as usize;
    let windows = Size::new(places.len() * side, side).map_err(|_| FilterError::EmptyRegion)?;
    let mut row = Image::new(windows, LinearRgba::default());
    for (index, place) in places.iter().enumerate() {
        let left = inside(place.left, image.width());
        let top = inside(place.top, image.height());
        for y in 0..side {
            let source = image.row((top + y).min(image.height() - 1));
            let target = &mut row.row_mut(y)[index * side..][..side];
            for (x, target) in target.iter_mut().enumerate() {
                *target = source[(left + x).min(image.width() - 1)].to_linear();
            }
        }
    }
    let params = FitParams {
        block_px: side,
        ..FitParams::default()
    };
    let field = TwoColorField::fit(&row, &params, &Progress::none())?;
    let stamps = places.into_iter().enumerate().map(|(index, place)| {
        let pixel = field.block(index, 0);
        Stamp {
            place,
            line: pixel.line,
            colors: [0, 1].map(|s| {
                let color = pixel.colors[s].to_linear().rgb();
                let straight = LinearRgba::from_rgb_alpha(color, pixel.alphas[s]);
                PremulLinearRgba::from_linear(straight)
            }),
        }
    });
    Ok(stamps.collect())
}

impl Stamp {
    /// The color of the square at a pixel, or nothing beside it.
    fn color_at(&self, side: usize, col: usize, row: usize) -> Option<PremulLinearRgba> {
        let (x, y) = (col as i64 - self.place.left, row as i64 - self.place.top);
        let inside = |v: i64| (0..side as i64).contains(&v);
        if !inside(x) || !inside(y) {
            return None;
        }
        let half = 0.5 * (side as f64 - 1.0);
        let share = self.line.map_or(1.0, |line| {
            line.coverage(DVec2::new(x as f64 - half, y as f64 - half))
        });
        let share = share as f32;
        let [c0, c1] = self.colors;
        Some(PremulLinearRgba(std::array::from_fn(|c| {
            share * c0.0[c] + (1.0 - share) * c1.0[c]
        })))
    }
}

/// Draws the topmost square at every pixel of some rows of the region.
fn draw(stamps: &[Stamp], side: usize, region: Rect, first_row: usize, out: &mut [LinearRgba]) {
    let rows = out.len() / region.width;
    let mut top = vec![(0u64, None::<&Stamp>); out.len()];
    for stamp in stamps {
        let span = |begin: i64, low: usize, high: usize| {
            let first = begin.max(low as i64);
            let last = (begin + side as i64).min(high as i64);
            first.max(0) as usize..last.max(first).max(0) as usize
        };
        for row in span(stamp.place.top, first_row, first_row + rows) {
            for col in span(stamp.place.left, region.col, region.right()) {
                let slot = &mut top[(row - first_row) * region.width + col - region.col];
                if slot.1.is_none() || stamp.place.rank > slot.0 {
                    *slot = (stamp.place.rank, Some(stamp));
                }
            }
        }
    }
    for (i, (out, (_, stamp))) in out.iter_mut().zip(top).enumerate() {
        let (col, row) = (region.col + i % region.width, first_row + i / region.width);
        if let Some(color) = stamp.and_then(|stamp| stamp.color_at(side, col, row)) {
            *out = color.to_linear();
        }
    }
}

/// A well-mixed number for a grid point (the finaliser of `SplitMix64`).
fn hash(seed: u64, i: i64, j: i64) -> u64 {
    let mut z = seed
        .wrapping_add((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add((j as u64).wrapping_mul(0xd1b5_4a32_d192_ed03));
    for multiplier in [0xbf58_476d_1ce4_e5b9u64, 0x94d0_49bb_1331_11eb] {
        z = (z ^ (z >> 30)).wrapping_mul(multiplier);
    }
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Srgb;

    #[test]
    fn every_pixel_lies_under_a_square() {
        let image = Image::new(Size::new(61, 47).unwrap(), Srgb([200u8, 100, 50]));
        for side in [3, 9, 31] {
            for seed in 0..5 {
                let region = Rect::of(image.size());
                let stamped = stamp(&image, region, side, seed, &Progress::none()).unwrap();
                assert!(
                    stamped
                        .pixels()
                        .iter()
                        .all(|&p| Srgb::<u8>::from_linear(p) == Srgb([200, 100, 50]))
                );
            }
        }
    }

    #[test]
    fn pictures_smaller_than_a_square_stay_opaque() {
        let image = Image::new(Size::new(7, 2).unwrap(), Srgb([200u8, 100, 50]));
        let region = Rect::of(image.size());
        let stamped = stamp(&image, region, 9, 0, &Progress::none()).unwrap();
        assert!(
            stamped
                .pixels()
                .iter()
                .all(|p| (p.alpha() - 1.0).abs() < 1e-6)
        );
    }

    #[test]
    fn another_seed_scatters_differently() {
        let image = Image::from_fn(Size::new(60, 60).unwrap(), |col, row| {
            Srgb([(col * 4) as u8, (row * 4) as u8, 60])
        });
        let run = |seed| stamp(&image, Rect::of(image.size()), 9, seed, &Progress::none()).unwrap();
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }
}
