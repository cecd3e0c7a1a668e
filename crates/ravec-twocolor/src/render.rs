//! Two-color pixels drawn at any size, with exact coverage.
//!
//! A field is a picture without resolution: squares, each cut by a line into two colors. A pixel of the rendering is
//! the mean of that picture over the pixel's square, by exact area, in linear light and premultiplied by alpha. The
//! share of a half plane in an axis-parallel rectangle has a closed form, so nothing is sampled and no polygon is
//! clipped: for each pixel and block the two have a rectangle in common, and the line cuts it.
//!
//! Guarantees: sums are taken in f64 and rounded once, so that a constant field renders exactly constant at any size, and
//! the result does not depend on the number of threads. Does not guarantee: colors inside the gamut, since Oklab means
//! may lie a little outside it.
//!
//! Cost: O(pixels of the rendering + blocks). Memory: the result, and 32 bytes a pixel for the eight rows that each
//! thread works on.

use crate::line::Line;
use crate::placed::{BlockField, PlacedBlock};
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::linear_from_oklab;
use ravec_raster::{Image, LinearRgba, Oklab, Rect, Size, SizeError};
use rayon::prelude::*;

/// Why a field could not be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The scale is not a positive number.
    #[error("the scale is {got}: choose a number above 0")]
    Scale {
        /// The requested scale.
        got: f64,
    },
    /// The scaled picture is too large.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Renders `field` at `scale` times the size of its image.
///
/// The sides are rounded to whole pixels, at least 1, and the picture fills them: where rounding changes the ratio of
/// the sides, the two axes are scaled by slightly different factors. Pixels without any opacity are transparent black.
///
/// The result takes 16 bytes a pixel; a caller with little memory checks the scale first.
///
/// # Errors
/// [`RenderError::Scale`] if `scale` is not finite and above 0, [`RenderError::Size`] if the result would be too large
/// for an image, [`RenderError::Cancelled`] soon after `progress` is.
pub fn render(
    field: &impl BlockField,
    scale: f64,
    progress: &Progress,
) -> Result<Image<LinearRgba>, RenderError> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(RenderError::Scale { got: scale });
    }
    let size = field.image_size();
    // `as` saturates, and `Size` refuses what is too large
    let scaled = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    let size = Size::new(scaled(size.width()), scaled(size.height()))?;
    Ok(render_to(field, size, progress)?)
}

/// Renders `field` so that it fills `size`.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub fn render_to(
    field: &impl BlockField,
    size: Size,
    progress: &Progress,
) -> Result<Image<LinearRgba>, Cancelled> {
    paint(field, size, progress, |block| Paint {
        line: block.line_in_image(),
        sides: [0, 1].map(|side| premultiplied(block.pixel.colors[side], block.pixel.alphas[side])),
    })
}

/// Renders `field` with one color a block, the mean of its pixels: the plain mosaic to compare with.
///
/// The mean is taken in Oklab, weighted by alpha: of all single colors it has the least error as the fit counts it.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub fn render_mosaic(
    field: &impl BlockField,
    size: Size,
    progress: &Progress,
) -> Result<Image<LinearRgba>, Cancelled> {
    let image_size = field.image_size();
    paint(field, size, progress, |block| {
        let (color, alpha) = block.mean(image_size);
        Paint {
            line: None,
            sides: [premultiplied(color, alpha); 2],
        }
    })
}

/// Rows of the result that one task works on: few, so that their sums stay in the cache.
const STRIP_ROWS: usize = 8;

/// Blocks between two checks for cancellation, well under a millisecond's worth.
const BLOCKS_PER_CHECK: usize = 1024;

/// Paint of one block.
struct Paint {
    /// In pixels of the image, from its corner.
    line: Option<Line>,
    /// Premultiplied linear light of each side.
    sides: [[f64; 4]; 2],
}

fn premultiplied(color: Oklab, alpha: f32) -> [f64; 4] {
    let [r, g, b] = linear_from_oklab(color.0).map(|v| f64::from(v) * f64::from(alpha));
    [r, g, b, f64::from(alpha)]
}

