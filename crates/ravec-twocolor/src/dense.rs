//! A two-color pixel at every pixel: the window around it, its split, and the side that it is on.
//!
//! This is the *two-color operator* of the source (dissertation, chapter 3), from which the brush is made. Windows of
//! neighboring pixels overlap almost wholly, so they lie in neighboring lanes and load without any shuffling.
//!
//! Cost: as the exact fit of one block a pixel; 9 × 9 windows take about a quarter of a microsecond each and core with
//! 16 lanes. Memory: the result, and a few rows of the region.

use crate::filter_error::FilterError;
use crate::fit::{FlatThreshold, opaque_pixel, weighted_pixel};
use crate::pixel::{TwoColorPixel, countable};
use crate::split_table::{MAX_EXACT_SIDE, SplitTable, split_table};
use crate::sweep::{Batch, MAX_LANES, OPAQUE, WEIGHTED};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::oklab_from_linear;
use ravec_raster::{Color, Image, LinearRgba, LinearRows, Oklab, Pixel, Rect};
use rayon::prelude::*;

/// Sides of windows around a pixel, for messages.
pub(crate) const ODD_SIDES: &str = "an odd side of 3 to 31";

/// The window around each pixel.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindowParams {
    /// Side of the square window in pixels, odd, 3 to 31 (default 9). Larger windows smooth more and lose details
    /// smaller than they are; cost grows with the fourth power.
    pub window_px: usize,
    /// Oklab contrast below which a window has one side only, 0 to 1 (default 0.01).
    pub flat_contrast: f32,
}

impl Default for WindowParams {
    fn default() -> Self {
        Self {
            window_px: 9,
            flat_contrast: 0.01,
        }
    }
}

/// The two-color pixel of the window centered at one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CenteredWindow {
    /// The window's fit. Where the image's border clips the window, only what lies inside counts.
    pub fit: TwoColorPixel,
    /// The side on which the window's central pixel lies: 0 or 1, and 0 in a flat window.
    pub own_side: usize,
}

impl CenteredWindow {
    /// The mean color of the side that the central pixel is on.
    pub fn own_color(&self) -> Oklab {
        self.fit.colors[self.own_side]
    }

    /// The mean color of the other side; the same color in a flat window.
    pub fn other_color(&self) -> Oklab {
        self.fit.colors[1 - self.own_side]
    }

    /// The mean alpha of the side that the central pixel is on.
    pub fn own_alpha(&self) -> f32 {
        self.fit.alphas[self.own_side]
    }
}

/// Fits the window around each pixel of `region` and maps it by `f(col, row, window)`, in parallel.
///
/// `region` is clipped to the image; pixels outside it are read where windows reach them. The result has the size of
/// the clipped region.
///
/// # Errors
/// [`FilterError::Window`] if the window is even, below 3 or above 31; [`FilterError::EmptyRegion`] if the region has no
/// pixel of the image; [`FilterError::Cancelled`] soon after `progress` is.
pub fn map_windows<P: Color, Q: Pixel>(
    image: &Image<P>,
    region: Rect,
    params: &WindowParams,
    progress: &Progress,
    f: impl Fn(usize, usize, &CenteredWindow) -> Q + Sync,
) -> Result<Image<Q>, FilterError> {
    let side = params.window_px;
    if !(3..MAX_EXACT_SIDE).contains(&side) || side.is_multiple_of(2) {
        return Err(FilterError::Window {
            got: side,
            expected: ODD_SIDES,
        });
    }
    let region = region.intersection(Rect::of(image.size()));
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    let table = split_table(side);
    let level = Level::new();
    let flat = FlatThreshold(params.flat_contrast);
    let outside = Q::zeroed();
    let mut result = Image::new(size, outside);
    let phase = progress.phase("windows", size.height() as u64);
    result
        .par_strips_mut(STRIP_ROWS)
        .enumerate()
        .try_for_each(|(strip, out)| {
            progress.check()?;
            let rows = out.len() / region.width;
            let centers = Rect::new(
                region.col,
                region.row + strip * STRIP_ROWS,
                region.width,
                rows,
            );
            map_strip(level, image, centers, table, flat, &mut |x, y, windows| {
                let out = &mut out[y * centers.width + x..];
                for (i, (out, window)) in out.iter_mut().zip(windows).enumerate() {
                    *out = f(centers.col + x + i, centers.row + y, window);
                }
            });
            phase.advance(rows as u64);
            Ok::<(), Cancelled>(())
        })?;
    Ok(result)
}

/// Receives neighboring windows, with the column and row of the first in the strip.
type Receiver<'a> = &'a mut dyn FnMut(usize, usize, &[CenteredWindow]);