fn paint(
    field: &impl BlockField,
    size: Size,
    progress: &Progress,
    paint_of: impl Fn(&PlacedBlock) -> Paint + Sync,
) -> Result<Image<LinearRgba>, Cancelled> {
    let to_output = Axes {
        from: field.image_size(),
        to: size,
    };
    let mut image = Image::new(size, LinearRgba::default());
    let phase = progress.phase("render", size.height() as u64);
    image
        .par_strips_mut(STRIP_ROWS)
        .enumerate()
        .try_for_each(|(index, out)| {
            let rows = out.len() / size.width();
            let mut strip = Strip {
                window: Rect::new(0, index * STRIP_ROWS, size.width(), rows),
                sums: vec![[0.0; 4]; out.len()],
            };
            let blocks = field.blocks_in_rows(to_output.source_rows(strip.window));
            for (count, block) in blocks.enumerate() {
                if count % BLOCKS_PER_CHECK == 0 {
                    progress.check()?;
                }
                let area = to_output.area(block.rect(to_output.from));
                let paint = paint_of(&block);
                let edge = paint.line.map(|line| to_output.edge(&line));
                strip.add(&area, &paint, edge.as_ref());
            }
            for (pixel, sum) in out.iter_mut().zip(&strip.sums) {
                *pixel = straight(*sum);
            }
            phase.advance(rows as u64);
            Ok(())
        })?;
    Ok(image)
}

fn straight([r, g, b, alpha]: [f64; 4]) -> LinearRgba {
    if alpha <= 0.0 {
        return LinearRgba::default();
    }
    LinearRgba([r / alpha, g / alpha, b / alpha, alpha].map(|v| v as f32))
}

/// From pixels of the image to pixels of the rendering.
struct Axes {
    from: Size,
    to: Size,
}

impl Axes {
    /// An edge between columns of the image. Whole where it falls between columns of the rendering, since the division
    /// is rounded once.
    fn x(&self, col: usize) -> f64 {
        (col as u128 * self.to.width() as u128) as f64 / self.from.width() as f64
    }

    fn y(&self, row: usize) -> f64 {
        (row as u128 * self.to.height() as u128) as f64 / self.from.height() as f64
    }

    fn area(&self, rect: Rect) -> Area {
        Area {
            x: [self.x(rect.col), self.x(rect.right())],
            y: [self.y(rect.row), self.y(rect.bottom())],
        }
    }

    fn edge(&self, line: &Line) -> Edge {
        Edge {
            normal: line.normal
                * DVec2::new(
                    self.from.width() as f64 / self.to.width() as f64,
                    self.from.height() as f64 / self.to.height() as f64,
                ),
            offset: line.offset_px,
        }
    }

    /// The rows of the image under those of the rendering.
    fn source_rows(&self, window: Rect) -> std::ops::Range<usize> {
        let (from, to) = (self.from.height() as u128, self.to.height() as u128);
        let first = window.row as u128 * from / to;
        let end = (window.bottom() as u128 * from).div_ceil(to);
        first as usize..end as usize
    }
}

/// An axis-parallel rectangle in the rendering.
struct Area {
    x: [f64; 2],
    y: [f64; 2],
}

/// A line in the rendering: `normal·p = offset`, the normal of any length.
struct Edge {
    normal: DVec2,
    offset: f64,
}

impl Edge {
    /// The share of side 0 in a rectangle.
    ///
    /// The rectangle is stretched to a unit square, which stretches the normal; from there it is the area under a box
    /// filter of an edge, integrated once along each axis. With `a`, `b` the components of the stretched normal, `u`
    /// how far the center lies within side 0, and `F(t) = max(0, t)²`:
    /// `[F(u + (a+b)/2) − F(u + (a−b)/2) − F(u − (a−b)/2)] / 2ab` for `|u| < (a+b)/2`.
    #[inline]
    fn share_of(&self, center: DVec2, extent: DVec2) -> f64 {
        let (a, b) = (
            (self.normal.x * extent.x).abs(),
            (self.normal.y * extent.y).abs(),
        );
        let u = self.offset - self.normal.dot(center);
        let sum = 0.5 * (a + b);
        if u >= sum {
            return 1.0;
        }
        if u <= -sum {
            return 0.0;
        }
        if a.min(b) < PARALLEL * a.max(b) {
            return (u / a.max(b) + 0.5).clamp(0.0, 1.0);
        }
        let difference = 0.5 * (a - b);
        let square = |t: f64| t.max(0.0) * t.max(0.0);
        let area = square(u + sum) - square(u + difference) - square(u - difference);
        (area / (2.0 * a * b)).clamp(0.0, 1.0)
    }
}