/// Fits the windows around the pixels of `centers`.
fn map_strip(
    level: Level,
    image: &dyn LinearRows,
    centers: Rect,
    table: &SplitTable,
    flat: FlatThreshold,
    receiver: Receiver<'_>,
) {
    dispatch!(level, simd => {
        Surroundings::read(image, centers, table.side / 2).map(simd, table, flat, receiver);
    });
}

/// Rows of windows done by one task: enough to spread the cost of their surroundings, few enough to cancel promptly.
const STRIP_ROWS: usize = 8;

/// The pixels under the windows of a strip, as planes: Oklab times weight, the weight, and 1 inside the image.
struct Surroundings {
    centers: Rect,
    image: Rect,
    half: usize,
    /// Pixels in a row of each plane, with room for a whole batch past the end.
    stride: usize,
    opaque: bool,
    planes: [Vec<f32>; WEIGHTED],
}

impl Surroundings {
    #[inline(always)]
    fn read(image: &dyn LinearRows, centers: Rect, half: usize) -> Self {
        let size = image.size();
        let (width, rows) = (centers.width + 2 * half, centers.height + 2 * half);
        let stride = width + MAX_LANES;
        let mut planes = [const { Vec::new() }; WEIGHTED];
        for plane in &mut planes {
            plane.resize(rows * stride, 0.0);
        }
        let mut opaque = true;
        let first_col = centers.col.saturating_sub(half);
        let last_col = (centers.right() + half).min(size.width());
        let mut run = vec![LinearRgba::default(); last_col - first_col];
        let skipped = half - (centers.col - first_col);
        for y in 0..rows {
            let Some(row) = (centers.row + y)
                .checked_sub(half)
                .filter(|&row| row < size.height())
            else {
                continue;
            };
            let from = y * stride + skipped;
            image.read_linear(row, first_col, &mut run);
            let [l, a, b, alpha, inside] = &mut planes;
            let [l, a, b, alpha, inside] =
                [l, a, b, alpha, inside].map(|plane| &mut plane[from..][..run.len()]);
            for (i, &pixel) in run.iter().enumerate() {
                [l[i], a[i], b[i], alpha[i]] = countable(pixel).0;
            }
            for i in 0..run.len() {
                [l[i], a[i], b[i]] = oklab_from_linear([l[i], a[i], b[i]]);
                inside[i] = 1.0;
            }
            if alpha.iter().any(|&alpha| alpha < 1.0) {
                opaque = false;
                for i in 0..run.len() {
                    alpha[i] = alpha[i].clamp(0.0, 1.0);
                    l[i] *= alpha[i];
                    a[i] *= alpha[i];
                    b[i] *= alpha[i];
                }
            }
        }
        Self {
            centers,
            image: Rect::of(size),
            half,
            stride,
            opaque,
            planes,
        }
    }

    #[inline(always)]
    fn map<S: Simd>(
        &self,
        simd: S,
        table: &SplitTable,
        flat: FlatThreshold,
        receiver: Receiver<'_>,
    ) {
        let lanes = Batch::<S, OPAQUE>::LANES;
        let count = table.side * table.side;
        let mut opaque = Batch::<S, OPAQUE>::new(simd, count);
        let mut weighted = None;
        let empty = centered(TwoColorPixel::flat(Oklab::default(), 0.0, 0.0));
        let mut fitted = [empty; MAX_LANES];
        for y in 0..self.centers.height {
            let row = self.centers.row + y;
            for x in (0..self.centers.width).step_by(lanes) {
                let fitted = &mut fitted[..lanes.min(self.centers.width - x)];
                if self.opaque && self.whole(self.centers.col + x, row, fitted.len()) {
                    self.load(simd, &mut opaque, x, y);
                    let found = opaque.best_split(table);
                    for (lane, window) in fitted.iter_mut().enumerate() {
                        *window = centered(opaque_pixel(table, &found.lane(lane), flat));
                    }
                } else {
                    let weighted =
                        weighted.get_or_insert_with(|| Batch::<S, WEIGHTED>::new(simd, count));
                    self.load(simd, weighted, x, y);
                    let found = weighted.best_split(table);
                    for (lane, window) in fitted.iter_mut().enumerate() {
                        *window = centered(weighted_pixel(table, &found.lane(lane), flat));
                    }
                }
                receiver(x, y, fitted);
            }
        }
    }

    /// Returns `true` if the windows around `count` pixels from `(col, row)` on lie wholly inside the image.
    fn whole(&self, col: usize, row: usize, count: usize) -> bool {
        let half = self.half;
        col >= half
            && row >= half
            && col + count + half <= self.image.width
            && row + half < self.image.height
    }