/// Below this ratio of the normal's components the edge counts as parallel to an axis. The error of that is a quarter
/// of it; the general form would lose as many digits as the ratio has, and keeps ten here.
const PARALLEL: f64 = 1e-6;

/// Rows of the rendering while blocks are added to them.
struct Strip {
    window: Rect,
    sums: Vec<[f64; 4]>,
}

impl Strip {
    /// Adds what `area` contributes to each pixel.
    fn add(&mut self, area: &Area, paint: &Paint, edge: Option<&Edge>) {
        let first_row = (area.y[0] as usize).max(self.window.row);
        let end_row = (area.y[1].ceil() as usize).min(self.window.bottom());
        let first_col = area.x[0] as usize;
        let end_col = (area.x[1].ceil() as usize).min(self.window.width);
        let [side_0, side_1] = paint.sides;
        for row in first_row..end_row {
            let [top, bottom] = [area.y[0].max(row as f64), area.y[1].min((row + 1) as f64)];
            let from = (row - self.window.row) * self.window.width;
            let sums = &mut self.sums[from..][first_col..end_col];
            for (col, sum) in (first_col..).zip(sums) {
                let [left, right] = [area.x[0].max(col as f64), area.x[1].min((col + 1) as f64)];
                let extent = DVec2::new(right - left, bottom - top);
                let share = edge.map_or(1.0, |edge| {
                    edge.share_of(0.5 * DVec2::new(left + right, top + bottom), extent)
                });
                let weight_0 = share * extent.x * extent.y;
                let weight_1 = (1.0 - share) * extent.x * extent.y;
                for (sum, (c0, c1)) in sum.iter_mut().zip(side_0.iter().zip(&side_1)) {
                    *sum += weight_0 * c0 + weight_1 * c1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_share_is_that_of_the_points_on_side_0(
            angle in 0.0f64..7.0, offset in -1.5f64..1.5, stretch in 0.1f64..4.0, w in 0.05f64..1.0, h in 0.05f64..1.0,
        ) {
            let line = Line::from_angle(angle, offset);
            let edge = Edge { normal: line.normal * DVec2::new(1.0, stretch), offset };
            let (center, extent, n) = (DVec2::new(0.2, -0.1), DVec2::new(w, h), 64);
            let inside = (0..n * n).filter(|i| {
                let cell = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / f64::from(n) - 0.5;
                edge.normal.dot(center + extent * cell) < offset
            });
            let naive = inside.count() as f64 / f64::from(n * n);
            // the edge crosses at most 2n of the n² cells
            prop_assert!((edge.share_of(center, extent) - naive).abs() < 2.0 / f64::from(n));
        }
    }

    #[test]
    fn nearly_parallel_edges_have_the_share_of_parallel_ones() {
        for tilt in [0.0, 1e-9, 0.9e-6, 1.1e-6, 1e-5] {
            for step in -60..=60 {
                let u = f64::from(step) / 100.0;
                let edge = Edge {
                    normal: DVec2::new(1.0, tilt),
                    offset: u,
                };
                let share = edge.share_of(DVec2::ZERO, DVec2::ONE);
                // tilting by t moves the share by t/4 at most; a thousand units of the tenth digit for rounding
                assert!(
                    (share - (u + 0.5).clamp(0.0, 1.0)).abs() <= 0.25 * tilt + 1e-9,
                    "{tilt} {u}"
                );
            }
        }
    }
}