    /// Loads the windows whose centers begin at `(x, y)` of the strip, one a lane.
    #[inline(always)]
    fn load<S: Simd, const CHANNELS: usize>(
        &self,
        simd: S,
        batch: &mut Batch<S, CHANNELS>,
        x: usize,
        y: usize,
    ) {
        let side = 2 * self.half + 1;
        for (dy, slots) in batch.pixels.chunks_exact_mut(side).enumerate() {
            for (dx, slot) in slots.iter_mut().enumerate() {
                let from = (y + dy) * self.stride + x + dx;
                for (channel, plane) in slot.iter_mut().zip(&self.planes) {
                    *channel = S::f32s::from_slice(simd, &plane[from..][..S::f32s::LEN]);
                }
            }
        }
    }
}

fn centered(fit: TwoColorPixel) -> CenteredWindow {
    // the central pixel is at the line's origin
    let own_side = usize::from(fit.line.is_some_and(|line| line.offset_px < 0.0));
    CenteredWindow { fit, own_side }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FitParams, TwoColorField};
    use ravec_raster::Size;

    fn textured(width: usize, height: usize, transparent: bool) -> Image<LinearRgba> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let v = |k: usize| ((col * 37 + row * 91 + col * row * k) % 101) as f32 / 100.0;
            LinearRgba([v(3), v(5), v(7), if transparent { v(11) } else { 1.0 }])
        })
    }

    #[test]
    fn each_window_is_fitted_as_the_block_that_it_is() {
        for transparent in [false, true] {
            let image = textured(41, 23, transparent);
            let params = WindowParams {
                window_px: 5,
                flat_contrast: 0.0,
            };
            let region = Rect::new(0, 0, 41, 23);
            let errors = map_windows(
                &image,
                region,
                &params,
                &Progress::none(),
                |_, _, window| window.fit.error,
            )
            .unwrap();
            let contrasts = map_windows(
                &image,
                region,
                &params,
                &Progress::none(),
                |_, _, window| window.fit.contrast(),
            )
            .unwrap();
            for row in 2..21 {
                for col in 2..39 {
                    let block = image
                        .crop(col - 2, row - 2, Size::new(5, 5).unwrap())
                        .unwrap();
                    let fit = FitParams {
                        block_px: 5,
                        flat_contrast: 0.0,
                        ..FitParams::default()
                    };
                    let field = TwoColorField::fit(&block, &fit, &Progress::none()).unwrap();
                    assert_eq!(errors[(col, row)], field.block(0, 0).error);
                    assert_eq!(contrasts[(col, row)], field.block(0, 0).contrast());
                }
            }
        }
    }

    #[test]
    fn a_region_gives_the_same_windows_as_the_whole_image() {
        let image = textured(60, 40, false);
        let params = WindowParams::default();
        let color = |_: usize, _: usize, window: &CenteredWindow| window.own_color();
        let whole = map_windows(
            &image,
            Rect::of(image.size()),
            &params,
            &Progress::none(),
            color,
        )
        .unwrap();
        for region in [
            Rect::new(0, 0, 1, 1),
            Rect::new(13, 7, 29, 19),
            Rect::new(50, 30, 100, 100),
        ] {
            let part = map_windows(&image, region, &params, &Progress::none(), color).unwrap();
            assert_eq!(
                part,
                whole.crop(region.col, region.row, part.size()).unwrap()
            );
        }
    }

    #[test]
    fn the_own_side_of_an_edge_keeps_its_color() {
        let (dark, bright) = (
            LinearRgba([0.1, 0.1, 0.2, 1.0]),
            LinearRgba([0.9, 0.8, 0.7, 1.0]),
        );
        let image = Image::from_fn(Size::new(32, 32).unwrap(), |col, row| {
            if 2 * col > row + 12 { bright } else { dark }
        });
        let colors = map_windows(
            &image,
            Rect::of(image.size()),
            &WindowParams::default(),
            &Progress::none(),
            |_, _, window| window.own_color(),
        )
        .unwrap();
        for row in 0..32 {
            for col in 0..32 {
                let own = oklab_from_linear(image[(col, row)].rgb());
                for (found, planted) in colors[(col, row)].0.into_iter().zip(own) {
                    assert!((found - planted).abs() < 1e-5, "({col}, {row})");
                }
            }
        }
    }

    #[test]
    fn even_or_huge_windows_and_empty_regions_are_refused() {
        let image = textured(8, 8, false);
        let run = |window_px, region| {
            let params = WindowParams {
                window_px,
                ..WindowParams::default()
            };
            map_windows(
                &image,
                region,
                &params,
                &Progress::none(),
                |_, _, window| window.fit.error,
            )
            .map(|_| ())
        };
        let region = Rect::of(image.size());
        for got in [0, 1, 8, 33] {
            assert_eq!(
                run(got, region),
                Err(FilterError::Window {
                    got,
                    expected: ODD_SIDES
                })
            );
        }
        assert_eq!(run(9, Rect::new(8, 0, 5, 5)), Err(FilterError::EmptyRegion));
        assert_eq!(run(31, region), Ok(()));
    }
}
